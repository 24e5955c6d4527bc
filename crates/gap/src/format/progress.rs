//! The progress of a diagnosis.

use std::fmt;

/// The current stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The nominal model is simulated.
    Simulating,
    /// Times of changes of a parameter or a delay are searched.
    Scanning,
    /// This number of candidates is screened.
    Screening(usize),
    /// The candidates with the largest predicted cost reduction are fitted.
    Fitting,
    /// Pairs of effects are searched.
    Pairing,
    /// The leading hypotheses are fitted again under their noise; this is the n-th time, from 0.
    Refitting(usize),
    /// The best delay is at the limit of the search: the whole diagnosis is repeated with longer ones.
    Longer,
    /// The found effects are judged.
    Judging,
    /// This number of causes is found; one more is searched.
    Composing(usize),
    /// The answer is assembled: shares, intervals, remainder.
    Describing,
}

impl Stage {
    /// The part of a usual diagnosis that is over when the stage begins, 0 to 1.
    #[must_use]
    pub fn begins_at(self) -> f64 {
        match self {
            Self::Simulating | Self::Longer => 0.0,
            Self::Scanning => 0.01,
            Self::Screening(_) => 0.02,
            Self::Fitting => 0.1,
            Self::Pairing => 0.25,
            Self::Refitting(0) => 0.45,
            Self::Refitting(_) => 0.55,
            Self::Judging => 0.6,
            Self::Composing(causes) => 0.63 + 0.05 * causes.min(6) as f64,
            Self::Describing => 0.95,
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Simulating => f.write_str("simulating the model as it is"),
            Self::Scanning => f.write_str("looking for times at which something changes"),
            Self::Screening(candidates) => write!(f, "screening {candidates} candidates"),
            Self::Fitting => f.write_str("fitting the best candidates"),
            Self::Pairing => f.write_str("searching pairs"),
            Self::Refitting(_) => {
                f.write_str("refitting under the noise of the leading candidates")
            }
            Self::Longer => f.write_str("a delay may be longer: searching again"),
            Self::Judging => f.write_str("judging"),
            Self::Composing(0) => f.write_str("searching several causes"),
            Self::Composing(1) => f.write_str("searching a second cause"),
            Self::Composing(causes) => write!(f, "searching a cause in addition to {causes}"),
            Self::Describing => f.write_str("writing the answer"),
        }
    }
}

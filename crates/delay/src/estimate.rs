//! The result of an estimator.

use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::time::SampleTime;

/// Outcome of an estimation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// A delay was found.
    Found,
    /// The best delay is the longest in the search window.
    AtEdge,
    /// The output does not visibly follow the input.
    NotVisible,
    /// The input does not excite what the method must estimate.
    NotRichEnough,
    /// The equations have no unique solution.
    Singular,
    /// The optimiser found no minimum.
    NotConverged,
    /// Many delays fit equally well.
    Flat,
    /// The method cannot be used on this data.
    NotApplicable,
}

impl Outcome {
    /// The outcome comes with a delay.
    #[must_use]
    pub fn has_delay(self) -> bool {
        matches!(self, Self::Found | Self::AtEdge)
    }

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::AtEdge => "at_edge",
            Self::NotVisible => "not_visible",
            Self::NotRichEnough => "not_rich_enough",
            Self::Singular => "singular",
            Self::NotConverged => "not_converged",
            Self::Flat => "flat",
            Self::NotApplicable => "not_applicable",
        }
    }
}

/// The fit of a model to the samples that all models of a record fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// ln Σ e².
    pub log_cost: f64,
    /// Number of independent samples behind it.
    pub counting: f64,
    /// Free parameters.
    pub parameters: usize,
}

/// One method's estimate for one input and one output.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayEstimate {
    /// The outcome.
    pub outcome: Outcome,
    /// The dead time, s, the degree bias subtracted; with `Found` and `AtEdge` only.
    pub delay_s: Option<f64>,
    /// Its standard deviation, s, the resolution of the method included.
    pub std_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The estimate of the method's original definition, s.
    pub raw_delay_s: Option<f64>,
    /// Samples that were subtracted from the raw value: the relative degree of the sampled plant.
    pub degree_bias_samples: f64,
    /// A note for the reader.
    pub note: Option<Message>,
    /// The method's residual contradicts its own model; its interval is then too narrow.
    pub contradicted: bool,
    /// The fit of the method's model, where models of other orders fit the same samples.
    pub misfit: Option<Box<Misfit>>,
    /// The record, of one step or of several inputs, reveals no more poles than the method's model has.
    pub enough_poles: bool,
    /// The estimate uses the part of the input that the output did not cause ([`super::feedback::open_part`]).
    pub open_part: bool,
}

fn longest_searched() -> Message {
    Message::from("the best delay is the longest searched: give a longer ").and(Remedy::MaxDelay)
}

impl DelayEstimate {
    /// An estimate with an outcome alone.
    pub(super) fn bare(outcome: Outcome) -> Self {
        Self {
            outcome,
            delay_s: None,
            std_s: None,
            ci95_s: None,
            raw_delay_s: None,
            degree_bias_samples: 0.0,
            note: None,
            contradicted: false,
            misfit: None,
            enough_poles: false,
            open_part: false,
        }
    }

    /// An estimate with a delay; at the edge of the window, the note says that it may be longer.
    fn found(at_edge: bool) -> Self {
        let outcome = if at_edge { Outcome::AtEdge } else { Outcome::Found };
        Self { note: at_edge.then(longest_searched), ..Self::bare(outcome) }
    }

    /// An estimate without a delay.
    #[must_use]
    pub fn without(outcome: Outcome, note: impl Into<Message>) -> Self {
        Self { note: Some(note.into()), ..Self::bare(outcome) }
    }

    /// An estimate in samples, before the bias `off` is subtracted: raw value, standard deviation and interval. The bias may be a fraction (half a sample for a
    /// phase behind a zero-order hold).
    pub(super) fn measured(
        raw: f64,
        std: f64,
        interval: [f64; 2],
        at_edge: bool,
        off: f64,
        sample_time: SampleTime,
    ) -> Self {
        let seconds = |samples: f64| sample_time.to_seconds(samples - off);
        if [raw, std, interval[0], interval[1]].iter().any(|v| v.is_nan()) {
            return Self::without(
                Outcome::Singular,
                "the numbers of the record leave no finite answer: too large, too small, or too alike",
            );
        }
        Self {
            delay_s: Some(seconds(raw)),
            std_s: Some(sample_time.to_seconds(std)),
            ci95_s: Some(interval.map(seconds)),
            raw_delay_s: Some(sample_time.to_seconds(raw)),
            degree_bias_samples: off,
            ..Self::found(at_edge)
        }
    }

    /// The estimate of a method in continuous time: all values in seconds, no bias.
    pub(super) fn in_seconds(delay_s: f64, std_s: f64, ci95_s: [f64; 2], at_edge: bool) -> Self {
        if [delay_s, std_s, ci95_s[0], ci95_s[1]].iter().any(|v| !v.is_finite()) {
            return Self::without(
                Outcome::Singular,
                "the numbers leave no finite answer: too large, too small, or too alike",
            );
        }
        Self {
            delay_s: Some(delay_s),
            std_s: Some(std_s),
            ci95_s: Some(ci95_s),
            raw_delay_s: Some(delay_s),
            ..Self::found(at_edge)
        }
    }

    /// The estimate for a record whose input was shifted `later` seconds. Delays are bounded by zero, and a note reports a negative one.
    pub(super) fn finished(mut self, later_s: f64) -> Self {
        let whole = |v: f64| (v + later_s).max(0.0);
        let within = self.delay_s.is_some_and(|d| {
            d + later_s < -1e-9 * self.raw_delay_s.map_or(1.0, |r| r.abs().max(1e-12))
        });
        self.delay_s = self.delay_s.map(whole);
        self.ci95_s = self.ci95_s.map(|ends| ends.map(whole));
        self.raw_delay_s = self.raw_delay_s.map(|v| v + later_s);
        let note = "the output reacts within the sample: no dead time, and a direct path or a faster response than assumed";
        self.noting(within.then(|| note.to_owned()))
    }

    /// Marks the estimate, with a note, where the method's residual contradicts its model.
    #[must_use]
    pub(super) fn contradicted(mut self, why: Option<String>) -> Self {
        self.contradicted |= why.is_some();
        self.noting(why)
    }

    /// Marks the estimate as based on the part of the input that the output did not cause.
    #[must_use]
    pub(super) fn of_open_part(mut self) -> Self {
        self.open_part = true;
        self.noting(Some("from the part of the input that the output did not cause".to_owned()))
    }

    /// With a raw value that differs from the estimate, s.
    #[must_use]
    pub(super) fn with_raw_s(self, raw_delay_s: f64) -> Self {
        Self { raw_delay_s: Some(raw_delay_s), ..self }
    }

    /// Adds a sentence to the note.
    #[must_use]
    pub(super) fn noting(mut self, more: Option<impl Into<Message>>) -> Self {
        self.note = match (self.note, more.map(Into::into)) {
            (Some(a), Some(b)) => Some(a.and("; ").and(b)),
            (a, b) => a.or(b),
        };
        self
    }
}

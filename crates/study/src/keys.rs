//! The keys of a cell: loops, places, references of the answers, and injected delays.

use serde::{Deserialize, Serialize};

/// Whether u is the command of the log's author, or the output of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loop {
    /// No feedback.
    Open,
    /// The sampled plant with state feedback u = r − K·x as a plant of input r: y = (C − D·K)x + D·r. K is that of `dlqr` with unit weights.
    Stabilised,
    /// Feedback of the noisy output through a controller of the plan's, or of the states by `dlqr`.
    Closed,
}

impl Loop {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Stabilised => "stabilised",
            Self::Closed => "closed",
        }
    }
}

/// The signals of the delay estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// The plant's input.
    U,
    /// The reference.
    R,
}

/// The reference of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Truth {
    /// The method's raw answer with its own convention (10 for 9 s behind a hold of 1 s).
    Raw,
    /// The dead time with the injected one.
    Delay,
}

impl Place {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::U => "u",
            Self::R => "r",
        }
    }
}

impl Truth {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Delay => "delay",
        }
    }
}

/// An injected delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Delay {
    /// The same at every input, s.
    Same(f64),
    /// One per input, s.
    PerInput(Vec<f64>),
    /// Drawn anew for every trial and input.
    Drawn(Drawn),
}

/// A delay drawn with equal chances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// From and to, s.
    pub uniform_s: [f64; 2],
    /// Whole samples only, both ends included.
    #[serde(default)]
    pub whole: bool,
}

impl std::fmt::Display for Delay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Same(s) => write!(f, "{s}"),
            Self::PerInput(all) => {
                f.write_str(&all.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))
            }
            Self::Drawn(Drawn { uniform_s: [from, to], whole }) => {
                write!(f, "{from}..{to}{}", if *whole { " whole" } else { "" })
            }
        }
    }
}

impl Delay {
    /// Seconds that can be: finite, not negative, and in order.
    pub(super) fn can_be(&self) -> bool {
        let fine = |s: &f64| s.is_finite() && *s >= 0.0;
        match self {
            Self::Same(s) => fine(s),
            Self::PerInput(all) => !all.is_empty() && all.iter().all(fine),
            Self::Drawn(Drawn { uniform_s: [from, to], .. }) => {
                *from >= 0.0 && from <= to && to.is_finite()
            }
        }
    }
}

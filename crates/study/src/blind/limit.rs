//! Limits on scores, for gates.

use std::fmt;
use std::str::FromStr;

use super::error::BlindError;
use super::score::BlindScore;
use super::scores;

/// A demand on a score: `NAME>=VALUE` or `NAME<=VALUE`.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    name: &'static str,
    side: Side,
    value: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    AtLeast,
    AtMost,
}

/// The result of the cases for a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The score, or at least its interval, reaches the limit.
    Kept,
    /// The whole interval (without one, the score itself) lies on the wrong side.
    Missed,
    /// No case has this score.
    NotMeasured,
}

impl FromStr for Limit {
    type Err = BlindError;

    fn from_str(text: &str) -> Result<Self, BlindError> {
        let syntax = || BlindError::LimitSyntax { text: text.to_owned() };
        let (name, side, value) = if let Some((name, value)) = text.split_once(">=") {
            (name, Side::AtLeast, value)
        } else if let Some((name, value)) = text.split_once("<=") {
            (name, Side::AtMost, value)
        } else {
            return Err(syntax());
        };
        let value: f64 = value.trim().parse().map_err(|_| syntax())?;
        if !value.is_finite() {
            return Err(syntax());
        }
        let known = scores::names();
        let name = name.trim();
        match known.iter().find(|k| **k == name) {
            Some(&name) => Ok(Self { name, side, value }),
            None => Err(BlindError::UnknownScore { name: name.to_owned(), known }),
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = match self.side {
            Side::AtLeast => ">=",
            Side::AtMost => "<=",
        };
        write!(f, "{}{sign}{}", self.name, self.value)
    }
}

impl Limit {
    /// The score that it is about.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The message where the scores violate it.
    #[must_use]
    pub fn unmet(&self, scores: &BlindScore) -> Option<String> {
        let value = scores.get(self.name).and_then(|s| s.value);
        match self.judge(scores) {
            Verdict::Kept => None,
            Verdict::Missed => {
                Some(format!("{self} was not met: it is {}", value.unwrap_or(f64::NAN)))
            }
            Verdict::NotMeasured => Some(format!("{self} was not met: no case has this score")),
        }
    }

    /// Whether the scores keep to it. A limit is missed only when chance does not explain it: when the 95 % interval lies beyond it as a whole.
    #[must_use]
    pub fn judge(&self, scores: &BlindScore) -> Verdict {
        let Some((score, value)) = scores.get(self.name).and_then(|s| Some((s, s.value?))) else {
            return Verdict::NotMeasured;
        };
        let [low, high] = score.ci95.unwrap_or([value; 2]);
        let missed = match self.side {
            Side::AtLeast => high < self.value,
            Side::AtMost => low > self.value,
        };
        if missed { Verdict::Missed } else { Verdict::Kept }
    }
}

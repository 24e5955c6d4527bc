//! Classes of causes that are indistinguishable on the logs, with the probability that one of the members acts.

use serde::{Deserialize, Serialize};

use super::contributions::{Share, Strength};

/// Effects of which these logs cannot tell which one acts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CauseClass {
    /// The calibrated probability that a member acts on the machine.
    pub probability: f64,
    /// The representative in words.
    pub name: String,
    /// The representative first, then what explains the training logs as well in its place.
    pub members: Vec<Member>,
    /// The member that the written model carries, as `effect:channel`; `recalibration` for the model's own parameters together.
    pub representative: String,
    /// Its share of the gap.
    pub share: Share,
    /// How clearly it shows.
    pub strength: Strength,
    /// The inputs of the probability.
    pub grounds: Grounds,
}

/// The inputs of the probability of a class.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grounds {
    /// The rise of the score of the best set without any member, in units of twice the log-likelihood.
    pub evidence: f64,
    /// The distance from nominal of the representative's worst known parameter, in standard deviations; of a recalibration, of all parameters together.
    pub deviations: f64,
    /// Its share of the gap on the training logs.
    pub share: f64,
}

/// A member of a class.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Member {
    /// An effect, as `effect:channel`.
    One(String),
    /// Several effects that together do the same.
    Several(Vec<String>),
}

/// The representative of a class that recalibrates the model's own parameters together.
pub(crate) const RECALIBRATION: &str = "recalibration";

/// An effect on a channel in words.
#[must_use]
pub fn in_words(effect: &str, channel: &str) -> String {
    let words = effect.replace('_', " ");
    match channel {
        "*" => format!("{words} of all outputs"),
        channel => format!("{words} of `{channel}`"),
    }
}

/// Several effects as a list in words.
#[must_use]
pub fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [others @ .., last] => format!("{} and {last}", others.join(", ")),
    }
}

//! The contributions to a gap and its remainder: the part of a diagnosis that `deadtime/diagnosis@2` added.

use serde::{Deserialize, Serialize};

use super::found::FoundParameter;
use super::place::{Band, Regime, TimeSpan, WhereOutput};
use deadtime_signal::remedy::Message;

/// The explained part of a gap, in classes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Explained {
    /// The remainder is noise, or a negligible part of the gap.
    All,
    /// Half of the gap or more is explained, and more than noise stays.
    Mostly,
    /// Less than half of the gap is explained.
    Part,
    /// Nothing was found to act.
    Nothing,
}

/// How clearly an effect shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Strength {
    /// Without it the error is larger by a factor that matters.
    Clear,
    /// It is certain, and changes the error little.
    Weak,
}

/// A share of before² − floor².
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Share {
    /// On the training logs.
    pub learnt: Option<f64>,
    /// On held-out data.
    pub held_out: Option<f64>,
    /// The 95 % interval of the held-out share, over resampled blocks of time; missing where there are too few.
    #[serde(default)]
    pub ci95: Option<[f64; 2]>,
}

/// An effect that was found to act, and how much of the gap it takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contribution {
    /// Its name.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// Its parameters.
    pub parameters: Vec<FoundParameter>,
    /// The probability of its class; missing in files of earlier programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// How clearly it shows.
    pub strength: Strength,
    /// Its share: the rise of the squared error when the effect is removed and the others stay. The shares are scaled so that they add up to the explained
    /// part.
    pub share: Share,
    /// The training nrmse without it, all others refitted; missing where that cannot be simulated.
    pub without_it: Option<f64>,
    /// Aliases of the effect, as `effect:channel`.
    pub class: Vec<String>,
    /// It predicts, but its value is not the physics'.
    pub surrogate: bool,
}

/// The model's own parameters as a group.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recalibration {
    /// Whether the data ask for it.
    pub accepted: bool,
    /// The relative size of the parameters' errors that predicts best; 0: as they came.
    pub size: f64,
    /// Its share of the gap.
    #[serde(default)]
    pub share: Share,
    /// The parameters with their new values.
    pub parameters: Vec<FoundParameter>,
    /// Sentences on indistinguishable parameters, and on parameters that predict without being physical.
    pub directions: Vec<String>,
}

/// The remainder of a gap.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Remainder {
    /// Its share of the gap.
    pub share: Share,
    /// The remainder over the noise floor; missing where no output moves.
    pub above_floor: Option<f64>,
    /// The outputs in which it is.
    pub outputs: Vec<WhereOutput>,
    /// Spans of time in which it is.
    #[serde(default)]
    pub times: Vec<TimeSpan>,
    /// Frequency bands in which it is.
    #[serde(default)]
    pub bands: Vec<Band>,
    /// Ranges of another variable in which it is.
    #[serde(default)]
    pub regimes: Vec<Regime>,
    /// The description of the remainder; missing where none is possible.
    pub description: Option<Description>,
    /// The relation of the remainder with the commands, where no cause was found; missing where the samples are too few.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unrelated: Option<Unrelated>,
}

/// How the remainder depends on past commands and the model's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unrelated {
    /// The chance that a residual without any relation goes with them as much.
    pub chance: f64,
    /// The explained part of the residual's innovations (the part that its own past does not predict); the largest of all outputs.
    pub explained: f64,
}

impl Unrelated {
    /// No relation is seen at a chance of 1 %, or one that explains next to nothing.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.chance >= 0.01 || self.explained < 0.02
    }
}

/// A missing force, as regressed from the remainder. A missing force is a description, and no cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// The state on whose derivative it acts.
    pub state: String,
    /// The variable that it goes with.
    pub goes_with: String,
    /// The part of its variance that the variable predicts on held-out data.
    pub held_out_r2: f64,
    /// Terms that describe it, best on the training logs first, as `--candidate` takes them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub suggested: Vec<String>,
    /// In words.
    pub sentence: Message,
}

//! The estimates of a log's own constants in the form of a diagnosis.

use serde::{Deserialize, Serialize};

use deadtime_model::EffectEntry;

/// One nuisance of the model file in one log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NuisanceEstimate {
    /// The effect.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// The log.
    pub log: String,
    /// Its parameter.
    pub parameter: String,
    /// The parameter's unit.
    pub unit: String,
    /// The value, given the reported effects.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
    /// The standard deviation of its prior.
    pub prior_std: f64,
}

impl NuisanceEstimate {
    /// As an effect that the log's simulation has.
    pub(crate) fn to_entry(&self) -> EffectEntry {
        EffectEntry {
            effect: self.effect.clone(),
            channel: self.channel.clone(),
            parameters: [(self.parameter.clone(), self.value)].into_iter().collect(),
        }
    }
}

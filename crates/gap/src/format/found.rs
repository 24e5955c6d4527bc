//! Effects with their parameters in the form of a diagnosis.

use serde::{Deserialize, Serialize};

/// An effect found to act.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoundEffect {
    /// Its name.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// Its parameters.
    pub parameters: Vec<FoundParameter>,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoundParameter {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its value; missing for a limit that does not act.
    pub value: Option<f64>,
    /// Its standard deviation; missing at a bound.
    pub std: Option<f64>,
    /// Its 95 % interval; missing at a bound.
    pub ci95: Option<[f64; 2]>,
}

//! The held-out error by how far ahead it is predicted: the part of a diagnosis that `deadtime/diagnosis@3` adds.

use serde::{Deserialize, Serialize};

/// Held-out errors of the nominal model and of the written one, nrmse over all outputs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorsByMode {
    /// One step ahead, by a fixed-gain observer of the nominal model; missing for a simulator that can only be called.
    pub one_step: Option<BeforeAfter>,
    /// Over horizons up to the model's slowest time constant.
    pub horizons: Vec<OverHorizon>,
    /// In a free run; missing where one leaves all bounds.
    pub free_run: Option<BeforeAfter>,
    /// The noise floor.
    pub floor: Option<f64>,
}

/// An error before and after the causes are added.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeforeAfter {
    /// Of the nominal model.
    pub before: f64,
    /// Of the written model.
    pub after: f64,
}

/// An error over a horizon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OverHorizon {
    /// Samples that are predicted from one estimated state.
    pub steps: usize,
    /// Of the nominal model.
    pub before: f64,
    /// Of the written model.
    pub after: f64,
}

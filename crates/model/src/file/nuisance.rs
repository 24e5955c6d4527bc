//! Values that are unknown in every log and no cause of a gap: `[[nuisances]]` of a model file.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::ModelError;

/// An effect with a separate value in every log, as in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NuisanceEntry {
    /// The effect's name.
    pub effect: String,
    /// Its channel.
    pub channel: String,
    /// The prior's standard deviation about the value of no effect, in the unit of its parameter.
    pub std: f64,
}

impl NuisanceEntry {
    /// `effect:channel`.
    #[must_use]
    pub fn key(&self) -> String {
        format!("{}:{}", self.effect, self.channel)
    }
}

/// Standard deviations are positive, and entries unique. The existence of the effects and channels is checked at their use.
pub(super) fn check_nuisances(path: &Path, nuisances: &[NuisanceEntry]) -> Result<(), ModelError> {
    for (at, entry) in nuisances.iter().enumerate() {
        let wrong = |why: String| {
            Err(ModelError::Nuisance { path: path.to_owned(), nuisance: entry.key(), why })
        };
        if !(entry.std.is_finite() && entry.std > 0.0) {
            return wrong(format!(
                "its `std` is {}; give how far it may be from log to log, a finite number above 0",
                entry.std
            ));
        }
        if nuisances.iter().take(at).any(|before| before.key() == entry.key()) {
            return wrong("it stands there twice; leave one".to_owned());
        }
    }
    Ok(())
}

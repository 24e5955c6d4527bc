//! What is unknown anew in every log and no cause of a gap: `[[nuisances]]` of a model file.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::ModelError;

/// An effect that every log has with a value of its own, kept as it stands in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NuisanceEntry {
    /// The effect's name.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// The prior's standard deviation about the value at which the effect does nothing, in the unit of its parameter.
    pub std: f64,
}

impl NuisanceEntry {
    /// `effect:channel`.
    #[must_use]
    pub fn key(&self) -> String {
        format!("{}:{}", self.effect, self.channel)
    }
}

/// Standard deviations that are some, and nothing twice. Whether there are such effects and channels is for whoever uses them.
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

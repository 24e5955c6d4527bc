//! Other thresholds of a diagnosis than the program's own, for `lab/criteria`, which measures the sensitivity to each of them.

use std::path::PathBuf;

use anyhow::{Context, bail};
use serde_json::Value;

use deadtime_gap::Criteria;
use deadtime_signal::file::read_text;

/// A file with other thresholds.
#[derive(Debug, clap::Args)]
pub(super) struct Thresholds {
    /// Thresholds of the diagnosis that differ from the program's own: a TOML file with the names of `deadtime list criteria`
    #[arg(long, value_name = "FILE", hide = true)]
    criteria: Option<PathBuf>,
}

impl Thresholds {
    /// The program's own thresholds, with those of the file in their place.
    pub(super) fn criteria(&self) -> anyhow::Result<Criteria> {
        let Some(path) = &self.criteria else { return Ok(Criteria::default()) };
        let read: Criteria = toml::from_str(&read_text(path)?)
            .with_context(|| format!("{}: no thresholds", path.display()))?;
        let Value::Object(all) = serde_json::to_value(read)? else {
            bail!("{}: no thresholds", path.display())
        };
        let positive = |value: &Value| value.as_f64().is_some_and(|v| v > 0.0);
        for (name, value) in &all {
            if !value.as_array().map_or_else(|| positive(value), |each| each.iter().all(positive)) {
                bail!("{}: {name} is {value}; it must be above 0", path.display());
            }
        }
        Ok(read)
    }
}

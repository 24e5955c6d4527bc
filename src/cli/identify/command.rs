//! The subcommand `identify`.

use super::common::Common;
use super::{linear, matching, structured};
use crate::cli::show::Out;
use crate::cli::source::Reading;

/// Identify a model from logs, or fit the parameters of a model file (--structure) to logs or to an identified model (--match). The answer has standard
/// deviations and the fit on held-out data
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime identify flight.csv --input rudder --output yaw_rate
  deadtime identify flight.csv --input rudder --output yaw_rate --method p1d --out model.toml
  deadtime identify flight.csv --structure model.toml --free mass,damping --out fitted.toml
  deadtime identify --structure model.toml --match identified.json --free mass,damping --norm hinf --band 1:30")]
pub(crate) struct Identify {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    linear: linear::Linear,
    #[command(flatten)]
    structured: structured::Structured,
    #[command(flatten)]
    matched: matching::Matched,
    // Last: options for reading logs end every help.
    #[command(flatten)]
    reading: Reading,
}

impl Identify {
    pub(crate) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        if self.matched.matched.is_none() {
            self.matched.must_be_absent()?;
        }
        match (&self.structured.structure, &self.matched.matched) {
            (Some(structure), Some(identified)) => {
                self.matched.run((&self.common, &self.structured.free), structure, identified, to)
            }
            (Some(structure), None) => {
                self.structured.run((&self.common, &self.reading), structure, to)
            }
            (None, _) => self.linear.run((&self.common, &self.reading), to),
        }
    }
}

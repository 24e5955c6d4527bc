//! The subcommand `identify`.

use super::{linear, matching, structured};
use crate::cli::show::Out;
use crate::cli::source::Reading;
use std::path::PathBuf;

/// Make a model file of logs, or fit the parameters of one (--structure) to logs or to an identified model (--match): with standard deviations, and how it does on data that it has not seen
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime identify flight.csv --input rudder --output yaw_rate --out model.toml
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
}

/// What both ways need.
#[derive(Debug, clap::Args)]
pub(super) struct Common {
    /// Logs to learn from; of a linear model the last 30 % of each are held out unless --holdout names others
    #[arg(value_name = "LOG", required_unless_present = "matched")]
    pub(super) logs: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) reading: Reading,
    /// A log to judge the model on, which takes no part in the fit; may be repeated
    #[arg(long, value_name = "LOG")]
    pub(super) holdout: Vec<PathBuf>,
    /// The model file to write (.toml or .json)
    #[arg(short, long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
    /// Also write what was found as a page, one file that needs no network
    #[arg(long, value_name = "FILE")]
    pub(super) html: Option<PathBuf>,
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
            (Some(structure), None) => self.structured.run(&self.common, structure, to),
            (None, _) => self.linear.run(&self.common, to),
        }
    }
}

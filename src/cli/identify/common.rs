//! The options that all ways of `deadtime identify` take.

use std::path::PathBuf;

/// Logs, and where results go.
#[derive(Debug, clap::Args)]
pub(super) struct Common {
    /// Logs to learn from; of a linear model the last 30 % of each are held out unless --holdout names others
    #[arg(value_name = "LOG", required_unless_present = "matched")]
    pub(super) logs: Vec<PathBuf>,
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

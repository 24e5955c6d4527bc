//! `deadtime check`: whether a model and logs fit, before anyone diagnoses.

use super::words::option;
use std::path::PathBuf;

use super::progress::Bar;
use super::show::{Out, write};
use super::simulator::{Simulated, SimulatorArgs};
use super::source::Reading;
use crate::report::checks::text;
use crate::report::page;
use deadtime_gap::{clocks, inspect};
use deadtime_log::Log;
use deadtime_signal::stop::Stop;

/// Check a model and logs before diagnosing: names, units, time stamps, signs, axes, clocks, stuck and clipped channels, excitation
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime check --model model.toml --log flight.csv
  deadtime check --model model.toml --log a.csv --log b.csv --json checks.json")]
pub(super) struct Check {
    /// The model, deadtime/model@1; or give --simulator
    #[arg(
        long,
        value_name = "MODEL",
        required_unless_present = "simulator",
        conflicts_with = "simulator"
    )]
    model: Option<PathBuf>,
    #[command(flatten)]
    simulator: SimulatorArgs,
    /// A log; may be repeated
    #[arg(long, value_name = "LOG", required = true)]
    log: Vec<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    /// Also write what was found as a page, one file that needs no network
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl Check {
    /// Prints what was found; as JSON it is deadtime/check@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let subject = Simulated::new(self.model.as_deref(), &self.simulator)?;
        let mut logs: Vec<Log> = Vec::new();
        let mut seen = Vec::new();
        for path in &self.log {
            logs.extend(subject.read(
                to,
                &self.reading,
                path,
                false,
                &mut |recording, wanted| seen.push(clocks(recording, wanted)),
            )?);
        }
        let bar = Bar::new(to);
        let mut found = inspect(&subject, &logs, &Stop::default(), bar.far())?;
        found.clocks = seen;
        drop(bar);
        let found = found.worded(option);
        to.json(&found)?;
        write(self.html.as_ref(), || page::check(&found))?;
        say!(to, "{}", text(&found).trim_end());
        Ok(())
    }
}

//! `deadtime log`: the content of a log file.

use super::words::option;
use std::path::PathBuf;

use super::progress::Bar;
use super::show::Out;
use super::source::Clock;
use crate::report::log::text;
use deadtime_log::open;

/// List what a log holds: topics and channels with their rates, gaps, units and ranges, and the course of each
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime log flight.csv
  deadtime log flight.ulg --topic vehicle_rates")]
pub(super) struct Log {
    /// The log, of any format of `deadtime list readers`
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Only topics whose name contains this; may be repeated
    #[arg(long, value_name = "TEXT")]
    topic: Vec<String>,
    #[command(flatten)]
    clock: Clock,
}

impl Log {
    /// Prints the listing; as JSON it is deadtime/log@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let bar = Bar::new(to);
        let mut listing = open(&self.log, &self.clock.options(bar.far()))?.listing();
        drop(bar);
        listing.notes = listing.notes.worded(option);
        if !self.topic.is_empty() {
            listing
                .topics
                .retain(|topic| self.topic.iter().any(|part| topic.name.contains(part.as_str())));
        }
        to.json(&listing)?;
        say!(to, "{}", text(&listing).trim_end());
        Ok(())
    }
}

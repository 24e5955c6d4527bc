//! `deadtime methods`: all methods compared on a small study.

use std::path::PathBuf;

use anyhow::bail;

use super::progress::Bar;
use super::show::{Out, write};
use crate::report::methods::{errors, page};
use deadtime_delay::METHODS;
use deadtime_study::Common;

/// Compare all methods: what each needs, what it cannot see, its time, and its error on a small study of known delays
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime methods
  deadtime methods --trials 100 --out methods.md")]
pub(super) struct Methods {
    /// Records of each kind
    #[arg(long, value_name = "N", default_value_t = Common::default().trials)]
    trials: usize,
    /// Samples of a record
    #[arg(long, value_name = "N", default_value_t = Common::default().samples)]
    samples: usize,
    /// Seed of the records
    #[arg(long, value_name = "N", default_value_t = Common::default().seed)]
    seed: u64,
    /// Also write the page docs/results/methods.md, as Markdown
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Methods {
    /// Prints the errors and times; as JSON they are the rows of the study.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        if self.trials == 0 || self.samples < LEAST {
            bail!(
                "--trials {} --samples {}: give at least 1 record of at least {LEAST} samples",
                self.trials,
                self.samples
            );
        }
        let study = Common { trials: self.trials, samples: self.samples, seed: self.seed };
        let bar = Bar::new(to);
        let mut done = 0.0;
        let rows = study.run(&mut |name| {
            done += 1.0;
            bar.far().at(done / METHODS.len() as f64, &name);
        });
        drop(bar);
        let rows = rows?;
        to.json(&rows)?;
        write(self.out.as_ref(), || page(&study, &rows))?;
        say!(to, "{}", errors(&rows).to_string().trim_end());
        say!(
            to,
            "\nErrors in samples, over {} records of {} samples each: on what the method is made for, on a plant with a lag, and in a loop; held: intervals that hold",
            self.trials,
            self.samples
        );
        say!(to, "the truth; none: records without an answer.");
        Ok(())
    }
}

/// Samples below which most methods have no answer.
const LEAST: usize = 200;

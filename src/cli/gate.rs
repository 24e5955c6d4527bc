//! `deadtime gate`: whether a study is worse than an earlier one.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::limit::LimitNotMet;
use super::show::{Out, write};
use crate::report::{gate, junit, speed};
use deadtime_study as study;
use deadtime_study::{Speed, SpeedGate, Study, Timings};

/// Fail where a study is worse than its baseline, or benches are slower than before
///
/// Of a study correctness is compared exactly, accuracy statistically; of benches (--timings) pairs of runs by a sign test.
///
/// Exit codes: 0 nothing is worse, 1 something is, 2 the two cannot be compared.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime gate study-mine --baseline kept --update
  deadtime gate study-mine --baseline kept --junit gate.xml --markdown gate.md
  deadtime gate --timings pairs.csv --junit speed.xml --markdown speed.md")]
pub(super) struct Gate {
    /// The study to judge: study.json or its folder
    #[arg(value_name = "RESULTS", required_unless_present = "timings")]
    results: Option<PathBuf>,
    /// The study to compare with: study.json or its folder
    #[arg(long, value_name = "BASELINE", required_unless_present = "timings")]
    baseline: Option<PathBuf>,
    /// Judge speed instead: a CSV with columns bench, before_s and after_s, a line for each pair of runs; `scripts/bench-gate` makes one
    #[arg(long, value_name = "FILE", conflicts_with_all = ["results", "baseline", "update", "margin_samples", "margin_share"])]
    timings: Option<PathBuf>,
    /// Make RESULTS the baseline instead of comparing: without run times, one line per cell
    #[arg(long, conflicts_with_all = ["junit", "markdown", "json"])]
    update: bool,
    /// Also write JUnit XML, a test case per method or bench
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Also write a summary as Markdown
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Chance that equally accurate or fast programs fail, all comparisons together
    #[arg(long, value_name = "P", default_value_t = study::Gate::default().alpha)]
    alpha: f64,
    /// Share of itself by which an RMS error, or a time, may grow
    #[arg(long, value_name = "SHARE", default_value_t = study::Gate::default().margin)]
    margin: f64,
    /// Samples by which an RMS error may grow
    #[arg(long, value_name = "SAMPLES", default_value_t = study::Gate::default().margin_samples)]
    margin_samples: f64,
    /// By how much a share of records, answers or intervals may get worse
    #[arg(long, value_name = "SHARE", default_value_t = study::Gate::default().margin_share)]
    margin_share: f64,
}

impl Gate {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        match (&self.timings, &self.results, &self.baseline) {
            (Some(timings), ..) => self.speed(timings, to),
            (None, Some(results), Some(baseline)) => self.accuracy(results, baseline, to),
            _ => bail!("give RESULTS and --baseline, or --timings"),
        }
    }

    fn speed(&self, timings: &Path, to: &Out<'_>) -> anyhow::Result<()> {
        let gate = SpeedGate { alpha: self.alpha, margin: self.margin };
        let report =
            gate.judge(&Timings::read(timings)?).with_context(|| timings.display().to_string())?;
        to.json(&report)?;
        self.write(speed::junit(&report), speed::markdown(&report))?;
        say!(to, "{}", speed::text(&report).trim_end());
        match report.of(Speed::Slower).count() {
            0 => Ok(()),
            slower => {
                Err(LimitNotMet(format!("{slower} of {} benches are slower", report.benches.len()))
                    .into())
            }
        }
    }

    fn write(&self, xml: String, page: String) -> anyhow::Result<()> {
        write(self.junit.as_ref(), || xml)?;
        write(self.markdown.as_ref(), || page)
    }

    fn accuracy(&self, from: &Path, kept: &Path, to: &Out<'_>) -> anyhow::Result<()> {
        let results = Study::read(from)?;
        if self.update {
            results.write_baseline(kept)?;
            say!(
                to,
                "{}: {} cells are the baseline now, in {}",
                results.plan,
                results.cells.len(),
                kept.display()
            );
            return Ok(());
        }
        if !kept.exists() {
            bail!(
                "{}: there is no baseline yet; --update makes one of {}",
                kept.display(),
                from.display()
            );
        }
        let baseline = Study::read(kept)?;
        let Self { alpha, margin, margin_samples, margin_share, .. } = *self;
        let report = study::Gate { alpha, margin, margin_samples, margin_share }
            .compare(&results, &baseline)
            .with_context(|| format!("{} and {}", from.display(), kept.display()))?;
        to.json(&report)?;
        self.write(junit::xml(&report), gate::markdown(&report))?;
        say!(to, "{}", gate::text(&report).trim_end());
        if report.worse.is_empty() {
            return Ok(());
        }
        Err(LimitNotMet(format!("worse than {} in {} places", kept.display(), report.worse.len()))
            .into())
    }
}

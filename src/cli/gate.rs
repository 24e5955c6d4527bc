//! `deadtime gate`: whether a study is worse than an earlier one.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context, bail};

use super::{LimitNotMet, Out};
use crate::file::write_atomic;
use crate::report::{gate, junit};
use crate::study::{self, Study};
use crate::text::printed;

/// Fail where a study is worse than its baseline: correctness compared exactly, accuracy statistically
///
/// Exit codes: 0 nothing is worse, 1 something is, 2 the two cannot be compared.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime gate study-mine --baseline kept --update
  deadtime gate study-mine --baseline kept --junit gate.xml --markdown gate.md")]
pub(super) struct Gate {
    /// The study to judge: study.json or its folder
    #[arg(value_name = "RESULTS")]
    results: PathBuf,
    /// The study to compare with: study.json or its folder
    #[arg(long, value_name = "BASELINE")]
    baseline: PathBuf,
    /// Make RESULTS the baseline instead of comparing: without run times, one line per cell
    #[arg(long, conflicts_with_all = ["junit", "markdown", "json"])]
    update: bool,
    /// Also write JUnit XML, a test case per method
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Also write a summary as Markdown
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Chance that equally accurate programs fail, all comparisons together
    #[arg(long, value_name = "P", default_value_t = study::Gate::default().alpha)]
    alpha: f64,
    /// Share of itself by which an RMS error may grow
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
        let results = Study::read(&self.results)?;
        if self.update {
            results.write_baseline(&self.baseline)?;
            say!(to, "{}: {} cells are the baseline now, in {}", results.plan, results.cells.len(), self.baseline.display());
            return Ok(());
        }
        if !self.baseline.exists() {
            bail!("{}: there is no baseline yet; --update makes one of {}", self.baseline.display(), self.results.display());
        }
        let baseline = Study::read(&self.baseline)?;
        let Self { alpha, margin, margin_samples, margin_share, .. } = *self;
        let report = study::Gate { alpha, margin, margin_samples, margin_share }
            .compare(&results, &baseline)
            .with_context(|| format!("{} and {}", self.results.display(), self.baseline.display()))?;
        to.json(&report)?;
        if let Some(path) = &self.junit {
            write_atomic(path, |out| out.write_all(junit::xml(&report).as_bytes()))?;
        }
        if let Some(path) = &self.markdown {
            write_atomic(path, |out| out.write_all(gate::markdown(&report).as_bytes()))?;
        }
        std::io::stdout().lock().write_all(printed(&gate::text(&report)).as_bytes()).context("standard output")?;
        if report.worse.is_empty() {
            return Ok(());
        }
        Err(LimitNotMet(format!("worse than {} in {} places", self.baseline.display(), report.worse.len())).into())
    }
}

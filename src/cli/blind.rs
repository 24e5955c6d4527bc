//! `deadtime blind`: the check on withheld effects.

use std::path::PathBuf;

use anyhow::bail;

use super::criteria::Thresholds;
use super::limit::LimitNotMet;
use super::progress::Bar;
use super::show::{Out, write};
use super::words::option;
use crate::report::{blind, page};
use deadtime_gap::{GapOptions, diagnose_files};
use deadtime_signal::remedy::Remedied;
use deadtime_signal::text::{message, shown};
use deadtime_study::blind::{CaseFiles, Existing, Limit, Outcome, RunOptions, load, run, score};

/// Diagnose cases whose cause is withheld, and score the verdicts once the labels are known
#[derive(Debug, clap::Subcommand)]
#[command(after_help = "Examples:
  deadtime blind run cases --out verdicts
  deadtime blind score verdicts labels")]
pub(super) enum Blind {
    Run(RunCases),
    Score(ScoreVerdicts),
}

/// Diagnose every case of a folder, one at a time; only the case folders are read
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime blind run cases --out verdicts --jobs 4")]
pub(super) struct RunCases {
    /// The folder of cases: ID/model.toml, ID/train_*.csv, ID/holdout_*.csv, ID/commitment.txt
    #[arg(value_name = "CASES")]
    cases: PathBuf,
    /// Folder to write the verdicts to; cases that stand there are not done again
    #[arg(long, value_name = "VERDICTS")]
    out: PathBuf,
    /// Cases at a time, four for each core at most
    #[arg(long, value_name = "N", default_value_t = 1)]
    jobs: usize,
    /// Diagnose all cases again
    #[arg(long)]
    fresh: bool,
    /// Seed of the bootstrap
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    thresholds: Thresholds,
}

/// Score verdicts against the labels, after checking every label against the commitment that came with its case
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime blind score verdicts labels")]
pub(super) struct ScoreVerdicts {
    /// The folder of verdicts: ID/diagnosis.json, ID/run.json and ID/commitment.txt
    #[arg(value_name = "VERDICTS")]
    verdicts: PathBuf,
    /// The folder of labels: ID.json, deadtime/blind@1
    #[arg(value_name = "LABELS")]
    labels: PathBuf,
    /// The folder of cases; needed only where a verdict has no commitment
    #[arg(long, value_name = "CASES")]
    cases: Option<PathBuf>,
    /// Also write the report as Markdown
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Also write the report as a page, one file that needs no network
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Exit with 1 when a score's 95 % interval lies beyond this limit as a whole; may be repeated
    #[arg(long, value_name = "NAME>=VALUE|NAME<=VALUE")]
    require: Vec<String>,
}

impl Blind {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        match self {
            Self::Run(c) => c.run(to),
            Self::Score(c) => c.run(to),
        }
    }
}

impl RunCases {
    fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let existing = if self.fresh { Existing::Redo } else { Existing::Keep };
        let gap = GapOptions {
            seed: self.seed,
            criteria: self.thresholds.criteria()?,
            ..GapOptions::default()
        };
        let diagnose = |case: &CaseFiles| {
            Ok(diagnose_files(&case.model, &case.logs, &case.holdout, &gap)?
                .worded(option)
                .diagnosis)
        };
        let bar = Bar::new(to);
        let progress = |id: &str, outcome: &Outcome| {
            bar.say(&match outcome {
                Outcome::Done { time_s, damage: None } => format!("{}: {time_s:.1} s", shown(id)),
                Outcome::Done { time_s, damage: Some(why) } => {
                    format!("{}: {time_s:.1} s, made again: {why}", shown(id))
                }
                Outcome::Kept => format!("{}: done before", shown(id)),
                Outcome::Failed(error) => {
                    format!("{}: {}", shown(id), message(&error.message().worded(option)))
                }
            });
        };
        let options = RunOptions {
            jobs: self.jobs,
            existing,
            far: bar.far().clone(),
            ..RunOptions::default()
        };
        let summary = run(&self.cases, &self.out, &options, &diagnose, &progress)?;
        drop(bar);
        let failed: Vec<String> =
            summary.failed().map(|(id, error)| format!("{id}: {error}")).collect();
        let done = summary.cases.len() - failed.len();
        to.json(
            &serde_json::json!({ "cases": summary.cases.len(), "done": done, "failed": failed }),
        )?;
        if failed.is_empty() {
            say!(to, "{done} cases diagnosed; verdicts in {}", self.out.display());
            return Ok(());
        }
        bail!(
            "{done} of {} cases were diagnosed; these were not:\n{}",
            summary.cases.len(),
            failed.join("\n")
        )
    }
}

impl ScoreVerdicts {
    fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let limits: Vec<Limit> =
            self.require.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
        let scores = score(&load(&self.verdicts, &self.labels, self.cases.as_deref())?);
        to.json(&scores)?;
        write(self.markdown.as_ref(), || blind::markdown(&scores))?;
        write(self.html.as_ref(), || page::blind(&scores))?;
        say!(to, "{}", blind::text(&scores).trim_end());
        let unmet: Vec<String> = limits.iter().filter_map(|limit| limit.unmet(&scores)).collect();
        if unmet.is_empty() { Ok(()) } else { Err(LimitNotMet(unmet.join("; ")).into()) }
    }
}

//! `deadtime blind`: the check on withheld effects.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::{LimitNotMet, write_json};
use crate::blind::{Limit, Verdict, load, score};
use crate::file::write_atomic;
use crate::report::blind;

/// Diagnose cases whose cause is withheld, and score the verdicts once the labels are known
#[derive(Debug, clap::Subcommand)]
pub(super) enum Blind {
    Score(ScoreVerdicts),
}

/// Score verdicts against the labels, after checking every label against the commitment that came with its case
#[derive(Debug, clap::Args)]
pub(super) struct ScoreVerdicts {
    /// The folder of verdicts: ID/diagnosis.json, ID/run.json and ID/commitment.txt
    #[arg(value_name = "VERDICTS")]
    verdicts: PathBuf,
    /// The folder of labels: ID.json, deadtime/blind@1
    #[arg(value_name = "LABELS")]
    labels: PathBuf,
    /// The folder of cases; needed only where no commitment stands beside a verdict
    #[arg(long, value_name = "CASES")]
    cases: Option<PathBuf>,
    /// Also write the report as Markdown
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Exit with 1 when a score's 95 % interval lies beyond this limit as a whole; may be repeated
    #[arg(long, value_name = "NAME>=VALUE|NAME<=VALUE")]
    require: Vec<String>,
}

impl Blind {
    pub(super) fn run(&self, json: Option<&Path>) -> anyhow::Result<()> {
        match self {
            Self::Score(c) => c.run(json),
        }
    }
}

impl ScoreVerdicts {
    fn run(&self, json: Option<&Path>) -> anyhow::Result<()> {
        let limits: Vec<Limit> = self.require.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
        let scores = score(&load(&self.verdicts, &self.labels, self.cases.as_deref())?);
        write_json(json, &scores)?;
        if let Some(path) = &self.markdown {
            write_atomic(path, |out| out.write_all(blind::markdown(&scores).as_bytes()))?;
        }
        std::io::stdout().lock().write_all(blind::text(&scores).as_bytes()).context("standard output")?;
        let unmet: Vec<String> = limits
            .iter()
            .filter_map(|limit| {
                let value = scores.get(limit.name()).and_then(|s| s.value);
                match limit.judge(&scores) {
                    Verdict::Kept => None,
                    Verdict::Missed => Some(format!("{limit} was not met: it is {}", value.unwrap_or(f64::NAN))),
                    Verdict::NotMeasured => Some(format!("{limit} was not met: no case has this score")),
                }
            })
            .collect();
        if unmet.is_empty() { Ok(()) } else { Err(LimitNotMet(unmet.join("; ")).into()) }
    }
}

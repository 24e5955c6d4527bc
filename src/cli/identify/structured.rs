//! `deadtime identify --structure`: many parameters of a model file from logs, jointly.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::common::Common;
use crate::cli::progress::Bar;
use crate::cli::show::{Out, write};
use crate::cli::source::Reading;
use crate::report::page;
use crate::report::structured::{scores, text};
use deadtime_identify::structured;
use deadtime_identify::structured::{Balance, score};
use deadtime_log::Log;
use deadtime_model::{EquationsFile, ModelDocument};

/// The options of a fit of a model file's parameters.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Parameters of a model file")]
pub(super) struct Structured {
    /// The model whose parameters are fitted, deadtime/model@1. Those of a linear model are the entries of A and B that are not 0, such as A_v_phi
    #[arg(long, value_name = "MODEL")]
    pub(super) structure: Option<PathBuf>,
    /// Parameters to fit, NAME,…, also dead times of inputs as delay:INPUT, or `all` that the file does not declare as known. Without any, only the model's
    /// errors are reported
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(super) free: Vec<String>,
    /// Parameters that may deviate by record, NAME,…; a prediction of another log does not use the deviations
    #[arg(long, value_name = "NAMES", value_delimiter = ',', hide_short_help = true)]
    per_record: Vec<String>,
    /// Steps that are predicted from each window's start
    #[arg(long, value_name = "STEPS", default_value_t = 50)]
    horizon: usize,
    /// Steps from one window's start to the next; default: the horizon
    #[arg(long, value_name = "STEPS", hide_short_help = true)]
    stride: Option<usize>,
    /// Errors above this many median errors count by their size, not their square (Huber); inf: never
    #[arg(long, value_name = "RATIO", default_value_t = 1.345, hide_short_help = true)]
    threshold: f64,
    /// How the horizons of a group of outputs are weighed
    #[arg(long, value_enum, default_value_t = BalanceName::Horizon, hide_short_help = true)]
    balance: BalanceName,
    /// Shrinkage towards the file's values, dead times excepted; default: what predicts left-out records (below three: stretches) best
    #[arg(long, value_name = "SIZE", hide_short_help = true)]
    shrinkage: Option<f64>,
    /// Leave out the fit over single steps, and with it the word on physical values and surrogates
    #[arg(long, hide_short_help = true)]
    no_one_step: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum BalanceName {
    /// Each horizon by its own median error: none is sacrificed
    Horizon,
    /// All alike: long horizons, with larger errors, count most
    Group,
}

impl Structured {
    pub(super) fn run(
        &self,
        (common, reading): (&Common, &Reading),
        structure: &Path,
        to: &Out<'_>,
    ) -> anyhow::Result<()> {
        let document = ModelDocument::read(structure)?;
        let file = &document.structure().with_context(|| structure.display().to_string())?;
        if self.threshold.is_nan() || self.threshold <= 0.0 {
            bail!("--threshold {}: it must be above 0 (inf for plain squares)", self.threshold);
        }
        if self.shrinkage.is_some_and(|s| !s.is_finite() || s < 0.0) {
            bail!("--shrinkage must be finite and not negative");
        }
        let (logs, held_out) = (
            read(reading, to, &document, &common.logs)?,
            read(reading, to, &document, &common.holdout)?,
        );
        if self.free.is_empty() && self.per_record.is_empty() {
            return self.only_score(common, file, &logs, to);
        }
        let bar = Bar::new(to);
        let options = structured::Structured {
            free: self.free.clone(),
            per_record: self.per_record.clone(),
            horizon: self.horizon,
            stride: self.stride,
            threshold: self.threshold,
            balance: match self.balance {
                BalanceName::Horizon => Balance::Horizon,
                BalanceName::Group => Balance::Group,
            },
            shrinkage: self.shrinkage,
            one_step: !self.no_one_step,
            far: bar.far().clone(),
            ..structured::Structured::default()
        };
        let mut found = options.fit(file, &logs, &held_out)?;
        drop(bar);
        found.name.clone_from(&file.name);
        to.json(&found)?;
        if let (Some(out), Some(model)) = (&common.out, &found.model) {
            model.write(out)?;
        }
        write(common.html.as_ref(), || page::structured(&found))?;
        say!(to, "{}", text(&found).trim_end());
        if let Some(out) = &common.out {
            say!(to, "\nWritten to {}.", out.display());
        }
        Ok(())
    }

    fn only_score(
        &self,
        common: &Common,
        file: &EquationsFile,
        logs: &[Log],
        to: &Out<'_>,
    ) -> anyhow::Result<()> {
        if common.out.is_some() {
            bail!("nothing is fitted, so there is nothing to write: name parameters with --free");
        }
        if common.html.is_some() {
            bail!(
                "--html: nothing is fitted, so there is no page to write: name parameters with --free"
            );
        }
        let found = score(file, logs, self.horizon, self.stride.unwrap_or(self.horizon))?;
        to.json(
            &serde_json::json!({ "name": file.name, "horizon": self.horizon, "score": found }),
        )?;
        say!(to, "{}", scores(&file.name, &[&found]).trim_end());
        Ok(())
    }
}

fn read(
    reading: &Reading,
    to: &Out<'_>,
    document: &ModelDocument,
    paths: &[PathBuf],
) -> anyhow::Result<Vec<Log>> {
    let mut logs = Vec::new();
    for path in paths {
        logs.extend(reading.read_for(to, path, document, true, &mut |_, _| {})?);
    }
    Ok(logs)
}

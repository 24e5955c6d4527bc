//! `deadtime identify --structure --match`: parameters of a model file from an identified model, by frequency.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::common::Common;
use crate::cli::show::{Out, write};
use crate::report::matching::text;
use crate::report::page;
use deadtime_identify::matching::{Matching, Target};
use deadtime_model::ModelDocument;

/// The options of a match by frequency.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Parameters by frequency, from an identified model")]
pub(super) struct Matched {
    /// The identified model: what `deadtime identify` wrote, its --json (which has the uncertainty) or the model file; in place of logs
    #[arg(long = "match", value_name = "IDENTIFIED", requires = "structure", conflicts_with_all = ["logs", "per_record"])]
    pub(super) matched: Option<PathBuf>,
    /// By what responses are compared: wls (the default), h2, hinf or nu-gap
    #[arg(long, value_name = "NORM", requires = "matched", hide_short_help = true)]
    norm: Option<String>,
    /// The frequencies that count, rad/s; default: those that the data show
    #[arg(long, value_name = "LOW:HIGH", requires = "matched", hide_short_help = true)]
    band: Option<String>,
    /// Starts of the search, the file's values first; default: 8
    #[arg(long, value_name = "N", requires = "matched", hide_short_help = true)]
    starts: Option<usize>,
    /// How far the file's values may be off, as a share of each; inf: not held; default: by evidence (wls, h2)
    #[arg(long, value_name = "SHARE", requires = "matched")]
    prior: Option<f64>,
    /// What counts as one of a channel in gains (h2, hinf, nu-gap): CHANNEL=SIZE; may be repeated
    #[arg(
        long = "unit",
        value_name = "CHANNEL=SIZE",
        requires = "matched",
        hide_short_help = true
    )]
    units: Vec<String>,
    /// Where equations are linearised: STATE=VALUE or INPUT=VALUE; default: initial states, and the identified model's operating inputs
    #[arg(long, value_name = "NAME=VALUE", requires = "matched", hide_short_help = true)]
    at: Vec<String>,
}

impl Matched {
    /// Without --match none of its options is allowed: the parser accepts them together with logs, which --match excludes.
    pub(super) fn must_be_absent(&self) -> anyhow::Result<()> {
        let given = [
            ("--norm", self.norm.is_some()),
            ("--band", self.band.is_some()),
            ("--starts", self.starts.is_some()),
            ("--prior", self.prior.is_some()),
            ("--unit", !self.units.is_empty()),
            ("--at", !self.at.is_empty()),
        ];
        match given.iter().find(|(_, there)| *there) {
            Some((option, _)) => {
                bail!(
                    "{option} is an option of a match by frequency: name the identified model (--match IDENTIFIED) in place of logs"
                )
            }
            None => Ok(()),
        }
    }

    pub(super) fn run(
        &self,
        (common, free): (&Common, &[String]),
        structure: &Path,
        identified: &Path,
        to: &Out<'_>,
    ) -> anyhow::Result<()> {
        if !common.holdout.is_empty() {
            bail!(
                "--holdout: a match sees no logs; compare the models on a log by `deadtime simulate`"
            );
        }
        let file = ModelDocument::read(structure)?
            .structure()
            .with_context(|| structure.display().to_string())?;
        let Matching { norm, starts, .. } = Matching::default();
        let options = Matching {
            free: free.to_vec(),
            norm: self.norm.clone().unwrap_or(norm),
            band: self.band.as_deref().map(band).transpose()?,
            starts: self.starts.unwrap_or(starts),
            prior: self.prior,
            units: pairs("--unit", &self.units)?,
            at: pairs("--at", &self.at)?,
        };
        let found = options.fit(&file, &Target::read(identified)?)?;
        to.json(&found)?;
        if let (Some(out), Some(model)) = (&common.out, &found.model) {
            model.write(out)?;
        }
        write(common.html.as_ref(), || page::matching(&found))?;
        say!(to, "{}", text(&found).trim_end());
        if let Some(out) = &common.out {
            say!(to, "\nWritten to {}.", out.display());
        }
        Ok(())
    }
}

fn band(text: &str) -> anyhow::Result<[f64; 2]> {
    let ends = text
        .split_once(':')
        .and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    ends.with_context(|| format!("--band {text}: write it as LOW:HIGH in rad/s"))
}

fn pairs(option: &str, texts: &[String]) -> anyhow::Result<Vec<(String, f64)>> {
    let one = |text: &String| {
        let parts = text
            .rsplit_once('=')
            .and_then(|(name, value)| Some((name.to_owned(), value.parse().ok()?)));
        parts.with_context(|| format!("{option} {text}: write it as NAME=NUMBER"))
    };
    texts.iter().map(one).collect()
}

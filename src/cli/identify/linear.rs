//! `deadtime identify`: a linear model of inputs and outputs.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::common::Common;
use crate::cli::aliases::identifier;
use crate::cli::progress::Bar;
use crate::cli::show::Out;
use crate::cli::source::{Needed, Reading};
use crate::cli::words::delay_of;
use crate::report::identify::Report;
use crate::report::page;
use deadtime_delay::{BehindDelays, Comparison, TakenOut, compare_models, identify_behind_delays};
use deadtime_identify::subspace::{Direct, Recordings};
use deadtime_log::Log;
use deadtime_signal::file::{STANDARD_OUTPUT, write_atomic};
use deadtime_signal::progress::HowFar;
use deadtime_signal::registry;
use deadtime_signal::stop::Stop;

/// The options of a linear model.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "A linear model of inputs and outputs")]
pub(super) struct Linear {
    /// Input channel (the command); may be repeated
    #[arg(
        long,
        value_name = "U",
        required_unless_present = "structure",
        conflicts_with = "structure"
    )]
    input: Vec<String>,
    /// Output channel (the response); may be repeated
    #[arg(
        long,
        value_name = "Y",
        required_unless_present = "structure",
        conflicts_with = "structure"
    )]
    output: Vec<String>,
    /// Method (`deadtime list identifiers`); default: all are compared, and the simplest within the noise of the best is kept
    #[arg(long, value_name = "NAME")]
    method: Option<String>,
    /// Number of states, or `auto`; without --method by pbsidopt
    #[arg(long, value_name = "N", default_value = "auto")]
    order: String,
    /// Samples of the past that predict, or `auto`
    #[arg(long, value_name = "P", default_value = "auto", hide_short_help = true)]
    past: String,
    /// Dead time of an input, removed before a model of states is identified: INPUT=SECONDS (may be repeated), `none`, or `auto` to estimate it
    #[arg(long, value_name = "INPUT=S", default_value = "auto")]
    delay: Vec<String>,
    /// Estimate a direct path D too: the input acts within the sample
    #[arg(long, hide_short_help = true)]
    direct: bool,
    /// What is taken off every channel first: its mean, or the slope of the straight line through it too (a drift of the record)
    #[arg(long, value_enum, value_name = "TREND", default_value_t = Trend::Mean)]
    detrend: Trend,
    /// Write the continuous model behind a zero-order hold, not the sampled one
    #[arg(long)]
    continuous: bool,
    /// Another option of the method, such as `max_order=20`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", hide_short_help = true)]
    set: Vec<String>,
}

/// What is taken off every channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Trend {
    /// The mean, which is the model's operating point
    Mean,
    /// The slope of the straight line through each record too
    Line,
}

/// Share of each log that the model is identified from where nothing is named to judge it on, or where the rest chooses.
const LEARNT: f64 = 0.7;
/// The part of the work that the comparison is.
const COMPARED: f64 = 0.8;
/// The default method where only its options are given.
const DEFAULT: &str = "pbsidopt";

/// The chosen identification: the method, its options, and the comparison that chose it.
struct Choice {
    method: String,
    options: Value,
    taken_out: TakenOut,
    compared: Option<Comparison>,
}

impl Linear {
    pub(super) fn run(
        &self,
        (common, reading): (&Common, &Reading),
        to: &Out<'_>,
    ) -> anyhow::Result<()> {
        let logs = self.read(reading, to, &common.logs)?;
        let all = Recordings::from_logs(&logs, &self.input, &self.output)?;
        let (learnt, judged, held_out) = self.shares(&all, (common, reading), to)?;
        let bar = Bar::new(to);
        let own_holdout = !common.holdout.is_empty();
        let chosen = self.choice(&all, &logs, bar.far())?;
        let rest = bar.far().part(if chosen.compared.is_some() { COMPARED } else { 0.0 }, 1.0);
        let found = identify_behind_delays(
            &learnt,
            &logs,
            &chosen.method,
            &chosen.options,
            &chosen.taken_out,
            (&Stop::default(), &rest),
        )?;
        let BehindDelays { model: identified, delays, notes: delay_notes } = found;
        let held_out = match &chosen.compared {
            Some(_) if !own_holdout => format!("{held_out}, which also chose the model"),
            _ => held_out,
        };
        let what = match self.continuous {
            true => "--continuous: leave it out to write the sampled model",
            false => "the model",
        };
        let called = common.out.as_deref().map_or_else(|| "identified".to_owned(), name);
        let file = identified.file(&called, &delays, self.continuous).context(what)?;
        let judged = judged.behind_delays(&delays)?;
        let report = Report {
            logs: names(&common.logs),
            model: &identified,
            delays: &delays,
            delay_notes,
            held_out,
            held_out_samples: judged.samples(),
            checks: identified.check(&judged),
            judged: &judged,
            compared: chosen.compared.as_ref(),
        };
        drop(bar);
        if let Some(out) = &common.out {
            file.write(out)?;
        }
        if let Some(path) = &common.html {
            let page = page::identify(&report)?;
            write_atomic(path, |to| to.write_all(page.as_bytes()))?;
        }
        if to.wants_json() {
            to.json(&report.data()?)?;
        }
        say!(to, "{}", report.text().trim_end());
        match &common.out {
            Some(out) => say!(to, "\nWritten to {}.", out.display()),
            None => say!(to, "\nNo model file was written: give --out MODEL.toml."),
        }
        Ok(())
    }

    /// The records to identify from, those to judge on, and the words on the latter.
    fn shares(
        &self,
        all: &Recordings,
        (common, reading): (&Common, &Reading),
        to: &Out<'_>,
    ) -> anyhow::Result<(Recordings, Recordings, String)> {
        if common.holdout.is_empty() {
            let (learnt, judged) = all.split(LEARNT);
            let last = format!("the last {:.0} % of each record", 100.0 * (1.0 - LEARNT));
            return Ok((learnt, judged, last));
        }
        let logs = self.read(reading, to, &common.holdout)?;
        let judged = Recordings::from_logs(&logs, &self.input, &self.output)?;
        all.sample_time.must_equal(judged.sample_time).context("--holdout")?;
        Ok((all.clone(), judged, names(&common.holdout).join(", ")))
    }

    /// The method that was named; else the simplest that the best does not outdo.
    fn choice(&self, all: &Recordings, logs: &[Log], far: &HowFar) -> anyhow::Result<Choice> {
        let (options, taken_out) = (self.options()?, self.taken_out()?);
        let nothing = options.as_object().is_some_and(serde_json::Map::is_empty);
        let free = nothing && taken_out == TakenOut::Estimated;
        let name = self.method.as_deref().filter(|name| *name != "all");
        if name.is_none() && free {
            let (learnt, validation) = all.split(LEARNT);
            let compared = compare_models(
                &learnt,
                &validation,
                logs,
                (&Stop::default(), &far.part(0.0, COMPARED)),
            )?;
            let best = compared.chosen().context("no model predicts the validation data")?;
            let (method, mut options) = (best.method.to_owned(), best.options.clone());
            // The comparison draws no models; the one that is kept has its intervals.
            options.as_object_mut().map(|o| o.remove("draws"));
            let taken_out = TakenOut::Estimated;
            return Ok(Choice { method, options, taken_out, compared: Some(compared) });
        }
        let (method, note) = identifier(name.unwrap_or(DEFAULT))?;
        if let Some(note) = note {
            eprintln!("deadtime: {note}");
        }
        Ok(Choice { method: method.to_owned(), options, taken_out, compared: None })
    }

    fn read(&self, reading: &Reading, to: &Out<'_>, paths: &[PathBuf]) -> anyhow::Result<Vec<Log>> {
        let needed = Needed { inputs: &self.input, outputs: &self.output, required: true };
        let records = paths
            .iter()
            .map(|path| reading.read(to, path, &needed))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let logs = records.into_iter().flatten();
        if self.detrend == Trend::Mean {
            return Ok(logs.collect());
        }
        let names: Vec<String> = self.input.iter().chain(&self.output).cloned().collect();
        Ok(logs.map(|log| log.without_drift(&names)).collect::<Result<_, _>>()?)
    }

    /// The method's options.
    fn options(&self) -> anyhow::Result<Value> {
        let mut options = registry::options(self.set.iter().map(String::as_str))?;
        let number = |option: &str, text: &str| match text {
            "auto" => Ok(None),
            text => match text.parse::<usize>() {
                Ok(n) if n > 0 => Ok(Some(n)),
                _ => bail!("--{option} {text}: write a whole number above 0, or auto"),
            },
        };
        if let Some(object) = options.as_object_mut() {
            for (option, text) in [("order", &self.order), ("past", &self.past)] {
                if let Some(n) = number(option, text)? {
                    object.insert(option.to_owned(), json!(n));
                }
            }
            if self.direct {
                object.insert("direct".to_owned(), json!(Direct::Free));
            }
        }
        Ok(options)
    }

    /// Which delays are removed before states are identified.
    fn taken_out(&self) -> anyhow::Result<TakenOut> {
        match self.delay.as_slice() {
            [one] if one == "auto" => Ok(TakenOut::Estimated),
            [one] if one == "none" => Ok(TakenOut::Nothing),
            given => Ok(TakenOut::Given(
                given.iter().map(|text| self.given(text)).collect::<anyhow::Result<_>>()?,
            )),
        }
    }

    fn given(&self, text: &str) -> anyhow::Result<(String, f64)> {
        let (input, delay_s) = delay_of(text, &self.input).with_context(|| {
            format!(
                "--delay {text}: write it as INPUT=SECONDS with an input of the model ({}), or auto or none",
                self.input.join(", ")
            )
        })?;
        Ok((input.to_owned(), delay_s))
    }
}

fn names(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(|p| p.display().to_string()).collect()
}

/// The name of a model: that of its file.
fn name(out: &Path) -> String {
    out.file_stem()
        .filter(|_| out.as_os_str() != STANDARD_OUTPUT)
        .map_or_else(|| "identified".to_owned(), |s| s.to_string_lossy().into_owned())
}

//! `deadtime estimate`: the dead time in a measured log, by every method.

use super::words::option;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;

use super::aliases::estimator;
use super::limit::NothingTrusted;
use super::progress::Bar;
use super::show::Out;
use super::source::{Needed, Reading};
use crate::report::estimate::full;
use crate::report::page;
use crate::report::picture::{Shown, svg};
use crate::report::standing::trusted;
use crate::report::terminal::delay::{brief, short};
use deadtime_delay::report::Report;
use deadtime_delay::{Detrend, EventsJob, Feedback, Job, ResponseJob, STEP_METHODS, Scope, chosen};
use deadtime_log::{Log, STEP, read_frequency_response};
use deadtime_model::ModelFile;
use deadtime_signal::file::write_atomic;
use deadtime_signal::registry;

/// Estimate the dead time between inputs and outputs of a log, by one method or by all, with a verdict
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime estimate flight.csv --input rudder --output yaw_rate
  deadtime estimate flight.csv --input rudder --output yaw_rate --brief --json answer.json
  deadtime estimate flight.csv --input rudder --output yaw_rate --method oestruc --method arxstruc --max-delay 1
  deadtime estimate flight.csv --input rudder --output yaw_rate --html answer.html
  deadtime estimate gates.csv --events entry,exit
  deadtime estimate --frf response.csv
  deadtime estimate --step-table step.csv --step-size 5")]
pub(super) struct Estimate {
    /// The log: text with a header row and a column `time` in seconds (.csv, .csv.gz), or another format of `deadtime list readers`
    #[arg(value_name = "LOG", required_unless_present_any = ["frf", "step_table"], conflicts_with_all = ["frf", "step_table"])]
    log: Option<PathBuf>,
    /// Input channel (the command); may be repeated
    #[arg(long, value_name = "U", required_unless_present_any = ["events", "frf", "step_table"])]
    input: Vec<String>,
    /// Output channel (the response); may be repeated
    #[arg(long, value_name = "Y", required_unless_present_any = ["events", "frf", "step_table"])]
    output: Vec<String>,
    /// Two columns of event times instead of channels: when the same events were seen at two places; no `time` column is needed
    #[arg(long, value_name = "A,B", conflicts_with_all = ["input", "output", "model", "degree_bias", "svg"], hide_short_help = true)]
    events: Option<String>,
    /// A frequency response instead of a log, as text: `frequency [Hz]` or `[rad/s]`; `real`, `imag` or `magnitude [dB]`, `phase [deg]`; perhaps `coherence` or `std`
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["input", "output", "events", "model", "degree_bias", "svg", "track", "from", "to", "resample", "records", "map", "channel", "time", "time_unit"], hide_short_help = true)]
    frf: Option<PathBuf>,
    /// A table of a step response instead of a log: time, the response, and nothing else (or name it by --output)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["input", "events", "frf", "records", "from", "to", "degree_bias"], hide_short_help = true)]
    step_table: Option<PathBuf>,
    /// Height of the step that a --step-table answers
    #[arg(
        long,
        value_name = "H",
        default_value_t = 1.0,
        requires = "step_table",
        allow_negative_numbers = true,
        hide_short_help = true
    )]
    step_size: f64,
    /// Time of the step that a --step-table answers; default: 0, where the table holds it, or else its first row
    #[arg(
        long,
        value_name = "S",
        requires = "step_table",
        allow_negative_numbers = true,
        hide_short_help = true
    )]
    step_time: Option<f64>,
    /// Method, or `all`; may be repeated; `deadtime list methods` shows them
    #[arg(long, value_name = "NAME", default_value = "all")]
    method: Vec<String>,
    /// Longest delay to search, seconds. Default: 35 samples, at most 25 % of the longest record, doubled up to 33 % of it while the response begins later
    #[arg(long, value_name = "S")]
    max_delay: Option<f64>,
    /// Model of the plant: adds `state_least_squares` and the model's own relative degree
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// What to take off each channel first
    #[arg(long, value_enum, default_value_t = Detrend::Mean, hide_short_help = true)]
    detrend: Detrend,
    /// Samples that the plant needs to respond without any dead time (its relative degree when sampled); default: the model's, or 1
    #[arg(long, value_name = "N", hide_short_help = true)]
    degree_bias: Option<usize>,
    /// How the log was taken: with the input depending on the output (closed) or not (open); auto looks for it
    #[arg(long = "loop", value_enum, default_value_t = Feedback::Auto)]
    feedback: Feedback,
    /// An option of a method, such as `oestruc.nf=3`; may be repeated
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE", hide_short_help = true)]
    set: Vec<String>,
    /// Also print the dead time against time with its band; --json has every sample of it
    #[arg(long, conflicts_with = "events")]
    track: bool,
    /// Only the answer: at most three lines a pair
    #[arg(long, conflicts_with = "full")]
    brief: bool,
    /// Exit with code 3 where a pair has no dead time that a trusted method supports
    #[arg(long)]
    require: bool,
    /// Every method with every number, also those that are left out, in wide tables
    #[arg(long)]
    full: bool,
    /// Also write a picture of the answers and the impulse responses, as SVG
    #[arg(long, alias = "plot", value_name = "FILE", value_parser = super::picture::picture())]
    svg: Option<PathBuf>,
    /// Also write a page: the signals, zoomable, and every method's answer, as one HTML file
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
}

impl Estimate {
    /// Prints the estimates; as JSON they are deadtime/estimate@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let (report, job) = match (&self.frf, &self.events) {
            (Some(path), _) => (self.of_response(path)?, None),
            (None, Some(columns)) => (self.of_events(columns)?, None),
            (None, None) => {
                let mut job =
                    if self.step_table.is_some() { self.job_of_step(to)? } else { self.job(to)? };
                let bar = Bar::new(to);
                job.far = bar.far().clone();
                (job.run()?.worded(option), Some(job))
            }
        };
        // The files first: they are written even if the pipe is closed.
        to.json(&report)?;
        if let (Some(path), Some(job)) = (&self.svg, &job) {
            draw(job, &report, path)?;
        }
        if let Some(path) = &self.html {
            let evidence =
                job.as_ref().map(|job| job.evidence(&report)).transpose()?.unwrap_or_default();
            let logs = job.as_ref().map(|job| job.logs.as_slice()).unwrap_or_default();
            let text = page::estimate(&report, logs, &evidence);
            write_atomic(path, |out| out.write_all(text.as_bytes()))?;
        }
        match (self.brief, self.full) {
            (true, _) => to.styled(&brief(&report))?,
            (_, true) => to.line(full(&report).trim_end())?,
            _ => to.styled(&short(&report))?,
        }
        self.must_be_trusted(&report)
    }

    /// With --require every pair must have a trusted dead time.
    fn must_be_trusted(&self, report: &Report) -> anyhow::Result<()> {
        let missing = report.pairs.iter().filter(|pair| !trusted(pair));
        let missing: Vec<String> =
            missing.map(|pair| format!("{} → {}", pair.input, pair.output)).collect();
        if self.require && !missing.is_empty() {
            let text = format!("--require: no trusted dead time for {}", missing.join(", "));
            return Err(NothingTrusted(text).into());
        }
        Ok(())
    }

    /// The log; there is one wherever no frequency response is.
    fn log(&self) -> anyhow::Result<&Path> {
        self.step_table
            .as_deref()
            .or(self.log.as_deref())
            .context("LOG is missing: the log to read")
    }

    /// The methods by their names here; for another tool's name a message gives its counterpart.
    fn methods(&self) -> Vec<String> {
        let one = |name: &String| match estimator(name) {
            Some(here) => {
                eprintln!("deadtime: --method {name}: {here} is used");
                here.to_owned()
            }
            None => name.clone(),
        };
        self.method.iter().map(one).collect()
    }

    fn of_response(&self, path: &Path) -> anyhow::Result<Report> {
        let response = read_frequency_response(path)?;
        let job = ResponseJob {
            methods: self.method.clone(),
            options: options(&self.set)?,
            max_delay_s: self.max_delay,
            ..ResponseJob::new(response)
        };
        Ok(job.run()?.worded(option))
    }

    fn job(&self, to: &Out<'_>) -> anyhow::Result<Job> {
        let scopes: &[Scope] =
            if self.model.is_some() { &[Scope::Pair, Scope::States] } else { &[Scope::Pair] };
        let needed = Needed { inputs: &self.input, outputs: &self.output, required: true };
        Ok(Job {
            name: self.log()?.display().to_string(),
            methods: chosen(&self.methods(), &options(&self.set)?, scopes)?,
            model: self.model.as_deref().map(ModelFile::read).transpose()?,
            max_delay_s: self.max_delay,
            degree_bias: self.degree_bias,
            detrend: self.detrend,
            feedback: self.feedback,
            track: self.track,
            ..Job::new(self.reading.read(to, self.log()?, &needed)?, &self.input, &self.output)
        })
    }

    /// The step and its response as a log, by default with the methods for steps and delays up to 25 % of the table.
    fn job_of_step(&self, to: &Out<'_>) -> anyhow::Result<Job> {
        let table = self.log()?;
        let needed = Needed { inputs: &[], outputs: &self.output, required: true };
        let read = self.reading.read(to, table, &needed)?;
        let Some(first) = read.first() else { bail!("{}: no rows", table.display()) };
        let log = Log::of_step(
            first,
            self.output.first().map(String::as_str),
            self.step_size,
            self.step_time,
        )?;
        let scopes: &[Scope] =
            if self.model.is_some() { &[Scope::Pair, Scope::States] } else { &[Scope::Pair] };
        let all = self.method.iter().any(|m| m == "all");
        let methods: Vec<String> = if all {
            STEP_METHODS.iter().map(|m| (*m).to_owned()).collect()
        } else {
            self.method.clone()
        };
        let output: Vec<String> = log.names().filter(|n| *n != STEP).map(str::to_owned).collect();
        let quarter_s = 0.25 * log.duration_s();
        Ok(Job {
            name: table.display().to_string(),
            methods: chosen(&methods, &options(&self.set)?, scopes)?,
            model: self.model.as_deref().map(ModelFile::read).transpose()?,
            max_delay_s: Some(self.max_delay.unwrap_or(quarter_s)),
            feedback: Feedback::Open,
            track: self.track,
            ..Job::new(vec![log], [STEP], output)
        })
    }

    fn of_events(&self, columns: &str) -> anyhow::Result<Report> {
        let methods = chosen(&self.method, &options(&self.set)?, &[Scope::Events])?;
        let Some((a, b)) = columns
            .split_once(',')
            .map(|(a, b)| (a.trim(), b.trim()))
            .filter(|(a, b)| !a.is_empty() && !b.is_empty() && a != b)
        else {
            bail!("--events {columns}: write the two columns as A,B");
        };
        let events = self.reading.events(self.log()?, [a, b])?;
        let job = EventsJob {
            methods,
            max_delay_s: self.max_delay,
            ..EventsJob::new(self.log()?.display().to_string(), [a, b], events)
        };
        Ok(job.run()?.worded(option))
    }
}

/// `METHOD.KEY=VALUE` texts as one JSON object per method.
pub(super) fn options(set: &[String]) -> anyhow::Result<BTreeMap<String, Value>> {
    let mut texts: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for text in set {
        let Some((method, option)) = text.split_once('.').filter(|(_, o)| o.contains('=')) else {
            bail!("--set {text}: write it as METHOD.KEY=VALUE, such as oestruc.nf=3");
        };
        texts.entry(method).or_default().push(option);
    }
    texts
        .into_iter()
        .map(|(method, options)| Ok((method.to_owned(), registry::options(options)?)))
        .collect()
}

/// Writes the picture of a report: answers, and impulse responses where the inputs allow them.
pub(super) fn draw(job: &Job, report: &Report, path: &Path) -> anyhow::Result<()> {
    let responses = job.responses(report)?;
    let pairs: Vec<Shown<'_>> = report
        .pairs
        .iter()
        .zip(&responses)
        .map(|(pair, r)| Shown { pair, response: r.as_ref() })
        .collect();
    let text = svg(&pairs, report.sample_time_s);
    Ok(write_atomic(path, |out| out.write_all(text.as_bytes()))?)
}

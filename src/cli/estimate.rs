//! `deadtime estimate`: the dead time in a measured log, by every method.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail};
use nalgebra::DVector;
use rayon::prelude::*;
use serde_json::Value;

use super::source::Source;
use super::write_json;
use crate::delay::{
    Condition, DelayError, DelayEstimate, DelayEstimator, Detrend, Experiment, Finding, Information, METHODS, Method, Outcome, PlantModel,
    Recording, Richness, Scope, Search, Start, Threshold, conditions, moving_together, richness, verdict,
};
use crate::file::write_atomic;
use crate::identify::fir;
use crate::log::Log;
use crate::model::c2d::{Conversion, ZeroOrderHold};
use crate::model::{ModelFile, Operating, Sampled, StateSpace};
use crate::registry::{RegistryError, options};
use crate::report::estimate::{Estimate as Row, FORMAT, Pair, Report};
use crate::report::picture::{Panel, Response, svg};
use crate::time::SampleTime;

/// Estimate the dead time between inputs and outputs of a log, by one method or all, and say what to believe
#[derive(Debug, clap::Args)]
pub(super) struct Estimate {
    #[command(flatten)]
    source: Source,
    /// Input channel (the command); may be repeated
    #[arg(long, value_name = "U", required_unless_present = "events")]
    input: Vec<String>,
    /// Output channel (the response); may be repeated
    #[arg(long, value_name = "Y", required_unless_present = "events")]
    output: Vec<String>,
    /// Two columns of event times instead of channels: when the same events were seen at two places; no `time` column is needed
    #[arg(long, value_name = "A,B", conflicts_with_all = ["input", "output", "model", "degree_bias", "plot"])]
    events: Option<String>,
    /// Method, or `all`; may be repeated; `deadtime list methods` shows them
    #[arg(long, value_name = "NAME", default_value = "all")]
    method: Vec<String>,
    /// Longest delay to search, seconds; default 35 samples
    #[arg(long, value_name = "S")]
    max_delay: Option<f64>,
    /// Model of the plant: adds `state_least_squares` and the model's own relative degree
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// What to take off each channel first
    #[arg(long, value_enum, default_value_t = Detrend::Mean)]
    detrend: Detrend,
    /// Samples that the plant needs to respond without any dead time (its relative degree when sampled); default: the model's, or 1
    #[arg(long, value_name = "N")]
    degree_bias: Option<usize>,
    /// How the log was taken: with the input depending on the output (closed) or not (open); auto looks for it
    #[arg(long = "loop", value_enum, default_value_t = Feedback::Auto)]
    feedback: Feedback,
    /// An option of a method, such as `oestruc.nf=3`; may be repeated
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE")]
    set: Vec<String>,
    /// Show every method in the tables, also those whose answers do not count
    #[arg(long)]
    full: bool,
    /// Also draw the answers and the impulse responses, as SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

impl Estimate {
    /// Prints the estimates; as JSON they are deadtime/estimate@1.
    pub(super) fn run(&self, json: Option<&Path>) -> anyhow::Result<()> {
        if let Some(columns) = &self.events {
            let methods = chosen(&self.method, &self.set, &[Scope::Events])?;
            let (report, preamble) = super::events::run(&self.source, columns, &methods, self.max_delay)?;
            write_json(json, &report)?;
            say!("{preamble}\n{}", report.text(self.full).trim_end());
            return Ok(());
        }
        let scopes: &[Scope] = if self.model.is_some() { &[Scope::Pair, Scope::States] } else { &[Scope::Pair] };
        for channels in [&self.input, &self.output] {
            if let Some((_, twice)) = channels.iter().enumerate().find(|(i, c)| channels[..*i].contains(c)) {
                bail!("`{twice}` is given twice: name every input and every output once");
            }
        }
        let logs = self.source.read(&self.input)?;
        let job = Job {
            name: self.source.log.display().to_string(),
            logs,
            inputs: self.input.clone(),
            outputs: self.output.clone(),
            methods: chosen(&self.method, &self.set, scopes)?,
            model: self.model.as_deref().map(ModelFile::read).transpose()?,
            max_delay_s: self.max_delay,
            degree_bias: self.degree_bias,
            detrend: self.detrend,
            feedback: self.feedback,
        };
        let (report, mut preamble) = job.run()?;
        if self.source.reading.resample.is_some() {
            preamble.push_str("; outputs were interpolated, which makes a response up to a step of the log's own too early");
        }
        // The files first: whoever closes the pipe still gets them.
        write_json(json, &report)?;
        if let Some(path) = &self.plot {
            job.draw(&report, path)?;
        }
        say!("{preamble}\n{}", report.text(self.full).trim_end());
        Ok(())
    }
}

/// What is known of feedback in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Feedback {
    Auto,
    Open,
    Closed,
}

/// A method, ready to run.
pub(super) struct Ready {
    pub(super) method: &'static Method,
    pub(super) estimator: Box<dyn DelayEstimator>,
}

/// The methods asked for, with their options; `all` are those that look at one of `scopes`.
pub(super) fn chosen(names: &[String], set: &[String], scopes: &[Scope]) -> anyhow::Result<Vec<Ready>> {
    let known = || METHODS.iter().map(|m| m.entry.name).collect::<Vec<_>>();
    let unknown = |name: &str| RegistryError::Unknown { kind: "method", name: name.to_owned(), known: known() };
    let all = names.iter().any(|n| n == "all");
    if let Some(name) = names.iter().find(|n| *n != "all" && !known().contains(&n.as_str())) {
        return Err(unknown(name).into());
    }
    let mut per_method: Vec<Vec<&str>> = vec![Vec::new(); METHODS.len()];
    for text in set {
        let Some((method, option)) = text.split_once('.').filter(|(_, o)| o.contains('=')) else {
            bail!("--set {text}: write it as METHOD.KEY=VALUE, such as oestruc.nf=3");
        };
        let at = METHODS.iter().position(|m| m.entry.name == method).ok_or_else(|| unknown(method))?;
        per_method[at].push(option);
    }
    let mut ready = Vec::new();
    for (method, texts) in METHODS.iter().zip(per_method) {
        let named = names.iter().any(|n| n == method.entry.name);
        if named && (method.scope == Scope::Events) != scopes.contains(&Scope::Events) {
            let instead =
                if method.scope == Scope::Events { "event times: give --events A,B" } else { "samples: give --input and --output" };
            bail!("{} looks at {instead}", method.entry.name);
        }
        if named || (all && scopes.contains(&method.scope)) {
            let given: Value = options(texts)?;
            ready.push(Ready { method, estimator: method.entry.with(given)? });
        }
    }
    Ok(ready)
}

/// Everything that an estimation needs.
pub(super) struct Job {
    pub(super) name: String,
    pub(super) logs: Vec<Log>,
    pub(super) inputs: Vec<String>,
    pub(super) outputs: Vec<String>,
    pub(super) methods: Vec<Ready>,
    pub(super) model: Option<ModelFile>,
    pub(super) max_delay_s: Option<f64>,
    pub(super) degree_bias: Option<usize>,
    pub(super) detrend: Detrend,
    pub(super) feedback: Feedback,
}

impl Job {
    /// The report, and a sentence on what was searched and assumed.
    pub(super) fn run(&self) -> anyhow::Result<(Report, String)> {
        // Checked as logged first, so that a message shows the values that are in the file.
        Experiment::from_logs(&self.logs, &self.inputs, &self.outputs, Detrend::None)?.check().with_context(|| self.name.clone())?;
        let mut experiment = Experiment::from_logs(&self.logs, &self.inputs, &self.outputs, self.detrend)?;
        experiment.check().with_context(|| self.name.clone())?;
        let ts = experiment.sample_time;
        let mut search = Search { max_delay: self.max_delay(ts)?, ..Search::default() };
        let mut bias = "assumed relative degree 1 (a strictly proper plant behind a zero-order hold)".to_owned();
        if let Some(model) = &self.model {
            search.bias = self.relative_degrees(model, ts)?;
            bias = format!("relative degrees of {} behind a zero-order hold", model.name);
        }
        if let Some(given) = self.degree_bias {
            (search.bias, search.default_bias) = (Vec::new(), given);
            bias = format!("relative degree {given} as given");
        }
        let mut pairs = self.pairs(&experiment, &search)?;
        if let Some(model) = &self.model {
            experiment = self.with_states(model, ts)?;
            pairs.extend(self.inputs_by_state(&experiment, &search)?);
        }
        let samples: usize = self.logs.iter().map(Log::len).sum();
        let records = if self.logs.len() > 1 { format!(" in {} records", self.logs.len()) } else { String::new() };
        #[allow(clippy::cast_precision_loss)]
        let max_delay_s = ts.to_seconds(search.max_delay as f64);
        let preamble =
            format!("{}: {samples} samples{records}, one every {} s; searched 0 to {max_delay_s:.4} s; {bias}", self.name, ts.seconds());
        Ok((Report { format: FORMAT, log: self.name.clone(), sample_time_s: ts.seconds(), max_delay_s, pairs }, preamble))
    }

    /// Writes the picture of a report: answers, and impulse responses where the inputs allow them.
    pub(super) fn draw(&self, report: &Report, path: &Path) -> anyhow::Result<()> {
        let experiment = Experiment::from_logs(&self.logs, &self.inputs, &self.outputs, self.detrend)?;
        let response = |pair: &Pair| {
            let input = self.inputs.iter().position(|c| *c == pair.input)?;
            let output = self.outputs.iter().position(|c| *c == pair.output)?;
            let taps = Threshold::default().taps;
            let fir = fir(&experiment.pair(input, output).ok()?, taps)?;
            Some(Response {
                values: fir.coefficients.iter().copied().collect(),
                std: fir.covariance.diagonal().map(|v| v.max(0.0).sqrt()).iter().copied().collect(),
            })
        };
        let responses: Vec<Option<Response>> = report.pairs.iter().map(response).collect();
        let panels: Vec<Panel<'_>> = report.pairs.iter().zip(&responses).map(|(pair, r)| Panel { pair, response: r.as_ref() }).collect();
        let text = svg(&panels, report.sample_time_s).map_err(anyhow::Error::msg).with_context(|| path.display().to_string())?;
        Ok(write_atomic(path, |out| out.write_all(text.as_bytes()))?)
    }

    fn max_delay(&self, ts: SampleTime) -> anyhow::Result<usize> {
        let Some(seconds) = self.max_delay_s else { return Ok(Search::default().max_delay) };
        let samples = ts.samples(seconds)?;
        let longest = samples.whole + usize::from(samples.fraction > 0.0);
        let rows = self.logs.iter().map(Log::len).max().unwrap_or(0);
        if longest == 0 || longest >= rows {
            bail!("--max-delay {seconds}: give at least one sample ({} s) and less than the log is long ({} samples)", ts.seconds(), rows);
        }
        Ok(longest)
    }

    /// Every pair by every method that looks at pairs.
    fn pairs(&self, experiment: &Experiment, search: &Search) -> anyhow::Result<Vec<Pair>> {
        let methods: Vec<&Ready> = self.methods.iter().filter(|r| r.method.scope == Scope::Pair).collect();
        let mut pairs = Vec::new();
        if methods.is_empty() {
            return Ok(pairs);
        }
        for (o, output) in self.outputs.iter().enumerate() {
            for (i, input) in self.inputs.iter().enumerate() {
                let one = experiment.select(i, o)?;
                let rested = if self.detrend == Detrend::Mean { one.from_rest() } else { None };
                // What a method that takes all inputs together sees: this one first.
                let together = experiment.towards(i, o)?;
                let degree = |input: usize| search.bias.get(o).and_then(|row| row.get(input)).copied().unwrap_or(search.default_bias);
                let inputs = std::iter::once(i).chain((0..self.inputs.len()).filter(|other| *other != i));
                let own = vec![inputs.map(degree).collect()];
                let mut search = Search { bias: own, ..search.clone() };
                let mut findings = self.findings(&one, &search)?;
                findings.extend(moving_together(&together, 0, search.max_delay));
                if findings.iter().any(|f| f.condition == Condition::Feedback) {
                    // A controller that answers within the sample would pass for a plant that does.
                    search.min_delay = search.bias.first().and_then(|row| row.first()).copied().unwrap_or(search.default_bias);
                }
                let looks: Vec<&Method> = methods.iter().map(|r| r.method).collect();
                // What has no prediction has none; why it cannot be used at all each method says itself.
                let predicted =
                    richness(rested.as_ref().unwrap_or(&one), &search, 0, 0, &looks).unwrap_or_else(|_| vec![None; looks.len()]);
                let answer = |(ready, predicted): (&&Ready, Option<Richness>)| -> anyhow::Result<Answer> {
                    let clock = Instant::now();
                    // What a method cannot do with this log is its answer; the others go on.
                    let sees = match ready.method.start {
                        _ if ready.estimator.is_joint() => &together,
                        Start::Rest => rested.as_ref().unwrap_or(&one),
                        Start::Any => &one,
                    };
                    let estimate = match ready.estimator.estimate(sees, &search) {
                        Ok(mut estimates) if !estimates.is_empty() => estimates.remove(0).estimate,
                        Ok(_) => DelayEstimate::without(Outcome::NotApplicable, "no answer for this pair"),
                        // What was typed wrong stops the command.
                        Err(e @ DelayError::Option { .. }) => return Err(e.into()),
                        Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.to_string()),
                    };
                    Ok(Answer { method: ready.method, estimate, predicted, time_s: clock.elapsed().as_secs_f64() })
                };
                let answers: Vec<Answer> = methods.par_iter().zip(predicted).map(answer).collect::<anyhow::Result<_>>()?;
                pairs.push(pair(input, output, &answers, findings, experiment.sample_time));
            }
        }
        Ok(pairs)
    }

    /// What the record shows, corrected by what the user knows of its loop.
    fn findings(&self, one: &Experiment, search: &Search) -> anyhow::Result<Vec<Finding>> {
        let mut findings = conditions(&one.pair(0, 0)?, search.max_delay);
        if self.feedback != Feedback::Auto {
            findings.retain(|f| f.condition != Condition::Feedback);
        }
        if self.feedback == Feedback::Closed {
            findings.push(Finding { condition: Condition::Feedback, evidence: "--loop closed".to_owned() });
        }
        Ok(findings)
    }

    /// Every input by every method that looks at the states.
    fn inputs_by_state(&self, experiment: &Experiment, search: &Search) -> anyhow::Result<Vec<Pair>> {
        let mut pairs = Vec::new();
        for ready in self.methods.iter().filter(|r| r.method.scope == Scope::States) {
            let clock = Instant::now();
            let answers = ready.estimator.estimate(experiment, search);
            let time_s = clock.elapsed().as_secs_f64();
            for (i, input) in experiment.inputs.iter().enumerate() {
                let estimate = match &answers {
                    Ok(estimates) => estimates
                        .iter()
                        .find(|e| e.input == i)
                        .map_or_else(|| DelayEstimate::without(Outcome::NotApplicable, "no answer for this input"), |e| e.estimate.clone()),
                    Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.to_string()),
                };
                let answer = Answer { method: ready.method, estimate, predicted: None, time_s };
                pairs.push(pair(input, "*", &[answer], Vec::new(), experiment.sample_time));
            }
        }
        Ok(pairs)
    }

    /// Relative degrees of the sampled model by output and input of the command line; 1 where the model lacks the pair.
    fn relative_degrees(&self, model: &ModelFile, ts: SampleTime) -> anyhow::Result<Vec<Vec<usize>>> {
        let sampled = sampled(model, ts)?;
        let degree = |output: &String, input: &String| {
            let output = model.outputs.iter().position(|c| &c.name == output)?;
            let input = model.inputs.iter().position(|c| &c.name == input)?;
            sampled.relative_degree(output, input)
        };
        Ok(self.outputs.iter().map(|o| self.inputs.iter().map(|i| degree(o, i).unwrap_or(1)).collect()).collect())
    }

    /// All inputs of the model and its states, as logged: A and B are about the channels themselves, so nothing is detrended.
    fn with_states(&self, model: &ModelFile, ts: SampleTime) -> anyhow::Result<Experiment> {
        let inputs: Vec<String> = model.inputs.iter().map(|c| c.name.clone()).collect();
        let plant = if model.is_sampled() { PlantModel::Sampled(sampled(model, ts)?) } else { PlantModel::Continuous(model.continuous()?) };
        let mut experiment = Experiment::from_logs(&self.logs, &inputs, &self.outputs, Detrend::None)?;
        for (log, recording) in self.logs.iter().zip(&mut experiment.recordings) {
            for (channel, values) in model.inputs.iter().zip(&mut recording.inputs) {
                let operating = match channel.operating {
                    Operating::Value(v) => v,
                    Operating::Mean(_) => DVector::from_column_slice(values).mean(),
                };
                values.iter_mut().for_each(|v| *v -= operating);
            }
            states(log, model, recording);
        }
        experiment.model = Some(plant);
        Ok(experiment)
    }
}

/// Adds the measured states where the log has all of them.
fn states(log: &Log, model: &ModelFile, recording: &mut Recording) {
    let columns: Result<Vec<Vec<f64>>, _> = model.states.iter().map(|s| log.input(&s.name).map(<[f64]>::to_vec)).collect();
    recording.states = columns.unwrap_or_default();
}

fn sampled(model: &ModelFile, ts: SampleTime) -> anyhow::Result<StateSpace<Sampled>> {
    if model.is_sampled() {
        let sampled = model.sampled()?;
        sampled.sample_time().must_equal(ts).with_context(|| format!("model {} and log", model.name))?;
        return Ok(sampled);
    }
    Ok(ZeroOrderHold {}.c2d(&model.continuous()?, ts)?)
}

/// A method's answer, what was to be expected of it, and its run time, s.
pub(super) struct Answer {
    pub(super) method: &'static Method,
    pub(super) estimate: DelayEstimate,
    pub(super) predicted: Option<Richness>,
    pub(super) time_s: f64,
}

pub(super) fn pair(input: &str, output: &str, answers: &[Answer], findings: Vec<Finding>, sample_time: SampleTime) -> Pair {
    let by_trust: Vec<(&Method, &DelayEstimate)> = answers.iter().map(|a| (a.method, &a.estimate)).collect();
    Pair {
        input: input.to_owned(),
        output: output.to_owned(),
        estimates: answers.iter().map(|a| Row::new(a.method, &a.estimate, a.predicted.map(|p| p.std_s), a.time_s, &findings)).collect(),
        warning: poor(answers, sample_time),
        verdict: verdict(&by_trust, &findings, sample_time),
        findings,
    }
}

/// That the data hardly tell neighbouring delays apart, by the best that is to be expected of a method that knows neither gain nor poles.
fn poor(answers: &[Answer], sample_time: SampleTime) -> Option<String> {
    let expected = answers.iter().filter(|a| matches!(a.method.information, Information::Poles(_))).filter_map(|a| a.predicted);
    let best = expected.max_by(|a, b| a.separation.total_cmp(&b.separation)).filter(|p| p.separation < TOLD_APART)?;
    let step = sample_time.seconds();
    let std = crate::report::seconds(best.data_std_s, step);
    Some(format!(
        "poor data: a standard deviation of {std} s was to be expected before any method ran, so delays {step} s apart are hardly told apart"
    ))
}

/// Half the distance between two responses, in standard deviations of the noise, from which they are seldom taken for each other.
const TOLD_APART: f64 = 3.0;

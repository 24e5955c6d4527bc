//! The whole estimation: the methods asked for, on every pair of a log, with what the record shows, what was to be expected and what to believe.

use deadtime_signal::remedy::{Message, Remedied, Remedy};
use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::DVector;
use rayon::prelude::*;
use serde_json::Value;

use super::conditions::of_the_plant;
use super::conditions::{Finding, moving_together, standing_off};
use super::error::DelayError;
use super::error::Result;
use super::estimate::{DelayEstimate, Outcome};
use super::estimator::{DelayEstimator, Search};
use super::evidence::{Evidence, evidence, impulse_response};
use super::experiment::recordings;
use super::experiment::{Detrend, Experiment, PlantModel, Recording, Series};
use super::feedback::{InLoop, held_for, in_loop, lead, open_part};
use super::method::{Condition, Information, Method, Scope, Start};
use super::methods::METHODS;
use super::report::{Bias, Estimate, FORMAT, Pair, Report, Response, Searched};
use super::richness::{Richness, richness};
use super::verdict::EXPERIMENT;
use super::verdict::{Grounds, RecordFacts, Verdict, distrust, verdict};
use super::watched;
use crate::events::jitter::Jitter;
use crate::events::offsets::Events;
use crate::process::family::rough;
use crate::process::orders::judge_orders;
use crate::process::shares::{Measured, Shares};
use deadtime_identify::Record;
use deadtime_log::{EventTimes, Log};
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{ModelFile, Operating, Sampled, StateSpace};
use deadtime_signal::progress::HowFar;
use deadtime_signal::registry::RegistryError;
use deadtime_signal::stats;
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::stop::Stop;
use deadtime_signal::time::SampleTime;

/// What is known of feedback in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Feedback {
    /// Nothing: it is looked for.
    #[default]
    Auto,
    /// The input does not depend on the output.
    Open,
    /// It does.
    Closed,
}

impl Feedback {
    /// What the user says of the log, as a finding.
    fn said(self) -> Option<Finding> {
        let evidence = Message::from(Remedy::ClosedLoop);
        (self == Self::Closed).then_some(Finding { condition: Condition::Feedback, evidence })
    }
}

/// A method, ready to run.
pub struct Ready {
    /// Its line in the list.
    pub method: &'static Method,
    /// The method with its options.
    pub estimator: Box<dyn DelayEstimator>,
}

impl Ready {
    /// Every method that looks at samples, with its default options.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let methods = METHODS.iter().filter(|m| m.scope != Scope::Events);
        methods
            .filter_map(|method| {
                Some(Self {
                    method,
                    estimator: method.entry.with(Value::Object(serde_json::Map::new())).ok()?,
                })
            })
            .collect()
    }
}

/// Methods that a single step is enough for, by their names.
pub const STEP_METHODS: [&str; 6] = ["p1d", "p2d", "p3d", "p2dz", "area1", "cusum_step"];

/// The methods asked for, in the list's order, with their options as JSON objects; `all` are those that look at one of `scopes`.
///
/// # Errors
/// [`RegistryError`] for a name or an option that there is not; [`DelayError::WrongScope`] for a method that looks at something else.
pub fn chosen(
    names: &[String],
    options: &BTreeMap<String, Value>,
    scopes: &[Scope],
) -> Result<Vec<Ready>> {
    let known = || METHODS.iter().map(|m| m.entry.name).collect::<Vec<_>>();
    let all = names.iter().any(|n| n == "all");
    let mut named = names.iter().filter(|n| *n != "all").chain(options.keys());
    if let Some(name) = named.find(|n| !known().contains(&n.as_str())) {
        return Err(
            RegistryError::Unknown { kind: "method", name: name.clone(), known: known() }.into()
        );
    }
    let mut ready = Vec::new();
    for method in METHODS {
        let named = names.iter().any(|n| n == method.entry.name);
        if named && (method.scope == Scope::Events) != scopes.contains(&Scope::Events) {
            return Err(DelayError::WrongScope {
                method: method.entry.name,
                events: method.scope == Scope::Events,
            }
            .into());
        }
        if named || (all && scopes.contains(&method.scope)) {
            let given = options
                .get(method.entry.name)
                .cloned()
                .unwrap_or_else(|| Value::Object(serde_json::Map::new()));
            ready.push(Ready { method, estimator: method.entry.with(given)? });
        }
    }
    Ok(ready)
}

/// Everything that an estimation needs; [`Job::new`] has every method and the defaults.
pub struct Job {
    /// What the log is called.
    pub name: String,
    /// Its records, all on one even grid.
    pub logs: Vec<Log>,
    /// Input channels.
    pub inputs: Vec<String>,
    /// Output channels; every pair with an input is estimated.
    pub outputs: Vec<String>,
    /// The methods, as [`Ready::all`] or [`chosen`] makes them; those that look at states wait for a model.
    pub methods: Vec<Ready>,
    /// The plant: its relative degrees, and A and B for the methods that look at states.
    pub model: Option<ModelFile>,
    /// Longest delay to search, s; `None`: that of [`Search`], of records shorter than four times that a quarter of the longest.
    pub max_delay_s: Option<f64>,
    /// Samples that the plant needs to respond without any dead time; `None`: the model's, or 1.
    pub degree_bias: Option<usize>,
    /// What to take off each channel first.
    pub detrend: Detrend,
    /// What is known of feedback.
    pub feedback: Feedback,
    /// The delay against time is wanted, also where one delay describes the records.
    pub track: bool,
    /// Looked at between methods, pairs, and the delays of long scans.
    pub stop: Stop,
    /// Where it is said how many methods have answered.
    pub far: HowFar,
}

impl Job {
    /// Every method on every pair of these inputs and outputs of one or several records, with the defaults of [`Search`], means taken off, and feedback looked for;
    /// called as its first record is.
    pub fn new<I: Into<String>, O: Into<String>>(
        logs: Vec<Log>,
        inputs: impl IntoIterator<Item = I>,
        outputs: impl IntoIterator<Item = O>,
    ) -> Self {
        Self {
            name: logs.first().map_or_else(String::new, |log| log.source().to_owned()),
            logs,
            inputs: inputs.into_iter().map(Into::into).collect(),
            outputs: outputs.into_iter().map(Into::into).collect(),
            methods: Ready::all(),
            model: None,
            max_delay_s: None,
            degree_bias: None,
            detrend: Detrend::default(),
            feedback: Feedback::default(),
            track: false,
            stop: Stop::default(),
            far: HowFar::default(),
        }
    }

    /// Estimates every pair by every method.
    ///
    /// # Errors
    /// What the channels, the model or a typed option cannot be used for; [`super::error::Error::Stopped`]. What a method cannot do with the data is its answer.
    pub fn run(&self) -> Result<Report> {
        let (logged, search, bias) = self.prepared()?;
        let ts = logged.sample_time();
        let experiment = self.detrended(&logged)?;
        let mut pairs = self.pairs(&logged, &experiment, &search)?;
        if let Some(model) = &self.model {
            pairs.extend(self.inputs_by_state(model, ts, &search)?);
        }
        let samples = self.logs.iter().map(Log::len).sum();
        let searched =
            Searched::Samples { samples, records: self.logs.len(), bias, early_s: self.early_s() };
        let max_delay_s = ts.to_seconds(search.max_delay as f64);
        Ok(Report {
            format: FORMAT,
            log: self.name.clone(),
            sample_time_s: ts.seconds(),
            max_delay_s,
            pairs,
            searched,
        })
    }

    /// The impulse responses of a report's pairs, where the inputs allow them.
    ///
    /// # Errors
    /// As [`impulse_response`].
    pub fn responses(&self, report: &Report) -> Result<Vec<Option<Response>>> {
        let response = |pair: &Pair| match pair.output.as_str() {
            "*" => Ok(None),
            output => impulse_response(&self.logs, &pair.input, output, self.detrend),
        };
        report.pairs.iter().map(response).collect()
    }

    /// What the methods look at, for each pair of a report; `None` for pairs of an input and all states.
    ///
    /// # Errors
    /// As [`evidence`].
    pub fn evidence(&self, report: &Report) -> Result<Vec<Option<Evidence>>> {
        let max_delay = (report.max_delay_s / report.sample_time_s).round() as usize;
        let of = |pair: &Pair| match pair.output.as_str() {
            "*" => Ok(None),
            output => evidence(&self.logs, &pair.input, output, self.detrend, max_delay).map(Some),
        };
        report.pairs.iter().map(of).collect()
    }

    /// What is to be expected of each method that looks at pairs, before any runs: for each pair, outputs first, one line a method.
    ///
    /// # Errors
    /// As [`Job::run`].
    pub fn expected(&self) -> Result<Vec<Expected>> {
        let (logged, search, _) = self.prepared()?;
        let experiment = self.detrended(&logged)?;
        let methods: Vec<&Method> =
            self.methods.iter().map(|r| r.method).filter(|m| m.scope == Scope::Pair).collect();
        let mut expected = Vec::new();
        for (o, output) in self.outputs.iter().enumerate() {
            let shares = Shares::of(&experiment.towards(0, o)?, search.max_delay, &self.stop)?;
            for (i, input) in self.inputs.iter().enumerate() {
                self.stop.check()?;
                let seen = self.seen(&logged, &experiment, &search, (i, o), shares.as_ref())?;
                let predicted = richness(seen.by_start(Start::Rest), &seen.search, &methods)?;
                let methods = methods.iter().map(|m| m.entry.name).zip(predicted).collect();
                expected.push(Expected { input: input.clone(), output: output.clone(), methods });
            }
        }
        Ok(expected)
    }

    fn in_log(&self) -> impl Fn(DelayError) -> DelayError {
        |error| DelayError::In { log: self.name.clone(), error: Box::new(error) }
    }

    fn detrended<'a>(&self, logged: &'a Experiment<'_>) -> Result<Experiment<'a>> {
        Ok(logged.detrended(self.detrend).map_err(self.in_log())?)
    }

    /// The channels as they were logged, so that a message shows the values that are in the file; the window and the bias.
    fn prepared(&self) -> Result<(Experiment<'_>, Search, Bias)> {
        for channels in [&self.inputs, &self.outputs] {
            if let Some((_, twice)) =
                channels.iter().enumerate().find(|(i, c)| channels[..*i].contains(c))
            {
                return Err(DelayError::Twice { channel: twice.clone() }.into());
            }
        }
        let (ts, recordings) = recordings(&self.logs, &self.inputs, &self.outputs)?;
        let logged = Experiment::new(ts, self.inputs.clone(), self.outputs.clone(), recordings)
            .map_err(self.in_log())?;
        let mut search =
            Search { max_delay: self.max_delay(ts)?, stop: self.stop.clone(), ..Search::default() };
        let mut bias = Bias::Assumed;
        if let Some(model) = &self.model {
            search.bias = self.relative_degrees(model, ts)?;
            bias = Bias::Model(model.name.clone());
        }
        if let Some(given) = self.degree_bias {
            (search.bias, search.default_bias) = (Vec::new(), given);
            bias = Bias::Given(given);
        }
        Ok((logged, search, bias))
    }

    /// By how much a response may look too early because the logs were put onto another grid than their own, s.
    fn early_s(&self) -> f64 {
        self.logs.iter().map(Log::early_s).fold(0.0, f64::max)
    }

    fn max_delay(&self, ts: SampleTime) -> Result<usize> {
        let samples = self.logs.iter().map(Log::len).max().unwrap_or(0);
        // Of a short record no method could search more.
        let Some(seconds) = self.max_delay_s else {
            return Ok(Search::default().max_delay.min(samples / 4).max(1));
        };
        let longest = whole(ts, seconds)?;
        if longest == 0 || longest >= samples {
            return Err(DelayError::MaxDelay { seconds, step_s: ts.seconds(), samples }.into());
        }
        Ok(longest)
    }

    /// Every pair by every method that looks at pairs.
    fn pairs(
        &self,
        logged: &Experiment<'_>,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<Vec<Pair>> {
        let methods: Vec<&Ready> =
            self.methods.iter().filter(|r| r.method.scope == Scope::Pair).collect();
        let mut pairs = Vec::new();
        if methods.is_empty() {
            return Ok(pairs);
        }
        for (o, output) in self.outputs.iter().enumerate() {
            let shares = Shares::of(&experiment.towards(0, o)?, search.max_delay, &self.stop)?;
            for (i, input) in self.inputs.iter().enumerate() {
                self.stop.check()?;
                let share =
                    |done: usize| done as f64 / (self.inputs.len() * self.outputs.len()) as f64;
                let far = self
                    .far
                    .part(share(o * self.inputs.len() + i), share(o * self.inputs.len() + i + 1));
                far.at(0.0, &format_args!("what the record of {input} and {output} shows"));
                let seen = self.seen(logged, experiment, search, (i, o), shares.as_ref())?;
                let mut search = seen.search.clone();
                let bias = search
                    .bias
                    .first()
                    .and_then(|row| row.first())
                    .copied()
                    .unwrap_or(search.default_bias);
                let records = seen.one.pair(0, 0)?;
                let looped = &seen.looped;
                let mut findings = of_the_plant(&seen.alone().pair(0, 0)?, search.max_delay);
                findings.extend(self.feedback.said().or_else(|| looped.finding()));
                findings.extend(moving_together(&seen.together, search.max_delay));
                self.stop.check()?;
                let closed = findings.iter().any(|f| f.condition == Condition::Feedback);
                if closed {
                    // A controller that answers within the sample would pass for a plant that does.
                    search.min_delay = bias;
                }
                let ts = experiment.sample_time();
                let open =
                    if closed { open_experiment(&seen.one, search.max_delay, bias)? } else { None };
                let looks: Vec<&Method> = methods.iter().map(|r| r.method).collect();
                // What has no prediction has none; why it cannot be used at all each method says itself.
                let predicted = richness(seen.by_start(Start::Rest), &search, &looks)
                    .unwrap_or_else(|_| vec![None; looks.len()]);
                let (answering, what) = (
                    far.part(LOOKED, ANSWERED),
                    format!("answers of methods on {input} and {output}"),
                );
                let steps = answering.steps(methods.len(), &what);
                let answer = |(ready, predicted): (&&Ready, Option<Richness>)| -> Result<Answer> {
                    self.stop.check()?;
                    let clock = Instant::now();
                    // What a method cannot do with this log is its answer; the others go on.
                    let sees = if ready.estimator.is_joint() {
                        seen.all_inputs(ready.method.start)
                    } else {
                        seen.by_start(ready.method.start)
                    };
                    // What does not withstand feedback sees what is free of it.
                    let freed =
                        open.as_ref().filter(|_| !ready.method.withstands(Condition::Feedback));
                    let estimate = match ready.estimator.estimate(freed.unwrap_or(sees), &search) {
                        Ok(estimate) if freed.is_some() => estimate.of_open_part(),
                        Ok(estimate) => estimate,
                        // What was typed wrong stops the work.
                        Err(e @ (DelayError::Option { .. } | DelayError::Stopped)) => {
                            return Err(e.into());
                        }
                        Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.message()),
                    };
                    steps.one_more();
                    Ok(Answer {
                        method: ready.method,
                        estimate,
                        predicted,
                        time_s: clock.elapsed().as_secs_f64(),
                    })
                };
                let mut answers: Vec<Answer> =
                    methods.par_iter().zip(predicted).map(answer).collect::<Result<_>>()?;
                let one_step = records.iter().all(Record::is_one_step);
                let others_act = seen.freed.is_some();
                if one_step || others_act {
                    judge_orders(answers.iter_mut().map(|a| (a.method, &mut a.estimate)));
                }
                self.stop.check()?;
                far.at(
                    ANSWERED,
                    &format_args!("whether the delay of {output} behind {input} changes"),
                );
                let held =
                    if closed && self.feedback == Feedback::Auto { held_for(&records) } else { 1 };
                let held_s = ts.to_seconds(held as f64 - 1.0);
                let facts = RecordFacts {
                    early_s: self.early_s().max(held_s),
                    direct: looped.direct,
                    one_step,
                    others_act,
                };
                let mut pair = pair(input, output, &answers, findings, ts, &facts);
                if let Some(shares) = shares.as_ref().filter(|_| others_act) {
                    pair.verdict.why.push_str(&taken_off_note(&self.inputs, &shares.beside(i)));
                }
                if held > 1 {
                    pair.verdict = held_verdict(pair.verdict, input, held, ts);
                }
                // Between interpolated samples every jump stands off.
                if self.early_s() == 0.0 {
                    pair.standing_off = standing_off(&seen.one.pair(0, 0)?);
                }
                let lead = if self.feedback == Feedback::Auto {
                    lead(&records, search.max_delay, bias)
                } else {
                    None
                };
                if looped.tied {
                    pair.verdict = none(tied_note(input, output));
                } else if let Some(samples) = lead {
                    pair.verdict = none(lead_note(input, output, samples, ts));
                } else {
                    watched::tell(
                        &mut pair,
                        seen.alone(),
                        &search,
                        &methods,
                        &watched::Asked { track: self.track, facts },
                    )?;
                }
                far.at(1.0, &format_args!("{input} and {output} done"));
                pairs.push(pair);
            }
        }
        Ok(pairs)
    }

    /// One pair of the experiment.
    fn seen<'a>(
        &self,
        logged: &'a Experiment<'_>,
        experiment: &'a Experiment<'_>,
        search: &Search,
        (i, o): (usize, usize),
        shares: Option<&Shares>,
    ) -> Result<Seen<'a>> {
        let search = search.towards(i, o, self.inputs.len());
        let (one, together) = (experiment.select(i, o)?, experiment.towards(i, o)?);
        let looped = self.looped(&one.pair(0, 0)?, search.max_delay, search.bias(0, 0));
        // What a loop makes of several inputs is no sum of what each does.
        let closed = self.feedback.said().is_some() || looped.finding().is_some();
        let shares = shares.filter(|s| !closed && !s.beside(i).is_empty());
        let without = |together: &Experiment<'_>, from| {
            shares.map(|s| s.without_others(together, i, from)).transpose()
        };
        let freed = without(&together, Measured::FromMean)?;
        let at_mean = freed.as_ref().unwrap_or(&one);
        let rested = if self.detrend == Detrend::Mean {
            let all_rested = together
                .from_rest()
                .map(|t| without(&t, Measured::FromRest))
                .transpose()?
                .flatten();
            let before_moving =
                all_rested.or_else(|| at_mean.from_rest()).map(|e| (e, Level::BeforeMoving));
            let as_logged = match without(&logged.towards(i, o)?, Measured::FromRest)? {
                Some(freed) => freed,
                None => logged.select(i, o)?,
            };
            self.best_start(
                at_mean,
                [before_moving, Some((as_logged, Level::AsLogged))],
                search.max_delay,
            )?
        } else {
            None
        };
        let (rested, together_rested) = match rested {
            None => (None, None),
            Some((rested, Level::BeforeMoving)) => (Some(rested), together.from_rest()),
            Some((rested, Level::AsLogged)) => (Some(rested), Some(logged.towards(i, o)?)),
        };
        Ok(Seen { rested, freed, together, together_rested, search, looped, one })
    }

    /// The pair measured from where it rested, where that explains it better than its mean: from its level before the inputs moved, or as logged, where that is zero. A
    /// rough model judges, as an input that is still for a while at first may be one that moves seldom, and a controller that rests at zero moves at once.
    fn best_start<'a>(
        &self,
        at_mean: &Experiment<'_>,
        starts: [Option<(Experiment<'a>, Level)>; 2],
        max_delay: usize,
    ) -> Result<Option<(Experiment<'a>, Level)>> {
        let left = |seen: &Experiment<'_>| -> Result<f64> {
            let fitted = rough(&seen.pair(0, 0)?, 2, max_delay, 0);
            Ok(fitted.map_or(f64::INFINITY, |r| r.residual.iter().map(|e| e * e).sum()))
        };
        let mut best = (left(at_mean)?, None);
        for start in starts.into_iter().flatten() {
            self.stop.check()?;
            let less = left(&start.0)?;
            if less < best.0 {
                best = (less, Some(start));
            }
        }
        Ok(best.1)
    }

    /// What the record shows of a loop, as far as the user does not know it.
    fn looped(&self, records: &[Record<'_>], max_delay: usize, bias: usize) -> InLoop {
        let seen = in_loop(records, max_delay, bias);
        match self.feedback {
            Feedback::Open => {
                InLoop { direct: seen.direct || seen.same_sample.is_some(), ..InLoop::default() }
            }
            Feedback::Auto | Feedback::Closed => seen,
        }
    }

    /// Every input of the model by every method that looks at the states.
    fn inputs_by_state(
        &self,
        model: &ModelFile,
        ts: SampleTime,
        search: &Search,
    ) -> Result<Vec<Pair>> {
        let experiment = self.with_states(model, ts)?;
        let mut pairs = Vec::new();
        for ready in self.methods.iter().filter(|r| r.method.scope == Scope::States) {
            self.stop.check()?;
            let clock = Instant::now();
            let answers = experiment
                .as_ref()
                .map_err(Clone::clone)
                .and_then(|e| ready.estimator.estimate_inputs(e, search));
            let time_s = clock.elapsed().as_secs_f64();
            for (i, input) in model.inputs.iter().enumerate() {
                let estimate = match &answers {
                    Ok(estimates) => estimates.get(i).cloned().unwrap_or_else(|| {
                        DelayEstimate::without(Outcome::NotApplicable, "no answer for this input")
                    }),
                    Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.message()),
                };
                let answer = Answer { method: ready.method, estimate, predicted: None, time_s };
                let facts = RecordFacts { early_s: self.early_s(), ..RecordFacts::default() };
                pairs.push(pair(&input.name, "*", &[answer], Vec::new(), ts, &facts));
            }
        }
        Ok(pairs)
    }

    /// Relative degrees of the sampled model by the job's outputs and inputs; 1 where the model lacks the pair.
    fn relative_degrees(&self, model: &ModelFile, ts: SampleTime) -> Result<Vec<Vec<usize>>> {
        let sampled = sampled(model, ts)?;
        let degree = |output: &String, input: &String| {
            let output = model.outputs.iter().position(|c| &c.name == output)?;
            let input = model.inputs.iter().position(|c| &c.name == input)?;
            sampled.relative_degree(output, input)
        };
        Ok(self
            .outputs
            .iter()
            .map(|o| self.inputs.iter().map(|i| degree(o, i).unwrap_or(1)).collect())
            .collect())
    }

    /// All inputs of the model and its states, as logged: A and B are about the channels themselves, so nothing is detrended. Channels that no method could use are an
    /// error inside, as they are the methods' answer.
    fn with_states(
        &self,
        model: &ModelFile,
        ts: SampleTime,
    ) -> Result<std::result::Result<Experiment<'_>, DelayError>> {
        let inputs: Vec<String> = model.inputs.iter().map(|c| c.name.clone()).collect();
        let plant = if model.is_sampled() {
            PlantModel::Sampled(sampled(model, ts)?)
        } else {
            PlantModel::Continuous(model.continuous()?)
        };
        let (ts, mut recordings) = recordings(&self.logs, &inputs, &self.outputs)?;
        for (log, recording) in self.logs.iter().zip(&mut recordings) {
            for (channel, values) in model.inputs.iter().zip(&mut recording.inputs) {
                let operating = match channel.operating {
                    Operating::Value(v) => v,
                    Operating::Mean(_) => DVector::from_column_slice(values).mean(),
                };
                values.to_mut().iter_mut().for_each(|v| *v -= operating);
            }
            // The states, where the log has all of them.
            let columns: std::result::Result<Vec<&[f64]>, _> =
                model.states.iter().map(|s| log.input(&s.name)).collect();
            recording.states = columns.unwrap_or_default().into_iter().map(Into::into).collect();
        }
        Ok(Experiment::new(ts, inputs, self.outputs.clone(), recordings)
            .map(|e| e.with_model(plant)))
    }
}

/// One pair as methods see it.
struct Seen<'a> {
    one: Experiment<'a>,
    /// Without what other inputs do, where they visibly do something and there is no loop.
    freed: Option<Experiment<'a>>,
    /// The same, or the pair, measured from where it rested, where it did.
    rested: Option<Experiment<'a>>,
    /// What a method that takes all inputs together sees: this one first.
    together: Experiment<'a>,
    /// The same from where the pair rested, where all inputs did.
    together_rested: Option<Experiment<'a>>,
    /// The window, with this pair's bias.
    search: Search,
    /// What the record shows of a loop.
    looped: InLoop,
}

/// From where a pair is measured that rests at its start.
enum Level {
    /// From its level before the inputs moved.
    BeforeMoving,
    /// From zero.
    AsLogged,
}

impl<'a> Seen<'a> {
    /// What a method that takes all inputs together sees.
    fn all_inputs(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.together_rested.as_ref().unwrap_or(&self.together),
            Start::Any => &self.together,
        }
    }

    /// The pair without what other inputs do.
    fn alone(&self) -> &Experiment<'a> {
        self.freed.as_ref().unwrap_or(&self.one)
    }

    fn by_start(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.rested.as_ref().unwrap_or_else(|| self.alone()),
            Start::Any => self.alone(),
        }
    }
}

/// A pair with the part of the input that the output did not cause, where there is enough of it.
fn open_experiment<'a>(
    one: &Experiment<'_>,
    max_delay: usize,
    bias: usize,
) -> Result<Option<Experiment<'a>>> {
    let Some(records) = open_part(&one.pair(0, 0)?, max_delay, bias) else { return Ok(None) };
    let recordings = records.into_iter().map(|r| Recording {
        inputs: vec![r.u],
        outputs: vec![Series { values: r.y, present: None }],
        states: Vec::new(),
    });
    Ok(Some(one.with_recordings(recordings.collect())))
}

/// Nothing to believe, and why.
fn none(why: String) -> Verdict {
    Verdict { delay_s: None, ci95_s: None, why, method: None, grounds: Grounds::default() }
}

fn tied_note(input: &str, output: &str) -> String {
    format!(
        "`{input}` is a function of `{output}` and of nothing else: the controller and the plant are one equation here, and no method can tell a dead time from it; {EXPERIMENT}"
    )
}

/// Which inputs were taken off first, each with its share of the output's power.
fn taken_off_note(inputs: &[String], shares: &[(usize, f64)]) -> String {
    let each = shares.iter().map(|(other, share)| {
        format!("`{}` ({:.0} % of the output's power)", inputs[*other], 100.0 * share)
    });
    format!(
        "; what other inputs do was taken off for methods that see one input: {}",
        each.collect::<Vec<_>>().join(", ")
    )
}

fn lead_note(input: &str, output: &str, samples: usize, ts: SampleTime) -> String {
    let by_s = digits(ts.to_seconds(samples as f64), ts);
    format!(
        "`{output}` leads `{input}` by about {by_s} s: exchange them, what moves first is the input; or, if a controller makes `{input}` from `{output}`, {EXPERIMENT}"
    )
}

/// Seconds to a tenth of a sample.
fn digits(seconds: f64, ts: SampleTime) -> String {
    let places = (1.0 - ts.seconds().log10()).ceil().clamp(0.0, 9.0) as usize;
    format!("{seconds:.places$}")
}

/// The verdict on an input that is held for several samples while what it does later shows in the output: it was logged more seldom than it was given, so that the delay may be
/// that much longer. Where that is all of it, no number is given.
fn held_verdict(verdict: Verdict, input: &str, samples: usize, ts: SampleTime) -> Verdict {
    let by_s = ts.to_seconds(samples as f64 - 1.0);
    let held = format!(
        "`{input}` changes every {samples} samples only while the output reacts sooner: it was logged more seldom than it was given, or the output drives it; what was logged too seldom makes a response look up to {} s too early",
        digits(by_s, ts)
    );
    match (verdict.delay_s, verdict.ci95_s) {
        (Some(delay_s), Some([from, to])) if delay_s < by_s => none(format!(
            "{held}, and no more than that is seen: anything from {} to {} s fits; log `{input}` at every sample ({} s), then estimate again ({})",
            digits(from, ts),
            digits(to, ts),
            ts.seconds(),
            verdict.why
        )),
        (Some(_), _) => Verdict {
            why: format!("{}; {held}, and the interval ends that much later", verdict.why),
            ..verdict
        },
        (None, _) => Verdict { why: format!("{}; {held}", verdict.why), ..verdict },
    }
}

/// What is to be expected of each method for one pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// Methods by name; `None` where there is no prediction.
    pub methods: Vec<(&'static str, Option<Richness>)>,
}

fn sampled(model: &ModelFile, ts: SampleTime) -> Result<StateSpace<Sampled>> {
    if model.is_sampled() {
        let sampled = model.sampled()?;
        let grid = |error| DelayError::ModelGrid { model: model.name.clone(), error };
        sampled.sample_time().must_equal(ts).map_err(grid)?;
        return Ok(sampled);
    }
    Ok(ZeroOrderHold {}.c2d(&model.continuous()?, ts)?)
}

/// Samples that hold so many seconds.
fn whole(step: SampleTime, seconds: f64) -> Result<usize> {
    let samples = step.samples(seconds)?;
    Ok(samples.whole + usize::from(samples.fraction > 0.0))
}

/// Everything that an estimation between two sequences of event times needs; [`EventsJob::new`] has every method and the defaults.
pub struct EventsJob {
    /// What the log is called.
    pub name: String,
    /// What the two sequences are called.
    pub channels: [String; 2],
    /// When the events were seen at the first place, and at the second.
    pub events: [EventTimes; 2],
    /// The methods, as [`chosen`] makes them.
    pub methods: Vec<Ready>,
    /// Longest delay to search, s; `None`: as many typical intervals as [`Search`] has samples.
    pub max_delay_s: Option<f64>,
    /// Looked at between methods.
    pub stop: Stop,
}

/// Parts of a typical interval in which the window is counted.
const PARTS: u8 = 100;

impl EventsJob {
    /// Every method that looks at events, between two sequences that are called so, with the defaults of [`Search`].
    pub fn new(name: impl Into<String>, channels: [&str; 2], events: [EventTimes; 2]) -> Self {
        Self {
            name: name.into(),
            channels: channels.map(str::to_owned),
            events,
            methods: Ready::all().into_iter().filter(|r| r.method.scope == Scope::Events).collect(),
            max_delay_s: None,
            stop: Stop::default(),
        }
    }

    /// Estimates the delay by every method.
    ///
    /// # Errors
    /// [`DelayError::OneEvent`], [`DelayError::Intervals`], [`DelayError::NoWindow`], [`deadtime_signal::time::TimeError`]; [`super::error::Error::Stopped`]. What a method cannot do with the
    /// events is its answer.
    pub fn run(&self) -> Result<Report> {
        let Self { name, channels: [a, b], events: [first, second], methods, max_delay_s, stop } =
            self;
        if let Some(none) = [first, second].into_iter().find(|e| e.times.is_empty()) {
            return Err(
                DelayError::Count { what: "events", needed: 2, got: none.times.len() }.into()
            );
        }
        let (counts, units) =
            ([first.times.len(), second.times.len()], [first.unit.clone(), second.unit.clone()]);
        let intervals: Vec<f64> = first.times.windows(2).map(|w| w[1] - w[0]).collect();
        let events =
            vec![Events { first: first.times.clone(), second: second.times.clone(), units }];
        let experiment = Experiment::of_events(SampleTime::new(1.0)?, [a, b], events)?;
        let Some(interval_s) = stats::upper_median(intervals) else {
            return Err(DelayError::OneEvent { log: name.clone(), channel: a.clone() }.into());
        };
        let step = SampleTime::new(interval_s / f64::from(PARTS)).map_err(|error| {
            DelayError::Intervals { log: name.clone(), channel: a.clone(), error }
        })?;
        let max_delay = match max_delay_s {
            None => Search::default().max_delay * usize::from(PARTS),
            Some(seconds) => whole(step, *seconds)?,
        };
        if max_delay == 0 {
            return Err(DelayError::NoWindow.into());
        }
        let experiment = experiment.with_sample_time(step);
        let search = Search { max_delay, stop: stop.clone(), ..Search::default() };
        let mut answers = Vec::new();
        for ready in methods {
            stop.check()?;
            let clock = Instant::now();
            // What a method cannot do with these sequences is its answer; the others go on.
            let estimate = match ready.estimator.estimate(&experiment, &search) {
                Ok(estimate) => estimate,
                Err(DelayError::Stopped) => return Err(DelayError::Stopped.into()),
                Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.message()),
            };
            answers.push(Answer {
                method: ready.method,
                estimate,
                predicted: None,
                time_s: clock.elapsed().as_secs_f64(),
            });
        }
        let max_delay_s = step.to_seconds(max_delay as f64);
        let jitter = Jitter::of(&experiment, &search);
        let pairs = vec![Pair {
            jitter,
            ..pair(a, b, &answers, Vec::new(), step, &RecordFacts::default())
        }];
        let searched = Searched::Events { counts, interval_s };
        Ok(Report {
            format: FORMAT,
            log: name.clone(),
            sample_time_s: step.seconds(),
            max_delay_s,
            pairs,
            searched,
        })
    }
}

/// How much of the work on a pair is done when the record was looked at, and when all methods have answered.
const LOOKED: f64 = 0.15;
const ANSWERED: f64 = 0.75;

/// A method's answer, what was to be expected of it, and its run time, s.
struct Answer {
    method: &'static Method,
    estimate: DelayEstimate,
    predicted: Option<Richness>,
    time_s: f64,
}

fn pair(
    input: &str,
    output: &str,
    answers: &[Answer],
    findings: Vec<Finding>,
    sample_time: SampleTime,
    facts: &RecordFacts,
) -> Pair {
    let by_trust: Vec<_> =
        answers.iter().map(|a| (a.method, &a.estimate, a.predicted.map(|p| p.std_s))).collect();
    let verdict = verdict(&by_trust, &findings, sample_time, facts);
    Pair {
        input: input.to_owned(),
        output: output.to_owned(),
        estimates: answers
            .iter()
            .map(|a| {
                Estimate::new(
                    a.method,
                    &a.estimate,
                    a.predicted.map(|p| p.std_s),
                    a.time_s,
                    &findings,
                )
            })
            .collect(),
        poor_std_s: poor(answers, &findings, verdict.ci95_s),
        standing_off: 0,
        verdict,
        moving: None,
        track: None,
        jitter: None,
        findings,
    }
}

/// Where the data hardly tell neighbouring delays apart, the best that is to be expected of a method that knows neither gain nor poles and whose answer counts (of any such
/// method where none does), s: the number that stands in that method's line. Nothing where the believed interval is far narrower than that: the rough model that predicts was
/// then no model of this plant.
fn poor(answers: &[Answer], findings: &[Finding], believed_s: Option<[f64; 2]>) -> Option<f64> {
    // The predictions are of stable plants in open loop.
    if findings
        .iter()
        .any(|f| matches!(f.condition, Condition::Feedback | Condition::UnstablePlant))
    {
        return None;
    }
    let counts = |a: &Answer| {
        a.estimate.outcome == Outcome::Found
            && !a.estimate.contradicted
            && distrust(a.method, &a.estimate, findings).is_empty()
    };
    let of_poles = |a: &&Answer| matches!(a.method.information, Information::Poles(_));
    let best = |which: &dyn Fn(&Answer) -> bool| {
        let expected =
            answers.iter().filter(of_poles).filter(|a| which(a)).filter_map(|a| a.predicted);
        expected.max_by(|a, b| a.separation.total_cmp(&b.separation))
    };
    let predicted =
        best(&counts).or_else(|| best(&|_| true)).filter(|p| p.separation < TOLD_APART)?;
    let narrower = believed_s.is_some_and(|[from, to]| to - from < NORMAL_95 * predicted.std_s);
    (!narrower).then_some(predicted.std_s)
}

/// Half the distance between two responses, in standard deviations of the noise, from which they are seldom taken for each other.
const TOLD_APART: f64 = 3.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use deadtime_log::Channel;
    use deadtime_signal::Excitation;
    use deadtime_signal::excitation::Rbs;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    fn experiment(samples: usize) -> Experiment<'static> {
        let u = Rbs::default().generate(samples, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        let noise = Rbs::default().generate(samples, &mut ChaCha8Rng::seed_from_u64(2)).unwrap();
        let mut y = vec![0.0; samples];
        for t in 6..samples {
            y[t] = 1.5 * y[t - 1] - 0.56 * y[t - 2] + 0.1 * u[t - 6] + 0.05 * noise[t];
        }
        Experiment::siso(SampleTime::new(0.1).unwrap(), u, y).unwrap()
    }

    fn job(stop: Stop) -> Job {
        let experiment = experiment(400);
        let recording = &experiment.recordings()[0];
        let time_s = (0..400).map(|k| 0.1 * f64::from(k)).collect();
        let channels = vec![
            Channel::new("u", None, recording.inputs[0].to_vec()),
            Channel::new("y", None, recording.outputs[0].values.to_vec()),
        ];
        let logs = vec![Log::new("log", time_s, channels).unwrap()];
        let methods = chosen(&["arxstruc".to_owned()], &BTreeMap::new(), &[Scope::Pair]).unwrap();
        Job { methods, stop, ..Job::new(logs, ["u"], ["y"]) }
    }

    #[test]
    fn a_job_that_is_no_longer_wanted_has_no_report() {
        assert_eq!(job(Stop::default()).run().unwrap().pairs.len(), 1);
        let stop = Stop::default();
        stop.set();
        assert!(matches!(job(stop.clone()).run(), Err(Error::Stopped(_))));
        assert!(matches!(job(stop).expected(), Err(Error::Stopped(_))));
    }

    #[test]
    fn a_method_that_is_stopped_in_the_middle_does_not_answer() {
        let experiment = experiment(60_000);
        for name in
            ["p3d", "p1dz", "ivstruc", "armaxstruc", "oestruc", "oe_posterior", "sampling_zero"]
        {
            let ready =
                chosen(&[name.to_owned()], &BTreeMap::new(), &[Scope::Pair]).unwrap().remove(0);
            for wait in [0, 20, 60] {
                let search = Search::default();
                let wish = search.stop.clone();
                let waiter = std::thread::spawn(move || {
                    std::thread::sleep(std::time::Duration::from_millis(wait));
                    wish.set();
                });
                match ready.estimator.estimate(&experiment, &search) {
                    Err(DelayError::Stopped) => {}
                    // Done before the wish came.
                    Ok(answer) => assert!(wait > 0 && answer.delay_s.is_some(), "{name}"),
                    Err(other) => panic!("{name}: {other}"),
                }
                waiter.join().unwrap();
            }
        }
    }
}

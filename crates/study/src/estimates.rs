//! Every single estimate: how it is made, and the files it is kept in.

use std::path::PathBuf;

use cpu_time::ThreadTime;
use serde::{Deserialize, Serialize};

use super::cell::{Chosen, Resolved, Slot};
use super::error::{Error, Result, StudyError};
use super::keys::{Place, Truth};
use super::plan::{PLAIN, Plan, Scoring, Shown};
use super::results::Cell;
use super::setting::{Record, Setting};
use deadtime_delay::{
    DelayEstimate, Detrend, Experiment, Outcome, Scans, Scope, Search, Start, richness,
};
use deadtime_signal::file::Begun;
use deadtime_signal::stop::Stop;

/// One estimate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// The cell, counted over the whole plan.
    pub(super) cell: usize,
    pub(super) trial: usize,
    pub(super) seed: u64,
    pub(super) true_delay_s: f64,
    pub(super) outcome: Outcome,
    pub(super) raw_s: Option<f64>,
    pub(super) delay_s: Option<f64>,
    pub(super) std_s: Option<f64>,
    pub(super) lo_s: Option<f64>,
    pub(super) hi_s: Option<f64>,
    /// As the plan scores it.
    pub(super) error_samples: Option<f64>,
    pub(super) bound_samples: Option<f64>,
    /// Predicted before estimating, where the plan shows it.
    pub(super) predicted_samples: Option<f64>,
    pub(super) time_s: f64,
}

/// A record; the error of an impossible one names it.
pub(super) fn made(plan: &Plan, setting: &Setting, trial: usize) -> Result<Record> {
    let because = |source: Error| StudyError::Record {
        plan: plan.name.clone(),
        setting: setting.key.to_string(),
        trial,
        seed: setting.seed(plan.seed, trial),
        source: Box::new(source),
    };
    Ok(setting.record(plan.seed, trial).map_err(because)?)
}

/// All estimates from one record; `stop` is checked between the methods.
pub(super) fn of_record(
    plan: &Plan,
    layout: &Resolved,
    number: usize,
    trial: usize,
    stop: &Stop,
) -> Result<Vec<Row>> {
    let setting = &layout.settings[number];
    let grid = &plan.grids[setting.grid];
    let record = made(plan, setting, trial)?;
    let predicts = grid.by.iter().any(|l| l.shown == Shown::Predicted);
    let mut rows = Vec::with_capacity(layout.of(number).len());
    for place in [Place::U, Place::R] {
        let slots: Vec<(usize, Slot)> = layout
            .of(number)
            .map(|c| (c, layout.slots[c]))
            .filter(|(_, s)| s.place == place)
            .collect();
        if slots.is_empty() {
            continue;
        }
        // Unusable records have no answers.
        let views = record
            .experiment(place)
            .filter(|e| e.events().is_empty())
            .and_then(|e| Views::new(e, setting.detrend));
        let search = search(setting, place, &record, stop);
        for (method, chosen) in layout.methods[setting.grid].iter().enumerate() {
            stop.check()?;
            let mine: Vec<Slot> =
                slots.iter().map(|(_, s)| *s).filter(|s| s.method == method).collect();
            let question = Question {
                chosen,
                view: views.as_ref().map(|v| v.of(chosen.method.scope, chosen.method.start)),
                events: record.experiment(place),
                search: &search,
            };
            // The worker's thread does nothing else meanwhile.
            let clock = ThreadTime::now();
            let answers = question.answers(&mine);
            let each_s = clock.elapsed().as_secs_f64() / mine.len().max(1) as f64;
            let cells = slots.iter().filter(|(_, s)| s.method == method);
            rows.extend(cells.zip(answers).map(|(&(cell, slot), estimate)| {
                let predicted = predicts.then(|| question.predicted_s(slot)).flatten();
                let scored = (grid.truth, &grid.scoring);
                let row =
                    row(cell, slot, trial, &record, estimate.as_ref(), each_s, setting, scored);
                Row {
                    predicted_samples: predicted.map(|s| s / setting.sample_time.seconds()),
                    ..row
                }
            }));
        }
    }
    // An estimate that heard of it is no answer.
    stop.check()?;
    Ok(rows)
}

/// The search range of delays of a record.
fn search(setting: &Setting, place: Place, record: &Record, stop: &Stop) -> Search {
    // A controller answers within the sample where the plant does not.
    let delayed = record.degree.iter().flatten().all(|d| *d > 0);
    Search {
        min_delay: usize::from(setting.is_closed() && place == Place::U && delayed),
        max_delay: setting.max_delay,
        bias: record.degree.clone(),
        stop: stop.clone(),
        ..Search::default()
    }
}

/// The task of a method on a record.
struct Question<'a> {
    chosen: &'a Chosen,
    /// `None`: the record cannot be used.
    view: Option<&'a Experiment<'a>>,
    events: Option<&'a Experiment<'static>>,
    search: &'a Search,
}

impl Question<'_> {
    /// The pair of channels of a slot, with its own search.
    fn pair(&self, slot: Slot) -> Option<(Experiment<'_>, Search)> {
        let (view, output) = (self.view?, slot.output.unwrap_or(0));
        let towards = self.search.towards(slot.input, output, view.inputs().len());
        // A method's time is that of its own work.
        let own = Search { scans: Scans::default(), ..towards };
        let seen = if self.chosen.estimator.is_joint() {
            view.towards(slot.input, output)
        } else {
            view.select(slot.input, output)
        };
        Some((seen.ok()?, own))
    }

    /// An answer for each slot.
    fn answers(&self, slots: &[Slot]) -> Vec<Option<DelayEstimate>> {
        let estimator = &self.chosen.estimator;
        match self.chosen.method.scope {
            Scope::States => {
                let all = self.view.and_then(|v| estimator.estimate_inputs(v, self.search).ok());
                let all = all.unwrap_or_default();
                slots.iter().map(|slot| all.get(slot.input).cloned()).collect()
            }
            Scope::Events => {
                let all = self.events.and_then(|e| estimator.estimate(e, self.search).ok());
                vec![all; slots.len()]
            }
            Scope::Pair => {
                let estimate = |slot: &Slot| {
                    let (seen, own) = self.pair(*slot)?;
                    estimator.estimate(&seen, &own).ok()
                };
                slots.iter().map(estimate).collect()
            }
        }
    }

    /// The standard deviation that is predicted before estimating, s.
    fn predicted_s(&self, slot: Slot) -> Option<f64> {
        let method = self.chosen.method;
        if method.scope != Scope::Pair || slot.output.is_none() {
            return None;
        }
        let (seen, own) = self.pair(slot)?;
        Some(richness(&seen, &own, &[method]).ok()?.into_iter().next()??.std_s)
    }
}

/// A record as the methods are given it by the command line.
struct Views<'a> {
    logged: Experiment<'a>,
    level: Experiment<'a>,
    rested: Option<Experiment<'a>>,
}

impl<'a> Views<'a> {
    fn new(logged: &'a Experiment<'_>, detrend: Detrend) -> Option<Self> {
        let level = logged.detrended(detrend).ok()?;
        let rested = (detrend == Detrend::Mean).then(|| level.from_rest()).flatten();
        Some(Self { logged: logged.borrowed(), level, rested })
    }

    fn of(&self, scope: Scope, start: Start) -> &Experiment<'a> {
        match (scope, start) {
            (Scope::States | Scope::Events, _) => &self.logged,
            (Scope::Pair, Start::Rest) => self.rested.as_ref().unwrap_or(&self.level),
            (Scope::Pair, Start::Any) => &self.level,
        }
    }
}

#[allow(clippy::too_many_arguments)]
fn row(
    cell: usize,
    slot: Slot,
    trial: usize,
    record: &Record,
    estimate: Option<&DelayEstimate>,
    time_s: f64,
    setting: &Setting,
    (truth, scoring): (Truth, &Scoring),
) -> Row {
    let ts = setting.sample_time.seconds();
    let true_delay_s = record.delay_s.get(slot.input).copied().unwrap_or(0.0);
    let found = estimate.filter(|e| e.outcome.has_delay());
    let degree =
        slot.output.and_then(|o| record.degree.get(o)?.get(slot.input)).copied().unwrap_or(0)
            as f64;
    let off = found.and_then(|e| match truth {
        // The raw answer less its method's bias is not cut off at 0.
        Truth::Raw => Some(e.raw_delay_s? / ts - e.degree_bias_samples - true_delay_s / ts),
        Truth::Delay => Some((e.delay_s? - true_delay_s) / ts),
    });
    let raw_truth = true_delay_s / ts + degree;
    let error_samples = match scoring.invalid_samples {
        None => off.or(scoring.missing_off_samples),
        Some(invalid) => Some(
            off.filter(|off| off + raw_truth > 0.0 && off + raw_truth < invalid)
                .unwrap_or(invalid - raw_truth),
        ),
    };
    Row {
        cell,
        trial,
        seed: record.seed,
        true_delay_s,
        outcome: estimate.map_or(Outcome::NotApplicable, |e| e.outcome),
        raw_s: found.and_then(|e| e.raw_delay_s),
        delay_s: found.and_then(|e| e.delay_s),
        std_s: found.and_then(|e| e.std_s),
        lo_s: found.and_then(|e| e.ci95_s).map(|i| i[0]),
        hi_s: found.and_then(|e| e.ci95_s).map(|i| i[1]),
        error_samples,
        bound_samples: slot
            .output
            .filter(|_| slot.place == Place::U)
            .and_then(|o| *record.bound_samples.get(o)?),
        predicted_samples: None,
        time_s,
    }
}

/// A value of `estimates.csv` or `estimates.parquet`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Field {
    Text(String),
    Count(u64),
    Number(Option<f64>),
}

impl std::fmt::Display for Field {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Count(count) => count.fmt(f),
            Self::Number(number) => number.map_or(Ok(()), |v| v.fmt(f)),
        }
    }
}

/// The cell's part of a line, with the names of its columns.
pub(super) fn key_fields(number: usize, cell: &Cell) -> Vec<(&'static str, Field)> {
    let text = |text: &str| Field::Text(text.to_owned());
    vec![
        ("cell", Field::Count(number as u64)),
        ("grid", text(&cell.grid)),
        ("plant", text(&cell.plant)),
        ("input", text(&cell.input)),
        ("output", text(&cell.output)),
        ("c2d", text(&cell.c2d)),
        ("excitation", text(&cell.excitation)),
        ("snr", Field::Number(cell.snr)),
        ("noise", text(&cell.noise)),
        ("loop", text(cell.loops.name())),
        ("controller", text(cell.controller.as_deref().unwrap_or_default())),
        ("place", text(cell.place.name())),
        ("injected", text(&cell.delay_s.to_string())),
        ("samples", Field::Count(cell.samples as u64)),
        ("sample_time_s", Field::Number(Some(cell.sample_time_s))),
        ("max_delay", Field::Count(cell.max_delay as u64)),
        ("logging", text(cell.logging.as_deref().unwrap_or(PLAIN))),
        ("truth", text(cell.truth.name())),
        ("method", text(&cell.method)),
        (
            "options",
            text(
                &cell.options.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" "),
            ),
        ),
    ]
}

/// The estimate's part of a line, with the names of its columns.
pub(super) fn value_fields(row: &Row) -> [(&'static str, Field); 13] {
    [
        ("trial", Field::Count(row.trial as u64)),
        ("seed", Field::Count(row.seed)),
        ("true_delay_s", Field::Number(Some(row.true_delay_s))),
        ("outcome", Field::Text(row.outcome.name().to_owned())),
        ("raw_s", Field::Number(row.raw_s)),
        ("delay_s", Field::Number(row.delay_s)),
        ("std_s", Field::Number(row.std_s)),
        ("lo_s", Field::Number(row.lo_s)),
        ("hi_s", Field::Number(row.hi_s)),
        ("error_samples", Field::Number(row.error_samples)),
        ("bound_samples", Field::Number(row.bound_samples)),
        ("predicted_samples", Field::Number(row.predicted_samples)),
        ("time_s", Field::Number(Some(row.time_s))),
    ]
}

/// A file that takes estimates one at a time and holds few of them.
pub(super) trait Sink {
    /// One line: the cell's fields, then the estimate's.
    fn write(
        &mut self,
        key: &[(&'static str, Field)],
        values: &[(&'static str, Field)],
    ) -> Result<()>;
    /// Gives the file its name, once all is written.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// `estimates.csv`.
pub(super) struct CsvSink {
    path: PathBuf,
    file: csv::Writer<Begun>,
    headed: bool,
}

impl CsvSink {
    pub(super) fn new(path: PathBuf) -> Result<Self> {
        let file = Begun::new(&path)?;
        Ok(Self { path, file: csv::Writer::from_writer(file), headed: false })
    }
}

impl Sink for CsvSink {
    fn write(
        &mut self,
        key: &[(&'static str, Field)],
        values: &[(&'static str, Field)],
    ) -> Result<()> {
        let wrong = |e: csv::Error| Error::io(&self.path, e.into());
        if !self.headed {
            self.file.write_record(key.iter().chain(values).map(|f| f.0)).map_err(wrong)?;
            self.headed = true;
        }
        self.file.write_record(key.iter().chain(values).map(|f| f.1.to_string())).map_err(wrong)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let file = self
            .file
            .into_inner()
            .map_err(|e| Error::io(&self.path, std::io::Error::other(e.to_string())))?;
        Ok(file.finish()?)
    }
}

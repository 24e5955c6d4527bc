//! Every single estimate: how it is made, and the files it is kept in.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::StudyError;
use super::cell::{Layout, Slot};
use super::plan::{Place, Plan, Scoring, Truth};
use super::results::Cell;
use super::setting::{Record, Setting};
use crate::delay::{DelayEstimate, Detrend, Experiment, Outcome, PairEstimate, Scope, Search, Start};
use crate::file::write_atomic;

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
    pub(super) time_s: f64,
}

/// All estimates from one record.
pub(super) fn of_record(plan: &Plan, layout: &Layout, number: usize, trial: usize) -> crate::Result<Vec<Row>> {
    let setting = &layout.settings[number];
    let grid = &plan.grids[setting.grid];
    let because =
        |source: crate::Error| StudyError::Record { plan: plan.name.clone(), setting: setting.key.to_string(), source: Box::new(source) };
    let record = setting.record(plan.seed, trial).map_err(because)?;
    let mut rows = Vec::with_capacity(layout.of(number).len());
    for place in [Place::U, Place::R] {
        let slots: Vec<(usize, Slot)> = layout.of(number).map(|c| (c, layout.slots[c])).filter(|(_, s)| s.place == place).collect();
        let Some(experiment) = record.experiment(place).filter(|_| !slots.is_empty()) else { continue };
        let views = Views::new(experiment, setting.detrend);
        for (method, chosen) in layout.methods[setting.grid].iter().enumerate() {
            // A controller answers within the sample where the plant does not.
            let search = Search {
                min_delay: usize::from(setting.is_closed() && place == Place::U && record.degree.iter().flatten().all(|d| *d > 0)),
                max_delay: setting.max_delay,
                bias: record.degree.clone(),
                ..Search::default()
            };
            let clock = Instant::now();
            let answers = chosen.estimator.estimate(views.of(chosen.method.scope, chosen.method.start), &search);
            let time_s = clock.elapsed().as_secs_f64();
            let answers = answers.unwrap_or_default();
            let mine: Vec<&(usize, Slot)> = slots.iter().filter(|(_, s)| s.method == method).collect();
            #[allow(clippy::cast_precision_loss)]
            let each_s = time_s / mine.len().max(1) as f64;
            rows.extend(mine.into_iter().map(|&(cell, slot)| {
                let of_slot = |p: &&PairEstimate| p.input == slot.input && (slot.output.is_none() || p.output == slot.output);
                let estimate = answers.iter().find(of_slot).map(|p| &p.estimate);
                row(cell, slot, trial, &record, estimate, each_s, setting, (grid.truth, &grid.scoring))
            }));
        }
    }
    Ok(rows)
}

/// A record as the methods are given it by the command line.
struct Views<'a> {
    logged: &'a Experiment,
    level: Experiment,
    rested: Option<Experiment>,
}

impl<'a> Views<'a> {
    fn new(logged: &'a Experiment, detrend: Detrend) -> Self {
        let mut level = logged.clone();
        level.take_trend_off(detrend);
        // States and model are for methods that look at nothing else.
        level.recordings.iter_mut().for_each(|r| r.states.clear());
        level.model = None;
        let rested = (detrend == Detrend::Mean).then(|| level.from_rest()).flatten();
        Self { logged, level, rested }
    }

    fn of(&self, scope: Scope, start: Start) -> &Experiment {
        match (scope, start) {
            (Scope::States | Scope::Events, _) => self.logged,
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
    #[allow(clippy::cast_precision_loss)]
    let degree = slot.output.and_then(|o| record.degree.get(o)?.get(slot.input)).copied().unwrap_or(0) as f64;
    let off = found.and_then(|e| match truth {
        // The raw answer less what its method takes off is not cut off at 0.
        Truth::Raw => Some(e.raw_delay_s? / ts - e.degree_bias_samples - true_delay_s / ts),
        Truth::Delay => Some((e.delay_s? - true_delay_s) / ts),
    });
    let raw_truth = true_delay_s / ts + degree;
    let error_samples = match scoring.invalid_samples {
        None => off.or(scoring.missing_off_samples),
        Some(invalid) => Some(off.filter(|off| off + raw_truth > 0.0 && off + raw_truth < invalid).unwrap_or(invalid - raw_truth)),
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
        bound_samples: slot.output.filter(|_| slot.place == Place::U).and_then(|o| *record.bound_samples.get(o)?),
        time_s,
    }
}

/// Writes rows to a file of their own.
pub(super) fn write_part(path: &Path, rows: &[Row]) -> crate::Result<()> {
    write_atomic(path, |out| {
        let mut csv = csv::Writer::from_writer(out);
        for row in rows {
            csv.serialize(row)?;
        }
        csv.flush()
    })
}

/// Reads such a file row by row.
pub(super) fn read_part(path: &Path) -> crate::Result<impl Iterator<Item = crate::Result<Row>> + use<>> {
    let wrong = {
        let path = path.to_owned();
        move |e: csv::Error| StudyError::Results { path: path.clone(), detail: format!("{e}; remove the file and go on with --resume") }
    };
    let reader = csv::Reader::from_path(path).map_err(&wrong)?;
    Ok(reader.into_deserialize().map(move |row| row.map_err(|e| wrong(e).into())))
}

/// Columns of `estimates.csv`: the cell's key, then the estimate.
pub(super) const COLUMNS: [&str; 30] = [
    "grid",
    "plant",
    "input",
    "output",
    "c2d",
    "excitation",
    "snr",
    "noise",
    "loop",
    "controller",
    "place",
    "injected",
    "samples",
    "sample_time_s",
    "max_delay",
    "truth",
    "method",
    "options",
    "trial",
    "seed",
    "true_delay_s",
    "outcome",
    "raw_s",
    "delay_s",
    "std_s",
    "lo_s",
    "hi_s",
    "error_samples",
    "bound_samples",
    "time_s",
];

/// The cell's part of a line.
pub(super) fn key_fields(cell: &Cell) -> Vec<String> {
    vec![
        cell.grid.clone(),
        cell.plant.clone(),
        cell.input.clone(),
        cell.output.clone(),
        cell.c2d.clone(),
        cell.excitation.clone(),
        cell.snr.map(|v| v.to_string()).unwrap_or_default(),
        cell.noise.clone(),
        cell.loops.name().to_owned(),
        cell.controller.clone().unwrap_or_default(),
        cell.place.name().to_owned(),
        cell.delay_s.to_string(),
        cell.samples.to_string(),
        cell.sample_time_s.to_string(),
        cell.max_delay.to_string(),
        cell.truth.name().to_owned(),
        cell.method.clone(),
        cell.options.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" "),
    ]
}

/// The estimate's part of a line.
pub(super) fn value_fields(row: &Row) -> Vec<String> {
    let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
    vec![
        row.trial.to_string(),
        row.seed.to_string(),
        row.true_delay_s.to_string(),
        row.outcome.name().to_owned(),
        number(row.raw_s),
        number(row.delay_s),
        number(row.std_s),
        number(row.lo_s),
        number(row.hi_s),
        number(row.error_samples),
        number(row.bound_samples),
        row.time_s.to_string(),
    ]
}

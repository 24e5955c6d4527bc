//! The gap between a simulator and a log: its size, its place, its cause, and how far it shrinks.

mod black_box;
mod caveats;
mod checks;
mod data;
mod diagnosis;
mod error;
mod experiment;
mod explanation;
mod feedback;
mod floor;
mod intervals;
mod isolability;
mod locate;
mod lost;
mod most;
mod noise;
mod pairs;
mod prediction;
mod problem;
mod progress;
mod pushes;
mod rank;
mod related;
mod scales;
mod screen;
mod search;
mod shrink;
mod subject;
mod traces;
mod trust;
mod verdict;

use std::path::Path;
use std::sync::Arc;

pub use caveats::Caveat;
pub use checks::{ChannelReport, Inspection, InspectionFormat, LogReport, Role, inspect};
pub use diagnosis::{
    Band, Cause, Check, CheckKind, Diagnosis, DiagnosisError, DiagnosisFormat, FoundEffect, Gap, GapOutput, Holdout, Metric, Mode,
    NotTried, Parameter, Prediction, RankedPair, RankedSingle, RankingRow, Regime, Shrink, ShrinkOutput, TimeSpan, Where, WhereOutput,
};
pub use error::GapError;
pub use isolability::{Class, EffectVisibility, Isolability, IsolabilityFormat, Rival, Size, isolability};
pub use most::Most;
pub use progress::Stage;
pub use subject::Subject;
pub use traces::Trace;

use crate::effect::Applied;
use crate::error::Result;
use crate::log::Log;
use crate::model::ModelDocument;
use crate::simulate::{Remembered, System};
use crate::stop::Stop;
use black_box::{Probed, remembering};
use data::{Record, Span};
use problem::{Acting, NOTHING, Problem};
use shrink::{Errors, together};

/// The part of each log that is held back where no log is held out.
const HELD_BACK: f64 = 0.3;
/// Where a delay that explains much stands at the longest that was looked for, so many times longer ones are looked for, once.
const LONGER: f64 = 3.0;

/// How to diagnose.
#[derive(Debug, Clone, PartialEq)]
pub struct GapOptions {
    /// The prediction mode; `None`: chosen from the model's poles.
    pub prediction: Option<Mode>,
    /// The longest delay and lag that are looked for, seconds; `None`: 35 samples or half the time in which the model settles, at most a tenth of the
    /// shortest log. So much of every log's start carries no weight.
    pub longest_delay_s: Option<f64>,
    /// Seed of the bootstrap. Default 1.
    pub seed: u64,
    /// A wish to stop, looked at before every prediction.
    pub stop: Stop,
}

impl Default for GapOptions {
    fn default() -> Self {
        Self { prediction: None, longest_delay_s: None, seed: 1, stop: Stop::default() }
    }
}

/// A diagnosis, and the model with the effects that it found.
#[derive(Debug, Clone)]
pub struct Diagnosed {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The model with what was found added to its effects; `None` for a simulator without a model file.
    pub model: Option<ModelDocument>,
    /// What was found to act.
    pub effects: Vec<Applied>,
    /// What was measured and predicted, by output and then by log.
    pub traces: Vec<Trace>,
    /// What explains most, where nothing is called the cause.
    pub most: Option<Most>,
    /// What a reader has to know of the data.
    pub caveats: Vec<Caveat>,
    /// How often a simulator that can only be called was called; `None` for a model file.
    pub calls: Option<usize>,
}

/// As [`diagnose`], from files.
///
/// # Errors
/// As [`diagnose`], and of files that cannot be read.
pub fn diagnose_files(model: &Path, logs: &[impl AsRef<Path>], holdout: &[impl AsRef<Path>], options: &GapOptions) -> Result<Diagnosed> {
    let document = ModelDocument::read(model)?;
    let read = |paths: &[std::path::PathBuf]| paths.iter().map(|p| crate::log::read(p)).collect::<Result<Vec<_>>>();
    let owned = |paths: &mut dyn Iterator<Item = &Path>| paths.map(Path::to_owned).collect::<Vec<_>>();
    let logs = read(&owned(&mut logs.iter().map(AsRef::as_ref)))?;
    let holdout = read(&owned(&mut holdout.iter().map(AsRef::as_ref)))?;
    diagnose(&document, &logs, &holdout, options, &|_| ())
}

/// Diagnoses the gap between a model and logs: every effect of the catalogue on every channel, alone and in pairs.
///
/// `progress` is told what is being done.
///
/// # Errors
/// [`GapError`] where model and logs do not fit, the errors of models and logs, [`crate::Error::Stopped`].
pub fn diagnose<'a>(
    subject: impl Into<Subject<'a>>,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    let begin = || {
        let subject = subject.into();
        let (system, memory) = remembering(subject.system(logs)?, &options.stop);
        let mut found = search_and_judge(subject, &system, memory.as_ref(), logs, holdout, options, progress)?;
        if let Some(memory) = memory {
            let calls = memory.calls();
            if let (failed, Some(why)) = memory.failures() {
                found.caveats.push(Caveat::SimulatorFailed { failed, calls, why });
            }
            found.calls = Some(calls);
        }
        Ok(found)
    };
    let found = begin();
    options.stop.check()?;
    found
}

fn search_and_judge(
    subject: Subject<'_>,
    system: &System,
    memory: Option<&Arc<Remembered>>,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    progress(Stage::Simulating);
    let setup = Setup::new(subject, system, memory, logs, holdout, options)?;
    let Setup { own, records, prediction, probed, holdouts, longest_delay_s, limit_s } = &setup;
    let (longest_delay_s, limit_s, probed) = (*longest_delay_s, *limit_s, probed.as_ref());
    let outputs = system.outputs.len();

    let motion = scales::Motion::of(system, own, records, prediction, probed)?;
    let prior = motion.prior(system);
    let smallest = motion.smallest.clone();
    let first_noise: Vec<f64> = motion.innovations(records);
    let mut problem = Problem::new(system, records, prediction, own.clone(), prior, &first_noise, &options.stop)?;
    problem.set_resolution(probed.map(|p| p.resolution.clone()).unwrap_or_default());
    let before = shrink::residuals(&problem, NOTHING).ok_or_else(|| nominal_fails(records))?;
    caveats::must_not_explode(system, records, &before)?;
    let scales = motion.scales(system, records, &before, longest_delay_s);

    let (catalogue, left_out) = screen::catalogue(system, probed);
    let found = search::search(&mut problem, catalogue.clone(), &scales, &smallest, progress).ok_or_else(|| nominal_fails(records))?;

    let longer_s = f64::min(LONGER * longest_delay_s, 0.5 * limit_s);
    if options.longest_delay_s.is_none() && longer_s > 1.2 * longest_delay_s && found.wants_longer_delays(&scales) {
        progress(Stage::Longer);
        let longer = GapOptions { longest_delay_s: Some(longer_s), ..options.clone() };
        return search_and_judge(subject, system, memory, logs, holdout, &longer, progress);
    }

    progress(Stage::Judging);
    let before = shrink::residuals(&problem, NOTHING).ok_or_else(|| nominal_fails(records))?;
    let judged = verdict::judge(&problem, &found, &catalogue, &scales).ok_or_else(|| nominal_fails(records))?;
    let hangs = match judged.verdict {
        verdict::Verdict::Unknown => Vec::new(),
        _ => trust::hangs(&mut problem, &found, judged.found.as_ref(), &catalogue, &scales),
    };
    let most = most::most(&problem, &judged, &found, &scales);
    let estimate = judged.found.as_ref().and_then(|e| intervals::estimate(&problem, e, &scales));
    let with_found =
        shrink::residuals(&problem, judged.found.as_ref().map_or(NOTHING, Acting::from)).ok_or_else(|| nominal_fails(records))?;

    let floor = &judged.floor;
    let nothing = Errors::of(records, &before, |r| r.train);
    let (each, each_floor) = (nothing.nrmse(), nothing.relative(&floor.floor));
    let shares = locate::output_shares(&each, &each_floor);
    let gap_output = |i: usize| GapOutput { name: system.outputs[i].name.clone(), before: each[i], floor: each_floor[i], share: shares[i] };
    let mut cause = rank::cause(&problem, &judged, &found, estimate.as_ref(), &scales, &hangs, |e| {
        let residuals = shrink::trained(&problem, e)?;
        together(&Errors::of(records, &residuals, |r| r.train).nrmse())
    });
    cause.not_tried = left_out.into_iter().map(|(effect, why)| NotTried { effect: effect.to_owned(), why }).collect();
    let diagnosis = Diagnosis {
        format: DiagnosisFormat::V1,
        model: subject.name().to_owned(),
        logs: logs.iter().map(|l| l.source().to_owned()).collect(),
        holdout: holdouts.clone(),
        prediction: Prediction { mode: prediction.mode, why: prediction.why.clone() },
        gap: Gap {
            metric: Metric::Nrmse,
            before: together(&each),
            floor: together(&each_floor),
            outputs: (0..outputs).map(gap_output).collect(),
        },
        place: locate::locate(system, records, &before, floor, &shares, &problem.memory()),
        checks: checks::all(
            system,
            own,
            records,
            probed.map_or_else(|| prediction::Prediction::choose(system, records, None), |p| p.prediction()),
        ),
        cause,
        shrink: shrink::shrink(system, records, &before, &with_found, &floor.floor, prediction.settling_s, options.seed),
    };
    let traces = traces::traces(&problem, judged.found.as_ref().map(Acting::from), &floor.floor);
    let effects: Vec<Applied> = judged.found.into_iter().flat_map(|e| e.effects).collect();
    let mut caveats = caveats::caveats(system, records);
    caveats.extend(probed.iter().flat_map(|p| p.caveats.clone()));
    if let Some((output, times)) = judged.left_over.filter(|_| !effects.is_empty()) {
        let times = format!("{times:.1}");
        caveats.push(match system.is_black_box() {
            true => Caveat::Incomplete { times },
            false => Caveat::Rest { times, output: system.outputs[output].name.clone() },
        });
    }
    Ok(Diagnosed { diagnosis, model: subject.with(effects.iter().map(Applied::to_entry)), effects, traces, most, caveats, calls: None })
}

/// What every diagnosis begins with: the simulator, its logs with what is trained on and what is held back, and how outputs are predicted.
struct Setup {
    /// Effects that belong to the simulator.
    own: Vec<Applied>,
    /// Training logs, then those held out.
    records: Vec<Record>,
    prediction: prediction::Prediction,
    /// What was found out about a simulator that can only be called.
    probed: Option<Probed>,
    holdouts: Vec<Holdout>,
    longest_delay_s: f64,
    /// No delay as long as this can be looked for.
    limit_s: f64,
}

impl Setup {
    fn new(
        subject: Subject<'_>,
        system: &System,
        memory: Option<&Arc<Remembered>>,
        logs: &[Log],
        holdout: &[Log],
        options: &GapOptions,
    ) -> Result<Self> {
        if logs.is_empty() {
            return Err(GapError::NoLogs.into());
        }
        if system.is_black_box() && options.prediction == Some(Mode::Predictor) {
            return Err(GapError::NoPredictor.into());
        }
        let own = subject.effects().iter().map(|e| Applied::from_entry(system, e)).collect::<std::result::Result<Vec<_>, _>>()?;
        let mut records = logs.iter().chain(holdout).map(|log| Record::new(log, system)).collect::<Result<Vec<_>>>()?;
        let probed = black_box::probe(system, memory, &records)?;
        let prediction = match &probed {
            Some(probed) => probed.prediction(),
            None => prediction::Prediction::choose(system, &records, options.prediction),
        };
        let longest_delay_s = options.longest_delay_s.unwrap_or_else(|| longest_delay(&records, prediction.settling_s));
        let limit_s = records.iter().map(|r| 0.5 * r.duration_s()).fold(f64::INFINITY, f64::min);
        if !(0.0..limit_s).contains(&longest_delay_s) {
            return Err(GapError::LongestDelay { given_s: longest_delay_s, limit_s }.into());
        }
        let holdouts =
            set_spans(&mut records, logs.len(), !holdout.is_empty(), longest_delay_s, prediction.settling_s, system.is_black_box());
        Ok(Self { own, records, prediction, probed, holdouts, longest_delay_s, limit_s })
    }
}

fn nominal_fails(records: &[Record]) -> crate::Error {
    let log = records.first().map(|r| r.name.clone()).unwrap_or_default();
    GapError::Nominal { log, why: "its predictions are not finite".to_owned() }.into()
}

/// 35 samples or half the time in which the model settles, at most a tenth of the shortest log.
fn longest_delay(records: &[Record], settling_s: f64) -> f64 {
    let samples = records.iter().map(|r| 35.0 * r.sample_time_s).fold(0.5 * settling_s, f64::max);
    records.iter().map(|r| 0.1 * r.duration_s()).fold(samples, f64::min)
}

/// Sets what is trained on and what is held back; the held-out parts by name.
///
/// What a black box does after the last sample is not known, and a clock that is ahead would show it: so much of its end carries no weight either.
fn set_spans(records: &mut [Record], training: usize, held_out: bool, start_s: f64, settling_s: f64, black_box: bool) -> Vec<Holdout> {
    let mut holdouts = Vec::new();
    for (at, record) in records.iter_mut().enumerate() {
        let end = record.duration_s() - if black_box { start_s } else { 0.0 };
        let whole = Span { from_s: start_s, to_s: end };
        if at >= training {
            record.held = Some(whole);
        } else if held_out {
            record.train = Some(whole);
        } else {
            let cut = (1.0 - HELD_BACK) * end;
            record.train = Some(Span { from_s: start_s, to_s: cut });
            record.held = Some(Span { from_s: (cut + settling_s).min(0.5 * (cut + end)), to_s: end });
        }
        if let Some(span) = record.held {
            holdouts.push(Holdout { log: record.name.clone(), from_s: span.from_s, to_s: span.to_s });
        }
    }
    holdouts
}

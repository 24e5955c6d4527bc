//! Consistency of a model and logs before any diagnosis: names, units, time stamps, missing samples, then all checks.

use deadtime_signal::remedy::{Message, Remedied, Remedy, Words};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::evidence::{ALL, result, short};
use super::topics::LogClocks;
use super::{every, operating_point, units};
use crate::baseline::predictor::Predictor;
use crate::error::Result;
use crate::format::caveat::Caveat;
use crate::format::diagnosis::{Check, CheckKind};
use crate::input::black_box::probe;
use crate::input::criteria::Criteria;
use crate::input::inputs::{Simulator, model_effects};
use crate::input::log_caveats::whole_turns;
use crate::input::poles::Poles;
use crate::input::record::{LogRecord, Span};
use crate::input::restart::restart;
use crate::input::subject::Subject;
use deadtime_log::{Channel, Log, LogError};
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::System;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stop::Stop;

/// The format line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum InspectionFormat {
    /// The only format there is.
    #[default]
    #[serde(rename = "deadtime/check@1")]
    V1,
}

/// The result of `deadtime check`, `deadtime/check@1`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inspection {
    /// The format line.
    pub format: InspectionFormat,
    /// The model's name.
    pub model: String,
    /// Every log, as the model sees it.
    pub logs: Vec<LogReport>,
    /// The clocks of the logs' topics, of logs that were read from files.
    #[serde(default)]
    pub clocks: Vec<LogClocks>,
    /// Why the checks could not be run; missing where they were.
    pub not_run: Option<Message>,
    /// The checks of `deadtime/diagnosis@1`.
    pub checks: Vec<Check>,
}

impl Inspection {
    /// The inspection with its findings in the words of a face.
    #[must_use]
    pub fn worded(mut self, words: Words) -> Self {
        let logs = self.logs.iter_mut().flat_map(|log| {
            log.time.iter_mut().chain(log.channels.iter_mut().filter_map(|c| c.finding.as_mut()))
        });
        let checks = self.checks.iter_mut().map(|check| &mut check.finding);
        logs.chain(checks).chain(&mut self.not_run).for_each(|text| text.word(words));
        self
    }
}

/// One log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogReport {
    /// The log.
    pub log: String,
    /// Samples.
    pub samples: usize,
    /// From the first sample to the last, s.
    pub duration_s: f64,
    /// The sample time, s; missing where the time stamps are uneven.
    pub sample_time_s: Option<f64>,
    /// The fault of its time stamps, with the remedy.
    pub time: Option<Message>,
    /// The model's channels in it.
    pub channels: Vec<ChannelReport>,
}

/// A command or a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// A command.
    Input,
    /// A response.
    Output,
}

/// A channel of the model in a log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelReport {
    /// The model's name for it.
    pub channel: String,
    /// Command or response.
    pub role: Role,
    /// The unit that the model gives.
    pub model_unit: Option<String>,
    /// The unit that the log gives.
    pub log_unit: Option<String>,
    /// Whether it can be used.
    pub ok: bool,
    /// Samples that are missing.
    pub missing: usize,
    /// Its fault, with the remedy.
    pub finding: Option<Message>,
}

/// The report on one of the model's channels in a log.
fn channel(log: &Log, name: &str, unit: Option<&str>, role: Role) -> ChannelReport {
    let mut report = ChannelReport {
        channel: name.to_owned(),
        role,
        model_unit: unit.map(str::to_owned),
        log_unit: log.unit(name).map(str::to_owned),
        ok: false,
        missing: 0,
        finding: None,
    };
    match log.channel(name) {
        Ok(found) => report.missing = log.len() - found.samples().present_count(),
        Err(LogError::UnknownChannel { closest, existing, .. }) => {
            let column = closest.clone().unwrap_or_else(|| "COLUMN".to_owned());
            let near = closest.map_or_else(
                || {
                    format!(
                        "the log has {}",
                        existing.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
                    )
                },
                |near| format!("`{near}` is near"),
            );
            let text = format!("`{name}` is not in the log; {near}: use ");
            let of = vec![(name.to_owned(), column)];
            report.finding = Some(Message::from(text).and(Remedy::Columns { of }));
            return report;
        }
        Err(other) => {
            report.finding = Some(other.message());
            return report;
        }
    }
    let usable = match role {
        Role::Input => log.input(name).err(),
        Role::Output => log.output(name).err(),
    };
    report.finding = usable.map(|e| e.message());
    report.ok = report.finding.is_none();
    if log.check_unit(name, unit).is_err() {
        let (logged, modelled) =
            (report.log_unit.clone().unwrap_or_default(), unit.unwrap_or_default());
        let factor = units::between(&logged, modelled)
            .map(|f| format!(" (factor {})", short(f)))
            .unwrap_or_default();
        let text = format!(
            "`{name}` is in {logged} in the log, in {modelled} in the model{factor}: convert the column or correct the header"
        );
        report.finding = Some(match report.finding {
            Some(before) => before.and("; ").and(text),
            None => text.into(),
        });
    }
    report
}

fn report(log: &Log, subject: Subject<'_>) -> LogReport {
    let (inputs, outputs) = (subject.inputs(), subject.outputs());
    let inputs = inputs.iter().map(|c| channel(log, &c.name, c.unit.as_deref(), Role::Input));
    let outputs = outputs.iter().map(|c| channel(log, &c.name, c.unit.as_deref(), Role::Output));
    let grid = log.even_grid();
    LogReport {
        log: log.source().to_owned(),
        samples: log.len(),
        duration_s: log.duration_s(),
        sample_time_s: grid.as_ref().ok().map(|ts| ts.seconds()),
        time: grid.err().map(|e| e.message()),
        channels: inputs.chain(outputs).collect(),
    }
}

/// A log without units, an output that is not there as zeros: what can be checked of the rest is.
fn usable(log: &Log, report: &LogReport) -> std::result::Result<Log, LogError> {
    let column = |c: &ChannelReport| match log.channel(&c.channel) {
        Ok(found) if c.ok => {
            let samples = found.samples();
            match samples.present {
                Some(present) => {
                    Channel::partial(&c.channel, None, samples.values.to_vec(), present.to_vec())
                }
                None => Channel::new(&c.channel, None, samples.values.to_vec()),
            }
        }
        _ => Channel::new(&c.channel, None, vec![0.0; log.len()]),
    };
    // A channel may be command and response.
    let mut columns: Vec<Channel> = Vec::new();
    for c in &report.channels {
        if columns.iter().all(|there| there.name() != c.channel) {
            columns.push(column(c));
        }
    }
    Log::new(log.source(), log.time_s().to_vec(), columns)
}

/// The part of the work that simulating the model is.
const SIMULATED: f64 = 0.2;

/// Inspects a model and logs before any diagnosis: names, units, time stamps and missing samples of every log, and all checks over whole logs.
///
/// # Errors
/// Those of the model, [`crate::error::Error::Stopped`]; what does not fit in a log is part of the answer.
pub fn inspect<'a>(
    subject: impl Into<Subject<'a>>,
    logs: &[Log],
    stop: &Stop,
    far: &HowFar,
) -> Result<Inspection> {
    let found = look(subject.into(), logs, stop, far);
    stop.check()?;
    found
}

fn look(subject: Subject<'_>, logs: &[Log], stop: &Stop, far: &HowFar) -> Result<Inspection> {
    // Missing parts of a log are reported below.
    let completed = subject.completed(logs);
    let logs = completed.as_deref().unwrap_or(logs);
    let reports: Vec<LogReport> = logs.iter().map(|log| report(log, subject)).collect();
    let mut found = Inspection {
        format: InspectionFormat::V1,
        model: subject.name().to_owned(),
        logs: reports,
        clocks: Vec::new(),
        not_run: None,
        checks: Vec::new(),
    };
    let lost = found
        .logs
        .iter()
        .flat_map(|l| l.channels.iter().map(move |c| (l, c)))
        .find(|(_, c)| c.role == Role::Input && !c.ok);
    if let Some((log, c)) = lost {
        found.not_run = Some(
            format!("{}: without the command `{}` nothing can be compared", log.log, c.channel)
                .into(),
        );
    } else {
        match checks(subject, logs, &found.logs, (stop, far)) {
            Ok(checks) => found.checks = checks,
            // A fault of the model itself is an error; a fault of a log is part of the answer.
            Err(e @ (crate::error::Error::Gap(_) | crate::error::Error::Log(_))) => {
                found.not_run = Some(e.message())
            }
            Err(other) => return Err(other),
        }
    }
    for c in found.logs.iter().flat_map(|l| &l.channels) {
        let stated = c.finding.as_ref().filter(|_| c.ok && c.log_unit.is_some());
        let known = found
            .checks
            .iter()
            .any(|k| k.check == CheckKind::Unit && k.channel == c.channel && k.ok == Some(false));
        if let Some(finding) = stated.filter(|_| !known) {
            found.checks.retain(|k| k.check != CheckKind::Unit || k.channel != ALL);
            found.checks.push(result(CheckKind::Unit, &c.channel, Some(false), finding.clone()));
        }
    }
    for turning in whole_turns(subject, logs) {
        if let Caveat::WholeTurns { channel, .. } = &turning {
            found.checks.push(result(CheckKind::Unit, channel, Some(false), turning.to_string()));
        }
    }
    Ok(found)
}

fn checks(
    subject: Subject<'_>,
    logs: &[Log],
    reports: &[LogReport],
    (stop, far): (&Stop, &HowFar),
) -> Result<Vec<Check>> {
    far.at(0.0, &"simulating the model as it is");
    let logs: Vec<Log> = logs
        .iter()
        .zip(reports)
        .map(|(log, report)| usable(log, report))
        .collect::<std::result::Result<_, _>>()?;
    let Simulator { system, memory } = Simulator::of(subject, &logs, stop)?;
    let model_effects = model_effects(subject, &system)?;
    let mut records =
        logs.iter().map(|log| LogRecord::new(log, &system)).collect::<Result<Vec<_>>>()?;
    for (record, report) in records.iter_mut().zip(reports) {
        record.train = Some(Span { from_s: 0.0, to_s: record.duration_s() });
        let outputs = report.channels.iter().filter(|c| c.role == Role::Output);
        for (measured, c) in record.measured.iter_mut().zip(outputs).filter(|(_, c)| !c.ok) {
            measured.present = Some(vec![false; measured.values.len()]);
            debug_assert_eq!(c.role, Role::Output);
        }
    }
    let restarted = restart(&system, &mut records)?;
    let probed = probe(&system, memory.as_ref(), &records, restarted)?;
    let poles = probed.as_ref().map_or_else(|| Poles::of(&system, &records), Poles::probed);
    let predictor =
        Predictor::of(&system, &records, &poles, probed.as_ref(), None, &Criteria::default());
    let free = predictor.gains.is_empty() && subject.nuisances().is_empty();
    let predicted = if free { free_runs(&system, &model_effects, &records) } else { None };
    let mut checks =
        every::checks(&system, &model_effects, &records, predictor, &far.part(SIMULATED, 1.0))
            .checks;
    checks.extend(operating_point::check(&system, &records, predicted.as_deref()));
    Ok(checks)
}

/// The outputs of the nominal model in free run, of each record, samples × outputs; `None` where a record cannot be simulated.
fn free_runs(
    system: &System,
    model_effects: &[Applied],
    records: &[LogRecord],
) -> Option<Vec<DMatrix<f64>>> {
    let plan = Applied::plan(system, model_effects, Chance::Mean).ok()?;
    let run = |record: &LogRecord| {
        let start = if system.restart.is_some() { &record.start } else { &system.initial };
        let run = system.simulate(&plan, record.commands(), start, None).ok()?;
        run.y.iter().all(|v| v.is_finite()).then_some(run.y)
    };
    records.iter().map(run).collect()
}

//! Where a log begins: the model's initial state, conditioned on the first samples of the log.
//!
//! Equation: x = x0 + P·C′·(C·P·C′ + R)⁻¹·(y − ŷ) (Kalman 1960). C = ∂y/∂x0 at the first sample, P is the prior of the initial state, and R the noise of the
//! sensors. Outputs that commands move at once are left out. A state that no other output shows stays as the model has it: a velocity of 0 is at rest.
//!
//! How it can be wrong: the estimate is only the point of linearisation, and the initial state of a law with a memory. Prior and
//! posterior of the initial state do not depend on it where the model is linear. A first sample that is an outlier is outvoted by the two after it.

use nalgebra::{DMatrix, DVector};

use crate::input::record::LogRecord;
use deadtime_model::simulate::{Correction, Dynamics, Measured, Plan, System, Wanted};
use deadtime_signal::stats;

/// Samples whose median is the first measurement.
const FIRST: usize = 3;
/// Steps of the conditioning: two where outputs are linear in the states.
const STEPS: usize = 3;

/// The state at the first sample; that of the record where the log does not determine it. `prior`: standard deviations of the initial state.
pub(super) fn log_start(
    system: &System,
    plan: Plan,
    record: &LogRecord,
    correction: Option<Correction<'_>>,
    prior: &[f64],
    noise_std: &[f64],
) -> Vec<f64> {
    let model = record.start.clone();
    if system.is_black_box() || model.len() != prior.len() || prior.iter().all(|s| *s == 0.0) {
        return model;
    }
    let shown = (0..record.measured.len()).filter(|&i| shows_states(system, record, i));
    let first: Vec<(usize, f64)> =
        shown.filter_map(|i| Some((i, first_measurement(record, i)?))).collect();
    if first.is_empty() {
        return model;
    }
    let plan = Plan { wanted: Wanted { samples: 1, states: false }, ..plan };
    let mut start = model.clone();
    for _ in 0..STEPS {
        // Outputs and their slopes by the states, in units of the prior.
        let run = || {
            let y = system.simulate(&plan, record.commands(), &start, correction).ok()?.y;
            let all = system.sensitivity(&plan, record.commands(), &start, prior, correction);
            let (slopes, samples) = (all.ok()?, record.time_s.len());
            let c = DMatrix::from_fn(first.len(), prior.len(), |i, j| {
                slopes[(first[i].0 * samples, j)] * prior[j]
            });
            Some((y, c))
        };
        let Some((y, c)) = run() else { return model };
        let off = DVector::from_fn(prior.len(), |j, _| {
            if prior[j] > 0.0 { (start[j] - model[j]) / prior[j] } else { 0.0 }
        });
        // The part of the measurement that the model's own state does not explain.
        let left = DVector::from_fn(first.len(), |i, _| first[i].1 - y[(0, first[i].0)]) + &c * off;
        let noise = DVector::from_fn(first.len(), |i, _| {
            noise_std[first[i].0].powi(2).max(f64::MIN_POSITIVE)
        });
        let spread = &c * c.transpose() + DMatrix::from_diagonal(&noise);
        let Some(factor) = spread.cholesky() else { return model };
        let deviation = c.tr_mul(&factor.solve(&left));
        start = (0..prior.len()).map(|j| model[j] + prior[j] * deviation[j]).collect();
        if start.iter().any(|v| !v.is_finite()) {
            return model;
        }
    }
    start
}

/// States alone move an output. A direct response to a command also has the gap of that command, above all a delay.
fn shows_states(system: &System, record: &LogRecord, output: usize) -> bool {
    let direct = match &system.dynamics {
        Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _) => matrices.d.clone(),
        Dynamics::Equations(equations, parameters) => {
            let u = first_commands(record);
            equations.linearise(0.0, &record.start, &u, parameters).d
        }
        Dynamics::BlackBox(..) => return false,
    };
    direct.row(output).iter().all(|v| *v == 0.0)
}

/// The first command of every input.
fn first_commands(record: &LogRecord) -> Vec<f64> {
    record.inputs.iter().map(|u| u.first().copied().unwrap_or(0.0)).collect()
}

/// The median of the first samples of an output, where the log begins with them.
fn first_measurement(record: &LogRecord, output: usize) -> Option<f64> {
    record.measured[output].get(0)?;
    let first = 0..FIRST.min(record.time_s.len());
    stats::median(first.filter_map(|k| record.measured[output].get(k)).collect())
}

/// Per input, the plant's input while it rests at the state `start`. `None` where the log does not begin at rest, or this input alone cannot hold the plant
/// there.
pub(super) fn rests(
    system: &System,
    record: &LogRecord,
    start: &[f64],
    noise_std: &[f64],
) -> Vec<Option<f64>> {
    let inputs = system.inputs.len();
    let first = first_commands(record);
    let Some((moves, by_input)) =
        begins_at_rest(record, noise_std).then(|| slopes(system, start, &first)).flatten()
    else {
        return vec![None; inputs];
    };
    let alone = |i: usize| {
        let by = by_input.column(i);
        let step = -by.dot(&moves) / by.norm_squared();
        let left = (&moves + by * step).norm();
        (step.is_finite() && left <= STILL * moves.norm()).then_some(first[i] + step)
    };
    (0..inputs).map(alone).collect()
}

/// The allowed remainder of the sum that moves the state.
const STILL: f64 = 0.05;
/// Samples before the first change of a command that show whether outputs rest.
const RESTING: usize = 5;
/// Standard deviations of the noise between the means of two halves of such a stretch, per root of their samples.
const MOVED: f64 = 4.0;

/// No output moves before the first change of a command.
fn begins_at_rest(record: &LogRecord, noise_std: &[f64]) -> bool {
    let changes = |u: &Vec<f64>| u.windows(2).position(|w| w[0].to_bits() != w[1].to_bits());
    let until =
        record.inputs.iter().filter_map(changes).min().map_or(record.time_s.len(), |k| k + 1);
    let still = |(measured, std): (&Measured, &f64)| {
        let part = |rows: std::ops::Range<usize>| stats::mean(rows.filter_map(|k| measured.get(k)));
        let (Some(a), Some(b)) = (part(0..until / 2), part(until / 2..until)) else {
            return false;
        };
        (a - b).abs() <= MOVED * std * (4.0 / until as f64).sqrt()
    };
    until >= RESTING && record.measured.iter().zip(noise_std).all(still)
}

/// The derivative of the state, and its slopes by the inputs.
fn slopes(system: &System, x: &[f64], u: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
    match &system.dynamics {
        Dynamics::Linear(matrices) => {
            let about = u.iter().zip(&system.input_operating).map(|(u, point)| u - point);
            let about = DVector::from_iterator(u.len(), about);
            let x = DVector::from_column_slice(x);
            Some((&matrices.a * x + &matrices.b * about, matrices.b.clone()))
        }
        Dynamics::Equations(equations, parameters) => {
            let (mut workspace, mut dx) = (equations.workspace(), vec![0.0; x.len()]);
            equations.derivatives(0.0, x, u, parameters, &mut workspace, &mut dx);
            let by_input = equations.linearise(0.0, x, u, parameters).b;
            Some((DVector::from_vec(dx), by_input))
        }
        Dynamics::Sampled(..) | Dynamics::BlackBox(..) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_log::{Channel, Log};
    use deadtime_model::ModelDocument;

    const SERVO: &str = r#"
format = "deadtime/model@1"
name = "servo"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "angle" }]
[states]
q = { initial = 0.0, initial_std = 0.3 }
w = { initial = 0.0, initial_std = 0.1 }
[derivatives]
q = "w"
w = "60*(u - q) - 5*cos(q) - 8*w"
[output_equations]
angle = "2*q"
"#;

    fn system(text: &str) -> System {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("servo.toml");
        std::fs::write(&path, text).unwrap();
        System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap()
    }

    /// A log whose command steps after 20 samples, and whose output is `angle` of the sample's number.
    fn record(system: &System, angle: impl Fn(u32) -> f64) -> LogRecord {
        let time_s: Vec<f64> = (0..60).map(|k| 0.02 * f64::from(k)).collect();
        let u = (0..60).map(|k| if k < 20 { 0.5 } else { 0.9 }).collect();
        let channels = vec![
            Channel::new("u", None, u),
            Channel::new("angle", None, (0..60).map(angle).collect()),
        ];
        LogRecord::new(&Log::new("a.csv", time_s, channels).unwrap(), system).unwrap()
    }

    fn start(system: &System, record: &LogRecord, prior: &[f64]) -> Vec<f64> {
        log_start(system, Plan::new(system), record, None, prior, &[1e-3])
    }

    #[test]
    fn a_run_begins_where_the_log_does_as_far_as_the_prior_allows() {
        let system = system(SERVO);
        let there = record(&system, |k| if k == 0 { 7.0 } else { 0.9 });
        let found = start(&system, &there, &[0.3, 0.1]);
        assert!((found[0] - 0.45).abs() < 1e-4 && found[1] == 0.0, "{found:?}");
        // An exactly known state stays.
        assert_eq!(start(&system, &there, &[0.0, 0.1]), [0.0, 0.0]);
        // As far as the noise: half way where prior and noise of the state are one.
        let found = start(&system, &there, &[0.5e-3, 0.0]);
        assert!((found[0] - 0.225).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_log_at_rest_shows_what_the_plant_receives() {
        let system = system(SERVO);
        let resting = record(&system, |k| if k < 25 { 0.9 } else { 1.4 });
        let held = rests(&system, &resting, &[0.45, 0.0], &[1e-3]);
        let want = 0.45 + 5.0 * 0.45_f64.cos() / 60.0;
        assert!((held[0].unwrap() - want).abs() < 1e-12, "{held:?} for {want}");
        let moving = record(&system, |k| 0.9 + 0.01 * f64::from(k));
        assert_eq!(rests(&system, &moving, &[0.45, 0.0], &[1e-3]), [None]);
        // A state that moves cannot be held by the command.
        assert_eq!(rests(&system, &resting, &[0.45, 0.3], &[1e-3]), [None]);
    }
}

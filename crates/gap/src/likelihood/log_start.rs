//! Where a log begins: the model's initial state, conditioned on the first samples of the log.
//!
//! Equation: x = x0 + P·C′·(C·P·C′ + R)⁻¹·(y − ŷ), C = ∂y/∂x0 at the first sample, P the prior of the initial state, R the noise of the sensors (Kalman 1960).
//! A state that no output shows stays as the model has it: a velocity of 0 is at rest.
//!
//! How it can be wrong: it is only the point about which responses to the initial state are straight lines, and the state from which a law with a memory begins.
//! Prior and posterior of the initial state do not depend on it where the model is linear. A first sample that is an outlier is outvoted by the two after it.

use nalgebra::{DMatrix, DVector};

use crate::input::record::LogRecord;
use deadtime_model::simulate::{Correction, Dynamics, Measured, Plan, System, Wanted};
use deadtime_signal::stats;

/// Samples whose median is the first measurement.
const FIRST: usize = 3;
/// Steps of the conditioning: two where outputs are linear in the states.
const STEPS: usize = 4;

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
    let usable = !system.is_black_box() && model.len() == prior.len();
    if !usable || prior.iter().all(|s| *s == 0.0) {
        return model;
    }
    let plan = Plan { wanted: Wanted { samples: 1, states: false }, ..plan };
    let condition = || -> Option<Vec<f64>> {
        let first: Vec<(usize, f64)> = (0..record.measured.len())
            .filter_map(|i| Some((i, first_measurement(record, i)?)))
            .collect();
        let mut start = model.clone();
        for _ in 0..STEPS {
            let y = system.simulate(&plan, record.commands(), &start, correction).ok()?.y;
            let slopes =
                system.sensitivity(&plan, record.commands(), &start, prior, correction).ok()?;
            let samples = record.time_s.len();
            let c = DMatrix::from_fn(first.len(), prior.len(), |i, j| {
                slopes[(first[i].0 * samples, j)] * prior[j]
            });
            let off = DVector::from_iterator(
                prior.len(),
                (0..prior.len())
                    .map(|j| if prior[j] > 0.0 { (start[j] - model[j]) / prior[j] } else { 0.0 }),
            );
            // Of the measurement, what the model's own state leaves.
            let left =
                DVector::from_iterator(first.len(), first.iter().map(|&(i, v)| v - y[(0, i)]))
                    + &c * &off;
            let noise = DVector::from_iterator(
                first.len(),
                first.iter().map(|&(i, _)| noise_std[i].powi(2).max(f64::MIN_POSITIVE)),
            );
            let spread = &c * c.transpose() + DMatrix::from_diagonal(&noise);
            let deviation = c.tr_mul(&spread.cholesky()?.solve(&left));
            start = (0..prior.len()).map(|j| model[j] + prior[j] * deviation[j]).collect();
        }
        start.iter().all(|v| v.is_finite()).then_some(start)
    };
    condition().unwrap_or(model)
}

/// The median of the first samples of an output, where the log begins with them.
fn first_measurement(record: &LogRecord, output: usize) -> Option<f64> {
    record.measured[output].get(0)?;
    let first = 0..FIRST.min(record.time_s.len());
    stats::median(first.filter_map(|k| record.measured[output].get(k)).collect())
}

/// Per input, what the plant receives while it rests at the state `start`; `None` where the log does not begin at rest, or this input alone cannot hold it there.
pub(super) fn rests(
    system: &System,
    record: &LogRecord,
    start: &[f64],
    noise_std: &[f64],
) -> Vec<Option<f64>> {
    let inputs = system.inputs.len();
    let first: Vec<f64> = record.inputs.iter().map(|u| u.first().copied().unwrap_or(0.0)).collect();
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

/// Of what moves the state, so much may remain.
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

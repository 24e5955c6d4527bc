//! The share of a residual that depends on the commands: all effects of the catalogue together predict it in blocked cross-validation.
//!
//! Every effect's signature given the best hypothesis is a regressor, computed with the simulator's own dynamics. A ridge regression on all signatures (Hoerl
//! and Kennard 1970, doi:10.1080/00401706.1970.10488634) is no explanation. Its prediction of a block of time outside the fit (Stone 1974,
//! doi:10.1111/j.2517-6161.1974.tb00994.x) is no noise either.
//!
//! An active effect may hide all others. Given an output clipped to a constant, or a friction that sticks, no effect has a signature. The whole residual would
//! then be taken for noise. The signatures on the nominal model are therefore regressors as well, together with its prediction and delayed copies of it.
//!
//! Forces outside the catalogue are expanded to second order (Volterra 1930): the outputs respond to every square and product of two states or commands on the
//! derivative of each state, linearised along the run. The catalogue has the forces of first and third order.
//!
//! A simulator that can only be called lacks the signatures of friction and of all other effects on equations. Perturbations of its inputs are their
//! substitutes. Active effects may have absorbed a part of those effects, so the directions of their parameters are regressors as well.
//!
//! How it can be wrong: a gap with a longer memory than every effect, or a single event, is not predicted. The share is then near 0, and only the low-variance windows can reveal the gap.

use faer::linalg::solvers::Solve;
use faer::{MatRef, Side};
use nalgebra::{DMatrix, DVector};

use super::along_the_run::Run;
use super::forms::Form;
use super::perturbations::{Commanded, perturbations};
use crate::format::diagnosis::Mode;
use crate::hypothesis::direction::with;
use crate::input::record::LogRecord;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::parallel;

/// Signatures of one effect.
const EACH: usize = 2;
/// Rows of the regression per output; longer data are thinned.
const ROWS: usize = 4000;
/// Blocks of time that are left out in turn.
const FOLDS: usize = 8;
/// The step of a parameter of an active effect, as a part of its distance from nominal.
const FURTHER: f64 = 0.1;
/// With more states there are no forces of second order: their number grows with the cube.
const STATES: usize = 8;
/// Ridge parameters that are tried, relative to a signature's mean square.
const RIDGES: [f64; 5] = [1e-6, 1e-4, 1e-3, 1e-2, 1e-1];

/// Per output, the share of the residual's mean square over the training samples that is predicted.
pub(crate) fn shares(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    residuals: &[DMatrix<f64>],
    catalogue: &[Applied],
    scales: &Scales,
) -> Vec<f64> {
    let outputs = residuals.first().map_or(0, DMatrix::ncols);
    let rows = rows(likelihood);
    let Some(base) = stacked(likelihood, active, None, &rows) else { return vec![0.0; outputs] };
    let tried = further_effects(likelihood, active, catalogue, scales);
    let signatures = |given: ActiveEffects<'_>, without: &DMatrix<f64>| -> Vec<DMatrix<f64>> {
        let signature = |applied: &Applied| {
            let effects: Vec<Applied> =
                given.effects.iter().cloned().chain([applied.clone()]).collect();
            finite(stacked(likelihood, given.with(&effects), None, &rows)? - without)
        };
        parallel::filter_map(tried.iter(), signature)
    };
    let mut columns = signatures(active, &base);
    if !likelihood.system.is_black_box() && !active.effects.is_empty() {
        let model = stacked(likelihood, NO_EFFECT, None, &rows).and_then(finite);
        columns.extend(model.iter().flat_map(|model| signatures(NO_EFFECT, model)));
        // A predictor has the measured outputs in it, and with them their noise.
        if likelihood.predictor.mode == Mode::Simulation {
            columns.extend(later(likelihood, &rows, scales).into_iter().filter_map(finite));
        }
        columns.extend(model);
    }
    if likelihood.system.is_black_box() {
        columns.extend(substitutes(likelihood, active, catalogue, &rows, &base));
    }
    // Regressors without information reduce the weight of the others: the larger share counts, with the forces or without.
    let without_forces = columns.len();
    columns.extend(forces(likelihood, active, &rows).into_iter().filter_map(finite));
    parallel::map(0..outputs, |i| {
        let there: Vec<usize> = (0..rows.len())
            .filter(|&r| likelihood.records[rows[r].0].measured[i].get(rows[r].1).is_some())
            .collect();
        let left = there.iter().map(|&r| residuals[rows[r].0][(rows[r].1, i)]);
        let left = DVector::from_iterator(there.len(), left);
        let by = |columns: &[DMatrix<f64>]| {
            let regressors = DMatrix::from_fn(there.len(), columns.len() + 1, |r, c| {
                if c == 0 { 1.0 } else { columns[c - 1][(there[r], i)] }
            });
            predicted(&left, regressors)
        };
        let share = by(&columns[..without_forces]);
        if columns.len() > without_forces { share.max(by(&columns)) } else { share }
    })
}

/// The effects of the catalogue that are not active, each at its first guesses.
fn further_effects(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    catalogue: &[Applied],
    scales: &Scales,
) -> Vec<Applied> {
    let others = catalogue.iter().filter(|a| active.effects.iter().all(|e| e.key() != a.key()));
    others
        .flat_map(|a| {
            let starts = likelihood.first_guesses(a, scales);
            let every = starts.len().div_ceil(EACH).max(1);
            starts.into_iter().step_by(every).map(|start| with(a, &start)).collect::<Vec<_>>()
        })
        .collect()
}

/// The regressors that replace effects on equations of a black box: directions of the active parameters, and perturbations of the inputs.
fn substitutes(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    catalogue: &[Applied],
    rows: &[(usize, usize)],
    base: &DMatrix<f64>,
) -> Vec<DMatrix<f64>> {
    let own = own_directions(active);
    let mut columns: Vec<DMatrix<f64>> = parallel::filter_map(own.iter(), |e| {
        finite(stacked(likelihood, active.with(e), None, rows)? - base)
    });
    let pushed = perturbations(likelihood, active, catalogue);
    columns.extend(parallel::filter_map(&pushed, |u| {
        finite(stacked(likelihood, active, Some(u), rows)? - base)
    }));
    columns
}

/// A regressor; `None` where a value of it is not finite.
fn finite(moved: DMatrix<f64>) -> Option<DMatrix<f64>> {
    moved.iter().all(|v| v.is_finite()).then_some(moved)
}

/// The model's own prediction with delays an octave apart, up to the length of a block. A weighted sum of these copies responds like a machine with its own
/// memory.
fn later(
    likelihood: &Likelihood<'_>,
    rows: &[(usize, usize)],
    scales: &Scales,
) -> Vec<DMatrix<f64>> {
    let Some(model) = trained(likelihood, NO_EFFECT, None) else { return Vec::new() };
    let spans = likelihood.records.iter().filter_map(|r| r.train);
    let block_s = spans.map(|span| span.to_s - span.from_s).fold(0.0, f64::max) / FOLDS as f64;
    let delays = std::iter::successors(Some(scales.sample_time_s), |delay_s| Some(2.0 * delay_s));
    let delays = delays.take_while(|delay_s| *delay_s > 0.0 && *delay_s <= block_s);
    let before = |(at, k): (usize, usize), delay_s: f64| {
        (at, k.saturating_sub((delay_s / likelihood.records[at].sample_time_s).round() as usize))
    };
    delays
        .map(|delay_s| {
            at_rows(&model, &rows.iter().map(|&row| before(row, delay_s)).collect::<Vec<_>>())
        })
        .collect()
}

/// The responses to forces of second order on the derivative of each state, about the run with the active effects; none without differential equations.
fn forces(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    rows: &[(usize, usize)],
) -> Vec<DMatrix<f64>> {
    let system = likelihood.system;
    if system.states.len() > STATES {
        return Vec::new();
    }
    let run = |at: usize| match likelihood.records[at].train {
        Some(_) => Run::of(likelihood, active.effects, at).map(Some),
        None => Some(None),
    };
    let Some(runs) = (0..likelihood.records.len()).map(run).collect::<Option<Vec<_>>>() else {
        return Vec::new();
    };
    let forms = || Form::of_second_order(system.states.len() + system.inputs.len());
    let all: Vec<(usize, Form)> =
        (0..system.states.len()).flat_map(|state| forms().map(move |form| (state, form))).collect();
    let response = |&(state, form): &(usize, Form)| {
        let of_run = |run: &Run| run.response(state, |k| form.of(|v| run.value(v, k)), 1);
        let responses: Vec<Option<DMatrix<f64>>> =
            runs.iter().map(|run| run.as_ref().map(of_run)).collect();
        at_rows(&responses, rows)
    };
    parallel::map(all.iter(), response)
}

/// The active effects, each time with one parameter a small step further from nominal.
fn own_directions(active: ActiveEffects<'_>) -> Vec<Vec<Applied>> {
    let all = active.effects.iter().enumerate().flat_map(|(e, a)| {
        (0..a.values.len()).map(move |i| (e, i, a.parameters[i].nominal, a.values[i]))
    });
    all.filter(|(.., nominal, value)| value.is_finite() && value != nominal)
        .map(|(e, i, nominal, value)| {
            let mut moved = active.effects.to_vec();
            moved[e].values[i] +=
                FURTHER * if nominal.is_finite() { value - nominal } else { value };
            moved
        })
        .collect()
}

/// The rows of the regression: record and sample, evenly thinned, in the order of time.
fn rows(likelihood: &Likelihood<'_>) -> Vec<(usize, usize)> {
    let inside = |(at, record): (usize, &LogRecord)| {
        let span = record.train;
        (0..record.time_s.len())
            .filter(move |&k| span.is_some_and(|s| s.holds(record.time_s[k])))
            .map(move |k| (at, k))
            .collect::<Vec<_>>()
    };
    let all: Vec<(usize, usize)> = likelihood.records.iter().enumerate().flat_map(inside).collect();
    let every = all.len().div_ceil(ROWS).max(1);
    all.into_iter().step_by(every).collect()
}

/// Predictions at the rows, rows × outputs; `commanded` instead of the log's commands.
fn stacked(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    commanded: Option<&Commanded>,
    rows: &[(usize, usize)],
) -> Option<DMatrix<f64>> {
    Some(at_rows(&trained(likelihood, active, commanded)?, rows))
}

/// Predictions of the training records; nothing of the others.
fn trained(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    commanded: Option<&Commanded>,
) -> Option<Vec<Option<DMatrix<f64>>>> {
    let inputs = |at: usize| commanded.map_or(&likelihood.records[at].inputs, |c| &c[at]);
    let one = |at: usize| match likelihood.records[at].train {
        Some(_) => likelihood.predict_trained(at, active, inputs(at)).map(Some),
        None => Some(None),
    };
    (0..likelihood.records.len()).map(one).collect()
}

fn at_rows(predicted: &[Option<DMatrix<f64>>], rows: &[(usize, usize)]) -> DMatrix<f64> {
    let outputs = predicted.iter().flatten().map(DMatrix::ncols).next().unwrap_or(0);
    DMatrix::from_fn(rows.len(), outputs, |r, i| {
        predicted[rows[r].0].as_ref().map_or(0.0, |y| y[(rows[r].1, i)])
    })
}

/// The share of the mean square of `left` that blocks predict of each other, at the best ridge.
fn predicted(left: &DVector<f64>, mut regressors: DMatrix<f64>) -> f64 {
    let (count, width) = regressors.shape();
    let whole = left.norm_squared();
    if count < 4 * FOLDS || whole <= 0.0 {
        return 0.0;
    }
    for mut column in regressors.column_iter_mut() {
        let size = column.norm() / (count as f64).sqrt();
        if size > 0.0 {
            column /= size;
        }
    }
    let missed = if width > count {
        missed_by_rows(left, &regressors)
    } else {
        missed_by_columns(left, &regressors)
    };
    let best = missed.into_iter().flatten().fold(whole, f64::min);
    1.0 - best / whole
}

/// The rows of a block that is left out.
fn fold(f: usize, count: usize) -> (usize, usize) {
    (f * count / FOLDS, (f + 1) * count / FOLDS)
}

/// The solution of a positive definite system; `None` where it is none.
fn solved(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let size = matrix.nrows();
    let matrix = MatRef::from_column_major_slice(matrix.as_slice(), size, size);
    let right = MatRef::from_column_major_slice(right.as_slice(), size, 1);
    let solution = matrix.llt(Side::Lower).ok()?.solve(right);
    Some(DVector::from_fn(size, |i, _| solution[(i, 0)]))
}

/// By ridge, the squared error of the blocks that are left out in turn; `None` where it cannot be computed.
fn missed_by_columns(
    left: &DVector<f64>,
    regressors: &DMatrix<f64>,
) -> [Option<f64>; RIDGES.len()] {
    let (count, width) = regressors.shape();
    let parts: Vec<(DMatrix<f64>, DVector<f64>)> = (0..FOLDS)
        .map(|f| {
            let (from, to) = fold(f, count);
            let x = regressors.rows(from, to - from);
            let turned = x.transpose();
            (&turned * x, turned * left.rows(from, to - from))
        })
        .collect();
    let (gram, right) =
        parts.iter().fold((DMatrix::zeros(width, width), DVector::zeros(width)), |(g, r), p| {
            (g + &p.0, r + &p.1)
        });
    RIDGES.map(|ridge| {
        let mut missed = 0.0;
        for (f, part) in parts.iter().enumerate() {
            let mut others = &gram - &part.0;
            for i in 0..width {
                let weight = ridge * count as f64;
                others[(i, i)] += weight;
            }
            let beta = solved(&others, &(&right - &part.1))?;
            let (from, to) = fold(f, count);
            missed += (left.rows(from, to - from) - regressors.rows(from, to - from) * beta)
                .norm_squared();
        }
        Some(missed)
    })
}

/// The same where there are more regressors than rows, as a wide model has: X(XᵀX + λI)⁻¹Xᵀ = XXᵀ(XXᵀ + λI)⁻¹. Source: Saunders, Gammerman and Vovk 1998,
/// "Ridge regression learning algorithm in dual variables", ICML, eq. 8.
fn missed_by_rows(left: &DVector<f64>, regressors: &DMatrix<f64>) -> [Option<f64>; RIDGES.len()] {
    let count = regressors.nrows();
    let kernel = regressors * regressors.transpose();
    RIDGES.map(|ridge| {
        let mut missed = 0.0;
        for f in 0..FOLDS {
            let (from, to) = fold(f, count);
            let others: Vec<usize> = (0..from).chain(to..count).collect();
            let weight = ridge * count as f64;
            let among = DMatrix::from_fn(others.len(), others.len(), |i, j| {
                kernel[(others[i], others[j])] + if i == j { weight } else { 0.0 }
            });
            let known = DVector::from_iterator(others.len(), others.iter().map(|&i| left[i]));
            let alpha = solved(&among, &known)?;
            for k in from..to {
                let predicted: f64 =
                    others.iter().zip(alpha.iter()).map(|(&i, a)| kernel[(k, i)] * a).sum();
                missed += (left[k] - predicted).powi(2);
            }
        }
        Some(missed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::residuals::residuals;
    use crate::likelihood::servo::{nominal, with_servo};
    use crate::search::catalogue::catalogue;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Given an angle that is clipped to a constant, no effect moves it: the whole response is residual, and none of it is noise.
    #[test]
    fn what_a_clipped_output_hides_is_no_noise() {
        with_servo(&[("actuator_lag", "u", &[0.1])], |likelihood, scales| {
            let clipped =
                [with(&nominal(likelihood.system, "sensor_saturation", "angle"), &[-0.01, 0.01])];
            let left = residuals(likelihood, &clipped).unwrap();
            let candidates = catalogue(likelihood.system, &[], None, scales).candidates;
            let related =
                shares(likelihood, ActiveEffects::from(&clipped), &left, &candidates, scales);
            assert!(related[0] > 0.95, "{related:?}");
        });
    }

    /// Given a friction that sticks, no effect has a signature. A slower and later machine is a weighted sum of delayed predictions of the model.
    #[test]
    fn what_a_friction_that_sticks_hides_is_no_noise() {
        with_servo(
            &[("actuator_lag", "u", &[0.5]), ("output_delay", "*", &[0.3])],
            |likelihood, scales| {
                let stuck = [with(&nominal(likelihood.system, "coulomb_friction", "v"), &[1e4])];
                let left = residuals(likelihood, &stuck).unwrap();
                let related = shares(likelihood, ActiveEffects::from(&stuck), &left, &[], scales);
                assert!(related[0] > 0.95, "{related:?}");
            },
        );
    }

    /// A force of v² on the speed's derivative, integrated here by Euler's steps: no effect of a catalogue, and no noise.
    #[test]
    fn a_force_of_second_order_is_no_noise() {
        with_servo(&[], |likelihood, scales| {
            let mut left = residuals(likelihood, NO_EFFECT).unwrap();
            for (at, left) in left.iter_mut().enumerate() {
                let inputs = &likelihood.records[at].inputs;
                let motion = likelihood.predict_trained(at, NO_EFFECT, inputs).unwrap();
                let (mut angle, mut rate) = (0.0, 0.0);
                for k in 0..left.nrows() {
                    left[(k, 0)] += angle;
                    left[(k, 1)] += rate;
                    let next = (k + 1).min(left.nrows() - 1);
                    for part in 0..50 {
                        let way = f64::from(part) / 50.0;
                        let v = motion[(k, 1)] + way * (motion[(next, 1)] - motion[(k, 1)]);
                        let slope = -9.0 * angle - 2.4 * rate - 0.6 * v * v;
                        angle += 4e-4 * rate;
                        rate += 4e-4 * slope;
                    }
                }
            }
            let related = shares(likelihood, NO_EFFECT, &left, &[], scales);
            assert!(related.iter().all(|share| *share > 0.9), "{related:?}");
        });
    }

    #[test]
    fn rows_and_columns_give_one_regression() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for (count, width) in [(40, 12), (40, 70)] {
            let regressors = DMatrix::from_fn(count, width, |_, _| rng.random_range(-1.0..1.0));
            let left =
                regressors.column(0) + DVector::from_fn(count, |_, _| rng.random_range(-0.3..0.3));
            for (a, b) in missed_by_columns(&left, &regressors)
                .into_iter()
                .zip(missed_by_rows(&left, &regressors))
            {
                let (a, b) = (a.unwrap(), b.unwrap());
                assert!((a - b).abs() < 1e-7 * a, "{count} × {width}: {a} and {b}");
            }
        }
    }
}

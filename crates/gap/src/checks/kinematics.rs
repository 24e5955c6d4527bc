//! Outputs of which one is the derivative of another by the model at any parameters: angle and rate, position and velocity. The two measured channels must then
//! agree without any dynamics: the change of the one over a window is the integral of the other.

use nalgebra::DVector;

use super::moments::{correlation, mean};
use super::view::View;
use deadtime_model::simulate::{Dynamics, Matrices};

/// Points and parameters at which equations are tried.
const POINTS: usize = 12;
/// Relative disagreement that is rounding.
const ROUNDING: f64 = 1e-9;
/// Windows that are tried, half their length in samples: longer ones have less noise, shorter ones more independent stretches.
const HALF_WINDOWS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// A correlation from which on two channels belong together, and below which they do not.
pub(super) const TOGETHER: f64 = 0.85;
pub(super) const APART: f64 = 0.5;

/// d(output `of`)/dt = factor · output `rate`, in the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Relation {
    pub(super) of: usize,
    pub(super) rate: usize,
    pub(super) factor: f64,
}

/// The measured values of a relation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) relation: Relation,
    pub(super) correlation: f64,
    /// Measured change over the integral, 1 where log and model agree; the true value is between these two for any noise of either.
    pub(super) slope: [f64; 2],
    /// Another output that goes with the derivative far better, and its correlation.
    pub(super) better: Option<(usize, f64)>,
}

/// Numbers that differ from point to point and are no simple fractions.
fn spread(at: usize, index: usize) -> f64 {
    let phase = 1.0 + at as f64 * 1.618_033_988_75 + index as f64 * 2.399_963_23;
    phase.sin()
}

/// Derivatives of all outputs and the outputs themselves at one point; no derivative where it depends on the input's.
pub(super) type Point = (Vec<Option<f64>>, Vec<f64>);

fn linear(m: &Matrices, at: usize) -> Point {
    let x = DVector::from_fn(m.a.nrows(), |j, _| spread(at, j));
    let u = DVector::from_fn(m.b.ncols(), |j, _| spread(at, 100 + j));
    let dx = &m.a * &x + &m.b * &u;
    let y = &m.c * &x + &m.d * &u;
    let derivative =
        |i: usize| m.d.row(i).iter().all(|d| *d == 0.0).then(|| m.c.row(i).dot(&dx.transpose()));
    ((0..m.c.nrows()).map(derivative).collect(), y.iter().copied().collect())
}

/// The model's equations at points of all kinds; `None` where it shows no equations.
pub(super) fn points(view: &View<'_>) -> Option<Vec<Point>> {
    let system = view.system;
    match &system.dynamics {
        Dynamics::Sampled(..) | Dynamics::BlackBox(..) => None,
        Dynamics::Linear(m) => Some((0..POINTS).map(|at| linear(m, at)).collect()),
        Dynamics::Equations(equations, nominal) => {
            let point = |at: usize| {
                let states = system.initial.iter().enumerate();
                let x: Vec<f64> =
                    states.map(|(j, x)| x + 0.3 * (1.0 + x.abs()) * spread(at, j)).collect();
                let u: Vec<f64> = (0..system.inputs.len()).map(|j| spread(at, 100 + j)).collect();
                // Other parameters too: what holds for these alone is no kinematics.
                let p: Vec<f64> = nominal
                    .iter()
                    .enumerate()
                    .map(|(j, p)| p * (1.0 + 0.2 * spread(at, 200 + j)))
                    .collect();
                let mut workspace = equations.workspace();
                let mut y = vec![0.0; system.outputs.len()];
                equations.outputs(0.0, &x, &u, &p, &mut workspace, &mut y);
                let mut dx = vec![0.0; x.len()];
                equations.derivatives(0.0, &x, &u, &p, &mut workspace, &mut dx);
                let c = equations.linearise(0.0, &x, &u, &p);
                let derivative = |i: usize| {
                    let direct = c.d.row(i).iter().any(|d| *d != 0.0);
                    (!direct).then(|| c.c.row(i).iter().zip(&dx).map(|(c, dx)| c * dx).sum())
                };
                let finite = y.iter().chain(&dx).all(|v| v.is_finite());
                finite.then(|| ((0..y.len()).map(derivative).collect(), y))
            };
            let all: Vec<_> = (0..POINTS).filter_map(point).collect();
            (all.len() >= POINTS / 2).then_some(all)
        }
    }
}

/// All relations of the model between its outputs.
pub(super) fn relations(view: &View<'_>) -> Vec<Relation> {
    let Some(points) = points(view) else { return Vec::new() };
    let outputs = view.outputs();
    let pairs = (0..outputs).flat_map(|of| (0..outputs).map(move |rate| (of, rate)));
    pairs
        .filter(|(of, rate)| of != rate)
        .filter_map(|(of, rate)| {
            let values: Option<Vec<(f64, f64)>> =
                points.iter().map(|(dy, y)| Some((dy[of]?, y[rate]))).collect();
            let values = values?;
            let power: f64 = values.iter().map(|(_, y)| y * y).sum();
            let factor = values.iter().map(|(dy, y)| dy * y).sum::<f64>() / power;
            let same = |(dy, y): &(f64, f64)| {
                (dy - factor * y).abs() <= ROUNDING * (dy.abs() + (factor * y).abs())
            };
            (power > 0.0 && factor.is_finite() && factor != 0.0 && values.iter().all(same))
                .then_some(Relation { of, rate, factor })
        })
        .collect()
}

/// The model shows equations, so that unrelated outputs are known as such.
pub(super) fn shows_equations(view: &View<'_>) -> bool {
    matches!(view.system.dynamics, Dynamics::Linear(_) | Dynamics::Equations(..))
}

/// Change of one output over windows and the integral of another over the same, where every sample of both is there.
fn windows(view: &View<'_>, of: usize, rate: usize, half: usize) -> Vec<(Vec<f64>, Vec<f64>)> {
    view.records
        .iter()
        .map(|record| {
            let value = |i: usize, k: usize| record.measured_in(record.train, i, k);
            let mut integral = vec![0.0; record.time_s.len()];
            // Samples of a window that are missing are counted, so that such windows can be left out.
            let mut missing = vec![0_usize; record.time_s.len()];
            for k in 1..record.time_s.len() {
                let step_s = record.time_s[k] - record.time_s[k - 1];
                let pair = value(rate, k - 1).zip(value(rate, k));
                integral[k] = integral[k - 1] + pair.map_or(0.0, |(a, b)| 0.5 * step_s * (a + b));
                missing[k] = missing[k - 1] + usize::from(pair.is_none());
            }
            (2 * half..record.time_s.len())
                .filter(|&k| missing[k] == missing[k - 2 * half])
                .filter_map(|k| {
                    Some((
                        value(of, k)? - value(of, k - 2 * half)?,
                        integral[k] - integral[k - 2 * half],
                    ))
                })
                .unzip()
        })
        .collect()
}

/// The correlation and the ratio of sizes over the best window.
fn compare(view: &View<'_>, of: usize, rate: usize) -> Option<(f64, f64)> {
    let of_window = |half: usize| {
        let parts = windows(view, of, rate, half);
        let all: Vec<Vec<usize>> = parts.iter().map(|(d, _)| (0..d.len()).collect()).collect();
        let parts: Vec<_> = all
            .iter()
            .zip(&parts)
            .map(|(k, (d, i))| (k.as_slice(), d.as_slice(), i.as_slice()))
            .collect();
        correlation(&parts, 0)
    };
    let shortest = view.records.iter().map(|r| r.time_s.len()).min().unwrap_or(0);
    HALF_WINDOWS
        .into_iter()
        .filter(|h| 20 * h < shortest)
        .filter_map(of_window)
        .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
}

/// Every relation as measured in the logs; relations with constant channels are left out.
pub(super) fn measure(view: &View<'_>, relations: &[Relation]) -> Vec<Measured> {
    let moves = |i: usize| {
        let values = || {
            view.records.iter().flat_map(move |r| {
                (0..r.time_s.len()).filter_map(move |k| r.measured_in(r.train, i, k))
            })
        };
        let centre = mean(values());
        mean(values().map(|v| (v - centre).powi(2))) > 0.0
    };
    relations
        .iter()
        .copied()
        .filter(|r| moves(r.of) && moves(r.rate))
        .filter_map(|relation| {
            let (correlation, ratio) = compare(view, relation.of, relation.rate)?;
            let slope = correlation.signum() * ratio / relation.factor;
            let others = (0..view.outputs()).filter(|&j| j != relation.rate && j != relation.of);
            let better = others
                .filter_map(|j| Some((j, compare(view, relation.of, j)?.0)))
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            let better = better.filter(|b| correlation.abs() < APART && b.1.abs() > TOGETHER);
            Some(Measured {
                relation,
                correlation,
                slope: [slope * correlation.abs(), slope / correlation.abs()],
                better,
            })
        })
        .collect()
}

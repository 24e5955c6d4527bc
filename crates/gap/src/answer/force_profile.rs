//! The missing force as a piecewise linear curve over the variable that correlates with it.
//!
//! The knots are halfway between quantiles of the variable and an even grid. The values at all knots are fitted jointly to the residual, with a free initial
//! state in every span. Training and held-out spans both take part: the curve is an illustration, and the held-out R² is computed separately. Standard errors
//! sum over blocks of time (Liang and Zeger 1986, doi:10.1093/biomet/73.1.13), because the residual is autocorrelated.
//!
//! How it can be wrong: the linearisation fails. A force of another variable is spread over this one. A step between two knots appears as a slope.

use nalgebra::{DMatrix, DVector};

use super::span_residual::Part;
use crate::judge::along_the_run::Run;
use crate::judge::forms::Form;
use deadtime_signal::stats::NORMAL_95;

/// Knots at most, from this part of the samples to that.
const KNOTS: usize = 7;
const ENDS: [f64; 2] = [0.01, 0.99];
/// Knots that are closer than this part of the range are one.
const APART: f64 = 0.02;
/// Blocks of time of all spans.
const BLOCKS: usize = 20;
/// Points of the curves.
const POINTS: usize = 81;

/// A missing force over a variable.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceProfile {
    /// The state on whose derivative it acts.
    pub state: String,
    /// The argument of the plot: a state, a command, or a product of two, as an expression of the model file.
    pub over: String,
    /// The reported expression, times its gain.
    pub told: String,
    /// Values of the variable.
    pub at: Vec<f64>,
    /// The force as fitted at knots, in units of the derivative.
    pub force: Vec<f64>,
    /// Its 95 % interval, point by point.
    pub ci95: Vec<[f64; 2]>,
    /// The force of the reported expression.
    pub law: Vec<f64>,
}

/// Piecewise straight functions.
struct Knots(Vec<f64>);

impl Knots {
    /// Knots at quantiles of the values, at a minimum distance; `None` where fewer than two knots differ.
    fn of(mut values: Vec<f64>) -> Option<Self> {
        values.retain(|v| v.is_finite());
        values.sort_by(f64::total_cmp);
        let (first, last) = (*values.first()?, *values.last()?);
        let at = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
        let share = |k: usize| k as f64 / (KNOTS - 1) as f64;
        let mut knots: Vec<f64> = Vec::new();
        for k in 0..KNOTS {
            let knot = at(ENDS[0] + (ENDS[1] - ENDS[0]) * share(k));
            if knots.last().is_none_or(|before| knot - before > APART * (last - first)) {
                knots.push(knot);
            }
        }
        // Halfway to an even grid, so that a bend with few samples has knots, too; a variable with discrete values keeps them.
        if knots.len() == KNOTS {
            let [from, to] = [knots[0], knots[KNOTS - 1]];
            knots
                .iter_mut()
                .enumerate()
                .for_each(|(k, knot)| *knot = 0.5 * (*knot + from + (to - from) * share(k)));
        }
        (knots.len() > 1).then_some(Self(knots))
    }

    /// The share of each knot's value at a place; beyond the ends the outer one's.
    fn shares(&self, x: f64) -> DVector<f64> {
        let after = self.0.partition_point(|knot| *knot <= x);
        let mut shares = DVector::zeros(self.0.len());
        match (after.checked_sub(1).map(|b| self.0[b]), self.0.get(after)) {
            (Some(low), Some(high)) => {
                let part = (x - low) / (high - low);
                (shares[after - 1], shares[after]) = (1.0 - part, part);
            }
            (None, _) => shares[0] = 1.0,
            (_, None) => shares[after - 1] = 1.0,
        }
        shares
    }
}

/// The profile of a force on a state's derivative over the argument of a form; `None` where its values are indistinguishable in the data.
pub(super) fn profile(
    (state, form, gain): (usize, Form, f64),
    (runs, parts): (&[Run], &[Part]),
    weights: &[f64],
    every: usize,
    names: impl Fn(usize) -> String + Copy,
) -> Option<ForceProfile> {
    let argument = |run: &Run, k: usize| form.argument(|v| run.value(v, k));
    let knots = Knots::of(
        runs.iter()
            .flat_map(|run| (0..run.samples()).step_by(every).map(|k| argument(run, k)))
            .collect(),
    )?;
    let count = knots.0.len();
    let responses: Vec<Vec<DMatrix<f64>>> = runs
        .iter()
        .map(|run| {
            (0..count)
                .map(|b| run.response(state, |k| knots.shares(argument(run, k))[b], every))
                .collect()
        })
        .collect();
    let columns: Vec<DMatrix<f64>> =
        parts.iter().map(|part| part.without_starts(&responses[part.record], weights)).collect();
    let mut information = DMatrix::zeros(count, count);
    let mut product = DVector::zeros(count);
    for (x, part) in columns.iter().zip(parts) {
        information += x.tr_mul(x);
        product += x.tr_mul(&part.left);
    }
    let inverse = information.cholesky()?.inverse();
    let values = &inverse * product;
    let mut scores = DMatrix::zeros(count, count);
    let per_part = BLOCKS.div_ceil(parts.len().max(1));
    for (x, part) in columns.iter().zip(parts) {
        let error = &part.left - x * &values;
        for block in 0..per_part {
            let (from, to) = (block * x.nrows() / per_part, (block + 1) * x.nrows() / per_part);
            let score = x.rows(from, to - from).tr_mul(&error.rows(from, to - from));
            scores += &score * score.transpose();
        }
    }
    let covariance = &inverse * scores * &inverse;
    let (first, last) = (knots.0[0], knots.0[count - 1]);
    let at: Vec<f64> =
        (0..POINTS).map(|i| first + (last - first) * i as f64 / (POINTS - 1) as f64).collect();
    let shares: Vec<DVector<f64>> = at.iter().map(|x| knots.shares(*x)).collect();
    let force: Vec<f64> = shares.iter().map(|s| s.dot(&values)).collect();
    let half = |s: &DVector<f64>| NORMAL_95 * s.dot(&(&covariance * s)).max(0.0).sqrt();
    let ci95: Vec<[f64; 2]> =
        force.iter().zip(&shares).map(|(f, s)| [f - half(s), f + half(s)]).collect();
    let law: Vec<f64> = at.iter().map(|x| gain * form.law(*x)).collect();
    let finite = force.iter().chain(&law).chain(ci95.iter().flatten()).all(|v| v.is_finite());
    finite.then(|| ForceProfile {
        state: names(state),
        over: form.over(names),
        told: form.text(names),
        at,
        force,
        ci95,
        law,
    })
}

#[cfg(test)]
mod tests {
    use super::Knots;

    #[test]
    fn shares_are_straight_between_knots_and_add_up_to_one() {
        let knots = Knots::of((0..1001).map(|k| f64::from(k) / 1000.0).collect()).unwrap();
        assert_eq!(knots.0.len(), 7);
        for x in [-1.0, 0.0, 0.1, 0.37, 0.5, 0.99, 2.0] {
            let shares = knots.shares(x);
            assert!((shares.sum() - 1.0).abs() < 1e-12);
            // A straight line is its own interpolation.
            let line: f64 = shares.iter().zip(&knots.0).map(|(s, k)| s * k).sum();
            assert!((line - x.clamp(knots.0[0], knots.0[6])).abs() < 1e-12, "{x} {line}");
        }
        // Two levels have two knots, and one has none.
        assert_eq!(Knots::of([[-1.0; 50], [1.0; 50]].concat()).unwrap().0, [-1.0, 1.0]);
        assert!(Knots::of(vec![3.0; 20]).is_none());
        assert!(Knots::of(Vec::new()).is_none());
    }
}

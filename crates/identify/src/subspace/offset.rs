//! The operating point of a model: the equilibrium of inputs and outputs.
//!
//! Every regression has a constant, so that no mean replaces the equilibrium: a slow plant's mean depends on the start of the record. How it can be wrong: a
//! nearly integrating plant has its equilibrium far from the record, or none. The inputs' operating point then moves as well.

use nalgebra::{DMatrix, DVector};

use super::innovations::{InnovationsModel, column_norms};
use super::recordings::Factor;
use super::single::solve;

/// Weight of the equilibrium equation relative to the distance from the means.
const EXACT: f64 = 1e6;

/// The constants `moves` and `reads` of a model's regressions. x(t+1) = A x + B u + K e + moves, and y = C x + D u + e + reads. Signals are scaled deviations
/// from the means.
pub(super) struct Constants {
    pub(super) moves: DVector<f64>,
    pub(super) reads: DVector<f64>,
}

impl Constants {
    /// For regressions over the rows of the factor, with states `map` times the past.
    pub(super) fn of(factor: &Factor, map: &DMatrix<f64>, model: &InnovationsModel) -> Self {
        let layout = factor.layout;
        let of = |from: usize, count: usize| factor.means.rows(from, count).into_owned();
        let x = map * of(0, layout.window());
        let shifted = layout.shifted().into_iter().map(|column| factor.means[column]);
        let next = map * DVector::from_iterator(layout.window(), shifted);
        let (u, y) = (of(layout.window(), layout.m), of(layout.window() + layout.m, layout.l));
        Self {
            moves: next - &model.a * &x - &model.b * &u,
            reads: y - &model.c * &x - &model.d * &u,
        }
    }
}

/// Equilibrium deviations of inputs and outputs from their means, scaled channels.
///
/// Inputs stay at their means. Where an output's equilibrium then exceeds `extent`, its largest recorded deviation, inputs move as well: to the equilibrium
/// nearest to all means.
pub(super) fn at_rest(
    Constants { moves, reads }: &Constants,
    model: &InnovationsModel,
    extent: &[f64],
) -> (DVector<f64>, DVector<f64>) {
    let (n, m, l) = (model.order(), model.b.ncols(), model.c.nrows());
    let still = DMatrix::identity(n, n) - &model.a;
    if let Some(rest) = still.clone().lu().solve(moves) {
        let outputs = &model.c * rest + reads;
        if outputs.iter().zip(extent).all(|(y, extent)| y.abs() <= *extent) {
            return (DVector::zeros(m), outputs);
        }
    }
    let mut equations = DMatrix::zeros(n + l + m, n + m);
    equations.view_mut((0, 0), (n, n)).copy_from(&(still * EXACT));
    equations.view_mut((0, n), (n, m)).copy_from(&(&model.b * -EXACT));
    equations.view_mut((n, 0), (l, n)).copy_from(&model.c);
    equations.view_mut((n, n), (l, m)).copy_from(&model.d);
    equations.view_mut((n + l, n), (m, m)).fill_with_identity();
    let mut targets = DMatrix::zeros(n + l + m, 1);
    targets.view_mut((0, 0), (n, 1)).copy_from(&(moves * EXACT));
    targets.view_mut((n, 0), (l, 1)).copy_from(&(-reads));
    let (point, _) = solve(&equations, &targets, &column_norms(&equations));
    let point = point.column(0);
    let inputs = point.rows(n, m).into_owned();
    let outputs = &model.c * point.rows(0, n) + &model.d * &inputs + reads;
    (inputs, outputs)
}

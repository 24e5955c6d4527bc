//! The operating point of a model: inputs and outputs at which it rests.
//!
//! Every regression has a constant, so that no mean is taken for a rest: a slow plant's mean depends on where the record begins.
//! How it can be wrong: a plant near integration rests far from what was recorded, or nowhere; then the inputs' operating point moves as well.

use nalgebra::{DMatrix, DVector};

use super::innovations::{InnovationsModel, column_norms};
use super::recordings::Factor;
use super::single::solve;

/// Weight of the equation of rest against the distance from the means.
const EXACT: f64 = 1e6;

/// Deviations of inputs and outputs from their means at rest, scaled channels: x = A x + B u + c, y = C x + D u + d.
///
/// Inputs rest at their means. Where an output then rests beyond `extent`, its largest recorded deviation, inputs move as well: the point of rest nearest to all
/// means. `map` times the past is the state.
pub(super) fn at_rest(
    factor: &Factor,
    map: &DMatrix<f64>,
    model: &InnovationsModel,
    extent: &[f64],
) -> (DVector<f64>, DVector<f64>) {
    let (layout, n) = (factor.layout, map.nrows());
    let (m, l) = (layout.m, layout.l);
    let of = |from: usize, count: usize| factor.means.rows(from, count).into_owned();
    let x = map * of(0, layout.window());
    let next = map
        * DVector::from_iterator(
            layout.window(),
            layout.shifted().into_iter().map(|column| factor.means[column]),
        );
    let (u, y) = (of(layout.window(), m), of(layout.window() + m, l));
    let moves = next - &model.a * &x - &model.b * &u;
    let reads = y - &model.c * &x - &model.d * &u;
    let still = DMatrix::identity(n, n) - &model.a;
    if let Some(rest) = still.clone().lu().solve(&moves) {
        let outputs = &model.c * rest + &reads;
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
    targets.view_mut((n, 0), (l, 1)).copy_from(&(-&reads));
    let (point, _) = solve(&equations, &targets, &column_norms(&equations));
    let point = point.column(0);
    let inputs = point.rows(n, m).into_owned();
    let outputs = &model.c * point.rows(0, n) + &model.d * &inputs + reads;
    (inputs, outputs)
}

//! Predicted rise of the misfit where a member of a set is removed: the Wald statistic of its parameters (Wald 1943,
//! doi:10.1090/S0002-9947-1943-0012401-3) from the normal matrix of the fit.
//!
//! The set {inertia, gravity} explains what {stiffness, damping, gravity} explains. It is reached over {inertia, damping, gravity}, which explains no more and
//! is no step on its own.
//!
//! How it can be wrong: a limit is no small change, so no removal is predicted for it. The prediction is linear; the set is fitted before it is ranked.

use nalgebra::{DMatrix, DVector};

use super::set::{CauseSet, Removal};
use deadtime_model::effect::Applied;

/// The ridge of the normal matrix, relative to its diagonal: two members that replace one another leave a direction without information.
const RIDGE: f64 = 1e-9;

/// The removals of a set at its fit. `normal` is over `free`, the residual last.
pub(super) fn removals(
    set: &CauseSet,
    free: &[(usize, usize)],
    normal: &DMatrix<f64>,
) -> Vec<Removal> {
    let places: Vec<usize> = (0..free.len()).filter(|&at| normal[(at, at)] > 0.0).collect();
    let unit: Vec<f64> = places.iter().map(|&at| normal[(at, at)].sqrt()).collect();
    let size = places.len();
    let scaled = DMatrix::from_fn(size, size, |i, j| {
        normal[(places[i], places[j])] / (unit[i] * unit[j]) + if i == j { RIDGE } else { 0.0 }
    });
    let Some(covariance) = scaled.cholesky().map(|c| c.inverse()) else { return Vec::new() };
    let one = |(e, applied): (usize, &Applied)| {
        let own = (0..size).filter(|&at| free[places[at]].0 == e);
        let parameter = |at: usize| &applied.parameters[free[places[at]].1];
        let sizes: Vec<usize> = own.clone().filter(|&at| !parameter(at).role.is_shape()).collect();
        if sizes.is_empty() || sizes.iter().any(|&at| !parameter(at).nominal.is_finite()) {
            return None;
        }
        let away = DVector::from_iterator(
            sizes.len(),
            sizes.iter().map(|&at| {
                let value = applied.values[free[places[at]].1];
                (value - parameter(at).nominal) * unit[at]
            }),
        );
        let among =
            DMatrix::from_fn(sizes.len(), sizes.len(), |i, j| covariance[(sizes[i], sizes[j])]);
        let rise = away.dot(&among.cholesky()?.solve(&away));
        Some(Removal { key: applied.key(), parameters: own.count(), rise })
    };
    let singly = |(_, applied): &(usize, &Applied)| !set.recalibrates(applied);
    set.effects.iter().enumerate().filter(singly).filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::effect::{Parameter, Role, find};
    use proptest::prelude::*;

    fn jump(channel: &str, nominal: f64, value: f64) -> Applied {
        let parameter = Parameter {
            name: "p".into(),
            unit: "1".into(),
            role: Role::Size,
            nominal,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
        };
        Applied {
            effect: find("input_gain").unwrap(),
            channel: channel.to_owned(),
            parameters: vec![parameter],
            values: vec![value],
        }
    }

    proptest! {
        /// In a linear problem the rise is exact: the least squares with the parameter at its nominal value, minus the least squares.
        #[test]
        fn a_linear_rise_is_exact(
            numbers in prop::collection::vec(-1.0..1.0, 24),
            y in prop::collection::vec(-1.0..1.0, 8),
            nominal in -1.0..1.0,
        ) {
            let columns = DMatrix::from_vec(8, 3, numbers);
            let y = DVector::from_vec(y);
            let solve = |columns: &DMatrix<f64>, y: &DVector<f64>| {
                columns.tr_mul(columns).cholesky().map(|c| c.solve(&columns.tr_mul(y)))
            };
            let Some(best) = solve(&columns, &y) else { return Ok(()) };
            let Some(factor) = columns.tr_mul(&columns).cholesky() else { return Ok(()) };
            let conditioned = factor.l().diagonal();
            prop_assume!(conditioned.min() > 0.1 * conditioned.max());
            let left = |x: &DVector<f64>, columns: &DMatrix<f64>, y: &DVector<f64>| {
                (y - columns * x).norm_squared()
            };
            let others = columns.clone().remove_column(0);
            let rest = &y - columns.column(0) * nominal;
            let Some(without) = solve(&others, &rest) else { return Ok(()) };
            let rise = left(&without, &others, &rest) - left(&best, &columns, &y);
            let effects: Vec<Applied> = ["a", "b", "c"]
                .iter()
                .enumerate()
                .map(|(i, name)| jump(name, if i == 0 { nominal } else { 0.0 }, best[i]))
                .collect();
            let set = CauseSet::begun(effects, None, None);
            let free = [(0, 0), (1, 0), (2, 0)];
            let found = removals(&set, &free, &columns.tr_mul(&columns).insert_column(3, 0.0).insert_row(3, 0.0));
            prop_assert!((found[0].rise - rise).abs() < 1e-6 * (1.0 + rise), "{found:?} {rise}");
            prop_assert_eq!(found[0].parameters, 1);
        }
    }

    /// A member that another replaces exactly costs nothing to remove; the other would cost as little.
    #[test]
    fn two_members_that_replace_one_another_can_each_be_removed() {
        let column = DVector::from_vec(vec![1.0, 2.0, -1.0]);
        let columns = DMatrix::from_columns(&[column.clone(), column]);
        let normal = columns.tr_mul(&columns).insert_column(2, 0.0).insert_row(2, 0.0);
        let set = CauseSet::begun(vec![jump("a", 0.0, 3.0), jump("b", 0.0, -1.0)], None, None);
        let found = removals(&set, &[(0, 0), (1, 0)], &normal);
        assert!(found.len() == 2 && found.iter().all(|r| r.rise < 1e-6), "{found:?}");
    }
}

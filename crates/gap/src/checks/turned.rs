//! A sensor whose axes are turned against the model's: two or three outputs of one vector that agree with the model after a rotation.
//!
//! The rotation is the one of least squares (Kabsch 1976, doi:10.1107/S0567739476001873). It must explain at least `OF_ANY` of the part that a general matrix
//! between the outputs explains.
//!
//! How it can be wrong: gains that differ by axis or a cross coupling look like a small rotation. Motion about one axis alone determines no rotation about it.
//! A predicted model contains the measured outputs, so this check is silent there.

use nalgebra::{DMatrix, Matrix3};

use super::evidence::{Evidence, result, short};
use super::faults::Search;
use crate::format::diagnosis::{Check, CheckKind};
use deadtime_signal::decompositions::{svd, symmetric_eigen};

/// A rotation of fewer degrees is within the mounting of most boards.
const LEAST_DEG: f64 = 2.0;
/// The largest part of the squared misfit that may remain after the rotation.
const LEAVES: f64 = 0.5;
/// The part of what any matrix takes that the rotation takes, at least.
const OF_ANY: f64 = 0.9;
/// The second direction in which the model moves, as a part of the first; below it the rotation is not fixed.
const SECOND: f64 = 0.05;
/// Names of the axes of a vector.
const AXES: [[&str; 3]; 3] = [["x", "y", "z"], ["p", "q", "r"], ["roll", "pitch", "yaw"]];

/// The vectors among the outputs that are turned, with axis and angle.
pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let Some(search) = e.search.as_ref().filter(|_| !e.view.predicts()) else { return Vec::new() };
    vectors(e).into_iter().filter_map(|vector| one(e, search, &vector)).collect()
}

/// Places of outputs that are the components of one vector, in the order of the axes. The vector has the first two axes alone, or all three.
fn vectors(e: &Evidence<'_>) -> Vec<Vec<usize>> {
    let outputs = &e.view.system.outputs;
    let mut found: Vec<Vec<usize>> = Vec::new();
    for first in outputs {
        for axes in AXES {
            let Some((before, after)) = first.name.split_once(axes[0]) else { continue };
            let of = |axis: &str| {
                let name = format!("{before}{axis}{after}");
                outputs.iter().position(|o| o.name == name && o.unit == first.unit)
            };
            // Names of one letter are ambiguous where the third is missing.
            let least = if before.is_empty() && after.is_empty() && axes[0] != "x" { 3 } else { 2 };
            let vector: Vec<usize> = axes.iter().map_while(|axis| of(axis)).collect();
            if vector.len() >= least {
                found.push(vector);
            }
        }
    }
    found
}

fn one(e: &Evidence<'_>, search: &Search, vector: &[usize]) -> Option<Check> {
    let [measured, modelled] = [&search.measured, &search.modelled].map(|all| {
        (0..e.view.records.len())
            .flat_map(|at| {
                // Samples that all components have.
                let mut there = e.view.usable(at, *vector.first()?).into_iter();
                let others: Vec<Vec<usize>> =
                    vector.iter().skip(1).map(|&i| e.view.usable(at, i)).collect();
                let rows: Vec<usize> = there
                    .by_ref()
                    .filter(|k| others.iter().all(|o| o.binary_search(k).is_ok()))
                    .collect();
                let column = |&i: &usize| -> Vec<f64> {
                    let values: Vec<f64> =
                        rows.iter().map(|&k| all[at][i].get(k).copied().unwrap_or(0.0)).collect();
                    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
                    values.into_iter().map(|v| v - mean).collect()
                };
                Some(vector.iter().map(column).collect::<Vec<_>>())
            })
            .collect::<Vec<_>>()
    });
    let stacked = |parts: Vec<Vec<Vec<f64>>>| {
        let columns: Vec<f64> =
            (0..vector.len()).flat_map(|i| parts.iter().flat_map(move |p| p[i].clone())).collect();
        DMatrix::from_vec(columns.len() / vector.len(), vector.len(), columns)
    };
    let turn = Turn::of(&stacked(measured), &stacked(modelled))?;
    let names: Vec<String> = vector.iter().map(|&i| format!("`{}`", e.output(i))).collect();
    let about = match vector.len() {
        2 => String::new(),
        _ => format!(" about ({})", turn.axis.map(short).join(", ")),
    };
    let finding = format!(
        "{} are turned by {} degrees{about} against the model: the misfit falls from {} to {} of their size; correct the mounting angle or turn the channels back",
        names.join(", "),
        short(turn.degrees),
        short(turn.before),
        short(turn.after)
    );
    Some(result(CheckKind::Axes, e.output(*vector.first()?), Some(false), finding))
}

/// The rotation from the model's axes to the sensor's.
struct Turn {
    axis: [f64; 3],
    degrees: f64,
    /// Misfit over size, without and with the rotation.
    before: f64,
    after: f64,
}

impl Turn {
    /// From samples × axes; `None` where nothing is turned.
    fn of(measured: &DMatrix<f64>, modelled: &DMatrix<f64>) -> Option<Self> {
        let axes = measured.ncols();
        let product = measured.tr_mul(modelled);
        let decomposed = svd(&product)?;
        let (u, v) = (decomposed.u.as_ref()?, decomposed.v_t.as_ref()?);
        // A proper rotation: the direction of the smallest singular value is the one that may change its sign.
        let mut signs = nalgebra::DVector::from_element(axes, 1.0);
        let smallest = decomposed.singular_values.imin();
        signs[smallest] = (u.determinant() * v.determinant()).signum();
        let rotation = u * DMatrix::from_diagonal(&signs) * v;
        let gram = modelled.tr_mul(modelled);
        let moves = symmetric_eigen(&gram)?.eigenvalues;
        let mut moves: Vec<f64> = moves.iter().map(|v| v.max(0.0).sqrt()).collect();
        moves.sort_by(|a, b| b.total_cmp(a));
        if moves.first()? * SECOND > *moves.get(1)? {
            return None;
        }
        let size = measured.norm();
        let before = (measured - modelled).norm();
        let after = (measured - modelled * rotation.transpose()).norm();
        let any = gram.cholesky()?.solve(&product.transpose());
        let any = (measured - modelled * any).norm();
        let share = (before * before - after * after) / (before * before - any * any);
        let mut whole = Matrix3::identity();
        whole.view_mut((0, 0), (axes, axes)).copy_from(&rotation);
        let cosine = ((whole.trace() - 1.0) / 2.0).clamp(-1.0, 1.0);
        let degrees = cosine.acos().to_degrees();
        let turned = size > 0.0
            && (LEAST_DEG..180.0 - LEAST_DEG).contains(&degrees)
            && after * after <= LEAVES * before * before
            && share >= OF_ANY;
        let skew = [
            whole[(2, 1)] - whole[(1, 2)],
            whole[(0, 2)] - whole[(2, 0)],
            whole[(1, 0)] - whole[(0, 1)],
        ];
        let length = skew.iter().map(|v| v * v).sum::<f64>().sqrt();
        turned.then(|| Self {
            axis: skew.map(|v| v / length),
            degrees,
            before: before / size,
            after: after / size,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// A vector that wanders, and the same with noise.
    fn drawn(seed: u64, axes: usize, rotation: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |size: f64| size * (rng.random::<f64>() - 0.5);
        let mut modelled: DMatrix<f64> = DMatrix::zeros(600, axes);
        for k in 1..600 {
            for i in 0..axes {
                modelled[(k, i)] = 0.9 * modelled[(k - 1, i)] + noise(1.0);
            }
        }
        let mut measured = &modelled * rotation.transpose();
        measured.iter_mut().for_each(|v| *v += noise(0.2));
        [measured, modelled]
    }

    fn about(axis: [f64; 3], degrees: f64) -> DMatrix<f64> {
        let axis = nalgebra::Unit::new_normalize(Vector3::from(axis));
        let turned = Rotation3::from_axis_angle(&axis, degrees.to_radians());
        DMatrix::from_column_slice(3, 3, turned.matrix().as_slice())
    }

    #[test]
    fn a_turned_triad_is_said_with_axis_and_angle() {
        for (seed, (axis, degrees)) in (0..).zip([
            ([0.0, 0.0, 1.0], 23.0),
            ([1.0, 0.0, 0.0], -8.0),
            ([1.0, 1.0, -0.5], 40.0),
            ([0.2, -1.0, 0.4], 120.0),
            ([0.0, 1.0, 0.0], 12.0),
        ]) {
            let [measured, modelled] = drawn(seed, 3, &about(axis, degrees));
            let turn = Turn::of(&measured, &modelled).unwrap();
            assert!((turn.degrees - degrees.abs()).abs() < 0.5, "{} for {degrees}", turn.degrees);
            let size = axis.iter().map(|v| v * v).sum::<f64>().sqrt() * degrees.signum();
            for (found, of) in turn.axis.iter().zip(axis) {
                assert!((found - of / size).abs() < 0.05, "{:?} for {axis:?}", turn.axis);
            }
        }
    }

    #[test]
    fn a_turned_plane_has_an_angle() {
        let rotation = about([0.0, 0.0, 1.0], 15.0).view((0, 0), (2, 2)).into_owned();
        let [measured, modelled] = drawn(3, 2, &rotation);
        let turn = Turn::of(&measured, &modelled).unwrap();
        assert!((turn.degrees - 15.0).abs() < 0.5, "{}", turn.degrees);
    }

    #[test]
    fn gains_couplings_and_straight_boards_are_no_rotation() {
        let straight = DMatrix::identity(3, 3);
        let mut gain = straight.clone();
        gain[(0, 0)] = 1.4;
        let mut coupling = straight.clone();
        coupling[(1, 0)] = 0.3;
        let mirrored = DMatrix::from_diagonal(&nalgebra::dvector![1.0, 1.0, -1.0]);
        for (seed, matrix) in (10..).zip([straight, gain, coupling, mirrored]) {
            let [measured, modelled] = drawn(seed, 3, &matrix);
            assert!(Turn::of(&measured, &modelled).is_none(), "{matrix}");
        }
        // Motion along one axis fixes no rotation.
        let [measured, mut modelled] = drawn(20, 3, &about([0.0, 0.0, 1.0], 30.0));
        modelled.column_mut(1).fill(0.0);
        modelled.column_mut(2).fill(0.0);
        assert!(Turn::of(&measured, &modelled).is_none());
    }
}

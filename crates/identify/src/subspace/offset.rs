//! The operating point of a record: where the outputs would settle at the inputs' means.
//!
//! How it can be wrong: an integrating plant has none (the mean stays), a constant that rounding or noise makes (it counts where a likelihood-ratio test asks for
//! it), and a mean taken for it (a slow plant's mean depends on where the record begins).

use deadtime_signal::decompositions::singular_values;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::innovations::Direct;
use super::pbsidopt::Predictor;
use super::recordings::{Named, Recordings, Scales, Stretch};

/// How often noise may pass for a constant.
const BY_CHANCE: f64 = 1e-3;
/// The settled outputs of a plant this close to integration are no numbers.
const INTEGRATES: f64 = 1e-9;

/// The scales with the outputs' operating point in the place of their means, where the records show that the two differ.
///
/// The long predictor is fitted with a constant beside its past: y = Σ θy·y(t−lag) + Σ θu·u(t−lag) + c + e. Its outputs settle at (I − Σ θy)⁻¹c.
pub(super) fn at_operating_point(
    scales: Scales,
    recordings: &Recordings,
    past: usize,
    direct: Direct,
) -> Scales {
    let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
    let with_one = beside_one(recordings);
    let mut one_scales = scales.clone();
    one_scales.inputs.push((0.0, 1.0));
    let factor = with_one.factor(past, &one_scales);
    let predictor = Predictor::fit(&factor, direct);
    let without = Predictor::fit(&factor.without_input(m), direct);
    let determinant =
        |p: &Predictor| p.noise.diagonal().iter().map(|v| 2.0 * v.abs().ln()).sum::<f64>();
    let gained = factor.rows as f64 * (determinant(&without) - determinant(&predictor));
    let limit = ChiSquared::new(l as f64).map_or(f64::INFINITY, |d| d.inverse_cdf(1.0 - BY_CHANCE));
    if gained.is_nan() || gained <= limit {
        return scales;
    }
    let width = m + 1 + l;
    let mut constant = DVector::zeros(l);
    let mut settled = DMatrix::<f64>::identity(l, l);
    for lag in 0..past {
        constant += predictor.theta.row(lag * width + m).transpose();
        settled -= predictor.theta.rows(lag * width + m + 1, l).transpose();
    }
    if singular_values(&settled).is_none_or(|s| s.min() <= INTEGRATES * s.max()) {
        return scales;
    }
    let Some(point) = settled.lu().solve(&constant) else { return scales };
    let mut scales = scales;
    for (scale, by) in scales.outputs.iter_mut().zip(point.iter()) {
        scale.0 += scale.1 * by;
    }
    scales
}

/// The same records with an input that is 1.
fn beside_one(recordings: &Recordings) -> Recordings {
    let beside =
        |s: &Stretch| Stretch { u: s.u.clone().insert_row(s.u.nrows(), 1.0), y: s.y.clone() };
    let mut inputs = recordings.inputs.clone();
    inputs.push(Named { name: String::new(), unit: None });
    Recordings {
        inputs,
        stretches: recordings.stretches.iter().map(beside).collect(),
        ..recordings.clone()
    }
}

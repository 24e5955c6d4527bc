//! An effect moved a part of the way to other values, and what that changes.

use crate::likelihood::gaussian::Whitened;
use deadtime_model::effect::{Applied, Parameter, Role};

/// Where a signature is taken, as a share of the way from nominal to a start.
pub(crate) const NEAR: f64 = 0.02;

/// The same effect with other values.
pub(crate) fn with(applied: &Applied, values: &[f64]) -> Applied {
    Applied { values: values.to_vec(), ..applied.clone() }
}

/// `a − b`, times `scale`.
pub(crate) fn difference(a: &Whitened, b: &Whitened, scale: f64) -> Whitened {
    a.iter().zip(b).map(|(a, b)| (a - b) * scale).collect()
}

/// Values moved a share of the way from nominal to a start; infinite limits stay.
pub(crate) fn between(applied: &Applied, start: &[f64], share: f64) -> Vec<f64> {
    let move_one = |(value, p): (&f64, &Parameter)| {
        let moved = p.nominal + share * (value - p.nominal);
        if p.nominal.is_infinite() || !moved.is_finite() {
            *value
        } else {
            moved.clamp(p.lower, p.upper)
        }
    };
    keep_shape(applied, start, start.iter().zip(&applied.parameters).map(move_one).collect())
}

/// Shape parameters keep the value of the first guess when a signature is scaled.
fn keep_shape(applied: &Applied, start: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    for ((value, start), p) in values.iter_mut().zip(start).zip(&applied.parameters) {
        if p.role.is_shape() {
            *value = *start;
        }
    }
    values
}

/// Some parameter is a limit, infinite when nominal.
pub(crate) fn has_limit(applied: &Applied) -> bool {
    applied.parameters.iter().any(|p| p.role == Role::Limit)
}

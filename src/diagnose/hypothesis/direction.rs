//! An effect moved a part of the way to other values, and what that changes.

use crate::diagnose::likelihood::gaussian::Whitened;
use crate::effect::{Applied, Parameter, Role};

/// Where a signature is taken, as a share of the way from nominal to a start.
pub(in crate::diagnose) const NEAR: f64 = 0.02;

/// The same effect with other values.
pub(in crate::diagnose) fn with(applied: &Applied, values: &[f64]) -> Applied {
    Applied { values: values.to_vec(), ..applied.clone() }
}

/// `a − b`, times `scale`.
pub(in crate::diagnose) fn difference(a: &Whitened, b: &Whitened, scale: f64) -> Whitened {
    a.iter().zip(b).map(|(a, b)| (a - b) * scale).collect()
}

/// Values moved a share of the way from nominal to a start; infinite limits stay.
pub(in crate::diagnose) fn between(applied: &Applied, start: &[f64], share: f64) -> Vec<f64> {
    let move_one = |(value, p): (&f64, &Parameter)| {
        let moved = p.nominal + share * (value - p.nominal);
        if p.nominal.is_infinite() || !moved.is_finite() { *value } else { moved.clamp(p.lower, p.upper) }
    };
    keep_shape(applied, start, start.iter().zip(&applied.parameters).map(move_one).collect())
}

/// What says what an effect is like keeps the start's value when a signature is scaled.
fn keep_shape(applied: &Applied, start: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    for ((value, start), p) in values.iter_mut().zip(start).zip(&applied.parameters) {
        if p.role.is_shape() {
            *value = *start;
        }
    }
    values
}

/// Some parameter is a limit, infinite when nominal.
pub(in crate::diagnose) fn has_limit(applied: &Applied) -> bool {
    applied.parameters.iter().any(|p| p.role == Role::Limit)
}

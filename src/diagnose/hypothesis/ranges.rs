//! How far a parameter is searched, and in which steps.

use crate::effect::{Applied, Scales, Site};

/// The bounds of a parameter in a search: its own, and what these logs can show at all.
pub(in crate::diagnose) fn range(applied: &Applied, at: usize, scales: &Scales) -> (f64, f64) {
    let p = &applied.parameters[at];
    let (lower, upper) = match (p.name, p.unit.as_str()) {
        // From a fifth of a period in the whole log to near the Nyquist frequency.
        ("frequency", _) => (0.2 / scales.duration_s, 0.45 / scales.sample_time_s),
        ("damping", _) => (1e-3, 2.0),
        ("delay", _) => (0.0, scales.longest_delay_s),
        ("time_constant", _) => (0.0, 0.25 * scales.duration_s),
        ("offset", "s") if applied.effect.site() == Site::Clock => (-scales.longest_delay_s, scales.longest_delay_s),
        _ => (p.lower, p.upper),
    };
    (lower.max(p.lower), upper.min(p.upper))
}

/// The step for a numerical derivative.
pub(in crate::diagnose) fn step(applied: &Applied, at: usize, scales: &Scales) -> f64 {
    let (p, value) = (&applied.parameters[at], applied.values[at]);
    let size = if p.nominal.is_finite() { (value - p.nominal).abs() } else { value.abs() };
    let least = match p.unit.as_str() {
        "s" => 0.01 * scales.sample_time_s,
        _ => 1e-6 * value.abs(),
    };
    let step = (1e-4 * size).max(1e-4 * least).max(1e-12);
    if value + step > p.upper { -step } else { step }
}

/// A first step for a black box's numerical derivative.
pub(in crate::diagnose) fn called_step(applied: &Applied, at: usize, scales: &Scales) -> f64 {
    let (p, value) = (&applied.parameters[at], applied.values[at]);
    let size = if p.nominal.is_finite() { (value - p.nominal).abs() } else { value.abs() };
    let least = if p.unit == "s" { 0.02 * scales.sample_time_s } else { 1e-3 * value.abs() };
    let step = (1e-2 * size).max(least);
    if step > 0.0 { step } else { 1e-9 }
}

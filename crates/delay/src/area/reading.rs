//! Areas of a step response, and the estimate from two readings of it.

use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairRecords};
use deadtime_signal::stats::NORMAL_95;
use nalgebra::DMatrix;
use std::f64::consts::E;

/// The number of equal lags of the plant model that reads a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lags {
    One,
    Two,
}

impl Lags {
    /// (T_ar − L)·K/A₁.
    pub(super) fn of_area(self) -> f64 {
        match self {
            Self::One => E,
            Self::Two => 0.5 * E * E,
        }
    }
}

/// A delay, samples, and its standard deviation from noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) delay: f64,
    pub(super) std: f64,
}

/// Error of the linear interpolation, samples: a response that ends within one sample is read up to 0.2 samples late or early.
pub(super) const BETWEEN: f64 = 0.2;

/// The estimate from both readings; the reading with `lags` is the published one.
pub(super) fn answer(
    lags: Lags,
    [one, two]: [Reading; 2],
    pair: &PairRecords,
) -> Result<DelayEstimate, NoDelay> {
    let chosen = if lags == Lags::One { one } else { two };
    let [from, to] = if one.delay < two.delay { [one, two] } else { [two, one] };
    let interval =
        [from.delay - NORMAL_95 * from.std - BETWEEN, to.delay + NORMAL_95 * to.std + BETWEEN];
    // The true structure is taken as uniform between the two readings.
    let std = chosen.std.hypot((to.delay - from.delay + 2.0 * BETWEEN) / 12.0_f64.sqrt());
    pair.narrows(std)?;
    let off = pair.bias as f64 - 1.0;
    let at_edge = chosen.delay - off > pair.max_delay as f64 - 0.5;
    Ok(pair.measured(chosen.delay, std, interval, at_edge, off))
}

/// Standard deviation of Σ gᵢxᵢ.
pub(super) fn propagated(gradient: &[f64], covariance: &DMatrix<f64>) -> f64 {
    let along =
        |i: usize| gradient.iter().enumerate().map(|(j, g)| covariance[(i, j)] * g).sum::<f64>();
    gradient.iter().enumerate().map(|(i, g)| g * along(i)).sum::<f64>().max(0.0).sqrt()
}

/// The area under a step response up to its average residence time.
pub(super) struct Area {
    /// A₁/K, samples.
    pub(super) a1: f64,
    /// s(T_ar)/K.
    pub(super) height: f64,
    /// A₁ = Σ wᵢsᵢ.
    pub(super) weights: Vec<f64>,
}

/// Area of a step response s at t = 0, 1, … samples with final value `gain`, linear between samples. `None` where T_ar lies outside the response.
pub(super) fn area(step: &[f64], gain: f64, t_ar: f64) -> Option<Area> {
    let (whole, part) = if t_ar >= 0.0 && t_ar < step.len() as f64 {
        (t_ar as usize, t_ar.fract())
    } else {
        return None;
    };
    let mut weights = vec![0.0; step.len()];
    let (head, last) = (weights.get_mut(..=whole)?, step.get(whole)?);
    head.fill(1.0);
    if let Some(first) = head.first_mut() {
        *first -= 0.5;
    }
    if let Some(end) = head.last_mut() {
        *end += part * (1.0 - 0.5 * part) - 0.5;
    }
    let next = step.get(whole + 1).unwrap_or(last);
    if let Some(beyond) = weights.get_mut(whole + 1) {
        *beyond = 0.5 * part * part;
    }
    let a1 = weights.iter().zip(step).map(|(w, s)| w * s).sum::<f64>() / gain;
    Some(Area { a1, height: (last + part * (next - last)) / gain, weights })
}

/// Coefficients beyond the longest delay, for the response itself.
pub(super) const BEYOND: usize = 36;

/// A gain at frequency 0 is significant from this many standard deviations on.
pub(super) const SIGNIFICANT: f64 = 3.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_that_of_the_straight_lines() {
        let step = [0.0, 1.0, 2.0, 2.0];
        // 0.5 + 1.5 to t = 2, and half a sample at height 2.
        let at = area(&step, 2.0, 2.5).unwrap();
        assert!((at.a1 - 1.5).abs() < 1e-15 && (at.height - 1.0).abs() < 1e-15);
        let at = area(&step, 1.0, 0.5).unwrap();
        assert!((at.a1 - 0.125).abs() < 1e-15 && (at.height - 0.5).abs() < 1e-15);
        assert!(
            area(&step, 1.0, -0.1).is_none()
                && area(&step, 1.0, 4.0).is_none()
                && area(&step, 1.0, f64::NAN).is_none()
        );
    }
}

//! Areas of a measured step response.

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::experiment::Experiment;
use crate::posterior;
use deadtime_identify::{Fir, Record, fir_or_rank};
use deadtime_signal::stats::NORMAL_95;
use nalgebra::DMatrix;
use std::f64::consts::E;

/// A plant of how many equal lags a response is read as.
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

/// What the straight lines between samples cost, samples: a response that ends within one is read up to a fifth of a sample late or early.
pub(super) const BETWEEN: f64 = 0.2;

/// The answer from both readings, that of `lags` being the published one.
pub(super) fn answer(
    lags: Lags,
    [one, two]: [Reading; 2],
    bias: usize,
    max_delay: usize,
    experiment: &Experiment,
) -> DelayEstimate {
    let chosen = if lags == Lags::One { one } else { two };
    let [from, to] = if one.delay < two.delay { [one, two] } else { [two, one] };
    let interval =
        [from.delay - NORMAL_95 * from.std - BETWEEN, to.delay + NORMAL_95 * to.std + BETWEEN];
    // The structure is anywhere between the two.
    let std = chosen.std.hypot((to.delay - from.delay + 2.0 * BETWEEN) / 12.0_f64.sqrt());
    let (longest, off) = (max_delay as f64, bias as f64 - 1.0);
    let narrower = std <= longest.max(1.0) / 12.0_f64.sqrt();
    if !narrower {
        let note = format!(
            "a standard deviation of {std:.1} samples says no more than the search window does"
        );
        return DelayEstimate::without(Outcome::Flat, note);
    }
    let at_edge = chosen.delay - off > longest - 0.5;
    DelayEstimate::measured(chosen.delay, std, interval, at_edge, off, experiment.sample_time())
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

/// Of a step response s at t = 0, 1, … samples with the end `gain`, straight between its samples; `None` where T_ar lies outside it.
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

/// A gain at frequency 0 is told from noise by this many standard deviations.
pub(super) const TOLD: f64 = 3.0;

/// The impulse response that area2, area3 and moment read, and its sum K; the inner error is an answer without a delay.
#[allow(clippy::type_complexity)]
pub(super) fn pulse_response(
    name: &'static str,
    taps: usize,
    records: &[Record],
    max_delay: usize,
    experiment: &Experiment,
) -> Result<Result<(Fir, f64), DelayEstimate>, DelayError> {
    if taps == 0 {
        return Err(DelayError::Option {
            method: name,
            option: "taps",
            value: 0.0,
            allowed: "1 or more",
        });
    }
    let taps = taps.max(max_delay + BEYOND);
    let (needed, got) = (2 * taps + 1, experiment.longest());
    if got < needed {
        return Err(DelayError::TooShort {
            method: name,
            needed,
            got,
            remedy: crate::error::LengthRemedy::WindowOr("set fewer taps"),
        });
    }
    let fir = match fir_or_rank(records, taps) {
        Ok(fir) => fir,
        Err(rank) => {
            let note =
                format!("the input excites only {} of {} coefficients", rank.rank, rank.columns);
            return Ok(Err(DelayEstimate::without(Outcome::NotRichEnough, note)));
        }
    };
    if let Some(note) = posterior::unseen(records, max_delay) {
        return Ok(Err(DelayEstimate::without(Outcome::NotVisible, note)));
    }
    let gain = fir.coefficients.sum();
    let told = gain.abs() > TOLD * fir.covariance.sum().max(0.0).sqrt();
    if !told {
        let note = "the gain at frequency 0, by which areas and moments are divided, is not told from noise";
        return Ok(Err(DelayEstimate::without(Outcome::Singular, note)));
    }
    Ok(Ok((fir, gain)))
}

/// Both readings of the areas of an impulse response; `None` where they have no solution.
pub(super) fn by_areas(fir: &Fir, gain: f64) -> Option<[Reading; 2]> {
    let h = &fir.coefficients;
    let mean = h.iter().enumerate().map(|(j, h)| j as f64 * h).sum::<f64>() / gain;
    let step: Vec<f64> = h
        .iter()
        .scan(0.0, |sum, h| {
            *sum += h;
            Some(*sum)
        })
        .collect();
    // Straight lines between the samples: half a sample less than the sum of K − s.
    let t_ar = mean - 0.5;
    let Area { a1, height, weights } = area(&step, gain, t_ar)?;
    // Σ wᵢ over i ≥ j: what sample j of the impulse response adds to the area.
    let mut after = weights;
    for j in (0..after.len().saturating_sub(1)).rev() {
        after[j] += after[j + 1];
    }
    let reading = |lags: Lags| {
        let c = lags.of_area();
        let gradient: Vec<f64> = after
            .iter()
            .enumerate()
            .map(|(j, w)| ((1.0 - c * height) * (j as f64 - mean) - c * (w - a1)) / gain)
            .collect();
        Reading { delay: t_ar - c * a1, std: propagated(&gradient, &fir.covariance) }
    };
    let readings = [reading(Lags::One), reading(Lags::Two)];
    readings.iter().all(|r| r.delay.is_finite() && r.std.is_finite()).then_some(readings)
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;

    /// Sampled step responses of e^(−Ls)/(1 + sT)ⁿ by their closed forms.
    fn step(delay: f64, lag: f64, order: usize) -> Vec<f64> {
        (0..400)
            .map(|i| {
                let x = (i as f64 - delay) / lag;
                match order {
                    _ if x <= 0.0 => 0.0,
                    1 => 1.0 - (-x).exp(),
                    _ => 1.0 - (1.0 + x) * (-x).exp(),
                }
            })
            .collect()
    }

    fn fir(step: &[f64]) -> Fir {
        let h: Vec<f64> =
            (0..step.len()).map(|i| step[i] - if i > 0 { step[i - 1] } else { 0.0 }).collect();
        let n = h.len();
        Fir {
            coefficients: DVector::from_vec(h),
            covariance: DMatrix::identity(n, n) * 1e-12,
            variance: 1e-12,
            rows: 1000,
        }
    }

    #[test]
    fn each_reading_is_right_for_its_own_plant() {
        for (delay, lag) in [(4.0, 5.0), (9.3, 10.0), (0.0, 20.0), (17.0, 3.0)] {
            let one = by_areas(&fir(&step(delay, lag, 1)), 1.0).unwrap()[0].delay;
            let two = by_areas(&fir(&step(delay, lag, 2)), 1.0).unwrap()[1].delay;
            assert!(
                (one - delay).abs() < 0.1 && (two - delay).abs() < 0.1,
                "{delay} {lag}: {one} {two}"
            );
            let [early, late] =
                [1, 0].map(|k| by_areas(&fir(&step(delay, lag, 2)), 1.0).unwrap()[k].delay);
            assert!(early < late, "one lag read into two is late");
        }
    }

    #[test]
    fn the_standard_deviation_is_that_of_the_difference_quotients() {
        let at = fir(&step(4.2, 5.0, 1)[..60]);
        let readings = |fir: &Fir| by_areas(fir, fir.coefficients.sum()).unwrap();
        for k in 0..2 {
            let squares: f64 = (0..60)
                .map(|j| {
                    let moved = |h: f64| {
                        let mut other = at.clone();
                        other.coefficients[j] += h;
                        readings(&other)[k].delay
                    };
                    ((moved(1e-6) - moved(-1e-6)) / 2e-6).powi(2)
                })
                .sum();
            let std = readings(&at)[k].std;
            assert!(
                (std / (1e-6 * squares.sqrt()) - 1.0).abs() < 1e-3,
                "{std} {}",
                1e-6 * squares.sqrt()
            );
        }
    }

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

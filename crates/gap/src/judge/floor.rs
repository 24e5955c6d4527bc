//! The noise floor: the part of a residual that no deterministic model can explain.
//!
//! How it can be wrong: a gap that is the same everywhere and unrelated to inputs and predictions looks like noise. Coloured noise has few independent samples,
//! so low-variance windows occur by chance. The floor is therefore the least of four levels. Two are the part that commands do not predict, and the
//! low-variance windows (corrected for the noise's correlation length). The others are noise of the longest correlation length allowed, and the least residual
//! of any hypothesis.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use crate::baseline::noise::{Noise, autoregression_of, memory_of};
use crate::input::criteria::Criteria;
use crate::input::record::LogRecord;
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::Likelihood;
use deadtime_signal::parallel;
use deadtime_signal::stats;

/// Samples of simulated noise for the variance of its low-variance windows.
const SIMULATED: usize = 200_000;

/// The noise in each output's residual: its standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Floor {
    /// Per output.
    pub(crate) floor: Vec<f64>,
}

/// From the residuals of the best hypothesis, one matrix per record (samples × outputs). `reached` are errors and residuals of all leading hypotheses, no
/// effect included: no floor is above the error of a model. `related` is the share of every output's residual that depends on the commands.
pub(crate) fn estimate(
    likelihood: &Likelihood<'_>,
    residuals: &[DMatrix<f64>],
    reached: &[(Errors, Vec<DMatrix<f64>>)],
    related: &[f64],
) -> Floor {
    let (records, criteria) = (likelihood.records, &likelihood.criteria);
    let one = |i: usize| {
        let samples = records.iter().zip(residuals).flat_map(|(r, e)| {
            (0..r.time_s.len())
                .filter(move |&k| r.measured_in(r.train, i, k).is_some())
                .map(move |k| e[(k, i)])
        });
        let square = mean_square(samples);
        let calm = calmest(records, residuals, i, criteria) / square.max(f64::MIN_POSITIVE);
        let slow = slow(records, residuals, i, criteria) / square.max(f64::MIN_POSITIVE);
        // Noise is in every residual: the low-variance windows of any hypothesis are no lower.
        let lowest = reached
            .iter()
            .map(|(e, other)| e.rms()[i].min(calmest(records, other, i, criteria).sqrt()))
            .fold(f64::INFINITY, f64::min);
        (square * (1.0 - related[i]).min(calm).min(slow).clamp(0.0, 1.0)).sqrt().min(lowest)
    };
    Floor { floor: parallel::map(0..related.len(), one) }
}

fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    stats::mean(values.map(|v| v * v)).unwrap_or(0.0)
}

/// The mean square of noise of the longest correlation length allowed with this residual's innovations; infinite where the residual's correlation length is shorter.
fn slow(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    output: usize,
    criteria: &Criteria,
) -> f64 {
    let (trained, left): (Vec<&LogRecord>, Vec<&DMatrix<f64>>) =
        records.iter().zip(residuals).filter(|(r, _)| r.train.is_some()).unzip();
    let noise =
        Noise::fit(&trained, &left, &vec![0.0; left.first().map_or(0, |r| r.ncols())], criteria);
    let slowest = criteria.slowest_noise;
    if noise.memory(output) <= slowest {
        return f64::INFINITY;
    }
    // A first-order autoregression of memory m has the variance (m + 1)²/4m in units of its innovations'.
    noise.std()[output].powi(2) * (slowest + 1.0).powi(2) / (4.0 * slowest)
}

/// Mean square in the 25 % of windows with the lowest variance, over its expectation for stationary noise. Infinite where the windows differ by chance only.
/// The noise is simulated with the autoregression of these windows: an intermittent gap must not be taken for its colour. Windows shorter than the noise's
/// correlation length carry no information.
fn calmest(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    output: usize,
    criteria: &Criteria,
) -> f64 {
    let series: Vec<Vec<Option<f64>>> = (records.iter().zip(residuals))
        .filter(|(r, _)| r.train.is_some())
        .map(|(record, residual)| {
            let inside = (0..record.time_s.len())
                .filter(|&k| record.train.is_some_and(|s| s.holds(record.time_s[k])));
            let measured = &record.measured[output];
            let ends =
                extremes(record.time_s.iter().enumerate().filter_map(|(k, _)| measured.get(k)));
            // At a limit of the sensor the noise does not show.
            let free = |y: &f64| !ends.contains(y);
            inside.map(|k| measured.get(k).filter(free).map(|_| residual[(k, output)])).collect()
        })
        .collect();
    let each = parallel::map(&criteria.windows, |&count| calmest_of(&series, count, criteria));
    each.into_iter().fold(f64::INFINITY, f64::min)
}

/// The least and the greatest value, where each is taken by more samples than noise without a limit would (one in a hundred).
fn extremes(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let [Some(low), Some(high)] = [sorted.first(), sorted.last()] else { return Vec::new() };
    let often = |value: f64| {
        let equal =
            sorted.partition_point(|v| *v <= value) - sorted.partition_point(|v| *v < value);
        100 * equal > sorted.len()
    };
    [*low, *high].into_iter().filter(|v| often(*v)).collect()
}

/// As [`calmest`], with the given number of windows per record.
fn calmest_of(series: &[Vec<Option<f64>>], count: usize, criteria: &Criteria) -> f64 {
    let mut windows: Vec<Vec<Option<f64>>> = Vec::new();
    for inside in series {
        let size = (inside.len() / count.max(1)).max(criteria.shortest_window);
        windows.extend(
            inside
                .chunks_exact(size)
                .filter(|w| 2 * w.iter().flatten().count() > size)
                .map(<[_]>::to_vec),
        );
    }
    if windows.len() < criteria.fewest_windows.max(1) {
        return f64::INFINITY;
    }
    windows.sort_by(|a, b| power(a).total_cmp(&power(b)));
    let powers: Vec<f64> = windows.iter().map(|w| power(w)).collect();
    let part = criteria.calm_part;
    let (calm, all) = calm_and_all(&powers, part);
    let ar = autoregression_of(
        &windows[..((part * windows.len() as f64).ceil() as usize).min(windows.len())],
        criteria,
    );
    let samples: usize = windows.iter().map(Vec::len).sum();
    if (samples / windows.len()) as f64 <= criteria.window_memories * memory_of(&ar) {
        return f64::INFINITY;
    }
    let draws = (SIMULATED / samples.max(1)).clamp(20, 200);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut ratios: Vec<f64> = (0..draws)
        .map(|_| {
            let mut powers: Vec<f64> =
                windows.iter().map(|w| power(&simulated(&ar, w.len(), &mut rng))).collect();
            powers.sort_by(f64::total_cmp);
            let (calm, all) = calm_and_all(&powers, part);
            calm / all
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let usual = ratios.iter().sum::<f64>() / draws as f64;
    if ratios
        .get((criteria.calm_by_chance * draws as f64) as usize)
        .is_some_and(|limit| calm / all < *limit)
    {
        calm / usual
    } else {
        f64::INFINITY
    }
}

/// Mean square of the samples that are there.
fn power(window: &[Option<f64>]) -> f64 {
    mean_square(window.iter().flatten().copied())
}

/// Means of the part with the lowest powers and of all, of sorted powers.
fn calm_and_all(powers: &[f64], part: f64) -> (f64, f64) {
    let mean = |p: &[f64]| stats::mean(p.iter().copied()).unwrap_or(0.0);
    (mean(&powers[..((part * powers.len() as f64) as usize).min(powers.len())]), mean(powers))
}

/// A stretch of autoregressive noise of unit innovations, from rest and after settling.
fn simulated(ar: &[f64], samples: usize, rng: &mut ChaCha8Rng) -> Vec<Option<f64>> {
    let settle = if ar.is_empty() { 0 } else { 200 };
    let mut past: Vec<f64> = Vec::with_capacity(samples + settle);
    for k in 0..samples + settle {
        let next: f64 = ar.iter().zip(past[..k].iter().rev()).map(|(a, r)| a * r).sum::<f64>()
            + rng.sample::<f64, _>(StandardNormal);
        past.push(next);
    }
    past.drain(..settle);
    past.into_iter().map(Some).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_at_an_end_that_many_samples_take_is_a_limit() {
        let wave: Vec<f64> = (0..1000).map(|k| (0.37 * f64::from(k)).sin()).collect();
        let clipped = |low: f64, high: f64| extremes(wave.iter().map(move |v| v.clamp(low, high)));
        assert_eq!(clipped(-2.0, 2.0), Vec::<f64>::new());
        assert_eq!(clipped(-0.5, 2.0), [-0.5]);
        assert_eq!(clipped(-0.5, 0.9), [-0.5, 0.9]);
        assert_eq!(extremes(std::iter::empty()), Vec::<f64>::new());
    }
}

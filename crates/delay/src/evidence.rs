//! Curves behind the methods for one pair: the impulse response, the ARX loss over the delay with its probability, the correlation, and the cross-spectrum's
//! phase. The curves plot a record at the methods' defaults; no estimate uses them. ARX models use the first 100 000 samples, the other curves all of them.
//!
//! Lags here are those of the samples, hold and relative degree included: a dead time of 0 appears at the pair's sampling delay.

use nalgebra::Complex;

use super::correlation::weights::maximum_likelihood;
use super::error::Result;
use super::experiment::{Detrend, Experiment};
use super::posterior::posterior_of_start;
use super::report::Response;
use crate::correlation::generalised::{Centred, alike, segment_length};
use crate::parametric::arxstruc::Arxstruc;
use crate::threshold::impulse::Threshold;
use deadtime_identify::Record;
use deadtime_identify::{arx_scan, fir};
use deadtime_log::Log;
use deadtime_signal::correlation;
use deadtime_signal::stats::NORMAL_95;

/// Squared coherence below which a phase is mostly random and is not drawn.
const COHERENT: f64 = 0.1;

/// The curves of one pair, each `None` where the record does not allow it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// The impulse response; `None` where the input does not excite all coefficients.
    pub response: Option<Response>,
    /// The limit that the method `threshold` applies to it, standard deviations.
    pub limit_std: f64,
    /// The loss of ARX models over the delay.
    pub scan: Option<Scan>,
    /// The correlation of input and output.
    pub correlation: Option<Correlated>,
    /// The phase of the cross-spectrum.
    pub phase: Option<Phase>,
}

/// ARX models over all delays, one value per lag from 0 on.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// The loss relative to the smallest one.
    pub loss: Vec<f64>,
    /// The probability of each lag from the losses (Schwarz 1978, Ann. Statist. 6(2), 461-464, doi:10.1214/aos/1176344136).
    pub probability: Vec<f64>,
}

/// The correlation of two signals, one value per lag from 0 on.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlated {
    /// The correlation coefficient.
    pub coefficient: Vec<f64>,
    /// Unrelated signals with the same autocorrelations stay below this value at 95 % of all lags (Bartlett 1946, Suppl. J. R. Stat. Soc. 8(1), 27-41,
    /// doi:10.2307/2983611).
    pub chance: f64,
}

/// The phase over frequency, where input and output are coherent.
#[derive(Debug, Clone, PartialEq)]
pub struct Phase {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// The phase, rad, unwrapped about the straight line; the phase of a negative gain is removed.
    pub phase_rad: Vec<f64>,
    /// The delay of the straight line −2πf·delay, s.
    pub delay_s: f64,
}

/// The curves of one pair of channels over lags up to `max_delay` samples.
///
/// # Errors
/// As [`Experiment::from_logs`].
pub fn evidence(
    logs: &[Log],
    input: &str,
    output: &str,
    detrend: Detrend,
    max_delay: usize,
) -> Result<Evidence> {
    let logged = Experiment::from_logs(logs, &[input.to_owned()], &[output.to_owned()])?;
    let experiment = logged.detrended(detrend)?;
    let records = experiment.pair(0, 0)?;
    let threshold = Threshold::default();
    Ok(Evidence {
        response: response(&records, threshold.taps),
        limit_std: threshold.h_std,
        scan: scan(&records, max_delay),
        correlation: correlated(&records, max_delay),
        phase: phase(&records, max_delay, experiment.longest(), experiment.sample_time().seconds()),
    })
}

/// The impulse response from one channel to another, as many coefficients as [`Threshold`] estimates; `None` where the input does not excite all of them.
///
/// # Errors
/// As [`Experiment::from_logs`].
pub fn impulse_response(
    logs: &[Log],
    input: &str,
    output: &str,
    detrend: Detrend,
) -> Result<Option<Response>> {
    let logged = Experiment::from_logs(logs, &[input.to_owned()], &[output.to_owned()])?;
    let experiment = logged.detrended(detrend)?;
    Ok(response(&experiment.pair(0, 0)?, Threshold::default().taps))
}

fn response(records: &[Record], taps: usize) -> Option<Response> {
    fir(records, taps).map(|fir| Response {
        values: fir.coefficients.iter().copied().collect(),
        std: fir.covariance.diagonal().map(|v| v.max(0.0).sqrt()).iter().copied().collect(),
    })
}

fn scan(records: &[Record], max_delay: usize) -> Option<Scan> {
    let Arxstruc { na, nb, max_samples, .. } = Arxstruc::default();
    let heads: Vec<Record> = records.iter().map(|r| r.head(max_samples)).collect();
    let scan = arx_scan(&heads, na, nb, max_delay);
    if scan.rows < 2 * (na + nb) || scan.input_rank.iter().all(|&r| r == 0) {
        return None;
    }
    let posterior = posterior_of_start(&scan.by_count, scan.power, scan.rows as f64)?;
    let smallest = scan
        .loss
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .min_by(f64::total_cmp)
        .filter(|v| *v > 0.0)?;
    Some(Scan {
        loss: scan.loss.iter().map(|v| v / smallest).collect(),
        probability: posterior.weights,
    })
}

/// Products of two signals at the lags from 0 to the last.
type Products = fn(&[f64], &[f64], isize) -> Vec<f64>;

fn correlated(records: &[Record], max_delay: usize) -> Option<Correlated> {
    let centred = Centred::new(records);
    let samples: usize = centred.records().map(|(u, _)| u.len()).sum();
    let last = isize::try_from(max_delay).ok()?;
    // Products of lags beyond 25 % of a record average few samples and are mostly noise.
    let memory = isize::try_from(centred.records().map(|(u, _)| u.len()).min()? / 4).ok()?;
    let sum = |products: Products, last: isize| -> Option<Vec<f64>> {
        centred
            .records()
            .map(|(u, y)| products(u, y, last))
            .reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect())
    };
    let own_u = sum(|u, _, last| correlation(u, u, 0..=last), memory)?;
    let own_y = sum(|_, y, last| correlation(y, y, 0..=last), memory)?;
    let (power_u, power_y) = (*own_u.first()?, *own_y.first()?);
    let scale = (power_u * power_y).sqrt();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let coefficient: Vec<f64> =
        sum(|u, y, last| correlation(u, y, 0..=last), last)?.iter().map(|v| v / scale).collect();
    let likeness: f64 =
        own_u.iter().zip(&own_y).skip(1).map(|(u, y)| u * y).sum::<f64>() / (power_u * power_y);
    // Estimated products of long lags can sum to less than those of white signals.
    let variance = (1.0 + 2.0 * likeness).max(1.0) / samples as f64;
    Some(Correlated { coefficient, chance: NORMAL_95 * variance.sqrt() })
}

fn phase(records: &[Record], max_delay: usize, longest: usize, step_s: f64) -> Option<Phase> {
    let segment = segment_length(0, longest, max_delay);
    if longest < max_delay + segment {
        return None;
    }
    let (found, seen) = alike(&Centred::new(records), segment, maximum_likelihood, max_delay);
    let (seen, fraction) = (seen?, found.fraction?);
    let delay = found.lag as f64 + fraction;
    let coherent = seen
        .lines
        .iter()
        .zip(&seen.spectra.uy)
        .filter(|(line, _)| line.times > 1.0 && line.coherence > COHERENT);
    let points: Vec<[f64; 2]> = coherent
        .map(|(line, s)| {
            // The spectra are of y moved back by the whole lag: the residual phase after the fraction is small.
            let left = (s * seen.sign * Complex::from_polar(1.0, line.omega * fraction)).arg();
            [line.omega / (2.0 * std::f64::consts::PI * step_s), left - line.omega * delay]
        })
        .collect();
    (points.len() > 1).then(|| Phase {
        frequency_hz: points.iter().map(|p| p[0]).collect(),
        phase_rad: points.iter().map(|p| p[1]).collect(),
        delay_s: delay * step_s,
    })
}

#[cfg(test)]
mod tests {
    use approx::assert_abs_diff_eq;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use deadtime_log::Channel;

    fn white(n: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
        (0..n).map(|_| StandardNormal.sample(rng)).collect()
    }

    fn log(u: Vec<f64>, y: Vec<f64>) -> Log {
        let time_s = (0..u.len()).map(|t| 0.1 * t as f64).collect();
        Log::new("test", time_s, vec![Channel::new("u", None, u), Channel::new("y", None, y)])
            .unwrap()
    }

    fn lowest(values: &[f64]) -> usize {
        (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap()
    }

    #[test]
    fn every_curve_shows_an_injected_delay() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (u, e) = (white(2000, &mut rng), white(2000, &mut rng));
        // Seven samples late, with a negative gain.
        let y: Vec<f64> =
            (0..u.len()).map(|t| 0.1 * e[t] - if t < 7 { 0.0 } else { u[t - 7] }).collect();
        let found = evidence(&[log(u, y)], "u", "y", Detrend::Mean, 20).unwrap();
        let response = found.response.unwrap();
        let size: Vec<f64> = response.values.iter().map(|v| -v.abs()).collect();
        assert_eq!(lowest(&size), 7);
        assert_abs_diff_eq!(response.values[7], -1.0, epsilon = 5.0 * response.std[7]);
        let scan = found.scan.unwrap();
        assert_eq!(
            (scan.loss.len(), scan.loss[7]),
            (21, scan.loss.iter().copied().fold(f64::INFINITY, f64::min)),
            "{:?}",
            scan.loss
        );
        assert!(scan.probability[7] > 0.9, "{:?}", scan.probability);
        let correlation = found.correlation.unwrap();
        assert!(
            correlation.coefficient[7] < -0.95
                && correlation.coefficient.iter().filter(|c| c.abs() > correlation.chance).count()
                    <= 5
        );
        let phase = found.phase.unwrap();
        assert_abs_diff_eq!(phase.delay_s, 0.7, epsilon = 0.01);
        for (f, turned) in phase.frequency_hz.iter().zip(&phase.phase_rad) {
            assert_abs_diff_eq!(*turned, -2.0 * std::f64::consts::PI * f * 0.7, epsilon = 0.3);
        }
    }

    #[test]
    fn slow_signals_that_have_nothing_in_common_stay_below_chance_as_often_as_it_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let slow = |rng: &mut ChaCha8Rng| {
            let mut x = 0.0;
            white(1500, rng)
                .into_iter()
                .map(|e| {
                    x = 0.9 * x + e;
                    x
                })
                .collect::<Vec<f64>>()
        };
        let (mut beyond, mut beyond_white, mut all) = (0, 0, 0);
        for _ in 0..400 {
            let (u, y) = (slow(&mut rng), slow(&mut rng));
            let log = log(u, y);
            let experiment = Experiment::from_logs(
                std::slice::from_ref(&log),
                &["u".to_owned()],
                &["y".to_owned()],
            )
            .unwrap();
            let found = correlated(&experiment.pair(0, 0).unwrap(), 30).unwrap();
            all += found.coefficient.len();
            beyond += found.coefficient.iter().filter(|c| c.abs() > found.chance).count();
            beyond_white +=
                found.coefficient.iter().filter(|c| c.abs() > NORMAL_95 / 1500_f64.sqrt()).count();
        }
        let share = |count: usize| count as f64 / all as f64;
        assert!((0.02..0.08).contains(&share(beyond)), "{}", share(beyond));
        assert!(
            share(beyond_white) > 0.3,
            "the limit of white signals is no limit here: {}",
            share(beyond_white)
        );
    }

    #[test]
    fn what_a_record_does_not_allow_is_left_out() {
        let step: Vec<f64> = (0..60).map(|t| f64::from(u8::from(t >= 30))).collect();
        let found = evidence(&[log(step.clone(), step)], "u", "y", Detrend::Mean, 10).unwrap();
        assert_eq!(found.response, None, "a step does not excite 71 coefficients in 60 samples");
        for curve in [
            found.scan.map(|s| s.loss),
            found.correlation.map(|c| c.coefficient),
            found.phase.map(|p| p.phase_rad),
        ]
        .into_iter()
        .flatten()
        {
            assert!(curve.iter().all(|v| v.is_finite()), "{curve:?}");
        }
    }
}

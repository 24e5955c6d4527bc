//! The default search window of dead times.
//!
//! The window of [`Search`](crate::Search) suits most records. A response that begins beyond the window is invisible in it, or passes for noise, feedback or a
//! time-varying delay. Prediction-error models over longer delays detect such a response before any method runs. A method whose estimate is at the end of the
//! window indicates it afterwards.
//!
//! How it can be wrong: a periodic input fits a delay of one more period equally well, though never better. An input that moves once excites few lags, so that
//! only the methods reach the end of the window. A response that begins beyond a third of the record is not found.

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::finding::Finding;
use crate::method::Method;
use crate::posterior::{ARX_ORDERS, ROUNDING, samples_under, smallest, visible_gain};
use crate::process::family::{ROUGH_SAMPLES, Rough, rough};
use crate::verdict::answer::distrust;
use deadtime_identify::{ArxScan, Record, arx_scan};
use deadtime_signal::stop::Stop;

/// Delays are searched up to 1/`PARTS` of the longest record.
const PARTS: usize = 3;
/// Samples of a record in the test for a response beyond the window.
const LOOKED_AT: usize = 20_000;
/// The same where samples are missing, as lag products then cost a factorisation.
const LOOKED_AT_WITH_GAPS: usize = 3000;

/// The longest delay of the default search, samples.
pub(super) fn most(longest_record: usize) -> usize {
    (longest_record / PARTS).max(1)
}

/// The window, doubled until it holds `delay` before its end, or reaches the maximum.
fn holding(window: usize, delay: usize, most: usize) -> usize {
    let mut window = window;
    while window <= delay && window < most {
        window = (2 * window).min(most);
    }
    window
}

/// The window that holds the beginning of the response. The result is `window`, unless models with a delay beyond it predict the output significantly better.
///
/// Equation: N·ln(V(inside)/V(beyond)) ≥ the χ² quantile of the models' coefficients over all tested delays. V is the loss of the best ARX model; all models
/// predict the same rows.
/// Assumes: no condition on noise, feedback or the plant's speed, because every model contains past outputs.
/// Resolution and cost: one ARX scan for each window length of lags.
/// Source: Ljung (1999), "System Identification", 2nd ed., section 10.1, for the scan; the test is the likelihood ratio of `unseen`.
///
/// # Errors
/// [`DelayError::Stopped`].
pub(super) fn reaching(
    records: &[Record<'_>],
    window: usize,
    stop: &Stop,
) -> Result<usize, DelayError> {
    let gaps = records.iter().any(|r| r.present.is_some());
    let looked_at = if gaps { LOOKED_AT_WITH_GAPS } else { LOOKED_AT };
    let heads: Vec<Record<'_>> = records.iter().map(|r| r.head(looked_at)).collect();
    let most = most(heads.iter().map(Record::len).max().unwrap_or(0));
    let [na, nb] = ARX_ORDERS;
    let each = window + 1;
    // The same rows in every scan: those of the longest delay.
    let long = || heads.iter().filter(|r| r.len() > most + each + nb + na);
    if window == 0 || most <= window || long().next().is_none() {
        return Ok(window);
    }
    let gain = |scan: &ArxScan, loss: f64| {
        scan.rows as f64 * (scan.loss_without_input / loss.max(f64::MIN_POSITIVE)).ln()
    };
    let (mut inside, mut beyond) = (0.0, (f64::NEG_INFINITY, 0));
    for first in (0..=most).step_by(each) {
        if stop.is_set() {
            return Err(DelayError::Stopped);
        }
        let moved: Vec<Record<'_>> =
            long().map(|r| r.part(most - first.min(most), most, r.len() - most)).collect();
        let scan = arx_scan(&moved, na, nb, window);
        let Some(best) = smallest(&scan.loss).filter(|_| scan.rows > 2 * (na + nb)) else {
            return Ok(window);
        };
        let gained = gain(&scan, scan.loss[best]);
        if first == 0 {
            inside = gained.max(0.0);
        } else if gained > beyond.0 {
            beyond = (gained, first + best);
        }
    }
    let begins = beyond.0 > inside + visible_gain(nb, most + 1);
    Ok(if begins { holding(window, beyond.1, most) } else { window })
}

/// The same by models of two poles, for records that begin at rest. Inputs of these records move too seldom for regressions to detect the beginning of the
/// response.
///
/// Equation: n·ln(Σe²(inside)/Σe²(any delay)) ≥ the χ² quantile of a delay, over all tested delays; n is the number of independent samples.
/// Assumes: an open loop, and a dead time of at most a third of [`ROUGH_SAMPLES`]. A plant of more lags biases the two-pole delay late, so the window only
/// grows.
pub(super) fn reaching_by_model(records: &[Record<'_>], window: usize, most: usize) -> usize {
    let longest = records.iter().map(Record::len).max().unwrap_or(0);
    let most = most.min(self::most(longest.min(ROUGH_SAMPLES)));
    if window >= most {
        return window;
    }
    let fitted = |window| rough(records, 2, window, 0);
    let cost = |r: &Rough| r.residual.iter().map(|e| e * e).sum::<f64>();
    let (Some(inside), Some(any)) = (fitted(window), fitted(most)) else { return window };
    let least = cost(&any).max(ROUNDING * any.power).max(f64::MIN_POSITIVE);
    let counting =
        any.samples * samples_under(&any.model, &any.residual) / any.residual.len().max(1) as f64;
    let gain = counting * (cost(&inside) / least).ln();
    if gain > visible_gain(1, most + 1) {
        holding(window, any.delay.ceil() as usize, most)
    } else {
        window
    }
}

/// The methods at the end of the window are significant from 1/`SHARE` of the methods with an estimate.
const SHARE: usize = 3;

/// Methods that withstand the record's conditions, with estimates at or beyond the end of the window. Without any such estimate, all methods are included. A
/// model's residual is no exclusion here, because a window that is too short causes it. Empty where they are few.
pub(super) fn at_its_end<'a>(
    answers: impl Iterator<Item = (&'a Method, &'a DelayEstimate)>,
    findings: &[Finding],
    window_s: f64,
) -> Vec<&'a str> {
    let answered: Vec<(&Method, &DelayEstimate)> =
        answers.filter(|(_, e)| e.outcome.has_delay()).collect();
    let counts = |(m, e): &&(&'a Method, &'a DelayEstimate)| distrust(m, e, findings).is_empty();
    let any = answered.iter().any(|a| counts(&a));
    let beyond = |e: &DelayEstimate| {
        e.outcome == Outcome::AtEdge || e.raw_delay_s.is_some_and(|raw| raw > window_s)
    };
    let asked: Vec<_> = answered.iter().filter(|a| !any || counts(a)).collect();
    let at_end: Vec<&str> =
        asked.iter().filter(|(_, e)| beyond(e)).map(|(m, _)| m.entry.name).collect();
    // A single outlier is not significant.
    if SHARE * at_end.len() >= asked.len() { at_end } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// A lag behind a delay, in steps of `hold` samples, with 10 % white noise.
    fn drawn(rng: &mut ChaCha8Rng, samples: usize, delay: usize, hold: usize) -> Record<'static> {
        let pole = rng.random_range(0.3..0.95);
        let mut u = Vec::with_capacity(samples);
        while u.len() < samples {
            let level = if rng.random::<bool>() { 1.0 } else { -1.0 };
            u.extend(std::iter::repeat_n(level, hold.min(samples - u.len())));
        }
        let mut x = 0.0;
        let mut y = Vec::with_capacity(samples);
        for t in 0..samples {
            let before = t.checked_sub(delay + 1).map_or(0.0, |at| u[at]);
            x = pole * x + (1.0 - pole) * before;
            let noise: f64 = StandardNormal.sample(rng);
            y.push(x + 0.1 * noise);
        }
        Record::new(u, y)
    }

    #[test]
    fn the_window_holds_a_response_that_begins_beyond_it_and_stays_where_it_begins_inside() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let stop = Stop::default();
        for draw in 0..30 {
            let samples = rng.random_range(700..2500_usize);
            let hold = rng.random_range(1..8_usize);
            let far = rng.random_range(40..samples / 4);
            let record = drawn(&mut rng, samples, far, hold);
            let window = reaching(&[record], 35, &stop).unwrap();
            assert!(window > far && window <= samples / 3, "{draw}: {far} in {window}");
            let near = drawn(&mut rng, samples, far % 30, hold);
            let window = reaching(&[near], 35, &stop).unwrap();
            assert_eq!(window, 35, "{draw}: {}", far % 30);
        }
    }

    #[test]
    fn one_step_shows_by_a_model_that_the_response_begins_beyond_the_window() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for draw in 0..2 {
            let (samples, far) = (900, rng.random_range(50..200_usize));
            let near = rng.random_range(0..30_usize);
            let mut held = |delay: usize| {
                let step = |t: usize| f64::from(u8::from(t >= 300));
                let lag: f64 = rng.random_range(2.0..20.0);
                let answer = |t: usize| {
                    let since = t as f64 - (300 + delay) as f64;
                    if since > 0.0 { 1.0 - (-since / lag).exp() } else { 0.0 }
                };
                let mut noisy = |t: usize| -> f64 {
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    answer(t) + 0.05 * noise
                };
                let y = (0..samples).map(&mut noisy).collect::<Vec<f64>>();
                let record = Record::new((0..samples).map(step).collect::<Vec<f64>>(), y);
                reaching_by_model(&[record], 35, most(samples))
            };
            let (wide, same) = (held(far), held(near));
            assert!(wide > far && same == 35, "{draw}: {far} in {wide}, {near} in {same}");
        }
    }

    #[test]
    fn noise_alone_moves_no_window() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let moved = (0..40).filter(|_| {
            let u: Vec<f64> = (0..800).map(|_| StandardNormal.sample(&mut rng)).collect();
            let mut slow = 0.0;
            let mut next = || {
                let e: f64 = StandardNormal.sample(&mut rng);
                slow = 0.9 * slow + e;
                slow
            };
            let y: Vec<f64> = (0..800).map(|_| next()).collect();
            reaching(&[Record::new(u, y)], 35, &Stop::default()).unwrap() != 35
        });
        assert!(moved.count() <= 1);
    }

    #[test]
    fn a_short_record_keeps_its_window() {
        let mut rng = ChaCha8Rng::seed_from_u64(10);
        let record = drawn(&mut rng, 80, 5, 2);
        assert_eq!(reaching(&[record], 20, &Stop::default()).unwrap(), 20);
    }
}

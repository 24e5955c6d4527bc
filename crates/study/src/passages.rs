//! The same events at two places, a dead time apart: records for the criteria that pair events.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, Exp1, StandardNormal};

use super::logging::Logging;
use deadtime_delay::{DelayError, Events, Experiment};
use deadtime_signal::time::SampleTime;

/// The excitation that makes a record one of events.
pub(super) const EVENTS: &str = "events";
/// Sample times in a mean interval: the window is counted in hundredths of one, as between logged events.
const PARTS: f64 = 100.0;

/// `count` events whose intervals are half fixed and half exponential, seen `delay_s` later at the second place. For the times there, var(interval)/var(error)
/// is `snr`; each place misses events with the probability of `logging`.
///
/// # Errors
/// [`DelayError`] where too many were missed.
pub(super) fn passages(
    names: [&str; 2],
    count: usize,
    delay_s: f64,
    snr: f64,
    logging: &Logging,
    sample_time: SampleTime,
    rng: &mut impl Rng,
) -> Result<Experiment<'static>, DelayError> {
    let half_s = sample_time.to_seconds(0.5 * PARTS);
    // The exponential half has a standard deviation of half a mean interval.
    let error_s = half_s / snr.sqrt();
    let mut time_s = 0.0;
    let (mut first, mut second) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for _ in 0..count {
        let (rest, error): (f64, f64) = (Exp1.sample(rng), StandardNormal.sample(rng));
        time_s += half_s * (1.0 + rest);
        for (place, time) in
            [(&mut first, time_s), (&mut second, time_s + delay_s + error_s * error)]
        {
            if !rng.random_bool(logging.missing) {
                place.push(time);
            }
        }
    }
    // Errors may turn neighbours round.
    second.sort_by(f64::total_cmp);
    second.dedup();
    Experiment::of_events(sample_time, names, vec![Events { first, second, ..Events::default() }])
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_signal::stats;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn events_have_the_stated_intervals_errors_and_losses() {
        let ts = SampleTime::new(0.01).unwrap();
        let made = |missing: f64| {
            let logging = Logging { missing, jitter: 0.0 };
            passages(["a", "b"], 20_000, 3.0, 25.0, &logging, ts, &mut ChaCha8Rng::seed_from_u64(3))
                .unwrap()
        };
        let whole = made(0.0);
        let Events { first, second, .. } = &whole.events()[0];
        let intervals: Vec<f64> = first.windows(2).map(|w| w[1] - w[0]).collect();
        assert!((stats::mean(intervals.iter().copied()).unwrap() - 1.0).abs() < 0.02);
        let spread = stats::variance(&intervals).unwrap();
        assert!((spread - 0.25).abs() < 0.02, "{spread}");
        // Errors of 0.1 s rarely swap neighbours 0.5 s apart.
        let delays: Vec<f64> = first.iter().zip(second).map(|(a, b)| b - a).collect();
        assert!((stats::mean(delays.iter().copied()).unwrap() - 3.0).abs() < 0.005);
        let ratio = spread / stats::variance(&delays).unwrap();
        assert!((ratio - 25.0).abs() < 2.0, "{ratio}");
        let few = made(0.1);
        let lost = |seen: &[f64]| 1.0 - seen.len() as f64 / 20_000.0;
        assert!(
            [&few.events()[0].first, &few.events()[0].second]
                .into_iter()
                .all(|e| (lost(e) - 0.1).abs() < 0.01)
        );
    }
}

//! Delays of single events, as of packets in a network: quantiles over the paired events.
//!
//! How it can be wrong. An event missed at one place shifts all pairs behind it. Events are then paired by time within a gate; delays beyond the gate are left
//! out, which a note reports. Neighbours that are late together count as fewer independent events. Few events do not determine a far quantile: its interval is
//! then open.

use serde::Serialize;
use statrs::distribution::{Binomial, DiscreteCDF};

use super::criteria::correlation;
use super::offsets::{Matched, PARTS, Paired, mean, median, rows};
use crate::correlation::generalised::real;
use crate::estimator::Search;
use crate::experiment::Experiment;
use crate::posterior;
use deadtime_signal::stats;

/// Which quantiles are reported.
const SHARES: [f64; 4] = [0.05, 0.5, 0.95, 0.99];

/// The delays of single events.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Jitter {
    /// Events that were paired.
    pub events: usize,
    /// Standard deviation of a single delay, s.
    pub std_s: f64,
    /// Quantiles, in order.
    pub quantiles: Vec<DelayQuantile>,
    /// The longest delay that the pairing resolves, s, where events were missed; `null` where every event has its partner.
    pub longest_s: Option<f64>,
}

/// A quantile of single delays.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DelayQuantile {
    /// The share of events with at most this delay.
    pub share: f64,
    /// The delay, s.
    pub delay_s: f64,
    /// The ends of its 95 % interval, s; `null` where too few events leave an end open.
    pub ci95_s: [Option<f64>; 2],
}

impl Jitter {
    /// The delays of the events of an experiment, over all its recordings; `None` where no events can be paired.
    ///
    /// Intervals by order statistics assume no distribution of the delays: David and Nagaraja (2003), Order Statistics, 3rd edition, section 7.1,
    /// doi:10.1002/0471722162. Correlated neighbours count as the equivalent number of independent ones.
    #[must_use]
    pub fn of(experiment: &Experiment, search: &Search) -> Option<Self> {
        let window = experiment.sample_time().to_seconds(real(search.max_delay));
        let (mut delays, mut longest_s, mut count) = (Vec::new(), None::<f64>, 0.0);
        for events in experiment.events() {
            let matched = Matched::of(&events.first, &events.second, correlation, Some(window));
            // Rows that are shifted by an event contradict the intervals.
            let agree = |delays: &&[f64]| {
                let near = |m: &Matched<'_>| (median(delays.to_vec()) - m.typical).abs() <= m.gate;
                matched.as_ref().map_or(true, near)
            };
            let one: Vec<f64> = match (rows(events).filter(agree), matched) {
                (Some(delays), _) => delays.to_vec(),
                (None, Ok(matched)) if matched.is_whole() => matched.pairs.delays().collect(),
                (None, Ok(matched)) => {
                    let longest = matched.typical + matched.gate;
                    longest_s = Some(longest_s.map_or(longest, |l| l.min(longest)));
                    matched.by_time.iter().map(|p| p.1 - p.0).collect()
                }
                (None, Err(_)) => continue,
            };
            let centre = mean(one.iter().copied());
            let apart: Vec<f64> = one.iter().map(|d| d - centre).collect();
            count += posterior::effective_samples(&apart);
            delays.extend(one);
        }
        delays.sort_by(f64::total_cmp);
        let independent = (count.round() as u64).clamp(1, delays.len().max(1) as u64);
        let quantile = |share: f64| {
            Some(DelayQuantile {
                share,
                delay_s: stats::quantile(&delays, share)?,
                ci95_s: interval(&delays, share, independent),
            })
        };
        let quantiles = SHARES.into_iter().map(quantile).collect::<Option<_>>()?;
        Some(Self { events: delays.len(), std_s: stats::deviation(&delays)?, quantiles, longest_s })
    }
}

impl Matched<'_> {
    /// No event is missing at either place: the typical delay is constant along the best offset.
    fn is_whole(&self) -> bool {
        let delays: Vec<f64> = self.pairs.delays().collect();
        let part = |p: &[f64]| (median(p.to_vec()) - self.typical).abs() <= self.gate;
        self.pairs.is_all() && delays.chunks(delays.len().div_ceil(PARTS).max(1)).all(part)
    }
}

impl Paired<'_> {
    /// Both sequences have equally many events.
    fn is_all(&self) -> bool {
        self.first.len() == self.second.len()
    }
}

/// The 95 % interval of a quantile by the order of sorted values, with this number of independent ones.
fn interval(sorted: &[f64], share: f64, independent: u64) -> [Option<f64>; 2] {
    let Ok(below) = Binomial::new(share, independent) else { return [None; 2] };
    // The r-th of n is below the quantile unless fewer than r values are.
    let low = (1..=independent).rev().find(|&r| below.cdf(r - 1) <= 0.025);
    let high = (1..=independent).find(|&r| below.cdf(r - 1) >= 0.975);
    let rank = |r: u64| {
        // The same place among all values.
        let at = (r as f64 - 0.5) / independent as f64 * sorted.len() as f64;
        sorted.get((at as usize).min(sorted.len().saturating_sub(1))).copied()
    };
    [low.and_then(rank), high.and_then(rank)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::times::Events;
    use deadtime_signal::time::SampleTime;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Packets at intervals of 0.5 to 1.5 s, in order, some lost. Exponential delays have a mean of 0.04 s above 0.1 s.
    fn packets(count: usize, lost: f64, seed: u64) -> Experiment<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut sent, mut seen, mut t, mut last) = (Vec::new(), Vec::new(), 0.0, 0.0_f64);
        for _ in 0..count {
            t += rng.random_range(0.5..1.5);
            sent.push(t);
            last = last.max(t + 0.1 - 0.04 * rng.random::<f64>().max(1e-12).ln());
            if rng.random::<f64>() >= lost {
                seen.push(last);
            }
        }
        let events = vec![Events { first: sent, second: seen, ..Events::default() }];
        Experiment::of_events(SampleTime::new(1.0).unwrap(), ["sent", "seen"], events)
            .unwrap()
            .with_sample_time(SampleTime::new(0.01).unwrap())
    }

    fn search() -> Search {
        Search { max_delay: 300, ..Search::default() }
    }

    /// 0.1 − 0.04·ln(1 − q) lies in 90 to 99 % of 200 intervals; correct 95 % intervals violate this once in 1000 times.
    #[test]
    fn intervals_hold_the_quantiles_of_an_exponential_law() {
        let found: Vec<Jitter> =
            (0..200).map(|seed| Jitter::of(&packets(400, 0.0, seed), &search()).unwrap()).collect();
        for (at, share) in SHARES.into_iter().enumerate().take(3) {
            let truth = 0.1 - 0.04 * (1.0 - share).ln();
            let holds = |j: &&Jitter| matches!(j.quantiles[at].ci95_s, [Some(low), Some(high)] if low <= truth && truth <= high);
            let held = found.iter().filter(holds).count();
            assert!((180..=198).contains(&held), "{held} of 200 hold {truth}");
        }
        assert!(found.iter().all(|j| j.longest_s.is_none() && j.events == 400));
    }

    /// With lost packets every pair is correct, and the pairing reports its longest resolvable delay.
    #[test]
    fn lost_events_leave_the_rest_paired() {
        let found = Jitter::of(&packets(400, 0.01, 7), &search()).unwrap();
        assert!((385..400).contains(&found.events), "{}", found.events);
        assert!(found.longest_s.is_some_and(|l| (0.3..0.5).contains(&l)), "{:?}", found.longest_s);
        assert!(
            (found.quantiles[1].delay_s - (0.1 + 0.04 * 2.0_f64.ln())).abs() < 0.01,
            "{found:?}"
        );
    }

    /// Twelve events leave the 99 % quantile open.
    #[test]
    fn a_far_quantile_of_few_events_is_open() {
        let found = Jitter::of(&packets(14, 0.0, 3), &search()).unwrap();
        assert_eq!(found.quantiles[3].ci95_s[1], None);
        assert!(found.quantiles[1].ci95_s.iter().all(Option::is_some), "{found:?}");
    }

    #[test]
    fn unrelated_events_have_no_delays() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut times = || {
            (0..100)
                .scan(0.0, |t, _| {
                    *t += rng.random_range(0.5..1.5);
                    Some(*t)
                })
                .collect::<Vec<f64>>()
        };
        let events = vec![Events { first: times(), second: times(), ..Events::default() }];
        let experiment =
            Experiment::of_events(SampleTime::new(1.0).unwrap(), ["a", "b"], events).unwrap();
        assert_eq!(Jitter::of(&experiment, &Search::default()), None);
    }
}

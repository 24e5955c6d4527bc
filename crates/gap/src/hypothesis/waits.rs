//! Lost or late: the evidence of the waits of commands, decoded from the outputs.
//!
//! A command that is missing for several samples may have been lost repeatedly, each time with the same probability, or in a burst. Its own delay may also be
//! that long. All these hypotheses have the same trajectories, and differ in the probability of the waits. Each has the same form of score: minus twice the
//! log-probability of all waits, plus the logarithm of their number per parameter (Schwarz 1978, doi:10.1214/aos/1176344136). A distribution of delays of any
//! shape is coded predictively (Krichevsky and Trofimov 1981, doi:10.1109/TIT.1981.1056331).
//!
//! How it can be wrong: a command that changes again before it arrives hides its wait. A command without a visible response has no weight. Neither is counted.
//! Few waits carry little evidence: the scores then differ by less than the threshold, and the hypotheses form one class.

use statrs::distribution::{ContinuousCDF, Normal};

use deadtime_model::simulate::Losses;

/// A command that shows, from when it was sent until it was there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wait {
    /// When it was sent, seconds of its log.
    pub(crate) sent_s: f64,
    /// For so many samples it was not there.
    pub(crate) samples: usize,
    /// The number of samples before it without evidence of arrivals; `None`: since the log began.
    pub(crate) rested: Option<usize>,
    /// The log's sample time, seconds.
    pub(crate) sample_time_s: f64,
}

/// No distribution of delays is narrower than this, in samples: a wait is known to a sample only.
const NARROWEST: f64 = 0.3;
/// Golden sections of a search: to a millionth of the interval.
const SECTIONS: usize = 30;
/// No wait is less probable than this.
const IMPROBABLE: f64 = 1e-12;

/// Twice the negative log-probability of the waits where each sample is lost as likely as any other, or as the one before it was.
pub(crate) fn as_lost(waits: &[Wait]) -> f64 {
    as_lost_alone(waits).min(in_bursts(waits))
}

/// Losses with a memory, where the waits support them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bursts {
    pub(crate) losses: Losses,
    /// Standard deviations of the probability and of the mean length.
    pub(crate) std: [f64; 2],
}

impl Bursts {
    /// `None` where losses of each command for itself make the waits as probable. `cut`: losses that lasted at least so long.
    pub(crate) fn of(waits: &[Wait], cut: &[Wait]) -> Option<Self> {
        (in_bursts(waits) < as_lost_alone(waits)).then(|| Self::likeliest(waits, cut))
    }

    /// A loss goes on by the waits themselves; its probability is where the beginnings are likeliest.
    fn likeliest(waits: &[Wait], cut: &[Wait]) -> Self {
        let begun = waits.iter().filter(|w| w.samples > 0).count() as f64;
        let further: f64 =
            waits.iter().chain(cut).map(|w| w.samples.saturating_sub(1) as f64).sum();
        let goes_on = (further + 0.5) / (further + begun + 1.0);
        let burst = (1.0 - goes_on).recip();
        let of = |probability: f64| Losses { probability, burst: Some(burst) };
        // No more than where each command that arrives is followed by a loss.
        let most = burst / (1.0 + burst);
        let cost = |p: f64| beginnings(waits, &of(p)) + beginnings(cut, &of(p));
        let probability = lowest(cost, [1e-4 * most, (1.0 - 1e-4) * most]);
        let h = 0.02 * probability.min(most - probability);
        let bend = (cost(probability + h) - 2.0 * cost(probability) + cost(probability - h))
            / (2.0 * h * h);
        let of_length =
            burst.powi(2) * (goes_on * (1.0 - goes_on) / (further + begun).max(1.0)).sqrt();
        Self {
            losses: of(probability),
            std: [bend.max(f64::MIN_POSITIVE).sqrt().recip().min(0.5), of_length],
        }
    }
}

/// Twice the negative log-probability of the times at which losses begin. After g samples of rest a command is lost with probability p·(1 − ρ^(g+1)), with the
/// correlation ρ from sample to sample.
fn beginnings(waits: &[Wait], losses: &Losses) -> f64 {
    let [begins, goes_on] = losses.begins_and_goes_on();
    let lost = |rested: Option<usize>| {
        let known = rested
            .map_or(0.0, |g| (goes_on - begins).powi(i32::try_from(g + 1).unwrap_or(i32::MAX)));
        (losses.probability * (1.0 - known)).clamp(IMPROBABLE, 1.0 - IMPROBABLE)
    };
    let cost =
        |w: &Wait| if w.samples > 0 { lost(w.rested).ln() } else { (1.0 - lost(w.rested)).ln() };
    -2.0 * waits.iter().map(cost).sum::<f64>()
}

/// Where a function of one minimum is lowest, by golden sections (Kiefer 1953, doi:10.1090/S0002-9939-1953-0055639-3).
fn lowest(f: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..SECTIONS {
        let (left, right) = (high - ratio * (high - low), low + ratio * (high - low));
        if f(left) < f(right) {
            high = right;
        } else {
            low = left;
        }
    }
    0.5 * (low + high)
}

/// The same with a separate delay of every command: of a normal distribution, or of any.
pub(crate) fn as_late(waits: &[Wait]) -> f64 {
    normal(waits).min(any(waits))
}

/// Mean and standard deviation of the waits, seconds.
pub(crate) fn delay_and_spread(waits: &[Wait]) -> [f64; 2] {
    let seconds = || waits.iter().map(|w| w.samples as f64 * w.sample_time_s);
    moments(seconds, waits.len())
}

/// Several commands waited, and none longer than another by more than a wait is known to.
pub(crate) fn steady(waits: &[Wait]) -> bool {
    let [mean, spread] = moments(|| waits.iter().map(|w| w.samples as f64), waits.len());
    waits.len() > 2 && mean > 0.0 && spread < NARROWEST
}

fn moments<I: Iterator<Item = f64>>(values: impl Fn() -> I, count: usize) -> [f64; 2] {
    let count = count.max(1) as f64;
    let mean = values().sum::<f64>() / count;
    [mean, (values().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt()]
}

fn parameters(count: usize, waits: &[Wait]) -> f64 {
    count as f64 * (waits.len().max(2) as f64).ln()
}

/// Independent losses: a geometric distribution. Laplace's rule keeps the probability off its edges.
pub(crate) fn as_lost_alone(waits: &[Wait]) -> f64 {
    let lost: f64 = waits.iter().map(|w| w.samples as f64).sum();
    let passed = waits.len() as f64;
    binary(lost, passed) + parameters(1, waits)
}

/// Losses with a memory (Gilbert 1960, doi:10.1002/j.1538-7305.1960.tb03959.x): one probability that a loss begins, another that it goes on.
fn in_bursts(waits: &[Wait]) -> f64 {
    let begun = waits.iter().filter(|w| w.samples > 0).count() as f64;
    let further: f64 = waits.iter().map(|w| w.samples.saturating_sub(1) as f64).sum();
    beginnings(waits, &Bursts::likeliest(waits, &[]).losses)
        + binary(further, begun)
        + parameters(2, waits)
}

/// Twice the negative log-likelihood of so many losses and passes.
fn binary(lost: f64, passed: f64) -> f64 {
    let p = (lost + 0.5) / (lost + passed + 1.0);
    -2.0 * (lost * p.ln() + passed * (1.0 - p).ln())
}

/// Whole samples of a normal distribution; what would come before it was sent comes at once.
fn normal(waits: &[Wait]) -> f64 {
    let [mean, spread] = moments(|| waits.iter().map(|w| w.samples as f64), waits.len());
    let spread = spread.max(NARROWEST);
    let standard = Normal::standard();
    let below = |samples: f64| standard.cdf((samples - mean) / spread);
    let probability = |w: &Wait| {
        let k = w.samples as f64;
        let before = if w.samples == 0 { 0.0 } else { below(k - 0.5) };
        (below(k + 0.5) - before).max(IMPROBABLE)
    };
    -2.0 * waits.iter().map(|w| probability(w).ln()).sum::<f64>() + parameters(2, waits)
}

/// Each wait with the frequency of the earlier ones.
fn any(waits: &[Wait]) -> f64 {
    let kinds = waits.iter().map(|w| w.samples).max().map_or(1, |most| most + 1);
    let mut seen = vec![0.5; kinds];
    let mut price = 0.0;
    for (count, wait) in waits.iter().enumerate() {
        price -= 2.0 * (seen[wait.samples] / (count as f64 + 0.5 * kinds as f64)).ln();
        seen[wait.samples] += 1.0;
    }
    price
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::criteria::Criteria;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::StandardNormal;

    fn waits(samples: impl IntoIterator<Item = usize>) -> Vec<Wait> {
        samples
            .into_iter()
            .map(|samples| Wait { sent_s: 0.0, samples, rested: Some(0), sample_time_s: 0.02 })
            .collect()
    }

    fn drawn(seed: u64, draw: impl Fn(&mut ChaCha8Rng) -> usize) -> Vec<Wait> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        waits((0..60).map(|_| draw(&mut rng)).collect::<Vec<_>>())
    }

    /// Sixty waits of each kind, over draws: the kind that made them is the cheaper one.
    #[test]
    fn the_kind_that_made_the_waits_is_the_cheaper_one() {
        let losses = |p: f64| {
            move |rng: &mut ChaCha8Rng| (0..200).take_while(|_| rng.random::<f64>() < p).count()
        };
        let bursts = |rng: &mut ChaCha8Rng| {
            if rng.random::<f64>() < 0.8 { 0 } else { 1 + losses(0.75)(rng) }
        };
        let late = |mean: f64, spread: f64| {
            move |rng: &mut ChaCha8Rng| {
                (mean + spread * rng.sample::<f64, _>(StandardNormal)).round().max(0.0) as usize
            }
        };
        let jumps = |rng: &mut ChaCha8Rng| if rng.random::<f64>() < 0.5 { 5 } else { 15 };
        for seed in 0..20 {
            // Where losses are few, almost every wait is one sample: the two hypotheses may be indistinguishable, and neither is preferred.
            let few = drawn(seed, losses(0.2));
            assert!(
                as_lost(&few) < as_late(&few) + Criteria::default().equals,
                "seed {seed}: {} as lost, {} as late",
                as_lost(&few),
                as_late(&few)
            );
            for lost in [drawn(seed, losses(0.5)), drawn(seed, losses(0.8)), drawn(seed, bursts)] {
                assert!(
                    as_lost(&lost) < as_late(&lost),
                    "seed {seed}: {} as lost, {} as late",
                    as_lost(&lost),
                    as_late(&lost)
                );
            }
            for late in
                [drawn(seed, late(5.0, 1.0)), drawn(seed, late(8.0, 3.0)), drawn(seed, jumps)]
            {
                assert!(
                    as_late(&late) < as_lost(&late),
                    "seed {seed}: {} as late, {} as lost",
                    as_late(&late),
                    as_lost(&late)
                );
            }
        }
    }

    #[test]
    fn waits_that_are_all_alike_are_steady() {
        assert!(steady(&waits([5; 20])) && steady(&waits([vec![5; 20], vec![6]].concat())));
        assert!(
            !steady(&waits([0; 20]))
                && !steady(&waits([5, 6, 5, 6]))
                && !steady(&waits([5, 5]))
                && !steady(&[])
        );
    }

    #[test]
    fn nothing_is_known_of_no_waits() {
        assert!(as_lost(&[]).is_finite() && as_late(&[]).is_finite());
        assert_eq!(delay_and_spread(&[]), [0.0, 0.0]);
    }

    /// The observable waits of a link whose losses come in runs, with one change of commands in `every` samples.
    fn behind_bursts(p: f64, burst: f64, every: usize, seed: u64) -> Vec<Wait> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let [begins, goes_on] = Losses { probability: p, burst: Some(burst) }.begins_and_goes_on();
        let mut lost = rng.random::<f64>() < p;
        let (mut waits, mut rested, mut wait, mut open) = (Vec::new(), None, 0, false);
        for k in 0..4000_usize {
            lost = rng.random::<f64>() < if lost { goes_on } else { begins };
            open |= k.is_multiple_of(every);
            match (open, lost) {
                (true, true) => wait += 1,
                (true, false) => {
                    waits.push(Wait { sent_s: 0.0, samples: wait, rested, sample_time_s: 0.02 });
                    (rested, wait, open) = (Some(0), 0, false);
                }
                (false, _) => rested = rested.map(|g: usize| g + 1),
            }
        }
        waits
    }

    /// For rare and frequent changes of commands the 95 % intervals hold the truth in 88 to 99 % of 200 links. One in a thousand sets of good intervals would
    /// miss this range.
    #[test]
    fn the_probability_and_the_length_of_bursts_are_within_their_intervals() {
        for (p, burst, every) in [(0.2, 5.0, 1), (0.2, 5.0, 10), (0.5, 4.0, 3), (0.6, 8.0, 12)] {
            let found: Vec<Bursts> = (0..200)
                .filter_map(|seed| Bursts::of(&behind_bursts(p, burst, every, seed), &[]))
                .collect();
            assert!(found.len() >= 195, "{} of 200 at {p}, {burst}, {every}", found.len());
            let held = |of: &dyn Fn(&Bursts) -> [f64; 3]| {
                let inside = |f: &&Bursts| {
                    let [value, std, truth] = of(f);
                    (value - truth).abs() < 1.96 * std
                };
                found.iter().filter(inside).count() as f64 / found.len() as f64
            };
            let shares = [
                held(&|f| [f.losses.probability, f.std[0], p]),
                held(&|f| [f.losses.burst.unwrap(), f.std[1], burst]),
            ];
            assert!(
                shares.iter().all(|s| (0.88..=0.99).contains(s)),
                "{shares:?} at {p}, {burst}, {every}"
            );
        }
    }

    /// Losses of each command for itself are no bursts, but for one link in twenty.
    #[test]
    fn chance_alone_is_no_burst() {
        for (p, every) in [(0.2, 1), (0.5, 5), (0.7, 2)] {
            let found = (0..200)
                .filter(|seed| {
                    Bursts::of(&behind_bursts(p, 1.0 / (1.0 - p), every, *seed), &[]).is_some()
                })
                .count();
            assert!(found <= 20, "{found} of 200 at {p}, {every}");
        }
    }
}

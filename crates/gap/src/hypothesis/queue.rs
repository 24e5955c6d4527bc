//! The waits of commands with random delays that keep their order: mean, standard deviation, and correlation of successive waits.
//!
//! Equation: command k acts from a(k) = max(a(k − 1), t(k) + d(k)) on, d(k) gamma distributed. The moments of a(k) − t(k) are those of a draw of many commands.
//! How it can be wrong: by the sampling error of that draw, some per cent of the standard deviation.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::Distribution;

use deadtime_model::simulate::{Delays, Late};

/// Commands that are drawn.
const DRAWN: usize = 4000;
/// A spread is no larger than this multiple of its mean: beyond it most delays are none.
const MOST_UNEVEN: f64 = 1.5;
/// Upper limit of the estimated correlation of successive waits: a constant wait is a fixed delay.
const MOST_ALIKE: f64 = 0.99;

/// The waits of commands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waiting {
    pub(super) mean_s: f64,
    pub(super) std_s: f64,
    /// The correlation of the waits of one command and the next.
    pub(super) alike: f64,
}

impl Waiting {
    /// Of commands that are sent every `step_s`.
    pub(super) fn of(late: &Late, step_s: f64) -> Option<Self> {
        let delays = late.distribution()?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut latest_s = f64::NEG_INFINITY;
        let waits: Vec<f64> = (0..DRAWN)
            .map(|k| {
                let sent_s = k as f64 * step_s;
                let own_s = sent_s + delays.sample(&mut rng);
                latest_s = if late.ordered { latest_s.max(own_s) } else { own_s };
                latest_s - sent_s
            })
            .collect();
        let count = DRAWN as f64;
        let mean_s = waits.iter().sum::<f64>() / count;
        let together = |apart: usize| {
            waits.iter().zip(&waits[apart..]).map(|(a, b)| (a - mean_s) * (b - mean_s)).sum::<f64>()
                / count
        };
        let variance = together(0);
        let alike = (together(1) / variance).clamp(0.0, MOST_ALIKE);
        (variance > 0.0 && alike.is_finite()).then(|| Self {
            mean_s,
            std_s: variance.sqrt(),
            alike,
        })
    }
}

/// Halvings of the search range of a mean.
const HALVINGS: usize = 14;

/// The law with this spread and the given mean wait of its commands, and the wait. `None` where commands of that spread wait longer at any mean.
pub(super) fn waiting_for(
    mean_s: f64,
    spread_s: f64,
    ordered: bool,
    step_s: f64,
) -> Option<(Late, Waiting)> {
    let law = |delay_s: f64| Late { delay_s, spread_s, ordered, delays: Delays::Mean };
    let (mut low, mut high) = (spread_s / MOST_UNEVEN, mean_s);
    let waits = |delay_s: f64| Waiting::of(&law(delay_s), step_s);
    if low > high || waits(low)?.mean_s > mean_s {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if waits(middle)?.mean_s > mean_s { high = middle } else { low = middle }
    }
    let delay_s = 0.5 * (low + high);
    Some((law(delay_s), waits(delay_s)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    fn waiting(spread_s: f64, ordered: bool) -> Waiting {
        Waiting::of(&Late { delay_s: 0.3, spread_s, ordered, delays: Delays::Mean }, 0.1).unwrap()
    }

    /// Commands that never meet wait as they are drawn; where they meet those behind wait for those before them.
    #[test]
    fn commands_that_meet_wait_longer_and_alike() {
        let apart = waiting(0.01, true);
        assert!(
            (apart.mean_s - 0.3).abs() < 1e-3
                && (apart.std_s / 0.01 - 1.0).abs() < 0.05
                && apart.alike < 0.05,
            "{apart:?}"
        );
        let (free, queued) = (waiting(0.2, false), waiting(0.2, true));
        assert!(
            (free.mean_s - 0.3).abs() < 0.02
                && (free.std_s / 0.2 - 1.0).abs() < 0.06
                && free.alike < 0.05,
            "{free:?}"
        );
        assert!(queued.mean_s > 0.4 && queued.alike > 0.3, "{queued:?}");
        assert!(
            Waiting::of(
                &Late { delay_s: 0.3, spread_s: 0.0, ordered: true, delays: Delays::Mean },
                0.1
            )
            .is_none()
        );
    }

    /// The mean is found again from the waits, and no law waits less than its spread lets it.
    #[test]
    fn the_law_behind_a_mean_wait_is_found() {
        for spread_s in [0.01, 0.1, 0.2] {
            let there = waiting(spread_s, true);
            let (law, found) = waiting_for(there.mean_s, spread_s, true, 0.1).unwrap();
            assert!(
                (law.delay_s - 0.3).abs() < 1e-3 && (found.mean_s - there.mean_s).abs() < 1e-3,
                "{law:?} {found:?}"
            );
        }
        assert!(waiting_for(0.1, 0.5, true, 0.1).is_none());
    }
}

//! How often 95 % intervals hold the truth.

use deadtime::diagnose::FoundParameter;

/// What an interval claims.
const HELD: f64 = 0.95;
/// Fewer intervals hold the truth than `fewest` in so many draws of honest intervals, at most.
const BY_CHANCE: f64 = 0.01;

/// Intervals of several draws, and those that miss.
#[derive(Default)]
pub(crate) struct Coverage {
    count: usize,
    missed: Vec<String>,
}

impl Coverage {
    /// An interval absent holds nothing.
    pub(crate) fn interval(&mut self, what: &str, ci95: Option<[f64; 2]>, truth: f64) {
        self.count += 1;
        if !ci95.is_some_and(|[from, to]| from <= truth && truth <= to) {
            self.missed.push(format!("{what}: {truth} in {ci95:?}"));
        }
    }

    pub(crate) fn parameter(&mut self, what: &str, p: &FoundParameter, truth: f64) {
        self.interval(&format!("{what}, {}", p.name), p.ci95, truth);
    }

    /// Of `least` intervals or more, as many hold the truth as 95 % intervals do but for one set of draws in a hundred.
    #[track_caller]
    pub(crate) fn is_honest(&self, least: usize) {
        let held = self.count - self.missed.len();
        assert!(
            self.count >= least && held >= fewest(self.count),
            "{held} of {} intervals hold the truth: {:#?}",
            self.count,
            self.missed
        );
    }
}

/// The smallest number of which the binomial distribution has less than `BY_CHANCE` below it.
fn fewest(count: usize) -> usize {
    let mut probability = (1.0 - HELD).powi(count as i32);
    let mut below = 0.0;
    for held in 0..count {
        if below + probability > BY_CHANCE {
            return held;
        }
        below += probability;
        probability *= (count - held) as f64 / (held + 1) as f64 * HELD / (1.0 - HELD);
    }
    count
}

#[test]
fn of_a_hundred_intervals_eighty_nine_hold_the_truth_at_least() {
    // The binomial distribution of 100 and 0.95: 0.0043 lie below 89, 0.0115 below 90.
    assert_eq!((fewest(100), fewest(2)), (89, 1));
}

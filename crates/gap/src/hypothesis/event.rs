//! The time at which several parameters change at once.
//!
//! Let s be the signatures of the parameters and e the residual. One set of changes before a time T and another from T on leave |e|² − g(0, T) − g(T, end).
//! Here g(a, b) = cᵀG⁻¹c with c = Σ s·e and G = Σ s·sᵀ over the stretch. The event is at the time with the largest sum, less the reduction by one set over the
//! whole log. This is a generalised likelihood ratio on all parameters jointly (Basseville and Nikiforov 1993, Detection of Abrupt Changes, section 7.2).
//!
//! How it can be wrong: a signature is that of a small change over the whole log. A machine with memory smears the time over its memory length. A change
//! outside all parameters is projected on the parameters. The time and the values are therefore first guesses of jumps. These jumps are fitted and compared
//! like all others; the search decides which of the parameters step.

use nalgebra::{DMatrix, DVector};

/// The products of signatures and of a residual over a stretch of time.
#[derive(Debug, Clone)]
pub(crate) struct Stretch {
    /// Σ s·sᵀ.
    pub(crate) gram: DMatrix<f64>,
    /// Σ s·e.
    pub(crate) along: DVector<f64>,
}

impl Stretch {
    fn empty(count: usize) -> Self {
        Self { gram: DMatrix::zeros(count, count), along: DVector::zeros(count) }
    }

    fn add(&mut self, other: &Self) {
        self.gram += &other.gram;
        self.along += &other.along;
    }

    /// The shares of the signatures that fit best, and by how much the squared error falls. Directions that this stretch does not excite are held by a part of the
    /// whole log's information.
    fn best(&self, whole: &DMatrix<f64>) -> Option<(f64, DVector<f64>)> {
        let held = DMatrix::from_diagonal(&(whole.diagonal() * HELD));
        let shares = (&self.gram + held).cholesky()?.solve(&self.along);
        Some((shares.dot(&self.along), shares))
    }
}

/// Information on every parameter that no stretch is without, of that of the whole log.
const HELD: f64 = 1e-4;

/// An event, by stretches of equal length.
#[derive(Debug, Clone)]
pub(crate) struct Event {
    /// The first stretch behind it.
    pub(crate) stretch: usize,
    /// The reduction of the squared error by one set of changes throughout.
    pub(crate) one: f64,
    /// The further reduction by two sets.
    pub(crate) fall: f64,
    /// The shares of the signatures before it and from it on.
    pub(crate) shares: [DVector<f64>; 2],
}

/// The event that fits best, no closer than `margin` stretches to an end.
pub(crate) fn event(stretches: &[Stretch], margin: usize) -> Option<Event> {
    let count = stretches.first()?.along.len();
    let mut whole = Stretch::empty(count);
    stretches.iter().for_each(|s| whole.add(s));
    let (one, _) = whole.best(&whole.gram)?;
    let mut before = Stretch::empty(count);
    let mut found: Option<Event> = None;
    for (stretch, own) in stretches.iter().enumerate() {
        if (margin..stretches.len().saturating_sub(margin)).contains(&stretch) {
            let behind =
                Stretch { gram: &whole.gram - &before.gram, along: &whole.along - &before.along };
            let (Some(first), Some(second)) = (before.best(&whole.gram), behind.best(&whole.gram))
            else {
                before.add(own);
                continue;
            };
            let fall = first.0 + second.0 - one;
            if found.as_ref().is_none_or(|e| fall > e.fall) {
                found = Some(Event { stretch, one, fall, shares: [first.1, second.1] });
            }
        }
        before.add(own);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Stretches of ten samples of three signatures; the residual holds two of them from a stretch on.
    fn drawn(seed: u64, at: usize, size: f64) -> Vec<Stretch> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let one = |stretch: usize| {
            let mut found = Stretch::empty(3);
            for _ in 0..10 {
                let s = DVector::from_fn(3, |_, _| rng.sample::<f64, _>(StandardNormal));
                let step = if stretch >= at { size * (s[0] - 2.0 * s[2]) } else { 0.0 };
                let e = 0.5 * s[1] + step + rng.sample::<f64, _>(StandardNormal);
                found.gram += &s * s.transpose();
                found.along += s * e;
            }
            found
        };
        (0..100).map(one).collect()
    }

    #[test]
    fn an_event_is_found_where_it_was_drawn() {
        for seed in 0..20 {
            let at = 20 + usize::try_from(3 * seed).unwrap();
            let event = event(&drawn(seed, at, 0.7), 3).unwrap();
            assert!(event.stretch.abs_diff(at) <= 2, "{} for {at}", event.stretch);
            let [before, behind] = &event.shares;
            let off = |shares: &DVector<f64>, want: [f64; 3]| {
                (0..3).map(|i| (shares[i] - want[i]).abs()).fold(0.0, f64::max)
            };
            // Four standard deviations of a mean over the shorter side.
            let within = 4.0 / (10.0 * at.min(100 - at) as f64).sqrt();
            assert!(
                off(before, [0.0, 0.5, 0.0]) < within && off(behind, [0.7, 0.5, -1.4]) < within
            );
        }
    }

    /// Twice the log-likelihood of the largest of 100 such ratios: of three parameters, far below 40.
    #[test]
    fn without_an_event_little_is_gained() {
        let most = (0..50).map(|seed| event(&drawn(seed, 100, 0.0), 3).unwrap().fall);
        assert!(most.fold(0.0, f64::max) < 40.0);
    }
}

//! Staircase: levels, each held for a number of samples.
//!
//! u = level₁ for n₁ samples, then level₂ for n₂, …; the last one is held to the end.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// Set points as an operator gives them, and the step inputs of published benchmarks.
///
/// Fails when: all but the last piece do not fit into the requested samples.
///
/// Source: the steps of S. Björklund, 2003, LiU-TEK-LIC-2003:60, p. 70, are `[[0, 50], [1, 150], [-1, 150], [0, 150]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Staircase {
    /// Pairs of a level, in the input's unit, finite, and the number of samples at that level, at least 1. Default `[[0, 10], [1, 40], [-1, 40], [0, 10]]`.
    pub pieces: Vec<(f64, usize)>,
}

impl Default for Staircase {
    fn default() -> Self {
        Self { pieces: vec![(0.0, 10), (1.0, 40), (-1.0, 40), (0.0, 10)] }
    }
}

impl Excitation for Staircase {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        check::samples(samples)?;
        check::at_least("staircase", "pieces", self.pieces.len(), 1)?;
        let mut needed = 1_usize;
        for (at, &(level, held)) in self.pieces.iter().enumerate() {
            check::finite("staircase", "pieces", level)?;
            check::at_least("staircase", "pieces", held, 1)?;
            if at + 1 < self.pieces.len() {
                needed = needed.saturating_add(held);
            }
        }
        check::fits("staircase", needed, samples)?;
        let levels = self
            .pieces
            .iter()
            .flat_map(|&(level, held)| std::iter::repeat_n(level, held.min(samples)));
        let last = self.pieces.last().map_or(0.0, |p| p.0);
        Ok(levels.chain(std::iter::repeat(last)).take(samples).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn levels_follow_each_other_and_the_last_one_stays() {
        let staircase = Staircase { pieces: vec![(0.0, 2), (3.0, 1), (-1.0, 1)] };
        let u = staircase.generate(6, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        assert_eq!(u, [0.0, 0.0, 3.0, -1.0, -1.0, -1.0]);
    }

    #[test]
    fn pieces_that_do_not_fit_or_are_none_are_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let refused = Staircase::default().generate(90, rng);
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "staircase", needed: 91, got: 90 })
        );
        for pieces in [vec![], vec![(1.0, 0)], vec![(f64::NAN, 3)]] {
            assert!(Staircase { pieces }.generate(100, rng).is_err());
        }
    }
}

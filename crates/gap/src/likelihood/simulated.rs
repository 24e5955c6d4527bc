//! A cache of simulations: a search, its refits and its judgement repeat the same effects at the same values.
//!
//! How it can be wrong: a key that omits an input of the run. Every omitted input is the same for all runs of one likelihood and of
//! its clones (system, records, tolerance, the simulator's own effects). Values are compared bit by bit. Runs with known sequences are not cached.

use std::collections::HashMap;
use std::mem::{size_of, take};
use std::sync::{Mutex, PoisonError};

use nalgebra::DMatrix;

use deadtime_model::effect::Applied;

/// The inputs of a run.
#[derive(PartialEq, Eq, Hash)]
pub(super) struct Key {
    record: usize,
    samples: usize,
    effects: Vec<(&'static str, String, Vec<u64>)>,
}

impl Key {
    pub(super) fn new(record: usize, samples: usize, effects: &[Applied]) -> Self {
        let bits = |a: &Applied| a.values.iter().map(|v| v.to_bits()).collect();
        Self {
            record,
            samples,
            effects: effects
                .iter()
                .map(|a| (a.effect.name(), a.channel.clone(), bits(a)))
                .collect(),
        }
    }
}

/// Predicted outputs; `None`: the simulation failed.
type Outputs = Option<DMatrix<f64>>;

/// The runs of late, in two generations: where the young are many, the old ones go.
#[derive(Default)]
pub(super) struct Simulated {
    generations: Mutex<Generations>,
}

#[derive(Default)]
struct Generations {
    young: HashMap<Key, Outputs>,
    old: HashMap<Key, Outputs>,
    /// Bytes of the young.
    held: usize,
}

/// Bytes of a generation: two thousand runs of two outputs and 2000 samples. Chosen: more costs memory, less has runs made again.
const GENERATION: usize = 64 << 20;

impl Simulated {
    /// The outputs of a run, made where they are not known. `keep`: whether the new outputs may be kept.
    pub(super) fn of(
        &self,
        key: Key,
        make: impl FnOnce() -> Outputs,
        keep: impl FnOnce() -> bool,
    ) -> Outputs {
        let known = |g: &Generations| g.young.get(&key).or_else(|| g.old.get(&key)).cloned();
        if let Some(outputs) =
            known(&self.generations.lock().unwrap_or_else(PoisonError::into_inner))
        {
            return outputs;
        }
        let outputs = make();
        if keep() {
            let mut generations = self.generations.lock().unwrap_or_else(PoisonError::into_inner);
            // Failed runs hold a key, too.
            generations.held += size_of::<(Key, Outputs)>()
                + outputs.as_ref().map_or(0, |y| y.len() * size_of::<f64>());
            generations.young.insert(key, outputs.clone());
            if generations.held > GENERATION {
                generations.held = 0;
                generations.old = take(&mut generations.young);
            }
        }
        outputs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_made_once_and_the_oldest_are_forgotten() {
        let runs = Simulated::default();
        let mut made = 0;
        let mut ask = |record: usize, rows: usize| {
            let make = || {
                made += 1;
                Some(DMatrix::from_element(rows, 1, record as f64))
            };
            let y = runs.of(Key::new(record, rows, &[]), make, || true).unwrap();
            assert!(y.len() == rows && y[0] == record as f64);
            made
        };
        assert_eq!((ask(0, 3), ask(0, 3), ask(1, 3), ask(0, 4)), (1, 1, 2, 3));
        // A generation each: the second is the old one when the third came.
        let rows = GENERATION / size_of::<f64>() + 1;
        assert_eq!((ask(2, rows), ask(3, rows), ask(3, rows), ask(0, 3)), (4, 5, 5, 6));
    }

    #[test]
    fn what_must_not_be_kept_is_made_again() {
        let runs = Simulated::default();
        assert!(runs.of(Key::new(0, 1, &[]), || None, || false).is_none());
        assert!(runs.of(Key::new(0, 1, &[]), || Some(DMatrix::zeros(1, 1)), || true).is_some());
    }
}

//! The blocks of a study, counted and never listed: as little memory for 10^12 trials as for one.

use std::ops::Range;

/// Records of one setting that are made together, and written as one file: seconds of work between two writes at most.
pub(super) const BLOCK: usize = 25;

/// Trials of one setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) setting: usize,
    pub(super) first: usize,
    pub(super) end: usize,
}

/// All blocks in the order of settings and trials.
#[derive(Debug)]
pub(super) struct Blocks {
    /// One past the last block of every setting, and its trials.
    settings: Vec<(usize, usize)>,
}

impl Blocks {
    /// The blocks of settings with so many trials; `None` where they cannot be counted.
    pub(super) fn new(trials: impl Iterator<Item = usize>) -> Option<Self> {
        let mut end = 0_usize;
        let count = |trials: usize| {
            end = end.checked_add(trials.div_ceil(BLOCK))?;
            Some((end, trials))
        };
        Some(Self { settings: trials.map(count).collect::<Option<_>>()? })
    }

    pub(super) fn len(&self) -> usize {
        self.settings.last().map_or(0, |s| s.0)
    }

    pub(super) fn get(&self, number: usize) -> Option<Block> {
        let setting = self.settings.partition_point(|(end, _)| *end <= number);
        let (_, trials) = *self.settings.get(setting)?;
        let first = (number - self.of(setting).start) * BLOCK;
        Some(Block { setting, first, end: first.saturating_add(BLOCK).min(trials) })
    }

    /// The blocks of a setting.
    pub(super) fn of(&self, setting: usize) -> Range<usize> {
        let end = |setting: usize| self.settings.get(setting).map(|s| s.0);
        let start = setting.checked_sub(1).and_then(end).unwrap_or(0);
        start..end(setting).unwrap_or(start)
    }

    /// These blocks, in order.
    #[cfg(any(test, feature = "tables"))]
    pub(super) fn iter(&self, numbers: Range<usize>) -> impl Iterator<Item = Block> {
        (numbers.start..numbers.end.min(self.len())).filter_map(|number| self.get(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_hold_every_trial_once_and_in_order() {
        let trials = [1, 60, 25, 26];
        let blocks = Blocks::new(trials.into_iter()).unwrap();
        let listed: Vec<Block> = blocks.iter(0..usize::MAX).collect();
        let all = |setting: usize| (0..trials[setting]).map(move |trial| (setting, trial));
        let held = listed.iter().flat_map(|b| (b.first..b.end).map(|trial| (b.setting, trial)));
        assert!(held.eq((0..4).flat_map(all)));
        assert_eq!((listed.len(), blocks.len(), blocks.of(1), blocks.of(3)), (7, 7, 1..4, 5..7));
        assert!(blocks.get(7).is_none() && listed.iter().all(|b| b.end - b.first <= BLOCK));
    }

    #[test]
    fn as_many_trials_as_there_are_numbers_are_counted_or_refused() {
        let blocks = Blocks::new([usize::MAX].into_iter()).unwrap();
        let last = blocks.get(blocks.len() - 1).unwrap();
        assert_eq!(last.end, usize::MAX);
        assert!(Blocks::new(std::iter::repeat_n(usize::MAX, 26)).is_none());
    }
}

//! Values that repeat exactly.

use super::moments::mean;
use crate::input::record::LogRecord;

/// A channel is coarse where each of its values comes so often in the mean.
const COARSE: usize = 3;

/// One channel of one log, its samples in order; `index` are their places in the log.
pub(super) struct Trace<'a> {
    pub(super) record: &'a LogRecord,
    pub(super) index: Vec<usize>,
    pub(super) values: Vec<f64>,
}

/// A stretch of equal values, places in the trace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stretch {
    pub(super) from: usize,
    pub(super) to: usize,
}

impl Stretch {
    pub(super) fn len(self) -> usize {
        self.to - self.from
    }
}

impl<'a> Trace<'a> {
    pub(super) fn output(record: &'a LogRecord, i: usize) -> Self {
        let there = (0..record.time_s.len())
            .filter_map(|k| Some((k, record.measured_in(record.train, i, k)?)));
        let (index, values) = there.unzip();
        Self { record, index, values }
    }

    pub(super) fn input(record: &'a LogRecord, j: usize) -> Self {
        let there = (0..record.time_s.len())
            .filter(|&k| record.train.is_some_and(|s| s.holds(record.time_s[k])));
        let (index, values) = there.map(|k| (k, record.inputs[j][k])).unzip();
        Self { record, index, values }
    }

    pub(super) fn longest(&self) -> Option<Stretch> {
        let mut best: Option<Stretch> = None;
        let mut from = 0;
        for k in 1..=self.values.len() {
            if self.values.get(k) != self.values.get(from) {
                let here = Stretch { from, to: k };
                if best.is_none_or(|b| here.len() > b.len()) {
                    best = Some(here);
                }
                from = k;
            }
        }
        best
    }

    /// The part of neighbouring samples outside a stretch that are equal.
    pub(super) fn repeats(&self, outside: impl Fn(usize) -> bool) -> f64 {
        let pairs =
            self.values.windows(2).enumerate().filter(|(k, _)| outside(*k) && outside(k + 1));
        mean(pairs.map(|(_, w)| if w[0] == w[1] { 1.0 } else { 0.0 }))
    }

    /// It has so few different values that even noise repeats them.
    pub(super) fn is_coarse(&self) -> bool {
        let mut different = self.values.clone();
        different.sort_by(f64::total_cmp);
        different.dedup();
        COARSE * different.len() < self.values.len()
    }

    pub(super) fn smallest(&self) -> f64 {
        self.values.iter().copied().fold(f64::INFINITY, f64::min)
    }

    pub(super) fn largest(&self) -> f64 {
        self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Seconds from the log's first sample.
    pub(super) fn time_s(&self, at: usize) -> f64 {
        self.index.get(at).and_then(|&k| self.record.time_s.get(k)).copied().unwrap_or(0.0)
    }

    /// The places in the log that a stretch covers.
    pub(super) fn span(&self, s: Stretch) -> std::ops::Range<usize> {
        let at = |k: usize| self.index.get(k).copied().unwrap_or(0);
        at(s.from)..at(s.to.saturating_sub(1)) + 1
    }
}

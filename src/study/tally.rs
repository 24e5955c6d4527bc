//! Sums over the answers of a cell: as large after a million trials as after one.

use std::collections::BTreeMap;

use super::estimates::Row;
use super::plan::Scoring;
use crate::time::SampleTime;

/// What is kept of a cell's answers.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    pub(super) trials: usize,
    pub(super) flagged: usize,
    pub(super) wrong: usize,
    pub(super) intervals: usize,
    /// Errors that count, and Σe, Σe², Σe⁴.
    pub(super) scored: usize,
    sum: f64,
    square: f64,
    fourth: f64,
    largest: f64,
    /// Raw answers: count, mean, Σ(raw − mean)², updated as Welford (1962), doi:10.1080/00401706.1962.10490022: equal answers have a spread of exactly 0.
    raw: [f64; 3],
    holding: f64,
    bound: [f64; 2],
    time_s: f64,
    /// |e| in bins of 1.6 %: count and Σe². Whole samples have bins of their own.
    bins: BTreeMap<u64, [f64; 2]>,
}

/// Seconds by which an interval's end may miss the truth through rounding alone, in samples.
const ROUNDING: f64 = 1e-9;
/// Bits of a number that are dropped to find its bin: six of the mantissa stay.
const BIN: u32 = 46;
/// The normal number of a two-sided 95 % interval.
const Z: f64 = 1.959_963_984_540_054;

impl Tally {
    pub(super) fn add(&mut self, row: &Row, scoring: &Scoring, sample_time: SampleTime) {
        let ts = sample_time.seconds();
        self.trials += 1;
        self.flagged += usize::from(row.delay_s.is_none());
        self.time_s += row.time_s;
        let mut held = None;
        if let (Some(lo), Some(hi)) = (row.lo_s, row.hi_s) {
            let slack = ROUNDING * ts;
            let holds = lo - slack <= row.true_delay_s && row.true_delay_s <= hi + slack;
            self.intervals += 1;
            self.holding += f64::from(u8::from(holds));
            held = Some(holds);
        }
        if let Some(raw) = row.raw_s {
            let [count, mean, squares] = &mut self.raw;
            *count += 1.0;
            let off = raw - *mean;
            *mean += off / *count;
            *squares += off * (raw - *mean);
        }
        if let Some(bound) = row.bound_samples {
            self.bound[0] += 1.0;
            self.bound[1] += bound * bound;
        }
        if let Some(e) = row.error_samples {
            self.wrong += usize::from(row.delay_s.is_some() && e.abs() > scoring.wrong_samples && held != Some(true));
            self.scored += 1;
            self.sum += e;
            self.square += e * e;
            self.fourth += e.powi(4);
            self.largest = self.largest.max(e.abs());
            let bin = self.bins.entry(e.abs().to_bits() >> BIN).or_default();
            bin[0] += 1.0;
            bin[1] += e * e;
        }
    }

    #[allow(clippy::cast_precision_loss)]
    fn count(&self) -> f64 {
        self.scored as f64
    }

    pub(super) fn rms(&self) -> Option<f64> {
        (self.scored > 0).then(|| (self.square / self.count()).sqrt())
    }

    /// Mean square error and the standard deviation of that mean.
    fn mean_square(&self) -> Option<[f64; 2]> {
        let n = self.count();
        (n > 1.0).then(|| {
            let mean = self.square / n;
            [mean, ((self.fourth / n - mean * mean).max(0.0) / (n - 1.0)).sqrt()]
        })
    }

    /// 95 % interval of the root mean square error: the mean of the squares is nearly normal, and an error as large as the largest seen (a sample where none was) may
    /// have been missed by 3.7 chances in n.
    pub(super) fn rms_ci95(&self) -> Option<[f64; 2]> {
        let [mean, std] = self.mean_square()?;
        let unseen = if self.square == 0.0 { UNSEEN / self.count() } else { 0.0 };
        Some([(mean - Z * std).max(0.0).sqrt(), (mean + Z * std + unseen).sqrt()])
    }

    /// The root mean square error and its standard deviation.
    pub(super) fn rms_std(&self) -> Option<[f64; 2]> {
        let [mean, std] = self.mean_square()?;
        let rms = mean.sqrt();
        Some([rms, if rms > 0.0 { std / (2.0 * rms) } else { 0.0 }])
    }

    pub(super) fn bias(&self) -> Option<f64> {
        (self.scored > 0).then(|| self.sum / self.count())
    }

    pub(super) fn mean_raw_s(&self) -> Option<f64> {
        (self.raw[0] > 0.0).then_some(self.raw[1])
    }

    pub(super) fn std_raw_s(&self) -> Option<f64> {
        let [n, _, squares] = self.raw;
        (n > 1.0).then(|| (squares / (n - 1.0)).sqrt())
    }

    #[allow(clippy::cast_precision_loss)]
    pub(super) fn coverage95(&self) -> Option<f64> {
        (self.intervals > 0).then(|| self.holding / self.intervals as f64)
    }

    pub(super) fn bound_rms(&self) -> Option<f64> {
        (self.bound[0] > 0.0).then(|| (self.bound[1] / self.bound[0]).sqrt())
    }

    #[allow(clippy::cast_precision_loss)]
    pub(super) fn time_s(&self) -> Option<f64> {
        (self.trials > 0).then(|| self.time_s / self.trials as f64)
    }
}

/// −ln(2.5 %): of n records without an event, its chance is below this over n at 97.5 %.
const UNSEEN: f64 = 3.69;

/// What is left of cells when the worst of all their answers are left out: the bin at the border, the share of it that stays, and so every cell's root mean square.
pub(super) fn kept(tallies: &[&Tally], percent: f64) -> Vec<Option<f64>> {
    let mut all: BTreeMap<u64, f64> = BTreeMap::new();
    for (bin, [count, _]) in tallies.iter().flat_map(|t| &t.bins) {
        *all.entry(*bin).or_default() += count;
    }
    let mut left = all.values().sum::<f64>() * percent / 100.0;
    let mut border = (u64::MAX, 1.0);
    for (bin, count) in all {
        if left <= count {
            border = (bin, left / count);
            break;
        }
        left -= count;
    }
    // Equal errors of all cells are left out in equal shares, whatever the order of the cells.
    let of = |tally: &&Tally| {
        let (mut count, mut square) = (0.0, 0.0);
        for (bin, [n, s]) in &tally.bins {
            let share = match bin.cmp(&border.0) {
                std::cmp::Ordering::Less => 1.0,
                std::cmp::Ordering::Equal => border.1,
                std::cmp::Ordering::Greater => break,
            };
            count += share * n;
            square += share * s;
        }
        (count > 0.0).then(|| (square / count).sqrt())
    };
    tallies.iter().map(of).collect()
}

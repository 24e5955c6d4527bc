//! Sums over the answers of a cell: as large after a million trials as after one.

use std::collections::BTreeMap;

use super::estimates::Row;
use super::plan::Scoring;
use deadtime_signal::stats::NORMAL_95_EXACT;
use deadtime_signal::time::SampleTime;

/// The kept sums of a cell's answers.
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
    predicted: [f64; 2],
    time_s: f64,
    /// |e| in bins of 1.6 %: count and Σe². Whole samples have bins of their own.
    bins: BTreeMap<u64, [f64; 2]>,
}

/// Seconds by which an interval's end may miss the truth through rounding alone, in samples.
const ROUNDING: f64 = 1e-9;
/// Bits of a number that are dropped to find its bin: six of the mantissa stay.
const BIN: u32 = 46;
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
        for (sums, value) in
            [(&mut self.bound, row.bound_samples), (&mut self.predicted, row.predicted_samples)]
        {
            if let Some(value) = value {
                sums[0] += 1.0;
                sums[1] += value * value;
            }
        }
        if let Some(e) = row.error_samples {
            self.wrong += usize::from(
                row.delay_s.is_some() && e.abs() > scoring.wrong_samples && held != Some(true),
            );
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

    /// 95 % interval of the root mean square error. The mean of the squares is nearly normal. An error as large as the largest seen (a sample where none was)
    /// may have been missed with a probability of 3.7/n.
    pub(super) fn rms_ci95(&self) -> Option<[f64; 2]> {
        let [mean, std] = self.mean_square()?;
        let unseen = if self.square == 0.0 { UNSEEN / self.count() } else { 0.0 };
        Some([
            (mean - NORMAL_95_EXACT * std).max(0.0).sqrt(),
            (mean + NORMAL_95_EXACT * std + unseen).sqrt(),
        ])
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

    pub(super) fn coverage95(&self) -> Option<f64> {
        (self.intervals > 0).then(|| self.holding / self.intervals as f64)
    }

    pub(super) fn bound_rms(&self) -> Option<f64> {
        (self.bound[0] > 0.0).then(|| (self.bound[1] / self.bound[0]).sqrt())
    }

    pub(super) fn predicted_rms(&self) -> Option<f64> {
        (self.predicted[0] > 0.0).then(|| (self.predicted[1] / self.predicted[0]).sqrt())
    }

    pub(super) fn time_s(&self) -> Option<f64> {
        (self.trials > 0).then(|| self.time_s / self.trials as f64)
    }
}

/// −ln(2.5 %): of n records without an event, its chance is below this over n at 97.5 %.
const UNSEEN: f64 = 3.69;

/// Root mean squares of the cells without the largest errors of all their answers. The histogram bin at the limit and the retained share of that bin are common
/// to all cells.
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
    // Equal errors of all cells are left out in equal shares, for any order of the cells.
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

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use deadtime_delay::Outcome;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn row(error: f64) -> Row {
        Row {
            cell: 0,
            trial: 0,
            seed: 0,
            true_delay_s: 5.0,
            outcome: Outcome::Found,
            raw_s: Some(5.0 + error),
            delay_s: Some(5.0 + error),
            std_s: Some(1.0),
            lo_s: Some(4.0 + error),
            hi_s: Some(6.0 + error),
            error_samples: Some(error),
            bound_samples: Some(0.5),
            predicted_samples: None,
            time_s: 0.1,
        }
    }

    fn tally(errors: &[f64]) -> Tally {
        let mut tally = Tally::default();
        errors
            .iter()
            .for_each(|e| tally.add(&row(*e), &Scoring::default(), SampleTime::new(1.0).unwrap()));
        tally
    }

    #[test]
    fn sums_are_those_of_the_errors() {
        let t = tally(&[0.0, 3.0, -1.0, 0.5]);
        assert_abs_diff_eq!(t.rms().unwrap(), (10.25_f64 / 4.0).sqrt(), epsilon = 1e-12);
        assert_abs_diff_eq!(t.bias().unwrap(), 0.625, epsilon = 1e-12);
        // 3 is off by more than a sample and its interval, 7 … 9, leaves out 5; −1 is on the edge of its interval.
        assert_eq!((t.wrong, t.flagged, t.coverage95()), (1, 0, Some(0.75)));
        let spread =
            [5.0, 8.0, 4.0, 5.5_f64].map(|v| (v - 5.625).powi(2)).iter().sum::<f64>() / 3.0;
        assert_abs_diff_eq!(t.std_raw_s().unwrap(), spread.sqrt(), epsilon = 1e-12);
        assert_eq!(t.bound_rms(), Some(0.5));
    }

    #[test]
    fn intervals_of_the_root_mean_square_hold_it_about_95_times_of_100() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
        // Normal errors; and whole ones, one sample off in one record of eight.
        for (kind, truth) in [(0, 1.0), (1, 0.125_f64.sqrt())] {
            let mut held = 0;
            for _ in 0..2000 {
                let errors: Vec<f64> = (0..100)
                    .map(|_| normal(&mut rng))
                    .map(|e| if kind == 0 { e } else { f64::from(u8::from(e > 1.150_349_38)) })
                    .collect();
                let [a, b] = tally(&errors).rms_ci95().unwrap();
                held += u32::from(a <= truth && truth <= b);
            }
            // The normal approximation of a mean of 100 squares holds 93 % or so.
            assert!((1820..=1960).contains(&held), "kind {kind}: {held} of 2000");
        }
        let [a, b] = tally(&[0.0; 100]).rms_ci95().unwrap();
        assert!(
            a == 0.0 && b > 0.18 && b < 0.2,
            "no error in 100 records leaves one in 27 possible: {b}"
        );
    }

    #[test]
    fn the_worst_are_left_out_over_all_cells_and_equal_errors_in_equal_shares() {
        // 20 answers, 10 % left out: of the three errors of 4 two go, a third of each stays.
        let mut first = vec![0.0; 9];
        first.push(4.0);
        let mut second = vec![1.0; 8];
        second.extend([4.0, -4.0]);
        let (a, b) = (tally(&first), tally(&second));
        let kept90 = kept(&[&a, &b], 90.0);
        let share = 1.0_f64 / 3.0;
        assert_abs_diff_eq!(
            kept90[0].unwrap(),
            (16.0 * share / (9.0 + share)).sqrt(),
            epsilon = 1e-9
        );
        assert_abs_diff_eq!(
            kept90[1].unwrap(),
            ((8.0 + 32.0 * share) / (8.0 + 2.0 * share)).sqrt(),
            epsilon = 1e-9
        );
        let all = kept(&[&a, &b], 100.0);
        assert!(
            (all[0].unwrap() - a.rms().unwrap()).abs() < 1e-12
                && (all[1].unwrap() - b.rms().unwrap()).abs() < 1e-12
        );
        // Nothing of a cell whose answers are all worse than the border.
        assert_eq!(kept(&[&tally(&[0.0; 9]), &tally(&[7.0])], 90.0)[1], None);
    }
}

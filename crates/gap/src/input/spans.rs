//! The training span and the held-out span of every log, and the parts without weight.

use super::record::{LogRecord, Span};

/// The held-out part of each log, where no log is held out.
const HELD_BACK: f64 = 0.3;

/// 35 samples or half the settling time of the model, at most a tenth of the shortest log.
pub(crate) fn longest_delay(records: &[LogRecord], settling_s: f64) -> f64 {
    let samples = records.iter().map(|r| 35.0 * r.sample_time_s).fold(0.5 * settling_s, f64::max);
    records.iter().map(|r| 0.1 * r.duration_s()).fold(samples, f64::min)
}

/// The part of a held-out log from which its start and its nuisances are estimated, where there are nuisances; the rest is scored. A constant fitted to the
/// scored samples would excuse a wrong cause. A third: its variance is three times that of the whole, and twice as much is left to score.
const ESTIMATED_ANEW: f64 = 1.0 / 3.0;

/// How logs are divided.
pub(crate) struct Divide {
    /// There are held-out logs.
    pub(crate) held_out: bool,
    /// Something is to be estimated anew in every held-out log.
    pub(crate) anew: bool,
    /// The duration without weight at the start of every log, s.
    pub(crate) start_s: f64,
    /// The time in which the model settles, s.
    pub(crate) settling_s: f64,
    /// The simulator is a black box.
    pub(crate) black_box: bool,
}

impl Divide {
    /// Sets the training spans and returns the held-out ones, per record. The first `training` records are the training logs.
    ///
    /// A black box has no values after the last sample, and a fast clock needs them. The last `start_s` seconds of a black box therefore carry no weight
    /// either.
    pub(crate) fn set_spans(
        &self,
        records: &mut [LogRecord],
        training: usize,
    ) -> Vec<Option<Span>> {
        let mut held = Vec::with_capacity(records.len());
        for (at, record) in records.iter_mut().enumerate() {
            let end = record.duration_s() - if self.black_box { self.start_s } else { 0.0 };
            // A held-out log may be shorter than the longest delay of the training logs.
            let from_s = if at < training { self.start_s } else { self.start_s.min(0.5 * end) };
            let whole = Span { from_s, to_s: end };
            if at >= training && self.anew {
                let cut = from_s + ESTIMATED_ANEW * (end - from_s);
                record.anew = Some(Span { from_s, to_s: cut });
                held.push(Some(Span { from_s: cut + record.sample_time_s, to_s: end }));
            } else if at >= training {
                record.anew = Some(whole);
                held.push(Some(whole));
            } else if self.held_out {
                record.train = Some(whole);
                held.push(None);
            } else {
                let cut = (1.0 - HELD_BACK) * end;
                record.train = Some(Span { from_s: self.start_s, to_s: cut });
                held.push(Some(Span {
                    from_s: (cut + self.settling_s).min(0.5 * (cut + end)),
                    to_s: end,
                }));
            }
        }
        held
    }
}

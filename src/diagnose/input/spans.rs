//! What of every log is learnt from, what is held back, and what carries no weight.

use super::record::{LogRecord, Span};
use crate::diagnose::format::diagnosis::Holdout;

/// The part of each log that is held back where no log is held out.
const HELD_BACK: f64 = 0.3;

/// 35 samples or half the time in which the model settles, at most a tenth of the shortest log.
pub(in crate::diagnose) fn longest_delay(records: &[LogRecord], settling_s: f64) -> f64 {
    let samples = records.iter().map(|r| 35.0 * r.sample_time_s).fold(0.5 * settling_s, f64::max);
    records.iter().map(|r| 0.1 * r.duration_s()).fold(samples, f64::min)
}

/// Sets what is trained on and what is held back; the held-out parts by name.
///
/// What a black box does after the last sample is not known, and a clock that is ahead would show it: so much of its end carries no weight either.
pub(in crate::diagnose) fn set_spans(
    records: &mut [LogRecord],
    training: usize,
    held_out: bool,
    start_s: f64,
    settling_s: f64,
    black_box: bool,
) -> Vec<Holdout> {
    let mut holdouts = Vec::new();
    for (at, record) in records.iter_mut().enumerate() {
        let end = record.duration_s() - if black_box { start_s } else { 0.0 };
        let whole = Span { from_s: start_s, to_s: end };
        if at >= training {
            record.held = Some(whole);
        } else if held_out {
            record.train = Some(whole);
        } else {
            let cut = (1.0 - HELD_BACK) * end;
            record.train = Some(Span { from_s: start_s, to_s: cut });
            record.held = Some(Span { from_s: (cut + settling_s).min(0.5 * (cut + end)), to_s: end });
        }
        if let Some(span) = record.held {
            holdouts.push(Holdout { log: record.name.clone(), from_s: span.from_s, to_s: span.to_s });
        }
    }
    holdouts
}

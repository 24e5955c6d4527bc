//! Clocks of sensors and commands with a constant offset.

use super::evidence::{ALL, Evidence, result, short};
use super::one_sample_shift::is_one;
use super::timing::Timing;
use crate::format::diagnosis::{Check, CheckKind};

/// The share of a filter's correction that the lag alone must reach.
const PURE: f64 = 0.9;
/// The part of the residual after present and past commands that future commands must explain: no machine answers before the command.
const AHEAD: f64 = 0.15;
/// Lags that differ by this much beyond four times their standard deviations may be equal, samples. Half a sample is a whole one for an output with a direct
/// path.
const SAME: f64 = 0.5;
/// The least interval of a reported offset, samples: the accuracy of the interpolation.
const LEAST: f64 = 0.02;
/// A lag with a larger standard deviation is unused, samples.
const KNOWN: f64 = 0.25;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    let known: Vec<Timing> =
        e.timing.iter().flatten().filter(|t| t.is_late() || t.std < KNOWN).copied().collect();
    let ts = e.view.sample_time_s();
    if known.is_empty() {
        let text = e.timing.iter().flatten().map(|t| t.std).fold(f64::INFINITY, f64::min);
        if text.is_finite() {
            let finding = format!(
                "undecided: the outputs' lags are known to {} s only",
                short(2.0 * text * ts)
            );
            return vec![result(CheckKind::ClockOffset, ALL, None, finding)];
        }
    } else if known.iter().all(Timing::is_late) {
        found.extend(
            common(&known, ts)
                .map(|(ok, finding)| result(CheckKind::ClockOffset, ALL, ok, finding)),
        );
    }
    let bound = known.iter().map(|t| t.lag.abs() + 2.0 * t.std).fold(0.0, f64::max);
    let good = if known.iter().any(Timing::is_late) {
        "outputs are late by different times, so it is not the clocks".to_owned()
    } else {
        format!("commands and outputs are less than {} s apart", short(bound * ts))
    };
    e.timing_rest(CheckKind::ClockOffset, &mut found, &good);
    found
}

/// The finding on outputs that are all late or early: none unless by the same time.
fn common(known: &[Timing], ts: f64) -> Option<(Option<bool>, String)> {
    let weight = |t: &Timing| 1.0 / t.std.max(1e-3).powi(2);
    let total: f64 = known.iter().map(weight).sum();
    let lag = known.iter().map(|t| weight(t) * t.lag).sum::<f64>() / total;
    if !known.iter().all(|t| (t.lag - lag).abs() <= 4.0 * t.std + SAME) {
        return None;
    }
    // The differences of the outputs beyond their scatter determine the accuracy of the time.
    let apart = known.iter().map(|t| (t.lag - lag).abs()).fold(0.0, f64::max);
    let size = format!(
        "{} s (± {} s)",
        short(lag.abs() * ts),
        short(ts * apart.max(2.0 * (1.0 / total).sqrt()).max(LEAST))
    );
    if known.iter().all(is_one) {
        return Some((
            None,
            format!("commands and outputs are {size} apart, one sample: see one_sample_shift"),
        ));
    }
    if lag > 0.0 {
        return Some((
            None,
            format!(
                "commands and outputs are {size} apart, outputs late; a clock offset, a dead time and a lag look the same here"
            ),
        ));
    }
    let certain = known.iter().all(|t| t.pure >= PURE) && known.iter().any(|t| t.ahead >= AHEAD);
    let finding = if certain {
        format!(
            "the outputs answer {size} before the commands, which no machine does: the sensors' clock is behind, or the commands are logged late; shift one of them"
        )
    } else {
        format!(
            "the outputs come {size} earlier than the model says: a clock offset, or a model that is too slow"
        )
    };
    Some((certain.then_some(false), finding))
}

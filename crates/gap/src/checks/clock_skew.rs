//! Sensors' and commands' clocks that run at different rates: the lag grows.

use super::evidence::{ALL, Evidence, result, short};
use super::timing::Timing;
use crate::format::diagnosis::{Check, CheckKind};

/// The growth over a log that is worth a word, samples.
const GROWS: f64 = 0.5;
/// The least undetectable drift, in samples, that is reported.
const UNSEEN: f64 = 5.0;
/// Standard deviations from none: the stretches' lags are not quite normal.
const SURE: f64 = 6.0;
/// The part of the lags' variance that a straight line must explain; a jump in the middle reaches 0.75.
const STRAIGHT: f64 = 0.9;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    let known: Vec<Timing> = e.timing.iter().flatten().copied().collect();
    let grows = |t: &Timing| {
        (t.growth * t.length).abs() >= GROWS
            && t.growth.abs() > SURE * t.growth_std
            && t.straight >= STRAIGHT
    };
    let best = known.iter().min_by(|a, b| a.growth_std.total_cmp(&b.growth_std));
    let agree = |best: &Timing| {
        known
            .iter()
            .all(|t| (t.growth - best.growth).abs() <= SURE * t.growth_std.hypot(best.growth_std))
    };
    if let Some(t) = best.filter(|t| grows(t) && agree(t)) {
        let finding = format!(
            "outputs drift against the commands by {} ms per s (± {}), {} s over the log: the two clocks run at different rates, or a queue between them fills; put both on one \
             clock, and look for what queues",
            short(1e3 * t.growth),
            short(2e3 * t.growth_std),
            short(t.growth * t.length * e.view.sample_time_s())
        );
        found.push(result(CheckKind::ClockSkew, ALL, Some(false), finding));
    }
    let ts = e.view.sample_time_s();
    let bound = best.map_or(0.0, |t| (t.growth.abs() + SURE * t.growth_std) * t.length);
    if found.is_empty() && bound > UNSEEN {
        let finding = format!(
            "undecided: the outputs may drift against the commands by {} s over the log and it would not show",
            short(bound * ts)
        );
        found.push(result(CheckKind::ClockSkew, ALL, None, finding));
    }
    let good = format!(
        "outputs drift against the commands by less than {} s over the log",
        short(bound * ts)
    );
    e.timing_rest(CheckKind::ClockSkew, &mut found, &good);
    found
}

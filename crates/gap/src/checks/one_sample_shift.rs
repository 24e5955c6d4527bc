//! A channel that is one sample late or early: an off-by-one in a logger.

use super::evidence::{ALL, Evidence, result, short, uneven};
use super::timing::Timing;
use crate::format::diagnosis::{Check, CheckKind};

/// How close to one sample a lag must be, samples.
const NEAR: f64 = 0.1;
/// The share of a filter's correction that the lag alone must reach: a slower or faster plant needs more than a lag.
const PURE: f64 = 0.9;

/// The lag is one sample, to either side.
pub(super) fn is_one(t: &Timing) -> bool {
    t.is_sharp() && (t.lag.abs() - 1.0).abs() <= NEAR + 2.0 * t.std && t.is_late() && t.pure >= PURE
}

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let words = |t: &Timing| if t.lag > 0.0 { "late" } else { "early" };
    let mut found = Vec::new();
    let known: Vec<(usize, Timing)> =
        e.timing.iter().enumerate().filter_map(|(i, t)| Some((i, (*t)?))).collect();
    let hit: Vec<&(usize, Timing)> = known.iter().filter(|(_, t)| is_one(t)).collect();
    let common =
        |sign: f64| hit.len() == known.len() && hit.iter().all(|(_, t)| t.lag * sign > 0.0);
    let one = |t: &Timing| {
        format!(
            "{} ± {} samples of {} s",
            short(t.lag.abs()),
            short(2.0 * t.std),
            short(e.view.sample_time_s())
        )
    };
    if let Some((_, t)) = hit.first().filter(|_| common(1.0) || common(-1.0)) {
        let finding = format!(
            "all outputs come one sample {} ({}): look for an off-by-one where commands and outputs are logged; a dead time of one sample looks the same",
            words(t),
            one(t)
        );
        found.push(result(CheckKind::OneSampleShift, ALL, Some(false), finding));
    } else if known.iter().all(|(_, t)| t.is_sharp() && (is_one(t) || !t.is_late())) {
        // The others in step: half a sample of dead time is a whole one for an output with a direct path.
        for (i, t) in hit {
            let name = e.output(*i);
            let finding = format!(
                "`{name}` comes one sample {} ({}), other outputs do not: look for an off-by-one in its logger",
                words(t),
                one(t)
            );
            found.push(result(CheckKind::OneSampleShift, name, Some(false), finding));
        }
    }
    let blurred = known.iter().map(|(_, t)| t.std).fold(f64::INFINITY, f64::min);
    if found.is_empty() && blurred.is_finite() && !known.iter().any(|(_, t)| t.is_sharp()) {
        let finding = format!(
            "undecided: the outputs' lags are known to {} samples only",
            short(2.0 * blurred)
        );
        found.push(result(CheckKind::OneSampleShift, ALL, None, finding));
    }
    e.timing_rest(CheckKind::OneSampleShift, &mut found, "no output is one sample late or early");
    found
}

impl Evidence<'_> {
    /// The finding of a check of timing without a fault.
    pub(super) fn timing_rest(&self, check: CheckKind, found: &mut Vec<Check>, good: &str) {
        if !found.is_empty() {
            return;
        }
        let measured = self.timing.iter().flatten().count();
        let outcome = if measured > 0 {
            result(
                check,
                ALL,
                Some(true),
                format!("{good} (lags of {measured} of {} outputs measured)", self.timing.len()),
            )
        } else if self.search.is_none() {
            result(check, ALL, None, format!("undecided: {}", self.view.why_not))
        } else if !self.view.is_even() {
            result(check, ALL, None, uneven(""))
        } else {
            result(check, ALL, None, "undecided: no output goes with its model closely enough for its lag to be measured".to_owned())
        };
        found.push(outcome);
    }
}

//! The standing of an answer in the verdict: agreeing, differing, or left out, and why.

use deadtime_delay::report::{Estimate, Pair};
use deadtime_delay::{Condition, Outcome};
use deadtime_gap::listed;

/// The standing of a method's answer in the verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    /// Its interval holds the verdict's delay.
    Agrees,
    /// It is trusted, and its interval does not hold the verdict's delay.
    Differs,
    /// It has an answer that the verdict does not use.
    LeftOut,
    /// It has no answer.
    Silent,
}

impl Standing {
    pub(super) fn of(pair: &Pair, e: &Estimate) -> Self {
        let grounds = &pair.verdict.grounds;
        if grounds.agree.contains(&e.method) {
            Self::Agrees
        } else if grounds.differ.iter().any(|(method, _)| *method == e.method) {
            Self::Differs
        } else if e.outcome == Outcome::Found {
            Self::LeftOut
        } else {
            Self::Silent
        }
    }

    /// The word of a table.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::Differs => "differs",
            Self::LeftOut => "left out",
            Self::Silent => "–",
        }
    }

    /// The verdict uses the answer.
    pub(super) fn used(self) -> bool {
        matches!(self, Self::Agrees | Self::Differs)
    }
}

/// A verdict with a number that a trusted method supports.
#[must_use]
pub fn trusted(pair: &Pair) -> bool {
    let supports = |e: &Estimate| e.counts() && pair.verdict.grounds.agree.contains(&e.method);
    pair.verdict.delay_s.is_some() && pair.estimates.iter().any(supports)
}

/// The reason of an omission: the method's assumption, and its violation by the record. `None` where it has no answer.
pub(super) fn reason(e: &Estimate) -> Option<String> {
    if e.outcome != Outcome::Found {
        return None;
    }
    Some(match e.distrust.as_slice() {
        [] if e.contradicted => "its residuals contradict its model".to_owned(),
        [] => "a delay below one sample, and the record shows no direct path".to_owned(),
        conditions => {
            let parts: Vec<[&str; 2]> = conditions.iter().map(|c| assumption(*c)).collect();
            let of = |i: usize| listed(&parts.iter().map(|p| p[i].to_owned()).collect::<Vec<_>>());
            format!("assumes {}; {}", of(0), of(1))
        }
    })
}

/// The same with the number of methods: `12 methods assume a pure copy; this plant is slow`.
pub(super) fn counted(count: usize, reason: &str) -> String {
    match (count, reason.strip_prefix("assumes ")) {
        (1, Some(_)) => format!("1 method {reason}"),
        (1, None) => format!("1 method: {reason}"),
        (_, Some(rest)) => format!("{count} methods assume {rest}"),
        (_, None) => format!("{count} methods: {}", reason.replace("its ", "their ")),
    }
}

/// The assumption of a method that does not withstand this condition, and its violation by the record.
fn assumption(of: Condition) -> [&'static str; 2] {
    match of {
        Condition::UnstablePlant => ["a stable plant", "this one is unstable"],
        Condition::Integrating => ["a plant that settles", "this one integrates"],
        Condition::Feedback => ["an open loop", "the input depends on the output"],
        Condition::ColouredNoise => ["white noise", "residuals are correlated"],
        Condition::Dynamics => ["a pure copy", "this plant is slow"],
        Condition::MissingOutputs => ["every output sample", "some are missing"],
        Condition::OtherInputs => ["one input", "others move with it"],
        Condition::TwoSensors => ["a zero-order hold", "these may be two sensors of one signal"],
        Condition::InverseResponse => {
            ["a response without undershoot", "this one starts the other way"]
        }
    }
}

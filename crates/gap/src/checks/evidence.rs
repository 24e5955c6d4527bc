//! The inputs of all checks, and the common parts of their findings.

use super::faults;
use super::faults::Search;
use super::kinematics;
use super::timing::Timing;
use super::view::View;
use crate::format::diagnosis::{Check, CheckKind};
use deadtime_signal::remedy::{Message, Remedy};

/// The common evidence of all checks.
pub(super) struct Evidence<'a> {
    pub(super) view: View<'a>,
    /// `None` where the model cannot be simulated on the logs.
    pub(super) search: Option<Search>,
    /// The outputs that the model defines as derivatives of others.
    pub(super) relations: Vec<kinematics::Relation>,
    pub(super) kinematics: Vec<kinematics::Measured>,
    /// Per output.
    pub(super) timing: Vec<Option<Timing>>,
}

/// Every channel.
pub(super) const ALL: &str = "*";

pub(super) fn result(
    check: CheckKind,
    channel: &str,
    ok: Option<bool>,
    finding: impl Into<Message>,
) -> Check {
    Check { check, channel: channel.to_owned(), ok, finding: finding.into() }
}

/// The finding on an uneven log: undecided.
pub(super) fn uneven(what: &str) -> Message {
    Message::from(format!("undecided{what}: the time stamps are uneven; use "))
        .and(Remedy::Resample)
}

/// A number with three digits, as short as it can be.
pub(super) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

impl Evidence<'_> {
    pub(super) fn output(&self, i: usize) -> &str {
        self.view.system.outputs.get(i).map_or("", |p| p.name.as_str())
    }

    /// The outputs that do not agree with the model, each with the reason why they cannot be tested.
    pub(super) fn untestable(&self) -> Vec<(usize, String)> {
        let Some(search) = &self.search else {
            let why = self.view.why_not.to_owned();
            return (0..self.view.outputs()).map(|i| (i, why.clone())).collect();
        };
        let why = |i: usize| match search.fits[i] {
            None => Some(format!("`{}` or its model stands still", self.output(i))),
            Some(fit) if fit.along < faults::AGREES => Some(format!(
                "`{}` and its model are weakly correlated (correlation {} at best)",
                self.output(i),
                short(fit.along)
            )),
            Some(_) => None,
        };
        (0..self.view.outputs()).filter_map(|i| Some((i, why(i)?))).collect()
    }

    /// The finding of a check of the outputs without a fault: one line for all, or one for each output that cannot be tested.
    pub(super) fn rest(&self, check: CheckKind, found: &mut Vec<Check>, good: &str) {
        let named = |name: &str| {
            found.iter().any(|c| c.channel == name || c.finding.contains(&format!("`{name}`")))
        };
        let open: Vec<_> =
            self.untestable().into_iter().filter(|(i, _)| !named(self.output(*i))).collect();
        if open.is_empty() && found.is_empty() {
            found.push(result(check, ALL, Some(true), good.to_owned()));
        }
        // One reason of several outputs is one line.
        for (at, (i, why)) in open
            .iter()
            .enumerate()
            .filter(|(at, (_, why))| open[..*at].iter().all(|(_, said)| said != why))
        {
            let count = open[at..].iter().filter(|(_, other)| other == why).count();
            let (name, of) = if count > 1 {
                (ALL, format!(" of {count} outputs"))
            } else {
                (self.output(*i), String::new())
            };
            found.push(result(check, name, None, format!("undecided{of}: {why}")));
        }
    }
}

//! Checks that need no dynamics: the commonest and cheapest causes of a gap, looked at before any effect is fitted. They change no log.
//!
//! One file per check. What they look at is prepared once: the logs beside the nominal model ([`view`]), the outputs of which the model says that one is the
//! derivative of another ([`kinematics`]), the signs, units and places of channels that would make model and log go together ([`faults`]), and how late the
//! outputs are ([`timing`]).

mod axes;
mod clipped;
mod clock_offset;
mod clock_skew;
mod excitation;
mod faults;
mod inspection;
mod kinematics;
mod one_sample_shift;
mod runs;
mod sign;
mod stuck;
mod timing;
mod unit;
mod units;
mod view;

use super::data::Record;
use super::diagnosis::{Check, CheckKind};
use super::prediction::Prediction;
use crate::effect::Applied;
use crate::simulate::System;
use faults::Search;
use timing::Timing;
use view::View;

pub use inspection::{ChannelReport, Inspection, InspectionFormat, LogReport, Role, inspect};

/// What all checks look at.
struct Evidence<'a> {
    view: View<'a>,
    /// `None` where the model cannot be simulated on the logs.
    search: Option<Search>,
    kinematics: Vec<kinematics::Measured>,
    /// Per output.
    timing: Vec<Option<Timing>>,
}

type Checker = fn(&Evidence<'_>) -> Vec<Check>;

/// The checks, in the order in which they are reported.
const CHECKS: [Checker; 9] = [
    sign::check,
    axes::check,
    unit::check,
    one_sample_shift::check,
    clock_offset::check,
    clock_skew::check,
    stuck::check,
    clipped::check,
    excitation::check,
];

/// All checks on the training logs. `prediction`: as it is chosen from the simulator, whatever a diagnosis is asked for.
pub(super) fn all(system: &System, own: &[Applied], records: &[Record], prediction: Prediction) -> Vec<Check> {
    let view = View::new(system, own, records, prediction);
    if view.records.is_empty() {
        return Vec::new();
    }
    let search = Search::run(&view);
    let kinematics = kinematics::measure(&view);
    let timing = search.as_ref().map_or_else(|| vec![None; view.outputs()], |s| timing::measure(&view, s));
    let evidence = Evidence { view, search, kinematics, timing };
    CHECKS.iter().flat_map(|check| check(&evidence)).collect()
}

/// Every channel.
const ALL: &str = "*";

fn result(check: CheckKind, channel: &str, ok: Option<bool>, finding: String) -> Check {
    Check { check, channel: channel.to_owned(), ok, finding }
}

/// A number with three digits, as short as it can be.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

impl Evidence<'_> {
    fn output(&self, i: usize) -> &str {
        self.view.system.outputs.get(i).map_or("", |p| p.name.as_str())
    }

    /// The outputs that do not go with the model, each with the reason why nothing can be said of them.
    fn untestable(&self) -> Vec<(usize, String)> {
        let Some(search) = &self.search else {
            let why = self.view.why_not.to_owned();
            return (0..self.view.outputs()).map(|i| (i, why.clone())).collect();
        };
        let why = |i: usize| match search.fits[i] {
            None => Some(format!("`{}` or its model stands still", self.output(i))),
            Some(fit) if fit.along < faults::AGREES => {
                Some(format!("`{}` and its model hardly go together (correlation {} at best)", self.output(i), short(fit.along)))
            }
            Some(_) => None,
        };
        (0..self.view.outputs()).filter_map(|i| Some((i, why(i)?))).collect()
    }

    /// What a check of the outputs says where it found no fault: one line for all, or one for each that cannot be tested.
    fn rest(&self, check: CheckKind, found: &mut Vec<Check>, good: &str) {
        let named = |name: &str| found.iter().any(|c| c.channel == name || c.finding.contains(&format!("`{name}`")));
        let open: Vec<_> = self.untestable().into_iter().filter(|(i, _)| !named(self.output(*i))).collect();
        if open.is_empty() && found.is_empty() {
            found.push(result(check, ALL, Some(true), good.to_owned()));
        }
        for (i, why) in open {
            let name = self.output(i).to_owned();
            found.push(result(check, &name, None, format!("cannot be told: {why}")));
        }
    }
}

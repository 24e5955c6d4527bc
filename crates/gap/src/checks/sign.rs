//! A channel that has the other sign.

use super::evidence::{Evidence, result, short};
use super::faults::{Fault, FoundFault};
use super::kinematics::TOGETHER;
use crate::format::diagnosis::{Check, CheckKind};

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for f in e.search.iter().flat_map(|s| &s.faults) {
        if let Fault::TurnedUnit(port, factor) = f.fault {
            let name = port.name(&e.view);
            let finding = format!(
                "`{name}` has the other sign than in the model, and looks like {}; turn the column or the model round",
                factor.unit
            );
            found.push(result(CheckKind::Sign, &name, Some(false), finding));
        }
        if let Fault::Sign(port) = f.fault {
            let name = port.name(&e.view);
            let finding = format!(
                "`{name}` has the other sign than in the model: correlation {} as logged, {} turned round{}; turn the column or the model round",
                short(f.before),
                short(f.correlation),
                e.or_instead(f)
            );
            found.push(result(CheckKind::Sign, &name, Some(false), finding));
        }
    }
    for m in e.kinematics.iter().filter(|m| m.correlation.abs() > TOGETHER && m.slope[0] < 0.0) {
        let (of, rate) = (e.output(m.relation.of), e.output(m.relation.rate));
        let text = format!(
            "measured, the derivative of `{of}` is {} times what `{rate}` says it is",
            short(0.5 * (m.slope[0] + m.slope[1]))
        );
        match found.iter_mut().find(|c: &&mut Check| c.channel == of || c.channel == rate) {
            Some(check) => check.finding = check.finding.clone().and(format!("; {text}")),
            None => found.push(result(
                CheckKind::Sign,
                rate,
                Some(false),
                format!("`{of}` or `{rate}` has the other sign: {text}"),
            )),
        }
    }
    e.rest(CheckKind::Sign, &mut found, "every output moves the way the model says");
    found
}

impl Evidence<'_> {
    /// The faults that look the same.
    pub(super) fn or_instead(&self, found: &FoundFault) -> String {
        let other = |f: &Fault| {
            let names: Vec<String> =
                f.ports().iter().map(|p| format!("`{}`", p.name(&self.view))).collect();
            match f {
                Fault::Sign(_) => format!("the sign of {}", names.join("")),
                Fault::Unit(_, factor) => format!("{} in {}", names.join(""), factor.unit),
                Fault::TurnedUnit(_, factor) => {
                    format!("{} turned round and in {}", names.join(""), factor.unit)
                }
                Fault::Swap(..) => format!("{} swapped", names.join(" and ")),
            }
        };
        let others: Vec<String> = found.instead.iter().map(other).collect();
        if others.is_empty() {
            String::new()
        } else {
            format!(" (looks the same: {})", others.join(", or "))
        }
    }
}

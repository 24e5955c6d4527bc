//! A channel in another unit.

use super::evidence::{Evidence, result, short};
use super::faults::{AGREES, Fault, Port, agrees};
use super::kinematics::{Relation, TOGETHER};
use super::units::{Factor, alternatives};
use crate::format::diagnosis::{Check, CheckKind};

/// How close a measured factor between two sensors comes to that of a unit; nothing but their own gains lies between.
const CLOSE: f64 = 1.15;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for f in e.search.iter().flat_map(|s| &s.faults) {
        if let Fault::Unit(port, factor) | Fault::TurnedUnit(port, factor) = f.fault {
            let name = port.name(&e.view);
            let turned =
                if matches!(f.fault, Fault::TurnedUnit(..)) { " with the other sign" } else { "" };
            let says = port
                .unit(&e.view)
                .map_or_else(|| "gives no unit".to_owned(), |u| format!("says {u}"));
            let finding = format!(
                "`{name}` looks like {}{turned} where the model {says} (factor {}; measured over modelled {}, correlation {}){}; convert the column",
                factor.unit,
                short(factor.factor),
                short(f.ratio),
                short(f.correlation),
                e.or_instead(f)
            );
            found.push(result(CheckKind::Unit, &name, Some(false), finding));
        }
    }
    kinematic(e, &mut found);
    for (i, fit) in e.search.iter().flat_map(|s| s.fits.iter().enumerate()) {
        let Some(fit) = fit.filter(|f| f.along >= AGREES && !agrees(f)) else { continue };
        let name = e.output(i);
        if found.iter().all(|c| c.channel != name) {
            let finding = format!(
                "`{name}` moves {} times as far as the model says, which is no factor between units known here: a gain, or a unit",
                short(fit.ratio)
            );
            found.push(result(CheckKind::Unit, name, None, finding));
        }
    }
    e.rest(CheckKind::Unit, &mut found, "every output moves about as far as the model says");
    found
}

/// The units in which one of two sensors may be, where measured change over integral is `slope`; nothing where it is near 1.
pub(super) fn guesses(e: &Evidence<'_>, relation: Relation, slope: f64) -> Vec<String> {
    let near = |factor: f64| (slope / factor).ln().abs() <= CLOSE.ln();
    // The one in another unit multiplies, the other divides.
    let guess = |i: usize, inverse: bool| {
        let port = Port::Output(i);
        let fits = move |f: &Factor| near(if inverse { 1.0 / f.factor } else { f.factor });
        alternatives(port.unit(&e.view))
            .into_iter()
            .find(fits)
            .map(|f| format!("`{}` in {}", e.output(i), f.unit))
    };
    if near(1.0) {
        Vec::new()
    } else {
        [guess(relation.of, false), guess(relation.rate, true)].into_iter().flatten().collect()
    }
}

/// Two sensors of which the one is the derivative of the other.
fn kinematic(e: &Evidence<'_>, found: &mut Vec<Check>) {
    for m in e.kinematics.iter().filter(|m| m.correlation.abs() > TOGETHER) {
        let slope = (m.slope[0] * m.slope[1]).sqrt();
        let (of, rate) = (m.relation.of, m.relation.rate);
        let guesses = guesses(e, m.relation, slope);
        if guesses.is_empty() {
            continue;
        }
        let text = format!(
            "measured, the derivative of `{}` is {} times what `{}` says it is",
            e.output(of),
            short(slope),
            e.output(rate)
        );
        match found.iter_mut().find(|c| c.channel == e.output(of) || c.channel == e.output(rate)) {
            Some(check) => check.finding = check.finding.clone().and(format!("; {text}")),
            None => {
                let finding = format!("{text}: {}", guesses.join(", or "));
                found.push(result(CheckKind::Unit, e.output(rate), Some(false), finding));
            }
        }
    }
}

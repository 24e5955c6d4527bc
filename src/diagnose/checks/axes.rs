//! Channels that changed places.

use super::faults::Fault;
use super::{Evidence, result, short};
use crate::diagnose::diagnosis::{Check, CheckKind};

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for f in e.search.iter().flat_map(|s| &s.faults) {
        if let Fault::Swap(p, q) = f.fault {
            let (p, q) = (p.name(&e.view), q.name(&e.view));
            let finding = format!(
                "`{p}` and `{q}` have changed places: correlation {} as logged, {} exchanged{}; use --map {p}={q} --map {q}={p}",
                short(f.before),
                short(f.correlation),
                e.or_instead(f)
            );
            found.push(result(CheckKind::Axes, &p, Some(false), finding));
        }
    }
    for m in &e.kinematics {
        let Some((other, correlation)) = m.better else { continue };
        let (of, rate, other) = (e.output(m.relation.of), e.output(m.relation.rate), e.output(other));
        if found.iter().any(|c: &Check| [of, rate, other].iter().any(|n| c.finding.contains(&format!("`{n}`")))) {
            continue;
        }
        let finding = format!(
            "the model says that `{rate}` is the derivative of `{of}`, but in the log `{other}` is (correlation {} instead of {}); look for columns that changed places",
            short(correlation),
            short(m.correlation)
        );
        found.push(result(CheckKind::Axes, rate, Some(false), finding));
    }
    e.rest(CheckKind::Axes, &mut found, "every output goes with its own model");
    found
}

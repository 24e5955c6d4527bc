//! Channels that changed places.

use super::evidence::{Evidence, result, short};
use super::faults::{Fault, GOOD, SIZE, agreement};
use super::view::Columns;
use crate::format::diagnosis::{Check, CheckKind};
use deadtime_signal::remedy::{Message, Remedy};

/// Correlation of two outputs' models above which the outputs are indistinguishable: 95 % of the correlation above which no swap is searched.
const ALIKE: f64 = 0.95 * GOOD;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for f in e.search.iter().flat_map(|s| &s.faults) {
        if let Fault::Swap(p, q) = f.fault {
            let (p, q) = (p.name(&e.view), q.name(&e.view));
            let finding = format!(
                "`{p}` and `{q}` are swapped: correlation {} as logged, {} swapped{}; use ",
                short(f.before),
                short(f.correlation),
                e.or_instead(f)
            );
            let swapped = vec![(p.clone(), q.clone()), (q.clone(), p.clone())];
            let finding = Message::from(finding).and(Remedy::Columns { of: swapped });
            found.push(result(CheckKind::Axes, &p, Some(false), finding));
        }
    }
    for m in &e.kinematics {
        let Some((other, correlation)) = m.better else { continue };
        let (of, rate, other) =
            (e.output(m.relation.of), e.output(m.relation.rate), e.output(other));
        if found.iter().any(|c: &Check| {
            [of, rate, other].iter().any(|n| c.finding.contains(&format!("`{n}`")))
        }) {
            continue;
        }
        let finding = format!(
            "the model says that `{rate}` is the derivative of `{of}`, but in the log `{other}` is (correlation {} instead of {}); look for columns that changed places",
            short(correlation),
            short(m.correlation)
        );
        found.push(result(CheckKind::Axes, rate, Some(false), finding));
    }
    found.extend(super::turned::check(e));
    if found.is_empty() {
        found.extend(e.twins().into_iter().map(|(i, j)| {
            let (i, j) = (e.output(i), e.output(j));
            let finding = format!(
                "undecided: `{i}` and `{j}` move so much alike that either could be the other"
            );
            result(CheckKind::Axes, i, None, finding)
        }));
    }
    e.rest(CheckKind::Axes, &mut found, "every output goes with its own model");
    found
}

impl Evidence<'_> {
    /// Pairs of outputs whose models move alike, in the same size.
    fn twins(&self) -> Vec<(usize, usize)> {
        let Some(search) = &self.search else { return Vec::new() };
        let outputs = self.view.outputs();
        let alike = |i: usize, j: usize| {
            let other: Vec<Columns> =
                search.modelled.iter().map(|columns| vec![columns[j].clone(); outputs]).collect();
            self.view.fit(i, &search.modelled, &other).is_some_and(|f| agreement(&f, SIZE) >= ALIKE)
        };
        let pairs = (0..outputs).flat_map(|i| (i + 1..outputs).map(move |j| (i, j)));
        pairs.filter(|&(i, j)| alike(i, j)).collect()
    }
}

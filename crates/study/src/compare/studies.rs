//! Studies side by side, on the cells that all of them have. `study::Gate` decides whether a difference is significant.
//!
//! How this can be wrong: cells of one name but another meaning (a plant that changed) are no pair. Cells therefore count as shared only where their
//! definitions agree. A method that answers only easy records looks better, so the share without an answer is shown next to its error.

use serde::Serialize;

use crate::compare::CompareFormat;
use crate::results::{Cell, Study};
use deadtime_signal::stats;

/// Several studies side by side.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Studies {
    /// The format line.
    pub format: CompareFormat,
    /// The name of each.
    pub names: Vec<String>,
    /// The results of each.
    pub studies: Vec<StudyStanding>,
    /// Cells that all studies have, and that mean the same in all.
    pub shared: usize,
    /// Cells of any study that are left out, as others have no such cell.
    pub left_out: usize,
    /// Every method of the shared cells.
    pub methods: Vec<MethodRow>,
}

/// One of the studies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyStanding {
    /// Its plan.
    pub plan: String,
    /// Its seed.
    pub seed: u64,
    /// The program that ran it.
    pub program: String,
    /// Its cells.
    pub cells: usize,
}

/// A method over the shared cells; each list in the order of the studies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodRow {
    /// The method with its options.
    pub method: String,
    /// Its shared cells.
    pub cells: usize,
    /// Mean of the root mean square errors, samples, over the cells in which every study has one.
    pub rms_samples: Vec<Option<f64>>,
    /// Share of the records without an answer.
    pub no_answer: Vec<Option<f64>>,
    /// Share of the records with a wrong answer whose interval leaves out the truth.
    pub wrong: Vec<Option<f64>>,
    /// Mean share of the 95 % intervals that hold the truth.
    pub coverage95: Vec<Option<f64>>,
    /// Mean processor time of an estimate, s.
    pub time_s: Vec<Option<f64>>,
}

/// Studies side by side, each with its name.
#[must_use]
pub fn studies(named: &[(String, Study)]) -> Studies {
    let keyed: Vec<std::collections::HashMap<String, &Cell>> = named
        .iter()
        .map(|(_, study)| study.cells.iter().map(|c| (identity(c), c)).collect())
        .collect();
    let all = named.iter().flat_map(|(_, study)| study.cells.iter().map(identity));
    let every: std::collections::HashSet<String> = all.collect();
    // In the order of the first study.
    let first = named.first().map(|(_, study)| study.cells.as_slice()).unwrap_or_default();
    let mut methods: Vec<(String, Vec<Vec<&Cell>>)> = Vec::new();
    let mut shared = 0;
    for cell in first {
        let key = identity(cell);
        let Some(across) =
            keyed.iter().map(|cells| cells.get(&key).copied()).collect::<Option<Vec<&Cell>>>()
        else {
            continue;
        };
        shared += 1;
        let method = cell.method_text();
        match methods.iter_mut().find(|(name, _)| *name == method) {
            Some((_, cells)) => cells.push(across),
            None => methods.push((method, vec![across])),
        }
    }
    Studies {
        format: CompareFormat::V1,
        names: named.iter().map(|(name, _)| name.clone()).collect(),
        studies: named
            .iter()
            .map(|(_, s)| StudyStanding {
                plan: s.plan.clone(),
                seed: s.seed,
                program: s.program.clone(),
                cells: s.cells.len(),
            })
            .collect(),
        shared,
        left_out: every.len() - shared,
        methods: methods
            .into_iter()
            .map(|(method, cells)| row(method, &cells, named.len()))
            .collect(),
    }
}

/// The identity of cells of two studies: their keys and the definitions of the names in them.
fn identity(cell: &Cell) -> String {
    format!("{} {}", cell.key(), cell.definition)
}

fn row(method: String, cells: &[Vec<&Cell>], studies: usize) -> MethodRow {
    let mean = |value: &dyn Fn(&Cell) -> Option<f64>| -> Vec<Option<f64>> {
        // A cell without a value in one study is left out in all studies.
        let whole: Vec<Vec<f64>> =
            cells.iter().filter_map(|across| across.iter().map(|c| value(c)).collect()).collect();
        (0..studies)
            .map(|s| stats::mean(whole.iter().filter_map(|across| across.get(s).copied())))
            .collect()
    };
    let share = |count: &dyn Fn(&Cell) -> usize| {
        mean(&|c: &Cell| (c.trials > 0).then(|| count(c) as f64 / c.trials as f64))
    };
    MethodRow {
        method,
        cells: cells.len(),
        rms_samples: mean(&|c| c.rms_samples),
        no_answer: share(&|c| c.flagged),
        wrong: share(&|c| c.unflagged_wrong),
        coverage95: mean(&|c| c.coverage95),
        time_s: mean(&|c| c.time_per_estimate_s),
    }
}

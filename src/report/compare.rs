//! Results side by side as text of 80 columns.

use super::diagnosis::percent;
use super::study::{number, share, time};
use super::styled::{WIDTH, wrapped};
use super::text::{Table, estimate};
use deadtime_gap::{Mode, Strength};
use deadtime_study::compare::{
    CausePart, CauseRow, CauseValue, Diagnoses, MethodRow, ParameterRow, Studies,
};

/// Names that a sentence lists.
const NAMED: usize = 6;

/// The common parts and the differences of diagnoses, a sentence each.
#[must_use]
pub fn findings(found: &Diagnoses) -> Vec<String> {
    let mut said = Vec::new();
    let mode = found.diagnoses.first().map(|d| d.mode);
    if found.diagnoses.iter().any(|d| Some(d.mode) != mode) {
        said.push("Errors of free runs and of one-step predictions are not comparable.".to_owned());
    }
    let names = |rows: &[&CauseRow]| listed(rows.iter().map(|r| format!("`{}`", r.cause)));
    let common = found.common();
    let several = found.names.len() > 2;
    match (found.causes.is_empty(), common.is_empty()) {
        (true, _) => said.push("None of them has a cause.".to_owned()),
        (false, true) => said.push("No cause is in all of them.".to_owned()),
        (false, false) => said.push(format!("In all of them: {}.", names(&common))),
    }
    if let (false, [first, last]) = (several, found.names.as_slice()) {
        let [gone, new] = found.gone_and_new();
        if !gone.is_empty() {
            said.push(format!("Only in {first}: {}.", names(&gone)));
        }
        if !new.is_empty() {
            said.push(format!("Only in {last}: {}.", names(&new)));
        }
    } else {
        let some: Vec<String> = found
            .causes
            .iter()
            .filter(|c| c.parts.iter().any(Option::is_none))
            .map(|c| {
                format!(
                    "`{}` in {} of {}",
                    c.cause,
                    c.parts.iter().flatten().count(),
                    c.parts.len()
                )
            })
            .collect();
        if !some.is_empty() {
            said.push(format!("Not in all: {}.", listed(some.into_iter())));
        }
    }
    let differ: Vec<&ParameterRow> =
        found.parameters.iter().filter(|p| p.agree == Some(false)).collect();
    let agree = found.parameters.iter().filter(|p| p.agree == Some(true)).count();
    if !differ.is_empty() {
        let each = differ
            .iter()
            .map(|p| format!("{} of `{}` ({})", p.parameter, p.cause, chance(p.p_value)));
        said.push(format!("They differ by more than chance in {}.", listed(each)));
    }
    if agree > 0 {
        let what = if agree == 1 {
            "One number agrees".to_owned()
        } else {
            format!("{agree} numbers agree")
        };
        said.push(format!("{what} within the intervals."));
    }
    said
}

/// As one sentence holds them.
fn listed(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    match names.len().checked_sub(NAMED).filter(|more| *more > 0) {
        Some(more) => format!(
            "{}, and {more} more",
            names.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ")
        ),
        None => names.join(", "),
    }
}

pub(super) fn chance(p: Option<f64>) -> String {
    match p {
        Some(p) if p < 0.001 => "p < 0.001".to_owned(),
        Some(p) => format!("p = {p:.3}"),
        None => "not tested".to_owned(),
    }
}

/// For a terminal: the sentences, the results of each, the shares of the causes, the numbers.
#[must_use]
pub fn diagnoses(found: &Diagnoses) -> String {
    let mut text: String =
        findings(found).iter().map(|s| wrapped(s, WIDTH, 2).join("\n") + "\n").collect();
    let tables = [
        ("How each stands, held out (nrmse)", standings(found)),
        ("Causes, and their shares of the gap", shares(found)),
        ("Numbers of the causes", values(found)),
    ];
    for (title, table) in tables {
        if let Some(table) = table {
            text += &format!("\n{title}\n{}", table.fit(WIDTH));
        }
    }
    text
}

/// The errors and verdicts; `None` without any.
#[must_use]
pub fn standings(found: &Diagnoses) -> Option<Table> {
    let mut table = Table::new(
        &["diagnosis", "verdict", "before", "after", "noise", "shrink", "95 %"],
        &[0, 1],
    );
    for (name, d) in found.names.iter().zip(&found.diagnoses) {
        let mode = match d.mode {
            Mode::Simulation => "",
            Mode::Predictor => " (one step)",
            Mode::Horizon => " (horizon)",
        };
        let part = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), percent);
        let ends = d.ci95.map_or_else(
            || "–".to_owned(),
            |[low, high]| format!("{} to {}", percent(low), percent(high)),
        );
        table.row(vec![
            name.clone(),
            format!("{}{mode}", d.verdict),
            part(d.before),
            part(d.after),
            part(d.floor),
            part(d.fraction),
            ends,
        ]);
    }
    (!found.names.is_empty()).then_some(table)
}

/// Causes by diagnoses; `None` without any.
#[must_use]
pub fn shares(found: &Diagnoses) -> Option<Table> {
    let mut headings = vec!["cause"];
    headings.extend(found.names.iter().map(String::as_str));
    let mut table = Table::new(&headings, &[0]);
    for row in &found.causes {
        let mut cells = vec![row.cause.clone()];
        cells.extend(
            row.parts.iter().map(|part| part.as_ref().map_or_else(|| "–".to_owned(), part_text)),
        );
        table.row(cells);
    }
    (!found.causes.is_empty()).then_some(table)
}

pub(super) fn part_text(part: &CausePart) -> String {
    let share = part.share.map_or_else(|| "yes".to_owned(), percent);
    let weak = if part.strength == Some(Strength::Weak) { ", weak" } else { "" };
    let other = part.stands_in.as_ref().map_or_else(String::new, |other| format!(" as {other}"));
    format!("{share}{weak}{other}")
}

/// The numbers, a row for each and one for the common ones; `None` without any.
#[must_use]
pub fn values(found: &Diagnoses) -> Option<Table> {
    let mut headings = vec!["number", "unit"];
    headings.extend(found.names.iter().map(String::as_str));
    headings.extend(["agree", "mean", "spread"]);
    let mut table = Table::new(&headings, &[0, 1]);
    for row in &found.parameters {
        let mut cells = vec![format!("{} {}", row.cause, row.parameter), row.unit.clone()];
        cells.extend(
            row.values.iter().map(|v| v.as_ref().map_or_else(|| "–".to_owned(), value_text)),
        );
        cells.extend([agreement(row), mean_text(row), number(row.spread)]);
        table.row(cells);
    }
    (!found.parameters.is_empty()).then_some(table)
}

pub(super) fn value_text(v: &CauseValue) -> String {
    match estimate(v.value, v.ci95) {
        (value, Some([low, high])) => format!("{value} ({low} to {high})"),
        (value, None) => format!("{value} (at a bound)"),
    }
}

pub(super) fn agreement(row: &ParameterRow) -> String {
    let word = match row.agree {
        Some(true) => "yes",
        Some(false) => "no",
        None => return "not tested".to_owned(),
    };
    format!("{word}, {}", chance(row.p_value))
}

pub(super) fn mean_text(row: &ParameterRow) -> String {
    row.mean.map_or_else(
        || "–".to_owned(),
        |value| value_text(&CauseValue { value, ci95: row.mean_ci95 }),
    )
}

/// The cells of the comparison of studies, a sentence.
#[must_use]
pub fn shared_cells(found: &Studies) -> String {
    let left = match found.left_out {
        0 => String::new(),
        1 => "; 1 cell that not all have is left out".to_owned(),
        n => format!("; {n} cells that not all have are left out"),
    };
    match found.shared {
        0 => "The studies have no cell in common: other plants, delays, noise or methods, or a plan whose names stand for something else now.".to_owned(),
        n => format!("{n} cells are in all of them{left}. `deadtime gate` tells whether a difference is more than chance."),
    }
}

/// For a terminal: the compared cells, and every method.
#[must_use]
pub fn studies(found: &Studies) -> String {
    let mut text = wrapped(&shared_cells(found), WIDTH, 0).join("\n") + "\n";
    for measure in &MEASURES {
        if let Some(table) = by_method(found, measure) {
            text += &format!("\n{}\n{}", measure.name, table.fit(WIDTH));
        }
    }
    text
}

/// A number of every method.
pub(super) struct Measure {
    pub(super) name: &'static str,
    pub(super) of: fn(&MethodRow) -> &[Option<f64>],
    pub(super) text: fn(Option<f64>) -> String,
    /// Its axis is logarithmic.
    pub(super) log: bool,
    /// The value that is neither good nor bad.
    pub(super) from: Option<f64>,
}

pub(super) const MEASURES: [Measure; 5] = [
    Measure {
        name: "RMS error (samples)",
        of: |m| &m.rms_samples,
        text: number,
        log: true,
        from: None,
    },
    Measure { name: "no answer", of: |m| &m.no_answer, text: share, log: false, from: None },
    Measure { name: "wrong, unflagged", of: |m| &m.wrong, text: share, log: false, from: None },
    Measure {
        name: "truth in the 95 % interval",
        of: |m| &m.coverage95,
        text: share,
        log: false,
        from: Some(0.95),
    },
    Measure { name: "time per estimate", of: |m| &m.time_s, text: time, log: true, from: None },
];

/// Methods by studies; `None` where no study has the number.
pub(super) fn by_method(found: &Studies, measure: &Measure) -> Option<Table> {
    let mut headings = vec!["method", "cells"];
    headings.extend(found.names.iter().map(String::as_str));
    let mut table = Table::new(&headings, &[0]);
    let some: Vec<&MethodRow> =
        found.methods.iter().filter(|m| (measure.of)(m).iter().any(Option::is_some)).collect();
    for method in &some {
        let mut cells = vec![method.method.clone(), method.cells.to_string()];
        cells.extend((measure.of)(method).iter().map(|v| (measure.text)(*v)));
        table.row(cells);
    }
    (!some.is_empty()).then_some(table)
}

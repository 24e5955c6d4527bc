//! The result of a gate, as text and as Markdown.

use super::study::{number, share};
use super::styled::wrapped;
use super::text::Table;
use deadtime_study::{Finding, GateGroup, GateReport, Measured};

/// Columns that the text keeps to.
const WIDE: usize = 100;

/// One sentence: the comparison, and whether anything is worse.
#[must_use]
pub fn headline(report: &GateReport) -> String {
    let GateReport {
        plan,
        seeds: [before, after],
        alpha,
        cells,
        exact_cells,
        tests,
        worse,
        better,
        new_cells,
        groups,
        ..
    } = report;
    let mut methods: Vec<&str> =
        groups.iter().filter(|g| !g.new).map(|g| g.method.as_str()).collect();
    methods.sort_unstable();
    methods.dedup();
    let seeds = if before == after {
        format!("seed {before}")
    } else {
        format!("seeds {before} and {after}")
    };
    let standing = match (worse.len(), better.len()) {
        (0, 0) => "nothing is worse".to_owned(),
        (0, b) => format!("nothing is worse, {b} better"),
        (w, b) => format!("{w} worse, {b} better"),
    };
    let new = if *new_cells > 0 { format!(", {new_cells} new cells") } else { String::new() };
    format!(
        "{plan}: {} methods, {cells} cells ({exact_cells} without noise, compared exactly), {tests} tests of chance at {} % for all together, {seeds}{new}: {standing}.",
        methods.len(),
        100.0 * alpha
    )
}

/// The place of a finding: method, and cell.
fn place(finding: &Finding) -> String {
    let Finding { grid, place, method, cell, .. } = finding;
    cell.clone().unwrap_or_else(|| format!("{grid}, from {}: {method}, all cells", place.name()))
}

fn value(measured: Measured, value: Option<f64>) -> String {
    match measured {
        Measured::Cells => String::new(),
        Measured::RmsSamples => number(value),
        _ => share(value),
    }
}

fn with_interval(measured: Measured, of: Option<f64>, ci95: Option<[f64; 2]>) -> String {
    let interval = ci95.map_or_else(String::new, |[low, high]| {
        format!(" ({} … {})", number(Some(low)), number(Some(high)))
    });
    value(measured, of) + &interval
}

/// The change, in a line.
#[must_use]
pub fn line(finding: &Finding) -> String {
    let Finding { measured, before, after, before_count, after_count, p_value, .. } = finding;
    if *measured == Measured::Cells {
        let what =
            if finding.cell.is_none() { "the method is gone" } else { "the cell is missing" };
        return format!("{}: {what}", place(finding));
    }
    let [before, after] =
        [(before, finding.before_ci95, before_count), (after, finding.after_ci95, after_count)]
            .map(|(v, ci95, count)| format!("{} of {count}", with_interval(*measured, *v, ci95)));
    let sure = p_value.map_or_else(|| "exactly".to_owned(), |p| format!("p = {}", chance(p)));
    format!("{}: {} {before} → {after}, {sure}", place(finding), measured.words())
}

/// A p-value.
fn chance(p: f64) -> String {
    if p < 1e-12 { "below 1e-12".to_owned() } else { number(Some(p)) }
}

/// For a terminal of 100 columns: the sentence, and the changes for the worse and the better as tables.
#[must_use]
pub fn text(report: &GateReport) -> String {
    let list = |word: &str, findings: &[Finding]| match findings {
        [] => String::new(),
        some => format!("\n{word}\n{}", changes(some).fit(WIDE)),
    };
    format!(
        "{}\n{}{}",
        wrapped(&headline(report), WIDE, 0).join("\n"),
        list("worse", &report.worse),
        list("better", &report.better)
    )
}

/// A page: the sentence, what changed, every method.
#[must_use]
pub fn markdown(report: &GateReport) -> String {
    let mut text = format!("# Gate\n\n{}\n", headline(report));
    for (title, findings) in [("Worse", &report.worse), ("Better", &report.better)] {
        if !findings.is_empty() {
            text += &format!("\n## {title}\n\n{}", changes(findings).markdown());
        }
    }
    text + &format!(
        "\n## Methods\n\nMeans over the cells, before → after.\n\n{}",
        methods(&report.groups).markdown()
    )
}

fn changes(findings: &[Finding]) -> Table {
    let mut table = Table::new(&["cell", "what", "before", "of", "now", "of", "p"], &[0, 1]);
    for f in findings {
        table.row(vec![
            place(f),
            f.measured.words().to_owned(),
            with_interval(f.measured, f.before, f.before_ci95),
            f.before_count.to_string(),
            with_interval(f.measured, f.after, f.after_ci95),
            f.after_count.to_string(),
            f.p_value.map_or_else(|| "exact".to_owned(), chance),
        ]);
    }
    table
}

fn methods(groups: &[GateGroup]) -> Table {
    let measured: Vec<Measured> =
        groups.first().map(|g| g.means.iter().map(|m| m.0).collect()).unwrap_or_default();
    let headings: Vec<&str> = ["grid", "from", "method", "cells"]
        .into_iter()
        .chain(measured.iter().map(|m| m.words()))
        .collect();
    let mut table = Table::new(&headings, &[0, 1, 2]);
    for group in groups {
        let name = if group.new { format!("{} (new)", group.method) } else { group.method.clone() };
        let mut row =
            vec![group.grid.clone(), group.place.name().to_owned(), name, group.cells.to_string()];
        row.extend(group.means.iter().map(|(m, before, after)| {
            match (value(*m, *before), value(*m, *after)) {
                (before, after) if before == after => before,
                (before, after) => format!("{before} → {after}"),
            }
        }));
        table.row(row);
    }
    table
}

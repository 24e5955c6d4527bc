//! Tables of accuracy studies.

use super::Table;
use crate::study::{Cell, Measure, Plan, Score, Standing, Statistic, Study};

/// How one number of a table is shown.
fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| significant(v, 3))
}

/// So many significant digits, without an exponent between a thousandth and a million.
fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let size = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&size) {
        return format!("{value:.1e}");
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let decimals = (digits - 1 - size as i32).max(0) as usize;
    format!("{value:.decimals$}")
}

fn between(ends: Option<[f64; 2]>) -> String {
    ends.map_or_else(|| "–".to_owned(), |[a, b]| format!("{} … {}", significant(a, 3), significant(b, 3)))
}

fn share(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{:.1} %", 100.0 * v))
}

/// A time with three digits in the unit that suits it.
fn time(seconds: Option<f64>) -> String {
    seconds.map_or_else(
        || "–".to_owned(),
        |s| match s {
            s if s < 1e-3 => format!("{} µs", significant(1e6 * s, 3)),
            s if s < 1.0 => format!("{} ms", significant(1e3 * s, 3)),
            s => format!("{} s", significant(s, 3)),
        },
    )
}

/// The cells of one method, grid and place, in a study's order.
fn groups(study: &Study) -> Vec<Vec<&Cell>> {
    let mut groups: Vec<Vec<&Cell>> = Vec::new();
    for cell in &study.cells {
        let same = |g: &&mut Vec<&Cell>| {
            g.first().is_some_and(|c| c.grid == cell.grid && c.place == cell.place && c.method == cell.method && c.options == cell.options)
        };
        match groups.iter_mut().find(same) {
            Some(group) => group.push(cell),
            None => groups.push(vec![cell]),
        }
    }
    groups
}

const HEADINGS: [&str; 11] = [
    "estimates",
    "RMS error (samples)",
    "95 % interval",
    "bias (samples)",
    "no answer",
    "wrong unflagged",
    "truth in 95 % interval",
    "bound (samples)",
    "RMS/bound",
    "time",
    "total",
];

/// One row per grid, place and method: means over the cells of their root mean square errors and biases, medians of their bounds, and shares of all estimates.
#[must_use]
pub fn summary(study: &Study) -> Table {
    let headings: Vec<&str> = ["grid", "from", "method", "cells"].into_iter().chain(HEADINGS).collect();
    let mut table = Table::new(&headings, &[0, 1, 2]);
    for group in groups(study) {
        let Some(first) = group.first() else { continue };
        let score = study.scores.iter().find(|s| {
            s.grid == first.grid
                && s.place == first.place
                && s.method == first.method
                && s.options == first.options
                && s.kept_percent >= 100.0
        });
        let trials: usize = group.iter().map(|c| c.trials).sum();
        #[allow(clippy::cast_precision_loss)]
        let of_all =
            |count: &dyn Fn(&Cell) -> usize| share(Some(group.iter().map(|c| count(c)).sum::<usize>() as f64 / trials.max(1) as f64));
        let mean = |value: &dyn Fn(&Cell) -> Option<f64>| {
            let some: Vec<f64> = group.iter().filter_map(|c| value(c)).collect();
            #[allow(clippy::cast_precision_loss)]
            let count = some.len() as f64;
            (!some.is_empty()).then(|| some.iter().sum::<f64>() / count)
        };
        // Where the data hardly tell the delay the bound is hundreds of samples: one such cell would be all of a mean.
        let median = |value: &dyn Fn(&Cell) -> Option<f64>| {
            let mut some: Vec<f64> = group.iter().filter_map(|c| value(c)).collect();
            some.sort_by(f64::total_cmp);
            some.get(some.len() / 2).copied()
        };
        #[allow(clippy::cast_precision_loss)]
        let total = group.iter().map(|c| c.time_per_estimate_s.unwrap_or(0.0) * c.trials as f64).sum::<f64>();
        table.row(vec![
            first.grid.clone(),
            first.place.name().to_owned(),
            first.method_text(),
            group.len().to_string(),
            trials.to_string(),
            number(mean(&|c| c.rms_samples)),
            between(score.and_then(|s| s.ci95_samples)),
            number(mean(&|c| c.bias_samples)),
            of_all(&|c| c.flagged),
            of_all(&|c| c.unflagged_wrong),
            share(mean(&|c| c.coverage95)),
            number(median(&|c| c.bound_rms_samples)),
            number(median(&|c| Some(c.rms_samples? / c.bound_rms_samples?))),
            time(mean(&|c| c.time_per_estimate_s)),
            time(Some(total)),
        ]);
    }
    table
}

/// One row per cell of a grid; keys that are the same in all of them are told in the sentence before.
#[must_use]
pub fn cells(study: &Study, grid: &str) -> (String, Table) {
    let members: Vec<&Cell> = study.cells.iter().filter(|c| c.grid == grid).collect();
    let columns: Vec<(&str, Vec<String>)> = KEYS.iter().map(|(name, of)| (*name, members.iter().map(|c| of(c)).collect())).collect();
    let (varying, fixed): (Vec<_>, Vec<_>) = columns.into_iter().partition(|(_, values)| values.iter().any(|v| Some(v) != values.first()));
    let told: Vec<String> =
        fixed.iter().filter_map(|(name, values)| values.first().filter(|v| !v.is_empty()).map(|v| format!("{name} {v}"))).collect();
    let headings: Vec<&str> = varying.iter().map(|(n, _)| *n).chain(HEADINGS[1..10].iter().copied()).collect();
    let left: Vec<usize> = (0..varying.len()).collect();
    let mut table = Table::new(&headings, &left);
    for (at, cell) in members.iter().enumerate() {
        let mut row: Vec<String> = varying.iter().map(|(_, values)| values[at].clone()).collect();
        row.extend([
            number(cell.rms_samples),
            between(cell.rms_ci95_samples),
            number(cell.bias_samples),
            cell.flagged.to_string(),
            cell.unflagged_wrong.to_string(),
            share(cell.coverage95),
            number(cell.bound_rms_samples),
            number(cell.rms_samples.zip(cell.bound_rms_samples).map(|(r, b)| r / b)),
            time(cell.time_per_estimate_s),
        ]);
        table.row(row);
    }
    (told.join(", "), table)
}

type KeyText = fn(&Cell) -> String;

/// The keys of a cell as columns.
const KEYS: &[(&str, KeyText)] = &[
    ("plant", |c| c.plant.clone()),
    ("input", |c| c.input.clone()),
    ("output", |c| c.output.clone()),
    ("c2d", |c| c.c2d.clone()),
    ("excitation", |c| c.excitation.clone()),
    ("SNR", |c| c.snr.map(|v| v.to_string()).unwrap_or_default()),
    ("noise", |c| c.noise.clone()),
    ("loop", |c| c.loops.name().to_owned()),
    ("controller", |c| c.controller.clone().unwrap_or_default()),
    ("from", |c| c.place.name().to_owned()),
    ("delay (s)", |c| c.delay_s.to_string()),
    ("samples", |c| c.samples.to_string()),
    ("sample time (s)", |c| c.sample_time_s.to_string()),
    ("longest delay (samples)", |c| c.max_delay.to_string()),
    ("truth", |c| c.truth.name().to_owned()),
    ("method", Cell::method_text),
    ("trials", |c| c.trials.to_string()),
];

/// Every published number of a plan beside ours; `None` where the plan has none.
#[must_use]
pub fn published(study: &Study, plan: &Plan) -> Option<Table> {
    let mut table = Table::new(&["source", "cells", "what", "published", "ours", ""], &[0, 1, 2, 5]);
    let mut any = false;
    for p in &plan.published {
        let Some(beside) = p.beside(study) else { continue };
        any = true;
        let what = match p.statistic {
            Statistic::RmsSamples => format!("RMS (samples), {} % kept", p.kept_percent),
            Statistic::MeanRawS => "mean raw delay (s)".to_owned(),
            Statistic::Failed => "failed".to_owned(),
        };
        let (theirs, ours) = match p.statistic {
            Statistic::Failed => ("always".to_owned(), share(beside.ours)),
            _ => (number(p.value), number(beside.ours)),
        };
        let standing = match beside.standing {
            Standing::Matching => "matching".to_owned(),
            Standing::Differing => "differing".to_owned(),
            Standing::NotReproducible => format!("not reproducible: {}", p.not_reproducible.as_deref().unwrap_or("")),
        };
        table.row(vec![p.source.clone(), p.cells.to_string(), what, theirs, ours, standing]);
    }
    any.then_some(table)
}

/// The page `tables.md`: what was run, the summary, the published numbers, the scores, every cell.
#[must_use]
pub fn page(study: &Study, plan: &Plan) -> String {
    let mut text = format!("# {}\n\n{}\n\n", plan.name, plan.about);
    text += &format!("Seed {}; {}.\n\n## Methods\n\n{}\n", study.seed, study.program, summary(study).markdown());
    if let Some(table) = aims(study, plan) {
        text += &format!("## Aims\n\n{}\n", table.markdown());
    }
    if let Some(table) = published(study, plan) {
        text += &format!("## Beside published numbers\n\n{}\n", table.markdown());
    }
    if let Some(table) = scores(study) {
        text += &format!("## Mean RMS error with the worst answers left out\n\n{}\n", table.markdown());
    }
    if let Some(table) = growth(study) {
        text += &format!("## Growth of the time\n\n{}\n", table.markdown());
    }
    for grid in &plan.grids {
        let (told, table) = cells(study, &grid.name);
        text += &format!("## Cells of {}\n\nIn all of them: {told}.\n\n{}\n", grid.name, table.markdown());
    }
    text
}

/// How the time of an estimate grows: the exponent p of its power law in the samples of a record and in the delays searched, least squares of logarithms over the cells
/// of a grid in which one of them varies; `None` where none does.
#[must_use]
pub fn growth(study: &Study) -> Option<Table> {
    let mut table = Table::new(&["grid", "method", "grows with", "from", "to", "time there", "exponent"], &[0, 1, 2]);
    let mut any = false;
    for group in groups(study) {
        let Some(first) = group.first() else { continue };
        let axes: [(&str, fn(&Cell) -> usize); 2] = [("samples", |c| c.samples), ("delays searched", |c| c.max_delay)];
        for (axis, of) in axes {
            let mut at: Vec<usize> = group.iter().map(|c| of(c)).collect();
            at.sort_unstable();
            at.dedup();
            let (Some(&from), Some(&to)) = (at.first(), at.last()) else { continue };
            if from == to {
                continue;
            }
            #[allow(clippy::cast_precision_loss)]
            let points: Vec<[f64; 2]> =
                group.iter().filter_map(|c| Some([(of(c) as f64).ln(), c.time_per_estimate_s.filter(|t| *t > 0.0)?.ln()])).collect();
            let times = |which: usize| {
                let there: Vec<f64> = group.iter().filter(|c| of(c) == which).filter_map(|c| c.time_per_estimate_s).collect();
                #[allow(clippy::cast_precision_loss)]
                let count = there.len() as f64;
                time((!there.is_empty()).then(|| there.iter().sum::<f64>() / count))
            };
            any = true;
            table.row(vec![
                first.grid.clone(),
                first.method_text(),
                axis.to_owned(),
                format!("{from}: {}", times(from)),
                to.to_string(),
                times(to),
                slope(&points).map_or_else(|| "–".to_owned(), |p| format!("{p:.2}")),
            ]);
        }
    }
    any.then_some(table)
}

/// The slope of the straight line through the points.
fn slope(points: &[[f64; 2]]) -> Option<f64> {
    #[allow(clippy::cast_precision_loss)]
    let n = points.len() as f64;
    let mean = |i: usize| points.iter().map(|p| p[i]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let spread: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
    (spread > 0.0).then(|| points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>() / spread)
}

/// Every aim of a plan beside what was reached; `None` where the plan has none of these cells.
#[must_use]
pub fn aims(study: &Study, plan: &Plan) -> Option<Table> {
    let mut table = Table::new(&["aim", "method", "wanted", "ours", "furthest off", ""], &[0, 1, 4, 5]);
    let mut any = false;
    for aim in &plan.aims {
        let shown = |v: f64| match aim.measure {
            Measure::RmsSamples | Measure::RmsOverBound => number(Some(v)),
            Measure::Flagged | Measure::Coverage95 => share(Some(v)),
        };
        let wanted = match (aim.at_least, aim.at_most) {
            (Some(a), Some(b)) => format!("{} … {}", shown(a), shown(b)),
            (Some(a), None) => format!("≥ {}", shown(a)),
            (_, b) => format!("≤ {}", b.map_or_else(String::new, shown)),
        };
        for reached in aim.reached(study) {
            any = true;
            table.row(vec![
                aim.aim.clone(),
                reached.method.to_owned(),
                wanted.clone(),
                shown(reached.value),
                reached.cell.map(place).unwrap_or_default(),
                if reached.met { "met" } else { "missed" }.to_owned(),
            ]);
        }
    }
    any.then_some(table)
}

/// A cell in a few words.
fn place(cell: &Cell) -> String {
    let snr = cell.snr.map(|v| format!(", SNR {v}")).unwrap_or_default();
    let noise = if cell.noise == "white" { String::new() } else { format!(", {}", cell.noise) };
    format!("{}, {}{snr}{noise}", cell.plant, cell.excitation)
}

/// Scores by the share of answers kept; `None` where all are kept.
#[must_use]
pub fn scores(study: &Study) -> Option<Table> {
    let mut shares: Vec<f64> = Vec::new();
    for score in &study.scores {
        if !shares.contains(&score.kept_percent) {
            shares.push(score.kept_percent);
        }
    }
    let names: Vec<String> = shares.iter().map(|s| format!("{s} % kept")).collect();
    let headings: Vec<&str> = ["grid", "from", "method"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let mut table = Table::new(&headings, &[0, 1, 2]);
    let same = |a: &Score, b: &Score| a.grid == b.grid && a.place == b.place && a.method == b.method && a.options == b.options;
    for of_one in study.scores.chunk_by(same) {
        let Some(first) = of_one.first() else { continue };
        let mut row = vec![first.grid.clone(), first.place.name().to_owned(), first.method_text()];
        row.extend(shares.iter().map(|&s| number(of_one.iter().find(|k| k.kept_percent == s).and_then(|k| k.mean_rms_samples))));
        table.row(row);
    }
    (shares.len() > 1).then_some(table)
}

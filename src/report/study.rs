//! Tables of accuracy studies.

use std::collections::BTreeMap;

use super::styled::wrapped;
use super::text::Table;
use deadtime_signal::stats;
use deadtime_signal::text::markdown;
use deadtime_study::{
    Cell, Delay, Grid, Layout, Measure, Plan, Score, Shown, Standing, Statistic, Study, Which,
};

/// How one number of a table is shown.
pub(super) fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| significant(v, 3))
}

/// The given number of significant digits, without an exponent between a thousandth and a million.
fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let size = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&size) {
        return format!("{value:.1e}");
    }
    let decimals = (digits - 1 - size as i32).max(0) as usize;
    format!("{value:.decimals$}")
}

fn between(ends: Option<[f64; 2]>) -> String {
    ends.map_or_else(
        || "–".to_owned(),
        |[a, b]| format!("{} … {}", significant(a, 3), significant(b, 3)),
    )
}

pub(super) fn share(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{:.1} %", 100.0 * v))
}

/// A time with three digits in the unit that suits it.
pub(super) fn time(seconds: Option<f64>) -> String {
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
pub(super) fn groups(study: &Study) -> Vec<Vec<&Cell>> {
    let mut groups: Vec<Vec<&Cell>> = Vec::new();
    for cell in &study.cells {
        let same = |g: &&mut Vec<&Cell>| {
            g.first().is_some_and(|c| {
                c.grid == cell.grid
                    && c.place == cell.place
                    && c.method == cell.method
                    && c.options == cell.options
            })
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

/// The most important columns of the summary.
const SHORT: [&str; 10] = [
    "grid",
    "from",
    "method",
    "RMS error (samples)",
    "95 % interval",
    "no answer",
    "wrong unflagged",
    "truth in 95 % interval",
    "RMS/bound",
    "time",
];

/// One row per grid, place and method. The columns are means over the cells of root mean square errors and biases, medians of bounds, and shares of all estimates.
#[must_use]
pub fn summary(study: &Study) -> Table {
    let headings: Vec<&str> =
        ["grid", "from", "method", "cells"].into_iter().chain(HEADINGS).collect();
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
        let of_all = |count: &dyn Fn(&Cell) -> usize| {
            share(Some(group.iter().map(|c| count(c)).sum::<usize>() as f64 / trials.max(1) as f64))
        };
        let total = group
            .iter()
            .map(|c| c.time_per_estimate_s.unwrap_or(0.0) * c.trials as f64)
            .sum::<f64>();
        table.row(vec![
            first.grid.clone(),
            first.place.name().to_owned(),
            first.method_text(),
            group.len().to_string(),
            trials.to_string(),
            number(mean(&group, |c| c.rms_samples)),
            between(score.and_then(|s| s.ci95_samples)),
            number(mean(&group, |c| c.bias_samples)),
            of_all(&|c| c.flagged),
            of_all(&|c| c.unflagged_wrong),
            share(mean(&group, |c| c.coverage95)),
            number(median(&group, |c| c.bound_rms_samples)),
            number(median(&group, |c| Some(c.rms_samples? / c.bound_rms_samples?))),
            time(mean(&group, |c| c.time_per_estimate_s)),
            time(Some(total)),
        ]);
    }
    table
}

/// A table of the `by` of a plan.
#[must_use]
pub fn by(study: &Study, grid: &str, layout: &Layout) -> Table {
    let of = |key: &str, cell: &Cell| match KEYS
        .iter()
        .find(|(_, name, _)| *name == key)
        .map(|(_, _, of)| of(cell))
    {
        Some(value) if !value.is_empty() => value,
        _ => "none".to_owned(),
    };
    let Some((column, keys)) = layout.keys.split_last() else { return Table::new(&[], &[]) };
    let (mut columns, mut rows): (Vec<String>, Vec<Vec<String>>) = (Vec::new(), Vec::new());
    let mut groups: BTreeMap<(usize, usize), Vec<&Cell>> = BTreeMap::new();
    for cell in study.cells.iter().filter(|c| c.grid == grid) {
        let row: Vec<String> =
            keys.iter().map(|k| of(k, cell)).chain([cell.method_text()]).collect();
        groups
            .entry((place(&mut rows, row), place(&mut columns, of(column, cell))))
            .or_default()
            .push(cell);
    }
    let headings: Vec<&str> = keys
        .iter()
        .map(String::as_str)
        .chain(["method"])
        .chain(columns.iter().map(String::as_str))
        .collect();
    let mut table = Table::new(&headings, &(0..=keys.len()).collect::<Vec<_>>());
    // Rows with equal leading keys are next to each other.
    let mut order: Vec<usize> = (0..rows.len()).collect();
    let first =
        |r: usize| rows.iter().position(|other| other[..keys.len()] == rows[r][..keys.len()]);
    order.sort_by_key(|&r| (first(r), r));
    for at in order {
        let texts: Vec<String> = (0..columns.len())
            .map(|c| {
                groups.get(&(at, c)).map_or_else(|| "–".to_owned(), |g| shown(layout.shown, g))
            })
            .collect();
        // A number that no method of this name has, such as a bound, makes no row.
        if layout.shown == Shown::Rms || texts.iter().any(|t| t != "–") {
            table.row(rows[at].iter().cloned().chain(texts).collect());
        }
    }
    table
}

/// The place of a value in a list that it is added to where it is new.
pub(super) fn place<T: PartialEq>(list: &mut Vec<T>, value: T) -> usize {
    list.iter().position(|v| *v == value).unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}

pub(super) fn mean(cells: &[&Cell], value: impl Fn(&Cell) -> Option<f64>) -> Option<f64> {
    stats::mean(cells.iter().filter_map(|c| value(c)))
}

/// Where the data carry little information on the delay a bound is hundreds of samples: one such cell would dominate a mean.
pub(super) fn median(cells: &[&Cell], value: impl Fn(&Cell) -> Option<f64>) -> Option<f64> {
    stats::upper_median(cells.iter().filter_map(|c| value(c)).collect())
}

/// One number of a [`Layout`].
fn shown(what: Shown, cells: &[&Cell]) -> String {
    // Rounding is not an error of a method.
    let settled = |v: f64| if v.abs() < 1e-6 { 0.0 } else { v };
    let trials: usize = cells.iter().map(|c| c.trials).sum();
    let of_all = |count: fn(&Cell) -> usize| {
        100.0 * cells.iter().map(|c| count(c)).sum::<usize>() as f64 / trials.max(1) as f64
    };
    match what {
        Shown::Rms => {
            let rms = number(mean(cells, |c| c.rms_samples).map(settled));
            let flagged = of_all(|c| c.flagged);
            if flagged == 0.0 { rms } else { format!("{rms} ({flagged:.0} %)") }
        }
        Shown::Wrong => format!("{:.0} %", of_all(|c| c.unflagged_wrong)),
        Shown::Bias => number(mean(cells, |c| c.bias_samples).map(settled)),
        Shown::Slope => number(slope(cells).map(settled)),
        Shown::Bound => number(median(cells, |c| c.bound_rms_samples)),
        Shown::OverBound => number(over_bound(cells)),
        Shown::Predicted => number(median(cells, |c| c.predicted_rms_samples)),
    }
}

/// The errors over the bound. `None` where fewer than half of the records have an answer: the answered records do not represent the method's accuracy.
pub(super) fn over_bound(cells: &[&Cell]) -> Option<f64> {
    let (trials, flagged): (usize, usize) =
        cells.iter().fold((0, 0), |s, c| (s.0 + c.trials, s.1 + c.flagged));
    let rms = mean(cells, |c| c.rms_samples).filter(|_| 2 * flagged <= trials)?;
    Some(rms / median(cells, |c| c.bound_rms_samples)?)
}

/// The slope of the mean answers over the injected delays; `None` below two different ones.
fn slope(cells: &[&Cell]) -> Option<f64> {
    let points = cells.iter().filter_map(|c| match c.delay_s {
        Delay::Same(s) => Some([s / c.sample_time_s, c.bias_samples?]),
        _ => None,
    });
    let points: Vec<[f64; 2]> = points.collect();
    // The answer is the delay and its error.
    inclination(&points).map(|error| 1.0 + error)
}

/// The methods with the smallest errors over all cells, one row each, `rows` at most: error, answers, intervals that hold the truth.
#[must_use]
pub fn overview(study: &Study, rows: usize) -> Table {
    let mut methods: Vec<&str> = Vec::new();
    for cell in &study.cells {
        if !methods.contains(&cell.method.as_str()) {
            methods.push(&cell.method);
        }
    }
    let of = |method: &str| {
        let cells: Vec<&Cell> = study.cells.iter().filter(|c| c.method == method).collect();
        let sum = |f: &dyn Fn(&Cell) -> f64| cells.iter().map(|c| f(c)).sum::<f64>();
        let (trials, silent) = (sum(&|c| c.trials as f64), sum(&|c| c.flagged as f64));
        let squares: Option<Vec<f64>> =
            cells.iter().map(|c| c.rms_samples.map(|r| r.powi(2) * c.scored as f64)).collect();
        let scored = sum(&|c| c.scored as f64);
        let rms = squares.map(|s| (s.iter().sum::<f64>() / scored.max(1.0)).sqrt());
        let held: f64 =
            cells.iter().filter_map(|c| Some(c.coverage95? * c.scored as f64)).sum::<f64>();
        (method.to_owned(), rms, 1.0 - silent / trials.max(1.0), held / scored.max(1.0))
    };
    let mut all: Vec<(String, Option<f64>, f64, f64)> = methods.into_iter().map(of).collect();
    all.sort_by(|a, b| {
        let key = |rms: Option<f64>| rms.unwrap_or(f64::INFINITY);
        b.2.total_cmp(&a.2).then(key(a.1).total_cmp(&key(b.1)))
    });
    let headings = ["method", "rms error (samples)", "answered", "truth in the 95 % interval"];
    let mut table = Table::new(&headings, &[0]);
    for (method, rms, answered, held) in all.into_iter().take(rows) {
        table.row(vec![method, number(rms), share(Some(answered)), share(Some(held))]);
    }
    table
}

/// One row per cell of a grid; keys with one value in all of them are in the sentence before.
#[must_use]
pub fn cells(study: &Study, grid: &str) -> (String, Table) {
    let members: Vec<&Cell> = study.cells.iter().filter(|c| c.grid == grid).collect();
    let columns: Vec<(&str, Vec<String>)> =
        KEYS.iter().map(|(name, _, of)| (*name, members.iter().map(|c| of(c)).collect())).collect();
    let (varying, fixed): (Vec<_>, Vec<_>) = columns
        .into_iter()
        .partition(|(_, values)| values.iter().any(|v| Some(v) != values.first()));
    let told: Vec<String> = fixed
        .iter()
        .filter_map(|(name, values)| {
            values.first().filter(|v| !v.is_empty()).map(|v| format!("{name} {v}"))
        })
        .collect();
    let headings: Vec<&str> =
        varying.iter().map(|(n, _)| *n).chain(HEADINGS[1..10].iter().copied()).collect();
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

pub(super) type KeyText = fn(&Cell) -> String;

/// The keys of a cell as columns: heading, key of a plan.
pub(super) const KEYS: &[(&str, &str, KeyText)] = &[
    ("plant", "plant", |c| c.plant.clone()),
    ("input", "input", |c| c.input.clone()),
    ("output", "output", |c| c.output.clone()),
    ("c2d", "c2d", |c| c.c2d.clone()),
    ("excitation", "excitation", |c| c.excitation.clone()),
    ("SNR", "snr", |c| c.snr.map(|v| v.to_string()).unwrap_or_default()),
    ("noise", "noise", |c| c.noise.clone()),
    ("loop", "loop", |c| c.loops.name().to_owned()),
    ("controller", "controller", |c| c.controller.clone().unwrap_or_default()),
    ("from", "place", |c| c.place.name().to_owned()),
    ("delay (s)", "delay_s", |c| c.delay_s.to_string()),
    ("samples", "samples", |c| c.samples.to_string()),
    ("sample time (s)", "sample_time_s", |c| c.sample_time_s.to_string()),
    ("longest delay (samples)", "max_delay", |c| c.max_delay.to_string()),
    ("logging", "logging", |c| c.logging.clone().unwrap_or_else(|| "plain".to_owned())),
    ("truth", "truth", |c| c.truth.name().to_owned()),
    ("method", "method", Cell::method_text),
    ("trials", "trials", |c| c.trials.to_string()),
];

/// Every published number of a plan and ours; `None` where the plan has none.
#[must_use]
pub fn published(study: &Study, plan: &Plan) -> Option<Table> {
    let mut table =
        Table::new(&["source", "cells", "what", "published", "ours", ""], &[0, 1, 2, 5]);
    let mut any = false;
    for p in &plan.published {
        let Some(beside) = p.beside(study) else { continue };
        any = true;
        let what = match p.statistic {
            Statistic::RmsSamples => format!("RMS (samples), {} % kept", p.kept_percent),
            Statistic::MeanRawS => "mean raw delay (s)".to_owned(),
            Statistic::StdRawS => "its standard deviation (s)".to_owned(),
            Statistic::Failed => "failed".to_owned(),
        };
        let (theirs, ours) = match p.statistic {
            Statistic::Failed => ("always".to_owned(), share(beside.ours)),
            _ => (
                number(p.value),
                beside.ours.map_or_else(|| "no answer".to_owned(), |v| number(Some(v))),
            ),
        };
        let standing = match beside.standing {
            Standing::Matching => "matching".to_owned(),
            Standing::Differing => match (p.statistic, beside.ours.zip(p.value)) {
                (Statistic::RmsSamples, Some((ours, theirs))) => {
                    format!("differing, {}", if ours < theirs { "lower" } else { "higher" })
                }
                _ => "differing".to_owned(),
            },
            Standing::NotReproducible => {
                format!("not reproducible: {}", p.not_reproducible.as_deref().unwrap_or(""))
            }
        };
        // A grid with the name of the source adds no information.
        let grid = p.cells.grid.clone().filter(|g| *g != p.source);
        table.row(vec![
            p.source.clone(),
            Which { grid, ..p.cells.clone() }.to_string(),
            what,
            theirs,
            ours,
            standing,
        ]);
    }
    any.then_some(table)
}

/// The number of a plan's published numbers that agree with ours.
#[must_use]
pub fn standings(study: &Study, plan: &Plan) -> String {
    let all: Vec<Standing> =
        plan.published.iter().filter_map(|p| p.beside(study)).map(|b| b.standing).collect();
    let count = |standing: Standing| all.iter().filter(|s| **s == standing).count();
    format!(
        "{} matching, {} differing, {} not reproducible",
        count(Standing::Matching),
        count(Standing::Differing),
        count(Standing::NotReproducible)
    )
}

/// Columns that a study's tables keep to.
const WIDE: usize = 100;

/// The report of a study for a terminal of 100 columns. Without a plan it lacks published numbers, aims and the plan's own tables.
#[must_use]
pub fn text(study: &Study, plan: Option<&Plan>) -> String {
    let about = wrapped(&format!("{}: {}", study.plan, study.about), WIDE, 2).join("\n");
    let first = format!("{about}\n\n{}", summary(study).only(&SHORT).fit(WIDE));
    with_tables(first, study, plan, &|told| wrapped(told, WIDE, 0).join("\n"), &|table| {
        table.fit(WIDE)
    })
}

/// The same with every column, as wide as it comes.
#[must_use]
pub fn full(study: &Study, plan: Option<&Plan>) -> String {
    with_tables(headline(study), study, plan, &str::to_owned, &Table::to_string)
}

/// Beneath the summary, published numbers, the plan's own tables, scores and aims.
fn with_tables(
    first: String,
    study: &Study,
    plan: Option<&Plan>,
    say: &dyn Fn(&str) -> String,
    show: &dyn Fn(&Table) -> String,
) -> String {
    let mut text = first;
    let mut add =
        |told: &str, table: &Table| text += &format!("\n{}\n\n{}", say(told), show(table));
    if let Some((plan, table)) = plan.and_then(|p| Some((p, published(study, p)?))) {
        add(&format!("Published numbers and ours, {}:", standings(study, plan)), &table);
    }
    for (told, table) in plan.map(|p| layouts(study, p)).unwrap_or_default() {
        add(&format!("{told}:"), &table);
    }
    if let Some(table) = scores(study) {
        add("Mean over the cells of the RMS error in samples, the worst answers left out:", &table);
    }
    if let Some(table) = plan.and_then(|p| aims(study, p)) {
        add("Aims:", &table);
    }
    text
}

/// The run, and the summary.
#[must_use]
pub fn headline(study: &Study) -> String {
    format!("{}: {}\n\n{}", study.plan, study.about, summary(study))
}

/// The page `tables.md`: the run, the summary, the published numbers, the scores, every cell.
#[must_use]
pub fn page(study: &Study, plan: &Plan) -> String {
    let mut text = format!("# {}\n\n{}\n\n", markdown(&plan.name), markdown(&plan.about));
    text += &format!(
        "Seed {}; {}.\n\n## Methods\n\n{}\n",
        study.seed,
        study.program,
        summary(study).markdown()
    );
    if let Some(table) = aims(study, plan) {
        text += &format!("## Aims\n\n{}\n", table.markdown());
    }
    if let Some(table) = published(study, plan) {
        text += &format!(
            "## Beside published numbers\n\n{}.\n\n{}\n",
            standings(study, plan),
            table.markdown()
        );
    }
    let tables = layouts(study, plan);
    if !tables.is_empty() {
        text += "## Laid out by keys\n\n";
    }
    for (told, table) in tables {
        text += &format!("{told}.\n\n{}\n", table.markdown());
    }
    if let Some(table) = scores(study) {
        text +=
            &format!("## Mean RMS error with the worst answers left out\n\n{}\n", table.markdown());
    }
    if let Some(table) = growth(study) {
        text += &format!("## Growth of the time\n\n{}\n", table.markdown());
    }
    for grid in &plan.grids {
        let (told, table) = cells(study, &grid.name);
        text += &format!(
            "## Cells of {}\n\nIn all of them: {}.\n\n{}\n",
            markdown(&grid.name),
            markdown(&told),
            table.markdown()
        );
    }
    text
}

/// Every table of the `by` of the plan's grids, and the meaning of its numbers.
#[must_use]
pub fn layouts(study: &Study, plan: &Plan) -> Vec<(String, Table)> {
    let told = |grid: &Grid, layout: &Layout| {
        let what = match layout.shown {
            Shown::Rms => {
                "RMS error (samples), mean over the cells; in brackets the share of records without an answer"
            }
            Shown::Wrong => {
                "share of records with an answer that is off by more than `wrong_samples` and whose interval leaves out the truth"
            }
            Shown::Bias => "mean error (samples)",
            Shown::Slope => {
                "growth of the mean answer with the injected delay: 1 follows it, 0 is a constant"
            }
            Shown::Bound => "Cramér-Rao bound (samples), median over the cells",
            Shown::OverBound => {
                "RMS error over the Cramér-Rao bound, where half of the records have an answer at least"
            }
            Shown::Predicted => {
                "standard deviation predicted before estimating (samples), median over the cells"
            }
        };
        format!("{} by {}: {what}", grid.name, layout.keys.join(", "))
    };
    plan.grids
        .iter()
        .flat_map(|g| g.by.iter().map(move |l| (told(g, l), by(study, &g.name, l))))
        .collect()
}

/// The growth of the time of an estimate: the exponent p of its power law in the samples of a record and in the delays searched. It is a least-squares fit of
/// logarithms over the cells of a grid in which one of them varies. `None` where none does.
#[must_use]
pub fn growth(study: &Study) -> Option<Table> {
    let mut table = Table::new(
        &["grid", "method", "grows with", "from", "time", "to", "time", "exponent"],
        &[0, 1, 2],
    );
    let mut any = false;
    for group in groups(study) {
        let Some(first) = group.first() else { continue };
        for axis in ["samples", "delays searched"] {
            let of = |c: &Cell| if axis == "samples" { c.samples } else { c.max_delay };
            let mut at: Vec<usize> = group.iter().map(|c| of(c)).collect();
            at.sort_unstable();
            at.dedup();
            let (Some(&from), Some(&to)) = (at.first(), at.last()) else { continue };
            if from == to {
                continue;
            }
            let points: Vec<[f64; 2]> = group
                .iter()
                .filter_map(|c| {
                    Some([(of(c) as f64).ln(), c.time_per_estimate_s.filter(|t| *t > 0.0)?.ln()])
                })
                .collect();
            let times = |which: usize| {
                time(stats::mean(
                    group.iter().filter(|c| of(c) == which).filter_map(|c| c.time_per_estimate_s),
                ))
            };
            any = true;
            table.row(vec![
                first.grid.clone(),
                first.method_text(),
                axis.to_owned(),
                from.to_string(),
                times(from),
                to.to_string(),
                times(to),
                inclination(&points).map_or_else(|| "–".to_owned(), |p| format!("{p:.2}")),
            ]);
        }
    }
    any.then_some(table)
}

/// The slope of the straight line through the points.
fn inclination(points: &[[f64; 2]]) -> Option<f64> {
    let n = points.len() as f64;
    let mean = |i: usize| points.iter().map(|p| p[i]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let spread: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
    (spread > 0.0).then(|| points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>() / spread)
}

/// Every aim of a plan and what was reached; `None` where the plan has none of these cells.
#[must_use]
pub fn aims(study: &Study, plan: &Plan) -> Option<Table> {
    let mut table =
        Table::new(&["aim", "method", "wanted", "ours", "furthest off", ""], &[0, 1, 4, 5]);
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
                reached.cell.map(whereabouts).unwrap_or_default(),
                if reached.met { "met" } else { "missed" }.to_owned(),
            ]);
        }
    }
    any.then_some(table)
}

/// A cell in a few words.
fn whereabouts(cell: &Cell) -> String {
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
    let headings: Vec<&str> =
        ["grid", "from", "method"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let mut table = Table::new(&headings, &[0, 1, 2]);
    let same = |a: &Score, b: &Score| {
        a.grid == b.grid && a.place == b.place && a.method == b.method && a.options == b.options
    };
    for of_one in study.scores.chunk_by(same) {
        let Some(first) = of_one.first() else { continue };
        let mut row = vec![first.grid.clone(), first.place.name().to_owned(), first.method_text()];
        row.extend(shares.iter().map(|&s| {
            number(of_one.iter().find(|k| k.kept_percent == s).and_then(|k| k.mean_rms_samples))
        }));
        table.row(row);
    }
    (shares.len() > 1).then_some(table)
}

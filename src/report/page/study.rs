//! A study as a page: errors against noise and delay, method by condition, accuracy against time, distance from the bound, coverage.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::frame::{Cell as Shown, figure, given, number, page, percent, sorted};
use super::series::{brief, picked};
use crate::report::study::{
    KEYS, KeyText, aims, groups, layouts, mean, median, over_bound, place, published, scores,
    standings, summary,
};
use deadtime_study::blind::wilson;
use deadtime_study::{Cell, Plan, Study};

/// Different values of a key that a picture has room for.
const VALUES: usize = 80;
/// Curves that are shown at first; the legend shows the others.
const OPEN_CURVES: usize = 8;
/// Answers that comparisons leave out.
const MOSTLY: &str = "Methods that answer less than half of the records are left out.";
/// A key whose largest value is this many times its smallest gets a logarithmic axis.
const WIDE_RANGE: f64 = 20.0;

/// The page; without a plan, nothing of published numbers, aims and the plan's own tables.
#[must_use]
pub fn study(study: &Study, plan: Option<&Plan>) -> String {
    let parts = parts(study);
    let trials: usize = study.cells.iter().map(|c| c.trials).sum();
    let body = html! {
        h1 { "Accuracy study " (study.plan) }
        p { (study.about) }
        p .faint { (study.cells.len()) " cells, " (trials) " estimates, seed " (study.seed) ", " (study.program) ". Errors are in samples; every number is a mean over the cells that share its place." }
        h2 { "Against noise, delay and length" }
        p { "A method whose name is faint in the legend is hidden: click it, or press Enter on it. The dashed line is the Cramér-Rao bound, where it is known." }
        (figure("against", "The picture"))
        h2 { "Method by condition" }
        p { "More colour is worse. A heading sorts." }
        (figure("heat", "The heat map"))
        h2 { "Accuracy against time" }
        p { "No method is both faster and more accurate than one on the line. " (MOSTLY) }
        (figure("pareto", "The picture"))
        (bound(&parts))
        (coverage(&parts))
        h2 { "Tables" }
        (given("Every method: means over the cells", &summary(study)))
        @if let Some((plan, table)) = plan.and_then(|p| Some((p, aims(study, p)?))) { (given(&format!("Aims of {}", plan.name), &table)) }
        @if let Some((plan, table)) = plan.and_then(|p| Some((p, published(study, p)?))) {
            details { summary { "Published numbers: " (standings(study, plan)) } (given("Published and ours", &table)) }
        }
        @for (told, table) in plan.map(|p| layouts(study, p)).unwrap_or_default() {
            details { summary { (told) } (given(&told, &table)) }
        }
        @if let Some(table) = scores(study) {
            details { summary { "The worst answers left out" } (given("Mean over the cells of the RMS error in samples, the worst answers left out", &table)) }
        }
    };
    page(
        &format!("Accuracy study {}", study.plan),
        &body,
        &json!({ "kind": "study", "figures": figures(&parts) }),
    )
}

/// The cells of one grid and place, method by method.
struct Part<'a> {
    name: String,
    methods: Vec<(String, Vec<&'a Cell>)>,
}

fn parts(study: &Study) -> Vec<Part<'_>> {
    let mut parts: Vec<Part<'_>> = Vec::new();
    for group in groups(study) {
        let Some(first) = group.first() else { continue };
        let name = if study.cells.iter().all(|c| c.place == first.place) {
            first.grid.clone()
        } else {
            format!("{}, from {}", first.grid, first.place.name())
        };
        let method = first.method_text();
        match parts.iter_mut().find(|p| p.name == name) {
            Some(part) => part.methods.push((method, group)),
            None => parts.push(Part { name, methods: vec![(method, group)] }),
        }
    }
    parts
}

/// A number of several cells: its name, the number, a logarithmic axis or not, its limit for a bad value, a share or not.
struct Measure {
    name: &'static str,
    of: fn(&[&Cell]) -> Option<f64>,
    log: bool,
    good: Option<f64>,
    share: bool,
}

const MEASURES: [Measure; 7] = [
    Measure {
        name: "RMS error (samples)",
        of: |c| mean(c, |c| c.rms_samples).map(settled),
        log: true,
        good: None,
        share: false,
    },
    Measure {
        name: "RMS error over the bound",
        of: over_bound,
        log: true,
        good: None,
        share: false,
    },
    Measure {
        name: "bias (samples)",
        of: |c| mean(c, |c| c.bias_samples).map(settled),
        log: false,
        good: Some(0.0),
        share: false,
    },
    Measure {
        name: "no answer",
        of: |c| of_all(c, |c| c.flagged),
        log: false,
        good: None,
        share: true,
    },
    Measure {
        name: "wrong, unflagged",
        of: |c| of_all(c, |c| c.unflagged_wrong),
        log: false,
        good: None,
        share: true,
    },
    Measure {
        name: "truth in the 95 % interval",
        of: |c| mean(c, |c| c.coverage95),
        log: false,
        good: Some(0.95),
        share: true,
    },
    Measure {
        name: "time per estimate (s)",
        of: |c| mean(c, |c| c.time_per_estimate_s),
        log: true,
        good: None,
        share: false,
    },
];

/// Rounding is not an error of a method.
fn settled(value: f64) -> f64 {
    if value.abs() < 1e-6 { 0.0 } else { value }
}

fn of_all(cells: &[&Cell], count: fn(&Cell) -> usize) -> Option<f64> {
    let trials: usize = cells.iter().map(|c| c.trials).sum();
    (trials > 0).then(|| cells.iter().map(|c| count(c)).sum::<usize>() as f64 / trials as f64)
}

fn figures(parts: &[Part<'_>]) -> Vec<Value> {
    let heat = parts.iter().flat_map(heat).collect();
    let all = [
        picked(
            "against",
            &["cells", "against", "number"],
            parts.iter().flat_map(against).collect(),
        ),
        picked("heat", &["cells", "condition", "number"], heat),
        picked("pareto", &["cells"], parts.iter().filter_map(pareto).collect()),
    ];
    all.into_iter().flatten().collect()
}

/// The keys that vary between the cells of a part, their values in order of appearance, rising where they are numbers.
fn varying(part: &Part<'_>) -> Vec<(&'static str, KeyText, Vec<String>)> {
    let vary = |(heading, key, text): &(&'static str, &'static str, KeyText)| {
        let mut values: Vec<String> = Vec::new();
        for cell in part.methods.iter().flat_map(|(_, cells)| cells) {
            place(&mut values, text(cell));
        }
        let skip =
            *key == "method" || *key == "trials" || values.len() < 2 || values.len() > VALUES;
        values.sort_by(|a, b| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(a), Ok(b)) => a.total_cmp(&b),
            (Ok(_), Err(_)) => std::cmp::Ordering::Less,
            (Err(_), Ok(_)) => std::cmp::Ordering::Greater,
            (Err(_), Err(_)) => std::cmp::Ordering::Equal,
        });
        (!skip).then_some((*heading, *text, values))
    };
    KEYS.iter().filter_map(vary).collect()
}

fn at<'a>(cells: &[&'a Cell], text: KeyText, value: &str) -> Vec<&'a Cell> {
    cells.iter().copied().filter(|c| text(c) == value).collect()
}

/// The name of a value of a key; a missing signal-to-noise ratio means no noise.
fn called(value: &str) -> String {
    if value.is_empty() { "none".to_owned() } else { value.to_owned() }
}

/// A key that is a number, as the axis of pictures.
struct Key<'a> {
    heading: &'static str,
    text: KeyText,
    values: &'a [String],
    /// The axis as the script has it.
    axis: Value,
}

impl<'a> Key<'a> {
    /// `None` where more than one value is no number.
    fn of(heading: &'static str, text: KeyText, values: &'a [String]) -> Option<Self> {
        let numbers: Vec<f64> = values.iter().filter_map(|v| v.parse().ok()).collect();
        let (&low, [.., before, high]) = (numbers.first()?, numbers.as_slice()) else {
            return None;
        };
        if numbers.len() + 1 < values.len() {
            return None;
        }
        let log = low > 0.0 && *high >= WIDE_RANGE * low;
        // A value without a number, as a signal without noise, is one step behind the last.
        let beyond = if log { high * (high / before) } else { high + (high - before) };
        let x: Vec<f64> = values.iter().map(|v| v.parse().unwrap_or(beyond)).collect();
        let ticks: Vec<Value> = x.iter().zip(values).map(|(x, v)| json!([x, called(v)])).collect();
        let axis = json!({ "label": heading, "log": log, "values": x, "ticks": ticks });
        Some(Self { heading, text, values, axis })
    }

    /// A number of the cells at every value.
    fn row(&self, cells: &[&Cell], of: fn(&[&Cell]) -> Option<f64>) -> Vec<Option<f64>> {
        self.values.iter().map(|v| of(&at(cells, self.text, v)).and_then(brief)).collect()
    }
}

/// Every number against every key that is a number.
fn against(part: &Part<'_>) -> Vec<Value> {
    let varying = varying(part);
    let keys = varying.iter().filter_map(|(heading, text, values)| Key::of(heading, *text, values));
    keys.flat_map(|key| {
        MEASURES.iter().filter_map(|measure| plotted(part, &key, measure)).collect::<Vec<_>>()
    })
    .collect()
}

/// A number against a key, a curve per method; `None` where no method has it.
fn plotted(part: &Part<'_>, key: &Key<'_>, measure: &Measure) -> Option<Value> {
    let row = |(name, cells): &'_ (String, Vec<&Cell>)| (name.clone(), key.row(cells, measure.of));
    let rows: Vec<(String, Vec<Option<f64>>)> =
        part.methods.iter().map(row).filter(|(_, y)| y.iter().any(Option::is_some)).collect();
    if rows.is_empty() {
        return None;
    }
    // The curves that lie best, in the order of the study.
    let size = |y: &[Option<f64>]| {
        let there: Vec<f64> =
            y.iter().flatten().map(|v| (v - measure.good.unwrap_or(0.0)).abs()).collect();
        (y.len() - there.len(), there.iter().sum::<f64>() / there.len().max(1) as f64)
    };
    let mut sizes: Vec<(usize, f64)> = rows.iter().map(|(_, y)| size(y)).collect();
    sizes.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let open = |y: &[Option<f64>]| sizes.iter().take(OPEN_CURVES).any(|s| *s == size(y));
    let many = rows.len() > OPEN_CURVES + 2;
    let mut curves: Vec<Value> = rows
        .iter()
        .map(|(name, y)| json!({ "label": name, "y": y, "hidden": many && !open(y) }))
        .collect();
    let all: Vec<&Cell> = part.methods.iter().flat_map(|(_, cells)| cells).copied().collect();
    let bound = key.row(&all, |cells| median(cells, |c| c.bound_rms_samples));
    if measure.name == MEASURES[0].name && bound.iter().any(Option::is_some) {
        curves.push(
            json!({ "label": "Cramér-Rao bound", "y": bound, "color": "ink", "dash": [10, 5], "width": 2.2, "points": false }),
        );
    }
    let zeros = measure.log && rows.iter().any(|(_, y)| y.contains(&Some(0.0)));
    Some(json!({
        "kind": "lines", "keys": [part.name, key.heading, measure.name],
        "about": format!("{} of every method against {}", measure.name, key.heading),
        "says": zeros.then_some("An error of 0 has no place on a logarithmic axis and is left out; the heat map has it."),
        "x": key.axis,
        "y": { "label": measure.name, "log": measure.log, "range": measure.share.then_some([-0.02, 1.02]) },
        "curves": curves, "height": 400,
        "marks": measure.good.filter(|g| *g > 0.0).map(|g| vec![json!({ "value": g, "color": "measured" })]),
    }))
}

/// Method by the values of every key that varies.
fn heat(part: &Part<'_>) -> Vec<Value> {
    let mut views = Vec::new();
    for (heading, text, values) in varying(part) {
        let columns: Vec<String> = values.iter().map(|v| called(v)).collect();
        for measure in &MEASURES {
            let row = |(name, cells): &(String, Vec<&Cell>)| {
                let numbers: Vec<Option<f64>> = values
                    .iter()
                    .map(|v| (measure.of)(&at(cells, text, v)).and_then(brief))
                    .collect();
                let shown = |v: &Option<f64>| if measure.share { percent(*v) } else { number(*v) };
                let texts: Vec<String> = numbers.iter().map(shown).collect();
                numbers
                    .iter()
                    .any(Option::is_some)
                    .then(|| json!({ "name": name, "values": numbers, "texts": texts }))
            };
            let rows: Vec<Value> = part.methods.iter().filter_map(row).collect();
            if !rows.is_empty() {
                views.push(json!({
                    "kind": "heat", "keys": [part.name, heading, measure.name], "head": "method", "columns": columns, "rows": rows, "log": measure.log,
                    "from": measure.good, "caption": format!("{} by {heading}", measure.name), "about": format!("{} of every method by {heading}", measure.name),
                }));
            }
        }
    }
    views
}

/// Every method's error over its time, and those that no other beats in both.
fn pareto(part: &Part<'_>) -> Option<Value> {
    let point = |(name, cells): &(String, Vec<&Cell>)| {
        mostly(cells).then_some(())?;
        let time = mean(cells, |c| c.time_per_estimate_s).and_then(brief).filter(|t| *t > 0.0)?;
        Some((
            time,
            mean(cells, |c| c.rms_samples).map(settled).and_then(brief).filter(|e| *e > 0.0)?,
            name.clone(),
        ))
    };
    let mut points: Vec<(f64, f64, String)> = part.methods.iter().filter_map(point).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    if points.is_empty() {
        return None;
    }
    let mut least = f64::INFINITY;
    let mut first = Vec::new();
    for (at, (_, error, _)) in points.iter().enumerate() {
        if *error < least {
            least = *error;
            first.push(at);
        }
    }
    let all: Vec<f64> = points.iter().map(|p| p.1).collect();
    let front: Vec<Option<f64>> =
        (0..points.len()).map(|at| first.contains(&at).then(|| all[at])).collect();
    Some(json!({
        "kind": "lines", "keys": [part.name], "about": "RMS error of every method against the time of an estimate", "height": 420,
        "x": { "label": "time per estimate (s)", "log": true, "values": points.iter().map(|p| p.0).collect::<Vec<f64>>() },
        "y": { "label": "RMS error (samples)", "log": true },
        "curves": [
            { "label": "methods", "y": all, "color": "measured", "points": "only" },
            { "label": "best for their time", "y": front, "color": "after", "points": true },
        ],
        "names": points.iter().map(|p| p.2.clone()).collect::<Vec<String>>(), "first": first,
    }))
}

/// Whether half of the records have an answer at least: the answered records do not represent the method's accuracy.
fn mostly(cells: &[&Cell]) -> bool {
    of_all(cells, |c| c.flagged).is_some_and(|share| share <= 0.5)
}

/// The ratio of every method to the Cramér-Rao bound, where there is one.
fn bound(parts: &[Part<'_>]) -> Markup {
    let ratio = |cells: &[&Cell]| {
        median(cells, |c| Some(c.rms_samples? / c.bound_rms_samples?))
            .filter(|r| r.is_finite() && *r > 0.0 && mostly(cells))
    };
    let all: Vec<(&str, &str, f64)> = parts
        .iter()
        .flat_map(|p| {
            p.methods.iter().filter_map(move |(method, cells)| {
                Some((p.name.as_str(), method.as_str(), ratio(cells)?))
            })
        })
        .collect();
    let [low, high] =
        all.iter().fold([0.5_f64, 10.0_f64], |[low, high], (.., r)| [low.min(*r), high.max(*r)]);
    let on = |r: f64| (r / low).ln() / (high / low).ln();
    let row = |(name, method, ratio): &(&str, &str, f64)| {
        let drawn = html! { (stretch(on(1.0), on(*ratio), "range")) (stretch(on(1.0) - 0.002, on(1.0) + 0.002, "noise")) (dot(on(*ratio), "")) };
        let text = number(Some(*ratio));
        vec![
            Shown::Words((*method).to_owned()),
            Shown::Words((*name).to_owned()),
            Shown::Number(text.clone()),
            Shown::Drawn(bar(&format!("{text} times the bound"), &drawn)),
        ]
    };
    let rows: Vec<Vec<Shown>> = all.iter().map(row).collect();
    let ends = format!(
        "{} to {} on a logarithmic axis; the mark is 1",
        number(Some(low)),
        number(Some(high))
    );
    html! {
        @if !rows.is_empty() {
            h2 { "Efficiency: distance from the Cramér-Rao bound" }
            p { "1 is the least RMS error that an unbiased method can have. Medians over the cells that have a bound. A method that rounds to whole samples is not unbiased, so it can be below. " (MOSTLY) }
            (sorted("RMS error over the bound", &["method", "cells", "times the bound", &ends], &rows))
        }
    }
}

/// The coverage of the intervals.
fn coverage(parts: &[Part<'_>]) -> Markup {
    let row = |name: &str, method: &str, cells: &[&Cell]| {
        let intervals: usize = cells.iter().map(|c| c.intervals).sum();
        let held: f64 = cells.iter().filter_map(|c| Some(c.coverage95? * c.intervals as f64)).sum();
        let [low, high] = wilson((held.round() as usize).min(intervals), intervals)?;
        let share = held / intervals as f64;
        let (text, interval) =
            (percent(Some(share)), format!("{} to {}", percent(Some(low)), percent(Some(high))));
        let drawn = html! { (stretch(0.948, 0.952, "noise")) (stretch(low, high, "range")) (dot(share, "")) };
        let cells = [
            Shown::Words(method.to_owned()),
            Shown::Words(name.to_owned()),
            Shown::Number(intervals.to_string()),
            Shown::Number(text.clone()),
        ];
        let mut cells = Vec::from(cells);
        cells.extend([
            Shown::Number(interval),
            Shown::Drawn(bar(&format!("{text} of the intervals"), &drawn)),
        ]);
        Some(cells)
    };
    let rows: Vec<Vec<Shown>> = parts
        .iter()
        .flat_map(|p| p.methods.iter().filter_map(|(method, cells)| row(&p.name, method, cells)))
        .collect();
    html! {
        @if !rows.is_empty() {
            h2 { "Coverage: the truth in the 95 % interval" }
            p { "A calibrated interval holds the truth in 95 % of the records, which the mark shows." }
            (sorted("Share of the intervals that hold the truth, all records together", &["method", "cells", "intervals", "share", "its 95 % interval", "0 to 100 %"], &rows))
        }
    }
}

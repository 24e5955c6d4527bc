//! Parameters of a model file from logs as a page: the new value of each, the combinations that are not identifiable, errors over the horizon.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::frame::{Cell, figure, page, quoted, sorted};
use super::series::{briefly, labelled, picked, thinned};
use crate::report::diagnosis::base;
use crate::report::structured::{determined, digits, fitted, how_unseen, meaning, standing};
use crate::report::terminal::axis::Axis;
use deadtime_identify::structured::{
    FreeParameter, GroupScore, Standing, StructuredFit, Unseen, WindowRun,
};
use deadtime_signal::stats::NORMAL_95;

/// The axis of the parameters, in times the file's value: values beyond are an arrow at its end.
const TIMES: [f64; 2] = [-1.0, 3.0];

/// The page.
#[must_use]
pub fn structured(found: &StructuredFit) -> String {
    let count = |of: Standing| found.parameters.iter().filter(|p| p.standing == of).count();
    let kinds = [Standing::Physical, Standing::Surrogate, Standing::Open, Standing::Unchecked]
        .map(|s| (standing(s), count(s)));
    let said: Vec<String> = kinds
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    let body = html! {
        h1 { "Parameters of " (found.name) }
        p .verdict { strong { (found.parameters.len()) } " parameters: " (said.join(", ")) "." }
        @if !found.converged { p { strong { "Beware: " } "the search did not end at a minimum." } }
        p .faint {
            (found.windows) " windows of " (found.horizon) " steps of " (found.sample_time_s) " s in " (found.clusters) " clusters. " (determined(found))
        }
        h2 { "Parameters" }
        (parameters(&found.parameters.iter().map(drawn).collect::<Vec<_>>(), true))
        @for said in [Standing::Surrogate, Standing::Open, Standing::Unchecked].into_iter().filter_map(|s| meaning(found, s)) { p { (said) } }
        (not_identifiable(&found.unseen, &found.trades))
        @if !found.per_record.is_empty() { h2 { "What stands off by record" } (by_record(found)) }
        @if !found.runs.is_empty() {
            h2 { "Measured and predicted" }
            p { (if found.held_out.is_some() { "Held-out logs. " } else { "Training logs. " }) "Each window of " (found.horizon) " steps is predicted from its measured start." }
            p { span .key.measured { "measured" } span .key.before { "the file's model" } span .key.after { "fitted" } }
            (figure("run", "The predictions"))
        }
        h2 { "Errors over the horizon" }
        p { "Mean absolute error so many steps after a window's start, of the model as the file has it and as it was fitted." }
        (figure("errors", "The picture"))
        (errors("On the training logs", &found.training))
        @if let Some(held_out) = &found.held_out { (errors("On the logs held out", held_out)) }
    };
    page(
        &format!("Parameters of {}", found.name),
        &body,
        &json!({ "kind": "structured", "figures": figures(found) }),
    )
}

fn drawn(p: &FreeParameter) -> Drawn {
    Drawn {
        name: p.name.clone(),
        unit: p.unit.clone(),
        nominal: p.nominal,
        value: p.value,
        interval: Some(p.interval),
        one_step: p.one_step,
        standing: p.standing,
    }
}

/// A parameter as the table has it.
pub(super) struct Drawn {
    pub(super) name: String,
    pub(super) unit: Option<String>,
    pub(super) nominal: f64,
    pub(super) value: f64,
    pub(super) interval: Option<[f64; 2]>,
    /// Value and standard deviation of single steps.
    pub(super) one_step: Option<[f64; 2]>,
    pub(super) standing: Standing,
}

/// Every parameter; the bar in times the file's value. `single` has a column of what single steps ask for.
pub(super) fn parameters(all: &[Drawn], single: bool) -> Markup {
    let Some(axis) = Axis::over(std::iter::once(TIMES), usize::MAX) else { return html! {} };
    let row = |p: &Drawn| {
        let (value, ends) = fitted(p.value, p.interval);
        let interval = ends.map_or_else(|| "–".to_owned(), |ends| ends.join(" to "));
        let drawn = html! {
            @if p.nominal != 0.0 && p.nominal.is_finite() {
                @if let Some(ends) = p.interval {
                    @let [a, b] = ends.map(|v| axis.share(v / p.nominal));
                    (stretch(a.min(b), a.max(b), "range"))
                }
                (dot(axis.share(1.0), "aside"))
                (dot(axis.share(p.value / p.nominal), ""))
            }
        };
        let mut cells = vec![
            Cell::Words(p.name.clone()),
            Cell::Words(p.unit.clone().unwrap_or_default()),
            Cell::Number(digits(p.nominal)),
            Cell::Number(value.clone()),
            Cell::Number(interval.clone()),
            Cell::Drawn(bar(
                &format!("{} in the file, {value} found, 95 %: {interval}", digits(p.nominal)),
                &drawn,
            )),
        ];
        if single {
            let one = p.one_step.map_or_else(
                || "–".to_owned(),
                |[v, s]| format!("{} ± {}", digits(v), digits(NORMAL_95 * s)),
            );
            cells.push(Cell::Number(one));
        }
        cells.push(Cell::Words(standing(p.standing).to_owned()));
        cells
    };
    let rows: Vec<Vec<Cell>> = all.iter().map(row).collect();
    let mut headings =
        vec!["parameter", "unit", "file", "found", "95 % interval", "−1 to 3 times the file"];
    if single {
        headings.push("one step ahead");
    }
    headings.push("standing");
    sorted(
        "Parameters; the grey point is the file's value, an arrow is beyond the axis",
        &headings,
        &rows,
    )
}

/// The combinations that are not identifiable, if any.
pub(super) fn not_identifiable(unseen: &[Unseen], trades: &[String]) -> Markup {
    html! {
        @if !unseen.is_empty() || !trades.is_empty() {
            h2 { "Not identifiable" }
            ul {
                @for unseen in unseen { li { (quoted(&unseen.words)) " (standard deviation " (how_unseen(unseen.std)) ")" } }
                @for trade in trades { li { (quoted(trade)) } }
            }
        }
    }
}

fn by_record(found: &StructuredFit) -> Markup {
    let row = |(name, record, value): &(String, String, f64)| {
        vec![Cell::Words(name.clone()), Cell::Words(record.clone()), Cell::Number(digits(*value))]
    };
    sorted(
        "What stands off by record",
        &["parameter", "record", "by"],
        &found.per_record.iter().map(row).collect::<Vec<_>>(),
    )
}

fn errors(caption: &str, [before, after]: &[Vec<GroupScore>; 2]) -> Markup {
    let row = |(before, after): (&GroupScore, &GroupScore)| {
        let last =
            |g: &GroupScore| g.mean_absolute.last().map_or_else(|| "–".to_owned(), |v| digits(*v));
        vec![
            Cell::Words(before.group.clone()),
            Cell::Words(before.unit.clone().unwrap_or_default()),
            Cell::Number(last(before)),
            Cell::Number(last(after)),
            Cell::Number(digits(before.sum)),
            Cell::Number(digits(after.sum)),
        ]
    };
    let headings = [
        "group",
        "unit",
        "file, last step",
        "fitted, last step",
        "file, sum over steps",
        "fitted, sum over steps",
    ];
    sorted(caption, &headings, &before.iter().zip(after).map(row).collect::<Vec<_>>())
}

fn figures(found: &StructuredFit) -> Vec<Value> {
    let brief = |values: &[f64]| briefly(values.iter().copied());
    let parts =
        [("training logs", Some(&found.training)), ("logs held out", found.held_out.as_ref())];
    let view = |which: &str, before: &GroupScore, after: &GroupScore| {
        let unit = before.unit.as_ref().map_or_else(String::new, |u| format!(" ({u})"));
        let steps: Vec<usize> = (1..=before.mean_absolute.len()).collect();
        json!({
            "kind": "lines", "keys": [which, before.group], "about": format!("Mean absolute error of {} over the horizon, {which}", before.group),
            "x": { "label": "steps after a window's start", "values": steps }, "y": { "label": format!("mean absolute error{unit}") },
            "curves": [
                { "label": "as the file has it", "y": brief(&before.mean_absolute), "color": "before", "points": false },
                { "label": "fitted", "y": brief(&after.mean_absolute), "color": "after", "points": false },
            ],
        })
    };
    let views: Vec<Value> = parts
        .into_iter()
        .filter_map(|(which, both)| Some((which, both?)))
        .flat_map(|(which, [before, after])| {
            before.iter().zip(after).map(|(b, a)| view(which, b, a)).collect::<Vec<_>>()
        })
        .collect();
    let runs = picked("run", &["output", "record"], runs(&found.runs));
    runs.into_iter().chain(picked("errors", &["logs", "group"], views)).collect()
}

/// Every output of every record: measured, and predicted by both models.
fn runs(all: &[WindowRun]) -> Vec<Value> {
    // Logs of one name in different folders keep their folders.
    let named = |run: &WindowRun| {
        let same = |other: &WindowRun| {
            base(&other.source) == base(&run.source) && other.source != run.source
        };
        if all.iter().any(same) { run.source.clone() } else { base(&run.source).to_owned() }
    };
    let view = |run: &WindowRun| {
        let [before, after] = &run.predicted;
        json!({
            "kind": "lines", "keys": [run.output, named(run)],
            "about": format!("{}, measured and predicted", run.output),
            "x": { "label": "time (s)", "values": thinned(&run.time_s), "tight": true }, "y": { "label": labelled(&run.output, run.unit.as_deref()) },
            "curves": [
                { "label": "measured", "y": thinned(&run.measured), "color": "measured", "points": false },
                { "label": "the file's model", "y": thinned(before), "color": "before", "points": false },
                { "label": "fitted", "y": thinned(after), "color": "after", "points": false },
            ],
        })
    };
    all.iter().map(view).collect()
}

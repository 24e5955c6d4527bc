//! Results side by side as a page: before and after a repair, the machines of a fleet, studies of two versions.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::frame::{Cell, figure, given, page, percent, quoted, table};
use super::series::picked;
use crate::report::compare::{
    MEASURES, agreement, by_method, findings, part_text, shared_cells, value_text, values,
};
use crate::report::terminal::axis::Axis;
use deadtime_study::compare::{CauseValue, Diagnoses, ParameterRow, Studies};

/// Diagnoses side by side.
#[must_use]
pub fn compared_diagnoses(found: &Diagnoses) -> String {
    let body = html! {
        h1 { (found.names.len()) " diagnoses side by side" }
        @for (at, said) in findings(found).iter().enumerate() {
            @if at == 0 { p .verdict { (quoted(said)) } } @else { p { (quoted(said)) } }
        }
        h2 { "How far each is from its machine" }
        p { span .key.before { "as it came" } " " span .key.after { "with its causes" } " " span .key.measured { "noise" } }
        (standings(found))
        @if !found.causes.is_empty() {
            h2 { "Which causes" }
            p { "The part of the gap that each cause takes; more colour is more, a dash is none." }
            (figure("causes", "The matrix"))
        }
        @if !found.parameters.is_empty() {
            h2 { "Do they agree on the parameters?" }
            p { "Each parameter on an axis of its own with its 95\u{a0}% interval. One value for all is tested at a level of 5\u{a0}%, divided by the number of tests." }
            @for row in &found.parameters { (numbers(found, row)) }
            details { summary { "All parameters as a table" } @if let Some(table) = values(found) { (given("Parameters of the causes", &table)) } }
        }
    };
    page("Diagnoses side by side", &body, &json!({ "kind": "compare", "figures": matrix(found) }))
}

/// Errors on one axis.
fn standings(found: &Diagnoses) -> Markup {
    let most = found
        .diagnoses
        .iter()
        .flat_map(|d| [d.before, d.after])
        .flatten()
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let scale = |v: f64| if most > 0.0 { v / most } else { 0.0 };
    let rows: Vec<Vec<Cell>> = found
        .names
        .iter()
        .zip(&found.diagnoses)
        .map(|(name, d)| {
            let label = format!("{} as it came, {} with its causes, noise {}", percent(d.before), percent(d.after), percent(d.floor));
            let drawn = html! {
                @if let Some(before) = d.before { (stretch(d.after.map_or(0.0, scale), scale(before), "before")) }
                @if let Some(after) = d.after { (stretch(0.0, scale(after), "")) }
                @if let Some(floor) = d.floor { (dot(scale(floor), "aside")) }
            };
            let ends = d.ci95.map_or_else(|| "–".to_owned(), |[low, high]| format!("{} to {}", percent(Some(low)), percent(Some(high))));
            vec![
                Cell::Words(name.clone()),
                Cell::Words(d.verdict.clone()),
                Cell::Drawn(bar(&label, &drawn)),
                Cell::Number(percent(d.before)),
                Cell::Number(percent(d.after)),
                Cell::Number(percent(d.floor)),
                Cell::Number(percent(d.fraction)),
                Cell::Number(ends),
            ]
        })
        .collect();
    table(
        "Held-out nrmse",
        &[
            "diagnosis",
            "verdict",
            "",
            "as it came",
            "with its causes",
            "noise",
            "shrink",
            "95 % interval",
        ],
        &rows,
    )
}

/// A number of every diagnosis on its own axis.
fn numbers(found: &Diagnoses, row: &ParameterRow) -> Markup {
    let held = |v: &CauseValue| v.ci95.unwrap_or([v.value, v.value]);
    let axis = Axis::over(row.values.iter().flatten().map(held).chain(row.mean_ci95), usize::MAX);
    let line = |name: &str, v: &CauseValue, class: &str| {
        let drawn = html! {
            @if let Some(axis) = axis {
                @if let Some([low, high]) = v.ci95 { (stretch(axis.share(low), axis.share(high), &format!("range {class}"))) }
                (dot(axis.share(v.value), class))
            }
        };
        let text = value_text(v);
        vec![
            Cell::Words(name.to_owned()),
            Cell::Number(text.clone()),
            Cell::Drawn(bar(&text, &drawn)),
        ]
    };
    let mut rows: Vec<Vec<Cell>> = found
        .names
        .iter()
        .zip(&row.values)
        .filter_map(|(name, v)| Some(line(name, v.as_ref()?, "")))
        .collect();
    if let Some(value) = row.mean {
        rows.push(line("one value for all", &CauseValue { value, ci95: row.mean_ci95 }, "aside"));
    }
    let unit = if row.unit == "1" { String::new() } else { format!(", {}", row.unit) };
    let caption = format!("{} of {}{unit}: agree: {}", row.parameter, row.cause, agreement(row));
    let heading = format!("{} (95 %){unit}", row.parameter);
    html! { (table(&caption, &["diagnosis", &heading, ""], &rows)) }
}

fn matrix(found: &Diagnoses) -> Vec<Value> {
    if found.causes.is_empty() {
        return Vec::new();
    }
    let row = |cause: &deadtime_study::compare::CauseRow| {
        // A found effect without a share is shown all the same.
        let values: Vec<Option<f64>> = cause
            .parts
            .iter()
            .map(|p| p.as_ref().map(|p| p.share.unwrap_or(1.0).max(0.0)))
            .collect();
        let texts: Vec<String> = cause
            .parts
            .iter()
            .map(|p| p.as_ref().map_or_else(|| "–".to_owned(), part_text))
            .collect();
        json!({ "name": cause.cause, "values": values, "texts": texts })
    };
    vec![json!({ "id": "causes", "views": [{
        "kind": "heat", "head": "cause", "columns": found.names, "rows": found.causes.iter().map(row).collect::<Vec<Value>>(), "from": 0.0,
        "caption": "Share of the gap by cause and diagnosis", "about": "Share of the gap by cause and diagnosis",
    }] })]
}

/// Studies side by side.
#[must_use]
pub fn compared_studies(found: &Studies) -> String {
    let rows: Vec<Vec<Cell>> = found
        .names
        .iter()
        .zip(&found.studies)
        .map(|(name, s)| {
            let words = [name.clone(), s.plan.clone(), s.program.clone()].map(Cell::Words);
            words
                .into_iter()
                .chain([s.seed.to_string(), s.cells.to_string()].map(Cell::Number))
                .collect()
        })
        .collect();
    let body = html! {
        h1 { (found.names.len()) " studies side by side" }
        p .verdict { (quoted(&shared_cells(found))) }
        (table("What was run", &["study", "plan", "program", "seed", "cells"], &rows))
        @if found.shared > 0 {
            h2 { "Method by study" }
            p { "Means over the cells that all studies have. More colour is worse; a heading sorts." }
            (figure("methods", "The heat map"))
            h2 { "Tables" }
            @for measure in &MEASURES { @if let Some(table) = by_method(found, measure) { details { summary { (measure.name) } (given(measure.name, &table)) } } }
        }
    };
    let views: Vec<Value> = MEASURES
        .iter()
        .filter_map(|measure| {
            let row = |m: &deadtime_study::compare::MethodRow| {
                let values = (measure.of)(m);
                let texts: Vec<String> = values.iter().map(|v| (measure.text)(*v)).collect();
                values.iter().any(Option::is_some).then(|| json!({ "name": m.method, "values": values, "texts": texts }))
            };
            let rows: Vec<Value> = found.methods.iter().filter_map(row).collect();
            (!rows.is_empty()).then(|| {
                json!({
                    "kind": "heat", "keys": [measure.name], "head": "method", "columns": found.names, "rows": rows, "log": measure.log, "from": measure.from,
                    "caption": format!("{} by study", measure.name), "about": format!("{} of every method by study", measure.name),
                })
            })
        })
        .collect();
    let figures: Vec<Value> = picked("methods", &["number"], views).into_iter().collect();
    page("Studies side by side", &body, &json!({ "kind": "compare", "figures": figures }))
}

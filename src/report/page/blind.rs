//! The check on withheld effects as a page: scores with their intervals, truth by verdict, and the calibration of the probabilities.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::frame::{Cell, figure, given, page, sorted};
use crate::report::blind::{ends, headline, number, tables};
use deadtime_study::blind::{BlindScore, SCORES, Score};

/// The page.
#[must_use]
pub fn blind(scores: &BlindScore) -> String {
    let body = html! {
        h1 { "Withheld effects" }
        p .verdict { (headline(scores)) "." }
        (overall(scores))
        h2 { "Truth and verdict" }
        p { "Rows are the truth, columns the verdict; the cells count cases, and more colour is more." }
        (figure("confusion", "The matrix"))
        h2 { "Calibration of the probabilities" }
        p { "Of the verdicts with a probability of 80 %, 80 % should be exactly right: then the curve lies on the dashed line." }
        (figure("reliability", "The curve"))
        h2 { "Tables" }
        // The first is drawn above.
        @for (title, table) in tables(scores).iter().skip(1) { details { summary { (title) } (given(title, table)) } }
    };
    page("Withheld effects", &body, &json!({ "kind": "blind", "figures": figures(scores) }))
}

/// Every score with its interval; those that are shares on an axis from 0 to 1.
fn overall(scores: &BlindScore) -> Markup {
    let share = |s: &Score| {
        s.value.is_some_and(|v| (0.0..=1.0).contains(&v))
            && s.ci95.is_none_or(|[l, h]| l >= 0.0 && h <= 1.0)
    };
    let row = |(name, summary, score): (&str, &str, &Score)| {
        let label = format!("{} ({})", number(score.value), ends(score.ci95));
        let drawn = html! {
            @if let (true, Some(value)) = (share(score), score.value) {
                @if let Some([low, high]) = score.ci95 { (stretch(low, high, "range")) }
                (dot(value, ""))
            }
        };
        vec![
            Cell::Words(name.to_owned()),
            Cell::Number(number(score.value)),
            Cell::Number(ends(score.ci95)),
            Cell::Number(score.count.to_string()),
            Cell::Drawn(bar(&label, &drawn)),
            Cell::Words(summary.to_owned()),
        ]
    };
    let (said, silent): (Vec<_>, Vec<_>) =
        SCORES.iter().zip(&scores.scores).partition(|(_, s)| s.value.is_some());
    let rows: Vec<Vec<Cell>> = said.into_iter().map(|(d, s)| row((s.name, d.summary, s))).collect();
    let silent: Vec<&str> = silent.into_iter().map(|(_, s)| s.name).collect();
    html! {
        h2 { "Scores" }
        (sorted("Over all cases", &["score", "value", "95 % interval", "of", "0 to 1", "what it says"], &rows))
        @if !silent.is_empty() { p { "No case asks for these: " (silent.join(", ")) "." } }
    }
}

fn figures(scores: &BlindScore) -> Vec<Value> {
    let mut figures = Vec::new();
    let (mut truths, mut verdicts): (Vec<&str>, Vec<&str>) = (Vec::new(), Vec::new());
    for cell in &scores.confusion {
        if !truths.contains(&cell.truth.as_str()) {
            truths.push(&cell.truth);
        }
    }
    // Columns in the order of the rows, so that right verdicts are on the diagonal.
    verdicts.extend(truths.iter().filter(|t| scores.confusion.iter().any(|c| c.verdict == **t)));
    for cell in &scores.confusion {
        if !verdicts.contains(&cell.verdict.as_str()) {
            verdicts.push(&cell.verdict);
        }
    }
    let count = |truth: &str, verdict: &str| {
        let cases = scores
            .confusion
            .iter()
            .filter(|c| c.truth == truth && c.verdict == verdict)
            .map(|c| c.cases)
            .sum::<usize>();
        (cases > 0).then_some(cases)
    };
    let row = |truth: &&str| {
        let values: Vec<Option<usize>> = verdicts.iter().map(|v| count(truth, v)).collect();
        let texts: Vec<String> =
            values.iter().map(|v| v.map_or_else(String::new, |v| v.to_string())).collect();
        json!({ "name": truth, "values": values, "texts": texts })
    };
    if !truths.is_empty() {
        figures.push(json!({ "id": "confusion", "views": [{
            "kind": "heat", "head": "truth", "columns": verdicts, "rows": truths.iter().map(row).collect::<Vec<Value>>(), "from": 0.0,
            "caption": "Cases by truth and verdict", "about": "Cases by truth and verdict",
        }] }));
    }
    let bins: Vec<[f64; 4]> = scores
        .reliability
        .iter()
        .filter_map(|b| {
            let [low, high] = b.ci95?;
            Some([b.probability?, b.exact?, low, high])
        })
        .collect();
    if !bins.is_empty() {
        let of = |i: usize| bins.iter().map(|b| b[i]).collect::<Vec<f64>>();
        figures.push(json!({ "id": "reliability", "views": [{
            "kind": "lines", "about": "Share of verdicts that are exactly right against their probability",
            "x": { "label": "mean probability", "values": of(0) }, "y": { "label": "exactly right", "range": [-0.02, 1.02] },
            "curves": [
                { "label": "exactly right", "y": of(1), "low": of(2), "high": of(3), "color": "after" },
                { "label": "calibrated", "y": of(0), "color": "measured", "dash": [8, 5], "points": false },
            ],
        }] }));
    }
    figures
}

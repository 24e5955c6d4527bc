//! Dead times as a page: input and output, the output shifted back by the answer, every method's answer on one axis.

use maud::{Markup, PreEscaped, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::curves;
use super::frame::{Cell, figure, page, plots, quoted, table};
use super::series::{Thinning, base64, brief, picked};
use crate::report::diagnosis::base;
use crate::report::estimate::{preamble, single_events, warning};
use crate::report::picture::{Shown, svg};
use crate::report::standing::{Standing, reason};
use crate::report::terminal::axis::Axis;
use crate::report::terminal::delay::without_lists;
use crate::report::text::{delay, delay_cells, seconds};
use deadtime_delay::Evidence;
use deadtime_delay::report::{Estimate, Pair, Report, Response};
use deadtime_delay::track::Tracked;
use deadtime_log::Log;

/// Records that the page holds.
const LOGS: usize = 40;

/// The page of a report, with its records and the methods' intermediate results, as many as pairs.
#[must_use]
pub fn estimate(report: &Report, logs: &[Log], evidence: &[Option<Evidence>]) -> String {
    let body = html! {
        h1 { "Dead time in " (base(&report.log)) }
        p .faint { (about(report)) "." }
        @for pair in &report.pairs { (verdict(pair, report.sample_time_s)) }
        @if !logs.is_empty() {
            h2 { "Input and output" }
            p {
                span .key.input { "input" }
                span .key.after { "output" }
            }
            p { "Below each pair the output is shifted back by the answer: a response then begins under the command that it answers." }
            (plots("The curves"))
            @if logs.len() > LOGS { p .faint { "The first " (LOGS) " of " (logs.len()) " records." } }
        }
        @if report.pairs.iter().any(|p| p.track.is_some()) {
            h2 { "Dead time against time" }
            p { "With its 95 % band, which is wide where the input does not move." }
            (figure("track", "The track"))
        }
        @for (at, pair) in report.pairs.iter().enumerate() {
            (methods(pair, report.sample_time_s))
            @let response = evidence.get(at).and_then(Option::as_ref).and_then(|e| e.response.as_ref());
            @if let Some(response) = response { (picture(pair, response, report.sample_time_s)) }
        }
        @if evidence.iter().flatten().next().is_some() {
            h2 { "What the methods look at" }
            p { "Lags count from the command's sample, hold and relative degree included: what the raw answers count. A point marks the answer of a method that looks at the curve." }
            (figure("evidence", "The curve"))
        }
    };
    page(&format!("Dead time in {}", base(&report.log)), &body, &data(report, logs, evidence))
}

/// The preamble, with the base name of the log.
fn about(report: &Report) -> String {
    let text = preamble(report);
    match text.strip_prefix(&report.log) {
        Some(rest) => format!("{}{rest}", base(&report.log)),
        None => text,
    }
}

fn target(pair: &Pair) -> &str {
    if pair.output == "*" { "the states" } else { &pair.output }
}

fn verdict(pair: &Pair, step_s: f64) -> Markup {
    html! {
        h3 { (pair.input) " → " (target(pair)) }
        @match pair.verdict.delay_s.map(|v| delay(v, pair.verdict.ci95_s, step_s)) {
            Some((value, Some([from, to]))) => p .verdict {
                "Dead time " strong { (value) " s" } " (95 %: " (from) " to " (to) " s)."
            },
            _ if pair.moving.is_some() => {},
            _ => p .verdict { strong { "No trusted dead time." } },
        }
        p { (quoted(&without_lists(&pair.verdict.why, pair))) "." }
        @if let Some(jitter) = &pair.jitter { p { (single_events(jitter, step_s)) "." } }
        @if let Some(warning) = warning(pair, step_s) { p { strong { "Warning: " } (warning) "." } }
        @if !pair.findings.is_empty() {
            p { "The record shows " @for (at, f) in pair.findings.iter().enumerate() { @if at > 0 { "; " } (f.condition.words()) " (" (quoted(&f.evidence)) ")" } "." }
        }
    }
}

/// Every method on a common axis.
fn methods(pair: &Pair, step_s: f64) -> Markup {
    let used = |e: &&Estimate| Standing::of(pair, e).used();
    let counted = || pair.estimates.iter().filter(used).filter_map(|e| e.ci95_s);
    let axis = match (pair.verdict.delay_s, pair.verdict.ci95_s) {
        (Some(delay), Some(ci)) => Axis::around(delay, ci, counted(), usize::MAX),
        _ => Axis::over(pair.estimates.iter().filter_map(|e| e.ci95_s), usize::MAX),
    };
    let row = |e: &Estimate| {
        let [value, interval] = delay_cells(e.delay_s, e.ci95_s, step_s);
        let standing = Standing::of(pair, e);
        let aside = if standing.used() { "" } else { "aside" };
        let why = reason(e).filter(|_| standing == Standing::LeftOut);
        let counts = match why {
            Some(why) => format!("{}: {why}", standing.word()),
            None if standing == Standing::Silent => e.outcome.name().replace('_', " "),
            None => standing.word().to_owned(),
        };
        let drawn = html! {
            @if let (Some(axis), Some(delay)) = (axis, e.delay_s) {
                @if let Some([from, to]) = pair.verdict.ci95_s { (stretch(axis.share(from), axis.share(to), "band")) }
                @if let Some([from, to]) = e.ci95_s { (stretch(axis.share(from), axis.share(to), &format!("range {aside}"))) }
                (dot(axis.share(delay), aside))
            }
        };
        let label = format!("{value} s, interval {interval} s");
        let texts = [Cell::Words(e.method.clone()), Cell::Number(value), Cell::Number(interval)];
        let mut cells: Vec<Cell> = texts.into();
        cells.extend([
            Cell::Drawn(bar(&label, &drawn)),
            Cell::Words(counts),
            Cell::Words(e.note.as_deref().unwrap_or_default().to_owned()),
        ]);
        cells
    };
    let all = |counting: bool| {
        pair.estimates.iter().filter(|e| used(e) == counting).map(row).collect::<Vec<Vec<Cell>>>()
    };
    let (open, aside) = (all(true), all(false));
    let ends =
        axis.map_or_else(String::new, |a| a.ends().map(|v| seconds(v, step_s)).join(" to ") + " s");
    let headings = ["method", "answer (s)", "95 % interval (s)", &ends, "in the verdict", "note"];
    html! {
        h2 { "Methods: " (pair.input) " → " (target(pair)) }
        @if !open.is_empty() { (table("Answers that the verdict uses; the band is the verdict's interval, and an arrow marks an answer beyond the axis", &headings, &open)) }
        @if !aside.is_empty() { details open[open.is_empty()] { summary { (aside.len()) " left out or without an answer" } (table("Answers that the verdict leaves out", &headings, &aside)) } }
    }
}

/// The impulse response with its threshold, which the delay is seen in by eye.
fn picture(pair: &Pair, response: &Response, step_s: f64) -> Markup {
    let drawn = svg(&[Shown { pair, response: Some(response) }], step_s);
    let source = format!("data:image/svg+xml;base64,{}", base64(drawn.bytes()));
    html! {
        details {
            summary { "Impulse response of " (pair.input) " → " (target(pair)) }
            img src=(PreEscaped(source)) style="max-width:100%;height:auto" alt={ "Answers of the methods above the estimated impulse response from " (pair.input) " to " (target(pair)) };
        }
    }
}

/// Points of a track that are drawn.
const POINTS: usize = 4000;

/// The dead time of every record over its time. A group of neighbouring samples beyond the drawn number has its mean, and the widest ends of its bands.
fn tracks(pair: &Pair, track: &Tracked) -> Vec<Value> {
    let records = track.record.iter().max().map_or(0, |last| last + 1);
    let view = |record: usize| {
        let at: Vec<usize> =
            (0..track.record.len()).filter(|&i| track.record[i] == record).collect();
        let parts: Vec<&[usize]> = at.chunks(at.len().div_ceil(POINTS).max(1)).collect();
        let of = |values: &[f64], fold: fn(&[f64]) -> f64| -> Vec<Option<f64>> {
            let part = |p: &&[usize]| {
                brief(fold(&p.iter().filter_map(|&i| values.get(i).copied()).collect::<Vec<_>>()))
            };
            parts.iter().map(part).collect()
        };
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        let low = of(&track.low_s, |v| v.iter().copied().fold(f64::INFINITY, f64::min));
        let high = of(&track.high_s, |v| v.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        (!parts.is_empty()).then(|| {
            json!({
                "kind": "lines", "keys": [format!("{} → {}", pair.input, target(pair)), format!("record {}", record + 1)],
                "about": format!("Dead time from {} to {} over time", pair.input, target(pair)),
                "x": { "label": "time (s)", "values": of(&track.time_s, mean), "tight": true }, "y": { "label": "dead time (s)" },
                "curves": [{ "label": "dead time", "y": of(&track.delay_s, mean), "low": low, "high": high, "color": "after", "points": false, "width": 2.2 }],
            })
        })
    };
    (0..records.min(LOGS)).filter_map(view).collect()
}

/// The data of the script: every pair of two channels, record by record.
fn data(report: &Report, logs: &[Log], evidence: &[Option<Evidence>]) -> Value {
    let pairs: Vec<&Pair> = report.pairs.iter().filter(|p| p.output != "*").collect();
    let shown = logs.len().min(LOGS);
    let samples: usize = logs.iter().take(shown).map(Log::len).sum();
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    let record = |(at, log): (usize, &Log)| {
        let time_s: Vec<f64> =
            log.time_s().iter().map(|t| t - log.time_s().first().unwrap_or(&0.0)).collect();
        let thinning = Thinning::share(&time_s, 2 * pairs.len(), samples);
        let one = |pair: &&Pair| {
            let (u, y) = (log.channel(&pair.input).ok()?, log.channel(&pair.output).ok()?);
            let unit = |name: &str| log.unit(name).filter(|u| *u != "1").unwrap_or("").to_owned();
            let (inward, outward) = (u.samples(), y.samples());
            Some(json!({
                "input": pair.input,
                "output": pair.output,
                "label_u": "input",
                "unit_u": unit(&pair.input),
                "unit_y": unit(&pair.output),
                "u": thinning.curve(|i| inward.get(i), all),
                "y": thinning.curve(|i| outward.get(i), all),
                "delay_s": pair.verdict.delay_s,
            }))
        };
        let name = if logs.len() > 1 {
            format!("record {}", at + 1)
        } else {
            base(log.source()).to_owned()
        };
        json!({ "name": name, "bucket": thinning.bucket(), "time": thinning.times(&time_s), "pairs": pairs.iter().filter_map(one).collect::<Vec<Value>>() })
    };
    let tracks: Vec<Value> = report
        .pairs
        .iter()
        .filter_map(|p| Some((p, p.track.as_ref()?)))
        .flat_map(|(p, t)| tracks(p, t))
        .collect();
    let pairs_and_curves =
        report.pairs.iter().zip(evidence).filter_map(|(pair, e)| Some((pair, e.as_ref()?)));
    let curves: Vec<Value> = pairs_and_curves
        .flat_map(|(pair, e)| curves::curves(pair, e, report.sample_time_s))
        .collect();
    let figures = [
        picked("track", &["pair", "record"], tracks),
        picked("evidence", &["pair", "curve"], curves),
    ];
    let figures: Vec<Value> = figures.into_iter().flatten().collect();
    json!({ "kind": "estimate", "figures": figures, "logs": logs.iter().take(shown).enumerate().map(record).collect::<Vec<Value>>(), "opens": 0 })
}

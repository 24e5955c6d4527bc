//! Frequency responses from records as a page: gain, phase and coherence over frequency, with 95 % bands.

use maud::html;
use serde_json::{Value, json};

use super::bode;
use super::bode::Curve;
use super::frame::{figure, given, page, quoted};
use crate::report::diagnosis::base;
use crate::report::response::{Report, table};
use deadtime_identify::response::Point;

/// The name of a pair and its points.
type Named = (String, Vec<Point>);

/// The page.
#[must_use]
pub fn response(report: &Report<'_>) -> String {
    let r = report.responses;
    let logs: Vec<&str> = report.logs.iter().map(|log| base(log)).collect();
    let title = format!("Frequency responses of {}", logs.join(", "));
    let name = |(input, output): (usize, usize)| {
        format!("{} → {}", r.inputs[input].name, r.outputs[output].name)
    };
    let body = html! {
        h1 { (title) }
        p .verdict { (report.headline()) "." }
        @for note in &r.notes { p { (quoted(note)) } }
        p { "Bands hold 95 % of each value on its own; the phase has none where the interval of its gain holds 0. The curve of the phase has no jumps of 360°; the phases of the table lie within ±180°." }
        (figure("gain", "The gain"))
        (figure("phase", "The phase"))
        (figure("coherence", "The coherence"))
        @for pair in report.pairs() {
            h2 { (name(pair)) }
            (given(&format!("Some frequencies of {}", name(pair)), &table(&r.pair(pair.1, pair.0))))
        }
    };
    let all: Vec<Named> = report
        .pairs()
        .map(|pair| (name(pair), r.pair(pair.1, pair.0)))
        .filter(|(_, points)| !points.is_empty())
        .collect();
    page(&title, &body, &json!({ "kind": "identify", "figures": figures(&all) }))
}

fn figures(all: &[Named]) -> Vec<Value> {
    let hz = |points: &[Point]| {
        points.iter().map(|p| p.omega_rad_s / std::f64::consts::TAU).collect::<Vec<f64>>()
    };
    let curve = |points: &[Point]| Curve {
        label: None,
        color: "after",
        gain: points.iter().map(Point::gain).collect(),
        gain_ci95: points.iter().map(|p| Some(p.gain_ci95())).collect(),
        phase_deg: points.iter().map(|p| p.phase_rad().to_degrees()).collect(),
        phase_ci95_deg: points
            .iter()
            .map(|p| p.phase_ci95_rad().map(|ends| ends.map(f64::to_degrees)))
            .collect(),
    };
    let coherence = |(name, points): &Named| {
        json!({
            "kind": "lines", "keys": [name], "about": format!("coherence of {name} over frequency"),
            "x": { "label": "frequency (Hz)", "log": true, "values": hz(points) }, "y": { "label": "coherence", "range": [-0.02, 1.02] },
            "curves": [{ "label": "coherence", "y": points.iter().map(|p| p.coherence).collect::<Vec<f64>>(), "color": "after", "points": false }],
        })
    };
    let mut figures = bode::figures(
        all.iter().map(|(name, points)| bode::views(name, &hz(points), &[curve(points)])).collect(),
    );
    if !figures.is_empty() {
        figures.push(json!({ "id": "coherence", "pick": ["pair"], "views": all.iter().map(coherence).collect::<Vec<Value>>() }));
    }
    figures
}

//! Frequency responses from records as a page: gain, phase and coherence over frequency, with 95 % bands.

use maud::html;
use serde_json::{Value, json};

use super::{figure, given, made_by, page, quoted};
use crate::identify::response::Point;
use crate::report::response::{Report, table};

/// The name of a pair and its points.
type Named = (String, Vec<Point>);

/// The page.
#[must_use]
pub fn response(report: &Report<'_>) -> String {
    let r = report.responses;
    let title = format!("Frequency responses of {}", report.logs.join(", "));
    let name = |(input, output): (usize, usize)| format!("{} → {}", r.inputs[input].name, r.outputs[output].name);
    let body = html! {
        h1 { (title) }
        p .verdict { (report.headline()) "." }
        @for note in &r.notes { p { (quoted(note)) } }
        p { "Bands hold 95 % of each value on its own; where a gain cannot be told from 0 its phase has none." }
        (figure("gain", "The gain"))
        (figure("phase", "The phase"))
        (figure("coherence", "The coherence"))
        @for pair in report.pairs() {
            h2 { (name(pair)) }
            (given(&format!("Some frequencies of {}", name(pair)), &table(&r.pair(pair.1, pair.0))))
        }
        (made_by())
    };
    let all: Vec<Named> =
        report.pairs().map(|pair| (name(pair), r.pair(pair.1, pair.0))).filter(|(_, points)| !points.is_empty()).collect();
    page(&title, &body, &json!({ "kind": "identify", "figures": figures(&all) }))
}

fn figures(all: &[Named]) -> Vec<Value> {
    if all.is_empty() {
        return Vec::new();
    }
    let view = |(name, points): &Named, y: &Value, values: Vec<f64>, ends: Vec<Option<[f64; 2]>>| {
        let edge = |i: usize| ends.iter().map(|e| e.map(|e| e[i])).collect::<Vec<_>>();
        let hz: Vec<f64> = points.iter().map(|p| p.omega_rad_s / std::f64::consts::TAU).collect();
        json!({
            "kind": "lines", "keys": [name], "about": format!("{} of {name} over frequency", y["label"].as_str().unwrap_or_default()),
            "x": { "label": "frequency (Hz)", "log": true, "values": hz }, "y": y,
            "curves": [{ "label": y["label"], "y": values, "low": edge(0), "high": edge(1), "color": "after", "points": false }],
        })
    };
    let gain = |of: &Named| {
        // A logarithm has no 0.
        let ends = of.1.iter().map(|p| Some(p.gain_ci95()).map(|[l, h]| [l.max(1e-3 * p.gain()), h])).collect();
        view(of, &json!({ "label": "gain", "log": true }), of.1.iter().map(Point::gain).collect(), ends)
    };
    let phase = |of: &Named| {
        // Whole turns between neighbours are taken out, of the interval too.
        let (mut turns, mut before) = (0.0, None::<f64>);
        let turned = of.1.iter().map(|p| {
            let own = p.phase_rad().to_degrees();
            turns -= before.map_or(0.0, |b| 360.0 * ((own - b) / 360.0).round());
            before = Some(own);
            (own + turns, p.phase_ci95_rad().map(|ends| ends.map(|e| e.to_degrees() + turns)))
        });
        let (middle, ends) = turned.unzip();
        view(of, &json!({ "label": "phase (°)" }), middle, ends)
    };
    let coherence = |of: &Named| {
        let values: Vec<f64> = of.1.iter().map(|p| p.coherence).collect();
        let none = vec![None; values.len()];
        view(of, &json!({ "label": "coherence", "range": [-0.02, 1.02] }), values, none)
    };
    let each = |of: &dyn Fn(&Named) -> Value| all.iter().map(of).collect::<Vec<Value>>();
    vec![
        json!({ "id": "gain", "pick": ["pair"], "views": each(&gain) }),
        json!({ "id": "phase", "pick": ["pair"], "views": each(&phase) }),
        json!({ "id": "coherence", "pick": ["pair"], "views": each(&coherence) }),
    ]
}

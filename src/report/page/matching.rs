//! Parameters from an identified model as a page: the new value of each, the combinations that are not identifiable, and the responses of both models.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bode;
use super::bode::Curve;
use super::frame::{figure, page, quoted};
use super::structured::{Drawn, not_identifiable, parameters};
use crate::report::matching::{how, meanings, nearness};
use deadtime_identify::matching::{Compared, ComparedPoint, Matched};
use deadtime_signal::stats::NORMAL_95;

/// The page.
#[must_use]
pub fn matching(found: &Matched) -> String {
    let title = format!("{} matched to {}", found.structure, found.identified);
    let body = html! {
        h1 { (title) }
        p .verdict { strong { (found.parameters.len()) } " parameters " (how(found)) "." }
        @for note in &found.notes { p { (quoted(note)) } }
        h2 { "Parameters" }
        (table(found))
        @for said in meanings(found) { p { (said) } }
        (not_identifiable(&found.unseen, &found.trades))
        h2 { "Distance of the responses" }
        ul { @for line in nearness(found) { li { (quoted(&line)) } } }
        (figure("gain", "The gain"))
        (figure("phase", "The phase"))
    };
    page(&title, &body, &json!({ "kind": "identify", "figures": figures(&found.responses) }))
}

fn table(found: &Matched) -> Markup {
    let row = |p: &deadtime_identify::matching::MatchedParameter| Drawn {
        name: p.name.clone(),
        unit: p.unit.clone(),
        nominal: p.nominal,
        value: p.value,
        interval: p.interval,
        one_step: None,
        standing: p.standing,
    };
    parameters(&found.parameters.iter().map(row).collect::<Vec<_>>(), false)
}

fn figures(responses: &[Compared]) -> Vec<Value> {
    let curve = |label: &'static str,
                 color: &'static str,
                 points: &[ComparedPoint],
                 of: fn(&ComparedPoint) -> [f64; 2],
                 known: bool| {
        let gain: Vec<f64> = points.iter().map(|p| of(p)[0].hypot(of(p)[1])).collect();
        let phase_deg: Vec<f64> =
            points.iter().map(|p| of(p)[1].atan2(of(p)[0]).to_degrees()).collect();
        let ends = |values: &[f64], which: usize, unit: f64| {
            let end = |(p, v): (&ComparedPoint, &f64)| {
                p.std
                    .filter(|_| known)
                    .map(|std| [-1.0, 1.0].map(|s| v + s * NORMAL_95 * unit * std[which]))
            };
            points.iter().zip(values).map(end).collect::<Vec<_>>()
        };
        let (gain_ci95, phase_ci95_deg) =
            (ends(&gain, 0, 1.0), ends(&phase_deg, 1, 1.0_f64.to_degrees()));
        Curve { label: Some(label), color, gain, gain_ci95, phase_deg, phase_ci95_deg }
    };
    let views = |r: &Compared| {
        let hz: Vec<f64> = r.points.iter().map(|p| p.omega_rad_s / std::f64::consts::TAU).collect();
        let curves = [
            curve("identified, 95 %", "measured", &r.points, |p| p.identified, true),
            curve("as the file has it", "before", &r.points, |p| p.nominal, false),
            curve("found", "after", &r.points, |p| p.found, false),
        ];
        bode::views(&format!("{} → {}", r.input, r.output), &hz, &curves)
    };
    bode::figures(responses.iter().map(views).collect())
}

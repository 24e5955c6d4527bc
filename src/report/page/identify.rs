//! A model from logs as a page: frequency responses with their bands, poles, the choice of the order, how it does on data that it has not seen.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, stretch};
use super::bode;
use super::bode::Curve;
use super::frame::{Cell, figure, given, number, page, quoted, sorted};
use crate::report::identify::{FREQUENCIES, Report, parameters, poles, seconds};
use deadtime_identify::subspace::{Band, Response, Root};
use deadtime_model::ModelError;
use deadtime_signal::stats::NORMAL_95;

/// The page.
///
/// # Errors
/// [`ModelError`] where the responses cannot be had.
pub fn identify(report: &Report<'_>) -> Result<String, ModelError> {
    let m = report.model;
    let responses = m.responses(report.delays, FREQUENCIES)?;
    let (roots, zeros) = (m.poles(), m.zeros());
    let step_s = m.sample_time.seconds();
    let body = html! {
        h1 { "Model of " (report.logs.join(", ")) }
        @if let Some(own) = &m.parametric {
            p .verdict { (own.structure) ", by " (m.method) "." }
            p .faint { (m.rows) " rows, sample time " (seconds(step_s)) "." }
            (given("Its numbers, with 95 % intervals", &parameters(own)))
        } @else {
            p .verdict { "Order " strong { (m.order.order) } " (" (m.order.sure) "), by " (m.method) "." }
            p .faint { "Past window " (m.past) " samples, " (m.rows) " rows, sample time " (seconds(step_s)) "." }
            @for (input, delay) in m.inputs.iter().zip(report.delays) {
                p { "Dead time of " code { (input.name) } ", taken out first: " strong { (seconds(m.sample_time.to_seconds(*delay as f64))) } "." }
            }
        }
        @for note in report.delay_notes.iter().chain(&m.notes) { p { (quoted(note)) } }
        h2 { "On data that it has not seen" }
        (given(&format!("{}, {} samples", report.held_out, report.held_out_samples), &report.fits()))
        p .faint { (report.about_fits()) }
        h2 { "Frequency responses" }
        p { "With 95 % intervals where the method gives them; dead times are in the phase." }
        (figure("gain", "The gain"))
        (figure("phase", "The phase"))
        h2 { "Poles and zeros" }
        p { "Poles are crosses, zeros are rings; inside the circle a pole decays. Ellipses, and bars of real ones, hold 95 %." }
        (plane(&roots, &zeros))
        (given("Poles in the z plane, standard deviations in brackets", &poles(&roots)))
        @if m.parametric.is_none() { (order(report)) }
    };
    let data = json!({ "kind": "identify", "figures": figures(&responses) });
    Ok(page(&format!("Model of {}", report.logs.join(", ")), &body, &data))
}

fn figures(responses: &[Response]) -> Vec<Value> {
    let views = |r: &Response| {
        let phase = |b: &Band| {
            let half = NORMAL_95 * b.phase_std_rad?;
            Some([b.phase_rad - half, b.phase_rad + half].map(f64::to_degrees))
        };
        let curve = Curve {
            label: None,
            color: "after",
            gain: r.bands.iter().map(|b| b.gain).collect(),
            gain_ci95: r.bands.iter().map(|b| b.gain_ci95).collect(),
            phase_deg: r.bands.iter().map(|b| b.phase_rad.to_degrees()).collect(),
            phase_ci95_deg: r.bands.iter().map(phase).collect(),
        };
        let hz: Vec<f64> = r.bands.iter().map(|b| b.omega_rad_s / std::f64::consts::TAU).collect();
        bode::views(&format!("{} → {}", r.input, r.output), &hz, &[curve])
    };
    bode::figures(responses.iter().filter(|r| !r.bands.is_empty()).map(views).collect())
}

/// The z plane: unit circle, axes, poles and zeros with their ellipses. What is further out than twice the circle stands at the edge.
fn plane(poles: &[Root], zeros: &[Root]) -> Markup {
    let edge = poles.iter().map(|r| r.re.hypot(r.im)).fold(1.1, f64::max).min(2.0);
    let at = |v: f64| 150.0 * (v / edge).clamp(-1.0, 1.0);
    let size = |length: f64| 150.0 * (length / edge).min(2.0);
    let told = |roots: &[Root]| {
        roots.iter().map(|r| format!("{:.3}{:+.3}i", r.re, r.im)).collect::<Vec<_>>().join(", ")
    };
    let around = |r: &Root| {
        let (x, y) = (at(r.re), -at(r.im));
        html! {
            @if let Some(e) = r.ellipse95 {
                // Downwards is positive: the angle turns the other way.
                @let turned = format!("rotate({:.2} {x:.1} {y:.1})", -e.angle_rad.to_degrees());
                ellipse .whisker fill="none" cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) rx=(format!("{:.2}", size(e.major))) ry=(format!("{:.2}", size(e.minor))) transform=(turned) {}
            } @else {
                @let half = size(NORMAL_95 * r.std_re.unwrap_or(0.0));
                path .whisker d=(format!("M{:.1} {y:.1}h{:.1}", x - half, 2.0 * half)) {}
            }
        }
    };
    let name = |r: &Root| html! { title { (format!("{:.4} {:+.4}i", r.re, r.im)) } };
    html! {
        svg .plane viewBox="-160 -160 320 320" width="320" height="320" role="img" aria-label={ "Poles in the z plane: " (told(poles)) "; zeros: " (told(zeros)) } {
            path .axis d="M-155 0H155M0 -155V155" {}
            circle .circle r=(format!("{:.1}", 150.0 / edge)) {}
            @for r in poles {
                (around(r))
                path .pole d=(format!("M{:.1} {:.1}l10 10m0 -10l-10 10", at(r.re) - 5.0, -at(r.im) - 5.0)) { (name(r)) }
            }
            @for r in zeros {
                (around(r))
                circle .zero fill="none" cx=(format!("{:.1}", at(r.re))) cy=(format!("{:.1}", -at(r.im))) r="5" { (name(r)) }
            }
        }
    }
}

/// Every order that was tried, with its weight as a bar.
fn order(report: &Report<'_>) -> Markup {
    let choice = &report.model.order;
    let most = choice.candidates.iter().map(|c| c.singular_value).fold(f64::MIN_POSITIVE, f64::max);
    let row = |c: &deadtime_identify::subspace::Candidate| {
        let schwarz =
            c.schwarz.map_or_else(|| "no stable predictor".to_owned(), |s| format!("{s:.2}"));
        let weight = format!("{:.3}", c.weight);
        vec![
            Cell::Number(c.order.to_string()),
            Cell::Number(number(Some(c.singular_value))),
            Cell::Drawn(bar(
                &number(Some(c.singular_value)),
                &stretch(0.0, c.singular_value / most, "noise"),
            )),
            Cell::Number(schwarz),
            Cell::Number(weight.clone()),
            Cell::Drawn(bar(&weight, &stretch(0.0, c.weight, "after"))),
        ]
    };
    let rows: Vec<Vec<Cell>> = choice.candidates.iter().map(row).collect();
    html! {
        h2 { "Order" }
        p { (choice.by_schwarz) " by Schwarz's criterion, " (choice.by_akaike) " by Akaike's, " (choice.by_gap) " by the largest gap of the singular values." }
        (sorted("Orders that were tried", &["order", "singular value", "of the largest", "Schwarz", "weight", "of all"], &rows))
    }
}

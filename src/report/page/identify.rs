//! A model from logs as a page: frequency responses with their bands, poles, the choice of the order, and the fit on held-out data.

use maud::{Markup, html};
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};

use super::bars::{bar, stretch};
use super::bode;
use super::bode::Curve;
use super::frame::{Cell, figure, given, number, page, quoted, sorted};
use super::series::{brief, picked, thinned};
use crate::report::diagnosis::base;
use crate::report::identify::{FREQUENCIES, Report, candidates, parameters, poles, seconds};
use deadtime_identify::subspace::{Band, InnovationsModel, Named, Response, Root, Stretch};
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
    let named = report.logs.iter().map(|log| base(log)).collect::<Vec<_>>().join(", ");
    let body = html! {
        h1 { "Model of " (named) }
        @if let Some(own) = &m.parametric {
            p .verdict { (own.structure) ", by " (m.method) "." }
            p .faint { (m.rows) " rows, sample time " (seconds(step_s)) "." }
            (given("Parameters, with 95 % intervals", &parameters(own)))
        } @else {
            p .verdict { "Order " strong { (m.order.order) } " (" (m.order.sure) "), by " (m.method) "." }
            p .faint { "Past window " (m.past) " samples, " (m.rows) " rows, sample time " (seconds(step_s)) "." }
            @for (input, delay) in m.inputs.iter().zip(report.delays) {
                p { "Dead time of " code { (input.name) } ", removed before the states are identified: " strong { (seconds(m.sample_time.to_seconds(*delay as f64))) } "." }
            }
        }
        @for note in report.delay_notes.iter().chain(&m.notes) { p { (quoted(note)) } }
        @if let Some(compared) = report.compared {
            h2 { "Models that were compared" }
            p { "Chosen: the fewest parameters within the noise of the best fit on validation data." }
            (given("Every model; the last column is its place in the choice, or why it has none", &candidates(compared, usize::MAX)))
        }
        h2 { "Measured and simulated" }
        p { "On data that the fit has not seen: " (report.held_out) "." }
        p { span .key.measured { "measured" } span .key.after { "simulated" } }
        (figure("run", "The free run"))
        (given(&format!("{}, {} samples", report.held_out, report.held_out_samples), &report.fits()))
        p .faint { (report.about_fits()) }
        h2 { "Step response" }
        p { "To a step of 1, dead times included. The band holds 95 % of drawn models, where the method gives them." }
        (figure("step", "The step response"))
        h2 { "Frequency responses" }
        p { "With 95 % intervals where the method gives them; dead times are in the phase." }
        (figure("gain", "The gain"))
        (figure("phase", "The phase"))
        h2 { "Poles and zeros" }
        p { "Poles are crosses, zeros are rings; inside the circle a pole decays. Ellipses, and bars of real ones, are 95 % regions; those wider than the circle are left out." }
        (plane(&roots, &zeros))
        (given("Poles in the z plane, standard deviations in brackets", &poles(&roots)))
        @if m.parametric.is_none() { (order(report)) }
    };
    let curves = [
        picked("run", &["output", "record"], runs(report)),
        picked("step", &["pair"], steps(report)),
    ];
    let mut all: Vec<Value> = curves.into_iter().flatten().collect();
    all.extend(figures(&responses));
    let data = json!({ "kind": "identify", "figures": all });
    Ok(page(&format!("Model of {named}"), &body, &data))
}

/// Records that are drawn.
const RECORDS: usize = 10;
/// Longest step response, samples.
const LONGEST: usize = 2000;
/// The step response is settled where it stays within this share of its size.
const SETTLED: f64 = 0.005;

/// A label with its unit.
fn labelled(named: &Named) -> String {
    match named.unit.as_deref().filter(|u| *u != "1") {
        Some(unit) => format!("{} ({unit})", named.name),
        None => named.name.clone(),
    }
}

/// Every output of every held-out record: measured, and as the model runs freely.
fn runs(report: &Report<'_>) -> Vec<Value> {
    let m = report.model;
    let step_s = m.sample_time.seconds();
    let of_record = |(at, measured): (usize, &Stretch)| -> Vec<Value> {
        let free = m.model.free_run(&m.scales.centred(measured));
        let time_s: Vec<f64> = (0..measured.len()).map(|t| t as f64 * step_s).collect();
        let view = |(i, named): (usize, &Named)| {
            let mean = m.scales.outputs.get(i).map_or(0.0, |s| s.0);
            let row = |y: &DMatrix<f64>, mean: f64| {
                thinned(&y.row(i).iter().map(|v| v + mean).collect::<Vec<_>>())
            };
            json!({
                "kind": "lines", "keys": [named.name, format!("record {}", at + 1)],
                "about": format!("{}, measured and simulated", named.name),
                "x": { "label": "time (s)", "values": thinned(&time_s), "tight": true }, "y": { "label": labelled(named) },
                "curves": [
                    { "label": "measured", "y": row(&measured.y, 0.0), "color": "measured", "points": false },
                    { "label": "simulated", "y": row(&free, mean), "color": "after", "points": false, "width": 2.0 },
                ],
            })
        };
        m.outputs.iter().enumerate().map(view).collect()
    };
    report.judged.stretches.iter().take(RECORDS).enumerate().flat_map(of_record).collect()
}

/// The response of one output to a step of one input, `samples` long.
fn step(
    model: &InnovationsModel,
    input: usize,
    output: usize,
    delay: usize,
    samples: usize,
) -> Vec<f64> {
    let mut x = DVector::zeros(model.order());
    let mut y = vec![0.0; delay.min(samples)];
    while y.len() < samples {
        y.push((model.c.row(output) * &x)[0] + model.d[(output, input)]);
        x = &model.a * x + model.b.column(input);
    }
    y
}

/// The shown length of a step response: until it is settled.
fn settled(y: &[f64]) -> usize {
    let end = y.last().copied().unwrap_or(0.0);
    let size = y.iter().fold(0.0, |m: f64, v| m.max(v.abs())).max(f64::MIN_POSITIVE);
    let last = y.iter().rposition(|v| (v - end).abs() > SETTLED * size).unwrap_or(0);
    (last + last / 4 + 10).min(y.len())
}

/// The step response of every pair, with the band of the drawn models.
fn steps(report: &Report<'_>) -> Vec<Value> {
    let m = report.model;
    let step_s = m.sample_time.seconds();
    let pairs = m.inputs.iter().enumerate().flat_map(|(j, input)| {
        m.outputs.iter().enumerate().map(move |(i, output)| (j, input, i, output))
    });
    let view = |(j, input, i, output): (usize, &Named, usize, &Named)| {
        let delay = report.delays.get(j).copied().unwrap_or(0);
        let whole = step(&m.model, j, i, delay, LONGEST);
        let shown = settled(&whole);
        let middle: Vec<f64> = whole.into_iter().take(shown).collect();
        let drawn: Vec<Vec<f64>> =
            m.draws.whole.iter().map(|d| step(d, j, i, delay, shown)).collect();
        let end = |quantile: f64| -> Vec<Option<f64>> {
            let at = |t: usize| {
                let mut values: Vec<f64> = drawn.iter().filter_map(|y| y.get(t).copied()).collect();
                values.sort_by(f64::total_cmp);
                let last = values.len().checked_sub(1)?;
                brief(*values.get((quantile * last as f64).round() as usize)?)
            };
            (0..shown).map(at).collect()
        };
        let time_s: Vec<Option<f64>> = (0..shown).map(|t| brief(t as f64 * step_s)).collect();
        let values: Vec<Option<f64>> = middle.iter().map(|v| brief(*v)).collect();
        let mut curve = json!({ "label": "step response", "y": values, "color": "after", "points": false, "width": 2.0 });
        if let Some(curve) = curve.as_object_mut().filter(|_| !drawn.is_empty()) {
            curve.insert("low".to_owned(), json!(end(0.025)));
            curve.insert("high".to_owned(), json!(end(0.975)));
        }
        json!({
            "kind": "lines", "keys": [format!("{} → {}", input.name, output.name)],
            "about": format!("Response of {} to a step of {}", output.name, input.name),
            "x": { "label": "time (s)", "values": time_s, "tight": true }, "y": { "label": labelled(output) },
            "curves": [curve],
        })
    };
    pairs.map(view).collect()
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

/// The z plane: unit circle, axes, poles and zeros with their ellipses. Points further out than twice the circle are drawn at the edge.
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
            // A region wider than the unit circle shows nothing.
            @if let Some(e) = r.ellipse95.filter(|e| e.major <= 1.0) {
                // Downwards is positive: the angle turns the other way.
                @let turned = format!("rotate({:.2} {x:.1} {y:.1})", -e.angle_rad.to_degrees());
                ellipse .whisker fill="none" cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) rx=(format!("{:.2}", size(e.major))) ry=(format!("{:.2}", size(e.minor))) transform=(turned) {}
            } @else if let Some(half) = r.std_re.map(|s| NORMAL_95 * s).filter(|half| r.ellipse95.is_none() && *half <= 1.0) {
                @let half = size(half);
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
        p { (choice.by_schwarz) " by Schwarz's criterion, " (choice.by_akaike) " by Akaike's, " (choice.by_gap) " by the largest gap of the singular values"
            @if let Some(order) = choice.by_free_run { ", " (order) " by free runs of the last 30 % of each record" }
            "." }
        (sorted("Orders that were tried", &["order", "singular value", "of the largest", "Schwarz", "weight", "of all"], &rows))
    }
}

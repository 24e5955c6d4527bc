//! The findings of `deadtime check` as a page, failed checks first.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, stretch};
use super::frame::{Cell, figure, named, number, page, percent, quoted, sorted};
use super::series::{picked, thinned};
use crate::report::diagnosis::base;
use deadtime_gap::{Inspection, LogReport, Role};

/// A channel of a log with the model's response.
pub struct Measured {
    /// The channel.
    pub channel: String,
    /// The log.
    pub log: String,
    /// Seconds from the log's first sample.
    pub time_s: Vec<f64>,
    /// As logged; NaN where a sample is missing.
    pub measured: Vec<f64>,
    /// A free run of the model.
    pub simulated: Vec<f64>,
}

fn view(curve: &Measured) -> Value {
    json!({
        "kind": "lines", "keys": [curve.channel, base(&curve.log)],
        "about": format!("{}, measured and simulated", curve.channel),
        "x": { "label": "time (s)", "values": thinned(&curve.time_s), "tight": true }, "y": { "label": curve.channel },
        "curves": [
            { "label": "measured", "y": thinned(&curve.measured), "color": "measured", "points": false },
            { "label": "simulated", "y": thinned(&curve.simulated), "color": "after", "points": false, "width": 2.0 },
        ],
    })
}

/// The page, with the curves of the channels that failed.
#[must_use]
pub fn check(found: &Inspection, curves: &[Measured]) -> String {
    let failed = found.checks.iter().filter(|c| c.ok == Some(false)).count();
    let faults = found
        .logs
        .iter()
        .map(|l| l.channels.iter().filter(|c| !c.ok).count() + usize::from(l.time.is_some()))
        .sum::<usize>();
    let verdict = match (failed + faults, &found.not_run) {
        (0, None) => "Nothing needs a look.".to_owned(),
        (0, Some(_)) => "The checks were not run.".to_owned(),
        (1, _) => "1 finding needs a look.".to_owned(),
        (n, _) => format!("{n} findings need a look."),
    };
    let body = html! {
        h1 { "Do " (found.model) " and its logs fit?" }
        p .verdict { strong { (verdict) } }
        @if let Some(why) = &found.not_run { p { strong { "The checks were not run:" } " " (quoted(why)) "." } }
        (checks(found))
        @if !curves.is_empty() {
            h2 { "Measured, and simulated by the model as it is" }
            p { span .key.measured { "measured" } span .key.after { "simulated" } }
            (figure("run", "The free run"))
        }
        h2 { "Logs" }
        @for log in &found.logs { (channels(log)) }
    };
    let figures = picked("run", &["channel", "log"], curves.iter().map(view).collect());
    let figures: Vec<Value> = figures.into_iter().collect();
    let data = json!({ "kind": "check", "figures": figures });
    page(&format!("Check of {}", found.model), &body, &data)
}

/// Words and a mark: colour alone is not enough.
fn mark(ok: Option<bool>) -> Cell {
    Cell::Marked(match ok {
        Some(false) => html! { span .look { "✗ look" } },
        None => html! { span .faint { "? open" } },
        Some(true) => html! { span .ok { "✓ ok" } },
    })
}

fn checks(found: &Inspection) -> Markup {
    let mut rows: Vec<Vec<Cell>> = Vec::new();
    for ok in [Some(false), None, Some(true)] {
        for check in found.checks.iter().filter(|c| c.ok == ok) {
            let name = check.check.name().replace('_', " ");
            rows.push(vec![
                Cell::Words(name),
                mark(ok),
                Cell::Words(named(&check.channel).to_owned()),
                Cell::Marked(quoted(&check.finding)),
            ]);
        }
    }
    html! { @if !rows.is_empty() { h2 { "Checks" } (sorted("Checks that run before the model; findings come first", &["check", "result", "channel", "finding"], &rows)) } }
}

fn channels(log: &LogReport) -> Markup {
    let every = log.sample_time_s.map_or_else(
        || "unevenly sampled".to_owned(),
        |ts| format!("one every {} s", number(Some(ts))),
    );
    let row = |c: &deadtime_gap::ChannelReport| {
        let share = c.missing as f64 / log.samples.max(1) as f64;
        let missing = if c.missing > 0 {
            format!("{} ({})", c.missing, percent(Some(share)))
        } else {
            c.missing.to_string()
        };
        let role = match c.role {
            Role::Input => "command",
            Role::Output => "response",
        };
        let unit = |u: &Option<String>| Cell::Words(u.clone().unwrap_or_default());
        vec![
            Cell::Words(c.channel.clone()),
            mark(Some(c.ok)),
            Cell::Words(role.to_owned()),
            unit(&c.model_unit),
            unit(&c.log_unit),
            Cell::Number(missing.clone()),
            Cell::Drawn(bar(
                &format!("{missing} samples are missing"),
                &stretch(0.0, share, "before"),
            )),
            Cell::Marked(quoted(c.finding.as_deref().unwrap_or(""))),
        ]
    };
    let rows: Vec<Vec<Cell>> = log.channels.iter().map(row).collect();
    let caption =
        format!("{} samples, {every}, {} s in all", log.samples, number(Some(log.duration_s)));
    html! {
        h3 { (base(&log.log)) }
        @if let Some(time) = &log.time { p { span .look { "✗ time stamps" } ": " (quoted(time)) } }
        (sorted(&caption, &["channel", "usable", "is a", "unit of the model", "unit of the log", "missing", "share missing", "finding"], &rows))
    }
}

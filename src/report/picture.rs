//! A picture of the answers: every method's dead time with its interval, above the estimated impulse response.

use maud::{Markup, html};

use super::drawing::{Panel, Scale, document, px, text, ticks};
use super::estimate::A_HANDFUL;
use deadtime_delay::report::{Estimate, Pair, Response};

/// One pair's part of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown<'a> {
    /// The answers.
    pub pair: &'a Pair,
    /// The impulse response, where the input allows one.
    pub response: Option<&'a Response>,
}

const WIDTH: f64 = 900.0;
/// Space for the names of methods, and at the right of a plot.
const LEFT: f64 = 158.0;
const RIGHT: f64 = 14.0;
/// Above a plot, for its caption, and below, for its time axis.
const CAPTION: f64 = 36.0;
const AXIS: f64 = 46.0;
/// Height of a method's row, and of the plot of a response.
const ROW: f64 = 24.0;
const RESPONSE: f64 = 150.0;
/// Standard deviations that the band around the response shows, as `threshold` has by default.
const BAND: f64 = 5.0;
/// The picture is used alone, so that its colours are in it.
const STYLE: &str = "text{font:14px sans-serif;fill:#222}text.caption{font-size:16px}text.aside{fill:#6e6e6e}\
    .frame{fill:none;stroke:#999}.grid{stroke:#ddd}.tick{stroke:#999}.verdict{fill:#e1ecf7}.band{stroke:#5a8cbe}\
    .bar{stroke:#282828;stroke-width:3}.dot{fill:#c83c28}.bar.aside{stroke:#bebebe}.dot.aside{fill:#969696}\
    .band{fill:#cdcdcd}.stem{stroke:#464646;stroke-width:2}.stem.out{stroke:#c83c28}.tip{fill:#464646}.tip.out{fill:#c83c28}";

/// The picture as SVG; `sample_time_s` scales the responses' time axis.
#[must_use]
pub fn svg(pairs: &[Shown<'_>], sample_time_s: f64) -> String {
    let (mut parts, mut top) = (Vec::new(), 0.0);
    for Shown { pair, response } in pairs {
        let rows = shown(pair);
        let time = time_axis(&rows, sample_time_s);
        let mut panel = |height: f64, up: Scale| {
            let width = WIDTH - LEFT - RIGHT;
            let panel = Panel { left: LEFT, top: top + CAPTION, width, height, across: time, up };
            top = panel.bottom() + AXIS;
            panel
        };
        let count = rows.len().max(2) as f64;
        let up = Scale { from: count, to: 0.0, logarithmic: false };
        parts.push(answers(pair, &rows, &panel(ROW * count, up)));
        if let Some(response) = response {
            let drawn = Stems::new(response, time.to, sample_time_s);
            parts.push(drawn.within(&panel(RESPONSE, drawn.up())));
        }
    }
    document([WIDTH, top.max(1.0)], STYLE, &html! { @for part in &parts { (part) } })
}

/// The time axis of both parts of a pair, so that a delay is above the sample where the response begins.
fn time_axis(rows: &[&Estimate], sample_time_s: f64) -> Scale {
    let reach = |e: &&Estimate| Some(e.ci95_s?[1].max(e.raw_delay_s?));
    let counting = rows.iter().filter(|e| e.counts());
    let longest = counting.filter_map(reach).fold(4.0 * sample_time_s, f64::max);
    Scale { from: -0.05 * longest, to: 2.5 * longest, logarithmic: false }
}

/// The answers that are drawn: of many methods those that have a delay.
fn shown(pair: &Pair) -> Vec<&Estimate> {
    let many = pair.estimates.len() > A_HANDFUL;
    pair.estimates.iter().filter(|e| !many || e.delay_s.is_some()).collect()
}

/// Caption, frame and time axis of a plot.
fn frame(panel: &Panel, caption: &str) -> Markup {
    let below = panel.bottom();
    html! {
        (text((0.5 * WIDTH, panel.top - 12.0), "middle", "caption", caption))
        (panel.frame())
        @for (time_s, label) in ticks(panel.across.from, panel.across.to, 8.0) {
            path .tick d={ "M" (px(panel.x(time_s))) " " (px(below)) "v5" } {}
            (text((panel.x(time_s), below + 19.0), "middle", "", &label))
        }
        (panel.across_label(37.0, "seconds"))
    }
}

/// One line per method: the interval as a bar, the dead time as a dot; the verdict as a band behind them.
fn answers(pair: &Pair, rows: &[&Estimate], panel: &Panel) -> Markup {
    let target = if pair.output == "*" { "the states" } else { &pair.output };
    let caption = format!(
        "{} to {target}: dead time by method, 95 % intervals (grey: not counted)",
        pair.input
    );
    let row = |(i, e): (usize, &&Estimate)| {
        let y = panel.y(i as f64 + 0.5);
        let bar = |aside: &str, delay: f64, [from, to]: [f64; 2]| {
            html! {
                path class={ "bar" (aside) } d={ "M" (px(panel.x(from))) " " (px(y)) "H" (px(panel.x(to))) } {}
                @if (panel.across.from..panel.across.to).contains(&delay) {
                    circle class={ "dot" (aside) } cx=(px(panel.x(delay))) cy=(px(y)) r="5" {}
                }
            }
        };
        html! {
            (text((LEFT - 8.0, y + 5.0), "end", "", &e.method))
            @if let (Some(delay), Some(interval)) = (e.delay_s, e.ci95_s) {
                (bar(if e.counts() { "" } else { " aside" }, delay, interval))
            } @else {
                (text((LEFT + 8.0, y + 5.0), "start", "aside", &e.outcome.name().replace('_', " ")))
            }
        }
    };
    html! {
        @if let (Some(delay), Some([from, to])) = (pair.verdict.delay_s, pair.verdict.ci95_s) {
            @let (left, right) = (panel.x(from), panel.x(to));
            rect .verdict x=(px(left)) y=(px(panel.top)) width=(px((right - left).max(0.5))) height=(px(panel.height)) {}
            path .band d={ "M" (px(panel.x(delay))) " " (px(panel.top)) "v" (px(panel.height)) } {}
        }
        (frame(panel, &caption))
        @for one in rows.iter().enumerate().map(row) { (one) }
    }
}

/// The coefficients of a response over time.
struct Stems<'a> {
    response: &'a Response,
    /// Those that the time axis holds.
    count: usize,
    sample_time_s: f64,
}

impl<'a> Stems<'a> {
    fn new(response: &'a Response, to_s: f64, sample_time_s: f64) -> Self {
        let inside = |i: &usize| *i as f64 * sample_time_s <= to_s;
        let count = (0..response.values.len().min(response.std.len())).take_while(inside).count();
        Self { response, count, sample_time_s }
    }

    fn at(&self, i: usize) -> f64 {
        i as f64 * self.sample_time_s
    }

    fn band(&self, i: usize) -> f64 {
        BAND * self.response.std[i]
    }

    fn up(&self) -> Scale {
        let reach = (0..self.count)
            .map(|i| self.response.values[i].abs().max(self.band(i)))
            .fold(f64::MIN_POSITIVE, f64::max);
        Scale::with_margin(-reach, reach, false)
    }

    /// The coefficients as stems, their threshold as a band.
    fn within(&self, panel: &Panel) -> Markup {
        let all = || 0..self.count;
        let upper = all().map(|i| [self.at(i), self.band(i)]);
        let lower = all().rev().map(|i| [self.at(i), -self.band(i)]);
        let edge: Vec<[f64; 2]> = upper.chain(lower).collect();
        let caption = format!(
            "estimated impulse response; grey: {BAND} standard deviations (the dead time ends before the first stem outside)"
        );
        html! {
            @if !edge.is_empty() { path .band d={ (panel.path(&edge)) "Z" } {} }
            @for (value, label) in ticks(panel.up.from, panel.up.to, 5.0) { (panel.level(value, &label)) }
            (frame(panel, &caption))
            @for i in all() {
                @let (x, y) = (px(panel.x(self.at(i))), px(panel.y(self.response.values[i])));
                @let out = if self.response.values[i].abs() > self.band(i) { " out" } else { "" };
                path class={ "stem" (out) } d={ "M" (x) " " (px(panel.y(0.0))) "V" (y) } {}
                circle class={ "tip" (out) } cx=(x) cy=(y) r="3" {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_delay::report::Estimate;
    use deadtime_delay::{DelayEstimate, Grounds, Outcome, Verdict};

    #[test]
    fn every_method_and_every_kind_of_answer_is_drawn() {
        let found = DelayEstimate {
            delay_s: Some(0.2),
            ci95_s: Some([0.1, 0.3]),
            raw_delay_s: Some(0.3),
            ..DelayEstimate::without(Outcome::Found, "")
        };
        let none = DelayEstimate::without(Outcome::NotRichEnough, "");
        let pair = Pair {
            input: "u<1>".into(),
            output: "y".into(),
            findings: Vec::new(),
            poor_std_s: None,
            standing_off: 0,
            two_sensors: false,
            estimates: ["oestruc", "arxstruc"]
                .iter()
                .zip([&found, &none])
                .map(|(name, e)| {
                    Estimate::new(deadtime_delay::method(name).unwrap(), e, None, 0.0, &[])
                })
                .collect(),
            verdict: Verdict {
                delay_s: Some(0.2),
                ci95_s: Some([0.1, 0.3]),
                why: String::new(),
                method: None,
                grounds: Grounds::default(),
            },
            moving: None,
            jitter: None,
            track: None,
        };
        let response = Response { values: vec![0.0, 0.0, 1.0], std: vec![0.01; 3] };
        let text = svg(
            &[
                Shown { pair: &pair, response: Some(&response) },
                Shown { pair: &pair, response: None },
            ],
            0.1,
        );
        for part in
            ["oestruc", "arxstruc", "not rich enough", "u&lt;1&gt;", "impulse response", "</svg>"]
        {
            assert!(text.contains(part), "{part}");
        }
    }
}

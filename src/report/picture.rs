//! A picture of the answers: every method's dead time with its interval, above the estimated impulse response.

use std::fmt::Write as _;

use super::chart::{Panel, ticks};
use super::escape::escape;
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
/// The picture stands alone, so that its colours are in it.
const STYLE: &str = "text{font:14px sans-serif;fill:#222}text.caption{font-size:16px}text.aside{fill:#6e6e6e}\
    .frame{fill:none;stroke:#999}.grid{stroke:#ddd}.tick{stroke:#999}.verdict{fill:#e1ecf7}.believed{stroke:#5a8cbe}\
    .bar{stroke:#282828;stroke-width:3}.dot{fill:#c83c28}.bar.aside{stroke:#bebebe}.dot.aside{fill:#969696}\
    .band{fill:#cdcdcd}.stem{stroke:#464646;stroke-width:2}.stem.out{stroke:#c83c28}.tip{fill:#464646}.tip.out{fill:#c83c28}";

/// The picture as SVG; `sample_time_s` scales the responses' time axis.
#[must_use]
pub fn svg(pairs: &[Shown<'_>], sample_time_s: f64) -> String {
    let (mut body, mut top) = (String::new(), 0.0);
    for shown in pairs {
        let axis = Axis::new(shown.pair, sample_time_s);
        top = answers(&mut body, shown.pair, axis, top);
        if let Some(response) = shown.response {
            top = impulse(&mut body, response, axis, sample_time_s, top);
        }
    }
    let height = top.max(1.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\">\n<style>{STYLE}</style>\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n{body}</svg>\n"
    )
}

/// The time axis that both parts of a pair share, so that a delay stands above the sample where the response begins.
#[derive(Debug, Clone, Copy)]
struct Axis {
    from_s: f64,
    to_s: f64,
}

impl Axis {
    fn new(pair: &Pair, sample_time_s: f64) -> Self {
        let reach = |e: &&Estimate| Some(e.ci95_s?[1].max(e.raw_delay_s?));
        let longest = shown(pair)
            .iter()
            .filter(|e| e.counts())
            .filter_map(reach)
            .fold(4.0 * sample_time_s, f64::max);
        Self { from_s: -0.05 * longest, to_s: 2.5 * longest }
    }

    /// What lies beyond the axis ends at it.
    fn x(self, time_s: f64) -> f64 {
        let share = ((time_s - self.from_s) / (self.to_s - self.from_s)).clamp(0.0, 1.0);
        LEFT + share * (WIDTH - LEFT - RIGHT)
    }

    fn holds(self, time_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&time_s)
    }
}

/// The answers that are drawn: of many methods those that have a delay.
fn shown(pair: &Pair) -> Vec<&Estimate> {
    let many = pair.estimates.len() > A_HANDFUL;
    pair.estimates.iter().filter(|e| !many || e.delay_s.is_some()).collect()
}

/// Caption, frame and time axis of a plot.
fn frame(svg: &mut String, caption: &str, axis: Axis, (top, height): (f64, f64)) {
    let (middle, bottom, width) = (0.5 * WIDTH, top + height, WIDTH - LEFT - RIGHT);
    let _ = writeln!(
        svg,
        "<text class=\"caption\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{caption}</text>",
        top - 12.0
    );
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/>"
    );
    for (time_s, label) in ticks(axis.from_s, axis.to_s, 8.0) {
        let x = axis.x(time_s);
        let _ = writeln!(svg, "<path class=\"tick\" d=\"M{x:.1} {bottom}v5\"/>");
        let _ = writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
            bottom + 19.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">seconds</text>",
        LEFT + 0.5 * width,
        bottom + 37.0
    );
}

/// One line per method: the interval as a bar, the dead time as a dot; the verdict as a band behind them. The height that all of it ends at.
fn answers(svg: &mut String, pair: &Pair, axis: Axis, above: f64) -> f64 {
    let target = if pair.output == "*" { "the states" } else { &pair.output };
    let estimates = shown(pair);
    let (top, height) = (above + CAPTION, ROW * estimates.len().max(2) as f64);
    if let (Some(delay), Some([from, to])) = (pair.verdict.delay_s, pair.verdict.ci95_s) {
        let (left, right, x) = (axis.x(from), axis.x(to), axis.x(delay));
        let width = (right - left).max(0.5);
        let _ = writeln!(
            svg,
            "<rect class=\"verdict\" x=\"{left:.1}\" y=\"{top}\" width=\"{width:.1}\" height=\"{height}\"/>"
        );
        let _ = writeln!(svg, "<path class=\"believed\" d=\"M{x:.1} {top}v{height}\"/>");
    }
    let caption = format!(
        "{} to {}: dead time by method, 95 % intervals (grey: not counted)",
        escape(&pair.input),
        escape(target)
    );
    frame(svg, &caption, axis, (top, height));
    for (i, estimate) in estimates.iter().enumerate() {
        let y = top + ROW * (i as f64 + 0.5);
        let text = y + 5.0;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{text}\" text-anchor=\"end\">{}</text>",
            LEFT - 8.0,
            escape(&estimate.method)
        );
        let (Some(delay), Some([from, to])) = (estimate.delay_s, estimate.ci95_s) else {
            let outcome = estimate.outcome.name().replace('_', " ");
            let _ = writeln!(
                svg,
                "<text class=\"aside\" x=\"{}\" y=\"{text}\">{outcome}</text>",
                LEFT + 8.0
            );
            continue;
        };
        let aside = if estimate.counts() { "" } else { " aside" };
        let _ = writeln!(
            svg,
            "<path class=\"bar{aside}\" d=\"M{:.1} {y}H{:.1}\"/>",
            axis.x(from),
            axis.x(to)
        );
        if axis.holds(delay) {
            let _ = writeln!(
                svg,
                "<circle class=\"dot{aside}\" cx=\"{:.1}\" cy=\"{y}\" r=\"5\"/>",
                axis.x(delay)
            );
        }
    }
    top + height + AXIS
}

/// The coefficients as stems, their threshold as a band. The height that all of it ends at.
fn impulse(
    svg: &mut String,
    response: &Response,
    axis: Axis,
    sample_time_s: f64,
    above: f64,
) -> f64 {
    let at = |i: usize| i as f64 * sample_time_s;
    let shown: Vec<usize> = (0..response.values.len()).filter(|&i| at(i) <= axis.to_s).collect();
    let band = |i: usize| BAND * response.std[i];
    let reach = shown
        .iter()
        .map(|&i| response.values[i].abs().max(band(i)))
        .fold(f64::MIN_POSITIVE, f64::max);
    let panel = Panel::new(above + CAPTION, RESPONSE, -reach, reach);
    let point = |i: usize, value: f64| format!("{:.1} {:.1}", axis.x(at(i)), panel.y(value));
    let edge: Vec<String> = shown
        .iter()
        .map(|&i| point(i, band(i)))
        .chain(shown.iter().rev().map(|&i| point(i, -band(i))))
        .collect();
    if !edge.is_empty() {
        let _ = writeln!(svg, "<path class=\"band\" d=\"M{}Z\"/>", edge.join("L"));
    }
    for (value, label) in ticks(panel.lowest, panel.highest, 5.0) {
        let y = panel.y(value);
        let _ = writeln!(svg, "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/>", WIDTH - RIGHT);
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            LEFT - 8.0,
            y + 5.0
        );
    }
    let caption = format!(
        "estimated impulse response; grey: {BAND} standard deviations (the dead time ends before the first stem outside)"
    );
    frame(svg, &caption, axis, (panel.top, panel.height));
    for &i in &shown {
        let (x, h) = (axis.x(at(i)), response.values[i]);
        let out = if h.abs() > band(i) { " out" } else { "" };
        let _ = writeln!(
            svg,
            "<path class=\"stem{out}\" d=\"M{x:.1} {:.1}V{:.1}\"/>",
            panel.y(0.0),
            panel.y(h)
        );
        let _ = writeln!(
            svg,
            "<circle class=\"tip{out}\" cx=\"{x:.1}\" cy=\"{:.1}\" r=\"3\"/>",
            panel.y(h)
        );
    }
    panel.top + panel.height + AXIS
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

//! One output of a diagnosis as an inline SVG: measured and predicted above, what is left of the difference below. Colours are classes of the page.

use std::fmt::Write as _;

use super::escape::escape;
use crate::diagnose::Trace;
use crate::signal::stats;

/// Size of the drawing in its own units; the page scales it.
const WIDTH: f64 = 760.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 8.0;
const TOP: f64 = 20.0;
const CURVES: f64 = 210.0;
const BETWEEN: f64 = 26.0;
const REST: f64 = 110.0;
const BOTTOM: f64 = 38.0;
/// Space between logs that lie side by side.
const APART: f64 = 4.0;
/// A prediction may leave the range of the measurement by this many of its widths before it is cut off: one that explodes must not flatten all else.
const LEAVES: f64 = 0.6;
/// More time than this many sample distances without a sample is a gap.
const GAP: f64 = 1.5;

/// A part of the drawing with the numbers it shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panel {
    pub(super) top: f64,
    pub(super) height: f64,
    pub(super) lowest: f64,
    pub(super) highest: f64,
}

impl Panel {
    /// Numbers that are all equal get a range around them.
    pub(super) fn new(top: f64, height: f64, lowest: f64, highest: f64) -> Self {
        let margin = if highest > lowest { 0.04 * (highest - lowest) } else { 0.5 * highest.abs().max(1e-9) };
        Self { top, height, lowest: lowest - margin, highest: highest + margin }
    }

    pub(super) fn y(self, value: f64) -> f64 {
        // Far outside is as good as further outside, and SVG readers stumble over huge numbers.
        let share = ((self.highest - value) / (self.highest - self.lowest)).clamp(-1.0, 2.0);
        self.top + share * self.height
    }
}

/// Where one log lies.
#[derive(Debug, Clone, Copy)]
struct Lane {
    left: f64,
    width: f64,
    duration_s: f64,
}

impl Lane {
    fn x(self, time_s: f64) -> f64 {
        self.left + self.width * (time_s / self.duration_s).clamp(0.0, 1.0)
    }
}

/// The drawing of one output's logs, side by side. `id` makes names on the page unique; `points` is how finely a curve is drawn across the whole width;
/// `title` and `description` are for those who cannot see it, both already escaped.
#[must_use]
pub(super) fn chart(id: usize, traces: &[Trace], points: usize, title: &str, description: &str) -> String {
    let lanes = lanes(traces);
    let rests: Vec<[Option<Vec<Sample>>; 2]> =
        traces.iter().map(|t| [Some(rest(t, &t.before)), t.after.as_ref().map(|after| rest(t, after))]).collect();
    let (curves, below) = (curves_panel(traces), rest_panel(traces, &rests));
    let height = TOP + CURVES + BETWEEN + REST + BOTTOM;
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-labelledby=\"t{id} d{id}\"><title id=\"t{id}\">{title}</title>\
         <desc id=\"d{id}\">{description}</desc>\n"
    );
    for (name, panel) in [("a", curves), ("b", below)] {
        let _ = writeln!(
            svg,
            "<clipPath id=\"{name}{id}\"><rect x=\"{LEFT}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>",
            panel.top,
            WIDTH - LEFT - RIGHT,
            panel.height
        );
    }
    for (trace, lane) in traces.iter().zip(&lanes) {
        held(&mut svg, trace, *lane);
    }
    let floor = traces.first().map_or(0.0, |t| t.floor);
    let (upper, lower) = (below.y(floor).max(below.top), below.y(-floor).min(below.top + below.height));
    let _ = writeln!(
        svg,
        "<rect class=\"floor\" x=\"{LEFT}\" y=\"{upper:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
        WIDTH - LEFT - RIGHT,
        (lower - upper).max(0.5)
    );
    axes(&mut svg, &[curves, below], traces, &lanes);
    for ((trace, lane), rests) in traces.iter().zip(&lanes).zip(&rests) {
        let columns = ((points as f64 * lane.width / (WIDTH - LEFT - RIGHT)) as usize).max(8);
        let mut draw = |class: &str, name: &str, panel: Panel, samples: &[Sample]| {
            let path = path(samples, *lane, panel, columns);
            if !path.is_empty() {
                let _ = writeln!(svg, "<path class=\"{class}\" clip-path=\"url(#{name}{id})\" d=\"{path}\"/>");
            }
        };
        let whole = |values: &[f64]| -> Vec<Sample> { trace.time_s.iter().copied().zip(values.iter().copied()).collect() };
        draw("measured", "a", curves, &measured(trace));
        draw("before", "a", curves, &whole(&trace.before));
        if let Some(after) = &trace.after {
            draw("after", "a", curves, &whole(after));
        }
        for (class, samples) in ["before", "after"].iter().zip(rests) {
            draw(class, "b", below, samples.as_deref().unwrap_or_default());
        }
    }
    // Last, so that no curve hides them.
    for (at, lane) in lanes.iter().enumerate().filter(|(_, lane)| lanes.len() > 1 && lane.width > 16.0) {
        let middle = lane.left + 0.5 * lane.width;
        let _ = writeln!(svg, "<text class=\"small over\" x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", TOP + 14.0, at + 1);
    }
    svg + "</svg>"
}

/// Time and value.
type Sample = (f64, f64);

fn measured(trace: &Trace) -> Vec<Sample> {
    trace.time_s.iter().zip(&trace.measured).filter_map(|(t, y)| y.map(|y| (*t, y))).collect()
}

/// measured − predicted, where there is a measurement.
fn rest(trace: &Trace, predicted: &[f64]) -> Vec<Sample> {
    trace.time_s.iter().zip(&trace.measured).zip(predicted).filter_map(|((t, y), p)| y.map(|y| (*t, y - p))).collect()
}

/// Least and greatest finite number.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|v| v.is_finite()).fold(None, |range, v| {
        let (least, greatest) = range.unwrap_or((v, v));
        Some((least.min(v), greatest.max(v)))
    })
}

fn curves_panel(traces: &[Trace]) -> Panel {
    let (low, high) = range(traces.iter().flat_map(|t| t.measured.iter().flatten().copied())).unwrap_or((0.0, 0.0));
    let predicted = traces.iter().flat_map(|t| t.before.iter().chain(t.after.iter().flatten()).copied());
    let (lowest, highest) = range(predicted).unwrap_or((low, high));
    let beyond = LEAVES * (high - low);
    Panel::new(TOP, CURVES, low.min(lowest.max(low - beyond)), high.max(highest.min(high + beyond)))
}

fn rest_panel(traces: &[Trace], rests: &[[Option<Vec<Sample>>; 2]]) -> Panel {
    let spread = range(traces.iter().flat_map(|t| t.measured.iter().flatten().copied())).map_or(0.0, |(low, high)| high - low);
    let floor = traces.iter().map(|t| t.floor).filter(|f| f.is_finite()).fold(0.0, f64::max);
    // What carries no weight at the start of a log may stick out.
    let counts = |t: &Trace, s: &Sample| [t.train, t.held].iter().flatten().any(|[from, to]| (*from..=*to).contains(&s.0));
    let all = traces.iter().zip(rests).flat_map(|(t, r)| r.iter().flatten().flatten().filter(move |s| counts(t, s)).map(|s| s.1.abs()));
    let reach = range(all).map_or(0.0, |(_, most)| most).min((1.0 + LEAVES) * spread).max(1.5 * floor);
    Panel::new(TOP + CURVES + BETWEEN, REST, -reach, reach)
}

fn lanes(traces: &[Trace]) -> Vec<Lane> {
    let durations: Vec<f64> = traces.iter().map(|t| t.time_s.last().copied().unwrap_or(0.0).max(f64::MIN_POSITIVE)).collect();
    let free = WIDTH - LEFT - RIGHT - APART * (traces.len().saturating_sub(1)) as f64;
    let total: f64 = durations.iter().sum();
    let mut left = LEFT;
    durations
        .into_iter()
        .map(|duration_s| {
            let lane = Lane { left, width: free * duration_s / total, duration_s };
            left += lane.width + APART;
            lane
        })
        .collect()
}

/// The held-out part, shaded.
fn held(svg: &mut String, trace: &Trace, lane: Lane) {
    let Some([from, to]) = trace.held else { return };
    let (left, right) = (lane.x(from), lane.x(to));
    let height = CURVES + BETWEEN + REST;
    let _ =
        writeln!(svg, "<rect class=\"held\" x=\"{left:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{height}\"/>", (right - left).max(0.5));
    if right - left > 60.0 {
        let _ = writeln!(svg, "<text class=\"small\" x=\"{:.1}\" y=\"{}\" text-anchor=\"end\">held out</text>", right - 4.0, TOP - 6.0);
    }
}

/// Frames, grid lines, numbers.
fn axes(svg: &mut String, panels: &[Panel], traces: &[Trace], lanes: &[Lane]) {
    for panel in panels {
        for value in ticks(panel.lowest, panel.highest, panel.height / 22.0) {
            let y = panel.y(value.0);
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/>", WIDTH - RIGHT);
            let _ = writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", LEFT - 6.0, y + 4.0, value.1);
        }
    }
    let bottom = TOP + CURVES + BETWEEN + REST;
    let unit =
        traces.first().and_then(|t| t.unit.as_deref()).filter(|u| *u != "1").map(|u| format!(" ({})", escape(u))).unwrap_or_default();
    let _ = writeln!(svg, "<text class=\"small\" x=\"{LEFT}\" y=\"{}\">prediction and measurement{unit}</text>", TOP - 6.0);
    let _ = writeln!(svg, "<text class=\"small\" x=\"{LEFT}\" y=\"{}\">measured − predicted{unit}</text>", bottom - REST - 7.0);
    for (at, lane) in lanes.iter().enumerate() {
        for panel in panels {
            let (left, width) = (lane.left, lane.width);
            let _ = writeln!(
                svg,
                "<rect class=\"frame\" x=\"{left:.1}\" y=\"{}\" width=\"{width:.1}\" height=\"{}\"/>",
                panel.top, panel.height
            );
        }
        for (time_s, label) in ticks(0.0, lane.duration_s, lane.width / 80.0) {
            // A number at the very end would stick out, or touch the next log's.
            let x = lane.x(time_s);
            if lane.width > 60.0 && (at == 0 || x > lane.left + 20.0) {
                let anchor = if x > WIDTH - RIGHT - 14.0 { "end" } else { "middle" };
                let _ = writeln!(svg, "<path class=\"tick\" d=\"M{x:.1} {bottom}v4\"/>");
                let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"{anchor}\">{label}</text>", bottom + 17.0);
            }
        }
    }
    let what = if lanes.len() > 1 { "time in each log (s); logs side by side, numbered" } else { "time (s)" };
    let middle = 0.5 * (LEFT + WIDTH - RIGHT);
    let _ = writeln!(svg, "<text class=\"small\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{what}</text>", bottom + 33.0);
}

/// Round numbers between two, about so many, with their labels.
pub(super) fn ticks(lowest: f64, highest: f64, about: f64) -> Vec<(f64, String)> {
    let width = highest - lowest;
    if !(width.is_finite() && width > 0.0) {
        return Vec::new();
    }
    let rough = width / about.max(1.0);
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0].into_iter().map(|s| s * power).find(|s| *s >= 0.999 * rough).unwrap_or(10.0 * power);
    let first = (lowest / step).ceil();
    let count = ((highest / step).floor() - first).clamp(-1.0, 50.0) + 1.0;
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let most = lowest.abs().max(highest.abs());
    let label = |value: f64| {
        if value == 0.0 && !(1e-4..1e6).contains(&most) {
            return "0".to_owned();
        }
        if !(1e-4..1e6).contains(&most) {
            // The same digits for all: those that tell neighbours apart.
            let digits = (most.log10().floor() - step.log10().floor()).clamp(0.0, 6.0) as usize;
            return format!("{value:.digits$e}").replace('-', "−");
        }
        format!("{value:.decimals$}").replace('-', "−")
    };
    let numbers = (0..count as u32).map(|i| (first + f64::from(i)) * step);
    // A zero that rounding made −0 is 0.
    numbers.map(|v| if v.abs() < 1e-9 * step { 0.0 } else { v }).map(|v| (v, label(v))).collect()
}

/// A curve as the `d` of a path: of many samples in one of `columns` only the least and the greatest; interrupted where samples are missing.
fn path(samples: &[Sample], lane: Lane, panel: Panel, columns: usize) -> String {
    let samples: Vec<Sample> = samples.iter().copied().filter(|s| s.1.is_finite()).collect();
    let distances: Vec<f64> = samples.windows(2).map(|w| w[1].0 - w[0].0).collect();
    let longest = GAP * stats::upper_median(distances).unwrap_or(f64::INFINITY);
    let mut out = String::new();
    let mut pen = |lift: bool, (time, value): Sample| {
        let (x, y) = (lane.x(time), panel.y(value));
        // A sample on its own is a dot.
        let _ = if lift { write!(out, "M{x:.1} {y:.1}h0") } else { write!(out, "L{x:.1} {y:.1}") };
    };
    let column = |s: &Sample| if samples.len() <= 2 * columns { usize::MAX } else { (s.0 / lane.duration_s * columns as f64) as usize };
    let mut at = 0;
    while at < samples.len() {
        let here = column(&samples[at]);
        let same = |i: usize| here != usize::MAX && column(&samples[i]) == here && samples[i].0 - samples[i - 1].0 <= longest;
        let end = (at + 1..samples.len()).find(|&i| !same(i)).unwrap_or(samples.len());
        let group = &samples[at..end];
        let by = |a: &&Sample, b: &&Sample| a.1.total_cmp(&b.1);
        if let (Some(least), Some(greatest)) = (group.iter().min_by(by), group.iter().max_by(by)) {
            let (first, second) = if least.0 <= greatest.0 { (least, greatest) } else { (greatest, least) };
            pen(at == 0 || samples[at].0 - samples[at - 1].0 > longest, *first);
            if second.0 > first.0 {
                pen(false, *second);
            }
        }
        at = end;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const LANE: Lane = Lane { left: 0.0, width: 100.0, duration_s: 10.0 };

    fn panel() -> Panel {
        Panel { top: 0.0, height: 100.0, lowest: 0.0, highest: 1.0 }
    }

    #[test]
    fn a_missing_stretch_interrupts_the_curve_and_a_sample_alone_is_a_dot() {
        let samples = [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (5.0, 1.0), (8.0, 0.0), (9.0, 0.5)];
        assert_eq!(path(&samples, LANE, panel(), 100), "M0.0 100.0h0L10.0 0.0L20.0 100.0M50.0 0.0h0M80.0 100.0h0L90.0 50.0");
    }

    #[test]
    fn thinning_keeps_the_extremes() {
        let mut samples: Vec<Sample> = (0..1000).map(|i| (f64::from(i) * 0.01, 0.5)).collect();
        samples[433].1 = 1.0;
        samples[437].1 = 0.0;
        let drawn = path(&samples, LANE, panel(), 10);
        assert!(drawn.contains("43.3 0.0") && drawn.contains("43.7 100.0"), "{drawn}");
        assert!(drawn.matches(['M', 'L']).count() <= 20, "{drawn}");
        assert_eq!(drawn.matches('M').count(), 1);
    }

    #[test]
    fn ticks_are_round_and_their_labels_tell_them_apart() {
        let labels = |l, h| ticks(l, h, 5.0).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(-0.1, 1.05), ["0.0", "0.5", "1.0"]);
        assert_eq!(labels(0.0, 12.0), ["0", "5", "10"]);
        assert_eq!(labels(-1.1e-7, 1.1e-7), ["−1.0e−7", "−5.0e−8", "0", "5.0e−8", "1.0e−7"]);
        assert!(labels(1.0, 1.0).is_empty());
    }
}

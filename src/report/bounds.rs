//! Errors beside the Cramér-Rao bound: a row of panels per class of methods, a column per grid, both axes logarithmic.

use std::fmt::Write as _;

use super::escape::escape;
use super::study::over_bound;
use deadtime_delay::{Class, METHODS};
use deadtime_signal::stats;
use deadtime_study::{Cell, Plan, Shown, Study};

/// Left of a panel, its width and height, and the room between two.
const LEFT: f64 = 70.0;
const WIDE: f64 = 330.0;
const HIGH: f64 = 200.0;
const BETWEEN: f64 = 60.0;
/// Above a panel its title, below it the axis.
const ABOVE: f64 = 34.0;
const BELOW: f64 = 44.0;
const LEGEND: f64 = 190.0;
/// The most that a character of a label takes, room beside it included.
const CHARACTER: f64 = 8.0;
/// Colours that are told apart with most kinds of colour blindness (Okabe and Ito 2008), and three more in dashes.
const COLOURS: [&str; 7] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5c00"];
const STYLE: &str = "text{font:13px sans-serif;fill:#222}.frame{fill:none;stroke:#999}.grid{stroke:#e4e4e4}.line{fill:none;stroke-width:2}\
    .bound{fill:none;stroke:#000;stroke-width:2.5;stroke-dasharray:7 4}";

/// A grid against one of its keys.
struct Column<'a> {
    heading: &'static str,
    x: fn(&Cell) -> Option<f64>,
    cells: Vec<&'a Cell>,
    /// Decades of the two axes.
    span: [[f64; 2]; 2],
}

impl Column<'_> {
    /// The values of the key, rising.
    fn values(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.cells.iter().filter_map(|c| (self.x)(c)).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    }

    fn at(&self, value: f64) -> impl Iterator<Item = &Cell> {
        self.cells.iter().copied().filter(move |c| (self.x)(c) == Some(value))
    }

    /// The least error of an unbiased estimate at every value of the key.
    fn bound(&self) -> Vec<[f64; 2]> {
        let median = |value: f64| {
            stats::upper_median(self.at(value).filter_map(|c| c.bound_rms_samples).collect())
        };
        self.values().into_iter().filter_map(|v| Some([v, median(v)?])).collect()
    }

    /// A method's errors, where half of the records have an answer at least.
    fn errors(&self, method: &str) -> Vec<[f64; 2]> {
        let of = |value: f64| {
            let cells: Vec<&Cell> = self.at(value).filter(|c| c.method_text() == method).collect();
            over_bound(&cells)?;
            stats::mean(cells.iter().filter_map(|c| c.rms_samples))
        };
        self.values().into_iter().filter_map(|v| Some([v, of(v)?])).filter(|p| p[1] > 0.0).collect()
    }
}

/// The drawing; `None` where no grid asks for a table `over_bound: snr` or `over_bound: samples`.
#[must_use]
pub fn svg(study: &Study, plan: &Plan) -> Option<String> {
    let mut columns: Vec<Column<'_>> = Vec::new();
    for grid in &plan.grids {
        for layout in grid.by.iter().filter(|l| l.shown == Shown::OverBound) {
            let (heading, x): (_, fn(&Cell) -> Option<f64>) =
                match layout.keys.last().map(String::as_str) {
                    Some("snr") => ("var(signal)/var(noise)", |c| c.snr),
                    Some("samples") => ("samples of a record", |c| Some(c.samples as f64)),
                    _ => continue,
                };
            let cells = study.cells.iter().filter(|c| c.grid == grid.name).collect();
            columns.push(Column { heading, x, cells, span: [[0.0, 1.0]; 2] });
        }
    }
    if columns.is_empty() {
        return None;
    }
    let names = |class: Class| -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        let of_class =
            |c: &&&Cell| METHODS.iter().any(|m| m.entry.name == c.method && m.class == class);
        for name in
            columns.iter().flat_map(|c| c.cells.iter()).filter(of_class).map(|c| c.method_text())
        {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    };
    let rows: Vec<(Class, Vec<String>)> =
        Class::ALL.iter().map(|c| (*c, names(*c))).filter(|(_, names)| !names.is_empty()).collect();
    // Every row has the same axes, so that classes compare.
    let reach = |points: &mut dyn Iterator<Item = f64>| -> [f64; 2] {
        let [low, high] = points
            .filter(|v| *v > 0.0)
            .map(f64::log10)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
        if low < high { [low, high] } else { [low.min(0.0) - 0.5, high.max(0.0) + 0.5] }
    };
    for column in &mut columns {
        let all: Vec<[f64; 2]> = rows
            .iter()
            .flat_map(|(_, names)| names)
            .flat_map(|n| column.errors(n))
            .chain(column.bound())
            .collect();
        let margin =
            |[low, high]: [f64; 2]| [low - 0.04 * (high - low), high + 0.04 * (high - low)];
        column.span = [0, 1].map(|axis| margin(reach(&mut all.iter().map(|p| p[axis]))));
    }
    let (width, height) = (
        LEFT + columns.len() as f64 * (WIDE + BETWEEN) + LEGEND,
        rows.len() as f64 * (ABOVE + HIGH + BELOW),
    );
    let mut body = String::new();
    for (row, (class, names)) in rows.iter().enumerate() {
        let top = row as f64 * (ABOVE + HIGH + BELOW) + ABOVE;
        let _ = writeln!(
            body,
            "<text x=\"{LEFT}\" y=\"{}\" style=\"font-size:16px\">{}</text>",
            top - 10.0,
            class.title()
        );
        for (at, column) in columns.iter().enumerate() {
            panel(&mut body, column, names, (LEFT + at as f64 * (WIDE + BETWEEN), top));
        }
        legend(&mut body, names, (width - LEGEND - 20.0, top));
    }
    Some(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n<style>{STYLE}</style>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n{body}</svg>\n"
    ))
}

/// Frame, axes, the bound, and a line per method.
fn panel(svg: &mut String, column: &Column<'_>, names: &[String], (left, top): (f64, f64)) {
    let [across, up] = column.span;
    let share =
        |[low, high]: [f64; 2], value: f64| ((value.log10() - low) / (high - low)).clamp(0.0, 1.0);
    let (x, y) =
        (|v: f64| left + share(across, v) * WIDE, |v: f64| top + HIGH - share(up, v) * HIGH);
    let mut taken = f64::NEG_INFINITY;
    for value in column.values() {
        let (at, label) = (x(value), value.to_string());
        let _ = writeln!(svg, "<path class=\"grid\" d=\"M{at:.1} {top}v{HIGH}\"/>");
        // Labels that would run into the one before are left out.
        let half = 0.5 * CHARACTER * label.len() as f64;
        if at - half >= taken {
            let _ = writeln!(
                svg,
                "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
                top + HIGH + 16.0
            );
            taken = at + half;
        }
    }
    for decade in up[0].ceil() as i32..=up[1].floor() as i32 {
        let value = 10_f64.powi(decade);
        let at = y(value);
        let _ = writeln!(svg, "<path class=\"grid\" d=\"M{left} {at:.1}h{WIDE}\"/>");
        let label = if value < 1.0 { value.to_string() } else { format!("{value:.0}") };
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            left - 6.0,
            at + 4.0
        );
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{left}\" y=\"{top}\" width=\"{WIDE}\" height=\"{HIGH}\"/>"
    );
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        left + 0.5 * WIDE,
        top + HIGH + 34.0,
        column.heading
    );
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" transform=\"rotate(-90 {0} {1})\">RMS error (samples)</text>",
        left - 44.0,
        top + 0.5 * HIGH
    );
    let path = |points: &[[f64; 2]]| {
        points
            .iter()
            .map(|p| format!("{:.1} {:.1}", x(p[0]), y(p[1])))
            .collect::<Vec<String>>()
            .join("L")
    };
    let bound = column.bound();
    if !bound.is_empty() {
        let _ = writeln!(svg, "<path class=\"bound\" d=\"M{}\"/>", path(&bound));
    }
    for (number, name) in names.iter().enumerate() {
        let points = column.errors(name);
        if points.is_empty() {
            continue;
        }
        let (colour, dashes) = look(number);
        let _ = writeln!(
            svg,
            "<path class=\"line\" stroke=\"{colour}\"{dashes} d=\"M{}\"/>",
            path(&points)
        );
        for [value, error] in points {
            let _ = writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{colour}\"/>",
                x(value),
                y(error)
            );
        }
    }
}

/// Colour and dashes of a line.
fn look(number: usize) -> (&'static str, &'static str) {
    let colour = COLOURS.get(number % COLOURS.len()).copied().unwrap_or("#000");
    (colour, if number >= COLOURS.len() { " stroke-dasharray=\"3 3\"" } else { "" })
}

fn legend(svg: &mut String, names: &[String], (left, top): (f64, f64)) {
    let mut line = |row: usize, stroke: String, text: &str| {
        let y = top + 12.0 + 17.0 * row as f64;
        let _ = writeln!(svg, "<path {stroke} d=\"M{left} {y}h26\"/>");
        let _ =
            writeln!(svg, "<text x=\"{}\" y=\"{}\">{}</text>", left + 32.0, y + 4.0, escape(text));
    };
    line(0, "class=\"bound\"".to_owned(), "Cramér-Rao bound");
    for (number, name) in names.iter().enumerate() {
        let (colour, dashes) = look(number);
        line(number + 1, format!("class=\"line\" stroke=\"{colour}\"{dashes}"), name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_line_ends_where_half_of_the_records_have_no_answer_and_stands_above_the_bound_by_its_ratio()
     {
        let text = "format = \"deadtime/plan@1\"\nname = \"p\"\nplant = \"slow2\"\nexcitation = \"rbs\"\nmethod = \"p2d\"\nsnr = [1, 10, 100]\nby = [\"over_bound: snr\"]\n";
        let plan = Plan::parse("p", text, std::path::Path::new(".")).unwrap();
        let cell = |snr: f64, rms: f64, flagged: usize| {
            json!({ "grid": "p", "plant": "slow2", "input": "u", "output": "y", "c2d": "zoh", "excitation": "rbs", "snr": snr, "noise": "white", "loop": "open",
                "place": "u", "delay_s": 9.0, "samples": 100, "sample_time_s": 1.0, "max_delay": 9, "truth": "delay", "method": "p2d", "options": {},
                "trials": 10, "rms_samples": rms, "rms_ci95_samples": null, "bias_samples": 0.0, "flagged": flagged, "unflagged_wrong": 0, "coverage95": null,
                "bound_rms_samples": 0.1, "time_per_estimate_s": null })
        };
        let of = |cells: [serde_json::Value; 3]| -> Study {
            let study = json!({ "format": "deadtime/study@1", "plan": "p", "seed": 1, "program": "", "cells": cells, "scores": [] });
            serde_json::from_value(study).unwrap()
        };
        let study = of([cell(1.0, 10.0, 6), cell(10.0, 1.0, 5), cell(100.0, 0.1, 0)]);
        let drawn = svg(&study, &plan).unwrap();
        // Two of three answer often enough; the last lies on the bound.
        assert_eq!(drawn.matches("<circle").count(), 2);
        let points = |class: &str| {
            let path = drawn
                .split(class)
                .nth(1)
                .unwrap()
                .split(" d=\"M")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap();
            path.split('L').map(str::to_owned).collect::<Vec<String>>()
        };
        let (line, bound) = (points("class=\"line\""), points("class=\"bound\""));
        assert_eq!((line.len(), bound.len()), (2, 3));
        assert_eq!(line[1], bound[2]);
        let table = crate::report::study::by(&study, "p", &plan.grids[0].by[0]).markdown();
        assert!(table.contains("10.0") && table.contains("1.00"), "{table}");
        assert!(svg(&study, &Plan::open("ci").unwrap()).is_none());
        // Every value has its label, but one that would run into its neighbour.
        let labelled = |drawn: &str, value: &str| {
            drawn.contains(&format!("text-anchor=\"middle\">{value}</text>"))
        };
        assert!(["1", "10", "100"].iter().all(|v| labelled(&drawn, v)));
        let close =
            svg(&of([cell(10.0, 1.0, 0), cell(10.5, 1.0, 0), cell(100.0, 0.1, 0)]), &plan).unwrap();
        assert!(labelled(&close, "10") && !labelled(&close, "10.5") && labelled(&close, "100"));
    }
}

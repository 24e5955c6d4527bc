//! Errors and the Cramér-Rao bound: a row of panels per class of methods, a column per grid, both axes logarithmic.

use maud::{Markup, html};

use super::drawing::{Panel, Scale, document, px, text};
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
/// The most that a character of a label takes, its margin included.
const CHARACTER: f64 = 8.0;
/// Colours that are distinguishable with most kinds of colour blindness (Okabe and Ito 2008), and three more in dashes.
const COLOURS: [&str; 7] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5c00"];
const STYLE: &str = "text{font:13px sans-serif;fill:#222}text.title{font-size:16px}.frame{fill:none;stroke:#999}.grid{stroke:#e4e4e4}.line{fill:none;stroke-width:2}\
    .bound{fill:none;stroke:#000;stroke-width:2.5;stroke-dasharray:7 4}";

/// A grid against one of its keys.
struct Column<'a> {
    heading: &'static str,
    x: fn(&Cell) -> Option<f64>,
    cells: Vec<&'a Cell>,
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

/// The grids that ask for a table `over_bound: snr` or `over_bound: samples`.
fn columns<'a>(study: &'a Study, plan: &Plan) -> Vec<Column<'a>> {
    let mut columns = Vec::new();
    for grid in &plan.grids {
        for layout in grid.by.iter().filter(|l| l.shown == Shown::OverBound) {
            let (heading, x): (_, fn(&Cell) -> Option<f64>) =
                match layout.keys.last().map(String::as_str) {
                    Some("snr") => ("var(signal)/var(noise)", |c| c.snr),
                    Some("samples") => ("samples of a record", |c| Some(c.samples as f64)),
                    _ => continue,
                };
            let cells = study.cells.iter().filter(|c| c.grid == grid.name).collect();
            columns.push(Column { heading, x, cells });
        }
    }
    columns
}

/// The methods of every class that the columns hold.
fn classes(columns: &[Column<'_>]) -> Vec<(Class, Vec<String>)> {
    let names = |class: Class| -> Vec<String> {
        let of_class =
            |c: &&&Cell| METHODS.iter().any(|m| m.entry.name == c.method && m.class == class);
        let mut names: Vec<String> = Vec::new();
        for cell in columns.iter().flat_map(|c| c.cells.iter()).filter(of_class) {
            let name = cell.method_text();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    };
    Class::ALL.iter().map(|c| (*c, names(*c))).filter(|(_, names)| !names.is_empty()).collect()
}

/// The two axes of a column, the same in every row, so that classes compare.
fn scales(column: &Column<'_>, rows: &[(Class, Vec<String>)]) -> [Scale; 2] {
    let errors = rows.iter().flat_map(|(_, names)| names).flat_map(|n| column.errors(n));
    let all: Vec<[f64; 2]> = errors.chain(column.bound()).collect();
    [0, 1].map(|axis| {
        let [low, high] = all
            .iter()
            .map(|p| p[axis])
            .filter(|v| *v > 0.0)
            .map(f64::log10)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
        let [low, high] =
            if low < high { [low, high] } else { [low.min(0.0) - 0.5, high.max(0.0) + 0.5] };
        Scale::with_margin(low, high, true)
    })
}

/// The drawing; `None` where no grid has a table `over_bound: snr` or `over_bound: samples`.
#[must_use]
pub fn svg(study: &Study, plan: &Plan) -> Option<String> {
    let columns = columns(study, plan);
    if columns.is_empty() {
        return None;
    }
    let rows = classes(&columns);
    let row_height = ABOVE + HIGH + BELOW;
    let (width, height) =
        (LEFT + columns.len() as f64 * (WIDE + BETWEEN) + LEGEND, rows.len() as f64 * row_height);
    let place = |column: usize, top: f64, [across, up]: [Scale; 2]| Panel {
        left: LEFT + column as f64 * (WIDE + BETWEEN),
        top,
        width: WIDE,
        height: HIGH,
        across,
        up,
    };
    let scales: Vec<[Scale; 2]> = columns.iter().map(|column| scales(column, &rows)).collect();
    let body = html! {
        @for (row, (class, names)) in rows.iter().enumerate() {
            @let top = row as f64 * row_height + ABOVE;
            (text((LEFT, top - 10.0), "start", "title", class.title()))
            @for (at, (column, scale)) in columns.iter().zip(&scales).enumerate() {
                (panel(column, names, &place(at, top, *scale)))
            }
            (legend(names, (width - LEGEND - 20.0, top)))
        }
    };
    Some(document([width, height], STYLE, &body))
}

/// Frame, axes, the bound, and a line per method.
fn panel(column: &Column<'_>, names: &[String], panel: &Panel) -> Markup {
    let decades = panel.up.from.ceil() as i32..=panel.up.to.floor() as i32;
    let decade = |value: f64| if value < 1.0 { value.to_string() } else { format!("{value:.0}") };
    let middle = (panel.left - 44.0, panel.top + 0.5 * panel.height);
    let bound = column.bound();
    html! {
        (values(column, panel))
        @for value in decades.map(|d| 10_f64.powi(d)) { (panel.level(value, &decade(value))) }
        (panel.frame())
        (panel.across_label(34.0, column.heading))
        g transform=(format!("rotate(-90 {} {})", px(middle.0), px(middle.1))) { (text(middle, "middle", "", "RMS error (samples)")) }
        @if !bound.is_empty() { path .bound d=(panel.path(&bound)) {} }
        @for (number, name) in names.iter().enumerate() {
            @let (points, (colour, dashes)) = (column.errors(name), look(number));
            @if !points.is_empty() {
                path .line stroke=(colour) stroke-dasharray=[dashes] d=(panel.path(&points)) {}
                @for [value, error] in points { circle cx=(px(panel.x(value))) cy=(px(panel.y(error))) r="3" fill=(colour) {} }
            }
        }
    }
}

/// A line up at every value of the key, and the labels that do not run into the one before.
fn values(column: &Column<'_>, panel: &Panel) -> Markup {
    let mut taken = f64::NEG_INFINITY;
    let mut free = |at: f64, label: &str| {
        let half = 0.5 * CHARACTER * label.len() as f64;
        let free = at - half >= taken;
        taken = if free { at + half } else { taken };
        free
    };
    html! {
        @for value in column.values() {
            @let (at, label) = (panel.x(value), value.to_string());
            path .grid d={ "M" (px(at)) " " (px(panel.top)) "v" (px(panel.height)) } {}
            @if free(at, &label) { (text((at, panel.bottom() + 16.0), "middle", "", &label)) }
        }
    }
}

/// Colour and dashes of a line.
fn look(number: usize) -> (&'static str, Option<&'static str>) {
    let colour = COLOURS.get(number % COLOURS.len()).copied().unwrap_or("#000");
    (colour, (number >= COLOURS.len()).then_some("3 3"))
}

fn legend(names: &[String], (left, top): (f64, f64)) -> Markup {
    let y = |row: usize| top + 12.0 + 17.0 * row as f64;
    let name = |row: usize, name: &str| text((left + 32.0, y(row) + 4.0), "start", "", name);
    let dash = |row: usize| format!("M{} {}h26", px(left), px(y(row)));
    html! {
        path .bound d=(dash(0)) {}
        (name(0, "Cramér-Rao bound"))
        @for (row, method) in (1..).zip(names) {
            @let (colour, dashes) = look(row - 1);
            path .line stroke=(colour) stroke-dasharray=[dashes] d=(dash(row)) {}
            (name(row, method))
        }
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

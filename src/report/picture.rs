//! A picture of the answers: every method's dead time with its interval, above the estimated impulse response.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::estimate::A_HANDFUL;
use crate::delay::report::{Estimate, Pair, Response};

/// One pair's part of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Panel<'a> {
    /// The answers.
    pub pair: &'a Pair,
    /// The impulse response, where the input allows one.
    pub response: Option<&'a Response>,
}

const WIDTH: u32 = 900;
/// Height of the answers' part but for its rows, and of a row.
const FRAME: u32 = 90;
const ROW: u32 = 24;
const RESPONSE: u32 = 230;
/// Standard deviations that the band around the response shows, as `threshold` has by default.
const BAND: f64 = 5.0;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// The picture as SVG; `sample_time_s` scales the responses' time axis.
///
/// # Errors
/// What the drawing library says; it does not fail on finite numbers.
pub fn svg(panels: &[Panel<'_>], sample_time_s: f64) -> Result<String, String> {
    let height: u32 = panels.iter().map(|p| answers_height(p.pair) + if p.response.is_some() { RESPONSE } else { 0 }).sum();
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, (WIDTH, height.max(1))).into_drawing_area();
        draw(&root, panels, sample_time_s).map_err(|e| e.to_string())?;
        root.present().map_err(|e| e.to_string())?;
    }
    Ok(text)
}

/// The answers that are drawn: of many methods those that have a delay.
fn shown(pair: &Pair) -> Vec<&Estimate> {
    let many = pair.estimates.len() > A_HANDFUL;
    pair.estimates.iter().filter(|e| !many || e.delay_s.is_some()).collect()
}

fn answers_height(pair: &Pair) -> u32 {
    FRAME + ROW * u32::try_from(shown(pair).len().max(2)).unwrap_or(u32::MAX / ROW / 2)
}

fn draw(root: &Area<'_>, panels: &[Panel<'_>], sample_time_s: f64) -> Drawn {
    root.fill(&WHITE)?;
    let mut rest = root.clone();
    for panel in panels {
        // Both parts share one time axis, so that a delay stands above the sample where the response begins.
        let longest = shown(panel.pair)
            .iter()
            .filter(|e| e.counts())
            .filter_map(|e| Some(e.ci95_s?[1].max(e.raw_delay_s?)))
            .fold(4.0 * sample_time_s, f64::max);
        let axis = -0.05 * longest..2.5 * longest;
        let (part, below) = rest.split_vertically(answers_height(panel.pair));
        answers(root, &part, panel.pair, axis.clone())?;
        rest = below;
        if let Some(response) = panel.response {
            let (part, below) = rest.split_vertically(RESPONSE);
            impulse(&part, response, axis, sample_time_s)?;
            rest = below;
        }
    }
    Ok(())
}

/// One line per method: the interval as a bar, the dead time as a dot; the verdict as a band behind them.
fn answers(root: &Area<'_>, area: &Area<'_>, pair: &Pair, axis: Range<f64>) -> Drawn {
    let target = if pair.output == "*" { "the states" } else { &pair.output };
    let estimates = shown(pair);
    let rows = estimates.len();
    let top = rows as f64;
    let mut chart = ChartBuilder::on(area)
        .caption(format!("{} to {target}: dead time by method, 95 % intervals (grey: not counted)", pair.input), ("sans-serif", 17))
        .margin(8)
        .x_label_area_size(34)
        .y_label_area_size(150)
        .build_cartesian_2d(axis.clone(), -0.5..top - 0.5)?;
    chart.configure_mesh().disable_y_mesh().y_labels(0).x_desc("seconds").light_line_style(WHITE).draw()?;
    if let (Some(delay), Some([from, to])) = (pair.verdict.delay_s, pair.verdict.ci95_s) {
        chart.draw_series([Rectangle::new([(from, -0.5), (to, top - 0.5)], RGBColor(225, 236, 247).filled())])?;
        chart.draw_series([PathElement::new([(delay, -0.5), (delay, top - 0.5)], RGBColor(90, 140, 190).stroke_width(1))])?;
    }
    let label = TextStyle::from(("sans-serif", 14).into_font()).pos(Pos::new(HPos::Right, VPos::Center));
    let aside = TextStyle::from(("sans-serif", 13).into_font()).color(&RGBColor(110, 110, 110)).pos(Pos::new(HPos::Left, VPos::Center));
    for (i, estimate) in estimates.iter().enumerate() {
        let y = (rows - 1 - i) as f64;
        let (x, row) = chart.backend_coord(&(axis.start, y));
        // Positions are those of the whole picture.
        root.draw(&Text::new(estimate.method.clone(), (x - 8, row), label.clone()))?;
        match (estimate.delay_s, estimate.ci95_s) {
            (Some(delay), Some([from, to])) => {
                let (bar, dot) = if estimate.counts() {
                    (RGBColor(40, 40, 40), RGBColor(200, 60, 40))
                } else {
                    (RGBColor(190, 190, 190), RGBColor(150, 150, 150))
                };
                // What lies beyond the axis ends at it.
                let end = |v: f64| v.clamp(axis.start, axis.end);
                chart.draw_series([PathElement::new([(end(from), y), (end(to), y)], bar.stroke_width(3))])?;
                if axis.contains(&delay) {
                    chart.draw_series([Circle::new((delay, y), 5, dot.filled())])?;
                }
            }
            _ => root.draw(&Text::new(estimate.outcome.name().replace('_', " "), (x + 8, row), aside.clone()))?,
        }
    }
    Ok(())
}

/// The coefficients as stems, their threshold as a band.
fn impulse(area: &Area<'_>, response: &Response, axis: Range<f64>, sample_time_s: f64) -> Drawn {
    let at = |i: usize| i as f64 * sample_time_s;
    let shown: Vec<usize> = (0..response.values.len()).filter(|&i| at(i) <= axis.end).collect();
    let reach = shown.iter().map(|&i| response.values[i].abs().max(BAND * response.std[i])).fold(f64::MIN_POSITIVE, f64::max) * 1.1;
    let mut chart = ChartBuilder::on(area)
        .caption(
            format!("estimated impulse response; grey: {BAND} standard deviations (the dead time ends before the first stem outside)"),
            ("sans-serif", 14),
        )
        .margin(8)
        .x_label_area_size(34)
        .y_label_area_size(150)
        .build_cartesian_2d(axis, -reach..reach)?;
    chart.configure_mesh().x_desc("seconds").y_labels(5).light_line_style(WHITE).draw()?;
    let upper = shown.iter().map(|&i| (at(i), BAND * response.std[i]));
    let lower = shown.iter().rev().map(|&i| (at(i), -BAND * response.std[i]));
    chart.draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), RGBColor(205, 205, 205).filled())])?;
    for &i in &shown {
        let (x, h) = (at(i), response.values[i]);
        let colour = if h.abs() > BAND * response.std[i] { RGBColor(200, 60, 40) } else { RGBColor(70, 70, 70) };
        chart.draw_series([PathElement::new([(x, 0.0), (x, h)], colour.stroke_width(2))])?;
        chart.draw_series([Circle::new((x, h), 3, colour.filled())])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delay::report::Estimate;
    use crate::delay::{DelayEstimate, Outcome, Verdict};

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
                .map(|(name, e)| Estimate::new(crate::delay::method(name).unwrap(), e, None, 0.0, &[]))
                .collect(),
            verdict: Verdict { delay_s: Some(0.2), ci95_s: Some([0.1, 0.3]), why: String::new(), method: None },
        };
        let response = Response { values: vec![0.0, 0.0, 1.0], std: vec![0.01; 3] };
        let text = svg(&[Panel { pair: &pair, response: Some(&response) }, Panel { pair: &pair, response: None }], 0.1).unwrap();
        for part in ["oestruc", "arxstruc", "not rich enough", "u&lt;1&gt;", "impulse response", "</svg>"] {
            assert!(text.contains(part), "{part}");
        }
    }
}

//! Charts as SVG, for `--svg` and for pages: the document, panels with two axes, marks.

use maud::{Markup, PreEscaped, html};

use super::escape::escape;

/// Numbers along an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) from: f64,
    pub(super) to: f64,
    /// `from` and `to` are decades.
    pub(super) logarithmic: bool,
}

impl Scale {
    /// From the lowest to the highest value, with a margin of 4 % beyond each.
    pub(super) fn with_margin(lowest: f64, highest: f64, logarithmic: bool) -> Self {
        let margin = 0.04 * (highest - lowest);
        Self { from: lowest - margin, to: highest + margin, logarithmic }
    }

    /// The place of a value, 0 to 1; a value beyond an end is drawn at it.
    fn share(self, value: f64) -> f64 {
        let value = if self.logarithmic { value.log10() } else { value };
        ((value - self.from) / (self.to - self.from)).clamp(0.0, 1.0)
    }
}

/// A rectangle with two axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panel {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) across: Scale,
    pub(super) up: Scale,
}

impl Panel {
    pub(super) fn x(&self, value: f64) -> f64 {
        self.left + self.across.share(value) * self.width
    }

    pub(super) fn y(&self, value: f64) -> f64 {
        self.bottom() - self.up.share(value) * self.height
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Its edge.
    pub(super) fn frame(&self) -> Markup {
        html! { rect .frame x=(px(self.left)) y=(px(self.top)) width=(px(self.width)) height=(px(self.height)) {} }
    }

    /// A line across at a value, with its label at the left.
    pub(super) fn level(&self, value: f64, label: &str) -> Markup {
        let y = self.y(value);
        html! {
            path .grid d={ "M" (px(self.left)) " " (px(y)) "h" (px(self.width)) } {}
            (text((self.left - 8.0, y + 5.0), "end", "", label))
        }
    }

    /// The name of the axis across.
    pub(super) fn across_label(&self, below: f64, label: &str) -> Markup {
        text((self.left + 0.5 * self.width, self.bottom() + below), "middle", "", label)
    }

    /// The path through points of the two axes.
    pub(super) fn path(&self, points: &[[f64; 2]]) -> String {
        let points: Vec<String> =
            points.iter().map(|[x, y]| format!("{} {}", px(self.x(*x)), px(self.y(*y)))).collect();
        format!("M{}", points.join("L"))
    }
}

/// A coordinate, to 0.1 pixel.
pub(super) fn px(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map(str::to_owned).unwrap_or(text)
}

/// A text at a place; `anchor` is its start, middle or end.
pub(super) fn text((x, y): (f64, f64), anchor: &str, class: &str, content: &str) -> Markup {
    html! { text class=[Some(class).filter(|c| !c.is_empty())] x=(px(x)) y=(px(y)) text-anchor=(anchor) { (PreEscaped(escape(content))) } }
}

/// A separate drawing, with its colours in it.
pub(super) fn document([width, height]: [f64; 2], style: &str, body: &Markup) -> String {
    let drawn = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } {
            style { (PreEscaped(style)) }
            rect width=(width) height=(height) fill="#fff" {}
            (body)
        }
    };
    drawn.into_string() + "\n"
}

/// Round numbers between two, about so many, with their labels.
pub(super) fn ticks(lowest: f64, highest: f64, about: f64) -> Vec<(f64, String)> {
    let width = highest - lowest;
    if !(width.is_finite() && width > 0.0) {
        return Vec::new();
    }
    let rough = width / about.max(1.0);
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0]
        .into_iter()
        .map(|s| s * power)
        .find(|s| *s >= 0.999 * rough)
        .unwrap_or(10.0 * power);
    let first = (lowest / step).ceil();
    let count = ((highest / step).floor() - first).clamp(-1.0, 50.0) + 1.0;
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let most = lowest.abs().max(highest.abs());
    let label = |value: f64| {
        if value == 0.0 && !(1e-4..1e6).contains(&most) {
            return "0".to_owned();
        }
        if !(1e-4..1e6).contains(&most) {
            // The same digits for all: enough to distinguish neighbours.
            let digits = (most.log10().floor() - step.log10().floor()).clamp(0.0, 6.0) as usize;
            return format!("{value:.digits$e}").replace('-', "−");
        }
        format!("{value:.decimals$}").replace('-', "−")
    };
    let numbers = (0..count as u32).map(|i| (first + f64::from(i)) * step);
    // A zero that rounding made −0 is 0.
    numbers.map(|v| if v.abs() < 1e-9 * step { 0.0 } else { v }).map(|v| (v, label(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_their_labels_tell_them_apart() {
        let labels = |l, h| ticks(l, h, 5.0).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(-0.1, 1.05), ["0.0", "0.5", "1.0"]);
        assert_eq!(labels(0.0, 12.0), ["0", "5", "10"]);
        assert_eq!(labels(-1.1e-7, 1.1e-7), ["−1.0e−7", "−5.0e−8", "0", "5.0e−8", "1.0e−7"]);
        assert!(labels(1.0, 1.0).is_empty());
    }
}

//! Bars inside tables: no script, and they print.

use maud::{Markup, html};

/// A share of less is not drawn: the narrowest stretch has two pixels.
const LEAST: f64 = 0.001;

/// A stretch from `from` to `to`, both 0 to 1, of this class.
pub(super) fn stretch(from: f64, to: f64, class: &str) -> Markup {
    let (from, to) = (within(from), within(to));
    html! { @if to - from >= LEAST { i class=(class) style=(format!("left:{:.2}%;width:{:.2}%", 100.0 * from, 100.0 * (to - from))) {} } }
}

/// A dot at `at`, 0 to 1; beyond, an arrow at the end.
pub(super) fn dot(at: f64, class: &str) -> Markup {
    html! {
        @if at.is_nan() {} @else if at < -1e-9 { b .left { "‹" } } @else if at > 1.0 + 1e-9 { b { "›" } } @else {
            i class={ "dot " (class) } style=(format!("left:{:.2}%", 100.0 * within(at))) {}
        }
    }
}

/// The drawing on one line, with words for those who cannot see it.
pub(super) fn bar(label: &str, drawn: &Markup) -> Markup {
    html! { span .bar role="img" aria-label=(label) { (drawn) } }
}

fn within(share: f64) -> f64 {
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

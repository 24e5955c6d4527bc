//! The frame of every page, and its parts.

use super::series::base64;
use crate::report::text::Table;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;
use sha2::{Digest, Sha256};

pub(super) const STYLE: &str = include_str!("page.css");

pub(super) const UPLOT_STYLE: &str = include_str!("../vendor/uplot/uPlot.min.css");

pub(super) const UPLOT: &str = include_str!("../vendor/uplot/uPlot.iife.min.js");

pub(super) const SCRIPT: &str = concat!(include_str!("frame.js"), include_str!("time.js"));

/// A page of this title; `data` is drawn by its script. Only the page's own scripts may run: their digests are in its policy.
pub(super) fn page(title: &str, body: &Markup, data: &Value) -> String {
    let digest = |script: &str| {
        format!("'sha256-{}'", base64(Sha256::digest(script.as_bytes()).into_iter()))
    };
    let policy = format!(
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {} {}",
        digest(UPLOT),
        digest(SCRIPT)
    );
    // No name can end its enclosing element.
    let data = data.to_string().replace('<', "\\u003c");
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(UPLOT_STYLE)) (PreEscaped(STYLE)) }
            }
            body {
                main { (body) (made_by()) }
                script #data type="application/json" { (PreEscaped(data)) }
                script { (PreEscaped(UPLOT)) }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
    .into_string()
}

/// The place of the script's drawing; a note for readers without scripts.
pub(super) fn plots(what: &str) -> Markup {
    html! {
        div .tools #tools role="toolbar" aria-label="What the plots show" {}
        p .faint { "Drag across a plot to zoom all of them, double-click for the whole log. In a focused plot: arrow keys, +, − and 0; Shift and the wheel." }
        div #plots {}
        noscript { p { (what) " are drawn by the page's own script, which is switched off here; every number stands below." } }
    }
}

/// The place of a figure of the script, which has pickers, zooms and shows numbers; its content, `what`, is in a table too.
pub(super) fn figure(id: &str, what: &str) -> Markup {
    html! {
        div .figure #(id) {}
        noscript { p { (what) " is drawn by the page's own script, which is switched off here; the numbers stand in the tables below." } }
    }
}

/// The program that made the page.
fn made_by() -> Markup {
    html! { p .faint { "deadtime " (env!("CARGO_PKG_VERSION")) "; curves by uPlot 1.6.32 (MIT, Leon Sorokin)." } }
}

/// Names in backquotes as code.
pub(super) fn quoted(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

pub(super) fn percent(share: Option<f64>) -> String {
    match share {
        Some(v) if v > 0.0 && v < 0.0005 => "< 0.1 %".to_owned(),
        Some(v) if v < 0.0 && v > -0.0005 => "0 %".to_owned(),
        Some(v) if v.is_finite() && (v == 0.0 || v.abs() >= 0.0995) => {
            format!("{:.0} %", 100.0 * v)
        }
        Some(v) if v.is_finite() => format!("{:.1} %", 100.0 * v),
        _ => "–".to_owned(),
    }
    .replace('-', "−")
}

/// Four significant digits.
pub(super) fn number(value: Option<f64>) -> String {
    let Some(v) = value.filter(|v| v.is_finite()) else { return "–".to_owned() };
    let text = if v == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e6).contains(&v.abs()) {
        let decimals = (3.0 - v.abs().log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{v:.decimals$}")
    } else {
        format!("{v:.3e}")
    };
    text.replace('-', "−")
}

/// The channel that a row is about, or that it is about all.
pub(super) fn named(channel: &str) -> &str {
    if channel == "*" { "all" } else { channel }
}

/// A cell of a table.
pub(super) enum Cell {
    /// Words, flush left.
    Words(String),
    /// A number, flush right.
    Number(String),
    /// Words with a mark or with code in them.
    Marked(Markup),
    /// A bar.
    Drawn(Markup),
}

/// A table whose first column heads its rows.
pub(super) fn table(caption: &str, headings: &[&str], rows: &[Vec<Cell>]) -> Markup {
    drawn(caption, headings, rows, false)
}

/// The same, and its headings sort it.
pub(super) fn sorted(caption: &str, headings: &[&str], rows: &[Vec<Cell>]) -> Markup {
    drawn(caption, headings, rows, true)
}

/// A table of the text reports, whose headings sort it.
pub(super) fn given(caption: &str, table: &Table) -> Markup {
    let (all, left) = table.parts();
    let Some((headings, rows)) = all.split_first() else { return html! {} };
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    let cell = |(at, text): (usize, &String)| {
        if left.contains(&at) { Cell::Words(text.clone()) } else { Cell::Number(text.clone()) }
    };
    let rows: Vec<Vec<Cell>> =
        rows.iter().map(|r| r.iter().enumerate().map(cell).collect()).collect();
    sorted(caption, &headings, &rows)
}

/// Characters from which a cell is a sentence: on narrow screens it is below its row.
const SENTENCE: usize = 30;

impl Cell {
    fn is_sentence(&self) -> bool {
        let length = match self {
            Self::Words(text) => text.chars().count(),
            Self::Marked(words) => words.0.chars().count(),
            Self::Number(_) | Self::Drawn(_) => 0,
        };
        length > SENTENCE
    }
}

/// A number with its interval, which may be broken between its ends.
fn is_range(text: &str) -> bool {
    [" to ", " … ", ", ", " ("].iter().any(|between| text.contains(between))
}

pub(super) fn drawn(caption: &str, headings: &[&str], rows: &[Vec<Cell>], sorts: bool) -> Markup {
    let left = |at: usize| {
        rows.first().and_then(|r| r.get(at)).is_some_and(|c| !matches!(c, Cell::Number(_)))
    };
    let bar = |at: usize| {
        rows.first().and_then(|r| r.get(at)).is_some_and(|c| matches!(c, Cell::Drawn(_)))
    };
    // A row's head and the marks of a check stay in their row.
    let marks = |at: usize| {
        rows.iter()
            .filter_map(|r| r.get(at))
            .all(|c| matches!(c, Cell::Marked(w) if w.0.starts_with("<span")))
    };
    let sentences: Vec<bool> = (0..headings.len())
        .map(|at| {
            at > 0 && !marks(at) && rows.iter().filter_map(|r| r.get(at)).any(Cell::is_sentence)
        })
        .collect();
    let sentence = |at: usize| sentences.get(at).copied().unwrap_or(false);
    let short = sentences.iter().filter(|s| !**s).count();
    html! {
        div .wide tabindex="0" role="group" aria-label=(caption) {
            table .sorts[sorts] .noted[short < headings.len()] style={ "--n:" (short) } {
                caption { (caption) }
                thead { tr { @for (at, heading) in headings.iter().enumerate() { th scope="col" .l[left(at)] .b[bar(at)] .w[sentence(at)] { (heading) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (at, cell) in row.iter().enumerate() {
                                @match (at, cell) {
                                    (0, Cell::Words(text) | Cell::Number(text)) => th scope="row" .l { (text) },
                                    (_, Cell::Words(text)) => td .l .w[sentence(at)] { (text) },
                                    (_, Cell::Number(text)) => td .r[is_range(text)] { (text) },
                                    (_, Cell::Marked(words)) => td .l .w[sentence(at)] { (words) },
                                    (_, Cell::Drawn(drawn)) => td .l.b { (drawn) },
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_name_holds_can_act_on_the_page() {
        assert_eq!(quoted("in `a<b>` and").into_string(), "in <code>a&lt;b&gt;</code> and");
        let data = serde_json::json!({ "name": "</script><script>alert(1)</script>" });
        let text = page("<title>", &html! { (quoted("<b>")) }, &data);
        assert!(
            !text.contains("alert(1)</script>")
                && !text.contains("<b>")
                && text.contains("<title>&lt;title&gt;</title>")
        );
        assert_eq!(text.matches("<script").count(), 3);
        assert!(
            text.contains("script-src &apos;sha256-") || text.contains("script-src 'sha256-"),
            "the policy"
        );
    }

    #[test]
    fn what_is_not_a_number_is_a_dash() {
        assert_eq!(
            [number(None), number(Some(f64::NAN)), percent(Some(f64::INFINITY)), percent(None)],
            ["–", "–", "–", "–"]
        );
        assert_eq!(
            [number(Some(0.161)), number(Some(-716_382.0)), number(Some(2e-7)), number(Some(0.0))],
            ["0.1610", "−716382", "2.000e−7", "0"]
        );
        assert_eq!(
            [
                percent(Some(-1e-5)),
                percent(Some(0.0123)),
                percent(Some(0.456)),
                percent(Some(-0.05))
            ],
            ["0 %", "1.2 %", "46 %", "−5.0 %"]
        );
    }
}

//! Plain-text tables and numbers for a terminal.

use std::fmt;

use super::escape::escape;
use super::styled::{cell, columns, wrapped};
use deadtime_signal::text::{markdown, shown};

/// A table with columns as wide as their widest cell; the first column is flush left, the others right.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    rows: Vec<Vec<String>>,
    left: Vec<usize>,
    /// Rows whose Markdown is meant.
    marked_up: Vec<usize>,
}

impl Table {
    /// A table with these headings; columns in `left` are flush left.
    #[must_use]
    pub fn new(headings: &[&str], left: &[usize]) -> Self {
        Self {
            rows: vec![headings.iter().map(|h| (*h).to_owned()).collect()],
            left: left.to_vec(),
            marked_up: Vec::new(),
        }
    }

    /// Rows, the headings first, and which columns are flush left.
    pub(super) fn parts(&self) -> (&[Vec<String>], &[usize]) {
        (&self.rows, &self.left)
    }

    /// Adds a row. Names in it are data: nothing in it commands a terminal or is markup.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// Adds a row of words of this program, which may hold Markdown.
    pub fn marked_up_row(&mut self, cells: Vec<String>) {
        self.marked_up.push(self.rows.len());
        self.rows.push(cells);
    }

    /// Only the columns under these headings; of words that are the same in every row of several, none.
    #[must_use]
    pub(super) fn only(&self, headings: &[&str]) -> Self {
        let Some(first) = self.rows.first() else { return self.clone() };
        let same = |c: usize| {
            self.rows.len() > 2
                && self.left.contains(&c)
                && self.rows[1..].iter().all(|r| r.get(c) == self.rows[1].get(c))
        };
        let kept: Vec<usize> = (0..first.len())
            .filter(|&c| headings.contains(&first[c].as_str()) && !same(c))
            .collect();
        let left = kept
            .iter()
            .enumerate()
            .filter(|(_, c)| self.left.contains(c))
            .map(|(at, _)| at)
            .collect();
        let row = |r: &Vec<String>| kept.iter().filter_map(|&c| r.get(c).cloned()).collect();
        Self { rows: self.rows.iter().map(row).collect(), left, marked_up: self.marked_up.clone() }
    }

    fn widths(&self) -> Vec<usize> {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        (0..columns)
            .map(|c| {
                self.rows
                    .iter()
                    .filter_map(|r| r.get(c))
                    .map(|s| s.chars().count())
                    .max()
                    .unwrap_or(0)
            })
            .collect()
    }

    /// The same table in lines of at most `width` columns. Words are wrapped inside their columns; columns without room are in further tables below, with the
    /// leading columns of words repeated.
    #[must_use]
    pub fn fit(&self, width: usize) -> String {
        let rows: Vec<Vec<String>> =
            self.rows.iter().map(|r| r.iter().map(|c| shown(c)).collect()).collect();
        let room = self.room(&rows, width);
        let lead = (0..room.len()).take_while(|c| self.left.contains(c)).count();
        let lead = lead.min(room.len().saturating_sub(1));
        let taken = |parts: &[usize]| parts.iter().map(|c| 2 + room[*c].least).sum::<usize>();
        let mut blocks: Vec<Vec<usize>> = vec![(0..lead).collect()];
        for (c, Room { least, .. }) in room.iter().enumerate().skip(lead) {
            let full = blocks.last().is_none_or(|b| b.len() > lead && taken(b) + 2 + least > width);
            if full {
                blocks.push((0..lead).collect());
            }
            if let Some(block) = blocks.last_mut() {
                block.push(c);
            }
        }
        let block = |block: &Vec<usize>| {
            let widths = widths(block, &room, width);
            rows.iter().map(|row| self.lines(row, block, &widths)).collect::<String>()
        };
        blocks.iter().map(block).collect::<Vec<_>>().join("\n")
    }

    /// The least width of every column (its numbers, and the longest word of wrapped text), and its preferred width.
    fn room(&self, rows: &[Vec<String>], width: usize) -> Vec<Room> {
        let longest = |text: &str| text.split_whitespace().map(columns).max().unwrap_or(0);
        let of = |c: usize| {
            let cells =
                || rows.iter().enumerate().filter_map(|(r, row)| Some((r, row.get(c)?.as_str())));
            let left = self.left.contains(&c);
            let least = |(r, text)| if r == 0 || left { longest(text) } else { columns(text) };
            let least = cells().map(least).max().unwrap_or(0).min(width / 2);
            let whole = cells().filter(|(r, _)| *r > 0 || left).map(|(_, text)| columns(text));
            Room { least, whole: whole.max().unwrap_or(0).max(least) }
        };
        (0..rows.iter().map(Vec::len).max().unwrap_or(0)).map(of).collect()
    }

    /// A row of a block of columns, wrapped inside them.
    fn lines(&self, row: &[String], block: &[usize], widths: &[usize]) -> String {
        let of = |(c, width): (&usize, &usize)| {
            wrapped(row.get(*c).map_or("", String::as_str), (*width).max(1), 0)
        };
        let parts: Vec<Vec<String>> = block.iter().zip(widths).map(of).collect();
        let high = parts.iter().map(Vec::len).max().unwrap_or(0);
        let line = |at: usize| {
            let cells = parts.iter().zip(block).zip(widths).map(|((lines, c), width)| {
                cell(lines.get(at).map_or("", String::as_str), *width, !self.left.contains(c))
            });
            format!("  {}", cells.collect::<Vec<_>>().join("  ")).trim_end().to_owned() + "\n"
        };
        (0..high).map(line).collect()
    }

    /// The same table in HTML, without its own style.
    #[must_use]
    pub fn html(&self) -> String {
        let mut html = "<table>".to_owned();
        for (number, row) in self.rows.iter().enumerate() {
            let tag = if number == 0 { "th" } else { "td" };
            let cell = |(column, text): (usize, &String)| {
                let side = if self.left.contains(&column) { "left" } else { "right" };
                format!("<{tag} style=\"text-align:{side}\">{}</{tag}>", escape(text))
            };
            html += &format!("<tr>{}</tr>", row.iter().enumerate().map(cell).collect::<String>());
        }
        html + "</table>"
    }

    /// The same table in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        // A cell that is code as a whole is ours.
        let is_code = |cell: &str| {
            let inside = cell.strip_prefix('`').and_then(|c| c.strip_suffix('`'));
            inside.is_some_and(|c| {
                c.chars()
                    .all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '=' | '.' | ' '))
            })
        };
        let safe = |cell: &String| if is_code(cell) { cell.clone() } else { markdown(cell) };
        let line = |(number, row): (usize, &Vec<String>)| {
            let cells: Vec<String> = if self.marked_up.contains(&number) {
                row.clone()
            } else {
                row.iter().map(safe).collect()
            };
            format!("| {} |", cells.join(" | "))
        };
        let mut lines: Vec<String> = self.rows.iter().enumerate().map(line).collect();
        let columns = self.rows.first().map_or(0, Vec::len);
        let rule: Vec<&str> =
            (0..columns).map(|c| if self.left.contains(&c) { "---" } else { "---:" }).collect();
        lines.insert(1.min(lines.len()), format!("| {} |", rule.join(" | ")));
        lines.join("\n") + "\n"
    }
}

/// Characters of a column.
struct Room {
    least: usize,
    whole: usize,
}

/// The widths of a block's columns: spare width goes to the first columns that need more.
fn widths(block: &[usize], room: &[Room], width: usize) -> Vec<usize> {
    let mut spare = width.saturating_sub(block.iter().map(|&c| 2 + room[c].least).sum::<usize>());
    let mut widths: Vec<usize> = block
        .iter()
        .map(|&c| {
            let more = (room[c].whole - room[c].least).min(spare);
            spare -= more;
            room[c].least + more
        })
        .collect();
    // Words too long even so are broken, the longest first.
    while widths.iter().map(|w| 2 + w).sum::<usize>() > width {
        let Some(widest) = widths.iter_mut().max().filter(|w| **w > 4) else { break };
        *widest -= 1;
    }
    widths
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = Self {
            rows: self.rows.iter().map(|r| r.iter().map(|c| shown(c)).collect()).collect(),
            left: Vec::new(),
            marked_up: Vec::new(),
        };
        let widths = shown.widths();
        for row in &shown.rows {
            let cells: Vec<String> = row
                .iter()
                .enumerate()
                .map(|(c, cell)| {
                    let gap = " ".repeat(widths[c] - cell.chars().count());
                    if self.left.contains(&c) {
                        format!("{cell}{gap}")
                    } else {
                        format!("{gap}{cell}")
                    }
                })
                .collect();
            writeln!(f, "  {}", cells.join("  ").trim_end())?;
        }
        Ok(())
    }
}

/// A unit behind its number; nothing where it is 1.
#[must_use]
pub(crate) fn unit(unit: &str) -> String {
    if unit.is_empty() || unit == "1" { String::new() } else { format!(" {unit}") }
}

/// Seconds with as many decimals as a resolution of `step_s` deserves.
#[must_use]
pub fn seconds(value_s: f64, step_s: f64) -> String {
    // Two digits below the step: 0.08 s shows 0.1600.
    let decimals =
        if step_s > 0.0 { (2.0 - step_s.log10().floor()).clamp(0.0, 9.0) as usize } else { 6 };
    format!("{value_s:.decimals$}")
}

/// A value and the ends of its interval, all with the same decimals. Half of the interval keeps two digits, a value without one three; powers of ten where that
/// is too many decimals.
#[must_use]
pub(super) fn estimate(value: f64, ci95: Option<[f64; 2]>) -> (String, Option<[String; 2]>) {
    let finest = ci95
        .map(|[lower, upper]| 0.5 * (upper - lower))
        .filter(|half| *half > 0.0)
        .unwrap_or(0.1 * value.abs());
    let place = |v: f64| if v > 0.0 && v.is_finite() { v.log10().floor() } else { 0.0 };
    let digits = |count: f64| count.clamp(0.0, 15.0) as usize;
    let (fixed, mantissa) =
        (digits(1.0 - place(finest)), digits(1.0 + place(value.abs()) - place(finest)));
    let text =
        |v: f64| if fixed <= 8 { format!("{v:.fixed$}") } else { format!("{v:.mantissa$e}") };
    (text(value), ci95.map(|ends| ends.map(text)))
}

/// Finest part of a sample time in the digits of a delay: an exact fit knows more only of its own model.
const FINEST: f64 = 1e-3;

/// A delay and the ends of its interval, s, with the digits that the interval allows; without an interval those that the sample time deserves.
#[must_use]
pub(super) fn delay(
    value_s: f64,
    ci95_s: Option<[f64; 2]>,
    step_s: f64,
) -> (String, Option<[String; 2]>) {
    let Some([from, to]) = ci95_s else { return (seconds(value_s, step_s), None) };
    let half = (0.5 * (to - from)).max(FINEST * step_s);
    // The digits of an interval of that width, for all three.
    let text = |v: f64| estimate(v, Some([v - half, v + half])).0;
    (text(value_s), Some([text(from), text(to)]))
}

/// The same in the columns of a table: value and interval, `–` where there is none.
#[must_use]
pub(super) fn delay_cells(
    value_s: Option<f64>,
    ci95_s: Option<[f64; 2]>,
    step_s: f64,
) -> [String; 2] {
    let (value, ends) =
        value_s.map_or_else(|| ("–".to_owned(), None), |v| delay(v, ci95_s, step_s));
    [value, ends.map_or_else(|| "–".to_owned(), |ends| ends.join(" … "))]
}

/// A standard deviation, s, with two digits; `–` where there is none.
#[must_use]
pub(super) fn deviation(std_s: Option<f64>) -> String {
    std_s.map_or_else(|| "–".to_owned(), |v| estimate(v, Some([0.0, 2.0 * v])).0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_shows_as_many_digits_as_its_interval_has() {
        let shown = |value, lower, upper| {
            let (value, ends) = estimate(value, Some([lower, upper]));
            format!("{value} ({})", ends.map(|e| e.join(" to ")).unwrap_or_default())
        };
        assert_eq!(shown(0.129_93, 0.129_61, 0.130_22), "0.12993 (0.12961 to 0.13022)");
        assert_eq!(shown(2.6445, 2.3774, 2.9116), "2.64 (2.38 to 2.91)");
        assert_eq!(shown(0.011_98, 0.011_96, 0.012_003), "0.011980 (0.011960 to 0.012003)");
        assert_eq!(shown(2.1166e-8, 2.1142e-8, 2.119e-8), "2.1166e-8 (2.1142e-8 to 2.1190e-8)");
        assert_eq!(shown(-3e-12, -5e-12, -1e-12), "-3.0e-12 (-5.0e-12 to -1.0e-12)");
        assert_eq!(shown(1234.4, 1200.0, 1270.0), "1234 (1200 to 1270)");
        assert_eq!(
            [estimate(0.5, None).0, estimate(2e-10, None).0, estimate(0.0, None).0],
            ["0.500", "2.00e-10", "0.0"]
        );
    }

    #[test]
    fn cells_neither_command_nor_mark_up() {
        let mut table = Table::new(&["name"], &[0]);
        table.row(vec!["a|b <script> `x`\u{1b}[2J\n# c".into()]);
        table.row(vec!["long ".repeat(60)]);
        let text = table.to_string();
        assert!(text.contains("`x`\\u{1b}[2J\\n# c\n") && text.contains("long …"), "{text}");
        assert!(
            text.lines().count() == 3 && text.lines().all(|l| l.chars().count() < 210),
            "{text}"
        );
        assert!(
            table.markdown().contains("| a\\|b \\<script> \\`x\\`\\\\u{1b}[2J\\\\n# c |"),
            "{}",
            table.markdown()
        );
    }

    #[test]
    fn a_delay_shows_the_digits_of_its_interval_to_a_thousandth_of_a_sample_at_most() {
        assert_eq!(
            delay_cells(Some(0.145), Some([0.0, 0.203]), 0.1),
            ["0.14", "0.00 … 0.20"].map(str::to_owned)
        );
        assert_eq!(
            delay_cells(Some(0.6178), Some([0.6152, 0.6203]), 0.1),
            ["0.6178", "0.6152 … 0.6203"].map(str::to_owned)
        );
        assert_eq!(
            delay_cells(Some(0.3), Some([0.3, 0.3]), 0.1),
            ["0.300000", "0.300000 … 0.300000"].map(str::to_owned)
        );
        assert_eq!(delay_cells(Some(0.3), None, 0.1), ["0.300", "–"].map(str::to_owned));
        assert_eq!(delay_cells(None, None, 0.1), ["–", "–"].map(str::to_owned));
        assert_eq!(
            [deviation(Some(0.012_96)), deviation(Some(1.01)), deviation(None)],
            ["0.013", "1.0", "–"].map(str::to_owned)
        );
    }

    #[test]
    fn a_table_keeps_to_a_width_and_loses_nothing() {
        let mut table = Table::new(
            &["grid", "method", "RMS error (samples)", "truth in interval", "a", "b"],
            &[0, 1],
        );
        table.row(
            [
                "first order",
                "oestruc nf=3 of many words",
                "0.123",
                "95.0 %",
                "1234567.0",
                "7654321.0",
            ]
            .map(str::to_owned)
            .to_vec(),
        );
        for width in [30, 40, 60, 120] {
            let text = table.fit(width);
            assert!(text.lines().all(|l| columns(l) <= width), "{width}:\n{text}");
            for part in ["0.123", "95.0 %", "1234567.0", "7654321.0", "nf=3", "interval"] {
                assert!(text.contains(part), "{part}, {width}:\n{text}");
            }
        }
        assert_eq!(
            table.fit(120).lines().next().map(|l| l.trim_end().ends_with("a          b")),
            Some(true),
            "{}",
            table.fit(120)
        );
        assert_eq!(Table::new(&[], &[]).fit(80), "");
    }

    #[test]
    fn columns_line_up_and_markdown_has_a_rule() {
        let mut table = Table::new(&["method", "delay"], &[0]);
        table.row(vec!["oestruc".into(), "0.16".into()]);
        table.row(vec!["a".into(), "10.16".into()]);
        assert_eq!(table.to_string(), "  method   delay\n  oestruc   0.16\n  a        10.16\n");
        assert_eq!(
            table.markdown(),
            "| method | delay |\n| --- | ---: |\n| oestruc | 0.16 |\n| a | 10.16 |\n"
        );
        assert!(table.html().contains("<td style=\"text-align:right\">10.16</td>"));
    }

    #[test]
    fn seconds_show_two_digits_below_the_sample_time() {
        assert_eq!(seconds(0.16, 0.08), "0.1600");
        assert_eq!(seconds(14.0, 1.0), "14.00");
        assert_eq!(seconds(0.000_110_7, 2.083e-5), "0.0001107");
    }
}

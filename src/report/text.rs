//! Plain-text tables and numbers for a terminal.

use std::fmt;

use super::html::escape;

/// A table with columns as wide as their widest cell; the first column is flush left, the others right.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    rows: Vec<Vec<String>>,
    left: Vec<usize>,
}

impl Table {
    /// A table with these headings; columns in `left` are flush left.
    #[must_use]
    pub fn new(headings: &[&str], left: &[usize]) -> Self {
        Self { rows: vec![headings.iter().map(|h| (*h).to_owned()).collect()], left: left.to_vec() }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    fn widths(&self) -> Vec<usize> {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        (0..columns).map(|c| self.rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0)).collect()
    }

    /// The same table in HTML, without style of its own.
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
        let mut lines: Vec<String> = self.rows.iter().map(|r| format!("| {} |", r.join(" | "))).collect();
        let columns = self.rows.first().map_or(0, Vec::len);
        let rule: Vec<&str> = (0..columns).map(|c| if self.left.contains(&c) { "---" } else { "---:" }).collect();
        lines.insert(1.min(lines.len()), format!("| {} |", rule.join(" | ")));
        lines.join("\n") + "\n"
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widths = self.widths();
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .enumerate()
                .map(|(c, cell)| {
                    let gap = " ".repeat(widths[c] - cell.chars().count());
                    if self.left.contains(&c) { format!("{cell}{gap}") } else { format!("{gap}{cell}") }
                })
                .collect();
            writeln!(f, "  {}", cells.join("  ").trim_end())?;
        }
        Ok(())
    }
}

/// Seconds with as many decimals as a resolution of `step_s` deserves.
#[must_use]
pub fn seconds(value_s: f64, step_s: f64) -> String {
    // Two digits below the step: 0.08 s shows 0.1600.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let decimals = if step_s > 0.0 { (2.0 - step_s.log10().floor()).clamp(0.0, 9.0) as usize } else { 6 };
    format!("{value_s:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_and_markdown_has_a_rule() {
        let mut table = Table::new(&["method", "delay"], &[0]);
        table.row(vec!["oestruc".into(), "0.16".into()]);
        table.row(vec!["a".into(), "10.16".into()]);
        assert_eq!(table.to_string(), "  method   delay\n  oestruc   0.16\n  a        10.16\n");
        assert_eq!(table.markdown(), "| method | delay |\n| --- | ---: |\n| oestruc | 0.16 |\n| a | 10.16 |\n");
        assert!(table.html().contains("<td style=\"text-align:right\">10.16</td>"));
    }

    #[test]
    fn seconds_show_two_digits_below_the_sample_time() {
        assert_eq!(seconds(0.16, 0.08), "0.1600");
        assert_eq!(seconds(14.0, 1.0), "14.00");
        assert_eq!(seconds(0.000_110_7, 2.083e-5), "0.0001107");
    }
}

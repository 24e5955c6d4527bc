//! Tables of accuracy studies.

use super::Table;
use crate::study::Cell;

/// One row per method and delay.
#[must_use]
pub fn table(cells: &[Cell]) -> Table {
    let headings = ["method", "injected (s)", "records", "no answer", "bias (samples)", "RMS error (samples)", "truth in 95 % interval"];
    let mut table = Table::new(&headings, &[0]);
    let number = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| format!("{v:.2}"));
    for c in cells {
        table.row(vec![
            c.method.clone(),
            format!("{:.3}", c.delay_s),
            c.trials.to_string(),
            c.flagged.to_string(),
            number(c.bias_samples),
            number(c.rms_samples),
            c.coverage95.map_or_else(|| "–".to_owned(), |v| format!("{:.0} %", 100.0 * v)),
        ]);
    }
    table
}

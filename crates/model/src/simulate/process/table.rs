//! The tables sent to and received from a program: CSV with a header, time first.

use std::fmt::Write;

use nalgebra::DMatrix;

use super::program::{Asked, Names};

/// The request: a column of time and one per input.
pub(super) fn written(asked: Asked<'_>, names: &Names) -> String {
    let mut text = String::with_capacity(16 * (asked.u.len() + asked.time_s.len()));
    text.push_str("time");
    for name in &names.inputs {
        text.push(',');
        text.push_str(&quoted(name));
    }
    text.push('\n');
    for (k, time) in asked.time_s.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(text, "{time}");
        for j in 0..asked.u.ncols() {
            let _ = write!(text, ",{}", asked.u[(k, j)]);
        }
        text.push('\n');
    }
    text
}

/// A name in CSV quoting.
pub(super) fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

/// Bytes allowed for banners and comments.
const BANNERS: usize = 16 << 20;
/// Bytes of a number, and columns in addition to the requested ones.
const WIDE: (usize, usize) = (32, 8);

/// The longest accepted output, bytes.
pub(super) fn most(names: &Names, samples: usize) -> usize {
    let row = line(names);
    BANNERS.saturating_add(samples.saturating_mul(row))
}

/// The longest line of an output, bytes, without banners.
pub(super) fn line(names: &Names) -> usize {
    WIDE.0 * (names.outputs.len() + WIDE.1)
}

/// The column indices of the outputs in a header.
///
/// # Errors
/// As a phrase: the missing column, and the present ones.
pub(super) fn columns(header: &[String], names: &Names) -> Result<Vec<usize>, String> {
    // `speed [rad/s]` is the column speed.
    let bare = |text: &str| {
        text.trim()
            .trim_start_matches('\u{feff}')
            .split(" [")
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned()
    };
    let there: Vec<String> = header.iter().map(|h| bare(h)).collect();
    let find = |name: &String| {
        there.iter().position(|t| t == name).ok_or_else(|| {
            let shown = there.iter().map(|t| deadtime_signal::text::shown(t)).collect::<Vec<_>>().join(", ");
            format!("its answer has no column `{name}`; the first line of the answer is the header, here: {shown}")
        })
    };
    names.outputs.iter().map(find).collect()
}

/// One row's outputs.
///
/// # Errors
/// As a phrase: the row, the column and its text.
pub(super) fn row(
    fields: &[&str],
    columns: &[usize],
    names: &Names,
    number: usize,
) -> Result<Vec<f64>, String> {
    let one = |(&at, name): (&usize, &String)| {
        let text = fields.get(at).map(|f| f.trim()).unwrap_or_default();
        text.parse::<f64>().map_err(|_| {
            format!(
                "row {number} of its answer, column `{name}`: `{}` is no number",
                deadtime_signal::text::shown(text)
            )
        })
    };
    columns.iter().zip(&names.outputs).map(one).collect()
}

/// The output of a program that has ended.
///
/// # Errors
/// As a phrase.
pub(super) fn read(text: &str, names: &Names, samples: usize) -> Result<DMatrix<f64>, String> {
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).comment(Some(b'#')).from_reader(text.as_bytes());
    let header: Vec<String> = reader
        .headers()
        .map_err(|e| format!("its answer is no CSV: {e}"))?
        .iter()
        .map(str::to_owned)
        .collect();
    if header.is_empty() {
        return Err(
            "it answered nothing; a header and a row for every sample are needed".to_owned()
        );
    }
    let columns = columns(&header, names)?;
    let mut values = Vec::with_capacity(samples * columns.len());
    let mut rows = 0;
    for record in reader.records() {
        let record = record.map_err(|e| format!("its answer is no CSV: {e}"))?;
        rows += 1;
        values.extend(row(&record.iter().collect::<Vec<_>>(), &columns, names, rows)?);
    }
    if rows != samples {
        return Err(format!(
            "it answered {rows} rows of numbers where {samples} are needed, one for every row that it got"
        ));
    }
    Ok(DMatrix::from_row_slice(samples, columns.len(), &values))
}

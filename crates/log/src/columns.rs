//! Logs out of tables of typed columns, as Parquet and Arrow files hold them.

use super::error::{Error, LogError};
use super::numbers::Numbers;
use super::options::{ReadOptions, TimeUnit};
use super::recording::{Recording, Table};
use crate::csv::clock::seconds;
use crate::csv::time_name::named_time;
use crate::notes::Notes;
use deadtime_signal::remedy::{Message, Remedy};

/// One column of a table while it is read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) cells: Cells,
}

/// The content of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cells {
    /// Numbers; NaN where none is.
    Numbers(Vec<f64>),
    /// Whole numbers, exactly, with their unit where they are stamps of time.
    Whole(Vec<Option<i64>>, Option<TimeUnit>),
    /// Text, which may be dates.
    Text(Vec<Option<String>>),
}

impl Cells {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Whole(values, _) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    /// Bytes of a row; the referenced text is counted separately.
    pub(super) fn cost(&self) -> u64 {
        let bytes = match self {
            Self::Numbers(_) => size_of::<f64>(),
            Self::Whole(..) => size_of::<Option<i64>>(),
            Self::Text(_) => size_of::<Option<String>>(),
        };
        bytes as u64
    }

    /// Puts rows without a value before row `at`.
    pub(super) fn insert_missing(&mut self, at: usize, rows: usize) {
        fn insert<V: Clone>(values: &mut Vec<V>, at: usize, rows: usize, none: V) {
            let at = at.min(values.len());
            values.splice(at..at, std::iter::repeat_n(none, rows));
        }
        match self {
            Self::Numbers(values) => insert(values, at, rows, f64::NAN),
            Self::Whole(values, _) => insert(values, at, rows, None),
            Self::Text(values) => insert(values, at, rows, None),
        }
    }

    /// As numbers; NaN where none is.
    fn into_numbers(self) -> Vec<f64> {
        match self {
            Self::Numbers(values) => values,
            Self::Whole(values, _) => {
                values.into_iter().map(|v| v.map_or(f64::NAN, |v| v as f64)).collect()
            }
            Self::Text(_) => Vec::new(),
        }
    }

    /// As a text file would have it, so that stamps are understood alike in all formats.
    fn text(&self, row: usize) -> String {
        match self {
            Self::Numbers(values) => values.get(row).filter(|v| !v.is_nan()).map(|v| v.to_string()),
            Self::Whole(values, _) => values.get(row).copied().flatten().map(|v| v.to_string()),
            Self::Text(values) => values.get(row).cloned().flatten(),
        }
        .unwrap_or_default()
    }

    pub(super) fn unit(&self) -> Option<TimeUnit> {
        if let Self::Whole(_, unit) = self { *unit } else { None }
    }
}

/// The column of time among columns with their names, and whether their type is that of stamps. It is found by the caller's word, by its name, or by its type.
pub(super) fn time_among<'a>(
    columns: impl Iterator<Item = (&'a str, bool)> + Clone,
    options: &ReadOptions,
) -> Option<usize> {
    let place = |test: &dyn Fn(&str, bool) -> bool| {
        columns.clone().position(|(name, stamps)| test(name, stamps))
    };
    match &options.time {
        Some(wanted) => place(&|name, _| name == *wanted),
        None => place(&|name, _| name == "time")
            .or_else(|| place(&|name, _| named_time(name).is_some()))
            .or_else(|| place(&|_, stamps| stamps))
            .or_else(|| place(&|name, _| name == "t")),
    }
}

/// The recording of a table. Its column of time is found by the caller's word, by its name, or by its type; every other column of numbers is a channel.
pub(super) fn assemble(
    source: &str,
    format: &'static str,
    title: &'static str,
    columns: Vec<Column>,
    mut notes: Notes,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let kinds = columns.iter().map(|c| (c.name.as_str(), c.cells.unit().is_some()));
    let time = time_among(kinds, options);
    let Some((time, clock)) = time.and_then(|at| Some((at, columns.get(at)?))) else {
        let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
        let missing = format!(
            "no column of time was found among {}: call one `time`, or name it with ",
            names.join(", ")
        );
        notes.push(Message::from(missing).and(Remedy::TimeColumn));
        return Err(LogError::NoTopics { file: source.into(), format: title, notes }.into());
    };
    let known =
        options.time_unit.or(clock.cells.unit()).or_else(|| named_time(&clock.name).flatten());
    let times =
        seconds((0..clock.cells.len()).map(|row| clock.cells.text(row)), known, &clock.name);
    if clock.name != "time" || times.unit != TimeUnit::S || !times.note.is_empty() {
        notes.push(
            Message::from(format!("time is `{}`, in {}", clock.name, times.unit.words()))
                .and(times.note.clone()),
        );
    }
    let mut table = Table::new("");
    table.rows(|stamps| stamps.extend(&times.time_s));
    let rows = table.len();
    for (_, column) in columns.into_iter().enumerate().filter(|(at, _)| *at != time) {
        if let Cells::Text(_) = column.cells {
            notes.push(format!("{}: text; left out", column.name));
            continue;
        }
        let (name, unit) = crate::header::name_and_unit(&column.name);
        let place = table.column(name, unit);
        let mut values = column.cells.into_numbers();
        values.resize(rows, f64::NAN);
        table.extend(place, |numbers| *numbers = Numbers::F64(values));
    }
    let topics = table.finish(source, &mut notes)?.into_iter().collect();
    Recording::of_topics(source, (format, title), topics, notes)
}

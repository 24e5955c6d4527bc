//! Logs out of tables of typed columns, as Parquet and Arrow files hold them.

use super::error::{Error, LogError};
use super::recording::{ReadOptions, Recording, Table, TimeUnit};
use crate::csv::clock::{named_time, seconds};
use crate::notes::Notes;
use deadtime_signal::remedy::{Message, Remedy};

/// What a reader of another crate found, or that it gave up in the middle: some stop the program where parts of a damaged file lie outside of it.
pub(super) fn guarded<T>(
    source: &str,
    format: &'static str,
    read: impl FnOnce() -> Result<T, Error>,
) -> Result<T, Error> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let what = "damaged: its parts do not fit together; write it again";
        Err(LogError::format(source, format, what).into())
    })
}

/// One column of a table while it is read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) cells: Cells,
}

/// What stands in a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cells {
    /// Numbers, and nothing where none is.
    Numbers(Vec<Option<f64>>),
    /// Whole numbers, exactly, with their unit where they are stamps of time.
    Whole(Vec<Option<i64>>, Option<TimeUnit>),
    /// Text, which may be dates.
    Text(Vec<Option<String>>),
}

impl Cells {
    fn number(&self, row: usize) -> Option<f64> {
        match self {
            Self::Numbers(values) => *values.get(row)?,
            Self::Whole(values, _) => values.get(row)?.map(|v| v as f64),
            Self::Text(_) => None,
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Whole(values, _) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    /// As a text file would have it, so that stamps are understood alike in all formats.
    fn text(&self, row: usize) -> String {
        match self {
            Self::Numbers(values) => values.get(row).copied().flatten().map(|v| v.to_string()),
            Self::Whole(values, _) => values.get(row).copied().flatten().map(|v| v.to_string()),
            Self::Text(values) => values.get(row).cloned().flatten(),
        }
        .unwrap_or_default()
    }

    fn unit(&self) -> Option<TimeUnit> {
        if let Self::Whole(_, unit) = self { *unit } else { None }
    }
}

/// The recording of a table: its column of time by the caller's word, by its name, or by its type; every other column of numbers is a channel.
pub(super) fn assemble(
    source: &str,
    format: &'static str,
    title: &'static str,
    columns: Vec<Column>,
    mut notes: Notes,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let place = |test: &dyn Fn(&Column) -> bool| columns.iter().position(test);
    let time = match &options.time {
        Some(wanted) => place(&|c| c.name == *wanted),
        None => place(&|c| c.name == "time")
            .or_else(|| place(&|c| named_time(&c.name).is_some()))
            .or_else(|| place(&|c| c.cells.unit().is_some()))
            .or_else(|| place(&|c| c.name == "t")),
    };
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
    let times = seconds(
        (0..clock.cells.len()).map(|row| clock.cells.text(row)),
        known,
        clock.name == "time",
    );
    if clock.name != "time" || times.unit != TimeUnit::S || !times.told.is_empty() {
        notes.push(
            Message::from(format!("time is `{}`, in {}", clock.name, times.unit.words()))
                .and(times.told.clone()),
        );
    }
    let mut table = Table::new("");
    let mut channels = Vec::new();
    for (_, column) in columns.iter().enumerate().filter(|(at, _)| *at != time) {
        if let Cells::Text(_) = column.cells {
            notes.push(format!("{}: text; left out", column.name));
        } else {
            let (name, unit) = crate::header::name_and_unit(&column.name);
            channels.push((table.column(name, unit), &column.cells));
        }
    }
    for (row, stamp) in times.time_s.iter().enumerate() {
        table.row(*stamp);
        for (place, cells) in &channels {
            if let Some(value) = cells.number(row) {
                table.set(*place, value);
            }
        }
    }
    let topics = table.finish(source, &mut notes)?.into_iter().collect();
    Recording::of_topics(source, (format, title), topics, notes)
}

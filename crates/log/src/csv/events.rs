//! Columns of event times.

use super::cell::parse;
use super::lines::Lines;
use super::table::open;
use crate::error::{Error, LogError};
use crate::header::name_and_unit;
use deadtime_signal::progress::HowFar;
use std::io::Read;
use std::path::Path;

/// A column of event times.
#[derive(Debug, Clone, PartialEq)]
pub struct EventTimes {
    /// Its name.
    pub name: String,
    /// Its unit, where the header gives one.
    pub unit: Option<String>,
    /// The times, increasing; with `in_rows` in the order of their rows.
    pub times: Vec<f64>,
    /// Every row of the file has one event at both places: the times of both columns belong together, and those of the second place may not increase.
    pub in_rows: bool,
}

/// Reads two columns of event times from a `.csv` or `.csv.gz` file: a header row, and in each column one time per event. A `time` column is not needed. The
/// columns may hold different numbers of events: empty cells are ignored. Where every row has both events, the second one's times need not increase.
///
/// # Errors
/// As [`crate::reader::read`]; [`LogError::EventOrder`] where times do not increase, [`LogError::MissingThroughout`] for a column without events.
pub fn read_events(path: &Path, columns: [&str; 2]) -> Result<[EventTimes; 2], Error> {
    read_events_from(&path.display().to_string(), open(path, &HowFar::default())?, columns)
}

/// Reads two columns of event times from any source of bytes, as [`read_events`] does.
///
/// # Errors
/// As [`read_events`].
pub fn read_events_from(
    source: &str,
    bytes: impl Read,
    columns: [&str; 2],
) -> Result<[EventTimes; 2], Error> {
    let file = || source.to_owned();
    let mut lines = Lines::new(source, bytes)?;
    if !lines.header()? {
        return Err(LogError::Empty { file: file() }.into());
    }
    let cells = lines.len();
    let text =
        |place| std::str::from_utf8(lines.cell(place)).map(|cell| name_and_unit(cell).0.to_owned());
    let names: Vec<String> =
        (0..cells).map(text).collect::<Result<_, _>>().map_err(|_| lines.not_text())?;
    let mut found = Vec::with_capacity(2);
    for column in columns {
        let place = only(&names, source, column)?;
        let unit = std::str::from_utf8(lines.cell(place))
            .ok()
            .and_then(|cell| name_and_unit(cell).1)
            .map(ToOwned::to_owned);
        found.push((
            place,
            EventTimes { name: column.into(), unit, times: Vec::new(), in_rows: false },
        ));
    }
    let (mut in_rows, mut overtaking) = (true, None);
    while lines.next()? {
        lines.must_have(cells)?;
        let mut events_of_row = 0;
        for (which, (place, events)) in found.iter_mut().enumerate() {
            let (cell, row, channel) = (lines.cell(*place), lines.row, events.name.clone());
            let found = parse(cell, lines.separator.allows_decimal_comma());
            let Some(time) = found.number(&file(), row, &channel, cell)? else { continue };
            if let Some(&before) = events.times.last().filter(|before| **before >= time) {
                let wrong = LogError::EventOrder { file: file(), row, channel, before, time };
                if which == 0 {
                    return Err(wrong.into());
                }
                overtaking.get_or_insert(wrong);
            }
            events.times.push(time);
            events_of_row += 1;
        }
        in_rows &= events_of_row != 1;
    }
    // Where a row has one event alone, the columns are sequences of their own.
    if let Some(wrong) = overtaking.filter(|_| !in_rows) {
        return Err(wrong.into());
    }
    found.iter_mut().for_each(|(_, events)| events.in_rows = in_rows);
    if let Some((_, empty)) = found.iter().find(|(_, events)| events.times.is_empty()) {
        return Err(
            LogError::MissingThroughout { file: file(), channel: empty.name.clone() }.into()
        );
    }
    let mut columns = found.into_iter().map(|(_, events)| events);
    match (columns.next(), columns.next()) {
        (Some(first), Some(second)) => Ok([first, second]),
        _ => Err(LogError::NoSamples { file: file() }.into()),
    }
}

/// The place of the one column of this name.
fn only(names: &[String], file: &str, column: &str) -> Result<usize, LogError> {
    let mut places = (0..names.len()).filter(|&i| names.get(i).is_some_and(|name| name == column));
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(place),
        (Some(_), Some(_)) => {
            Err(LogError::DuplicateChannel { file: file.to_owned(), channel: column.to_owned() })
        }
        (None, _) => Err(LogError::unknown_channel(file, column, names.iter().map(String::as_str))),
    }
}

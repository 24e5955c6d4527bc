//! Tables of text.

use super::clock::{self, StampReader, Why, median_step, shortest};
use super::lines::{GZIP_MAGIC, Lines, Separator, first_bytes};
use super::number::decimal;
use crate::budget::Budget;
use crate::counted::Counted;
use crate::error::{Error, LogError};
use crate::header::name_and_unit;
use crate::log::{Channel, Log, Origin, Rows, Unusable, time_follows};
use crate::notes::Notes;
use crate::place::Place;
use crate::recording::{ReadOptions, Recording, TimeUnit};
use crate::sentinel;
use deadtime_signal::file::write_atomic;
use deadtime_signal::progress::HowFar;
use deadtime_signal::remedy::{Message, Remedy};
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::path::Path;

/// As much of an offending cell as a message shows, in characters.
pub(super) const SHOWN: usize = 40;

/// Numbers that are read into memory, of all columns together: 3.2 GB.
pub(super) const MOST_NUMBERS: usize = 400_000_000;

/// Cells that say that a sample is missing, besides empty ones and those that are read as NaN; lower case.
pub(super) const NOTHING: [&[u8]; 7] = [b"-", b"--", b"na", b"n/a", b"#n/a", b"null", b"none"];

/// Reads a file of several records: a new one begins wherever the cell of `column` (numbers or text) differs from the row before, and time
/// may start afresh in it. They are called `FILE#VALUE`; a value that comes back later begins another record of the same name.
///
/// # Errors
/// As [`crate::reader::read`]; [`LogError::UnknownChannel`] when there is no such column, [`LogError::EmptyRecord`].
pub fn read_records(path: &Path, column: &str) -> Result<Vec<Log>, Error> {
    records(path, column, &ReadOptions::default()).map(|(logs, _)| logs)
}

/// A column of event times.
#[derive(Debug, Clone, PartialEq)]
pub struct EventTimes {
    /// Its name.
    pub name: String,
    /// Its unit, where the header gives one.
    pub unit: Option<String>,
    /// The times, increasing.
    pub times: Vec<f64>,
}

/// Reads two columns of event times from a `.csv` or `.csv.gz` file: a header row, and in each column one time per event; there need be no `time` column. The columns may
/// hold different numbers of events: empty cells are passed over.
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
        found.push((place, EventTimes { name: column.into(), unit, times: Vec::new() }));
    }
    while lines.next()? {
        lines.must_have(cells)?;
        for (place, events) in &mut found {
            let (cell, row, channel) = (lines.cell(*place), lines.row, events.name.clone());
            let found = parse(cell, lines.separator.allows_decimal_comma());
            let Some(time) = found.number(&file(), row, &channel, cell)? else { continue };
            if let Some(&before) = events.times.last().filter(|before| **before >= time) {
                return Err(
                    LogError::EventOrder { file: file(), row, channel, before, time }.into()
                );
            }
            events.times.push(time);
        }
    }
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

/// Reads one log from any source of bytes, gzip or plain; `source` names it in errors and results.
///
/// # Errors
/// As [`crate::reader::read`].
pub fn read_from(source: &str, bytes: impl Read) -> Result<Log, Error> {
    Ok(recording_from(source, bytes, &ReadOptions::default())?.into_log()?)
}

/// Reads a file as a recording without topics, whose notes say what was guessed.
pub(crate) fn recording(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    recording_from(&source, open(path, &options.far)?, &within(path, options))
}

/// Memory by the size of the file, unless the caller gives a limit: text may be packed.
fn within(path: &Path, options: &ReadOptions) -> ReadOptions {
    let length = std::fs::metadata(path).map_or(u64::MAX, |there| there.len());
    ReadOptions { memory: Some(Budget::of(length, options).limit()), ..options.clone() }
}

/// Reads any source of bytes as a recording without topics.
///
/// # Errors
/// As [`crate::reader::read`].
pub fn recording_from(
    source: &str,
    bytes: impl Read,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut lines = Lines::to_break(source, bytes)?;
    let mut header = Header::read(&mut lines, options)?;
    let mut part = PartialLog::new(source.into(), &header, options.memory);
    while lines.next()? {
        match part.cut_off(&lines, &header) {
            None => part.push(&lines, &mut header)?,
            Some(why) => header.left_out(&lines, &why),
        }
    }
    header.notes.extend(lines.how_it_ends());
    if part.raw.is_empty() {
        return Err(lines.nothing(LogError::NoSamples { file: source.into() }).into());
    }
    let log = part.finish(&mut header)?;
    Ok(Recording::single("csv", log, header.notes))
}

/// Reads several records from any source of bytes, as [`read_records`] does.
///
/// # Errors
/// As [`read_records`].
pub fn read_records_from(source: &str, bytes: impl Read, column: &str) -> Result<Vec<Log>, Error> {
    records_from(source, bytes, column, &ReadOptions::default()).map(|(logs, _)| logs)
}

/// The records of a file, as [`read_records`] reads them, and what was guessed, a sentence each.
///
/// # Errors
/// As [`read_records`].
pub fn records(
    path: &Path,
    column: &str,
    options: &ReadOptions,
) -> Result<(Vec<Log>, Notes), Error> {
    let source = path.display().to_string();
    let read = open(path, &options.far)?;
    let (mut logs, mut notes) = records_from(&source, read, column, &within(path, options))?;
    logs.iter_mut().for_each(|log| sentinel::missing(log, &options.missing, &mut notes));
    Ok((logs, notes))
}

pub(super) fn records_from(
    source: &str,
    bytes: impl Read,
    column: &str,
    options: &ReadOptions,
) -> Result<(Vec<Log>, Notes), Error> {
    let mut lines = Lines::to_break(source, bytes)?;
    let mut header = Header::read(&mut lines, options)?;
    let place = header.place(source, column)?;
    let mut logs = Vec::new();
    let mut current: Option<(Vec<u8>, PartialLog)> = None;
    while lines.next()? {
        // A row that is whole may begin another record.
        if let Some((name, part)) = &current
            && (lines.cut_off()
                || lines.len() < header.cells
                || name.as_slice() == lines.cell(place))
            && let Some(why) = part.cut_off(&lines, &header)
        {
            header.left_out(&lines, &why);
            continue;
        }
        header.check_length(&lines)?;
        let value = lines.cell(place);
        if value.is_empty() {
            return Err(LogError::EmptyRecord {
                file: source.into(),
                row: lines.row,
                channel: column.into(),
            }
            .into());
        }
        let part = match &mut current {
            Some((name, part)) if name.as_slice() == value => part,
            _ => {
                let fresh = PartialLog::new(
                    format!("{source}#{}", String::from_utf8_lossy(value)),
                    &header,
                    options.memory,
                );
                if let Some((_, done)) = current.take() {
                    logs.push(done.finish(&mut header)?);
                }
                &mut current.insert((value.to_vec(), fresh)).1
            }
        };
        part.push(&lines, &mut header)?;
    }
    header.notes.extend(lines.how_it_ends());
    match current {
        Some((_, last)) => logs.push(last.finish(&mut header)?),
        None => return Err(lines.nothing(LogError::NoSamples { file: source.into() }).into()),
    }
    Ok((logs, header.notes))
}

impl Log {
    /// Writes the log as a CSV file, compressed when the name ends in `.gz`: units in the header, missing samples as empty cells,
    /// each number in the fewest digits that read back to the same bits. Columns without numbers are left out.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); an earlier file of that name is then untouched.
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        let written = write_atomic(path, |file| {
            if is_gz(path) {
                let mut encoder =
                    flate2::write::GzEncoder::new(file, flate2::Compression::default());
                self.write_rows(&mut encoder)?;
                encoder.finish().map(|_| ())
            } else {
                self.write_rows(file)
            }
        });
        Ok(written?)
    }

    fn write_rows(&self, mut out: &mut dyn Write) -> std::io::Result<()> {
        let mut header = ::csv::Writer::from_writer(&mut out);
        header.write_record(
            std::iter::once("time".to_owned()).chain(self.channels.iter().map(Channel::header)),
        )?;
        header.flush()?;
        drop(header);
        let mut line = String::new();
        for (i, time_s) in self.time_s.iter().enumerate() {
            line.clear();
            push_number(&mut line, *time_s);
            for channel in &self.channels {
                line.push(',');
                if let Some(value) = channel.samples().get(i) {
                    push_number(&mut line, value);
                }
            }
            line.push('\n');
            out.write_all(line.as_bytes())?;
        }
        Ok(())
    }
}

/// The shortest digits that read back to the same bits, with an exponent where zeros would fill the cell.
pub(super) fn push_number(line: &mut String, x: f64) {
    // Writing to a `String` cannot fail.
    let _ = if x == 0.0 || (1e-5..1e16).contains(&x.abs()) {
        write!(line, "{x}")
    } else {
        write!(line, "{x:e}")
    };
}

pub(super) fn is_gz(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz"))
}

/// Opens a file; one that is called .gz must be one.
pub(super) fn open(path: &Path, far: &HowFar) -> Result<impl Read, Error> {
    let io = |e| Error::io(path, e);
    let mut file = Counted::open(path, far).map_err(io)?;
    let head = first_bytes(&mut file).map_err(io)?;
    if is_gz(path) && !head.is_empty() && head != GZIP_MAGIC {
        return Err(LogError::NotGzip { file: path.display().to_string() }.into());
    }
    Ok(std::io::Cursor::new(head).chain(file))
}

/// Cell, name and unit of each channel.
type Columns = Vec<(usize, String, Option<String>)>;

/// The header row: where the time stands, and the channels.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) separator: Separator,
    /// Whether a comma within a cell is a decimal comma.
    decimal_comma: bool,
    time: usize,
    /// The column of the date, where the time is one of day.
    date: Option<usize>,
    /// Rows that were written twice.
    twice: usize,
    pub(super) clock: Clock,
    columns: Columns,
    cells: usize,
    /// Its line, where a separator stands behind its last name.
    trailing: Option<usize>,
    pub(super) notes: Notes,
}

/// What is known of the time before its stamps are read.
#[derive(Debug)]
pub(super) struct Clock {
    pub(super) column: String,
    unit: Option<(TimeUnit, Why)>,
}

/// Name and unit of each cell of a header.
pub(super) type Names = Vec<(String, Option<String>)>;

/// The cells of the current line as names and units; in Latin-1 where they are no UTF-8, which is said.
pub(super) fn names(lines: &Lines<'_>, notes: &mut Notes) -> Result<Names, LogError> {
    let mut names = Vec::with_capacity(lines.len());
    for place in 0..lines.len() {
        let cell = lines.cell(place);
        let text = match std::str::from_utf8(cell) {
            Ok(text) => text.to_owned(),
            // What are signs there and in the code pages of Western Europe; the rest are control characters in one of them.
            Err(_) if cell.iter().all(|byte| byte.is_ascii() || *byte >= 0xa0) => {
                let note = format!("row {} is no UTF-8: its names are read as Latin-1", lines.row);
                notes.push_once(note);
                cell.iter().map(|byte| char::from(*byte)).collect()
            }
            Err(_) => return Err(lines.not_text()),
        };
        if text.chars().any(|c| c.is_control() && c != '\t') {
            return Err(lines.not_text());
        }
        let (name, unit) = name_and_unit(&text);
        names.push((name.to_owned(), unit.map(ToOwned::to_owned)));
    }
    Ok(names)
}

/// Takes the units of a row below the header that holds nothing else: the time's is one, and no cell is a number but 1, which stands for none. Whether it was such a row.
pub(super) fn take_units(names: &mut Names, time: usize, below: &[Vec<u8>]) -> bool {
    let bare = |cell: &[u8]| {
        let text: String = match std::str::from_utf8(cell) {
            Ok(text) => text.trim().to_owned(),
            Err(_) => cell.iter().map(|byte| char::from(*byte)).collect(),
        };
        let inner = [('[', ']'), ('(', ')')]
            .iter()
            .find_map(|(open, close)| text.strip_prefix(*open)?.strip_suffix(*close));
        inner.map_or_else(|| text.clone(), |inner| inner.trim().to_owned())
    };
    let of_unit = |cell: &Vec<u8>| {
        matches!(parse(cell, true), Cell::Text | Cell::Missing) || bare(cell) == "1"
    };
    let timed = below.get(time).is_some_and(|cell| clock::unit(&bare(cell)).is_some());
    if !timed || below.len() < names.len() || !below.iter().all(of_unit) {
        return false;
    }
    for ((_, unit), cell) in names.iter_mut().zip(below) {
        let text = bare(cell);
        if unit.is_none() && !matches!(text.as_str(), "" | "-" | "--" | "1") {
            *unit = Some(text);
        }
    }
    true
}

/// The name of the column of time, and the others with their places; `index`: the first has no name
/// and counts the rows.
fn channels(
    lines: &Lines<'_>,
    names: Names,
    (time, index): (usize, bool),
    options: &ReadOptions,
    notes: &mut Notes,
) -> Result<(String, Columns), LogError> {
    let file = || lines.file.to_owned();
    let (mut clock, mut columns) = (String::new(), Vec::with_capacity(names.len()));
    for (place, (name, unit)) in names.into_iter().enumerate() {
        if place == time {
            clock = name;
            continue;
        }
        match name.as_str() {
            "" if place == 0 && index => {
                notes.push("column 1 has no name and counts the rows; left out".to_owned())
            }
            "" => {
                let (row, column) = (lines.row, place + 1);
                return Err(LogError::UnnamedColumn { file: file(), row, column });
            }
            "time" if options.time.is_none() => {
                return Err(LogError::DuplicateChannel { file: file(), channel: name });
            }
            "time" => notes
                .push("the column `time` is left out: another one is taken as the time".to_owned()),
            _ => columns.push((place, name, unit)),
        }
    }
    let mut seen = std::collections::HashSet::new();
    if let Some((_, twice, _)) = columns.iter().find(|(_, name, _)| !seen.insert(name)) {
        return Err(LogError::DuplicateChannel { file: file(), channel: twice.clone() });
    }
    Ok((clock, columns))
}

impl Header {
    pub(super) fn read(lines: &mut Lines<'_>, options: &ReadOptions) -> Result<Self, Error> {
        let file = lines.file;
        if !lines.header()? {
            return Err(lines.nothing(LogError::Empty { file: file.into() }).into());
        }
        Self::of_table(lines, options, Notes::default())
    }

    /// From the line at hand.
    fn of_table(
        lines: &mut Lines<'_>,
        options: &ReadOptions,
        mut notes: Notes,
    ) -> Result<Self, Error> {
        let file = lines.file;
        let mut names = names(lines, &mut notes)?;
        let trailing = (names.len() > 1
            && names.last().is_some_and(|last| *last == Default::default()))
        .then(|| {
            names.pop();
            lines.row
        });
        let below = lines.below();
        let cell = |place: usize| below.get(place).map_or(b"".as_slice(), Vec::as_slice);
        if let (Some(row), true) =
            (trailing, matches!(parse(cell(names.len()), true), Cell::Number(_)))
        {
            let column = names.len() + 1;
            return Err(LogError::UnnamedColumn { file: file.into(), row, column }.into());
        }
        let index = unnamed_first(&mut names, cell(0), options, &mut notes);
        let (time, _) = match time_column(lines, &names, options) {
            Ok(found) => found,
            Err(error) => {
                let row = lines.row;
                if notes.iter().any(|note| note.contains(PREAMBLE)) || !table_below(lines, options)?
                {
                    return Err(error.into());
                }
                let last = lines.row - 1;
                notes.push(format!("rows {row} to {last} {PREAMBLE} and are left out"));
                return Self::of_table(lines, options, notes);
            }
        };
        if take_units(&mut names, time, &below) {
            notes.push(format!("the row below row {} holds the units", lines.row));
            lines.skip_below();
        }
        let (_, mut unit) = time_column(lines, &names, options)?;
        let cells = names.len();
        let beside = date_beside(&names, &lines.below(), options);
        let (date, time) = beside.map_or((None, time), |(date, time)| (Some(date), time));
        if let Some((name, _)) = date.and_then(|date| names.get(date)) {
            notes.push(format!("the date stands in the column `{}`", shown(name.as_bytes())));
            unit = None;
        }
        let (column, mut columns) = channels(lines, names, (time, index), options, &mut notes)?;
        columns.retain(|(place, ..)| Some(*place) != date);
        let clock = Clock { column, unit };
        let separator = lines.separator;
        let decimal_comma = separator.allows_decimal_comma()
            || lines.below().iter().any(|cell| has_decimal_comma(cell));
        Ok(Self {
            separator,
            decimal_comma,
            time,
            date,
            twice: 0,
            clock,
            columns,
            cells,
            trailing,
            notes,
        })
    }

    /// Says that the last row is not whole.
    fn left_out(&mut self, lines: &Lines<'_>, why: &str) {
        if !lines.cut_off() {
            self.notes
                .push(format!("row {}, the last one, is cut off ({why}) and left out", lines.row));
        }
    }

    /// The cell of a column in each line.
    pub(super) fn place(&self, file: &str, column: &str) -> Result<usize, LogError> {
        let names = || self.columns.iter().map(|(_, name, _)| name.as_str());
        let found = self.columns.iter().find(|(_, name, _)| name == column);
        found
            .map(|(place, ..)| *place)
            .ok_or_else(|| LogError::unknown_channel(file, column, names()))
    }

    pub(super) fn check_length(&self, lines: &Lines<'_>) -> Result<(), LogError> {
        let (expected, found) = (self.cells, lines.len());
        let one_more = found == expected + 1;
        match self.trailing {
            _ if expected == found => Ok(()),
            // A separator behind the last cell.
            _ if one_more && lines.cell(expected).is_empty() => Ok(()),
            Some(row) if one_more => {
                Err(LogError::UnnamedColumn { file: lines.file.into(), row, column: found })
            }
            _ => lines.must_have(expected),
        }
    }

    /// The time stamp of the current line, in the file's unit.
    pub(super) fn stamp(
        &self,
        source: &str,
        lines: &Lines<'_>,
        stamps: &mut StampReader,
    ) -> Result<f64, LogError> {
        let joined = self.date.map(|date| [lines.cell(date), b" ", lines.cell(self.time)].concat());
        let time = joined.as_deref().unwrap_or(lines.cell(self.time));
        let row = lines.row;
        let number = |cell: &[u8]| match parse(cell, self.decimal_comma) {
            Cell::Number(x) => Some(x),
            _ => None,
        };
        if let Some(raw) = stamps.read(time, self.clock.unit.map(|(unit, _)| unit), number) {
            return Ok(raw);
        }
        if time.is_empty() {
            return Err(LogError::EmptyTime { file: source.to_owned(), row });
        }
        // Time must be there: what stands for nothing is not finite either.
        let found = match parse(time, self.decimal_comma) {
            Cell::Missing => Cell::NotFinite,
            Cell::Number(_) => Cell::Text,
            other => other,
        };
        Err(found.refusal(source, row, &self.clock.column, time))
    }

    /// The number of a channel in the current line; `None` where it is missing.
    pub(super) fn number(
        &self,
        source: &str,
        lines: &Lines<'_>,
        place: usize,
        name: &str,
    ) -> Result<Option<f64>, LogError> {
        let cell = lines.cell(place);
        parse(cell, self.decimal_comma).number(source, lines.row, name, cell)
    }

    /// Whether the current line has the numbers of the one before it.
    fn again(&self, source: &str, lines: &Lines<'_>, columns: &[CellColumn]) -> bool {
        columns.iter().zip(&self.columns).all(|(column, (place, name, _))| {
            column.refused.is_some()
                || self
                    .number(source, lines, *place, name)
                    .is_ok_and(|value| column.last() == Some(value))
        })
    }

    /// The unit of time, settled by the first record that shows it.
    pub(super) fn settle(&mut self, stamps: &StampReader, raw: &[f64]) -> TimeUnit {
        let plain = self.clock.column == "time";
        let (unit, why) = match self.clock.unit {
            Some(settled) => settled,
            None => {
                let guess = stamps.guess(raw, plain);
                if raw.len() > 1 {
                    self.clock.unit = Some(guess);
                }
                guess
            }
        };
        let step_s = median_step(raw) / unit.per_second();
        let column = &self.clock.column;
        let every = if step_s > 0.0 {
            format!(", a sample every {} s", shortest(step_s))
        } else {
            String::new()
        };
        let again = |note: String| {
            Some(
                Message::from(note)
                    .and("; ")
                    .and(Remedy::TimeColumn)
                    .and(" and ")
                    .and(Remedy::TimeUnit)
                    .and(" say it otherwise"),
            )
        };
        let from = stamps.counted_from(unit);
        let note = match why {
            Why::Given => None,
            Why::Named if plain && unit == TimeUnit::S => None,
            Why::Named => again(format!(
                "time is the column `{column}` in {} by its name{every}{from}",
                unit.words()
            )),
            Why::Size => again(format!(
                "time is the column `{column}` in {} by the size of its numbers{every}{from}",
                unit.words()
            )),
            Why::Written => {
                Some(format!("time is the column `{column}`, {}{every}{from}", unit.words()).into())
            }
            Why::Rule if !plain => {
                again(format!("time is the column `{column}`, taken in seconds{every}{from}"))
            }
            Why::Rule if step_s >= 2.0 => again(format!("time is taken in seconds{every}{from}")),
            Why::Rule if !from.is_empty() => Some(format!("time is taken in seconds{from}").into()),
            Why::Rule => None,
        };
        note.into_iter().for_each(|note| self.notes.push_once(note));
        unit
    }
}

/// What is said of rows above the table.
const PREAMBLE: &str = "stand above the table";
/// Rows above a table that are looked through.
const MOST_ABOVE: usize = 2000;

/// Goes to the first row that begins a table: one of its names is that of the time, as many cells stand below, and the one below that name is a stamp.
fn table_below(lines: &mut Lines<'_>, options: &ReadOptions) -> Result<bool, Error> {
    let mut unused = Notes::default();
    for _ in 0..MOST_ABOVE {
        if !lines.header_below()? {
            return Ok(false);
        }
        let Ok(mut names) = names(lines, &mut unused) else { continue };
        if names.last().is_some_and(|last| *last == Default::default()) {
            names.pop();
        }
        let below = lines.below();
        let Ok((time, _)) = time_column(lines, &names, options) else { continue };
        let stamp = |cell: &Vec<u8>| {
            let text = std::str::from_utf8(cell).unwrap_or_default().trim();
            matches!(parse(cell, true), Cell::Number(_))
                || clock::date(text).or_else(|| clock::time_of_day(text)).is_some()
        };
        let alike = (names.len()..=names.len() + 1).contains(&below.len());
        if names.len() > 1 && alike && below.get(time).is_some_and(stamp) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The columns of date and time of day, where a row has them apart.
fn date_beside(names: &Names, below: &[Vec<u8>], options: &ReadOptions) -> Option<(usize, usize)> {
    const DATES: [&str; 3] = ["date", "datum", "day"];
    const TIMES: [&str; 5] = ["time", "zeit", "uhrzeit", "clock", "time_of_day"];
    let text = |place: usize| std::str::from_utf8(below.get(place)?).ok().map(str::trim);
    let is = |place: usize, known: &[&str], test: &dyn Fn(&str) -> bool| {
        let name = names.get(place).map(|(name, _)| name.trim().to_lowercase().replace(' ', "_"));
        name.is_some_and(|n| known.contains(&n.as_str())) && text(place).is_some_and(test)
    };
    let places = || 0..names.len();
    let of_day = |t: &str| t.contains(':') && clock::time_of_day(t).is_some();
    let date =
        places().find(|p| is(*p, &DATES, &|t| !t.contains(':') && clock::date(t).is_some()))?;
    let time = places().find(|p| is(*p, &TIMES, &of_day))?;
    let named = options.time.as_ref().is_none_or(|wanted| {
        [date, time].iter().any(|p| names.get(*p).is_some_and(|(name, _)| name == wanted))
    });
    (named && options.time_unit.is_none_or(|unit| unit == TimeUnit::Iso)).then_some((date, time))
}

/// The column of time and, where somebody says it, its unit.
pub(super) fn time_column(
    lines: &Lines<'_>,
    names: &[(String, Option<String>)],
    options: &ReadOptions,
) -> Result<(usize, Option<(TimeUnit, Why)>), LogError> {
    let file = || lines.file.to_owned();
    let first = || names.first().map_or_else(String::new, |(name, _)| shown(name.as_bytes()));
    let time = match &options.time {
        Some(wanted) => names.iter().position(|(name, _)| name == wanted).ok_or_else(|| {
            let known = names.iter().map(|(name, _)| name.as_str());
            LogError::unknown_channel(lines.file, wanted, known)
        })?,
        None => {
            let called = |place: usize, name: &str| clock::named(name, place == 0).is_some();
            let plain = names.iter().position(|(name, _)| name == "time");
            plain
                .or_else(|| {
                    names.iter().enumerate().position(|(place, (name, _))| called(place, name))
                })
                // A column of time in a unit that is not known.
                .or_else(|| {
                    let strange = |(place, (name, _)): (usize, &(String, Option<String>))| {
                        clock::unknown_unit(name, place == 0).is_some()
                    };
                    names.iter().enumerate().position(strange)
                })
                .ok_or_else(|| LogError::FirstColumn {
                    file: file(),
                    row: lines.row,
                    found: first(),
                })?
        }
    };
    let (name, bracket) =
        names.get(time).map_or(("", None), |(name, unit)| (name.as_str(), unit.as_deref()));
    if let Some(given) = options.time_unit {
        return Ok((time, Some((given, Why::Given))));
    }
    let bracket = bracket.map(str::to_owned).or_else(|| clock::unknown_unit(name, time == 0));
    let unit = match bracket.as_deref() {
        Some(text) => Some(clock::unit(text).ok_or_else(|| LogError::TimeUnit {
            file: file(),
            row: lines.row,
            unit: shown(text.as_bytes()),
        })?),
        None => clock::named(name, time == 0).flatten(),
    };
    Ok((time, unit.map(|unit| (unit, Why::Named))))
}

/// Deals with a first column without a name, as pandas writes its index: it is the time where it holds dates and no other column is the time. Whether it counts the rows.
pub(super) fn unnamed_first(
    names: &mut Names,
    below: &[u8],
    options: &ReadOptions,
    notes: &mut Notes,
) -> bool {
    let time =
        names.iter().enumerate().any(|(place, (name, _))| clock::named(name, place == 0).is_some());
    let Some((name, None)) = names.first_mut() else { return false };
    if !name.is_empty() || names_time(options, "") {
        return false;
    }
    let text = std::str::from_utf8(below).unwrap_or_default();
    if !time && options.time.is_none() && clock::date(text).is_some() {
        *name = "time".to_owned();
        notes.push("column 1 has no name and holds dates: it is taken as the time".to_owned());
        return false;
    }
    text.bytes().all(|byte| byte.is_ascii_digit()) && !text.is_empty()
}

/// Whether the caller says that a column of this name is the time.
pub(super) fn names_time(options: &ReadOptions, name: &str) -> bool {
    options.time.as_deref() == Some(name)
}

/// What one cell holds.
pub(super) enum Cell {
    Number(f64),
    Missing,
    NotFinite,
    /// A comma that may be a decimal one or stand between thousands.
    Comma,
    Text,
}

impl Cell {
    /// The number; `None` where it is missing.
    pub(super) fn number(
        self,
        file: &str,
        row: usize,
        channel: &str,
        cell: &[u8],
    ) -> Result<Option<f64>, LogError> {
        match self {
            Self::Number(x) => Ok(Some(x)),
            Self::Missing => Ok(None),
            other => Err(other.refusal(file, row, channel, cell)),
        }
    }

    /// What to say of a cell without a number.
    fn refusal(&self, file: &str, row: usize, channel: &str, cell: &[u8]) -> LogError {
        let (file, place, channel, text) =
            (file.to_owned(), Place::Row(row), channel.to_owned(), shown(cell));
        match self {
            Self::NotFinite => LogError::NotFinite { file, place, channel, text },
            Self::Comma => LogError::Comma { file, place, channel, text },
            Self::Number(_) | Self::Missing | Self::Text => {
                LogError::NotANumber { file, place, channel, text }
            }
        }
    }
}

/// A cell with one comma and no point, the comma made a point.
pub(super) fn with_point(text: &str) -> Option<String> {
    (text.bytes().filter(|byte| *byte == b',').count() == 1 && !text.contains('.'))
        .then(|| text.replace(',', "."))
}

/// Whether a comma may stand between thousands: three digits behind it, one to three before it and no 0 in front.
pub(super) fn may_be_thousands(text: &str) -> bool {
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    text.trim_start_matches(['-', '+']).split_once(',').is_some_and(|(whole, behind)| {
        digits(whole)
            && digits(behind)
            && behind.len() == 3
            && (1..=3).contains(&whole.len())
            && !whole.starts_with('0')
    })
}

/// Whether a cell is a number with a decimal comma beyond doubt.
pub(super) fn has_decimal_comma(cell: &[u8]) -> bool {
    cell.contains(&b',')
        && !std::str::from_utf8(cell).is_ok_and(may_be_thousands)
        && matches!(parse(cell, true), Cell::Number(_))
}

pub(super) fn parse(cell: &[u8], decimal_comma: bool) -> Cell {
    if cell.is_empty() {
        return Cell::Missing;
    }
    if let Some(x) = decimal(cell) {
        return Cell::Number(x);
    }
    let Ok(text) = std::str::from_utf8(cell) else { return Cell::Text };
    let number = match text.parse::<f64>() {
        Ok(x) => Some(x),
        Err(_) => match with_point(text).and_then(|t| t.parse().ok()) {
            Some(_) if !decimal_comma && may_be_thousands(text) => return Cell::Comma,
            x => x,
        },
    };
    match number {
        Some(x) if x.is_finite() => Cell::Number(x),
        Some(x) if x.is_nan() => Cell::Missing,
        Some(_) => Cell::NotFinite,
        None if NOTHING.contains(&text.to_lowercase().as_bytes()) => Cell::Missing,
        None if ON.iter().any(|on| text.eq_ignore_ascii_case(on)) => Cell::Number(1.0),
        None if OFF.iter().any(|off| text.eq_ignore_ascii_case(off)) => Cell::Number(0.0),
        None => Cell::Text,
    }
}

/// What stands for 1 and for 0 in columns of switches.
const ON: [&str; 2] = ["true", "on"];
const OFF: [&str; 2] = ["false", "off"];

/// A log that is being read; its time in the unit of the file until it is whole.
pub(super) struct PartialLog {
    source: String,
    stamps: StampReader,
    raw: Vec<f64>,
    columns: Vec<CellColumn>,
    rows: Rows,
    /// By how much changes of the clocks moved the stamps, in the unit of the file.
    moved: f64,
    /// Rows that may be read.
    most: usize,
    /// The memory that this is of, where it is the lower limit, bytes.
    memory: Option<u64>,
}

/// A column that is being read: numbers up to the first cell that is none.
#[derive(Default)]
pub(super) struct CellColumn {
    values: Vec<f64>,
    present: Option<Vec<bool>>,
    refused: Option<LogError>,
}

impl CellColumn {
    /// The number in the row before; `Some(None)` where it is missing.
    fn last(&self) -> Option<Option<f64>> {
        let there = self.present.as_ref().is_none_or(|p| p.last() == Some(&true));
        self.values.last().map(|value| there.then_some(*value))
    }

    fn push(&mut self, value: Option<f64>) {
        if value.is_none() && self.present.is_none() {
            self.present = Some(vec![true; self.values.len()]);
        }
        self.values.push(value.unwrap_or(0.0));
        if let Some(present) = &mut self.present {
            present.push(value.is_some());
        }
    }

    fn refuse(&mut self, error: LogError) {
        *self = Self { refused: Some(error), ..Self::default() };
    }
}

impl PartialLog {
    fn new(source: String, header: &Header, memory: Option<u64>) -> Self {
        let columns = header.columns.iter().map(|_| CellColumn::default()).collect();
        let memory = memory.unwrap_or(u64::MAX);
        let numbers = usize::try_from(memory / size_of::<f64>() as u64).unwrap_or(usize::MAX);
        let most = numbers.min(MOST_NUMBERS) / (header.columns.len() + 1);
        Self {
            source,
            stamps: StampReader::default(),
            raw: Vec::new(),
            columns,
            rows: Rows::new(Origin::File),
            moved: 0.0,
            most,
            memory: Some(memory).filter(|_| numbers < MOST_NUMBERS),
        }
    }

    /// Why the current line is the rest of a row whose end is lost; only the last one of a file can be, and only one below rows that are whole.
    fn cut_off(&self, lines: &Lines<'_>, header: &Header) -> Option<String> {
        if !lines.open {
            return None;
        }
        if lines.cut_off() {
            return Some(String::new());
        }
        let last = self.raw.last()?;
        if lines.len() < header.cells {
            return Some(format!("{} of {} cells", lines.len(), header.cells));
        }
        if lines.len() > header.cells {
            return None;
        }
        let stamp = header.stamp(&self.source, lines, &mut self.stamps.clone());
        if !stamp.is_ok_and(|stamp| stamp - self.moved > *last) {
            return Some(format!("its time is `{}`", shown(lines.cell(header.time))));
        }
        let columns =
            self.columns.iter().zip(&header.columns).filter(|(column, _)| column.refused.is_none());
        for (column, (place, name, _)) in columns {
            let cell = lines.cell(*place);
            match header.number(&self.source, lines, *place, name) {
                Err(_) => return Some(format!("`{name}` is `{}`", shown(cell))),
                // A column that missed nothing so far, and has lost its last number.
                Ok(None) if *place + 1 == header.cells && column.present.is_none() => {
                    return Some(format!("`{name}` is `{}`", shown(cell)));
                }
                Ok(_) => {}
            }
        }
        None
    }

    /// Adds the current line as a sample.
    fn push(&mut self, lines: &Lines<'_>, header: &mut Header) -> Result<(), LogError> {
        header.check_length(lines)?;
        let row = lines.row;
        let Self { source, stamps, raw: before, columns, rows, moved, most, memory } = self;
        if before.len() >= *most {
            if let Some(memory) = memory {
                let limit_mb = memory.div_ceil(1 << 20);
                return Err(LogError::Memory { file: source.clone(), limit_mb });
            }
            let numbers = *most as f64 * (columns.len() + 1) as f64;
            return Err(LogError::TooLarge {
                file: source.clone(),
                row,
                most: numbers,
                gb: numbers * size_of::<f64>() as f64 / 1e9,
            });
        }
        let mut raw = header.stamp(source, lines, stamps)? - *moved;
        if let Some(change) = stamps.clock_change(before, raw) {
            (raw, *moved) = (raw - change, *moved + change);
            let way = if change > 0.0 { "forward" } else { "back" };
            header.notes.push(format!(
                "row {row}: local time goes {way} by an hour, as where the clocks are changed; the stamps behind it are moved by that hour"
            ));
        }
        if before.last() == Some(&raw) && header.again(source, lines, columns) {
            header.twice += 1;
            return Ok(());
        }
        if before.last().is_none_or(|before| *before < raw) && raw.abs() <= crate::log::TIME_LIMIT_S
        {
            rows.note(before.len(), row);
            before.push(raw);
        } else {
            let scale = header.settle(stamps, before).per_second();
            time_follows(
                source,
                || Place::Row(row),
                before.last().map(|t| t / scale),
                raw / scale,
            )?;
        }
        let places = columns.iter_mut().zip(&header.columns);
        for (column, (place, name, _)) in places.filter(|(column, _)| column.refused.is_none()) {
            match header.number(source, lines, *place, name) {
                Ok(value) => column.push(value),
                Err(error) => column.refuse(error),
            }
        }
        Ok(())
    }

    fn finish(mut self, header: &mut Header) -> Result<Log, LogError> {
        if header.twice > 0 {
            let twice = std::mem::take(&mut header.twice);
            header.notes.push(format!(
                "{twice} rows are the same as the one before them, with its time; each is read once"
            ));
        }
        let scale = header.settle(&self.stamps, &self.raw).per_second();
        let mut time_s = self.raw;
        if scale != 1.0 {
            time_s.iter_mut().for_each(|t| *t /= scale);
        }
        time_s.shrink_to_fit();
        let (mut channels, mut unusable) = (Vec::new(), Vec::new());
        for (column, (_, name, unit)) in self.columns.drain(..).zip(&header.columns) {
            if let Some(error) = column.refused {
                unusable.push(Unusable { name: name.clone(), error });
                continue;
            }
            let CellColumn { mut values, mut present, .. } = column;
            values.shrink_to_fit();
            present.iter_mut().for_each(Vec::shrink_to_fit);
            channels.push(Channel {
                name: name.clone(),
                unit: unit.clone(),
                values: values.into(),
                present,
            });
        }
        Log::assemble(self.source, time_s, channels, unusable, self.rows)
    }
}

/// A cell as a message shows it.
pub(super) fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(cell);
    if text.chars().count() <= SHOWN {
        text.into_owned()
    } else {
        text.chars().take(SHOWN).chain(['…']).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_beyond_the_limit_are_refused() {
        let mut lines = Lines::new("a.csv", "time,u\n0,1\n1,2\n2,3\n".as_bytes()).unwrap();
        let mut header = Header::read(&mut lines, &ReadOptions::default()).unwrap();
        let mut part = PartialLog::new("a.csv".into(), &header, None);
        assert_eq!(part.most, MOST_NUMBERS / 2);
        part.most = 2;
        for _ in 0..2 {
            assert!(lines.next().unwrap());
            part.push(&lines, &mut header).unwrap();
        }
        assert!(lines.next().unwrap());
        let said = part.push(&lines, &mut header).unwrap_err().to_string();
        assert!(said.starts_with("a.csv, row 4: more than 4e0 numbers"), "{said}");
    }
}

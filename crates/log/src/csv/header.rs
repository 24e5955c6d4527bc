//! The header row of a text table: the column of time, and the channels.

use super::cell::{Cell, has_decimal_comma, parse, shown};
use super::clock::{StampReader, Why, median_step, shortest};
use super::lines::{Lines, Separator};
use super::{date, slashes, time_name};
use crate::error::{Error, LogError};
use crate::header::name_and_unit;
use crate::notes::Notes;
use crate::options::{ReadOptions, TimeUnit};
use deadtime_signal::remedy::{Message, Remedy};

/// Cell, name and unit of each channel.
pub(super) type Columns = Vec<(usize, String, Option<String>)>;

/// The header row: the column of time, and the channels.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) separator: Separator,
    /// Whether a comma within a cell is a decimal comma.
    pub(super) decimal_comma: bool,
    pub(super) time: usize,
    /// The column of the date, where the time is one of day.
    pub(super) date: Option<usize>,
    /// Rows that were written twice.
    pub(super) twice: usize,
    pub(super) clock: Clock,
    pub(super) columns: Columns,
    pub(super) cells: usize,
    /// Its line, if a separator is behind its last name.
    trailing: Option<usize>,
    /// The rows that are wanted, where not all are.
    only: Option<Only>,
    pub(super) notes: Notes,
}

/// The known facts of the time before its stamps are read.
#[derive(Debug)]
pub(super) struct Clock {
    pub(super) column: String,
    pub(super) unit: Option<(TimeUnit, Why)>,
}

/// Name and unit of each cell of a header.
pub(super) type Names = Vec<(String, Option<String>)>;

/// The cells of the current line as names and units; in Latin-1 where they are no UTF-8, with a note.
pub(super) fn names(lines: &Lines<'_>, notes: &mut Notes) -> Result<Names, LogError> {
    let mut names = Vec::with_capacity(lines.len());
    for place in 0..lines.len() {
        let cell = lines.cell(place);
        let text = match std::str::from_utf8(cell) {
            Ok(text) => text.to_owned(),
            // Printable characters there and in the code pages of Western Europe; the others are control characters in one of them.
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

/// Drops the empty name behind a separator at the end of a header; returns whether there was one.
fn take_trailing(names: &mut Names) -> bool {
    let trailing = names.len() > 1 && names.last().is_some_and(|last| *last == Default::default());
    if trailing {
        names.pop();
    }
    trailing
}

/// A unit without the brackets around it.
fn bare(cell: &[u8]) -> String {
    let text: String = match std::str::from_utf8(cell) {
        Ok(text) => text.trim().to_owned(),
        Err(_) => cell.iter().map(|byte| char::from(*byte)).collect(),
    };
    let inner = [('[', ']'), ('(', ')')]
        .iter()
        .find_map(|(open, close)| text.strip_prefix(*open)?.strip_suffix(*close));
    inner.map_or_else(|| text.clone(), |inner| inner.trim().to_owned())
}

/// Whether a row below a header of this many names holds units. The time's cell must be one, and no cell may be a number except 1, which means no unit.
fn holds_units(names: usize, time: usize, below: &[Vec<u8>]) -> bool {
    let of_unit = |cell: &Vec<u8>| {
        matches!(parse(cell, true), Cell::Text | Cell::Missing) || bare(cell) == "1"
    };
    let timed = below.get(time).is_some_and(|cell| time_name::unit(&bare(cell)).is_some());
    timed && below.len() >= names && below.iter().all(of_unit)
}

/// Uses the first column as the time where no name is one of time and the row below holds units, a unit of time first. Oscilloscopes write it: `X,CH1` above
/// `Second,Volt`.
fn first_by_unit(names: &mut Names, below: &[Vec<u8>], options: &ReadOptions, notes: &mut Notes) {
    let named = |(place, (name, _)): (usize, &(String, Option<String>))| {
        time_name::named(name, place == 0).is_some()
            || time_name::unknown_unit(name, place == 0).is_some()
    };
    let number = |(name, _): &(String, Option<String>)| {
        matches!(parse(name.as_bytes(), true), Cell::Number(_))
    };
    let known =
        options.time.is_some() || names.iter().enumerate().any(named) || names.iter().any(number);
    if known || names.len() < 2 || below.len() != names.len() || !holds_units(names.len(), 0, below)
    {
        return;
    }
    if let Some((name, _)) = names.first_mut() {
        notes.push(format!("column 1, `{name}`, is taken as the time by the unit below it"));
        *name = "time".to_owned();
    }
}

/// Takes the units of a row below the header with units only. The time's cell is one, and no cell is a number except 1, which means no unit. Returns whether it
/// was such a row.
pub(super) fn take_units(names: &mut Names, time: usize, below: &[Vec<u8>]) -> bool {
    if !holds_units(names.len(), time, below) {
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

/// The rows that are wanted: those with a text or number in a column.
#[derive(Debug)]
struct Only {
    place: usize,
    column: String,
    value: String,
    number: Option<f64>,
    /// A row had it.
    found: bool,
    /// Some other values of the column.
    others: Vec<String>,
}

impl Only {
    /// Other values that an error names.
    const OTHERS: usize = 8;

    fn of(file: &str, columns: &Columns, options: &ReadOptions) -> Result<Option<Self>, LogError> {
        let Some((column, value)) = &options.only else { return Ok(None) };
        let known = || columns.iter().map(|(_, name, _)| name.as_str());
        let found = columns.iter().find(|(_, name, _)| name == column);
        let (place, ..) = found.ok_or_else(|| LogError::unknown_channel(file, column, known()))?;
        Ok(Some(Self {
            place: *place,
            column: column.clone(),
            value: value.trim().to_owned(),
            number: value.trim().parse().ok(),
            found: false,
            others: Vec::new(),
        }))
    }

    fn is_in(&mut self, cell: &[u8], decimal_comma: bool) -> bool {
        let cell = cell.trim_ascii();
        let same = cell == self.value.as_bytes()
            || self.number.is_some_and(
                |number| matches!(parse(cell, decimal_comma), Cell::Number(x) if x == number),
            );
        self.found |= same;
        if !same && !self.found && self.others.len() < Self::OTHERS {
            let other = shown(cell);
            if !self.others.contains(&other) {
                self.others.push(other);
            }
        }
        same
    }

    fn nowhere(&self, file: &str) -> LogError {
        LogError::NoSuchRows {
            file: file.to_owned(),
            column: self.column.as_str().into(),
            value: self.value.as_str().into(),
            there: self.others.clone(),
        }
    }
}

impl Header {
    pub(super) fn read(lines: &mut Lines<'_>, options: &ReadOptions) -> Result<Self, Error> {
        let file = lines.file;
        let named = !options.columns.is_empty();
        if !(if named { lines.named(&options.columns)? } else { lines.header()? }) {
            return Err(lines.nothing(LogError::Empty { file: file.into() }).into());
        }
        Self::of_table(lines, options, Notes::default())
    }

    /// From the current line.
    fn of_table(
        lines: &mut Lines<'_>,
        options: &ReadOptions,
        mut notes: Notes,
    ) -> Result<Self, Error> {
        let file = lines.file;
        let mut names = names(lines, &mut notes)?;
        let trailing = take_trailing(&mut names).then_some(lines.row);
        let below = lines.below();
        let cell = |place: usize| below.get(place).map_or(b"".as_slice(), Vec::as_slice);
        if let (Some(row), true) =
            (trailing, matches!(parse(cell(names.len()), true), Cell::Number(_)))
        {
            let column = names.len() + 1;
            return Err(LogError::UnnamedColumn { file: file.into(), row, column }.into());
        }
        let index = unnamed_first(&mut names, cell(0), options, &mut notes);
        first_by_unit(&mut names, &below, options, &mut notes);
        let (time, _) = match time_column(lines, &names, options) {
            Ok(found) => found,
            Err(error) => {
                skip_preamble(lines, &names, options, &mut notes, error)?;
                return Self::of_table(lines, options, notes);
            }
        };
        if take_units(&mut names, time, &below) {
            notes.push(format!("the row below row {} holds the units", lines.row));
            lines.skip_below();
        }
        let (_, mut unit) = time_column(lines, &names, options)?;
        let cells = names.len();
        let separate = separate_date(&names, &lines.below(), options);
        let (date, time) = separate.map_or((None, time), |(date, time)| (Some(date), time));
        if let Some((name, _)) = date.and_then(|date| names.get(date)) {
            notes.push(format!("the date stands in the column `{}`", shown(name.as_bytes())));
            unit = None;
        }
        let (column, mut columns) = channels(lines, names, (time, index), options, &mut notes)?;
        columns.retain(|(place, ..)| Some(*place) != date);
        let only = Only::of(file, &columns, options)?;
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
            only,
            notes,
        })
    }

    /// Whether the current line is one of the rows that are wanted.
    pub(super) fn wants(&mut self, lines: &Lines<'_>) -> bool {
        let comma = self.decimal_comma;
        self.only.as_mut().is_none_or(|only| only.is_in(lines.cell(only.place), comma))
    }

    /// The message on a file without a requested row.
    pub(super) fn no_rows(&self, file: &str) -> LogError {
        match &self.only {
            Some(only) => only.nowhere(file),
            None => LogError::NoSamples { file: file.to_owned() },
        }
    }

    /// Says that the last row is not whole.
    pub(super) fn left_out(&mut self, lines: &Lines<'_>, why: &str) {
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
        let unit = self.clock.unit.map(|(unit, _)| unit);
        if let Some(raw) = stamps.read(time, unit, number) {
            return Ok(raw);
        }
        if stamps.is_ambiguous() {
            let text = shown(time);
            return Err(LogError::DayOrMonth { file: source.to_owned(), row, text });
        }
        if time.is_empty() {
            return Err(LogError::EmptyTime { file: source.to_owned(), row });
        }
        // Every row needs a time: a placeholder is not finite either.
        let found = match parse(time, self.decimal_comma) {
            Cell::Missing => Cell::NotFinite,
            Cell::Number(_) | Cell::Text => {
                let half = std::str::from_utf8(time).is_ok_and(date::is_half_a_clock);
                let (file, column) = (source.to_owned(), self.clock.column.clone());
                return Err(LogError::NotATime { file, row, column, text: shown(time), half });
            }
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

    /// The unit of time, settled by the first record that shows it.
    pub(super) fn settle(&mut self, stamps: &StampReader, raw: &[f64]) -> TimeUnit {
        let plain = self.clock.column == "time";
        let (unit, why) = match self.clock.unit {
            Some(settled) => settled,
            None => {
                let guess = stamps.guess(raw, &self.clock.column);
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
            Why::Writer => again(format!(
                "time is the column `{column}` in {}, as Betaflight's blackbox writes it (`{LOOPS}`){every}{from}",
                unit.words()
            )),
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

/// The words on rows above the table.
const PREAMBLE: &str = "stand above the table";
/// Rows above a table that are looked through.
const MOST_ABOVE: usize = 2000;

/// Skips the rows above a table, with a note. Without a table below them, the error of the column of time is returned.
fn skip_preamble(
    lines: &mut Lines<'_>,
    names: &Names,
    options: &ReadOptions,
    notes: &mut Notes,
    error: LogError,
) -> Result<(), Error> {
    let row = lines.row;
    let searched = notes.iter().any(|note| note.contains(PREAMBLE));
    if searched || !options.columns.is_empty() || !table_below(lines, options)? {
        let numbers = names.iter().all(|(name, _)| {
            matches!(parse(name.as_bytes(), true), Cell::Number(_)) || slashes::is_stamp(name)
        });
        let (file, cells) = (lines.file.to_owned(), names.len());
        let none = numbers.then_some(LogError::NoHeader { file, row, cells });
        return Err(none.unwrap_or(error).into());
    }
    let last = lines.row - 1;
    notes.push(format!("rows {row} to {last} {PREAMBLE} and are left out"));
    Ok(())
}

/// Goes to the first row that begins a table. One of its names is that of the time, the row below has as many cells, and the cell below that name is a stamp.
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
        first_by_unit(&mut names, &below, options, &mut unused);
        let Ok((time, _)) = time_column(lines, &names, options) else { continue };
        let stamp = |cell: &Vec<u8>| {
            let text = std::str::from_utf8(cell).unwrap_or_default().trim();
            matches!(parse(cell, true), Cell::Number(_)) || slashes::is_stamp(text)
        };
        let alike = (names.len()..=names.len() + 1).contains(&below.len());
        // A row that begins with a word below its first name is of names and values still.
        let word = |cell: &Vec<u8>| matches!(parse(cell, true), Cell::Text) && !stamp(cell);
        let numbers = below.get(time).is_some_and(stamp) && !below.first().is_some_and(word);
        if names.len() > 1 && alike && (numbers || holds_units(names.len(), time, &below)) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The columns of date and time of day, if a row has two.
fn separate_date(
    names: &Names,
    below: &[Vec<u8>],
    options: &ReadOptions,
) -> Option<(usize, usize)> {
    const DATES: [&str; 3] = ["date", "datum", "day"];
    const TIMES: [&str; 5] = ["time", "zeit", "uhrzeit", "clock", "time_of_day"];
    let text = |place: usize| std::str::from_utf8(below.get(place)?).ok().map(str::trim);
    let is = |place: usize, known: &[&str], test: &dyn Fn(&str) -> bool| {
        let name = names.get(place).map(|(name, _)| name.trim().to_lowercase().replace(' ', "_"));
        name.is_some_and(|n| known.contains(&n.as_str())) && text(place).is_some_and(test)
    };
    let places = || 0..names.len();
    let of_day = |t: &str| t.contains(':') && date::time_of_day(t).is_some();
    let date = places().find(|p| is(*p, &DATES, &|t| !t.contains(':') && slashes::is_date(t)))?;
    let time = places().find(|p| is(*p, &TIMES, &of_day))?;
    let named = options.time.as_ref().is_none_or(|wanted| {
        [date, time].iter().any(|p| names.get(*p).is_some_and(|(name, _)| name == wanted))
    });
    (named && options.time_unit.is_none_or(TimeUnit::is_dates)).then_some((date, time))
}

/// A column of Betaflight's blackbox, whose explorer and decoder write the time in microseconds.
const LOOPS: &str = "loopIteration";

/// The column of time and, if given, its unit.
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
            let called = |place: usize, name: &str| time_name::named(name, place == 0).is_some();
            let plain = names.iter().position(|(name, _)| name == "time");
            plain
                .or_else(|| {
                    names.iter().enumerate().position(|(place, (name, _))| called(place, name))
                })
                // A column of time in a unit that is not known.
                .or_else(|| {
                    let strange = |(place, (name, _)): (usize, &(String, Option<String>))| {
                        time_name::unknown_unit(name, place == 0).is_some()
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
    let bracket = bracket.map(str::to_owned).or_else(|| time_name::unknown_unit(name, time == 0));
    let unit = match bracket.as_deref() {
        Some(text) => Some(time_name::unit(text).ok_or_else(|| LogError::TimeUnit {
            file: file(),
            row: lines.row,
            unit: shown(text.as_bytes()),
        })?),
        None => time_name::named(name, time == 0).flatten(),
    };
    if unit.is_none() && name == "time" && names.iter().any(|(name, _)| name == LOOPS) {
        return Ok((time, Some((TimeUnit::Us, Why::Writer))));
    }
    Ok((time, unit.map(|unit| (unit, Why::Named))))
}

/// Handles a first column without a name, as pandas writes its index. The column is the time where it holds dates and no other column is the time. Returns
/// whether it counts the rows.
pub(super) fn unnamed_first(
    names: &mut Names,
    below: &[u8],
    options: &ReadOptions,
    notes: &mut Notes,
) -> bool {
    let time = names
        .iter()
        .enumerate()
        .any(|(place, (name, _))| time_name::named(name, place == 0).is_some());
    let Some((name, None)) = names.first_mut() else { return false };
    if !name.is_empty() || names_time(options, "") {
        return false;
    }
    let text = std::str::from_utf8(below).unwrap_or_default();
    if !time && options.time.is_none() && slashes::is_date(text) {
        *name = "time".to_owned();
        notes.push("column 1 has no name and holds dates: it is taken as the time".to_owned());
        return false;
    }
    text.bytes().all(|byte| byte.is_ascii_digit()) && !text.is_empty()
}

/// Whether a column of this name is the time by the caller's options.
pub(super) fn names_time(options: &ReadOptions, name: &str) -> bool {
    options.time.as_deref() == Some(name)
}

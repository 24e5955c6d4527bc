//! Logs as CSV: a header row, `time` first, one row per sample; `.csv.gz` too.
//!
//! Lines are read and counted here rather than by the csv crate, whose positions are off behind blank lines and in files with CRLF line
//! ends: the row in a message is the line that an editor shows. The csv crate takes apart lines with quotes.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write};
use std::ops::Range;
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::{Channel, Log, LogError, Origin, Place, Rows, Unusable, time_follows};
use crate::error::Error;
use crate::file::write_atomic;

/// A longer line is no row of a log, whatever the file is.
const LONGEST_LINE: u64 = 1 << 24;
/// As much of an offending cell as a message shows, in characters.
const SHOWN: usize = 40;
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads one log from a `.csv` or `.csv.gz` file.
///
/// A column that holds text, NaN or infinities somewhere loads as unusable: only asking for it is an error. `time` is always checked.
///
/// # Errors
/// [`Error::Io`] when the operating system refuses the file; [`LogError`] naming file, row and column.
pub fn read(path: &Path) -> Result<Log, Error> {
    read_from(&path.display().to_string(), open(path)?)
}

/// Reads a file of several records: a new one begins wherever the cell of `column` (numbers or text) differs from the row before, and time
/// may start afresh in it. They are called `FILE#VALUE`; a value that comes back later begins another record of the same name.
///
/// # Errors
/// As [`read`]; [`LogError::UnknownChannel`] when there is no such column, [`LogError::EmptyRecord`].
pub fn read_records(path: &Path, column: &str) -> Result<Vec<Log>, Error> {
    read_records_from(&path.display().to_string(), open(path)?, column)
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
/// As [`read`]; [`LogError::EventOrder`] where times do not increase, [`LogError::MissingThroughout`] for a column without events.
pub fn read_events(path: &Path, columns: [&str; 2]) -> Result<[EventTimes; 2], Error> {
    read_events_from(&path.display().to_string(), open(path)?, columns)
}

/// Reads two columns of event times from any source of bytes, as [`read_events`] does.
///
/// # Errors
/// As [`read_events`].
pub fn read_events_from(source: &str, bytes: impl Read, columns: [&str; 2]) -> Result<[EventTimes; 2], Error> {
    let file = || source.to_owned();
    let mut lines = Lines::new(source, bytes)?;
    if !lines.next()? {
        return Err(LogError::Empty { file: file() }.into());
    }
    let cells = lines.cells.len();
    let text = |place| std::str::from_utf8(lines.cell(place)).map(|cell| name_and_unit(cell).0.to_owned());
    let names: Vec<String> =
        (0..cells).map(text).collect::<Result<_, _>>().map_err(|_| LogError::NotText { file: file(), row: lines.row })?;
    let mut found = Vec::with_capacity(2);
    for column in columns {
        let mut places = (0..cells).filter(|&i| names.get(i).is_some_and(|name| name == column));
        let Some(place) = places.next() else {
            let closest = super::error::closest(column, names.iter().map(String::as_str)).map(Into::into);
            return Err(LogError::UnknownChannel { file: file(), channel: column.into(), closest, existing: names }.into());
        };
        if places.next().is_some() {
            return Err(LogError::DuplicateChannel { file: file(), channel: column.into() }.into());
        }
        let unit = std::str::from_utf8(lines.cell(place)).ok().and_then(|cell| name_and_unit(cell).1).map(ToOwned::to_owned);
        found.push((place, EventTimes { name: column.into(), unit, times: Vec::new() }));
    }
    while lines.next()? {
        if lines.cells.len() != cells {
            return Err(LogError::RowLength { file: file(), row: lines.row, expected: cells, found: lines.cells.len() }.into());
        }
        for (place, events) in &mut found {
            let (cell, row, channel) = (lines.cell(*place), lines.row, events.name.clone());
            let time = match parse(cell) {
                Cell::Missing => continue,
                Cell::Number(time) => time,
                Cell::NotFinite => {
                    return Err(LogError::NotFinite { file: file(), place: Place::Row(row), channel, text: shown(cell) }.into());
                }
                Cell::Text => return Err(LogError::NotANumber { file: file(), place: Place::Row(row), channel, text: shown(cell) }.into()),
            };
            if let Some(&before) = events.times.last().filter(|before| **before >= time) {
                return Err(LogError::EventOrder { file: file(), row, channel, before, time }.into());
            }
            events.times.push(time);
        }
    }
    if let Some((_, empty)) = found.iter().find(|(_, events)| events.times.is_empty()) {
        return Err(LogError::MissingThroughout { file: file(), channel: empty.name.clone() }.into());
    }
    let mut columns = found.into_iter().map(|(_, events)| events);
    match (columns.next(), columns.next()) {
        (Some(first), Some(second)) => Ok([first, second]),
        _ => Err(LogError::NoSamples { file: file() }.into()),
    }
}

/// Reads one log from any source of bytes, gzip or plain; `source` names it in errors and results.
///
/// # Errors
/// As [`read`].
pub fn read_from(source: &str, bytes: impl Read) -> Result<Log, Error> {
    let mut lines = Lines::new(source, bytes)?;
    let header = Header::read(&mut lines)?;
    let mut part = Part::new(source.into(), &header);
    while lines.next()? {
        part.push(&lines, &header)?;
    }
    Ok(part.finish(&header)?)
}

/// Reads several records from any source of bytes, as [`read_records`] does.
///
/// # Errors
/// As [`read_records`].
pub fn read_records_from(source: &str, bytes: impl Read, column: &str) -> Result<Vec<Log>, Error> {
    let mut lines = Lines::new(source, bytes)?;
    let header = Header::read(&mut lines)?;
    let place = header.place(source, column)?;
    let mut logs = Vec::new();
    let mut current: Option<(Vec<u8>, Part)> = None;
    while lines.next()? {
        header.check_length(&lines)?;
        let value = lines.cell(place);
        if value.is_empty() {
            return Err(LogError::EmptyRecord { file: source.into(), row: lines.row, channel: column.into() }.into());
        }
        let part = match &mut current {
            Some((name, part)) if name.as_slice() == value => part,
            _ => {
                let fresh = Part::new(format!("{source}#{}", String::from_utf8_lossy(value)), &header);
                if let Some((_, done)) = current.take() {
                    logs.push(done.finish(&header)?);
                }
                &mut current.insert((value.to_vec(), fresh)).1
            }
        };
        part.push(&lines, &header)?;
    }
    match current {
        Some((_, last)) => logs.push(last.finish(&header)?),
        None => return Err(LogError::NoSamples { file: source.into() }.into()),
    }
    Ok(logs)
}

impl Log {
    /// Writes the log as a CSV file, compressed when the name ends in `.gz`: units in the header, missing samples as empty cells,
    /// each number in the fewest digits that read back to the same bits. Columns without numbers are left out.
    ///
    /// # Errors
    /// [`Error::Io`]; an earlier file of that name is then untouched.
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        write_atomic(path, |file| {
            if is_gz(path) {
                let mut encoder = flate2::write::GzEncoder::new(file, flate2::Compression::default());
                self.write_rows(&mut encoder)?;
                encoder.finish().map(|_| ())
            } else {
                self.write_rows(file)
            }
        })
    }

    fn write_rows(&self, mut out: &mut dyn Write) -> std::io::Result<()> {
        let mut header = ::csv::Writer::from_writer(&mut out);
        header.write_record(std::iter::once("time".to_owned()).chain(self.channels.iter().map(Channel::header)))?;
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
fn push_number(line: &mut String, x: f64) {
    // Writing to a `String` cannot fail.
    let _ = if x == 0.0 || (1e-5..1e16).contains(&x.abs()) { write!(line, "{x}") } else { write!(line, "{x:e}") };
}

/// Splits a header `name [unit]` or `name`.
#[must_use]
pub fn name_and_unit(header: &str) -> (&str, Option<&str>) {
    let header = header.trim();
    match header.strip_suffix(']').and_then(|rest| rest.rsplit_once(" [")) {
        Some((name, unit)) if !unit.trim().is_empty() => (name.trim(), Some(unit.trim())),
        Some((name, _)) => (name.trim(), None),
        None => (header, None),
    }
}

fn is_gz(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz"))
}

/// Opens a file; one that is called .gz must be one.
fn open(path: &Path) -> Result<impl Read, Error> {
    let io = |e| Error::io(path, e);
    let mut file = std::fs::File::open(path).map_err(io)?;
    let head = first_bytes(&mut file).map_err(io)?;
    if is_gz(path) && !head.is_empty() && head != GZIP_MAGIC {
        return Err(LogError::NotGzip { file: path.display().to_string() }.into());
    }
    Ok(std::io::Cursor::new(head).chain(file))
}

fn first_bytes(bytes: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(GZIP_MAGIC.len());
    bytes.take(GZIP_MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(head)
}

/// The lines of a file with their numbers, blank ones left out; the current one is cut into cells.
struct Lines<'a> {
    file: &'a str,
    gzip: bool,
    reader: Box<dyn BufRead + 'a>,
    row: usize,
    line: Vec<u8>,
    cells: Vec<Range<usize>>,
}

impl<'a> Lines<'a> {
    fn new(file: &'a str, mut bytes: impl Read + 'a) -> Result<Self, Error> {
        let head = first_bytes(&mut bytes).map_err(|e| Error::io(Path::new(file), e))?;
        let gzip = head == GZIP_MAGIC;
        let whole = BufReader::with_capacity(1 << 16, std::io::Cursor::new(head).chain(bytes));
        let reader: Box<dyn BufRead> =
            if gzip { Box::new(BufReader::with_capacity(1 << 18, MultiGzDecoder::new(whole))) } else { Box::new(whole) };
        Ok(Self { file, gzip, reader, row: 0, line: Vec::new(), cells: Vec::new() })
    }

    /// Goes to the next line that is not blank; false at the end.
    fn next(&mut self) -> Result<bool, Error> {
        loop {
            self.line.clear();
            let read = self.reader.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut self.line).map_err(|e| self.refusal(e))?;
            if read == 0 {
                return Ok(false);
            }
            self.row += 1;
            if self.row == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
                self.line.drain(..BYTE_ORDER_MARK.len());
            }
            let endless = read as u64 == LONGEST_LINE && !self.line.ends_with(b"\n");
            if endless || self.line.contains(&0) {
                return Err(LogError::NotText { file: self.file.into(), row: self.row }.into());
            }
            if !self.line.trim_ascii().is_empty() {
                self.cut()?;
                return Ok(true);
            }
        }
    }

    fn refusal(&self, error: std::io::Error) -> Error {
        use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        if self.gzip && matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof) {
            LogError::Gzip { file: self.file.into(), row: self.row, reason: error.to_string() }.into()
        } else {
            Error::io(Path::new(self.file), error)
        }
    }

    /// Cuts the line into cells at its commas.
    fn cut(&mut self) -> Result<(), Error> {
        self.cells.clear();
        if self.line.contains(&b'"') {
            return self.cut_quoted();
        }
        let mut start = 0;
        for (i, _) in self.line.iter().enumerate().filter(|(_, byte)| **byte == b',') {
            self.cells.push(start..i);
            start = i + 1;
        }
        self.cells.push(start..self.line.len());
        Ok(())
    }

    /// As [`Lines::cut`] for a line with quotes, which go.
    fn cut_quoted(&mut self) -> Result<(), Error> {
        let open = || LogError::OpenQuote { file: self.file.into(), row: self.row };
        if self.line.iter().filter(|byte| **byte == b'"').count() % 2 != 0 {
            return Err(open().into());
        }
        let mut record = ::csv::ByteRecord::new();
        let mut reader = ::csv::ReaderBuilder::new().has_headers(false).buffer_capacity(self.line.len()).from_reader(self.line.as_slice());
        // Reading from memory fails in no way but at the end of a line that holds no cell.
        if !reader.read_byte_record(&mut record).unwrap_or(false) {
            return Err(open().into());
        }
        self.cells.extend((0..record.len()).filter_map(|i| record.range(i)));
        self.line.clear();
        self.line.extend_from_slice(record.as_slice());
        Ok(())
    }

    /// A cell of the current line without spaces around it; empty beyond the last one.
    fn cell(&self, place: usize) -> &[u8] {
        self.cells.get(place).and_then(|cell| self.line.get(cell.clone())).unwrap_or_default().trim_ascii()
    }
}

/// The header row behind `time`.
struct Header {
    columns: Vec<(String, Option<String>)>,
}

impl Header {
    fn read(lines: &mut Lines<'_>) -> Result<Self, Error> {
        let file = lines.file;
        if !lines.next()? {
            return Err(LogError::Empty { file: file.into() }.into());
        }
        let not_text = || LogError::NotText { file: file.into(), row: lines.row };
        let mut columns = Vec::with_capacity(lines.cells.len());
        for place in 0..lines.cells.len() {
            let cell = std::str::from_utf8(lines.cell(place)).map_err(|_| not_text())?;
            if cell.chars().any(|c| c.is_control() && c != '\t') {
                return Err(not_text().into());
            }
            let (name, unit) = name_and_unit(cell);
            match (place, name, unit) {
                (0, "time", None | Some("s")) => continue,
                (0, "time", Some(unit)) => return Err(LogError::TimeUnit { file: file.into(), unit: shown(unit.as_bytes()) }.into()),
                (0, ..) => return Err(LogError::FirstColumn { file: file.into(), found: shown(cell.as_bytes()) }.into()),
                (_, "", _) => return Err(LogError::UnnamedColumn { file: file.into(), column: place + 1 }.into()),
                (_, "time", _) => return Err(LogError::DuplicateChannel { file: file.into(), channel: name.into() }.into()),
                _ => columns.push((name.to_owned(), unit.map(ToOwned::to_owned))),
            }
        }
        let mut seen = std::collections::HashSet::new();
        match columns.iter().find(|(name, _)| !seen.insert(name)) {
            Some((twice, _)) => Err(LogError::DuplicateChannel { file: file.into(), channel: twice.clone() }.into()),
            None => Ok(Self { columns }),
        }
    }

    /// The cell of a column in each line.
    fn place(&self, file: &str, column: &str) -> Result<usize, LogError> {
        let names = || self.columns.iter().map(|(name, _)| name.as_str());
        names().position(|name| name == column).map(|i| i + 1).ok_or_else(|| LogError::UnknownChannel {
            file: file.into(),
            channel: column.into(),
            closest: super::error::closest(column, names()).map(Into::into),
            existing: names().map(Into::into).collect(),
        })
    }

    fn check_length(&self, lines: &Lines<'_>) -> Result<(), LogError> {
        let (expected, found) = (self.columns.len() + 1, lines.cells.len());
        if expected == found { Ok(()) } else { Err(LogError::RowLength { file: lines.file.into(), row: lines.row, expected, found }) }
    }
}

/// What one cell holds.
enum Cell {
    Number(f64),
    Missing,
    NotFinite,
    Text,
}

fn parse(cell: &[u8]) -> Cell {
    if cell.is_empty() {
        return Cell::Missing;
    }
    match std::str::from_utf8(cell).ok().and_then(|text| text.parse::<f64>().ok()) {
        Some(x) if x.is_finite() => Cell::Number(x),
        Some(_) => Cell::NotFinite,
        None => Cell::Text,
    }
}

/// A log that is being read.
struct Part {
    source: String,
    time_s: Vec<f64>,
    columns: Vec<Column>,
    rows: Rows,
}

/// A column that is being read: numbers up to the first cell that is none.
#[derive(Default)]
struct Column {
    values: Vec<f64>,
    present: Option<Vec<bool>>,
    refused: Option<LogError>,
}

impl Column {
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

impl Part {
    fn new(source: String, header: &Header) -> Self {
        let columns = header.columns.iter().map(|_| Column::default()).collect();
        Self { source, time_s: Vec::new(), columns, rows: Rows::new(Origin::File) }
    }

    /// Adds the current line as a sample.
    fn push(&mut self, lines: &Lines<'_>, header: &Header) -> Result<(), LogError> {
        header.check_length(lines)?;
        let row = lines.row;
        let file = || self.source.clone();
        let not_a_number =
            |channel: &str, cell| LogError::NotANumber { file: file(), place: Place::Row(row), channel: channel.into(), text: shown(cell) };
        let not_finite =
            |channel: &str, cell| LogError::NotFinite { file: file(), place: Place::Row(row), channel: channel.into(), text: shown(cell) };
        let time = lines.cell(0);
        let time_s = match parse(time) {
            Cell::Number(time_s) => time_s,
            Cell::Missing => return Err(LogError::EmptyTime { file: file(), row }),
            Cell::NotFinite => return Err(not_finite("time", time)),
            Cell::Text => return Err(not_a_number("time", time)),
        };
        time_follows(&self.source, || Place::Row(row), self.time_s.last().copied(), time_s)?;
        self.rows.note(self.time_s.len(), row);
        self.time_s.push(time_s);
        let places = self.columns.iter_mut().zip(&header.columns).enumerate();
        for (place, (column, (name, _))) in places.filter(|(_, (column, _))| column.refused.is_none()) {
            let cell = lines.cell(place + 1);
            match parse(cell) {
                Cell::Number(x) => column.push(Some(x)),
                Cell::Missing => column.push(None),
                Cell::NotFinite => column.refuse(not_finite(name, cell)),
                Cell::Text => column.refuse(not_a_number(name, cell)),
            }
        }
        Ok(())
    }

    fn finish(mut self, header: &Header) -> Result<Log, LogError> {
        self.time_s.shrink_to_fit();
        let (mut channels, mut unusable) = (Vec::new(), Vec::new());
        for (column, (name, unit)) in self.columns.into_iter().zip(&header.columns) {
            if let Some(error) = column.refused {
                unusable.push(Unusable { name: name.clone(), error });
                continue;
            }
            let Column { mut values, mut present, .. } = column;
            values.shrink_to_fit();
            present.iter_mut().for_each(Vec::shrink_to_fit);
            channels.push(Channel { name: name.clone(), unit: unit.clone(), values, present });
        }
        Log::assemble(self.source, self.time_s, channels, unusable, self.rows)
    }
}

/// A cell as a message shows it.
fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(cell);
    if text.chars().count() <= SHOWN { text.into_owned() } else { text.chars().take(SHOWN).chain(['…']).collect() }
}

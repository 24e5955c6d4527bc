//! A text log that still grows: the rows added since the last read.
//!
//! Wrong when: a file is written anew with the same first kilobyte and at least as many bytes as were read. Such a file is treated as the same file. Also wrong
//! when the stamps of a replacing file have another origin than the column's first.

use deadtime_signal::remedy::Message;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::clock::StampReader;
use super::header::Header;
use super::lines::{GZIP_MAGIC, LONGEST_LINE, Lines, Separator};
use super::utf16::byte_order;
use crate::channels::time_follows;
use crate::error::{Error, LogError};
use crate::options::ReadOptions;
use crate::place::Place;
use crate::reader::regular;

/// Bytes that are read at once.
const CHUNK: u64 = 1 << 20;
/// Bytes by which a file is known again.
const HEAD: usize = 1024;
/// Rows from which the unit of time is inferred, where neither the caller nor the header gives it.
const SETTLE: usize = 20;
/// Rows behind the time of those before them, and in order, that make a new run of the recorder.
const RUN: usize = 5;

/// A sample that was added.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its line in the file; the header's is 1.
    pub row: usize,
    /// Its stamp, s; counted from the file's first where stamps are dates.
    pub time_s: f64,
    /// The wanted columns; `None` where a cell is empty.
    pub values: Vec<Option<f64>>,
}

/// The news of one read.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// A sample.
    Row(Row),
    /// A row that is no sample, and why.
    Bad(LogError),
    /// A guess, as a sentence.
    Note(Message),
    /// The file was cut, or another file has its name: reading restarts at its beginning.
    Replaced,
    /// Time runs back for good: the recorder began again.
    TimeBegins {
        /// The first row of the new run.
        row: usize,
    },
}

/// The result of one read of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Polled {
    /// In the file's order.
    pub news: Vec<News>,
    /// There was something new, and there may be more already.
    pub grown: bool,
}

/// Reads the added rows of a text log. Only whole lines are read; memory is bounded by the longest line.
#[derive(Debug)]
pub struct Follower {
    path: PathBuf,
    source: String,
    columns: Vec<String>,
    options: ReadOptions,
    file: File,
    /// Bytes read of the file.
    at: u64,
    /// Its first bytes.
    head: Vec<u8>,
    /// Bytes of which no row was made yet.
    pending: Vec<u8>,
    /// Lines of which rows were made.
    lines: usize,
    header: Option<(Header, Vec<usize>)>,
    time: Time,
}

/// The time stamps, across files that follow each other.
#[derive(Debug, Default)]
struct Time {
    column: String,
    stamps: StampReader,
    per_second: Option<f64>,
    last: Option<f64>,
    /// No row of this file was read yet.
    fresh: bool,
    /// Rows that wait until the unit is known.
    waiting: Vec<Row>,
    /// Rows behind the last one, in order.
    behind: Vec<Row>,
}

impl Follower {
    /// A log of text from its first row on, of which these columns are wanted. Nothing is read yet.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn open(path: &Path, columns: &[&str], options: &ReadOptions) -> Result<Self, Error> {
        regular(path)?;
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            source: path.display().to_string(),
            columns: columns.iter().map(|c| (*c).to_owned()).collect(),
            options: options.clone(),
            file,
            at: 0,
            head: Vec::new(),
            pending: Vec::new(),
            lines: 0,
            header: None,
            time: Time::default(),
        })
    }

    /// The added rows, a megabyte at most. A missing file is awaited.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`LogError`] for an unusable header, a missing column, and data that are no text.
    pub fn poll(&mut self) -> Result<Polled, Error> {
        let mut polled = Polled::default();
        // The remainder of a file that was moved is read before its replacement.
        if self.same(None)? {
            polled.grown = self.read()?;
            if !polled.grown
                && let Some(now) = self.now()?
            {
                if self.same(Some(&now))? {
                    self.file = now;
                } else {
                    self.begin(now, &mut polled);
                }
            }
        } else if let Some(now) = self.now()? {
            self.begin(now, &mut polled);
        }
        if polled.grown {
            self.rows(&mut polled.news)?;
        }
        Ok(polled)
    }

    /// The line that has no end yet, where there is one.
    #[must_use]
    pub fn unfinished(&self) -> Option<usize> {
        (!self.pending.trim_ascii().is_empty()).then_some(self.lines + 1)
    }

    /// The rows that wait for more rows, at the end of the file: no row is added any more.
    pub fn finish(&mut self) -> Vec<News> {
        let mut news = Vec::new();
        self.settle(&mut news);
        self.refuse_behind(&mut news);
        news
    }

    /// The file that has the name now; `None` while none has.
    fn now(&self) -> Result<Option<File>, Error> {
        if !self.path.exists() {
            return Ok(None);
        }
        // A pipe or a device in its place has no rows to wait for.
        regular(&self.path)?;
        Ok(File::open(&self.path).ok())
    }

    /// Whether a file, or the open one, begins with the same bytes and is no shorter than the read part.
    fn same(&self, other: Option<&File>) -> Result<bool, Error> {
        let io = |e| Error::io(&self.path, e);
        let mut file = other.unwrap_or(&self.file);
        if file.metadata().map_err(io)?.len() < self.at {
            return Ok(false);
        }
        let mut head = Vec::with_capacity(self.head.len());
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        file.take(self.head.len() as u64).read_to_end(&mut head).map_err(io)?;
        Ok(head == self.head)
    }

    /// Reads on; whether there was anything.
    fn read(&mut self) -> Result<bool, Error> {
        let io = |e| Error::io(&self.path, e);
        self.file.seek(SeekFrom::Start(self.at)).map_err(io)?;
        let before = self.pending.len();
        let read = (&self.file).take(CHUNK).read_to_end(&mut self.pending).map_err(io)?;
        self.at += read as u64;
        let more = HEAD.saturating_sub(self.head.len());
        self.head.extend(self.pending.iter().skip(before).take(more));
        Ok(read > 0)
    }

    /// Goes to the beginning of a file.
    fn begin(&mut self, file: File, polled: &mut Polled) {
        self.settle(&mut polled.news);
        self.refuse_behind(&mut polled.news);
        (self.file, self.at, self.lines, self.header) = (file, 0, 0, None);
        self.head.clear();
        self.pending.clear();
        self.time.fresh = true;
        polled.grown = true;
        polled.news.push(News::Replaced);
    }

    /// Makes rows of the lines that are whole.
    fn rows(&mut self, news: &mut Vec<News>) -> Result<(), Error> {
        let end = self.pending.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let too_long = |bytes: usize| bytes as u64 > LONGEST_LINE;
        if self.header.is_none()
            && (self.pending.starts_with(&GZIP_MAGIC) || byte_order(&self.pending).is_some())
        {
            return Err(LogError::NotText { file: self.source.clone(), row: 1 }.into());
        }
        if too_long(self.pending.len() - end) {
            let row = self.lines + 1 + self.pending.iter().filter(|byte| **byte == b'\n').count();
            return Err(LogError::NotText { file: self.source.clone(), row }.into());
        }
        let source = self.source.clone();
        let begun = self.header.is_none();
        if begun {
            let mut look = Lines::new(&source, self.pending.get(..end).unwrap_or_default())?;
            if !look.header()? || !look.has_row() {
                // A header is less informative without a row below it.
                let none = LogError::NoSamples { file: source.clone() };
                return if too_long(end) { Err(none.into()) } else { Ok(()) };
            }
        }
        let rest = self.pending.split_off(end);
        let whole = std::mem::replace(&mut self.pending, rest);
        let mut lines = if begun {
            Lines::new(&source, whole.as_slice())?
        } else {
            self.below(&source, &whole)
        };
        let mut header = match self.header.take() {
            Some((header, _)) => header,
            None => Header::read(&mut lines, &self.options)?,
        };
        let places = self
            .columns
            .iter()
            .map(|name| header.place(&source, name))
            .collect::<Result<Vec<_>, _>>()?;
        if begun && self.time.column != header.clock.column {
            self.time = Time { column: header.clock.column.clone(), ..Time::default() };
        }
        loop {
            match lines.next() {
                Ok(true) if !header.wants(&lines) => {}
                Ok(true) => match self.row(&lines, &header, &places) {
                    Ok(row) => self.take(row, &mut header, news),
                    Err(error) => news.push(News::Bad(error)),
                },
                Ok(false) => break,
                Err(Error::Log(error)) => news.push(News::Bad(error)),
                Err(error) => return Err(error),
            }
        }
        self.lines += whole.iter().filter(|byte| **byte == b'\n').count();
        news.extend(std::mem::take(&mut header.notes).into_iter().map(News::Note));
        self.header = Some((header, places));
        Ok(())
    }

    fn below<'a>(&self, source: &'a str, whole: &'a [u8]) -> Lines<'a> {
        let separator =
            self.header.as_ref().map_or(Separator::Blanks, |(header, _)| header.separator);
        Lines::rows(source, whole, separator, self.lines)
    }

    /// The current line; its time is in the file's unit.
    fn row(
        &mut self,
        lines: &Lines<'_>,
        header: &Header,
        places: &[usize],
    ) -> Result<Row, LogError> {
        header.check_length(lines)?;
        let raw = header.stamp(&self.source, lines, &mut self.time.stamps)?;
        let values = places
            .iter()
            .zip(&self.columns)
            .map(|(place, name)| header.number(&self.source, lines, *place, name));
        Ok(Row { row: lines.row, time_s: raw, values: values.collect::<Result<_, _>>()? })
    }

    /// Puts a row behind those before it, where its time allows it.
    fn take(&mut self, row: Row, header: &mut Header, news: &mut Vec<News>) {
        let raw = row.time_s;
        if raw.abs() > crate::channels::TIME_LIMIT_S {
            news.push(News::Bad(LogError::TimeRange {
                file: self.source.clone(),
                place: Place::Row(row.row),
                time_s: raw,
            }));
            return;
        }
        let fresh = std::mem::take(&mut self.time.fresh);
        if fresh && self.time.last.is_some_and(|last| raw <= last) {
            self.settle_by(header, news);
            news.push(News::TimeBegins { row: row.row });
            self.keep(row, news);
        } else if self.time.last.is_some_and(|last| raw <= last) {
            if self.time.behind.last().is_some_and(|before| raw <= before.time_s) {
                self.refuse_behind(news);
            }
            self.time.behind.push(row);
            if self.time.behind.len() < RUN {
                return;
            }
            self.settle_by(header, news);
            let run = std::mem::take(&mut self.time.behind);
            news.extend(run.first().map(|first| News::TimeBegins { row: first.row }));
            run.into_iter().for_each(|row| self.keep(row, news));
        } else {
            self.refuse_behind(news);
            self.keep(row, news);
        }
        if self.time.per_second.is_none() && self.time.waiting.len() >= SETTLE {
            self.settle_by(header, news);
        }
    }

    fn keep(&mut self, row: Row, news: &mut Vec<News>) {
        self.time.last = Some(row.time_s);
        match self.time.per_second {
            Some(scale) => news.push(News::Row(Row { time_s: row.time_s / scale, ..row })),
            None => self.time.waiting.push(row),
        }
    }

    /// Rows whose time did not go on are no samples.
    fn refuse_behind(&mut self, news: &mut Vec<News>) {
        let scale = self.time.per_second.unwrap_or(1.0);
        let last = self.time.last.map(|last| last / scale);
        for row in std::mem::take(&mut self.time.behind) {
            let refused =
                time_follows(&self.source, || Place::Row(row.row), last, row.time_s / scale);
            news.extend(refused.err().map(News::Bad));
        }
    }

    fn settle(&mut self, news: &mut Vec<News>) {
        if let Some((mut header, places)) = self.header.take() {
            self.settle_by(&mut header, news);
            self.header = Some((header, places));
        }
    }

    /// Finds out the unit of time, and lets go of the rows that waited for it.
    fn settle_by(&mut self, header: &mut Header, news: &mut Vec<News>) {
        if self.time.per_second.is_some() || self.time.waiting.is_empty() {
            return;
        }
        let raw: Vec<f64> = self.time.waiting.iter().map(|row| row.time_s).collect();
        let scale = header.settle(&self.time.stamps, &raw).per_second();
        news.extend(std::mem::take(&mut header.notes).into_iter().map(News::Note));
        self.time.per_second = Some(scale);
        let rows = std::mem::take(&mut self.time.waiting);
        news.extend(
            rows.into_iter().map(|row| News::Row(Row { time_s: row.time_s / scale, ..row })),
        );
    }
}

//! The lines of a file with their numbers, cut into cells by whatever separates columns in it.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::{GZIP_MAGIC, first_bytes};
use crate::error::Error;
use crate::log::LogError;

/// A longer line is no row of a log, whatever the file is.
pub(super) const LONGEST_LINE: u64 = 1 << 24;
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// What may separate columns, in the order in which it is tried.
const SEPARATORS: [u8; 4] = [b',', b';', b'\t', b'|'];

/// What separates the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    /// One byte each.
    Byte(u8),
    /// Any number of blanks.
    Blanks,
}

impl Separator {
    /// Whether a comma within a cell may be a decimal comma.
    pub(super) fn allows_decimal_comma(self) -> bool {
        self != Self::Byte(b',')
    }
}

/// The lines of a file, blank ones and comments left out; the current one is cut into cells.
pub(super) struct Lines<'a> {
    pub(super) file: &'a str,
    pub(super) row: usize,
    pub(super) separator: Separator,
    gzip: bool,
    reader: Box<dyn BufRead + 'a>,
    read: usize,
    ahead: VecDeque<(usize, Vec<u8>)>,
    line: Vec<u8>,
    cells: Vec<Range<usize>>,
}

impl<'a> Lines<'a> {
    pub(super) fn new(file: &'a str, mut bytes: impl Read + 'a) -> Result<Self, Error> {
        let head = first_bytes(&mut bytes).map_err(|e| Error::io(Path::new(file), e))?;
        let gzip = head == GZIP_MAGIC;
        let whole = BufReader::with_capacity(1 << 16, std::io::Cursor::new(head).chain(bytes));
        let reader: Box<dyn BufRead> =
            if gzip { Box::new(BufReader::with_capacity(1 << 18, MultiGzDecoder::new(whole))) } else { Box::new(whole) };
        let separator = Separator::Byte(b',');
        Ok(Self { file, row: 0, separator, gzip, reader, read: 0, ahead: VecDeque::new(), line: Vec::new(), cells: Vec::new() })
    }

    /// Rows below a header that was read before: plain text, the line in front of it is number `before`.
    pub(super) fn rows(file: &'a str, bytes: &'a [u8], separator: Separator, before: usize) -> Self {
        let (ahead, line, cells) = (VecDeque::new(), Vec::new(), Vec::new());
        Self { file, row: before, separator, gzip: false, reader: Box::new(bytes), read: before, ahead, line, cells }
    }

    /// A row stands below the header that was just found.
    pub(super) fn has_row(&self) -> bool {
        !self.ahead.is_empty()
    }

    /// Goes to the header row and finds out what separates columns; false when the file holds nothing. Where the first row is numbers and the comment above it has as many
    /// words, that comment is the header.
    pub(super) fn header(&mut self) -> Result<bool, Error> {
        let (mut said, mut comment) = (None, None);
        loop {
            if !self.fetch()? {
                // Nothing but comments: the last one may be meant as a header without rows.
                return Ok(false);
            }
            let text = self.line.trim_ascii();
            match (text.get(..4), text.get(4)) {
                // What spreadsheets write above the header.
                (Some(word), Some(&byte)) if word.eq_ignore_ascii_case(b"sep=") && text.len() == 5 => said = Some(byte),
                _ => match uncommented(text) {
                    Some(rest) => comment = Some((self.row, rest.to_vec())),
                    None => break,
                },
            }
        }
        let first = (self.row, std::mem::take(&mut self.line));
        let second = if self.fetch_row()? { Some((self.row, std::mem::take(&mut self.line))) } else { None };
        let below = second.as_ref().map(|(_, line)| line.as_slice());
        self.separator = said.map_or_else(|| guess(&first.1, below), Separator::Byte);
        self.take(first)?;
        let numbers = !self.cells.is_empty() && (0..self.cells.len()).all(|i| is_number(self.cell(i)));
        let header = match comment {
            Some((row, text)) if numbers => {
                let (cells, values) = (self.cells.len(), (self.row, std::mem::take(&mut self.line)));
                self.take((row, text))?;
                if self.cells.len() == cells {
                    self.ahead.push_back(values);
                } else {
                    self.take(values)?;
                }
                true
            }
            _ => true,
        };
        self.ahead.extend(second);
        Ok(header)
    }

    /// Goes to the next row; false at the end.
    pub(super) fn next(&mut self) -> Result<bool, Error> {
        if let Some(line) = self.ahead.pop_front() {
            self.take(line)?;
            return Ok(true);
        }
        if !self.fetch_row()? {
            return Ok(false);
        }
        self.cut()?;
        Ok(true)
    }

    fn take(&mut self, (row, line): (usize, Vec<u8>)) -> Result<(), Error> {
        (self.row, self.line) = (row, line);
        self.cut()
    }

    /// Reads the next line that is no comment.
    fn fetch_row(&mut self) -> Result<bool, Error> {
        while self.fetch()? {
            if uncommented(self.line.trim_ascii_start()).is_none() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Reads the next line that is not blank.
    fn fetch(&mut self) -> Result<bool, Error> {
        loop {
            self.line.clear();
            let read = self.reader.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut self.line).map_err(|e| self.refusal(e))?;
            if read == 0 {
                return Ok(false);
            }
            self.read += 1;
            self.row = self.read;
            if self.row == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
                self.line.drain(..BYTE_ORDER_MARK.len());
            }
            let endless = read as u64 == LONGEST_LINE && !self.line.ends_with(b"\n");
            if endless || self.line.contains(&0) {
                return Err(LogError::NotText { file: self.file.into(), row: self.row }.into());
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
    }

    fn refusal(&self, error: std::io::Error) -> Error {
        use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        if self.gzip && matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof) {
            LogError::Gzip { file: self.file.into(), row: self.read, reason: error.to_string() }.into()
        } else {
            Error::io(Path::new(self.file), error)
        }
    }

    /// Cuts the line into cells.
    fn cut(&mut self) -> Result<(), Error> {
        self.cells.clear();
        let separator = match self.separator {
            Separator::Blanks => {
                self.cut_at_blanks();
                return Ok(());
            }
            Separator::Byte(separator) => separator,
        };
        if self.line.contains(&b'"') {
            return self.cut_quoted(separator);
        }
        while self.line.last().is_some_and(|end| matches!(end, b'\n' | b'\r')) {
            self.line.pop();
        }
        let mut start = 0;
        for (i, _) in self.line.iter().enumerate().filter(|(_, byte)| **byte == separator) {
            self.cells.push(start..i);
            start = i + 1;
        }
        self.cells.push(start..self.line.len());
        Ok(())
    }

    fn cut_at_blanks(&mut self) {
        let mut start = None;
        for (i, byte) in self.line.iter().enumerate() {
            match (start, byte.is_ascii_whitespace()) {
                (None, false) => start = Some(i),
                // A unit in brackets belongs to the name before it.
                (Some(_), true) if self.line.get(i + 1) == Some(&b'[') => {}
                (Some(from), true) => {
                    self.cells.push(from..i);
                    start = None;
                }
                _ => {}
            }
        }
        self.cells.extend(start.map(|from| from..self.line.len()));
    }

    /// As [`Lines::cut`] for a line with quotes, which go.
    fn cut_quoted(&mut self, separator: u8) -> Result<(), Error> {
        let open = || LogError::OpenQuote { file: self.file.into(), row: self.row };
        if self.line.iter().filter(|byte| **byte == b'"').count() % 2 != 0 {
            return Err(open().into());
        }
        let mut record = ::csv::ByteRecord::new();
        let mut reader = ::csv::ReaderBuilder::new()
            .has_headers(false)
            .delimiter(separator)
            .buffer_capacity(self.line.len())
            .from_reader(self.line.as_slice());
        // Reading from memory fails in no way but at the end of a line that holds no cell.
        if !reader.read_byte_record(&mut record).unwrap_or(false) {
            return Err(open().into());
        }
        self.cells.extend((0..record.len()).filter_map(|i| record.range(i)));
        self.line.clear();
        self.line.extend_from_slice(record.as_slice());
        Ok(())
    }

    /// The number of cells in the current line.
    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// A cell of the current line without spaces around it; empty beyond the last one.
    pub(super) fn cell(&self, place: usize) -> &[u8] {
        self.cells.get(place).and_then(|cell| self.line.get(cell.clone())).unwrap_or_default().trim_ascii()
    }
}

/// The text behind a comment sign.
fn uncommented(line: &[u8]) -> Option<&[u8]> {
    let rest = line.strip_prefix(b"#").or_else(|| line.strip_prefix(b"%")).or_else(|| line.strip_prefix(b"//"))?;
    Some(rest.trim_ascii_start())
}

fn is_number(cell: &[u8]) -> bool {
    cell.is_empty() || std::str::from_utf8(cell).is_ok_and(|text| text.replace(',', ".").parse::<f64>().is_ok())
}

/// What separates the columns of a file with these first two rows: what stands in both equally often, then what is commonest in the header; blanks where nothing else does.
fn guess(header: &[u8], below: Option<&[u8]>) -> Separator {
    let found = SEPARATORS.iter().filter_map(|&byte| {
        let count = separators(header, byte);
        (count > 0).then(|| (below.is_some_and(|row| separators(row, byte) == count), count, byte))
    });
    // Of equals the first one tried wins.
    if let Some((_, _, byte)) = found.reduce(|best, next| if (next.0, next.1) > (best.0, best.1) { next } else { best }) {
        return Separator::Byte(byte);
    }
    let words = |row: &[u8]| row.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let named = words(header).iter().filter(|word| !word.starts_with(b"[")).count();
    match below.map(words) {
        _ if words(header).len() > 1 && words(header).iter().all(|word| is_number(word)) => Separator::Blanks,
        Some(row) if row.len() > 1 && row.len() == named && row.iter().any(|word| is_number(word)) => Separator::Blanks,
        _ => Separator::Byte(b','),
    }
}

/// How often a byte stands outside quotes and brackets.
fn separators(line: &[u8], separator: u8) -> usize {
    let (mut quoted, mut depth, mut count) = (false, 0_usize, 0);
    for &byte in line.trim_ascii_end() {
        match byte {
            b'"' => quoted = !quoted,
            b'[' if !quoted => depth += 1,
            b']' if !quoted => depth = depth.saturating_sub(1),
            _ if byte == separator && !quoted && depth == 0 => count += 1,
            _ => {}
        }
    }
    count
}

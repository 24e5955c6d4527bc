//! The lines of a file with their numbers, split into cells by the file's separator.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::utf16::{Utf16, byte_order};
use crate::error::{Error, LogError};

/// How a file that gzip packed begins.
pub(super) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// A longer line is no row of a log, in any file.
pub(super) const LONGEST_LINE: u64 = 1 << 24;
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// Possible separators of columns, in the order of the trials.
const SEPARATORS: [u8; 4] = [b',', b';', b'\t', b'|'];

/// The separator of the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    /// One byte each.
    Byte(u8),
    /// Any number of blanks.
    Blanks,
}

impl Separator {
    /// Names as a line that is cut into them.
    fn joined(self, names: &[String]) -> Vec<u8> {
        let line = match self {
            Self::Byte(byte) => {
                let quoted: Vec<String> =
                    names.iter().map(|name| format!("\"{}\"", name.replace('"', "\"\""))).collect();
                quoted.join(&char::from(byte).to_string())
            }
            Self::Blanks => {
                let word = |name: &String| name.replace(' ', "_").replace("_[", " [");
                names.iter().map(word).collect::<Vec<_>>().join(" ")
            }
        };
        line.into_bytes()
    }

    /// Whether a comma within a cell may be a decimal comma.
    pub(super) fn allows_decimal_comma(self) -> bool {
        self != Self::Byte(b',')
    }
}

/// How a file broke off.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Break {
    /// The gzip stream has no end; the message of the decoder.
    Gzip(String),
    /// Nothing but bytes of zero follows.
    Zeros,
}

/// A line that was read and is not the current one yet.
#[derive(Debug, Clone)]
struct Ahead {
    row: usize,
    line: Vec<u8>,
    open: bool,
}

/// The lines of a file, blank ones and comments left out; the current one is cut into cells.
pub(super) struct Lines<'a> {
    pub(super) file: &'a str,
    pub(super) row: usize,
    pub(super) separator: Separator,
    /// The current line has no end, as only the last of a file can.
    pub(super) open: bool,
    /// A file that breaks off is read up to there, instead of being refused.
    to_break: bool,
    broken: Option<Break>,
    gzip: bool,
    reader: Box<dyn BufRead + 'a>,
    read: usize,
    /// The last line that has an end.
    ended: usize,
    ahead: VecDeque<Ahead>,
    line: Vec<u8>,
    cells: Vec<Range<usize>>,
}

impl<'a> Lines<'a> {
    pub(super) fn new(file: &'a str, mut bytes: impl Read + 'a) -> Result<Self, Error> {
        let head = first_bytes(&mut bytes).map_err(|e| Error::io(Path::new(file), e))?;
        let gzip = head == GZIP_MAGIC;
        let whole = BufReader::with_capacity(1 << 16, std::io::Cursor::new(head).chain(bytes));
        let reader: Box<dyn BufRead> = if gzip {
            Box::new(BufReader::with_capacity(1 << 18, MultiGzDecoder::new(whole)))
        } else {
            Box::new(whole)
        };
        let mut lines = Self { gzip, ..Self::over(file, reader, Separator::Byte(b','), 0) };
        // An error of the first bytes comes once.
        let order = match lines.reader.fill_buf() {
            Ok(first) => byte_order(first),
            Err(error) => return Err(lines.refusal(error)),
        };
        match order {
            Some(unit) => Ok(Self {
                reader: Box::new(BufReader::new(Utf16::new(lines.reader, unit))),
                ..lines
            }),
            None => Ok(lines),
        }
    }

    /// As [`Lines::new`]; a file that breaks off is read up to there.
    pub(super) fn to_break(file: &'a str, bytes: impl Read + 'a) -> Result<Self, Error> {
        Ok(Self { to_break: true, ..Self::new(file, bytes)? })
    }

    /// Rows below a header that was read before: plain text, the line in front of them is number `before`.
    pub(super) fn rows(
        file: &'a str,
        bytes: &'a [u8],
        separator: Separator,
        before: usize,
    ) -> Self {
        Self::over(file, Box::new(bytes), separator, before)
    }

    fn over(
        file: &'a str,
        reader: Box<dyn BufRead + 'a>,
        separator: Separator,
        before: usize,
    ) -> Self {
        let (ahead, line, cells) = (VecDeque::new(), Vec::new(), Vec::new());
        let (open, to_break, broken, gzip) = (false, false, None, false);
        Self {
            file,
            row: before,
            separator,
            open,
            to_break,
            broken,
            gzip,
            reader,
            read: before,
            ended: before,
            ahead,
            line,
            cells,
        }
    }

    /// A row follows the header.
    pub(super) fn has_row(&self) -> bool {
        !self.ahead.is_empty()
    }

    /// The cells of the row below the header that was just found; it stays to be read.
    pub(super) fn below(&mut self) -> Vec<Vec<u8>> {
        let Some(next) = self.ahead.front().cloned() else { return Vec::new() };
        let here =
            (self.row, self.open, std::mem::take(&mut self.line), std::mem::take(&mut self.cells));
        let whole = self.take(next).is_ok();
        let cells = if whole {
            (0..self.len()).map(|i| self.cell(i).to_vec()).collect()
        } else {
            Vec::new()
        };
        (self.row, self.open, self.line, self.cells) = here;
        cells
    }

    /// Passes over the row below the header.
    pub(super) fn skip_below(&mut self) {
        self.ahead.pop_front();
    }

    /// Whether the file was truncated in the current line: its content is incomplete.
    pub(super) fn cut_off(&self) -> bool {
        self.open && self.broken.is_some()
    }

    /// How the file broke off, a sentence.
    pub(super) fn how_it_ends(&self) -> Option<String> {
        let up_to = format!("read up to row {}", self.ended);
        match self.broken.as_ref()? {
            Break::Gzip(reason) => Some(format!("the gzip stream is cut off ({reason}): {up_to}")),
            Break::Zeros => Some(format!(
                "zero bytes stand from row {} to the end of the file: {up_to}",
                self.ended + 1
            )),
        }
    }

    /// The message on a file without rows: the reason of the truncation, if there is one.
    pub(super) fn nothing(&self, otherwise: LogError) -> LogError {
        match &self.broken {
            Some(Break::Gzip(reason)) => {
                LogError::Gzip { file: self.file.into(), row: self.read, reason: reason.clone() }
            }
            Some(Break::Zeros) => LogError::NotText { file: self.file.into(), row: self.ended + 1 },
            None => otherwise,
        }
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
                // Lines that spreadsheets write above the header.
                (Some(word), Some(&byte))
                    if word.eq_ignore_ascii_case(b"sep=") && text.len() == 5 =>
                {
                    said = Some(byte)
                }
                _ => match uncommented(text) {
                    Some(rest) => comment = Some((self.row, rest.to_vec())),
                    None => break,
                },
            }
        }
        let first = self.ahead();
        let second = if self.fetch_row()? { Some(self.ahead()) } else { None };
        let below = second.as_ref().map(|next| next.line.as_slice());
        self.separator = said.map_or_else(|| guess(&first.line, below), Separator::Byte);
        self.take(first)?;
        let numbers =
            !self.cells.is_empty() && (0..self.cells.len()).all(|i| is_number(self.cell(i)));
        let header = match comment {
            Some((row, text)) if numbers => {
                let (cells, values) = (self.cells.len(), self.ahead());
                self.take(Ahead { row, line: text, open: false })?;
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

    /// Takes these names as the header of a file without one; false when the file holds nothing.
    pub(super) fn named(&mut self, names: &[String]) -> Result<bool, Error> {
        if !self.fetch_row()? {
            return Ok(false);
        }
        let first = self.ahead();
        let second = if self.fetch_row()? { Some(self.ahead()) } else { None };
        self.separator = guess(&first.line, second.as_ref().map(|next| next.line.as_slice()));
        let line = self.separator.joined(names);
        self.ahead.push_back(first);
        self.ahead.extend(second);
        self.take(Ahead { row: 1, line, open: false })?;
        Ok(true)
    }

    /// Uses the next line as the header in place of the current one; false at the end.
    pub(super) fn header_below(&mut self) -> Result<bool, Error> {
        let first = match self.ahead.pop_front() {
            Some(line) => line,
            None if self.fetch_row()? => self.ahead(),
            None => return Ok(false),
        };
        if self.ahead.is_empty() && self.fetch_row()? {
            let second = self.ahead();
            self.ahead.push_back(second);
        }
        let below = self.ahead.front().map(|next| next.line.as_slice());
        self.separator = guess(&first.line, below);
        self.take(first)?;
        Ok(true)
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
        self.cut_or_break()?;
        Ok(true)
    }

    fn take(&mut self, next: Ahead) -> Result<(), Error> {
        (self.row, self.line, self.open) = (next.row, next.line, next.open);
        self.cut_or_break()
    }

    /// The current line, to be taken later.
    fn ahead(&mut self) -> Ahead {
        Ahead { row: self.row, line: std::mem::take(&mut self.line), open: self.open }
    }

    /// Cuts the line into cells; into none where the file broke off within quotes.
    fn cut_or_break(&mut self) -> Result<(), Error> {
        let cut = self.cut();
        if cut.is_err() && self.to_break && self.open {
            self.cells.clear();
            return Ok(());
        }
        cut
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
            if self.broken.is_some() {
                return Ok(false);
            }
            if let Err(error) =
                self.reader.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut self.line)
            {
                self.breaks_off(error)?;
            }
            let read = self.line.len() as u64;
            if read == 0 {
                return Ok(false);
            }
            self.read += 1;
            self.row = self.read;
            self.open = !self.line.ends_with(b"\n");
            if let Some(at) = self.line.iter().position(|byte| *byte == 0) {
                if !self.zeros_from(at)? {
                    return Err(self.not_text().into());
                }
                self.line.truncate(at);
                self.broken = Some(Break::Zeros);
            } else if read == LONGEST_LINE && self.open {
                return Err(self.not_text().into());
            }
            if !self.open {
                self.ended = self.read;
            }
            if self.row == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
                self.line.drain(..BYTE_ORDER_MARK.len());
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
    }

    /// Whether only zero bytes follow from a place of the current line to the end, as after a loss of power.
    fn zeros_from(&mut self, at: usize) -> Result<bool, Error> {
        let zeros = |bytes: &[u8]| bytes.iter().all(|byte| *byte == 0);
        if !self.to_break || !self.line.get(at..).is_some_and(zeros) {
            return Ok(false);
        }
        loop {
            let (read, only) = match self.reader.fill_buf() {
                Ok(more) => (more.len(), zeros(more)),
                Err(error) => return Err(self.refusal(error)),
            };
            if read == 0 || !only {
                return Ok(only);
            }
            self.reader.consume(read);
        }
    }

    /// A gzip stream without an end is one that was cut off, where such a file may be read.
    fn breaks_off(&mut self, error: std::io::Error) -> Result<(), Error> {
        if self.to_break && self.gzip && error.kind() == std::io::ErrorKind::UnexpectedEof {
            self.broken = Some(Break::Gzip(error.to_string()));
            return Ok(());
        }
        Err(self.refusal(error))
    }

    fn refusal(&self, error: std::io::Error) -> Error {
        use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        if self.gzip && matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof) {
            LogError::Gzip { file: self.file.into(), row: self.read, reason: error.to_string() }
                .into()
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

    /// The current line has as many cells as the header.
    pub(super) fn must_have(&self, expected: usize) -> Result<(), LogError> {
        let (file, row, found) = (self.file.to_owned(), self.row, self.len());
        if found == expected {
            return Ok(());
        }
        Err(LogError::RowLength { file, row, expected, found })
    }

    /// The current line is no text.
    pub(super) fn not_text(&self) -> LogError {
        LogError::NotText { file: self.file.to_owned(), row: self.row }
    }

    /// A cell of the current line without spaces around it; empty beyond the last one.
    pub(super) fn cell(&self, place: usize) -> &[u8] {
        self.cells
            .get(place)
            .and_then(|cell| self.line.get(cell.clone()))
            .unwrap_or_default()
            .trim_ascii()
    }
}

/// The text behind a comment sign.
fn uncommented(line: &[u8]) -> Option<&[u8]> {
    let rest = line
        .strip_prefix(b"#")
        .or_else(|| line.strip_prefix(b"%"))
        .or_else(|| line.strip_prefix(b"//"))?;
    Some(rest.trim_ascii_start())
}

fn is_number(cell: &[u8]) -> bool {
    cell.is_empty()
        || std::str::from_utf8(cell).is_ok_and(|text| text.replace(',', ".").parse::<f64>().is_ok())
}

/// The separator of a file with these first two rows. Separators with equal counts in both rows come first, then the commonest in the header; blanks where no
/// other separator occurs.
fn guess(header: &[u8], below: Option<&[u8]>) -> Separator {
    let found = SEPARATORS.iter().filter_map(|&byte| {
        let count = separators(header, byte);
        (count > 0).then(|| (below.is_some_and(|row| separators(row, byte) == count), count, byte))
    });
    // Of equals the first one tried wins.
    if let Some((_, _, byte)) =
        found.reduce(|best, next| if (next.0, next.1) > (best.0, best.1) { next } else { best })
    {
        return Separator::Byte(byte);
    }
    let words = |row: &[u8]| {
        row.split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .map(<[u8]>::to_vec)
            .collect::<Vec<_>>()
    };
    let named = words(header).iter().filter(|word| !word.starts_with(b"[")).count();
    match below.map(words) {
        _ if words(header).len() > 1 && words(header).iter().all(|word| is_number(word)) => {
            Separator::Blanks
        }
        Some(row)
            if row.len() > 1 && row.len() == named && row.iter().any(|word| is_number(word)) =>
        {
            Separator::Blanks
        }
        _ => Separator::Byte(b','),
    }
}

/// The number of times that a byte occurs outside quotes and brackets.
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

/// As many bytes as tell whether gzip packed a file.
pub(super) fn first_bytes(bytes: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(GZIP_MAGIC.len());
    bytes.take(GZIP_MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(head)
}

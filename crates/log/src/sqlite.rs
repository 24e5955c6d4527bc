//! The tables of an SQLite database, row by row: what reading a bag needs, and no more.
//!
//! Source: "SQLite Database File Format". Rows behind a broken page are passed over; indices are not used.

use std::io::{Read, Seek, SeekFrom};

/// Trees deeper than this are no trees.
const DEEPEST: usize = 32;
/// No message is larger.
const LARGEST: u64 = 1 << 30;

/// A value of a row.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum SqlValue {
    Null,
    Integer(i64),
    Real,
    Bytes(Vec<u8>),
}

impl SqlValue {
    pub(super) fn integer(&self) -> Option<i64> {
        match self {
            Self::Integer(x) => Some(*x),
            Self::Null | Self::Real | Self::Bytes(_) => None,
        }
    }

    pub(super) fn bytes(&self) -> Option<&[u8]> {
        match self {
            Self::Bytes(bytes) => Some(bytes),
            Self::Null | Self::Integer(_) | Self::Real => None,
        }
    }

    pub(super) fn text(&self) -> Option<String> {
        self.bytes().map(|b| String::from_utf8_lossy(b).into_owned())
    }
}

/// A database.
pub(super) struct Database<R> {
    file: R,
    page_size: u64,
    usable: u64,
    pages: u64,
    /// The remaining pages of the current table: each belongs to one place of it.
    left: u64,
    /// Pages that could not be read.
    pub(super) lost: usize,
}

/// A table: its first page and the names of its columns.
pub(super) struct SqlTable {
    root: u64,
    columns: Vec<String>,
    /// The column of the row's number.
    key: Option<usize>,
}

impl SqlTable {
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c.eq_ignore_ascii_case(name))
    }
}

impl<R: Read + Seek> Database<R> {
    /// `None` for bytes that are no database.
    pub(super) fn open(mut file: R) -> std::io::Result<Option<Self>> {
        let length = file.seek(SeekFrom::End(0))?;
        file.seek(SeekFrom::Start(0))?;
        let mut head = Vec::new();
        file.by_ref().take(100).read_to_end(&mut head)?;
        let size = head
            .get(16..)
            .and_then(<[u8]>::first_chunk)
            .map_or(0, |b| u64::from(u16::from_be_bytes(*b)));
        let page_size = if size == 1 { 65536 } else { size };
        let reserved = head.get(20).map_or(0, |b| u64::from(*b));
        if head.len() < 100
            || page_size < 512
            || !page_size.is_power_of_two()
            || page_size < reserved + 480
        {
            return Ok(None);
        }
        Ok(Some(Self {
            file,
            page_size,
            usable: page_size - reserved,
            pages: length.div_ceil(page_size),
            left: 0,
            lost: 0,
        }))
    }

    /// A page; `None` where the file has no such page as a whole.
    fn page(&mut self, number: u64) -> Option<Vec<u8>> {
        // Pages that lead in a circle are read no further.
        let Some(left) = self.left.checked_sub(1) else {
            self.lost += 1;
            return None;
        };
        self.left = left;
        let at = number.checked_sub(1)?.checked_mul(self.page_size)?;
        let mut page = vec![0; self.page_size as usize];
        let read =
            self.file.seek(SeekFrom::Start(at)).and_then(|_| self.file.read_exact(&mut page));
        if read.is_err() {
            self.lost += 1;
            return None;
        }
        Some(page)
    }

    /// The tables with their names.
    pub(super) fn tables(&mut self) -> Vec<(String, SqlTable)> {
        let mut tables = Vec::new();
        let master = SqlTable { root: 1, columns: Vec::new(), key: None };
        self.rows(&master, &mut |row| {
            if let [kind, name, _, root, sql] = row
                && kind.text().as_deref() == Some("table")
                && let (Some(name), Some(root), Some(sql)) =
                    (name.text(), root.integer(), sql.text())
            {
                let (columns, key) = columns(&sql);
                tables.push((
                    name,
                    SqlTable { root: u64::try_from(root).unwrap_or(0), columns, key },
                ));
            }
        });
        tables
    }

    /// Hands every row of a table over, in the order of their numbers.
    pub(super) fn rows(&mut self, table: &SqlTable, take: &mut dyn FnMut(&[SqlValue])) {
        self.left = self.pages + 1;
        self.tree(table.root, table, take, 0);
    }

    fn tree(
        &mut self,
        number: u64,
        table: &SqlTable,
        take: &mut dyn FnMut(&[SqlValue]),
        depth: usize,
    ) {
        if depth > DEEPEST {
            return;
        }
        let Some(page) = self.page(number) else { return };
        let start = if number == 1 { 100 } else { 0 };
        let u16_at = |at: usize| {
            page.get(at..)
                .and_then(<[u8]>::first_chunk)
                .map_or(0, |b| usize::from(u16::from_be_bytes(*b)))
        };
        let u32_at = |at: usize| {
            page.get(at..at + 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_be_bytes)
        };
        let kind = page.get(start).copied().unwrap_or(0);
        let cells = u16_at(start + 3);
        let (head, leaf) = match kind {
            13 => (8, true),
            5 => (12, false),
            _ => {
                self.lost += 1;
                return;
            }
        };
        for i in 0..cells {
            let at = u16_at(start + head + 2 * i);
            if leaf {
                match self.cell(&page, at, table) {
                    Some(row) => take(&row),
                    None => self.lost += 1,
                }
            } else {
                self.tree(u64::from(u32_at(at)), table, take, depth + 1);
            }
        }
        if !leaf {
            self.tree(u64::from(u32_at(start + 8)), table, take, depth + 1);
        }
    }

    /// The row of a leaf's cell, with its part on further pages.
    fn cell(&mut self, page: &[u8], at: usize, table: &SqlTable) -> Option<Vec<SqlValue>> {
        let mut rest = page.get(at..)?;
        let (size, number) = (varint(&mut rest)?, varint(&mut rest)? as i64);
        if size > LARGEST || size > self.pages * self.page_size {
            return None;
        }
        let most = self.usable - 35;
        let local = if size <= most {
            size
        } else {
            let least = (self.usable - 12) * 32 / 255 - 23;
            let fitting = least + (size - least) % (self.usable - 4);
            if fitting <= most { fitting } else { least }
        };
        let mut payload = rest.get(..local as usize)?.to_vec();
        if local < size {
            let mut next =
                u32::from_be_bytes(rest.get(local as usize..local as usize + 4)?.try_into().ok()?);
            while (payload.len() as u64) < size {
                let page = self.page(u64::from(next))?;
                next = u32::from_be_bytes(page.get(..4)?.try_into().ok()?);
                let part = (size - payload.len() as u64).min(self.usable - 4) as usize;
                payload.extend(page.get(4..4 + part)?);
            }
        }
        let mut row = record(&payload)?;
        if let Some(key) = table.key.and_then(|k| row.get_mut(k)).filter(|v| **v == SqlValue::Null)
        {
            *key = SqlValue::Integer(number);
        }
        Some(row)
    }
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0_u64;
    for i in 0..9 {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        if i == 8 {
            return Some(value << 8 | u64::from(*byte));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            break;
        }
    }
    Some(value)
}

fn record(payload: &[u8]) -> Option<Vec<SqlValue>> {
    let mut rest = payload;
    let length = varint(&mut rest)? as usize;
    let taken = payload.len() - rest.len();
    let mut types = payload.get(taken..length)?;
    let mut body = payload.get(length..)?;
    let mut row = Vec::new();
    while !types.is_empty() {
        let kind = varint(&mut types)?;
        let size = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => (kind - 12) / 2,
        };
        let (bytes, after) = body.split_at_checked(usize::try_from(size).ok()?)?;
        body = after;
        row.push(match kind {
            0 => SqlValue::Null,
            7 => SqlValue::Real,
            8 => SqlValue::Integer(0),
            9 => SqlValue::Integer(1),
            1..=6 => {
                // Big-endian, the sign in the first byte.
                let sign = if bytes.first()? & 0x80 == 0 { 0 } else { -1 };
                SqlValue::Integer(bytes.iter().fold(sign, |x, b| x << 8 | i64::from(*b)))
            }
            _ => SqlValue::Bytes(bytes.to_vec()),
        });
    }
    Some(row)
}

/// The columns' names of a CREATE TABLE, and which one is the integer primary key.
fn columns(sql: &str) -> (Vec<String>, Option<usize>) {
    let inner = sql
        .split_once('(')
        .map_or("", |(_, rest)| rest.rsplit_once(')').map_or(rest, |(inner, _)| inner));
    let (mut depth, mut parts) = (0_i32, vec![String::new()]);
    for c in inner.chars() {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        match parts.last_mut() {
            Some(part) if c != ',' || depth > 0 => part.push(c),
            _ => parts.push(String::new()),
        }
    }
    let name = |part: &String| {
        part.split_whitespace()
            .next()
            .unwrap_or_default()
            .trim_matches(['"', '`', '[', ']', '\''])
            .to_owned()
    };
    let constraint = |part: &&String| {
        let word = part.split_whitespace().next().unwrap_or_default().to_uppercase();
        !["PRIMARY", "UNIQUE", "CHECK", "FOREIGN", "CONSTRAINT"].contains(&word.as_str())
    };
    let parts: Vec<&String> = parts.iter().filter(constraint).collect();
    let key = parts.iter().position(|part| {
        let words = part.to_uppercase();
        words.contains("INTEGER") && words.contains("PRIMARY KEY")
    });
    (parts.into_iter().map(name).collect(), key)
}

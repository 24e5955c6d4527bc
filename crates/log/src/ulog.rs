//! ULog, the log of PX4 autopilots: topics with numbered instances, dropouts, damaged stretches, data appended after a crash.
//!
//! Source: PX4 guide, "ULog File Format", version 1.

use std::collections::{BTreeMap, HashMap};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use super::counted::Counted;
use super::error::{Error, LogError};
use super::options::ReadOptions;
use super::recording::{Recording, Table, Topic};
use super::scalar::Scalar;
use crate::notes::Notes;

pub(super) const MAGIC: &[u8] = b"ULog\x01\x12\x35";
const NAME: &str = "ULog";
const HEADER: u64 = 16;
/// The message that recorders write now and then so that readers find back in.
const SYNC: [u8; 11] = [8, 0, b'S', 0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
const TYPES: &[u8] = b"BFIMPQARDLCSO";
/// Formats within formats deeper than this are refused.
const DEEPEST: usize = 8;
/// Bytes that are read at once; a message has 2¹⁶ + 3 at most.
const PIECE: usize = 1 << 18;
/// Bytes of a topic's messages that are kept before decoding, number by number: the size of a processor's nearest cache.
const BLOCK: usize = 1 << 14;
/// No sample of a topic is larger, as its message's length has 16 bits.
const LARGEST: usize = 1 << 16;

/// Reads a file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let io = |e| Error::io(path, e);
    let file = Counted::open(path, &options.far).map_err(io)?;
    let length = file.length();
    read(&path.display().to_string(), BufReader::with_capacity(1 << 18, file), length)
}

/// Reads `length` bytes of any source.
pub(super) fn read(
    source: &str,
    bytes: impl BufRead + Seek,
    length: u64,
) -> Result<Recording, Error> {
    let io = |e| Error::io(Path::new(source), e);
    let mut bytes = bytes;
    let mut head = Vec::new();
    bytes.by_ref().take(HEADER).read_to_end(&mut head).map_err(io)?;
    let mut file = Input::new(bytes, head.len() as u64, length);
    if head.len() < HEADER as usize || !head.starts_with(MAGIC) {
        let what = "the header is cut off; copy the file again";
        return Err(LogError::format(source, NAME, what).into());
    }
    let mut log = Ulog::default();
    loop {
        match file.message(log.next_section(file.at)).map_err(io)? {
            Next::Message(b'D') => log.sample(file.payload()),
            Next::Message(kind) => log.take(kind, file.payload()),
            Next::End => break,
            Next::Cut => {
                log.notes.push(format!(
                    "cut off at byte {} of {length}: the last message is not whole",
                    file.at
                ));
                break;
            }
            Next::Section(from) => {
                file.go_to(from).map_err(io)?;
            }
            Next::Damage => {
                let from = file.at;
                let found = file.resynchronise().map_err(io)?;
                let until = if found { format!("to {}", file.at) } else { "to the end".to_owned() };
                log.notes.push(format!("damaged from byte {from} {until}, which is left out"));
                if !found {
                    break;
                }
            }
        }
        if let Some(what) = log.refused.take() {
            return Err(LogError::format(source, NAME, what).into());
        }
    }
    log.finish(source)
}

/// The next part of a file.
enum Next {
    Message(u8),
    Section(u64),
    Damage,
    Cut,
    End,
}

/// A file in pieces: a message is read in place, and moved only where it crosses the end of a piece.
struct Input<R> {
    bytes: R,
    /// Where the next message begins.
    at: u64,
    length: u64,
    buffer: Vec<u8>,
    /// The unused part of the buffer.
    rest: Range<usize>,
    payload: Range<usize>,
}

impl<R: BufRead + Seek> Input<R> {
    fn new(bytes: R, at: u64, length: u64) -> Self {
        Self { bytes, at, length, buffer: vec![0; PIECE], rest: 0..0, payload: 0..0 }
    }

    /// The next bytes; fewer only where the file has no more.
    fn ahead(&mut self, count: usize) -> std::io::Result<&[u8]> {
        if self.rest.len() < count {
            self.buffer.copy_within(self.rest.clone(), 0);
            self.rest = 0..self.rest.len();
            while self.rest.len() < count {
                let read =
                    self.bytes.read(self.buffer.get_mut(self.rest.end..).unwrap_or_default())?;
                if read == 0 {
                    break;
                }
                self.rest.end += read;
            }
        }
        Ok(self.buffer.get(self.rest.clone()).unwrap_or_default())
    }

    fn consume(&mut self, count: usize) {
        self.rest.start += count;
        self.at += count as u64;
    }

    fn payload(&self) -> &[u8] {
        self.buffer.get(self.payload.clone()).unwrap_or_default()
    }

    fn go_to(&mut self, from: u64) -> std::io::Result<()> {
        self.bytes.seek(SeekFrom::Start(from))?;
        (self.at, self.rest) = (from, 0..0);
        Ok(())
    }

    /// Reads the next message; a section that begins at `appended` ends the one before, even within a message.
    fn message(&mut self, appended: Option<u64>) -> std::io::Result<Next> {
        let end = appended.unwrap_or(self.length).min(self.length);
        let (at, length) = (self.at, self.length);
        let ended = || match appended {
            Some(from) if from < length => Next::Section(from),
            _ if at == end => Next::End,
            _ => Next::Cut,
        };
        if at + 3 > end {
            return Ok(ended());
        }
        let Some(&[low, high, kind]) = self.ahead(3)?.first_chunk() else { return Ok(Next::Cut) };
        let size = usize::from(u16::from_le_bytes([low, high]));
        if !TYPES.contains(&kind) {
            return Ok(Next::Damage);
        }
        if at + 3 + size as u64 > end {
            return Ok(ended());
        }
        if self.ahead(3 + size)?.len() < 3 + size {
            return Ok(Next::Cut);
        }
        self.payload = self.rest.start + 3..self.rest.start + 3 + size;
        self.consume(3 + size);
        Ok(Next::Message(kind))
    }

    /// Goes to the next synchronisation message.
    fn resynchronise(&mut self) -> std::io::Result<bool> {
        let mut matched = 0;
        loop {
            let piece = self.ahead(1)?;
            if piece.is_empty() {
                return Ok(false);
            }
            let mut used = 0;
            for byte in piece {
                used += 1;
                matched = if SYNC.get(matched) == Some(byte) {
                    matched + 1
                } else {
                    usize::from(*byte == SYNC[0])
                };
                if matched == SYNC.len() {
                    break;
                }
            }
            self.consume(used);
            if matched == SYNC.len() {
                return Ok(true);
            }
        }
    }
}

/// A type of the format; letters take a byte each.
fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "int8_t" => Scalar::I8,
        "uint8_t" | "bool" | LETTER => Scalar::U8,
        "int16_t" => Scalar::I16,
        "uint16_t" => Scalar::U16,
        "int32_t" => Scalar::I32,
        "uint32_t" => Scalar::U32,
        "int64_t" => Scalar::I64,
        "uint64_t" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        _ => return None,
    })
}

/// The type of letters, without numbers.
const LETTER: &str = "char";

/// A number of a topic: where in a message, and in which column.
struct NumberField {
    kind: Scalar,
    at: usize,
    column: usize,
}

/// A topic's instance that messages refer to by a number.
struct Subscription {
    topic: usize,
    stamp: Option<(Scalar, usize)>,
    fields: Vec<NumberField>,
    /// Bytes up to the end of the last number.
    size: usize,
}

#[derive(Default)]
struct Ulog {
    formats: HashMap<String, Vec<(String, String)>>,
    sections: Vec<u64>,
    /// By their numbers.
    subscriptions: Vec<Option<Subscription>>,
    /// Per topic, the undecoded messages, one behind the other, and their subscription.
    blocks: Vec<(u16, Vec<u8>)>,
    tables: Vec<Table>,
    places: BTreeMap<(String, u8), usize>,
    dropouts: (usize, f64),
    short: usize,
    strange: usize,
    notes: Notes,
    refused: Option<String>,
}

impl Ulog {
    fn next_section(&self, at: u64) -> Option<u64> {
        self.sections.iter().copied().filter(|from| *from > at).min()
    }

    fn take(&mut self, kind: u8, payload: &[u8]) {
        match kind {
            b'B' => self.flags(payload),
            b'F' => self.format(payload),
            b'A' => self.subscribe(payload),
            b'O' => {
                self.dropouts.0 += 1;
                self.dropouts.1 += Scalar::U16.at(payload, 0).unwrap_or(0.0) / 1e3;
            }
            // Parameters, information, messages to people, synchronisation.
            _ => {}
        }
    }

    fn flags(&mut self, payload: &[u8]) {
        let incompatible = payload.get(8..16).unwrap_or_default();
        // The lowest bit means appended data; this reader knows no others.
        if incompatible.iter().enumerate().any(|(i, byte)| byte & !u8::from(i == 0) != 0) {
            self.refused =
                Some("it uses a newer version of the format than 1; convert it with pyulog".into());
            return;
        }
        let offsets = (0..3)
            .filter_map(|i| payload.get(16 + 8 * i..24 + 8 * i))
            .filter_map(|b| b.try_into().ok())
            .map(u64::from_le_bytes);
        self.sections = offsets.filter(|from| *from > HEADER).collect();
    }

    fn format(&mut self, payload: &[u8]) {
        let text = String::from_utf8_lossy(payload);
        let Some((name, fields)) = text.split_once(':') else {
            self.strange += 1;
            return;
        };
        let field = |text: &str| {
            text.trim()
                .split_once(' ')
                .map(|(kind, name)| (kind.to_owned(), name.trim().to_owned()))
        };
        self.formats.insert(name.to_owned(), fields.split(';').filter_map(field).collect());
    }

    fn subscribe(&mut self, payload: &[u8]) {
        let (Some(instance), Some(id), Some(name)) =
            (payload.first(), payload.get(1..3), payload.get(3..))
        else {
            self.strange += 1;
            return;
        };
        let name = String::from_utf8_lossy(name).into_owned();
        let mut layout = FormatNumbers { ulog: self, at: 0, numbers: Vec::new() };
        if layout.add(&name, "", 0).is_none() {
            self.notes.push(format!("{name}: its format is unknown or broken; left out"));
            return;
        }
        let numbers = layout.numbers;
        // Padding at the end is not logged.
        let size = numbers.iter().map(|(_, kind, at)| at + kind.size()).max().unwrap_or(0);
        let stamp =
            numbers.iter().find(|(path, ..)| path == "timestamp").map(|(_, kind, at)| (*kind, *at));
        if stamp.is_none() {
            self.notes.push(format!("{name}: it has no time stamps; left out"));
        }
        let topic = *self.places.entry((name.clone(), *instance)).or_insert_with(|| {
            let mut table = Table::new(name);
            for (path, kind, _) in numbers.iter().filter(|(path, ..)| path != "timestamp") {
                table.column_of(path.clone(), None, kind.none());
            }
            self.tables.push(table);
            self.blocks.push((0, Vec::new()));
            self.tables.len() - 1
        });
        let fields = numbers.iter().filter(|(path, ..)| path != "timestamp").enumerate();
        let fields = fields
            .map(|(column, (_, kind, at))| NumberField { kind: *kind, at: *at, column })
            .collect();
        let id = id.first_chunk().map_or(0, |id| u16::from_le_bytes(*id));
        // Messages of the former subscription are decoded by it.
        self.flush(topic);
        if let Some(before) =
            self.subscriptions.get(usize::from(id)).and_then(Option::as_ref).map(|s| s.topic)
        {
            self.flush(before);
        }
        if self.subscriptions.len() <= usize::from(id) {
            self.subscriptions.resize_with(usize::from(id) + 1, || None);
        }
        if let Some(place) = self.subscriptions.get_mut(usize::from(id)) {
            *place = Some(Subscription { topic, stamp, fields, size });
        }
    }

    fn sample(&mut self, payload: &[u8]) {
        let Some(id) = payload.first_chunk().map(|b| u16::from_le_bytes(*b)) else {
            self.strange += 1;
            return;
        };
        let Some(subscription) = self.subscriptions.get(usize::from(id)).and_then(Option::as_ref)
        else {
            self.strange += 1;
            return;
        };
        let data = payload.get(2..).unwrap_or_default();
        let topic = subscription.topic;
        if let (Some(message), Some(_), Some((of, block))) =
            (data.get(..subscription.size), subscription.stamp, self.blocks.get_mut(topic))
            && (*of == id || block.is_empty())
        {
            *of = id;
            block.extend_from_slice(message);
            if block.len() >= BLOCK {
                self.flush(topic);
            }
            return;
        }
        // A message that is too short, or of another number than the ones before it.
        self.flush(topic);
        let Some(subscription) = self.subscriptions.get(usize::from(id)).and_then(Option::as_ref)
        else {
            return;
        };
        let Some(table) = self.tables.get_mut(topic) else { return };
        let Some(stamp_us) = subscription.stamp.and_then(|(kind, at)| kind.at(data, at)) else {
            self.short += usize::from(subscription.stamp.is_some());
            return;
        };
        table.row(stamp_us / 1e6);
        let mut whole = true;
        for field in &subscription.fields {
            match field.kind.at(data, field.at) {
                Some(value) => table.set(field.column, value),
                None => whole = false,
            }
        }
        self.short += usize::from(!whole);
    }

    /// Decodes a topic's messages, one number of all of them after the other.
    fn flush(&mut self, topic: usize) {
        let (Some((id, block)), Some(table)) =
            (self.blocks.get_mut(topic), self.tables.get_mut(topic))
        else {
            return;
        };
        let subscription = self
            .subscriptions
            .get(usize::from(*id))
            .and_then(Option::as_ref)
            .filter(|_| !block.is_empty());
        if let Some(Subscription { stamp: Some((kind, at)), fields, size, .. }) = subscription {
            let stamps =
                block.chunks_exact((*size).max(1)).filter_map(|message| kind.at(message, *at));
            table.rows(|times| times.extend(stamps.map(|us| us / 1e6)));
            for field in fields {
                table
                    .extend(field.column, |values| field.kind.each(block, *size, field.at, values));
            }
        }
        block.clear();
    }

    fn finish(mut self, source: &str) -> Result<Recording, Error> {
        (0..self.tables.len()).for_each(|topic| self.flush(topic));
        let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
        if self.dropouts.0 > 0 {
            self.notes.push(format!(
                "{} dropouts, {:.3} s together, in which the recorder lost samples",
                self.dropouts.0, self.dropouts.1
            ));
        }
        self.notes.extend(count(
            self.short,
            "samples are shorter than their format says; what they lack is missing",
        ));
        self.notes.extend(count(self.strange, "messages make no sense and are left out"));
        let several: Vec<String> = self
            .places
            .keys()
            .filter(|(_, instance)| *instance > 0)
            .map(|(name, _)| name.clone())
            .collect();
        let mut topics: Vec<Topic> = Vec::new();
        let mut tables: Vec<Option<Table>> = self.tables.into_iter().map(Some).collect();
        for ((name, instance), place) in self.places {
            let Some(mut table) = tables.get_mut(place).and_then(Option::take) else { continue };
            if several.contains(&name) {
                table.rename(format!("{name}[{instance}]"));
            }
            topics.extend(table.finish(source, &mut self.notes)?);
        }
        Recording::of_topics(source, ("ulog", NAME), topics, self.notes)
    }
}

/// The numbers of a format, nested ones too, in the order of their bytes.
struct FormatNumbers<'a> {
    ulog: &'a Ulog,
    at: usize,
    numbers: Vec<(String, Scalar, usize)>,
}

impl FormatNumbers<'_> {
    fn add(&mut self, format: &str, prefix: &str, depth: usize) -> Option<()> {
        let fields = self.ulog.formats.get(format).filter(|_| depth < DEEPEST)?;
        for (kind, name) in fields {
            let (kind, count) = match kind.strip_suffix(']').and_then(|k| k.split_once('[')) {
                Some((kind, count)) => {
                    (kind, Some(count.parse::<usize>().ok().filter(|n| *n <= LARGEST)?))
                }
                None => (kind.as_str(), None),
            };
            let number = scalar(kind);
            if name.starts_with("_padding") || kind == LETTER {
                self.at = self.at.checked_add(number?.size().checked_mul(count.unwrap_or(1))?)?;
                continue;
            }
            for i in 0..count.unwrap_or(1) {
                let path = if count.is_some() {
                    format!("{prefix}{name}[{i}]")
                } else {
                    format!("{prefix}{name}")
                };
                match number {
                    Some(kind) => {
                        self.numbers.push((path, kind, self.at));
                        self.at += kind.size();
                    }
                    None => self.add(kind, &format!("{path}."), depth + 1)?,
                }
                if self.at > LARGEST {
                    return None;
                }
            }
        }
        Some(())
    }
}

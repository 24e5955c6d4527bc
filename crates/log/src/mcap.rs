//! MCAP: channels with schemas, messages in chunks, compressed or not.
//!
//! Source: the MCAP format specification, version 0. Records are read in file order up to the end of the data section. Checksums (CRC-32) are verified where
//! the writer set them: of every chunk, of the data section, and of the summary behind it. The counts of the summary are compared with those of the data.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use crc32fast::Hasher;
use deadtime_signal::remedy::{Message, Remedy};

use super::bag::{Bag, Schema};
use super::budget::Budget;
use super::counted::Counted;
use super::error::{Error, LogError};
use super::options::ReadOptions;
use super::recording::Recording;

pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const NAME: &str = "MCAP";
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const STATISTICS: u8 = 11;
const DATA_END: u8 = 15;
/// Bytes of a record before its content: its type and its length.
const HEAD: usize = 9;
/// Bytes of a footer before its checksum.
const FOOTER_CHECKED: usize = 16;
/// Chunks that are named when their checksum does not match; further ones are counted.
const NAMED: usize = 5;

/// Reads a file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let file = Counted::open(path, &options.far).map_err(|e| Error::io(path, e))?;
    let length = file.length();
    read(&path.display().to_string(), BufReader::with_capacity(1 << 18, file), length, options)
}

/// Reads any source of bytes, of so many at most.
pub(super) fn read(
    source: &str,
    bytes: impl BufRead,
    length: u64,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut bag = Bag::new(options, length);
    fill(source, bytes, &mut bag)?;
    bag.finish(source, "mcap", NAME)
}

/// The bytes of a file with their checksum.
struct Checked<R> {
    bytes: R,
    at: u64,
    sum: Hasher,
}

impl<R: BufRead> Checked<R> {
    /// The head of the next record; `None` at the end of the file.
    fn head(&mut self) -> std::io::Result<Option<([u8; HEAD], u8, u64)>> {
        let mut head = Vec::new();
        self.bytes.by_ref().take(HEAD as u64).read_to_end(&mut head)?;
        let Ok(head) = <[u8; HEAD]>::try_from(head) else { return Ok(None) };
        let [opcode, length @ ..] = head;
        Ok(Some((head, opcode, u64::from_le_bytes(length))))
    }

    /// The content of a record, if it is complete and within the budget.
    fn content(&mut self, length: u64, budget: &Budget, into: &mut Vec<u8>) -> std::io::Result<()> {
        into.clear();
        match budget.read(self.bytes.by_ref(), length, into) {
            Err(e) if e.kind() == std::io::ErrorKind::OutOfMemory => budget.exceed(),
            read => read?,
        }
        budget.give(into.len() as u64);
        Ok(())
    }

    fn passed(&mut self, head: &[u8; HEAD], content: &[u8]) {
        self.sum.update(head);
        self.sum.update(content);
        self.at += (HEAD + content.len()) as u64;
    }
}

/// Reads a file, perhaps one of several, into a bag.
pub(super) fn fill(source: &str, mut bytes: impl BufRead, bag: &mut Bag) -> Result<(), Error> {
    let io = |e| Error::io(Path::new(source), e);
    let mut head = Vec::new();
    bytes.by_ref().take(MAGIC.len() as u64).read_to_end(&mut head).map_err(io)?;
    if head != MAGIC {
        let what = "it does not begin as such a file does; copy it again";
        return Err(LogError::format(source, NAME, what).into());
    }
    let mut sum = Hasher::new();
    sum.update(MAGIC);
    let mut bytes = Checked { bytes, at: MAGIC.len() as u64, sum };
    let mut mcap = Mcap {
        bag,
        schemas: HashMap::new(),
        compressed: Vec::new(),
        strange: 0,
        chunks: Chunks::default(),
        messages: 0,
    };
    let ended = mcap.data(source, &mut bytes).map_err(|e| match e {
        Stopped::Io(e) => io(e),
        Stopped::Budget(e) => e.into(),
    })?;
    if ended {
        mcap.summary(&mut bytes).map_err(io)?;
    }
    mcap.notes();
    Ok(())
}

/// Why the data are not read to their end.
enum Stopped {
    Io(std::io::Error),
    Budget(LogError),
}

impl From<std::io::Error> for Stopped {
    fn from(e: std::io::Error) -> Self {
        Self::Io(e)
    }
}

/// Chunks, and those whose checksum does not match.
#[derive(Default)]
struct Chunks {
    all: u64,
    /// Where the damaged ones begin.
    damaged: Vec<u64>,
}

struct Mcap<'b> {
    bag: &'b mut Bag,
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    compressed: Vec<String>,
    strange: usize,
    chunks: Chunks,
    messages: u64,
}

impl Mcap<'_> {
    /// Reads the data section; whether it has an end.
    fn data(&mut self, source: &str, bytes: &mut Checked<impl BufRead>) -> Result<bool, Stopped> {
        let budget = self.bag.budget.clone();
        let mut content = Vec::new();
        loop {
            let at = bytes.at;
            let Some((head, opcode, length)) = bytes.head()? else {
                self.bag.notes.push(format!("cut off at byte {at}: the data have no end"));
                return Ok(false);
            };
            bytes.content(length, &budget, &mut content)?;
            budget.check(source).map_err(Stopped::Budget)?;
            let whole = content.len() as u64 == length;
            if !whole {
                self.bag.notes.push(format!(
                    "cut off at byte {}: the record that begins at byte {at} is not whole",
                    at + (HEAD + content.len()) as u64
                ));
            }
            if whole && opcode == DATA_END {
                self.data_end(&content, &bytes.sum);
            }
            if matches!(opcode, DATA_END | FOOTER) {
                if opcode == FOOTER {
                    self.bag.notes.push(format!("the data have no end before byte {at}"));
                }
                bytes.sum = Hasher::new();
                if opcode == DATA_END {
                    bytes.at += (HEAD + content.len()) as u64;
                }
                return Ok(whole && opcode == DATA_END);
            }
            // The existing part of a truncated chunk is readable.
            if whole || opcode == CHUNK {
                self.take(opcode, &content, (at, whole));
            }
            budget.check(source).map_err(Stopped::Budget)?;
            if !whole {
                return Ok(false);
            }
            bytes.passed(&head, &content);
        }
    }

    /// Compares the checksum of the data with that of the read bytes.
    fn data_end(&mut self, content: &[u8], sum: &Hasher) {
        if let Some(wanted) = Fields(content).u32().filter(|wanted| *wanted != 0)
            && wanted != sum.clone().finalize()
        {
            self.bag
                .notes
                .push("the checksum of the data does not match: they are not as they were written");
        }
    }

    /// Reads what follows the data: only the counts in it are used.
    fn summary(&mut self, bytes: &mut Checked<impl BufRead>) -> std::io::Result<()> {
        let budget = self.bag.budget.clone();
        let (mut content, mut counted) = (Vec::new(), None);
        while let Some((head, opcode, length)) = bytes.head()? {
            bytes.content(length, &budget, &mut content)?;
            if content.len() as u64 != length {
                break;
            }
            if opcode == STATISTICS {
                counted = Fields(&content).u64();
            }
            if opcode != FOOTER {
                bytes.passed(&head, &content);
                continue;
            }
            let checked = content.get(..FOOTER_CHECKED).unwrap_or_default();
            bytes.sum.update(&head);
            bytes.sum.update(checked);
            let wanted = content.get(FOOTER_CHECKED..).and_then(|rest| Fields(rest).u32());
            if wanted.is_some_and(|wanted| wanted != 0 && wanted != bytes.sum.clone().finalize()) {
                self.bag
                    .notes
                    .push("the checksum of the summary does not match; no values are read from it");
            } else if let Some(counted) = counted.filter(|n| {
                *n != self.messages && self.chunks.damaged.is_empty() && self.compressed.is_empty()
            }) {
                self.bag.notes.push(format!(
                    "{} messages were found where the file counts {counted}: parts of it are damaged",
                    self.messages
                ));
            }
            return Ok(());
        }
        self.bag
            .notes
            .push("the summary behind the data is damaged or cut off; no values are read from it");
        Ok(())
    }

    /// Adds a note on each kind of omitted record.
    fn notes(&mut self) {
        if self.strange > 0 {
            self.bag.notes.push(format!("{} records make no sense and are left out", self.strange));
        }
        for compression in &self.compressed {
            self.bag.notes.push(format!("chunks compressed by `{compression}` are not read"));
        }
        let Chunks { all, damaged } = &self.chunks;
        if damaged.is_empty() {
            return;
        }
        let places: Vec<String> = damaged.iter().take(NAMED).map(u64::to_string).collect();
        let more = if damaged.len() > NAMED { ", …" } else { "" };
        let what = format!(
            "{} of {all} chunks are not as they were written, by their checksums (at byte {}{more})",
            damaged.len(),
            places.join(", ")
        );
        self.bag.notes.push(match self.bag.unchecked {
            true => Message::from(format!("{what}; they are read all the same")),
            false => Message::from(format!("{what}; they are left out: "))
                .and(Remedy::Unchecked)
                .and(" reads them all the same"),
        });
    }

    fn take(&mut self, opcode: u8, content: &[u8], place: (u64, bool)) {
        let mut fields = Fields(content);
        let understood = match opcode {
            SCHEMA => self.schema(&mut fields),
            CHANNEL => self.channel(&mut fields),
            MESSAGE => self.message(&mut fields),
            CHUNK => self.chunk(&mut fields, place),
            // Indices, attachments, metadata.
            _ => Some(()),
        };
        self.strange += usize::from(understood.is_none());
    }

    fn schema(&mut self, fields: &mut Fields<'_>) -> Option<()> {
        let (id, name, encoding) = (fields.u16()?, fields.text()?, fields.text()?);
        let length = fields.u32()? as usize;
        self.schemas.insert(id, (name, encoding, fields.bytes(length)?.to_vec()));
        Some(())
    }

    fn channel(&mut self, fields: &mut Fields<'_>) -> Option<()> {
        let (id, schema, topic, encoding) =
            (fields.u16()?, fields.u16()?, fields.text()?, fields.text()?);
        let schema =
            self.schemas.get(&schema).map(|(name, encoding, data)| Schema { name, encoding, data });
        self.bag.topic(u64::from(id), &topic, &encoding, schema.as_ref());
        Some(())
    }

    fn message(&mut self, fields: &mut Fields<'_>) -> Option<()> {
        let (id, _sequence, log_ns, _publish_ns) =
            (fields.u16()?, fields.u32()?, fields.u64()?, fields.u64()?);
        self.messages += 1;
        self.bag.message(u64::from(id), i128::from(log_ns), fields.0);
        Some(())
    }

    fn chunk(&mut self, fields: &mut Fields<'_>, (at, whole): (u64, bool)) -> Option<()> {
        let (_from, _to, size, crc, compression) =
            (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?, fields.text()?);
        let length = usize::try_from(fields.u64()?).unwrap_or(usize::MAX);
        self.chunks.all += 1;
        let packed = fields.0.get(..length).unwrap_or(fields.0);
        let budget = self.bag.budget.clone();
        let mut records = Vec::new();
        let Some(unpacked) = unpacked(&compression, packed, size, &budget, &mut records) else {
            if !self.compressed.contains(&compression) {
                self.compressed.push(compression);
            }
            return Some(());
        };
        // A truncated chunk cannot be verified.
        let sound = crc == 0 || !whole || crc32fast::hash(&records) == crc;
        if !sound {
            self.chunks.damaged.push(at);
        }
        if sound || self.bag.unchecked {
            self.records(&records, size, unpacked, (at, crc != 0 && whole && sound));
        }
        budget.give(records.len() as u64);
        Some(())
    }

    /// Reads the records of a chunk; a note reports the lost part.
    fn records(
        &mut self,
        records: &[u8],
        size: u64,
        unpacked: Result<(), String>,
        (at, checked): (u64, bool),
    ) {
        let mut rest = Fields(records);
        while !rest.0.is_empty() {
            let Some((opcode, content)) = rest.record() else { break };
            if opcode != CHUNK {
                self.take(opcode, content, (at, true));
            }
        }
        let short = if checked { 0 } else { size.saturating_sub(records.len() as u64) };
        let lost = short + rest.0.len() as u64;
        if lost > 0 || (unpacked.is_err() && !checked) {
            let why = unpacked.err().map_or_else(String::new, |e| format!(" ({e})"));
            self.bag.notes.push(format!("the chunk at byte {at} is damaged or cut off{why}: {lost} of its {size} bytes are lost"));
        }
    }
}

/// Unpacks a chunk as far as it goes; `None` of a compression that is not known.
fn unpacked(
    compression: &str,
    packed: &[u8],
    size: u64,
    budget: &Budget,
    records: &mut Vec<u8>,
) -> Option<Result<(), String>> {
    let read = match compression {
        "" => budget.read(packed, size, records),
        "lz4" => budget.read(lz4_flex::frame::FrameDecoder::new(packed), size, records),
        "zstd" => ruzstd::decoding::StreamingDecoder::new(packed)
            .map_err(std::io::Error::other)
            .and_then(|decoder| budget.read(decoder, size, records)),
        _ => return None,
    };
    if read.as_ref().is_err_and(|e| e.kind() == std::io::ErrorKind::OutOfMemory) {
        budget.exceed();
    }
    Some(read.map_err(|e| e.to_string()))
}

/// The fields of a record, taken from the front.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        self.0.split_off(..length)
    }

    fn u16(&mut self) -> Option<u16> {
        self.bytes(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.bytes(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.bytes(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        Some(String::from_utf8_lossy(self.bytes(length)?).into_owned())
    }

    /// The next record; nothing is taken where it is not whole.
    fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let length = u64::from_le_bytes(self.0.get(1..9)?.try_into().ok()?);
        let end = usize::try_from(length).ok()?.checked_add(9)?;
        let content = self.0.get(9..end)?;
        let opcode = *self.0.first()?;
        self.0 = self.0.get(end..)?;
        Some((opcode, content))
    }
}

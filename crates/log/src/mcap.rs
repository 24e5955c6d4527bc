//! MCAP: channels with schemas, messages in chunks, compressed or plain.
//!
//! Source: the MCAP format specification, version 0. Records are read in file order up to the end of the data section; the index behind it is not needed.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::bag::{Bag, Schema};
use super::counted::Counted;
use super::error::{Error, LogError};
use super::recording::{ReadOptions, Recording};

pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const NAME: &str = "MCAP";
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const FOOTER: u8 = 2;
const DATA_END: u8 = 15;
/// A chunk is larger in no file that a recorder wrote.
const LARGEST_CHUNK: u64 = 1 << 32;

/// Reads a file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let file = Counted::open(path, &options.far).map_err(|e| Error::io(path, e))?;
    read(&path.display().to_string(), BufReader::with_capacity(1 << 18, file), options)
}

/// Reads any source of bytes.
pub(super) fn read(
    source: &str,
    bytes: impl BufRead,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut bag = Bag::new(options.stamps);
    fill(source, bytes, &mut bag)?;
    bag.finish(source, "mcap", NAME)
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
    let mut mcap = Mcap { bag, schemas: HashMap::new(), compressed: Vec::new(), strange: 0 };
    let (mut at, mut content) = (MAGIC.len() as u64, Vec::new());
    loop {
        let mut start = Vec::new();
        bytes.by_ref().take(9).read_to_end(&mut start).map_err(io)?;
        let (opcode, length) =
            match (start.first(), start.get(1..9).and_then(|b| b.try_into().ok())) {
                (Some(opcode), Some(length)) => (*opcode, u64::from_le_bytes(length)),
                _ => {
                    mcap.bag.notes.push(format!("cut off at byte {at}: the data have no end"));
                    break;
                }
            };
        if matches!(opcode, DATA_END | FOOTER) {
            break;
        }
        content.clear();
        bytes.by_ref().take(length).read_to_end(&mut content).map_err(io)?;
        let whole = content.len() as u64 == length;
        if !whole {
            mcap.bag.notes.push(format!(
                "cut off at byte {}: the record that begins at byte {at} is not whole",
                at + 9 + content.len() as u64
            ));
        }
        // Of a chunk that is cut off, what is there can be read.
        if whole || opcode == CHUNK {
            mcap.take(opcode, &content, at);
        }
        if !whole {
            break;
        }
        at += 9 + length;
    }
    if mcap.strange > 0 {
        mcap.bag.notes.push(format!("{} records make no sense and are left out", mcap.strange));
    }
    for compression in mcap.compressed {
        mcap.bag.notes.push(format!("chunks compressed by `{compression}` are not read"));
    }
    Ok(())
}

struct Mcap<'b> {
    bag: &'b mut Bag,
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    compressed: Vec<String>,
    strange: usize,
}

impl Mcap<'_> {
    fn take(&mut self, opcode: u8, content: &[u8], at: u64) {
        let mut fields = Fields(content);
        let understood = match opcode {
            SCHEMA => self.schema(&mut fields),
            CHANNEL => self.channel(&mut fields),
            MESSAGE => self.message(&mut fields),
            CHUNK => self.chunk(&mut fields, at),
            // Indices, attachments, metadata, statistics.
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
        self.bag.message(u64::from(id), i128::from(log_ns), fields.0);
        Some(())
    }

    fn chunk(&mut self, fields: &mut Fields<'_>, at: u64) -> Option<()> {
        let (_from, _to, size, _crc, compression) =
            (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?, fields.text()?);
        let _length = fields.u64()?;
        let packed = fields.0;
        let mut records = Vec::new();
        let most = size.min(LARGEST_CHUNK);
        let unpacked = match compression.as_str() {
            "" => packed.take(most).read_to_end(&mut records).map_err(|e| e.to_string()),
            "lz4" => lz4_flex::frame::FrameDecoder::new(packed)
                .take(most)
                .read_to_end(&mut records)
                .map_err(|e| e.to_string()),
            "zstd" => ruzstd::decoding::StreamingDecoder::new(packed)
                .map_err(|e| e.to_string())
                .and_then(|decoder| {
                    decoder.take(most).read_to_end(&mut records).map_err(|e| e.to_string())
                }),
            other => {
                if !self.compressed.iter().any(|c| c == other) {
                    self.compressed.push(other.to_owned());
                }
                return Some(());
            }
        };
        let mut rest = Fields(&records);
        while !rest.0.is_empty() {
            let Some((opcode, content)) = rest.record() else { break };
            if opcode != CHUNK {
                self.take(opcode, content, at);
            }
        }
        let lost = size.saturating_sub(records.len() as u64) + rest.0.len() as u64;
        if lost > 0 || unpacked.is_err() {
            let why = unpacked.err().map_or_else(String::new, |e| format!(" ({e})"));
            self.bag.notes.push(format!("the chunk at byte {at} is damaged or cut off{why}: {lost} of its {size} bytes are lost"));
        }
        Some(())
    }
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

//! The pages of a column of a Parquet file: headers, checksums, unpacking within a budget.
//!
//! Source: the Apache Parquet format, `parquet.thrift` and "Thrift compact protocol". A page whose checksum (CRC-32) does not match is left out; its rows are
//! remembered. No page unpacks to more than its header and the budget allow.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Take};
use std::sync::{Arc, Mutex, PoisonError};

use flate2::read::MultiGzDecoder;
use parquet::basic::{Compression, Encoding, Type};
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::ParquetError;

use super::budget::Budget;

type Result<T> = std::result::Result<T, ParquetError>;

/// Bytes of the largest header of a page: statistics may hold long texts.
const LARGEST_HEADER: u64 = 16 << 20;
/// Structures within structures of a header.
const DEEPEST: usize = 16;

/// Rows of a column that are not there, in order.
#[derive(Debug, Default)]
pub(super) struct Lost {
    /// Rows that were handed over before, and how many are missing then.
    pub(super) rows: Vec<(usize, usize)>,
    /// Rows that were handed over or are missing.
    passed: usize,
    /// Pages that are not as they were written.
    pub(super) pages: usize,
}

/// The common properties of all pages of a column.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    pub(super) kind: Type,
    pub(super) compression: Compression,
    pub(super) unchecked: bool,
    pub(super) budget: Budget,
    pub(super) lost: Arc<Mutex<Lost>>,
}

/// The pages of a column in a row group.
pub(super) struct Pages {
    bytes: Take<BufReader<File>>,
    chunk: Chunk,
    /// The budget of the current page and of the dictionary.
    held: [u64; 2],
}

fn wrong(what: impl Into<String>) -> ParquetError {
    ParquetError::General(what.into())
}

/// A number that is a size or a count.
fn size<T: TryFrom<i64>>(value: i64) -> Result<T> {
    T::try_from(value).map_err(|_| wrong(format!("a size of {value}")))
}

impl Pages {
    /// The pages from byte `start` on, `length` bytes.
    pub(super) fn new(file: &File, (start, length): (u64, u64), chunk: Chunk) -> Result<Self> {
        let mut file = BufReader::new(file.try_clone()?);
        file.seek(SeekFrom::Start(start))?;
        Ok(Self { bytes: file.take(length), chunk, held: [0; 2] })
    }

    fn header(&mut self) -> Result<Option<Header>> {
        if self.bytes.limit() == 0 {
            return Ok(None);
        }
        let mut thrift = Thrift { bytes: self.bytes.by_ref().take(LARGEST_HEADER) };
        Ok(Some(Header(thrift.fields(0)?)))
    }

    /// The bytes of a page in the file.
    fn packed(&mut self, header: &Header) -> Result<Vec<u8>> {
        let length: u64 = size(header.number(&[3])?)?;
        if length > self.bytes.limit() {
            return Err(ParquetError::EOF("a page is not whole".into()));
        }
        let mut packed = Vec::new();
        self.chunk
            .budget
            .read(self.bytes.by_ref(), length, &mut packed)
            .map_err(|e| self.over(e))?;
        self.chunk.budget.give(packed.len() as u64);
        if packed.len() as u64 == length {
            Ok(packed)
        } else {
            Err(ParquetError::EOF("a page is not whole".into()))
        }
    }

    fn over(&self, e: std::io::Error) -> ParquetError {
        match e.kind() {
            std::io::ErrorKind::OutOfMemory => wrong(format!(
                "a page unpacks to more than is left of {} MiB of memory",
                self.chunk.budget.limit().div_ceil(1 << 20)
            )),
            _ => e.into(),
        }
    }

    /// Unpacks the part behind the levels of a page; `plain` holds the levels.
    fn unpack(
        &mut self,
        packed: &[u8],
        length: u64,
        dictionary: bool,
        plain: &mut Vec<u8>,
    ) -> Result<()> {
        let place = usize::from(dictionary);
        if let Some(held) = self.held.get_mut(place) {
            self.chunk.budget.give(std::mem::take(held));
        }
        let before = plain.len();
        unpacked(self.chunk.compression, packed, length, &self.chunk.budget, plain)
            .map_err(|e| self.over(e))?;
        let added = (plain.len() - before) as u64;
        if let Some(held) = self.held.get_mut(place) {
            *held = added;
        }
        if added == length {
            Ok(())
        } else {
            Err(wrong(format!("a page unpacks to {added} bytes, not to {length}")))
        }
    }

    /// A page that is as it was written, or is wanted all the same; `None` of one that is left out.
    fn page(&mut self, header: &Header) -> Result<Option<Page>> {
        let packed = self.packed(header)?;
        let kind = header.number(&[1])?;
        let rows: usize = match kind {
            0 => size(header.number(&[5, 1])?)?,
            3 => size(header.number(&[8, 3])?)?,
            _ => 0,
        };
        let mut lost = self.chunk.lost.lock().unwrap_or_else(PoisonError::into_inner);
        let sum = header.number(&[4]).ok().map(|sum| sum as i32);
        if sum.is_some_and(|sum| sum.cast_unsigned() != crc32fast::hash(&packed)) {
            lost.pages += 1;
            if !self.chunk.unchecked {
                if kind == 2 {
                    return Err(wrong("the dictionary is not as it was written, by its checksum"));
                }
                let at = lost.passed;
                lost.rows.push((at, rows));
                lost.passed += rows;
                return Ok(None);
            }
        }
        lost.passed += rows;
        drop(lost);
        match kind {
            0 => self.data(header, &packed).map(Some),
            2 => self.dictionary(header, &packed).map(Some),
            3 => self.data_v2(header, &packed).map(Some),
            // An index.
            _ => Ok(None),
        }
    }

    fn data(&mut self, header: &Header, packed: &[u8]) -> Result<Page> {
        let mut plain = Vec::new();
        self.unpack(packed, size(header.number(&[2])?)?, false, &mut plain)?;
        Ok(Page::DataPage {
            buf: plain.into(),
            num_values: size(header.number(&[5, 1])?)?,
            encoding: encoding(header.number(&[5, 2])?)?,
            def_level_encoding: encoding(header.number(&[5, 3])?)?,
            rep_level_encoding: encoding(header.number(&[5, 4])?)?,
            statistics: None,
        })
    }

    fn data_v2(&mut self, header: &Header, packed: &[u8]) -> Result<Page> {
        let (length, of): (u64, u64) =
            (size(header.number(&[8, 5])?)?, size(header.number(&[8, 6])?)?);
        let whole: u64 = size(header.number(&[2])?)?;
        let behind =
            whole.checked_sub(length + of).ok_or_else(|| wrong("levels longer than their page"))?;
        let Some((levels, values)) = packed.split_at_checked(size((length + of).cast_signed())?)
        else {
            return Err(wrong("levels longer than their page"));
        };
        let mut plain = levels.to_vec();
        let is_packed = header.number(&[8, 7]).map_or(true, |is| is != 0);
        if is_packed && behind > 0 {
            self.unpack(values, behind, false, &mut plain)?;
        } else {
            plain.extend_from_slice(values);
        }
        Ok(Page::DataPageV2 {
            buf: plain.into(),
            num_values: size(header.number(&[8, 1])?)?,
            encoding: encoding(header.number(&[8, 4])?)?,
            num_nulls: size(header.number(&[8, 2])?)?,
            num_rows: size(header.number(&[8, 3])?)?,
            def_levels_byte_len: size(length.cast_signed())?,
            rep_levels_byte_len: size(of.cast_signed())?,
            is_compressed: false,
            statistics: None,
        })
    }

    fn dictionary(&mut self, header: &Header, packed: &[u8]) -> Result<Page> {
        let mut plain = Vec::new();
        self.unpack(packed, size(header.number(&[2])?)?, true, &mut plain)?;
        let count: u32 = size(header.number(&[7, 1])?)?;
        // Bytes that a value takes at least.
        let (least, most): (u64, u64) = match self.chunk.kind {
            Type::BOOLEAN => (0, 1),
            Type::INT32 | Type::FLOAT => (4, 4),
            Type::BYTE_ARRAY => (4, 32),
            _ => (8, 8),
        };
        if u64::from(count) * least > plain.len() as u64
            || !self.chunk.budget.spare(u64::from(count) * most)
        {
            return Err(wrong(format!("a dictionary of {count} values in {} bytes", plain.len())));
        }
        if let Some(held) = self.held.last_mut() {
            *held += u64::from(count) * most;
        }
        Ok(Page::DictionaryPage {
            buf: plain.into(),
            num_values: count,
            encoding: encoding(header.number(&[7, 2])?)?,
            is_sorted: false,
        })
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        self.held.into_iter().for_each(|held| self.chunk.budget.give(held));
    }
}

impl PageReader for Pages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        while let Some(header) = self.header()? {
            if let Some(page) = self.page(&header)? {
                return Ok(Some(page));
            }
        }
        Ok(None)
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        Err(wrong("pages are read in their order"))
    }

    fn skip_next_page(&mut self) -> Result<()> {
        Err(wrong("pages are read in their order"))
    }
}

impl Iterator for Pages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

/// Unpacks to `length` bytes at most.
fn unpacked(
    how: Compression,
    packed: &[u8],
    length: u64,
    budget: &Budget,
    into: &mut Vec<u8>,
) -> std::io::Result<()> {
    use std::io::Error;
    // One byte more than there should be shows that there are more.
    let most = length + 1;
    let block = |unpack: &dyn Fn(&mut [u8]) -> std::io::Result<usize>, into: &mut Vec<u8>| {
        if !budget.spare(length) {
            return Err(std::io::ErrorKind::OutOfMemory.into());
        }
        let mut plain = vec![0; usize::try_from(length).map_err(Error::other)?];
        let count = unpack(&mut plain)?;
        plain.truncate(count);
        budget.give(length - count as u64);
        into.append(&mut plain);
        Ok(())
    };
    match how {
        Compression::UNCOMPRESSED => budget.read(packed, most, into),
        Compression::GZIP(_) => budget.read(MultiGzDecoder::new(packed), most, into),
        Compression::ZSTD(_) => budget.read(
            ruzstd::decoding::StreamingDecoder::new(packed).map_err(Error::other)?,
            most,
            into,
        ),
        Compression::SNAPPY => block(
            &|to| snap::raw::Decoder::new().decompress(packed, to).map_err(Error::other),
            into,
        ),
        Compression::LZ4_RAW => {
            block(&|to| lz4_flex::block::decompress_into(packed, to).map_err(Error::other), into)
        }
        Compression::LZ4 => block(&|to| hadoop(packed, to), into).or_else(|_| {
            let before = into.len();
            // Older writers used frames, or nothing around the block.
            budget.read(lz4_flex::frame::FrameDecoder::new(packed), most, into).or_else(|_| {
                budget.give((into.len() - before) as u64);
                into.truncate(before);
                block(
                    &|to| lz4_flex::block::decompress_into(packed, to).map_err(Error::other),
                    into,
                )
            })
        }),
        Compression::BROTLI(_) | Compression::LZO => Err(std::io::ErrorKind::Unsupported.into()),
    }
}

/// LZ4 in Hadoop's form: blocks behind their sizes, unpacked and packed.
fn hadoop(mut packed: &[u8], mut to: &mut [u8]) -> std::io::Result<usize> {
    let damaged = || std::io::Error::other("no blocks of LZ4");
    let mut all = 0;
    while !packed.is_empty() {
        let mut number = || {
            let (first, rest) = packed.split_first_chunk().ok_or_else(damaged)?;
            packed = rest;
            Ok::<usize, std::io::Error>(u32::from_be_bytes(*first) as usize)
        };
        let (plain, length) = (number()?, number()?);
        let block = packed.split_off(..length).ok_or_else(damaged)?;
        let (into, rest) = to.split_at_mut_checked(plain).ok_or_else(damaged)?;
        if lz4_flex::block::decompress_into(block, into).map_err(std::io::Error::other)? != plain {
            return Err(damaged());
        }
        (to, all) = (rest, all + plain);
    }
    Ok(all)
}

fn encoding(number: i64) -> Result<Encoding> {
    Ok(match number {
        0 => Encoding::PLAIN,
        2 => Encoding::PLAIN_DICTIONARY,
        3 => Encoding::RLE,
        5 => Encoding::DELTA_BINARY_PACKED,
        6 => Encoding::DELTA_LENGTH_BYTE_ARRAY,
        7 => Encoding::DELTA_BYTE_ARRAY,
        8 => Encoding::RLE_DICTIONARY,
        9 => Encoding::BYTE_STREAM_SPLIT,
        #[expect(deprecated, reason = "old files have levels in it")]
        4 => Encoding::BIT_PACKED,
        other => return Err(wrong(format!("an encoding of number {other}"))),
    })
}

/// The fields of a page's header by their numbers.
struct Header(Vec<(i16, Value)>);

/// The used part of a field.
enum Value {
    Number(i64),
    Fields(Vec<(i16, Value)>),
    Other,
}

impl Header {
    fn number(&self, path: &[i16]) -> Result<i64> {
        let mut fields = &self.0;
        for id in path {
            match fields.iter().find(|(field, _)| field == id) {
                Some((_, Value::Number(number))) => return Ok(*number),
                Some((_, Value::Fields(inner))) => fields = inner,
                _ => break,
            }
        }
        Err(wrong("the header of a page is damaged"))
    }
}

/// Thrift's compact protocol.
struct Thrift<R> {
    bytes: R,
}

impl<R: Read> Thrift<R> {
    fn byte(&mut self) -> Result<u8> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte)?;
        let [byte] = byte;
        Ok(byte)
    }

    fn varint(&mut self) -> Result<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(wrong("the header of a page is damaged"))
    }

    fn zigzag(&mut self) -> Result<i64> {
        let value = self.varint()?;
        Ok((value >> 1).cast_signed() ^ -(value & 1).cast_signed())
    }

    fn fields(&mut self, depth: usize) -> Result<Vec<(i16, Value)>> {
        let (mut fields, mut id) = (Vec::new(), 0_i16);
        loop {
            let head = self.byte()?;
            if head & 0xf == 0 {
                return Ok(fields);
            }
            id = match head >> 4 {
                0 => self.zigzag()? as i16,
                more => id.wrapping_add(i16::from(more)),
            };
            let value = match head & 0xf {
                1 => Value::Number(1),
                2 => Value::Number(0),
                kind => self.value(kind, depth)?,
            };
            if !matches!(value, Value::Other) {
                fields.push((id, value));
            }
        }
    }

    fn value(&mut self, kind: u8, depth: usize) -> Result<Value> {
        if depth > DEEPEST {
            return Err(wrong("the header of a page is damaged"));
        }
        match kind {
            1..=3 => {
                self.byte()?;
            }
            4..=6 => return Ok(Value::Number(self.zigzag()?)),
            7 => self.pass(8)?,
            8 => {
                let length = self.varint()?;
                self.pass(length)?;
            }
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
                for _ in 0..count {
                    self.value(head & 0xf, depth + 1)?;
                }
            }
            12 => return Ok(Value::Fields(self.fields(depth + 1)?)),
            _ => return Err(wrong("the header of a page is damaged")),
        }
        Ok(Value::Other)
    }

    fn pass(&mut self, length: u64) -> Result<()> {
        let passed = std::io::copy(&mut self.bytes.by_ref().take(length), &mut std::io::sink())?;
        if passed == length {
            Ok(())
        } else {
            Err(ParquetError::EOF("a header is not whole".into()))
        }
    }
}

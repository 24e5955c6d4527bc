//! Arrow IPC, files (which Feather is) and streams: every column that has one value a row.
//!
//! Source: the Arrow columnar format, "IPC File Format", by the crates of Arrow. A file is a stream between a magic word and an index. The index is not needed,
//! so that a truncated file is read up to its end. Lists have several values a row; their columns are named and left out.

use std::io::Cursor;
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType,
    DurationSecondType, Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type,
    Int64Type, Time32MillisecondType, Time32SecondType, Time64MicrosecondType,
    Time64NanosecondType, TimestampMicrosecondType, TimestampMillisecondType,
    TimestampNanosecondType, TimestampSecondType, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_ipc::reader::StreamReader;
use arrow_ipc::{Message, MessageHeader, root_as_message};
use arrow_schema::{DataType, TimeUnit as Unit};

use super::budget::Budget;
use super::columns::{Cells, Column, assemble, time_among};
use super::counted::{READING, whole};
use super::error::{Error, LogError};
use super::guard::guarded;
use super::options::{ReadOptions, TimeUnit};
use super::recording::Recording;
use crate::notes::Notes;

const NAME: &str = "Arrow IPC";
pub(super) const MAGIC: &[u8] = b"ARROW1";
/// How streams begin, and every message of them.
pub(super) const CONTINUES: &[u8] = &[0xff; 4];
/// The magic word and its padding.
const HEAD: usize = 8;
/// A buffer that declares to unpack to more than this many times its size is damaged.
const PACKED: u64 = 4096;
/// Structs within structs deeper than this are left out.
const DEEPEST: usize = 16;

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let bytes = whole(path, &options.far).map_err(|e| Error::io(path, e))?;
    options.far.at(READING, &"taking it apart");
    let begin = if bytes.starts_with(MAGIC) { HEAD } else { 0 };
    let mut notes = Notes::default();
    let budget = Budget::of(bytes.len() as u64, options);
    let end = sound(&bytes, begin, &budget, &mut notes);
    let refused = |what: String| LogError::format(source, NAME, what);
    let stream = bytes.get(begin..end).unwrap_or_default();
    let reader =
        StreamReader::try_new(Cursor::new(stream), None).map_err(|e| refused(e.to_string()))?;
    let mut columns: Vec<Column> = Vec::new();
    for field in reader.schema().fields() {
        empty(field.name(), field.data_type(), 0, &mut columns, &mut notes);
    }
    let kinds = columns.iter().map(|c| (c.name.as_str(), c.cells.unit().is_some()));
    let time = time_among(kinds, options);
    let cost: u64 = columns.iter().map(|column| column.cells.cost()).sum();
    for batch in reader {
        match batch {
            Ok(batch) if !budget.spare(cost.saturating_mul(batch.num_rows() as u64)) => {
                notes.push(budget.left_out("what comes behind the first rows"));
                break;
            }
            Ok(batch) => taken(&batch, time, &mut columns),
            Err(error) => {
                notes.push(format!("damaged ({error}): what comes behind is left out"));
                break;
            }
        }
    }
    assemble(source, "arrow", NAME, columns, notes, options)
}

/// The end of the whole messages that need no more memory than their size allows, and a note on the reason for the rest.
fn sound(bytes: &[u8], begin: usize, budget: &Budget, notes: &mut Notes) -> usize {
    let mut at = begin;
    loop {
        let number = |from: usize| {
            bytes.get(from..from + 4).and_then(|b| b.try_into().ok()).map(i32::from_le_bytes)
        };
        // Older writers leave the first word out.
        let head =
            if bytes.get(at..).is_some_and(|rest| rest.starts_with(CONTINUES)) { 8 } else { 4 };
        let Some(length) = number(at + head - 4).and_then(|n| usize::try_from(n).ok()) else {
            notes.push(format!("cut off at byte {}: the messages have no end", bytes.len()));
            return at;
        };
        if length == 0 {
            return at;
        }
        let (from, body) = (at + head, at.saturating_add(head).saturating_add(length));
        let message = bytes.get(from..body).and_then(|meta| root_as_message(meta).ok());
        let Some((message, size)) =
            message.and_then(|m| Some((m, usize::try_from(m.bodyLength()).ok()?)))
        else {
            notes.push(format!("cut off or damaged at byte {at}: what comes behind is left out"));
            return at;
        };
        let Some(content) = bytes.get(body..body.saturating_add(size)) else {
            notes.push(format!(
                "cut off at byte {}: the message that begins at byte {at} is not whole",
                bytes.len()
            ));
            return at;
        };
        let unpacked = unpacks_to(&message, content);
        if unpacked.is_some_and(|bytes| bytes > budget.room()) {
            notes.push(budget.left_out(&format!("what comes behind byte {at}")));
            return at;
        }
        if unpacked.is_none() {
            notes.push(format!("damaged at byte {at}: a buffer does not lie in its message, or unpacks to more than there can be"));
            return at;
        }
        at = body + size;
    }
}

/// The bytes to which a message unpacks by its own header. `None` where a buffer is outside of it, or unpacks to more than its limit.
fn unpacks_to(message: &Message<'_>, body: &[u8]) -> Option<u64> {
    let batch = match message.header_type() {
        MessageHeader::RecordBatch => message.header_as_record_batch(),
        MessageHeader::DictionaryBatch => {
            message.header_as_dictionary_batch().and_then(|d| d.data())
        }
        _ => None,
    };
    let Some(batch) = batch else { return Some(0) };
    let (packed, rows) =
        (batch.compression().is_some(), usize::try_from(batch.length()).unwrap_or(usize::MAX));
    // A bit a row is the least that a column takes; one of nothing takes none, and is left out.
    let fits = rows / 8 <= body.len().saturating_mul(PACKED as usize)
        || batch.buffers().is_none_or(|b| b.is_empty());
    let one = |buffer: &arrow_ipc::Buffer| {
        let range =
            usize::try_from(buffer.offset()).ok().zip(usize::try_from(buffer.length()).ok());
        let content = range.and_then(|(from, length)| body.get(from..from.checked_add(length)?))?;
        let length = content.len() as u64;
        if !packed || content.is_empty() {
            return Some(length);
        }
        match i64::from_le_bytes(content.get(..8)?.try_into().ok()?) {
            -1 => Some(length),
            n => u64::try_from(n).ok().filter(|n| *n <= PACKED * length),
        }
    };
    let buffers = batch.buffers().into_iter().flatten();
    let all = buffers.map(one).try_fold(0_u64, |sum, bytes| sum.checked_add(bytes?));
    all.filter(|_| fits)
}

/// The columns of a field before any is read: of a struct one for each of its fields.
fn empty(name: &str, kind: &DataType, depth: usize, columns: &mut Vec<Column>, notes: &mut Notes) {
    let unit = |unit: &Unit| match unit {
        Unit::Second => TimeUnit::S,
        Unit::Millisecond => TimeUnit::Ms,
        Unit::Microsecond => TimeUnit::Us,
        Unit::Nanosecond => TimeUnit::Ns,
    };
    let cells = match kind {
        DataType::Struct(fields) if depth < DEEPEST => {
            for field in fields {
                empty(
                    &format!("{name}.{}", field.name()),
                    field.data_type(),
                    depth + 1,
                    columns,
                    notes,
                );
            }
            return;
        }
        DataType::Boolean | DataType::Float16 | DataType::Float32 | DataType::Float64 => {
            Cells::Numbers(Vec::new())
        }
        DataType::Timestamp(kind, _)
        | DataType::Time32(kind)
        | DataType::Time64(kind)
        | DataType::Duration(kind) => Cells::Whole(Vec::new(), Some(unit(kind))),
        kind if kind.is_integer() => Cells::Whole(Vec::new(), None),
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => Cells::Text(Vec::new()),
        kind => {
            notes.push(format!("{name}: {kind}, which is no number; left out"));
            return;
        }
    };
    columns.push(Column { name: name.to_owned(), cells });
}

/// Appends the rows of a batch.
fn taken(batch: &RecordBatch, time: Option<usize>, columns: &mut [Column]) {
    let mut at = 0;
    for array in batch.columns() {
        of_array(array, (0, time), columns, &mut at);
    }
}

fn of_array(
    array: &ArrayRef,
    (depth, time): (usize, Option<usize>),
    columns: &mut [Column],
    at: &mut usize,
) {
    if let (DataType::Struct(_), true) = (array.data_type(), depth < DEEPEST) {
        for inner in array.as_struct_opt().map(|s| s.columns()).unwrap_or_default() {
            of_array(inner, (depth + 1, time), columns, at);
        }
        return;
    }
    let (mut none, mut unused) = (Vec::new(), Notes::default());
    // An array without a column was left out with the schema.
    empty("", array.data_type(), depth, &mut none, &mut unused);
    if none.is_empty() {
        return;
    }
    if let Some(column) = columns.get_mut(*at) {
        match &mut column.cells {
            Cells::Numbers(values) => numbers(array, values),
            Cells::Whole(values, _) => whole_numbers(array, values),
            // Text is read where it is the time.
            Cells::Text(values) if time == Some(*at) => texts(array, values),
            Cells::Text(_) => {}
        }
    }
    *at += 1;
}

fn each<T: ArrowPrimitiveType, V>(
    array: &ArrayRef,
    into: &mut Vec<Option<V>>,
    value: impl Fn(T::Native) -> Option<V>,
) {
    if let Some(values) = array.as_primitive_opt::<T>() {
        into.extend(values.iter().map(|v| v.and_then(&value)));
    }
}

fn each_number<T: ArrowPrimitiveType>(
    array: &ArrayRef,
    into: &mut Vec<f64>,
    value: impl Fn(T::Native) -> f64,
) {
    if let Some(values) = array.as_primitive_opt::<T>() {
        into.extend(values.iter().map(|v| v.map_or(f64::NAN, &value)));
    }
}

/// NaN where there is none.
fn numbers(array: &ArrayRef, into: &mut Vec<f64>) {
    match array.data_type() {
        DataType::Float16 => each_number::<Float16Type>(array, into, |v| v.to_f64()),
        DataType::Float32 => each_number::<Float32Type>(array, into, f64::from),
        DataType::Float64 => each_number::<Float64Type>(array, into, |v| v),
        _ => into.extend(
            array
                .as_boolean_opt()
                .into_iter()
                .flatten()
                .map(|v| v.map_or(f64::NAN, |on| f64::from(u8::from(on)))),
        ),
    }
}

fn whole_numbers(array: &ArrayRef, into: &mut Vec<Option<i64>>) {
    match array.data_type() {
        DataType::Int8 => each::<Int8Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::Int16 => each::<Int16Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::Int32 => each::<Int32Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::Int64 => each::<Int64Type, _>(array, into, Some),
        DataType::UInt8 => each::<UInt8Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::UInt16 => each::<UInt16Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::UInt32 => each::<UInt32Type, _>(array, into, |v| Some(i64::from(v))),
        DataType::UInt64 => each::<UInt64Type, _>(array, into, |v| i64::try_from(v).ok()),
        DataType::Timestamp(Unit::Second, _) => each::<TimestampSecondType, _>(array, into, Some),
        DataType::Timestamp(Unit::Millisecond, _) => {
            each::<TimestampMillisecondType, _>(array, into, Some)
        }
        DataType::Timestamp(Unit::Microsecond, _) => {
            each::<TimestampMicrosecondType, _>(array, into, Some)
        }
        DataType::Timestamp(Unit::Nanosecond, _) => {
            each::<TimestampNanosecondType, _>(array, into, Some)
        }
        DataType::Time32(Unit::Second) => {
            each::<Time32SecondType, _>(array, into, |v| Some(i64::from(v)))
        }
        DataType::Time32(_) => {
            each::<Time32MillisecondType, _>(array, into, |v| Some(i64::from(v)))
        }
        DataType::Time64(Unit::Microsecond) => each::<Time64MicrosecondType, _>(array, into, Some),
        DataType::Time64(_) => each::<Time64NanosecondType, _>(array, into, Some),
        DataType::Duration(Unit::Second) => each::<DurationSecondType, _>(array, into, Some),
        DataType::Duration(Unit::Millisecond) => {
            each::<DurationMillisecondType, _>(array, into, Some)
        }
        DataType::Duration(Unit::Microsecond) => {
            each::<DurationMicrosecondType, _>(array, into, Some)
        }
        _ => each::<DurationNanosecondType, _>(array, into, Some),
    }
}

fn texts(array: &ArrayRef, into: &mut Vec<Option<String>>) {
    match array.data_type() {
        DataType::LargeUtf8 => into.extend(
            array.as_string_opt::<i64>().into_iter().flatten().map(|v| v.map(str::to_owned)),
        ),
        DataType::Utf8View => into
            .extend(array.as_string_view_opt().into_iter().flatten().map(|v| v.map(str::to_owned))),
        _ => into.extend(
            array.as_string_opt::<i32>().into_iter().flatten().map(|v| v.map(str::to_owned)),
        ),
    }
}

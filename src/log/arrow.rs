//! Arrow IPC files and Feather of version 2: columns of numbers, structs of them, and lists of a fixed size.
//!
//! Source: the Apache Arrow columnar format, by the crates `arrow-ipc` and `arrow-array`.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType, DurationSecondType, Float32Type, Float64Type, Int8Type,
    Int16Type, Int32Type, Int64Type, TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, ArrowPrimitiveType, PrimitiveArray};
use arrow_ipc::reader::FileReader;
use arrow_schema::{DataType, TimeUnit as Unit};

use super::LogError;
use super::columns::{Cells, Column, assemble, guarded};
use super::recording::{ReadOptions, Recording, TimeUnit};
use crate::error::Error;

const NAME: &str = "Arrow IPC";

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let refused = |what: String| LogError::Format { file: source.to_owned(), format: NAME, what };
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let reader = FileReader::try_new(BufReader::new(file), None).map_err(|e| refused(e.to_string()))?;
    let (mut columns, mut notes) = (Vec::<Column>::new(), Vec::new());
    for (number, batch) in reader.enumerate() {
        let batch = match batch {
            Ok(batch) => batch,
            Err(error) => {
                notes.push(format!("damaged in batch {number} ({error}): read up to there"));
                break;
            }
        };
        let mut found = Vec::new();
        for (field, array) in batch.schema().fields().iter().zip(batch.columns()) {
            take(field.name(), array, &mut found, &mut notes);
        }
        if columns.is_empty() {
            columns = found;
        } else {
            columns.iter_mut().zip(found).for_each(|(whole, part)| join(&mut whole.cells, part.cells));
        }
    }
    let mut said = std::collections::HashSet::new();
    notes.retain(|note| said.insert(note.clone()));
    assemble(source, "arrow", NAME, columns, notes, options)
}

/// The next batch of a column behind those before it.
fn join(whole: &mut Cells, part: Cells) {
    match (whole, part) {
        (Cells::Numbers(whole), Cells::Numbers(part)) => whole.extend(part),
        (Cells::Whole(whole, _), Cells::Whole(part, _)) => whole.extend(part),
        (Cells::Text(whole), Cells::Text(part)) => whole.extend(part),
        _ => {}
    }
}

fn numbers<T: ArrowPrimitiveType>(array: &ArrayRef, value: impl Fn(T::Native) -> f64) -> Cells {
    Cells::Numbers(array.as_primitive::<T>().iter().map(|v| v.map(&value)).collect())
}

fn whole<T: ArrowPrimitiveType>(array: &ArrayRef, unit: Option<TimeUnit>) -> Cells
where
    T::Native: Into<i64>,
{
    let array: &PrimitiveArray<T> = array.as_primitive();
    Cells::Whole(array.iter().map(|v| v.map(Into::into)).collect(), unit)
}

/// The columns of a field: one of a number, several of a struct or of a list of a fixed size.
fn take(name: &str, array: &ArrayRef, columns: &mut Vec<Column>, notes: &mut Vec<String>) {
    let (s, ms, us, ns) = (Some(TimeUnit::S), Some(TimeUnit::Ms), Some(TimeUnit::Us), Some(TimeUnit::Ns));
    let cells = match array.data_type() {
        DataType::Boolean => Cells::Numbers(array.as_boolean().iter().map(|v| v.map(|v| f64::from(u8::from(v)))).collect()),
        DataType::Int8 => whole::<Int8Type>(array, None),
        DataType::Int16 => whole::<Int16Type>(array, None),
        DataType::Int32 => whole::<Int32Type>(array, None),
        DataType::Int64 => whole::<Int64Type>(array, None),
        DataType::UInt8 => whole::<UInt8Type>(array, None),
        DataType::UInt16 => whole::<UInt16Type>(array, None),
        DataType::UInt32 => whole::<UInt32Type>(array, None),
        // Stamps of nanoseconds since 1970 fit into the smaller half of these.
        DataType::UInt64 => match array.as_primitive::<UInt64Type>().iter().map(|v| v.map(i64::try_from).transpose()).collect() {
            Ok(values) => Cells::Whole(values, None),
            Err(_) => numbers::<UInt64Type>(array, |v| v as f64),
        },
        DataType::Float32 => numbers::<Float32Type>(array, f64::from),
        DataType::Float64 => numbers::<Float64Type>(array, |v| v),
        DataType::Timestamp(Unit::Second, _) => whole::<TimestampSecondType>(array, s),
        DataType::Timestamp(Unit::Millisecond, _) => whole::<TimestampMillisecondType>(array, ms),
        DataType::Timestamp(Unit::Microsecond, _) => whole::<TimestampMicrosecondType>(array, us),
        DataType::Timestamp(Unit::Nanosecond, _) => whole::<TimestampNanosecondType>(array, ns),
        DataType::Duration(Unit::Second) => whole::<DurationSecondType>(array, s),
        DataType::Duration(Unit::Millisecond) => whole::<DurationMillisecondType>(array, ms),
        DataType::Duration(Unit::Microsecond) => whole::<DurationMicrosecondType>(array, us),
        DataType::Duration(Unit::Nanosecond) => whole::<DurationNanosecondType>(array, ns),
        DataType::Utf8 => Cells::Text(array.as_string::<i32>().iter().map(|v| v.map(str::to_owned)).collect()),
        DataType::LargeUtf8 => Cells::Text(array.as_string::<i64>().iter().map(|v| v.map(str::to_owned)).collect()),
        DataType::Struct(fields) => {
            let parts = array.as_struct();
            for (field, part) in fields.iter().zip(parts.columns()) {
                take(&format!("{name}.{}", field.name()), part, columns, notes);
            }
            return;
        }
        DataType::FixedSizeList(_, size) => {
            let list = array.as_fixed_size_list();
            let mut inner = Vec::new();
            take(name, list.values(), &mut inner, notes);
            let size = usize::try_from(*size).unwrap_or(0);
            for column in inner {
                let part = |i: usize| -> Cells {
                    // The values of missing lists stand there too, as anything.
                    let rows = (0..list.len()).map(|row| (!list.is_null(row)).then_some(row * size + i));
                    match &column.cells {
                        Cells::Numbers(v) => Cells::Numbers(rows.map(|at| v.get(at?).copied().flatten()).collect()),
                        Cells::Whole(v, unit) => Cells::Whole(rows.map(|at| v.get(at?).copied().flatten()).collect(), *unit),
                        Cells::Text(v) => Cells::Text(rows.map(|at| v.get(at?).cloned().flatten()).collect()),
                    }
                };
                columns.extend((0..size).map(|i| Column { name: format!("{}[{i}]", column.name), cells: part(i) }));
            }
            return;
        }
        other => {
            notes.push(format!("{name}: {other}, which is no number; left out"));
            return;
        }
    };
    columns.push(Column { name: name.to_owned(), cells });
}

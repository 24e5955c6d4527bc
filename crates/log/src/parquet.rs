//! Parquet files: every leaf column that has one value a row.
//!
//! Source: the Apache Parquet format, by the crate `parquet`. Lists have several values a row; they are named and left out.

use std::fs::File;
use std::path::Path;

use ::parquet::data_type::DataType;
use ::parquet::errors::ParquetError;
use ::parquet::schema::types::ColumnDescriptor;
use parquet::basic::{Compression, LogicalType, TimeUnit as Unit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::file::reader::{FileReader, SerializedFileReader};

use super::columns::{Cells, Column, assemble, guarded};
use super::error::{Error, LogError};
use super::recording::{ReadOptions, Recording, TimeUnit};
use crate::notes::Notes;
use deadtime_signal::progress::HowFar;

const NAME: &str = "Parquet";
/// So many rows at a time.
const BATCH: usize = 65_536;

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let (columns, notes) =
        read(file, &options.far).map_err(|e| LogError::format(source, NAME, e.to_string()))?;
    assemble(source, "parquet", NAME, columns, notes, options)
}

fn read(file: File, far: &HowFar) -> Result<(Vec<Column>, Notes), ParquetError> {
    let reader = SerializedFileReader::new(file)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let packed = reader
        .metadata()
        .row_groups()
        .iter()
        .flat_map(|group| group.columns().iter().map(|column| column.compression()));
    if let Some(name) = packed.into_iter().find_map(unread) {
        let remedy = "write it again with compression=\"zstd\", \"snappy\" or \"gzip\"";
        return Err(ParquetError::General(format!(
            "compressed by {name}, which is not read; {remedy}"
        )));
    }
    let (mut columns, mut notes) = (Vec::new(), Notes::default());
    let steps = far.steps(schema.num_columns(), "reading columns");
    for (at, leaf) in schema.columns().iter().enumerate() {
        let name = leaf.path().string();
        if leaf.max_rep_level() > 0 {
            notes.push(format!("{name}: a list in every row; left out"));
            continue;
        }
        let Some(mut cells) = empty(leaf) else {
            notes.push(format!("{name}: {:?}, which is no number; left out", leaf.physical_type()));
            continue;
        };
        for group in 0..reader.num_row_groups() {
            let rows = usize::try_from(reader.metadata().row_group(group).num_rows()).unwrap_or(0);
            if let Err(error) =
                column(reader.get_row_group(group)?.get_column_reader(at)?, leaf, rows, &mut cells)
            {
                // What was whole stays; the rest of the column counts as missing.
                notes.push(format!("{name}: damaged in row group {group} ({error})"));
                break;
            }
        }
        columns.push(Column { name, cells });
        steps.one_more();
    }
    Ok((columns, notes))
}

/// The name of a compression that is not read.
fn unread(how: Compression) -> Option<&'static str> {
    match how {
        Compression::BROTLI(_) => Some("Brotli"),
        Compression::LZO => Some("LZO"),
        _ => None,
    }
}

/// The cells of a column before any is read; `None` of what is neither number nor text.
fn empty(leaf: &ColumnDescriptor) -> Option<Cells> {
    let unit = match leaf.logical_type_ref() {
        Some(LogicalType::Timestamp(kind) | LogicalType::Time(kind)) => Some(match kind.unit {
            Unit::MILLIS => TimeUnit::Ms,
            Unit::MICROS => TimeUnit::Us,
            Unit::NANOS => TimeUnit::Ns,
        }),
        Some(LogicalType::Decimal(_)) => return None,
        _ => None,
    };
    match leaf.physical_type() {
        Type::INT32 | Type::INT64 => Some(Cells::Whole(Vec::new(), unit)),
        Type::BOOLEAN | Type::FLOAT | Type::DOUBLE => Some(Cells::Numbers(Vec::new())),
        Type::BYTE_ARRAY => Some(Cells::Text(Vec::new())),
        Type::INT96 | Type::FIXED_LEN_BYTE_ARRAY => None,
    }
}

fn column(
    reader: ColumnReader,
    leaf: &ColumnDescriptor,
    rows: usize,
    cells: &mut Cells,
) -> Result<(), ParquetError> {
    let deepest = leaf.max_def_level();
    let unsigned =
        matches!(leaf.logical_type_ref(), Some(LogicalType::Integer(kind)) if !kind.is_signed);
    match (reader, cells) {
        (ColumnReader::BoolColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, |v| f64::from(u8::from(*v)))
        }
        (ColumnReader::FloatColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, |v| f64::from(*v))
        }
        (ColumnReader::DoubleColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, |v| *v)
        }
        (ColumnReader::Int32ColumnReader(r), Cells::Whole(n, _)) if unsigned => {
            values(r, deepest, rows, n, |v| i64::from(v.cast_unsigned()))
        }
        (ColumnReader::Int32ColumnReader(r), Cells::Whole(n, _)) => {
            values(r, deepest, rows, n, |v| i64::from(*v))
        }
        (ColumnReader::Int64ColumnReader(r), Cells::Whole(n, _)) => {
            values(r, deepest, rows, n, |v| *v)
        }
        (ColumnReader::ByteArrayColumnReader(r), Cells::Text(n)) => {
            values(r, deepest, rows, n, |v| String::from_utf8_lossy(v.data()).into_owned())
        }
        _ => {
            Err(ParquetError::General("its type is not the one that the file's schema says".into()))
        }
    }
}

/// Appends one value a row, nothing where the definition level says that there is none.
fn values<T: DataType, V>(
    mut reader: ColumnReaderImpl<T>,
    deepest: i16,
    rows: usize,
    into: &mut Vec<Option<V>>,
    value: impl Fn(&T::T) -> V,
) -> Result<(), ParquetError> {
    let mut left = rows;
    while left > 0 {
        let (mut found, mut levels) = (Vec::new(), Vec::new());
        let (records, ..) = reader.read_records(
            left.min(BATCH),
            (deepest > 0).then_some(&mut levels),
            None,
            &mut found,
        )?;
        if records == 0 {
            return Err(ParquetError::EOF(format!("{left} of {rows} rows are missing")));
        }
        left = left.saturating_sub(records);
        let mut found = found.iter();
        if deepest == 0 {
            into.extend(found.map(|v| Some(value(v))));
        } else {
            into.extend(
                levels
                    .iter()
                    .map(|level| if *level == deepest { found.next().map(&value) } else { None }),
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use ::parquet::data_type::DoubleType;
    use ::parquet::file::properties::WriterProperties;
    use ::parquet::file::writer::SerializedFileWriter;
    use ::parquet::schema::parser::parse_message_type;
    use parquet::basic::{BrotliLevel, GzipLevel};

    use super::*;

    #[test]
    fn pages_in_gzip_are_read_and_what_is_not_read_is_known() {
        let schema = Arc::new(
            parse_message_type("message log { required double time; required double u; }").unwrap(),
        );
        let properties =
            WriterProperties::builder().set_compression(Compression::GZIP(GzipLevel::default()));
        let mut bytes = Vec::new();
        let mut writer =
            SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties.build())).unwrap();
        let mut group = writer.next_row_group().unwrap();
        let values = |scale: f64| (0..500).map(|k| scale * f64::from(k)).collect::<Vec<_>>();
        for scale in [0.01, 2.0] {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<DoubleType>().write_batch(&values(scale), None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
        writer.close().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.parquet");
        std::fs::write(&path, bytes).unwrap();
        let log = open(&path, &ReadOptions::default()).unwrap().into_log().unwrap();
        assert_eq!(
            (log.time_s(), log.input("u").unwrap()),
            (values(0.01).as_slice(), values(2.0).as_slice())
        );
        let names =
            [Compression::BROTLI(BrotliLevel::default()), Compression::LZO, Compression::SNAPPY]
                .map(unread);
        assert_eq!(names, [Some("Brotli"), Some("LZO"), None]);
    }
}

//! Parquet files: every leaf column that has one value a row.
//!
//! Source: the Apache Parquet format, by the crate `parquet`. Lists have several values a row; they are named and left out.

use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use ::parquet::data_type::DataType;
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::ColumnChunkMetaData;
use ::parquet::schema::types::{ColumnDescPtr, ColumnDescriptor};
use parquet::basic::{Compression, LogicalType, TimeUnit as Unit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::file::reader::{FileReader, SerializedFileReader};

use super::budget::Budget;
use super::columns::{Cells, Column, assemble, time_among};
use super::error::{Error, LogError};
use super::guard::{attempted, guarded};
use super::options::{ReadOptions, TimeUnit};
use super::pages::{Chunk, Lost, Pages};
use super::recording::Recording;
use crate::notes::Notes;
use deadtime_signal::remedy::{Message, Remedy};

const NAME: &str = "Parquet";
/// The number of rows at a time.
const BATCH: usize = 65_536;

pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    guarded(&source, NAME, || whole_file(path, &source, options))
}

fn whole_file(path: &Path, source: &str, options: &ReadOptions) -> Result<Recording, Error> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let budget = Budget::of(file.metadata().map_or(0, |m| m.len()), options);
    let (columns, notes) =
        read(file, &budget, options).map_err(|e| LogError::format(source, NAME, e.to_string()))?;
    assemble(source, "parquet", NAME, columns, notes, options)
}

fn read(
    file: File,
    budget: &Budget,
    options: &ReadOptions,
) -> Result<(Vec<Column>, Notes), ParquetError> {
    let reader = SerializedFileReader::new(file.try_clone()?)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let groups = reader.metadata().row_groups();
    let packed =
        groups.iter().flat_map(|group| group.columns().iter().map(|column| column.compression()));
    if let Some(name) = packed.into_iter().find_map(unread) {
        let remedy = "write it again with compression=\"zstd\", \"snappy\" or \"gzip\"";
        return Err(ParquetError::General(format!(
            "compressed by {name}, which is not read; {remedy}"
        )));
    }
    let names: Vec<String> = schema.columns().iter().map(|leaf| leaf.path().string()).collect();
    let units: Vec<bool> = schema
        .columns()
        .iter()
        .map(|leaf| leaf.max_rep_level() == 0 && empty(leaf).is_some_and(|c| c.unit().is_some()))
        .collect();
    let time = time_among(names.iter().map(String::as_str).zip(units), options);
    let (mut columns, mut notes) = (Vec::new(), Notes::default());
    let steps = options.far.steps(schema.num_columns(), "reading columns");
    for (at, (leaf, name)) in schema.columns().iter().zip(names).enumerate() {
        if leaf.max_rep_level() > 0 {
            notes.push(format!("{name}: a list in every row; left out"));
            continue;
        }
        let Some(mut cells) = empty(leaf) else {
            notes.push(format!("{name}: {:?}, which is no number; left out", leaf.physical_type()));
            continue;
        };
        // Text is read where it is the time.
        if !matches!(cells, Cells::Text(_)) || time == Some(at) {
            let rows: u64 = groups
                .iter()
                .map(|g| u64::try_from(g.num_rows()).unwrap_or(u64::MAX))
                .fold(0, u64::saturating_add);
            if !budget.spare(rows.saturating_mul(cells.cost())) {
                notes.push(budget.left_out(&name));
                continue;
            }
            let mut of =
                Reading { file: &file, leaf, name: &name, budget, unchecked: options.unchecked };
            for (group, metadata) in groups.iter().enumerate() {
                let Some(chunk) = metadata.columns().get(at) else { break };
                let rows = usize::try_from(metadata.num_rows()).unwrap_or(0);
                if let Err(error) = of.group(group, chunk, rows, &mut cells, &mut notes) {
                    // The whole pages stay; the rest of the column is missing.
                    notes.push(format!("{name}: damaged in row group {group} ({error})"));
                    break;
                }
            }
        }
        columns.push(Column { name, cells });
        steps.one_more();
    }
    Ok((columns, notes))
}

/// A column that is read.
struct Reading<'a> {
    file: &'a File,
    leaf: &'a ColumnDescPtr,
    name: &'a str,
    budget: &'a Budget,
    unchecked: bool,
}

impl Reading<'_> {
    /// Appends the cells of a row group; rows on pages that are not as they were written are missing.
    fn group(
        &mut self,
        group: usize,
        chunk: &ColumnChunkMetaData,
        rows: usize,
        cells: &mut Cells,
        notes: &mut Notes,
    ) -> Result<(), ParquetError> {
        let lost = Arc::new(Mutex::new(Lost::default()));
        let of = Chunk {
            kind: self.leaf.physical_type(),
            compression: chunk.compression(),
            unchecked: self.unchecked,
            budget: self.budget.clone(),
            lost: lost.clone(),
        };
        let before = cells.len();
        let read = attempted(|| {
            let pages = Pages::new(self.file, chunk.byte_range(), of)?;
            let reader = get_column_reader(self.leaf.clone(), Box::new(pages));
            column(reader, self.leaf, rows, cells)
        });
        let lost = lost.lock().unwrap_or_else(PoisonError::into_inner);
        for (at, rows) in &lost.rows {
            cells.insert_missing(before + at, *rows);
        }
        if lost.pages > 0 {
            let what = format!(
                "{}: {} pages of row group {group} are not as they were written, by their checksums",
                self.name, lost.pages
            );
            notes.push(match self.unchecked {
                true => Message::from(format!("{what}; they are read all the same")),
                false => Message::from(format!(
                    "{what}; their {} rows are left out: ",
                    lost.rows.iter().map(|(_, rows)| rows).sum::<usize>()
                ))
                .and(Remedy::Unchecked)
                .and(" reads them all the same"),
            });
        }
        read.ok_or_else(|| ParquetError::General("its parts do not fit together".into()))??;
        let found = cells.len() - before;
        if found < rows {
            return Err(ParquetError::EOF(format!("{} of {rows} rows are missing", rows - found)));
        }
        Ok(())
    }
}

/// The name of a compression that is not read.
fn unread(how: Compression) -> Option<&'static str> {
    match how {
        Compression::BROTLI(_) => Some("Brotli"),
        Compression::LZO => Some("LZO"),
        _ => None,
    }
}

/// The cells of a column before any is read; `None` for a column of neither numbers nor text.
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
        Type::INT64 => Some(Cells::Whole(Vec::new(), unit)),
        Type::INT32 if unit.is_some() => Some(Cells::Whole(Vec::new(), unit)),
        Type::INT32 | Type::BOOLEAN | Type::FLOAT | Type::DOUBLE => {
            Some(Cells::Numbers(Vec::new()))
        }
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
    let none = f64::NAN;
    match (reader, cells) {
        (ColumnReader::BoolColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, none, |v| f64::from(u8::from(*v)))
        }
        (ColumnReader::FloatColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, none, |v| f64::from(*v))
        }
        (ColumnReader::DoubleColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, none, |v| *v)
        }
        (ColumnReader::Int32ColumnReader(r), Cells::Numbers(n)) if unsigned => {
            values(r, deepest, rows, n, none, |v| f64::from(v.cast_unsigned()))
        }
        (ColumnReader::Int32ColumnReader(r), Cells::Numbers(n)) => {
            values(r, deepest, rows, n, none, |v| f64::from(*v))
        }
        (ColumnReader::Int32ColumnReader(r), Cells::Whole(n, _)) => {
            values(r, deepest, rows, n, None, |v| Some(i64::from(*v)))
        }
        (ColumnReader::Int64ColumnReader(r), Cells::Whole(n, _)) => {
            values(r, deepest, rows, n, None, |v| Some(*v))
        }
        (ColumnReader::ByteArrayColumnReader(r), Cells::Text(n)) => {
            values(r, deepest, rows, n, None, |v| {
                Some(String::from_utf8_lossy(v.data()).into_owned())
            })
        }
        _ => {
            Err(ParquetError::General("its type is not the one that the file's schema says".into()))
        }
    }
}

/// Appends one value a row up to the last page, `none` where the definition level means a missing value.
fn values<T: DataType, V: Clone>(
    mut reader: ColumnReaderImpl<T>,
    deepest: i16,
    rows: usize,
    into: &mut Vec<V>,
    none: V,
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
            return Ok(());
        }
        left = left.saturating_sub(records);
        let mut found = found.iter();
        if deepest == 0 {
            into.extend(found.map(&value));
        } else {
            into.extend(levels.iter().map(|level| {
                if *level == deepest {
                    found.next().map_or(none.clone(), &value)
                } else {
                    none.clone()
                }
            }));
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

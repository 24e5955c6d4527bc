//! `estimates.parquet`: the columns of `estimates.csv`, with types.

use std::path::PathBuf;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::estimates::{Field, Sink};
use crate::file::{named, temporary};

/// Rows that are held before they are written together.
const GROUP: usize = 65_536;

/// Values of a column, and which of a number's are there.
enum Column {
    Text(Vec<ByteArray>),
    Count(Vec<i64>),
    Number(Vec<f64>, Vec<i16>),
}

/// The file.
pub(super) struct ParquetSink {
    path: PathBuf,
    /// Made with the first line, which tells the columns.
    writer: Option<SerializedFileWriter<tempfile::NamedTempFile>>,
    columns: Vec<Column>,
    rows: usize,
}

impl ParquetSink {
    pub(super) fn new(path: PathBuf) -> crate::Result<Self> {
        Ok(Self { path, writer: None, columns: Vec::new(), rows: 0 })
    }

    fn open(&mut self, fields: &[&(&'static str, Field)]) -> crate::Result<()> {
        let typed = |(name, field): &(&'static str, Field)| -> Result<TypePtr, ParquetError> {
            let column = match field {
                Field::Text(_) => Type::primitive_type_builder(name, Physical::BYTE_ARRAY).with_logical_type(Some(LogicalType::String)),
                Field::Count(_) => Type::primitive_type_builder(name, Physical::INT64),
                Field::Number(_) => Type::primitive_type_builder(name, Physical::DOUBLE),
            };
            let may_lack = if matches!(field, Field::Number(_)) { Repetition::OPTIONAL } else { Repetition::REQUIRED };
            column.with_repetition(may_lack).build().map(Arc::new)
        };
        let schema = || -> Result<TypePtr, ParquetError> {
            let columns = fields.iter().map(|f| typed(f)).collect::<Result<_, _>>()?;
            Ok(Arc::new(Type::group_type_builder("estimates").with_fields(columns).build()?))
        };
        let properties = Arc::new(WriterProperties::builder().set_compression(Compression::SNAPPY).build());
        let file = temporary(&self.path)?;
        let writer = schema().and_then(|schema| SerializedFileWriter::new(file, schema, properties)).map_err(|e| self.wrong(&e))?;
        self.writer = Some(writer);
        self.columns = fields
            .iter()
            .map(|f| match f.1 {
                Field::Text(_) => Column::Text(Vec::new()),
                Field::Count(_) => Column::Count(Vec::new()),
                Field::Number(_) => Column::Number(Vec::new(), Vec::new()),
            })
            .collect();
        Ok(())
    }

    /// Writes what is held as one row group.
    fn flush(&mut self) -> crate::Result<()> {
        if self.rows == 0 {
            return Ok(());
        }
        self.rows = 0;
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let mut write = || -> Result<(), ParquetError> {
            let mut group = writer.next_row_group()?;
            for column in &mut self.columns {
                match column {
                    Column::Text(values) => put::<ByteArrayType, _>(&mut group, &std::mem::take(values), None)?,
                    Column::Count(values) => put::<Int64Type, _>(&mut group, &std::mem::take(values), None)?,
                    Column::Number(values, there) => {
                        put::<DoubleType, _>(&mut group, &std::mem::take(values), Some(&std::mem::take(there)))?;
                    }
                }
            }
            group.close().map(|_| ())
        };
        write().map_err(|e| self.wrong(&e))
    }

    fn wrong(&self, e: &ParquetError) -> crate::Error {
        crate::Error::io(&self.path, std::io::Error::other(e.to_string()))
    }
}

fn put<T: DataType, W: std::io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    there: Option<&[i16]>,
) -> Result<(), ParquetError> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(values, there, None)?;
        column.close()?;
    }
    Ok(())
}

impl Sink for ParquetSink {
    fn write(&mut self, key: &[(&'static str, Field)], values: &[(&'static str, Field)]) -> crate::Result<()> {
        if self.writer.is_none() {
            self.open(&key.iter().chain(values).collect::<Vec<_>>())?;
        }
        for (column, (_, field)) in self.columns.iter_mut().zip(key.iter().chain(values)) {
            match (column, field) {
                (Column::Text(to), Field::Text(text)) => to.push(text.as_bytes().to_vec().into()),
                // Seeds have 53 bits, and no count is larger.
                (Column::Count(to), Field::Count(count)) => to.push(count.cast_signed()),
                (Column::Number(to, there), Field::Number(number)) => {
                    to.extend(number);
                    there.push(i16::from(number.is_some()));
                }
                _ => {}
            }
        }
        self.rows += 1;
        if self.rows >= GROUP { self.flush() } else { Ok(()) }
    }

    fn finish(mut self: Box<Self>) -> crate::Result<()> {
        self.flush()?;
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let file = writer.into_inner().map_err(|e| self.wrong(&e))?;
        named(file, &self.path)
    }
}

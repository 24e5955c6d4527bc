//! Estimates as Parquet, the columns of `estimates.csv` with types: one file, or parts of one.

use deadtime_signal::remedy::{Message, Remedy};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::error::{Error, Result, StudyError};
use super::estimates::{Field, Row, Sink};
use deadtime_delay::Outcome;
use deadtime_signal::file::Begun;

/// Rows that are held before they are written together.
const GROUP: usize = 65_536;

/// Values of a column, and which of a number's are there.
enum EstimateColumn {
    Text(Vec<ByteArray>),
    Count(Vec<i64>),
    Number(Vec<f64>, Vec<i16>),
}

/// Lines on their way to a file.
pub(super) struct EstimateTable<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    columns: Vec<EstimateColumn>,
    rows: usize,
}

impl<W: Write + Send> EstimateTable<W> {
    /// A table with the columns of `fields`, a line of it; `about` is kept in the file's footer.
    pub(super) fn new<'a>(
        file: W,
        fields: impl Iterator<Item = &'a (&'static str, Field)> + Clone,
        about: &[(&str, String)],
    ) -> Result<Self, ParquetError> {
        let typed = |(name, field): &(&'static str, Field)| -> Result<TypePtr, ParquetError> {
            let column = match field {
                Field::Text(_) => Type::primitive_type_builder(name, Physical::BYTE_ARRAY)
                    .with_logical_type(Some(LogicalType::String)),
                Field::Count(_) => Type::primitive_type_builder(name, Physical::INT64),
                Field::Number(_) => Type::primitive_type_builder(name, Physical::DOUBLE),
            };
            let may_lack = if matches!(field, Field::Number(_)) {
                Repetition::OPTIONAL
            } else {
                Repetition::REQUIRED
            };
            column.with_repetition(may_lack).build().map(Arc::new)
        };
        let columns = fields.clone().map(typed).collect::<Result<_, _>>()?;
        let schema = Arc::new(Type::group_type_builder("estimates").with_fields(columns).build()?);
        let about: Vec<KeyValue> = about
            .iter()
            .map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone()))
            .collect();
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata((!about.is_empty()).then_some(about))
            .build();
        let columns = fields
            .map(|f| match f.1 {
                Field::Text(_) => EstimateColumn::Text(Vec::new()),
                Field::Count(_) => EstimateColumn::Count(Vec::new()),
                Field::Number(_) => EstimateColumn::Number(Vec::new(), Vec::new()),
            })
            .collect();
        Ok(Self {
            writer: SerializedFileWriter::new(file, schema, Arc::new(properties))?,
            columns,
            rows: 0,
        })
    }

    /// One line.
    pub(super) fn write<'a>(
        &mut self,
        fields: impl Iterator<Item = &'a (&'static str, Field)>,
    ) -> Result<(), ParquetError> {
        for (column, (_, field)) in self.columns.iter_mut().zip(fields) {
            match (column, field) {
                (EstimateColumn::Text(to), Field::Text(text)) => {
                    to.push(text.as_bytes().to_vec().into())
                }
                // Seeds have 53 bits, and no count is larger.
                (EstimateColumn::Count(to), Field::Count(count)) => to.push(count.cast_signed()),
                (EstimateColumn::Number(to, there), Field::Number(number)) => {
                    to.extend(number);
                    there.push(i16::from(number.is_some()));
                }
                _ => {}
            }
        }
        self.rows += 1;
        if self.rows >= GROUP { self.flush() } else { Ok(()) }
    }

    /// Writes the held rows as one row group.
    fn flush(&mut self) -> Result<(), ParquetError> {
        if self.rows == 0 {
            return Ok(());
        }
        self.rows = 0;
        let mut group = self.writer.next_row_group()?;
        for column in &mut self.columns {
            match column {
                EstimateColumn::Text(values) => {
                    put::<ByteArrayType, _>(&mut group, &std::mem::take(values), None)?
                }
                EstimateColumn::Count(values) => {
                    put::<Int64Type, _>(&mut group, &std::mem::take(values), None)?
                }
                EstimateColumn::Number(values, there) => {
                    put::<DoubleType, _>(
                        &mut group,
                        &std::mem::take(values),
                        Some(&std::mem::take(there)),
                    )?;
                }
            }
        }
        group.close().map(|_| ())
    }

    pub(super) fn finish(mut self) -> Result<W, ParquetError> {
        self.flush()?;
        self.writer.into_inner()
    }
}

fn put<T: DataType, W: Write + Send>(
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

/// `estimates.parquet`.
pub(super) struct ParquetSink {
    path: PathBuf,
    /// Made with the first line, which determines the columns.
    table: Option<EstimateTable<Begun>>,
}

impl ParquetSink {
    pub(super) fn new(path: PathBuf) -> Self {
        Self { path, table: None }
    }
}

/// The error of Parquet for a written file.
pub(super) fn unwritten(path: &Path, e: &ParquetError) -> Error {
    Error::io(path, std::io::Error::other(e.to_string()))
}

impl Sink for ParquetSink {
    fn write(
        &mut self,
        key: &[(&'static str, Field)],
        values: &[(&'static str, Field)],
    ) -> Result<()> {
        let fields = key.iter().chain(values);
        let path = &self.path;
        let table = match &mut self.table {
            Some(table) => table,
            none => none.insert(
                EstimateTable::new(Begun::new(path)?, fields.clone(), &[])
                    .map_err(|e| unwritten(path, &e))?,
            ),
        };
        table.write(fields).map_err(|e| unwritten(path, &e))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let Self { path, table } = *self;
        let Some(table) = table else { return Ok(()) };
        Ok(table.finish().map_err(|e| unwritten(&path, &e))?.finish()?)
    }
}

/// A column of estimates that was read.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Words: the different ones, and which one of them every line has.
    Words(Vec<String>, Vec<i32>),
    /// Whole numbers.
    Counts(Vec<i64>),
    /// Numbers, NaN where there is none.
    Numbers(Vec<f64>),
}

/// A file of estimates that is being read.
pub(super) struct EstimateReader {
    path: PathBuf,
    file: Box<dyn FileReader>,
}

impl EstimateReader {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        let file = SerializedFileReader::new(file).map_err(|e| unread(path, &e.to_string()))?;
        Ok(Self { path: path.to_owned(), file: Box::new(file) })
    }

    /// A file with its bytes in memory.
    pub(super) fn of(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        let file = SerializedFileReader::new(bytes::Bytes::from(bytes))
            .map_err(|e| unread(path, &e.to_string()))?;
        Ok(Self { path: path.to_owned(), file: Box::new(file) })
    }

    /// The value of a name in the footer.
    pub(super) fn about(&self, name: &str) -> Option<&str> {
        let all = self.file.metadata().file_metadata().key_value_metadata()?;
        all.iter().find(|kv| kv.key == name)?.value.as_deref()
    }

    /// Names of the columns, in order.
    fn names(&self) -> Vec<String> {
        self.file
            .metadata()
            .file_metadata()
            .schema_descr()
            .columns()
            .iter()
            .map(|c| c.name().to_owned())
            .collect()
    }

    /// A column of one row group.
    fn column(&self, group: usize, name: &str) -> Result<EstimateColumn> {
        let wrong = |detail: &str| unread(&self.path, detail);
        let failed = |e: ParquetError| wrong(&e.to_string());
        let Some(at) = self.names().iter().position(|n| n == name) else {
            return Err(wrong(&format!("no column `{name}`")));
        };
        let group = self.file.get_row_group(group).map_err(failed)?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        match group.get_column_reader(at).map_err(failed)? {
            ColumnReader::ByteArrayColumnReader(mut column) => {
                Ok(EstimateColumn::Text(all(&mut column, rows, &mut Vec::new()).map_err(failed)?))
            }
            ColumnReader::Int64ColumnReader(mut column) => {
                Ok(EstimateColumn::Count(all(&mut column, rows, &mut Vec::new()).map_err(failed)?))
            }
            ColumnReader::DoubleColumnReader(mut column) => {
                let mut there = Vec::with_capacity(rows);
                let values = all(&mut column, rows, &mut there).map_err(failed)?;
                Ok(EstimateColumn::Number(values, there))
            }
            _ => Err(wrong(&format!("column `{name}` is none of an estimate's"))),
        }
    }

    /// Numbers of one row group, with those that are missing.
    fn numbers(&self, group: usize, name: &str) -> Result<Vec<Option<f64>>> {
        match self.column(group, name)? {
            EstimateColumn::Number(values, there) => Ok(spread(values, &there, |v| v).collect()),
            _ => Err(unread(&self.path, &format!("column `{name}` holds no numbers"))),
        }
    }

    fn counts(&self, group: usize, name: &str) -> Result<Vec<i64>> {
        match self.column(group, name)? {
            EstimateColumn::Count(values) => Ok(values),
            _ => Err(unread(&self.path, &format!("column `{name}` holds no counts"))),
        }
    }

    /// The estimates, in order.
    pub(super) fn rows(&self) -> Result<Vec<Row>> {
        let mut rows = Vec::new();
        let mut known: Vec<(ByteArray, Outcome)> = Vec::new();
        for group in 0..self.file.num_row_groups() {
            let cells = self.counts(group, "cell")?;
            let (trials, seeds) = (self.counts(group, "trial")?, self.counts(group, "seed")?);
            let EstimateColumn::Text(outcomes) = self.column(group, "outcome")? else {
                return Err(unread(&self.path, "column `outcome` holds no words"));
            };
            let columns =
                NUMBERS.iter().map(|name| self.numbers(group, name)).collect::<Result<Vec<_>>>()?;
            let short = || unread(&self.path, "columns of unequal lengths, or counts below 0");
            for (k, cell) in cells.iter().enumerate() {
                let outcome = self.outcome(outcomes.get(k).ok_or_else(short)?, &mut known)?;
                let at = |column: usize| {
                    columns.get(column).and_then(|c| c.get(k)).copied().ok_or_else(short)
                };
                let must = |column: usize| at(column)?.ok_or_else(short);
                let count = |value: Option<&i64>| {
                    value.and_then(|v| usize::try_from(*v).ok()).ok_or_else(short)
                };
                rows.push(Row {
                    cell: count(Some(cell))?,
                    trial: count(trials.get(k))?,
                    seed: count(seeds.get(k))? as u64,
                    true_delay_s: must(0)?,
                    outcome,
                    raw_s: at(1)?,
                    delay_s: at(2)?,
                    std_s: at(3)?,
                    lo_s: at(4)?,
                    hi_s: at(5)?,
                    error_samples: at(6)?,
                    bound_samples: at(7)?,
                    predicted_samples: at(8)?,
                    time_s: must(9)?,
                });
            }
        }
        Ok(rows)
    }

    /// The outcome that a word means; `known` keeps those that were met.
    fn outcome(&self, word: &ByteArray, known: &mut Vec<(ByteArray, Outcome)>) -> Result<Outcome> {
        if let Some((_, outcome)) = known.iter().find(|(w, _)| w == word) {
            return Ok(*outcome);
        }
        let text = String::from_utf8_lossy(word.data()).into_owned();
        let outcome = serde_json::from_value(text.clone().into())
            .map_err(|_| unread(&self.path, &format!("outcome `{text}`")))?;
        known.push((word.clone(), outcome));
        Ok(outcome)
    }
}

/// The columns of numbers, as [`EstimateReader::rows`] counts them.
const NUMBERS: [&str; 10] = [
    "true_delay_s",
    "raw_s",
    "delay_s",
    "std_s",
    "lo_s",
    "hi_s",
    "error_samples",
    "bound_samples",
    "predicted_samples",
    "time_s",
];

/// A file that cannot be used.
pub(super) fn unread(path: &Path, detail: &str) -> Error {
    let detail = Message::from(detail)
        .and("; go on where it was (")
        .and(Remedy::Resume)
        .and("): a damaged part is made again");
    StudyError::Results { path: path.to_owned(), detail }.into()
}

/// Everything that a column of a row group holds.
fn all<T: DataType>(
    column: &mut ColumnReaderImpl<T>,
    rows: usize,
    there: &mut Vec<i16>,
) -> Result<Vec<T::T>, ParquetError> {
    let mut values = Vec::with_capacity(rows);
    let mut read = 0;
    while read < rows {
        let (records, ..) = column.read_records(rows - read, Some(there), None, &mut values)?;
        if records == 0 {
            return Err(ParquetError::EOF("the file ends too early".to_owned()));
        }
        read += records;
    }
    Ok(values)
}

/// Values with gaps where there is none.
fn spread<T>(
    values: Vec<f64>,
    there: &[i16],
    of: impl Fn(Option<f64>) -> T,
) -> impl Iterator<Item = T> {
    let mut values = values.into_iter();
    there.iter().map(move |there| of(if *there > 0 { values.next() } else { None }))
}

/// All columns of files of estimates, one file after the other: `estimates.parquet`, or parts of one in their order.
///
/// # Errors
/// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`StudyError::Results`] for files that are damaged, or have other columns than the first.
pub fn columns(
    paths: &[PathBuf],
    stop: &deadtime_signal::stop::Stop,
) -> Result<Vec<(String, Values)>> {
    let mut whole: Vec<(String, Values)> = Vec::new();
    let mut words: Vec<BTreeMap<String, i32>> = Vec::new();
    for path in paths {
        let reader = EstimateReader::open(path)?;
        let names = reader.names();
        if whole.is_empty() {
            let blank = |column: EstimateColumn| match column {
                EstimateColumn::Text(_) => Values::Words(Vec::new(), Vec::new()),
                EstimateColumn::Count(_) => Values::Counts(Vec::new()),
                EstimateColumn::Number(..) => Values::Numbers(Vec::new()),
            };
            for name in &names {
                whole.push((name.clone(), blank(reader.column(0, name)?)));
            }
            words = vec![BTreeMap::new(); names.len()];
        }
        if whole.iter().map(|(name, _)| name).ne(&names) {
            return Err(unread(path, "it has other columns than the first file"));
        }
        for group in 0..reader.file.num_row_groups() {
            stop.check()?;
            for ((name, values), seen) in whole.iter_mut().zip(&mut words) {
                match (values, reader.column(group, name)?) {
                    (Values::Words(different, codes), EstimateColumn::Text(texts)) => {
                        for text in &texts {
                            let text = std::str::from_utf8(text.data())
                                .map_err(|e| unread(path, &e.to_string()))?;
                            let code = match seen.get(text) {
                                Some(code) => *code,
                                None => {
                                    let code = i32::try_from(different.len())
                                        .map_err(|e| unread(path, &e.to_string()))?;
                                    different.push(text.to_owned());
                                    seen.insert(text.to_owned(), code);
                                    code
                                }
                            };
                            codes.push(code);
                        }
                    }
                    (Values::Counts(to), EstimateColumn::Count(values)) => to.extend(values),
                    (Values::Numbers(to), EstimateColumn::Number(values, there)) => {
                        to.extend(spread(values, &there, |v| v.unwrap_or(f64::NAN)))
                    }
                    _ => {
                        return Err(unread(
                            path,
                            &format!("column `{name}` has another type than in the first file"),
                        ));
                    }
                }
            }
        }
    }
    Ok(whole)
}

//! Tables of text.

use super::entities::Entities;
use super::header::Header;
use super::instances::instances;
use super::lines::{GZIP_MAGIC, Lines, first_bytes};
use super::partial::PartialLog;
use super::sparse::apart;
use crate::budget::Budget;
use crate::channels::Log;
use crate::counted::Counted;
use crate::error::{Error, LogError};
use crate::notes::Notes;
use crate::options::ReadOptions;
use crate::recording::Recording;
use crate::sentinel;
use deadtime_signal::progress::HowFar;
use std::io::Read;
use std::path::Path;

/// Reads a file of several records. A new record begins wherever the cell of `column` (numbers or text) differs from the row before, and time may start afresh
/// in it. Records are called `FILE#VALUE`; a value that returns later begins another record of the same name.
///
/// # Errors
/// As [`crate::reader::read`]; [`LogError::UnknownChannel`] when there is no such column, [`LogError::EmptyRecord`].
pub fn read_records(path: &Path, column: &str) -> Result<Vec<Log>, Error> {
    records(path, column, &ReadOptions::default()).map(|(logs, _)| logs)
}

/// Reads one log from any source of bytes, gzip or uncompressed; `source` names it in errors and results.
///
/// # Errors
/// As [`crate::reader::read`].
pub fn read_from(source: &str, bytes: impl Read) -> Result<Log, Error> {
    Ok(recording_from(source, bytes, &ReadOptions::default())?.into_log()?)
}

/// Reads a file as a recording without topics, whose notes report the guesses.
pub(crate) fn recording(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let source = path.display().to_string();
    recording_from(&source, open(path, &options.far)?, &within(path, options))
}

/// Memory by the size of the file, unless the caller gives a limit: text may be packed.
fn within(path: &Path, options: &ReadOptions) -> ReadOptions {
    let length = std::fs::metadata(path).map_or(u64::MAX, |there| there.len());
    ReadOptions { memory: Some(Budget::of(length, options).limit()), ..options.clone() }
}

/// Reads any source of bytes as a recording without topics.
///
/// # Errors
/// As [`crate::reader::read`].
pub fn recording_from(
    source: &str,
    bytes: impl Read,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut lines = Lines::to_break(source, bytes)?;
    let mut header = Header::read(&mut lines, options)?;
    let mut part = PartialLog::new(source.into(), &header, options.memory);
    if let Some(entities) = Entities::of(&header) {
        return entities.read(source, lines, header, options);
    }
    while lines.next()? {
        if !header.wants(&lines) {
            continue;
        }
        match part.cut_off(&lines, &header) {
            None => {
                let pushed = part.push(&lines, &mut header);
                pushed.map_err(|error| instances(error, source, &mut lines, &header))?;
            }
            Some(why) => header.left_out(&lines, &why),
        }
    }
    header.notes.extend(lines.how_it_ends());
    if part.raw.is_empty() {
        return Err(lines.nothing(header.no_rows(source)).into());
    }
    let log = part.finish(&mut header)?;
    Ok(match apart(&log) {
        None => Recording::single("csv", log, header.notes),
        Some(topics) => {
            let each: Vec<String> =
                topics.iter().map(|t| t.log.names().collect::<Vec<_>>().join(", ")).collect();
            header.notes.push(format!(
                "no row has all columns: they are taken for topics with stamps of their own ({})",
                each.join("; ")
            ));
            Recording::of_topics(source, ("csv", "a table of text"), topics, header.notes)?
        }
    })
}

/// Reads several records from any source of bytes, as [`read_records`] does.
///
/// # Errors
/// As [`read_records`].
pub fn read_records_from(source: &str, bytes: impl Read, column: &str) -> Result<Vec<Log>, Error> {
    records_from(source, bytes, column, &ReadOptions::default()).map(|(logs, _)| logs)
}

/// The records of a file, as in [`read_records`], and the guesses, a sentence each.
///
/// # Errors
/// As [`read_records`].
pub fn records(
    path: &Path,
    column: &str,
    options: &ReadOptions,
) -> Result<(Vec<Log>, Notes), Error> {
    let source = path.display().to_string();
    let read = open(path, &options.far)?;
    let (mut logs, mut notes) = records_from(&source, read, column, &within(path, options))?;
    logs.iter_mut().for_each(|log| sentinel::missing(log, &options.missing, &mut notes));
    Ok((logs, notes))
}

pub(super) fn records_from(
    source: &str,
    bytes: impl Read,
    column: &str,
    options: &ReadOptions,
) -> Result<(Vec<Log>, Notes), Error> {
    let mut lines = Lines::to_break(source, bytes)?;
    let mut header = Header::read(&mut lines, options)?;
    let place = header.place(source, column)?;
    let mut logs = Vec::new();
    let mut current: Option<(Vec<u8>, PartialLog)> = None;
    while lines.next()? {
        if !header.wants(&lines) {
            continue;
        }
        // A row that is whole may begin another record.
        if let Some((name, part)) = &current
            && (lines.cut_off()
                || lines.len() < header.cells
                || name.as_slice() == lines.cell(place))
            && let Some(why) = part.cut_off(&lines, &header)
        {
            header.left_out(&lines, &why);
            continue;
        }
        header.check_length(&lines)?;
        let value = lines.cell(place);
        if value.is_empty() {
            return Err(LogError::EmptyRecord {
                file: source.into(),
                row: lines.row,
                channel: column.into(),
            }
            .into());
        }
        let part = match &mut current {
            Some((name, part)) if name.as_slice() == value => part,
            _ => {
                let fresh = PartialLog::new(
                    format!("{source}#{}", String::from_utf8_lossy(value)),
                    &header,
                    options.memory,
                );
                if let Some((_, done)) = current.take() {
                    logs.push(done.finish(&mut header)?);
                }
                &mut current.insert((value.to_vec(), fresh)).1
            }
        };
        part.push(&lines, &mut header)?;
    }
    header.notes.extend(lines.how_it_ends());
    match current {
        Some((_, last)) => logs.push(last.finish(&mut header)?),
        None => return Err(lines.nothing(header.no_rows(source)).into()),
    }
    Ok((logs, header.notes))
}

pub(super) fn is_gz(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz"))
}

/// Opens a file; one that is called .gz must be one.
pub(super) fn open(path: &Path, far: &HowFar) -> Result<impl Read, Error> {
    let io = |e| Error::io(path, e);
    let mut file = Counted::open(path, far).map_err(io)?;
    let head = first_bytes(&mut file).map_err(io)?;
    if is_gz(path) && !head.is_empty() && head != GZIP_MAGIC {
        return Err(LogError::NotGzip { file: path.display().to_string() }.into());
    }
    Ok(std::io::Cursor::new(head).chain(file))
}

//! A finished block on this machine's disk: rows as CSV, and a last line with their study and block, their count and their digest.
//!
//! The last line is computed from the rows and compared as a whole. A block with a lost or changed byte, or of another file, is not complete.

use deadtime_signal::remedy::{Message, Remedy};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::error::{Error, Result, StudyError};
use super::estimates::Row;
use deadtime_signal::file::write_atomic;

/// The beginning of the last line.
const MARK: &str = "# deadtime block";

/// Which block of which study, and how many estimates it has.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockFile<'a> {
    pub(super) stamp: &'a str,
    pub(super) number: usize,
    pub(super) rows: usize,
}

/// A finished part of a study that cannot be used, and is made again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damaged {
    /// The file.
    pub file: PathBuf,
    /// Its fault.
    pub why: String,
}

impl std::fmt::Display for Damaged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}; it is made again", self.file.display(), self.why)
    }
}

impl BlockFile<'_> {
    /// The last line for these rows.
    fn seal(&self, body: &[u8]) -> String {
        let Self { stamp, number, rows } = self;
        let digest = Sha256::new()
            .chain_update(format!("{stamp} {number} {rows}\n"))
            .chain_update(body)
            .finalize();
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        format!("{MARK} {number}, {rows} rows, sha256 {hex}\n")
    }

    /// Writes the block, all of it or none.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub(super) fn write(&self, path: &Path, rows: &[Row]) -> Result<()> {
        let wrong = |e: csv::Error| Error::io(path, e.into());
        let mut csv = csv::Writer::from_writer(Vec::new());
        rows.iter().try_for_each(|row| csv.serialize(row)).map_err(wrong)?;
        let mut body = csv.into_inner().map_err(|e| Error::io(path, e.into_error()))?;
        let seal = self.seal(&body);
        body.extend_from_slice(seal.as_bytes());
        Ok(write_atomic(path, |out| out.write_all(&body))?)
    }

    /// The rows as text, after a check that the file is whole; else its fault.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); a fault of the content is no error.
    pub(super) fn body(&self, path: &Path) -> Result<Result<Vec<u8>, String>> {
        let mut bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        if bytes.is_empty() {
            return Ok(Err("it is empty".to_owned()));
        }
        let whole = bytes.strip_suffix(b"\n").unwrap_or(&bytes);
        let last = whole.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
        if !bytes[last..].starts_with(MARK.as_bytes()) {
            return Ok(Err("its last line, with count and digest, is missing".to_owned()));
        }
        if bytes[last..] != *self.seal(&bytes[..last]).as_bytes() {
            return Ok(Err(
                "its count or digest is not that of its rows, or it is another block's".to_owned(),
            ));
        }
        bytes.truncate(last);
        Ok(Ok(bytes))
    }

    /// Reads the block.
    ///
    /// # Errors
    /// [`StudyError::Results`] where it is damaged; [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub(super) fn read(&self, path: &Path) -> Result<Vec<Row>> {
        let wrong = |detail: String| StudyError::Results {
            path: path.to_owned(),
            detail: Message::from(detail).and("; ").and(Remedy::Resume).and(" makes it again"),
        };
        let body = self.body(path)?.map_err(wrong)?;
        let rows: Vec<Row> = csv::Reader::from_reader(body.as_slice())
            .into_deserialize()
            .collect::<Result<_, _>>()
            .map_err(|e: csv::Error| wrong(e.to_string()))?;
        if rows.len() == self.rows {
            Ok(rows)
        } else {
            Err(wrong(format!("{} rows where there are {}", rows.len(), self.rows)).into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_delay::Outcome;

    #[test]
    fn every_byte_that_is_changed_or_cut_is_found() {
        let row = |trial| Row {
            cell: 3,
            trial,
            seed: 11,
            true_delay_s: 0.5,
            outcome: Outcome::Found,
            raw_s: Some(0.5),
            delay_s: None,
            std_s: None,
            lo_s: None,
            hi_s: None,
            error_samples: Some(-0.25),
            bound_samples: None,
            predicted_samples: None,
            time_s: 1e-3,
        };
        let rows = [row(0), row(1), row(2)];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("00000004.csv");
        let block = BlockFile { stamp: "abc", number: 4, rows: 3 };
        block.write(&path, &rows).unwrap();
        assert_eq!(block.read(&path).unwrap(), rows);
        let whole = std::fs::read(&path).unwrap();
        for at in 0..whole.len() {
            for bit in [0, 3, 7] {
                let mut flipped = whole.clone();
                flipped[at] ^= 1 << bit;
                std::fs::write(&path, &flipped).unwrap();
                assert!(block.body(&path).unwrap().is_err(), "byte {at}, bit {bit}");
            }
            std::fs::write(&path, &whole[..at]).unwrap();
            assert!(block.body(&path).unwrap().is_err(), "cut at {at}");
        }
        std::fs::write(&path, &whole).unwrap();
        for other in [
            BlockFile { number: 5, ..block },
            BlockFile { rows: 2, ..block },
            BlockFile { stamp: "abd", ..block },
        ] {
            assert!(other.body(&path).unwrap().is_err());
        }
        assert!(block.body(&path).unwrap().is_ok());
    }
}

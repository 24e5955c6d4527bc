//! Logs written as text.

use super::clock::seconds;
use super::table::is_gz;
use crate::channels::{Channel, Log};
use crate::error::Error;
use crate::options::TimeUnit;
use deadtime_signal::file::write_atomic;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

impl Log {
    /// Writes the log as a CSV file, compressed when the name ends in `.gz`. Units are in the header, missing samples are empty cells, and each number has the
    /// fewest digits that read back to the same bits. Columns without numbers are left out.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); an earlier file of that name is then untouched.
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        let written = write_atomic(path, |file| {
            if is_gz(path) {
                let mut encoder =
                    flate2::write::GzEncoder::new(file, flate2::Compression::default());
                self.write_rows(&mut encoder)?;
                encoder.finish().map(|_| ())
            } else {
                self.write_rows(file)
            }
        });
        Ok(written?)
    }

    fn write_rows(&self, mut out: &mut dyn Write) -> std::io::Result<()> {
        let time = if self.reads_as_seconds() { "time" } else { "time [s]" };
        let mut header = ::csv::Writer::from_writer(&mut out);
        header.write_record(
            std::iter::once(time.to_owned()).chain(self.channels.iter().map(Channel::header)),
        )?;
        header.flush()?;
        drop(header);
        let mut line = String::new();
        for (i, time_s) in self.time_s.iter().enumerate() {
            line.clear();
            push_number(&mut line, *time_s);
            for channel in &self.channels {
                line.push(',');
                if let Some(value) = channel.samples().get(i) {
                    push_number(&mut line, value);
                }
            }
            line.push('\n');
            out.write_all(line.as_bytes())?;
        }
        Ok(())
    }

    /// A reader takes these stamps for seconds without a stated unit: whole numbers far apart would look like thousandths.
    fn reads_as_seconds(&self) -> bool {
        let cells = self.time_s.iter().map(|time_s| {
            let mut cell = String::new();
            push_number(&mut cell, *time_s);
            cell
        });
        let read = seconds(cells, None, "time");
        read.unit == TimeUnit::S && read.origin_ns.is_none()
    }
}

/// The shortest digits that read back to the same bits, with an exponent where zeros would fill the cell.
pub(super) fn push_number(line: &mut String, x: f64) {
    // Writing to a `String` cannot fail.
    let _ = if x == 0.0 || (1e-5..1e16).contains(&x.abs()) {
        write!(line, "{x}")
    } else {
        write!(line, "{x:e}")
    };
}

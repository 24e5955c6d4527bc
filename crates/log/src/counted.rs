//! A file that reports the progress of its reading.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};
use std::path::Path;

use deadtime_signal::progress::HowFar;

/// A file, and the report of its reading. A part that is read twice counts twice, up to the whole.
pub(super) struct Counted {
    file: File,
    length: u64,
    read: u64,
    what: String,
    far: HowFar,
}

impl Counted {
    pub(super) fn open(path: &Path, far: &HowFar) -> Result<Self> {
        let file = File::open(path)?;
        let counted = Self {
            length: file.metadata()?.len(),
            file,
            read: 0,
            what: format!("reading {}", path.display()),
            far: far.clone(),
        };
        counted.tell();
        Ok(counted)
    }

    /// Bytes of the file.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    fn tell(&self) {
        self.far.at(self.read as f64 / self.length.max(1) as f64, &self.what);
    }
}

/// The share of reading in the work where a file is read as a whole and then decoded.
pub(super) const READING: f64 = 0.3;

/// All bytes of a file.
pub(super) fn whole(path: &Path, far: &HowFar) -> Result<Vec<u8>> {
    let mut file = Counted::open(path, &far.part(0.0, READING))?;
    let mut bytes = Vec::with_capacity(usize::try_from(file.length).unwrap_or(0));
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl Read for Counted {
    fn read(&mut self, into: &mut [u8]) -> Result<usize> {
        let read = self.file.read(into)?;
        self.read += read as u64;
        self.tell();
        Ok(read)
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.file.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_says_how_much_of_a_file_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, [7; 1000]).unwrap();
        let far = HowFar::watched();
        let share = || far.told().unwrap().0;
        let mut file = Counted::open(&path, &far).unwrap();
        assert_eq!(share(), 0.0);
        file.read_exact(&mut [0; 250]).unwrap();
        assert!((share() - 0.25).abs() < 1e-12 && far.told().unwrap().1.ends_with("log.csv"));
        assert_eq!(whole(&path, &far).unwrap().len(), 1000);
        assert!((share() - READING).abs() < 1e-12);
    }
}

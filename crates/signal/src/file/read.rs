//! Files with instructions (models, plans, labels, baselines), read within a limit.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::error::FileError;

/// Largest size of such a file, bytes: thousands of times what people write, and small relative to a machine's memory.
pub const LARGEST: u64 = 64 << 20;

/// The bytes of a file with instructions.
///
/// # Errors
/// [`FileError::Large`] beyond [`LARGEST`], for any declared size (a device has none); [`FileError::Io`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let wrong = |e| FileError::io(path, e);
    let file = File::open(path).map_err(wrong)?;
    let told = file.metadata().map_err(wrong)?.len();
    let large = || Err(FileError::Large { path: path.to_owned(), limit: LARGEST });
    if told > LARGEST {
        return large();
    }
    let mut bytes = Vec::with_capacity(usize::try_from(told).unwrap_or(0));
    file.take(LARGEST + 1).read_to_end(&mut bytes).map_err(wrong)?;
    if bytes.len() as u64 > LARGEST { large() } else { Ok(bytes) }
}

/// The same as text.
///
/// # Errors
/// As [`read_bytes`]; [`FileError::Io`] where it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, FileError> {
    String::from_utf8(read_bytes(path)?).map_err(|e| {
        FileError::io(path, std::io::Error::new(std::io::ErrorKind::InvalidData, e.utf8_error()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_larger_than_the_limit_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.toml");
        // Without blocks on the disk.
        File::create(&path).unwrap().set_len(3 << 30).unwrap();
        let said = read_text(&path).unwrap_err().to_string();
        assert!(said.contains("large.toml") && said.contains("64 MiB"), "{said}");
        std::fs::write(&path, b"a = 1\n").unwrap();
        assert_eq!(read_text(&path).unwrap(), "a = 1\n");
        std::fs::write(&path, [0xff]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("utf-8"));
    }

    #[cfg(unix)]
    #[test]
    fn a_device_without_an_end_is_refused() {
        assert!(matches!(read_bytes(Path::new("/dev/zero")), Err(FileError::Large { .. })));
    }
}

//! Whole files, written so that a reader never meets half of one.

use std::io::Write;
use std::path::Path;

use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// Writes `path` as a whole: to a temporary file in the same folder, then renamed. Missing folders are made.
///
/// # Errors
/// [`Error::Io`] naming `path`; an earlier file of that name is then untouched.
pub fn write_atomic(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    let mut buffered = std::io::BufWriter::new(temporary(path)?);
    write(&mut buffered).map_err(|source| Error::io(path, source))?;
    let file = buffered.into_inner().map_err(|e| Error::io(path, e.into_error()))?;
    named(file, path)
}

/// A file without a name of its own beside `path`, for writers that go on for long; missing folders are made. [`named`] gives it its name.
pub(crate) fn temporary(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).and_then(|()| NamedTempFile::new_in(folder)).map_err(|source| Error::io(path, source))
}

/// Gives a temporary file its name.
pub(crate) fn named(file: NamedTempFile, path: &Path) -> Result<()> {
    // A temporary file is private to its owner; a result is as readable as any other new file.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let readable = std::fs::Permissions::from_mode(0o644);
        file.as_file().set_permissions(readable).map_err(|source| Error::io(path, source))?;
    }
    file.persist(path).map(|_| ()).map_err(|e| Error::io(path, e.error))
}

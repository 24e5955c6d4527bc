//! Files written as a whole.

use super::error::FileError;
use super::unfinished;
use std::io::Write;
use std::path::Path;
use tempfile::NamedTempFile;

/// How the names of files begin and end that are not whole yet.
pub(super) const UNFINISHED: [&str; 2] = [".deadtime-", ".tmp"];

/// Writes `path` as a whole: to a temporary file in the same folder, then renamed. File and folder are synced, so that a name, once there, stands for the
/// whole file even if the machine stops. Missing folders are made.
///
/// # Errors
/// [`FileError::Io`] naming `path`; an earlier file of that name is then untouched.
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), FileError> {
    let mut buffered = std::io::BufWriter::new(temporary(path)?);
    write(&mut buffered).map_err(|source| FileError::io(path, source))?;
    let file = buffered.into_inner().map_err(|e| FileError::io(path, e.into_error()))?;
    named(file, path)
}

/// A file without a name of its own beside `path`, for writers that go on for long; missing folders are made. [`named`] gives it its name.
pub fn temporary(path: &Path) -> Result<NamedTempFile, FileError> {
    let folder = folder_of(path);
    let [prefix, suffix] = UNFINISHED;
    let file = std::fs::create_dir_all(folder)
        .and_then(|()| tempfile::Builder::new().prefix(prefix).suffix(suffix).tempfile_in(folder))
        .map_err(|source| FileError::io(path, source))?;
    unfinished::begun(file.path());
    Ok(file)
}

/// Gives a temporary file its name.
pub fn named(file: NamedTempFile, path: &Path) -> Result<(), FileError> {
    // A temporary file is private to its owner; a result is as readable as any other new file.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let readable = std::fs::Permissions::from_mode(0o644);
        file.as_file().set_permissions(readable).map_err(|source| FileError::io(path, source))?;
    }
    // The content must be on the disk before the name, and the name before anything that relies on it.
    file.as_file().sync_all().map_err(|source| FileError::io(path, source))?;
    file.persist(path).map_err(|e| FileError::io(path, e.error))?;
    sync_folder(folder_of(path));
    Ok(())
}

/// Removes what processes left behind that were killed while they wrote to this folder. Only for whoever holds the folder's [`Lock`](super::lock::Lock): nobody else writes there.
///
/// # Errors
/// [`FileError::Io`].
pub fn sweep(folder: &Path) -> Result<(), FileError> {
    let [prefix, suffix] = UNFINISHED;
    let entries = match std::fs::read_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(|e| FileError::io(folder, e))?,
    };
    for entry in entries {
        let entry = entry.map_err(|e| FileError::io(folder, e))?;
        let name = entry.file_name();
        if name.to_str().is_some_and(|n| n.starts_with(prefix) && n.ends_with(suffix)) {
            match std::fs::remove_file(entry.path()) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FileError::io(&entry.path(), e));
                }
                _ => {}
            }
        }
    }
    Ok(())
}

pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the names in a folder last. Not every file system can: what it says is no error of the file's.
pub(super) fn sync_folder(folder: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = std::fs::File::open(folder) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_our_unfinished_files_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let left = temporary(&folder.path().join("a.csv")).unwrap().keep().unwrap().1;
        for other in [".tmpABC", "a.tmp", ".deadtime-lock"] {
            std::fs::write(folder.path().join(other), "x").unwrap();
        }
        assert!(left.exists());
        sweep(folder.path()).unwrap();
        assert!(!left.exists());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
        sweep(&folder.path().join("none")).unwrap();
    }

    #[test]
    fn a_failed_write_leaves_the_earlier_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomic(&path, |out| out.write_all(b"first")).unwrap();
        let failed = write_atomic(&path, |out| {
            out.write_all(b"sec").and_then(|()| Err(std::io::Error::other("full")))
        });
        assert!(failed.unwrap_err().to_string().contains("a.txt"));
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

//! The one place that writes files: regular ones as a whole, everything else straight through.

use super::error::FileError;
use super::unfinished;
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Write, stdout};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// How the names of files begin and end that are not whole yet.
pub(super) const UNFINISHED: [&str; 2] = [".deadtime-", ".tmp"];
/// The name that means standard output.
pub const STANDARD_OUTPUT: &str = "-";
/// Symbolic links that are followed from one to the next, as many as Linux follows.
const MOST_LINKS: usize = 40;

/// Writes `path` as a whole: to a temporary file in the same folder, then renamed. File and folder are synced, so that an existing name means the whole file
/// even if the machine stops. Missing folders are made, and symbolic links are followed. A path that is no regular file (a device, a FIFO) is written to and
/// keeps its place; `-` is standard output.
///
/// # Errors
/// [`FileError::Io`] naming `path`; an earlier regular file of that name is then untouched.
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), FileError> {
    let mut buffered = std::io::BufWriter::new(Begun::new(path)?);
    write(&mut buffered).map_err(|source| FileError::io(path, source))?;
    buffered.into_inner().map_err(|e| FileError::io(path, e.into_error()))?.finish()
}

/// Opens `path` for lines that are read while they are written: standard output for `-`, else the file with that name. A regular file is emptied.
///
/// # Errors
/// [`FileError::Io`] naming `path`.
pub fn write_lines(path: &Path) -> Result<Box<dyn Write>, FileError> {
    if path.as_os_str() == STANDARD_OUTPUT {
        return Ok(Box::new(stdout()));
    }
    Ok(Box::new(File::create(path).map_err(|source| FileError::io(path, source))?))
}

/// A file that is being written, for writers that go on for long; [`Begun::finish`] gives it its name.
#[derive(Debug)]
pub struct Begun {
    path: PathBuf,
    to: To,
}

/// Where the bytes go.
#[derive(Debug)]
enum To {
    /// A temporary file in the folder of the file that it becomes.
    Beside { file: NamedTempFile, target: PathBuf },
    /// Into something that is no regular file.
    Through(File),
    /// To standard output.
    Standard,
}

impl Begun {
    /// Begins the file of `path`; missing folders are made.
    ///
    /// # Errors
    /// [`FileError::Io`] naming `path`.
    pub fn new(path: &Path) -> Result<Self, FileError> {
        let to = To::of(path).map_err(|source| FileError::io(path, source))?;
        Ok(Self { path: path.to_owned(), to })
    }

    /// Gives the file its name, once all is written.
    ///
    /// # Errors
    /// [`FileError::Io`] naming the file; an earlier regular file of that name is then untouched.
    pub fn finish(mut self) -> Result<(), FileError> {
        self.flush().map_err(|source| FileError::io(&self.path, source))?;
        match self.to {
            To::Beside { file, target } => named(file, &self.path, &target),
            To::Through(_) | To::Standard => Ok(()),
        }
    }
}

impl To {
    fn of(path: &Path) -> std::io::Result<Self> {
        if path.as_os_str() == STANDARD_OUTPUT {
            return Ok(Self::Standard);
        }
        let target = followed(path)?;
        match std::fs::metadata(&target) {
            Ok(there) if there.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(there) if !there.is_file() => {
                return Ok(Self::Through(OpenOptions::new().write(true).open(&target)?));
            }
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
            _ => {}
        }
        let folder = folder_of(&target);
        std::fs::create_dir_all(folder)?;
        let [prefix, suffix] = UNFINISHED;
        let mut undisturbed = unfinished::undisturbed();
        let file = tempfile::Builder::new().prefix(prefix).suffix(suffix).tempfile_in(folder)?;
        undisturbed.begun(file.path());
        Ok(Self::Beside { file, target })
    }
}

impl Write for Begun {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match &mut self.to {
            To::Beside { file, .. } => file.write(bytes),
            To::Through(file) => file.write(bytes),
            To::Standard => stdout().write(bytes),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match &mut self.to {
            To::Beside { file, .. } => file.flush(),
            To::Through(file) => file.flush(),
            To::Standard => stdout().flush(),
        }
    }
}

/// The name at the end of a chain of symbolic links; there need not be a file of that name.
fn followed(path: &Path) -> std::io::Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..MOST_LINKS {
        match std::fs::symlink_metadata(&target) {
            Ok(there) if there.is_symlink() => {
                // A relative link counts from its own folder.
                let to = std::fs::read_link(&target)?;
                target = folder_of(&target).join(to);
            }
            Err(e) if !matches!(e.kind(), ErrorKind::NotFound) => return Err(e),
            _ => return Ok(target),
        }
    }
    Err(Error::other("symbolic links in a circle"))
}

/// Gives a temporary file its name: that of `target`, the file of `path`.
fn named(file: NamedTempFile, path: &Path, target: &Path) -> Result<(), FileError> {
    // A temporary file is private to its owner; a result is as readable as the file before it, or as any other new file.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let readable = std::fs::metadata(target).map_or_else(
            |_| std::fs::Permissions::from_mode(0o644),
            |earlier| earlier.permissions(),
        );
        file.as_file().set_permissions(readable).map_err(|source| FileError::io(path, source))?;
    }
    // The content must be on the disk before the name, and the name before anything that relies on it.
    file.as_file().sync_all().map_err(|source| FileError::io(path, source))?;
    file.persist(target).map_err(|e| FileError::io(path, e.error))?;
    sync_folder(folder_of(target));
    Ok(())
}

/// Removes the files of processes that were killed while they wrote to this folder. Only for the holder of the folder's [`Lock`](super::lock::Lock): no other
/// process writes there.
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

/// Makes the names in a folder last. Not every file system can: its answer is no error of the file.
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
        let begun = Begun::new(&folder.path().join("a.csv")).unwrap();
        let To::Beside { file, .. } = begun.to else {
            panic!("a new file is written next to its target")
        };
        let left = file.keep().unwrap().1;
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

    #[cfg(unix)]
    mod unix {
        use super::*;
        use proptest::prelude::*;
        use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
        use std::process::Command;

        /// The end of a chain of links.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        enum End {
            File,
            Nothing,
            Fifo,
            Folder,
        }

        proptest! {
            #[test]
            fn links_are_followed_to_whatever_stands_at_their_end(
                links in prop::collection::vec(any::<bool>(), 0..6),
                end in prop::sample::select(&[End::File, End::Nothing, End::Fifo, End::Folder][..]),
                bytes in prop::collection::vec(any::<u8>(), 0..9000),
                mode in prop::sample::select(&[0o600, 0o644, 0o640, 0o666][..]),
            ) {
                let folder = tempfile::tempdir().unwrap();
                let place = |at: usize| folder.path().join(format!("{at}")).join("name");
                (0..=links.len()).for_each(|at| std::fs::create_dir(folder.path().join(format!("{at}"))).unwrap());
                for (at, relative) in links.iter().enumerate() {
                    let to = if *relative { format!("../{}/name", at + 1).into() } else { place(at + 1) };
                    symlink(to, place(at)).unwrap();
                }
                let last = place(links.len());
                match end {
                    End::File => {
                        std::fs::write(&last, "earlier").unwrap();
                        std::fs::set_permissions(&last, std::fs::Permissions::from_mode(mode)).unwrap();
                    }
                    End::Nothing => {}
                    End::Fifo => assert!(Command::new("mkfifo").arg(&last).status().unwrap().success()),
                    End::Folder => std::fs::create_dir(&last).unwrap(),
                }
                let read = (end == End::Fifo).then(|| {
                    let fifo = last.clone();
                    std::thread::spawn(move || std::fs::read(fifo).unwrap())
                });
                let written = write_atomic(&place(0), |out| out.write_all(&bytes));
                prop_assert_eq!(written.is_ok(), end != End::Folder);
                for at in 0..links.len() {
                    prop_assert!(std::fs::symlink_metadata(place(at)).unwrap().is_symlink());
                }
                let there = std::fs::symlink_metadata(&last).unwrap();
                match end {
                    End::File | End::Nothing => {
                        prop_assert_eq!(std::fs::read(&last).unwrap(), bytes);
                        let wanted = if end == End::File { mode } else { 0o644 };
                        prop_assert_eq!(there.mode() & 0o777, wanted);
                    }
                    End::Fifo => {
                        prop_assert!(there.file_type().is_fifo());
                        prop_assert_eq!(read.unwrap().join().unwrap(), bytes);
                    }
                    End::Folder => prop_assert!(there.is_dir()),
                }
                for at in 0..=links.len() {
                    let left = std::fs::read_dir(folder.path().join(format!("{at}"))).unwrap().count();
                    prop_assert!(left <= 1);
                }
            }
        }

        #[test]
        fn links_in_a_circle_are_an_error() {
            let folder = tempfile::tempdir().unwrap();
            let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
            symlink(&a, &b).unwrap();
            symlink(&b, &a).unwrap();
            let said = write_atomic(&a, |out| out.write_all(b"x")).unwrap_err().to_string();
            assert!(said.contains("circle"), "{said}");
            assert!(std::fs::symlink_metadata(&a).unwrap().is_symlink());
        }

        /// Nodes of the test's own, like `/dev/null` and `/dev/full`; without permission the test reports it.
        #[test]
        fn a_device_is_written_to_and_stays_a_device() {
            let folder = tempfile::tempdir().unwrap();
            for (minor, takes) in [("3", true), ("7", false)] {
                let node = folder.path().join(minor);
                let made =
                    Command::new("mknod").arg(&node).args(["c", "1", minor]).output().unwrap();
                if !made.status.success() || OpenOptions::new().write(true).open(&node).is_err() {
                    eprintln!("skipped: no device node can be made or opened here");
                    return;
                }
                for _ in 0..2 {
                    let written = write_atomic(&node, |out| out.write_all(&[7; 100_000]));
                    assert_eq!(written.is_ok(), takes, "{written:?}");
                    let there = std::fs::symlink_metadata(&node).unwrap();
                    assert!(there.file_type().is_char_device());
                }
            }
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        }
    }
}

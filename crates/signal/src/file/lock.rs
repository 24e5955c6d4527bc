//! One writer at a time for a folder.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use super::error::FileError;
use super::unfinished;

/// The file that is locked while a run writes to its folder; it holds the process id of the run.
const NAME: &str = ".deadtime.lock";

/// Held while a run writes to a folder. The operating system releases it when the process ends, in any way.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// The folder, where it was not there before.
    made: Option<PathBuf>,
    _file: File,
}

impl Lock {
    /// Locks a folder, which is made if it is missing, and goes again if nothing was written to it. Where the file system has no locks, nothing is locked.
    ///
    /// # Errors
    /// [`FileError::Busy`] with the other's process id where another run writes to the folder; [`FileError::Io`].
    pub fn of(folder: &Path) -> Result<Self, FileError> {
        let path = folder.join(NAME);
        let wrong = |e| FileError::io(&path, e);
        let made = (!folder.exists()).then(|| folder.to_owned());
        loop {
            let mut undisturbed = unfinished::undisturbed();
            std::fs::create_dir_all(folder).map_err(|e| FileError::io(folder, e))?;
            let opened =
                OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let mut file = match opened {
                // Another's folder that went between our making it and our opening the file.
                Err(e) if e.kind() == std::io::ErrorKind::NotFound && !folder.exists() => continue,
                opened => opened.map_err(wrong)?,
            };
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => {
                    drop(undisturbed);
                    return Err(FileError::Busy {
                        folder: folder.to_owned(),
                        process: holder(&mut file),
                    });
                }
                Err(TryLockError::Error(e)) if e.kind() != std::io::ErrorKind::Unsupported => {
                    return Err(wrong(e));
                }
                _ => {}
            }
            // Whoever held it may have removed the file between our opening it and our locking it: then another run could lock a new one.
            if !is_still(&file, &path) {
                continue;
            }
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| writeln!(file, "{}", std::process::id()))
                .map_err(wrong)?;
            undisturbed.begun(&path);
            made.iter().for_each(|folder| undisturbed.begun(folder));
            return Ok(Self { path, made, _file: file });
        }
    }
}

/// The process that holds the lock. It has locked the file before it writes its number there: until then the file is empty, or holds a dead run's.
fn holder(file: &mut File) -> Option<u32> {
    const TRIES: u32 = 50;
    for _ in 0..TRIES {
        let mut text = String::new();
        if file.rewind().is_ok()
            && file.take(20).read_to_string(&mut text).is_ok()
            && let Ok(process) = text.trim().parse()
            && lives(process)
        {
            return Some(process);
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    None
}

/// Whether a process runs. Outside Linux every process is treated as running. On a shared file system a process may run on another machine; its number is then
/// unknown.
fn lives(process: u32) -> bool {
    let all = Path::new("/proc/self");
    !all.exists() || Path::new("/proc").join(process.to_string()).exists()
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While the lock is held, so that no other process's file is removed.
        let mut undisturbed = unfinished::undisturbed();
        undisturbed.ended(&self.path);
        let _ = std::fs::remove_file(&self.path);
        // A folder that holds something stays.
        if let Some(folder) = &self.made {
            undisturbed.ended(folder);
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// The name still means this very file.
#[cfg(unix)]
fn is_still(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same =
        |a: std::fs::Metadata, b: std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().ok().zip(std::fs::metadata(path).ok()).is_some_and(|(a, b)| same(a, b))
}

#[cfg(not(unix))]
fn is_still(_: &File, _: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_locked_once_and_free_again_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let held = Lock::of(folder.path()).unwrap();
        let refused = Lock::of(folder.path()).unwrap_err().to_string();
        assert!(refused.contains(&format!("process {}", std::process::id())), "{refused}");
        drop(held);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        // The lock file of a killed run is no obstacle.
        std::fs::write(folder.path().join(NAME), "1\n").unwrap();
        drop(Lock::of(folder.path()).unwrap());
        let new = folder.path().join("new");
        drop(Lock::of(&new).unwrap());
        assert!(!new.exists());
        let held = Lock::of(&new).unwrap();
        std::fs::write(new.join("kept"), "x").unwrap();
        drop(held);
        assert_eq!(std::fs::read_dir(&new).unwrap().count(), 1);
    }

    #[test]
    fn of_many_that_want_it_one_at_a_time_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("made by each that finds none");
        let inside = std::sync::atomic::AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        if let Ok(held) = Lock::of(&folder) {
                            assert_eq!(inside.fetch_add(1, std::sync::atomic::Ordering::SeqCst), 0);
                            inside.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                            drop(held);
                        }
                    }
                });
            }
        });
    }
}

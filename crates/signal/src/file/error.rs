//! Files that cannot be read or written.

use std::path::{Path, PathBuf};

/// A file or folder that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The operating system refused a file.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A file of instructions that is far larger than any such file.
    #[error("{path}: larger than {mib} MiB, the most that is read of a file of this kind; is it a log, or a device?", path = path.display(), mib = limit >> 20)]
    Large {
        /// The file.
        path: PathBuf,
        /// Bytes at most.
        limit: u64,
    },
    /// Another run writes to the folder.
    #[error("{folder}: {other} writes there; wait for it, or give another folder", folder = folder.display(), other = process.map_or_else(|| "another process".to_owned(), |p| format!("process {p}")))]
    Busy {
        /// The folder.
        folder: PathBuf,
        /// The other's process id, where it can be read.
        process: Option<u32>,
    },
}

impl FileError {
    /// An operating-system error with the file it is about.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}

//! Files that cannot be read or written.

use std::path::{Path, PathBuf};

/// A file or folder that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The operating system refused a file.
    #[error("{path}: {reason}", path = path.display(), reason = why(path, reason))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason; the message holds it.
        reason: std::io::Error,
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

/// The operating system's reason without its number; for a missing name, the missing part and the nearest name in the folder.
fn why(path: &Path, reason: &std::io::Error) -> String {
    if reason.kind() != std::io::ErrorKind::NotFound {
        let text = reason.to_string();
        return text.split(" (os error").next().unwrap_or(&text).to_owned();
    }
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let Ok(entries) = std::fs::read_dir(folder) else {
        return format!("there is no folder {}", folder.display());
    };
    let names: Vec<String> =
        entries.flatten().filter_map(|entry| entry.file_name().into_string().ok()).collect();
    let wanted = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into());
    // The file may have come since, or be a link to nothing.
    let others = names.iter().map(String::as_str).filter(|name| *name != wanted);
    format!("no such file{}", crate::text::did_you_mean(&wanted, others))
}

impl FileError {
    /// An operating-system error with the file it is about.
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), reason }
    }
}

#[cfg(test)]
mod tests {
    use super::FileError;

    #[test]
    fn a_missing_file_has_its_folder_or_the_nearest_name() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("flight.csv"), "").unwrap();
        let message = |name: &str| {
            let path = folder.path().join(name);
            FileError::io(&path, std::fs::File::open(&path).unwrap_err()).to_string()
        };
        assert!(message("fligth.csv").ends_with("no such file (did you mean `flight.csv`?)"));
        assert!(message("model.toml").ends_with("no such file"));
        assert!(message("logs/flight.csv").contains("there is no folder "));
        assert!(message("logs/flight.csv").ends_with("logs"));
    }
}

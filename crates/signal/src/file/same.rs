//! Whether two names mean one file.

use std::path::{Path, PathBuf};

use super::write::folder_of;

/// The identity of the file behind a name: equal for two names of one file, also by symbolic and hard links. For a file that does not exist yet it is its
/// folder and name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SameFile(Identity);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Identity {
    /// Device and number of the file in it.
    #[cfg(unix)]
    There(u64, u64),
    /// The name without links.
    Named(PathBuf),
}

impl SameFile {
    /// The file of `path`; `None` where it cannot be found out.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        #[cfg(unix)]
        if let Ok(there) = std::fs::metadata(path) {
            use std::os::unix::fs::MetadataExt;
            return Some(Self(Identity::There(there.dev(), there.ino())));
        }
        let named = std::fs::canonicalize(path).ok().or_else(|| {
            Some(std::fs::canonicalize(folder_of(path)).ok()?.join(path.file_name()?))
        })?;
        Some(Self(Identity::Named(named)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_file_are_the_same_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, none] = ["a", "b", "none"].map(|name| folder.path().join(name));
        std::fs::write(&a, "x").unwrap();
        std::fs::write(&b, "x").unwrap();
        let roundabout = folder.path().join(".").join("a");
        assert_eq!(SameFile::of(&a), SameFile::of(&roundabout));
        assert_ne!(SameFile::of(&a), SameFile::of(&b));
        assert_eq!(SameFile::of(&none), SameFile::of(&folder.path().join("./none")));
        assert_ne!(SameFile::of(&none), SameFile::of(&a));
        assert_eq!(SameFile::of(&folder.path().join("no/where")), None);
        #[cfg(unix)]
        for link in [false, true] {
            let other = folder.path().join(format!("{link}"));
            if link {
                std::os::unix::fs::symlink("a", &other).unwrap();
            } else {
                std::fs::hard_link(&a, &other).unwrap();
            }
            assert_eq!(SameFile::of(&a), SameFile::of(&other));
        }
    }
}

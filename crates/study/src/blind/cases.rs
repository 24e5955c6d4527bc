//! The content of a case folder.

use std::path::{Path, PathBuf};

use super::error::BlindError;
use crate::error::{Error, Result};

/// The file that binds the case to its label.
pub const COMMITMENT: &str = "commitment.txt";

/// The files of one case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaseFiles {
    /// The folder's name.
    pub id: String,
    /// The folder.
    pub folder: PathBuf,
    /// `model.toml` or `model.json`.
    pub model: PathBuf,
    /// `train_*.csv` or `.csv.gz`, by number.
    pub logs: Vec<PathBuf>,
    /// `holdout_*.csv` or `.csv.gz`, by number.
    pub holdout: Vec<PathBuf>,
    /// `commitment.txt`.
    pub commitment: PathBuf,
}

/// All cases in a folder, in order of their names, each with its files or with the missing ones. Files and hidden folders are ignored.
///
/// # Errors
/// [`FileError::Io`](deadtime_signal::file::FileError::Io), [`BlindError::NoCases`], [`BlindError::BadName`].
pub fn find(cases: &Path) -> Result<Vec<(String, Result<CaseFiles>)>> {
    let ids = folders(cases)?;
    if ids.is_empty() {
        return Err(BlindError::NoCases { folder: cases.to_owned() }.into());
    }
    Ok(ids.into_iter().map(|id| (id.clone(), CaseFiles::of(cases.join(&id), &id))).collect())
}

impl CaseFiles {
    /// The files of the case in a folder.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io), [`BlindError::Missing`], [`BlindError::Ambiguous`].
    pub fn of(folder: PathBuf, id: &str) -> Result<Self> {
        let names = names(&folder)?;
        let has = |name: &str| names.iter().any(|n| n == name);
        let missing = |file| Error::from(BlindError::Missing { folder: folder.clone(), file });
        let model = match (has("model.toml"), has("model.json")) {
            (true, true) => {
                return Err(BlindError::Ambiguous {
                    folder,
                    first: "model.toml",
                    second: "model.json",
                }
                .into());
            }
            (true, false) => "model.toml",
            (false, true) => "model.json",
            (false, false) => return Err(missing("model.toml")),
        };
        let logs = numbered(&names, "train_");
        if logs.is_empty() {
            return Err(missing("train_*.csv"));
        }
        let holdout = numbered(&names, "holdout_");
        if holdout.is_empty() {
            return Err(missing("holdout_*.csv"));
        }
        if !has(COMMITMENT) {
            return Err(missing(COMMITMENT));
        }
        let paths = |names: Vec<&String>| names.into_iter().map(|n| folder.join(n)).collect();
        Ok(Self {
            id: id.to_owned(),
            model: folder.join(model),
            logs: paths(logs),
            holdout: paths(holdout),
            commitment: folder.join(COMMITMENT),
            folder: folder.clone(),
        })
    }
}

/// Names like `train_10.csv`, train_2 before train_10.
fn numbered<'a>(names: &'a [String], prefix: &str) -> Vec<&'a String> {
    let number = |name: &str| {
        let rest = name.strip_prefix(prefix)?;
        let stem = rest.strip_suffix(".csv").or_else(|| rest.strip_suffix(".csv.gz"))?;
        Some(stem.parse::<u64>().unwrap_or(u64::MAX))
    };
    let mut found: Vec<(u64, &String)> =
        names.iter().filter_map(|n| Some((number(n)?, n))).collect();
    found.sort();
    found.into_iter().map(|(_, n)| n).collect()
}

fn names(folder: &Path) -> Result<Vec<String>> {
    let io = |source| Error::io(folder, source);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        // A name that is no text equals none of the searched names.
        names.extend(entry.map_err(io)?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// The names of the folders in a folder, in order, hidden ones left out.
pub(super) fn folders(folder: &Path) -> Result<Vec<String>> {
    let io = |source| Error::io(folder, source);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        // Links to folders count.
        if !entry.path().is_dir() {
            continue;
        }
        let name = entry
            .file_name()
            .into_string()
            .map_err(|_| BlindError::BadName { folder: entry.path() })?;
        if !name.starts_with('.') {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

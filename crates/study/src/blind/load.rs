//! Verdicts and labels side by side, every label checked against its commitment before anything is scored.

use std::path::Path;

use super::cases::{COMMITMENT, folders};
use super::commitment;
use super::error::BlindError;
use super::label::Label;
use super::run_time::RunTime;
use crate::error::{Error, Result};
use deadtime_gap::Diagnosis;
use deadtime_signal::file::read_bytes;

/// The file of a verdict.
pub(super) const DIAGNOSIS: &str = "diagnosis.json";
/// The file of its run time.
pub(super) const RUN_TIME: &str = "run.json";

/// One case, its truth and its verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Scored {
    /// The truth.
    pub label: Label,
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The run time, s; missing where the verdict has no `run.json`.
    pub time_s: Option<f64>,
}

/// Reads `labels/ID.json` and `verdicts/ID/diagnosis.json`, in order of their names.
///
/// The commitment is read from `cases/ID`, where `cases` is given, and from the copy stored with the verdict; where both are, they must agree.
///
/// # Errors
/// Labels without case or verdict and verdicts without label ([`BlindError::Unpaired`]); missing or unequal commitments. Labels that do not match theirs
/// ([`BlindError::Changed`], naming all); files that cannot be read.
pub fn load(verdicts: &Path, labels: &Path, cases: Option<&Path>) -> Result<Vec<Scored>> {
    let ids = label_ids(labels)?;
    if ids.is_empty() {
        return Err(BlindError::NoLabels { folder: labels.to_owned() }.into());
    }
    let judged: Vec<String> = folders(verdicts)?
        .into_iter()
        .filter(|id| verdicts.join(id).join(DIAGNOSIS).is_file())
        .collect();
    let cases_there = cases.map(folders).transpose()?;
    let lacks = |id: &String| {
        !judged.contains(id) || cases_there.as_ref().is_some_and(|there| !there.contains(id))
    };
    let without_verdict: Vec<String> = ids.iter().filter(|id| lacks(id)).cloned().collect();
    let without_label: Vec<String> =
        judged.iter().filter(|id| !ids.contains(id)).cloned().collect();
    if !without_verdict.is_empty() || !without_label.is_empty() {
        return Err(
            BlindError::Unpaired { labels: without_verdict, verdicts: without_label }.into()
        );
    }
    let read: Vec<(Label, Vec<u8>)> = ids
        .iter()
        .map(|id| Label::read(&labels.join(format!("{id}.json")), id))
        .collect::<Result<_>>()?;
    check_commitments(&read, verdicts, cases)?;
    read.into_iter()
        .map(|(label, _)| {
            let folder = verdicts.join(&label.id);
            let diagnosis = Diagnosis::read(&folder.join(DIAGNOSIS))?;
            let time = folder.join(RUN_TIME);
            let time_s = if time.is_file() { Some(run_time(&time)?.time_s) } else { None };
            Ok(Scored { label, diagnosis, time_s })
        })
        .collect()
}

fn label_ids(labels: &Path) -> Result<Vec<String>> {
    let io = |source| Error::io(labels, source);
    let mut ids = Vec::new();
    for entry in std::fs::read_dir(labels).map_err(io)? {
        let name = entry.map_err(io)?.file_name();
        if let Some(id) = name.to_str().and_then(|n| n.strip_suffix(".json"))
            && !id.starts_with('.')
        {
            ids.push(id.to_owned());
        }
    }
    ids.sort();
    Ok(ids)
}

fn check_commitments(
    labels: &[(Label, Vec<u8>)],
    verdicts: &Path,
    cases: Option<&Path>,
) -> Result<()> {
    let (mut missing, mut unequal, mut changed) = (Vec::new(), Vec::new(), Vec::new());
    for (label, bytes) in labels {
        let id = label.id.clone();
        let copy = committed(&verdicts.join(&id).join(COMMITMENT), &id)?;
        let original =
            cases.map_or(Ok(None), |cases| committed(&cases.join(&id).join(COMMITMENT), &id))?;
        if let (Some(copy), Some(original)) = (&copy, &original)
            && copy != original
        {
            unequal.push(id);
            continue;
        }
        let Some(hash) = original.or(copy) else {
            missing.push(id);
            continue;
        };
        match commitment::check(&hash, bytes, &label.salt) {
            Some(true) => {}
            Some(false) => changed.push(id),
            None => return Err(BlindError::NoSalt { id }.into()),
        }
    }
    if !missing.is_empty() {
        return Err(BlindError::NoCommitment { ids: missing }.into());
    }
    if !unequal.is_empty() {
        return Err(BlindError::CommitmentChanged { ids: unequal }.into());
    }
    if !changed.is_empty() {
        return Err(BlindError::Changed { ids: changed }.into());
    }
    Ok(())
}

/// The first word of a commitment file, in small letters; none where there is no file.
fn committed(path: &Path, id: &str) -> Result<Option<String>> {
    let text = match read_bytes(path) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(deadtime_signal::file::FileError::Io { reason, .. })
            if reason.kind() == std::io::ErrorKind::NotFound =>
        {
            return Ok(None);
        }
        Err(e) => return Err(e.into()),
    };
    let word = text.split_whitespace().next().unwrap_or_default().to_ascii_lowercase();
    if word.len() == 64 && word.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Ok(Some(word));
    }
    Err(BlindError::BadCommitment { id: id.to_owned(), found: word.chars().take(80).collect() }
        .into())
}

/// Reads a run time.
pub(super) fn run_time(path: &Path) -> Result<RunTime> {
    let bytes = read_bytes(path)?;
    Ok(serde_json::from_slice(&bytes)
        .map_err(|source| BlindError::RunTime { file: path.to_owned(), source })?)
}

//! A diagnosis as the files of a folder.

use std::path::Path;

use super::page::gap;
use crate::diagnose::Diagnosed;
use crate::error::Result;
use crate::file::write_atomic;

/// Writes diagnosis.json, report.html and, where there is a model file, `model_with_effects.toml` into a folder; the names of what was written.
///
/// # Errors
/// Of files that cannot be written.
pub fn save(found: &Diagnosed, folder: &Path) -> Result<Vec<&'static str>> {
    let (diagnosis, report, model) = ("diagnosis.json", "report.html", "model_with_effects.toml");
    found.diagnosis.write(&folder.join(diagnosis))?;
    write_atomic(&folder.join(report), |out| out.write_all(gap(found).as_bytes()))?;
    let mut written = vec![diagnosis, report];
    if let Some(with_effects) = &found.model {
        with_effects.write(&folder.join(model))?;
        written.push(model);
    }
    Ok(written)
}

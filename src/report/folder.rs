//! A diagnosis, or a study, as the files of a folder.

use std::path::Path;

use super::page;
use super::study;
use crate::error::Result;
use deadtime_gap::Diagnosed;
use deadtime_signal::file::write_atomic;
use deadtime_study::{Plan, Study};

/// Writes diagnosis.json, report.html and, where there is a model file, `model_with_effects.toml` into a folder; the names of the written files.
///
/// # Errors
/// Of files that cannot be written.
pub fn save(found: &Diagnosed, folder: &Path) -> Result<Vec<&'static str>> {
    let (diagnosis, report, model) = ("diagnosis.json", "report.html", "model_with_effects.toml");
    found.diagnosis.write(&folder.join(diagnosis))?;
    write_atomic(&folder.join(report), |out| out.write_all(page::gap(found).as_bytes()))?;
    let mut written = vec![diagnosis, report];
    if let Some(with_effects) = &found.model {
        with_effects.write(&folder.join(model))?;
        written.push(model);
    }
    Ok(written)
}

/// Writes tables.md and report.html of a study into its folder.
///
/// # Errors
/// Of files that cannot be written.
pub fn save_study(found: &Study, plan: &Plan, folder: &Path) -> Result<()> {
    write_atomic(&folder.join("tables.md"), |out| {
        out.write_all(study::page(found, plan).as_bytes())
    })?;
    Ok(write_atomic(&folder.join("report.html"), |out| {
        out.write_all(page::study(found, Some(plan)).as_bytes())
    })?)
}

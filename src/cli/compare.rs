//! `deadtime compare`: diagnoses or studies side by side.

use std::path::{Path, PathBuf};

use anyhow::bail;

use super::show::{Out, write};
use crate::report::{compare, page};
use deadtime_gap::Diagnosis;
use deadtime_study::Study;
use deadtime_study::compare::{diagnoses, studies};

/// Compare diagnoses (before and after a repair, the machines of a fleet), or studies: their causes, and the numbers that differ significantly
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime compare before after
  deadtime compare robot_1 robot_2 robot_3 --html fleet.html
  deadtime compare baseline_study new_study --name baseline --name new")]
pub(super) struct Compare {
    /// Folders that `deadtime gap` or `deadtime study` wrote, or their diagnosis.json or study.json; two or more of one kind
    #[arg(value_name = "RESULT", num_args = 2.., required = true)]
    results: Vec<PathBuf>,
    /// What to call each, in the order of the results; default: their folders
    #[arg(long, value_name = "NAME")]
    name: Vec<String>,
    /// Also write the comparison as a page, one file that needs no network
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Diagnosis,
    Study,
}

impl Kind {
    const ALL: [Self; 2] = [Self::Diagnosis, Self::Study];

    fn file(self) -> &'static str {
        match self {
            Self::Diagnosis => "diagnosis.json",
            Self::Study => "study.json",
        }
    }
}

impl Compare {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let found =
            self.results.iter().map(|path| kind(path)).collect::<anyhow::Result<Vec<_>>>()?;
        let names = self.names()?;
        let Some((first, _)) = found.first() else { bail!("compare: nothing to compare") };
        if let Some((other, path)) = found.iter().find(|(kind, _)| kind != first) {
            bail!(
                "{}: a {} and a {}: compare results of one kind",
                path.display(),
                other.file(),
                first.file()
            );
        }
        let files = found.iter().map(|(_, file)| file.as_path());
        let (text, html) = match first {
            Kind::Diagnosis => {
                let read = names
                    .into_iter()
                    .zip(files)
                    .map(|(name, file)| Ok((name, Diagnosis::read(file)?)));
                let compared = diagnoses(&read.collect::<crate::error::Result<Vec<_>>>()?);
                to.json(&compared)?;
                (compare::diagnoses(&compared), page::compared_diagnoses(&compared))
            }
            Kind::Study => {
                let read =
                    names.into_iter().zip(files).map(|(name, file)| Ok((name, Study::read(file)?)));
                let compared = studies(&read.collect::<crate::error::Result<Vec<_>>>()?);
                to.json(&compared)?;
                (compare::studies(&compared), page::compared_studies(&compared))
            }
        };
        write(self.html.as_ref(), || html)?;
        say!(to, "{}", text.trim_end());
        Ok(())
    }

    /// The given names, else those of the folders where they differ, else the paths.
    fn names(&self) -> anyhow::Result<Vec<String>> {
        if !self.name.is_empty() {
            if self.name.len() != self.results.len() {
                bail!(
                    "--name: {} names for {} results; give one for each, in their order",
                    self.name.len(),
                    self.results.len()
                );
            }
            if let Some(twice) = self
                .name
                .iter()
                .enumerate()
                .find(|(at, name)| self.name.iter().take(*at).any(|n| n == *name))
            {
                bail!("--name {}: given twice", twice.1);
            }
            return Ok(self.name.clone());
        }
        let folder = |path: &PathBuf| {
            let known = Kind::ALL
                .iter()
                .any(|kind| path.file_name().is_some_and(|name| name == kind.file()));
            let named =
                if known { path.parent().and_then(Path::file_name) } else { path.file_stem() };
            named.map_or_else(
                || path.display().to_string(),
                |name| name.to_string_lossy().into_owned(),
            )
        };
        let short: Vec<String> = self.results.iter().map(folder).collect();
        let apart = short
            .iter()
            .enumerate()
            .all(|(at, name)| short.iter().take(at).all(|other| other != name));
        Ok(if apart {
            short
        } else {
            self.results.iter().map(|path| path.display().to_string()).collect()
        })
    }
}

/// The kind of a path, and its file.
fn kind(path: &Path) -> anyhow::Result<(Kind, PathBuf)> {
    if path.is_dir() {
        let held: Vec<Kind> =
            Kind::ALL.into_iter().filter(|kind| path.join(kind.file()).is_file()).collect();
        return match held.as_slice() {
            [kind] => Ok((*kind, path.join(kind.file()))),
            [] => bail!(
                "{}: neither diagnosis.json nor study.json is in this folder: give one that `deadtime gap --out` or `deadtime study --out` wrote",
                path.display()
            ),
            _ => bail!(
                "{}: both diagnosis.json and study.json are in this folder: name the file that is meant",
                path.display()
            ),
        };
    }
    let text = deadtime_signal::file::read_text(path)?;
    let format = serde_json::from_str::<serde_json::Value>(&text)
        .ok()
        .and_then(|v| v.get("format")?.as_str().map(str::to_owned));
    match format.as_deref() {
        Some(format) if format.starts_with("deadtime/study@") => Ok((Kind::Study, path.to_owned())),
        Some(format) if format.starts_with("deadtime/diagnosis@") => {
            Ok((Kind::Diagnosis, path.to_owned()))
        }
        Some(format) => bail!(
            "{}: {}: only deadtime/diagnosis@1 to @3 and deadtime/study@1 can be compared",
            path.display(),
            deadtime_signal::text::shown(format)
        ),
        None => bail!("{}: no `format` line: neither a diagnosis nor a study", path.display()),
    }
}

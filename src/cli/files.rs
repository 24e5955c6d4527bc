//! The files of a command: its inputs, its outputs, and the check that they differ.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Arg, ArgMatches};

use deadtime_signal::file::{STANDARD_OUTPUT, SameFile};

/// Options that write, by their names in the code; `baseline` does where `--update` does with `--update`. Every other path is read.
const WRITTEN: [&str; 7] = ["folder", "html", "json", "junit", "markdown", "out", "svg"];
/// The files that commands read from a given folder; bags are found by their extension.
const READ_FROM_FOLDERS: [&str; 3] = ["diagnosis.json", "model_with_effects.toml", "study.json"];
/// The files that commands write into a given folder.
const WRITTEN_TO_FOLDERS: [&str; 10] = [
    "accuracy",
    "diagnosis.json",
    "estimate.json",
    "estimate.svg",
    "estimates.csv",
    "estimates.parquet",
    "model_with_effects.toml",
    "report.html",
    "study.json",
    "tables.md",
];

/// A path with the option that names it.
struct Given {
    option: String,
    path: PathBuf,
    folder: bool,
}

impl Given {
    fn is_standard(&self) -> bool {
        self.path.as_os_str() == STANDARD_OUTPUT
    }

    fn called(&self) -> String {
        format!("{} {}", self.option, self.path.display())
    }
}

/// Whether an argument is the path of a file or folder.
fn is_path(argument: &Arg) -> bool {
    argument.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>()
}

fn writes(argument: &str, matches: &ArgMatches) -> bool {
    let updates = |argument| {
        argument == "baseline" && matches.try_get_one("update").is_ok_and(|u| u == Some(&true))
    };
    WRITTEN.contains(&argument) || updates(argument)
}

/// The paths of the arguments that a command was given, and of those of its subcommand.
fn given(command: &clap::Command, matches: &ArgMatches, found: &mut (Vec<Given>, Vec<Given>)) {
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let folder = argument.get_value_names().is_some_and(|n| n.iter().all(|n| n != "FILE"));
        let name = argument.get_value_names().and_then(|n| n.first()).map_or(id, |n| n.as_str());
        let option = argument.get_long().map_or(name.to_owned(), |long| format!("--{long}"));
        let one = |path: PathBuf| Given { option: option.clone(), path, folder };
        // The program of `--simulator` is a file that is read, where a word of the command names one.
        if id == "simulator" {
            let words = matches.try_get_one::<String>(id).ok().flatten();
            let words = words.iter().flat_map(|words| words.split_whitespace());
            found.0.extend(words.map(|word| one(word.into())).filter(|g| g.path.is_file()));
        }
        if !is_path(argument) {
            continue;
        }
        let Ok(Some(paths)) = matches.try_get_many::<PathBuf>(id) else { continue };
        let to = if writes(id, matches) { &mut found.1 } else { &mut found.0 };
        to.extend(paths.map(|path| one(path.clone())));
    }
    if let Some((name, below)) = matches.subcommand()
        && let Some(command) = command.find_subcommand(name)
    {
        given(command, below, found);
    }
}

/// The files that are read where this is given: itself, the files of a folder, and the model next to a diagnosis.
fn read_of(path: &Path) -> Vec<PathBuf> {
    let mut all = vec![path.to_owned()];
    if path.is_dir() {
        all.extend(READ_FROM_FOLDERS.iter().map(|name| path.join(name)));
        let bag = |path: &PathBuf| {
            let extension = path.extension().and_then(|e| e.to_str());
            extension.is_some_and(|e| ["db3", "mcap", "yaml"].contains(&e))
        };
        let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
        all.extend(entries.map(|entry| entry.path()).filter(bag));
    } else if path.file_name().is_some_and(|name| name == "diagnosis.json") {
        all.push(path.with_file_name("model_with_effects.toml"));
    }
    all.retain(|path| path.exists());
    all
}

/// The files that are written where this is given.
fn written_of(one: &Given) -> Vec<PathBuf> {
    let mut all = vec![one.path.clone()];
    if one.folder {
        all.extend(WRITTEN_TO_FOLDERS.iter().map(|n| one.path.join(n)).filter(|p| p.exists()));
    }
    all
}

/// Whether two outputs to it would be one after the other: a device or a FIFO takes both.
fn replaced(path: &Path) -> bool {
    std::fs::metadata(path).map_or(true, |there| there.is_file() || there.is_dir())
}

/// Refuses an output that is also an input, or also another output. Whether one is standard output.
///
/// # Errors
/// With both options, before anything is read or written.
pub(super) fn apart(command: &clap::Command, matches: &ArgMatches) -> anyhow::Result<bool> {
    let mut found = (Vec::new(), Vec::new());
    given(command, matches, &mut found);
    let (read, written) = found;
    let read: Vec<(&Given, SameFile)> = read
        .iter()
        .flat_map(|one| read_of(&one.path).into_iter().map(move |path| (one, path)))
        .filter_map(|(one, path)| Some((one, SameFile::of(&path)?)))
        .collect();
    let mut standard = false;
    let mut before: Vec<(&Given, SameFile)> = Vec::new();
    for one in &written {
        if one.is_standard() {
            if one.folder {
                bail!("{}: standard output is no folder: name one", one.called());
            }
            if standard {
                bail!("{}: only one output can be standard output", one.called());
            }
            standard = true;
            continue;
        }
        for path in written_of(one) {
            let Some(same) = SameFile::of(&path) else { continue };
            if let Some((other, _)) = read.iter().find(|(_, other)| *other == same) {
                bail!(
                    "{}: the file {} is read by {} and would be lost: write to another one",
                    one.called(),
                    path.display(),
                    other.called()
                );
            }
            if let Some((other, _)) = before.iter().find(|(_, other)| *other == same) {
                bail!("{} and {}: two outputs in one file", other.called(), one.called());
            }
            if replaced(&path) {
                before.push((one, same));
            }
        }
    }
    Ok(standard)
}

#[cfg(test)]
mod tests {
    use super::super::program::Cli;
    use super::*;
    use clap::CommandFactory;
    use std::collections::BTreeSet;

    /// Paths that are read.
    const READ: [&str; 16] = [
        "baseline",
        "cases",
        "criteria",
        "diagnosis",
        "frf",
        "holdout",
        "labels",
        "log",
        "logs",
        "matched",
        "model",
        "results",
        "step_table",
        "structure",
        "timings",
        "verdicts",
    ];

    #[test]
    fn every_path_is_known_as_read_or_as_written() {
        fn all(command: &clap::Command, found: &mut BTreeSet<String>) {
            let paths = command.get_arguments().filter(|a| is_path(a));
            found.extend(paths.map(|a| a.get_id().to_string()));
            command.get_subcommands().for_each(|c| all(c, found));
        }
        let mut found = BTreeSet::new();
        all(&Cli::command(), &mut found);
        let known: BTreeSet<String> =
            READ.iter().chain(&WRITTEN).map(|name| (*name).to_owned()).collect();
        assert_eq!(found, known);
    }
}

//! The console blocks of the README and of docs/estimating.md do what they show, and the README's lists are complete.

use std::path::Path;
use std::process::Command;

const README: &str = include_str!("../../README.md");
const ESTIMATING: &str = include_str!("../../docs/estimating.md");

/// Run times differ from run to run: `1.2 ms`, `345 µs`, `0.8 s` at the end of a table row become `TIME`, and the blanks before them one.
fn masked(text: &str) -> String {
    let mask = |line: &str| {
        let mut words: Vec<&str> = line.split_whitespace().collect();
        if let [.., number, unit] = words[..]
            && ["µs", "ms", "s"].contains(&unit)
            && number.parse::<f64>().is_ok()
        {
            words.truncate(words.len() - 2);
            words.push("TIME");
        }
        words.join(" ")
    };
    text.trim().lines().map(mask).collect::<Vec<_>>().join("\n")
}

/// The files of a folder, without those of folders in it.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|e| e.file_type().unwrap().is_file()) {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

#[test]
fn every_console_block_prints_what_the_pages_show() {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    // Paths are as the pages write them, so that lines break where theirs do; everything written goes to a temporary folder.
    copy(&root.join("examples"), &folder.path().join("examples"));
    let mut run = 0;
    let pages = [README, ESTIMATING];
    for block in pages.iter().flat_map(|p| p.split("```console\n").skip(1)).filter_map(|rest| rest.split("```").next()) {
        for session in block.split("$ ").skip(1) {
            let (command, expected) = session.split_once('\n').unwrap_or((session, ""));
            let Some(arguments) = command.strip_prefix("deadtime ") else { continue };
            let output = Command::new(env!("CARGO_BIN_EXE_deadtime"))
                .args(arguments.split_whitespace())
                .current_dir(folder.path())
                .output()
                .unwrap();
            let printed = String::from_utf8(output.stdout).unwrap();
            assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
            if !expected.trim().is_empty() {
                assert_eq!(masked(&printed), masked(expected), "{command}");
            }
            run += 1;
        }
    }
    assert!(run >= 9, "the pages show {run} commands");
}

#[test]
fn every_method_excitation_and_conversion_is_named() {
    let methods = deadtime::delay::METHODS.iter().map(|m| m.entry.name);
    let excitations = deadtime::signal::EXCITATIONS.iter().map(|e| e.name);
    let conversions = deadtime::model::c2d::CONVERSIONS.iter().map(|e| e.name);
    for name in methods.chain(excitations).chain(conversions) {
        assert!(README.contains(&format!("`{name}`")), "{name}");
    }
}

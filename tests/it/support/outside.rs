//! What a test needs from outside the repository. Without it the test is skipped: a line `skipped: NAME needs …` is printed, which `scripts/test` counts.

use std::io::Write;
use std::path::PathBuf;
use std::process::Command;

/// Prints `skipped: NAME needs WHAT`, past the test harness, which keeps what a passing test prints to itself. NAME is the running test.
pub(crate) fn skipped(needs: &str) {
    let thread = std::thread::current();
    let line = format!("skipped: {} needs {needs}\n", thread.name().unwrap_or("a test"));
    // One call writes the whole line, so that tests on other threads do not cut it.
    std::io::stderr().write_all(line.as_bytes()).unwrap();
}

/// A measured log in the folder `DEADTIME_REAL_DATA`, `../shared/data` beside the repository unless set; without the log the test is skipped.
pub(crate) fn shared_data(name: &str) -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let path = std::env::var_os("DEADTIME_REAL_DATA").map_or_else(beside, PathBuf::from).join(name);
    if path.is_file() {
        return Some(path);
    }
    skipped(&format!("the measured log {}", path.display()));
    None
}

/// The interpreter `DEADTIME_PYTHON`, `.venv/bin/python` unless set, with these packages; without it the test is skipped, and fails where `CI` or
/// `DEADTIME_REQUIRE_REFERENCE` is set.
pub(crate) fn reference_python(packages: &str) -> Option<PathBuf> {
    let made = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(".venv/bin/python");
    let python = std::env::var_os("DEADTIME_PYTHON").map_or_else(made, PathBuf::from);
    let imported = Command::new(&python).args(["-c", &format!("import {packages}")]).output();
    if imported.is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    let required =
        ["CI", "DEADTIME_REQUIRE_REFERENCE"].iter().any(|name| std::env::var_os(name).is_some());
    assert!(
        !required,
        "no reference environment: run scripts/venv (CI or DEADTIME_REQUIRE_REFERENCE is set)"
    );
    skipped("the reference environment: run scripts/venv");
    None
}

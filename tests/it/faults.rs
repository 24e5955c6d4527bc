//! The faults of `scripts/faults`, a few of each: kills, a full disk, a read-only folder, two writers, flipped bytes, SIGINT.

use crate::support::outside::skipped;
use std::path::Path;
use std::process::Command;

#[test]
fn nothing_is_lost_wrong_or_left_behind_by_faults() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/faults");
    let run = Command::new("python3")
        .arg(&script)
        .args(["--kills", "2", "--program", env!("CARGO_BIN_EXE_deadtime")])
        .output();
    let Ok(run) = run else {
        return skipped("python3");
    };
    let said =
        String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{said}");
    assert!(
        said.lines().filter(|l| l.contains("0 lost, wrong or left behind")).count() >= 8,
        "{said}"
    );
}

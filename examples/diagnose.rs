//! Where a model and a machine differ, what causes it, and how far the gap shrinks on a run that nothing was fitted to.
//!
//! `cargo run --release --example diagnose`

use std::f64::consts::PI;
use std::path::Path;

use deadtime::diagnose::{GapOptions, diagnose};
use deadtime::log::{self, Channel, Log};
use deadtime::model::ModelDocument;
use deadtime::report::diagnosis::summary;
use deadtime::report::save;

/// A run of the drive; its speed was logged in revolutions per minute, and the model wants rad/s.
fn run(folder: &Path, name: &str) -> deadtime::Result<Log> {
    let logged = log::read(&folder.join(name))?;
    let voltage = Channel::new("voltage", Some("V"), logged.input("voltage")?.to_vec());
    let speed = logged.input("speed")?.iter().map(|rpm| rpm * 2.0 * PI / 60.0).collect();
    Ok(Log::new(
        name,
        logged.time_s().to_vec(),
        vec![voltage, Channel::new("speed", Some("rad/s"), speed)],
    )?)
}

fn main() -> deadtime::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let model = ModelDocument::read(&folder.join("drive.toml"))?;
    let (learnt_from, held_out) =
        (run(&folder, "drive_run_1.csv")?, run(&folder, "drive_run_2.csv")?);

    let found = diagnose(&model, &[learnt_from], &[held_out], &GapOptions::default(), &|_| ())?;
    println!("{}", summary(&found));
    for effect in &found.effects {
        println!("found to act: {effect:?}");
    }

    // diagnosis.json, report.html and the model with what was found.
    let out = std::env::temp_dir().join("deadtime-diagnose");
    println!("{}: {}", out.display(), save(&found, &out)?.join(", "));
    Ok(())
}

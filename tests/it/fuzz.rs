//! Mutated inputs of every reader: an error, or a value that writes and reads back to itself; never a panic, and never more memory than [`TIMES`] the input's size and
//! [`BESIDE`].
//!
//! The corpus lies in `tests/corpus/READER`, one input a file; an input that broke something is added to it and stays. `DEADTIME_FUZZ_ROUNDS` mutants of each input are
//! tried (default few), from the seed `DEADTIME_FUZZ_SEED`: `scripts/fuzz MINUTES` goes on with fresh seeds.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use deadtime::blind::Label;
use deadtime::diagnose::Diagnosis;
use deadtime::log;
use deadtime::model::{Equations, ModelDocument, OutputVariable, Parameter, StateVariable, Symbol};
use deadtime::study::{Plan, Study};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// What is put into inputs beside their own pieces.
const WORDS: [&str; 34] = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e-320",
    "1e999",
    "18446744073709551616",
    "-1",
    "0",
    "0.1",
    "1e400",
    "\u{0}",
    "\u{1b}[2J",
    "\u{202e}",
    "\u{feff}",
    "é",
    "\"",
    "'",
    "'''",
    "\\",
    "\n",
    "\r\n",
    "\n\n[",
    "]]",
    "{",
    "}",
    "[",
    "(",
    ")",
    "^",
    ",",
    ",,,,",
    "=",
    "null",
];

/// Bytes of memory for each byte of input. A cell of text may be two bytes, its number is eight and its place in lists of rows and columns as much again; lists double as
/// they grow. Names are kept several times, in errors too.
const TIMES: u64 = 200;
/// Bytes of memory whatever the input: buffers, and 1000 times the size of what was compressed.
const BESIDE: u64 = 4 << 20;
/// Of log files, which may be packed: the budget of their readers for any file, and what holds a part of it twice while it grows.
const UNPACKED: u64 = 2 * (64 << 20);

/// One reader: refuses an input, or gives what it reads as the value written again.
type Reader = fn(&[u8], &Path) -> Option<Box<dyn FnOnce() -> bool>>;

fn file(bytes: &[u8], folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn csv(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let source = file(bytes, folder, "fuzz.csv");
    let _ = log::read_records(&source, "u");
    let _ = log::read_events(&source, ["u", "y"]);
    let read = log::read(&source).ok()?;
    let path = folder.join("again.csv");
    Some(Box::new(move || {
        read.write_csv(&path).unwrap();
        let again = log::read(&path).unwrap();
        let channel = |log: &log::Log, name: &str| log.output(name).map(|o| format!("{o:?}")).ok();
        // Columns without numbers are refused, and may be left out.
        read.time_s() == again.time_s()
            && read.names().all(|n| channel(&read, n).is_none_or(|c| channel(&again, n) == Some(c)))
    }))
}

fn model(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let _ = ModelDocument::from_json(text, Path::new("m.json"));
    let read = ModelDocument::from_toml(text, Path::new("m.toml")).ok()?;
    let paths = ["again.toml", "again.json"].map(|n| folder.join(n));
    Some(Box::new(move || {
        paths.iter().all(|path| {
            read.write(path).unwrap();
            ModelDocument::read(path).is_ok_and(|again| format!("{again:?}") == format!("{read:?}"))
        })
    }))
}

fn expression(bytes: &[u8], _: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let derivative = std::str::from_utf8(bytes).ok()?.to_owned();
    let state = |name: &str, derivative: String| StateVariable {
        name: name.into(),
        unit: None,
        initial: 0.1,
        initial_std: None,
        derivative,
    };
    let equations = Equations::new(
        vec![Symbol { name: "u".into(), unit: None }],
        vec![state("x", "rate".into()), state("angle", derivative), state("rate", "u".into())],
        vec![Parameter { name: "k".into(), unit: None, value: 2.0 }],
        vec![OutputVariable { name: "y".into(), unit: None, equation: "x".into() }],
    )
    .ok()?;
    Some(Box::new(move || {
        let (mut workspace, mut dx, mut jacobian) = (equations.workspace(), [0.0; 3], [0.0; 9]);
        let x = [0.1, -0.2, 1e9];
        equations.derivatives(0.5, &x, &[1.0], &[2.0], &mut workspace, &mut dx);
        equations.derivatives_jacobian(
            deadtime::model::Wrt::States,
            0.5,
            &x,
            &[1.0],
            &[2.0],
            &mut workspace,
            &mut jacobian,
        );
        // What is not finite is explained.
        dx.iter().all(|v| v.is_finite()) || equations.explain(0.5, &x, &[1.0], &[2.0]).is_some()
    }))
}

fn plan(bytes: &[u8], _: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let read = match Plan::parse("fuzz.toml", text, Path::new(".")) {
        Ok(plan) => plan,
        Err(e) => {
            let said = e.to_string();
            assert!(said.starts_with("plan fuzz.toml") && said.contains("line "), "{said}");
            return None;
        }
    };
    Some(Box::new(move || match read.to_toml() {
        Ok(text) => {
            Plan::parse("again.toml", &text, Path::new(".")).is_ok_and(|again| again == read)
        }
        // A seed that no file can hold.
        Err(_) => i64::try_from(read.seed).is_err(),
    }))
}

fn label(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let (label, kept) = Label::read(&file(bytes, folder, "case.json"), "case").ok()?;
    let same = kept == bytes && label.id == "case";
    Some(Box::new(move || same))
}

fn baseline(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let read = Study::read(&file(bytes, folder, "study.json")).ok()?;
    let path = folder.join("again.json");
    Some(Box::new(move || {
        read.write_baseline(&path).unwrap();
        let once = Study::read(&path).unwrap();
        // What a baseline leaves out is left out once.
        once.write_baseline(&path).unwrap();
        read.write(&path).unwrap();
        Study::read(&path).unwrap() == read && once.cells.len() == read.cells.len()
    }))
}

fn diagnosis(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let read = Diagnosis::read(&file(bytes, folder, "diagnosis.json")).ok()?;
    let path = folder.join("again.json");
    Some(Box::new(move || {
        read.write(&path).unwrap();
        Diagnosis::read(&path).unwrap() == read
    }))
}

/// Changes an input in one to six places: bytes, pieces of its own or of another input, words that mean something somewhere.
fn mutate(input: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..rng.random_range(1..=6) {
        let at = rng.random_range(0..=bytes.len());
        let end = rng.random_range(at..=bytes.len().min(at + 40));
        match rng.random_range(0..7) {
            0 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..end)),
            3 => {
                let piece = bytes[at..end].repeat(rng.random_range(1..20));
                bytes.splice(at..at, piece).for_each(drop);
            }
            4 => {
                let from = rng.random_range(0..=other.len());
                let to = rng.random_range(from..=other.len().min(from + 60));
                bytes.splice(at..end, other[from..to].iter().copied()).for_each(drop);
            }
            _ => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                // A whole number or word is exchanged as often as something is put in between.
                let word_end = if rng.random_bool(0.5) {
                    at
                } else {
                    at + bytes[at..].iter().take_while(|b| b.is_ascii_alphanumeric()).count()
                };
                bytes.splice(at..word_end, word.bytes()).for_each(drop);
            }
        }
    }
    bytes
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(otherwise)
}

fn fuzz(name: &str, reader: Reader, rounds: u64) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(name);
    fuzz_from(name, &corpus, &[corpus.as_path()], reader, rounds);
}

/// Inputs from several folders; what breaks the reader is kept in the first argument's.
fn fuzz_from(name: &str, corpus: &Path, folders: &[&Path], reader: Reader, rounds: u64) {
    let mut files: Vec<PathBuf> = folders
        .iter()
        .flat_map(|f| std::fs::read_dir(f).unwrap().flatten().map(|f| f.path()))
        .collect();
    files.retain(|f| f.extension().is_none_or(|e| e != "md" && e != "json") || name != "log_files");
    files.sort();
    let inputs: Vec<Vec<u8>> = files.iter().map(|f| std::fs::read(f).unwrap()).collect();
    let folder = tempfile::tempdir().unwrap();
    let rounds = number("DEADTIME_FUZZ_ROUNDS", rounds);
    let mut rng = ChaCha8Rng::seed_from_u64(number("DEADTIME_FUZZ_SEED", 1));
    let mut read = 0;
    let mut check = |bytes: &[u8], what: &str| {
        let mut taken = 0;
        let beside = if name == "log_files" { UNPACKED } else { BESIDE };
        let allowed = TIMES * bytes.len() as u64 + beside;
        let fine = catch_unwind(AssertUnwindSafe(|| {
            let mut read_as = None;
            taken =
                allocation_counter::measure(|| read_as = reader(bytes, folder.path())).bytes_max;
            read_as.is_none_or(|again| {
                read += 1;
                again()
            })
        }));
        if !matches!(fine, Ok(true)) || taken > allowed {
            let kept = corpus.join(format!(
                "broke-{:016x}",
                bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(*b))
                    .wrapping_mul(0x100_0000_01b3))
            ));
            std::fs::write(&kept, bytes).unwrap();
            panic!(
                "{name}, {what}: {}; kept as {}",
                match fine {
                    Ok(true) => format!("{taken} bytes of memory for {} of input", bytes.len()),
                    Ok(false) => "not the same when written and read".to_owned(),
                    Err(_) => "panicked".to_owned(),
                },
                kept.display()
            );
        }
    };
    for (file, input) in files.iter().zip(&inputs) {
        check(input, &file.display().to_string());
    }
    for round in 0..rounds {
        for input in &inputs {
            let other = &inputs[rng.random_range(0..inputs.len())];
            check(&mutate(input, other, &mut rng), &format!("round {round}"));
        }
    }
    // Inputs that are all refused would test the first check of the reader and nothing else.
    assert!(read > 0, "{name}: nothing was read");
}

#[test]
fn fuzz_csv() {
    fuzz("csv", csv, 400);
}

/// Files of other programs: an error or a log, whose channels can all be asked for.
fn log_file(bytes: &[u8], folder: &Path) -> Option<Box<dyn FnOnce() -> bool>> {
    let recording =
        log::open(&file(bytes, folder, "fuzz.bin"), &log::ReadOptions::default()).ok()?;
    let listing = recording.listing();
    Some(Box::new(move || serde_json::to_string(&listing).is_ok()))
}

#[test]
fn fuzz_log_files() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let kept = root.join("tests/corpus/log_files");
    std::fs::create_dir_all(&kept).unwrap();
    fuzz_from("log_files", &kept, &[&kept, &root.join("golden/log_files")], log_file, 40);
}

#[test]
fn fuzz_model() {
    fuzz("model", model, 120);
}

#[test]
fn fuzz_expression() {
    fuzz("expression", expression, 400);
}

#[test]
fn fuzz_plan() {
    fuzz("plan", plan, 300);
}

#[test]
fn fuzz_label() {
    fuzz("label", label, 400);
}

#[test]
fn fuzz_baseline() {
    fuzz("baseline", baseline, 400);
}

#[test]
fn fuzz_diagnosis() {
    fuzz("diagnosis", diagnosis, 60);
}

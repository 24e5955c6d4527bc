//! The console blocks of the README and of the first pages of the book do what they show, to two digits of each number; and the book's lists are complete.
//! The wording of answers is tested here and in wording.rs.

use std::collections::HashMap;
use std::path::Path;
use std::process::Command;

const README: &str = include_str!("../../README.md");
const MODELS: &str = include_str!("../../docs/models.md");
const EXPERIMENTS: &str = include_str!("../../docs/experiments.md");
const PAGES: [&str; 9] = [
    README,
    include_str!("../../docs/five-minutes.md"),
    include_str!("../../docs/estimating.md"),
    include_str!("../../docs/awkward-records.md"),
    include_str!("../../docs/reading-a-diagnosis.md"),
    include_str!("../../docs/identifying.md"),
    include_str!("../../docs/tutorial.md"),
    EXPERIMENTS,
    MODELS,
];

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
    text.trim().lines().map(mask).collect::<Vec<_>>().join(" ")
}

/// Text and the numbers in it, by turns.
fn pieces(text: &str) -> Vec<&str> {
    let bytes = text.as_bytes();
    let digit = |at: Option<usize>| at.and_then(|at| bytes.get(at)).is_some_and(u8::is_ascii_digit);
    let of_number = |at: usize| {
        digit(Some(at)) || bytes[at] == b'.' && digit(at.checked_sub(1)) && digit(Some(at + 1))
    };
    let ends =
        (1..bytes.len()).filter(|&at| of_number(at) != of_number(at - 1)).chain([bytes.len()]);
    let mut from = 0;
    ends.map(|to| &text[std::mem::replace(&mut from, to)..to]).collect()
}

/// The same words, and numbers that differ by one unit of the second significant digit at most: a change in the last digits printed is none, a wrong answer is one.
fn alike(printed: &str, shown: &str) -> bool {
    let near = |a: f64, b: f64| {
        (a - b).abs() <= 1.001 * 10_f64.powf(a.abs().max(b.abs()).log10().floor() - 1.0)
    };
    let same = |(a, b): (&&str, &&str)| {
        a == b || a.parse().is_ok_and(|a| b.parse().is_ok_and(|b| near(a, b)))
    };
    let (a, b) = (pieces(printed), pieces(shown));
    a.len() == b.len() && a.iter().zip(&b).all(same)
}

#[test]
fn two_digits_of_every_number_count_and_every_word() {
    assert_eq!(pieces("0.16 s, p2d: ±3.5."), ["0.16", " s, p", "2", "d: ±", "3.5", "."]);
    assert!(
        alike("0.1603 s", "0.1589 s")
            && alike("99 of 120", "100 of 121")
            && alike("0 and 12", "0 and 13")
    );
    assert!(
        !alike("0.16 s", "0.18 s")
            && !alike("1 of 3", "2 of 3")
            && !alike("0 of 3", "1 of 3")
            && !alike("0.16 s", "0.16 m")
    );
}

/// The files of a folder, without those of folders in it.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from)
        .unwrap()
        .map(Result::unwrap)
        .filter(|e| e.file_type().unwrap().is_file())
    {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

#[test]
fn every_console_block_of_the_first_pages_prints_what_they_show() {
    shown_by(&PAGES[..2], 4);
}

#[test]
#[ignore = "nightly: all pages"]
fn every_console_block_prints_what_the_pages_show() {
    shown_by(&PAGES, 9);
}

/// At least so many commands of these pages print what is shown.
fn shown_by(pages: &[&str], least: usize) {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    // Paths are as the pages write them, so that lines break where theirs do; everything written goes to a temporary folder.
    copy(&root.join("examples"), &folder.path().join("examples"));
    let mut printed: HashMap<&str, String> = HashMap::new();
    for block in pages
        .iter()
        .flat_map(|p| p.split("```console\n").skip(1))
        .filter_map(|rest| rest.split("```").next())
    {
        for session in
            block.split("$ ").enumerate().filter(|(k, s)| *k > 0 && !s.is_empty()).map(|(_, s)| s)
        {
            let (command, expected) = session.split_once('\n').unwrap_or((session, ""));
            // What two pages show is run once.
            if !printed.contains_key(command) {
                let mut process = match command.strip_prefix("deadtime ") {
                    Some(_) => Command::new(env!("CARGO_BIN_EXE_deadtime")),
                    None => Command::new("sh"),
                };
                match command.strip_prefix("deadtime ") {
                    Some(arguments) => process.args(arguments.split_whitespace()),
                    None => process.args(["-c", command]),
                };
                let output = process.current_dir(folder.path()).output().unwrap();
                assert!(
                    output.status.success(),
                    "{command}: {}",
                    String::from_utf8_lossy(&output.stderr)
                );
                printed.insert(command, String::from_utf8(output.stdout).unwrap());
            }
            if !expected.trim().is_empty() {
                let (printed, shown) = (masked(&printed[command]), masked(expected));
                assert!(
                    alike(&printed, &shown),
                    "{command}\nprints\n{printed}\nand the page shows\n{shown}"
                );
            }
        }
    }
    let run = printed.len();
    assert!(run >= least, "the pages show {run} commands");
}

#[test]
fn every_method_excitation_and_conversion_is_named() {
    let named = |page: &str, names: &[&str]| {
        names.iter().for_each(|name| assert!(page.contains(&format!("`{name}`")), "{name}"))
    };
    named(
        include_str!("../../docs/which-method.md"),
        &deadtime::delay::METHODS.iter().map(|m| m.entry.name).collect::<Vec<_>>(),
    );
    named(EXPERIMENTS, &deadtime::signal::EXCITATIONS.iter().map(|e| e.name).collect::<Vec<_>>());
    named(MODELS, &deadtime::model::c2d::CONVERSIONS.iter().map(|e| e.name).collect::<Vec<_>>());
}

#[test]
fn the_readme_is_short_and_true_and_the_citation_is_of_this_version() {
    assert!(README.lines().count() <= 110, "{} lines", README.lines().count());
    assert!(README.contains("scripts/test"));
    assert!(
        include_str!("../../CITATION.cff")
            .contains(&format!("\nversion: {}\n", env!("CARGO_PKG_VERSION")))
    );
    assert!(README.contains(&format!("Which of {} methods", deadtime::delay::METHODS.len())));
}

//! Where commands write: never over an input, never over what is no file, through links, and to standard output for `-`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::program::{Folder, deadtime, text};

const MODEL: &str = r#"format = "deadtime/model@1"
name = "lag"
kind = "lti"
A = [[-2.0]]
B = [[2.0]]
C = [[1.0]]
D = [[0.0]]
states = [{ name = "x" }]
inputs = [{ name = "u" }]
outputs = [{ name = "y" }]
"#;

/// A lag behind three samples of dead time, as a log.
fn log() -> String {
    let mut rows = "time,u,y\n".to_owned();
    let (mut y, mut seed) = (0.0_f64, 1_u32);
    let mut past = [0.0; 4];
    for k in 0..400 {
        if k % 9 == 0 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            past[0] = if seed >> 31 == 1 { 1.0 } else { -1.0 };
        }
        let noise = f64::from(seed.wrapping_mul(k + 7) >> 16) / 65_536.0 - 0.5;
        rows += &format!("{:.2},{},{:.5}\n", f64::from(k) * 0.02, past[0], y + 0.01 * noise);
        y += 0.04 * (past[3] - y);
        past = [past[0], past[0], past[1], past[2]];
    }
    rows
}

/// A folder with inputs for every command.
struct Inputs {
    folder: Folder,
    log: PathBuf,
    model: PathBuf,
}

impl Inputs {
    fn new() -> Self {
        let folder = Folder::new();
        let (log, model) = (folder.write("e.csv", &log()), folder.write("m.toml", MODEL));
        Self { folder, log, model }
    }

    /// Commands, the option of an output of each, and what it reads.
    fn commands(&self) -> Vec<(Vec<&str>, &'static str, Vec<&Path>)> {
        let (log, model) = (text(&self.log), text(&self.model));
        let pair = ["--input", "u", "--output", "y"];
        let with = |first: &[&'static str], more: &[&'static str]| [first, more].concat();
        let mut all: Vec<(Vec<&str>, &str, Vec<&Path>)> = Vec::new();
        let (of_log, of_model): (Vec<&Path>, Vec<&Path>) = (vec![&self.log], vec![&self.model]);
        let both: Vec<&Path> = vec![&self.log, &self.model];
        for option in ["--json", "--html", "--svg"] {
            let mut words = vec!["estimate", log, "--method", "crosscorr"];
            words.extend(pair);
            all.push((words, option, of_log.clone()));
        }
        for option in ["--json", "--out"] {
            all.push((vec!["c2d", model, "--sample-time", "0.02"], option, of_model.clone()));
        }
        all.push((vec!["simulate", model, log], "--out", both.clone()));
        for option in ["--json", "--html"] {
            all.push((vec!["check", "--model", model, "--log", log], option, both.clone()));
        }
        for option in ["--json", "--html", "--out"] {
            let mut words = vec!["response", log];
            words.extend(pair);
            all.push((words, option, of_log.clone()));
        }
        let mut words = vec!["watch", log, "--once"];
        words.extend(pair);
        all.push((words, "--json", of_log.clone()));
        all.push((vec!["log", log], "--json", of_log.clone()));
        all.push((
            with(&["excite", "rbs"], &["--samples", "50", "--sample-time", "0.1"]),
            "--out",
            vec![],
        ));
        all.push((with(&["list", "readers"], &[]), "--json", vec![]));
        all
    }

    fn unchanged(&self) {
        assert_eq!(std::fs::read_to_string(&self.log).unwrap(), log());
        assert_eq!(std::fs::read_to_string(&self.model).unwrap(), MODEL);
    }
}

fn run(words: &[&str], option: &str, to: &Path) -> crate::support::program::Run {
    let mut words = words.to_vec();
    words.extend([option, text(to)]);
    deadtime(&words)
}

/// A name of the right kind for an option that looks at it.
fn name(option: &str, command: &str, stem: &str) -> String {
    match (option, command) {
        ("--svg", _) => format!("{stem}.svg"),
        ("--out", "c2d") => format!("{stem}.toml"),
        _ => format!("{stem}.csv"),
    }
}

#[cfg(unix)]
#[test]
fn an_output_that_is_an_input_is_refused_by_whatever_name() {
    let inputs = Inputs::new();
    for (at, (words, option, read)) in inputs.commands().iter().enumerate() {
        for (of, input) in read.iter().enumerate() {
            for kind in ["itself", "roundabout", "link", "hard link"] {
                let other =
                    inputs.folder.path(&name(option, words[0], &format!("{at}-{of}-{kind}")));
                let to = match kind {
                    "itself" => (*input).to_owned(),
                    "roundabout" => {
                        input.parent().unwrap().join("./.").join(input.file_name().unwrap())
                    }
                    "link" => {
                        std::os::unix::fs::symlink(input, &other).unwrap();
                        other
                    }
                    _ => {
                        std::fs::hard_link(input, &other).unwrap();
                        other
                    }
                };
                run(words, option, &to).refused(&[option, "would be lost"]);
                inputs.unchanged();
            }
        }
    }
}

#[cfg(unix)]
#[test]
fn devices_pipes_and_links_stay_what_they_are() {
    use std::os::unix::fs::FileTypeExt;
    let inputs = Inputs::new();
    let made = |program: &str, words: &[&str]| {
        Command::new(program).args(words).status().is_ok_and(|s| s.success())
    };
    for (at, (words, option, _)) in inputs.commands().iter().enumerate() {
        let place =
            |stem: &str| inputs.folder.path(&name(option, words[0], &format!("{at}-{stem}")));
        let (file, link, fifo, device) =
            (place("file"), place("link"), place("fifo"), place("device"));
        run(words, option, &file).done();
        std::os::unix::fs::symlink(place("behind"), &link).unwrap();
        run(words, option, &link).done();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink(), "{words:?}");
        assert!(made("mkfifo", &[text(&fifo)]));
        let reader = {
            let fifo = fifo.clone();
            std::thread::spawn(move || std::fs::read(fifo).unwrap())
        };
        run(words, option, &fifo).done();
        let piped = reader.join().unwrap();
        assert!(std::fs::metadata(&fifo).unwrap().file_type().is_fifo(), "{words:?}");
        // What a file names of itself differs; else it is the same file.
        assert!(!piped.is_empty());
        if !["simulate", "excite", "estimate"].contains(&words[0]) {
            assert_eq!(piped, std::fs::read(&file).unwrap(), "{words:?} {option}");
            assert_eq!(std::fs::read(&link).unwrap(), std::fs::read(&file).unwrap());
        }
        if made("mknod", &[text(&device), "c", "1", "3"]) && std::fs::write(&device, "x").is_ok() {
            run(words, option, &device).done();
            assert!(std::fs::metadata(&device).unwrap().file_type().is_char_device(), "{words:?}");
        } else {
            crate::support::outside::skipped("device nodes of one's own");
        }
    }
    inputs.unchanged();
}

#[test]
fn a_dash_is_standard_output_and_words_go_aside() {
    let inputs = Inputs::new();
    for (at, (words, option, _)) in inputs.commands().iter().enumerate() {
        let file = inputs.folder.path(&name(option, words[0], &format!("{at}")));
        run(words, option, &file).done();
        if (words[0], *option) == ("c2d", "--json") {
            // Without --out the model itself is printed.
            run(words, option, Path::new("-")).refused(&["only one output"]);
            continue;
        }
        let piped = run(words, option, Path::new("-"));
        assert!(!inputs.folder.path("-").exists());
        if words[0] == "excite" || words[0] == "simulate" || words[0] == "c2d" {
            assert!(
                piped.stderr.contains("written to -") || option == &"--json",
                "{words:?}: {piped:?}"
            );
        }
        let (piped, file) = (piped.done(), std::fs::read_to_string(&file).unwrap());
        if words[0] == "estimate" {
            // Run times differ.
            assert_eq!(piped.lines().count(), file.lines().count(), "{words:?} {option}");
        } else {
            assert_eq!(piped, file, "{words:?} {option}");
        }
    }
    let folders = ["gap", "--model", text(&inputs.model), "--log", text(&inputs.log), "--out", "-"];
    deadtime(&folders).refused(&["--out -", "folder"]);
    let mut twice = inputs.commands()[0].0.clone();
    twice.extend(["--json", "-", "--html", "-"]);
    deadtime(&twice).refused(&["only one output"]);
    deadtime(&["excite", "rbs", "--samples", "50", "--sample-time", "0.1", "--json", "-"])
        .refused(&["only one output"]);
    let one = inputs.folder.path("one");
    let mut twice = inputs.commands()[0].0.clone();
    twice.extend(["--json", text(&one), "--html", text(&one)]);
    deadtime(&twice).refused(&["two outputs in one file"]);
}

#[test]
fn a_folder_is_not_written_over_what_is_read_from_it() {
    let inputs = Inputs::new();
    let gap = inputs.folder.path("gap");
    std::fs::create_dir(&gap).unwrap();
    let model = gap.join("model_with_effects.toml");
    std::fs::write(&model, MODEL).unwrap();
    let words = ["gap", "--model", text(&model), "--log", text(&inputs.log), "--out", text(&gap)];
    deadtime(&words).refused(&["would be lost", "model_with_effects.toml"]);
    assert_eq!(std::fs::read_to_string(&model).unwrap(), MODEL);
    let diagnosis = gap.join("diagnosis.json");
    std::fs::write(&diagnosis, "{}").unwrap();
    for to in [&diagnosis, &model] {
        for from in [&gap, &diagnosis] {
            let words = ["export", text(from), "--to", "isaaclab", "--out", text(to)];
            deadtime(&words).refused(&["would be lost"]);
        }
    }
    let bag = inputs.folder.path("bag");
    std::fs::create_dir(&bag).unwrap();
    for name in ["metadata.yaml", "bag_0.db3"] {
        std::fs::write(bag.join(name), "x").unwrap();
        deadtime(&["log", text(&bag), "--json", text(&bag.join(name))]).refused(&["would be lost"]);
    }
    // Two runs into one folder: the second one is refused while the first one works.
    let held = deadtime::file::Lock::of(&inputs.folder.path("held")).unwrap();
    let held_too = inputs.folder.path("held");
    let (model, log) = (text(&inputs.model), text(&inputs.log));
    deadtime(&["gap", "--model", model, "--log", log, "--out", text(&held_too)])
        .refused(&["writes there"]);
    drop(held);
    // What fails leaves no folder behind.
    let none = inputs.folder.path("none");
    deadtime(&["gap", "--model", model, "--log", model, "--out", text(&none)]).refused(&[]);
    assert!(!none.exists());
}

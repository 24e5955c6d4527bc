//! Bad input through the built program: exit code 2, a message that says what, where and what to do, and nothing left behind.

use std::fmt::Write as _;
use std::io::{BufWriter, Write as _};
use std::path::Path;

use crate::support::program::{Folder, Run, deadtime};

/// `time,u,y` with a rich input and a response three samples later.
fn good(samples: usize) -> String {
    let mut text = String::from("time,u,y\n");
    let (mut state, mut recent, mut y) = (1_u64, [0.0_f64; 3], 0.0_f64);
    for k in 0..samples {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = if state >> 63 == 0 { 1.0 } else { -1.0 };
        let wobble = ((state >> 20) % 1000) as f64 / 1e5;
        y = 0.6 * y + recent[2];
        recent = [u, recent[0], recent[1]];
        writeln!(text, "{},{u},{}", k as f64 / 10.0, y + wobble).unwrap();
    }
    text
}

/// The text with row `row` (as an editor counts) replaced.
fn with_row(text: &str, row: usize, replacement: &str) -> String {
    let lines =
        text.lines().enumerate().map(|(i, line)| if i + 1 == row { replacement } else { line });
    lines.collect::<Vec<_>>().join("\n") + "\n"
}

/// By two methods, where the test names none: what is bad shows before any method runs.
fn estimate(log: &Path, more: &[&str]) -> Run {
    let mut arguments = vec!["estimate", log.to_str().unwrap(), "--input", "u", "--output", "y"];
    arguments.extend(more);
    if !more.contains(&"--method") {
        arguments.extend(["--method", "arxstruc", "--method", "oestruc"]);
    }
    deadtime(&arguments)
}

fn estimate_by_all(log: &Path, more: &[&str]) -> Run {
    let arguments = ["estimate", log.to_str().unwrap(), "--input", "u", "--output", "y"];
    deadtime(&[&arguments, more].concat())
}

/// Writes the text as a log, runs `estimate` and expects a refusal that says all of this.
fn refused(text: &str, more: &[&str], says: &[&str]) -> String {
    let folder = Folder::new();
    let log = folder.write("log.csv", text);
    let run = estimate(&log, more);
    run.refused(says);
    assert!(
        run.stderr.contains("log.csv") || more.iter().any(|m| says.iter().any(|s| m.contains(s))),
        "which file? {}",
        run.stderr
    );
    assert_eq!(folder.names(), ["log.csv"], "something was left behind");
    run.stderr
}

#[test]
fn the_good_log_that_the_bad_ones_are_made_from_is_fine() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    assert!(estimate(&log, &[]).words().contains("Dead time 0.2"));
}

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::new();
    estimate(&folder.path("nowhere.csv"), &[]).refused(&["nowhere.csv", "no such file"]);
}

#[test]
fn a_folder_instead_of_a_file_is_named() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("logs.csv")).unwrap();
    estimate(&folder.path("logs.csv"), &[])
        .refused(&["logs.csv", "a folder without files that end in .mcap or .db3"]);
}

#[test]
fn an_empty_file_says_what_a_log_needs() {
    refused("", &[], &["empty", "header row", "time"]);
}

#[test]
fn a_header_alone_has_no_samples() {
    refused("time,u,y\n", &[], &["no samples", "at least one row"]);
}

#[test]
fn a_header_without_time_says_how_to_call_the_first_column() {
    refused("speed,u,y\n0,1,2\n", &[], &["row 1", "`speed`", "call it `time`", "--time COLUMN"]);
}

#[test]
fn text_in_a_number_column_names_row_and_channel() {
    let spoiled = with_row(&good(400), 57, "5.5,1,broken");
    refused(&spoiled, &[], &["row 57", "`y`", "`broken`", "no number", "empty"]);
    let spoiled = with_row(&good(400), 57, "5.5,half,0.5");
    refused(&spoiled, &[], &["row 57", "`u`", "`half`"]);
    let spoiled = with_row(&good(400), 57, "noon,1,0.5");
    refused(&spoiled, &[], &["row 57", "`time`", "`noon`"]);
}

#[test]
fn nan_and_infinity_name_row_and_channel() {
    for nothing in ["NaN", "nan", "-"] {
        refused(
            &with_row(&good(400), 100, &format!("9.8,{nothing},1")),
            &[],
            &["row 100", "input `u`", "only outputs may miss"],
        );
        refused(&with_row(&good(400), 100, &format!("{nothing},1,1")), &[], &["row 100", "`time`"]);
        let folder = Folder::new();
        let log = folder.write("log.csv", &with_row(&good(400), 100, &format!("9.8,1,{nothing}")));
        assert!(estimate(&log, &[]).words().contains("Dead time 0.2"), "{nothing}");
    }
    for bad in ["inf", "-inf", "Infinity", "1e999"] {
        refused(
            &with_row(&good(400), 100, &format!("9.8,1,{bad}")),
            &[],
            &["row 100", "`y`", bad, "finite", "empty"],
        );
        refused(&with_row(&good(400), 100, &format!("9.8,{bad},1")), &[], &["row 100", "`u`", bad]);
        refused(&with_row(&good(400), 100, &format!("{bad},1,1")), &[], &["row 100", "`time`"]);
    }
}

#[test]
fn time_that_stands_still_names_the_row() {
    refused(
        &with_row(&good(400), 60, "5.7,1,1"),
        &[],
        &["row 60", "stands still", "5.7", "more digits"],
    );
}

#[test]
fn time_that_runs_back_offers_records_and_the_offer_works() {
    let says = refused(
        &with_row(&good(400), 60, "1.25,1,1"),
        &[],
        &["row 60", "runs back", "1.25", "--records COLUMN"],
    );
    assert!(says.contains("sort the rows by time"));
    let text = good(300);
    let mut two = String::from("run,time,u,y\n").replace("run,time", "time,run");
    for run in ["a", "b"] {
        for line in text.lines().skip(1) {
            let (time, rest) = line.split_once(',').unwrap();
            writeln!(two, "{time},{run},{rest}").unwrap();
        }
    }
    refused(&two, &[], &["runs back", "--records"]);
    let folder = Folder::new();
    let log = folder.write("two.csv", &two);
    let out = estimate(&log, &["--records", "run"]).words();
    assert!(out.contains("in 2 records") && out.contains("Dead time 0.2"), "{out}");
    estimate(&log, &["--records", "runn"]).refused(&["`runn`", "did you mean `run`"]);
}

#[test]
fn uneven_time_offers_resample_and_the_offer_works() {
    let mut text = String::from("time,u,y\n");
    for (k, line) in good(500).lines().skip(1).enumerate() {
        let rest = line.split_once(',').unwrap().1;
        let time_s = k as f64 / 10.0 + if k % 7 == 3 { 0.02 } else { 0.0 };
        writeln!(text, "{time_s},{rest}").unwrap();
    }
    let says =
        refused(&text, &[], &["row ", "uneven", "--resample TS", "for instance `--resample 0.1`"]);
    let offered = says
        .split("for instance `--resample ")
        .nth(1)
        .unwrap()
        .split('`')
        .next()
        .unwrap()
        .to_owned();
    let folder = Folder::new();
    let log = folder.write("uneven.csv", &text);
    let out = estimate(&log, &["--resample", &offered]).words();
    assert!(out.contains("Dead time 0"), "{out}");
    for bad in ["0", "-1", "NaN", "inf"] {
        estimate(&log, &[&format!("--resample={bad}")]).refused(&["sample time", "above 0"]);
    }
    estimate(&log, &["--resample", "1e-12"]).refused(&["uneven.csv", "--resample TS", "larger"]);
}

#[test]
fn an_unknown_channel_lists_what_there_is_and_suggests() {
    let folder = Folder::new();
    let log = folder
        .write("log.csv", &good(400).replacen("time,u,y", "time,throttle [1],speed [m/s]", 1));
    let run = |input: &str, output: &str| {
        deadtime(&["estimate", log.to_str().unwrap(), "--input", input, "--output", output])
    };
    run("throtle", "speed").refused(&[
        "log.csv",
        "`throtle`",
        "did you mean `throttle`",
        "`throttle`, `speed`",
    ]);
    run("throttle", "Speed").refused(&["`Speed`", "did you mean `speed`"]);
    let far = run("zzzzzz", "speed");
    far.refused(&["`zzzzzz`", "`throttle`, `speed`"]);
    assert!(!far.stderr.contains("did you mean"), "{}", far.stderr);
}

#[test]
fn a_constant_channel_is_named_with_its_value() {
    let still = |column: usize| {
        let rows = good(400);
        let row = |line: &str| {
            let mut cells: Vec<&str> = line.split(',').collect();
            cells[column] =
                if cells[column].parse::<f64>().is_ok() { "3.5" } else { cells[column] };
            cells.join(",")
        };
        rows.lines().map(row).collect::<Vec<_>>().join("\n") + "\n"
    };
    refused(&still(1), &["--detrend", "none"], &["input `u` never changes", "3.5"]);
    refused(&still(2), &["--detrend", "none"], &["output `y` never changes", "3.5"]);
    // Its mean taken off it is 0; the message must still speak of the value in the file.
    refused(&still(1), &[], &["input `u` never changes", "3.5"]);
}

#[test]
fn a_log_too_short_for_some_methods_still_answers_by_the_others() {
    let folder = Folder::new();
    let log = folder.write("short.csv", &good(110));
    let out = estimate_by_all(&log, &["--full"]).words();
    // 71 taps need 143 samples.
    assert!(
        out.contains("threshold needs at least 143 samples")
            && out.contains("has 110")
            && out.contains("--max-delay"),
        "{out}"
    );
    assert!(out.contains("Dead time 0.2"), "{out}");
    let tiny = folder.write("tiny.csv", &good(20));
    let short = estimate_by_all(&tiny, &["--max-delay", "1.8"]).words();
    assert!(
        short.contains("No trusted dead time") && short.contains("20 samples are too few"),
        "{short}"
    );
    let out = estimate_by_all(&tiny, &["--max-delay", "1.8", "--full"]).words();
    for method in ["oestruc", "arxstruc", "threshold_step"] {
        assert!(out.contains(&format!("{method}: too few samples")), "{out}");
    }
    assert!(out.contains("No trusted dead time"), "{out}");
    let single = folder.write("single.csv", &good(1));
    estimate(&single, &[]).refused(&["single.csv", "1 samples", "at least 2"]);
}

#[test]
fn missing_cells_are_refused_in_an_input_and_taken_in_an_output() {
    refused(
        &with_row(&good(400), 31, "2.9,,0.4"),
        &[],
        &["row 31", "input `u`", "2.9", "only outputs may miss"],
    );
    refused(&with_row(&good(400), 31, ",1,0.4"), &[], &["row 31", "`time` cell is empty"]);
    refused(&with_row(&good(400), 31, "2.9,1"), &[], &["row 31", "2 cells", "header has 3"]);
    let folder = Folder::new();
    let mut text = good(600);
    for row in (20..550).step_by(37) {
        let line = text.lines().nth(row - 1).unwrap().to_owned();
        let kept = line.rsplit_once(',').unwrap().0;
        text = with_row(&text, row, &format!("{kept},"));
    }
    let log = folder.write("gaps.csv", &text);
    let out = estimate(&log, &[]).words();
    assert!(out.contains("Dead time 0.2"), "{out}");
    let rows: Vec<String> =
        good(300).lines().skip(1).map(|l| l.rsplit_once(',').unwrap().0.to_owned() + ",").collect();
    refused(&format!("time,u,y\n{}\n", rows.join("\n")), &[], &["`y`", "no sample in any row"]);
}

#[test]
fn a_binary_file_and_a_damaged_gz_are_told_from_logs() {
    let folder = Folder::new();
    let binary: Vec<u8> =
        (0..5000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let run = estimate(&folder.write_bytes("image.csv", &binary), &[]);
    run.refused(&["image.csv", "row 1"]);
    let mut compressed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    compressed.write_all(good(2000).as_bytes()).unwrap();
    let whole = compressed.finish().unwrap();
    let fine = folder.write_bytes("whole.csv.gz", &whole);
    // The truth is 0.2 s; a median of many methods is no grid value.
    let near =
        |said: &str| ["0.19", "0.20"].iter().any(|d| said.contains(&format!("Dead time {d}")));
    let said = estimate(&fine, &[]).words();
    assert!(near(&said), "{said}");
    let cut = folder.write_bytes("cut.csv.gz", &whole[..whole.len() / 2]);
    let run = estimate(&cut, &[]);
    assert!(
        run.stderr.contains("cut off") && run.stderr.contains("read up to row"),
        "{}",
        run.stderr
    );
    assert!(near(&run.words()));
    let mut damaged = whole.clone();
    damaged.iter_mut().rev().skip(7).take(1).for_each(|byte| *byte ^= 1);
    estimate(&folder.write_bytes("damaged.csv.gz", &damaged), &[]).refused(&[
        "damaged.csv.gz",
        "gzip",
        "cut off after row",
        "copy or compress",
    ]);
    let plain = folder.write("plain.csv.gz", &good(300));
    estimate(&plain, &[]).refused(&["plain.csv.gz", "not compressed", "rename it to .csv"]);
}

#[test]
fn bad_options_are_refused_with_what_they_may_be() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    let refuse = |more: &[&str], says: &[&str]| estimate(&log, more).refused(says);
    for delay in ["0", "40", "1000"] {
        refuse(&["--max-delay", delay], &["--max-delay", "at least one sample", "400 samples"]);
    }
    for delay in ["-1", "NaN", "inf"] {
        refuse(&[&format!("--max-delay={delay}")], &["delay", "0 or more"]);
    }
    refuse(&["--max-delay", "soon"], &["--max-delay", "soon"]);
    refuse(&["--method", "oestuc"], &["no method `oestuc`", "oestruc", "state_least_squares"]);
    refuse(&["--set", "nf=3"], &["--set nf=3", "METHOD.KEY=VALUE"]);
    refuse(&["--set", "oestruc.nf"], &["--set oestruc.nf", "METHOD.KEY=VALUE"]);
    refuse(&["--set", "oestruk.nf=3"], &["no method `oestruk`"]);
    refuse(&["--set", "oestruc.nff=3"], &["oestruc", "nff", "max_samples"]);
    refuse(&["--set", "oestruc.nf=many"], &["oestruc", "many"]);
    refuse(&["--set", "oestruc.nf=-1"], &["oestruc", "-1"]);
    refuse(&["--map", "u"], &["--map u", "MODEL_NAME=COLUMN"]);
    refuse(&["--map", "v=w"], &["`w`", "`u`, `y`"]);
    refuse(&["--map", "y=u"], &["`--map` makes two columns called `y`"]);
    refuse(&["--from", "30", "--to", "10"], &["log.csv", "no sample", "--from S --to S"]);
    refuse(&["--detrend", "twice"], &["twice", "mean"]);
    refuse(&["--degree-bias=-1"], &["-1"]);
    refuse(&["--threads", "none"], &["none"]);
}

#[test]
fn an_option_out_of_range_is_refused_with_what_it_may_be() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    estimate(&log, &["--method", "threshold", "--set", "threshold.h_std=-2"])
        .refused(&["threshold: h_std = -2", "above 0"]);
}

#[test]
fn a_model_of_unknown_kind_or_format_says_what_is_read() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    let model = |name: &str, format: &str, kind: &str| {
        let text = format!(
            "format = \"{format}\"\nname = \"m\"\nkind = \"{kind}\"\ninputs = [{{ name = \"u\" }}]\nstates = [{{ name = \"x\" }}]\n\
             outputs = [{{ name = \"y\" }}]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]\nD = [[0.0]]\n"
        );
        folder.write(name, &text)
    };
    let with = |model: &Path| estimate_by_all(&log, &["--model", model.to_str().unwrap()]);
    with(&model("kind.toml", "deadtime/model@1", "neural")).refused(&[
        "kind.toml",
        "kind is `neural`",
        "lti",
    ]);
    with(&model("format.toml", "deadtime/model@9", "lti")).refused(&[
        "format.toml",
        "format is `deadtime/model@9`",
        "deadtime/model@1",
    ]);
    with(&model("model.yaml", "deadtime/model@1", "lti"))
        .refused(&["model.yaml", ".toml or .json"]);
    with(&folder.path("none.toml")).refused(&["none.toml", "no such file"]);
    with(&folder.write("broken.toml", "format = \"deadtime/model@1\"\nA = [[1.0\n"))
        .refused(&["broken.toml", "line"]);
    let ragged = folder.write(
        "ragged.toml",
        &std::fs::read_to_string(model("m.toml", "deadtime/model@1", "lti"))
            .unwrap()
            .replace("[[-1.0]]", "[[-1.0, 2.0]]"),
    );
    with(&ragged).refused(&["ragged.toml", "matrix A", "1 by 2", "1 by 1"]);
    assert!(with(&folder.path("m.toml")).done().contains("state_least_squares"));
}

#[test]
fn an_output_that_cannot_be_written_is_an_error_and_leaves_nothing() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    // A file where a folder would be needed: refused for every user, root too.
    let blocked = folder.write("file", "kept").join("out.json");
    estimate(&log, &["--json", blocked.to_str().unwrap()]).refused(&["out.json"]);
    assert_eq!(std::fs::read_to_string(folder.path("file")).unwrap(), "kept");
    // A folder of the name that the result should get.
    std::fs::create_dir(folder.path("taken.json")).unwrap();
    estimate(&log, &["--json", folder.path("taken.json").to_str().unwrap()])
        .refused(&["taken.json"]);
    assert_eq!(folder.names(), ["file", "log.csv", "taken.json"]);
}

#[test]
fn a_refused_job_leaves_an_earlier_result_as_it_was() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &with_row(&good(400), 99, "9.7,1,x"));
    let json = folder.write("result.json", "earlier");
    estimate(&log, &["--json", json.to_str().unwrap()]).refused(&["row 99"]);
    let model = folder.write("model.toml", "kind = \"lti\"");
    deadtime(&[
        "simulate",
        model.to_str().unwrap(),
        log.to_str().unwrap(),
        "--out",
        json.to_str().unwrap(),
    ])
    .refused(&["model.toml"]);
    deadtime(&[
        "excite",
        "rbs",
        "--samples",
        "0",
        "--sample-time",
        "1",
        "--out",
        json.to_str().unwrap(),
    ])
    .refused(&["at least 1"]);
    deadtime(&[
        "c2d",
        model.to_str().unwrap(),
        "--sample-time",
        "1",
        "--out",
        json.to_str().unwrap(),
    ])
    .refused(&["model.toml"]);
    assert_eq!(std::fs::read_to_string(&json).unwrap(), "earlier");
    assert_eq!(folder.names(), ["log.csv", "model.toml", "result.json"]);
}

/// `time,u,y` of many rows, every second one; y follows u four samples later.
fn long(path: &Path, rows: usize) {
    let mut out = BufWriter::with_capacity(1 << 20, std::fs::File::create(path).unwrap());
    out.write_all(b"time,u,y\n").unwrap();
    let (mut state, mut y) = (88_172_645_463_325_252_u64, 0_i64);
    let mut recent = [0_i64; 4];
    let mut line = Vec::with_capacity(40);
    for k in 0..rows {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let u = if state & 1 == 0 { 1 } else { -1 };
        // y in thousandths: y(k) = 0.6 y(k − 1) + u(k − 4), rounded as a sensor does.
        y = 6 * y / 10 + 1000 * recent[3];
        recent = [u, recent[0], recent[1], recent[2]];
        line.clear();
        number(&mut line, k as u64);
        line.extend_from_slice(if u > 0 { b",1," } else { b",-1," });
        if y < 0 {
            line.push(b'-');
        }
        number(&mut line, y.unsigned_abs());
        line.push(b'\n');
        out.write_all(&line).unwrap();
    }
    out.flush().unwrap();
}

fn number(line: &mut Vec<u8>, mut n: u64) {
    let from = line.len();
    loop {
        line.push(b'0' + (n % 10) as u8);
        n /= 10;
        if n == 0 {
            break;
        }
    }
    line[from..].reverse();
}

#[test]
#[ignore = "nightly: three million rows"]
fn three_million_rows_are_answered() {
    let folder = Folder::new();
    let log = folder.path("long.csv");
    long(&log, 3_000_000);
    let clock = std::time::Instant::now();
    let out = estimate(&log, &["--method", "arxstruc"]).words();
    println!(
        "3 million rows, {} MB: {:.1} s",
        std::fs::metadata(&log).unwrap().len() / 1_000_000,
        clock.elapsed().as_secs_f64()
    );
    assert!(
        out.contains("3000000 samples, one every 1 s") && out.contains("Dead time 3.00 s"),
        "{out}"
    );
}

#[test]
fn oestruc_says_how_much_of_a_long_log_it_used() {
    let folder = Folder::new();
    let log = folder.path("long.csv");
    long(&log, 3000);
    let out = estimate(&log, &["--method", "oestruc", "--set", "oestruc.max_samples=1000"]).words();
    assert!(
        out.contains("used the first 1000 of 3000 samples") && out.contains("Dead time 3.00 s"),
        "{out}"
    );
    let all = estimate(&log, &["--method", "oestruc"]).words();
    assert!(!all.contains("used the first"), "{all}");
}

#[test]
fn a_channel_that_is_given_twice_is_refused() {
    let folder = Folder::new();
    let log = folder.write("log.csv", &good(400));
    estimate(&log, &["--input", "u"]).refused(&["`u` is given twice"]);
    estimate(&log, &["--output", "y"]).refused(&["`y` is given twice"]);
}

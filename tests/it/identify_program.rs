//! `deadtime identify` as a user runs it.

use std::fmt::Write as _;
use std::path::Path;

use crate::support::program::{Folder, Run, deadtime, text};
use serde_json::Value;

/// `time,u,y`: y = 0.6 y + u three samples late + noise; `step` seconds a row.
fn log(samples: usize, step: impl Fn(usize) -> f64) -> String {
    let mut text = String::from("time,u [V],y [m],still\n");
    let (mut state, mut late, mut y) = (7_u64, [0.0_f64; 3], 0.0_f64);
    for k in 0..samples {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = if state >> 63 == 0 { 1.0 } else { -1.0 };
        let noise = ((state >> 20) % 1000) as f64 / 5e3 - 0.1;
        writeln!(text, "{},{},{},5", step(k), u + 4.0, y + noise + 20.0).unwrap();
        y = 0.6 * y + late[2];
        late = [u, late[0], late[1]];
    }
    text
}

fn identify(log: &Path, more: &[&str]) -> Run {
    deadtime(&[&["identify", text(log)], more].concat())
}

#[test]
fn the_model_of_a_log_simulates_the_log() {
    let folder = Folder::new();
    let data = folder.write("log.csv", &log(800, |k| k as f64 / 10.0));
    let (model, json) = (folder.path("model.toml"), folder.path("model.json"));
    let said = identify(
        &data,
        &[
            "--input",
            "u",
            "--output",
            "y",
            "--out",
            text(&model),
            "--json",
            text(&json),
            "--continuous",
            "--method",
            "pbsidopt",
        ],
    )
    .done();
    assert!(said.contains("order 1") && said.contains("dead time 0.3"), "{said}");
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(found["format"], "deadtime/identify@1");
    assert!((found["input_delay_s"][0].as_f64().unwrap() - 0.3).abs() < 1e-9, "{found}");
    let pole = found["poles"][0]["re"].as_f64().unwrap();
    assert!((pole - 0.6).abs() < 0.02, "{pole}");
    // Noise of ±0.1 on an output of standard deviation 1.25.
    let nrmse = found["held_out"]["outputs"][0]["simulation"]["nrmse"].as_f64().unwrap();
    assert!((0.03..0.07).contains(&nrmse), "{nrmse}");
    let out = folder.path("simulated.csv");
    let said = deadtime(&["simulate", text(&model), text(&data), "--out", text(&out)]).done();
    let nrmse: f64 = said
        .split("nrmse ")
        .nth(1)
        .and_then(|t| t.split(' ').next())
        .and_then(|t| t.parse().ok())
        .unwrap();
    // From the model's own start, which is not the log's.
    assert!(nrmse < 0.15, "{said}");
}

#[test]
fn without_a_method_all_are_compared_and_the_simplest_good_one_is_kept() {
    let folder = Folder::new();
    let data = folder.write("log.csv", &log(800, |k| k as f64 / 10.0));
    let json = folder.path("model.json");
    let words = ["--input", "u", "--output", "y", "--json", text(&json)];
    let said = identify(&data, &words).done();
    assert!(
        said.contains("Compared on validation data") && said.contains("No model file"),
        "{said}"
    );
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let tried = found["compared"]["candidates"].as_array().unwrap();
    let chosen: Vec<&Value> = tried.iter().filter(|c| c["chosen"] == true).collect();
    let [chosen] = chosen[..] else { panic!("{tried:?}") };
    assert_eq!(chosen["method"], found["method"]);
    assert!(chosen["parameters"].as_u64().unwrap() <= 4, "{chosen}");
    assert!((chosen["dead_time_s"][0].as_f64().unwrap() - 0.3).abs() <= 0.05, "{chosen}");
    for kind in ["pbsidopt", "riv", "p1d"] {
        assert!(tried.iter().any(|c| c["method"] == kind), "{kind}: {tried:?}");
    }
}

#[test]
fn names_of_other_tools_lead_to_the_method_or_say_which_command_answers() {
    let folder = Folder::new();
    let data = folder.write("log.csv", &log(400, |k| k as f64 / 10.0));
    let words = ["--input", "u", "--output", "y", "--method"];
    for (name, method) in [("bj", "riv"), ("OE", "riv"), ("arx", "pbsidopt")] {
        let run = identify(&data, &[&words[..], &[name]].concat());
        assert!(run.stderr.contains(&format!("{method} is used")), "{}", run.stderr);
        assert!(run.done().starts_with(method), "{name}");
    }
    for (name, instead) in
        [("procest", "p1d"), ("delayest", "deadtime estimate"), ("spa", "deadtime response")]
    {
        identify(&data, &[&words[..], &[name]].concat()).refused(&[name, instead]);
    }
    identify(&data, &[&words[..], &["p1s"]].concat()).refused(&["did you mean `p1d`"]);
}

/// The simulated output of `model` on `data`, as `simulate` writes it.
fn simulated(folder: &Folder, model: &Path, data: &Path) -> Vec<f64> {
    let out = folder.path("simulated.csv");
    deadtime(&["simulate", text(model), text(data), "--out", text(&out)]).done();
    let csv = std::fs::read_to_string(&out).unwrap();
    let mut lines = csv.lines();
    let at = lines.next().unwrap().split(',').position(|name| name.starts_with('y')).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

#[test]
fn process_models_and_transfer_functions_make_files_that_simulate_the_machine() {
    let folder = Folder::new();
    // K = 2, T = 3 s, a dead time of 0.73 s, every 0.1 s, in closed form; at rest at 4 V and 20 m, stepped and stepped back.
    let step = |t: f64| if t < 0.73 { 0.0 } else { 2.0 * (1.0 - (-(t - 0.73) / 3.0).exp()) };
    let mut csv = String::from("time,u [V],y [m]\n");
    let mut machine = Vec::new();
    for k in 0..600 {
        let t = f64::from(k) / 10.0;
        machine.push(20.0 + 1.5 * step(t - 3.0) - 2.5 * step(t - 20.0) + 1.75 * step(t - 31.0));
        let u = 4.0
            + [(3.0, 1.5), (20.0, -2.5), (31.0, 1.75)]
                .iter()
                .filter(|(at, _)| t >= *at)
                .map(|(_, jump)| jump)
                .sum::<f64>();
        writeln!(csv, "{t},{u},{:.12}", machine[k as usize]).unwrap();
    }
    let data = folder.write("log.csv", &csv);
    let (model, json, page) =
        (folder.path("model.toml"), folder.path("model.json"), folder.path("page.html"));
    let both = [
        "--input",
        "u",
        "--output",
        "y",
        "--out",
        text(&model),
        "--json",
        text(&json),
        "--html",
        text(&page),
    ];
    for (method, most) in [("p1d", 1e-3), ("p2d", 1e-2), ("riv", 0.05)] {
        let said = identify(&data, &[&both[..], &["--method", method]].concat()).done();
        assert!(said.contains("on held-out data") && !said.contains("order 1"), "{said}");
        let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        assert_eq!(found["format"], "deadtime/identify@1");
        assert!(
            !found["parameters"].as_array().unwrap().is_empty() && found["structure"].is_string(),
            "{found}"
        );
        assert!(
            std::fs::read_to_string(&page).unwrap().contains("Parameters, with 95 % intervals")
        );
        let y = simulated(&folder, &model, &data);
        // The file starts at its operating point, which is the mean, and not at rest: after ten time constants that is forgotten.
        let far = y.iter().zip(&machine).skip(350).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < most, "{method}: {far}");
        if method == "p1d" {
            let value = |name: &str| {
                found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap()
                    ["value"]
                    .as_f64()
                    .unwrap()
            };
            assert!(
                (value("K") - 2.0).abs() < 1e-4
                    && (value("T1") - 3.0).abs() < 1e-3
                    && (value("dead_time") - 0.73).abs() < 1e-3,
                "{found}"
            );
            assert_eq!(found["parameters"][0]["unit"], "m/V");
        }
    }
    let with = |more: &[&str]| identify(&data, &[&both[..6], more].concat());
    with(&["--method", "p1d", "--delay", "u=0.5"])
        .refused(&["p1d finds the dead times itself", "--delay"]);
    with(&["--method", "riv", "--past", "9"]).refused(&["past", "nf"]);
    with(&["--method", "p0di"]).refused(&["p0di"]);
    let listed = deadtime(&["list", "identifiers"]).done();
    assert!(
        ["riv", "srivc", "p1d", "p1dz", "p2d", "p2dz", "p0di", "p1di"]
            .iter()
            .all(|name| listed.contains(&format!("{name}\n"))),
        "{listed}"
    );
}

#[test]
fn what_cannot_be_identified_is_refused_with_a_remedy_and_no_file() {
    let folder = Folder::new();
    let data = folder.write("log.csv", &log(200, |k| k as f64 / 10.0));
    let uneven = folder
        .write("uneven.csv", &log(200, |k| k as f64 / 10.0 + if k % 7 == 3 { 0.04 } else { 0.0 }));
    let out = folder.path("m.toml");
    let both = ["--input", "u", "--output", "y", "--out", text(&out)];
    let with = |more: &[&str]| identify(&data, &[&both[..], more].concat());
    with(&["--past", "90"]).refused(&["past window of 90", "or less"]);
    with(&["--order", "two"]).refused(&["--order two", "auto"]);
    with(&["--method", "subspacey"]).refused(&["subspacey", "pbsidopt", "n4sid", "moesp"]);
    with(&["--set", "passed=3"]).refused(&["passed", "max_order"]);
    with(&["--delay", "v=0.1"]).refused(&["--delay v=0.1", "INPUT=SECONDS"]);
    identify(&data, &["--input", "still", "--output", "y", "--out", text(&out), "--delay", "none"])
        .refused(&["still", "never changes"]);
    identify(&data, &["--input", "u", "--output", "u", "--out", text(&out)])
        .refused(&["`u` is named twice"]);
    identify(&data, &["--input", "w", "--output", "y", "--out", text(&out)]).refused(&["`w`"]);
    identify(&uneven, &both).refused(&["uneven.csv", "--resample"]);
    assert!(!out.exists());
}

#[test]
fn a_template_has_the_channels_of_the_log_and_is_read_as_it_stands() {
    let folder = Folder::new();
    let data = folder.write("log.csv", &log(50, |k| k as f64 / 10.0));
    for (kind, says) in
        [("linear", "A = "), ("process", "numerator"), ("equations", "[derivatives]")]
    {
        let model = folder.path(&format!("{kind}.toml"));
        deadtime(&[
            "model",
            "new",
            kind,
            "--log",
            text(&data),
            "--input",
            "u",
            "--output",
            "y",
            "--output",
            "still",
            "--out",
            text(&model),
        ])
        .done();
        let written = std::fs::read_to_string(&model).unwrap();
        assert!(
            written.contains(says) && written.contains("unit = \"V\"") && written.contains("# "),
            "{written}"
        );
        let out = folder.path("out.csv");
        deadtime(&["simulate", text(&model), text(&data), "--out", text(&out)]).done();
    }
    let out = folder.path("none.toml");
    deadtime(&["model", "new", "linear", "--log", text(&data), "--out", text(&out)])
        .refused(&["--input", "u, y, still"]);
    deadtime(&[
        "model",
        "new",
        "linear",
        "--log",
        text(&data),
        "--input",
        "w",
        "--output",
        "y",
        "--out",
        text(&out),
    ])
    .refused(&["`w`"]);
    assert!(!out.exists());
}

#[test]
fn a_template_holds_the_level_of_channels_that_move_about_one() {
    let folder = Folder::new();
    let rows = (0..200).map(|k| {
        let moves = if k % 2 == 0 { 1.0 } else { -1.0 };
        format!(
            "{},{},{},{}\n",
            f64::from(k) / 10.0,
            230.0 + 5.0 * moves,
            -0.0312 + 0.01 * moves,
            0.4 + moves
        )
    });
    let data = folder.write("log.csv", &format!("time,u,y,z\n{}", rows.collect::<String>()));
    let model = folder.path("m.toml");
    let channels = ["--input", "u", "--output", "y", "--output", "z"];
    let start = ["model", "new", "process", "--log", text(&data), "--out", text(&model)];
    deadtime(&[&start[..], &channels].concat()).done();
    let written = std::fs::read_to_string(&model).unwrap();
    for says in ["\"u\", operating = 230.0", "\"y\", operating = -0.0312", "\"z\", operating = 0.0"]
    {
        assert!(written.contains(says), "{says}: {written}");
    }
}

#[test]
fn a_quadrotors_template_finds_the_logs_columns_and_is_the_shipped_model_otherwise() {
    let folder = Folder::new();
    let own = "m1_rads m2_rads m3_rads m4_rads x y z vx vy vz qx qy qz qw wx wy wz"
        .split(' ')
        .collect::<Vec<_>>();
    let log = |names: &[&str]| {
        let rows = (0..60).map(|k| {
            let hover = [1722.0; 4]
                .iter()
                .chain(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
            let row: Vec<String> = hover.take(names.len()).map(ToString::to_string).collect();
            format!("{},{}\n", f64::from(k) / 100.0, row.join(","))
        });
        format!("time,{}\n{}", names.join(","), rows.collect::<String>())
    };
    let new = |name: &str, log: &str| {
        let (data, model) =
            (folder.write(&format!("{name}.csv"), log), folder.path(&format!("{name}.toml")));
        let said =
            deadtime(&["model", "new", "quadrotor", "--log", text(&data), "--out", text(&model)])
                .done();
        let out = folder.path("out.csv");
        (said, std::fs::read_to_string(&model).unwrap(), move || {
            deadtime(&["simulate", text(&model), text(&data), "--out", text(&out)]).done();
            std::fs::read_to_string(&out).unwrap()
        })
    };
    let (said, same, simulated) = new("quadrotor", &log(&own));
    assert!(
        said.contains("17 of 17 channels")
            && same.ends_with(include_str!("../../examples/quadrotor.toml")),
        "{said}"
    );
    let own_names = simulated();
    let other = "motor_1 motor_2 motor_3 motor_4 pos_x pos_y pos_z vel_x vel_y vel_z quat_x quat_y quat_z quat_w p q r"
        .split(' ')
        .collect::<Vec<_>>();
    let (said, text_of, simulated) = new("other", &log(&other));
    assert!(said.contains("17 of 17 channels"), "{said}");
    assert!(
        text_of.contains("n1 = \"motor_1 - motor_lag*m1_slope\"")
            && text_of.contains("derivative_of = \"motor_1\""),
        "{text_of}"
    );
    // Names apart, the same flight.
    let numbers = |csv: &str| csv.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(numbers(&own_names), numbers(&simulated()));
    let (said, _, _) = new("few", &log(&own[..7]));
    assert!(
        said.contains("7 of 17 channels") && said.contains("not found: vx, vy, vz, qx"),
        "{said}"
    );
    let out = folder.path("refused.toml");
    deadtime(&["model", "new", "quadrotor", "--input", "u", "--out", text(&out)])
        .refused(&["--log alone", "--map"]);
    assert!(!out.exists());
}

#[test]
fn the_line_that_a_diagnosis_prints_fits_the_parameters_that_it_found() {
    let folder = Folder::new();
    let model = folder.write(
        "cart file.toml",
        "format = \"deadtime/model@1\"\nname = \"cart\"\nkind = \"equations\"\ninputs = [{ name = \"u\" }]\noutputs = [{ name = \"v\" }]\n\
         [states]\nv = { unit = \"m/s\", initial_std = 0.0 }\n[parameters]\nmass = { value = 2.0 }\nloss = { value = 1.0 }\n[derivatives]\nv = \"(u - loss*v)/mass\"\n[output_equations]\nv = \"v\"\n",
    );
    // A mass of 2.6, exact for a held input; stamps that jitter, and the channel under another name.
    let mut csv = String::from("time,u,speed\n");
    let (mut state, mut time, mut v, mut u) = (9_u64, 0.0_f64, 0.0_f64, 0.0_f64);
    for k in 0..900 {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        if k % 15 == 0 {
            u = (state >> 40) as f64 / (1 << 23) as f64 - 1.0;
        }
        let noise = ((state >> 20) % 1000) as f64 / 1e5 - 0.005;
        writeln!(csv, "{time},{u},{}", v + noise).unwrap();
        let step = 0.05 * (1.0 + 0.2 * ((state >> 30) % 100) as f64 / 100.0);
        let decay = (-step / 2.6).exp();
        v = v * decay + u * (1.0 - decay);
        time += step;
    }
    let data = folder.write("a.csv", &csv);
    let said =
        deadtime(&["gap", "--model", text(&model), "--log", text(&data), "--map", "v=speed"])
            .done();
    let line = said.lines().find(|l| l.contains("deadtime identify --structure")).expect(&said);
    let words: Vec<String> = line
        .trim()
        .split('"')
        .enumerate()
        .flat_map(|(at, part)| match at % 2 {
            0 => part.split_whitespace().map(str::to_owned).collect(),
            _ => vec![part.to_owned()],
        })
        .collect();
    let mut words: Vec<&str> = words.iter().skip(1).map(String::as_str).collect();
    let at = words.iter().position(|w| *w == "fitted.toml").expect(line);
    let fitted = folder.path("fitted.toml");
    words[at] = text(&fitted);
    deadtime(&words).done();
    let file: toml::Table = std::fs::read_to_string(&fitted).unwrap().parse().unwrap();
    let mass = file["parameters"]["mass"]["value"].as_float().unwrap();
    assert!((mass - 2.6).abs() < 0.05, "{mass}: {line}");
}

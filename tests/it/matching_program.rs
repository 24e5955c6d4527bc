//! `deadtime identify --structure --match` as a user runs it.

use std::fmt::Write as _;

use serde_json::Value;

use crate::report_html::drawn;
use crate::report_pages::stands;
use crate::support::program::{Folder, deadtime, text};

const LAG: &str = r#"
format = "deadtime/model@1"
name = "lag"
kind = "equations"
inputs = [{ name = "u", unit = "V" }]
outputs = [{ name = "y", unit = "m" }]
[states]
x = { unit = "m" }
[parameters]
gain = { unit = "m/V", value = 1.0 }
tau = { unit = "s", value = 0.5 }
[derivatives]
x = "(gain*u - x)/tau"
[output_equations]
y = "x"
"#;

/// y = 0.6 y + u three samples late, with noise on the output: gain 2.5, time constant 0.1/ln(1/0.6) s, 0.3 s late.
fn log() -> String {
    let mut text = String::from("time,u [V],y [m]\n");
    let (mut state, mut late, mut y) = (7_u64, [0.0_f64; 3], 0.0_f64);
    for k in 0..2000 {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = if state >> 63 == 0 { 1.0 } else { -1.0 };
        let noise = ((state >> 20) % 1000) as f64 / 5e3 - 0.1;
        writeln!(text, "{},{},{}", k as f64 / 10.0, u + 4.0, y + noise + 20.0).unwrap();
        y = 0.6 * y + late[2];
        late = [u, late[0], late[1]];
    }
    text
}

#[test]
fn from_a_log_to_an_identified_model_to_physical_parameters() {
    let folder = Folder::new();
    let (data, lag) = (folder.write("log.csv", &log()), folder.write("lag.toml", LAG));
    let [model, identified, matched, out] =
        ["model.toml", "model.json", "matched.json", "found.toml"].map(|f| folder.path(f));
    deadtime(&[
        "identify",
        text(&data),
        "--input",
        "u",
        "--output",
        "y",
        "--order",
        "1",
        "--out",
        text(&model),
        "--json",
        text(&identified),
    ])
    .done();
    let truth = [("gain", 2.5), ("tau", 0.1 / (1.0_f64 / 0.6).ln()), ("delay:u", 0.3)];
    let run = |what: &std::path::Path, more: &[&str]| {
        let common = [
            "identify",
            "--structure",
            text(&lag),
            "--match",
            text(what),
            "--free",
            "gain,tau,delay:u",
            "--json",
            text(&matched),
        ];
        let said = deadtime(&[&common[..], more].concat()).done();
        let found: Value =
            serde_json::from_str(&std::fs::read_to_string(&matched).unwrap()).unwrap();
        (said, found)
    };
    let page = folder.path("page.html");
    let (said, found) = run(&identified, &["--out", text(&out), "--html", text(&page)]);
    assert_eq!(found["format"], "deadtime/match@1");
    page_of(&std::fs::read_to_string(&page).unwrap(), &found);
    assert!(
        said.contains("delay:u") && said.contains("Nu-gap") && said.contains("standard deviations"),
        "{said}"
    );
    for ((name, truth), p) in truth.iter().zip(found["parameters"].as_array().unwrap()) {
        let (value, std) = (p["value"].as_f64().unwrap(), p["std"].as_f64().unwrap());
        // A delay that was taken out as whole samples is known to half a sample: uniform within one.
        let (within, known) = if *name == "delay:u" {
            (0.05, (std - 0.1 / 12.0_f64.sqrt()).abs() < 1e-3)
        } else {
            (0.05 * truth, std < 0.03 * truth)
        };
        assert!(p["name"] == *name && (value - truth).abs() < within && known, "{p}");
        assert!(p["standing"] == "unchecked", "{p}");
    }
    // Everything can be had: nothing of the exact delay hides the rest, and every start ends at one minimum.
    assert!(
        found["unseen"].as_array().unwrap().is_empty()
            && found["converged"] == true
            && found["starts"][1].as_u64() > Some(4),
        "{found}"
    );
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(written.contains("input_delay_s") && !written.contains("value = 1.0"), "{written}");
    // The file without uncertainty has the same minimum nearly, no intervals, and says so.
    let (said, found) = run(&model, &["--norm", "hinf", "--band", "0.5:30", "--starts", "2"]);
    assert!(said.contains("says nothing of its uncertainty"), "{said}");
    for ((_, truth), p) in truth.iter().zip(found["parameters"].as_array().unwrap()) {
        assert!(
            p["std"].is_null() && (p["value"].as_f64().unwrap() / truth - 1.0).abs() < 0.05,
            "{p}"
        );
    }
}

/// The page is well formed, and draws the responses that the JSON has.
fn page_of(page: &str, found: &Value) {
    let said = stands(page);
    assert!(
        said.contains("lag matched to model")
            && said.contains("delay:u")
            && said.contains("Nu-gap"),
        "{said}"
    );
    let data = drawn(page);
    let view = &data["figures"][0]["views"][0];
    let points = found["responses"][0]["points"].as_array().unwrap();
    assert_eq!(view["x"]["values"].as_array().unwrap().len(), points.len());
    let gain = |p: &Value| p[0].as_f64().unwrap().hypot(p[1].as_f64().unwrap());
    for (at, p) in points.iter().enumerate() {
        for (curve, of) in ["identified", "nominal", "found"].into_iter().enumerate() {
            let drawn = view["curves"][curve]["y"][at].as_f64().unwrap();
            assert!((drawn / gain(&p[of]) - 1.0).abs() < 1e-9, "{of} at {p}");
        }
        // What was found is near what was identified; the file's values are not.
        assert!((gain(&p["found"]) / gain(&p["identified"]) - 1.0).abs() < 0.05, "{p}");
        let [low, high] = ["low", "high"].map(|end| view["curves"][0][end][at].as_f64().unwrap());
        let std = p["std"][0].as_f64().unwrap();
        assert!((high - low - 2.0 * 1.96 * std).abs() < 1e-3 * std, "{low} {high} {std}");
    }
}

#[test]
fn a_linear_structure_has_its_entries_as_parameters() {
    let folder = Folder::new();
    let lti = |name: &str, a: f64| {
        let text = format!(
            "format = \"deadtime/model@1\"\nname = \"{name}\"\nkind = \"lti\"\ninputs = [{{ name = \"u\" }}]\nstates = [{{ name = \"x\" }}]\n\
             outputs = [{{ name = \"y\" }}]\nA = [[{a}]]\nB = [[2.0]]\nC = [[1.0]]\nD = [[0.0]]\n"
        );
        folder.write(&format!("{name}.toml"), &text)
    };
    let (structure, identified, json) =
        (lti("structure", -1.0), lti("identified", -3.0), folder.path("m.json"));
    deadtime(&[
        "identify",
        "--structure",
        text(&structure),
        "--match",
        text(&identified),
        "--free",
        "all",
        "--json",
        text(&json),
    ])
    .done();
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    for (p, (name, value)) in
        found["parameters"].as_array().unwrap().iter().zip([("A_x_x", -3.0), ("B_x_u", 2.0)])
    {
        assert!(p["name"] == name && (p["value"].as_f64().unwrap() - value).abs() < 1e-6, "{p}");
    }
}

#[test]
fn what_cannot_be_matched_is_refused_with_a_remedy_and_no_file() {
    let folder = Folder::new();
    let (data, lag, out) =
        (folder.write("log.csv", &log()), folder.write("lag.toml", LAG), folder.path("out.toml"));
    let broken = folder.write("broken.json", "{\"format\": \"deadtime/identify@1\", \"rows\": 3}");
    let refused = |more: &[&str], words: &[&str]| {
        deadtime(
            &[
                &["identify", "--structure", text(&lag), "--free", "gain", "--out", text(&out)],
                more,
            ]
            .concat(),
        )
        .refused(words);
    };
    refused(&["--match", text(&lag)], &["lag.toml", "no identified model", "`identify` wrote"]);
    refused(&["--match", text(&broken)], &["broken.json", "sample_time_s"]);
    refused(&["--match", "nowhere.toml"], &["nowhere.toml"]);
    refused(&["--match", text(&lag), text(&data)], &["cannot be used with"]);
    refused(&["--match", text(&lag), "--band", "3"], &["--band 3", "LOW:HIGH"]);
    refused(&["--match", text(&lag), "--unit", "y"], &["--unit y", "NAME=NUMBER"]);
    refused(&["--match", text(&lag), "--holdout", text(&data)], &["--holdout", "simulate"]);
    refused(&[text(&data), "--norm", "hinf"], &["--match"]);
    assert!(!out.exists());
    deadtime(&["identify", "--match", text(&lag)]).refused(&["--structure"]);
    deadtime(&["identify", "--structure", text(&lag)]).refused(&["LOG"]);
}

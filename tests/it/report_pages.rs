//! Pages of studies, checks, identified models and the check on withheld effects: well formed, and their pictures show the numbers of the JSON.

use crate::report_html::{MODEL, drawn, elements, log, read};
use crate::structured::{PENDULUM, swing};
use crate::support::blind::{Check, perfect};
use crate::support::program::{Folder, deadtime, text};
use serde_json::Value;

const SCRIPT: &str = "<script>alert(1)</script>";

fn figure<'a>(data: &'a Value, id: &str) -> &'a [Value] {
    let figures = data["figures"].as_array().unwrap();
    figures.iter().find(|f| f["id"] == id).unwrap_or_else(|| panic!("no figure {id}"))["views"]
        .as_array()
        .unwrap()
}

fn view<'a>(data: &'a Value, id: &str, keys: &[&str]) -> &'a Value {
    figure(data, id)
        .iter()
        .find(|v| v["keys"] == serde_json::json!(keys))
        .unwrap_or_else(|| panic!("no view {keys:?} of {id}"))
}

/// Well formed, and nothing in it acts.
pub(crate) fn stands(page: &str) -> String {
    let all = elements(page);
    assert!(
        !all.iter()
            .flat_map(|tag| tag.split(' '))
            .any(|word| word.starts_with("on") && word.contains("=\"")),
        "an event handler"
    );
    let read = read(page);
    for bad in ["NaN", "Infinity", "null", "<script", "src=", "http:", "https:"] {
        assert!(!read.contains(bad), "{bad}");
    }
    assert!(!page.contains(SCRIPT) && page.len() < 1_000_000, "{} bytes", page.len());
    read
}

#[test]
fn a_study_page_shows_the_means_of_its_cells() {
    let folder = Folder::new();
    let plan = folder.write(
        "plan.toml",
        &format!(
            "format = \"deadtime/plan@1\"\nname = \"{SCRIPT}\"\nabout = \"a <b>test</b>\"\nseed = 1\ntrials = 4\nsamples = 120\nsample_time_s = 0.1\nmax_delay = 12\n\
             plant = \"fast1\"\nexcitation = \"prbs\"\nsnr = [1, 100, \"inf\"]\ndelay_s = [0.3, 0.64]\nmethod = [\"oestruc\", \"arxstruc\", \"threshold\"]\n"
        ),
    );
    let out = folder.path("out");
    deadtime(&["study", text(&plan), "--out", text(&out)]).done();
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    let said = stands(&page);
    assert!(
        said.contains("a &lt;b&gt;test&lt;/b&gt;")
            && said.contains("Efficiency")
            && said.contains("Coverage")
    );
    let study: Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("study.json")).unwrap()).unwrap();
    let cells = study["cells"].as_array().unwrap();
    let data = drawn(&page);
    let part = figure(&data, "pareto")[0]["keys"][0].as_str().unwrap().to_owned();
    let mean = |method: &str, snr: &Value, of: &str| {
        let all: Vec<f64> = cells
            .iter()
            .filter(|c| c["method"] == method && c["snr"] == *snr)
            .filter_map(|c| c[of].as_f64())
            .collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    let near = |a: &Value, b: Option<f64>| match (a.as_f64(), b) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-3 * b.abs() + 1e-5,
        (a, b) => a.is_none() && b.is_none(),
    };
    let snrs = [serde_json::json!(1.0), serde_json::json!(100.0), Value::Null];
    let heat = view(&data, "heat", &[&part, "SNR", "RMS error (samples)"]);
    assert_eq!(heat["columns"], serde_json::json!(["1", "100", "none"]));
    for row in heat["rows"].as_array().unwrap() {
        for (at, snr) in snrs.iter().enumerate() {
            assert!(
                near(&row["values"][at], mean(row["name"].as_str().unwrap(), snr, "rms_samples")),
                "{row} at {snr}"
            );
        }
    }
    let lines = view(&data, "against", &[&part, "SNR", "truth in the 95 % interval"]);
    for curve in lines["curves"].as_array().unwrap() {
        for (at, snr) in snrs.iter().enumerate() {
            assert!(
                near(&curve["y"][at], mean(curve["label"].as_str().unwrap(), snr, "coverage95")),
                "{curve} at {snr}"
            );
        }
    }
    let bound = view(&data, "against", &[&part, "SNR", "RMS error (samples)"])["curves"]
        .as_array()
        .unwrap()
        .last()
        .unwrap();
    assert!(
        bound["label"] == "Cramér-Rao bound" && bound["y"][0].as_f64() > bound["y"][1].as_f64(),
        "{bound}"
    );
    // On the line is who has no faster and more accurate one beside it.
    let pareto = &figure(&data, "pareto")[0];
    let (times, errors) =
        (pareto["x"]["values"].as_array().unwrap(), pareto["curves"][0]["y"].as_array().unwrap());
    for (at, on) in pareto["curves"][1]["y"].as_array().unwrap().iter().enumerate() {
        let beaten = (0..times.len()).any(|i| {
            times[i].as_f64() < times[at].as_f64() && errors[i].as_f64() <= errors[at].as_f64()
        });
        assert_eq!(on.is_null(), beaten, "{pareto}");
    }
}

#[test]
fn a_check_page_marks_what_needs_a_look() {
    let folder = Folder::new();
    let model = folder.write(
        "model.toml",
        &MODEL.replace("C = [[1.0, 0.0], [0.0, 1.0]]", "C = [[-1.0, 0.0], [0.0, 1.0]]"),
    );
    let (log, page) = (folder.write("<img>.csv", &log(700, 0)), folder.path("check.html"));
    deadtime(&["check", "--model", text(&model), "--log", text(&log), "--html", text(&page)])
        .done();
    let said = stands(&std::fs::read_to_string(page).unwrap());
    assert!(
        said.contains("✗ look") && said.contains("✓ ok") && said.contains("&lt;img&gt;.csv"),
        "{said}"
    );
    let sign = said.split("<tr>").find(|row| row.contains(">sign<")).unwrap();
    assert!(sign.contains("✗ look") && sign.contains("angle &amp;"), "{sign}");
}

#[test]
fn an_identify_page_has_responses_without_jumps_and_every_pole() {
    let folder = Folder::new();
    let (log, page) = (folder.write("log.csv", &log(700, 0)), folder.path("model.html"));
    let (model, json) = (folder.path("m.toml"), folder.path("m.json"));
    let words = [
        "--input",
        "u<b>",
        "--output",
        "angle & \"co\"",
        "--delay",
        "none",
        "--out",
        text(&model),
        "--json",
        text(&json),
    ];
    deadtime(&[&["identify", text(&log)], &words[..], &["--html", text(&page)]].concat()).done();
    let page = std::fs::read_to_string(page).unwrap();
    let said = stands(&page);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    for (class, all) in [("pole", "poles"), ("zero", "zeros")] {
        assert_eq!(
            said.matches(&format!("class=\"{class}\"")).count(),
            found[all].as_array().unwrap().len()
        );
    }
    let data = drawn(&page);
    let bands = found["frequency_responses"][0]["bands"].as_array().unwrap();
    let (gain, phase) =
        (&figure(&data, "gain")[0]["curves"][0]["y"], &figure(&data, "phase")[0]["curves"][0]["y"]);
    let phases: Vec<f64> = phase.as_array().unwrap().iter().map(|p| p.as_f64().unwrap()).collect();
    assert!(phases.windows(2).all(|w| (w[1] - w[0]).abs() <= 180.0), "{phases:?}");
    for (at, band) in bands.iter().enumerate() {
        assert_eq!(gain[at], band["gain"]);
        let turns = (phases[at] - band["phase_rad"].as_f64().unwrap().to_degrees()) / 360.0;
        assert!((turns - turns.round()).abs() < 1e-9, "{turns}");
    }
}

#[test]
fn a_page_of_withheld_effects_counts_every_case_once() {
    let check = Check::new();
    check.answer(perfect);
    let page = check.path("score.html");
    deadtime(&[
        "blind",
        "score",
        text(&check.verdicts()),
        text(&check.labels()),
        "--html",
        text(&page),
    ])
    .done();
    let page = std::fs::read_to_string(page).unwrap();
    assert!(stands(&page).contains("8 cases"));
    let data = drawn(&page);
    let matrix = &figure(&data, "confusion")[0];
    let cases: u64 = matrix["rows"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|r| r["values"].as_array().unwrap())
        .filter_map(Value::as_u64)
        .sum();
    assert_eq!(cases, 8);
}

#[test]
fn a_page_of_fitted_parameters_shows_what_moved_and_what_cannot_be_had() {
    let folder = Folder::new();
    let model = folder.write(
        "model.toml",
        &PENDULUM.replace("name = \"pendulum\"", &format!("name = \"{SCRIPT}\"")),
    );
    let logs: Vec<std::path::PathBuf> = (1..=3)
        .map(|seed| {
            let path = folder.path(&format!("{seed}.csv"));
            swing(0.025, 0.9, 0.24, 0.01, 0.0, seed).write_csv(&path).unwrap();
            path
        })
        .collect();
    let (page, json) = (folder.path("page.html"), folder.path("fit.json"));
    let [a, b, held_out] = [0, 1, 2].map(|at| text(&logs[at]));
    let words = [
        "identify",
        a,
        b,
        "--holdout",
        held_out,
        "--structure",
        text(&model),
        "--horizon",
        "25",
        "--html",
        text(&page),
        "--json",
        text(&json),
    ];
    deadtime(&[&words[..], &["--free", "inertia,gain,stiffness,friction"]].concat()).done();
    let page = std::fs::read_to_string(page).unwrap();
    let read = stands(&page);
    // Inertia, gain and stiffness only act as ratios.
    assert!(read.contains("Not identifiable") && read.contains("parameters: 4 open."), "{read}");
    let found: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    let data = drawn(&page);
    let group = found["held_out"][1][0]["group"].as_str().unwrap();
    let fitted = &view(&data, "errors", &["logs held out", group])["curves"][1]["y"];
    let measured = found["held_out"][1][0]["mean_absolute"].as_array().unwrap();
    assert_eq!(fitted.as_array().unwrap().len(), 25);
    for (drawn, measured) in fitted.as_array().unwrap().iter().zip(measured) {
        assert!(
            (drawn.as_f64().unwrap() - measured.as_f64().unwrap()).abs()
                <= 1e-5 * measured.as_f64().unwrap(),
            "{drawn} {measured}"
        );
    }
    let page = folder.path("none.html");
    deadtime(&["identify", a, "--structure", text(&model), "--html", text(&page)])
        .refused(&["--html", "--free"]);
}

//! `deadtime compare`: diagnoses and studies side by side, as a terminal, a page and JSON show them.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::report_html::drawn;
use crate::report_pages::stands;
use crate::support::program::{Folder, deadtime, text};

/// The example's diagnosis with another delay, in a folder of its own.
fn diagnosis(folder: &Folder, name: &str, delay: f64, change: impl Fn(&mut Value)) -> PathBuf {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/diagnosis.json");
    let mut it: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let half = 0.0012;
    for place in ["contributions", "effects"] {
        let parameter = &mut it["cause"][place][0]["parameters"][0];
        parameter["value"] = json!(delay);
        parameter["ci95"] = json!([delay - half, delay + half]);
    }
    change(&mut it);
    std::fs::create_dir(folder.path(name)).unwrap();
    folder.write(&format!("{name}/diagnosis.json"), &it.to_string());
    folder.path(name)
}

fn json_of(folder: &Folder, results: &[&Path]) -> Value {
    let out = folder.path("compared.json");
    let mut words = vec!["compare", "--json", text(&out)];
    words.extend(results.iter().map(|p| text(p)));
    deadtime(&words).done();
    serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap()
}

#[test]
fn numbers_that_differ_by_more_than_chance_are_named() {
    let folder = Folder::new();
    let [a, b, c] = [("robot_1", 0.031), ("robot_2", 0.0315), ("robot_3", 0.047)]
        .map(|(name, delay)| diagnosis(&folder, name, delay, |_| {}));
    let two = json_of(&folder, &[&a, &b]);
    assert_eq!(two["format"], "deadtime/compare@1");
    assert_eq!(two["names"], json!(["robot_1", "robot_2"]));
    assert_eq!(two["parameters"][0]["agree"], true);
    let three = json_of(&folder, &[&a, &b, &c]);
    let row = &three["parameters"][0];
    assert_eq!(
        (row["cause"].as_str(), row["parameter"].as_str(), &row["agree"]),
        (Some("input_delay:delta_lat"), Some("delay"), &json!(false))
    );
    let page = folder.path("fleet.html");
    let said = deadtime(&["compare", text(&a), text(&b), text(&c), "--html", text(&page)]).words();
    assert!(said.contains("In all of them: `input_delay:delta_lat`."), "{said}");
    assert!(
        said.contains(
            "They differ by more than chance in delay of `input_delay:delta_lat` (p < 0.001)."
        ),
        "{said}"
    );
    let page = std::fs::read_to_string(page).unwrap();
    let read = stands(&page);
    assert!(
        read.contains("3 diagnoses side by side") && read.contains("0.0470 (0.0458 to 0.0482)"),
        "{read}"
    );
    let figure = &drawn(&page)["figures"][0]["views"][0];
    assert_eq!(figure["columns"], json!(["robot_1", "robot_2", "robot_3"]));
    assert_eq!(figure["rows"][0]["name"], "input_delay:delta_lat");
}

#[test]
fn what_went_and_what_came_is_said() {
    let folder = Folder::new();
    let before = diagnosis(&folder, "before", 0.031, |_| {});
    let after = diagnosis(&folder, "after", 0.031, |it| {
        for place in ["contributions", "effects"] {
            it["cause"][place][0]["effect"] = json!("sensor_bias");
            it["cause"][place][0]["channel"] = json!("<script>alert(1)</script>");
        }
        it["cause"]["contributions"][0]["class"] = json!([]);
        it["cause"]["verdict"] = json!("sensor_bias");
    });
    let page = folder.path("c.html");
    let said = deadtime(&["compare", text(&before), text(&after), "--html", text(&page)]).words();
    assert!(said.contains("No cause is in all of them. Only in before: `input_delay:delta_lat`. Only in after: `sensor_bias:"), "{said}");
    stands(&std::fs::read_to_string(page).unwrap());
    // Another name for what the data cannot tell apart is the same cause.
    let alias = diagnosis(&folder, "alias", 0.031, |it| {
        for place in ["contributions", "effects"] {
            it["cause"][place][0]["effect"] = json!("output_delay");
            it["cause"][place][0]["channel"] = json!("*");
        }
        it["cause"]["contributions"][0]["class"] =
            json!(["input_delay:delta_lat", "output_delay:*"]);
    });
    let found = json_of(&folder, &[&before, &alias]);
    assert_eq!(found["causes"].as_array().unwrap().len(), 1);
    assert_eq!(found["causes"][0]["parts"][1]["stands_in"], "output_delay:*");
}

#[test]
fn studies_are_compared_on_the_cells_that_they_share() {
    let folder = Folder::new();
    let plan = |name: &str, snr: &str, seed: u64| {
        let text = format!(
            "format = \"deadtime/plan@1\"\nname = \"p\"\nseed = {seed}\ntrials = 4\nsamples = 120\nsample_time_s = 0.1\nmax_delay = 12\n\
             plant = \"fast1\"\nexcitation = \"prbs\"\nsnr = {snr}\ndelay_s = [0.3]\nmethod = [\"arxstruc\", \"threshold\"]\n"
        );
        folder.write(&format!("{name}.toml"), &text)
    };
    let run = |name: &str, snr: &str, seed: u64| {
        let out = folder.path(name);
        deadtime(&["study", text(&plan(name, snr, seed)), "--out", text(&out)]).done();
        out
    };
    let (old, new) = (run("old", "[1, 100]", 1), run("new", "[1, 10]", 2));
    let found = json_of(&folder, &[&old, &new]);
    // Two methods at one SNR are shared, and each has one more.
    assert_eq!((&found["shared"], &found["left_out"]), (&json!(2), &json!(4)));
    let cell = |out: &Path, method: &str| {
        let study: Value =
            serde_json::from_str(&std::fs::read_to_string(out.join("study.json")).unwrap())
                .unwrap();
        let cells = study["cells"].as_array().unwrap();
        cells
            .iter()
            .find(|c| c["method"] == method && c["snr"] == 1.0)
            .map(|c| c["rms_samples"].clone())
            .unwrap()
    };
    for row in found["methods"].as_array().unwrap() {
        let method = row["method"].as_str().unwrap();
        assert_eq!(row["rms_samples"], json!([cell(&old, method), cell(&new, method)]), "{method}");
    }
    let page = folder.path("c.html");
    deadtime(&[
        "compare",
        text(&old),
        text(&new),
        "--html",
        text(&page),
        "--name",
        "v1",
        "--name",
        "v2",
    ])
    .done();
    let page = std::fs::read_to_string(page).unwrap();
    assert!(stands(&page).contains("2 studies side by side"));
    assert_eq!(drawn(&page)["figures"][0]["views"][0]["columns"], json!(["v1", "v2"]));
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let folder = Folder::new();
    let a = diagnosis(&folder, "a", 0.031, |_| {});
    let study = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/study_ci");
    deadtime(&["compare", text(&a), text(&study)]).refused(&[
        "study.json",
        "diagnosis.json",
        "one kind",
    ]);
    deadtime(&["compare", text(&a)]).refused(&["2 values required"]);
    deadtime(&["compare", text(&a), text(&folder.path("nothing"))]).refused(&["nothing"]);
    std::fs::create_dir(folder.path("empty")).unwrap();
    deadtime(&["compare", text(&a), text(&folder.path("empty"))])
        .refused(&["empty", "neither diagnosis.json nor study.json"]);
    let other = folder.write("other.json", "{\"format\": \"deadtime/model@1\"}");
    deadtime(&["compare", text(&a), text(&other)]).refused(&[
        "other.json",
        "deadtime/model@1",
        "only deadtime/diagnosis",
    ]);
    deadtime(&["compare", text(&a), text(&a), "--name", "x"]).refused(&["1 names for 2 results"]);
    // Folders of one name are told apart by their paths.
    std::fs::create_dir(folder.path("deep")).unwrap();
    std::fs::create_dir(folder.path("deep/a")).unwrap();
    std::fs::copy(a.join("diagnosis.json"), folder.path("deep/a/diagnosis.json")).unwrap();
    let found = json_of(&folder, &[&a, &folder.path("deep/a")]);
    assert_ne!(found["names"][0], found["names"][1]);
}

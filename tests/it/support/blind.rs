//! A small set of withheld cases with known answers, for the tests of the check on withheld effects.

use std::path::{Path, PathBuf};

use deadtime::blind::{COMMITMENT, CaseFiles, commitments};
use deadtime::diagnose::Diagnosis;
use serde_json::{Value, json};

/// Cases, verdicts and labels in a temporary folder.
pub(crate) struct Check {
    folder: tempfile::TempDir,
}

/// One label; the salt is text that any other label lacks.
pub(crate) fn label(id: &str, group: &str, effects: Value, more: Value) -> Value {
    let verdict = if group == "single" || group == "pair" {
        effects[0]["effect"].clone()
    } else {
        json!(group)
    };
    let mut label = json!({
        "id": id, "salt": format!("salt of {id}"), "group": group, "verdict": verdict, "effects": effects, "alias_class": [], "outputs": [],
        "from_s": null, "to_s": null, "from_hz": null, "to_hz": null, "strength_db": null, "before": null, "oracle_after": null,
        "noise": "white"
    });
    for (key, value) in more.as_object().unwrap() {
        label[key] = value.clone();
    }
    label
}

fn effect(effect: &str, channel: &str, parameter: &str, value: f64) -> Value {
    json!({ "effect": effect, "channel": channel, "parameters": { parameter: value } })
}

/// Four single effects, two cases of none, one unknown, one pair, of a model with input u, state v and output y.
pub(crate) fn labels() -> Vec<Value> {
    vec![
        label("k1", "unknown", json!([]), json!({ "plant": "cart" })),
        label("n1", "none", json!([]), json!({})),
        label("n2", "none", json!([]), json!({ "plant": "cart", "loop": "closed" })),
        label(
            "p1",
            "pair",
            json!([
                effect("input_delay", "u", "delay", 0.03),
                effect("sensor_gain", "*", "gain", 1.2)
            ]),
            json!({ "alias_class": [["input_delay:u", "output_delay:*"], ["sensor_gain:y", "input_gain:u"]] }),
        ),
        label(
            "s1",
            "single",
            json!([effect("input_delay", "u", "delay", 0.05)]),
            json!({ "alias_class": ["input_delay:u", "output_delay:*", "clock_offset:*"], "outputs": ["y"], "from_s": 2.0, "to_s": 4.0,
                    "from_hz": 1.0, "to_hz": 3.0, "strength_db": 15.0, "before": 1.0, "oracle_after": 0.2 }),
        ),
        label(
            "s2",
            "single",
            json!([effect("sensor_bias", "y", "offset", 0.2)]),
            json!({ "strength_db": 25.0 }),
        ),
        label(
            "s3",
            "single",
            json!([effect("coulomb_friction", "v", "level", 1.0)]),
            json!({ "strength_db": 35.0 }),
        ),
        label(
            "s4",
            "single",
            json!([effect("output_delay", "y", "delay", 0.1)]),
            json!({ "alias_class": ["input_delay:u", "output_delay:*"], "strength_db": 5.0 }),
        ),
    ]
}

/// The diagnosis that says exactly what a label says.
pub(crate) fn perfect(label: &Value) -> Diagnosis {
    let effects: Vec<Value> = label["effects"].as_array().unwrap().clone();
    let found: Vec<Value> = effects
        .iter()
        .map(|e| {
            let (name, value) = e["parameters"].as_object().unwrap().iter().next().unwrap();
            let value = value.as_f64().unwrap();
            json!({ "effect": e["effect"], "channel": e["channel"], "parameters":
                [{ "name": name, "unit": "s", "value": value, "std": 0.001, "ci95": [value - 0.002, value + 0.002] }] })
        })
        .collect();
    let row = match found.len() {
        0 => {
            json!({ "effect": label["group"], "channel": null, "probability": 1.0, "after": null })
        }
        1 => {
            json!({ "effect": found[0]["effect"], "channel": found[0]["channel"], "probability": 1.0, "after": 0.1 })
        }
        _ => {
            json!({ "effects": found.iter().map(|e| json!([e["effect"], e["channel"]])).collect::<Vec<_>>(), "probability": 1.0, "after": 0.1 })
        }
    };
    let channel = found.first().map_or(Value::Null, |e| e["channel"].clone());
    let mut answer = base();
    answer["cause"]["verdict"] = label["verdict"].clone();
    answer["cause"]["channel"] = channel;
    answer["cause"]["effects"] = json!(found);
    answer["cause"]["ranking"] = json!([row]);
    answer["where"]["times"] =
        json!([{ "log": "train_1.csv", "output": "y", "from_s": 2.0, "to_s": 4.0, "share": 1.0 }]);
    answer["where"]["bands"] =
        json!([{ "output": "y", "from_hz": 1.0, "to_hz": 3.0, "share": 1.0 }]);
    answer["shrink"]["after"] = json!(0.1);
    serde_json::from_value(answer).unwrap()
}

/// The diagnosis that always says an input delay of 0.06 s, somewhat late and somewhat high.
pub(crate) fn always_input_delay() -> Diagnosis {
    let mut answer = base();
    answer["cause"]["verdict"] = json!("input_delay");
    answer["cause"]["channel"] = json!("u");
    answer["cause"]["effects"] = json!([{ "effect": "input_delay", "channel": "u", "parameters":
        [{ "name": "delay", "unit": "s", "value": 0.06, "std": 0.0025, "ci95": [0.055, 0.065] }] }]);
    answer["cause"]["ranking"] = json!([{ "effect": "input_delay", "channel": "u", "probability": 0.9, "after": 0.4 },
        { "effect": "none", "channel": null, "probability": 0.1, "after": 0.5 }]);
    answer["where"]["times"] = json!([{ "log": "train_1.csv", "output": "y", "from_s": 3.0, "to_s": 4.5, "share": 0.5 },
        { "log": "train_1.csv", "output": "y", "from_s": 4.0, "to_s": 5.0, "share": 0.5 }]);
    answer["where"]["bands"] =
        json!([{ "output": "y", "from_hz": 2.0, "to_hz": 6.0, "share": 1.0 }]);
    answer["shrink"]["after"] = json!(0.4);
    serde_json::from_value(answer).unwrap()
}

/// The diagnosis that always says none, and input delay if anything; its held-out error is 4 % worse.
pub(crate) fn always_none() -> Diagnosis {
    let mut answer = base();
    answer["cause"]["ranking"] = json!([{ "effect": "none", "channel": null, "probability": 0.8, "after": 0.5 },
        { "effect": "input_delay", "channel": "u", "probability": 0.2, "after": 0.4 }]);
    answer["shrink"]["after"] = json!(0.52);
    serde_json::from_value(answer).unwrap()
}

/// A diagnosis of none about the output y.
fn base() -> Value {
    json!({ "format": "deadtime/diagnosis@1", "model": "toy", "logs": ["train_1.csv"],
        "holdout": [{ "log": "holdout_1.csv", "from_s": 0.0, "to_s": 10.0 }],
        "prediction": { "mode": "simulation", "why": "stable" },
        "gap": { "metric": "nrmse", "before": 0.5, "floor": 0.05, "outputs": [{ "name": "y", "before": 0.5, "floor": 0.05, "share": 1.0 }] },
        "where": { "outputs": [{ "name": "y", "share": 1.0 }], "times": [], "bands": [], "regimes": [] },
        "checks": [],
        "cause": { "verdict": "none", "channel": null, "effects": [], "ranking": [], "indistinguishable": [], "not_tried": [],
                   "next_experiment": null },
        "shrink": { "before": 0.5, "after": 0.5, "floor": 0.05, "fraction": 0.0, "of_explainable": 0.0, "ci95": null,
                    "outputs": [{ "name": "y", "before": 0.5, "after": 0.5, "floor": 0.05 }] } })
}

impl Check {
    /// Cases and labels, no verdicts.
    pub(crate) fn new() -> Self {
        let check = Self { folder: tempfile::tempdir().unwrap() };
        for label in labels() {
            check.add(&label);
        }
        check
    }

    /// A case and its label.
    pub(crate) fn add(&self, label: &Value) {
        let id = label["id"].as_str().unwrap();
        let text = serde_json::to_string_pretty(label).unwrap() + "\n";
        let [commitment, _] =
            commitments(text.as_bytes(), label["salt"].as_str().unwrap()).unwrap();
        write(&self.labels().join(format!("{id}.json")), &text);
        let case = self.cases().join(id);
        write(&case.join("model.toml"), "a model\n");
        write(&case.join("train_1.csv"), "time,u,y\n");
        write(&case.join("train_2.csv"), "time,u,y\n");
        write(&case.join("train_10.csv"), "time,u,y\n");
        write(&case.join("holdout_1.csv"), "time,u,y\n");
        write(&case.join(COMMITMENT), &format!("{commitment}\n"));
    }

    /// Verdicts for all labels, as `run` writes them.
    pub(crate) fn answer(&self, diagnose: impl Fn(&Value) -> Diagnosis) {
        for label in labels() {
            self.answer_one(&label, &diagnose(&label));
        }
    }

    /// The verdict of one case.
    pub(crate) fn answer_one(&self, label: &Value, diagnosis: &Diagnosis) {
        let id = label["id"].as_str().unwrap();
        let folder = self.verdicts().join(id);
        diagnosis.write(&folder.join("diagnosis.json")).unwrap();
        write(
            &folder.join("run.json"),
            "{ \"format\": \"deadtime/blind-run@1\", \"time_s\": 2.0 }\n",
        );
        std::fs::copy(self.cases().join(id).join(COMMITMENT), folder.join(COMMITMENT)).unwrap();
    }

    pub(crate) fn cases(&self) -> PathBuf {
        self.folder.path().join("cases")
    }

    pub(crate) fn verdicts(&self) -> PathBuf {
        self.folder.path().join("verdicts")
    }

    pub(crate) fn labels(&self) -> PathBuf {
        self.folder.path().join("labels")
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

pub(crate) fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

/// The perfect diagnosis of a case.
pub(crate) fn by_heart(case: &CaseFiles) -> Diagnosis {
    perfect(labels().iter().find(|l| l["id"] == case.id.as_str()).unwrap())
}

//! The table of effects: the same in the program, the documentation, the diagnosis' schema and the model files it leads to.

use std::path::Path;

use crate::support::program::{Folder, deadtime, text};
use deadtime::effect::EFFECTS;
use serde_json::Value;

fn root(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

#[test]
fn the_documentation_shows_the_table_that_the_program_prints() {
    let printed = deadtime(&["list", "effects"]).done();
    let documented = std::fs::read_to_string(root("docs/effects.md")).unwrap();
    assert!(
        documented.contains(&printed),
        "docs/effects.md lacks the table as `deadtime list effects` prints it:\n{printed}"
    );
    let rows = printed.lines().skip(2).map(|row| row.split('`').nth(1).unwrap());
    assert!(rows.eq(EFFECTS.iter().map(|e| e.name())), "{printed}");
}

#[test]
fn the_schema_of_a_diagnosis_names_the_same_effects_in_the_same_order() {
    let schema: Value =
        serde_json::from_str(&std::fs::read_to_string(root("docs/diagnosis.schema.json")).unwrap())
            .unwrap();
    let names: Vec<&str> = EFFECTS.iter().map(|e| e.name()).collect();
    let listed = |key: &str| {
        schema["$defs"][key]["enum"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_str().unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(listed("effect"), names);
    assert_eq!(listed("answer")[..names.len()], names);
}

#[test]
fn every_channel_in_the_list_of_a_model_can_be_written_into_its_file() {
    let folder = Folder::new();
    let file = folder.path("list.json");
    let log = folder.write("log.csv", "time,force\n0,1\n0.1,1\n0.2,-1\n");
    let model = root("examples/cart_pendulum.toml");
    let printed =
        deadtime(&["list", "effects", "--model", text(&model), "--json", text(&file)]).done();
    assert!(
        printed.contains("parameter_error")
            && printed.contains("value 0.4 [m]")
            && printed.contains("force->output:angle"),
        "{printed}"
    );
    let rows: Vec<Value> = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    assert_eq!(printed.lines().count(), rows.len() + 1);
    let mut effects = std::fs::read_to_string(&model).unwrap();
    for row in &rows {
        let parameters: Vec<String> = row["parameters"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|p| !p["nominal"].is_null())
            .map(|p| format!("{} = {}", p["name"].as_str().unwrap(), p["nominal"]))
            .collect();
        let (effect, channel) = (row["effect"].as_str().unwrap(), row["channel"].as_str().unwrap());
        effects += &format!(
            "[[effects]]\neffect = \"{effect}\"\nchannel = \"{channel}\"\nparameters = {{ {} }}\n",
            parameters.join(", ")
        );
    }
    // All of them where they do nothing: the bare model's response.
    let written = |model: &Path| {
        let out = folder.path("out.csv");
        deadtime(&["simulate", text(model), text(&log), "--out", text(&out)]).done();
        std::fs::read_to_string(out).unwrap()
    };
    assert_eq!(written(&folder.write("all.toml", &effects)), written(&model));
}

#[test]
fn the_list_of_a_sampled_model_has_no_effect_on_its_dynamics_and_says_why() {
    let folder = Folder::new();
    let sampled = folder.path("sampled.toml");
    let model = root("examples/uav_lateral_stabilised.toml");
    deadtime(&["c2d", text(&model), "--sample-time", "0.02", "--out", text(&sampled)]).done();
    let printed = deadtime(&["list", "effects", "--model", text(&sampled)]).done();
    assert!(
        !printed.contains("coulomb_friction") && printed.contains("this one is sampled"),
        "{printed}"
    );
    assert!(deadtime(&["list", "effects", "--model", text(&model)]).done().contains("A[v,phi]"));
}

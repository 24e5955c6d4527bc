//! What would take the machine is refused before it does, with the estimate and the remedy.

use std::path::Path;

use deadtime::study::{Budget, Needs, Plan, Runner, StudyError};

const PLAN: &str = r#"
format = "deadtime/plan@1"
name = "x/../../../escaped"
samples = 60
max_delay = 8
plant = ["slow2"]
excitation = ["rbs"]
method = ["crosscorr"]
"#;

fn plan(trials: usize) -> Plan {
    let mut plan = Plan::parse("p", PLAN, Path::new(".")).unwrap();
    plan.grids[0].trials = trials;
    plan
}

fn refused(plan: &Plan) -> String {
    match Runner::new(plan) {
        Err(deadtime::study::Error::Study(e @ StudyError::Budget { .. })) => e.to_string(),
        Err(e) => panic!("{e}"),
        Ok(_) => panic!("not refused"),
    }
}

#[test]
fn too_many_trials_are_refused_with_the_estimate_and_the_option() {
    for trials in [1_000_000_000_000, usize::MAX, 2_000_000_000] {
        let said = refused(&plan(trials));
        assert!(
            said.contains("`max_disk_gb`")
                && said.contains(&format!("{} estimates", trials as f64)),
            "{said}"
        );
    }
}

#[test]
fn trials_that_are_allowed_take_no_memory_and_every_number_of_them_is_counted() {
    let unlimited = Budget { disk_gb: f64::INFINITY, ..Budget::default() };
    let runner = Runner::untried(&plan(1_000_000_000_000), &unlimited).unwrap();
    assert_eq!(runner.estimates(), 1_000_000_000_000);
    assert!(
        Runner::untried(&plan(usize::MAX), &unlimited).is_ok_and(|r| r.estimates() == usize::MAX)
    );
}

#[test]
fn a_grid_too_large_for_the_memory_is_refused_before_it_is_made() {
    let mut plan = plan(1);
    plan.grids[0].snr = (1..=3000).map(f64::from).collect();
    plan.grids[0].max_delay = (1..=3000).collect();
    assert_eq!(Needs::of(&plan).cells, 9e6);
    let said = refused(&plan);
    assert!(said.contains("9000000 settings") && said.contains("`max_memory_gb`"), "{said}");
    plan.grids[0].snr.truncate(1);
    plan.grids[0].max_delay.truncate(1);
    plan.grids[0].samples = vec![1_000_000_000_000];
    assert!(refused(&plan).contains("memory"));
}

#[cfg(feature = "cli")]
#[test]
fn the_program_answers_at_once_and_writes_nothing_outside() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("a/b");
    std::fs::create_dir_all(&inside).unwrap();
    std::fs::write(inside.join("p.toml"), PLAN).unwrap();
    let run = |words: &[&str]| {
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_deadtime"))
            .args(words)
            .current_dir(&inside)
            .output()
            .unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, said) = run(&["study", "p.toml", "--trials", "2", "--threads", "20000"]);
    assert!(code == Some(0) && said.contains("four for each core"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read_dir(folder.path().join("a")).unwrap().count(), 1);
    assert_eq!(std::fs::read_dir(&inside).unwrap().count(), 2);
    let (code, said) = run(&["study", "p.toml", "--trials", "18446744073709551615"]);
    assert!(code == Some(2) && said.contains("--max-disk-gb"), "{said}");
    let (code, said) = run(&["study", "no\u{1b}[31m\nplan"]);
    assert!(code == Some(2) && !said.contains('\u{1b}') && said.lines().count() == 1, "{said}");
    std::fs::File::create(inside.join("large.toml")).unwrap().set_len(3 << 30).unwrap();
    let (code, said) = run(&["study", "large.toml"]);
    assert!(code == Some(2) && said.contains("64 MiB"), "{said}");
}

#[test]
fn models_that_are_too_large_or_too_fast_say_so() {
    use deadtime::model::ModelDocument;
    use deadtime::simulate::{Commands, Plan, System};
    let head = "format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"equations\"\ninputs = [{ name = \"u\" }]\noutputs = [{ name = \"y\" }]\n";
    let text = |states: &str, parameters: &str, derivatives: &str| {
        format!(
            "{head}[states]\n{states}\n[parameters]\n{parameters}\n[derivatives]\n{derivatives}\n[output_equations]\ny = \"x\"\n"
        )
    };
    let many: String = (0..20_000).map(|k| format!("p{k} = {{ value = 1.0 }}\n")).collect();
    let said = ModelDocument::from_toml(&text("x = {}", &many, "x = \"u\""), Path::new("m.toml"))
        .unwrap_err()
        .to_string();
    assert!(said.contains("20000 parameters") && said.contains("10000"), "{said}");

    // Stiff and driven: each command is a new transient of 1e-7 s.
    let sum: String = (0..300).map(|k| format!(" + 1e-9*sin({k}*x + time)")).collect();
    let model = text(
        "x = {}\nfast = {}",
        "k = { value = 1e7 }",
        &format!("x = \"u - x{sum}\"\nfast = \"k*(sin(1e6*time) - fast) + 0*x\""),
    );
    let system =
        System::new(&ModelDocument::from_toml(&model, Path::new("m.toml")).unwrap(), |_| Ok(0.0))
            .unwrap();
    let time_s: Vec<f64> = (0..100).map(f64::from).collect();
    let u = vec![vec![1.0; time_s.len()]];
    let mut plan = Plan::new(&system);
    plan.tolerance.budget = 3000;
    let commands = Commands { time_s: &time_s, inputs: &u };
    let said = system.simulate(&plan, commands, &system.initial, None).unwrap_err().to_string();
    assert!(said.contains("`fast`") && said.contains("1.0e-7"), "{said}");
}

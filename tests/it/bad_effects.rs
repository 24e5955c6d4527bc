//! Effects and models that do not fit, through the built program: exit code 2, a message that says what and where, and nothing left behind.

use crate::support::program::{Folder, Run, deadtime};

const LINEAR: &str = r#"
format = "deadtime/model@1"
name = "cart"
kind = "lti"
inputs = [{ name = "force", unit = "N" }]
states = [{ name = "s", unit = "m" }, { name = "v", unit = "m/s" }]
outputs = [{ name = "s", unit = "m" }, { name = "v", unit = "m/s" }]
A = [[0.0, 1.0], [-2.0, -0.3]]
B = [[0.0], [1.5]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

const EQUATIONS: &str = r#"
format = "deadtime/model@1"
name = "cart"
kind = "equations"
inputs = [{ name = "force", unit = "N" }]
outputs = [{ name = "s", unit = "m" }, { name = "v", unit = "m/s" }]
[states]
s = { unit = "m" }
v = { unit = "m/s" }
[parameters]
mass = { unit = "kg", value = 0.5 }
[derivatives]
s = "v"
v = "(force - 2*s)/mass"
[output_equations]
s = "s"
v = "v"
"#;

const LOG: &str = "time,force [N],s [m],v [m/s]\n0,1,0,0\n0.1,1,0.01,0.1\n0.2,-1,0.02,0.1\n0.3,-1,0.02,-0.1\n0.4,1,0.01,0\n";

fn effect(name: &str, channel: &str, parameters: &str) -> String {
    format!(
        "[[effects]]\neffect = \"{name}\"\nchannel = \"{channel}\"\nparameters = {{ {parameters} }}\n"
    )
}

fn run(folder: &Folder, model: &str, log: &str, more: &[&str]) -> Run {
    let (model, log, out) =
        (folder.write("cart.toml", model), folder.write("log.csv", log), folder.path("out.csv"));
    let arguments = [
        &[
            "simulate",
            model.to_str().unwrap(),
            log.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ],
        more,
    ]
    .concat();
    deadtime(&arguments)
}

/// Both kinds of model, with this effect.
fn refused(effects: &str, says: &[&str]) {
    for model in [LINEAR, EQUATIONS] {
        refused_on(&format!("{model}{effects}"), LOG, says);
    }
}

fn refused_on(model: &str, log: &str, says: &[&str]) {
    let folder = Folder::new();
    let run = run(&folder, model, log, &[]);
    run.refused(says);
    assert!(
        run.stderr.contains("cart.toml") || run.stderr.contains("log.csv"),
        "which file? {}",
        run.stderr
    );
    assert_eq!(folder.names(), ["cart.toml", "log.csv"], "something was left behind");
}

#[test]
fn the_good_models_that_the_bad_ones_are_made_from_are_fine_and_agree() {
    let effects = [
        effect("input_delay", "force", "delay = 0.037"),
        effect("saturation", "force", "upper = 0.6"),
        effect("coulomb_friction", "v", "level = 0.1"),
        effect("sensor_lag", "s", "time_constant = 0.2"),
    ]
    .concat();
    let simulated = |model: &str| {
        let folder = Folder::new();
        let text = run(&folder, &format!("{model}{effects}"), LOG, &[]).done();
        assert!(text.contains("s: nrmse ") && text.contains("v: nrmse "), "{text}");
        let written = std::fs::read_to_string(folder.path("out.csv")).unwrap();
        let numbers =
            |line: &str| line.split(',').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>();
        written.lines().skip(1).flat_map(numbers).collect::<Vec<_>>()
    };
    let undamped = LINEAR.replace("[-2.0, -0.3]", "[-4.0, 0.0]").replace("1.5", "2.0");
    for (a, b) in simulated(&undamped).iter().zip(simulated(EQUATIONS)) {
        assert!((a - b).abs() < 1e-8, "{a} {b}");
    }
}

#[test]
fn one_seed_draws_the_lost_commands() {
    let lossy = format!("{LINEAR}{}", effect("dropped_commands", "force", "probability = 0.5"));
    let rows: String = (0..200).map(|k| format!("{},{}\n", f64::from(k) * 0.1, k % 5)).collect();
    let log = format!("time,force\n{rows}");
    let written = |seed: &str| {
        let folder = Folder::new();
        run(&folder, &lossy, &log, &["--seed", seed]).done();
        std::fs::read_to_string(folder.path("out.csv")).unwrap()
    };
    assert_eq!(written("3"), written("3"));
    assert_ne!(written("3"), written("4"));
}

#[test]
fn an_unknown_effect_lists_those_there_are() {
    refused(
        &effect("input_dely", "force", "delay = 0.1"),
        &["no effect `input_dely`", "input_delay, delay_jump", "clock_offset"],
    );
}

#[test]
fn an_unknown_channel_lists_those_there_are() {
    refused(
        &effect("input_delay", "torque", "delay = 0.1"),
        &["input_delay cannot act on `torque`", "channels in this model are: force"],
    );
    refused(
        &effect("misalignment", "s->s", "gain = 0.1"),
        &["misalignment cannot act on `s->s`", "s->v, v->s"],
    );
    refused(
        &effect("unmodelled_mode", "force->v", "gain = 0.1"),
        &["force->input:force, force->state:s"],
    );
}

#[test]
fn unknown_missing_and_impossible_parameters_are_told() {
    refused(
        &effect("input_delay", "force", "delays = 0.1"),
        &["input_delay on `force` has no parameter `delays`; it has: delay"],
    );
    refused(
        &effect("input_delay", "force", ""),
        &["input_delay on `force`", "parameter `delay` is missing"],
    );
    refused(
        &effect("input_delay", "force", "delay = -0.1"),
        &["input_delay on `force`: delay is -0.1; it lies between 0 and inf"],
    );
    refused(
        &effect("dropped_commands", "force", "probability = 1.5"),
        &["probability is 1.5; it lies between 0 and"],
    );
    refused(
        &effect("dropped_commands", "force", "probability = 0.9, burst = 2.0"),
        &["burst is 2; it lies between 9.0"],
    );
    refused(&effect("input_gain", "force", "gain = nan"), &["input_gain on `force`: gain is NaN"]);
    refused(
        &effect("saturation", "force", "lower = 0.5, upper = -0.5"),
        &["lower is 0.5, upper is -0.5; lower must be the smaller one"],
    );
    refused("[[effects]]\neffect = \"input_gain\"\n", &["cart.toml", "channel"]);
}

const SAMPLED: &str = "sample_time_s = 0.1\ninputs";

#[test]
fn a_sampled_model_takes_no_effect_on_its_dynamics_and_no_log_of_another_sample_time() {
    let sampled = LINEAR
        .replace("inputs", SAMPLED)
        .replace("[[0.0, 1.0], [-2.0, -0.3]]", "[[1.0, 0.1], [-0.2, 0.9]]");
    let friction = format!("{sampled}{}", effect("coulomb_friction", "v", "level = 0.1"));
    refused_on(
        &friction,
        LOG,
        &["coulomb_friction acts on the dynamics of a continuous model; this one is sampled"],
    );
    for delayed in
        [sampled.clone(), format!("{sampled}{}", effect("input_delay", "force", "delay = 0.03"))]
    {
        run(&Folder::new(), &delayed, LOG, &[]).done();
        let slow = LOG
            .replace("0.1,1,", "0.2,1,")
            .replace("0.2,-1,", "0.4,-1,")
            .replace("0.3,-1,", "0.6,-1,")
            .replace("0.4,1,", "0.8,1,");
        refused_on(
            &delayed,
            &slow,
            &["sample times differ: 0.1 s and 0.2", "cart.toml", "log.csv"],
        );
    }
}

#[test]
fn a_model_that_explodes_says_when() {
    let delay = effect("input_delay", "force", "delay = 0.01");
    let fast = LINEAR.replace("[-2.0, -0.3]", "[4.0e6, 3e4]");
    refused_on(&format!("{fast}{delay}"), LOG, &["explodes", "t = 0."]);
    refused_on(
        &EQUATIONS.replace("(force - 2*s)/mass", "1e3*(1 + v^2)"),
        LOG,
        &["explodes", "t = 0.00157"],
    );
}

#[test]
fn an_equation_that_breaks_down_is_named_with_its_part() {
    let broken = |from: &str, to: &str, says: &[&str]| {
        for more in [
            String::new(),
            effect("sensor_lag", "s", "time_constant = 0.1"),
            effect("coulomb_friction", "v", "level = 0.1"),
        ] {
            let model = EQUATIONS.replace(from, to);
            assert_ne!(model, EQUATIONS);
            refused_on(&format!("{model}{more}"), LOG, says);
        }
    };
    broken(
        "(force - 2*s)/mass",
        "(force - 2*s)/(1 - force)",
        &["derivatives.v", "(force - 2*s)/(1 - force) divides by zero at t = 0 s"],
    );
    broken(
        "s = \"s\"",
        "s = \"log(0.25 - time)\"",
        &["output_equations.s", "takes the logarithm of", "at t = 0."],
    );
    broken(
        "(force - 2*s)/mass",
        "sqrt(0.25 - time)",
        &["derivatives.v", "sqrt(0.25 - time) takes the square root of -", "at t = 0.25"],
    );
}

#[test]
fn a_model_and_a_log_that_do_not_fit_are_told_apart_by_file_channel_and_unit() {
    for model in [
        LINEAR.to_owned(),
        format!("{LINEAR}{}", effect("input_gain", "force", "gain = 2.0")),
        EQUATIONS.to_owned(),
    ] {
        refused_on(&model, &LOG.replace("force [N]", "push [N]"), &["log.csv", "`force`"]);
        refused_on(
            &model,
            &LOG.replace("force [N]", "force [kN]"),
            &["log.csv", "`force` is in kN here and in N in the model", "convert"],
        );
        refused_on(
            &model,
            &LOG.replace("v [m/s]", "v [km/h]"),
            &["log.csv", "`v` is in km/h here and in m/s in the model"],
        );
        refused_on(&model, &LOG.replace("0.1,1,", "0.1,,"), &["log.csv", "row 3", "`force`"]);
    }
}

#[test]
fn an_output_without_a_sample_is_said_and_the_others_are_compared() {
    let folder = Folder::new();
    let silent = "time,force,s,v\n0,1,,0\n0.1,1,,0.1\n0.2,-1,,0.1\n0.3,-1,,-0.1\n";
    let text =
        run(&folder, LINEAR, silent, &["--json", folder.path("out.json").to_str().unwrap()]).done();
    assert!(
        text.contains("s: the log has this channel but no sample of it")
            && text.contains("v: nrmse "),
        "{text}"
    );
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path("out.json")).unwrap()).unwrap();
    assert!(json["nrmse"]["s"].is_null() && json["nrmse"]["v"].is_f64(), "{json}");
    let folder = Folder::new();
    run(&folder, LINEAR, &silent.replace("0.1,1,,", "0.1,1,loose,"), &[])
        .refused(&["row 3", "`s`", "`loose`"]);
}

#[test]
fn straight_lines_between_commands_pass_delays_and_lags_only() {
    let folder = Folder::new();
    let fine = [
        effect("input_delay", "force", "delay = 0.03"),
        effect("actuator_lag", "force", "time_constant = 0.1"),
    ]
    .concat();
    run(&folder, &format!("{LINEAR}{fine}"), LOG, &["--hold", "linear"]).done();
    let bent = format!("{LINEAR}{}", effect("saturation", "force", "upper = 0.5"));
    run(&Folder::new(), &bent, LOG, &["--hold", "linear"])
        .refused(&["path of input 0", "held commands"]);
    run(&Folder::new(), LINEAR, LOG, &["--delay", "force=-0.1"])
        .refused(&["--delay force=-0.1", "0 or more"]);
}

#[test]
fn commands_for_linear_models_say_so() {
    let folder = Folder::new();
    let (model, log) = (folder.write("cart.toml", EQUATIONS), folder.write("log.csv", LOG));
    let estimate = [
        "estimate",
        log.to_str().unwrap(),
        "--input",
        "force",
        "--output",
        "s",
        "--model",
        model.to_str().unwrap(),
    ];
    deadtime(&estimate).refused(&["cart.toml", "needs a linear model", "`equations`"]);
    deadtime(&["c2d", model.to_str().unwrap(), "--sample-time", "0.1"])
        .refused(&["cart.toml", "needs a linear model"]);
    let delayed = folder.write(
        "delayed.toml",
        &format!("{LINEAR}{}", effect("input_delay", "force", "delay = 0.03")),
    );
    deadtime(&["c2d", delayed.to_str().unwrap(), "--sample-time", "0.1"]).refused(&[
        "delayed.toml",
        "[[effects]]",
        "input_delay_s",
    ]);
    let list = ["list", "methods", "--model", model.to_str().unwrap()];
    deadtime(&list).refused(&["only `list effects`"]);
}

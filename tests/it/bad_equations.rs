//! Bad nonlinear models through the built program: exit code 2, a message that points at the fault, and nothing left behind.

use crate::support::program::{Folder, Run, deadtime};

const SERVO: &str = r#"
format = "deadtime/model@1"
name = "servo"
kind = "equations"
inputs = [{ name = "torque", unit = "N m" }]
outputs = [{ name = "angle", unit = "rad" }]
[states]
angle = { unit = "rad", initial = 0.0, initial_std = 0.0 }
speed = { unit = "rad/s" }
[parameters]
inertia = { unit = "kg m^2", value = 0.02 }
viscous = { unit = "N m s/rad", value = 0.1 }
[derivatives]
angle = "speed"
speed = "(torque - viscous*speed)/inertia"
[output_equations]
angle = "angle"
"#;

const LOG: &str = "time,torque,angle\n0,1,0\n0.1,1,0.1\n0.2,-1,0.3\n0.3,-1,0.4\n0.4,1,0.4\n";

/// Simulates the servo with one piece of its file replaced.
fn simulate(folder: &Folder, from: &str, to: &str, more: &[&str]) -> Run {
    assert!(SERVO.contains(from), "{from}");
    let model = folder.write("servo.toml", &SERVO.replace(from, to));
    let log = folder.write("log.csv", LOG);
    let out = folder.path("out.csv");
    let mut arguments = vec![
        "simulate",
        model.to_str().unwrap(),
        log.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    arguments.extend(more);
    deadtime(&arguments)
}

fn refused(from: &str, to: &str, says: &[&str]) -> String {
    let folder = Folder::new();
    let run = simulate(&folder, from, to, &[]);
    run.refused(says);
    assert!(run.stderr.contains("servo.toml"), "which file? {}", run.stderr);
    assert_eq!(folder.names(), ["log.csv", "servo.toml"], "something was left behind");
    run.stderr
}

#[test]
fn the_good_model_that_the_bad_ones_are_made_from_is_fine() {
    let folder = Folder::new();
    simulate(&folder, "servo", "servo", &["--states", "--delay", "torque=0.05"]).done();
    let written = std::fs::read_to_string(folder.path("out.csv")).unwrap();
    let header = written.lines().next().unwrap();
    assert!(header.contains("angle [rad]") && header.contains("speed [rad/s]"), "{header}");
    assert_eq!(written.lines().count(), 6);
    // Speed at 0.4 s by hand: 1 N m until 0.25 s, then −1 N m.
    let top = 10.0 * (1.0 - (-5.0_f64 * 0.25).exp());
    let speed = -10.0 + (top + 10.0) * (-5.0_f64 * 0.15).exp();
    let last: f64 = written.lines().last().unwrap().rsplit(',').next().unwrap().parse().unwrap();
    assert!((last - speed).abs() < 1e-8, "{last} {speed}");
}

#[test]
fn an_unknown_symbol_is_pointed_at_with_the_closest_name() {
    let says = refused(
        "viscous*speed",
        "visous*speed",
        &[
            "derivatives.speed, column 11",
            "`visous` is unknown",
            "did you mean `viscous`?",
            "inertia",
            "time",
        ],
    );
    assert!(says.contains("  (torque - visous*speed)/inertia\n            ^^^^^^"), "{says}");
}

#[test]
fn an_expression_that_is_none_is_pointed_at() {
    refused("/inertia\"", "/inertia)\"", &["derivatives.speed", "closes nothing"]);
    refused("(torque", "((torque", &["derivatives.speed, column 1", "never closed"]);
    refused("\"speed\"", "\"\"", &["derivatives.angle", "empty"]);
    refused(
        "\"speed\"",
        "\"speed speed\"",
        &["derivatives.angle, column 7", "without an operator"],
    );
    refused(
        "angle = \"angle\"",
        "angle = \"atan2(angle)\"",
        &["output_equations.angle", "`atan2` takes 2 arguments, 1 given"],
    );
    let deep = "(".repeat(200_000);
    refused("\"speed\"", &format!("\"{deep}\""), &["split the expression"]);
}

#[test]
fn a_division_by_zero_at_the_start_is_explained() {
    refused(
        "(torque - viscous*speed)/inertia",
        "(torque - viscous*speed)/angle",
        &[
            "derivatives.speed: (torque - viscous*speed)/angle divides by zero at t = 0 s",
            "initial",
        ],
    );
    refused(
        "angle = \"angle\"",
        "angle = \"log(angle)\"",
        &["output_equations.angle: log(angle) takes the logarithm of 0"],
    );
}

#[test]
fn a_domain_that_is_left_on_the_way_is_explained() {
    let says = refused(
        "\"(torque - viscous*speed)/inertia\"",
        "\"-torque*sqrt(0.5 - 10*time)\"",
        &["derivatives.speed: sqrt(0.5 - 10*time) takes the square root of -"],
    );
    assert!(says.contains("at t = 0.0"), "{says}");
}

#[test]
fn what_does_not_belong_together_is_named() {
    refused("angle = \"speed\"", "", &["the state `angle` has no derivative", "[derivatives]"]);
    refused(
        "angle = \"speed\"",
        "angle = \"speed\"\nfoo = \"1\"",
        &["the derivative `foo` belongs to no state"],
    );
    refused(
        "[output_equations]\nangle = \"angle\"",
        "[output_equations]",
        &["the output `angle` has no equation"],
    );
    refused(
        "angle = \"angle\"",
        "angle = \"angle\"\nrate = \"speed\"",
        &["the output equation `rate` belongs to no output"],
    );
    refused("[output_equations]\nangle = \"angle\"", "", &["output_equations"]);
}

#[test]
fn clashing_and_impossible_names_are_told() {
    refused("inertia = {", "speed = {", &["`speed` is a parameter and a state", "rename"]);
    refused("inertia = {", "time = {", &["`time` is a parameter and the time"]);
    refused("inertia = {", "sin = {", &["`sin` is a parameter and a function"]);
    refused(
        "inertia = {",
        "\"moment of inertia\" = {",
        &["the parameter `moment of inertia` cannot stand in an expression", "letter"],
    );
    refused(
        "{ name = \"angle\", unit = \"rad\" }",
        "{ name = \"angle\" }, { name = \"angle\" }",
        &["output `angle` is named twice"],
    );
}

#[test]
fn numbers_that_cannot_be_are_told() {
    refused("value = 0.02", "value = nan", &["parameters.inertia.value is NaN", "finite"]);
    refused("initial = 0.0", "initial = inf", &["states.angle.initial is inf"]);
    refused(
        "initial_std = 0.0",
        "initial_std = -1.0",
        &["states.angle.initial_std is -1", "not negative"],
    );
    refused(
        "kind = \"equations\"",
        "kind = \"equations\"\nsample_time_s = 0.1",
        &["sample_time_s holds 0.1", "continuous time"],
    );
    refused(
        "kind = \"equations\"",
        "kind = \"equations\"\ninput_delay_s = [-0.1]",
        &["input_delay_s holds -0.1"],
    );
    refused(
        "kind = \"equations\"",
        "kind = \"equations\"\ninput_delay_s = [0.1, 0.2]",
        &["input_delay_s: 2 given, 1 needed"],
    );
    refused("unit = \"N m\" }", "operating = 1.0 }", &["operating holds 1", "linear"]);
    refused("{ unit = \"rad/s\" }", "{ unit = \"rad/s\", start = 1.0 }", &["start"]);
    refused(
        "kind = \"equations\"",
        "kind = \"magic\"",
        &["kind is `magic`", "lti, equations, tf and zpk"],
    );
}

#[test]
fn a_model_that_explodes_says_when() {
    refused("(torque - viscous*speed)/inertia", "1e3*(1 + speed^2)", &["explodes", "t = 0.00157"]);
}

#[test]
fn a_command_for_linear_models_says_so() {
    let folder = Folder::new();
    let model = folder.write("servo.toml", SERVO);
    let method = ["c2d", model.to_str().unwrap(), "--sample-time", "0.1"];
    deadtime(&method).refused(&["servo.toml", "needs a linear model", "`equations`"]);
}

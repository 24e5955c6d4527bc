//! Measured logs beside the repository: what the program says of them, next to what is known of them.
//!
//! Without the logs every test is skipped. No estimator is tuned to these files.

use crate::support::outside::shared_data;
use crate::support::program::{Folder, deadtime, text};
use serde_json::Value;

/// The estimates of one input and output.
struct Answer(Value);

impl Answer {
    fn of(name: &str, input: &str, output: &str, more: &[&str]) -> Option<Self> {
        let path = shared_data(name)?;
        let folder = Folder::new();
        let file = folder.path("out.json");
        let arguments = [
            &["estimate", text(&path), "--input", input, "--output", output, "--json", text(&file)],
            more,
        ]
        .concat();
        let said = deadtime(&arguments).done();
        let report: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        let pair = report["pairs"][0].clone();
        println!("{name} {}", said.split_once('\n').map_or("", |(_, table)| table));
        Some(Self(pair))
    }

    fn verdict_s(&self) -> Option<f64> {
        self.0["verdict"]["delay_s"].as_f64()
    }

    /// The delay of a method that found one.
    #[track_caller]
    fn found(&self, method: &str) -> f64 {
        let e =
            self.0["estimates"].as_array().unwrap().iter().find(|e| e["method"] == method).unwrap();
        assert_eq!(e["outcome"], "found", "{e}");
        e["delay_s"].as_f64().unwrap()
    }

    #[track_caller]
    fn verdict_within(&self, from_s: f64, to_s: f64) {
        let delay_s = self.verdict_s();
        assert!(
            delay_s.is_some_and(|d| (from_s - 1e-9..=to_s + 1e-9).contains(&d)),
            "{delay_s:?} s: {}",
            self.0["verdict"]
        );
    }
}

#[test]
fn the_hair_dryers_air_takes_two_or_three_samples() {
    let Some(answer) = Answer::of("hairdryer/hairdryer.csv", "heater_voltage", "outlet_temp", &[])
    else {
        return;
    };
    answer.verdict_within(0.08, 0.24);
    for method in ["oestruc", "threshold"] {
        assert!((answer.found(method) - 0.16).abs() < 1e-9, "{method}: {}", answer.0);
    }
}

#[test]
#[ignore = "nightly: real logs"]
fn the_heat_exchanger_reacts_within_the_sample() {
    let Some(answer) = Answer::of("heat_exchanger/exchanger.csv", "flow_rate", "outlet_temp", &[])
    else {
        return;
    };
    // Less than a thousandth of a sample.
    answer.verdict_within(0.0, 1e-6);
}

#[test]
fn the_lamp_warms_its_plate_after_a_few_seconds() {
    let Some(answer) = Answer::of("heating_system/heating.csv", "lamp_voltage", "plate_temp", &[])
    else {
        return;
    };
    answer.verdict_within(0.0, 8.0);
}

#[test]
fn the_winding_tension_follows_its_motor_within_two_samples() {
    let Some(answer) =
        Answer::of("winding/winding.csv.gz", "u5_reel3_current_sp", "y2_tension23", &[])
    else {
        return;
    };
    answer.verdict_within(0.0, 0.2);
}

#[test]
#[ignore = "nightly: real logs"]
fn the_silverbox_has_no_dead_time() {
    let Some(answer) = Answer::of(
        "silverbox/snls80mv.csv.gz",
        "force_v1",
        "displacement_v2",
        &["--from", "70", "--to", "80"],
    ) else {
        return;
    };
    // Less than a thousandth of a sample.
    answer.verdict_within(0.0, 1e-6);
}

#[test]
#[ignore = "nightly: real logs"]
fn the_real_servo_lags_its_authors_simulation_by_about_a_sample() {
    let servo = |output| {
        Answer::of(
            "servo_real_and_sim/servo_action_real_sim.csv",
            "action_rad",
            output,
            &["--records", "rollout", "--max-delay", "0.3"],
        )
    };
    let (Some(real), Some(simulated)) = (servo("real_angle_rad"), servo("authors_sim_angle_rad"))
    else {
        return;
    };
    // One sample of 0.02 s: in most rollouts the real arm moves 3 samples after a step of the command, the simulated one 2. The verdicts know each to about a sample.
    let gap_s = real.verdict_s().unwrap() - simulated.verdict_s().unwrap();
    println!("verdicts: {gap_s:.3} s apart");
    assert!(gap_s > 0.0 && gap_s < 0.045, "{gap_s} s");
}

#[test]
fn a_rate_loop_whose_set_point_was_logged_too_seldom_is_not_said_to_react_at_once() {
    let methods = ["oestruc", "arxstruc", "delayest", "met1struc", "oe_posterior", "p2d", "arxdap"];
    let mut more = vec!["--resample", "0.0045"];
    methods.iter().for_each(|m| more.extend(["--method", *m]));
    let Some(answer) = Answer::of("px4_logs/px4_fmu_v6c.csv.gz", "roll_rate_sp", "gyro_x", &more)
    else {
        return;
    };
    let delay_s = answer.verdict_s();
    assert!(delay_s.is_none_or(|d| (0.01..0.05).contains(&d)), "{delay_s:?}");
}

/// What is known of each is an upper bound: a fit with more lag in the dead time, the loop's lag included, or the distance of the microphones.
#[test]
#[ignore = "nightly: all real logs"]
fn no_other_log_has_a_verdict_beyond_what_is_known_of_it() {
    let (mut there, mut answered) = (0, 0);
    for (name, input, output, more, most_s) in [
        ("emps/train.csv.gz", "motor_force_N", "pos_meas_m", &["--to", "5"][..], 0.007),
        ("tclab/tclab_step_test_siso.csv", "heater_pwm", "temp_kelvin", &["--resample", "1"], 14.0),
        ("tclab/tclab_dual_10min.csv", "heater1_pct", "temp1_degC", &["--resample", "1"], 14.0),
        (
            "px4_logs/px4_fmu_v6c.csv.gz",
            "roll_rate_sp",
            "gyro_x",
            &["--resample", "0.0045", "--to", "20"],
            0.049,
        ),
        (
            "mic_pair/alexa_pair_48k.csv.gz",
            "mic2",
            "mic1",
            &["--resample", "0.00002083333333333", "--to", "0.3"],
            408e-6,
        ),
        (
            "servo_real_and_sim/servo_response_real.csv.gz",
            "action_rad",
            "real_angle_rad",
            &["--records", "rollout"],
            0.06,
        ),
    ] {
        let Some(answer) = Answer::of(name, input, output, more) else { continue };
        there += 1;
        if answer.verdict_s().is_some() {
            answered += 1;
            answer.verdict_within(0.0, most_s);
        }
    }
    // Where no log has a verdict nothing is compared.
    assert!(there == 0 || answered > 0, "none of {there} logs has a verdict");
}

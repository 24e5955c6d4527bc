//! Channels that are calculated from others.

use deadtime::log::{Channel, Log};
use deadtime::model::Derived;

use crate::support::program::{Folder, deadtime, text};

fn log(columns: &[(&str, f64)]) -> Log {
    let channels = columns
        .iter()
        .map(|(name, value)| Channel::new(*name, None, vec![*value, *value]))
        .collect();
    Log::new("log", vec![5.0, 5.5], channels).unwrap()
}

fn value(expression: &str, columns: &[(&str, f64)]) -> f64 {
    let derived = Derived::parse(&format!("result={expression}")).unwrap();
    let log = derived.add_to(log(columns)).unwrap();
    log.output("result").unwrap().get(1).unwrap()
}

fn near(expression: &str, columns: &[(&str, f64)], expected: f64) {
    let found = value(expression, columns);
    assert!((found - expected).abs() < 1e-12, "{expression}: {found} where {expected} is due");
}

#[test]
fn sizes_angles_and_plain_arithmetic() {
    near("hypot(vx, vy)", &[("vx", 3.0), ("vy", -4.0)], 5.0);
    near("hypot(vx - 1, hypot(vy, 0)) ^ 2", &[("vx", 4.0), ("vy", 4.0)], 25.0);
    near("deg(a) + rad(180)", &[("a", std::f64::consts::PI)], 180.0 + std::f64::consts::PI);
    near("-2^2 + 1e-3*x + pi*0", &[("x", 1000.0)], -3.0);
    near("time", &[("x", 1.0)], 0.5);
    near("imu.gyro[0] - imu.gyro[1]", &[("imu.gyro[0]", 3.0), ("imu.gyro[1]", 1.0)], 2.0);
    near("`/cmd vel.x`/2", &[("/cmd vel.x", 3.0)], 1.5);
}

const W: f64 = 0.7219948723811553;
const Q: [f64; 3] = [0.2062842492517587, -0.4125684985035174, 0.5157106231293968];
const ROLL_PITCH_YAW: [f64; 3] = [-0.21866894587394214, -0.9416168416743644, 1.3521273809209549];
const BODY: [f64; 3] = [1.4042553191489362, -2.0638297872340425, 2.7872340425531914];

/// `scipy.spatial.transform.Rotation` 1.17.1 of the same quaternion (which scipy writes with w last): `as_euler("ZYX")`, `inv().apply([1, -2, 3])`.
#[test]
fn rotations_are_those_of_scipy() {
    let q = [("w", W), ("x", Q[0]), ("y", Q[1]), ("z", Q[2]), ("a", 1.0), ("b", -2.0), ("c", 3.0)];
    for (function, expected) in
        [("roll", ROLL_PITCH_YAW[0]), ("pitch", ROLL_PITCH_YAW[1]), ("yaw", ROLL_PITCH_YAW[2])]
    {
        near(&format!("{function}(w, x, y, z)"), &q, expected);
    }
    for (function, expected) in ["body_x", "body_y", "body_z"].into_iter().zip(BODY) {
        near(&format!("{function}(w, x, y, z, a, b, c)"), &q, expected);
    }
    // Straight up, where rounding may leave the sine a little above 1.
    near(
        "pitch(w, 0, y, 0)",
        &[("w", 0.5_f64.sqrt() * (1.0 + 1e-15)), ("y", 0.5_f64.sqrt())],
        std::f64::consts::FRAC_PI_2,
    );
}

#[test]
fn what_is_missing_or_not_finite_is_missing() {
    let channels = vec![
        Channel::partial("a", None, vec![1.0, 2.0, 3.0], vec![true, false, true]),
        Channel::new("b", None, vec![0.0, 1.0, 2.0]),
    ];
    let log = Log::new("log", vec![0.0, 1.0, 2.0], channels).unwrap();
    let log = Derived::parse("r [1/s]=a/b").unwrap().add_to(log).unwrap();
    let r = log.output("r").unwrap();
    assert_eq!([r.get(0), r.get(1), r.get(2)], [None, None, Some(1.5)]);
    assert_eq!(log.unit("r"), Some("1/s"));
}

#[test]
fn mistakes_are_named() {
    let deep = format!("r={}x{}", "hypot(".repeat(60), ",0)".repeat(60));
    for (text, says) in [
        ("speed", "NAME=EXPRESSION"),
        ("=vx", "NAME=EXPRESSION"),
        ("r=", "NAME=EXPRESSION"),
        ("r=hypot(vx)", "takes 2 arguments, 1 given"),
        ("r=roll()", "takes 4 arguments, 0 given"),
        ("r=hypot(vx, vy", "( is never closed"),
        ("r=`vx", "` is never closed"),
        ("r=hypott(vx, vy)", "no function `hypott`"),
        ("r=vx +", "ends where"),
        ("r=vx)", "closes nothing"),
        (deep.as_str(), "too long"),
    ] {
        let said = Derived::parse(text).unwrap_err().to_string();
        assert!(said.contains(says), "{text}: {said}");
    }
    let missing =
        Derived::parse("r=vx+vz").unwrap().add_to(log(&[("vx", 1.0)])).unwrap_err().to_string();
    assert!(missing.contains("vz"), "{missing}");
    let taken =
        Derived::parse("vx=2*vx").unwrap().add_to(log(&[("vx", 1.0)])).unwrap_err().to_string();
    assert!(taken.contains("vx"), "{taken}");
}

#[test]
fn the_command_line_estimates_on_a_calculated_channel() {
    let folder = Folder::new();
    let mut rows = "time,u,vx,vy\n".to_owned();
    let mut state = 7_u64;
    let mut commands = Vec::new();
    for k in 0..400_usize {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        commands.push(if state >> 63 == 1 { 2.0 } else { 1.0 });
        let late = commands[k.saturating_sub(6)];
        rows.push_str(&format!(
            "{},{},{},{}\n",
            k as f64 * 0.01,
            commands[k],
            0.6 * late,
            0.8 * late
        ));
    }
    let file = folder.write("run.csv", &rows);
    let channel = "speed [m/s]=hypot(vx,vy)";
    let run = deadtime(&[
        "estimate",
        text(&file),
        "--channel",
        channel,
        "--input",
        "u",
        "--output",
        "speed",
        "--method",
        "arxstruc",
    ]);
    // The output shows the command of 6 samples before, and what acts on [t, t + Ts) is seen at t + Ts: 5 samples beyond the one that a strictly proper plant has.
    let said = run.words();
    assert!(said.contains("0.05"), "{said}");
    deadtime(&[
        "estimate",
        text(&file),
        "--channel",
        "speed=hypot(vx,vz)",
        "--input",
        "u",
        "--output",
        "speed",
    ])
    .refused(&["vz"]);
}

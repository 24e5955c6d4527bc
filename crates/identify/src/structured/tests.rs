//! Dead times from logs, on drawn systems with known dead times.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fit::{Prepared, Structured, score};
use super::record::WindowLayout;
use super::window::{Buffers, WindowPoint};
use super::{Standing, StructuredFit};
use deadtime_log::{Channel, Log};
use deadtime_model::{EquationsFile, ModelDocument};

/// Steps of the reference simulation per sample; drawn dead times are multiples of them, so that the reference switches exactly.
const FINE: usize = 50;
const STEP_S: f64 = 0.02;

/// A lag and its integral.
const LAG: &str = r#"
format = "deadtime/model@1"
name = "lag"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "v" }, { name = "x" }]
[states]
v = {}
x = {}
[parameters]
gain = { value = 1.0 }
lag = { value = 0.2 }
[derivatives]
v = "(gain*u - v)/lag"
x = "v"
[output_equations]
v = "v"
x = "x"
"#;

/// A pendulum with a torque and a wind across the arm.
const PENDULUM: &str = r#"
format = "deadtime/model@1"
name = "pendulum"
kind = "equations"
inputs = [{ name = "torque" }, { name = "wind" }]
outputs = [{ name = "angle" }, { name = "rate" }]
[states]
angle = {}
rate = {}
[parameters]
gain = { value = 40.0 }
stiffness = { value = 12.0 }
friction = { value = 0.3 }
gust = { value = 10.0 }
[derivatives]
angle = "rate"
rate = "gain*torque - stiffness*sin(angle) - friction*rate + gust*wind*cos(angle)"
[output_equations]
angle = "angle"
rate = "rate"
"#;

fn model(text: &str, delays_s: &[f64]) -> EquationsFile {
    match ModelDocument::from_toml(text, Path::new("test.toml")).unwrap() {
        ModelDocument::Equations(mut file) => {
            file.input_delay_s = delays_s.to_vec();
            file
        }
        ModelDocument::Lti(_) => panic!("equations"),
    }
}

/// The slope of the states at an input.
type Slope<'a> = &'a dyn Fn([f64; 2], &[f64]) -> [f64; 2];

fn lag(gain: f64, lag: f64) -> impl Fn([f64; 2], &[f64]) -> [f64; 2] {
    move |[v, _], u| [(gain * u[0] - v) / lag, v]
}

fn pendulum([gain, stiffness, friction, gust]: [f64; 4]) -> impl Fn([f64; 2], &[f64]) -> [f64; 2] {
    move |[angle, rate], u| {
        let rise = gain * u[0] - stiffness * angle.sin() - friction * rate;
        [rate, rise + gust * u[1] * angle.cos()]
    }
}

/// A log of a system with inputs delayed by these numbers of fine steps. The system has run for 100 samples before, with inputs outside the log. The reference
/// uses its own midpoint rule.
fn run(
    slope: Slope<'_>,
    names: [&[&str]; 2],
    late: &[usize],
    (rows, held, noise): (usize, usize, f64),
    seed: u64,
) -> Log {
    const BEFORE: usize = 100;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut inputs = vec![Vec::new(); late.len()];
    for column in &mut inputs {
        while column.len() < BEFORE + rows {
            let value = random.random_range(-1.0..1.0);
            column.extend(std::iter::repeat_n(value, random.random_range(1..=held)));
        }
    }
    let (mut x, mut seen) = ([0.0; 2], vec![Vec::new(); 2]);
    let h = STEP_S / FINE as f64;
    for k in 0..BEFORE + rows {
        for i in 0..2 {
            // Uniform noise of this standard deviation.
            let off = 3_f64.sqrt() * noise * random.random_range(-1.0..1.0);
            seen[i].push(x[i] + off);
        }
        for fine in 0..FINE {
            let at = |(column, late): (&Vec<f64>, &usize)| {
                column[(k * FINE + fine).saturating_sub(*late) / FINE]
            };
            let u: Vec<f64> = inputs.iter().zip(late).map(at).collect();
            let first = slope(x, &u);
            let middle = slope([x[0] + h / 2.0 * first[0], x[1] + h / 2.0 * first[1]], &u);
            x = [x[0] + h * middle[0], x[1] + h * middle[1]];
        }
    }
    let [u_names, y_names] = names;
    let columns = u_names.iter().zip(&inputs).chain(y_names.iter().zip(&seen));
    let channels = columns
        .map(|(name, v)| Channel::new(*name, None, v[BEFORE..BEFORE + rows].to_vec()))
        .collect();
    let time = (0..rows).map(|k| k as f64 * STEP_S).collect();
    Log::new(format!("run {seed}"), time, channels).unwrap()
}

fn lagged(late: usize, shape: (usize, usize, f64), seed: u64) -> Log {
    run(&lag(1.4, 0.3), [&["u"], &["v", "x"]], &[late], shape, seed)
}

fn swung(late: [usize; 2], shape: (usize, usize, f64), seed: u64) -> Log {
    let slope = pendulum([36.0, 10.0, 0.5, 8.0]);
    run(&slope, [&["torque", "wind"], &["angle", "rate"]], &late, shape, seed)
}

fn seconds(late: usize) -> f64 {
    late as f64 * STEP_S / FINE as f64
}

fn free(names: &[&str]) -> Structured {
    Structured {
        free: names.iter().map(|n| (*n).to_owned()).collect(),
        horizon: 25,
        ..Structured::default()
    }
}

fn found<'a>(fit: &'a StructuredFit, name: &str) -> &'a super::FreeParameter {
    fit.parameters.iter().find(|p| p.name == name).unwrap()
}

#[test]
fn sensitivities_to_dead_times_agree_with_differences() {
    let logs = [swung([0, 0], (200, 4, 0.0), 1)];
    let step = 1e-6;
    for samples in [[0.3, 0.7], [2.4, 2.4], [6.5, 0.1], [1.999, 3.0005]] {
        let delays_s = samples.map(|q| q * STEP_S);
        let file = model(PENDULUM, &delays_s);
        let prepared = Prepared::new(&file, &logs).unwrap();
        let layout = WindowLayout { horizon: 30, stride: 37 };
        let records = prepared.records(&logs, layout).unwrap();
        // Gain, friction and both dead times.
        let columns = [(0, 1.0), (2, 1.0), (4, 1.0), (5, 1.0)];
        for substeps in [1, 4] {
            let mut problem = prepared.problem(&records, 30, columns.to_vec(), Vec::new());
            problem.simulator.substeps = substeps;
            let errors = |z: &[f64]| {
                let (mut errors, mut slopes) = (Vec::new(), Vec::new());
                let p = problem.parameters(0, z);
                for &start in &records[0].windows {
                    let at = WindowPoint { p: &p, columns: &columns, starts: &[], shift: &[] };
                    let buffers = &mut Buffers::default();
                    assert!(problem.simulator.walk(&records[0], start, at, buffers, |seen| {
                        errors.extend_from_slice(seen.error);
                        slopes.extend_from_slice(seen.slopes);
                    }));
                }
                (errors, slopes)
            };
            let (_, slopes) = errors(&[0.0; 4]);
            let largest = slopes.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for j in 0..4 {
                let mut z = [[0.0; 4]; 2];
                (z[0][j], z[1][j]) = (-step, step);
                let [low, high] = z.map(|z| errors(&z).0);
                for (k, (low, high)) in low.iter().zip(&high).enumerate() {
                    let (exact, by) = (slopes[k * 4 + j], (high - low) / (2.0 * step));
                    // The difference has rounding of 1e-10 and the error of a Runge-Kutta step, whose length changes with the dead time.
                    assert!(
                        (exact - by).abs() < 2e-4 * largest,
                        "{samples:?} {substeps} {j} {k}: {exact} {by} of {largest}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_dead_time_of_whole_samples_is_the_column_that_many_rows_later_to_the_bit() {
    let log = swung([0, 0], (200, 4, 0.01), 2);
    for late in [[0, 0], [3, 0], [2, 7], [250, 1]] {
        let moved = |name: &str, by: usize| {
            let column = log.input(name).unwrap();
            let moved = (0..column.len()).map(|k| column[k.saturating_sub(by)]).collect();
            Channel::new(name, None, moved)
        };
        let kept = |name: &str| Channel::new(name, None, log.input(name).unwrap().to_vec());
        let channels =
            vec![moved("torque", late[0]), moved("wind", late[1]), kept("angle"), kept("rate")];
        let later = Log::new("later", log.time_s().to_vec(), channels).unwrap();
        let delays_s = late.map(|n| n as f64 * STEP_S);
        let ours = score(&model(PENDULUM, &delays_s), std::slice::from_ref(&log), 20, 7).unwrap();
        let theirs = score(&model(PENDULUM, &[]), &[later], 20, 7).unwrap();
        assert_eq!(ours, theirs);
    }
}

#[test]
fn a_dead_time_of_part_of_a_sample_predicts_the_system_that_has_it() {
    let log = lagged(3 * FINE + 17, (300, 5, 0.0), 3);
    let mut file = model(LAG, &[seconds(3 * FINE + 17)]);
    (file.parameters[0].1.value, file.parameters[1].1.value) = (1.4, 0.3);
    // The first windows need inputs from before the log.
    let found = score(&file, &[log], 25, 25).unwrap();
    let late = |of: &super::GroupScore| of.mean_absolute.iter().sum::<f64>() / 25.0;
    assert!(found.iter().all(|g| late(g) < 5e-3), "{found:?}");
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn intervals_hold_dead_times_of_parts_of_samples() {
    let (mut held, mut all) = (0, 0);
    for seed in 0..50 {
        let mut random = ChaCha8Rng::seed_from_u64(900 + seed);
        let late = random.random_range(0..20 * FINE);
        let logs = [lagged(late, (800, 8, 0.01), seed)];
        let options = Structured { one_step: false, ..free(&["all"]) };
        let fit = options.fit(&model(LAG, &[]), &logs, &[]).unwrap();
        let p = found(&fit, "delay:u");
        assert_eq!(p.unit.as_deref(), Some("s"));
        assert!((p.value - seconds(late)).abs() < STEP_S / 2.0, "{late}: {p:?}");
        all += 1;
        held += usize::from(p.interval[0] <= seconds(late) && seconds(late) <= p.interval[1]);
    }
    // Of 50 intervals of 95 %, fewer than 44 hold the truth in one of 26 cases.
    assert!(held >= 44, "{held} of {all}");
}

#[test]
fn two_dead_times_of_a_nonlinear_system_are_found_with_its_parameters() {
    // Of ten intervals of 95 %, fewer than 8 hold the truth in one of 87 cases.
    two_dead_times(0..5, 8);
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn two_dead_times_of_a_nonlinear_system_are_found_with_its_parameters_in_twenty_draws() {
    two_dead_times(0..20, 35);
}

fn two_dead_times(seeds: std::ops::Range<u64>, least: usize) {
    let (mut held, mut all) = (0, 0);
    for seed in seeds {
        let mut random = ChaCha8Rng::seed_from_u64(700 + seed);
        let late = [random.random_range(0..15 * FINE), random.random_range(0..15 * FINE)];
        let logs = [swung(late, (800, 8, 0.005), seed)];
        let options = Structured { one_step: false, ..free(&["all"]) };
        let fit = options.fit(&model(PENDULUM, &[0.1, 0.0]), &logs, &[]).unwrap();
        for (name, late) in [("delay:torque", late[0]), ("delay:wind", late[1])] {
            let p = found(&fit, name);
            assert!((p.value - seconds(late)).abs() < STEP_S / 2.0, "{late}: {p:?}");
            all += 1;
            held += usize::from(p.interval[0] <= seconds(late) && seconds(late) <= p.interval[1]);
        }
        for (name, truth) in [("gain", 36.0), ("stiffness", 10.0), ("friction", 0.5), ("gust", 8.0)]
        {
            let p = found(&fit, name);
            assert!((p.value - truth).abs() < 5.0 * p.std.max(1e-3 * truth), "{p:?}");
        }
    }
    assert!(held >= least, "{held} of {all}");
}

#[test]
fn a_dead_time_far_from_the_files_is_found_and_shrinkage_does_not_hold_it() {
    let late = 25 * FINE + 20;
    let logs = [lagged(late, (800, 3, 0.01), 5)];
    for shrinkage in [None, Some(10.0)] {
        let options = Structured { shrinkage, ..free(&["delay:u"]) };
        let mut file = model(LAG, &[]);
        (file.parameters[0].1.value, file.parameters[1].1.value) = (1.4, 0.3);
        let fit = options.fit(&file, &logs, &[]).unwrap();
        let p = found(&fit, "delay:u");
        assert!((p.value - seconds(late)).abs() < 5.0 * p.std && p.std < 1e-3, "{p:?}");
        assert_eq!(p.standing, Standing::Physical, "{p:?}");
        assert_eq!(fit.model.as_ref().unwrap().input_delay_s, [p.value]);
    }
}

#[test]
fn runs_are_the_predictions_that_the_errors_summarise() {
    let [train, held_out] = [40, 41].map(|seed| vec![lagged(100, (400, 8, 0.01), seed)]);
    let options = Structured { one_step: false, ..free(&["gain", "lag"]) };
    for (held_out, shown) in [(&[][..], &train), (&held_out[..], &held_out)] {
        let fit = options.fit(&model(LAG, &[]), &train, held_out).unwrap();
        assert_eq!(fit.runs.len(), 2);
        let scores = fit.held_out.as_ref().unwrap_or(&fit.training);
        for (at, run) in fit.runs.iter().enumerate() {
            let logged = shown[0].output(&run.output).unwrap();
            assert_eq!(run.time_s.len(), shown[0].len());
            assert!((0..run.measured.len()).all(|k| logged.get(k) == Some(run.measured[k])));
            for (predicted, groups) in run.predicted.iter().zip(scores) {
                let errors: Vec<f64> = predicted
                    .iter()
                    .zip(&run.measured)
                    .filter(|(p, _)| !p.is_nan())
                    .map(|(p, y)| (p - y).abs())
                    .collect();
                // 400 rows hold fifteen windows of 25 steps.
                assert_eq!(errors.len(), 15 * 25);
                let mean = errors.iter().sum::<f64>() / errors.len() as f64;
                let of_group = groups[at].sum / 25.0;
                assert!((mean - of_group).abs() < 1e-12 * of_group, "{mean} {of_group}");
            }
        }
    }
}

#[test]
fn the_shrinkage_decides_how_many_parameters_the_logs_determine() {
    let logs = [lagged(0, (400, 8, 0.01), 42)];
    let of = |shrinkage| {
        let options =
            Structured { shrinkage: Some(shrinkage), one_step: false, ..free(&["gain", "lag"]) };
        options.fit(&model(LAG, &[]), &logs, &[]).unwrap().determined
    };
    let found = [1e-6, 1e3, 1e15].map(of);
    assert!(found[0] > 1.999 && found[0] >= found[1] && found[1] >= found[2], "{found:?}");
    assert!(found[2] < 1e-3, "{found:?}");
}

#[test]
fn no_dead_time_is_an_answer() {
    for seed in 0..5 {
        let logs = [lagged(0, (800, 8, 0.01), 30 + seed)];
        let fit = free(&["all"]).fit(&model(LAG, &[]), &logs, &[]).unwrap();
        let p = found(&fit, "delay:u");
        assert!(p.interval[0] == 0.0 && p.interval[1] < STEP_S / 2.0, "{p:?}");
        assert!(!matches!(p.standing, Standing::Open | Standing::Surrogate), "{p:?}");
    }
}

#[test]
fn a_constant_input_shows_no_dead_time() {
    let log = lagged(0, (400, 4, 0.01), 7);
    let kept = |name: &str| Channel::new(name, None, log.input(name).unwrap().to_vec());
    let channels = vec![Channel::new("u", None, vec![0.5; 400]), kept("v"), kept("x")];
    let logs = [Log::new("constant", log.time_s().to_vec(), channels).unwrap()];
    let fit = free(&["gain", "delay:u"]).fit(&model(LAG, &[0.1]), &logs, &[]).unwrap();
    let p = found(&fit, "delay:u");
    assert_eq!((p.value, p.standing), (0.1, Standing::Open));
    assert!(
        fit.unseen.iter().any(|u| u.words == "delay:u, which the logs do not show"),
        "{:?}",
        fit.unseen
    );
    assert!(p.interval[0] == 0.0 && p.interval[1] > 3.9, "{p:?}");
}

#[test]
fn one_sine_does_not_distinguish_lag_and_dead_time() {
    // A steady sine has an amplitude and a phase: two values for gain, lag and dead time.
    let (rows, omega) = (1500_u32, 2.0_f64);
    let (gain, lag, delay_s) = (1.4_f64, 0.3_f64, 0.15);
    let time: Vec<f64> = (0..rows).map(|k| f64::from(k) * STEP_S).collect();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let size = gain / (1.0 + (omega * lag).powi(2)).sqrt();
    let phase = (omega * lag).atan() + omega * (delay_s + STEP_S / 2.0);
    let mut noise = || 0.01 * random.random_range(-1.0..1.0);
    let angle = |t: &f64| omega * t - phase;
    let v = time.iter().map(|t| size * angle(t).sin() + noise()).collect();
    let x = time.iter().map(|t| -size / omega * angle(t).cos() + noise()).collect();
    let u = time.iter().map(|t| (omega * t).sin()).collect();
    let channels =
        vec![Channel::new("u", None, u), Channel::new("v", None, v), Channel::new("x", None, x)];
    let logs = [Log::new("sine", time.clone(), channels).unwrap()];
    // A window of one period from an unlogged initial state no longer determines that state.
    let text =
        LAG.replace(r#"{ name = "v" }, "#, "").replace("v = \"v\"\nx = \"x\"\n", "x = \"x\"\n");
    let options = Structured { horizon: 160, one_step: false, ..free(&["all"]) };
    let fit = options.fit(&model(&text, &[]), &logs, &[]).unwrap();
    let p = found(&fit, "delay:u");
    assert!(!fit.unseen.is_empty() || !fit.trades.is_empty(), "{:#?}", fit.parameters);
    assert_eq!(p.standing, Standing::Open, "{p:?}");
}

#[test]
fn dead_times_beyond_the_log_and_unknown_names_are_no_panic() {
    let logs = [lagged(0, (60, 4, 0.01), 8)];
    for delay_s in [1.19, 100.0, 1e300] {
        let fit = free(&["all"]).fit(&model(LAG, &[delay_s]), &logs, &[]).unwrap();
        assert!(found(&fit, "delay:u").value >= 0.0);
    }
    let own = Structured { per_record: vec!["delay:u".into()], ..free(&["gain", "delay:u"]) };
    let fit = own.fit(&model(LAG, &[]), &logs, &[]).unwrap();
    assert_eq!(fit.per_record[0].0, "delay:u");
    let told = free(&["delay:w"]).fit(&model(LAG, &[]), &logs, &[]).unwrap_err().to_string();
    assert!(told.contains("no parameter `delay:w`; it has gain, lag, delay:u"), "{told}");
}

#[test]
fn a_slope_is_late_with_its_input() {
    let text = LAG
        .replace(
            r#"[{ name = "u" }]"#,
            r#"[{ name = "u" }, { name = "u_slope", derivative_of = "u" }]"#,
        )
        .replace("gain*u", "gain*(u + lead*u_slope)")
        .replace("[derivatives]", "lead = { value = 0.0, known = true }\n[derivatives]");
    let late = 5 * FINE;
    let file = model(&text, &[0.0, 0.01]);
    let log = lagged(late, (600, 5, 0.01), 9);
    let log = ModelDocument::Equations(file.clone()).complete(log).unwrap();
    let fit = free(&["all"]).fit(&file, &[log], &[]).unwrap();
    let names: Vec<&str> = fit.parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["gain", "lag", "delay:u"]);
    let written = fit.model.unwrap().input_delay_s;
    assert!(
        (written[1] - written[0] - 0.01).abs() < 1e-12 && (written[0] - 0.1).abs() < 0.005,
        "{written:?}"
    );
}

#[test]
fn a_dead_time_in_a_loop_is_found_where_a_reference_moves() {
    // A lag under u = 2 (r − v), with a held command and a dead time of 4.3 samples.
    let (mut held, late) = (0, 4 * FINE + 15);
    for seed in 0..20 {
        let mut random = ChaCha8Rng::seed_from_u64(60 + seed);
        let (rows, h) = (900, STEP_S / FINE as f64);
        let (mut commands, mut seen, mut whole) = (vec![0.0; 10], Vec::new(), Vec::new());
        let ([mut v, mut x], mut reference) = ([0.0; 2], 0.0);
        for k in 0..rows {
            if k % 20 == 0 {
                reference = random.random_range(-1.0..1.0);
            }
            let measured = v + 0.02 * random.random_range(-1.0..1.0);
            seen.push(measured);
            whole.push(x + 0.02 * random.random_range(-1.0..1.0));
            commands.push(2.0 * (reference - measured));
            for fine in 0..FINE {
                let u = commands[(commands.len() - 1) - (late + FINE - 1 - fine) / FINE];
                let middle = v + h / 2.0 * (1.4 * u - v) / 0.3;
                x += h * middle;
                v += h * (1.4 * u - middle) / 0.3;
            }
        }
        let time = (0..rows).map(|k| k as f64 * STEP_S).collect();
        let channels = vec![
            Channel::new("u", None, commands[10..].to_vec()),
            Channel::new("v", None, seen),
            Channel::new("x", None, whole),
        ];
        let logs = [Log::new("loop", time, channels).unwrap()];
        let options = Structured { one_step: false, ..free(&["all"]) };
        let fit = options.fit(&model(LAG, &[]), &logs, &[]).unwrap();
        let p = found(&fit, "delay:u");
        // Noise in the windows' first rows reaches the command: a bias below 0.1 samples.
        held += usize::from((p.value - seconds(late)).abs() < STEP_S / 2.0);
    }
    assert_eq!(held, 20);
}

/// The shipped flight, generated with a dead time of 0.13 s.
#[test]
fn the_shipped_flights_dead_time_is_found_with_all_parameters() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let text = std::fs::read_to_string(root.join("uav_flight.csv")).unwrap();
    let names: Vec<&str> = text
        .lines()
        .next()
        .unwrap()
        .split(',')
        .map(|name| name.split(' ').next().unwrap())
        .collect();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().unwrap()).collect())
        .collect();
    let column = |i: usize| rows.iter().map(|row| row[i]).collect::<Vec<f64>>();
    let channels = (1..names.len()).map(|i| Channel::new(names[i], None, column(i))).collect();
    let logs = [Log::new("flight", column(0), channels).unwrap()];
    let document = ModelDocument::read(&root.join("uav_lateral_stabilised.toml")).unwrap();
    let options = Structured { horizon: 50, ..free(&["all"]) };
    let fit = options.fit(&document.structure().unwrap(), &logs, &[]).unwrap();
    let p = found(&fit, "delay:r");
    assert!(p.interval[0] <= 0.13 && 0.13 <= p.interval[1] && p.std < 2e-3, "{p:?}");
    assert!(p.standing == Standing::Physical && fit.converged, "{p:?}");
}

//! Many parameters of an equations model at once: on systems whose parameters are known.

use std::path::Path;

use crate::support::compare::{Comparison, golden, list};
use deadtime::identify::structured::{Standing, Structured, StructuredFit, score};
use deadtime::log::{Channel, Log};
use deadtime::model::{EquationsFile, ModelDocument};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(crate) const PENDULUM: &str = r#"
format = "deadtime/model@1"
name = "pendulum"
kind = "equations"
inputs = [{ name = "torque", unit = "N m" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
[states]
angle = { unit = "rad" }
rate = { unit = "rad/s" }
[parameters]
inertia = { unit = "kg m^2", value = 0.02 }
gain = { unit = "1", value = 1.0 }
stiffness = { unit = "N m", value = 0.3 }
friction = { unit = "N m s", value = 0.0 }
[definitions]
drive = "gain*torque"
moment = "drive - stiffness*sin(angle) - friction*rate"
[derivatives]
angle = "rate"
rate = "moment/inertia"
[output_equations]
angle = "angle"
rate = "rate"
"#;

fn model(text: &str) -> EquationsFile {
    match ModelDocument::from_toml(text, Path::new("test.toml")).unwrap() {
        ModelDocument::Equations(file) => file,
        ModelDocument::Lti(_) => panic!("equations"),
    }
}

fn with(file: &EquationsFile, values: &[(&str, f64)]) -> EquationsFile {
    let mut file = file.clone();
    for (name, value) in values {
        file.parameters.iter_mut().find(|(n, _)| n == name).unwrap().1.value = *value;
    }
    file
}

/// The pendulum itself, by steps so short that their error is far below every tolerance here; independent of the crate's integrators.
pub(crate) fn swing(
    inertia: f64,
    gain: f64,
    stiffness: f64,
    friction: f64,
    noise: f64,
    seed: u64,
) -> Log {
    let (samples, step, fine) = (601, 0.02, 200);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut angle, mut rate, mut torque) = (0.4_f64, 0.0_f64, 0.0);
    let (mut u, mut a, mut w) = (vec![], vec![], vec![]);
    for k in 0..samples {
        if k % 15 == 0 {
            torque = random.random_range(-0.2..0.2);
        }
        u.push(torque);
        a.push(angle + noise * random.random_range(-1.0..1.0));
        w.push(rate + noise * random.random_range(-1.0..1.0));
        let h = step / f64::from(fine);
        for _ in 0..fine {
            // Velocity Verlet with the friction at the middle of the step.
            let slope = |angle: f64, rate: f64| {
                (gain * torque - stiffness * angle.sin() - friction * rate) / inertia
            };
            let half = rate + h / 2.0 * slope(angle, rate);
            let middle = angle + h / 2.0 * rate;
            angle += h * half;
            rate += h * slope(middle, half);
        }
    }
    let time = (0..samples).map(|k| f64::from(k) * step).collect();
    let channels = vec![
        Channel::new("torque", None, u),
        Channel::new("angle", None, a),
        Channel::new("rate", None, w),
    ];
    Log::new(format!("swing {seed}"), time, channels).unwrap()
}

fn value(found: &StructuredFit, name: &str) -> f64 {
    found.parameters.iter().find(|p| p.name == name).unwrap().value
}

fn free(names: &[&str]) -> Structured {
    Structured {
        free: names.iter().map(|n| (*n).to_owned()).collect(),
        horizon: 25,
        ..Structured::default()
    }
}

#[test]
fn parameters_are_recovered_from_clean_logs_and_a_held_out_log_is_predicted() {
    let logs: Vec<Log> = (1..=3).map(|seed| swing(0.025, 0.9, 0.24, 0.01, 0.0, seed)).collect();
    let found = free(&["gain", "stiffness", "friction"])
        .fit(
            &with(&model(PENDULUM), &[("inertia", 0.025)]),
            &logs,
            &[swing(0.025, 0.9, 0.24, 0.01, 0.0, 9)],
        )
        .unwrap();
    assert!(found.converged);
    for (name, truth) in [("gain", 0.9), ("stiffness", 0.24), ("friction", 0.01)] {
        assert!(
            (value(&found, name) / truth - 1.0).abs() < 1e-4,
            "{name}: {}",
            value(&found, name)
        );
    }
    assert!(
        found.parameters.iter().all(|p| p.standing == Standing::Physical),
        "{:?}",
        found.parameters
    );
    assert!(
        found.unseen.is_empty() && found.trades.is_empty(),
        "{:?} {:?}",
        found.unseen,
        found.trades
    );
    let [before, after] = found.held_out.unwrap();
    assert!(after.iter().zip(&before).all(|(a, b)| a.sum < 1e-3 * b.sum), "{after:?}");
}

#[test]
fn intervals_hold_the_truth_with_noise_in_the_outputs() {
    let truth = [("gain", 0.9), ("stiffness", 0.24), ("friction", 0.01)];
    let (mut held, mut all) = (0, 0);
    for trial in 0..8 {
        let logs: Vec<Log> =
            (1..=3).map(|k| swing(0.02, 0.9, 0.24, 0.01, 0.002, 10 * trial + k)).collect();
        let options = Structured { one_step: false, ..free(&["gain", "stiffness", "friction"]) };
        let found = options.fit(&model(PENDULUM), &logs, &[]).unwrap();
        for (name, truth) in truth {
            let p = found.parameters.iter().find(|p| p.name == name).unwrap();
            all += 1;
            held += usize::from(p.interval[0] <= truth && truth <= p.interval[1]);
            assert!(p.std < 0.2 * truth, "{name}: {p:?}");
        }
    }
    // 24 intervals of 95 %: fewer than 19 happens once in two thousand times.
    assert!(held >= 19, "{held} of {all}");
}

#[test]
fn what_acts_only_as_a_ratio_is_said_in_words_and_gets_no_tight_interval() {
    let logs: Vec<Log> = (1..=3).map(|seed| swing(0.025, 0.9, 0.24, 0.01, 0.001, seed)).collect();
    let found = Structured { one_step: false, ..free(&["inertia", "gain"]) };
    // The pendulum hangs in no field here, so that only gain/inertia is seen.
    let file = with(&model(PENDULUM), &[("stiffness", 0.0)]);
    let free_swing: Vec<Log> =
        (1..=3).map(|seed| swing(0.025, 0.9, 0.0, 0.0, 0.001, seed)).collect();
    let found = found.fit(&file, &free_swing, &[]).unwrap();
    assert!(
        found.unseen.iter().any(|u| u.words == "inertia and gain one by one, only their ratio"),
        "{:?}",
        found.unseen
    );
    assert!(
        found.parameters.iter().all(|p| p.standing == Standing::Open),
        "{:?}",
        found.parameters
    );
    let ratio = value(&found, "gain") / value(&found, "inertia");
    assert!((ratio / 36.0 - 1.0).abs() < 0.01, "{ratio}");
    // All four at once: every one but for a common factor, which is the one direction that is missing.
    let found =
        Structured { one_step: false, ..free(&["all"]) }.fit(&model(PENDULUM), &logs, &[]).unwrap();
    assert_eq!(found.unseen.len(), 1, "{:?}", found.unseen);
}

#[test]
fn without_noise_a_common_factor_is_still_not_had() {
    let logs: Vec<Log> = (1..=2).map(|seed| swing(0.025, 0.9, 0.24, 0.01, 0.0, seed)).collect();
    for one_step in [false, true] {
        let found =
            Structured { one_step, ..free(&["all"]) }.fit(&model(PENDULUM), &logs, &[]).unwrap();
        assert_eq!(found.unseen.len(), 1, "{:?}", found.unseen);
        assert!(
            found
                .parameters
                .iter()
                .all(|p| (p.standing == Standing::Open) != (p.name == "delay:torque")),
            "{:?}",
            found.parameters
        );
        let ratio = value(&found, "gain") / value(&found, "inertia");
        assert!((ratio / 36.0 - 1.0).abs() < 0.01, "{ratio}");
    }
}

#[test]
fn a_nominal_value_that_moves_tenfold_is_called_a_surrogate() {
    let logs: Vec<Log> = (1..=3).map(|seed| swing(0.02, 1.0, 0.3, 0.01, 0.0, seed)).collect();
    let found = free(&["friction"])
        .fit(&with(&model(PENDULUM), &[("friction", 0.0005)]), &logs, &[])
        .unwrap();
    assert_eq!(found.parameters[0].standing, Standing::Surrogate, "{:?}", found.parameters);
}

#[test]
fn the_answer_is_the_same_to_the_bit_on_one_thread_and_on_four() {
    let logs: Vec<Log> = (1..=2).map(|seed| swing(0.025, 0.9, 0.24, 0.01, 0.01, seed)).collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = Structured {
            per_record: vec!["friction".into()],
            ..free(&["gain", "stiffness", "friction"])
        };
        pool.install(|| {
            serde_json::to_string(&options.fit(&model(PENDULUM), &logs, &[]).unwrap()).unwrap()
        })
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn a_start_that_is_not_logged_is_estimated_with_the_parameters() {
    // Without the rate's channel the windows' starting rates are unknown.
    let text = PENDULUM
        .replace(r#", { name = "rate", unit = "rad/s" }]"#, "]")
        .replace("\nangle = \"angle\"\nrate = \"rate\"\n", "\nangle = \"angle\"\n");
    let logs: Vec<Log> = (1..=2)
        .map(|seed| {
            let log = swing(0.02, 0.9, 0.24, 0.01, 0.0, seed);
            let channels =
                ["torque", "angle"].map(|n| Channel::new(n, None, log.input(n).unwrap().to_vec()));
            Log::new("angle only", log.time_s().to_vec(), channels.to_vec()).unwrap()
        })
        .collect();
    let options =
        Structured { one_step: false, horizon: 40, ..free(&["gain", "stiffness", "friction"]) };
    let found = options.fit(&model(&text), &logs, &[]).unwrap();
    for (name, truth) in [("gain", 0.9), ("stiffness", 0.24), ("friction", 0.01)] {
        assert!(
            (value(&found, name) / truth - 1.0).abs() < 1e-3,
            "{name}: {}",
            value(&found, name)
        );
    }
}

#[test]
fn bad_options_and_logs_are_refused_with_the_remedy() {
    let (file, log) = (model(PENDULUM), [swing(0.02, 1.0, 0.3, 0.0, 0.0, 1)]);
    let says = |options: &Structured, words: &str| {
        let told = options.fit(&file, &log, &[]).unwrap_err().to_string();
        assert!(told.contains(words), "{told}");
    };
    says(&free(&["gian"]), "no parameter `gian`; it has inertia, gain");
    says(&free(&[]), "no parameter is free");
    says(&Structured { horizon: 0, ..free(&["gain"]) }, "at least 1");
    says(&Structured { horizon: 5000, ..free(&["gain"]) }, "shorter horizon");
    let wrong = PENDULUM.replace("drive = \"gain*torque\"", "drive = \"gain*moment\"");
    let told = ModelDocument::from_toml(&wrong, Path::new("test.toml")).unwrap_err().to_string();
    assert!(told.contains("definitions.drive"), "{told}");
    let attitude = PENDULUM.to_owned()
        + "[groups]\nheading = { outputs = [\"angle\"], kind = \"attitude\" }\n";
    assert!(
        ModelDocument::from_toml(&attitude, Path::new("test.toml"))
            .unwrap_err()
            .to_string()
            .contains("four outputs")
    );
}

/// The shipped quadrotor against SciPy, which keeps the rotation as a matrix.
#[test]
fn the_shipped_quadrotor_agrees_with_scipy_over_ten_seconds() {
    use deadtime::effect::OnLog;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let golden = golden("quadrotor", "reference.json");
    let mut c = Comparison::new("quadrotor/reference.json");
    let rows = |v: &serde_json::Value| -> Vec<Vec<f64>> {
        v.as_array().unwrap().iter().map(list).collect()
    };
    let (u, step, every) = (
        rows(&golden["u"]),
        golden["step_s"].as_f64().unwrap(),
        golden["every"].as_u64().unwrap() as usize,
    );
    for case in golden["cases"].as_array().unwrap() {
        let mut file = EquationsFile::read(&root.join("examples/quadrotor.toml")).unwrap();
        for (name, value) in case["parameters"].as_object().unwrap() {
            file = with(&file, &[(name, value.as_f64().unwrap())]);
        }
        for ((_, state), start) in file.states.iter_mut().zip(list(&golden["start"])) {
            state.initial = start;
        }
        let time: Vec<f64> = (0..u.len()).map(|k| k as f64 * step).collect();
        let motors = (0..4)
            .map(|i| {
                Channel::new(format!("m{}_rads", i + 1), None, u.iter().map(|r| r[i]).collect())
            })
            .collect();
        let document = ModelDocument::Equations(file);
        let log = document.complete(Log::new("motors", time, motors).unwrap()).unwrap();
        let y = OnLog::new(&document, &log).unwrap().response().unwrap().y;
        let (p, v, q, w) = (
            rows(&case["position"]),
            rows(&case["velocity"]),
            rows(&case["quaternion"]),
            rows(&case["rates"]),
        );
        for k in 0..p.len() {
            let got = |i: usize| y[(k * every, i)];
            let size = p[k].iter().chain(&v[k]).fold(1.0, |m: f64, v| m.max(v.abs()));
            let apart = (0..3)
                .map(|i| (got(i) - p[k][i]).abs().max((got(3 + i) - v[k][i]).abs()) / size)
                .fold(0.0, f64::max);
            let turned = (0..4).map(|i| got(6 + i) * q[k][i]).sum::<f64>().abs();
            let rates = (0..3).map(|i| (got(10 + i) - w[k][i]).abs()).fold(0.0, f64::max);
            let id = format!("{} at {k}", case["id"]);
            for (what, apart) in [
                ("position and velocity", apart),
                ("rates (rad/s)", rates),
                ("cosine of half the turn between", 1.0 - turned),
            ] {
                c.check(what, &id, apart.abs(), 1e-6);
            }
        }
    }
    c.finish();
}

/// A model's errors on logs it made itself are nothing, and those of still states are the states' own moves.
#[test]
fn the_score_of_the_truth_is_nothing() {
    let log = swing(0.02, 1.0, 0.3, 0.0, 0.0, 5);
    let found = score(&model(PENDULUM), &[log], 25, 25).unwrap();
    assert_eq!(found.iter().map(|g| g.mean_absolute.len()).collect::<Vec<_>>(), [25, 25]);
    assert!(found.iter().all(|g| g.sum < 1e-4), "{found:?}");
}

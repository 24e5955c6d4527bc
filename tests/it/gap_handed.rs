//! The shrink that is printed is the shrink that a user gets: `model_with_effects.toml` is read from its file, run on the held-out commands, and compared with
//! `diagnosis.json`, for every effect of the catalogue and for every kind of verdict. Nothing of the diagnosis is used but what is in the folder.

use std::path::Path;

use deadtime::diagnose::{Diagnosed, Diagnosis, GapOptions, Mode, diagnose_files};
use deadtime::effect::{Applied, EFFECTS, OnLog};
use deadtime::log::Log;
use deadtime::model::{ModelDocument, Operating};
use deadtime::report::save;
use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::gap_hard::commands;
use crate::support::program::Folder;

const TS: f64 = 0.04;
/// Noise as a part of each output's spread.
const NOISE: f64 = 0.02;

const SERVO: &str = r#"format = "deadtime/model@1"
name = "servo"
kind = "lti"
inputs = [{ name = "u", unit = "V" }]
states = [{ name = "x", unit = "rad" }, { name = "v", unit = "rad/s" }]
outputs = [{ name = "angle", unit = "rad" }]
initial = [0.0, 0.0]
A = [[0.0, 1.0], [-9.0, -2.4]]
B = [[0.0], [9.0]]
C = [[1.0, 0.0]]
D = [[0.0]]
"#;
const SUSPECTED: &str = "[[candidates]]\nstate = \"v\"\nadds = \"k*x*abs(x)\"\n";
const TANKS: &str = r#"format = "deadtime/model@1"
name = "tanks"
kind = "lti"
inputs = [{ name = "u", unit = "V" }]
states = [{ name = "a", unit = "m" }, { name = "b", unit = "m" }]
outputs = [{ name = "a", unit = "m" }, { name = "b", unit = "m" }]
initial = [0.0, 0.0]
A = [[-1.5, 0.0], [0.0, -0.8]]
B = [[1.5], [0.4]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

const LOOP: &str = r#"format = "deadtime/model@1"
name = "loop"
kind = "equations"
inputs = [{ name = "u", unit = "rad" }]
outputs = [{ name = "angle", unit = "rad" }]
[states]
x = { unit = "rad", initial = 0.0 }
v = { unit = "rad/s", initial = 0.0 }
[derivatives]
x = "v"
v = "20*(u - x) - 5*v"
[output_equations]
angle = "x"
"#;
const TRAIN: &str = r#"format = "deadtime/model@1"
name = "train"
kind = "equations"
inputs = [{ name = "u", unit = "N*m" }]
outputs = [{ name = "motor", unit = "rad" }, { name = "load", unit = "rad" }]
[states]
motor = { unit = "rad", initial = 0.0, initial_std = 0.0 }
load = { unit = "rad", initial = 0.0, initial_std = 0.0 }
wm = { initial = 0.0, initial_std = 0.0 }
wl = { initial = 0.0, initial_std = 0.0 }
[derivatives]
motor = "wm"
load = "wl"
wm = "4*u - 40*(motor - load) - wm"
wl = "40*(motor - load) - 4*load - wl"
[output_equations]
motor = "motor"
load = "load"
"#;
const PAIR: &str = r#"format = "deadtime/model@1"
name = "pair"
kind = "lti"
inputs = [{ name = "u", unit = "V" }, { name = "w", unit = "V" }]
states = [{ name = "a", unit = "m" }, { name = "b", unit = "m" }]
outputs = [{ name = "a", unit = "m" }, { name = "b", unit = "m" }]
initial = [0.0, 0.0]
A = [[-1.5, 0.0], [0.0, -0.8]]
B = [[1.5, 0.3], [0.4, -1.2]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0, 0.0], [0.0, 0.0]]
"#;

/// An effect on a model: where, and its parameters as they stand in a file.
struct Case {
    effect: &'static str,
    model: &'static str,
    more: &'static str,
    channel: &'static str,
    parameters: &'static str,
}

const fn on_servo(effect: &'static str, channel: &'static str, parameters: &'static str) -> Case {
    Case { effect, model: SERVO, more: "", channel, parameters }
}

const fn on(
    model: &'static str,
    effect: &'static str,
    channel: &'static str,
    parameters: &'static str,
) -> Case {
    Case { effect, model, more: "", channel, parameters }
}

const CASES: &[Case] = &[
    on_servo("input_delay", "u", "delay = 0.15"),
    on_servo("delay_jump", "u", "delay = 0.04, time = 7.0, later = 0.28"),
    on_servo("delay_drift", "u", "delay = 0.04, rate = 0.015"),
    on_servo("multi_rate", "u", "period = 0.36, phase = 0.12"),
    on_servo("input_gain", "u", "gain = 1.4"),
    on_servo("input_curve", "u", "quadratic = 0.4"),
    on_servo("gain_fade", "u", "rate = 0.03"),
    on_servo("gain_jump", "u", "gain = 1.0, time = 7.0, later = 0.5"),
    on_servo("input_offset", "u", "offset = 0.3"),
    on_servo("deadband", "u", "width = 0.3"),
    on_servo("backlash", "u", "width = 0.4"),
    on_servo("saturation", "u", "lower = -0.4, upper = 0.5"),
    on_servo("rate_limit", "u", "rate = 1.2"),
    on_servo("actuator_lag", "u", "time_constant = 0.3"),
    on_servo("dropped_commands", "u", "probability = 0.9"),
    on_servo("delay_jitter", "u", "delay = 0.3, spread = 0.1, ordered = 1.0"),
    Case {
        effect: "candidate",
        model: SERVO,
        more: SUSPECTED,
        channel: "v += k*x*abs(x)",
        parameters: "k = -6.0",
    },
    on_servo("parameter_error", "A[v,x]", "value = -16.0"),
    on_servo("parameter_jump", "A[v,x]", "value = -9.0, time = 7.0, later = -16.0"),
    Case {
        effect: "cross_coupling",
        model: TANKS,
        more: "",
        channel: "a->b",
        parameters: "gain = 0.5",
    },
    Case { effect: "exchange", model: TANKS, more: "", channel: "a<->b", parameters: "gain = 0.6" },
    on_servo("coulomb_friction", "v", "level = 1.5"),
    on_servo("stribeck_friction", "v", "level = 0.8, extra = 1.5, velocity = 0.2"),
    on_servo("hysteresis", "v", "level = 3.0, displacement = 0.15, sharpness = 1.5"),
    on_servo("quadratic_drag", "v", "coefficient = 1.5"),
    on_servo("cubic_stiffness", "x->v", "coefficient = 12.0"),
    on_servo("unmodelled_mode", "u->output:angle", "frequency = 1.5, damping = 0.05, gain = 0.3"),
    on_servo("constant_disturbance", "v", "level = 2.0"),
    on_servo("periodic_disturbance", "v", "frequency = 1.0, amplitude = 8.0, phase = 0.5"),
    Case {
        effect: "output_delay",
        model: TANKS,
        more: "",
        channel: "b",
        parameters: "delay = 0.3",
    },
    Case {
        effect: "sensor_lag",
        model: TANKS,
        more: "",
        channel: "b",
        parameters: "time_constant = 0.5",
    },
    on_servo("static_nonlinearity", "angle", "quadratic = 0.3, cubic = -0.3"),
    on_servo("sensor_gain", "angle", "gain = -1.3"),
    on_servo("sensor_bias", "angle", "offset = 0.3"),
    on_servo("sensor_drift", "angle", "rate = 0.05"),
    on_servo("sensor_saturation", "angle", "lower = -0.3, upper = 0.4"),
    on_servo("sensor_quantisation", "angle", "step = 0.4"),
    Case {
        effect: "misalignment",
        model: TANKS,
        more: "",
        channel: "a->b",
        parameters: "gain = 0.3",
    },
    on(PAIR, "swapped_inputs", "u<->w", "share = 1.0"),
    on(LOOP, "internal_saturation", "20*(u - x)", "lower = -8.0, upper = 9.0"),
    on(LOOP, "internal_deadband", "20*(u - x)", "width = 4.0"),
    on(LOOP, "internal_delay", "20*(u - x)", "delay = 0.1"),
    on(LOOP, "internal_lag", "20*(u - x)", "time_constant = 0.12"),
    on(TRAIN, "driveline_backlash", "motor - load", "width = 0.1"),
    on(TRAIN, "driveline_friction", "motor - load", "level = 0.05, speed = 0.1"),
    on_servo("output_backlash", "angle", "width = 0.15"),
    on(PAIR, "swapped_outputs", "a<->b", "share = 1.0"),
    on_servo("clock_skew", "*", "ratio = 1.03"),
    on_servo("clock_offset", "*", "offset = 0.2"),
];

/// Writes a log of a machine, a model file with effects of its own, from a start that nobody told.
fn write_log(machine: &ModelDocument, path: &Path, samples: usize, seed: u64, start: f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..samples).map(|k| TS * k as f64).collect();
    let commanded: Vec<deadtime::log::Channel> = (machine.inputs().iter())
        .map(|c| {
            let unit = c.unit.as_deref();
            deadtime::log::Channel::new(&c.name, unit, commands(samples, &mut rng))
        })
        .collect();
    let sent = Log::new("sent", time_s.clone(), commanded).unwrap();
    let moved =
        from(machine, &start_of(machine).map(|x| x + start * rng.sample::<f64, _>(StandardNormal)));
    let mut run = OnLog::new(&moved, &sent).unwrap();
    run.seed = seed;
    let y = run.response().unwrap().y;
    let header: Vec<String> = (moved.inputs().iter().chain(moved.outputs()))
        .map(|c| format!("{} [{}]", c.name, c.unit.as_deref().unwrap_or("1")))
        .collect();
    let spread: Vec<f64> = y.column_iter().map(|y| y.variance().sqrt()).collect();
    let mut csv = format!("time,{}\n", header.join(","));
    for k in 0..samples {
        csv.push_str(&time_s[k].to_string());
        for input in moved.inputs() {
            csv.push_str(&format!(",{}", sent.input(&input.name).unwrap()[k]));
        }
        for (i, s) in spread.iter().enumerate() {
            csv.push_str(&format!(
                ",{}",
                y[(k, i)] + NOISE * s * rng.sample::<f64, _>(StandardNormal)
            ));
        }
        csv.push('\n');
    }
    std::fs::write(path, csv).unwrap();
}

fn start_of(model: &ModelDocument) -> DVector<f64> {
    DVector::from_vec(match model {
        ModelDocument::Lti(file) if file.initial.is_empty() => vec![0.0; model.states().count()],
        ModelDocument::Lti(file) => file.initial.clone(),
        ModelDocument::Equations(file) => file.states.iter().map(|(_, s)| s.initial).collect(),
    })
}

/// The model from another start.
fn from(model: &ModelDocument, start: &DVector<f64>) -> ModelDocument {
    let mut model = model.clone();
    match &mut model {
        ModelDocument::Lti(file) => file.initial = start.as_slice().to_vec(),
        ModelDocument::Equations(file) => {
            file.states.iter_mut().zip(start.iter()).for_each(|((_, s), x)| s.initial = *x)
        }
    }
    model
}

/// What is left of a log by a model file that is run on it, one column of all outputs: each in units of its deviation within the span, the squares adding up to the
/// squared nrmse.
fn left(model: &ModelDocument, log: &Log, [from_s, to_s]: [f64; 2]) -> DVector<f64> {
    let y = OnLog::new(model, log).unwrap().response().unwrap().y;
    let inside: Vec<usize> =
        (0..log.len()).filter(|k| (from_s..=to_s).contains(&log.time_s()[*k])).collect();
    let outputs = model.outputs().len() as f64;
    let each = model.outputs().iter().enumerate().flat_map(|(i, channel)| {
        let measured = log.output(&channel.name).unwrap();
        let there: Vec<(f64, f64)> =
            inside.iter().filter_map(|&k| Some((measured.get(k)?, y[(k, i)]))).collect();
        let mean = there.iter().map(|v| v.0).sum::<f64>() / there.len() as f64;
        let all = there.iter().map(|v| (v.0 - mean).powi(2)).sum::<f64>();
        there.into_iter().map(move |(measured, said)| (measured - said) / (all * outputs).sqrt())
    });
    DVector::from_vec(each.collect())
}

/// What is known of the start: `initial_std` of the file, else how far the model moves each state over the training log.
fn priors(folder: &Folder) -> Vec<f64> {
    let model = ModelDocument::read(&folder.path("model.toml")).unwrap();
    let given: Option<Vec<f64>> = match &model {
        ModelDocument::Lti(file) => {
            (!file.initial_std.is_empty()).then(|| file.initial_std.clone())
        }
        ModelDocument::Equations(file) => file.states.iter().map(|(_, s)| s.initial_std).collect(),
    };
    if let Some(given) = given {
        return given;
    }
    let training = deadtime::log::read(&folder.path("a.csv")).unwrap();
    let moved = [OnLog::new(&model, &training).unwrap().response().unwrap().x];
    let start = start_of(&model);
    let rms = |j: usize| {
        let all: Vec<f64> = moved
            .iter()
            .flat_map(|x| x.column(j).iter().map(|v| (v - start[j]).powi(2)).collect::<Vec<_>>())
            .collect();
        (all.iter().sum::<f64>() / all.len() as f64).sqrt()
    };
    (0..start.len()).map(rms).collect()
}

/// The nrmse of a model file on a log from the start that does best beside its prior: Gauss-Newton steps with differences for slopes, as anybody may do it.
fn from_the_best_start(model: &ModelDocument, log: &Log, span: [f64; 2], prior: &[f64]) -> f64 {
    let mut best = left(model, log, span);
    if prior.iter().all(|s| *s == 0.0) {
        return best.norm();
    }
    let count = best.len() as f64;
    let precision = DVector::from_iterator(prior.len(), prior.iter().map(|s| s.powi(-2)));
    let (came, mut start) = (start_of(model), start_of(model));
    for _ in 0..10 {
        let slopes: Vec<DVector<f64>> = (0..start.len())
            .map(|j| {
                let mut pushed = start.clone();
                pushed[j] += 1e-4;
                (left(&from(model, &pushed), log, span) - &best) / 1e-4
            })
            .collect();
        let slopes = DMatrix::from_columns(&slopes);
        // Squares over the variance of one sample, which is what they are on average.
        let weight = count / best.norm_squared();
        let cost = |left: &DVector<f64>, start: &DVector<f64>| {
            let off = start - &came;
            weight * left.norm_squared() + off.component_mul(&off).dot(&precision)
        };
        let towards = -weight * slopes.tr_mul(&best) - (&start - &came).component_mul(&precision);
        let step = (weight * slopes.tr_mul(&slopes) + DMatrix::from_diagonal(&precision))
            .cholesky()
            .unwrap()
            .solve(&towards);
        let now = cost(&best, &start);
        let better = [1.0, 0.3, 0.1].into_iter().find_map(|part| {
            let there = &start + part * &step;
            let left = left(&from(model, &there), log, span);
            (cost(&left, &there) < now).then_some((there, left))
        });
        let Some((there, left)) = better else { break };
        let done = cost(&left, &there) > (1.0 - 1e-7) * now;
        (start, best) = (there, left);
        if done {
            break;
        }
    }
    best.norm()
}

/// The files of a diagnosis, and what it was made of.
struct Made {
    folder: Folder,
    found: Diagnosed,
}

/// Diagnoses logs of a machine by a model, from files, and writes the folder; the last part of the log is held back where there is no other.
fn made(model: &str, machine: &str, seed: u64, start: f64, [train, held]: [usize; 2]) -> Made {
    let folder = Folder::new();
    let nominal = folder.write("model.toml", model);
    let machine = ModelDocument::read(&folder.write("machine.toml", machine)).unwrap();
    let logs = [folder.path("a.csv")];
    write_log(&machine, &logs[0], train, seed, start);
    let mut holdout = Vec::new();
    if held > 0 {
        holdout.push(folder.path("held.csv"));
        write_log(&machine, &holdout[0], held, seed + 1, start);
    }
    let found = diagnose_files(&nominal, &logs, &holdout, &GapOptions::default()).unwrap();
    save(&found, &folder.path("out")).unwrap();
    Made { folder, found }
}

/// What is wrong with a pair of numbers that should be one, of the model before and after.
fn apart(name: &str, printed: Option<f64>, got: f64, allowed: f64) -> Option<String> {
    let printed = printed.unwrap();
    ((printed / got - 1.0).abs() > allowed)
        .then(|| format!("{name}: {printed} is printed, {got} is got"))
}

/// Relative: both minima are flat, and found by different steps and integrations.
const SAME: f64 = 1e-3;

impl Made {
    fn diagnosis(&self) -> Diagnosis {
        Diagnosis::read(&self.folder.path("out").join("diagnosis.json")).unwrap()
    }

    fn written(&self) -> ModelDocument {
        ModelDocument::read(&self.folder.path("out").join("model_with_effects.toml")).unwrap()
    }

    /// What is printed beside what the files give, where they differ.
    fn wrong(&self) -> Vec<String> {
        let diagnosis = self.diagnosis();
        let (shrink, held) = (&diagnosis.shrink, &diagnosis.holdout[0]);
        let path = ["held.csv", "a.csv"]
            .map(|name| self.folder.path(name))
            .into_iter()
            .find(|path| path.exists())
            .unwrap();
        let log = deadtime::log::read(&path).unwrap();
        let prior = priors(&self.folder);
        let got = |model: &ModelDocument| {
            from_the_best_start(model, &log, [held.from_s, held.to_s], &prior)
        };
        let came = ModelDocument::read(&self.folder.path("model.toml")).unwrap();
        let both =
            [("before", shrink.before, got(&came)), ("after", shrink.after, got(&self.written()))];
        println!("{} {:?} {:?}", diagnosis.cause.verdict, both, self.handed());
        both.into_iter()
            .filter_map(|(name, printed, got)| apart(name, printed, got, SAME))
            .collect()
    }

    fn handed(&self) -> Vec<String> {
        self.found.handed_over.iter().map(Applied::key).collect()
    }
}

fn entry(effect: &str, channel: &str, parameters: &str) -> String {
    format!(
        "[[effects]]\neffect = \"{effect}\"\nchannel = \"{channel}\"\nparameters = {{ {parameters} }}\n"
    )
}

/// A model whose start is known to the last digit.
fn started(model: &str) -> String {
    model.replace("initial = [0.0, 0.0]", "initial = [0.0, 0.0]\ninitial_std = [0.0, 0.0]")
}

/// One of each kind: a delay, a parameter, a friction, a sensor, a clock.
const FEW: [&str; 5] =
    ["input_delay", "parameter_error", "coulomb_friction", "sensor_saturation", "clock_offset"];

#[test]
fn every_effect_has_a_case() {
    let missing: Vec<&str> = EFFECTS
        .iter()
        .map(|e| e.name())
        .filter(|name| CASES.iter().all(|c| c.effect != *name))
        .collect();
    assert!(missing.is_empty(), "no case for {missing:?}");
}

fn printed_of(tried: fn(&Case) -> bool) {
    let one = |(at, case): (usize, &Case)| {
        let model = format!("{}{}", case.model, case.more);
        // From within a play no gradient leads to the best start: it is known.
        let start = if case.model == TRAIN { 0.0 } else { 0.1 };
        let made = made(
            &model,
            &format!("{model}{}", entry(case.effect, case.channel, case.parameters)),
            100 + 10 * at as u64,
            start,
            [500, 300],
        );
        (
            made.wrong()
                .into_iter()
                .map(|wrong| format!("{}: {wrong}", case.effect))
                .collect::<Vec<_>>(),
            !made.handed().is_empty(),
        )
    };
    let (wrong, carried): (Vec<Vec<String>>, Vec<bool>) =
        CASES.par_iter().enumerate().filter(|(_, c)| tried(c)).map(one).unzip();
    let wrong: Vec<String> = wrong.into_iter().flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // Where nothing is handed over nothing is tested.
    let (count, carried) = (carried.len(), carried.into_iter().filter(|c| *c).count());
    assert!(count > 0 && carried + 2 >= count.max(3), "{carried} of {count} files carry an effect");
}

#[test]
fn what_is_printed_of_every_effect_is_what_its_file_gives() {
    printed_of(|case| FEW.contains(&case.effect));
}

#[test]
#[ignore = "nightly: every effect of the catalogue"]
fn what_is_printed_of_every_effect_is_what_its_file_gives_in_the_catalogue() {
    printed_of(|_| true);
}

#[test]
fn what_is_printed_of_every_kind_of_verdict_is_what_its_file_gives() {
    let servo = started(SERVO);
    let with = |effects: &[(&str, &str, &str)]| {
        effects.iter().map(|(e, c, p)| entry(e, c, p)).fold(servo.clone(), |all, e| all + &e)
    };
    let none = made(&servo, &servo, 1, 0.0, [500, 300]);
    assert_eq!(
        (none.diagnosis().cause.verdict.as_str(), none.handed().len(), none.wrong()),
        ("none", 0, Vec::new())
    );
    // The last part of the only log is held back.
    let back = made(&servo, &with(&[("deadband", "u", "width = 0.3")]), 11, 0.0, [800, 0]);
    assert_eq!((back.diagnosis().cause.verdict.as_str(), back.wrong()), ("deadband", Vec::new()));
    let pair = made(
        &servo,
        &with(&[("deadband", "u", "width = 0.3"), ("output_delay", "angle", "delay = 0.2")]),
        21,
        0.0,
        [500, 300],
    );
    assert_eq!((pair.handed().len(), pair.wrong()), (2, Vec::new()));
    // A spring that is in no catalogue, beside a gain.
    let spring = "[[candidates]]\nstate = \"v\"\nadds = \"k*sin(9*x)\"\n[[effects]]\neffect = \"candidate\"\nchannel = \"v += k*sin(9*x)\"\nparameters = { k = 4.0 }\n";
    let unknown = made(
        &servo,
        &format!("{}{spring}", with(&[("input_gain", "u", "gain = 1.5")])),
        31,
        0.0,
        [500, 300],
    );
    let cause = unknown.diagnosis().cause;
    assert!(
        cause.verdict == "unknown"
            && !cause.contributions.is_empty()
            && !unknown.handed().is_empty(),
        "{cause:?}"
    );
    assert_eq!(unknown.wrong(), Vec::<String>::new());
}

#[test]
#[ignore = "nightly: two diagnoses"]
fn commands_that_are_lost_or_late_by_chance_are_handed_over_as_what_is_printed() {
    let servo = started(SERVO);
    for (seed, effect, parameters) in [
        (41, "dropped_commands", "probability = 0.6"),
        (51, "delay_jitter", "delay = 0.28, spread = 0.08, ordered = 1.0"),
    ] {
        let made = made(
            &servo,
            &format!("{servo}{}", entry(effect, "u", parameters)),
            seed,
            0.0,
            [1200, 600],
        );
        let found: Vec<String> = made.found.effects.iter().map(Applied::key).collect();
        assert!(
            made.found.effects.iter().any(|a| a.effect.loses_commands()),
            "{effect}: {found:?}"
        );
        assert!(
            made.found.handed_over.iter().all(|a| !a.effect.loses_commands()),
            "{:?}",
            made.handed()
        );
        assert_eq!(made.wrong(), Vec::<String>::new());
        assert!(made.diagnosis().shrink.decoded.unwrap() < made.diagnosis().shrink.after.unwrap());
    }
}

#[test]
fn the_written_model_stands_at_the_operating_point_at_which_it_was_diagnosed() {
    let servo = started(SERVO).replace("unit = \"V\"", "unit = \"V\", operating = \"mean\"");
    let machine = format!("{}{}", started(SERVO), entry("input_gain", "u", "gain = 1.5"));
    let made = made(&servo, &machine, 61, 0.0, [500, 300]);
    let ModelDocument::Lti(written) = made.written() else { panic!("another kind") };
    let Operating::Value(about) = written.inputs[0].operating else {
        panic!("the mean of whatever log comes")
    };
    let u = deadtime::log::read(&made.folder.path("a.csv")).unwrap();
    let u = u.input("u").unwrap();
    assert!((about - u.iter().sum::<f64>() / u.len() as f64).abs() < 1e-12);
    let wrong = made.wrong();
    assert!(wrong.iter().all(|w| w.starts_with("before")), "{wrong:?}");
}

#[test]
fn a_model_that_needs_a_predictor_is_as_far_off_when_its_file_is_diagnosed_again() {
    let cart = SERVO
        .replace("[-9.0, -2.4]", "[0.0, -0.4]")
        .replace("[9.0]", "[1.0]")
        .replace("initial = [0.0, 0.0]", "initial = [0.0, 0.0]\ninitial_std = [0.0, 0.0]");
    let made = made(
        &cart,
        &format!("{cart}{}", entry("input_gain", "u", "gain = 1.6")),
        71,
        0.0,
        [400, 300],
    );
    assert_eq!((made.diagnosis().prediction.mode, made.handed().len()), (Mode::Predictor, 1));
    let paths = ["a.csv", "held.csv"].map(|name| [made.folder.path(name)]);
    let again = diagnose_files(
        &made.folder.path("out").join("model_with_effects.toml"),
        &paths[0],
        &paths[1],
        &GapOptions::default(),
    )
    .unwrap();
    assert_eq!(
        apart("after", made.diagnosis().shrink.after, again.diagnosis.shrink.before.unwrap(), 1e-9),
        None
    );
}

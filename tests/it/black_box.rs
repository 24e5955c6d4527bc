//! A simulator that can only be called is diagnosed as a model file is, in what can be tried on it; and what cannot be is said.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use deadtime::diagnose::{
    Caveat, Diagnosed, GapError, GapOptions, Mode, diagnose, inspect, isolability,
};
use deadtime::log::{Channel, Log};
use deadtime::progress::HowFar;
use deadtime::simulate::{Face, Port, Simulator, Start, System};
use deadtime::stop::Stop;
use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

type Answer = Result<DMatrix<f64>, String>;

/// A function as a simulator.
struct Function<F>(F);

impl<F> std::fmt::Debug for Function<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Function")
    }
}

impl<F: Fn(&DMatrix<f64>, &[f64], &[f64], &[f64]) -> Answer + Send + Sync> Simulator
    for Function<F>
{
    fn simulate(&self, u: &DMatrix<f64>, time_s: &[f64], x0: &[f64], parameters: &[f64]) -> Answer {
        (self.0)(u, time_s, x0, parameters)
    }
}

const TS: f64 = 0.02;
/// Noise as a part of each output's spread.
const NOISE: f64 = 0.03;

/// A servo with Coulomb friction, angle and rate, by small explicit steps: commands as they hold at any time.
fn servo(
    command: impl Fn(f64) -> f64,
    time_s: &[f64],
    x0: &[f64],
    stiffness: f64,
    gain: f64,
) -> DMatrix<f64> {
    let (mut x, mut v) = (x0[0], x0[1]);
    let mut y = DMatrix::zeros(time_s.len(), 2);
    for k in 0..time_s.len() {
        (y[(k, 0)], y[(k, 1)]) = (x, v);
        let Some(next) = time_s.get(k + 1) else { break };
        let steps = 20;
        let h = (next - time_s[k]) / f64::from(steps);
        for step in 0..steps {
            let u = command(time_s[k] + (f64::from(step) + 0.5) * h);
            v += h * (stiffness * (gain * u - x) - 2.4 * v - 0.3 * (20.0 * v).tanh());
            x += h * v;
        }
    }
    y
}

fn held<'a>(time_s: &'a [f64], u: &'a [f64]) -> impl Fn(f64) -> f64 + 'a {
    |t| u[time_s.partition_point(|s| *s <= t + 1e-9).saturating_sub(1)]
}

fn simulator() -> Arc<dyn Simulator> {
    Arc::new(Function(|u: &DMatrix<f64>, time_s: &[f64], x0: &[f64], p: &[f64]| {
        Ok(servo(held(time_s, u.as_slice()), time_s, x0, p[0], p[1]))
    }))
}

fn port(name: &str, unit: &str) -> Port {
    Port { name: name.to_owned(), unit: Some(unit.to_owned()) }
}

fn face() -> Face {
    let start =
        |name: &str, unit: &str| Start { port: port(name, unit), initial: 0.0, std: Some(0.02) };
    Face {
        name: "servo".to_owned(),
        inputs: vec![port("u", "V")],
        outputs: vec![port("angle", "rad"), port("rate", "rad/s")],
        states: vec![start("x", "rad"), start("v", "rad/s")],
        parameters: vec![(port("stiffness", "1/s^2"), 9.0), (port("gain", "rad/V"), 1.0)],
        restart: None,
    }
}

fn system() -> System {
    System::black_box(simulator(), face()).unwrap()
}

/// Steps of many heights and lengths.
fn commands(samples: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let (mut level, mut left) = (0.0, 0);
    (0..samples)
        .map(|_| {
            if left == 0 {
                (level, left) = (rng.random_range(-1.0..1.0), rng.random_range(5..60));
            }
            left -= 1;
            level
        })
        .collect()
}

/// A log of what `real` makes of commands (signal, stamps, start), with noise.
fn log(
    name: &str,
    samples: usize,
    seed: u64,
    real: impl Fn(&[f64], &[f64], &[f64]) -> DMatrix<f64>,
) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..samples).map(|k| TS * k as f64).collect();
    let u = commands(samples, &mut rng);
    let x0: Vec<f64> = (0..2).map(|_| 0.02 * rng.sample::<f64, _>(StandardNormal)).collect();
    let y = real(&u, &time_s, &x0);
    let mut channels = vec![Channel::new("u", Some("V"), u)];
    for (i, (name, unit)) in [("angle", "rad"), ("rate", "rad/s")].into_iter().enumerate() {
        let clean = y.column(i);
        let spread = clean.variance().sqrt();
        let noisy = clean
            .iter()
            .map(|v| v + NOISE * spread * rng.sample::<f64, _>(StandardNormal))
            .collect();
        channels.push(Channel::new(name, Some(unit), noisy));
    }
    Log::new(name, time_s, channels).unwrap()
}

fn run(seed: u64, real: impl Fn(&[f64], &[f64], &[f64]) -> DMatrix<f64>) -> Diagnosed {
    let logs = [log("a.csv", 900, seed, &real)];
    let held = [log("b.csv", 700, seed + 1, &real)];
    diagnose(&system(), &logs, &held, &GapOptions::default(), &|_| ()).unwrap()
}

fn value(found: &Diagnosed) -> (String, String, f64, [f64; 2]) {
    let e = &found.diagnosis.cause.effects[0];
    (
        e.effect.clone(),
        e.channel.clone(),
        e.parameters[0].value.unwrap(),
        e.parameters[0].ci95.unwrap_or([f64::NAN; 2]),
    )
}

/// What is found is named, or in a class with what is, near the value that went in.
fn is_found(found: &Diagnosed, effect: &str, channel: &str, expected: f64, tolerance: f64) {
    let d = &found.diagnosis;
    println!(
        "{effect}: {:?} calls, {:?} {:?}",
        found.calls, d.cause.verdict, d.cause.indistinguishable
    );
    assert_eq!(
        (d.cause.verdict.as_str(), d.cause.channel.as_deref()),
        (effect, Some(channel)),
        "{:#?}",
        d.cause
    );
    let (_, _, got, ci95) = value(found);
    assert!((got - expected).abs() < tolerance, "{effect}: {got} instead of {expected}, {ci95:?}");
    assert!(d.shrink.of_explainable.unwrap() > 0.9, "{:?}", d.shrink);
}

#[test]
fn an_input_delay_is_found_through_a_black_box() {
    let found = run(10, |u, t, x0| servo(|at| held(t, u)((at - 0.053).max(0.0)), t, x0, 9.0, 1.0));
    is_found(&found, "input_delay", "u", 0.053, 0.004);
}

#[test]
fn a_dead_zone_is_found_through_a_black_box() {
    let zone = |v: f64| if v.abs() < 0.15 { 0.0 } else { v - 0.15 * v.signum() };
    let found = run(20, move |u, t, x0| servo(|at| zone(held(t, u)(at)), t, x0, 9.0, 1.0));
    is_found(&found, "deadband", "u", 0.15, 0.02);
}

#[test]
fn a_biased_sensor_is_found_without_a_further_call() {
    let found = run(30, |u, t, x0| {
        let mut y = servo(held(t, u), t, x0, 9.0, 1.0);
        y.column_mut(0).add_scalar_mut(0.1);
        y
    });
    is_found(&found, "sensor_bias", "angle", 0.1, 0.02);
}

#[test]
fn a_wrong_parameter_is_found_in_its_own_unit() {
    let found = run(40, |u, t, x0| servo(held(t, u), t, x0, 12.0, 1.0));
    is_found(&found, "parameter_error", "stiffness", 12.0, 0.5);
    assert_eq!(found.diagnosis.cause.effects[0].parameters[0].unit, "1/s^2");
}

#[test]
fn a_gain_of_the_input_is_told_from_a_parameter_only_where_it_differs() {
    // gain·u in the simulator is the same as a gain before it: the data cannot tell, and both are named.
    let found = run(50, |u, t, x0| servo(|at| 1.2 * held(t, u)(at), t, x0, 9.0, 1.0));
    let class = &found.diagnosis.cause.indistinguishable;
    let named = ["input_gain:u", "parameter_error:gain"];
    assert!(class.iter().any(|c| named.iter().all(|n| c.iter().any(|m| m == n))), "{class:?}");
}

#[test]
fn a_perfect_black_box_has_no_cause_and_a_disturbance_that_no_effect_makes_is_unknown() {
    let none = run(60, |u, t, x0| servo(held(t, u), t, x0, 9.0, 1.0));
    assert_eq!(none.diagnosis.cause.verdict, "none", "{:?}", none.diagnosis.cause.ranking.first());
    let gust = |t: f64| if (t * 0.7).sin() > 0.6 { 0.5 * (9.0 * t).sin() } else { 0.0 };
    let unknown = run(70, move |u, t, x0| servo(|at| held(t, u)(at) + gust(at), t, x0, 9.0, 1.0));
    assert_eq!(
        unknown.diagnosis.cause.verdict,
        "unknown",
        "{:?}",
        unknown.diagnosis.cause.ranking.first()
    );
    for found in [&none, &unknown] {
        println!("{}: {:?} calls", found.diagnosis.cause.verdict, found.calls);
    }
}

#[test]
fn what_cannot_be_tried_is_said_with_the_reason() {
    let found = run(60, |u, t, x0| servo(held(t, u), t, x0, 9.0, 1.0));
    let left: Vec<(&str, &str)> = found
        .diagnosis
        .cause
        .not_tried
        .iter()
        .map(|n| (n.effect.as_str(), n.why.as_str()))
        .collect();
    for effect in [
        "coulomb_friction",
        "stribeck_friction",
        "hysteresis",
        "quadratic_drag",
        "cubic_stiffness",
        "cross_coupling",
        "exchange",
        "unmodelled_mode",
        "constant_disturbance",
        "periodic_disturbance",
    ] {
        assert!(
            left.iter().any(|(e, why)| *e == effect && why.contains("black box")),
            "{effect}: {left:?}"
        );
    }
    let tried = |effect: &str| left.iter().all(|(e, _)| *e != effect);
    assert!(
        ["input_delay", "deadband", "parameter_error", "sensor_bias", "clock_skew"]
            .into_iter()
            .all(tried),
        "{left:?}"
    );
    assert!(found.model.is_none() && found.diagnosis.prediction.mode == Mode::Simulation);
    assert!(
        found.diagnosis.prediction.why.contains("a perturbation decays within"),
        "{}",
        found.diagnosis.prediction.why
    );
}

#[test]
fn inputs_and_parameters_that_move_nothing_are_not_tried() {
    let recorded = log("a.csv", 400, 80, |u, t, x0| servo(held(t, u), t, x0, 9.0, 1.0));
    // A run that was recorded elsewhere and is looked up, whatever is asked.
    let angle: Vec<f64> = recorded.channel("angle").unwrap().samples().values.to_vec();
    let rate: Vec<f64> = recorded.channel("rate").unwrap().samples().values.to_vec();
    let lookup = Function(move |_: &DMatrix<f64>, time_s: &[f64], _: &[f64], _: &[f64]| {
        Ok(DMatrix::from_fn(time_s.len(), 2, |k, i| if i == 0 { angle[k] } else { rate[k] }))
    });
    let system = System::black_box(Arc::new(lookup), face()).unwrap();
    let real = log("a.csv", 400, 80, |u, t, x0| {
        let mut y = servo(held(t, u), t, x0, 9.0, 1.0);
        y.column_mut(1).add_scalar_mut(0.7);
        y
    });
    let found = diagnose(&system, &[real], &[], &GapOptions::default(), &|_| ()).unwrap();
    is_found(&found, "sensor_bias", "rate", 0.7, 0.1);
    for effect in ["input_delay", "deadband", "parameter_error"] {
        let why = found.diagnosis.cause.not_tried.iter().find(|n| n.effect == effect).unwrap();
        assert!(why.why.contains("depends on the"), "{why:?}");
    }
    assert!(found.caveats.contains(&Caveat::InputMovesNothing { input: "u".to_owned() }));
    assert!(
        found.caveats.contains(&Caveat::ParameterMovesNothing { parameter: "gain".to_owned() })
    );
    assert!(found.caveats.contains(&Caveat::StartMovesNothing { state: "v".to_owned() }));
    assert!(found.calls.unwrap() < 30, "{:?}", found.calls);
}

/// A diagnosis of a wrong black box, which must fail.
fn refused(
    f: impl Fn(&DMatrix<f64>, &[f64], &[f64], &[f64]) -> Answer + Send + Sync + 'static,
) -> deadtime::diagnose::Error {
    let system = System::black_box(Arc::new(Function(f)), face()).unwrap();
    let log = log("a.csv", 300, 90, |u, t, x0| servo(held(t, u), t, x0, 9.0, 1.0));
    diagnose(&system, &[log], &[], &GapOptions::default(), &|_| ()).unwrap_err()
}

#[test]
fn a_black_box_that_answers_wrongly_is_refused_with_what_it_answered() {
    let shape = refused(|_, t, _, _| Ok(DMatrix::zeros(t.len(), 1))).to_string();
    assert!(
        shape.contains("a.csv") && shape.contains("300 × 1") && shape.contains("300 × 2"),
        "{shape}"
    );
    let nan = refused(|u, t, x0, p| {
        let mut y = servo(held(t, u.as_slice()), t, x0, p[0], p[1]);
        y[(17, 1)] = f64::NAN;
        Ok(y)
    });
    let nan = nan.to_string();
    assert!(
        nan.contains("a.csv")
            && nan.contains("NaN")
            && nan.contains("`rate`")
            && nan.contains("sample 17"),
        "{nan}"
    );
    let said = refused(|_, _, _, _| Err("KeyError: 'ctrl'".to_owned())).to_string();
    assert!(said.contains("a.csv") && said.contains("KeyError: 'ctrl'"), "{said}");
    let count = AtomicUsize::new(0);
    let random = refused(move |u, t, x0, p| {
        let mut y = servo(held(t, u.as_slice()), t, x0, p[0], p[1]);
        y[(5, 0)] += 1e-3 * count.fetch_add(1, Ordering::Relaxed) as f64;
        Ok(y)
    });
    assert!(
        matches!(random, deadtime::diagnose::Error::Gap(GapError::NotRepeatable { .. }))
            && random.to_string().contains("seed"),
        "{random}"
    );
    let unstable = refused(|u, t, x0, _| {
        let mut x = x0[0];
        let run = |k: usize| {
            x += TS * (3.0 * x + u[(k, 0)]);
            [x, 3.0 * x]
        };
        let rows: Vec<[f64; 2]> = (0..t.len()).map(run).collect();
        Ok(DMatrix::from_fn(t.len(), 2, |k, i| rows[k][i]))
    });
    assert!(
        matches!(unstable, deadtime::diagnose::Error::Gap(GapError::Unstable { .. })),
        "{unstable}"
    );
}

#[test]
fn a_predictor_is_refused() {
    let log = log("a.csv", 300, 90, |u, t, x0| servo(held(t, u), t, x0, 9.0, 1.0));
    let options = GapOptions { prediction: Some(Mode::Predictor), ..GapOptions::default() };
    let error = diagnose(&system(), &[log], &[], &options, &|_| ()).unwrap_err();
    assert!(matches!(error, deadtime::diagnose::Error::Gap(GapError::NoPredictor)), "{error}");
}

#[test]
fn a_rival_that_fails_is_out_and_the_failures_are_counted() {
    let fussy = Function(|u: &DMatrix<f64>, t: &[f64], x0: &[f64], p: &[f64]| {
        if u.amax() > 1.3 {
            Err("command out of range".to_owned())
        } else {
            Ok(servo(held(t, u.as_slice()), t, x0, p[0], p[1]))
        }
    });
    let system = System::black_box(Arc::new(fussy), face()).unwrap();
    let real = |u: &[f64], t: &[f64], x0: &[f64]| {
        servo(|at| held(t, u)((at - 0.053).max(0.0)), t, x0, 9.0, 1.0)
    };
    let found =
        diagnose(&system, &[log("a.csv", 900, 10, real)], &[], &GapOptions::default(), &|_| ())
            .unwrap();
    is_found(&found, "input_delay", "u", 0.053, 0.004);
    let failed = found.caveats.iter().find_map(|c| match c {
        Caveat::SimulatorFailed { failed, why, .. } => Some((*failed, why.clone())),
        _ => None,
    });
    let (failed, why) = failed.expect("failures are told");
    assert!(failed > 0 && why.contains("command out of range"));
}

#[test]
fn a_coarse_simulator_of_single_precision_is_good_enough() {
    let coarse = Function(|u: &DMatrix<f64>, t: &[f64], x0: &[f64], p: &[f64]| {
        Ok(servo(held(t, u.as_slice()), t, x0, p[0], p[1]).map(|v| f64::from(v as f32)))
    });
    let system = System::black_box(Arc::new(coarse), face()).unwrap();
    let real = |u: &[f64], t: &[f64], x0: &[f64]| {
        servo(|at| held(t, u)((at - 0.053).max(0.0)), t, x0, 9.0, 1.0)
    };
    let found =
        diagnose(&system, &[log("a.csv", 900, 10, real)], &[], &GapOptions::default(), &|_| ())
            .unwrap();
    is_found(&found, "input_delay", "u", 0.053, 0.004);
}

/// A double integrator: the start is never forgotten.
fn cart(u: &[f64], t: &[f64], x0: &[f64]) -> DMatrix<f64> {
    let (mut x, mut v) = (x0[0], x0[1]);
    let mut y = DMatrix::zeros(t.len(), 2);
    for k in 0..t.len() {
        (y[(k, 0)], y[(k, 1)]) = (x, v);
        let h = if k + 1 < t.len() { t[k + 1] - t[k] } else { 0.0 };
        (x, v) = (x + h * v + 0.5 * h * h * u[k], v + h * u[k]);
    }
    y
}

#[test]
fn a_simulator_that_never_forgets_is_told_and_its_start_explains_what_it_can() {
    let integrates = |states: Vec<Start>| {
        let f = Function(|u: &DMatrix<f64>, t: &[f64], x0: &[f64], _: &[f64]| {
            Ok(cart(u.as_slice(), t, if x0.is_empty() { &[0.0, 0.0] } else { x0 }))
        });
        System::black_box(Arc::new(f), Face { states, parameters: Vec::new(), ..face() }).unwrap()
    };
    let real = |u: &[f64], t: &[f64], x0: &[f64]| cart(u, t, x0);
    let logs = [log("a.csv", 600, 7, real)];
    let found =
        diagnose(&integrates(face().states), &logs, &[], &GapOptions::default(), &|_| ()).unwrap();
    assert_eq!(
        found.diagnosis.cause.verdict,
        "none",
        "{:?}",
        found.diagnosis.cause.ranking.first()
    );
    assert!(
        found.caveats.iter().any(|c| matches!(c, Caveat::NeverForgets { started: true, .. })),
        "{:?}",
        found.caveats
    );
    assert!(
        found.diagnosis.prediction.why.contains("is left"),
        "{}",
        found.diagnosis.prediction.why
    );
    let without =
        diagnose(&integrates(Vec::new()), &logs, &[], &GapOptions::default(), &|_| ()).unwrap();
    assert!(without.caveats.contains(&Caveat::NoStart), "{:?}", without.caveats);
}

#[test]
fn logs_of_other_lengths_and_uneven_stamps_are_simulated_at_their_own_stamps() {
    let uneven = |name: &str, samples: usize, seed: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut at = 0.0;
        let stamps: Vec<f64> = (0..samples)
            .map(|_| {
                let here = at;
                at += rng.random_range(0.012..0.03);
                here
            })
            .collect();
        let u = commands(samples, &mut rng);
        let y = servo(|s| held(&stamps, &u)((s - 0.06).max(0.0)), &stamps, &[0.01, 0.0], 9.0, 1.0);
        let mut channels = vec![Channel::new("u", Some("V"), u)];
        for (i, (name, unit)) in [("angle", "rad"), ("rate", "rad/s")].into_iter().enumerate() {
            let noisy = y
                .column(i)
                .iter()
                .map(|v| v + 0.005 * rng.sample::<f64, _>(StandardNormal))
                .collect();
            channels.push(Channel::new(name, Some(unit), noisy));
        }
        Log::new(name, stamps, channels).unwrap()
    };
    let logs = [uneven("a.csv", 700, 1), uneven("b.csv", 500, 2)];
    let found = diagnose(&system(), &logs, &[], &GapOptions::default(), &|_| ()).unwrap();
    is_found(&found, "input_delay", "u", 0.06, 0.004);
}

#[test]
fn checks_and_isolability_take_a_black_box() {
    let log = log("a.csv", 900, 60, |u, t, x0| -servo(held(t, u), t, x0, 9.0, 1.0));
    let found =
        inspect(&system(), std::slice::from_ref(&log), &Stop::default(), &HowFar::default())
            .unwrap();
    assert!(found.not_run.is_none(), "{:?}", found.not_run);
    assert!(
        found.checks.iter().any(|c| c.ok == Some(false) && c.finding.contains("sign")),
        "{:#?}",
        found.checks
    );
    let apart = isolability(
        &system(),
        std::slice::from_ref(&log),
        &GapOptions::default(),
        &HowFar::default(),
    )
    .unwrap();
    assert!(
        apart.effects.iter().any(|e| e.effect == "input_delay" && e.visible),
        "{:#?}",
        apart.effects
    );
    assert!(apart.effects.iter().all(|e| e.effect != "coulomb_friction"));
    let class =
        apart.classes.iter().find(|c| c.members.iter().any(|m| m == "input_gain:u")).unwrap();
    assert!(class.members.iter().any(|m| m == "parameter_error:gain"), "{class:?}");
}

#[test]
fn a_diagnosis_that_nobody_waits_for_stops_soon() {
    let log = log("a.csv", 900, 10, |u, t, x0| servo(held(t, u), t, x0, 12.0, 1.0));
    let slow = Function(|u: &DMatrix<f64>, t: &[f64], x0: &[f64], p: &[f64]| {
        std::thread::sleep(Duration::from_millis(20));
        Ok(servo(held(t, u.as_slice()), t, x0, p[0], p[1]))
    });
    let system = System::black_box(Arc::new(slow), face()).unwrap();
    let stop = Stop::default();
    let options = GapOptions { stop: stop.clone(), ..GapOptions::default() };
    let wish = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(500));
        stop.set();
        Instant::now()
    });
    let error = diagnose(&system, &[log], &[], &options, &|_| ()).unwrap_err();
    let late = wish.join().unwrap().elapsed();
    assert!(matches!(error, deadtime::diagnose::Error::Stopped(_)), "{error}");
    // Generous: the machine may be busy.
    assert!(late < Duration::from_secs(2), "{late:?}");
}

#[test]
fn names_and_numbers_that_cannot_be_are_refused() {
    let with = |change: &dyn Fn(&mut Face)| {
        let mut face = face();
        change(&mut face);
        System::black_box(simulator(), face).unwrap_err().to_string()
    };
    assert!(with(&|f| f.inputs.clear()).contains("no input"));
    assert!(with(&|f| f.outputs[1].name = "angle".to_owned()).contains("`angle`"));
    assert!(
        with(&|f| f.states[0].std = Some(-1.0))
            .contains("standard deviation of the start of `x` is -1")
    );
    assert!(with(&|f| f.parameters[0].1 = f64::NAN).contains("`stiffness` is NaN"));
}

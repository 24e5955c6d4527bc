//! The laws of the effects: the identity at nominal, limit cases, signs, superposition, and hooks whose order is not that of the list.

use std::f64::consts::TAU;

use deadtime::effect::{Applied, Chance, EFFECTS, Scales, Site, Spread, find};
use deadtime::model::ModelDocument;
use deadtime::simulate::{Commands, Correction, Dynamics, Measured, Run, System};
use nalgebra::DMatrix;

const LINEAR: &str = r#"
format = "deadtime/model@1"
name = "two by two"
kind = "lti"
inputs = [{ name = "u", unit = "V" }, { name = "w", unit = "V" }]
states = [{ name = "x", unit = "m" }, { name = "v", unit = "m/s" }, { name = "h", unit = "m" }]
outputs = [{ name = "y", unit = "m" }, { name = "z", unit = "m/s" }]
initial = [0.1, -0.2, 0.05]
A = [[0.0, 1.0, 0.0], [-4.0, -0.8, 0.5], [0.0, 0.0, -0.6]]
B = [[0.0, 0.0], [3.0, 0.0], [0.0, 1.2]]
C = [[1.0, 0.0, 0.3], [0.0, 1.0, 0.0]]
D = [[0.0, 0.1], [0.0, 0.0]]
"#;

const EQUATIONS: &str = r#"
format = "deadtime/model@1"
name = "pendulum"
kind = "equations"
inputs = [{ name = "torque", unit = "N m" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
[states]
angle = { unit = "rad", initial = 0.3 }
rate = { unit = "rad/s", initial = -0.1 }
[parameters]
inertia = { unit = "kg m^2", value = 0.2 }
damping = { unit = "N m s/rad", value = 0.1 }
[derivatives]
angle = "rate"
rate = "(torque - damping*rate)/inertia - 9.0*sin(angle)"
[output_equations]
angle = "angle"
rate = "rate"
"#;

const SAMPLED: &str = r#"
format = "deadtime/model@1"
name = "sampled"
kind = "lti"
sample_time_s = 0.05
inputs = [{ name = "u", unit = "V" }]
states = [{ name = "x" }, { name = "q" }]
outputs = [{ name = "y", unit = "m" }, { name = "z", unit = "m" }]
A = [[0.9, 0.1], [-0.2, 0.8]]
B = [[0.0], [0.3]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.05]]
"#;

fn system(text: &str) -> System {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.toml");
    std::fs::write(&path, text).unwrap();
    System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap()
}

/// Commands of several levels, signs and lengths.
struct Flight {
    time_s: Vec<f64>,
    inputs: Vec<Vec<f64>>,
}

impl Flight {
    fn new(inputs: usize, samples: usize, ts: f64) -> Self {
        let level = |k: usize, i: usize| {
            let t = k as f64 * ts;
            let step = [0.0, 0.8, -0.5, 0.3, -1.0, 0.1][(k / (7 + 3 * i)) % 6];
            step + 0.2 * (TAU * (0.4 + 0.3 * i as f64) * t).sin()
        };
        Self {
            time_s: (0..samples).map(|k| k as f64 * ts).collect(),
            inputs: (0..inputs).map(|i| (0..samples).map(|k| level(k, i)).collect()).collect(),
        }
    }

    fn for_system(system: &System) -> Self {
        Self::new(system.inputs.len(), 200, 0.05)
    }

    fn commands(&self) -> Commands<'_> {
        Commands { time_s: &self.time_s, inputs: &self.inputs }
    }
}

fn with(system: &System, name: &str, channel: &str, values: &[f64]) -> Applied {
    let mut applied = Applied::nominal(system, find(name).unwrap(), channel).unwrap();
    applied.values.copy_from_slice(values);
    applied
}

fn run(system: &System, flight: &Flight, effects: &[Applied]) -> Run {
    let plan = Applied::plan(system, effects, Chance::Mean).unwrap();
    system.simulate(&plan, flight.commands(), &system.initial, None).unwrap()
}

fn distance(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax()
}

/// Every effect on every channel, on all kinds of models.
fn everywhere() -> Vec<(System, Applied)> {
    let mut all = Vec::new();
    for system in [LINEAR, EQUATIONS, SAMPLED].map(system) {
        for effect in
            EFFECTS.iter().filter(|e| !(system.is_sampled() && e.site() == Site::Dynamics))
        {
            for channel in effect.channels(&system) {
                all.push((system.clone(), Applied::nominal(&system, *effect, &channel).unwrap()));
            }
        }
    }
    all
}

#[test]
fn every_effect_at_its_nominal_parameters_is_the_identity_to_the_bit() {
    let mut count = 0;
    for (system, nominal) in everywhere() {
        let flight = Flight::for_system(&system);
        assert_eq!(
            run(&system, &flight, &[]),
            run(&system, &flight, std::slice::from_ref(&nominal)),
            "{nominal:?} on {}",
            system.name
        );
        count += 1;
    }
    assert!(count > 80, "{count} channels");
}

#[test]
fn every_effect_close_to_its_nominal_parameters_is_close_to_the_identity() {
    for (mut system, mut applied) in everywhere() {
        // With a direct path the sample of an edge sees the old command after the smallest delay: there is no limit to test.
        if let Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _) = &mut system.dynamics {
            matrices.d.fill(0.0);
        }
        let flight = Flight::for_system(&system);
        for (value, p) in applied.values.iter_mut().zip(&applied.parameters) {
            *value =
                if p.nominal.is_infinite() { p.nominal.signum() * 1e7 } else { p.nominal + 1e-6 };
        }
        let moved = distance(
            &run(&system, &flight, &[]).y,
            &run(&system, &flight, std::slice::from_ref(&applied)).y,
        );
        assert!(moved < 1e-4, "{applied:?} on {} moves the outputs by {moved}", system.name);
    }
}

#[test]
fn every_effect_away_from_its_nominal_parameters_moves_an_output_and_is_undone_by_none() {
    for (system, mut applied) in everywhere() {
        let flight = Flight::for_system(&system);
        let (effect, channel) = (applied.effect.name(), applied.channel.clone());
        for (value, p) in applied.values.iter_mut().zip(&applied.parameters) {
            *value = match (effect, p.name.as_ref()) {
                (_, "lower") => -0.07,
                (_, "upper") => 0.06,
                ("rate_limit", _) => 0.4,
                (_, "frequency") => 0.7,
                ("clock_skew", _) => 1.02,
                _ => p.nominal + 0.3,
            };
        }
        let moved = distance(
            &run(&system, &flight, &[]).y,
            &run(&system, &flight, std::slice::from_ref(&applied)).y,
        );
        assert!(moved > 1e-4, "{effect}:{channel} on {} moves nothing", system.name);
        assert!(moved.is_finite());
    }
}

#[test]
fn a_whole_delay_shifts_the_command_and_all_delays_of_a_settled_linear_model_agree() {
    let mut system = system(LINEAR);
    system.initial = vec![0.0; 3];
    let mut flight = Flight::for_system(&system);
    for input in &mut flight.inputs {
        input[..10].fill(0.0);
    }
    let delayed = run(
        &system,
        &flight,
        &[with(&system, "input_delay", "u", &[0.15]), with(&system, "input_delay", "w", &[0.15])],
    );
    let mut late = Flight::for_system(&system);
    for (late, input) in late.inputs.iter_mut().zip(&flight.inputs) {
        for k in 0..late.len() {
            late[k] = input[k.saturating_sub(3)];
        }
    }
    assert!(distance(&delayed.y, &run(&system, &late, &[]).y) < 1e-12);
    for fraction in [0.0137, 0.15] {
        let inputs = [
            with(&system, "input_delay", "u", &[fraction]),
            with(&system, "input_delay", "w", &[fraction]),
        ];
        let at_inputs = run(&system, &flight, &inputs);
        let at_outputs = run(&system, &flight, &[with(&system, "output_delay", "*", &[fraction])]);
        let clock = run(&system, &flight, &[with(&system, "clock_offset", "*", &[fraction])]);
        assert!(
            distance(&at_inputs.y, &at_outputs.y) < 1e-11,
            "{}",
            distance(&at_inputs.y, &at_outputs.y)
        );
        assert!(distance(&at_inputs.y, &clock.y) < 1e-11);
    }
}

#[test]
fn linear_effects_superpose_and_lags_commute_with_the_plant() {
    let mut system = system(LINEAR);
    system.initial = vec![0.0; 3];
    let flight = Flight::for_system(&system);
    let effects = [
        with(&system, "input_delay", "u", &[0.033]),
        with(&system, "actuator_lag", "u", &[0.21]),
        with(&system, "unmodelled_mode", "u->output:y", &[1.3, 0.05, 0.2]),
        with(&system, "sensor_lag", "z", &[0.4]),
        with(&system, "misalignment", "y->z", &[0.2]),
    ];
    let scaled = |by: f64| Flight {
        time_s: flight.time_s.clone(),
        inputs: flight.inputs.iter().map(|c| c.iter().map(|v| by * v).collect()).collect(),
    };
    let one = run(&system, &flight, &effects).y;
    assert!(distance(&(&one * -2.5), &run(&system, &scaled(-2.5), &effects).y) < 1e-11);
    // From rest the lag of an actuator is the same lag on all sensors.
    let mut single = Flight::for_system(&system);
    single.inputs[1].fill(0.0);
    single.inputs[0][..5].fill(0.0);
    let before = run(&system, &single, &[with(&system, "actuator_lag", "u", &[0.17])]);
    let after = run(&system, &single, &[with(&system, "sensor_lag", "*", &[0.17])]);
    assert!(distance(&before.y, &after.y) < 1e-11);
}

#[test]
fn the_order_of_a_list_changes_nothing() {
    let system = system(LINEAR);
    let flight = Flight::for_system(&system);
    let mut effects = vec![
        with(&system, "saturation", "u", &[-0.4, 0.6]),
        with(&system, "gain_fade", "u", &[0.03]),
        with(&system, "gain_jump", "u", &[0.9, 0.4, 1.2]),
        with(&system, "input_gain", "u", &[1.3]),
        with(&system, "input_curve", "u", &[0.2]),
        with(&system, "backlash", "u", &[0.05]),
        with(&system, "sensor_gain", "y", &[0.8]),
        with(&system, "sensor_bias", "y", &[0.3]),
        with(&system, "sensor_saturation", "y", &[-0.2, 0.5]),
    ];
    let one = run(&system, &flight, &effects);
    effects.reverse();
    assert_eq!(one, run(&system, &flight, &effects));
}

#[test]
fn limits_that_are_not_reached_do_nothing_and_limits_that_are_reached_hold() {
    let system = system(LINEAR);
    let flight = Flight::for_system(&system);
    let nominal = run(&system, &flight, &[]);
    for (effect, channel, wide) in [
        ("saturation", "u", vec![-50.0, 50.0]),
        ("rate_limit", "u", vec![1e7]),
        ("sensor_saturation", "y", vec![-9.0, 9.0]),
    ] {
        let moved = distance(
            &nominal.y,
            &run(&system, &flight, &[with(&system, effect, channel, &wide)]).y,
        );
        assert!(moved < 1e-5, "{effect} moves by {moved}");
    }
    let held = run(&system, &flight, &[with(&system, "sensor_saturation", "y", &[-0.1, 0.2])]);
    assert!(held.y.column(0).iter().all(|y| (-0.1..=0.2).contains(y)));
    assert!(held.y.column(0).iter().any(|y| *y == 0.2));
    let one_sided = run(
        &system,
        &flight,
        &[with(&system, "sensor_saturation", "y", &[f64::NEG_INFINITY, 0.2])],
    );
    assert!(one_sided.y.column(0).min() < -0.1);
}

#[test]
fn friction_sticks_exactly_until_it_is_overcome() {
    let text = EQUATIONS
        .replace("- 9.0*sin(angle)", "")
        .replace("initial = 0.3", "initial = 0.0")
        .replace("initial = -0.1", "initial = 0.0");
    let system = system(&text);
    let mut flight = Flight::for_system(&system);
    // Torque/inertia: 1.5, below the level; then 3, above it; then 0.
    for (k, torque) in flight.inputs[0].iter_mut().enumerate() {
        *torque = if k < 50 {
            0.3
        } else if k < 100 {
            0.6
        } else {
            0.0
        };
    }
    let moved = run(&system, &flight, &[with(&system, "coulomb_friction", "rate", &[2.0])]);
    assert!((0..=50).all(|k| moved.y[(k, 1)] == 0.0), "it moves below the level");
    assert!(moved.y[(100, 1)] > 0.5);
    assert!(
        (190..200).all(|k| moved.y[(k, 1)] == 0.0),
        "it does not come to rest: {}",
        moved.y[(199, 1)]
    );
    // dv/dt = 3 − 0.5 v − 2 from rest: v = 2(1 − exp(−t/2)).
    let expected = 2.0 * (1.0 - (-0.5_f64 * 2.5).exp());
    assert!((moved.y[(100, 1)] - expected).abs() < 1e-8, "{} is not {expected}", moved.y[(100, 1)]);

    // Two on one state add up.
    let both = run(
        &system,
        &flight,
        &[
            with(&system, "coulomb_friction", "rate", &[0.7]),
            with(&system, "coulomb_friction", "rate", &[1.3]),
        ],
    );
    assert!(distance(&both.y, &moved.y) < 1e-9, "{}", distance(&both.y, &moved.y));
}

#[test]
fn friction_that_falls_with_speed_breaks_loose_late_and_slides_on_its_level() {
    let text = EQUATIONS
        .replace("- 9.0*sin(angle)", "")
        .replace("initial = 0.3", "initial = 0.0")
        .replace("initial = -0.1", "initial = 0.0");
    let system = system(&text);
    let mut flight = Flight::for_system(&system);
    // Torque/inertia: 2.4, between the level and the level with what is extra at rest; then 3, above both.
    for (k, torque) in flight.inputs[0].iter_mut().enumerate() {
        *torque = if k < 50 { 0.48 } else { 0.6 };
    }
    let stribeck = |values: &[f64]| {
        run(&system, &flight, &[with(&system, "stribeck_friction", "rate", values)])
    };
    let moved = stribeck(&[2.0, 0.5, 1e-3]);
    assert!((0..=50).all(|k| moved.y[(k, 1)] == 0.0), "it moves below what holds it at rest");
    // Far above the velocity nothing extra is left: v = 2(1 − exp(−t/2)), less what the first thousandth took.
    let expected = 2.0 * (1.0 - (-0.5_f64 * 2.5).exp());
    let late = expected - moved.y[(100, 1)];
    assert!((0.0..2e-3).contains(&late), "{late}");
    // Without anything extra, and where no speed takes it away, it is Coulomb's.
    let coulomb =
        |level: f64| run(&system, &flight, &[with(&system, "coulomb_friction", "rate", &[level])]);
    assert_eq!(stribeck(&[2.0, 0.0, 1.0]).y, coulomb(2.0).y);
    assert!(distance(&stribeck(&[2.0, 0.5, 1e6]).y, &coulomb(2.5).y) < 1e-9);
}

/// What the search's lower bounds rest on: from there to nothing an elaborate friction changes a twentieth of what it does at most.
#[test]
fn elaborate_frictions_below_the_least_that_samples_show_hardly_change() {
    let system = system(EQUATIONS);
    let flight = Flight::for_system(&system);
    let nominal = run(&system, &flight, &[]).y;
    let rms =
        |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    let rates: Vec<f64> = nominal.column(1).iter().copied().collect();
    let accelerations: Vec<f64> = rates.windows(2).map(|w| (w[1] - w[0]) / 0.05).collect();
    let moves = |rms: f64| Spread { rms, std: rms, ..Spread::default() };
    let scales = Scales {
        sample_time_s: 0.05,
        states: vec![moves(1.0), moves(rms(&rates))],
        derivatives: vec![rms(&rates), rms(&accelerations)],
        ..Scales::default()
    };
    let level = 0.3 * scales.derivatives[1];
    for (name, values, at) in
        [("hysteresis", [level, 0.0, 2.0], 1), ("stribeck_friction", [level, level, 0.0], 2)]
    {
        let least = Applied::nominal(&system, find(name).unwrap(), "rate")
            .unwrap()
            .shown_by(&system, &scales)
            .parameters[at]
            .lower;
        let of = |times: f64| {
            let mut values = values;
            values[at] = times * least;
            run(&system, &flight, &[with(&system, name, "rate", &values)]).y
        };
        let limit = of(1.0 / 256.0);
        let off = |times: f64| distance(&of(times), &limit) / distance(&limit, &nominal);
        println!("{name}: least {least}, off by {} and {}", off(1.0), off(100.0));
        assert!(off(1.0) < 0.05 && off(100.0) > 0.05, "{name}: {} {}", off(1.0), off(100.0));
    }
}

#[test]
fn friction_on_a_linear_model_agrees_with_the_same_friction_on_equations() {
    let linear = r#"
format = "deadtime/model@1"
name = "cart"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "s" }, { name = "v" }]
outputs = [{ name = "s" }, { name = "v" }]
A = [[0.0, 1.0], [-2.0, -0.3]]
B = [[0.0], [1.5]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;
    let equations = r#"
format = "deadtime/model@1"
name = "cart"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "s" }, { name = "v" }]
[states]
s = { initial = 0.0 }
v = { initial = 0.0 }
[parameters]
[derivatives]
s = "v"
v = "-2*s - 0.3*v + 1.5*u"
[output_equations]
s = "s"
v = "v"
"#;
    let (linear, equations) = (system(linear), system(equations));
    let flight = Flight::for_system(&linear);
    for effects in [
        vec![("coulomb_friction", "v", vec![0.35])],
        vec![("stribeck_friction", "v", vec![0.2, 0.3, 0.4])],
        vec![("hysteresis", "v", vec![0.4, 0.1, 1.5])],
        vec![
            ("coulomb_friction", "v", vec![0.2]),
            ("quadratic_drag", "v", vec![0.4]),
            ("actuator_lag", "u", vec![0.06]),
        ],
    ] {
        let list =
            |s: &System| effects.iter().map(|(e, c, v)| with(s, e, c, v)).collect::<Vec<_>>();
        let (a, b) =
            (run(&linear, &flight, &list(&linear)), run(&equations, &flight, &list(&equations)));
        assert!(distance(&a.y, &b.y) < 1e-7, "{}", distance(&a.y, &b.y));
    }
    // Without nonlinear effects the exact step and the integrator agree.
    let effects = |s: &System| {
        vec![
            with(s, "input_delay", "u", &[0.012]),
            with(s, "gain_fade", "u", &[0.02]),
            with(s, "rate_limit", "u", &[2.0]),
            with(s, "actuator_lag", "u", &[0.1]),
            with(s, "unmodelled_mode", "u->state:v", &[0.8, 0.1, 0.5]),
            with(s, "periodic_disturbance", "v", &[0.9, 0.4, 0.3]),
            with(s, "cross_coupling", "u->s", &[0.1]),
            with(s, "sensor_lag", "s", &[0.2]),
            with(s, "output_delay", "v", &[0.07]),
            with(s, "clock_skew", "*", &[1.004]),
        ]
    };
    let (a, b) =
        (run(&linear, &flight, &effects(&linear)), run(&equations, &flight, &effects(&equations)));
    assert!(distance(&a.y, &b.y) < 1e-6, "{}", distance(&a.y, &b.y));
}

#[test]
fn play_has_its_width_and_starts_centred() {
    let gain = r#"
format = "deadtime/model@1"
name = "gain"
kind = "lti"
inputs = [{ name = "u" }]
states = []
outputs = [{ name = "y" }]
A = []
B = []
C = [[]]
D = [[1.0]]
"#;
    let system = system(gain);
    let inputs = vec![vec![1.0, 1.15, 1.5, 1.4, 1.0, 1.05, -1.0]];
    let time_s: Vec<f64> = (0..7).map(f64::from).collect();
    let flight = Flight { time_s, inputs };
    let out = run(&system, &flight, &[with(&system, "backlash", "u", &[0.2])]);
    let expected = [1.0, 1.0, 1.3, 1.3, 1.2, 1.2, -0.8];
    for (got, expected) in out.y.iter().zip(expected) {
        assert!((got - expected).abs() < 1e-15, "{got} is not {expected}");
    }
}

#[test]
fn a_correction_that_is_never_made_changes_nothing_and_one_that_is_made_pulls_to_the_measurement() {
    for text in [LINEAR, EQUATIONS, SAMPLED] {
        let system = system(text);
        let flight = Flight::for_system(&system);
        let plan = Applied::plan(&system, &[], Chance::Mean).unwrap();
        let free = run(&system, &flight, &[]);
        let measured: Vec<Measured> = (0..system.outputs.len())
            .map(|i| Measured {
                values: free.y.column(i).iter().map(|v| v + 0.5).collect(),
                present: None,
            })
            .collect();
        let simulate = |gain: &DMatrix<f64>| {
            system
                .simulate(
                    &plan,
                    flight.commands(),
                    &system.initial,
                    Some(Correction { gain, measured: &measured, horizon: None }),
                )
                .unwrap()
        };
        let none = simulate(&DMatrix::zeros(system.states.len(), system.outputs.len()));
        assert!(distance(&none.y, &free.y) < 1e-12);
        let pulled =
            simulate(&DMatrix::from_element(system.states.len(), system.outputs.len(), 0.05));
        assert!(distance(&pulled.y, &free.y) > 1e-3, "{}", system.name);
    }
}

#[test]
fn dropped_commands_follow_their_seed_and_average_to_their_mean() {
    let system = system(SAMPLED);
    let flight = Flight::for_system(&system);
    for burst in [f64::INFINITY, 4.0] {
        let effect = [with(&system, "dropped_commands", "u", &[0.4, burst])];
        let draw = |seed: u64| {
            let plan = Applied::plan(&system, &effect, Chance::Seed(seed)).unwrap();
            system.simulate(&plan, flight.commands(), &system.initial, None).unwrap().y
        };
        assert_eq!(draw(3), draw(3));
        assert!(distance(&draw(3), &draw(4)) > 1e-3);
        let draws = 400_u32;
        let mean =
            (0..draws).map(|s| draw(u64::from(s))).fold(DMatrix::zeros(200, 2), |sum, y| sum + y)
                / f64::from(draws);
        let spread = distance(&draw(0), &mean);
        let fit = run(&system, &flight, &effect).y;
        assert!(
            distance(&mean, &fit) < 4.0 * spread / f64::from(draws).sqrt(),
            "{} against {spread}",
            distance(&mean, &fit)
        );
    }
}

/// As many are lost as asked for, in runs as long as asked for; without a length each for itself.
#[test]
fn losses_are_as_many_and_as_long_as_they_should_be() {
    let sent: Vec<f64> = (0..40_000).map(f64::from).collect();
    for (probability, burst) in [(0.3, f64::INFINITY), (0.3, 5.0), (0.6, 1.5)] {
        let heard =
            received(&[("dropped_commands", &[probability, burst])], Chance::Seed(5), &sent);
        let lost: Vec<bool> = heard.iter().zip(&sent).map(|(heard, sent)| heard != sent).collect();
        let count = lost.iter().filter(|l| **l).count() as f64;
        let begun = lost.windows(2).filter(|w| !w[0] && w[1]).count() as f64;
        let length = if burst.is_finite() { burst } else { 1.0 / (1.0 - probability) };
        assert!(
            (count / 40_000.0 - probability).abs() < 0.02
                && (count / begun / length - 1.0).abs() < 0.05,
            "{count} lost in {begun} runs"
        );
    }
}

/// The command as the plant receives it, sample by sample: a direct path alone.
fn received(effects: &[(&str, &[f64])], chance: Chance<'_>, sent: &[f64]) -> Vec<f64> {
    let passes = r#"
format = "deadtime/model@1"
name = "direct"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "x" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[0.0]]
C = [[0.0]]
D = [[1.0]]
"#;
    let system = system(passes);
    let list: Vec<Applied> =
        effects.iter().map(|(name, values)| with(&system, name, "u", values)).collect();
    let plan = Applied::plan(&system, &list, chance).unwrap();
    let time_s: Vec<f64> = (0..sent.len()).map(|k| k as f64 * 0.1).collect();
    let inputs = [sent.to_vec()];
    system
        .simulate(&plan, Commands { time_s: &time_s, inputs: &inputs }, &[0.0], None)
        .unwrap()
        .y
        .column(0)
        .iter()
        .copied()
        .collect()
}

#[test]
fn delays_that_move_are_what_their_definitions_say() {
    let sent: Vec<f64> = (0..30).map(f64::from).collect();
    let mean = |effects: &[(&str, &[f64])]| received(effects, Chance::Mean, &sent);
    let at = |k: usize, delay: usize| sent[k.saturating_sub(delay)];
    // Between the samples, so that no rounding decides which side of an edge a sample sees.
    let jumped = mean(&[("delay_jump", &[0.15, 1.23, 0.45])]);
    assert_eq!(jumped, (0..30).map(|k| at(k, if k <= 12 { 2 } else { 5 })).collect::<Vec<_>>());
    let back = mean(&[("delay_jump", &[0.45, 1.23, 0.15])]);
    assert_eq!(back, (0..30).map(|k| at(k, if k <= 12 { 5 } else { 2 })).collect::<Vec<_>>());
    // u(t − d(t)): at 0.1·k the delay is 0.05 + 0.011·k.
    let drifted = mean(&[("delay_drift", &[0.05, 0.11])]);
    let expected = |k: usize| sent[(k as f64 - (0.5 + 0.11 * k as f64)).floor().max(0.0) as usize];
    assert_eq!(drifted, (0..30).map(expected).collect::<Vec<_>>());
    // A delay that has shrunk to nothing stays nothing.
    let shrunk = mean(&[("delay_drift", &[0.25, -0.2])]);
    assert_eq!(shrunk[20..], sent[20..]);
    // At 0.13, 0.48, 0.83 …: seen at the samples behind them.
    let held = mean(&[("multi_rate", &[0.35, 0.13])]);
    let passes = |k: usize| {
        let turns = ((0.1 * k as f64 - 0.13) / 0.35).floor();
        if turns < 0.0 { 0.0 } else { sent[((0.13 + 0.35 * turns) / 0.1).floor() as usize] }
    };
    assert_eq!(held, (0..30).map(passes).collect::<Vec<_>>());
    // The slower loop reads, then the delay holds back.
    assert_eq!(mean(&[("input_delay", &[0.2001]), ("multi_rate", &[0.35, 0.13])])[10], passes(7));
    assert_eq!(mean(&[("delay_jitter", &[0.25, 0.1, 1.0])]), mean(&[("input_delay", &[0.25])]));
}

#[test]
fn random_delays_follow_their_seed_and_their_order() {
    // Every second sample is a new step: how late it is heard is its delay, to a sample.
    let sent: Vec<f64> = (0..4000).map(|k| f64::from(k / 20)).collect();
    let draw = |seed: u64, ordered: f64| {
        received(&[("delay_jitter", &[0.6, 0.2, ordered])], Chance::Seed(seed), &sent)
    };
    assert_eq!(draw(3, 1.0), draw(3, 1.0));
    assert_ne!(draw(3, 1.0), draw(4, 1.0));
    let ordered = draw(3, 1.0);
    assert!(ordered.windows(2).all(|w| w[1] >= w[0]), "a command overtook another");
    assert!(draw(3, 0.0).windows(2).any(|w| w[1] < w[0]), "no command overtook another");
}

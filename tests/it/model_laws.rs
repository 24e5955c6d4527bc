//! Laws of models and simulations over random ones.

use crate::support::compare::{apart, responses_apart_together};
use deadtime::model::c2d::{
    CONVERSIONS, Conversion, Feedthrough, FirstOrderHold, ImpulseInvariant, LeastSquares, Tustin,
    ZeroOrderHold,
};
use deadtime::model::uav::Dynamics;
use deadtime::model::{Continuous, ModelError, Sampled, StateSpace, d2c, dare, dlqr, nu_gap};
use deadtime::simulate::{Hold, Options, Prehistory, lsim};
use deadtime::time::SampleTime;
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

fn matrix(rows: usize, columns: usize) -> impl Strategy<Value = DMatrix<f64>> {
    prop::collection::vec(-1.0..1.0f64, rows * columns)
        .prop_map(move |v| DMatrix::from_vec(rows, columns, v))
}

/// A, B, C, D with entries up to 1 (A up to 2 and damped), orders 1 to 4, one or two inputs and outputs.
fn model() -> impl Strategy<Value = StateSpace<Continuous>> {
    (1..=4usize, 1..=2usize, 1..=2usize).prop_flat_map(|(n, m, p)| {
        (matrix(n, n), matrix(n, m), matrix(p, n), matrix(p, m)).prop_map(move |(a, b, c, d)| {
            StateSpace::continuous(a * 2.0 - DMatrix::identity(n, n) * 0.5, b, c, d).unwrap()
        })
    })
}

/// An input record for a model, samples × inputs.
fn signal(samples: usize, seed: u64, inputs: usize) -> DMatrix<f64> {
    let mut state = seed | 1;
    DMatrix::from_fn(samples, inputs, |_, _| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    })
}

fn hold() -> impl Strategy<Value = Hold> {
    prop_oneof![Just(Hold::Zero), Just(Hold::Linear)]
}

fn seconds(ts: f64) -> SampleTime {
    SampleTime::new(ts).unwrap()
}

fn every(rows: &DMatrix<f64>, step: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows.nrows().div_ceil(step), rows.ncols(), |k, j| rows[(k * step, j)])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn no_frequency_of_a_band_has_a_larger_gain_than_its_norm_which_is_attained_and_delays_change_nothing(
        sys in model(), low in 0.01..2.0f64, width in 0.0..3.0f64, delay in 0.0..1.0f64,
    ) {
        let band = [low, low * 10f64.powf(width)];
        let gain = |w: f64| sys.frequency_response(w).singular_values().max();
        let found = sys.norm_linf(band).unwrap();
        prop_assert!((band[0]..=band[1]).contains(&found.omega_rad_s));
        prop_assert!((gain(found.omega_rad_s) / found.gain - 1.0).abs() < 1e-8, "{found:?}");
        for k in 0..=200 {
            let w = band[0] * (band[1] / band[0]).powf(f64::from(k) / 200.0);
            prop_assert!(gain(w) <= found.gain * (1.0 + 1e-8), "{w} {} {found:?}", gain(w));
        }
        let late = sys.clone().with_input_delay(vec![delay; sys.inputs()]).unwrap();
        prop_assert_eq!(late.norm_linf(band).unwrap(), found);
        // A wider band has no smaller norm.
        prop_assert!(sys.norm_linf([0.5 * band[0], 2.0 * band[1]]).unwrap().gain >= found.gain * (1.0 - 1e-9));
    }

    #[test]
    fn the_nu_gap_is_a_distance_and_no_chordal_distance_is_above_it(one in model(), change in -1.0..1.0f64, third in -1.0..1.0f64) {
        let moved = |by: f64| StateSpace::continuous(one.a() * (1.0 + 0.3 * by), one.b() * (1.0 - 0.2 * by), one.c().clone(), one.d().clone()).unwrap();
        let (two, three) = (moved(change), moved(third));
        // Modes that are all but hidden have Riccati equations that nobody solves: an error, never a number.
        let gap = |p: &StateSpace<Continuous>, q: &StateSpace<Continuous>| nu_gap(p, q).map(|g| g.value);
        let all = [gap(&one, &two), gap(&two, &one), gap(&one, &three), gap(&two, &three), gap(&one, &one)];
        prop_assume!(all.iter().all(Result::is_ok));
        if let [Ok(there), Ok(back), Ok(on), Ok(from), Ok(own)] = all {
            prop_assert!((there - back).abs() < 1e-6 && own < 1e-6, "{there} {back} {own}");
            prop_assert!(on <= there + from + 1e-6, "{on} {there} {from}");
            for k in 0..60 {
                let w = 10f64.powf(-2.0 + f64::from(k) / 15.0);
                let [p, q] = [&one, &two].map(|s| s.frequency_response(w));
                if one.inputs() == 1 && one.outputs() == 1 {
                    let (p, q) = (p[(0, 0)], q[(0, 0)]);
                    let chord = (p - q).norm() / ((1.0 + p.norm_sqr()) * (1.0 + q.norm_sqr())).sqrt();
                    prop_assert!(chord <= there + 1e-6, "{chord} {there}");
                }
            }
        }
    }

    #[test]
    fn d2c_undoes_zero_order_hold(sys in model(), ts in 0.01..0.3f64, delay in 0..4usize) {
        let ts = seconds(ts);
        let delayed = sys.clone().with_input_delay(vec![ts.to_seconds(delay as f64); sys.inputs()]).unwrap();
        let back = d2c(&ZeroOrderHold {}.c2d(&delayed, ts).unwrap()).unwrap();
        prop_assert!(apart(back.a(), sys.a()) < 1e-10 && apart(back.b(), sys.b()) < 1e-10, "{back:?}");
        prop_assert!(back.c() == sys.c() && back.d() == sys.d());
        prop_assert!((back.input_delay()[0] - delayed.input_delay()[0]).abs() < 1e-12);
    }

    #[test]
    fn seven_times_the_samples_of_the_same_held_input_pass_through_the_same_states(
        sys in model(), ts in 0.01..0.3f64, fraction in 0.0..3.0f64, seed: u64, hold in hold(),
    ) {
        let sys = sys.clone().with_input_delay(vec![fraction * ts; sys.inputs()]).unwrap();
        let u = signal(25, seed, sys.inputs());
        let fine = DMatrix::from_fn(24 * 7 + 1, sys.inputs(), |k, j| match hold {
            Hold::Zero => u[(k / 7, j)],
            Hold::Linear => {
                let share = (k % 7) as f64 / 7.0;
                u[(k / 7, j)] * (1.0 - share) + u[((k / 7 + 1).min(24), j)] * share
            }
        });
        let options = Options { hold, ..Options::default() };
        let coarse = lsim(&sys, &u, seconds(ts), &options).unwrap();
        let seven = lsim(&sys, &fine, seconds(ts / 7.0), &options).unwrap();
        prop_assert!(responses_apart_together(&every(&seven.x, 7), &coarse.x) < 1e-10);
        prop_assert!(responses_apart_together(&every(&seven.y, 7), &coarse.y) < 1e-10);
    }

    #[test]
    fn responses_add_up(sys in model(), ts in 0.01..0.3f64, fraction in 0.0..3.0f64, seed: u64, hold in hold(), gain in -3.0..3.0f64) {
        let sys = sys.clone().with_input_delay(vec![fraction * ts; sys.inputs()]).unwrap();
        let (u, v) = (signal(40, seed, sys.inputs()), signal(40, !seed, sys.inputs()));
        let x0 = DVector::from_element(sys.order(), 0.7);
        let run = |u: &DMatrix<f64>, initial: Option<DVector<f64>>| {
            lsim(&sys, u, seconds(ts), &Options { hold, initial, ..Options::default() }).unwrap()
        };
        let (left, right) = (run(&u, Some(x0.clone())), run(&v, None));
        let sum = run(&(&u + &v * gain), Some(x0));
        // Rounding is as large as what is added up: states may cancel in an output.
        let scale = [left.x.amax(), right.x.amax() * gain.abs(), left.y.amax(), 1.0].into_iter().fold(0.0, f64::max);
        prop_assert!((sum.y - left.y - right.y * gain).amax() < 1e-12 * scale);
    }

    /// The sampled model of a delayed plant against the undelayed plant under the shifted input, on a grid that has its edges.
    #[test]
    fn a_delay_before_conversion_is_a_shift_of_the_input(
        sys in model(), ts in 0.02..0.3f64, whole in 0..3usize, fraction in prop_oneof![Just(0.0), 0.05..0.95f64], seed: u64,
    ) {
        let samples = 20;
        let (m, delay) = (sys.inputs(), (whole as f64 + fraction) * ts);
        let u = signal(samples, seed, m);
        let options = Options { prehistory: Prehistory::Rest, ..Options::default() };
        let delayed = sys.clone().with_input_delay(vec![delay; m]).unwrap();
        let sampled = lsim(&ZeroOrderHold {}.c2d(&delayed, seconds(ts)).unwrap(), &u, seconds(ts), &options).unwrap();
        // Samples and edges, each with the input that holds from there on.
        let mut stamps: Vec<(f64, usize, usize)> = Vec::new();
        for k in 0..samples {
            stamps.push((k as f64 * ts, k, k.saturating_sub(whole + usize::from(fraction > 0.0))));
            if fraction > 0.0 {
                stamps.push(((k as f64 + fraction) * ts, usize::MAX, k.saturating_sub(whole)));
            }
        }
        let started = |at: usize| stamps[at].0 >= delay - 1e-9 * ts;
        let time_s: Vec<f64> = stamps.iter().map(|s| s.0).collect();
        let shifted = DMatrix::from_fn(stamps.len(), m, |i, j| if started(i) { u[(stamps[i].2, j)] } else { 0.0 });
        let reference = lsim(&sys, &shifted, time_s.as_slice(), &options).unwrap();
        let at_samples: Vec<usize> = (0..stamps.len()).filter(|&i| stamps[i].1 != usize::MAX).collect();
        prop_assert!(responses_apart_together(&sampled.y, &reference.y.select_rows(&at_samples)) < 1e-10);
    }

    #[test]
    fn whatever_the_shapes_there_is_an_answer_or_an_error(
        shapes in prop::collection::vec((0..4usize, 0..4usize), 9), seed: u64, order in 0..4usize, inputs in 0..3usize, outputs in 0..3usize, fit: bool,
    ) {
        let part = |i: usize, rows: usize, columns: usize| {
            let (rows, columns) = if fit { (rows, columns) } else { shapes[i] };
            signal(rows, seed.wrapping_add(i as u64), columns)
        };
        let (a, b, c, d) = (part(0, order, order), part(1, order, inputs), part(2, outputs, order), part(3, outputs, inputs));
        let ts = seconds(0.1);
        let _ = dlqr(&a, &b, &part(4, order, order), &part(5, inputs, inputs), Some(&part(6, order, inputs)));
        let eye = |n: usize| DMatrix::<f64>::identity(n, n);
        let _ = dare(&a, &b, &eye(shapes[4].0), &eye(shapes[5].0), None);
        let _ = dare(&a, &b, &eye(a.nrows()), &eye(b.ncols()), None);
        let _ = StateSpace::sampled(a.clone(), b.clone(), c.clone(), d.clone(), ts).map(|sys| {
            let _ = d2c(&sys);
            let _ = lsim(&sys, &signal(shapes[7].0, seed, shapes[7].1), ts, &Options::default());
        });
        let Ok(sys) = StateSpace::continuous(a, b, c, d) else { return Ok(()) };
        let _ = (sys.poles(), sys.zeros(), sys.is_stable(), sys.frequency_response(1.0));
        let _ = (sys.relative_degree(shapes[0].0, shapes[0].1), sys.pair(shapes[1].0, shapes[1].1), sys.with_state_feedback(&part(8, inputs, order)));
        let _ = sys.transfer_function(shapes[2].0, shapes[2].1);
        let _ = sys.clone().with_input_delay(vec![0.05; shapes[3].0]);
        let delayed = sys.clone().with_input_delay(vec![0.37; sys.inputs()]).unwrap();
        for sys in [&sys, &delayed] {
            for entry in CONVERSIONS.iter().filter(|entry| entry.name != "least_squares") {
                let _ = (entry.build)(serde_json::json!({})).unwrap().c2d(sys, ts);
            }
            for u in [signal(shapes[7].0, seed, shapes[7].1), signal(shapes[8].0, seed, sys.inputs())] {
                for hold in [Hold::Zero, Hold::Linear] {
                    for prehistory in [Prehistory::Held, Prehistory::Rest] {
                        let options = Options { hold, prehistory, ..Options::default() };
                        let _ = lsim(sys, &u, ts, &options);
                        let _ = lsim(sys, &u, &[0.0, 0.1, 0.25][..shapes[6].0.min(3)], &options);
                    }
                }
            }
        }
    }
}

/// THESIS tables: the degree bias in samples of each output under each conversion is the relative degree of the sampled model.
#[test]
fn the_relative_degree_of_every_sampled_output_is_the_published_bias() {
    let drop = ImpulseInvariant { feedthrough: Feedthrough::Drop };
    let methods: [(&str, &dyn Conversion, usize); 5] = [
        ("zoh", &ZeroOrderHold {}, 1),
        ("tustin", &Tustin { prewarp_rad_s: None, fractional_delay_order: 0 }, 0),
        ("foh", &FirstOrderHold {}, 0),
        ("impulse", &ImpulseInvariant { feedthrough: Feedthrough::Keep }, 0),
        ("impulse, feedthrough dropped", &drop, 0),
    ];
    for dynamics in Dynamics::ALL {
        for (output, (name, _)) in dynamics.outputs().iter().enumerate() {
            for (method, conversion, rates) in methods {
                // p, q and r follow the input's integral; the accelerations have a direct path.
                let expected = if ["p", "q", "r"].contains(name) { rates } else { 0 };
                for delay in [0, 3] {
                    let ts = seconds(0.1);
                    let sys = dynamics
                        .model()
                        .with_input_delay(vec![ts.to_seconds(delay as f64)])
                        .unwrap();
                    let sampled: StateSpace<Sampled> = conversion.c2d(&sys, ts).unwrap();
                    assert_eq!(
                        sampled.relative_degree(output, 0),
                        Some(expected),
                        "{name} {method}"
                    );
                    assert_eq!(sampled.input_delay(), [delay], "{name} {method}");
                }
            }
        }
    }
}

#[test]
fn least_squares_keeps_integrators_on_the_circle_and_settles() {
    // 1/(s(s+1)), zeros, poles and delay included.
    let sys = StateSpace::continuous(
        DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, -1.0]),
        DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
        DMatrix::from_row_slice(1, 2, &[1.0, 0.0]),
        DMatrix::zeros(1, 1),
    );
    let sampled = LeastSquares::default().c2d(&sys.unwrap(), seconds(0.1)).unwrap();
    assert!(sampled.poles().iter().any(|p| (p - 1.0).norm() < 1e-12), "{:?}", sampled.poles());
}

#[test]
fn a_chain_of_integrators_is_converted_by_every_method() {
    let sys = StateSpace::continuous(
        DMatrix::from_fn(3, 3, |i, j| f64::from(u8::from(i == j + 1))),
        DMatrix::from_row_slice(3, 1, &[1.0, 0.0, 0.0]),
        DMatrix::from_row_slice(1, 3, &[0.0, 0.0, 1.0]),
        DMatrix::zeros(1, 1),
    );
    let sys = sys.unwrap();
    for entry in CONVERSIONS {
        let sampled = (entry.build)(serde_json::json!({}))
            .unwrap()
            .c2d(&sys, seconds(0.1))
            .unwrap_or_else(|e| panic!("{}: {e}", entry.name));
        let poles = sampled.poles();
        assert!(poles.iter().all(|p| (p - 1.0).norm() < 1e-4), "{}: {poles:?}", entry.name);
    }
}

#[test]
fn single_pair_conversions_say_so_for_more() {
    for entry in CONVERSIONS {
        let converted = (entry.build)(serde_json::json!({}))
            .unwrap()
            .c2d(&Dynamics::Lateral.model(), seconds(0.1));
        let single = ["matched", "least_squares"].contains(&entry.name);
        assert_eq!(
            matches!(converted, Err(ModelError::NotSingle { inputs: 1, outputs: 2, .. })),
            single,
            "{}",
            entry.name
        );
    }
}

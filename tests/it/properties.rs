//! Laws of the estimators over random plants, inputs and dead times, and their bias from the relative degree.
//!
//! Each number in an assertion was measured; what does not hold exactly is asserted as it is, with the rate that was seen.

use crate::support::plants::{
    TS, answer, delayed, rbs, respond, samples, second_order, std_dev, sum, times, ts, white, whole,
};
use deadtime::delay::{
    DelayEstimate, Experiment, Law, METHODS, Method, Outcome, ReferenceExperiment, Scope, Search,
};
use deadtime::model::c2d::{
    Conversion, Feedthrough, FirstOrderHold, ImpulseInvariant, Tustin, ZeroOrderHold,
};
use deadtime::model::uav::Dynamics;
use deadtime::model::{Sampled, StateSpace, dlqr};
use nalgebra::DMatrix;
use proptest::prelude::*;
use rayon::prelude::*;

/// Longest delay searched where the injected ones go up to 40.
const WINDOW: usize = 45;

fn method(name: &str) -> &'static Method {
    METHODS.iter().find(|m| m.entry.name == name).unwrap()
}

/// The methods that answer pairs and promise a law.
fn promising(law: Law) -> impl Iterator<Item = &'static Method> {
    METHODS.iter().filter(move |m| m.scope == Scope::Pair && m.promises(law))
}

/// A delay was found, and it is this one to the method's tolerance.
fn hits(method: &Method, estimate: &DelayEstimate, delay: usize) -> bool {
    let off = estimate.delay_s.map_or(f64::NAN, |d| samples(d, TS) - delay as f64);
    estimate.outcome == Outcome::Found && off.abs() <= method.tolerance.max(1e-6)
}

fn search(bias: usize) -> Search {
    Search { max_delay: WINDOW, bias: vec![vec![bias]], ..Search::default() }
}

/// The sampled dynamics, lateral and longitudinal stabilised by u = r − Kx, K = dlqr(Q = I, R = I) of the sampled model.
fn stabilised(dynamics: Dynamics, conversion: &dyn Conversion) -> StateSpace<Sampled> {
    let sampled = conversion.c2d(&dynamics.model(), ts(TS)).unwrap();
    match dynamics {
        Dynamics::Directional | Dynamics::Vertical => sampled,
        Dynamics::Lateral | Dynamics::Longitudinal => {
            let n = sampled.order();
            let identity = DMatrix::identity(n, n);
            let k = dlqr(sampled.a(), sampled.b(), &identity, &DMatrix::identity(1, 1), None)
                .unwrap()
                .k;
            sampled.with_state_feedback(&k).unwrap()
        }
    }
}

/// A stable plant with one input and one output whose response begins `bias` samples after its input.
#[derive(Debug, Clone)]
enum Plant {
    /// b·q⁻¹/(1 − p·q⁻¹): any first-order plant behind a zero-order hold.
    First { b: f64, pole: f64 },
    /// b·q⁻¹/(1 + f₁q⁻¹ + f₂q⁻²).
    Second { b: f64, f: [f64; 2] },
    /// An output of the vehicle behind a zero-order hold.
    Vehicle { dynamics: Dynamics, output: usize },
}

impl Plant {
    /// The response from rest, and the relative degree.
    fn respond(&self, u: &[f64], delay: usize) -> (Vec<f64>, usize) {
        match *self {
            Self::First { b, pole } => (second_order(u, b, [-pole, 0.0], delay), 1),
            Self::Second { b, f } => (second_order(u, b, f, delay), 1),
            Self::Vehicle { dynamics, output } => {
                let sys = stabilised(dynamics, &ZeroOrderHold {}).pair(output, 0).unwrap();
                let degree = sys.relative_degree(0, 0).unwrap();
                (respond(&sys, &[u.to_vec()], &[delay]).0.remove(0), degree)
            }
        }
    }
}

fn gain() -> impl Strategy<Value = f64> {
    (0.05..20.0_f64, any::<bool>()).prop_map(|(b, up)| if up { b } else { -b })
}

/// Two poles: real, or a pair of radius and angle.
fn poles() -> impl Strategy<Value = [f64; 2]> {
    prop_oneof![
        (-0.4..0.9, -0.4..0.9).prop_map(|(p, q): (f64, f64)| [-(p + q), p * q]),
        (0.1..0.9, 0.05..3.0).prop_map(|(r, a): (f64, f64)| [-2.0 * r * a.cos(), r * r]),
    ]
}

fn simple_plant() -> impl Strategy<Value = Plant> {
    prop_oneof![
        (gain(), -0.5..0.9).prop_map(|(b, pole)| Plant::First { b, pole }),
        (gain(), poles()).prop_map(|(b, f)| Plant::Second { b, f }),
    ]
}

fn any_plant() -> impl Strategy<Value = Plant> {
    prop_oneof![
        3 => simple_plant(),
        1 => Just(Plant::Vehicle { dynamics: Dynamics::Directional, output: 0 }),
        1 => Just(Plant::Vehicle { dynamics: Dynamics::Vertical, output: 0 }),
        2 => (0..2_usize).prop_map(|output| Plant::Vehicle { dynamics: Dynamics::Lateral, output }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn injected_delays_are_found_exactly_on_noise_free_rich_input(plant in any_plant(), delay in 0..=40_usize, seed in 0..10_000_u64) {
        let u = rbs(400, 1.0, seed);
        let (y, bias) = plant.respond(&u, delay);
        let experiment = Experiment::siso(ts(TS), u, y).unwrap();
        for method in promising(Law::Exact) {
            let estimate = answer(method, &experiment, &search(bias));
            prop_assert!(hits(method, &estimate, delay), "{}, {} samples: {:?}", method.entry.name, delay, estimate);
        }
    }
}

proptest! {
    // Methods that fit models answer two noisy records a case.
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn gain_sign_and_sample_time_of_a_noisy_record_change_nothing(
        plant in simple_plant(), delay in 0..=15_usize, seed in 0..10_000_u64, on_u in gain(), on_y in gain(), seconds in 1e-4..100.0_f64,
    ) {
        gain_sign_and_sample_time_change_nothing(&plant, delay, seed, [on_u, on_y], seconds, &[]);
    }
}

/// Every method that promises it gives a record the same answer, in samples, when the channels are scaled by `gains` and a sample lasts `seconds`.
/// Of the methods that promise the law, and of those of `besides`.
fn gain_sign_and_sample_time_change_nothing(
    plant: &Plant,
    delay: usize,
    seed: u64,
    gains: [f64; 2],
    seconds: f64,
    besides: &[&str],
) {
    let u = rbs(300, 1.0, seed);
    let (clean, bias) = plant.respond(&u, delay);
    let y = sum(&clean, &white(300, 0.02 * std_dev(&clean), seed + 1));
    let changed = Experiment::siso(ts(seconds), times(&u, gains[0]), times(&y, gains[1])).unwrap();
    let plain = Experiment::siso(ts(TS), u, y).unwrap();
    let besides = besides.iter().map(|name| deadtime::delay::method(name).unwrap());
    for method in promising(Law::Gain).filter(|m| m.promises(Law::Sign)).chain(besides) {
        let (a, b) =
            (answer(method, &plain, &search(bias)), answer(method, &changed, &search(bias)));
        assert_eq!(a.outcome, b.outcome, "{}: {a:?} {b:?}", method.entry.name);
        let apart = |x: Option<f64>, y: Option<f64>| {
            x.map(|v| v / TS).unwrap_or(-1.0) - y.map(|v| v / seconds).unwrap_or(-1.0)
        };
        // A fit whose own leftovers say that the plant is not of its kind may stop anywhere along a valley of nearly equal costs (5 of 4000 such records).
        let holds = |apart: f64, tolerance: f64| a.contradicted || apart.abs() < tolerance;
        assert!(
            holds(apart(a.delay_s, b.delay_s), 1e-6_f64.max(0.01 * method.tolerance)),
            "{}: {a:?} {b:?}",
            method.entry.name
        );
        // The ends of an interval that is searched for are known to a share of the tolerance.
        assert!(
            holds(apart(a.std_s, b.std_s), 1e-4_f64.max(0.02 * method.tolerance)),
            "{}: {a:?} {b:?}",
            method.entry.name
        );
    }
}

#[test]
fn of_delays_that_fit_alike_the_gain_does_not_choose() {
    // p2d promises the law on all but 1 record of 1500, and these are mended ones.
    // A pole that dies away within a sample adds to the dead time: delays from 8.0000 to 8.0018 samples have one cost, and rounding once chose among them.
    let plant = Plant::First { b: -0.05, pole: 0.6101976027082096 };
    gain_sign_and_sample_time_change_nothing(
        &plant,
        8,
        805,
        [-9.872049108546365, -13.23525408153079],
        1e-4,
        &["p2d"],
    );
    // Here the interval's end is a cliff behind a plain, and the search for it once ran out of steps.
    gain_sign_and_sample_time_change_nothing(
        &Plant::First { b: 1.0, pole: 0.03436561152277906 },
        6,
        3637,
        [15.9, -5.6],
        90.6,
        &["p2d"],
    );
    // Here a direct path's neighbour was once fitted from a pole too fast to show.
    let plant = Plant::First { b: 10.513232238453124, pole: 0.013292616674143498 };
    gain_sign_and_sample_time_change_nothing(
        &plant,
        2,
        2546,
        [13.840696468561141, -11.079315290646536],
        48.58889781943347,
        &["p2d"],
    );
}

#[test]
#[ignore = "nightly: a rate over draws; contract.rs has the law without noise"]
fn delaying_a_noisy_output_moves_nearly_every_answer_by_as_much() {
    // The methods that read a phase keep the law on 97 of 100, the others on nearly all.
    let records = 60;
    // Of the methods that are made for such records: random input on a plant with dynamics.
    for method in promising(Law::Shift).filter(|m| m.reference == ReferenceExperiment::Plant) {
        let moved = (0..records).into_par_iter().filter(|&seed| {
            let more = 1 + seed as usize * 7 % 25;
            let pole = 0.08 * (seed % 11) as f64;
            // A method of skewed signals has nothing to say of a random binary one.
            let u = match method.reference {
                ReferenceExperiment::Skewed => {
                    white(400, 1.0, seed).iter().map(|v| v * v - 1.0).collect()
                }
                _ => rbs(400, 1.0, seed),
            };
            let clean =
                second_order(&u, 0.05 + seed as f64 / 10.0, [-pole, 0.0], seed as usize % 10);
            let noise = white(400 + more, 0.02 * std_dev(&clean), seed + 1000);
            // The noise goes on before the record as it does in it, and moves with the output.
            let plain = sum(&clean, &noise[more..]);
            let later = sum(&delayed(&clean, more), &noise[..400]);
            let found = |y: Vec<f64>| {
                answer(method, &Experiment::siso(ts(TS), u.clone(), y).unwrap(), &search(1))
            };
            let (a, b) = (found(plain), found(later));
            let (Some(a), Some(b)) = (a.delay_s, b.delay_s) else { return false };
            (samples(b - a, TS) - more as f64).abs() <= method.tolerance
        });
        let moved = moved.count();
        println!("{}: {moved} of {records} answers moved with the output", method.entry.name);
        // arxstruc weighs numerators by Schwarz's criterion, which keeps a coefficient of pure noise in about 1 record of 100.
        // 97 of 100, less three standard deviations of 60 records.
        assert!(moved >= 54, "{}: only {moved} of {records}", method.entry.name);
    }
}

#[test]
fn an_undermodelled_response_is_still_seen_by_oestruc() {
    // y = D·u + slow motion has two numerator coefficients; with one, what is left is slow, and must not count as if the white input were slow too.
    for (dynamics, output) in [(Dynamics::Vertical, 0), (Dynamics::Lateral, 1)] {
        let plant = Plant::Vehicle { dynamics, output };
        let off: Vec<(usize, Option<i64>)> = (0..41_u64)
            .into_par_iter()
            .map(|seed| {
                let (u, delay) = (rbs(400, 1.0, seed), seed as usize % 41);
                let (y, bias) = plant.respond(&u, delay);
                let estimate = answer(
                    method("oestruc"),
                    &Experiment::siso(ts(TS), u, y).unwrap(),
                    &search(bias),
                );
                (
                    delay,
                    whole(&estimate, TS)
                        .map(|found| i64::try_from(found).unwrap() - i64::try_from(delay).unwrap()),
                )
            })
            .collect();
        println!("oestruc, {plant:?}, 400 samples, noise-free: {}", histogram(&off));
        assert!(off.iter().all(|(_, o)| *o == Some(0)), "{plant:?}: {off:?}");
    }
}

/// What a method takes for the delay, minus the injected one, in samples, for d = 0 … 10 and some seeds; `None` for no answer.
fn biases(
    name: &str,
    sys: &StateSpace<Sampled>,
    seeds: std::ops::Range<u64>,
) -> Vec<(usize, Option<i64>)> {
    let cases: Vec<(usize, u64)> =
        (0..=10).flat_map(|d| seeds.clone().map(move |s| (d, s))).collect();
    cases
        .par_iter()
        .map(|&(d, seed)| {
            let u = rbs(1000, 0.01, 1000 + seed);
            let y = respond(sys, std::slice::from_ref(&u), &[d]).0.remove(0);
            let y = sum(&y, &white(1000, 0.01 * std_dev(&y), 2000 + seed));
            let estimate = answer(
                method(name),
                &Experiment::siso(ts(TS), u, y).unwrap(),
                &Search { max_delay: 20, default_bias: 0, ..Search::default() },
            );
            (
                d,
                whole(&estimate, TS)
                    .map(|nk| i64::try_from(nk).unwrap() - i64::try_from(d).unwrap()),
            )
        })
        .collect()
}

fn histogram(found: &[(usize, Option<i64>)]) -> String {
    let mut counts = std::collections::BTreeMap::new();
    for (_, bias) in found {
        *counts.entry(*bias).or_insert(0) += 1;
    }
    counts
        .iter()
        .map(|(b, n)| format!("{}×{n}", b.map_or_else(|| "none".to_owned(), |b| format!("{b:+}"))))
        .collect::<Vec<_>>()
        .join(" ")
}

const CONVERSIONS: [&str; 4] = ["zoh", "tustin", "foh", "impulse"];

fn conversion(name: &str, feedthrough: Feedthrough) -> Box<dyn Conversion> {
    match name {
        "zoh" => Box::new(ZeroOrderHold {}),
        "tustin" => Box::new(Tustin::default()),
        "foh" => Box::new(FirstOrderHold {}),
        _ => Box::new(ImpulseInvariant { feedthrough }),
    }
}

/// Every cell of the table: dynamics, output, conversion, feedthrough, and the sampled plant of that pair.
fn cells(
    feedthrough: Feedthrough,
    conversions: &[&'static str],
) -> Vec<(String, StateSpace<Sampled>)> {
    let mut cells = Vec::new();
    for dynamics in Dynamics::ALL {
        for (output, channel) in dynamics.outputs().iter().enumerate() {
            for by in conversions {
                let sys = stabilised(dynamics, conversion(by, feedthrough).as_ref())
                    .pair(output, 0)
                    .unwrap();
                cells.push((format!("{} {} {by}", dynamics.name(), channel.0), sys));
            }
        }
    }
    cells
}

/// The bias of a method is the relative degree of the sampled plant in every cell, at every delay and seed.
fn assert_bias_is_the_relative_degree(name: &str, seeds: std::ops::Range<u64>) {
    for (cell, sys) in cells(Feedthrough::Keep, &CONVERSIONS) {
        let degree = sys.relative_degree(0, 0).unwrap();
        let behind_hold =
            cell.ends_with("zoh") && ["p", "q", "r"].contains(&cell.split(' ').nth(1).unwrap());
        assert_eq!(degree, usize::from(behind_hold), "{cell}");
        let found = biases(name, &sys, seeds.clone());
        println!("{name} {cell}: {}", histogram(&found));
        let degree = i64::try_from(degree).unwrap();
        let wrong: Vec<_> = found.iter().filter(|(_, bias)| *bias != Some(degree)).collect();
        assert!(wrong.is_empty(), "{name} {cell}, degree {degree}: (delay, bias) {wrong:?}");
    }
}

#[test]
fn the_bias_of_oestruc_is_the_relative_degree_of_the_sampled_plant() {
    assert_bias_is_the_relative_degree("oestruc", 0..1);
}

#[test]
fn the_bias_of_threshold_is_the_relative_degree_of_the_sampled_plant() {
    // At 5 standard deviations no false crossing in 264 records; 3 of them, as in the thesis, give one in some.
    assert_bias_is_the_relative_degree("threshold", 0..1);
}

#[test]
fn the_bias_of_arxstruc_is_the_relative_degree_of_the_sampled_plant() {
    assert_bias_is_the_relative_degree("arxstruc", 0..1);
}

#[test]
fn without_feedthrough_an_impulse_invariant_plant_shows_oestruc_too_late() {
    for (cell, sys) in cells(Feedthrough::Drop, &["impulse"]) {
        assert_eq!(sys.relative_degree(0, 0), Some(0), "{cell}: the small direct path is there");
        let found = biases("oestruc", &sys, 0..2);
        println!("oestruc {cell}, D dropped: {}", histogram(&found));
        let may = match cell.split(' ').nth(1).unwrap() {
            // The undermodelled B/F (1, 2) is late where the direct path is small and the poles are three.
            "ay" => vec![1],
            "ax" => vec![1, 2],
            _ => vec![0],
        };
        assert!(
            found.iter().all(|(_, bias)| bias.is_some_and(|b| may.contains(&b))),
            "{cell}: {found:?}"
        );
        let seen = biases("threshold", &sys, 0..2);
        assert!(
            seen.iter().all(|(_, bias)| *bias == Some(0)),
            "threshold sees the direct path, {cell}: {seen:?}"
        );
    }
}

#[test]
fn three_standard_deviations_cross_falsely_where_five_do_not() {
    let u = |seed| rbs(1000, 1.0, seed);
    let late = |h_std: f64| {
        let estimator =
            method("threshold").entry.with(serde_json::json!({ "h_std": h_std })).unwrap();
        let wrong = (0..60).filter(|&seed| {
            let y = second_order(&u(seed), 1.0, [-0.5, 0.0], 30);
            let y = sum(&y, &white(1000, 0.01 * std_dev(&y), 500 + seed));
            let found = estimator
                .estimate(&Experiment::siso(ts(TS), u(seed), y).unwrap(), &Search::default())
                .unwrap();
            whole(&found, TS) != Some(30)
        });
        wrong.count()
    };
    let (three, five) = (late(3.0), late(5.0));
    println!("wrong of 60: {three} at 3 standard deviations, {five} at 5");
    // 31 coefficients before the response, each beyond 3 standard deviations in 0.27 % of records: 8 % of records, 4.8 of 60.
    assert!((1..=12).contains(&three), "{three}");
    assert_eq!(five, 0);
}

/// The unstable lateral dynamics behind a zero-order hold and `delay` samples, flown by a state feedback that knows the delay: u and the outputs.
fn flown(delay: usize, samples: usize, seed: u64) -> (Vec<f64>, Vec<Vec<f64>>) {
    let plant = ZeroOrderHold {}.c2d(&Dynamics::Lateral.model(), ts(TS)).unwrap();
    assert!(!plant.is_stable());
    let (n, size) = (plant.order(), plant.order() + delay);
    // States x, u(k − delay) … u(k − 1).
    let (mut a, mut b) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 1));
    a.view_mut((0, 0), (n, n)).copy_from(plant.a());
    if delay == 0 {
        b.copy_from(plant.b());
    } else {
        a.view_mut((0, n), (n, 1)).copy_from(plant.b());
        for i in n..size - 1 {
            a[(i, i + 1)] = 1.0;
        }
        b[(size - 1, 0)] = 1.0;
    }
    let k = dlqr(&a, &b, &DMatrix::identity(size, size), &DMatrix::identity(1, 1), None).unwrap().k;
    let reference = rbs(samples, 0.01, seed);
    let (mut u, mut y) = (Vec::new(), vec![Vec::new(); plant.outputs()]);
    let mut z = DMatrix::zeros(size, 1);
    for r in reference {
        let now = r - (&k * &z)[(0, 0)];
        let acting = if delay == 0 { now } else { z[(n, 0)] };
        let out = plant.c() * z.rows(0, n) + plant.d() * acting;
        u.push(now);
        y.iter_mut().zip(out.iter()).for_each(|(y, v)| y.push(*v));
        z = &a * z + &b * now;
    }
    (u, y)
}

/// Outcomes of a method on the flown unstable plant: found right, found wrong, anything else.
fn flown_outcomes(name: &str, noise: f64) -> [usize; 3] {
    let mut counts = [0; 3];
    for delay in 0..=5 {
        for seed in 0..3 {
            let (u, outputs) = flown(delay, 1000, 10 * seed + 7);
            for (y, degree) in outputs.iter().zip([1, 0]) {
                let y = sum(y, &white(1000, noise * std_dev(y), seed + 90));
                let estimate = answer(
                    method(name),
                    &Experiment::siso(ts(TS), u.clone(), y).unwrap(),
                    &search(degree),
                );
                let at = match (estimate.outcome, whole(&estimate, TS)) {
                    (Outcome::Found, Some(found)) if found == delay => 0,
                    (Outcome::Found, _) => 1,
                    _ => 2,
                };
                counts[at] += 1;
            }
        }
    }
    println!(
        "{name}, {noise} noise: {} right, {} wrong, {} without a delay",
        counts[0], counts[1], counts[2]
    );
    counts
}

#[test]
fn arxstruc_finds_the_delay_of_an_unstable_plant_flown_in_closed_loop() {
    for noise in [0.0, 0.01] {
        assert_eq!(flown_outcomes("arxstruc", noise), [36, 0, 0]);
    }
}

#[test]
fn oestruc_says_no_wrong_delay_of_an_unstable_plant_flown_in_closed_loop() {
    for noise in [0.0, 0.01] {
        let [_, wrong, _] = flown_outcomes("oestruc", noise);
        assert_eq!(wrong, 0, "a delay that is not there, and `found`");
    }
}

#[test]
#[ignore = "nightly: every method over draws"]
fn two_lags_behind_a_hold_do_not_hide_the_delay_from_a_method_that_promises_it() {
    for method in promising(Law::Exact) {
        for noise in [0.0, 0.01] {
            let found: Vec<(usize, Option<DelayEstimate>)> = (0..41_u64)
                .into_par_iter()
                .map(|seed| {
                    // Time constants from half a sample to sixteen samples.
                    let lag_s =
                        |i: u64| 0.05 * 10.0_f64.powf(((seed * 7 + i * 13) % 31) as f64 / 20.0);
                    let (p, q) = (1.0 / lag_s(0), 1.0 / lag_s(1));
                    let m = DMatrix::from_row_slice;
                    let (a, b) = (m(2, 2, &[-(p + q), -p * q, 1.0, 0.0]), m(2, 1, &[1.0, 0.0]));
                    let sys = StateSpace::continuous(a, b, m(1, 2, &[0.0, p * q]), m(1, 1, &[0.0]))
                        .unwrap();
                    let sys = ZeroOrderHold {}.c2d(&sys, ts(TS)).unwrap();
                    let (delay, u) = (seed as usize % 41, rbs(400, 1.0, seed));
                    let y = respond(&sys, std::slice::from_ref(&u), &[delay]).0.remove(0);
                    let y = sum(&y, &white(400, noise * std_dev(&y), seed + 500));
                    let estimate =
                        answer(method, &Experiment::siso(ts(TS), u, y).unwrap(), &search(1));
                    (delay, (!hits(method, &estimate, delay)).then_some(estimate))
                })
                .collect();
            let wrong: Vec<_> = found.iter().filter(|(_, wrong)| wrong.is_some()).collect();
            println!(
                "{} with {noise} noise: {} of {} beyond its tolerance",
                method.entry.name,
                wrong.len(),
                found.len()
            );
            assert!(
                wrong.is_empty(),
                "{}, noise {noise}: (delay, answer) {wrong:?}",
                method.entry.name
            );
        }
    }
}

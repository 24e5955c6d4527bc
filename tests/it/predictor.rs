//! Methods for coloured noise, unstable plants and feedback: what they find where others cannot, and how honest their intervals are.

use crate::support::plants;
use crate::support::plants::{TS, answer, rbs, second_order, std_dev, sum, ts, white};
use deadtime::delay::{
    Experiment, METHODS, Method, Outcome, PlantModel, Recording, Search, StateLeastSquares,
};
use deadtime::model::c2d::{Conversion, ZeroOrderHold};
use deadtime::model::uav::Dynamics;
use deadtime::model::{Sampled, StateSpace, dlqr};
use nalgebra::DMatrix;
use rayon::prelude::*;

fn method(name: &str) -> &'static Method {
    METHODS.iter().find(|m| m.entry.name == name).unwrap()
}

/// x(t+1) = A x + B u(t − d) + K e, y = C x + e in observer form, of a(q) y = b(q) u(t − d) + c(q) e; coefficients from lag 1 on.
struct Loop {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    noise: Vec<f64>,
}

impl Loop {
    fn new(a: &[f64], b: &[f64], c: &[f64]) -> Self {
        let n = a.len();
        let at = |v: &[f64], i: usize| v.get(i).copied().unwrap_or(0.0);
        Self {
            a: DMatrix::from_fn(
                n,
                n,
                |i, j| if j == 0 { -a[i] } else { f64::from(u8::from(j == i + 1)) },
            ),
            b: DMatrix::from_fn(n, 1, |i, _| at(b, i)),
            noise: (0..n).map(|i| at(c, i) - a[i]).collect(),
        }
    }

    /// Flown by a state feedback that knows the delay, K = dlqr(Q = 0.1·I, R = `weight`), plus a dither: u and y.
    fn fly(&self, delay: usize, weight: f64, dither: &[f64], e: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (n, size) = (self.a.nrows(), self.a.nrows() + delay);
        let (mut a, mut b) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 1));
        a.view_mut((0, 0), (n, n)).copy_from(&self.a);
        if delay == 0 {
            b.copy_from(&self.b);
        } else {
            a.view_mut((0, n), (n, 1)).copy_from(&self.b);
            (n..size - 1).for_each(|i| a[(i, i + 1)] = 1.0);
            b[(size - 1, 0)] = 1.0;
        }
        let q = DMatrix::identity(size, size) * 0.1;
        let k = dlqr(&a, &b, &q, &DMatrix::from_element(1, 1, weight), None).unwrap().k;
        let mut z = DMatrix::zeros(size, 1);
        let (mut u, mut y) = (Vec::new(), Vec::new());
        for (r, e) in dither.iter().zip(e) {
            let now = r - (&k * &z)[(0, 0)];
            u.push(now);
            y.push(z[(0, 0)] + e);
            z = &a * z + &b * now;
            (0..n).for_each(|i| z[(i, 0)] += self.noise[i] * e);
        }
        (u, y)
    }
}

fn times_one_minus(root: f64, f: &[f64]) -> Vec<f64> {
    let whole = [&[1.0], f].concat();
    (1..=whole.len()).map(|i| whole.get(i).copied().unwrap_or(0.0) - root * whole[i - 1]).collect()
}

fn in_two_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap().install(work)
}

#[test]
#[ignore = "nightly: drawn loops"]
fn unstable_plants_in_many_loops_are_found_where_simulation_cannot_follow() {
    let colours =
        ["white equation error", "moving average", "white on the output", "slow on the output"];
    let names = ["armaxstruc", "met1struc", "arxstruc", "oestruc"];
    let experiment = |seed: u64| {
        let (fast, slow) = (0.3 + 0.05 * (seed % 10) as f64, 1.01 + 0.01 * (seed % 9) as f64);
        let a = times_one_minus(slow, &[-fast]);
        let b = [0.1, 0.04 * (seed % 3) as f64];
        let mirrored = times_one_minus(1.0 / slow, &[-fast]);
        let (a, b, c) = match seed % 4 {
            0 => (a, b.to_vec(), vec![0.0; 2]),
            1 => (a, b.to_vec(), vec![-0.8, 0.3]),
            2 => (a, b.to_vec(), mirrored),
            _ => {
                let b = times_one_minus(0.7, &[b[1] / b[0]])
                    .iter()
                    .map(|v| v * b[0])
                    .collect::<Vec<_>>();
                (times_one_minus(0.7, &a), [vec![0.1], b].concat(), mirrored)
            }
        };
        let delay = seed as usize % 7;
        let weight = [0.1, 1.0, 10.0][seed as usize % 3];
        let (u, y) = Loop::new(&a, &b, &c).fly(
            delay,
            weight,
            &rbs(600, 1.0, seed),
            &white(600, 0.1, 500 + seed),
        );
        (delay as f64 * TS, Experiment::siso(ts(TS), u, y).unwrap())
    };
    let mut counts = [[[0_usize; 3]; 4]; 4];
    let all: Vec<(usize, Vec<[bool; 3]>)> = in_two_threads(|| {
        (0..120_u64)
            .into_par_iter()
            .map(|seed| {
                let (delay_s, experiment) = experiment(seed);
                let each = names.map(|name| {
                    let e = answer(method(name), &experiment, &Search::default());
                    let held = e
                        .ci95_s
                        .is_some_and(|[from, to]| from - 1e-9 <= delay_s && delay_s <= to + 1e-9);
                    [
                        e.outcome == Outcome::Found && held,
                        e.delay_s.is_some_and(|d| (d - delay_s).abs() < 1e-9),
                        e.outcome != Outcome::Found,
                    ]
                });
                (seed as usize % 4, each.to_vec())
            })
            .collect()
    });
    for (colour, each) in all {
        for (name, answers) in each.iter().enumerate() {
            (0..3).for_each(|i| counts[name][colour][i] += usize::from(answers[i]));
        }
    }
    for (name, counts) in names.iter().zip(&counts) {
        for (colour, [held, exact, without]) in colours.iter().zip(counts) {
            println!(
                "{name}, {colour}: of 30 intervals {held} hold the truth, {exact} delays exact, {without} without a delay"
            );
        }
    }
    let held = |name: usize| counts[name].iter().map(|c| c[0]).sum::<usize>();
    // 114 of 120 are expected; 107 or fewer happen once in 400 draws.
    assert!(held(0) >= 108, "armaxstruc: {} of 120 intervals", held(0));
    assert!(counts[0].iter().all(|c| c[0] >= 25), "{:?}", counts[0]);
    assert!(held(3) <= 60, "oestruc is not for these: {}", held(3));
}

#[test]
#[ignore = "nightly: all delays up to ten"]
fn the_unstable_lateral_dynamics_are_found_within_a_sample_for_delays_up_to_ten() {
    let cases: Vec<(f64, usize, u64)> = [0.1, 0.02]
        .into_iter()
        .flat_map(|t| (0..=10).flat_map(move |d| (0..2).map(move |s| (t, d, s))))
        .collect();
    let names = ["armaxstruc", "met1struc", "arxstruc", "oestruc"];
    let off: Vec<Vec<[Option<f64>; 2]>> = in_two_threads(|| {
        cases
            .par_iter()
            .map(|&(seconds, delay, seed)| {
                let plant = ZeroOrderHold {}.c2d(&Dynamics::Lateral.model(), ts(seconds)).unwrap();
                let n = 1000;
                let dither = rbs(n, 0.01, seed);
                let gusts = white(n, 0.002, 70 + seed);
                let (u, outputs) = flown(&plant, delay, &dither, &gusts);
                names
                    .iter()
                    .map(|name| {
                        [0, 1].map(|output| {
                            let y = sum(
                                &outputs[output],
                                &white(n, 0.01 * std_dev(&outputs[output]), 90 + seed),
                            );
                            let search = Search {
                                bias: vec![vec![1 - output]],
                                min_delay: 1 - output,
                                ..Search::default()
                            };
                            let e = answer(
                                method(name),
                                &Experiment::siso(ts(seconds), u.clone(), y).unwrap(),
                                &search,
                            );
                            if e.outcome != Outcome::Found && *name == "armaxstruc" {
                                println!(
                                    "{seconds} s, {delay} samples, output {output}: {:?}",
                                    e.note
                                );
                            }
                            e.delay_s
                                .filter(|_| e.outcome == Outcome::Found)
                                .map(|d| d / seconds - delay as f64)
                        })
                    })
                    .collect()
            })
            .collect()
    });
    for (at, name) in names.iter().enumerate() {
        let of = |output: usize| off.iter().map(move |each| each[at][output]);
        for (output, channel) in ["p", "ay"].iter().enumerate() {
            let right = of(output).filter(|o| o.is_some_and(|o| o.abs() < 0.5)).count();
            let near = of(output).filter(|o| o.is_some_and(|o| o.abs() < 1.5)).count();
            let none = of(output).filter(Option::is_none).count();
            println!(
                "{name}, {channel}: of 44 delays {right} exact, {near} within a sample, {none} without an answer"
            );
            if at == 0 {
                assert_eq!(
                    near,
                    44,
                    "{channel}: {:?}",
                    cases
                        .iter()
                        .zip(of(output))
                        .filter(|(_, o)| o.is_none_or(|o| o.abs() > 1.5))
                        .collect::<Vec<_>>()
                );
            }
        }
    }
}

/// The sampled plant behind `delay` samples, its input disturbed by gusts, flown by a state feedback that knows the delay: u and the outputs.
fn flown(
    plant: &StateSpace<Sampled>,
    delay: usize,
    dither: &[f64],
    gusts: &[f64],
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let (n, size) = (plant.order(), plant.order() + delay);
    let (mut a, mut b) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 1));
    a.view_mut((0, 0), (n, n)).copy_from(plant.a());
    if delay == 0 {
        b.copy_from(plant.b());
    } else {
        a.view_mut((0, n), (n, 1)).copy_from(plant.b());
        (n..size - 1).for_each(|i| a[(i, i + 1)] = 1.0);
        b[(size - 1, 0)] = 1.0;
    }
    let k = dlqr(&a, &b, &DMatrix::identity(size, size), &DMatrix::identity(1, 1), None).unwrap().k;
    let (mut u, mut y) = (Vec::new(), vec![Vec::new(); plant.outputs()]);
    let mut z = DMatrix::zeros(size, 1);
    for (r, gust) in dither.iter().zip(gusts) {
        let now = r - (&k * &z)[(0, 0)];
        let acting = gust + if delay == 0 { now } else { z[(n, 0)] };
        let out = plant.c() * z.rows(0, n) + plant.d() * acting;
        u.push(now);
        y.iter_mut().zip(out.iter()).for_each(|(y, v)| y.push(*v));
        z = &a * z + &b * now;
        let pushed = plant.b() * *gust;
        (0..n).for_each(|i| z[(i, 0)] += pushed[(i, 0)]);
    }
    (u, y)
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn slow_noise_in_open_loop_leaves_instrumental_variables_honest() {
    let names = ["ivstruc", "armaxstruc", "oestruc"];
    let held = names.map(|name| {
        (0..100_u64)
            .filter(|&seed| {
                let u = rbs(500, 1.0, 40 + seed);
                let delay = seed as usize % 12;
                let y = second_order(&u, 0.1, [-1.5, 0.56], delay);
                let mut slow = white(500, 0.3 * std_dev(&y), 900 + seed);
                (1..500).for_each(|t| slow[t] += 0.9 * slow[t - 1]);
                let e = answer(
                    method(name),
                    &Experiment::siso(ts(TS), u, sum(&y, &slow)).unwrap(),
                    &Search::default(),
                );
                let truth = delay as f64 * TS;
                e.outcome == Outcome::Found
                    && e.ci95_s.is_some_and(|[from, to]| from - 1e-9 <= truth && truth <= to + 1e-9)
            })
            .count()
    });
    println!("of 100 intervals under slow noise hold the truth: {names:?} {held:?}");
    assert!(held[0] >= 89 && held[1] >= 89, "{held:?}");
}

/// Two inputs that push one state alike, behind 3 and 8 samples.
fn two_pushes(left: Vec<f64>, right: Vec<f64>) -> Experiment<'static> {
    let m = DMatrix::from_row_slice;
    let (a, b) = (m(2, 2, &[0.8, 0.1, -0.1, 0.6]), m(2, 2, &[1.0, 0.7, 0.5, 0.35]));
    let plant =
        StateSpace::sampled(a, b, m(1, 2, &[1.0, 0.0]), DMatrix::zeros(1, 2), ts(TS)).unwrap();
    let inputs = vec![left, right];
    let (y, x) = plants::respond(&plant, &inputs, &[3, 8]);
    let states = x
        .iter()
        .zip(0..)
        .map(|(x, seed)| sum(x, &white(x.len(), 0.01 * std_dev(x), 70 + seed)).into())
        .collect();
    let inputs = inputs.into_iter().map(Into::into).collect();
    let recording = Recording { inputs, outputs: y.into_iter().map(Into::into).collect(), states };
    let experiment = Experiment::new(
        ts(TS),
        vec!["left".into(), "right".into()],
        vec!["y".into()],
        vec![recording],
    )
    .unwrap();
    experiment.with_model(PlantModel::Sampled(plant))
}

#[test]
fn state_least_squares_says_when_inputs_move_together() {
    let n = 800;
    let left = rbs(n, 1.0, 1);
    let outcomes = |right: Vec<f64>| {
        let experiment = two_pushes(left.clone(), right);
        let answers = method("state_least_squares")
            .entry
            .with(serde_json::json!({}))
            .unwrap()
            .estimate_inputs(&experiment, &Search::default())
            .unwrap();
        let angle =
            StateLeastSquares::default().coefficients(&experiment, 35).map(|c| c.angle_deg[0]).ok();
        println!(
            "{angle:?} {:?}",
            answers.iter().map(|a| (a.outcome, a.delay_s, &a.note)).collect::<Vec<_>>()
        );
        (answers, angle)
    };
    // Inputs of their own are told apart.
    let (own, angle) = outcomes(rbs(n, 1.0, 2));
    assert!(angle.unwrap() > 30.0);
    assert!(
        own.iter()
            .zip([0.3, 0.8])
            .all(|(e, d)| e.outcome == Outcome::Found && (e.delay_s.unwrap() - d).abs() < 0.01)
    );
    // The same input twice, and one that is the other's copy some samples later, are not.
    for same in [left.clone(), plants::delayed(&left, 4)] {
        let (answers, _) = outcomes(same);
        assert!(answers.iter().all(|e| e.outcome == Outcome::Singular
            && e.note.as_ref().unwrap().contains("moves with the others")));
    }
    // Nearly the same: told apart or not, never wrong, and the reader knows why.
    for share in [0.3, 0.1, 0.03, 0.01, 0.001] {
        let right = sum(&left, &plants::times(&rbs(n, 1.0, 3), share));
        let (answers, angle) = outcomes(right);
        for (e, truth) in answers.iter().zip([0.3, 0.8]) {
            assert!(e.delay_s.is_none_or(|d| (d - truth).abs() < 0.1), "{share}: {e:?}");
            let shown = !e.outcome.has_delay()
                || e.note.as_ref().unwrap().contains("angle")
                || angle.unwrap() > 5.0;
            assert!(shown, "{share}: {e:?}");
        }
    }
}

#[test]
fn arxstruc_with_the_other_input_as_regressor_finds_two_delays_of_correlated_inputs() {
    let n = 800;
    let wrong = |others: &str| {
        let wrong = (0..30_u64).filter(|&seed| {
            // The right input follows the left one two samples later, with a part of its own.
            let left = rbs(n, 1.0, seed);
            let right =
                sum(&plants::delayed(&left, 2), &plants::times(&rbs(n, 1.0, 100 + seed), 0.7));
            let (near, far) = (seed as usize % 5, 5 + seed as usize % 9);
            let y = sum(
                &second_order(&left, 0.3, [-1.3, 0.42], far),
                &second_order(&right, 0.5, [-1.3, 0.42], near),
            );
            let y = sum(&y, &white(n, 0.05 * std_dev(&y), 200 + seed));
            let recording = Recording {
                inputs: vec![left.into(), right.into()],
                outputs: vec![y.into()],
                states: Vec::new(),
            };
            let experiment = Experiment::new(
                ts(TS),
                vec!["left".into(), "right".into()],
                vec!["y".into()],
                vec![recording],
            )
            .unwrap();
            let estimator =
                method("arxstruc").entry.with(serde_json::json!({ "others": others })).unwrap();
            let right = |at: usize, truth: usize| {
                let seen = experiment.towards(at, 0).unwrap();
                plants::whole(&estimator.estimate(&seen, &Search::default()).unwrap(), TS)
                    == Some(truth)
            };
            !(right(0, far) && right(1, near))
        });
        wrong.count()
    };
    let (apart, together) = (wrong("apart"), wrong("regressors"));
    println!(
        "of 30 records with one delay or both wrong: {apart} pair by pair, {together} together"
    );
    assert!(apart >= 15 && together <= 2, "{apart} {together}");
}

//! Methods for coloured noise, unstable plants and feedback: what they find where others cannot, and how honest their intervals are.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "support/plants.rs"]
mod plants;

use deadtime::delay::{Experiment, METHODS, Method, Search};
use plants::{TS, answer, rbs, second_order, std_dev, sum, ts, white};

fn method(name: &str) -> &'static Method {
    METHODS.iter().find(|m| m.entry.name == name).unwrap()
}

#[test]
#[ignore = "prints times"]
fn times_of_the_methods() {
    for (n, runs) in [(500, 5), (1_000_000, 1)] {
        for seed in 0..runs {
            let u = rbs(n, 1.0, 11 + seed);
            let y = second_order(&u, 0.4, [-1.3, 0.42], 4);
            let noise = white(n, 0.1 * std_dev(&y), 12 + seed);
            let experiment = Experiment::siso(ts(TS), u, sum(&y, &noise));
            for name in ["oestruc", "arxstruc", "armaxstruc", "met1struc", "ivstruc"] {
                if METHODS.iter().all(|m| m.entry.name != name) {
                    continue;
                }
                let clock = std::time::Instant::now();
                let found = answer(method(name), &experiment, &Search::default());
                println!("{n} {name}: {:.1} ms {:?} {:?}", 1e3 * clock.elapsed().as_secs_f64(), found.delay_s, found.note);
            }
        }
    }
}

#[test]
#[ignore = "looks"]
fn look() {
    use plants::delayed;
    let search = Search { max_delay: 45, bias: vec![vec![1]], ..Search::default() };
    let (seed, noise) = (17_u64, 0.01);
    {
        use deadtime::model::{
            StateSpace,
            c2d::{Conversion, ZeroOrderHold},
        };
        let lag_s = |i: u64| 0.05 * 10.0_f64.powf(((seed * 7 + i * 13) % 31) as f64 / 20.0);
        let (p, q) = (1.0 / lag_s(0), 1.0 / lag_s(1));
        let m = nalgebra::DMatrix::from_row_slice;
        let (a, b) = (m(2, 2, &[-(p + q), -p * q, 1.0, 0.0]), m(2, 1, &[1.0, 0.0]));
        let sys = StateSpace::continuous(a, b, m(1, 2, &[0.0, p * q]), m(1, 1, &[0.0])).unwrap();
        let sys = ZeroOrderHold {}.c2d(&sys, ts(TS)).unwrap();
        let u = rbs(400, 1.0, seed);
        let y = plants::respond(&sys, std::slice::from_ref(&u), &[17]).0.remove(0);
        let y = sum(&y, &white(400, noise * std_dev(&y), seed + 500));
        println!("{:?}", answer(method("armaxstruc"), &Experiment::siso(ts(TS), u, y), &search));
    }
    for seed in 0..100_u64 {
        let more = 1 + seed as usize * 7 % 25;
        let pole = 0.08 * (seed % 11) as f64;
        let u = rbs(400, 1.0, seed);
        let clean = second_order(&u, 0.05 + seed as f64 / 10.0, [-pole, 0.0], seed as usize % 10);
        let noise = white(400 + more, 0.02 * std_dev(&clean), seed + 1000);
        let found = |y: Vec<f64>| answer(method("armaxstruc"), &Experiment::siso(ts(TS), u.clone(), y), &search);
        let (a, b) = (found(sum(&clean, &noise[more..])), found(sum(&delayed(&clean, more), &noise[..400])));
        for (e, truth) in [(a, seed as usize % 10), (b, seed as usize % 10 + more)] {
            if plants::whole(&e, TS) != Some(truth) {
                println!("{seed} pole {pole}: {truth} {:?} {:?} {:?}", e.delay_s, e.ci95_s, e.note);
            }
        }
    }
}

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

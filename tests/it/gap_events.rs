//! `deadtime gap` on machines that become others at a time: two parameters change together. The machine is integrated here, not by the program.

use deadtime::diagnose::{FoundEffect, GapOptions, diagnose};
use deadtime::log::Log;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::gap_hard::{as_log, commands, document, noisy, servo};

const TS: f64 = 0.02;
const SUBSTEPS: u32 = 20;

/// Stiffness and damping, 1/s² and 1/s.
type Numbers = [f64; 2];

/// A log of a servo whose numbers are others from a time on.
fn logged(samples: usize, seed: u64, [before, later]: [Numbers; 2], time_s: f64) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let u = commands(samples, &mut rng);
    let step = TS / f64::from(SUBSTEPS);
    let (mut state, mut outputs) = ([0.0, 0.0], [Vec::new(), Vec::new()]);
    for (k, target) in u.iter().enumerate() {
        outputs.iter_mut().zip(state).for_each(|(y, x)| y.push(x));
        for part in 0..SUBSTEPS {
            let now_s = TS * k as f64 + step * f64::from(part);
            let [stiffness, damping] = if now_s < time_s - 1e-9 { before } else { later };
            let rate = |[x, v]: [f64; 2]| [v, stiffness * (target - x) - damping * v];
            let by = |d: [f64; 2], h: f64| [state[0] + h * d[0], state[1] + h * d[1]];
            let a = rate(state);
            let b = rate(by(a, 0.5 * step));
            let c = rate(by(b, 0.5 * step));
            let d = rate(by(c, step));
            state = by([0, 1].map(|i| (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]) / 6.0), step);
        }
    }
    let outputs: Vec<Vec<f64>> = outputs.into_iter().map(|y| noisy(y, &mut rng)).collect();
    let times = (0..samples).map(|k| TS * k as f64).collect();
    as_log(&format!("log{seed}.csv"), times, &u, &outputs)
}

/// The interval, stretched to the tolerance of a single draw.
fn holds(found: &FoundEffect, place: usize, truth: f64) -> bool {
    let p = &found.parameters[place];
    let (value, std) = (p.value.unwrap(), p.std.unwrap());
    (value - truth).abs() < 3.5 * std
}

#[test]
fn two_parameters_that_change_together_have_one_time() {
    let mut rng = ChaCha8Rng::seed_from_u64(61);
    for seed in [6100, 6110] {
        // Whole steps of the integration.
        let step = TS / f64::from(SUBSTEPS);
        let time_s = (rng.random_range(6.0..11.0) / step).round() * step;
        let before = [9.0, 2.4];
        let later =
            [before[0] * rng.random_range(0.6..0.8), before[1] * rng.random_range(0.6..0.8)];
        let log = |samples, seed| logged(samples, seed, [before, later], time_s);
        let (logs, held) = ([log(900, seed), log(900, seed + 1)], [log(900, seed + 2)]);
        let model = document(&servo(", initial_std = 0.02", ""));
        let d = diagnose(&model, &logs, &held, &GapOptions::default(), &|_| ()).unwrap().diagnosis;
        let mut found = d.cause.effects.clone();
        found.sort_by(|a, b| b.channel.cmp(&a.channel));
        let keys: Vec<String> =
            found.iter().map(|e| format!("{}:{}", e.effect, e.channel)).collect();
        assert_eq!(keys, ["parameter_jump:stiffness", "parameter_jump:damping"], "{seed}");
        for (at, e) in found.iter().enumerate() {
            assert!(holds(e, 0, before[at]) && holds(e, 2, later[at]), "{seed} {e:?}");
            assert!(holds(e, 1, time_s), "{time_s} {e:?}");
            assert_eq!(e.parameters[1], found[0].parameters[1]);
        }
    }
}

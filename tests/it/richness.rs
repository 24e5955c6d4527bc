//! The predicted standard deviation of a delay beside the errors that are made.

use crate::support::plants;
use crate::support::plants::{TS, answer, process, rng, std_dev, sum, ts, white};
use deadtime::delay::{Experiment, Method, Outcome, Search, method, richness};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::Rbs;
use rand::RngExt;
use rayon::prelude::*;

fn predicted(experiment: &Experiment, name: &str) -> Option<f64> {
    let methods: [&Method; 1] = [method(name).unwrap()];
    richness(experiment, &Search::default(), &methods).unwrap()[0].map(|r| r.std_s / TS)
}

/// A plant of two real poles, an input and a noise level, drawn; its records differ by noise and by the fraction of the delay.
struct Case {
    lags_s: [f64; 2],
    u: Vec<f64>,
    noise: f64,
    delay: f64,
}

fn case(seed: u64) -> Case {
    let mut rng = rng(seed);
    let slow = TS * 10.0_f64.powf(rng.random_range(0.0..1.2));
    let u = match seed % 3 {
        0 => Rbs::default().generate(500, &mut rng).unwrap(),
        1 => Rbs { band: [0.0, 0.2], ..Rbs::default() }.generate(500, &mut rng).unwrap(),
        _ => {
            let mut level = 0.0;
            (0..500)
                .map(|t| {
                    if t % 60 == 30 {
                        level = if level > 0.0 { -1.0 } else { 1.0 };
                    }
                    level
                })
                .collect()
        }
    };
    Case {
        lags_s: [slow, slow * rng.random_range(0.05..0.9)],
        u,
        noise: 10.0_f64.powf(rng.random_range(-2.0..0.0)),
        delay: rng.random_range(3.0..20.0_f64).floor(),
    }
}

#[test]
#[ignore = "nightly: drawn spreads"]
fn what_is_predicted_is_what_happens() {
    let draws = 8_u64;
    for name in ["oestruc", "p2d"] {
        let mut ratios: Vec<(f64, f64, u64)> = (0..36_u64)
            .into_par_iter()
            .filter_map(|seed| {
                let case = case(seed);
                let (mut errors, mut expected) = (Vec::new(), Vec::new());
                for draw in 0..draws {
                    let fraction = (draw as f64 + 0.5) / draws as f64;
                    let y = process(&case.u, &case.lags_s, None, (case.delay + fraction) * TS, TS);
                    let y = sum(&y, &white(500, case.noise * std_dev(&y), 1000 * seed + draw));
                    let experiment = Experiment::siso(ts(TS), case.u.clone(), y).unwrap();
                    let e = answer(method(name).unwrap(), &experiment, &Search::default());
                    if e.outcome == Outcome::Found {
                        errors.push(e.delay_s.unwrap() / TS - case.delay - fraction);
                        expected.extend(predicted(&experiment, name));
                    }
                }
                // Where most records give no answer there is nothing to compare.
                if 2 * errors.len() < draws as usize || expected.is_empty() {
                    return None;
                }
                let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
                expected.sort_by(f64::total_cmp);
                Some((expected[expected.len() / 2] / rms, rms, seed))
            })
            .collect();
        ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize].0;
        let [low, median, high] = [0.05, 0.5, 0.95].map(at);
        println!(
            "{name}: predicted over actual RMS error in {} plants: 5 % {low:.2}, median {median:.2}, 95 % {high:.2}",
            ratios.len()
        );
        println!("   lowest {:?} highest {:?}", &ratios[..4], &ratios[ratios.len() - 4..]);
        assert!(
            ratios.len() >= 24 && (0.5..2.0).contains(&median),
            "{name}: {median} of {} plants",
            ratios.len()
        );
    }
}

#[test]
fn a_poor_input_shows_before_any_method_runs() {
    let number = |u: &[f64]| {
        let y = process(u, &[0.5, 0.2], None, 0.7, TS);
        let y = sum(&y, &white(u.len(), 0.05, 3));
        let experiment = Experiment::siso(ts(TS), u.to_vec(), y).unwrap();
        ["p2d", "threshold", "p1d"].map(|m| predicted(&experiment, m).unwrap())
    };
    let rich = number(&plants::rbs(500, 1.0, 2));
    let ramp: Vec<f64> = (0..500).map(|t| f64::from(t) / 500.0 - 0.5).collect();
    let sine: Vec<f64> =
        (0..500).map(|t| (2.0 * std::f64::consts::PI * 0.01 * f64::from(t)).sin()).collect();
    let (ramp, sine) = (number(&ramp), number(&sine));
    println!(
        "samples, p2d, threshold and p1d: binary {rich:.3?}, ramp {ramp:.3?}, sine {sine:.3?}"
    );
    assert!(rich[0] < 0.3 && ramp[0] > 20.0 * rich[0] && sine[0] > 20.0 * rich[0]);
    assert!(
        ramp[0] > 1.0 && sine[0] > 1.0 && ramp[1] > 5.0 && sine[1] > 5.0,
        "neighbouring delays are not told apart"
    );
}

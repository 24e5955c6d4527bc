//! Laws of identified models over drawn records with a known truth.

use std::path::Path;

use deadtime_signal::decompositions::eigenvalues;
use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::matching::{Matching, Target};
use crate::rival::polynomial;
use crate::subspace::{
    Identified, Identifier, Moesp, N4sid, Named, Pbsidopt, Recordings, Settings, Stretch,
};
use crate::transfer::Riv;
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{Continuous, ModelDocument, StateSpace, TransferFunction};
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::time::SampleTime;

const RECORDS: u64 = 20;

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn recordings(u: Vec<f64>, y: Vec<f64>, sample_time_s: f64) -> Recordings {
    let named = |name: &str| vec![Named { name: name.to_owned(), unit: None }];
    Recordings {
        sample_time: SampleTime::new(sample_time_s).unwrap(),
        inputs: named("u"),
        outputs: named("y"),
        stretches: vec![Stretch {
            u: DMatrix::from_vec(1, u.len(), u),
            y: DMatrix::from_vec(1, y.len(), y),
        }],
    }
}

/// x⁺ = pole·x + u + k·e, y = gain·x + e from rest, with white u and e of standard deviation `noise`.
fn first_order(pole: f64, [gain, k, noise]: [f64; 3], samples: usize, seed: u64) -> Recordings {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut u, mut y, mut x) = (Vec::new(), Vec::new(), 0.0);
    for _ in 0..samples {
        let e = noise * normal(&mut rng);
        y.push(gain * x + e);
        u.push(normal(&mut rng));
        x = pole * x + u[u.len() - 1] + k * e;
    }
    recordings(u, y, 1.0)
}

fn identified(method: &dyn Identifier, data: &Recordings) -> Identified {
    method.identify(data, &HowFar::default()).unwrap()
}

/// The mean of a slow plant's record differs from its rest. The noise enters the state (A − KC = 0), partly the state, or the output alone.
#[test]
fn a_slow_pole_lies_within_its_interval_whatever_the_mean_of_the_record() {
    for (pole, k) in [(0.99, 0.198), (0.99, 0.1), (0.99, 0.0), (0.95, 0.0), (0.6, 0.0)] {
        let off = |seed: u64| {
            let data = first_order(pole, [5.0, k, 0.01], 500, seed);
            let settings = Settings { order: Some(1), ..Settings::default() };
            let found = identified(&Pbsidopt(settings), &data).poles()[0];
            (found.re - pole) / found.std_re.unwrap()
        };
        let off: Vec<f64> = parallel::map(0..RECORDS, off);
        let inside = off.iter().filter(|z| z.abs() < 2.0).count();
        // 95 % of 20: fewer than 16 in less than one of 300 such tests.
        assert!(inside >= 16, "{pole}, {k}: {inside} of {RECORDS}: {off:.2?}");
        assert!(off.iter().all(|z| z.abs() < 5.0), "{pole}, {k}: {off:.2?}");
    }
}

/// Errors of an unstable predictor grow without bounds.
#[test]
fn every_predictor_forgets_its_start_also_that_of_an_unstable_plant() {
    for seed in 0..RECORDS {
        let data = first_order(1.01, [1.0, 0.0, 0.1], 500, seed);
        let settings = Settings { draws: 0, ..Settings::default() };
        let methods: [&dyn Identifier; 3] =
            [&N4sid(settings.clone()), &Moesp(settings.clone()), &Pbsidopt(settings)];
        for method in methods {
            let found = identified(method, &data);
            let model = &found.model;
            let kept = eigenvalues(&(&model.a - &model.k * &model.c));
            assert!(kept.iter().all(|p| p.norm() < 1.0), "{} {seed}: {kept:?}", found.method);
            let fit = found.check(&data)[0].one_step.unwrap().nrmse;
            assert!(fit < 0.1, "{} {seed}: {fit}", found.method);
        }
    }
}

/// (−6400 s + 1600)/(s⁴ + 5 s³ + 408 s² + 416 s + 1600) every 10 ms. The input is a PRBS of ten stages with bits of seven samples.
///
/// Source: Rao and Garnier (2002), "Numerical illustrations of the relevance of direct continuous-time model identification", IFAC World Congress.
fn rao_garnier(decibel: f64, seed: u64) -> Recordings {
    let tf = TransferFunction::from_polynomials(
        &[-6400.0, 1600.0],
        &[1.0, 5.0, 408.0, 416.0, 1600.0],
        0.0,
        Continuous,
    );
    let plant = tf.unwrap().to_state_space().unwrap();
    let sampled = ZeroOrderHold {}.c2d(&plant, SampleTime::new(0.01).unwrap()).unwrap();
    let mut register = [true; 10];
    let mut u = Vec::new();
    for _ in 0..1023 {
        u.extend([if register[9] { 1.0 } else { -1.0 }; 7]);
        let next = register[9] != register[6];
        register.rotate_right(1);
        register[0] = next;
    }
    let mut x = DVector::zeros(4);
    let clean: Vec<f64> = u
        .iter()
        .map(|u| {
            let y = (sampled.c() * &x)[0];
            x = sampled.a() * &x + sampled.b() * *u;
            y
        })
        .collect();
    let power = clean.iter().map(|y| y * y).sum::<f64>() / clean.len() as f64;
    let noise = (power * 10f64.powf(-decibel / 10.0)).sqrt();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let y = clean.iter().map(|y| y + noise * normal(&mut rng)).collect();
    recordings(u, y, 0.01)
}

#[test]
fn refined_instrumental_variables_end_at_the_plant_of_fast_samples() {
    let decibel = 10.0;
    for seed in 0..4 {
        let data = rao_garnier(decibel, seed);
        let riv = Riv { nf: 4, nb: 4, nk: Some(vec![1]), draws: 0, ..Riv::default() };
        let found = identified(&riv, &data).check(&data)[0].simulation.unwrap().nrmse;
        // The residual share of the measured output that the noise causes.
        let floor = (1.0 / (1.0 + 10f64.powf(decibel / 10.0))).sqrt();
        assert!(found < 1.05 * floor, "{seed}: {found} of {floor}");
    }
}

/// Fast sampling: poorly determined directions have neither bias nor too small standard deviations.
#[test]
#[ignore = "nightly: a rate over draws"]
fn transfer_functions_of_fast_samples_have_no_bias() {
    let tf = TransferFunction::from_polynomials(
        &[-6400.0, 1600.0],
        &[1.0, 5.0, 408.0, 416.0, 1600.0],
        0.0,
        Continuous,
    );
    let plant = tf.unwrap().to_state_space().unwrap();
    let sampled = ZeroOrderHold {}.c2d(&plant, SampleTime::new(0.01).unwrap()).unwrap();
    let truth = polynomial(sampled.poles().iter().copied());
    for decibel in [20.0, 40.0] {
        let one = |seed: u64| -> Vec<f64> {
            let riv = Riv { nf: 4, nb: 4, nk: Some(vec![1]), draws: 0, ..Riv::default() };
            let found = identified(&riv, &rao_garnier(decibel, seed)).parametric.unwrap();
            let f = found.parameters.iter().filter(|p| p.name.starts_with('f'));
            f.zip(&truth).map(|(p, truth)| (p.value - truth) / p.std.unwrap()).collect()
        };
        let off: Vec<Vec<f64>> = parallel::map(0..RECORDS, one);
        for k in 0..truth.len() {
            let mean = off.iter().map(|z| z[k]).sum::<f64>() / RECORDS as f64;
            // Four standard deviations of the mean.
            assert!(mean.abs() < 4.0 / (RECORDS as f64).sqrt(), "{decibel} dB, f{}: {mean}", k + 1);
            let inside = off.iter().filter(|z| z[k].abs() < 1.96).count();
            assert!(inside >= 16, "{decibel} dB, f{}: {inside} of {RECORDS}", k + 1);
        }
    }
}

/// Twenty sines with periods of at least ten samples: lags beyond the first few are below the noise.
#[test]
fn lags_that_the_noise_leaves_undetermined_are_counted() {
    for seed in 0..4 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let sines = sines(20, 200.0, 1000, &mut rng);
        let white: Vec<f64> = (0..1000).map(|_| normal(&mut rng)).collect();
        let of = |u: Vec<f64>, rng: &mut ChaCha8Rng| {
            let mut clean = vec![0.0; 1000];
            for t in 3..1000 {
                clean[t] = u[t - 1] + 2.2 * clean[t - 1] - 1.75 * clean[t - 2] + 0.5 * clean[t - 3];
            }
            let size = (clean.iter().map(|y| y * y).sum::<f64>() / 1000.0).sqrt();
            let y = clean.iter().map(|y| y + 0.01 * size * normal(rng)).collect();
            let settings = Settings { draws: 0, order: Some(3), ..Settings::default() };
            identified(&Pbsidopt(settings), &recordings(u, y, 1.0)).notes.join(" ")
        };
        let said = of(sines, &mut rng);
        assert!(said.contains("lags of the past window"), "{seed}: {said}");
        let said = of(white, &mut rng);
        assert!(!said.contains("lags of the past window"), "{seed}: {said}");
    }
}

/// Σ of sines with drawn phases, of the period `period` and its divisors.
fn sines(lines: usize, period: f64, samples: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let phases: Vec<f64> = (0..lines).map(|_| normal(rng) * 6.0).collect();
    let one = |t: usize, k: usize| {
        (std::f64::consts::TAU * ((k + 1) * t) as f64 / period + phases[k]).sin()
    };
    (0..samples).map(|t| (0..lines).map(|k| one(t, k)).sum()).collect()
}

/// Lightly damped arms under sines far below the Nyquist frequency: the past determines the states poorly, their observability matrix well.
#[test]
fn moesp_predicts_free_runs_of_resonances_that_few_lines_excite() {
    for seed in 0..6 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let damping: Vec<f64> = (0..2).map(|_| 0.98 + 0.015 * rng.random::<f64>()).collect();
        let angles = [0.1 + 0.1 * rng.random::<f64>(), 0.3 + 0.1 * rng.random::<f64>()];
        let pair = |k: usize| nalgebra::Complex::from_polar(damping[k], angles[k]);
        let a = polynomial((0..2).flat_map(|k| [pair(k), pair(k).conj()]));
        let u = sines(90, 1000.0, 1000, &mut rng);
        let mut clean = vec![0.0; 1000];
        for t in 4..1000 {
            clean[t] = u[t - 1] + 0.3 * u[t - 2];
            clean[t] -= (0..4).map(|k| a[k] * clean[t - 1 - k]).sum::<f64>();
        }
        let size = (clean.iter().map(|y| y * y).sum::<f64>() / 1000.0).sqrt();
        let noise = 0.03 * size;
        let y = clean.iter().map(|y| y + noise * normal(&mut rng)).collect();
        let (first, second) = recordings(u, y, 1.0).split(0.5);
        let moesp = Moesp(Settings { draws: 0, ..Settings::default() });
        let found = identified(&moesp, &first).check(&second)[0].simulation.unwrap().nrmse;
        let floor = noise / second.stretches[0].y.variance().sqrt();
        assert!(found < 1.5 * floor, "{seed}: {found} of {floor}");
    }
}

/// Noise of the state or of the output, white and slow inputs: the order is the plant's, or one fewer where noise hides a state.
#[test]
fn orders_do_not_exceed_the_plant() {
    let found = |seed: u64| -> Vec<usize> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let poles: Vec<f64> =
            (0..3).map(|k| 0.25 + 0.25 * f64::from(k) + 0.1 * rng.random::<f64>()).collect();
        let a = polynomial(poles.iter().map(|p| nalgebra::Complex::new(*p, 0.0)));
        let u: Vec<f64> = (0..800).map(|_| normal(&mut rng)).collect();
        let mut clean = vec![0.0; 800];
        for t in 3..800 {
            clean[t] = u[t - 1] - 0.4 * u[t - 2];
            clean[t] -= (0..3).map(|k| a[k] * clean[t - 1 - k]).sum::<f64>();
        }
        let y: Vec<f64> = clean.iter().map(|y| y + 0.01 * normal(&mut rng)).collect();
        let data = recordings(u, y, 1.0);
        let settings = Settings { draws: 0, ..Settings::default() };
        let methods: [&dyn Identifier; 3] =
            [&N4sid(settings.clone()), &Moesp(settings.clone()), &Pbsidopt(settings)];
        methods.iter().map(|m| identified(*m, &data).model.order()).collect()
    };
    let all: Vec<usize> = parallel::map(0..RECORDS, found).into_iter().flatten().collect();
    // Schwarz's criterion and free runs each err in a few of a hundred records.
    let right = all.iter().filter(|n| **n == 3).count();
    assert!(right * 10 >= all.len() * 9, "{all:?}");
}

/// Parameters of `COUPLED`, and their true values.
const COUPLED_VALUES: [(&str, f64); 6] =
    [("a", 0.5), ("b", 1.0), ("c", 2.0), ("d", 3.0), ("e", 1.2), ("f", 5.0)];
const COUPLED: &str = r#"format = "deadtime/model@1"
name = "coupled"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "y1" }, { name = "y2" }]
[states]
v = {}
w = {}
[derivatives]
v = "-a*v + b*w + c*u"
w = "-d*v - e*w + f*u"
[output_equations]
y1 = "v"
y2 = "w"
[parameters]
"#;

/// The identification report of the coupled plant from a drawn record.
fn coupled_target(samples: usize, noise: f64, rng: &mut ChaCha8Rng) -> Target {
    let [a, b, c, d, e, f] = COUPLED_VALUES.map(|(_, v)| v);
    let plant = StateSpace::continuous(
        DMatrix::from_row_slice(2, 2, &[-a, b, -d, -e]),
        DMatrix::from_row_slice(2, 1, &[c, f]),
        DMatrix::identity(2, 2),
        DMatrix::zeros(2, 1),
    );
    let sample_time = SampleTime::new(0.05).unwrap();
    let sampled = ZeroOrderHold {}.c2d(&plant.unwrap(), sample_time).unwrap();
    let (mut u, mut y) = (DMatrix::zeros(1, samples), DMatrix::zeros(2, samples));
    let (mut x, mut level) = (DVector::zeros(2), 1.0);
    for t in 0..samples {
        level = if normal(rng) > 1.0 { -level } else { level };
        u[(0, t)] = level;
        y.set_column(t, &(&x + DVector::from_fn(2, |_, _| noise * normal(rng))));
        x = sampled.a() * &x + sampled.b() * level;
    }
    let named = |names: &[&str]| -> Vec<Named> {
        names.iter().map(|n| Named { name: (*n).to_owned(), unit: None }).collect()
    };
    let record = Recordings {
        sample_time,
        inputs: named(&["u"]),
        outputs: named(&["y1", "y2"]),
        stretches: vec![Stretch { u, y }],
    };
    let found = identified(&Pbsidopt(Settings { order: Some(2), ..Settings::default() }), &record);
    let rows = |m: &DMatrix<f64>| -> Vec<Vec<f64>> {
        m.row_iter().map(|r| r.iter().copied().collect()).collect()
    };
    let model = &found.model;
    let report = serde_json::json!({
        "format": "deadtime/identify@1", "sample_time_s": 0.05, "rows": found.rows,
        "inputs": found.inputs, "outputs": found.outputs, "input_delay_s": [0.0],
        "model": {
            "A": rows(&model.a), "B": rows(&model.b), "C": rows(&model.c), "D": rows(&model.d),
            "operating": { "inputs": [0.0], "outputs": [0.0, 0.0] },
            "deviations": found.deviations(),
        },
    });
    Target::from_identify(&report.to_string(), Path::new("report.json")).unwrap()
}

/// File values that are correct, off by a common share, by drawn shares, or by factors. The spread of largest evidence matches them, and the determined
/// parameters are found.
#[test]
#[ignore = "nightly: a rate over draws"]
fn the_prior_of_a_match_is_as_wide_as_the_files_values_are_off() {
    for (samples, noise) in [(2000, 0.02), (400, 0.2)] {
        let mut rng = ChaCha8Rng::seed_from_u64(samples as u64);
        let target = coupled_target(samples, noise, &mut rng);
        for share in [0.0, 0.4 / 1.4, -0.4 / 0.6, 2.0 / 3.0, -2.0, 0.2, 0.8] {
            let drawn = share == 0.2 || share == 0.8;
            let shares: Vec<f64> = (0..6)
                .map(|_| if drawn { (share * normal(&mut rng)).max(-0.8) } else { -share })
                .collect();
            // The relative errors of the file's values.
            let values: Vec<f64> =
                COUPLED_VALUES.iter().zip(&shares).map(|((_, v), s)| v / (1.0 + s)).collect();
            let lines = COUPLED_VALUES.iter().zip(&values);
            let lines: Vec<String> =
                lines.map(|((name, _), v)| format!("{name} = {{ value = {v:?} }}")).collect();
            let text = format!("{COUPLED}{}", lines.join("\n"));
            let file = ModelDocument::from_toml(&text, Path::new("coupled.toml")).unwrap();
            let ModelDocument::Equations(file) = file else { panic!("equations") };
            let matching = Matching { free: vec!["all".to_owned()], ..Matching::default() };
            let found = matching.fit(&file, &target).unwrap();
            let size = (shares.iter().map(|s| s * s).sum::<f64>() / 6.0).sqrt().max(0.1);
            let prior = found.prior.unwrap();
            assert!(
                prior > size / 3.0 && prior < 3.0 * size,
                "{samples} {share}: {prior} of {size}"
            );
            for (p, (name, truth)) in found.parameters.iter().zip(COUPLED_VALUES) {
                let off = (p.value - truth) / p.std.unwrap();
                assert!(off.abs() < 4.5, "{samples} {share} {name}: {off} standard deviations");
            }
        }
    }
}

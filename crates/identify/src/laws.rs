//! Laws of identified models over drawn records whose truth is known.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::subspace::{
    Identified, Identifier, Moesp, N4sid, Named, Pbsidopt, Recordings, Settings, Stretch,
};
use crate::transfer::Riv;
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{Continuous, TransferFunction};
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

/// x⁺ = pole·x + u + k·e, y = gain·x + e from rest, white u, e of the standard deviation `noise`.
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

/// The mean of a slow plant's record is where it happened to be, not where it rests. The predictor, A − KC = 0, remembers one sample.
#[test]
fn a_slow_pole_lies_within_its_interval_whatever_the_mean_of_the_record() {
    let mut inside = 0;
    for seed in 0..RECORDS {
        let data = first_order(0.99, [5.0, 0.198, 0.01], 500, seed);
        let settings = Settings { order: Some(1), ..Settings::default() };
        let pole = identified(&Pbsidopt(settings), &data).poles()[0];
        let off = (pole.re - 0.99).abs() / pole.std_re.unwrap();
        assert!(off < 5.0, "{seed}: {off} standard deviations, {pole:?}");
        inside += u64::from(off < 2.0);
    }
    // 95 % of 20: fewer than 16 in less than one of three hundred such tests.
    assert!(inside >= 16, "{inside} of {RECORDS}");
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
            let kept = (&model.a - &model.k * &model.c).complex_eigenvalues();
            assert!(kept.iter().all(|p| p.norm() < 1.0), "{} {seed}: {kept}", found.method);
            let fit = found.check(&data)[0].one_step.unwrap().nrmse;
            assert!(fit < 0.1, "{} {seed}: {fit}", found.method);
        }
    }
}

/// (−6400 s + 1600)/(s⁴ + 5 s³ + 408 s² + 416 s + 1600) every 10 ms, its input a PRBS of ten stages whose bits last seven samples.
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
        // What the noise leaves of the measured output.
        let floor = (1.0 / (1.0 + 10f64.powf(decibel / 10.0))).sqrt();
        assert!(found < 1.05 * floor, "{seed}: {found} of {floor}");
    }
}

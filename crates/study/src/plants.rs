//! Plants of published studies, by name.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use deadtime_delay::PlantModel;
use deadtime_model::uav::{self, Dynamics};
use deadtime_model::{Continuous, ModelError, StateSpace, TransferFunction};

/// A plant without its dead time, and the names of its channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// Its dynamics.
    pub model: PlantModel,
    /// Input names.
    pub inputs: Vec<String>,
    /// Output names.
    pub outputs: Vec<String>,
}

/// A line of the list of plants.
pub struct PlantEntry {
    /// The name that plans use.
    pub name: &'static str,
    /// Its summary.
    pub summary: &'static str,
    /// Another one for every trial.
    pub random: bool,
    build: fn(&mut ChaCha8Rng) -> Result<Plant, ModelError>,
}

impl PlantEntry {
    /// The plant; `rng` is used by random ones alone.
    ///
    /// # Errors
    /// The error of matrices that are no model.
    pub fn build(&self, rng: &mut ChaCha8Rng) -> Result<Plant, ModelError> {
        (self.build)(rng)
    }
}

/// One plant of fixed dynamics.
macro_rules! plant {
    ($name:literal, $summary:literal, $build:expr) => {
        PlantEntry { name: $name, summary: $summary, random: false, build: |_| $build }
    };
}

/// Every plant. Those of Björklund (2003), LiU-TEK-LIC-2003:60, pp. 69-77 and 111, are in seconds and without their 9 s of dead time.
pub const PLANTS: &[PlantEntry] = &[
    plant!("lateral", "the thesis' lateral dynamics, unstable", Ok(vehicle(Dynamics::Lateral))),
    plant!(
        "longitudinal",
        "the thesis' longitudinal dynamics, unstable",
        Ok(vehicle(Dynamics::Longitudinal))
    ),
    plant!("directional", "the thesis' directional dynamics", Ok(vehicle(Dynamics::Directional))),
    plant!("vertical", "the thesis' vertical dynamics", Ok(vehicle(Dynamics::Vertical))),
    plant!("vehicle", "the thesis' vehicle: four inputs, six outputs, unstable", Ok(whole())),
    plant!(
        "slow2",
        "Björklund's G1, 1/((10s + 1)(s + 1))",
        rational(&[0.1], &[[0.1, 0.0], [1.0, 0.0]])
    ),
    plant!(
        "fast2",
        "Björklund's G2, 1/((s + 1)(0.1s + 1))",
        rational(&[10.0], &[[1.0, 0.0], [10.0, 0.0]])
    ),
    plant!(
        "real4",
        "Björklund's G5, 0.05(s + 0.9)(s + 0.4)/((s + 1)(s + 0.6)(s + 0.3)(s + 0.1))",
        rational(&[0.05, 0.065, 0.018], &[[1.0, 0.0], [0.6, 0.0], [0.3, 0.0], [0.1, 0.0]])
    ),
    plant!(
        "cplx4",
        "Björklund's G6, (s + 0.9)(s + 0.4)/36 over poles at 0.1·(−1 ± i)/√2 and (−1 ± i)/√2",
        rational(&[1.0 / 36.0, 1.3 / 36.0, 0.01], &[[0.1 * HALF, 0.1 * HALF], [HALF, HALF]])
    ),
    plant!("slow1", "Björklund's G7, 1/(10s + 1)", rational(&[0.1], &[[0.1, 0.0]])),
    plant!("fast1", "Björklund's G8, 1/(s + 1)", rational(&[1.0], &[[1.0, 0.0]])),
    plant!("gain", "Björklund's G9, a dead time alone", rational(&[1.0], &[])),
    plant!(
        "slow2b",
        "Björklund's G1b, half of slow2",
        rational(&[0.05], &[[0.1, 0.0], [1.0, 0.0]])
    ),
    plant!(
        "fast2b",
        "Björklund's G2b, half of fast2",
        rational(&[5.0], &[[1.0, 0.0], [10.0, 0.0]])
    ),
    plant!(
        "mixer",
        "3/((10s + 1)(s + 1)) of `a` and 1/(s + 1) of `b` add up to one output",
        mixer()
    ),
    plant!("unrelated", "an output that does not follow its input: noise alone", silent()),
    plant!("pole_1.00", "1/(s(s + 0.5)): sampled every second, a pole at z = 1", pole(1.0)),
    plant!(
        "pole_1.02",
        "1/((s − ln 1.02)(s + 0.5)): sampled every second, a pole at z = 1.02",
        pole(1.02)
    ),
    plant!("pole_1.05", "the same at z = 1.05", pole(1.05)),
    plant!("pole_1.10", "the same at z = 1.1", pole(1.1)),
    plant!("pole_1.20", "the same at z = 1.2", pole(1.2)),
    plant!("pole_1.30", "the same at z = 1.3", pole(1.3)),
    PlantEntry {
        name: "random10",
        summary: "ten real poles and complex pairs drawn anew for every trial, rates around 1 rad/s, one system in ten with an integrator",
        random: true,
        build: random,
    },
];

const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn names(list: &[(&str, &str)]) -> Vec<String> {
    list.iter().map(|(name, _)| (*name).to_owned()).collect()
}

fn vehicle(dynamics: Dynamics) -> Plant {
    Plant {
        model: PlantModel::Continuous(dynamics.model()),
        inputs: vec![dynamics.input().to_owned()],
        outputs: names(dynamics.outputs()),
    }
}

fn whole() -> Plant {
    Plant {
        model: PlantModel::Continuous(uav::model()),
        inputs: Dynamics::ALL.iter().map(|d| d.input().to_owned()).collect(),
        outputs: Dynamics::ALL.iter().flat_map(|d| names(d.outputs())).collect(),
    }
}

fn single(model: Result<StateSpace<Continuous>, ModelError>) -> Result<Plant, ModelError> {
    Ok(Plant {
        model: PlantModel::Continuous(model?),
        inputs: vec!["u".to_owned()],
        outputs: vec!["y".to_owned()],
    })
}

/// Two inputs, one output.
fn mixer() -> Result<Plant, ModelError> {
    let model = StateSpace::continuous(
        DMatrix::from_row_slice(3, 3, &[-0.1, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0]),
        DMatrix::from_row_slice(3, 2, &[0.3, 0.0, 0.0, 0.0, 0.0, 1.0]),
        DMatrix::from_row_slice(1, 3, &[0.0, 1.0, 1.0]),
        DMatrix::zeros(1, 2),
    )?;
    Ok(Plant {
        model: PlantModel::Continuous(model),
        inputs: vec!["a".to_owned(), "b".to_owned()],
        outputs: vec!["y".to_owned()],
    })
}

/// 0/(s + 1).
fn silent() -> Result<Plant, ModelError> {
    let one = |v: f64| DMatrix::from_element(1, 1, v);
    single(StateSpace::continuous(one(-1.0), one(1.0), one(0.0), one(0.0)))
}

/// A lag of 2 s and a pole at `z` when sampled every second.
fn pole(z: f64) -> Result<Plant, ModelError> {
    rational(&[1.0], &[[-z.ln(), 0.0], [0.5, 0.0]])
}

/// Numerator coefficients, highest power first, over factors: [a, 0] is s + a, [a, b] is (s + a)² + b².
fn rational(numerator: &[f64], factors: &[[f64; 2]]) -> Result<Plant, ModelError> {
    let denominator = factors.iter().fold(vec![1.0], |all, &[a, b]| {
        let factor = if b == 0.0 { vec![1.0, a] } else { vec![1.0, 2.0 * a, a * a + b * b] };
        product(&all, &factor)
    });
    single(
        TransferFunction::from_polynomials(numerator, &denominator, 0.0, Continuous)?
            .to_state_space(),
    )
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// Ten poles in parallel. Björklund (2003), p. 111, calls his stable or integrating, the words of MATLAB's manual on `rss`; ours are therefore drawn as there.
/// One of ten systems has an integrator, and about half of the other poles come in pairs. Rates are log-normal around 1 rad/s, frequencies around 3 rad/s,
/// input and output matrices normal. Ours have no direct path and no repeated poles.
fn random(rng: &mut ChaCha8Rng) -> Result<Plant, ModelError> {
    const ORDER: usize = 10;
    let (mut a, b, c) = (
        DMatrix::zeros(ORDER, ORDER),
        DMatrix::from_fn(ORDER, 1, |_, _| normal(rng)),
        DMatrix::from_fn(1, ORDER, |_, _| normal(rng)),
    );
    // The first pole stays at 0 in one of ten.
    let mut at = usize::from(rng.random_bool(0.1));
    while at < ORDER {
        let rate = normal(rng).exp();
        a[(at, at)] = -rate;
        // A third of the draws are pairs: half of the poles.
        if at + 1 < ORDER && rng.random_bool(1.0 / 3.0) {
            let frequency = 3.0 * normal(rng).exp();
            a[(at + 1, at + 1)] = -rate;
            a[(at, at + 1)] = frequency;
            a[(at + 1, at)] = -frequency;
            at += 1;
        }
        at += 1;
    }
    single(StateSpace::continuous(a, b, c, DMatrix::zeros(1, 1)))
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn random_systems_are_stable_or_integrate_and_have_ten_poles() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut integrators = 0;
        for _ in 0..400 {
            let PlantModel::Continuous(model) = random(&mut rng).unwrap().model else {
                panic!("sampled")
            };
            assert_eq!(model.order(), 10);
            let real: Vec<f64> = deadtime_signal::decompositions::eigenvalues(model.a())
                .iter()
                .map(|p| p.re)
                .collect();
            let at_zero = real.iter().filter(|re| re.abs() < 1e-12).count();
            assert!(real.iter().all(|re| *re < 1e-12) && at_zero <= 1, "{real:?}");
            integrators += at_zero;
        }
        // 40 expected; four standard deviations of a binomial count.
        assert!((16..=64).contains(&integrators), "{integrators}");
    }
}

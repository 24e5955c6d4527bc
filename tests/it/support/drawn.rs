//! Random stable plants, inputs and dead times with a noise-free record of each, and what of them decides which method can be exact.

use deadtime::model::c2d::{
    Conversion, FirstOrderHold, ImpulseInvariant, LeastSquares, Tustin, ZeroOrderHold,
    ZeroPoleMatching,
};
use deadtime::model::{Continuous, Sampled, StateSpace, TransferFunction};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::{Multisine, Phase, Prbs, Rbs, RegisterStart};
use deadtime::signal::fractional_delay;
use nalgebra::{Complex, DMatrix};
use proptest::prelude::*;

use super::plants::{process, respond, rng, ts, white};

/// Samples of a record.
pub(crate) const SAMPLES: usize = 420;
/// Longest dead time that is injected.
pub(crate) const LONGEST: f64 = 40.0;

pub(crate) const CONVERSIONS: [&str; 6] =
    ["zoh", "foh", "impulse", "tustin", "matched", "least_squares"];

fn conversion(name: &str) -> Box<dyn Conversion> {
    match name {
        "zoh" => Box::new(ZeroOrderHold {}),
        "foh" => Box::new(FirstOrderHold {}),
        "impulse" => Box::new(ImpulseInvariant::default()),
        "tustin" => Box::new(Tustin::default()),
        "matched" => Box::new(ZeroPoleMatching::default()),
        _ => Box::new(LeastSquares { grid: 60 }),
    }
}

/// A real pole or zero, or a pair.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Root {
    Real(f64),
    /// Real and imaginary part of the upper one.
    Pair(f64, f64),
}

impl Root {
    fn count(self) -> usize {
        if matches!(self, Self::Real(_)) { 1 } else { 2 }
    }

    fn all(roots: &[Self]) -> Vec<Complex<f64>> {
        let each = |r: &Self| match *r {
            Self::Real(v) => vec![Complex::new(v, 0.0)],
            Self::Pair(re, im) => vec![Complex::new(re, im), Complex::new(re, -im)],
        };
        roots.iter().flat_map(each).collect()
    }
}

/// What moves the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Input {
    /// Random binary, white.
    Binary,
    /// Gaussian, white.
    Gaussian,
    /// A register's sequence, begun anywhere.
    Register,
    /// All lines up to the Nyquist frequency, random phases.
    Multisine,
    /// Random binary in the band from 0 to 0.4 of the Nyquist frequency.
    Slow,
    /// Squares of Gaussian numbers less their mean.
    Skewed,
    /// One step from rest and back, long enough to settle.
    Steps,
}

impl Input {
    pub(crate) fn generate(self, seed: u64) -> Vec<f64> {
        let mut rng = rng(seed);
        match self {
            Self::Binary => Rbs::default().generate(SAMPLES, &mut rng).unwrap(),
            Self::Gaussian => white(SAMPLES, 1.0, seed),
            Self::Register => Prbs { order: 9, start: RegisterStart::Random, ..Prbs::default() }
                .generate(SAMPLES, &mut rng)
                .unwrap(),
            Self::Multisine => Multisine { phase: Phase::Random, ..Multisine::default() }
                .generate(SAMPLES, &mut rng)
                .unwrap(),
            Self::Slow => {
                Rbs { band: [0.0, 0.4], ..Rbs::default() }.generate(SAMPLES, &mut rng).unwrap()
            }
            Self::Skewed => white(SAMPLES, 1.0, seed).iter().map(|v| v * v - 1.0).collect(),
            Self::Steps => {
                (0..SAMPLES).map(|t| if (40..230).contains(&t) { 1.0 } else { 0.0 }).collect()
            }
        }
    }

    /// Its samples are independent of each other, or as good as.
    pub(crate) fn is_white(self) -> bool {
        matches!(
            self,
            Self::Binary | Self::Gaussian | Self::Register | Self::Multisine | Self::Skewed
        )
    }
}

/// How a plant comes about.
#[derive(Debug, Clone)]
pub(crate) enum Kind {
    /// A copy of the input, nothing else.
    Copy,
    /// Continuous poles and zeros in samples⁻¹, sampled by one of the six conversions.
    Converted { poles: Vec<Root>, zeros: Vec<Root>, by: &'static str },
    /// Real time constants and perhaps a zero's, samples, behind a hold: integrated between the samples.
    Lags { lags: Vec<f64>, zero: Option<f64> },
    /// Poles and zeros in the z plane, and so many more poles than zeros.
    Direct { poles: Vec<Root>, zeros: Vec<Root>, degree: usize },
}

#[derive(Debug, Clone)]
pub(crate) struct Recipe {
    pub(crate) kind: Kind,
    pub(crate) gain: f64,
    pub(crate) input: Input,
    /// Samples.
    pub(crate) delay: f64,
    pub(crate) seed: u64,
}

/// A plant's record and what it is.
#[derive(Debug)]
pub(crate) struct Drawn {
    pub(crate) recipe: Recipe,
    pub(crate) u: Vec<f64>,
    pub(crate) y: Vec<f64>,
    /// Relative degree of the sampled plant without its dead time.
    pub(crate) degree: usize,
    /// Response to a pulse of one sample, its dead time in it.
    pub(crate) h: Vec<f64>,
    /// First coefficient of it that is not rounding.
    pub(crate) first: usize,
    /// Poles away from z = 0, and numerator coefficients from the first on.
    pub(crate) order: usize,
    pub(crate) coefficients: usize,
    /// A zero of the sampled plant outside the unit circle.
    pub(crate) outside: bool,
}

/// Below this share of the largest a coefficient is rounding.
const ROUNDING: f64 = 1e-10;

fn pulse() -> Vec<f64> {
    (0..SAMPLES).map(|t| f64::from(u8::from(t == 0))).collect()
}

impl Recipe {
    pub(crate) fn is_whole(&self) -> bool {
        self.delay.fract() == 0.0
    }

    /// The sampled plant with this dead time; `None` where there is none (a pole that a conversion cannot have, an impulse between two samples).
    fn plant(&self, delay: f64) -> Option<StateSpace<Sampled>> {
        match &self.kind {
            Kind::Copy | Kind::Lags { .. } => None,
            Kind::Converted { poles, zeros, by } => {
                // Unit gain at frequency 0.
                let product = |roots: &[Root]| {
                    Root::all(roots).iter().map(|r| -r).product::<Complex<f64>>().re
                };
                let gain = self.gain * product(poles) / product(zeros);
                let tf = TransferFunction::from_zeros_poles_gain(
                    Root::all(zeros),
                    Root::all(poles),
                    gain,
                    delay,
                    Continuous,
                )
                .ok()?;
                conversion(by).c2d(&tf.to_state_space().ok()?, ts(1.0)).ok()
            }
            Kind::Direct { poles, zeros, degree } => {
                // Poles at 0 make the relative degree what was drawn.
                let (finite, free) = (
                    poles.iter().map(|p| p.count()).sum::<usize>(),
                    zeros.iter().map(|z| z.count()).sum::<usize>(),
                );
                let mut all = Root::all(poles);
                all.extend(vec![Complex::new(0.0, 0.0); (free + degree).saturating_sub(finite)]);
                let mut origin = Root::all(zeros);
                origin.extend(vec![Complex::new(0.0, 0.0); finite.saturating_sub(free + degree)]);
                let sampled = Sampled(ts(1.0));
                let tf =
                    TransferFunction::from_zeros_poles_gain(origin, all, self.gain, 0, sampled)
                        .ok()?;
                tf.to_state_space().ok()?.with_input_delay(vec![delay as usize]).ok()
            }
        }
    }

    /// Time constants as the poles and zeros that a zero-order hold samples: the same plant, for what its zeros are.
    fn behind_hold(&self) -> Option<Self> {
        let Kind::Lags { lags, zero } = &self.kind else { return None };
        let real = |lag: &f64| Root::Real(-1.0 / lag);
        let kind = Kind::Converted {
            poles: lags.iter().map(real).collect(),
            zeros: zero.iter().map(real).collect(),
            by: "zoh",
        };
        Some(Self { kind, ..self.clone() })
    }

    /// The response of the continuous plant and its dead time at these frequencies, rad a sample; `None` where there is no such plant.
    pub(crate) fn frequency_response(&self, omega: &[f64]) -> Option<Vec<Complex<f64>>> {
        let Kind::Converted { poles, zeros, .. } = &self.kind else { return None };
        let (poles, zeros) = (Root::all(poles), Root::all(zeros));
        let at = |w: f64| {
            let s = Complex::new(0.0, w);
            // Unit gain at frequency 0, as above.
            let up: Complex<f64> = zeros.iter().map(|z| 1.0 - s / z).product();
            let down: Complex<f64> = poles.iter().map(|p| 1.0 - s / p).product();
            up / down * self.gain * Complex::cis(-w * self.delay)
        };
        Some(omega.iter().map(|w| at(*w)).collect())
    }

    /// A zero of the continuous plant in the right half-plane.
    pub(crate) fn goes_backwards(&self) -> bool {
        matches!(&self.kind, Kind::Converted { zeros, .. } if Root::all(zeros).iter().any(|z| z.re > 0.0))
    }

    /// The record, or `None` where the conversion refuses the plant.
    pub(crate) fn record(&self) -> Option<Drawn> {
        let u = self.input.generate(self.seed);
        let plant = self.plant(self.delay);
        let of = |u: &[f64]| match &self.kind {
            Kind::Copy => {
                Some(fractional_delay(u, self.delay).iter().map(|v| self.gain * v).collect())
            }
            Kind::Lags { lags, zero } => {
                let y: Vec<f64> = process(u, lags, *zero, self.delay, 1.0);
                Some(y.iter().map(|v| self.gain * v).collect())
            }
            _ => plant.as_ref().map(|p| respond(p, &[u.to_vec()], p.input_delay()).0.remove(0)),
        };
        let (y, h): (Vec<f64>, Vec<f64>) = (of(&u)?, of(&pulse())?);
        let largest = h.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let first = h.iter().position(|v| v.abs() > ROUNDING * largest)?;
        let (degree, order, coefficients, outside) = match &self.kind {
            Kind::Copy => (0, 0, 1, false),
            _ => {
                let twin = self.behind_hold();
                let twin = twin.as_ref().unwrap_or(self);
                let plant = twin.plant(self.delay)?;
                let degree = if self.is_whole() {
                    plant.relative_degree(0, 0)?
                } else {
                    twin.plant(0.0)?.relative_degree(0, 0)?
                };
                let tf = plant.transfer_function(0, 0).ok()?.cancelled(1e-9);
                let counts = |c: &[f64]| {
                    let largest = c.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                    let far = |v: &f64| v.abs() > 1e-9 * largest;
                    c.iter().rposition(far).unwrap_or(0) - c.iter().position(far).unwrap_or(0)
                };
                let outside = tf.zeros().iter().any(|z| z.norm() > 1.0 - 1e-6);
                (degree, counts(&tf.denominator()), 1 + counts(&tf.numerator()), outside)
            }
        };
        Some(Drawn { recipe: self.clone(), u, y, degree, h, first, order, coefficients, outside })
    }
}

impl Drawn {
    /// The first coefficient's share of the largest.
    pub(crate) fn onset(&self) -> f64 {
        self.h[self.first].abs() / self.h.iter().fold(0.0_f64, |m, v| m.max(v.abs()))
    }

    /// The share of the response's size beyond `lags` lags.
    pub(crate) fn beyond(&self, lags: usize) -> f64 {
        let norm = |h: &[f64]| h.iter().map(|v| v * v).sum::<f64>().sqrt();
        norm(&self.h[lags.min(self.h.len())..]) / norm(&self.h)
    }
}

fn signed() -> impl Strategy<Value = f64> {
    (0.2..5.0_f64, any::<bool>()).prop_map(|(g, up)| if up { g } else { -g })
}

/// A continuous pole, samples⁻¹: a time constant of 0.7 to 6 samples, or a pair of 0.3 to 1.2 rad per sample with a damping ratio of 0.3 to 0.9.
fn pole() -> impl Strategy<Value = Root> {
    prop_oneof![
        2 => (0.7_f64.ln()..6.0_f64.ln()).prop_map(|l| Root::Real(-(-l).exp())),
        1 => (0.3..1.2_f64, 0.3..0.9_f64).prop_map(|(w, z)| Root::Pair(-z * w, w * (1.0 - z * z).sqrt())),
    ]
}

/// A continuous zero on either side of the axis.
fn zero() -> impl Strategy<Value = Root> {
    prop_oneof![
        3 => (0.25..2.0_f64, any::<bool>()).prop_map(|(v, left)| Root::Real(if left { -v } else { v })),
        1 => (0.3..1.2_f64, 0.3..0.9_f64, any::<bool>()).prop_map(|(w, z, left)| Root::Pair(if left { -z * w } else { z * w }, w * (1.0 - z * z).sqrt())),
    ]
}

/// Zeros, as many as keep the relative degree between 0 and 4.
fn fitting(poles: Vec<Root>, mut zeros: Vec<Root>) -> (Vec<Root>, Vec<Root>) {
    let order: usize = poles.iter().map(|p| p.count()).sum();
    let mut left = order;
    zeros.retain(|z| {
        let fits = z.count() <= left;
        left -= if fits { z.count() } else { 0 };
        fits
    });
    (poles, zeros)
}

fn converted() -> impl Strategy<Value = Kind> {
    (
        prop::collection::vec(pole(), 1..=3),
        prop::collection::vec(zero(), 0..=3),
        0..CONVERSIONS.len(),
    )
        .prop_map(|(mut poles, zeros, by)| {
            poles.truncate(if poles.iter().map(|p| p.count()).sum::<usize>() > 4 { 2 } else { 3 });
            let (poles, zeros) = fitting(poles, zeros);
            Kind::Converted { poles, zeros, by: CONVERSIONS[by] }
        })
}

fn direct() -> impl Strategy<Value = Kind> {
    let pole = prop_oneof![
        2 => (-0.5..0.85_f64).prop_map(Root::Real),
        1 => (0.2..0.8_f64, 0.2..2.8_f64).prop_map(|(r, a)| Root::Pair(r * a.cos(), r * a.sin())),
    ];
    let zero = prop_oneof![
        (0.1..0.8_f64, any::<bool>()).prop_map(|(v, up)| Root::Real(if up { v } else { -v })),
        (1.25..3.0_f64, any::<bool>()).prop_map(|(v, up)| Root::Real(if up { v } else { -v })),
        (0.3..0.8_f64, 0.3..2.8_f64).prop_map(|(r, a)| Root::Pair(r * a.cos(), r * a.sin())),
    ];
    (prop::collection::vec(pole, 1..=2), prop::collection::vec(zero, 0..=2), 0..=4_usize)
        .prop_map(|(poles, zeros, degree)| Kind::Direct { poles, zeros, degree })
}

fn lags() -> impl Strategy<Value = Kind> {
    let lag = (1.0_f64.ln()..8.0_f64.ln()).prop_map(f64::exp);
    (prop::collection::vec(lag, 1..=3), prop::option::weighted(0.4, 0.3..3.0_f64), 0..4_u8)
        .prop_map(|(mut lags, zero, equal)| {
            if equal == 0 {
                let first = lags[0];
                lags.fill(first);
            }
            Kind::Lags { lags, zero }
        })
}

/// Any plant, input and dead time; every second dead time is whole.
pub(crate) fn recipe() -> impl Strategy<Value = Recipe> {
    let kind = prop_oneof![4 => converted(), 3 => direct(), 3 => lags(), 2 => Just(Kind::Copy)];
    let input = prop_oneof![
        3 => Just(Input::Binary), 2 => Just(Input::Gaussian), 1 => Just(Input::Register), 1 => Just(Input::Multisine), 1 => Just(Input::Slow),
        1 => Just(Input::Skewed), 1 => Just(Input::Steps),
    ];
    (kind, signed(), input, 0.0..LONGEST, any::<bool>(), 0..1_000_000_u64).prop_map(
        |(kind, gain, input, delay, whole, seed)| {
            // A plant that is sampled already has no fraction.
            let whole = whole || matches!(kind, Kind::Direct { .. });
            Recipe { kind, gain, input, delay: if whole { delay.round() } else { delay }, seed }
        },
    )
}

/// A plant, its two inputs, its outputs and its states.
type WithStates = (StateSpace<Sampled>, [Vec<f64>; 2], Vec<Vec<f64>>, Vec<Vec<f64>>);

/// For the methods that see states: a plant whose two inputs come behind their own delays.
pub(crate) fn with_states(seed: u64, delays: [usize; 2]) -> WithStates {
    let draw = white(12, 1.0, seed);
    let n = 2 + (seed % 3) as usize;
    let mut a = DMatrix::from_fn(n, n, |i, j| 0.4 * draw[(3 * i + j) % 12] / n as f64);
    for i in 0..n {
        a[(i, i)] += 0.75 - 0.15 * i as f64;
    }
    let b = DMatrix::from_fn(n, 2, |i, j| {
        draw[(5 * j + 2 * i + 1) % 12] + if i == j { 1.5 } else { 0.0 }
    });
    let c = DMatrix::from_fn(1, n, |_, j| if j == 0 { 1.0 } else { 0.0 });
    let plant = StateSpace::sampled(a, b, c, DMatrix::zeros(1, 2), ts(1.0)).unwrap();
    let inputs = [white(SAMPLES, 1.0, seed + 1), Input::Binary.generate(seed + 2)];
    let (y, x) = respond(&plant, &inputs, &delays);
    (plant, inputs, y, x)
}

//! The fraction of a sample from the zero of a sampled first-order plant.
//!
//! Equation: y = (b₁ + b₂q⁻¹)/(1 − p·q⁻¹) u(t − nk), z₀ = −b₂/b₁, β = −ln(p)/Ts. L = β⁻¹·ln((1 − z₀/p)/(1 − z₀)), τ̂ = Ts·nk + L.

use nalgebra::DVector;

use super::profile::{OeScan, Profile, Weighing, check};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{
    Basis, Condition, Information, Law, Method, ReferenceExperiment, Start, method_line,
};
use crate::posterior;
use deadtime_identify::{Initial, OeFit, OutputError};
use deadtime_signal::stats::NORMAL_95;

/// Inputs: u, y on one even grid, u held between samples. Output: seconds, positive = y lags u, a fraction of a sample included.
///
/// Assumes: one lag and a dead time behind a zero-order hold, open loop, a record that starts at rest (or `initial: estimated`).
/// Resolution and cost: a fraction of a sample, with a standard deviation by the delta method; one output-error scan (nb 2, nf 1).
/// Fails when: the plant has more lags: they add to the delay, and a note reports a zero that one lag cannot have. A lag shorter than about a sample reveals no
/// fraction: the estimate is the whole delay, the interval the whole sample. An input that ramps between samples moves the zero. Otherwise as
/// [`super::oestruc::Oestruc`].
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, p. 57, for the formula. The source gives no uncertainty, and no rule for a zero that no dead time within a
/// sample can have. Here it is moved to the nearest end of the sample. The whole delay is also left open: here it has the smallest loss, or an equivalent loss
/// and a possible zero.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, SamplingZero, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// // Time constant 5 samples, dead time 4.3: the held input acts for 0.7 of the first sample.
/// let p = (-0.2_f64).exp();
/// let (b1, b2) = (1.0 - p.powf(0.7), p.powf(0.7) - p);
/// let mut y = vec![0.0; 400];
/// for t in 6..400 {
///     y[t] = p * y[t - 1] + b1 * u[t - 5] + b2 * u[t - 6];
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = SamplingZero::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.43).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingZero {
    /// The initial state of a record; default at rest.
    pub initial: Initial,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the loss changes little.
    pub max_samples: usize,
}

impl Default for SamplingZero {
    fn default() -> Self {
        Self { initial: Initial::Zero, max_samples: 100_000 }
    }
}

const NAME: &str = "sampling_zero";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    reference: ReferenceExperiment::Process { poles: 1, zero: false },
    information: Information::Poles(1),
    basis: Basis::OutputError,
    tolerance: 0.1,
    withstands: &[Condition::ColouredNoise, Condition::MissingOutputs],
    needs: "one lag longer than a sample, a held input, open loop, rest at the start",
    blind_to: "a second lag, which it takes for delay; the fraction where the lag is short",
    exempt: &[(Law::Exact, "it models one lag and takes any other for dead time")],
    ..method_line!(
        "sampling_zero",
        "fraction of a sample from the zero of a first-order model: closed form, for one lag and a dead time",
        SamplingZero,
        Parametric
    )
};

impl PairMethod for SamplingZero {
    fn check(&self) -> Result<(), DelayError> {
        check(NAME, &self.orders(), self.max_samples)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let orders = self.orders();
        let scan = OeScan { name: NAME, orders, max_samples: self.max_samples };
        let profile = scan.profile(pair, Weighing::Best)?;
        let Some(ZeroReading { raw, std, interval, note }) = read(&orders, &profile) else {
            let note = "numerator and pole are indistinguishable on this record";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        let at_edge = raw + 0.5 >= as_f64(pair.max_delay);
        let estimate = pair.counted_at(raw, std, interval, at_edge);
        Ok(estimate.noting(profile.note).noting(note))
    }
}

impl SamplingZero {
    fn orders(&self) -> OutputError {
        OutputError { nb: 2, nf: 1, initial: self.initial }
    }
}

fn as_f64(count: usize) -> f64 {
    count as f64
}

/// A delay in samples, whole and fraction.
struct ZeroReading {
    raw: f64,
    std: f64,
    interval: [f64; 2],
    note: Option<String>,
}

/// A delay with a fit near the best, and the reading of its zero.
struct Fraction {
    nk: usize,
    weight: f64,
    /// The fraction by the formula, and its standard deviation; `None` where the zero determines none.
    fraction: Option<(f64, f64)>,
    /// The first coefficient is significant.
    begins: bool,
}

impl Fraction {
    fn new(orders: &OutputError, profile: &Profile, nk: usize, fit: &OeFit) -> Option<Self> {
        let (&[b1, b2], &[f1]) = (fit.b.as_slice(), fit.f.as_slice()) else { return None };
        let covariance = orders.covariance(&profile.records, nk, &fit.f)? * profile.per_independent;
        let at = [b1, b2, -f1];
        // Relative step of 5e-7: far above rounding, far below the formula's nonlinearity.
        let slope = |i: usize| {
            let size = if i == 2 { 1.0 } else { b1.abs() + b2.abs() };
            let step = 5e-7 * at[i].abs().max(1e-3 * size);
            let moved = |by: f64| {
                let mut at = at;
                at[i] += by;
                fraction(at)
            };
            // The covariance is that of f₁ = −p.
            Some((moved(step)? - moved(-step)?) / (2.0 * step) * if i == 2 { -1.0 } else { 1.0 })
        };
        let resolved = || {
            let slopes = DVector::from_vec((0..3).map(slope).collect::<Option<Vec<f64>>>()?);
            let variance = (&covariance * &slopes).dot(&slopes);
            let value = fraction(at)?;
            // A fraction less certain than a uniform one within the sample is dropped.
            (value.is_finite() && (0.0..posterior::RESOLUTION).contains(&variance))
                .then(|| (value, variance.sqrt()))
        };
        Some(Self {
            nk,
            weight: profile.posterior.weights.get(nk).copied().unwrap_or(0.0),
            fraction: resolved(),
            begins: b1 * b1 > 9.0 * covariance[(0, 0)],
        })
    }

    /// The distance of the fraction from the sample.
    fn outside(&self) -> Option<f64> {
        self.fraction.map(|(l, _)| (-l).max(l - 1.0).max(0.0))
    }

    fn delay(&self) -> f64 {
        as_f64(self.nk) + self.fraction.map_or(0.0, |(l, _)| l.clamp(0.0, 1.0))
    }
}

/// L/Ts from b₁, b₂ and p; `None` where no first-order plant behind a hold has these coefficients.
fn fraction([b1, b2, p]: [f64; 3]) -> Option<f64> {
    let ratio = (p * b1 + b2) / (p * (b1 + b2));
    (p > 0.0 && p < 1.0 && ratio > 0.0).then(|| ratio.ln() / -p.ln()).filter(|l| l.is_finite())
}

/// Delays with less than this share of the best one's probability are skipped.
const SHARE: f64 = 0.05;

fn read(orders: &OutputError, profile: &Profile) -> Option<ZeroReading> {
    let weights = &profile.posterior.weights;
    let least = SHARE * weights.get(profile.posterior.best)?;
    let candidates: Vec<Fraction> = (profile.fits.iter().enumerate())
        .filter(|(nk, _)| weights.get(*nk).is_some_and(|w| *w >= least))
        .filter_map(|(nk, fit)| Fraction::new(orders, profile, nk, fit.as_ref()?))
        .collect();
    let [from, to] = profile.posterior.ends;
    let possible = candidates
        .iter()
        .filter_map(|c| Some((c, c.outside()?)))
        .min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.weight.total_cmp(&a.0.weight)));
    if let Some((chosen, outside)) = possible
        && let Some((l, std)) = chosen.fraction
    {
        let total: f64 = candidates.iter().map(|c| c.weight).sum();
        let raw = chosen.delay();
        let spread: f64 =
            candidates.iter().map(|c| c.weight / total * (c.delay() - raw).powi(2)).sum();
        let ends =
            [as_f64(chosen.nk) + l - NORMAL_95 * std, as_f64(chosen.nk) + l + NORMAL_95 * std];
        let interval = [ends[0].max(from).min(raw), ends[1].min(to + 1.0).max(raw)];
        let note = (outside > NORMAL_95 * std + 0.01).then(|| {
            format!("the zero asks for {l:.2} of a sample: not one lag and a dead time, but more lags, or an input that is not held")
        });
        // The fraction resolves the posterior's own grid; the remaining standard deviation must not vanish on exact data.
        return Some(ZeroReading {
            raw,
            std: (std * std + spread).sqrt().max(LEAST_STD),
            interval,
            note,
        });
    }
    let whole = candidates.iter().rev().find(|c| c.begins).or_else(|| candidates.last())?;
    let raw = as_f64(whole.nk);
    let interval = [raw.min(from), raw.max(to) + 1.0];
    Some(ZeroReading {
        raw,
        std: (interval[1] - interval[0]) * posterior::RESOLUTION.sqrt(),
        interval,
        note: Some("the lag is too short for the zero to show a fraction of a sample: anywhere within the sample".to_owned()),
    })
}

/// Lower bound of the standard deviation, samples: rounding.
const LEAST_STD: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_formula_inverts_the_hold() {
        for p in [0.05_f64, 0.5, 0.97] {
            for l in [0.0, 0.25, 0.5, 0.999] {
                let (b1, b2) = (3.0 * (1.0 - p.powf(1.0 - l)), 3.0 * (p.powf(1.0 - l) - p));
                assert!((fraction([b1, b2, p]).unwrap() - l).abs() < 1e-9, "{p} {l}");
            }
        }
        assert_eq!(fraction([1.0, 0.2, -0.3]), None);
        assert_eq!(fraction([1.0, -1.0, 0.3]), None);
    }
}

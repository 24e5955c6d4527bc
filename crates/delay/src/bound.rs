//! Lower bounds on the standard deviation of any unbiased delay estimate, and the error below the threshold where these bounds fail.
//!
//! Standard deviations have the unit of the time arguments: samples for signals, seconds for frequencies or time constants. ρ is the ratio of the power of the
//! signal to that of the noise.

use deadtime_signal::dft;
use nalgebra::Complex;
use statrs::function::erf::erfc;

use deadtime_identify::dot;

/// Two sensors observe one white signal in white noise of equal ratio ρ = `snr`, over the whole band: √(3(1 + 2ρ)/(π²Nρ²)) samples.
///
/// Source: Knapp and Carter (1976), IEEE Trans. ASSP 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, for a flat spectrum up to half the sampling rate.
#[must_use]
pub fn two_sensors_white(samples: usize, snr: f64) -> f64 {
    (3.0 * (1.0 + 2.0 * snr) / (count(samples) * snr * snr)).sqrt() / std::f64::consts::PI
}

/// Two sensors with magnitude-squared coherence γ²(f) over `band_hz` and `duration_s`: (2T∫(2πf)²·γ²/(1 − γ²)·df)^(−½) seconds.
///
/// Source: as [`two_sensors_white`].
#[must_use]
pub fn two_sensors(duration_s: f64, band_hz: [f64; 2], coherence: impl Fn(f64) -> f64) -> f64 {
    let information = integral(band_hz, |f| {
        let c = coherence(f).clamp(0.0, 1.0);
        (2.0 * std::f64::consts::PI * f).powi(2) * c / (1.0 - c)
    });
    (2.0 * duration_s * information).sqrt().recip()
}

/// A white signal known without noise, and its delayed copy in white noise: √(3/(π²Nρ)) samples. At high ρ this is smaller than for two sensors by √2.
///
/// Source: Kay (1993), "Fundamentals of Statistical Signal Processing: Estimation Theory", example 3.13.
#[must_use]
pub fn reference_white(samples: usize, snr: f64) -> f64 {
    (3.0 / (count(samples) * snr)).sqrt() / std::f64::consts::PI
}

/// Any band-limited signal known without noise: σ/‖dy/dt‖ samples, the derivative by its spectrum.
///
/// Source: as [`reference_white`]; β² = ∫ω²|Y|²/∫|Y|² there.
#[must_use]
pub fn reference(signal: &[f64], noise_std: f64) -> f64 {
    let n = signal.len();
    let mut spectrum: Vec<Complex<f64>> = signal.iter().map(|v| Complex::new(*v, 0.0)).collect();
    dft(&mut spectrum);
    let energy: f64 = spectrum
        .iter()
        .enumerate()
        .map(|(k, s)| {
            (2.0 * std::f64::consts::PI * count(k.min(n - k)) / count(n)).powi(2) * s.norm_sqr()
        })
        .sum::<f64>()
        / count(n.max(1));
    noise_std / energy.sqrt()
}

/// A response known except for its delay: σ/‖ψ‖, ψ = ∂ŷ/∂L at each sample. For coloured noise, filter ψ by the inverse noise model.
///
/// Source: Kay (1993), section 3.5.
#[must_use]
pub fn known_model(slope: &[f64], noise_std: f64) -> f64 {
    noise_std / dot(slope, slope).sqrt()
}

/// The same with further unknown parameters: σ/‖P⊥ψ‖. P⊥ψ is the component of ψ orthogonal to their derivatives `others` (gain, poles, initial state, …).
/// `None` where P⊥ψ vanishes: delay and other parameters are indistinguishable.
///
/// Source: Kay (1993), section 3.7; the Schur complement of the information matrix.
#[must_use]
pub fn joint(slope: &[f64], others: &[Vec<f64>], noise_std: f64) -> Option<f64> {
    let alone = alone(slope, others.iter().map(Vec::as_slice));
    let share = dot(&alone, &alone) / dot(slope, slope).max(f64::MIN_POSITIVE);
    (share > INDISTINCT).then(|| known_model(&alone, noise_std))
}

/// A derivative whose orthogonal component holds less than this share of its energy depends on the others, up to rounding.
const INDISTINCT: f64 = 1e-18;

/// The component of `slope` orthogonal to `others`, by Gram-Schmidt; a second pass removes rounding.
pub(super) fn alone<'a>(slope: &[f64], others: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for other in others {
        let size = dot(other, other).sqrt();
        let mut column = other.to_vec();
        for _ in 0..2 {
            take_off(&mut column, &basis);
        }
        let left = dot(&column, &column).sqrt();
        if left > 1e-10 * size && left.is_finite() {
            column.iter_mut().for_each(|v| *v /= left);
            basis.push(column);
        }
    }
    let mut alone = slope.to_vec();
    for _ in 0..2 {
        take_off(&mut alone, &basis);
    }
    alone
}

fn take_off(column: &mut [f64], basis: &[Vec<f64>]) {
    for b in basis {
        let share = dot(b, column);
        column.iter_mut().zip(b).for_each(|(c, b)| *c -= share * b);
    }
}

/// K·e^(−Ls)/(Ts + 1) after an input step, over a record that is long compared with T.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstOrderStep {
    /// K times the step.
    pub height: f64,
    /// T, s.
    pub lag_s: f64,
    /// The sample time, s.
    pub sample_time_s: f64,
    /// Standard deviation of the noise per sample, in the output's unit.
    pub noise_std: f64,
}

impl FirstOrderStep {
    /// K and T known: √(2TΔσ²/(KA)²) seconds.
    ///
    /// Follows from [`known_model`] with ψ = −(KA/T)·e^(−(t − L)/T) and an integral for the sum; valid for a sample time short compared with T.
    #[must_use]
    pub fn known(&self) -> f64 {
        (2.0 * self.lag_s * self.sample_time_s).sqrt() * self.noise_std / self.height.abs()
    }

    /// T unknown too (K is known from the long record): twice the variance, √(4TΔσ²/(KA)²) seconds.
    #[must_use]
    pub fn joint(&self) -> f64 {
        std::f64::consts::SQRT_2 * self.known()
    }
}

/// The least root mean square error of a delay drawn uniformly from 0 to `window`. The bound holds below the threshold, too, where it tends to window/√12.
///
/// MSE ≥ ∫h·max over η ≥ h of {(1 − η/D)·Q(d(η)/2)}·dh. `distance(h)` is d: the norm of ŷ delayed by h minus ŷ, over the noise's standard deviation per sample.
/// The bound holds for known dynamics; with their derivatives projected out of the difference it is a guide.
/// Source: Bell, Steinberg, Ephraim and Van Trees (1997), IEEE Trans. Inf. Theory 43(2), 624-637, doi:10.1109/18.556118.
#[must_use]
pub fn ziv_zakai(window: f64, distance: impl Fn(f64) -> f64) -> f64 {
    // Logarithmic steps: informative data confine the integrand to a few standard deviations around 0; uninformative data spread it over the window.
    let at = |i: usize| window * (RANGE * (count(i) / count(STEPS) - 1.0)).exp();
    let (mut filled, mut mse, mut last) = (0.0_f64, 0.0, (window, 0.0));
    for i in (0..STEPS).rev() {
        let h = at(i);
        filled = filled.max((1.0 - h / window) * tail(0.5 * distance(h)));
        let value = h * filled;
        mse += 0.5 * (value + last.1) * (last.0 - h);
        last = (h, value);
    }
    mse.sqrt()
}

/// Points of the integrals.
const STEPS: usize = 4096;
/// The integral begins at e^(−25) of the window; shorter delays contribute nothing.
const RANGE: f64 = 25.0;

/// The probability that noise produces a higher correlation peak elsewhere: 1 − ∫φ(z − m)·Φ(z)^(M − 1)·dz.
///
/// `peak` m is the true peak's height over the standard deviation of the correlation away from the peak. `cells` M is the number of independent lags searched,
/// about 2·D·B for a window D and a bandwidth B.
///
/// Source: Ianniello (1982), IEEE Trans. ASSP 30(6), 998-1003, doi:10.1109/TASSP.1982.1163992.
#[must_use]
pub fn anomaly_probability(peak: f64, cells: f64) -> f64 {
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    // 1 − Φ^(M−1) instead of 1 − ∫ keeps full precision where the probability is small.
    let wrong = |z: f64| -f64::exp_m1((cells - 1.0).max(0.0) * f64::ln_1p(-tail(z)));
    integral([peak - 10.0, peak + 10.0], |z| density(z - peak) * wrong(z)).clamp(0.0, 1.0)
}

/// The root mean square error of a correlator: uniform over the window with the given [`anomaly_probability`], else of standard deviation `std`.
#[must_use]
pub fn with_anomalies(std: f64, window: f64, probability: f64) -> f64 {
    (probability * window * window / 12.0 + (1.0 - probability) * std * std).sqrt()
}

/// Q(x), the probability that a standard normal variable exceeds x.
fn tail(x: f64) -> f64 {
    0.5 * erfc(x / std::f64::consts::SQRT_2)
}

/// The midpoint rule.
fn integral([from, to]: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
    let step = (to - from) / count(STEPS);
    (0..STEPS).map(|i| f(from + (count(i) + 0.5) * step)).sum::<f64>() * step
}

fn count(n: usize) -> f64 {
    n as f64
}

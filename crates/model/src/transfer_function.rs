//! Transfer functions of one input-output pair, kept as zeros, poles and gain.

use nalgebra::{Complex, DMatrix};

use super::error::ModelError;
use super::matrices::Matrices;
use super::state_space::{StateSpace, TimeDomain};
use super::{cascade, zeros};
use deadtime_signal::{refined_roots, unlike};

/// gain · Π(s − zero) / Π(s − pole) · exp(−delay·s), or the same in z.
///
/// Zeros, poles and gain are less sensitive to rounding than polynomial coefficients, whose roots near z = 1 are ill conditioned.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction<T: TimeDomain> {
    zeros: Vec<Complex<f64>>,
    poles: Vec<Complex<f64>>,
    gain: f64,
    delay: T::Delay,
    domain: T,
}

impl<T: TimeDomain> TransferFunction<T> {
    /// From zeros, poles and gain; complex ones in conjugate pairs.
    ///
    /// # Errors
    /// [`ModelError::Improper`] with more zeros than poles, [`ModelError::Unpaired`] for a root without its conjugate, [`ModelError::NotFinite`],
    /// [`ModelError::Time`] for an invalid delay.
    pub fn from_zeros_poles_gain(
        zeros: Vec<Complex<f64>>,
        poles: Vec<Complex<f64>>,
        gain: f64,
        delay: T::Delay,
        domain: T,
    ) -> Result<Self, ModelError> {
        if zeros.len() > poles.len() {
            return Err(ModelError::Improper { zeros: zeros.len(), poles: poles.len() });
        }
        domain.check_delay(delay)?;
        if !gain.is_finite() {
            return Err(ModelError::NotFinite { matrix: "gain", row: 1, column: 1, value: gain });
        }
        let zeros = cascade::pair_conjugates("zero", zeros)?;
        let poles = cascade::pair_conjugates("pole", poles)?;
        Ok(Self { zeros, poles, gain, delay, domain })
    }

    /// From polynomial coefficients, highest power first.
    ///
    /// # Errors
    /// [`ModelError::Improper`] for a numerator of higher degree, [`ModelError::NotFinite`] for a coefficient that is not finite or a denominator of
    /// zeros. [`ModelError::Unfactored`] where the computed roots do not reproduce a polynomial.
    pub fn from_polynomials(
        numerator: &[f64],
        denominator: &[f64],
        delay: T::Delay,
        domain: T,
    ) -> Result<Self, ModelError> {
        let (zeros, num_lead) = roots("numerator", numerator, domain)?;
        let (poles, den_lead) = roots("denominator", denominator, domain)?;
        Self::from_zeros_poles_gain(zeros, poles, num_lead / den_lead, delay, domain)
    }

    /// The zeros.
    #[must_use]
    pub fn zeros(&self) -> &[Complex<f64>] {
        &self.zeros
    }
    /// The poles.
    #[must_use]
    pub fn poles(&self) -> &[Complex<f64>] {
        &self.poles
    }
    /// The ratio of the leading coefficients.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.gain
    }
    /// The delay: seconds, or whole samples.
    #[must_use]
    pub fn delay(&self) -> T::Delay {
        self.delay
    }
    /// Continuous or sampled.
    #[must_use]
    pub fn domain(&self) -> T {
        self.domain
    }
    /// Poles minus zeros.
    #[must_use]
    pub fn relative_degree(&self) -> usize {
        self.poles.len() - self.zeros.len()
    }
    /// Numerator coefficients, highest power first.
    #[must_use]
    pub fn numerator(&self) -> Vec<f64> {
        expand(&self.zeros, self.gain)
    }
    /// Denominator coefficients, highest power first, the first one 1.
    #[must_use]
    pub fn denominator(&self) -> Vec<f64> {
        expand(&self.poles, 1.0)
    }

    /// The value without the delay at a point s or z.
    #[must_use]
    pub fn at(&self, point: Complex<f64>) -> Complex<f64> {
        // Interleaved, so that neither product overflows on its own.
        let mut value = Complex::new(self.gain, 0.0);
        for i in 0..self.poles.len() {
            if let Some(zero) = self.zeros.get(i) {
                value *= point - zero;
            }
            value /= point - self.poles[i];
        }
        value
    }

    /// The frequency response, delay included.
    #[must_use]
    pub fn frequency_response(&self, omega_rad_s: f64) -> Complex<f64> {
        self.at(self.domain.point(omega_rad_s))
            * Complex::from_polar(1.0, -omega_rad_s * self.domain.delay_s(self.delay))
    }

    /// The magnitude of the smallest root away from the origin, in continuous time. In sampled time it is 1, because the unit circle is the scale.
    pub(super) fn smallest_root(&self) -> f64 {
        if self.domain.sample_time_s().is_some() {
            return 1.0;
        }
        let sizes = || self.zeros.iter().chain(&self.poles).map(|r| r.norm());
        let origin = AT_ORIGIN * sizes().fold(0.0, f64::max);
        let smallest = sizes().filter(|size| *size > origin).fold(f64::INFINITY, f64::min);
        if smallest.is_finite() { smallest } else { 1.0 }
    }

    /// The same function without pairs of a zero and a pole closer than `tolerance`. The distance is relative to their size, or to that of the smallest root
    /// away from the origin (in sampled time, to 1).
    #[must_use]
    pub fn cancelled(&self, tolerance: f64) -> Self {
        let unit = self.smallest_root();
        let mut zeros = self.zeros.clone();
        let mut poles = Vec::with_capacity(self.poles.len());
        for &pole in &self.poles {
            let near = |z: &Complex<f64>| (z - pole).norm() <= tolerance * pole.norm().max(unit);
            match zeros.iter().position(near) {
                Some(at) => drop(zeros.remove(at)),
                None => poles.push(pole),
            }
        }
        let cancelled = Self { zeros, poles, ..self.clone() };
        // Cancelling must keep conjugate pairs; otherwise nothing is cancelled.
        let whole =
            |roots: &[Complex<f64>]| cascade::pair_conjugates("root", roots.to_vec()).is_ok();
        if whole(&cancelled.zeros) && whole(&cancelled.poles) { cancelled } else { self.clone() }
    }

    /// A state-space realisation: a cascade of sections of first and second order.
    ///
    /// # Errors
    /// [`ModelError::Unpaired`], impossible for a function built by this type's constructors.
    pub fn to_state_space(&self) -> Result<StateSpace<T>, ModelError> {
        let (a, b, c, d) = cascade::realise(&self.zeros, &self.poles, self.gain)?;
        let Matrices { a, b, c, d } = Matrices { a, b, c, d }.in_like_units();
        StateSpace::new(a, b, c, d, self.domain)?.with_input_delay(vec![self.delay])
    }
}

/// A root of this size relative to the largest is at the origin.
const AT_ORIGIN: f64 = 1e-9;
/// A product of factors within this relative distance of its polynomial is not refined.
const LIKE: f64 = 1e-12;
/// A product of factors beyond this relative distance of its polynomial is refused.
const UNLIKE: f64 = 1e-8;
/// Values are compared at points at least this far from a root, relative to the root's size.
const NEAREST: f64 = 1e-6;

/// Roots of a polynomial (highest power first) and its leading coefficient; leading zeros are dropped.
///
/// Eigenvalues of the companion matrix if their product reproduces the polynomial on the axis, else the roots refined with twice the digits.
fn roots<T: TimeDomain>(
    matrix: &'static str,
    coefficients: &[f64],
    domain: T,
) -> Result<(Vec<Complex<f64>>, f64), ModelError> {
    let start = coefficients.iter().position(|&c| c != 0.0).unwrap_or(coefficients.len());
    let coefficients = &coefficients[start..];
    if let Some(at) = coefficients.iter().position(|c| !c.is_finite()) {
        return Err(ModelError::NotFinite {
            matrix,
            row: 1,
            column: start + at + 1,
            value: coefficients[at],
        });
    }
    let Some((&lead, rest)) = coefficients.split_first() else {
        return Err(ModelError::NotFinite { matrix, row: 1, column: 1, value: 0.0 });
    };
    let n = rest.len();
    let companion = DMatrix::from_fn(n, n, |i, j| {
        if i == 0 { -rest[j] / lead } else { f64::from(u8::from(i == j + 1)) }
    });
    let first = zeros::eigenvalues(&companion);
    let at_origin = coefficients.iter().rev().take_while(|&&c| c == 0.0).count();
    if at_origin == n {
        return Ok((first, lead));
    }
    // In the unit in which the other roots have the geometric mean 1.
    let others = &coefficients[..=n - at_origin];
    let degree = (n - at_origin) as f64;
    let unit = (((others[n - at_origin] / lead).abs().log2() / degree).round()).exp2();
    let scaled: Vec<f64> = others
        .iter()
        .enumerate()
        .rev()
        .map(|(k, c)| c / lead * unit.powi(-i32::try_from(k).unwrap_or(i32::MAX)))
        .collect();
    let mut found: Vec<Complex<f64>> = first.iter().map(|r| r / unit).collect();
    found.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
    found.truncate(n - at_origin);
    let mut points = near(domain, &found, unit);
    let off = unlike(&scaled, &found, &points);
    if off <= LIKE {
        return Ok((first, lead));
    }
    let (mut best, mut error) = (first, off);
    if let Some(refined) = refined_roots(&scaled) {
        points.extend(near(domain, &refined, unit));
        error = unlike(&scaled, &found, &points);
        let off = unlike(&scaled, &refined, &points);
        if off < error {
            error = off;
            best = refined.into_iter().map(|r| r * unit).collect();
            best.resize(n, Complex::default());
        }
    }
    if error <= UNLIKE {
        Ok((best, lead))
    } else {
        Err(ModelError::Unfactored { what: matrix, error })
    }
}

/// Points of the frequency axis next to given roots, both in this unit.
fn near<T: TimeDomain>(domain: T, roots: &[Complex<f64>], unit: f64) -> Vec<Complex<f64>> {
    let mut points = Vec::with_capacity(5 * roots.len() + 9);
    let mut put = |omega: f64| points.push(domain.point(omega.abs()) / unit);
    for root in roots.iter().map(|r| r * unit).filter(|r| r.is_finite()) {
        let size = root.norm();
        let (centre, damping, nearest) = match domain.sample_time_s() {
            None => (root.im.abs(), root.re.abs(), NEAREST * size),
            Some(ts) => (root.arg().abs() / ts, (1.0 - size).abs() / ts, NEAREST / ts),
        };
        put(centre - damping.max(nearest));
        put(centre + damping.max(nearest));
        if damping >= nearest {
            put(centre);
        }
        if domain.sample_time_s().is_none() {
            put(0.37 * size);
            put(2.9 * size);
        }
    }
    if let Some(ts) = domain.sample_time_s() {
        for k in 0..9 {
            put(std::f64::consts::PI * f64::from(k) / (8.0 * ts));
        }
    }
    // At a root itself both sides are 0.
    points.retain(|x| roots.iter().all(|r| (x - r).norm() > 0.5 * NEAREST * r.norm()));
    points
}

/// Coefficients of gain·Π(x − root), highest power first.
fn expand(roots: &[Complex<f64>], gain: f64) -> Vec<f64> {
    let mut coefficients = vec![Complex::new(gain, 0.0)];
    for root in roots {
        coefficients.push(Complex::default());
        for i in (1..coefficients.len()).rev() {
            let previous = coefficients[i - 1];
            coefficients[i] -= root * previous;
        }
    }
    coefficients.into_iter().map(|c| c.re).collect()
}

impl<T: TimeDomain> StateSpace<T> {
    /// The transfer function of one pair: zeros, poles, gain and delay, without cancellation.
    ///
    /// # Errors
    /// [`ModelError::Index`], or [`ModelError::ZeroTransfer`] where it is identically zero.
    pub fn transfer_function(
        &self,
        output: usize,
        input: usize,
    ) -> Result<TransferFunction<T>, ModelError> {
        let pair = self.pair(output, input)?;
        let (degree, gain) =
            pair.leading_markov(0, 0).ok_or(ModelError::ZeroTransfer { input, output })?;
        let mut zeros = pair.zeros();
        // n − r zeros in exact arithmetic. A borderline rank decision may leave one far away, or take a leading Markov parameter for rounding.
        zeros.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        zeros.truncate(pair.order() - degree);
        let gain = match pair.order() - zeros.len() {
            own if own == degree => gain,
            later => pair.markov(0, 0, later),
        };
        TransferFunction::from_zeros_poles_gain(
            zeros,
            pair.poles(),
            gain,
            pair.input_delay()[0],
            pair.domain(),
        )
    }

    /// The response to a constant, p×m; infinite for an integrating pair.
    #[must_use]
    pub fn dc_gain(&self) -> DMatrix<f64> {
        let whole = self.frequency_response(0.0).map(|v| v.re);
        if whole.iter().all(|v| v.is_finite()) {
            return whole;
        }
        // A pole at the point belongs to some pairs only.
        let point = self.domain().point(0.0);
        DMatrix::from_fn(self.outputs(), self.inputs(), |i, j| match self.transfer_function(i, j) {
            Err(_) => 0.0,
            Ok(pair) => {
                let pair = pair.cancelled(1e-9);
                let nearest = 1e-12 * pair.smallest_root();
                if pair.poles().iter().any(|p| (p - point).norm() <= nearest) {
                    f64::INFINITY
                } else {
                    pair.at(point).re
                }
            }
        })
    }
}

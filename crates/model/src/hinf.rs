//! The H-infinity norm, the largest gain over all frequencies and directions; and the largest gain over a band for models of any poles.
//!
//! How it can be wrong: a peak lies between the evaluated frequencies (the level sets find it). A pole on the axis belongs to the realisation alone (it counts
//! as one of the response). A level is a singular value of D (the crossings are then rounding; the evaluated gains remain correct).

use deadtime_signal::decompositions::singular_values;
use nalgebra::{Complex, DMatrix};

use super::matrices::Matrices;
use super::state_space::{StateSpace, TimeDomain};
use super::zeros;

/// The largest gain of a model, and its frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The norm; infinite for a model with an unstable pole (for a band: with a pole on the axis within it).
    pub gain: f64,
    /// The frequency, rad/s; infinite where the gain increases towards that of the direct path, NaN for an infinite norm.
    pub omega_rad_s: f64,
}

/// All frequencies.
const EVERYWHERE: [f64; 2] = [0.0, f64::INFINITY];

/// Relative bound of the norm's excess over the returned gain, which is attained.
const TOLERANCE: f64 = 1e-10;
/// An eigenvalue within this relative distance of the imaginary axis may be on it: an additional frequency costs nothing.
const NEAR_AXIS: f64 = 1e-5;

/// A pole within this distance of the imaginary axis, relative to its size (to that of A where it is 0), is on it.
const ON_AXIS: f64 = 1e-13;

impl Matrices {
    /// The largest singular value at jω.
    fn gain(&self, omega: f64) -> f64 {
        let n = self.a.nrows();
        let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
        let mut response = complex(&self.d);
        if n > 0 && omega.is_finite() {
            let resolvent =
                DMatrix::from_diagonal_element(n, n, Complex::new(0.0, omega)) - complex(&self.a);
            match resolvent.lu().solve(&complex(&self.b)) {
                Some(x) => response += complex(&self.c) * x,
                None => return f64::INFINITY,
            }
        }
        if response.is_empty() {
            0.0
        } else {
            singular_values(&response).map_or(f64::NAN, |s| s.max())
        }
    }

    /// Frequencies at which a singular value may be `gamma`: imaginary eigenvalues of the Hamiltonian matrix. `gamma` may be below the gain of D, whose
    /// frequencies a band may exclude.
    fn crossings(&self, gamma: f64) -> Vec<f64> {
        let (n, m) = self.b.shape();
        let weight = (DMatrix::from_diagonal_element(m, m, gamma * gamma)
            - self.d.transpose() * &self.d)
            .lu();
        let through = self.d.transpose() * &self.c;
        let (Some(from_states), Some(from_inputs)) =
            (weight.solve(&through), weight.solve(&self.b.transpose()))
        else {
            return Vec::new();
        };
        let closed = &self.a + &self.b * &from_states;
        let above = &self.b * from_inputs * gamma;
        let seen = &self.c + &self.d * from_states;
        let below = self.c.transpose() * seen / -gamma;
        let mut hamiltonian = DMatrix::zeros(2 * n, 2 * n);
        hamiltonian.view_mut((0, 0), (n, n)).copy_from(&closed);
        hamiltonian.view_mut((0, n), (n, n)).copy_from(&above);
        hamiltonian.view_mut((n, 0), (n, n)).copy_from(&below);
        hamiltonian.view_mut((n, n), (n, n)).copy_from(&-closed.transpose());
        let smallest = f64::EPSILON.sqrt() * self.a.norm();
        let on_axis = |v: &&Complex<f64>| v.re.abs() <= NEAR_AXIS * v.norm() + smallest;
        let mut found: Vec<f64> =
            zeros::eigenvalues(&hamiltonian).iter().filter(on_axis).map(|v| v.im.abs()).collect();
        found.sort_by(f64::total_cmp);
        found
    }
}

/// The norm by level sets. Each round evaluates between the frequencies at which the gain crosses a level just above the best so far.
///
/// Source: Bruinsma and Steinbuch (1990), "A fast algorithm to compute the H∞-norm of a transfer function matrix", Systems & Control Letters 14(4), 287-293,
/// doi:10.1016/0167-6911(90)90049-Z. A sampled model is replaced by its bilinear image z = (1 + s)/(1 − s), which has the same gains.
pub(super) fn peak<T: TimeDomain>(sys: &StateSpace<T>) -> Peak {
    let infinite = Peak { gain: f64::INFINITY, omega_rad_s: f64::NAN };
    if !sys.is_stable() {
        return infinite;
    }
    // Stable models have no pole at z = −1.
    continuous(sys).map_or(infinite, |image| on_axis_of(sys, search(&image, EVERYWHERE)))
}

/// The same from the response alone, over a band in rad/s: the poles may lie on either side of the axis. `None` where the band contains no frequency.
pub(super) fn peak_within<T: TimeDomain>(sys: &StateSpace<T>, band: [f64; 2]) -> Option<Peak> {
    let half = sys.domain().sample_time_s().map(|ts| 0.5 * ts);
    // From 0 to the Nyquist frequency: tan π/2 is finite in floating point.
    let image = |omega: f64| {
        half.map_or(omega, |half| {
            if omega * half >= std::f64::consts::FRAC_PI_2 {
                f64::INFINITY
            } else {
                (omega * half).tan()
            }
        })
    };
    let [low, high] = [band[0].max(0.0), band[1]];
    let within = low <= high && half.is_none_or(|half| low * half <= std::f64::consts::FRAC_PI_2);
    if band[0].is_nan() || !within {
        return None;
    }
    let band = [image(low), image(high)];
    let infinite = Peak { gain: f64::INFINITY, omega_rad_s: f64::NAN };
    let Some(image) = continuous(sys) else { return Some(infinite) };
    let size = image.a.norm();
    let on_axis = |p: &Complex<f64>| {
        p.re.abs() <= ON_AXIS * p.norm().max(size) && (band[0]..=band[1]).contains(&p.im.abs())
    };
    if zeros::eigenvalues(&image.a).iter().any(|p| on_axis(p) || p.re.is_nan()) {
        return Some(infinite);
    }
    Some(on_axis_of(sys, search(&image, band)))
}

/// A continuous-time model with the same gains, in balanced states, without delays. `None` for a pole at z = −1.
pub(super) fn continuous<T: TimeDomain>(sys: &StateSpace<T>) -> Option<Matrices> {
    let given = Matrices::of(sys).balanced();
    if sys.domain().sample_time_s().is_none() {
        Some(given)
    } else {
        Some(image(&given)?.balanced())
    }
}

/// A point on the axis of [`continuous`] as the model's own frequency.
pub(super) fn on_axis_of<T: TimeDomain>(sys: &StateSpace<T>, found: Peak) -> Peak {
    let own = |omega: f64| sys.domain().sample_time_s().map_or(omega, |ts| 2.0 * omega.atan() / ts);
    Peak { omega_rad_s: own(found.omega_rad_s), ..found }
}

/// The continuous model with the gains of the sampled one; `None` for a pole at z = −1.
fn image(sys: &Matrices) -> Option<Matrices> {
    let n = sys.a.nrows();
    if n == 0 {
        return Some(sys.clone());
    }
    let identity = DMatrix::<f64>::identity(n, n);
    let shifted = (&sys.a + &identity).lu();
    let b = shifted.solve(&sys.b)?;
    let c = (&sys.a + &identity).transpose().lu().solve(&sys.c.transpose())?.transpose();
    let root = std::f64::consts::SQRT_2;
    Some(Matrices {
        a: shifted.solve(&(&sys.a - &identity))?,
        d: &sys.d - &sys.c * &b,
        b: b * root,
        c: c * root,
    })
}

/// The largest gain between two frequencies (the upper one may be infinite).
pub(super) fn search(sys: &Matrices, [low, high]: [f64; 2]) -> Peak {
    let mut best = Peak { gain: 0.0, omega_rad_s: low };
    let mut look = |omegas: &[f64]| {
        for &omega_rad_s in omegas.iter().filter(|w| (low..=high).contains(*w)) {
            let gain = sys.gain(omega_rad_s);
            if gain > best.gain {
                best = Peak { gain, omega_rad_s };
            }
        }
        best
    };
    // At the resonance of a lightly damped pole the gain is near the norm. A neighbouring point is added, because zeros may lie on all these points.
    let resonances: Vec<f64> = zeros::eigenvalues(&sys.a)
        .iter()
        .flat_map(|p| [p.norm(), p.im.abs(), 0.37 * p.norm(), 2.9 * p.norm()])
        .collect();
    look(&resonances);
    if [low, high] != EVERYWHERE {
        // Resonances may all lie outside a band, and its ends may be zeros. At this number of points no response of this order vanishes without vanishing
        // everywhere.
        let (count, end) =
            (2 * sys.a.nrows() + 2, if high.is_finite() { high } else { 10.0 * low.max(1.0) });
        look(&(0..=count).map(|k| low + (end - low) * k as f64 / count as f64).collect::<Vec<_>>());
    }
    let mut found = look(&[low, high]);
    if sys.a.is_empty() || found.gain == 0.0 {
        // A transfer function with zeros at all of these frequencies is zero.
        return found;
    }
    for _ in 0..60 {
        let level = found.gain * (1.0 + TOLERANCE);
        let crossings: Vec<f64> =
            sys.crossings(level).into_iter().filter(|w| (low..=high).contains(w)).collect();
        // Crossings and the band's ends bound the intervals above the level. A crossing may be the remainder of two merged by rounding, so it is evaluated,
        // too.
        let ends: Vec<f64> = std::iter::once(low)
            .chain(crossings.iter().copied())
            .chain(high.is_finite().then_some(high))
            .collect();
        let between: Vec<f64> =
            ends.windows(2).map(|w| 0.5 * (w[0] + w[1])).chain(crossings).collect();
        let mut next = look(&between);
        if next.gain <= level {
            // Close to the peak rounding moves crossings off the axis; there a direct search continues.
            next = look(&[climbed(sys, next.omega_rad_s)]);
            if next.gain <= level {
                return next;
            }
        }
        found = next;
    }
    found
}

/// The frequency of the largest gain within 10 % of a given one: golden sections of successively smaller neighbourhoods.
fn climbed(sys: &Matrices, mut omega: f64) -> f64 {
    if !(omega > 0.0 && omega.is_finite()) {
        return omega;
    }
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    for width in [1e-1, 1e-3, 1e-5] {
        let (mut low, mut high) = (omega * (1.0 - width), omega * (1.0 + width));
        let at = |share: f64, low: f64, high: f64| low + share * (high - low);
        let (mut left, mut right) = (at(1.0 - ratio, low, high), at(ratio, low, high));
        let (mut gain_left, mut gain_right) = (sys.gain(left), sys.gain(right));
        for _ in 0..24 {
            if gain_left > gain_right {
                (high, right, gain_right) = (right, left, gain_left);
                left = at(1.0 - ratio, low, high);
                gain_left = sys.gain(left);
            } else {
                (low, left, gain_left) = (left, right, gain_right);
                right = at(ratio, low, high);
                gain_right = sys.gain(right);
            }
        }
        let best = if gain_left > gain_right { left } else { right };
        if sys.gain(best) > sys.gain(omega) {
            omega = best;
        }
    }
    omega
}

impl<T: TimeDomain> StateSpace<T> {
    /// The H-infinity norm, the largest gain over all frequencies and directions; infinite unless every pole is stable. Delays have no influence.
    ///
    /// Source: Bruinsma and Steinbuch (1990), doi:10.1016/0167-6911(90)90049-Z.
    #[must_use]
    pub fn norm_hinf(&self) -> Peak {
        peak(self)
    }

    /// The largest gain over a band from `band[0]` to `band[1]` rad/s (0 and infinity: everywhere), for any poles. The result is the L-infinity norm, which for
    /// a stable model equals the H-infinity norm. Infinite with a pole on the imaginary axis (the unit circle) within the band, including hidden ones, or at
    /// z = −1. `None` where the band contains no frequency. Delays have no influence.
    ///
    /// Source: Bruinsma and Steinbuch (1990), doi:10.1016/0167-6911(90)90049-Z, with the band's
    /// ends among the crossings.
    #[must_use]
    pub fn norm_linf(&self, band: [f64; 2]) -> Option<Peak> {
        peak_within(self, band)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state_space::{Continuous, Sampled};
    use crate::transfer_function::TransferFunction;
    use approx::assert_abs_diff_eq;
    use deadtime_signal::time::SampleTime;

    #[test]
    fn a_resonance_has_the_height_and_place_of_its_formula() {
        for damping in [0.5, 0.1, 1e-3, 1e-6_f64] {
            let sys = TransferFunction::from_polynomials(
                &[1.0],
                &[1.0, 2.0 * damping, 1.0],
                0.7,
                Continuous,
            )
            .unwrap()
            .to_state_space()
            .unwrap();
            let found = sys.norm_hinf();
            let gain = 1.0 / (2.0 * damping * (1.0 - damping * damping).sqrt());
            assert!((found.gain / gain - 1.0).abs() < 1e-9, "{damping}: {found:?} {gain}");
            assert!(
                (found.omega_rad_s - (1.0 - 2.0 * damping * damping).sqrt()).abs() < 1e-5,
                "{damping}: {found:?}"
            );
        }
    }

    #[test]
    fn the_largest_gain_may_lie_at_either_end_of_the_frequencies() {
        let continuous = |num: &[f64], den: &[f64]| {
            TransferFunction::from_polynomials(num, den, 0.0, Continuous)
                .unwrap()
                .to_state_space()
                .unwrap()
                .norm_hinf()
        };
        assert_eq!(continuous(&[3.0], &[1.0, 2.0]), Peak { gain: 1.5, omega_rad_s: 0.0 });
        let high = continuous(&[2.0, 1.0], &[1.0, 2.0]);
        assert!((high.gain - 2.0).abs() < 1e-9, "{high:?}");
        let ts = SampleTime::new(0.1).unwrap();
        for (pole, omega) in [(0.5, 0.0), (-0.5, ts.nyquist_rad_s())] {
            let tf =
                TransferFunction::from_polynomials(&[1.0], &[1.0, -pole], 3, Sampled(ts)).unwrap();
            let found = tf.to_state_space().unwrap().norm_hinf();
            assert!(
                (found.gain - 2.0).abs() < 1e-12 && (found.omega_rad_s - omega).abs() < 1e-6,
                "{found:?}"
            );
        }
    }

    #[test]
    fn over_a_band_the_gain_is_that_of_the_formula_whatever_the_poles() {
        // A high pass: D is its largest gain, and every level within the band lies below it.
        let high_pass =
            TransferFunction::from_polynomials(&[1.0, 0.0], &[1.0, 1.0], 0.0, Continuous)
                .unwrap()
                .to_state_space()
                .unwrap();
        for pole in [1.0, -1.0] {
            let low_pass =
                TransferFunction::from_polynomials(&[1.0], &[1.0, pole], 0.3, Continuous)
                    .unwrap()
                    .to_state_space()
                    .unwrap();
            for [low, high] in [[0.0, 0.5], [0.2, 3.0], [1.0, f64::INFINITY]] {
                let found = low_pass.norm_linf([low, high]).unwrap();
                assert!(
                    (found.gain - 1.0 / (1.0_f64 + low * low).sqrt()).abs() < 1e-12
                        && found.omega_rad_s == low,
                    "{found:?}"
                );
                let found = high_pass.norm_linf([low, high]).unwrap();
                let gain = if high.is_finite() { high / (1.0 + high * high).sqrt() } else { 1.0 };
                assert!((found.gain - gain).abs() < 1e-9, "{found:?} {gain}");
            }
        }
        // Two resonances, the larger one outside the band.
        let two = TransferFunction::from_polynomials(
            &[1.0, 0.2, 30.0],
            &[1.0, 0.03, 101.0002, 2.01, 100.0],
            0.0,
            Continuous,
        )
        .unwrap();
        let two = two.to_state_space().unwrap();
        let (whole, part) = (two.norm_hinf(), two.norm_linf([3.0, 40.0]).unwrap());
        assert!(
            (whole.omega_rad_s - 1.0).abs() < 0.01
                && (part.omega_rad_s - 10.0).abs() < 0.1
                && part.gain < whole.gain,
            "{whole:?} {part:?}"
        );
        assert_eq!(two.norm_linf([0.0, f64::INFINITY]).unwrap().gain, whole.gain);
    }

    #[test]
    fn a_pole_on_the_axis_is_infinite_in_its_band_only_and_an_empty_band_has_no_gain() {
        let integrator = TransferFunction::from_polynomials(&[2.0], &[1.0, 0.0], 0.0, Continuous)
            .unwrap()
            .to_state_space()
            .unwrap();
        assert_eq!(integrator.norm_linf([0.0, 1.0]).unwrap().gain, f64::INFINITY);
        assert!((integrator.norm_linf([0.5, 1.0]).unwrap().gain - 4.0).abs() < 1e-12);
        for band in [[2.0, 1.0], [f64::NAN, 1.0], [1.0, f64::NAN]] {
            assert!(integrator.norm_linf(band).is_none(), "{band:?}");
        }
        let ts = SampleTime::new(0.1).unwrap();
        let sum = TransferFunction::from_polynomials(&[1.0], &[1.0, -1.0], 2, Sampled(ts))
            .unwrap()
            .to_state_space()
            .unwrap();
        assert_eq!(sum.norm_linf([0.0, 1.0]).unwrap().gain, f64::INFINITY);
        // 1/|z − 1| = 1/(2 sin(ωTs/2)).
        let found = sum.norm_linf([4.0, 1e9]).unwrap();
        assert!(
            (found.gain - 0.5 / 0.2_f64.sin()).abs() < 1e-12
                && (found.omega_rad_s - 4.0).abs() < 1e-12,
            "{found:?}"
        );
        assert!(sum.norm_linf([40.0, 50.0]).is_none());
    }

    #[test]
    fn directions_count_and_unstable_models_have_none() {
        // A constant matrix of singular values 5 and 1 before a lag.
        let gain = DMatrix::from_row_slice(2, 2, &[3.0, 2.0, 2.0, 3.0]);
        let (one, zero) = (DMatrix::identity(2, 2), DMatrix::zeros(2, 2));
        let lag = |pole: f64| {
            StateSpace::continuous(&one * pole, gain.clone(), one.clone(), zero.clone()).unwrap()
        };
        assert_abs_diff_eq!(lag(-2.0).norm_hinf().gain, 2.5, epsilon = 1e-12);
        for pole in [0.0, 1.0] {
            assert_eq!(lag(pole).norm_hinf().gain, f64::INFINITY);
        }
        let nothing = StateSpace::continuous(
            DMatrix::zeros(0, 0),
            DMatrix::zeros(0, 2),
            DMatrix::zeros(2, 0),
            gain,
        )
        .unwrap();
        assert_abs_diff_eq!(nothing.norm_hinf().gain, 5.0, epsilon = 1e-12);
        assert_eq!(
            StateSpace::continuous(one.clone() * -1.0, zero.clone(), one, zero)
                .unwrap()
                .norm_hinf()
                .gain,
            0.0
        );
    }
}

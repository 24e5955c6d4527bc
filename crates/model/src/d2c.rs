//! From a sampled model back to the continuous one behind a zero-order hold.

use deadtime_signal::decompositions::{singular_values, svd};
use nalgebra::{Complex, DMatrix};

use super::error::ModelError;
use super::matrix;
use super::state_space::{Continuous, Sampled, StateSpace};
use super::transfer_function::TransferFunction;

/// Methods of the conversion to continuous time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum D2c {
    /// The model whose zero-order-hold conversion is the sampled one.
    #[default]
    ZeroOrderHold,
    /// The inverse of Tustin's rule, z = (1 + sTs/2)/(1 − sTs/2).
    Tustin,
    /// Poles and zeros by their logarithms, for one input and one output; zeros at −1 are removed, because the forward conversion adds them.
    Matched,
}

/// As [`d2c`], by the given method.
///
/// # Errors
/// [`ModelError::NoLogarithm`] for a pole or zero without a continuous counterpart. Such roots are for the hold one at 0, for Tustin one at −1, for matching
/// one at 0 or on the negative real axis. [`ModelError::Count`] for matching several channels.
pub fn d2c_by(sys: &StateSpace<Sampled>, way: D2c) -> Result<StateSpace<Continuous>, ModelError> {
    match way {
        D2c::ZeroOrderHold => match d2c(sys) {
            Err(ModelError::NoLogarithm { re }) => with_pairs(sys, re),
            other => other,
        },
        D2c::Tustin => from_tustin(sys),
        D2c::Matched => from_matched(sys),
    }
}

fn delays_s(sys: &StateSpace<Sampled>) -> Vec<f64> {
    sys.input_delay().iter().map(|&d| sys.sample_time().to_seconds(d as f64)).collect()
}

/// The continuous model whose zero-order-hold conversion is `sys`: log of [A B; 0 I] over Ts. Whole-sample delays become seconds.
///
/// # Errors
/// [`ModelError::NoLogarithm`] for a pole at z = 0 or on the negative real axis (no real continuous model of this order has it).
pub fn d2c(sys: &StateSpace<Sampled>) -> Result<StateSpace<Continuous>, ModelError> {
    let (n, m) = (sys.order(), sys.inputs());
    let mut block = DMatrix::<f64>::identity(n + m, n + m);
    block.view_mut((0, 0), (n, n)).copy_from(sys.a());
    block.view_mut((0, n), (n, m)).copy_from(sys.b());
    let ts = sys.sample_time().seconds();
    let log = matrix::log(&block).map_err(|re| ModelError::NoLogarithm { re })? / ts;
    let (a, b) = (log.view((0, 0), (n, n)).into_owned(), log.view((0, n), (n, m)).into_owned());
    StateSpace::continuous(a, b, sys.c().clone(), sys.d().clone())?.with_input_delay(delays_s(sys))
}

/// With a second state for every simple pole p < 0: the pair ln|p| ± jπ then has its hold. MATLAB's `d2c` raises the order in the same way.
///
/// [A 0; 0 P] = exp [L −πV; πW ln|P|], A V = V P, WᵀA = P Wᵀ, WᵀV = I. L is the logarithm of A with |p| instead of p.
fn with_pairs(sys: &StateSpace<Sampled>, re: f64) -> Result<StateSpace<Continuous>, ModelError> {
    let none = || ModelError::NoLogarithm { re };
    let (n, m) = (sys.order(), sys.inputs());
    let poles = sys.poles();
    let size = poles.iter().map(|p| p.norm()).fold(0.0, f64::max);
    let negative: Vec<f64> =
        poles.iter().filter(|p| p.im == 0.0 && p.re < -1e-12 * size).map(|p| p.re).collect();
    let k = negative.len();
    let (mut v, mut w) = (DMatrix::zeros(n, k), DMatrix::zeros(n, k));
    for (j, pole) in negative.iter().enumerate() {
        let Some(found) = svd(&(sys.a() - DMatrix::identity(n, n) * *pole)) else {
            return Err(none());
        };
        let (Some(u), Some(vt)) = (found.u, found.v_t) else { return Err(none()) };
        let last = found.singular_values.imin();
        let (right, left) = (vt.row(last).transpose(), u.column(last).into_owned());
        let product = left.dot(&right);
        if product.abs() < 1e-8 {
            return Err(none());
        }
        v.set_column(j, &right);
        w.set_column(j, &(left / product));
    }
    let diagonal = |f: &dyn Fn(f64) -> f64| {
        DMatrix::from_fn(k, k, |i, j| if i == j { f(negative[i]) } else { 0.0 })
    };
    let turned = sys.a() - &v * diagonal(&|p| 2.0 * p) * w.transpose();
    let log = matrix::log(&turned).map_err(|re| ModelError::NoLogarithm { re })?;
    let (pi, order) = (std::f64::consts::PI, n + k);
    let mut a = DMatrix::zeros(order, order);
    a.view_mut((0, 0), (n, n)).copy_from(&log);
    a.view_mut((0, n), (n, k)).copy_from(&(&v * -pi));
    a.view_mut((n, 0), (k, n)).copy_from(&(w.transpose() * pi));
    a.view_mut((n, n), (k, k)).copy_from(&diagonal(&|p| p.abs().ln()));
    // B of the hold: ∫₀¹ e^(As) ds times that of the continuous model.
    let mut doubled = DMatrix::zeros(2 * order, 2 * order);
    doubled.view_mut((0, 0), (order, order)).copy_from(&a);
    doubled.view_mut((0, order), (order, order)).fill_with_identity();
    let held = matrix::exp(&doubled).view((0, order), (order, order)).into_owned();
    let mut b = DMatrix::zeros(order, m);
    b.rows_mut(0, n).copy_from(sys.b());
    let b = held.lu().solve(&b).ok_or_else(none)?;
    let mut c = DMatrix::zeros(sys.outputs(), order);
    c.columns_mut(0, n).copy_from(sys.c());
    let ts = sys.sample_time().seconds();
    StateSpace::continuous(a / ts, b / ts, c, sys.d().clone())?.with_input_delay(delays_s(sys))
}

/// A = (2/Ts)(Ad − I)(Ad + I)⁻¹, and with M = (Ad + I)/2: B = M⁻¹Bd/Ts, C = Cd·M⁻¹, D = Dd − C·Bd/2.
fn from_tustin(sys: &StateSpace<Sampled>) -> Result<StateSpace<Continuous>, ModelError> {
    let n = sys.order();
    let one = DMatrix::<f64>::identity(n, n);
    let middle = (sys.a() + &one) * 0.5;
    let singular = |s: nalgebra::DVector<f64>| s.min() <= 4.0 * f64::EPSILON * s.max();
    if singular_values(&middle).is_some_and(singular) {
        return Err(ModelError::NoLogarithm { re: -1.0 });
    }
    let none = || ModelError::NoLogarithm { re: -1.0 };
    let ts = sys.sample_time().seconds();
    let solved = middle.clone().lu();
    let a = solved.solve(&((sys.a() - &one) / ts)).ok_or_else(none)?;
    let b = solved.solve(&(sys.b() / ts)).ok_or_else(none)?;
    let c = middle.transpose().lu().solve(&sys.c().transpose()).ok_or_else(none)?.transpose();
    let d = sys.d() - &c * sys.b() * 0.5;
    StateSpace::continuous(a, b, c, d)?.with_input_delay(delays_s(sys))
}

fn from_matched(sys: &StateSpace<Sampled>) -> Result<StateSpace<Continuous>, ModelError> {
    for (what, got) in [
        ("inputs of a model by zero-pole matching", sys.inputs()),
        ("outputs of a model by zero-pole matching", sys.outputs()),
    ] {
        if got != 1 {
            return Err(ModelError::Count { what, needed: 1, got });
        }
    }
    let sampled = sys.transfer_function(0, 0)?;
    let ts = sys.sample_time().seconds();
    let back = |roots: &[Complex<f64>]| -> Result<Vec<Complex<f64>>, ModelError> {
        let one = |z: &Complex<f64>| {
            let none = z.norm() == 0.0 || (z.im == 0.0 && z.re < 0.0);
            if none { Err(ModelError::NoLogarithm { re: z.re }) } else { Ok(z.ln() / ts) }
        };
        roots.iter().map(one).collect()
    };
    let finite: Vec<Complex<f64>> =
        sampled.zeros().iter().copied().filter(|z| (z + 1.0).norm() > AT_MINUS_ONE).collect();
    let (zeros, poles) = (back(&finite)?, back(sampled.poles())?);
    // Gains are matched where neither model has a root: at rest, or at increasing real points.
    let at = (0..)
        .map(|k: u32| f64::from(k) * 0.1 / ts)
        .take(100)
        .find(|s| zeros.iter().chain(&poles).all(|r| (r - s).norm() * ts > 1e-3))
        .unwrap_or(0.05 / ts);
    let product = |roots: &[Complex<f64>]| roots.iter().map(|r| at - r).product::<Complex<f64>>();
    let gain = sampled.at(Complex::new((at * ts).exp(), 0.0)) * product(&poles) / product(&zeros);
    let delay_s = delays_s(sys).first().copied().unwrap_or(0.0);
    let found =
        TransferFunction::from_zeros_poles_gain(zeros, poles, gain.re, delay_s, Continuous)?;
    found.to_state_space()
}

/// Zeros within this distance of −1 are at −1 up to rounding.
const AT_MINUS_ONE: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use deadtime_signal::time::SampleTime;

    fn sampled(a: &[f64], n: usize) -> StateSpace<Sampled> {
        let (a, b) = (DMatrix::from_row_slice(n, n, a), DMatrix::from_element(n, 1, 1.0));
        StateSpace::sampled(
            a,
            b,
            DMatrix::from_element(1, n, 1.0),
            DMatrix::zeros(1, 1),
            SampleTime::new(0.1).unwrap(),
        )
        .unwrap()
    }

    #[test]
    fn a_negative_pole_has_no_continuous_counterpart() {
        let error = d2c(&sampled(&[-0.5, 0.0, 0.2, 0.3], 2)).unwrap_err();
        assert!(
            matches!(error, ModelError::NoLogarithm { re } if (re + 0.5).abs() < 1e-12),
            "{error}"
        );
    }

    #[test]
    fn a_pole_at_zero_has_no_continuous_counterpart_nor_has_a_chain_of_delays() {
        for (a, n) in [(vec![0.0], 1), (vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], 3)] {
            assert!(
                matches!(d2c(&sampled(&a, n)), Err(ModelError::NoLogarithm { re }) if re.abs() < 1e-12)
            );
        }
    }

    #[test]
    fn whole_samples_of_delay_become_seconds() {
        let sys = d2c(&sampled(&[0.5], 1).with_input_delay(vec![3]).unwrap()).unwrap();
        assert_abs_diff_eq!(sys.input_delay()[0], 0.3, epsilon = 1e-15);
        assert_abs_diff_eq!(sys.a()[(0, 0)], 0.5f64.ln() / 0.1, epsilon = 1e-12);
    }

    /// Three poles, two of them negative: the hold of the continuous model of raised order has the sampled model's response.
    #[test]
    fn simple_negative_poles_become_pairs_with_a_state_more_each() {
        use crate::c2d::{Conversion, ZeroOrderHold};
        let sys = sampled(&[-0.5, 0.2, 0.0, 0.0, -0.9, 0.3, 0.1, 0.0, 0.4], 3);
        let continuous = d2c_by(&sys, D2c::ZeroOrderHold).unwrap();
        let negative = sys.poles().iter().filter(|p| p.im == 0.0 && p.re < 0.0).count();
        assert_eq!(continuous.order(), 3 + negative);
        let again = ZeroOrderHold::default().c2d(&continuous, sys.sample_time()).unwrap();
        for omega in [0.0, 3.0, 20.0, 31.0] {
            let apart = again.frequency_response(omega) - sys.frequency_response(omega);
            assert!(apart.norm() < 1e-11, "{omega} {apart}");
        }
        assert!(d2c_by(&sampled(&[0.0], 1), D2c::ZeroOrderHold).is_err());
    }

    /// Each backward conversion inverts its forward conversion.
    #[test]
    fn tustin_and_matching_come_back_to_where_they_began() {
        use crate::c2d::{Conversion, Tustin, ZeroPoleMatching};
        let sys = StateSpace::continuous(
            DMatrix::from_row_slice(3, 3, &[-0.4, 3.0, 0.1, -2.0, -0.7, 0.4, 0.3, 0.0, -1.5]),
            DMatrix::from_column_slice(3, 1, &[1.0, 0.5, 0.2]),
            DMatrix::from_row_slice(1, 3, &[0.3, 2.0, 0.1]),
            DMatrix::from_element(1, 1, 0.0),
        )
        .unwrap();
        let ts = SampleTime::new(0.1).unwrap();
        let sampled = Tustin::default().c2d(&sys, ts).unwrap();
        let back = d2c_by(&sampled, D2c::Tustin).unwrap();
        for (got, want) in
            [(back.a(), sys.a()), (back.b(), sys.b()), (back.c(), sys.c()), (back.d(), sys.d())]
        {
            assert!((got - want).norm() < 1e-13, "{got} {want}");
        }
        let sampled = ZeroPoleMatching::default().c2d(&sys, ts).unwrap();
        let back = d2c_by(&sampled, D2c::Matched).unwrap();
        for omega in [0.0, 1.0, 10.0, 100.0] {
            let (got, want) = (back.frequency_response(omega), sys.frequency_response(omega));
            assert!((&got - &want).norm() < 1e-10 * want.norm(), "{omega} {got} {want}");
        }
    }
}

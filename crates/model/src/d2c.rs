//! From a sampled model back to the continuous one behind a zero-order hold.

use nalgebra::DMatrix;

use super::error::ModelError;
use super::matrix;
use super::state_space::{Continuous, Sampled, StateSpace};

/// The continuous model whose zero-order-hold conversion is `sys`: log of [A B; 0 I] over Ts. Whole-sample delays become seconds.
///
/// # Errors
/// [`ModelError::NoLogarithm`] for a pole at z = 0 or on the negative real axis (no real continuous model has it).
pub fn d2c(sys: &StateSpace<Sampled>) -> Result<StateSpace<Continuous>, ModelError> {
    let (n, m) = (sys.order(), sys.inputs());
    let mut block = DMatrix::<f64>::identity(n + m, n + m);
    block.view_mut((0, 0), (n, n)).copy_from(sys.a());
    block.view_mut((0, n), (n, m)).copy_from(sys.b());
    let ts = sys.sample_time().seconds();
    let log = matrix::log(&block).map_err(|re| ModelError::NoLogarithm { re })? / ts;
    let (a, b) = (log.view((0, 0), (n, n)).into_owned(), log.view((0, n), (n, m)).into_owned());
    let delays =
        sys.input_delay().iter().map(|&d| sys.sample_time().to_seconds(d as f64)).collect();
    StateSpace::continuous(a, b, sys.c().clone(), sys.d().clone())?.with_input_delay(delays)
}

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
}

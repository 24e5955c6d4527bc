//! Step and impulse responses of linear models, from rest: one matrix of samples × outputs per input.

use nalgebra::{DMatrix, DVector};

use super::error::SimulateError;
use super::lsim::{Options, Prehistory, lsim};
use crate::c2d::hold::{Hold, transition};
use crate::matrix::exp;
use crate::state_space::{Continuous, Sampled, StateSpace};
use deadtime_signal::time::SampleTime;

/// From rest: the input was 0 before the first sample.
fn rest() -> Options {
    Options { prehistory: Prehistory::Rest, ..Options::default() }
}

/// One input at 1 and the others at 0, throughout.
fn step(samples: usize, inputs: usize, input: usize) -> DMatrix<f64> {
    let mut u = DMatrix::zeros(samples, inputs);
    u.column_mut(input).fill(1.0);
    u
}

/// The outputs on a grid after a step of each input from 0 to 1 at the first sample, delays included.
///
/// # Errors
/// [`SimulateError::Explodes`] where the state is no longer finite.
pub fn step_response(
    sys: &StateSpace<Continuous>,
    sample_time: SampleTime,
    samples: usize,
) -> Result<Vec<DMatrix<f64>>, SimulateError> {
    (0..sys.inputs())
        .map(|j| Ok(lsim(sys, &step(samples, sys.inputs(), j), sample_time, &rest())?.y))
        .collect()
}

/// The same for a sampled model.
///
/// # Errors
/// As [`step_response`].
pub fn step_response_sampled(
    sys: &StateSpace<Sampled>,
    samples: usize,
) -> Result<Vec<DMatrix<f64>>, SimulateError> {
    (0..sys.inputs())
        .map(|j| Ok(lsim(sys, &step(samples, sys.inputs(), j), sys.sample_time(), &rest())?.y))
        .collect()
}

/// The impulse response C·exp(A(t − τ))·B on a grid, for t ≥ τ, the delay of the input. The impulse of a direct path is not included.
///
/// # Errors
/// As [`step_response`].
pub fn impulse_response(
    sys: &StateSpace<Continuous>,
    sample_time: SampleTime,
    samples: usize,
) -> Result<Vec<DMatrix<f64>>, SimulateError> {
    let ts = sample_time.seconds();
    let phi = transition(sys.a(), sys.b(), ts, Hold::Zero).0;
    let one = |j: usize| {
        let delay = sample_time.samples(sys.input_delay()[j])?;
        // The first sample at or after the impulse, and the time since it.
        let (first, since) = if delay.fraction == 0.0 {
            (delay.whole, 0.0)
        } else {
            (delay.whole + 1, 1.0 - delay.fraction)
        };
        let mut x: DVector<f64> = sys.b().column(j).into_owned();
        if since > 0.0 {
            x = exp(&(sys.a() * (since * ts))) * x;
        }
        let mut y = DMatrix::zeros(samples, sys.outputs());
        for k in first..samples {
            if x.iter().any(|v| !v.is_finite()) {
                return Err(SimulateError::Explodes { time_s: sample_time.to_seconds(k as f64) });
            }
            y.set_row(k, &(sys.c() * &x).transpose());
            x = &phi * x;
        }
        Ok(y)
    };
    (0..sys.inputs()).map(one).collect()
}

/// The response of a sampled model to one pulse of unit area, 1/Ts high and one sample long, as MATLAB's `impulse`. The response equals the Markov parameters
/// over Ts.
///
/// # Errors
/// As [`step_response`].
pub fn impulse_response_sampled(
    sys: &StateSpace<Sampled>,
    samples: usize,
) -> Result<Vec<DMatrix<f64>>, SimulateError> {
    let pulse = |j: usize| {
        let mut u = DMatrix::zeros(samples, sys.inputs());
        if let Some(first) = u.column_mut(j).get_mut(0) {
            *first = 1.0 / sys.sample_time().seconds();
        }
        Ok(lsim(sys, &u, sys.sample_time(), &rest())?.y)
    };
    (0..sys.inputs()).map(pulse).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lag(delay_s: f64) -> StateSpace<Continuous> {
        let one = DMatrix::identity(1, 1);
        let sys =
            StateSpace::continuous(&one * -2.0, &one * 3.0, one.clone(), DMatrix::zeros(1, 1))
                .unwrap();
        sys.with_input_delay(vec![delay_s]).unwrap()
    }

    /// y = 3 exp(−2(t − τ)) and 1.5 (1 − exp(−2(t − τ))), by hand.
    #[test]
    fn a_delayed_lag_answers_as_its_formula_says() {
        let ts = SampleTime::new(0.1).unwrap();
        for delay in [0.0, 0.2, 0.23] {
            let (impulse, step) = (
                &impulse_response(&lag(delay), ts, 12).unwrap()[0],
                &step_response(&lag(delay), ts, 12).unwrap()[0],
            );
            for k in 0..12u32 {
                let since = f64::from(k) * 0.1 - delay;
                let on = since > -1e-12;
                let e = (-2.0 * since).exp();
                let (want_impulse, want_step) =
                    if on { (3.0 * e, 1.5 * (1.0 - e)) } else { (0.0, 0.0) };
                assert!((impulse[k as usize] - want_impulse).abs() < 1e-14, "{delay} {k}");
                assert!((step[k as usize] - want_step).abs() < 1e-14, "{delay} {k}");
            }
        }
    }

    #[test]
    fn the_sampled_pulse_has_unit_area() {
        let one = DMatrix::identity(1, 1);
        let ts = SampleTime::new(0.25).unwrap();
        let sys = StateSpace::sampled(&one * 0.5, one.clone(), one.clone(), &one * 2.0, ts)
            .unwrap()
            .with_input_delay(vec![1])
            .unwrap();
        assert_eq!(
            impulse_response_sampled(&sys, 5).unwrap()[0].as_slice(),
            [0.0, 8.0, 4.0, 2.0, 1.0]
        );
        assert_eq!(step_response_sampled(&sys, 4).unwrap()[0].as_slice(), [0.0, 2.0, 3.0, 3.5]);
        assert!(impulse_response_sampled(&sys, 0).unwrap()[0].is_empty());
    }
}

//! Zero-pole matching.

use nalgebra::Complex;

use super::conversion::{Conversion, Converted, single};
use super::thiran;
use crate::state_space::{Continuous, Sampled, StateSpace};
use crate::transfer_function::TransferFunction;
use deadtime_signal::time::{SampleTime, Samples};

/// z = exp(s·Ts) for poles and zeros; all zeros at infinity but one go to z = −1. The gain is matched at s = 0, or at the first of s = 0.1/Ts, 0.2/Ts, …
/// without a pole or zero.
///
/// One input, one output; pole-zero pairs are cancelled first.
/// Source: MATLAB `c2d(…, 'matched')`; Franklin, Powell and Workman (1998), "Digital Control of Dynamic Systems", 3rd ed., section 6.2.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZeroPoleMatching {
    /// Largest order of the Thiran filter for a fractional delay; 0 (as MATLAB) rounds the delay to the nearest sample.
    pub fractional_delay_order: usize,
}

/// A pole and a zero within this relative distance cancel.
pub(super) const CANCEL: f64 = 1e-9;

impl Conversion for ZeroPoleMatching {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        single("zero-pole matching", sys)?;
        let ts = sample_time.seconds();
        let tf = sys.transfer_function(0, 0)?.cancelled(CANCEL);
        let map = |roots: &[Complex<f64>]| roots.iter().map(|s| (s * ts).exp()).collect::<Vec<_>>();
        let (mut zeros, poles) = (map(tf.zeros()), map(tf.poles()));
        zeros.resize((poles.len().max(1) - 1).max(zeros.len()), Complex::new(-1.0, 0.0));
        let (mut s, nearest) = (0.0, f64::EPSILON.sqrt() * tf.smallest_root());
        while tf.zeros().iter().chain(tf.poles()).any(|root| (root - s).norm() < nearest) {
            s += 0.1 / ts;
        }
        let unscaled = TransferFunction::from_zeros_poles_gain(
            zeros.clone(),
            poles.clone(),
            1.0,
            0,
            Sampled(sample_time),
        )?;
        let at = Complex::new(s, 0.0);
        let gain = (tf.at(at) / unscaled.at((at * ts).exp())).re;
        let matched =
            TransferFunction::from_zeros_poles_gain(zeros, poles, gain, 0, Sampled(sample_time))?;
        thiran::with_delays(
            matched.to_state_space()?,
            sys.input_delay(),
            sample_time,
            self.fractional_delay_order,
        )
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, self.fractional_delay_order)
    }
}

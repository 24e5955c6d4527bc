//! Tustin's (bilinear) conversion.

use nalgebra::DMatrix;

use super::conversion::{Conversion, Converted};
use super::thiran;
use crate::error::ModelError;
use crate::state_space::{Continuous, StateSpace};
use deadtime_signal::time::{SampleTime, Samples};

/// s → (2/Ts)(z − 1)/(z + 1), in the realisation of scipy and python-control:
/// M = (I − A·Ts/2)⁻¹, Ad = M(I + A·Ts/2), Bd = Ts·M·B, Cd = C·M, Dd = D + Ts/2·C·M·B.
///
/// Octave's and harold's states are √Ts of these, so an optimal gain K differs between the realisations; the transfer function does not.
/// Source: Tustin (1947), J. IEE 94(1), 130-142, doi:10.1049/ji-2a.1947.0020.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tustin {
    /// The frequency, rad/s, at which the sampled response equals the continuous one; `None`: 0.
    pub prewarp_rad_s: Option<f64>,
    /// Largest order of the Thiran filter for a fractional delay; 0 (as MATLAB) rounds the delay to the nearest sample.
    pub fractional_delay_order: usize,
}

impl Conversion for Tustin {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        let ts = match self.prewarp_rad_s {
            None => sample_time.seconds(),
            Some(rad_s) => {
                let nyquist_rad_s = sample_time.nyquist_rad_s();
                if !(rad_s > 0.0 && rad_s < nyquist_rad_s) {
                    return Err(ModelError::Prewarp { rad_s, nyquist_rad_s });
                }
                2.0 * (rad_s * sample_time.seconds() / 2.0).tan() / rad_s
            }
        };
        let n = sys.order();
        if n == 0 {
            let gain = StateSpace::sampled(
                sys.a().clone(),
                sys.b().clone(),
                sys.c().clone(),
                sys.d().clone(),
                sample_time,
            )?;
            return thiran::with_delays(
                gain,
                sys.input_delay(),
                sample_time,
                self.fractional_delay_order,
            );
        }
        let half = sys.a() * (ts / 2.0);
        let identity = DMatrix::<f64>::identity(n, n);
        let denominator = (&identity - &half).lu();
        let singular = ModelError::TustinPole { s: 2.0 / ts };
        let (Some(a), Some(mb)) =
            (denominator.solve(&(&identity + &half)), denominator.solve(sys.b()))
        else {
            return Err(singular);
        };
        // C·M from the transposed system.
        let Some(c) = (&identity - &half).transpose().lu().solve(&sys.c().transpose()) else {
            return Err(singular);
        };
        let d = sys.d() + sys.c() * &mb * (ts / 2.0);
        let sampled = StateSpace::sampled(a, mb * ts, c.transpose(), d, sample_time)?;
        thiran::with_delays(sampled, sys.input_delay(), sample_time, self.fractional_delay_order)
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, self.fractional_delay_order)
    }
}

//! Tustin's (bilinear) conversion.

use nalgebra::DMatrix;

use super::conversion::{Conversion, Converted};
use super::thiran;
use crate::error::ModelError;
use crate::state_space::{Continuous, StateSpace};
use deadtime_signal::time::{SampleTime, Samples};

/// s → (2/Ts)(z − 1)/(z + 1), in the realisation of scipy and python-control. M = (I − A·Ts/2)⁻¹, Ad = M(I + A·Ts/2), Bd = Ts·M·B, Cd = C·M, Dd = D +
/// Ts/2·C·M·B.
///
/// Octave's and harold's states are √Ts times these, so an optimal gain K differs between the realisations; the transfer function does not.
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
        let sampled = generalised(sys, ts, 0.5, sample_time)?;
        thiran::with_delays(sampled, sys.input_delay(), sample_time, self.fractional_delay_order)
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, self.fractional_delay_order)
    }
}

/// s → (z − 1)/(T(αz + 1 − α)), without delays. M = (I − αT·A)⁻¹, Ad = M(I + (1 − α)T·A), Bd = T·M·B, Cd = C·M, Dd = D + αT·C·M·B.
pub(super) fn generalised(
    sys: &StateSpace<Continuous>,
    step_s: f64,
    alpha: f64,
    sample_time: SampleTime,
) -> Converted {
    let n = sys.order();
    let [a, b, c, d] = [sys.a(), sys.b(), sys.c(), sys.d()];
    if n == 0 {
        return StateSpace::sampled(a.clone(), b.clone(), c.clone(), d.clone(), sample_time);
    }
    let (late, early) = (a * (alpha * step_s), a * ((1.0 - alpha) * step_s));
    let identity = DMatrix::<f64>::identity(n, n);
    let denominator = (&identity - &late).lu();
    let singular = ModelError::TustinPole { s: 1.0 / (alpha * step_s) };
    let (Some(by_a), Some(mb)) = (denominator.solve(&(&identity + &early)), denominator.solve(b))
    else {
        return Err(singular);
    };
    // C·M from the transposed system.
    let Some(seen) = (&identity - &late).transpose().lu().solve(&c.transpose()) else {
        return Err(singular);
    };
    let direct = d + c * &mb * (alpha * step_s);
    StateSpace::sampled(by_a, mb * step_s, seen.transpose(), direct, sample_time)
}

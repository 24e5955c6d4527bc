//! Conversions by difference quotients: forward, backward, and interpolations of the two.

use super::conversion::{Conversion, Converted};
use super::{thiran, tustin};
use crate::error::ModelError;
use crate::state_space::{Continuous, StateSpace};
use deadtime_signal::time::{SampleTime, Samples};

/// s → (z − 1)/(Ts(αz + 1 − α)): α = 0 is the forward difference (Euler), 1/2 Tustin, 1 the backward difference.
///
/// Delays are rounded to the nearest sample, half a sample up. With α < 1/2 a stable model may become unstable.
/// Source: Zhang, Chen and Wang (2009), "On discretization of continuous-time systems via the generalized bilinear transformation", IEEE CDC; scipy
/// `cont2discrete(…, 'gbt')`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GeneralisedBilinear {
    /// The share of the later sample, 0 to 1; default 1/2.
    pub alpha: f64,
}

impl Default for GeneralisedBilinear {
    fn default() -> Self {
        Self { alpha: 0.5 }
    }
}

/// The forward difference, s → (z − 1)/Ts.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ForwardDifference {}

/// The backward difference, s → (z − 1)/(Ts·z): stable models stay stable.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BackwardDifference {}

fn converted(sys: &StateSpace<Continuous>, sample_time: SampleTime, alpha: f64) -> Converted {
    let sampled = tustin::generalised(sys, sample_time.seconds(), alpha, sample_time)?;
    thiran::with_delays(sampled, sys.input_delay(), sample_time, 0)
}

impl Conversion for GeneralisedBilinear {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        if !(0.0..=1.0).contains(&self.alpha) {
            return Err(ModelError::Alpha { alpha: self.alpha });
        }
        converted(sys, sample_time, self.alpha)
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, 0)
    }
}

impl Conversion for ForwardDifference {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        converted(sys, sample_time, 0.0)
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, 0)
    }
}

impl Conversion for BackwardDifference {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        converted(sys, sample_time, 1.0)
    }

    fn rounds(&self, delay: Samples) -> Option<usize> {
        thiran::rounded(delay, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Complex, DMatrix};

    /// H(z) equals G at the mapped s, at every z.
    #[test]
    fn the_sampled_response_is_the_continuous_one_at_the_mapped_point() {
        let sys = StateSpace::continuous(
            DMatrix::from_row_slice(2, 2, &[-0.4, 3.0, -2.0, -0.7]),
            DMatrix::from_column_slice(2, 1, &[1.0, 0.5]),
            DMatrix::from_row_slice(1, 2, &[0.3, 2.0]),
            DMatrix::from_element(1, 1, 0.25),
        )
        .unwrap();
        let (ts, continuous) =
            (SampleTime::new(0.1).unwrap(), sys.transfer_function(0, 0).unwrap());
        let rules: [(f64, &dyn Conversion); 4] = [
            (0.0, &ForwardDifference {}),
            (0.3, &GeneralisedBilinear { alpha: 0.3 }),
            (0.5, &GeneralisedBilinear::default()),
            (1.0, &BackwardDifference {}),
        ];
        for (alpha, rule) in rules {
            let sampled = rule.c2d(&sys, ts).unwrap().transfer_function(0, 0).unwrap();
            for z in [Complex::new(0.2, 0.9), Complex::new(1.3, -0.4), Complex::new(-0.6, 0.1)] {
                let s = (z - 1.0) / ((z * alpha + 1.0 - alpha) * 0.1);
                let (got, expected) = (sampled.at(z), continuous.at(s));
                assert!((got - expected).norm() < 1e-12 * expected.norm(), "{alpha} {z}");
            }
        }
        assert!(GeneralisedBilinear { alpha: 1.5 }.c2d(&sys, ts).is_err());
    }
}

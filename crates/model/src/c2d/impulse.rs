//! Impulse invariance: the sampled impulse response, times the sample time.

use nalgebra::DMatrix;

use super::conversion::{Conversion, Converted};
use crate::error::ModelError;
use crate::matrix::exp;
use crate::state_space::{Continuous, StateSpace};
use deadtime_signal::time::SampleTime;

/// The treatment of a direct path, whose impulse response is an impulse.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Feedthrough {
    /// It is added to the sampled response: Dd = D + Ts·C·B.
    #[default]
    Keep,
    /// It is left out: Dd = Ts·C·B, which the published tables of the thesis need.
    Drop,
}

/// H(z) = Ts·Σ h(kTs) z⁻ᵏ with the full first sample, Dd = D + Ts·C·B.
///
/// A delay shifts h: its samples then start inside the response, and no state is added. Fails when: feedthrough is kept and an input with D ≠ 0 has a
/// fractional delay. The impulse of D then lies between two samples.
/// Source: MATLAB `c2d(…, 'impulse')`; Oppenheim and Schafer (2010), "Discrete-Time Signal Processing", 3rd ed., section 7.2.1.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImpulseInvariant {
    /// The treatment of D.
    pub feedthrough: Feedthrough,
}

impl Conversion for ImpulseInvariant {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        let ts = sample_time.seconds();
        let phi = exp(&(sys.a() * ts));
        let mut b = DMatrix::zeros(sys.order(), sys.inputs());
        let mut d = match self.feedthrough {
            Feedthrough::Keep => sys.d().clone(),
            Feedthrough::Drop => DMatrix::zeros(sys.outputs(), sys.inputs()),
        };
        let mut whole = Vec::with_capacity(sys.inputs());
        for (j, &delay_s) in sys.input_delay().iter().enumerate() {
            let delay = sample_time.samples(delay_s)?;
            let column = sys.b().column(j) * ts;
            if delay.fraction == 0.0 {
                b.set_column(j, &(&phi * &column));
                let mut direct = d.column_mut(j);
                direct += sys.c() * column;
            } else {
                if d.column(j).iter().any(|&v| v != 0.0) {
                    return Err(ModelError::ImpulseBetweenSamples {
                        input: j,
                        samples: delay.total(),
                    });
                }
                b.set_column(j, &(exp(&(sys.a() * (ts * (1.0 - delay.fraction)))) * column));
            }
            whole.push(delay.whole);
        }
        StateSpace::sampled(phi, b, sys.c().clone(), d, sample_time)?.with_input_delay(whole)
    }
}

//! The actuator lags: w′ = (u − w)/time_constant.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, Lateness, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The actuator follows with a first-order lag.
///
/// Assumes: one pole, settled at the start.
/// Fails when: the lag is short compared with the motion: a delay of the same length has nearly the same effect. On a single input, a lag of all sensors is an
/// alias.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActuatorLag;

impl Effect for ActuatorLag {
    fn facts(&self) -> Facts {
        Facts {
            lateness: Some(Lateness::Lag),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("actuator_lag", Site::Input, "the actuator follows with a first-order lag")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        Ok(vec![channel::time_constant("time_constant")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::times(scales)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.inputs[on.input()?].lags_s.push(values[0]);
        Ok(())
    }
}

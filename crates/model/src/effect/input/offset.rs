//! The actuator is off centre: u + offset.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The actuator is off centre.
///
/// Assumes: a constant offset in all logs.
/// Fails when: a constant disturbance of a state, or a sensor's offset, has the same effect on a settled linear plant. Only the transient distinguishes them.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors), for a constant error; here of the actuator.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputOffset;

impl Effect for InputOffset {
    fn facts(&self) -> Facts {
        Facts {
            is_constant: true,
            told_by: Some(Telling::OperatingPoint),
            ..Facts::of("input_offset", Site::Input, "the actuator is off centre")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.inputs[on.input()?]);
        Ok(vec![channel::free("offset", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        channel::both_signs([0.2 * spread.rms.max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let offset = values[0];
        plan.inputs[on.input()?]
            .maps
            .push(Arc::new(move |signal| signal.map(|p| (p.value + offset, p.slope))));
        Ok(())
    }
}

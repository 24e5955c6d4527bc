//! The actuator is nonlinear: u + quadratic·u·|u|.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The actuator has a quadratic characteristic.
///
/// Assumes: a static characteristic with odd symmetry about zero.
/// Fails when: the command has few levels: gain and offset then have the same effect. Small commands do not reveal the curve.
/// Source: Narendra and Gallman (1966), IEEE Transactions on Automatic Control 11, 546-550, doi:10.1109/TAC.1966.1098387, for a static curve before
/// linear dynamics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputCurve;

impl Effect for InputCurve {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("input_curve", Site::Input, "the actuator has a quadratic characteristic")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.inputs[on.input()?]);
        Ok(vec![channel::free("quadratic", format!("1/({unit})"), 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        channel::both_signs([0.3 / spread.quantiles[5].max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.inputs[on.input()?].curve.get_or_insert_default().quadratic += values[0];
        Ok(())
    }
}

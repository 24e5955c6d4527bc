//! Play between the plant and the measured position: the load follows the motor only once the play is used up.
//!
//! Equation: v(k) = max(y(k) − width, min(y(k) + width, v(k − 1))).

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// Play behind a stiff drive, measured on its far side.
///
/// Assumes: the far side stays in place within the play (by friction), and exerts no force. The play begins in its middle; samples are dense compared with the
/// motion.
/// Fails when: the motion seldom changes direction. Behind a position loop, a play of the command of the same width has nearly the same effect.
/// Source: Nordin and Gutman (2002), Automatica 38, 1633-1649, doi:10.1016/S0005-1098(02)00047-X.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutputBacklash;

impl Effect for OutputBacklash {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "output_backlash",
                Site::Output,
                "play between the plant and what a sensor sees",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.outputs[on.output()?]);
        Ok(vec![channel::not_negative("width", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        [0.02, 0.08, 0.3].map(|share| vec![share * spread.std]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.outputs[on.output()?].play += values[0];
        Ok(())
    }
}

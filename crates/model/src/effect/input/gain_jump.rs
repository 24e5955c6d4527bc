//! The gain of the actuator steps at a time: gain·u until then, later·u from then on.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::simulate::piecewise::Piecewise;
use crate::simulate::plan::Plan;

/// The gain of an actuator that steps, at the same time in every log: a motor that is lost, a load that drops.
///
/// Assumes: one step, at the same log time in every log; constant gains before and after.
/// Fails when: the step is close to an end of the log, or the command moves too little on one side of it. One gain then explains as much. Where the input acts
/// through one entry of B alone, a step of that entry is an alias.
/// Source: Zhang and Jiang (2008), Annual Reviews in Control 32, 229-252, doi:10.1016/j.arcontrol.2008.03.008 (abrupt loss of effectiveness).
#[derive(Debug, Clone, Copy)]
pub(crate) struct GainJump;

impl Effect for GainJump {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("input_gain"),
            changes: Some(Change::Jump),
            told_by: Some(Telling::Amplitude),
            ..Facts::of("gain_jump", Site::Input, "the gain of the actuator steps at a time")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        let gain = |name| channel::free(name, "1".to_owned(), 1.0);
        Ok(vec![gain("gain"), channel::instant(), gain("later")])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (gain, time_s, later) = (values[0], values[1], values[2]);
        let stepped = move |signal: Piecewise| signal.scaled_until(gain, time_s, later);
        plan.inputs[on.input()?].maps.push(Arc::new(stepped));
        Ok(())
    }
}

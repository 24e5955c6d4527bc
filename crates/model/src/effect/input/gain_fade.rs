//! The actuator weakens with time, as on a sagging battery: (1 − rate·t)·u.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The gain of the actuator fades with time.
///
/// Assumes: a gain that changes evenly with log time, in every log from its own start.
/// Fails when: the log is short against the fade, or the command stops early: a constant gain explains as much.
/// Source: Zhang and Jiang (2008), Annual Reviews in Control 32, 229-252, doi:10.1016/j.arcontrol.2008.03.008 (loss of effectiveness).
#[derive(Debug, Clone, Copy)]
pub(crate) struct GainFade;

impl Effect for GainFade {
    fn name(&self) -> &'static str {
        "gain_fade"
    }

    fn summary(&self) -> &'static str {
        "the gain of the actuator fades with time"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![channel::free("rate", "1/s".to_owned(), 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::both_signs([0.3 / scales.duration_s.max(f64::MIN_POSITIVE)])
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::OperatingPoint)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let rate = values[0];
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(move |signal| {
            // A command is held, so its product with a straight line is straight.
            signal.map(|p| (p.value * (1.0 - rate * p.start_s), -p.value * rate))
        }));
        Ok(())
    }
}

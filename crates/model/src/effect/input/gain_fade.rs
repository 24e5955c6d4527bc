//! The actuator weakens with time, as on a sagging battery: (1 − rate·t)·u.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The gain of the actuator fades with time.
///
/// Assumes: a gain that changes linearly with log time, relative to each log's own start.
/// Fails when: the log is short compared with the fade, or the command stops early: a constant gain explains as much.
/// Source: Zhang and Jiang (2008), Annual Reviews in Control 32, 229-252, doi:10.1016/j.arcontrol.2008.03.008 (loss of effectiveness).
#[derive(Debug, Clone, Copy)]
pub(crate) struct GainFade;

impl Effect for GainFade {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::OperatingPoint),
            ..Facts::of("gain_fade", Site::Input, "the gain of the actuator fades with time")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        Ok(vec![channel::free("rate", "1/s".to_owned(), 0.0)])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::both_signs([0.3 / scales.duration_s.max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let rate = values[0];
        plan.inputs[on.input()?].maps.push(Arc::new(move |signal| {
            // A held command times a linear function is linear.
            signal.map(|p| (p.value * (1.0 - rate * p.start_s), -p.value * rate))
        }));
        Ok(())
    }
}

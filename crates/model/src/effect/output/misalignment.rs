//! A sensor also measures another output: gain of one output, added to another.
//!
//! Equation: v = y + gain·from.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// A sensor also measures another output.
///
/// Assumes: a constant share of one other output.
/// Fails when: the two outputs are correlated in the log: a gain of the sensor has nearly the same effect.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Misalignment;

impl Effect for Misalignment {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`from->y`: one output into another",
            ..Facts::of("misalignment", Site::Output, "a sensor also sees another output")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::arrows(&system.outputs)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (from, to) = on.arrow(&on.system.outputs)?;
        Ok(vec![channel::free(
            "gain",
            channel::ratio(&on.system.outputs[to], &on.system.outputs[from]),
            0.0,
        )])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((from, to)) = on.arrow(&on.system.outputs) else {
            return Vec::new();
        };
        let Some((from, to)) = scales.outputs.get(from).zip(scales.outputs.get(to)) else {
            return Vec::new();
        };
        channel::both_signs([0.1 * to.std / from.std.max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (from, to) = on.arrow(&on.system.outputs)?;
        plan.outputs[to].mixing.push((from, values[0]));
        Ok(())
    }
}

//! Two outputs are swapped in the log: the order of two columns, or of two sensors.
//!
//! Equation: v_a = (1 − share)·y_a + share·y_b and v_b = (1 − share)·y_b + share·y_a; a share of 1 swaps them.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Two outputs are swapped.
///
/// Assumes: both have one unit. The swap precedes the other effects of their sensors.
/// Fails when: both outputs are equal.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (axes and their alignment).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SwappedOutputs;

impl Effect for SwappedOutputs {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`a<->b`: two outputs of equal unit",
            ..Facts::of("swapped_outputs", Site::Output, "two outputs are swapped")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::alike(&system.outputs)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.swap(&on.system.outputs)?;
        Ok(vec![channel::share()])
    }

    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        vec![vec![1.0]]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (a, b) = on.swap(&on.system.outputs)?;
        let share = values[0];
        for (to, from) in [(a, b), (b, a)] {
            plan.outputs[to].mixing.extend([(to, -share), (from, share)]);
        }
        Ok(())
    }
}

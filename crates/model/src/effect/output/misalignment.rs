//! A sensor also sees what another one measures: gain of one output, added to another.
//!
//! Equation: v = y + gain·from.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// A sensor also sees another output.
///
/// Assumes: a constant share of one other output.
/// Fails when: the two outputs move together in the log: a gain of the sensor does nearly the same.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Misalignment;

impl Effect for Misalignment {
    fn name(&self) -> &'static str {
        "misalignment"
    }

    fn summary(&self) -> &'static str {
        "a sensor also sees another output"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn rule(&self) -> &'static str {
        "`from->y`: one output into another"
    }

    fn channels(&self, system: &System) -> Vec<String> {
        let pairs =
            system.outputs.iter().flat_map(|from| system.outputs.iter().map(move |to| (from, to)));
        pairs
            .filter(|(from, to)| from.name != to.name)
            .map(|(from, to)| format!("{}->{}", from.name, to.name))
            .collect()
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let (from, to) = channel::arrow(self, system, channel, &system.outputs)?;
        Ok(vec![channel::free(
            "gain",
            channel::ratio(&system.outputs[to], &system.outputs[from]),
            0.0,
        )])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((from, to)) = channel::arrow(self, system, channel, &system.outputs) else {
            return Vec::new();
        };
        let Some((from, to)) = scales.outputs.get(from).zip(scales.outputs.get(to)) else {
            return Vec::new();
        };
        channel::both_signs([0.1 * to.std / from.std.max(f64::MIN_POSITIVE)])
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (from, to) = channel::arrow(self, system, channel, &system.outputs)?;
        plan.outputs[to].mixing.push((from, values[0]));
        Ok(())
    }
}

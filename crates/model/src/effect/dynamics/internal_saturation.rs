//! A quantity inside the model has limits: the actuator does not deliver the controller's full demand.
//!
//! Equation: v = min(max(r, lower), upper), r the quantity of the model.

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::equations::inner::InnerMap;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The torque, the current or the voltage inside a loop has limits.
///
/// Assumes: hard limits of one quantity; other effects on the same state are outside them.
/// Fails when: the quantity never reaches them. With small gravity and damping, a limit of the whole acceleration explains as much; behind a stiff loop, a rate
/// limit of the command does.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct InternalSaturation;

impl Effect for InternalSaturation {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::RULE,
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "internal_saturation",
                Site::Dynamics,
                "a quantity inside a loop has limits",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::controls(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = on.quantity()?;
        Ok(vec![
            channel::free("lower", unit.clone(), f64::NEG_INFINITY),
            channel::free("upper", unit, f64::INFINITY),
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        on.quantity_spread(scales).map(channel::limits).unwrap_or_default()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        on.rewrite(plan, |e| e.with_inner_map(on.channel, InnerMap::Limits), values)
    }
}

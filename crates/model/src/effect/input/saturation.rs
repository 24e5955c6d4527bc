//! The actuator has stops: u between lower and upper.
//!
//! Equation: v = min(max(u, lower), upper).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The actuator has stops.
///
/// Assumes: hard stops that do not move.
/// Fails when: no command reaches a stop: the stop is then not in the data. Where every command does, a gain explains as much.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Saturation;

impl Effect for Saturation {
    fn name(&self) -> &'static str {
        "saturation"
    }

    fn summary(&self) -> &'static str {
        "the actuator has stops"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.inputs[channel::input(self, system, channel)?]);
        Ok(vec![
            channel::free("lower", unit.clone(), f64::NEG_INFINITY),
            channel::free("upper", unit, f64::INFINITY),
        ])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::input(self, system, channel).ok().and_then(|i| scales.inputs.get(i))
        else {
            return Vec::new();
        };
        channel::limits(spread)
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Amplitude)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (lower, upper) = (values[0], values[1]);
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(move |signal| {
            signal.map_with_kinks(&[lower, upper], |u| {
                if u < lower {
                    (lower, 0.0)
                } else if u > upper {
                    (upper, 0.0)
                } else {
                    (u, 1.0)
                }
            })
        }));
        Ok(())
    }
}

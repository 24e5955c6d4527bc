//! The actuator has stops: u between lower and upper.
//!
//! Equation: v = min(max(u, lower), upper).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The actuator has stops.
///
/// Assumes: hard, constant stops.
/// Fails when: no command reaches a stop: the stop is then invisible. If every command reaches one, a gain explains as much.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Saturation;

impl Effect for Saturation {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("saturation", Site::Input, "the actuator has stops")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.inputs[on.input()?]);
        Ok(vec![
            channel::free("lower", unit.clone(), f64::NEG_INFINITY),
            channel::free("upper", unit, f64::INFINITY),
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        channel::limits(spread)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (lower, upper) = (values[0], values[1]);
        plan.inputs[on.input()?].maps.push(Arc::new(move |signal| {
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

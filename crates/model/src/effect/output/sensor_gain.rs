//! A sensor has another gain: gain·y.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor has another gain.
///
/// Assumes: a constant scale factor about zero.
/// Fails when: it acts on all outputs and there is one input: a gain of the input is an alias for a linear plant.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorGain;

impl Effect for SensorGain {
    fn facts(&self) -> Facts {
        Facts {
            rule: "an output, or `*`: all outputs",
            told_by: Some(Telling::Amplitude),
            ..Facts::of("sensor_gain", Site::Output, "the sensor has another gain")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::shared(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.outputs()?;
        Ok(vec![channel::free("gain", "1".to_owned(), 1.0)])
    }

    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.8], vec![1.25], vec![-1.0]]
    }

    fn of_factor(&self, factor: f64) -> Option<Vec<f64>> {
        Some(vec![factor])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let gain = values[0];
        for i in on.outputs()? {
            plan.outputs[i].maps.push(Arc::new(move |_, y| gain * y));
            plan.outputs[i].slope *= gain;
        }
        Ok(())
    }
}

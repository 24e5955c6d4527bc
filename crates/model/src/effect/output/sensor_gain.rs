//! A sensor reads too much or too little: gain·y.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor has another gain.
///
/// Assumes: a constant scale factor about zero.
/// Fails when: it acts on all outputs and there is one input: a gain of the input is the same for a linear plant.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorGain;

impl Effect for SensorGain {
    fn name(&self) -> &'static str {
        "sensor_gain"
    }

    fn summary(&self) -> &'static str {
        "the sensor has another gain"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn rule(&self) -> &'static str {
        "an output, or `*`: all outputs"
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::shared(system)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::outputs(self, system, channel)?;
        Ok(vec![channel::free("gain", "1".to_owned(), 1.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel, scales);
        vec![vec![0.8], vec![1.25], vec![-1.0]]
    }

    fn of_factor(&self, factor: f64) -> Option<Vec<f64>> {
        Some(vec![factor])
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
        let gain = values[0];
        for i in channel::outputs(self, system, channel)? {
            plan.outputs[i].maps.push(Arc::new(move |_, y| gain * y));
            plan.outputs[i].slope *= gain;
        }
        Ok(())
    }
}

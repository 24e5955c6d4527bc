//! The actuator delivers more or less than commanded: gain·u.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The actuator has another gain.
///
/// Assumes: a constant gain on the whole command.
/// Fails when: there is one input: a gain of all outputs, or of one column of B, is an alias for a linear plant.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputGain;

impl Effect for InputGain {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("input_gain", Site::Input, "the actuator has another gain")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        Ok(vec![channel::free("gain", "1".to_owned(), 1.0)])
    }

    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.8], vec![1.25], vec![-1.0]]
    }

    fn of_factor(&self, factor: f64) -> Option<Vec<f64>> {
        Some(vec![1.0 / factor])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.inputs[on.input()?].curve.get_or_insert_default().gain *= values[0];
        Ok(())
    }
}

//! Commands pass at certain times only and are held in between, as through a slower loop: at phase, phase + period, phase + 2·period, ….

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, Lateness, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::simulate::plan::Plan;

/// A slower loop in the path of the commands.
///
/// Assumes: a strictly periodic slower loop, with commands held between its times.
/// Fails when: the commands change less often than the slower loop runs; its mean delay, half a period, then resembles `input_delay`.
/// Source: Åström and Wittenmark (1997), Computer-Controlled Systems, 3rd edition (multirate sampling).
#[derive(Debug, Clone, Copy)]
pub(crate) struct MultiRate;

impl Effect for MultiRate {
    fn facts(&self) -> Facts {
        Facts {
            lateness: Some(Lateness::SlowerLoop),
            elaborates: Some("input_delay"),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of(
                "multi_rate",
                Site::Input,
                "commands pass at the times of a slower loop only",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        let period = Parameter { role: Role::Period, ..channel::delay("period") };
        // Additional whole periods have no effect.
        let phase = Parameter { role: Role::Shape, ..channel::free("phase", "s".to_owned(), 0.0) };
        Ok(vec![period, phase])
    }

    /// The first passing time at or after the log's first sample.
    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        let (period, phase) = (values[0], values[1]);
        if period > 0.0 && !(0.0..period).contains(&phase) {
            vec![period, phase.rem_euclid(period)]
        } else {
            values
        }
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.inputs[on.input()?].passing = Some((values[0], values[1]));
        Ok(())
    }
}

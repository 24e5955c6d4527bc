//! The delay of a command changes with time: the plant input at t is the command of t − (delay + rate·t).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::simulate::piecewise::Piecewise;
use crate::simulate::plan::Plan;

/// Bound of the rate, s/s: at 1 no later command would ever arrive.
const FASTEST: f64 = 0.9;

/// A dead time that drifts; never below zero.
///
/// Assumes: one rate in all logs; commands arrive in order.
/// Fails when: the drift over the log is small compared with a sample: one delay explains as much. Two clocks of different rates shift outputs in the same way.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes, for the constant delay. The growth is that of two clocks, as `clock_skew`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayDrift;

impl Effect for DelayDrift {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("input_delay"),
            changes: Some(Change::Drift),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of(
                "delay_drift",
                Site::Input,
                "the command arrives late, by a delay that grows or shrinks with time",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        let rate = Parameter {
            lower: -FASTEST,
            upper: FASTEST,
            ..channel::free("rate", "1".to_owned(), 0.0)
        };
        Ok(vec![channel::delay("delay"), rate])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (delay_s, rate) = (values[0], values[1]);
        let drifted = move |signal: Piecewise| signal.drifting(delay_s, rate);
        plan.inputs[on.input()?].maps.push(Arc::new(drifted));
        Ok(())
    }
}

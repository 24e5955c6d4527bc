//! Small commands have no effect: sign(u)·max(|u| − width, 0).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// Small commands have no effect.
///
/// Assumes: a dead zone symmetric about zero, before all elements with memory.
/// Fails when: all commands are far larger than the width: the loss is then an offset that changes sign with the command. Dry friction also suppresses small
/// commands.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deadband;

impl Effect for Deadband {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("deadband", Site::Input, "small commands do nothing")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.inputs[on.input()?]);
        Ok(vec![channel::not_negative("width", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        [0.1, 0.25, 0.5, 0.75]
            .map(|share| vec![share * spread.quantiles[5]])
            .into_iter()
            .chain([vec![0.5 * spread.quantiles[2]]])
            .collect()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let width = values[0];
        plan.inputs[on.input()?].maps.push(Arc::new(move |signal| {
            signal.map_with_kinks(&[-width, width], |u| {
                if u.abs() <= width { (0.0, 0.0) } else { (u - width * u.signum(), 1.0) }
            })
        }));
        Ok(())
    }
}

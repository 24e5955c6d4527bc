//! A quantity inside the model has a dead zone: small values have no effect.
//!
//! Equation: v = r − min(max(r, −width), width), r the quantity of the model.

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::equations::inner::InnerMap;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// A dead zone inside a loop.
///
/// Assumes: the zone is symmetric about 0 and constant.
/// Fails when: the quantity is large throughout: an offset of either sign explains as much. At rest it leaves an error, as dry friction does.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct InternalDeadband;

impl Effect for InternalDeadband {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::RULE,
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "internal_deadband",
                Site::Dynamics,
                "a quantity inside a loop has a dead zone",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::controls(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        Ok(vec![channel::not_negative("width", on.quantity()?, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.quantity_spread(scales) else { return Vec::new() };
        [0.02, 0.1, 0.3].map(|share| vec![share * spread.quantiles[5]]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        on.rewrite(plan, |e| e.with_inner_map(on.channel, InnerMap::DeadZone), values)
    }
}

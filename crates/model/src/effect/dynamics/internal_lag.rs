//! A quantity inside the model lags: v′ = (r − v)/time_constant, r the quantity of the model.

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{InnerFilter, Plan};
use crate::simulate::system::System;

/// A first-order lag inside a loop: a motor's winding, a valve, a filter.
///
/// Assumes: one pole, settled at the start of a log.
/// Fails when: the lag is short compared with the loop. A dead time of the same length inside the loop has nearly the same effect, and so does less damping.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InternalLag;

impl Effect for InternalLag {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::RULE,
            told_by: Some(Telling::Bandwidth),
            ..Facts::of(
                "internal_lag",
                Site::Dynamics,
                "a quantity inside a loop follows with a first-order lag",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::controls(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.quantity()?;
        Ok(vec![channel::time_constant("time_constant")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        internal::times(scales)
    }

    /// 2 % of a sample: below it the effect is invisible in the samples, and the integration steps become ever shorter.
    fn least(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<f64> {
        vec![internal::LEAST * scales.sample_time_s]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        if values[0] == 0.0 {
            return on.quantity().map(|_| ());
        }
        on.rewrite(plan, |e| e.with_open_quantity(on.channel), &[])?;
        plan.filters.push(InnerFilter::Lag(values[0]));
        Ok(())
    }
}

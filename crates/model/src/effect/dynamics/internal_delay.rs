//! A quantity inside the model is late: v(t) = r(t − delay), r the quantity of the model.

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{InnerFilter, Plan};
use crate::simulate::system::System;

/// A dead time inside a loop: a controller that computes, a bus between it and the drive.
///
/// Assumes: the quantity rests before the log. Nonlinear equations are simulated with the quantity's own history. Affine ones use a Padé approximant of order 3
/// over 4, with a phase error below 0.1 % up to ω·delay = 3.
/// Fails when: the delay is short compared with the motion. A lag of the same length inside the loop has nearly the same effect, and so does less damping.
/// Source: Bellen and Zennaro (2003), Numerical Methods for Delay Differential Equations, chapter 3; Baker and Graves-Morris (1996), Padé Approximants, section 1.2.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InternalDelay;

impl Effect for InternalDelay {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::RULE,
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("internal_delay", Site::Dynamics, "a quantity inside a loop is late")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::controls(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.quantity()?;
        Ok(vec![channel::delay("delay")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        internal::times(scales)
    }

    /// As for a lag.
    fn least(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<f64> {
        vec![internal::LEAST * scales.sample_time_s]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        if values[0] == 0.0 {
            return on.quantity().map(|_| ());
        }
        on.rewrite(plan, |e| e.with_open_quantity(on.channel), &[])?;
        plan.filters.push(InnerFilter::Delay(values[0]));
        Ok(())
    }
}

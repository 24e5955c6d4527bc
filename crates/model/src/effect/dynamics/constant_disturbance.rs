//! A constant disturbance on a state's derivative.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// A constant disturbance.
///
/// Assumes: a constant disturbance, the same in all logs.
/// Fails when: an offset of the input moves the same state. A sensor's offset differs from it only while the plant settles.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstantDisturbance;

impl Effect for ConstantDisturbance {
    fn facts(&self) -> Facts {
        Facts {
            is_constant: true,
            told_by: Some(Telling::OperatingPoint),
            ..Facts::of("constant_disturbance", Site::Dynamics, "a constant force acts")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::per(&on.system.states[on.state()?], "s");
        Ok(vec![channel::free("level", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) = on.derivative(scales) else { return Vec::new() };
        channel::both_signs([0.1 * size])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.terms.push(Term::Constant { to: on.state()?, level: values[0] });
        Ok(())
    }
}

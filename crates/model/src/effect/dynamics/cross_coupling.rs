//! A state or input moves a state without such a coupling in the model: gain·from on the derivative of `to`.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Source, Term};
use crate::simulate::system::System;

/// A coupling that the model lacks.
///
/// Assumes: a linear coupling of one state or input into one state.
/// Fails when: the two states are correlated in the log: an existing entry of A then explains as much.
/// Source: Ljung (1999), System Identification: Theory for the User, 2nd edition (grey-box models).
#[derive(Debug, Clone, Copy)]
pub(crate) struct CrossCoupling;

impl Effect for CrossCoupling {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`from->x`: a state or input into a state that does not depend on it in the model",
            ..Facts::of("cross_coupling", Site::Dynamics, "a coupling that the model lacks")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        let mut channels = Vec::new();
        let states =
            system.states.iter().enumerate().map(|(j, from)| (Source::State(j), &from.name));
        let inputs =
            system.inputs.iter().enumerate().map(|(j, from)| (Source::Input(j), &from.name));
        for (source, from) in states.chain(inputs) {
            let apart = system.states.iter().enumerate().filter(|&(i, _)| {
                source != Source::State(i) && !channel::depends(system, i, source)
            });
            channels.extend(apart.map(|(_, to)| format!("{from}->{}", to.name)));
        }
        channels
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (from, to) = on.coupling()?;
        let from = match from {
            Source::State(i) => &on.system.states[i],
            Source::Input(i) => &on.system.inputs[i],
        };
        let unit = channel::unit(from);
        let derivative = channel::per(&on.system.states[to], "s");
        Ok(vec![channel::free(
            "gain",
            if unit == "1" { derivative } else { format!("({derivative})/({unit})") },
            0.0,
        )])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((from, to)) = on.coupling() else { return Vec::new() };
        let size = match from {
            Source::State(i) => scales.states.get(i),
            Source::Input(i) => scales.inputs.get(i),
        };
        let Some((size, derivative)) = size.zip(scales.derivatives.get(to)) else {
            return Vec::new();
        };
        channel::both_signs([0.2 * derivative / size.rms.max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (from, to) = on.coupling()?;
        plan.terms.push(Term::Linear { to, from, gain: values[0] });
        Ok(())
    }
}

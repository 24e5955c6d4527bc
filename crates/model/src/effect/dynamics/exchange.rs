//! Two states that exchange what they store: gain·(a − b) on the derivative of b, and minus that on the derivative of a.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Source, Term};
use crate::simulate::system::System;

/// An exchange that the model lacks: of heat between bodies, of liquid between tanks.
///
/// Assumes: both states have one unit and one capacity, and their sum is conserved.
/// Fails when: only one of the two states moves or is measured: a leak, an entry of A, does nearly the same.
/// Source: Godfrey (1983), Compartmental Models and Their Application.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exchange;

impl Effect for Exchange {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`a<->b`: two states of equal unit that do not depend on each other in the model",
            ..Facts::of(
                "exchange",
                Site::Dynamics,
                "an exchange between two states that the model lacks",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        let states = &system.states;
        let apart = |i: usize, j: usize| {
            !channel::depends(system, i, Source::State(j))
                && !channel::depends(system, j, Source::State(i))
        };
        let alike =
            |i: usize, j: usize| states[i].unit.is_some() && states[i].unit == states[j].unit;
        let pairs = (0..states.len()).flat_map(|i| (i + 1..states.len()).map(move |j| (i, j)));
        pairs
            .filter(|&(i, j)| alike(i, j) && apart(i, j))
            .map(|(i, j)| format!("{}<->{}", states[i].name, states[j].name))
            .collect()
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.exchange()?;
        Ok(vec![channel::free("gain", "1/s".to_owned(), 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((a, b)) = on.exchange() else { return Vec::new() };
        let size = |i: usize| scales.states.get(i).map_or(0.0, |s| s.rms).max(f64::MIN_POSITIVE);
        let moved = |i: usize| scales.derivatives.get(i).copied().unwrap_or(0.0);
        channel::both_signs([0.2 * f64::max(moved(a), moved(b)) / f64::max(size(a), size(b))])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (a, b) = on.exchange()?;
        for (to, sign) in [(b, 1.0), (a, -1.0)] {
            plan.terms.push(Term::Linear { to, from: Source::State(a), gain: sign * values[0] });
            plan.terms.push(Term::Linear { to, from: Source::State(b), gain: -sign * values[0] });
        }
        Ok(())
    }
}

//! A force that depends on the path: −level·z on the derivative of the velocity x. Here ż = x/displacement·(1 − |z|ⁿ) where x and z have one sign, and ż =
//! x/displacement otherwise.
//!
//! This is Wen's law with β = γ in the normalised form of Ikhouane and Rodellar (2007) with σ = ½. A small displacement makes it dry friction, a large
//! one a spring.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// A force that depends on the path: hysteresis.
///
/// Assumes: the state is a velocity; loading and unloading are symmetric, without wear.
/// Fails when: the motion is much smaller than the displacement (a spring explains as much) or much larger (dry friction does).
/// Source: Wen (1976), J. Eng. Mech. Div. 102, 249-263; Ikhouane and Rodellar (2007), Systems with Hysteresis, doi:10.1002/9780470513200.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hysteresis;

impl Effect for Hysteresis {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("coulomb_friction"),
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "hysteresis",
                Site::Dynamics,
                "a force that depends on the way there (Bouc-Wen)",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let state = &on.system.states[on.state()?];
        let way = match channel::unit(state).as_str() {
            "1" => "s".to_owned(),
            unit => format!("({unit})*s"),
        };
        Ok(vec![
            channel::not_negative("level", channel::per(state, "s"), 0.0),
            Parameter {
                role: Role::Shape,
                lower: 1e-12,
                ..channel::free("displacement", way, 1.0)
            },
            Parameter {
                role: Role::Shape,
                lower: 1.0,
                upper: 10.0,
                ..channel::free("sharpness", "1".to_owned(), 1.5)
            },
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok(i) = on.state() else { return Vec::new() };
        let Some((speed, force)) = scales.states.get(i).zip(scales.derivatives.get(i)) else {
            return Vec::new();
        };
        // The path length of a sine with that speed and that acceleration.
        let way = (speed.std * speed.std / force).max(1e-12);
        let guesses = |share: f64| [0.1, 0.5].map(|part| vec![share * force, part * way, 2.0]);
        [0.1, 0.4].into_iter().flat_map(guesses).collect()
    }

    /// 1 % of the usual path within a sample. A shorter one changes less than 5 % of dry friction's effect and takes ever more steps.
    fn least(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<f64> {
        let speed =
            on.state().ok().and_then(|i| scales.states.get(i)).map_or(0.0, |speed| speed.rms);
        vec![0.0, 0.01 * speed * scales.sample_time_s, 1.0]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let velocity = on.state()?;
        plan.terms.push(Term::Hysteresis {
            velocity,
            level: values[0],
            displacement: values[1],
            sharpness: values[2],
        });
        Ok(())
    }
}

//! Dry friction that is larger at low speed: −(level + extra·exp(−(x/velocity)²))·sign(x) on the derivative of the velocity x, which sticks at 0.
//!
//! The falling curve is that of Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, eq. 5 with δ = 2 and without its viscous part,
//! doi:10.1016/0005-1098(94)90209-7. The law is dry friction of level + extra, minus the part extra·(1 − exp(−(x/velocity)²)) that speed removes. The removed
//! part is 0 at rest, so the contact sticks and breaks away at level + extra.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// Dry friction that is larger at low speed.
///
/// Assumes: the state is a velocity; the level falls with speed by a Gaussian curve.
/// Fails when: the log has few samples at low speed: dry friction explains as much.
/// Source: Armstrong-Hélouvry, Dupont and Canudas de Wit (1994), Automatica 30, 1083-1138, doi:10.1016/0005-1098(94)90209-7.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StribeckFriction;

impl Effect for StribeckFriction {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("coulomb_friction"),
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "stribeck_friction",
                Site::Dynamics,
                "dry friction that sticks, larger at low speed",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let state = &on.system.states[on.state()?];
        let force = channel::per(state, "s");
        Ok(vec![
            channel::not_negative("level", force.clone(), 0.0),
            channel::not_negative("extra", force, 0.0),
            Parameter {
                role: Role::Shape,
                lower: 1e-9,
                ..channel::free("velocity", channel::unit(state), 1.0)
            },
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok(i) = on.state() else { return Vec::new() };
        let Some((speed, force)) = scales.states.get(i).zip(scales.derivatives.get(i)) else {
            return Vec::new();
        };
        let guesses = |share: f64| {
            [0.1, 0.4].map(|slow| vec![share * force, share * force, (slow * speed.rms).max(1e-9)])
        };
        [0.1, 0.4].into_iter().flat_map(guesses).collect()
    }

    /// 2 % of the usual change within a sample: below it, less than 5 % of the friction's effect changes. The remaining effect is the breakaway force.
    fn least(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<f64> {
        let pull = on.state().ok().and_then(|i| scales.derivatives.get(i)).copied().unwrap_or(0.0);
        vec![0.0, 0.0, 0.02 * pull * scales.sample_time_s]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let state = on.state()?;
        let (level, extra, velocity) = (values[0], values[1], values[2]);
        plan.terms.push(Term::Friction { state, level: level + extra });
        if extra != 0.0 {
            let taken = move |x: f64| x.signum() * extra * -f64::exp_m1(-(x / velocity).powi(2));
            plan.terms.push(Term::Function { to: state, from: state, f: Arc::new(taken) });
        }
        Ok(())
    }
}

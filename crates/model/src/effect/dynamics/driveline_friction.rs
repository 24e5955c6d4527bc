//! Dry friction between two bodies: a torque against the change of the twist, equal and opposite on both.
//!
//! Equation: the twist d = x1 − x2 becomes d + level·tanh((x1′ − x2′)/speed) throughout the equations. Times the stiffness of the link, `level` is a torque.

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::equations::inner::InnerMap;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Dry friction in the link between two bodies: of teeth, of a belt, of a shaft in its hub.
///
/// Assumes: the friction has its full level above a relative speed of about `speed`. Below it is viscous, so the bodies creep instead of sticking. The level is
/// constant.
/// Fails when: the twist changes at one rate throughout: damping in the link explains as much. Friction of either body against the ground is
/// `coulomb_friction`.
/// Source: Armstrong-Hélouvry, Dupont and Canudas de Wit (1994), Automatica 30, 1083-1138, doi:10.1016/0005-1098(94)90209-7 (dry friction and its smooth forms).
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrivelineFriction;

impl Effect for DrivelineFriction {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::LINKS_RULE,
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "driveline_friction",
                Site::Dynamics,
                "dry friction in the link between two bodies",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::links(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let position = on.position()?;
        let speed = channel::per(position, "s");
        Ok(vec![
            channel::not_negative("level", channel::unit(position), 0.0),
            Parameter { role: Role::Shape, lower: 1e-9, ..channel::free("speed", speed, 1.0) },
        ])
    }

    /// Levels at shares of the twist, speeds around those of the twist.
    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.quantity_spread(scales) else { return Vec::new() };
        let rate = spread.rms / scales.timescale_s.max(scales.sample_time_s);
        let with = |level: f64| {
            [0.1, 1.0, 10.0].map(|speed| vec![level * spread.rms, (speed * rate).max(1e-9)])
        };
        [0.1, 0.5].into_iter().flat_map(with).collect()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        on.rewrite(plan, |e| e.with_inner_map(on.channel, InnerMap::Friction), values)
    }
}

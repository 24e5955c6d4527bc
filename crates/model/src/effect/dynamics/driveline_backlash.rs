//! Play in the link between two bodies: no torque while the twist is within it.
//!
//! Equation: the twist d = x1 − x2 becomes d − min(max(d, −width), width).

use super::internal;
use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::equations::inner::InnerMap;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Play in a drive train: a dead zone of the twist between two positions.
///
/// Assumes: the elastic torque depends on the twist alone; damping between the bodies acts inside the play too. Positions are relative to the middle of the
/// play.
/// Fails when: the load stays in contact with one side: the play is then an offset. A softer link explains as much if all twists have one size.
/// Source: Nordin and Gutman (2002), Automatica 38, 1633-1649, doi:10.1016/S0005-1098(02)00047-X.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrivelineBacklash;

impl Effect for DrivelineBacklash {
    fn facts(&self) -> Facts {
        Facts {
            rule: internal::LINKS_RULE,
            told_by: Some(Telling::Amplitude),
            ..Facts::of("driveline_backlash", Site::Dynamics, "play in the link between two bodies")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        internal::links(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        Ok(vec![channel::not_negative("width", channel::unit(on.position()?), 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.quantity_spread(scales) else { return Vec::new() };
        [0.3, 1.0, 3.0].map(|share| vec![share * spread.rms]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        on.rewrite(plan, |e| e.with_inner_map(on.channel, InnerMap::DeadZone), values)
    }
}

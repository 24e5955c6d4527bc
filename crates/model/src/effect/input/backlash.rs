//! Play between command and plant: the plant follows only once the play is used up.
//!
//! Equation: v(t) = max(u(t) − width, min(u(t) + width, v(t−))): v moves only where u is `width` away from it.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::piecewise::{Piece, Piecewise};
use crate::simulate::plan::Plan;

/// Play between command and plant.
///
/// Assumes: play without mass or contact dynamics. The play starts at the plant's rest in a log, else centred.
/// Fails when: the command seldom changes direction: the play is then not crossed. A small play resembles an amplitude-dependent delay.
/// Source: Nordin and Gutman (2002), Automatica 38, 1633-1649, doi:10.1016/S0005-1098(02)00047-X.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Backlash;

impl Effect for Backlash {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("backlash", Site::Input, "play between command and plant")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.inputs[on.input()?]);
        Ok(vec![channel::not_negative("width", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        [0.05, 0.15, 0.35, 0.7].map(|share| vec![share * spread.quantiles[5]]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let width = values[0];
        let path = &mut plan.inputs[on.input()?];
        let rest = Arc::clone(&path.rest);
        path.maps.push(Arc::new(move |signal| play(&signal, width, rest.get().copied())));
        Ok(())
    }
}

/// The play operator p ← min(max(p, v − width), v + width), from the plant's rest or centred on the first value. Source: Brokate and Sprekels (1996),
/// "Hysteresis and Phase Transitions", section 2.3.
fn play(signal: &Piecewise, width: f64, rest: Option<f64>) -> Piecewise {
    let mut position = rest.unwrap_or_else(|| signal.first());
    signal.rebuild(|piece, end_s, out| {
        position = position.clamp(piece.value - width, piece.value + width);
        let start_s = piece.start_s;
        if piece.slope == 0.0 {
            out.push(Piece { start_s, value: position, slope: 0.0 });
            return;
        }
        // The side in contact, and the time of contact.
        let side = width * piece.slope.signum();
        let touch_s = start_s + (position + side - piece.value) / piece.slope;
        if touch_s > start_s {
            out.push(Piece { start_s, value: position, slope: 0.0 });
        }
        if touch_s < end_s {
            let from_s = touch_s.max(start_s);
            out.push(Piece { start_s: from_s, value: piece.at(from_s) - side, slope: piece.slope });
            if end_s.is_finite() {
                position = piece.at(end_s) - side;
            }
        }
    })
}

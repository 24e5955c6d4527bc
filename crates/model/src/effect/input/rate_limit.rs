//! The actuator has a rate limit.
//!
//! Equation: v′ = rate·sign(u − v) while v ≠ u, and v follows u where |u′| ≤ rate.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::piecewise::{Piece, Piecewise};
use crate::simulate::plan::Plan;

/// The actuator has a rate limit.
///
/// Assumes: one limit for both directions and any load.
/// Fails when: commands are steps of one height: a lag has nearly the same effect. Steps of different heights distinguish the two, because larger ones take
/// longer.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities), for the limiter; the rate limit is one within a high-gain
/// feedback.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RateLimit;

/// The slowest initial value: a full swing takes this part of the longest log.
const LONGEST_SWING: f64 = 0.25;

impl Effect for RateLimit {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("rate_limit", Site::Input, "the actuator moves no faster than this")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::per(&on.system.inputs[on.input()?], "s");
        Ok(vec![channel::not_negative("rate", unit, f64::INFINITY)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.input_spread(scales) else { return Vec::new() };
        // The duration of a full swing: from half a sample to 25 % of a log, one per octave. The range is independent of the plant's speed.
        let (swing, longest_s) =
            (spread.largest - spread.smallest, LONGEST_SWING * scales.duration_s);
        let times = std::iter::successors(Some(0.5 * scales.sample_time_s), |time| {
            Some(2.0 * time).filter(|t| *t > 0.0)
        });
        times
            .take_while(|time| *time < longest_s)
            .map(|time| vec![swing / time.max(f64::MIN_POSITIVE)])
            .collect()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let rate = values[0];
        plan.inputs[on.input()?].maps.push(Arc::new(move |signal| follow(&signal, rate)));
        Ok(())
    }
}

/// Follows a signal with at most this slope, from its first value on.
fn follow(signal: &Piecewise, rate: f64) -> Piecewise {
    let mut at = signal.first();
    signal.rebuild(|piece, end_s, out| {
        let start_s = piece.start_s;
        let gap = piece.value - at;
        let along = piece.slope.abs() <= rate;
        // The slope while it catches up, and the duration.
        let (slope, catches_s) = if gap == 0.0 && along {
            (0.0, 0.0)
        } else {
            let slope = rate * if gap == 0.0 { piece.slope.signum() } else { gap.signum() };
            let closing = slope - piece.slope;
            let time = gap / closing;
            (slope, if time.is_finite() && time > 0.0 { time } else { f64::INFINITY })
        };
        if catches_s > 0.0 {
            out.push(Piece { start_s, value: at, slope });
        }
        let meet_s = start_s + catches_s;
        if meet_s < end_s {
            let limited = if along { piece.slope } else { rate * piece.slope.signum() };
            let value = piece.at(meet_s);
            out.push(Piece { start_s: meet_s, value, slope: limited });
            at = value + limited * if end_s.is_finite() { end_s - meet_s } else { 0.0 };
        } else if end_s.is_finite() {
            at += slope * (end_s - start_s);
        }
    })
}

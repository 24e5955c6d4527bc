//! The sensors' clock runs at another rate: when the commands' clock reads t, it reads ratio·t.

use crate::effect::channel;
use crate::effect::definition::{ALL, Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// Number of tested rates on either side; the furthest bounds the search.
const SCANNED: u32 = 40;
const FURTHEST: f64 = 0.15;

/// The sensors' clock runs at another rate.
///
/// Assumes: both clocks run evenly.
/// Fails when: the log is short: the clocks then diverge by less than a sample, and a constant delay explains as much.
/// Source: Mills, Martin, Burbank and Kasch (2010), RFC 5905 (Network Time Protocol version 4: offset and frequency of a clock).
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClockSkew;

impl Effect for ClockSkew {
    fn facts(&self) -> Facts {
        Facts::of("clock_skew", Site::Clock, "the sensors' clock runs at another rate")
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        if on.channel != ALL {
            return Err(on.unknown());
        }
        Ok(vec![Parameter {
            lower: 1e-3,
            upper: 1e3,
            ..channel::free("ratio", "1".to_owned(), 1.0)
        }])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        // Shifts of a tenth of a sample to ten samples at the end of the log.
        let shift = |samples: f64| {
            samples * scales.sample_time_s / scales.duration_s.max(f64::MIN_POSITIVE)
        };
        [1.0, 10.0].iter().flat_map(|&n| [vec![1.0 + shift(n)], vec![1.0 - shift(n)]]).collect()
    }

    fn scan(&self, scales: &Scales) -> Vec<Vec<f64>> {
        // An initial value leads to the minimum if its shift at the end of the log is off by less than the motion's own time.
        let step = scales.timescale_s / scales.duration_s.max(f64::MIN_POSITIVE);
        let ratios = (1..=SCANNED)
            .map(|n| f64::from(n) * step)
            .take_while(|off| *off > 0.0 && *off <= FURTHEST);
        ratios.flat_map(|off| [vec![1.0 + off], vec![1.0 - off]]).collect()
    }

    fn apply(&self, _: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.clock.ratio *= values[0];
        Ok(())
    }
}

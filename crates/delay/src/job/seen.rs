//! The views of a pair for the methods: alone or with the other inputs, relative to its mean or to its rest.

use super::asked::{Feedback, Job};
use crate::error::Result;
use crate::estimator::Search;
use crate::experiment::{Detrend, Experiment};
use crate::feedback::{InLoop, in_loop};
use crate::method::Start;
use crate::process::family::rough;
use crate::process::shares::{Measured, Shares};
use deadtime_identify::Record;

/// The views of one pair for the methods.
pub(super) struct PairView<'a> {
    /// As measured, detrended.
    pub(super) one: Experiment<'a>,
    /// Without the effect of other inputs, where that effect is visible in open loop.
    pub(super) freed: Option<Experiment<'a>>,
    /// The same, or the pair, relative to its rest, where it began at rest.
    pub(super) rested: Option<Experiment<'a>>,
    /// The view for a joint method over all inputs: this input first.
    pub(super) together: Experiment<'a>,
    /// The same relative to the rest, where all inputs began at rest.
    pub(super) together_rested: Option<Experiment<'a>>,
    /// The window, with this pair's bias.
    pub(super) search: Search,
    /// Evidence of a loop in the record.
    pub(super) looped: InLoop,
}

/// The reference level of a pair that begins at rest.
enum Level {
    /// Its level before the inputs moved.
    BeforeMoving,
    /// Zero.
    AsLogged,
}

impl<'a> PairView<'a> {
    /// The view for a joint method over all inputs.
    pub(super) fn all_inputs(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.together_rested.as_ref().unwrap_or(&self.together),
            Start::Any => &self.together,
        }
    }

    /// The pair without the effect of other inputs.
    pub(super) fn alone(&self) -> &Experiment<'a> {
        self.freed.as_ref().unwrap_or(&self.one)
    }

    /// The view for a method with this assumption on the start.
    pub(super) fn by_start(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.rested.as_ref().unwrap_or_else(|| self.alone()),
            Start::Any => self.alone(),
        }
    }
}

impl Job {
    /// The views of one pair of the experiment.
    pub(super) fn seen<'a>(
        &self,
        logged: &'a Experiment<'_>,
        experiment: &'a Experiment<'_>,
        search: &Search,
        (i, o): (usize, usize),
        shares: Option<&Shares>,
    ) -> Result<PairView<'a>> {
        let search = search.towards(i, o, self.inputs.len());
        let (one, together) = (experiment.select(i, o)?, experiment.towards(i, o)?);
        let looped = self.looped(&one.pair(0, 0)?, search.max_delay, search.bias(0, 0));
        // In a loop of several inputs the effects do not superpose.
        let closed = self.feedback.said().is_some() || looped.finding().is_some();
        let shares = shares.filter(|s| !closed && !s.of_others(i).is_empty());
        let without = |together: &Experiment<'_>, from| {
            shares.map(|s| s.without_others(together, i, from)).transpose()
        };
        let freed = without(&together, Measured::FromMean)?;
        let at_mean = freed.as_ref().unwrap_or(&one);
        let rested = if self.detrend == Detrend::Mean {
            let all_rested = together
                .from_rest()
                .map(|t| without(&t, Measured::FromRest))
                .transpose()?
                .flatten();
            let before_moving =
                all_rested.or_else(|| at_mean.from_rest()).map(|e| (e, Level::BeforeMoving));
            let as_logged = match without(&logged.towards(i, o)?, Measured::FromRest)? {
                Some(freed) => freed,
                None => logged.select(i, o)?,
            };
            self.best_start(
                at_mean,
                [before_moving, Some((as_logged, Level::AsLogged))],
                search.max_delay,
            )?
        } else {
            None
        };
        let (rested, together_rested) = match rested {
            None => (None, None),
            Some((rested, Level::BeforeMoving)) => (Some(rested), together.from_rest()),
            Some((rested, Level::AsLogged)) => (Some(rested), Some(logged.towards(i, o)?)),
        };
        Ok(PairView { rested, freed, together, together_rested, search, looped, one })
    }

    /// The pair relative to its rest, where that fits better than its mean. The level is the offset before the inputs moved, or zero for a pair logged from
    /// zero. A rough model decides. An input with a long initial rest may be one that moves seldom, and a controller at zero moves at once.
    fn best_start<'a>(
        &self,
        at_mean: &Experiment<'_>,
        starts: [Option<(Experiment<'a>, Level)>; 2],
        max_delay: usize,
    ) -> Result<Option<(Experiment<'a>, Level)>> {
        let left = |seen: &Experiment<'_>| -> Result<f64> {
            let fitted = rough(&seen.pair(0, 0)?, 2, max_delay, 0);
            Ok(fitted.map_or(f64::INFINITY, |r| r.residual.iter().map(|e| e * e).sum()))
        };
        let mut best = (left(at_mean)?, None);
        for start in starts.into_iter().flatten() {
            self.stop.check()?;
            let less = left(&start.0)?;
            if less < best.0 {
                best = (less, Some(start));
            }
        }
        Ok(best.1)
    }

    /// Evidence of a loop in the record, overridden by the user's statement.
    fn looped(&self, records: &[Record<'_>], max_delay: usize, bias: usize) -> InLoop {
        let seen = in_loop(records, max_delay, bias);
        match self.feedback {
            Feedback::Open => {
                let direct = seen.direct || seen.same_sample.is_some();
                InLoop { direct, ahead: seen.ahead, ..InLoop::default() }
            }
            Feedback::Closed => InLoop { ahead: false, ..seen },
            Feedback::Auto => seen,
        }
    }
}

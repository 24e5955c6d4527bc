//! A pair as methods see it: alone or with the other inputs, from its mean or from where it rested.

use super::asked::{Feedback, Job};
use crate::error::Result;
use crate::estimator::Search;
use crate::experiment::{Detrend, Experiment};
use crate::feedback::{InLoop, in_loop};
use crate::method::Start;
use crate::process::family::rough;
use crate::process::shares::{Measured, Shares};
use deadtime_identify::Record;

/// One pair as methods see it.
pub(super) struct PairView<'a> {
    /// As it was measured, detrended.
    pub(super) one: Experiment<'a>,
    /// Without what other inputs do, where they visibly do something and there is no loop.
    pub(super) freed: Option<Experiment<'a>>,
    /// The same, or the pair, measured from where it rested, where it did.
    pub(super) rested: Option<Experiment<'a>>,
    /// What a method that takes all inputs together sees: this one first.
    pub(super) together: Experiment<'a>,
    /// The same from where the pair rested, where all inputs did.
    pub(super) together_rested: Option<Experiment<'a>>,
    /// The window, with this pair's bias.
    pub(super) search: Search,
    /// What the record shows of a loop.
    pub(super) looped: InLoop,
}

/// From where a pair is measured that rests at its start.
enum Level {
    /// From its level before the inputs moved.
    BeforeMoving,
    /// From zero.
    AsLogged,
}

impl<'a> PairView<'a> {
    /// What a method that takes all inputs together sees.
    pub(super) fn all_inputs(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.together_rested.as_ref().unwrap_or(&self.together),
            Start::Any => &self.together,
        }
    }

    /// The pair without what other inputs do.
    pub(super) fn alone(&self) -> &Experiment<'a> {
        self.freed.as_ref().unwrap_or(&self.one)
    }

    /// What a method that takes this for granted of the start sees.
    pub(super) fn by_start(&self, start: Start) -> &Experiment<'a> {
        match start {
            Start::Rest => self.rested.as_ref().unwrap_or_else(|| self.alone()),
            Start::Any => self.alone(),
        }
    }
}

impl Job {
    /// One pair of the experiment.
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
        // What a loop makes of several inputs is no sum of what each does.
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

    /// The pair measured from its rest, where that explains it better than its mean: from its offset before the inputs moved, or as logged, where that is zero. A
    /// rough model decides: an input that rests for a while at first may be one that moves seldom, and a controller that rests at zero moves at once.
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

    /// What the record shows of a loop, as far as the user does not know it.
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

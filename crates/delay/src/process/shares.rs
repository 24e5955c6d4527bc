//! What each of several inputs does to one output, so that what the others do can be taken off before one input is looked at.
//!
//! Equation: y − Σ ŷ_j over the other inputs j, ŷ_j = K_j/((1 + T₁s)(1 + T₂s))·e^(−τ_j·s)·u_j, all inputs fitted together, each through two poles of its own.
//! How it can be wrong: of a plant of another shape a part of what the others do stays, which is noise to this input where the inputs do not move together. Where they do,
//! what one does may be given to another.

use std::borrow::Cow;

use super::chain::Shape;
use super::fit::Problem;
use crate::error::DelayError;
use crate::experiment::{Experiment, Recording, Series};
use crate::process::fit::several::Own;
use deadtime_identify::{Initial, Record};
use deadtime_signal::stop::Stop;

/// Samples of each record that the models are fitted to: inputs may move one after the other.
const FITTED: usize = 20_000;

/// The models of every input of one output that visibly does something.
pub(crate) struct Shares(Vec<Option<Own>>);

/// From where an output is measured.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measured {
    /// Its mean.
    FromMean,
    /// The level at which it rests.
    FromRest,
}

impl Shares {
    /// Fits all inputs of an experiment to its only output; `None` of one input.
    ///
    /// # Errors
    /// [`DelayError::Count`] for an experiment without channels or records.
    pub(crate) fn of(
        experiment: &Experiment<'_>,
        max_delay: usize,
        stop: &Stop,
    ) -> Result<Option<Self>, DelayError> {
        let inputs = experiment.inputs().len();
        if inputs < 2 {
            return Ok(None);
        }
        let whole =
            (0..inputs).map(|input| experiment.pair(input, 0)).collect::<Result<Vec<_>, _>>()?;
        let heads: Vec<Vec<Record<'_>>> =
            whole.iter().map(|records| records.iter().map(|r| r.head(FITTED)).collect()).collect();
        let Some((first, others)) = heads.split_first() else { return Ok(None) };
        let problem = Problem::together(
            Shape { poles: 2, zero: false },
            false,
            Initial::Zero,
            first,
            others,
            max_delay,
            stop,
        );
        Ok(Some(Self(problem.acting())))
    }

    /// The share of the output's power that every other input makes, of those that make any.
    pub(crate) fn of_others(&self, input: usize) -> Vec<(usize, f64)> {
        let others = self.0.iter().enumerate().filter(|(other, _)| *other != input);
        others.filter_map(|(other, own)| Some((other, own.as_ref()?.share))).collect()
    }

    /// The pair of `input` and the output of `together`, less what the other inputs do; `together` as [`Experiment::towards`] makes it.
    pub(crate) fn without_others<'a>(
        &self,
        together: &Experiment<'_>,
        input: usize,
        from: Measured,
    ) -> Result<Experiment<'a>, DelayError> {
        let others =
            || self.0.iter().enumerate().filter(|(other, _)| *other != input).map(|(_, own)| own);
        let freed = |all: &Recording<'_>| {
            let Some(Series { values, present }) = all.outputs.first() else {
                return Recording::default();
            };
            let mut y = values.to_vec();
            let counts = |t: usize| present.as_ref().is_none_or(|p| p[t]);
            let mut sum = vec![0.0; y.len()];
            for (own, u) in others().zip(all.inputs.iter().skip(1)) {
                for (sum, v) in sum.iter_mut().zip(own.iter().flat_map(|own| own.answer(u))) {
                    *sum += v;
                }
            }
            let (total, count) = (0..y.len())
                .filter(|t| counts(*t))
                .fold((0.0, 0.0), |(total, n), t| (total + sum[t], n + 1.0));
            let level = if from == Measured::FromMean { total / f64::max(count, 1.0) } else { 0.0 };
            for t in (0..y.len()).filter(|t| counts(*t)) {
                y[t] -= sum[t] - level;
            }
            Recording {
                inputs: all.inputs.iter().take(1).map(|u| Cow::Owned(u.to_vec())).collect(),
                outputs: vec![Series {
                    values: Cow::Owned(y),
                    present: present.as_ref().map(|p| Cow::Owned(p.to_vec())),
                }],
                states: Vec::new(),
            }
        };
        let recordings = together.recordings().iter().map(freed).collect();
        Ok(together.select(0, 0)?.with_recordings(recordings))
    }
}

//! The response of one output to each of several inputs, so that the effect of the others can be subtracted.
//!
//! Equation: y − Σ ŷ_j over the other inputs j, ŷ_j = K_j/((1 + T₁s)(1 + T₂s))·e^(−τ_j·s)·u_j. All inputs are fitted together, each through two poles of its
//! own. How it can be wrong: a plant of another shape leaves a residual of the other inputs. For uncorrelated inputs it is noise. With correlated inputs, the
//! effect of one may be attributed to another.

use std::borrow::Cow;

use super::chain::Shape;
use super::fit::Problem;
use crate::error::DelayError;
use crate::experiment::{Experiment, Recording, Series};
use crate::process::fit::several::Own;
use deadtime_identify::{Initial, Record};
use deadtime_signal::stop::Stop;

/// Samples of each record in the fit: inputs may move one after the other.
const FITTED: usize = 20_000;

/// The models of every input with a visible effect on one output.
pub(crate) struct Shares(Vec<Option<Own>>);

/// The reference level of an output.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measured {
    /// Its mean.
    FromMean,
    /// Its level at rest.
    FromRest,
}

impl Shares {
    /// Fits all inputs of an experiment to its only output; `None` for one input.
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

    /// The share of the output's power caused by every other input with an effect.
    pub(crate) fn of_others(&self, input: usize) -> Vec<(usize, f64)> {
        let others = self.0.iter().enumerate().filter(|(other, _)| *other != input);
        others.filter_map(|(other, own)| Some((other, own.as_ref()?.share))).collect()
    }

    /// The pair of `input` and the output of `together`, minus the responses to the other inputs; `together` is made by [`Experiment::towards`].
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

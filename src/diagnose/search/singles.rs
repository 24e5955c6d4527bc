//! Single effects: the most promising of the screen, fitted.

use rayon::prelude::*;

use super::screen::Screened;
use super::steps::{STEPS, TRIAL};
use crate::diagnose::hypothesis::direction::with;
use crate::diagnose::hypothesis::dropouts::decoded;
use crate::diagnose::hypothesis::hypothesis::Hypothesis;
use crate::diagnose::hypothesis::penalised_gain::SELECTION_PENALTY;
use crate::diagnose::likelihood::likelihood::{Likelihood, Whitened};
use crate::effect::{Applied, Scales, Site};

/// Candidates that are fitted in full after the screen.
const FITTED: usize = 25;

/// The same where each is calls of a black box; and what such a one must gain at its start to be worth them.
const CALLED_FITTED: usize = 10;
const CALLED_FROM: f64 = 0.2 * SELECTION_PENALTY;

/// The same where each is calls of a black box.
pub(in crate::diagnose) const CALLED_LEADERS: usize = 4;

/// Starts of one candidate that are fitted.
const STARTS: usize = 2;
/// Candidates whose fit goes on after the first few steps.
const ON: usize = 10;

/// Which of a list of hypotheses are worth their price: all that cost no call of a black box, and so many of the others.
pub(in crate::diagnose) fn frugal<'e>(likelihood: &Likelihood<'_>, all: impl Iterator<Item = &'e [Applied]>, most: usize) -> Vec<bool> {
    let mut called = 0;
    all.map(|effects| {
        let calls = effects.iter().any(|a| likelihood.calls(a));
        called += usize::from(calls);
        !calls || called <= most
    })
    .collect()
}

/// Which of the pool are fitted. Of a black box so many on its inputs and so many parameters beside what costs no call: commands can mimic much, and a far
/// wrong parameter promises less than it keeps.
fn worth_a_fit(likelihood: &Likelihood<'_>, pool: &[Screened]) -> Vec<bool> {
    let (mut free, mut inputs, mut parameters) = (0, 0, 0);
    let worth = |screened: &Screened| {
        let (count, most) = match (likelihood.calls(&screened.applied), screened.applied.effect.site()) {
            (false, _) => (&mut free, FITTED),
            (true, Site::Dynamics) => (&mut parameters, CALLED_FITTED),
            (true, _) => (&mut inputs, CALLED_FITTED),
        };
        *count += 1;
        *count <= most && (!likelihood.calls(&screened.applied) || screened.gain > CALLED_FROM)
    };
    pool.iter().map(worth).collect()
}

/// Fits the most promising of the pool, each from its best starts, the best of them to the end; the others stay as screened.
pub(in crate::diagnose) fn fit_first(
    likelihood: &Likelihood<'_>,
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
) -> Vec<Hypothesis> {
    let cost = likelihood.inner(nominal, nominal);
    let fitted = worth_a_fit(likelihood, pool);
    let mut singles: Vec<Hypothesis> = pool
        .par_iter()
        .enumerate()
        .map(|(at, screened)| {
            let values = screened.starts.first().map_or(screened.applied.values.as_slice(), Vec::as_slice);
            let as_screened = Hypothesis::screened(with(&screened.applied, values), screened.gain);
            let starts = screened.starts.iter().take(if fitted[at] { STARTS } else { 0 });
            let fits = starts.filter_map(|start| Hypothesis::fit(likelihood, &[with(&screened.applied, start)], scales, cost, TRIAL.0));
            fits.max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap_or(as_screened)
        })
        .collect();
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let on = frugal(likelihood, singles.iter().take(ON).map(|e| e.effects.as_slice()), CALLED_LEADERS);
    singles.par_iter_mut().zip(on).filter(|(_, on)| *on).for_each(|(single, _)| {
        let better = if single.loses_commands() && single.gain > SELECTION_PENALTY {
            decoded(likelihood, single.clone(), scales, cost, STEPS)
        } else {
            Hypothesis::refit(likelihood, single.clone(), scales, cost, STEPS)
        };
        if let Some(better) = better {
            *single = better;
        }
    });
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    singles
}

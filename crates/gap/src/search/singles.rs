//! Single effects: the candidates of the screen with the largest predicted cost reduction, fitted.

use super::screen::Screened;
use super::slower_loop::from_arrivals;
use crate::hypothesis::arrivals::refit_from_fixed;
use crate::hypothesis::direction::with;
use crate::hypothesis::dropouts::decoded;
use crate::hypothesis::effects::Hypothesis;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Scales, Site};
use deadtime_signal::parallel;

/// Which of a list of hypotheses are worth their price: all that cost no call, and so many of the others as the budget holds.
pub(crate) fn frugal<'e>(
    likelihood: &Likelihood<'_>,
    all: impl Iterator<Item = &'e [Applied]>,
) -> Vec<bool> {
    let mut called = 0;
    all.map(|effects| {
        let calls = effects.iter().any(|a| likelihood.calls(a));
        called += usize::from(calls);
        !calls || called <= likelihood.budget.called.leaders
    })
    .collect()
}

/// The members of the pool that are fitted. For a black box: limited numbers of effects on inputs and of parameters, and all effects without calls. Effects on commands can imitate
/// many others, and the linear prediction underestimates the reduction of a parameter that is far off.
fn worth_a_fit(likelihood: &Likelihood<'_>, pool: &[Screened]) -> Vec<bool> {
    let (mut free, mut inputs, mut parameters) = (0, 0, 0);
    let worth = |screened: &Screened| {
        let count = match (likelihood.calls(&screened.applied), screened.applied.effect.site()) {
            (false, _) => &mut free,
            (true, Site::Dynamics) => &mut parameters,
            (true, _) => &mut inputs,
        };
        *count += 1;
        let allowance = likelihood.allowance(&screened.applied);
        *count <= allowance.fitted
            && screened.gain > allowance.fitted_from * likelihood.criteria.selection_penalty
    };
    pool.iter().map(worth).collect()
}

/// Fits the members of the pool with the largest predicted cost reduction, each from its best starts, the best of them to convergence. The others keep their
/// screened values.
pub(crate) fn fit_first(
    likelihood: &Likelihood<'_>,
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
) -> Vec<Hypothesis> {
    let cost = likelihood.inner(nominal, nominal);
    let fitted = worth_a_fit(likelihood, pool);
    let mut singles = parallel::map(pool.iter().zip(fitted), |(screened, fitted)| {
        let values =
            screened.starts.first().map_or(screened.applied.values.as_slice(), Vec::as_slice);
        let as_screened = Hypothesis::screened(with(&screened.applied, values), screened.gain);
        let starts = screened.starts.iter().take(if fitted { likelihood.budget.starts } else { 0 });
        let fits = starts.filter_map(|start| {
            Hypothesis::fit(
                likelihood,
                &[with(&screened.applied, start)],
                scales,
                cost,
                likelihood.budget.trial_steps,
            )
        });
        fits.max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap_or(as_screened)
    });
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let on =
        frugal(likelihood, singles.iter().take(likelihood.budget.on).map(|e| e.effects.as_slice()));
    let goes_on = singles.iter_mut().zip(on).filter(|(e, on)| *on && e.gain.is_finite());
    parallel::for_each(goes_on, |(single, _)| {
        let decodes =
            single.loses_commands() && single.gain > likelihood.criteria.selection_penalty;
        let better = if decodes {
            decoded(likelihood, single.clone(), scales, cost, likelihood.budget.steps)
        } else {
            Hypothesis::refit(likelihood, single.clone(), scales, cost, likelihood.budget.steps)
        };
        if let Some(better) = better {
            *single = better;
        }
    });
    if !likelihood.system.is_black_box() {
        refit_from_fixed(likelihood, &mut singles, cost);
    }
    from_arrivals(likelihood, &mut singles, scales, cost);
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    singles
}

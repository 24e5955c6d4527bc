//! The search through the catalogue: candidates are screened, those with the largest predicted cost reduction fitted, pairs built on them; one noise model compares all.

use nalgebra::DMatrix;

use super::elaborations::held_back;
use super::late::add_late_twins;
use super::screen::screen;
use super::several::pairs;
use super::singles::{fit_first, frugal};
use crate::baseline::noise::Noise;
use crate::format::progress::Stage;
use crate::hypothesis::dropouts::decoded;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::gaussian::{Likelihood, Whitened};
use crate::likelihood::residuals::residuals;
use deadtime_model::effect::{Applied, Lateness, Scales};
use deadtime_signal::parallel;

/// The result of a search, best first.
pub(crate) struct SearchResult {
    /// Single effects: those fitted, then the rest of the catalogue as screened.
    pub(crate) singles: Vec<Hypothesis>,
    pub(crate) pairs: Vec<Hypothesis>,
}

/// A search's result, and the likelihood under the noise of the largest hypothesis in play.
pub(crate) struct Searched<'a> {
    pub(crate) likelihood: Likelihood<'a>,
    pub(crate) found: SearchResult,
}

/// Searches the whole catalogue, from a likelihood under white noise. `remedies`: the effects that the checks propose.
pub(crate) fn search<'a>(
    mut likelihood: Likelihood<'a>,
    catalogue: Vec<Applied>,
    remedies: &[Applied],
    scales: &Scales,
    smallest: &[f64],
    progress: &dyn Fn(Stage),
) -> Option<Searched<'a>> {
    let budget = likelihood.budget;
    let nominal = likelihood.whitened(NO_EFFECT)?;
    progress(Stage::Screening(catalogue.len()));
    let pool = screen(&likelihood, catalogue, scales, &nominal);
    progress(Stage::Fitting);
    let mut found = SearchResult {
        singles: fit_first(&likelihood, &pool, scales, &nominal),
        pairs: Vec::new(),
    };
    // The search over sets finds joint effects, but would call a simulator too often.
    if likelihood.system.is_black_box() {
        progress(Stage::Pairing);
        found.pairs = pairs(&likelihood, &found.singles, remedies, &pool, scales, &nominal);
    }
    members_alone(&likelihood, &mut found, scales, &nominal);
    for hypotheses in [&mut found.singles, &mut found.pairs] {
        give_up_what_breaks(&likelihood, hypotheses, usize::MAX);
    }
    for round in 0..budget.rounds {
        progress(Stage::Refitting(round));
        let leading = leading(&likelihood, &found);
        let Some(noise) = noise_of(&likelihood, leading, smallest) else { break };
        likelihood = likelihood.with_noise(noise);
        let nominal = likelihood.whitened(NO_EFFECT)?;
        let refits = Refits {
            likelihood: &likelihood,
            scales,
            cost: likelihood.inner(&nominal, &nominal),
            steps: if round + 1 < budget.rounds { budget.steps } else { budget.steps / 2 },
            polishes: round == 0,
        };
        for hypotheses in [&mut found.singles, &mut found.pairs] {
            refits.refit_leaders(hypotheses);
            give_up_what_breaks(&likelihood, hypotheses, budget.plain.leaders);
            hypotheses.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        }
    }
    add_late_twins(&likelihood, &mut found.singles);
    add_late_twins(&likelihood, &mut found.pairs);
    if likelihood.system.is_black_box() {
        held_back(&likelihood, &mut found.singles, &mut found.pairs);
    }
    Some(Searched { likelihood, found })
}

/// The fitted hypothesis with the largest penalised gain: a single effect, unless a pair has a larger one.
fn leading<'f>(likelihood: &Likelihood<'_>, found: &'f SearchResult) -> Option<&'f Hypothesis> {
    let penalties = Penalties::of(likelihood);
    let leading = |all: &'f [Hypothesis]| {
        all.iter()
            .filter(|e| e.fitted)
            .max_by(|a, b| penalties.gain(a).total_cmp(&penalties.gain(b)))
    };
    let single = leading(&found.singles);
    let pair = leading(&found.pairs)
        .filter(|pair| single.is_none_or(|s| penalties.gain(pair) > penalties.gain(s)));
    pair.or(single)
}

/// The refits of one round, under the noise of the leading hypothesis.
struct Refits<'r, 'a> {
    likelihood: &'r Likelihood<'a>,
    scales: &'r Scales,
    /// The cost of the nominal model.
    cost: f64,
    steps: usize,
    polishes: bool,
}

impl Refits<'_, '_> {
    /// Rescores all hypotheses and refits the leaders among them.
    fn refit_leaders(&self, hypotheses: &mut [Hypothesis]) {
        parallel::for_each(hypotheses.iter_mut(), |e| e.rescore(self.likelihood, self.cost));
        hypotheses.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let best = hypotheses.first().map_or(0.0, |e| e.gain);
        let first = hypotheses.iter().take(self.likelihood.budget.plain.leaders);
        let leaders = frugal(self.likelihood, first.map(|e| e.effects.as_slice()));
        let leaders = hypotheses.iter_mut().zip(leaders);
        parallel::for_each(leaders.filter(|(e, leads)| *leads && e.gain.is_finite()), |(e, _)| {
            if let Some(better) = self.refitted(e, best) {
                *e = better;
            }
        });
    }

    /// A hypothesis refitted with its latent sequence; `best`: the gain of the best hypothesis.
    fn refitted(&self, hypothesis: &Hypothesis, best: f64) -> Option<Hypothesis> {
        let Self { likelihood, scales, cost, steps, polishes } = *self;
        // A sequence that explains much less than the best hypothesis is not worth another search.
        let late = hypothesis.effects.iter().any(|a| a.effect.lateness() == Some(Lateness::Random));
        let part = if late { likelihood.budget.again_late } else { likelihood.budget.again };
        let again = hypothesis.lost.is_none() || hypothesis.gain > part * best;
        let sequences = if again {
            decoded(likelihood, hypothesis.clone(), scales, cost, steps)?
        } else {
            hypothesis.clone()
        };
        let better = Hypothesis::refit(likelihood, sequences, scales, cost, steps)?
            .with_missing_limits(likelihood, scales, cost, steps);
        Some(if polishes { better.polished(likelihood, scales, cost, steps) } else { better })
    }
}

/// Fits use the training spans only: an effect that makes the model fail in the rest of a log explains nothing. Tests the given number of first hypotheses.
fn give_up_what_breaks(likelihood: &Likelihood<'_>, hypotheses: &mut [Hypothesis], first: usize) {
    let known = likelihood.budget.one_by_one;
    let tested = hypotheses.iter_mut().take(first).filter(|e| e.fitted && !known);
    parallel::for_each(tested, |e| {
        if !likelihood.holds_throughout(&*e) {
            (e.fitted, e.gain) = (false, f64::NEG_INFINITY);
        }
    });
}

/// The noise of the residuals of one hypothesis, or of the nominal model, per record; records of one sample time share it.
pub(crate) fn noise_of(
    likelihood: &Likelihood<'_>,
    hypothesis: Option<&Hypothesis>,
    smallest: &[f64],
) -> Option<Vec<Noise>> {
    let residuals = residuals(likelihood, hypothesis.map_or(NO_EFFECT, ActiveEffects::from))?;
    let larger = hypothesis.map_or(1.0, |e| e.noise_over_left(likelihood));
    Some(noise_in(likelihood, &residuals, larger, smallest))
}

/// The noise of residuals, so many times as large, per record; records of one sample time share it.
pub(crate) fn noise_in(
    likelihood: &Likelihood<'_>,
    residuals: &[DMatrix<f64>],
    larger: f64,
    smallest: &[f64],
) -> Vec<Noise> {
    let same = |a: f64, b: f64| (a - b).abs() <= 0.02 * b;
    let noise = |ts: f64| {
        let members: Vec<usize> = (0..residuals.len())
            .filter(|&i| {
                likelihood.records[i].train.is_some()
                    && same(likelihood.records[i].sample_time_s, ts)
            })
            .collect();
        // For a held-out log with another sample time: all training logs.
        let members = if members.is_empty() {
            (0..residuals.len()).filter(|&i| likelihood.records[i].train.is_some()).collect()
        } else {
            members
        };
        let records: Vec<_> = members.iter().map(|&i| &likelihood.records[i]).collect();
        let residuals: Vec<_> = members.iter().map(|&i| &residuals[i]).collect();
        Noise::fit(&records, &residuals, smallest, &likelihood.criteria).times(larger)
    };
    likelihood.records.iter().map(|r| noise(r.sample_time_s)).collect()
}

/// Members of the best pair of a black box as separate hypotheses, from their values in the pair. A member with few calls so far may lead alone.
fn members_alone(
    likelihood: &Likelihood<'_>,
    found: &mut SearchResult,
    scales: &Scales,
    nominal: &Whitened,
) {
    let cost = likelihood.inner(nominal, nominal);
    let Some(pair) = found.pairs.first().filter(|_| likelihood.budget.one_by_one) else { return };
    let members: Vec<Hypothesis> = (0..pair.effects.len())
        .map(|place| pair.only(place))
        .filter(|e| !e.loses_commands())
        .collect();
    let better: Vec<Hypothesis> = parallel::filter_map(members, |e| {
        Hypothesis::refit(likelihood, e, scales, cost, likelihood.budget.steps)
    });
    for alone in better {
        if let Some(single) = found
            .singles
            .iter_mut()
            .find(|s| s.key() == alone.key())
            .filter(|s| !s.fitted || s.gain < alone.gain)
        {
            *single = alone;
        }
    }
    found.singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

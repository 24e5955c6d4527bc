//! Candidate additions to a set: every candidate by its change of the predictions at the set's own fit.

use nalgebra::DVector;

use super::fit::{Directions, Fit, ROUNDS, bounded};
use super::gram::Gram;
use super::set::{CauseSet, in_order};
use super::training::Stacked;
use crate::baseline::spectrum::peaks_hz;
use crate::hypothesis::direction::{NEAR, between, has_limit, with};
use crate::hypothesis::shared_time::instants;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::residuals::trained;
use crate::search::moving::typical;
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::parallel;

/// First guesses of one candidate.
const GUESSES: usize = 12;
/// A guess is scaled by no more.
const MOST_SCALED: f64 = 20.0;

/// A candidate with first values and its predicted cost reduction.
pub(super) struct Proposal {
    pub(super) applied: Applied,
    pub(super) reduction: f64,
}

impl Fit<'_, '_, '_> {
    /// Candidates that promise to lower the score of a set, the largest predicted reduction first.
    pub(super) fn proposals(&self, set: &CauseSet, candidates: &[Applied]) -> Vec<Proposal> {
        let Some(directions) = self.directions(set) else { return Vec::new() };
        let gram = Gram::of(self.training, &directions.all());
        let likelihood = self.training.likelihood;
        let scales = match trained(likelihood, set) {
            Some(left) => Scales {
                peaks_hz: peaks_hz(likelihood.records, &left, likelihood.system.outputs.len()),
                ..self.scales.clone()
            },
            None => self.scales.clone(),
        };
        let free = |a: &Applied| {
            !set.recalibrates(a) && set.effects.iter().all(|own| own.key() != a.key())
        };
        let mut proposals: Vec<Proposal> =
            parallel::filter_map(candidates.iter().filter(|a| free(a)), |candidate| {
                self.proposal(set, (&directions, &gram), candidate, &scales)
            });
        proposals.retain(|proposal| proposal.reduction > 0.0);
        proposals.sort_by(|a, b| b.reduction.total_cmp(&a.reduction));
        proposals
    }

    /// The guess of a candidate that predicts most.
    fn proposal(
        &self,
        set: &CauseSet,
        at: (&Directions, &Gram),
        candidate: &Applied,
        scales: &Scales,
    ) -> Option<Proposal> {
        let guesses = self.training.likelihood.first_guesses(candidate, scales);
        let events = self.at_events(set, candidate, guesses.first());
        let every = guesses.len().div_ceil(GUESSES).max(1);
        let limited = has_limit(candidate);
        let smooth = guesses.first().filter(|_| !limited).map(|guess| (guess.clone(), NEAR));
        let whole = guesses.into_iter().step_by(every).chain(events).map(|guess| (guess, 1.0));
        let tried = smooth.into_iter().chain(whole).filter_map(|(guess, share)| {
            let there = with(candidate, &between(candidate, &guess, share));
            let effects = in_order(set.effects.iter().cloned().chain([there]));
            let moved = self.training.residual(ActiveEffects::from(set).with(&effects))?;
            let residual = &at.0.residual;
            let column: Stacked = residual.iter().zip(&moved).map(|(a, b)| a - b).collect();
            let (factor, reduction) = self.along(set, at, &column, limited)?;
            let values = between(candidate, &guess, share * factor);
            let applied = with(candidate, &values);
            let idle = applied.effect.is_identity(&applied.values, &applied.parameters);
            let price = self.score.price(values.iter().filter(|v| v.is_finite()).count(), 1);
            (!idle).then_some(Proposal { applied, reduction: reduction - price })
        });
        tried.max_by(|a, b| a.reduction.total_cmp(&b.reduction))
    }

    /// A change at the time of every event that the set has: its first guess, or what such changes are like.
    fn at_events(
        &self,
        set: &CauseSet,
        candidate: &Applied,
        guess: Option<&Vec<f64>>,
    ) -> Vec<Vec<f64>> {
        let one = std::slice::from_ref(candidate);
        let (events, place) = (instants(&set.effects), instants(one).first().map(|at| at.1));
        let Some(place) = place.filter(|_| !events.is_empty()) else { return Vec::new() };
        let system = self.training.likelihood.system;
        let like = || typical(system, one, self.scales).pop()?.starts.pop();
        let Some(guess) = guess.cloned().or_else(like) else { return Vec::new() };
        let at = |(e, i): (usize, usize)| {
            let mut guess = guess.clone();
            guess[place] = set.effects[e].values[i];
            guess
        };
        events.into_iter().map(at).collect()
    }

    /// The step along a column with the least misfit, all directions of the set moving with it, and the reduction.
    fn along(
        &self,
        set: &CauseSet,
        (directions, gram): (&Directions, &Gram),
        column: &Stacked,
        one_sided: bool,
    ) -> Option<(f64, f64)> {
        let gram = gram.with(self.training, &directions.all(), column);
        let count = directions.columns.len() + 1;
        let mut lower = vec![f64::NEG_INFINITY; count];
        let mut upper = vec![f64::INFINITY; count];
        lower[count - 1] = if one_sided { 0.0 } else { -MOST_SCALED };
        upper[count - 1] = MOST_SCALED;
        let mut squares = set.squares.clone();
        let mut steps = DVector::zeros(count);
        let mut prior = 0.0;
        for _ in 0..ROUNDS {
            let eliminated = gram.eliminated(&self.score.weights(&squares))?;
            steps = bounded(&eliminated.normal, 0.0, &lower, &upper);
            let left = gram.left(&eliminated, &steps);
            (squares, prior) = (left.squares, left.prior);
        }
        let still = {
            let eliminated = gram.eliminated(&self.score.weights(&set.squares))?;
            gram.left(&eliminated, &DVector::zeros(count))
        };
        let fall =
            self.score.misfit(&still.squares) + still.prior - self.score.misfit(&squares) - prior;
        fall.is_finite().then_some((steps[count - 1], fall))
    }
}

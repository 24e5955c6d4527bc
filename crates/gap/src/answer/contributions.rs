//! The budget of a gap: the share of each effect, and the remainder.
//!
//! An effect's share is the rise of the squared error when the effect is removed and all others stay in the model (leave-one-out).
//! The shares are normalised to the explained part of the gap. The shares depend on no order of the effects.
//! A model file without the effect has exactly that squared error.
//!
//! How it can be wrong: two effects that act against each other both have large shares. A share measures prediction, not physical truth.

use nalgebra::DMatrix;

use super::found_effects::found_effects;
use super::held_out::HeldOut;
use super::improvement::{bootstrap, held_out_blocks};
use super::location::{locate, output_shares};
use crate::causes::conclusion::ActiveCauses;
use crate::causes::found::NAMED;
use crate::format::contributions::{
    Contribution, Explained, Recalibration, Remainder, Share, Strength,
};
use crate::format::found::{FoundEffect, FoundParameter};
use crate::hypothesis::effects::Hypothesis;
use crate::judge::intervals::Estimate;
use crate::judge::rule::GapVerdict;
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use deadtime_model::effect::Scales;

/// A nominal value that is further off than this factor is no value of the physics.
const FAR: f64 = 10.0;

/// A gap with at most this part unexplained is mostly explained.
const MOST: f64 = 0.5;

/// Absolute correlation of the sensitivities of two parameters above which the pair is reported as indistinguishable. At this correlation each standard deviation is inflated by 1/√(1 − r²) = 3.2.
const TRADE: f64 = 0.95;

/// The inputs of the budget.
pub(crate) struct GapBudget<'b, 'a> {
    pub(crate) likelihood: &'b Likelihood<'a>,
    pub(crate) held: &'b HeldOut,
    pub(crate) composed: &'b ActiveCauses,
    /// Residuals of the nominal model, and of the written model; for a latent sequence those with the decoded sequence.
    pub(crate) before: &'b [DMatrix<f64>],
    pub(crate) after: &'b [DMatrix<f64>],
    pub(crate) scales: &'b Scales,
    pub(crate) seed: u64,
}

/// Squared errors of the nominal model, of the model with all effects, and of the model without each effect; and that of the noise floor.
struct Squares {
    before: f64,
    after: f64,
    without: Vec<f64>,
    floor: f64,
}

impl Squares {
    /// Before, after, without each, the floor, in this order.
    fn of(sums: &[f64]) -> Self {
        let last = sums.len() - 1;
        Self { before: sums[0], after: sums[1], without: sums[2..last].to_vec(), floor: sums[last] }
    }

    /// Everything together; `None` where there is nothing to explain.
    fn together(&self) -> Option<f64> {
        (self.before > self.floor).then(|| (self.before - self.after) / (self.before - self.floor))
    }

    /// One effect.
    fn share(&self, effect: usize) -> Option<f64> {
        let rise = |w: &f64| (w - self.after).max(0.0);
        let all: f64 = self.without.iter().map(rise).sum();
        let part = if all > 0.0 {
            rise(&self.without[effect]) / all
        } else {
            1.0 / self.without.len() as f64
        };
        Some(self.together()? * part)
    }
}

/// The squared errors on the training logs, on the held-out data, and per block of the latter.
struct BudgetSquares {
    learnt: Squares,
    held: Squares,
    blocks: Vec<Vec<f64>>,
    seed: u64,
}

impl BudgetSquares {
    /// A number of the squared errors, on both data and with its interval.
    fn share(&self, number: impl Fn(&Squares) -> Option<f64>) -> Share {
        let of_sums = |sums: &[f64]| number(&Squares::of(sums)).unwrap_or(f64::NAN);
        Share {
            learnt: number(&self.learnt),
            held_out: number(&self.held),
            ci95: number(&self.held).and_then(|_| bootstrap(&self.blocks, self.seed, of_sums)),
        }
    }
}

impl GapBudget<'_, '_> {
    /// Contributions, largest first, the joint recalibration of the model's parameters, and the remainder.
    pub(crate) fn sections(
        &self,
        estimate: Option<&Estimate>,
    ) -> (Vec<Contribution>, Recalibration, Remainder) {
        let squares = self.squares();
        let found: Vec<FoundEffect> = self
            .composed
            .hypothesis
            .iter()
            .flat_map(|e| found_effects(self.likelihood, e, estimate))
            .collect();
        let singly = self.composed.singly();
        let contributions: Vec<Contribution> = singly
            .iter()
            .enumerate()
            .map(|(part, &at)| {
                self.contribution((part, at), &found[at], squares.share(|s| s.share(part)))
            })
            .collect();
        let recalibration = match self.composed.recalibration {
            None => Recalibration::default(),
            Some(size) => {
                self.recalibration(size, &found, squares.share(|s| s.share(singly.len())))
            }
        };
        let left = squares.share(|s| Some(1.0 - s.together()?));
        let complete = self.composed.judged.verdict == GapVerdict::Effects;
        let named = |c: &Contribution| {
            c.strength == Strength::Clear || c.share.learnt.is_none_or(|share| share >= NAMED)
        };
        let contributions = contributions
            .into_iter()
            .enumerate()
            .filter_map(|(at, c)| ((at == 0 && complete) || named(&c)).then_some(c))
            .collect();
        (contributions, recalibration, self.remainder(left, &squares.learnt))
    }

    /// The squared errors with all effects, without each, and of the floor.
    fn squares(&self) -> BudgetSquares {
        let taken_out: Vec<Option<Vec<DMatrix<f64>>>> =
            self.composed.taken_out.iter().map(|e| residuals(self.likelihood, e)).collect();
        // A set that cannot be simulated without an effect has the error of the nominal model.
        let all: Vec<&[DMatrix<f64>]> = [self.before, self.after]
            .into_iter()
            .chain(taken_out.iter().map(|w| w.as_deref().unwrap_or(self.before)))
            .collect();
        let floor = &self.composed.judged.floor.floor;
        let squares = |held: bool| {
            let errors = |r: &[DMatrix<f64>]| {
                let records = self.likelihood.records;
                if held { self.held.errors(records, r) } else { Errors::trained(records, r) }
            };
            let square = |each: &[Option<f64>]| overall(each).unwrap_or(0.0).powi(2);
            let mut sums: Vec<f64> = all.iter().map(|r| square(&errors(r).nrmse())).collect();
            sums.push(square(&errors(self.before).relative(floor)));
            Squares::of(&sums)
        };
        BudgetSquares {
            learnt: squares(false),
            held: squares(true),
            blocks: held_out_blocks(self.likelihood, self.held, &all, floor),
            seed: self.seed,
        }
    }

    /// The contribution of one effect, at its places among the parts of the budget and among all effects.
    fn contribution(
        &self,
        (part, at): (usize, usize),
        found: &FoundEffect,
        share: Share,
    ) -> Contribution {
        let without =
            self.composed.without[part].as_ref().and_then(|e| residuals(self.likelihood, e));
        Contribution {
            effect: found.effect.clone(),
            channel: found.channel.clone(),
            parameters: found.parameters.clone(),
            probability: None,
            strength: self.strength(without.as_deref().unwrap_or(self.before)),
            share,
            without_it: without
                .as_ref()
                .and_then(|r| overall(&Errors::trained(self.likelihood.records, r).nrmse())),
            class: self.composed.aliases(&format!("{}:{}", found.effect, found.channel)),
            surrogate: self.composed.hypothesis.as_ref().is_some_and(|e| self.is_surrogate(e, at)),
        }
    }

    /// The joint recalibration of the model's parameters by errors of a relative size.
    fn recalibration(&self, size: f64, found: &[FoundEffect], share: Share) -> Recalibration {
        let numbers = self.composed.block();
        let named = |at: &usize| FoundParameter {
            name: found[*at].channel.clone(),
            ..found[*at].parameters[0].clone()
        };
        Recalibration {
            accepted: true,
            size,
            share,
            parameters: numbers.iter().map(named).collect(),
            directions: self.directions(&numbers),
        }
    }

    /// Sentences on pairs of parameters with correlated sensitivities, and on parameters that predict without physical meaning.
    fn directions(&self, numbers: &[usize]) -> Vec<String> {
        let Some(hypothesis) = &self.composed.hypothesis else { return Vec::new() };
        let Some(slopes) = hypothesis.slopes(self.likelihood, self.scales) else {
            return Vec::new();
        };
        let column = |at: usize| {
            hypothesis.free.iter().position(|place| *place == (at, 0)).map(|c| &slopes.columns[c])
        };
        let cosine = |a: usize, b: usize| {
            let (a, b) = (column(a)?, column(b)?);
            let product = |x, y| self.likelihood.inner(x, y);
            Some(product(a, b) / (product(a, a) * product(b, b)).sqrt())
        };
        let name = |at: usize| &hypothesis.effects[at].channel;
        let pairs = numbers
            .iter()
            .enumerate()
            .flat_map(|(k, a)| numbers[k + 1..].iter().map(move |b| (*a, *b)));
        let correlated = pairs
            .filter_map(|(a, b)| Some((a, b, cosine(a, b)?)))
            .filter(|(_, _, cosine)| cosine.abs() > TRADE);
        let traded = correlated.map(|(a, b, cosine)| {
            let relative =
                cosine * hypothesis.effects[a].values[0] * hypothesis.effects[b].values[0];
            let what = if relative < 0.0 { "ratio" } else { "product" };
            format!("{} and {} are identifiable only as their {what}", name(a), name(b))
        });
        let surrogates = numbers.iter().filter(|&&at| self.is_surrogate(hypothesis, at));
        traded
            .chain(surrogates.map(|&at| format!("{} predicts but is not the physics'", name(at))))
            .collect()
    }

    /// Weak: without it, no output's error is larger by the factor required of an effect.
    fn strength(&self, without: &[DMatrix<f64>]) -> Strength {
        let rms = |r: &[DMatrix<f64>]| Errors::trained(self.likelihood.records, r).rms();
        let (with, without) = (rms(self.after), rms(without));
        let clear = with
            .iter()
            .zip(&without)
            .any(|(with, without)| *without > self.likelihood.criteria.first_matters * with);
        if clear { Strength::Clear } else { Strength::Weak }
    }

    /// A value at a bound, or a nominal value that moved tenfold or changed its sign, is not the physics'.
    fn is_surrogate(&self, hypothesis: &Hypothesis, at: usize) -> bool {
        let applied = &hypothesis.effects[at];
        let bound = hypothesis
            .free
            .iter()
            .any(|&place| place.0 == at && hypothesis.at_bound(place, self.scales));
        let far =
            |(value, nominal): (f64, f64)| value / nominal > FAR || value / nominal < FAR.recip();
        let nominal = applied
            .effect
            .corrects_model()
            .then(|| (applied.values[0], applied.parameters[0].nominal));
        bound || nominal.is_some_and(far)
    }

    fn remainder(&self, share: Share, learnt: &Squares) -> Remainder {
        let (likelihood, floor) = (self.likelihood, &self.composed.judged.floor);
        let errors = Errors::trained(likelihood.records, self.after);
        let shares = output_shares(&errors.nrmse(), &errors.relative(&floor.floor));
        let place = locate(
            likelihood.system,
            likelihood.records,
            self.after,
            floor,
            &shares,
            &likelihood.memory(),
        );
        Remainder {
            share,
            above_floor: (learnt.floor > 0.0).then(|| (learnt.after / learnt.floor).sqrt()),
            outputs: place.outputs,
            times: place.times,
            bands: place.bands,
            regimes: place.regimes,
            description: None,
            unrelated: None,
        }
    }
}

/// The aliases of an effect in the data belong to its class, too.
pub(crate) fn share_classes(contributions: &mut [Contribution], indistinguishable: &[Vec<String>]) {
    for contribution in contributions {
        let own = format!("{}:{}", contribution.effect, contribution.channel);
        for name in indistinguishable.iter().filter(|class| class.contains(&own)).flatten() {
            if *name != own && !contribution.class.contains(name) {
                contribution.class.push(name.clone());
            }
        }
    }
}

/// The explained part of the gap; `left`: the unexplained share on the training logs.
pub(crate) fn explained(composed: &ActiveCauses, left: Option<f64>) -> Explained {
    match (composed.judged.verdict, &composed.hypothesis) {
        (GapVerdict::Effects, _) if composed.judged.complete => Explained::All,
        (_, Some(_)) if left.is_some_and(|left| left <= MOST) => Explained::Mostly,
        (_, Some(_)) => Explained::Part,
        (_, None) => Explained::Nothing,
    }
}

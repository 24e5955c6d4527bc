//! The search for several causes: effects are added one at a time and all of them refitted together, for as long as data that were not fitted to ask for it.
//!
//! How it can be wrong:
//! - A flexible stand-in (a resonance for a lag, a lag for a coupling) comes in first, because alone it takes more than any of the true causes. So after every
//!   addition each earlier effect is taken out again, or replaced by what explains more in its place, and everything else is refitted.
//! - Noise with a memory makes blocks of time alike by chance, so an effect must help in most of them, and on held-out data.
//! - A simulator is a little off everywhere: on a precise machine a trifle is certain and still no cause. So an effect has to take a part of the original gap, or of
//!   what is left where that is seen in the outputs.
//! - Under autoregressive noise the misfit of causes that are not found yet counts as noise, and slow causes vanish in it. So the weights are white, as large
//!   as the present residual of each output; only where nothing is accepted they are tried beside the colour of the residual.
//! - An effect outside the catalogue is taken by its nearest neighbour: its share says how much it predicts, never that it is the physics.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::gate::{Gate, Original};
use super::standing::Standing;
use crate::baseline::noise::Noise;
use crate::baseline::spectrum::peaks_hz;
use crate::format::progress::Stage;
use crate::hypothesis::direction::with;
use crate::hypothesis::effects::Hypothesis;
use crate::input::budget::Composing;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use crate::search::catalogue_search::noise_of;
use deadtime_model::effect::{Applied, Scales, row};

/// Effects that together explain, and what could stand in the place of each.
#[derive(Debug, Clone)]
pub(crate) struct Composition {
    /// Fitted together, in the order of the table of effects.
    pub(crate) hypothesis: Hypothesis,
    /// Per effect.
    pub(crate) stand_ins: Vec<Vec<Applied>>,
    /// The relative size of the model's own errors, where its numbers were freed as one block.
    pub(crate) recalibration: Option<f64>,
}

/// The search.
pub(crate) struct Composer<'c, 'a> {
    pub(crate) likelihood: &'c Likelihood<'a>,
    pub(crate) candidates: Vec<Applied>,
    /// Single effects as they were fitted alone: first guesses.
    pub(crate) singles: &'c [Hypothesis],
    /// Pairs as the search fitted them, the best first.
    pub(crate) pairs: &'c [Hypothesis],
    pub(crate) scales: Scales,
    /// Per output, what is no more than rounding.
    pub(crate) smallest: &'c [f64],
    pub(crate) gate: Gate,
    /// The training nrmse of all outputs down to which something is left above the noise.
    pub(crate) noise: f64,
    /// So many effects at most.
    pub(crate) most: usize,
    /// Under white weights, or beside the colour of what is left.
    pub(crate) white: bool,
    /// The relative size of the model's own errors, once its numbers are freed as one block.
    pub(crate) shrinkage: Option<f64>,
    /// Names of candidates that were promising at some step.
    pub(crate) shortlist: Vec<String>,
}

impl<'a> Composer<'_, 'a> {
    /// Adds effects to those of a hypothesis until nothing is accepted; `None` where the model cannot be simulated.
    pub(crate) fn compose(
        &mut self,
        from: &[Applied],
        progress: &dyn Fn(Stage),
    ) -> Option<Composition> {
        // What noise decides sample by sample, and hidden sequences, are no deterministic parts of a sum.
        self.candidates.retain(|a| !a.effect.leaves_residual() && !a.effect.loses_commands());
        let before = residuals(self.likelihood, NO_EFFECT)?;
        let errors = |held: bool| {
            Errors::of(self.likelihood.records, &before, |r| if held { r.held } else { r.train })
        };
        let original = Original { train: errors(false), held: errors(true) };
        let hypothesis = Hypothesis {
            effects: from.to_vec(),
            free: Vec::new(),
            gain: 0.0,
            fitted: false,
            lost: None,
        };
        let mut composition = Composition {
            stand_ins: vec![Vec::new(); from.len()],
            hypothesis,
            recalibration: None,
        };
        // What explains most alone may belong in the place of what was found before, once something else stands beside it.
        let mut alone: Vec<&Hypothesis> =
            self.singles.iter().filter(|s| s.fitted && s.effects.len() == 1).collect();
        alone.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        self.shortlist = alone.iter().take(self.budget().listed).map(|s| s.key()).collect();
        // Of several that leave something each may be a stand-in; one alone, where it is a law of many numbers in the place of a plain one.
        let several = from.len() > 1 && self.leaves_something(&composition.hypothesis);
        if let Some((likelihood, present)) = self.renewed(&composition.hypothesis) {
            let flexible =
                |a: &&Applied| several || a.values.iter().filter(|v| v.is_finite()).count() > 1;
            let earlier: Vec<Applied> =
                present.hypothesis.effects.iter().filter(flexible).cloned().collect();
            composition = self.backward(&likelihood, composition, present, earlier, &original);
        }
        composition = self.forward(composition, &original, progress);
        if self.leaves_something(&composition.hypothesis)
            && let Some(other) = self.rearranged(&composition, &original)
        {
            composition = self.forward(other, &original, progress);
        }
        if let Some(other) = self.elaborated(&composition, &original) {
            composition = self.forward(other, &original, progress);
        }
        if composition.hypothesis.effects.is_empty()
            && let Some(pair) = self.together(&original)
        {
            composition = self.forward(pair, &original, progress);
        }
        if !self.likelihood.system.is_black_box()
            && let Some((released, size)) = self.recalibrated(&composition, &original)
        {
            self.shrinkage = size;
            composition = self.forward(released, &original, progress);
            composition.recalibration = size;
        }
        if let Some(other) = self.merged(&composition) {
            composition = self.forward(other, &original, progress);
        }
        Some(composition)
    }

    /// The best of the pairs that the search fitted, where the gate lets it in: two effects may hide each other, so that neither helps alone.
    fn together(&self, original: &Original) -> Option<Composition> {
        let nothing = Hypothesis {
            effects: Vec::new(),
            free: Vec::new(),
            gain: 0.0,
            fitted: false,
            lost: None,
        };
        let (likelihood, before) = self.renewed(&nothing)?;
        let cost = self.cost(&likelihood);
        let known = |e: &&Hypothesis| {
            e.effects.iter().all(|a| self.candidates.iter().any(|c| c.key() == a.key()))
        };
        let fitted = self.pairs.iter().filter(known).take(self.budget().pairs).filter_map(|pair| {
            let from = Hypothesis { lost: None, ..pair.clone() };
            let refitted =
                Hypothesis::refit(&likelihood, from, &self.scales, cost, likelihood.budget.steps)?;
            Standing::of(&likelihood, refitted, &self.scales)
                .filter(|after| self.gate.accepts(&before, after, original))
        });
        let best = fitted.min_by(|a, b| a.error().total_cmp(&b.error()))?;
        Some(Composition {
            stand_ins: vec![Vec::new(); best.hypothesis.effects.len()],
            hypothesis: best.hypothesis,
            recalibration: None,
        })
    }

    /// Adds one effect after the other for as long as one is accepted.
    fn forward(
        &mut self,
        mut composition: Composition,
        original: &Original,
        progress: &dyn Fn(Stage),
    ) -> Composition {
        while self.effects_of(&composition.hypothesis) < self.most {
            progress(Stage::Composing(self.effects_of(&composition.hypothesis)));
            let Some((likelihood, before)) = self.renewed(&composition.hypothesis) else { break };
            composition.hypothesis = before.hypothesis.clone();
            self.scales.peaks_hz =
                peaks_hz(likelihood.records, &before.residuals, likelihood.system.outputs.len());
            let all: Vec<&Applied> = self.candidates.iter().collect();
            let promising = self.promising(&likelihood, &before.hypothesis, &all);
            let listed = promising
                .iter()
                .take(self.budget().listed)
                .map(|(_, a)| a.key())
                .filter(|key| !self.shortlist.contains(key));
            self.shortlist.extend(listed.collect::<Vec<_>>());
            let Some((next, stand_ins)) = self.best(
                &likelihood,
                &before,
                &before.hypothesis,
                (promising, self.budget().added),
                original,
            ) else {
                break;
            };
            let Some(added) = newest(&before.hypothesis, &next.hypothesis) else { break };
            composition = composition.with(&next.hypothesis, &added, stand_ins);
            let earlier = next
                .hypothesis
                .effects
                .iter()
                .filter(|a| a.key() != added.key() && !self.in_block(a))
                .cloned()
                .collect();
            composition = self.backward(&likelihood, composition, next, earlier, original);
        }
        composition
    }

    /// Something is left above the noise of what was learnt from.
    pub(crate) fn leaves_something(&self, hypothesis: &Hypothesis) -> bool {
        let errors = |left: Vec<DMatrix<f64>>| {
            overall(&Errors::of(self.likelihood.records, &left, |r| r.train).nrmse())
        };
        residuals(self.likelihood, hypothesis)
            .and_then(errors)
            .is_some_and(|after| after > self.noise)
    }

    /// Effects aside from the model's numbers where these are one block.
    fn effects_of(&self, hypothesis: &Hypothesis) -> usize {
        hypothesis.effects.iter().filter(|a| !self.in_block(a)).count()
    }

    pub(super) fn budget(&self) -> &'static Composing {
        &self.likelihood.budget.composing
    }

    pub(super) fn in_block(&self, applied: &Applied) -> bool {
        self.shrinkage.is_some() && applied.effect.corrects_model()
    }

    /// The likelihood with white weights as large as what a hypothesis leaves, and how the hypothesis stands under them, fitted anew.
    pub(super) fn renewed(&self, hypothesis: &Hypothesis) -> Option<(Likelihood<'a>, Standing)> {
        let left = residuals(self.likelihood, hypothesis)?;
        let rms = Errors::of(self.likelihood.records, &left, |r| r.train)
            .times(hypothesis.noise_over_left(self.likelihood))
            .rms();
        let std: Vec<f64> = rms.iter().zip(self.smallest).map(|(r, s)| r.max(*s)).collect();
        let noise = match self.white {
            true => vec![Noise::white(&std); self.likelihood.records.len()],
            false => noise_of(self.likelihood, Some(hypothesis), self.smallest)?,
        };
        let likelihood = self.likelihood.with_noise(noise);
        let likelihood = self
            .shrinkage
            .map_or_else(|| likelihood.clone(), |size| likelihood.with_shrinkage(size));
        let refitted = Hypothesis::refit(
            &likelihood,
            hypothesis.clone(),
            &self.scales,
            self.cost(&likelihood),
            likelihood.budget.steps,
        )?;
        let standing = Standing::of(&likelihood, refitted, &self.scales)?;
        Some((likelihood, standing))
    }

    pub(super) fn cost(&self, likelihood: &Likelihood<'_>) -> f64 {
        likelihood.whitened(NO_EFFECT).map_or(0.0, |w| likelihood.inner(&w, &w))
    }

    /// The best addition that is accepted, and what could stand in its place. What has fewer parameters leads where it could stand in the place of the best:
    /// a law of three numbers takes the shape of much that it is not. Of near equals the first in the table leads.
    /// Fits begin `from` the values of the others there.
    fn best(
        &self,
        likelihood: &Likelihood<'_>,
        before: &Standing,
        from: &Hypothesis,
        (promising, counts): (Vec<(f64, Applied)>, [usize; 2]),
        original: &Original,
    ) -> Option<(Standing, Vec<Applied>)> {
        let trials = self.additions(likelihood, from, promising, counts);
        let standings: Vec<Standing> = trials
            .into_par_iter()
            .filter_map(|e| Standing::of(likelihood, e, &self.scales))
            .collect();
        let accepted: Vec<&Standing> =
            standings.iter().filter(|after| self.gate.accepts(before, after, original)).collect();
        let lowest = *accepted.iter().min_by(|a, b| a.error().total_cmp(&b.error()))?;
        let as_good =
            || accepted.iter().copied().filter(|s| self.gate.stands_in(before, lowest, s));
        let fewest = as_good().map(|s| s.hypothesis.free.len()).min()?;
        let few = || as_good().filter(|s| s.hypothesis.free.len() == fewest);
        let least = few().map(Standing::error).fold(f64::INFINITY, f64::min);
        let near = few().filter(|s| s.error() <= (1.0 + self.gate.criteria.added_equals) * least);
        let winner =
            near.min_by_key(|s| newest(&before.hypothesis, &s.hypothesis).map(|a| row(a.effect)))?;
        let others = standings.iter().filter(|s| {
            s.hypothesis.key() != winner.hypothesis.key() && self.gate.stands_in(before, winner, s)
        });
        let stand_ins = others.filter_map(|s| newest(&before.hypothesis, &s.hypothesis)).collect();
        Some((winner.clone(), stand_ins))
    }

    /// Takes out every earlier effect that is needless now, or puts in its place what explains more beside the others, or as much with fewer parameters.
    pub(super) fn backward(
        &self,
        likelihood: &Likelihood<'_>,
        mut composition: Composition,
        mut present: Standing,
        earlier: Vec<Applied>,
        original: &Original,
    ) -> Composition {
        let cost = self.cost(likelihood);
        for old in earlier {
            // Fitted without it the others take what was its own, a friction down to nothing: what is tried in its place begins from where they stand with it.
            let others = to_be_fitted(&present.hypothesis, None, Some(&old));
            let refitted = Hypothesis::refit(
                likelihood,
                others.clone(),
                &self.scales,
                cost,
                likelihood.budget.steps,
            );
            let Some(without) = refitted.and_then(|e| Standing::of(likelihood, e, &self.scales))
            else {
                continue;
            };
            if self.gate.needless(&without, &present) {
                composition = composition.without(&without.hypothesis);
                present = without;
                continue;
            }
            // What could explain as much was among the most promising at some step.
            let listed: Vec<&Applied> = self
                .candidates
                .iter()
                .filter(|a| self.shortlist.contains(&a.key()) || a.key() == old.key())
                .collect();
            let mut promising = self.promising(likelihood, &without.hypothesis, &listed);
            // One number of the same unit and kind (a delay elsewhere, a clock) is tried as it is.
            let begun: Vec<(f64, Applied)> = listed
                .iter()
                .filter_map(|a| Some((promising.first()?.0, begun_as(&old, a)?)))
                .collect();
            promising.retain(|(_, a)| begun.iter().all(|(_, b)| b.key() != a.key()));
            promising.splice(0..0, begun);
            let alike = promising
                .iter()
                .filter(|(promise, _)| {
                    *promise >= self.gate.criteria.promises_as_much * promising[0].0
                })
                .count();
            let counts =
                [0, 1].map(|of| alike.clamp(self.budget().swapped[of], self.budget().alike[of]));
            let Some((swapped, stand_ins)) =
                self.best(likelihood, &without, &others, (promising, counts), original)
            else {
                continue;
            };
            let Some(instead) = newest(&without.hypothesis, &swapped.hypothesis) else { continue };
            if instead.key() == old.key() {
                composition = composition.with(&present.hypothesis, &old, stand_ins);
                continue;
            }
            // What does as well with fewer parameters takes the place of a law of many: a resonance takes the shape of a gain, a lag, a friction. What leaves something
            // above the noise where the law leaves nothing does not do as well, though few blocks, those behind a jump, hold all the difference.
            let fewer = swapped.hypothesis.free.len() < present.hypothesis.free.len();
            let as_complete = || {
                !self.leaves_something(&swapped.hypothesis)
                    || self.leaves_something(&present.hypothesis)
            };
            let plainer =
                fewer && self.gate.stands_in(&without, &present, &swapped) && as_complete();
            if plainer || self.replaces(&present, &swapped) {
                composition = composition.with(&swapped.hypothesis, &instead, stand_ins);
                present = swapped;
            } else if self.gate.stands_in(&without, &present, &swapped) {
                let alike = [instead]
                    .into_iter()
                    .chain(stand_ins)
                    .filter(|a| a.key() != old.key())
                    .collect();
                composition = composition.with(&present.hypothesis, &old, alike);
            }
        }
        composition
    }

    /// Not plainly worse over the blocks, and hardly worse on held-out data.
    pub(super) fn as_good(&self, present: &Standing, other: &Standing) -> bool {
        let worse = Gate::fall(other, present) > self.gate.criteria.added_falls
            && present.better_by_t(other) >= self.gate.criteria.added_t;
        !worse && self.gate.holds_out(present, other)
    }

    /// Whether a composition that was found without some of another's effects takes that one's place: it explains as much with fewer numbers, or more, and more for
    /// every further number.
    pub(crate) fn prefers(&self, present: &Composition, other: &Composition) -> bool {
        let standing = |likelihood: &Likelihood<'a>, composition: &Composition| {
            let shrunk = composition
                .recalibration
                .map_or_else(|| likelihood.clone(), |size| likelihood.with_shrinkage(size));
            let cost = self.cost(&shrunk);
            let refitted = Hypothesis::refit(
                &shrunk,
                composition.hypothesis.clone(),
                &self.scales,
                cost,
                shrunk.budget.steps,
            )?;
            Standing::of(&shrunk, refitted, &self.scales)
        };
        let compared = || {
            let (likelihood, _) = self.renewed(&present.hypothesis)?;
            Some((standing(&likelihood, present)?, standing(&likelihood, other)?))
        };
        // Compared under the same weights, but handed over as it stands.
        let held = |composition: &Composition| {
            let left = residuals(self.likelihood, &composition.hypothesis)?;
            Some(Errors::of(self.likelihood.records, &left, |r| r.held))
        };
        let holds_out = |(present, other): (Errors, Errors)| {
            other.over(&present) <= 1.0 / (1.0 - self.gate.criteria.added_falls)
        };
        if !held(present).zip(held(other)).is_some_and(holds_out) {
            return false;
        }
        let Some((present, other)) = compared() else { return false };
        if other.hypothesis.free.len() < present.hypothesis.free.len() {
            return self.as_good(&present, &other);
        }
        self.gate.pays(&present, &other)
            && self.gate.better(&present, &other)
            && other.held.over(&present.held) <= 1.0
    }

    /// Whether a composition takes the place of another: it explains more, with hardly more parameters, on held-out data too.
    pub(super) fn replaces(&self, present: &Standing, other: &Standing) -> bool {
        let simple = other.hypothesis.free.len() <= present.hypothesis.free.len() + 1;
        let better = Gate::fall(present, other) > self.gate.criteria.added_equals
            && self.gate.better(present, other);
        simple && better && other.held.over(&present.held) <= 1.0
    }
}

impl Composition {
    /// Another hypothesis, with what could stand in the place of its newest effect; the others keep theirs.
    pub(super) fn with(
        &self,
        hypothesis: &Hypothesis,
        newest: &Applied,
        stand_ins: Vec<Applied>,
    ) -> Self {
        let of = |a: &Applied| {
            if a.key() == newest.key() { stand_ins.clone() } else { self.stand_ins_of(a) }
        };
        Self {
            stand_ins: hypothesis.effects.iter().map(of).collect(),
            hypothesis: hypothesis.clone(),
            ..*self
        }
    }

    /// A hypothesis with fewer effects.
    pub(super) fn without(&self, hypothesis: &Hypothesis) -> Self {
        Self {
            stand_ins: hypothesis.effects.iter().map(|a| self.stand_ins_of(a)).collect(),
            hypothesis: hypothesis.clone(),
            ..*self
        }
    }

    pub(super) fn stand_ins_of(&self, effect: &Applied) -> Vec<Applied> {
        let at = self.hypothesis.effects.iter().position(|a| a.key() == effect.key());
        at.map(|at| self.stand_ins[at].clone()).unwrap_or_default()
    }
}

/// A hypothesis with one effect more or less, in the order of the table, to be fitted.
pub(super) fn to_be_fitted(
    present: &Hypothesis,
    more: Option<Applied>,
    less: Option<&Applied>,
) -> Hypothesis {
    let kept = present.effects.iter().filter(|a| less.is_none_or(|l| l.key() != a.key())).cloned();
    Hypothesis {
        effects: in_order(kept.chain(more)),
        free: Vec::new(),
        gain: 0.0,
        fitted: false,
        lost: None,
    }
}

/// An effect of one number with that of another, where both numbers are of one unit and kind.
pub(super) fn begun_as(other: &Applied, applied: &Applied) -> Option<Applied> {
    let ([theirs], [own]) = (&other.parameters[..], &applied.parameters[..]) else { return None };
    let alike = own.unit == theirs.unit
        && (own.role == theirs.role || (own.role.is_time() && theirs.role.is_time()));
    (alike && applied.key() != other.key())
        .then(|| with(applied, &[other.values[0].clamp(own.lower, own.upper)]))
}

/// Effects in the order of the table.
pub(super) fn in_order(effects: impl Iterator<Item = Applied>) -> Vec<Applied> {
    let mut effects: Vec<Applied> = effects.collect();
    effects.sort_by_key(|a| row(a.effect));
    effects
}

/// The effect that one hypothesis has and another has not.
pub(super) fn newest(before: &Hypothesis, after: &Hypothesis) -> Option<Applied> {
    after.effects.iter().find(|a| before.effects.iter().all(|b| b.key() != a.key())).cloned()
}

//! The verdict in the light of several causes: where one or two effects explain too little, what else acts beside them, and whether all together explain it.
//!
//! How it can be wrong: where one effect explains all down to the noise, anything beside it is chance, so nothing is looked for; where the search named an
//! effect and something stays above the noise, further effects pass the gate beside it; where it named none, the composition begins with nothing. What was
//! decoded sample by sample (lost commands, a lattice) is no part of a sum and stays as it is.

use nalgebra::DMatrix;
use rayon::prelude::*;
use statrs::function::erf::erfc_inv;

use super::composer::{Composer, Composition, to_be_fitted};
use super::gate::Gate;
use super::standing::Standing;
use super::weak::weak;
use crate::baseline::noise::Noise;
use crate::format::progress::Stage;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::judge::floor::Floor;
use crate::judge::intervals;
use crate::judge::intervals::Estimate;
use crate::judge::rule::{GapVerdict, Ruling};
use crate::judge::verdict::{Judged, ruled};
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use crate::search::catalogue_search::{SearchResult, noise_of};
use deadtime_model::effect::{Applied, Lateness, Scales};
use deadtime_signal::stats::NORMAL_95;

/// What acts.
pub(crate) struct Composed {
    /// The verdict, with all that was found.
    pub(crate) judged: Judged,
    /// Everything that was found to act, whatever the verdict; `None`: nothing.
    pub(crate) hypothesis: Option<Hypothesis>,
    /// Per effect of the hypothesis, what could stand in its place.
    pub(crate) stand_ins: Vec<Vec<Applied>>,
    /// Per effect, all the others as they are without it; the model's numbers that are one block come last, and go together.
    pub(crate) taken_out: Vec<Hypothesis>,
    /// The same with all the others refitted. `None`: cannot be simulated.
    pub(crate) without: Vec<Option<Hypothesis>>,
    /// The relative size of the model's own errors, where its numbers are one block.
    pub(crate) recalibration: Option<f64>,
    /// Standard deviations of its parameters.
    pub(crate) estimate: Option<Estimate>,
}

impl Composed {
    /// Nothing was found to act.
    fn nothing(judged: Judged) -> Self {
        Self {
            judged,
            hypothesis: None,
            stand_ins: Vec::new(),
            taken_out: Vec::new(),
            without: Vec::new(),
            recalibration: None,
            estimate: None,
        }
    }
}

/// The terms of a composition.
pub(crate) struct Compose<'c, 'a> {
    /// As the search left it: under the noise of what leads.
    pub(crate) likelihood: &'c Likelihood<'a>,
    pub(crate) found: &'c SearchResult,
    pub(crate) catalogue: &'c [Applied],
    pub(crate) scales: &'c Scales,
    /// Per output, what is no more than rounding.
    pub(crate) smallest: &'c [f64],
}

impl Composed {
    /// Places of the effects that have a share of their own.
    pub(crate) fn singly(&self) -> Vec<usize> {
        let Some(hypothesis) = &self.hypothesis else { return Vec::new() };
        (0..hypothesis.effects.len())
            .filter(|&at| !in_block(self.recalibration, &hypothesis.effects[at]))
            .collect()
    }

    /// Places of the model's numbers that are one block.
    pub(crate) fn block(&self) -> Vec<usize> {
        let Some(hypothesis) = &self.hypothesis else { return Vec::new() };
        (0..hypothesis.effects.len())
            .filter(|&at| in_block(self.recalibration, &hypothesis.effects[at]))
            .collect()
    }
}

/// So many standard deviations does the largest of a number of normal variables exceed, on either side, with this chance at most (Bonferroni's inequality).
fn by_chance_of_many(chance: f64, many: usize) -> f64 {
    erfc_inv(chance / many.max(1) as f64) * std::f64::consts::SQRT_2
}

fn in_block(recalibration: Option<f64>, applied: &Applied) -> bool {
    recalibration.is_some() && applied.effect.corrects_model()
}

impl Compose<'_, '_> {
    /// What acts beside, or instead of, what the search named; `None` where the model cannot be simulated.
    pub(crate) fn from(&self, judged: Judged, progress: &dyn Fn(Stage)) -> Option<Composed> {
        let begin = match judged.verdict {
            GapVerdict::None => {
                return match self.weak() {
                    None => Some(Composed::nothing(judged)),
                    Some(weak) => self.judged_weak(judged, weak),
                };
            }
            GapVerdict::Effects => {
                let found = judged.found.clone()?;
                if self.is_of_the_numbers(&found) {
                    let of_the_numbers = Some(found.key());
                    return Some(Composed::nothing(Judged {
                        verdict: GapVerdict::None,
                        found: None,
                        best: None,
                        of_the_numbers,
                        ..judged
                    }));
                }
                found
            }
            GapVerdict::Unknown => of(Vec::new()),
        };
        let mut stand_ins: Vec<(String, Vec<Applied>)> = Vec::new();
        let decoded =
            begin.lost.is_some() || begin.effects.iter().any(|a| a.effect.leaves_residual());
        // A single effect that leaves nothing above the noise has been tried with every second one; a pair with no third.
        // Of a simulator that can only be called most laws cannot be tried, and what is left beside a named effect is taken by whatever can.
        // What is left of the gap is searched wherever a further cause could matter in it.
        let enough_of_it = 1.0 - self.likelihood.criteria.added_matters;
        let all_taken =
            || self.share_taken(&begin, &judged).is_none_or(|share| share >= enough_of_it);
        let alone = self.likelihood.system.is_black_box()
            || (judged.left_over.is_none() && begin.effects.len() < 2 && all_taken());
        let enough = judged.verdict == GapVerdict::Effects && alone;
        if !decoded && !enough {
            let composition = self.composition(&begin, &judged.floor, progress)?;
            let composition = self.begun_elsewhere(composition, &judged, progress);
            // Where nothing changed, what was judged stays as it was fitted.
            if !composition.hypothesis.effects.is_empty()
                && composition.hypothesis.key() != begin.key()
            {
                return self.judged(judged, &composition);
            }
            stand_ins = composition
                .hypothesis
                .effects
                .iter()
                .map(|a| (a.key(), composition.stand_ins_of(a)))
                .collect();
        }
        // A sequence that is decoded from the outputs can take the shape of much: where laws without chance explain as much, they are the reason.
        if begin.lost.is_some() && !self.likelihood.system.is_black_box() {
            let plain = self.composition(&of(Vec::new()), &judged.floor, progress)?;
            let errors = self.error_of(&plain.hypothesis).zip(self.error_of(&begin));
            let as_good = errors.is_some_and(|(plain, decoded)| {
                plain <= self.likelihood.criteria.settled * decoded
            });
            if !plain.hypothesis.effects.is_empty()
                && (as_good || self.predicts_more(&plain.hypothesis, &begin))
            {
                return self.judged(judged, &plain);
            }
        }
        if begin.effects.is_empty() {
            return Some(Composed::nothing(judged));
        }
        let (hypothesis, taken_out) = self.by_share(begin, None);
        let without = self.refitted(&hypothesis, &taken_out);
        let estimate = intervals::estimate(self.likelihood, &hypothesis, self.scales);
        let judged =
            Judged { found: Some(hypothesis.clone()), best: Some(hypothesis.clone()), ..judged };
        let of_effect = |a: &Applied| {
            stand_ins
                .iter()
                .find(|(key, _)| *key == a.key())
                .map(|(_, s)| s.clone())
                .unwrap_or_default()
        };
        Some(Composed {
            judged,
            stand_ins: hypothesis.effects.iter().map(of_effect).collect(),
            hypothesis: Some(hypothesis),
            taken_out,
            without,
            recalibration: None,
            estimate,
        })
    }

    /// Laws without chance tell plainly more, learnt and held out, than what a hidden sequence is on average, a fixed delay or a lag beside the same effects. Of a
    /// sequence that chance decides no law can tell more.
    fn predicts_more(&self, plain: &Hypothesis, hidden: &Hypothesis) -> bool {
        let on_average = |e: &&Hypothesis| {
            let stands = |a: &Applied| {
                hidden.effects.iter().any(|h| match h.effect.loses_commands() {
                    true => {
                        h.channel == a.channel
                            && matches!(a.effect.lateness(), Some(Lateness::Fixed | Lateness::Lag))
                    }
                    false => h.key() == a.key(),
                })
            };
            e.fitted && e.effects.len() == hidden.effects.len() && e.effects.iter().all(stands)
        };
        let Some(plain) = self.errors_of(plain) else { return false };
        let known: Vec<[Errors; 2]> = self
            .found
            .singles
            .iter()
            .chain(&self.found.pairs)
            .filter(on_average)
            .filter_map(|e| self.errors_of(e))
            .collect();
        let plainly = |mean: &[Errors; 2]| {
            (0..2)
                .all(|of| 1.0 - plain[of].over(&mean[of]) >= self.likelihood.criteria.added_plainly)
        };
        !known.is_empty() && known.iter().all(plainly)
    }

    /// The part of before² − floor² that a hypothesis takes on what was learnt from; `None` where there is nothing to take.
    fn share_taken(&self, hypothesis: &Hypothesis, judged: &Judged) -> Option<f64> {
        let nothing = Level::of(self.likelihood, None)?;
        let [before, floor] = [nothing.train.nrmse(), nothing.train.relative(&judged.floor.floor)]
            .map(|each| overall(&each).map(|e| e * e));
        let (before, floor, after) = (before?, floor?, self.error_of(hypothesis)?.powi(2));
        (before > floor).then(|| (before - after) / (before - floor))
    }

    /// A single effect that lowers a small gap, where the model's numbers, each a little off, do so as well: that is no effect.
    fn is_of_the_numbers(&self, found: &Hypothesis) -> bool {
        let small = || {
            let before = overall(&Level::of(self.likelihood, None)?.train.nrmse())?;
            Some(before < self.likelihood.criteria.clear * self.error_of(found)?)
        };
        let plain = found.effects.len() == 1
            && found.lost.is_none()
            && found.effects.iter().all(|a| !a.effect.leaves_residual());
        let explained =
            || {
                let likelihood =
                    self.likelihood.with_noise(noise_of(self.likelihood, None, self.smallest)?);
                let composer = Composer { likelihood: &likelihood, ..self.composer(false, None) };
                let steps = likelihood.budget.steps;
                let single = Hypothesis::refit(
                    &likelihood,
                    found.clone(),
                    self.scales,
                    composer.cost(&likelihood),
                    steps,
                )?;
                Some(composer.numbers_explain(
                    &single,
                    &Standing::of(&likelihood, of(Vec::new()), self.scales)?,
                ))
            };
        plain && small().unwrap_or(false) && explained().unwrap_or(false)
    }

    /// A small effect that is certain all the same.
    fn weak(&self) -> Option<Hypothesis> {
        let likelihood =
            self.likelihood.with_noise(noise_of(self.likelihood, None, self.smallest)?);
        let composer = Composer { likelihood: &likelihood, ..self.composer(false, None) };
        weak(&likelihood, self.found, &composer)
    }

    /// The verdict on a weak effect: there is little to explain, and it explains it.
    fn judged_weak(&self, judged: Judged, weak: Hypothesis) -> Option<Composed> {
        let beside =
            self.likelihood.with_noise(noise_of(self.likelihood, Some(&weak), self.smallest)?);
        let estimate = intervals::estimate(&beside, &weak, self.scales);
        // The likelihood takes the model's other numbers as exact, and every sample as one of its own. The interval does not.
        if estimate.as_ref().is_some_and(|e| {
            !e.apart(
                &weak,
                by_chance_of_many(self.likelihood.criteria.weak_chance, self.catalogue.len()),
            )
        }) {
            return Some(Composed::nothing(judged));
        }
        let taken_out = Self::taken_out(&weak, &[vec![0]]);
        let without = self.refitted(&weak, &taken_out);
        let judged = Judged {
            verdict: GapVerdict::Effects,
            found: Some(weak.clone()),
            best: Some(weak.clone()),
            ..judged
        };
        Some(Composed {
            judged,
            hypothesis: Some(weak),
            stand_ins: vec![Vec::new(); without.len()],
            taken_out,
            without,
            recalibration: None,
            estimate,
        })
    }

    fn composer(&self, white: bool, floor: Option<&Floor>) -> Composer<'_, '_> {
        // Each trial of a simulator that can only be called is a call: only what was fitted already, and one effect of it.
        let called = self.likelihood.system.is_black_box();
        let fitted = self.found.singles.iter().filter(|e| e.fitted).flat_map(|e| e.effects.clone());
        Composer {
            likelihood: self.likelihood,
            candidates: if called { fitted.collect() } else { self.catalogue.to_vec() },
            most: if called { 1 } else { self.likelihood.criteria.most_causes as usize },
            singles: &self.found.singles,
            pairs: &self.found.pairs,
            scales: self.scales.clone(),
            smallest: self.smallest,
            gate: Gate { criteria: self.likelihood.criteria },
            noise: floor.and_then(|f| self.noise_of(f)).unwrap_or(f64::INFINITY),
            white,
            shrinkage: None,
            shortlist: Vec::new(),
        }
    }

    fn composition(
        &self,
        begin: &Hypothesis,
        floor: &Floor,
        progress: &dyn Fn(Stage),
    ) -> Option<Composition> {
        let composition = self.composer(true, Some(floor)).compose(&begin.effects, progress)?;
        if composition.hypothesis.effects.is_empty() && !self.likelihood.system.is_black_box() {
            self.composer(false, Some(floor)).compose(&[], progress)
        } else {
            Some(composition)
        }
    }

    /// The same, or a better one that begins elsewhere: with a pair that leaves less than all of this does. Laws of many numbers (a resonance) take the shape of several
    /// plain ones together: so all is done again without any of them. And where something is left above the noise, what explains most may stand in the way of others:
    /// so all is done again without that, then without what explains most of the better composition.
    fn begun_elsewhere(
        &self,
        mut best: Composition,
        judged: &Judged,
        progress: &dyn Fn(Stage),
    ) -> Composition {
        if self.likelihood.system.is_black_box() || best.hypothesis.effects.is_empty() {
            return best;
        }
        let singly = |of: &Composition| -> Vec<Applied> {
            self.by_share(of.hypothesis.clone(), of.recalibration)
                .0
                .effects
                .into_iter()
                .filter(|a| !in_block(of.recalibration, a))
                .collect()
        };
        best = self.with_the_best_pair(best, &judged.floor, progress);
        let budget = self.likelihood.budget.composing;
        let is_elaborate = |a: &Applied| a.parameters.len() >= budget.elaborate;
        if singly(&best).iter().any(is_elaborate) && best.hypothesis.effects.len() > 2 {
            best = self.without_some(best, &judged.floor, progress, is_elaborate);
        }
        // Where little of the gap was understood, its noise was not, either.
        let floor = self
            .ruled_anew(&mut judged.reached.clone(), &best.hypothesis)
            .map_or_else(|| judged.floor.clone(), |(floor, _)| floor);
        let mut doubted: Vec<String> = Vec::new();
        while doubted.len() < budget.doubted
            && self.composer(true, Some(&floor)).leaves_something(&best.hypothesis)
        {
            let Some(next) =
                singly(&best).iter().map(Applied::key).find(|key| !doubted.contains(key))
            else {
                break;
            };
            best = self.without_some(best, &floor, progress, |a| a.key() == next);
            doubted.push(next);
        }
        best
    }

    /// A composition, or a better one that begins with the pair of the search that leaves least, where that is less than the composition does: two effects that help
    /// only together are not reached one at a time.
    fn with_the_best_pair(
        &self,
        best: Composition,
        floor: &Floor,
        progress: &dyn Fn(Stage),
    ) -> Composition {
        let mut composer = self.composer(true, Some(floor));
        let plain = |e: &&Hypothesis| {
            e.fitted && e.lost.is_none() && e.effects.iter().all(|a| !a.effect.leaves_residual())
        };
        let pairs: Vec<(f64, &Hypothesis)> = self
            .found
            .pairs
            .par_iter()
            .filter(plain)
            .filter_map(|pair| Some((self.error_of(pair)?, pair)))
            .collect();
        let least = pairs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (Some((error, pair)), Some(present)) = (least, self.error_of(&best.hypothesis)) else {
            return best;
        };
        if error >= present {
            return best;
        }
        let other = composer.compose(&pair.effects, progress);
        other.filter(|other| composer.prefers(&best, other)).unwrap_or(best)
    }

    /// A composition, or a better one without some effects, that begins with the best that the search found without them.
    fn without_some(
        &self,
        best: Composition,
        floor: &Floor,
        progress: &dyn Fn(Stage),
        doubted: impl Fn(&Applied) -> bool,
    ) -> Composition {
        let mut composer = self.composer(true, Some(floor));
        composer.candidates.retain(|a| !doubted(a));
        let known = |a: &Applied| {
            !a.effect.loses_commands() && composer.candidates.iter().any(|c| c.key() == a.key())
        };
        let mut fitted =
            self.found.pairs.iter().chain(self.found.singles.iter().filter(|e| e.fitted));
        let start = fitted.find(|e| e.effects.iter().all(known)).map(|e| e.effects.clone());
        let other = start.and_then(|start| composer.compose(&start, progress));
        other
            .filter(|other| !other.hypothesis.effects.is_empty() && composer.prefers(&best, other))
            .unwrap_or(best)
    }

    /// The training nrmse of all outputs down to which something is left above the noise; `None` where no output moves.
    fn noise_of(&self, floor: &Floor) -> Option<f64> {
        let floor = overall(&Level::of(self.likelihood, None)?.train.relative(&floor.floor))?;
        Some(self.likelihood.criteria.above_floor * floor)
    }

    /// The verdict on a composition.
    fn judged(&self, judged: Judged, composition: &Composition) -> Option<Composed> {
        let shrunk = composition.recalibration.map(|size| self.likelihood.with_shrinkage(size));
        let shrunk = Compose { likelihood: shrunk.as_ref().unwrap_or(self.likelihood), ..*self };
        let beside = shrunk.likelihood.with_noise(noise_of(
            shrunk.likelihood,
            Some(&composition.hypothesis),
            self.smallest,
        )?);
        let settled = shrunk.settled(&beside, composition.hypothesis.clone())?;
        let (hypothesis, taken_out) = shrunk.by_share(settled, composition.recalibration);
        let estimate = intervals::estimate(&beside, &hypothesis, self.scales);
        let without = shrunk.refitted(&hypothesis, &taken_out);
        let needless = estimate.as_ref().and_then(|e| {
            shrunk.not_established(&hypothesis, e, &without, composition.recalibration)
        });
        if let Some(needless) = needless {
            return self.judged(
                judged,
                &composition.without(&to_be_fitted(&hypothesis, None, Some(&needless))),
            );
        }
        let stand_ins = hypothesis.effects.iter().map(|a| composition.stand_ins_of(a)).collect();

        let mut reached = judged.reached.clone();
        let (floor, Ruling { verdict, unknown, left_over }) =
            self.ruled_anew(&mut reached, &hypothesis)?;
        // Of a simulator that can only be called most laws cannot be tried: what explains all of it may stand in for one of them.
        let (verdict, unknown) = match self.likelihood.system.is_black_box() {
            true => (judged.verdict, judged.unknown),
            false => (verdict, unknown),
        };
        let found = (verdict == GapVerdict::Effects).then(|| hypothesis.clone());
        let judged = Judged {
            verdict,
            found,
            best: Some(hypothesis.clone()),
            unknown,
            left_over,
            inexact: judged.inexact,
            floor,
            reached,
            of_the_numbers: None,
        };
        Some(Composed {
            judged,
            hypothesis: Some(hypothesis),
            stand_ins,
            taken_out,
            without,
            recalibration: composition.recalibration,
            estimate,
        })
    }

    /// The rules of the verdict beside what acts, whose errors join those that were `reached`: they bound the floor, too.
    fn ruled_anew(
        &self,
        reached: &mut Vec<(Errors, Vec<DMatrix<f64>>)>,
        hypothesis: &Hypothesis,
    ) -> Option<(Floor, Ruling)> {
        let (nothing, best) =
            (Level::of(self.likelihood, None)?, Level::of(self.likelihood, Some(hypothesis))?);
        reached.push(best.noise(self.likelihood));
        Some(ruled(
            self.likelihood,
            [&nothing, &best],
            reached,
            self.catalogue,
            self.scales,
            [true, false],
        ))
    }

    /// The last of the effects behind the first whose interval holds the value at which it does nothing: what the gate let in may be what others lack. Not one
    /// without which all the others, fitted again, are plainly worse: beside noise of the residual's colour slow effects have wide intervals. A law with a number at its
    /// bound takes what it can get.
    fn not_established(
        &self,
        hypothesis: &Hypothesis,
        estimate: &Estimate,
        without: &[Option<Hypothesis>],
        recalibration: Option<f64>,
    ) -> Option<Applied> {
        let with = self.errors_of(hypothesis);
        let plainly_worse = |at: usize| {
            let other = without.get(at).and_then(Option::as_ref).and_then(|e| self.errors_of(e));
            let falls = with
                .as_ref()
                .zip(other)
                .map(|(with, other)| [0, 1].map(|of| 1.0 - with[of].over(&other[of])));
            falls.is_some_and(|falls| {
                falls.iter().all(|fall| *fall >= self.likelihood.criteria.added_plainly)
            })
        };
        let at_a_bound = |at: usize| {
            hypothesis.free.iter().zip(&estimate.std).any(|((e, _), std)| *e == at && std.is_none())
        };
        let behind = (1..hypothesis.effects.len())
            .rev()
            .filter(|&at| !in_block(recalibration, &hypothesis.effects[at]));
        behind
            .filter(|&at| !estimate.one_apart(hypothesis, at, NORMAL_95))
            .find(|&at| at_a_bound(at) || !plainly_worse(at))
            .map(|at| hypothesis.effects[at].clone())
    }

    /// Of what was learnt from, and of held-out data.
    fn errors_of(&self, hypothesis: &Hypothesis) -> Option<[Errors; 2]> {
        let left = residuals(self.likelihood, hypothesis)?;
        Some([
            Errors::of(self.likelihood.records, &left, |r| r.train),
            Errors::of(self.likelihood.records, &left, |r| r.held),
        ])
    }

    /// In the order of what each effect explains beside the others, the block of the model's numbers last; and all the others without each.
    fn by_share(
        &self,
        hypothesis: Hypothesis,
        recalibration: Option<f64>,
    ) -> (Hypothesis, Vec<Hypothesis>) {
        let (block, singly): (Vec<usize>, Vec<usize>) = (0..hypothesis.effects.len())
            .partition(|&at| in_block(recalibration, &hypothesis.effects[at]));
        let mut parts: Vec<Vec<usize>> = singly.into_iter().map(|at| vec![at]).collect();
        parts.extend((!block.is_empty()).then_some(block));
        let taken_out = Self::taken_out(&hypothesis, &parts);
        let error = |e: &Hypothesis| self.error_of(e).unwrap_or(f64::INFINITY);
        let errors: Vec<f64> = taken_out.iter().map(error).collect();
        let place =
            |a: &Applied| hypothesis.effects.iter().position(|e| e.key() == a.key()).unwrap_or(0);
        let part = |a: &Applied| parts.iter().position(|p| p.contains(&place(a))).unwrap_or(0);
        let rank = |a: &Applied| {
            if in_block(recalibration, a) { f64::NEG_INFINITY } else { errors[part(a)] }
        };
        let ordered = hypothesis.clone().ordered(rank);
        let mut sorted: Vec<usize> = ordered.effects.iter().map(part).collect();
        sorted.dedup();
        (ordered, sorted.into_iter().map(|p| taken_out[p].clone()).collect())
    }

    /// The parameters under the noise of what is left, unless that makes the errors larger: under a colour that is another effect's, slow effects vanish.
    fn settled(&self, beside: &Likelihood<'_>, composed: Hypothesis) -> Option<Hypothesis> {
        let before = self.error_of(&composed)?;
        let refitted = Hypothesis::refit(
            beside,
            composed.clone(),
            self.scales,
            cost(beside)?,
            beside.budget.steps,
        );
        let mut settled = refitted
            .filter(|e| {
                self.error_of(e)
                    .is_some_and(|after| after <= self.likelihood.criteria.settled * before)
            })
            .unwrap_or(composed);
        // Compared with all others under their likelihood.
        settled.rescore(self.likelihood, cost(self.likelihood)?);
        Some(settled)
    }

    /// The training nrmse of all outputs.
    fn error_of(&self, hypothesis: &Hypothesis) -> Option<f64> {
        overall(&Level::of(self.likelihood, Some(hypothesis))?.train.nrmse())
    }

    /// Hypotheses refitted under white weights as large as what is left by all.
    fn refitted(&self, hypothesis: &Hypothesis, without: &[Hypothesis]) -> Vec<Option<Hypothesis>> {
        let Some(left) = residuals(self.likelihood, hypothesis) else {
            return vec![None; without.len()];
        };
        let rms = Errors::of(self.likelihood.records, &left, |r| r.train)
            .times(hypothesis.noise_over_left(self.likelihood))
            .rms();
        let std: Vec<f64> = rms.iter().zip(self.smallest).map(|(r, s)| r.max(*s)).collect();
        let white =
            self.likelihood.with_noise(vec![Noise::white(&std); self.likelihood.records.len()]);
        let one = |e: &Hypothesis| {
            Hypothesis::refit(&white, e.clone(), self.scales, cost(&white)?, white.budget.steps)
        };
        without.par_iter().map(one).collect()
    }

    /// Per part, all the others as they are without it.
    fn taken_out(hypothesis: &Hypothesis, parts: &[Vec<usize>]) -> Vec<Hypothesis> {
        let one = |part: &Vec<usize>| {
            let others: Vec<Applied> = hypothesis
                .effects
                .iter()
                .enumerate()
                .filter(|(at, _)| !part.contains(at))
                .map(|(_, a)| a.clone())
                .collect();
            let lost = hypothesis
                .lost
                .clone()
                .filter(|_| others.iter().any(|a| a.effect.loses_commands()));
            Hypothesis { lost, ..of(others) }
        };
        parts.iter().map(one).collect()
    }
}

/// Effects that are to be fitted.
fn of(effects: Vec<Applied>) -> Hypothesis {
    Hypothesis { effects, free: Vec::new(), gain: 0.0, fitted: false, lost: None }
}

/// What the model as it came costs.
fn cost(likelihood: &Likelihood<'_>) -> Option<f64> {
    let there = likelihood.whitened(NO_EFFECT)?;
    Some(likelihood.inner(&there, &there))
}

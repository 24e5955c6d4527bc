//! The active effects: the best set of the search with its shares, intervals and aliases, and the verdict on it.
//!
//! How it can be wrong: a sequence of lost or late commands that is decoded from the outputs absorbs a little of every misfit. It must therefore beat the best set of
//! deterministic effects under the same score. A lattice lowers no error, so the trace in the raw values alone decides on it.

use nalgebra::DMatrix;

use super::alternatives::classes;
use super::class::EffectClass;
use super::found::{Found, NAMED};
use super::search::Search;
use super::set::{CauseSet, in_order};
use super::training::Training;
use crate::baseline::noise::Noise;
use crate::format::progress::Stage;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::hypothesis::penalised_gain::Penalties;
use crate::hypothesis::slopes::information;
use crate::judge::floor::Floor;
use crate::judge::intervals;
use crate::judge::intervals::Estimate;
use crate::judge::rule::{GapVerdict, Ruling};
use crate::judge::verdict::{Judged, judge, ruled};
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::{Likelihood, Whitened};
use crate::likelihood::residuals::residuals;
use crate::search::catalogue::numbers;
use crate::search::catalogue_search::{SearchResult, noise_of};
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::parallel;

/// A refit under coloured noise may raise the training error by this factor; by more, the colour is that of another effect. Chosen: on 38 development cases
/// 1.02 and 1.2 differ in two answers. With 1.02 the values next to a slow misfit are those of the misfit.
const SETTLED: f64 = 1.2;

/// Single effects from which the search begins: their own fit had more first guesses.
const ALONE: usize = 10;

/// The active effects.
pub(crate) struct ActiveCauses {
    /// The verdict, with all that was found.
    pub(crate) judged: Judged,
    /// All active effects, for any verdict; `None`: no effect.
    pub(crate) hypothesis: Option<Hypothesis>,
    /// The classes of its effects, those that have a share of their own first; the joint recalibration is one.
    pub(crate) classes: Vec<EffectClass>,
    /// Per effect, all the others as they are without it; the joint recalibration comes last, and goes as one.
    pub(crate) taken_out: Vec<Hypothesis>,
    /// The same with all the others refitted. `None`: cannot be simulated.
    pub(crate) without: Vec<Option<Hypothesis>>,
    /// The noise of the residual of the best set; `None` where no sets were searched.
    pub(crate) noise: Option<Vec<Noise>>,
    /// The relative size of the parameters' errors, where all are recalibrated jointly.
    pub(crate) recalibration: Option<f64>,
    /// Standard deviations of its parameters.
    pub(crate) estimate: Option<Estimate>,
}

impl ActiveCauses {
    /// Nothing was found to act.
    fn nothing(judged: Judged) -> Self {
        Self {
            judged,
            hypothesis: None,
            classes: Vec::new(),
            taken_out: Vec::new(),
            without: Vec::new(),
            noise: None,
            recalibration: None,
            estimate: None,
        }
    }

    /// The named effects of the verdict: those with a share of their own, or the recalibrated parameters where there is no other.
    pub(crate) fn named(&self) -> Option<Hypothesis> {
        let found = self.judged.found.as_ref()?;
        let singly = |e: usize| !in_block(self.recalibration, &found.effects[e]);
        let kept: Vec<usize> = (0..found.effects.len()).filter(|&e| singly(e)).collect();
        if kept.is_empty() {
            return Some(found.clone());
        }
        let place = |&(e, i): &(usize, usize)| Some((kept.iter().position(|&k| k == e)?, i));
        Some(Hypothesis {
            effects: kept.iter().map(|&e| found.effects[e].clone()).collect(),
            free: found.free.iter().filter_map(place).collect(),
            ..found.clone()
        })
    }

    /// The effects that alone replace an effect, by the effect's key.
    pub(crate) fn aliases(&self, key: &str) -> Vec<String> {
        let class = self.classes.iter().find(|class| class.effect.key() == key);
        class.into_iter().flat_map(EffectClass::aliases).map(Applied::key).collect()
    }

    /// Places of the effects that have a share of their own.
    pub(crate) fn singly(&self) -> Vec<usize> {
        self.places(false)
    }

    /// Places of the parameters that are recalibrated jointly.
    pub(crate) fn block(&self) -> Vec<usize> {
        self.places(true)
    }

    fn places(&self, block: bool) -> Vec<usize> {
        let Some(hypothesis) = &self.hypothesis else { return Vec::new() };
        (0..hypothesis.effects.len())
            .filter(|&at| in_block(self.recalibration, &hypothesis.effects[at]) == block)
            .collect()
    }
}

fn in_block(recalibration: Option<f64>, applied: &Applied) -> bool {
    recalibration.is_some() && applied.effect.corrects_model()
}

/// The inputs of a conclusion.
pub(crate) struct Conclusion<'c, 'a> {
    /// As the search of single effects left it.
    pub(crate) likelihood: &'c Likelihood<'a>,
    pub(crate) catalogue: &'c [Applied],
    /// The result of the search of single effects.
    pub(crate) found: &'c SearchResult,
    /// The effects that the checks of the logs propose.
    pub(crate) remedies: &'c [Applied],
    /// The limits at which outputs stop, as effects.
    pub(crate) limits: &'c [Applied],
    pub(crate) scales: &'c Scales,
    /// Per output, the rounding error.
    pub(crate) smallest: &'c [f64],
}

impl Conclusion<'_, '_> {
    /// The active effects; `None` where the model cannot be simulated. A simulator that can only be called, and a lattice that leads, are judged by single effects
    /// and pairs.
    pub(crate) fn from(&self, progress: &dyn Fn(Stage)) -> Option<ActiveCauses> {
        let lattice = |e: &Hypothesis| e.effects.iter().any(|a| a.effect.leaves_residual());
        let leader = Penalties::of(self.likelihood).leader(&self.found.singles);
        if self.likelihood.system.is_black_box() || leader.is_some_and(lattice) {
            let judged = judge(self.likelihood, self.found, self.catalogue, self.scales)?;
            let acts = judged.best.as_ref().filter(|_| judged.verdict != GapVerdict::None);
            if self.likelihood.system.is_black_box() || acts.is_some_and(lattice) {
                return self.as_judged(judged);
            }
        }
        progress(Stage::Composing(0));
        let training = Training::of(self.likelihood);
        let deterministic =
            |a: &&Applied| !a.effect.leaves_residual() && !a.effect.loses_commands();
        let candidates: Vec<Applied> =
            self.catalogue.iter().filter(deterministic).cloned().collect();
        let scaled = |a: &Applied| a.parameters.iter().all(|p| p.nominal != 0.0);
        let numbers: Vec<Applied> =
            numbers(self.likelihood.system).into_iter().filter(scaled).collect();
        let limits = self.limits.iter().filter(|l| candidates.iter().any(|c| c.key() == l.key()));
        let limits: Vec<Applied> = limits.cloned().collect();
        let search =
            Search::new(&training, [&candidates, &numbers, &limits], self.scales, self.smallest)?;
        let begun = |e: &Hypothesis| CauseSet::begun(e.effects.clone(), None, e.lost.clone());
        let asked = (!self.remedies.is_empty())
            .then(|| CauseSet::begun(in_order(self.remedies.iter().cloned()), None, None));
        let alone = self.found.singles.iter().filter(|e| e.fitted && !lattice(e)).take(ALONE);
        let stops = limits.iter().map(|l| CauseSet::begun(vec![l.clone()], None, None));
        let found = search.from(alone.map(begun).chain(stops).collect(), asked)?;
        let (_, best) = found.sets.first()?;
        let nothing = Level::of(self.likelihood, None)?;
        let alone = leader.and_then(|e| Level::of(self.likelihood, Some(e)));
        let levels = std::iter::once(nothing).chain(alone);
        let reached = levels.map(|level| level.noise(self.likelihood)).collect();
        let noise = self.noise_given(&training, best)?;
        let likelihood = self.likelihood.with_noise(noise.clone());
        let concluded = Conclusion { likelihood: &likelihood, ..*self };
        let causes = concluded.concluded(reached, &found, best)?;
        Some(ActiveCauses { noise: Some(noise), ..causes })
    }

    /// The noise of the residual of a set. The search fits initial states under white noise; under the coloured noise of a single effect's residual they would
    /// differ.
    fn noise_given(&self, training: &Training<'_, '_>, best: &CauseSet) -> Option<Vec<Noise>> {
        let sizes = best.squares.iter().zip(&training.counts).zip(self.smallest);
        let std: Vec<f64> = sizes
            .map(|((square, count), least)| (square / count.max(1.0)).sqrt().max(*least))
            .collect();
        let white = vec![Noise::white(&std); self.likelihood.records.len()];
        let begin = Hypothesis { lost: best.lost.clone(), ..of(best.effects.clone()) };
        let acts = (!best.effects.is_empty()).then_some(&begin);
        noise_of(&self.likelihood.with_noise(white), acts, self.smallest)
    }

    /// The result of the judgement, unchanged.
    fn as_judged(&self, judged: Judged) -> Option<ActiveCauses> {
        let begin = match (&judged.verdict, &judged.found) {
            (GapVerdict::Effects, Some(found)) => found.clone(),
            _ => return Some(ActiveCauses::nothing(judged)),
        };
        let (hypothesis, taken_out) = self.by_share(begin, None);
        let without = self.refitted(&hypothesis, &taken_out);
        let central = self.likelihood.with_central_differences();
        let estimate = intervals::estimate(&central, &hypothesis, self.scales);
        let classes = classes(self.likelihood, &hypothesis, self.found, judged.inexact);
        let judged =
            Judged { found: Some(hypothesis.clone()), best: Some(hypothesis.clone()), ..judged };
        Some(ActiveCauses {
            judged,
            classes,
            hypothesis: Some(hypothesis),
            taken_out,
            without,
            noise: None,
            recalibration: None,
            estimate,
        })
    }

    /// The verdict on the best set.
    fn concluded(
        &self,
        reached: Vec<(Errors, Vec<DMatrix<f64>>)>,
        found: &Found,
        best: &CauseSet,
    ) -> Option<ActiveCauses> {
        if best.effects.is_empty() {
            let nothing = Level::of(self.likelihood, None)?;
            let levels = [&nothing, &nothing];
            let (floor, ruling) = self.ruled(levels, &reached);
            return Some(ActiveCauses::nothing(Judged::of(ruling, floor)));
        }
        let shrunk = best.recalibration.map(|size| self.likelihood.with_shrinkage(size));
        let shrunk = Conclusion { likelihood: shrunk.as_ref().unwrap_or(self.likelihood), ..*self };
        let mut begin = Hypothesis { lost: best.lost.clone(), ..of(best.effects.clone()) };
        if best.singly().next().is_none() {
            begin.effects.sort_by(|a, b| relative(b).total_cmp(&relative(a)));
        }
        let final_noise = shrunk
            .likelihood
            .with_noise(noise_of(shrunk.likelihood, Some(&begin), self.smallest)?)
            .with_central_differences();
        let settled = shrunk.settled(&final_noise, begin)?;
        let (hypothesis, taken_out) = shrunk.by_share(settled, best.recalibration);
        let between = |(key, i): (&str, usize)| found.between(best, key, i);
        let estimate = intervals::estimate(&final_noise, &hypothesis, self.scales)
            .map(|estimate| estimate.widened(&hypothesis, between));
        let unsure = shrunk.within_noise(&final_noise, found, best, &hypothesis);
        if let Some(fewer) = unsure.and_then(|out| found.without(best, out)) {
            return self.concluded(reached, found, fewer);
        }
        if let Some(fewer) = found.without_recalibration(best)
            && shrunk.recalibrates_noise(&final_noise, &hypothesis)
        {
            return self.concluded(reached, found, fewer);
        }
        let without = shrunk.refitted(&hypothesis, &taken_out);
        let judged = self.judged(best, (&hypothesis, &taken_out), reached)?;
        if judged.of_the_numbers.is_some() {
            return Some(ActiveCauses::nothing(judged));
        }
        let stays =
            |class: &EffectClass| hypothesis.effects.iter().any(|a| a.key() == class.effect.key());
        let classes = found.classes().into_iter().filter(stays).collect();
        Some(ActiveCauses {
            judged,
            classes,
            hypothesis: Some(hypothesis),
            taken_out,
            without,
            noise: None,
            recalibration: best.recalibration,
            estimate,
        })
    }

    /// The verdict on a hypothesis, which names nothing where the recalibration alone explains the gap. `taken_out`: as in [`ActiveCauses`].
    fn judged(
        &self,
        best: &CauseSet,
        (hypothesis, taken_out): (&Hypothesis, &[Hypothesis]),
        mut reached: Vec<(Errors, Vec<DMatrix<f64>>)>,
    ) -> Option<Judged> {
        let (nothing, with_all) =
            (Level::of(self.likelihood, None)?, Level::of(self.likelihood, Some(hypothesis))?);
        reached.push(with_all.noise(self.likelihood));
        if self.is_usual_recalibration(best, taken_out, [&nothing, &with_all]) {
            let recalibrated = Level { hypothesis: None, ..with_all };
            let (floor, ruling) = self.ruled([&recalibrated, &recalibrated], &reached);
            let of_the_numbers = Some(hypothesis.key());
            return Some(Judged { of_the_numbers, ..Judged::of(ruling, floor) });
        }
        let (floor, ruling) = self.ruled([&nothing, &with_all], &reached);
        Some(Judged {
            found: (ruling.verdict == GapVerdict::Effects).then(|| hypothesis.clone()),
            best: Some(hypothesis.clone()),
            ..Judged::of(ruling, floor)
        })
    }

    /// Whether a small gap is explained by a recalibration of the usual size, without an effect that is named.
    fn is_usual_recalibration(
        &self,
        best: &CauseSet,
        taken_out: &[Hypothesis],
        [nothing, with_all]: [&Level; 2],
    ) -> bool {
        // Every model's parameters are a little off: a recalibration by so little that lowers a small gap is no cause.
        let criteria = &self.likelihood.criteria;
        let overall_of = |level: &Level| overall(&level.train.nrmse());
        let small = overall_of(nothing)
            .zip(overall_of(with_all))
            .is_some_and(|(before, after)| before < criteria.clear * after);
        let usual = best.recalibration.is_some_and(|size| size <= criteria.usual_error);
        small && usual && !self.names_an_effect(best, taken_out, [nothing, with_all])
    }

    /// Whether an effect of its own, given the joint recalibration, explains a part of the gap that is named. `taken_out`: per effect the others, the recalibration last.
    fn names_an_effect(
        &self,
        best: &CauseSet,
        taken_out: &[Hypothesis],
        [nothing, with_all]: [&Level; 2],
    ) -> bool {
        let square = |level: &Level| overall(&level.train.nrmse()).map_or(0.0, |e| e * e);
        let (gap, left) = (square(nothing), square(with_all));
        let share = |without: &Hypothesis| {
            self.error_of(without).map_or(f64::INFINITY, |error| error * error - left)
        };
        let singly = taken_out.len() - usize::from(best.recalibration.is_some());
        taken_out[..singly].iter().any(|without| share(without) >= NAMED * gap)
    }

    /// The rules of the verdict, and the floor given the residuals of all `reached` hypotheses.
    fn ruled(
        &self,
        levels: [&Level; 2],
        reached: &[(Errors, Vec<DMatrix<f64>>)],
    ) -> (Floor, Ruling) {
        let penalties = Penalties::of(self.likelihood);
        let single = penalties.leader(&self.found.singles);
        let gains = single.is_some_and(|e| penalties.gain(e) > 0.0);
        let beaten = levels[1].hypothesis.is_some() || gains;
        ruled(self.likelihood, levels, reached, self.catalogue, self.scales, beaten)
    }

    /// The effects ordered by their leave-one-out error, the joint recalibration last; and the remaining effects without each.
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

    /// The parameters refitted under the noise model of the residual, unless that raises the error: a noise model that absorbed another effect hides slow effects.
    fn settled(&self, final_noise: &Likelihood<'_>, composed: Hypothesis) -> Option<Hypothesis> {
        let before = self.error_of(&composed)?;
        let refitted = Hypothesis::refit(
            final_noise,
            composed.clone(),
            self.scales,
            cost(final_noise)?,
            final_noise.budget.steps,
        );
        let mut settled = refitted
            .filter(|e| self.error_of(e).is_some_and(|after| after <= SETTLED * before))
            .unwrap_or_else(|| Hypothesis { free: composed.parameters_to_fit(), ..composed });
        // Compared with all others under their likelihood.
        settled.rescore(self.likelihood, cost(self.likelihood)?);
        Some(settled)
    }

    /// The effect whose gain under the coloured noise of the residual is smallest relative to its complexity penalty, if any gain is below the penalty.
    /// The score counts effective samples alike at all frequencies, so a slow effect can absorb slow noise.
    /// Only effects with a linearised gain (Wald 1943, doi:10.1090/S0002-9947-1943-0012401-3) below the penalty are removed, with a refit of the others.
    fn within_noise<'e>(
        &self,
        final_noise: &Likelihood<'_>,
        found: &Found,
        best: &CauseSet,
        hypothesis: &'e Hypothesis,
    ) -> Option<&'e Applied> {
        let slopes = hypothesis.slopes(final_noise, self.scales)?;
        let prior = hypothesis.prior(final_noise);
        let covariance = information(final_noise, &slopes.columns, &prior).cholesky()?.inverse();
        let own = final_noise.inner(&slopes.residual, &slopes.residual);
        let lacks = |(e, a): (usize, &'e Applied)| {
            let places = hypothesis.free.iter().enumerate().filter(|(_, free)| free.0 == e);
            let size = |(at, &(_, i)): (usize, &(usize, usize))| {
                let p = &a.parameters[i];
                let away = p.departure(a.values[i]);
                (!p.role.is_shape() && away.is_finite()).then(|| away * away / covariance[(at, at)])
            };
            let price = found.price(places.clone().count(), a);
            places.filter_map(size).reduce(f64::max).filter(|gain| *gain < price)?;
            let others = Self::taken_out(hypothesis, &[vec![e]]).pop()?;
            let steps = final_noise.budget.steps;
            let others = match others.effects.is_empty() {
                true => others,
                false => Hypothesis::refit(final_noise, others, self.scales, own, steps)?,
            };
            let left = final_noise.whitened(&others)?;
            let gain = final_noise.inner(&left, &left) - own;
            (gain < price).then_some((price - gain, a))
        };
        let effects = hypothesis.effects.iter().enumerate();
        let singly = effects.filter(|(_, a)| {
            !best.recalibrates(a)
                && !a.effect.loses_commands()
                && !a.effect.leaves_residual()
                && !found.is_shown(a)
        });
        let all: Vec<(f64, &Applied)> = singly.filter_map(lacks).collect();
        all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, a)| a)
    }

    /// Whether the joint recalibration costs more than it explains under the coloured noise of the residual. Its cost is that of the score: the prior, and the
    /// determinant of the information in units of the prior.
    fn recalibrates_noise(&self, final_noise: &Likelihood<'_>, hypothesis: &Hypothesis) -> bool {
        let costs = || -> Option<[f64; 2]> {
            let slopes = hypothesis.slopes(final_noise, self.scales)?;
            let prior = hypothesis.prior(final_noise);
            let block: Vec<usize> = (0..prior.len()).filter(|&at| prior[at].0 > 0.0).collect();
            let columns: Vec<&Whitened> = block.iter().map(|&at| &slopes.columns[at]).collect();
            let mut information = final_noise.inner_of_all(&columns);
            for (i, &a) in block.iter().enumerate() {
                for (j, &b) in block.iter().enumerate() {
                    information[(i, j)] /= (prior[a].0 * prior[b].0).sqrt();
                }
                information[(i, i)] += 1.0;
            }
            let factor = information.cholesky()?;
            let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            let moved: f64 = block.iter().map(|&at| prior[at].1.powi(2) * prior[at].0).sum();
            let own = final_noise.inner(&slopes.residual, &slopes.residual);
            let block: Vec<usize> = block.iter().map(|&at| hypothesis.free[at].0).collect();
            let others = Self::taken_out(hypothesis, &[block]).pop()?;
            let steps = final_noise.budget.steps;
            let others = Hypothesis::refit(final_noise, others, self.scales, own, steps)?;
            let left = final_noise.whitened(&others)?;
            Some([own + moved + determinant, final_noise.inner(&left, &left)])
        };
        costs().is_some_and(|[with, without]| without < with)
    }

    /// The training nrmse of all outputs.
    fn error_of(&self, hypothesis: &Hypothesis) -> Option<f64> {
        overall(&Level::of(self.likelihood, Some(hypothesis))?.train.nrmse())
    }

    /// The hypotheses refitted under white noise of the standard deviation of the residual of `hypothesis`.
    fn refitted(&self, hypothesis: &Hypothesis, without: &[Hypothesis]) -> Vec<Option<Hypothesis>> {
        let Some(left) = residuals(self.likelihood, hypothesis) else {
            return vec![None; without.len()];
        };
        let rms = Errors::trained(self.likelihood.records, &left)
            .times(hypothesis.noise_over_left(self.likelihood))
            .rms();
        let std: Vec<f64> = rms.iter().zip(self.smallest).map(|(r, s)| r.max(*s)).collect();
        let white =
            self.likelihood.with_noise(vec![Noise::white(&std); self.likelihood.records.len()]);
        let one = |e: &Hypothesis| {
            Hypothesis::refit(&white, e.clone(), self.scales, cost(&white)?, white.budget.steps)
        };
        parallel::map(without.iter(), one)
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

/// The cost of the nominal model.
fn cost(likelihood: &Likelihood<'_>) -> Option<f64> {
    let there = likelihood.whitened(NO_EFFECT)?;
    Some(likelihood.inner(&there, &there))
}

/// The deviation of a parameter of the model from its nominal value, relative to it.
fn relative(applied: &Applied) -> f64 {
    let nominal = applied.parameters[0].nominal;
    ((applied.values[0] - nominal) / nominal).abs()
}

//! All numbers of the model at once, each a little off: one block whose size the data choose.
//!
//! How it can be wrong: tried first it eats the structure (a friction, a coupling, a lag), so it comes after effects were looked for, and never alone. With as
//! many numbers as a model has, a fit describes the training logs; so all have a normal prior about the value that came, of one relative size, and the
//! size is that which predicts blocks of time left out best. Blocks beside those that were learnt from are still like them: what takes an effect's place must do so on
//! held-out data, too. Numbers that the data do not see stay where they were and are taken out again.

use super::composer::{Composer, Composition, in_order, to_be_fitted};
use super::gate::{Gate, Original};
use super::standing::Standing;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue::numbers;
use deadtime_model::effect::Applied;

/// Relative standard deviations that are tried.
const SIZES: [f64; 6] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5];
/// One number is an effect like any other.
const FEWEST: usize = 2;

impl Composer<'_, '_> {
    /// The composition with the model's numbers freed as a block, where the gate lets it in; and the size of the block. `None` for the size: one of the numbers
    /// is as good as the block, and is an effect like any other.
    pub(super) fn recalibrated(
        &self,
        composition: &Composition,
        original: &Original,
    ) -> Option<(Composition, Option<f64>)> {
        if composition.hypothesis.effects.is_empty() {
            return None;
        }
        let (likelihood, before) = self.renewed(&composition.hypothesis)?;
        let freed = self.freed(&likelihood, &before, &self.candidates)?;
        let size = self.size(&likelihood, &freed)?;
        let shrunk = likelihood.with_shrinkage(size);
        let full = self.fitted(&shrunk, freed)?;
        let block = self.fitted(&shrunk, moved(&full, self.gate.criteria.moved)?)?;
        let block =
            if block.better_by_t(&full) >= -self.gate.criteria.dropped_t { block } else { full };
        let (released, after) = self.pruned(&shrunk, composition.without(&block.hypothesis), block);
        let numbers = |standing: &Standing| {
            standing.hypothesis.effects.iter().filter(|a| a.effect.corrects_model()).count()
        };
        let others = |standing: &Standing| standing.hypothesis.effects.len() - numbers(standing);
        // What takes the place of effects, or of numbers that were found one by one, must predict as well; what comes beside them, better. A block of many
        // numbers takes the shape of an effect of one: then it must predict better, too.
        let plainer = others(&after) < others(&before)
            && after.hypothesis.free.len() <= before.hypothesis.free.len();
        let takes_place =
            plainer || numbers(&before) >= FEWEST && others(&after) == others(&before);
        let as_good = after.better_by_t(&before) >= -self.gate.criteria.dropped_t
            && self.gate.holds_out(&before, &after);
        let better = after.better_by_t(&before) >= self.gate.criteria.added_t
            && self.gate.pays(&before, &after)
            && self.gate.holds_out(&before, &after);
        let accepted = (takes_place && as_good)
            || (others(&after) < others(&before) && better)
            || self.gate.accepts(&before, &after, original);
        if numbers(&after) < FEWEST || !accepted {
            return None;
        }
        Some(match self.one_number(&likelihood, &after) {
            Some(one) => (released.without(&one), None),
            None => (released, Some(size)),
        })
    }

    /// The same with the number alone that moved furthest for what the data leave open of it, where all the others hardly help: each is a little off as those of
    /// every model are, and this one is off by more than the block's size has room for.
    fn one_number(&self, likelihood: &Likelihood<'_>, block: &Standing) -> Option<Hypothesis> {
        let (hypothesis, spread) = (&block.hypothesis, block.spread()?);
        let moved = |at: usize| {
            let (e, i) = hypothesis.free[at];
            let applied = &hypothesis.effects[e];
            applied.effect.corrects_model().then(|| {
                (
                    (applied.values[i] - applied.parameters[i].nominal).abs() / spread[at],
                    applied.key(),
                )
            })
        };
        let (_, furthest) =
            (0..spread.len()).filter_map(moved).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let kept = hypothesis
            .effects
            .iter()
            .filter(|a| !a.effect.corrects_model() || a.key() == furthest)
            .cloned();
        let one =
            to_be_fitted(&Hypothesis { effects: kept.collect(), ..hypothesis.clone() }, None, None);
        let one = self.fitted(likelihood, one)?;
        let criteria = &self.gate.criteria;
        let helped = Gate::fall(&one, block) >= criteria.added_falls
            && block.better_by_t(&one) >= criteria.added_t;
        (!helped && self.gate.holds_out(block, &one)).then_some(one.hypothesis)
    }

    /// Without the effects that only stood in for the model's numbers.
    fn pruned(
        &self,
        likelihood: &Likelihood<'_>,
        mut composition: Composition,
        mut present: Standing,
    ) -> (Composition, Standing) {
        let effects: Vec<Applied> = present
            .hypothesis
            .effects
            .iter()
            .filter(|a| !a.effect.corrects_model())
            .cloned()
            .collect();
        for old in effects {
            let Some(without) =
                self.fitted(likelihood, to_be_fitted(&present.hypothesis, None, Some(&old)))
            else {
                continue;
            };
            if self.gate.needless(&without, &present) && self.gate.holds_out(&present, &without) {
                composition = composition.without(&without.hypothesis);
                present = without;
            }
        }
        (composition, present)
    }

    /// The model's numbers being a little off, all together and nothing else, is as likely as a single effect: every model's are. Both gains stand under the
    /// composer's likelihood. An effect pays Schwarz's price of each of its numbers, and for having been chosen among all candidates, each as likely as the other.
    pub(super) fn numbers_explain(&self, single: &Hypothesis, nothing: &Standing) -> bool {
        let chosen = 2.0 * (self.candidates.len().max(1) as f64).ln();
        let evidence = single.gain
            - Penalties::of(self.likelihood).parameter * single.free.len() as f64
            - chosen;
        self.evidence_of_numbers(nothing).is_some_and(|numbers| numbers > evidence)
    }

    /// Twice the log of the evidence for the numbers being a little off against their being exact, under the size that gives the most: what they gain under
    /// their prior, less what the data tell of each beyond it (Laplace's approximation; MacKay 1992, doi:10.1162/neco.1992.4.3.415). The size under which blocks
    /// left out are predicted best says nothing here: two numbers that only their product tells apart from none may be off by any amount. `None` where the model
    /// has no numbers that could be freed.
    fn evidence_of_numbers(&self, nothing: &Standing) -> Option<f64> {
        let freed = self.freed(self.likelihood, nothing, &numbers(self.likelihood.system))?;
        let of_size = |size: f64| {
            let shrunk = self.likelihood.with_shrinkage(size);
            let block = self.fitted(&shrunk, freed.clone())?;
            let prior: f64 = block
                .hypothesis
                .prior(&shrunk)
                .iter()
                .filter(|p| p.0 > 0.0)
                .map(|p| p.0.ln())
                .sum();
            Some(block.hypothesis.gain - (block.log_information()? - prior))
        };
        SIZES
            .into_iter()
            .filter(|size| *size <= self.gate.criteria.a_little_off)
            .filter_map(of_size)
            .max_by(f64::total_cmp)
    }

    /// The effects as they stand, and every other number among candidates at its nominal value.
    fn freed(
        &self,
        likelihood: &Likelihood<'_>,
        before: &Standing,
        candidates: &[Applied],
    ) -> Option<Hypothesis> {
        let present: Vec<String> = before.hypothesis.effects.iter().map(Applied::key).collect();
        let number = |a: &&Applied| {
            a.effect.corrects_model()
                && a.parameters.iter().all(|p| p.nominal != 0.0 && p.nominal.is_finite())
        };
        let mut others: Vec<Applied> = candidates
            .iter()
            .filter(number)
            .filter(|a| !present.contains(&a.key()))
            .cloned()
            .collect();
        if others.is_empty() || others.len() > self.budget().numbers {
            return None;
        }
        for applied in &mut others {
            applied.values = applied.parameters.iter().map(|p| p.nominal).collect();
        }
        let effects = in_order(before.hypothesis.effects.iter().cloned().chain(others));
        let place = |e: usize, a: &Applied| {
            (0..a.values.len())
                .filter(|&i| a.values[i].is_finite())
                .map(move |i| (e, i))
                .collect::<Vec<_>>()
        };
        let free = effects.iter().enumerate().flat_map(|(e, a)| place(e, a)).collect();
        let freed = Hypothesis { effects, free, gain: 0.0, fitted: false, lost: None };
        likelihood.whitened(&freed).is_some().then_some(freed)
    }

    /// The size under which blocks of time left out are predicted best.
    fn size(&self, likelihood: &Likelihood<'_>, freed: &Hypothesis) -> Option<f64> {
        let slopes = freed.slopes(likelihood, &self.scales)?;
        let error = |size: f64| {
            let prior = freed.prior(&likelihood.with_shrinkage(size));
            Some(
                likelihood.left_out(&slopes.residual, &slopes.columns, &prior)?.iter().sum::<f64>(),
            )
        };
        let tried = SIZES.iter().filter_map(|&size| Some((size, error(size)?)));
        tried.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(size, _)| size)
    }

    fn fitted(&self, likelihood: &Likelihood<'_>, hypothesis: Hypothesis) -> Option<Standing> {
        let refitted = Hypothesis::refit(
            likelihood,
            hypothesis,
            &self.scales,
            self.cost(likelihood),
            likelihood.budget.steps,
        )?;
        Standing::of(likelihood, refitted, &self.scales)
    }
}

/// Without the numbers that moved by fewer standard deviations.
fn moved(full: &Standing, least: f64) -> Option<Hypothesis> {
    let spread = full.spread()?;
    let hypothesis = &full.hypothesis;
    let stays = |e: usize, a: &Applied| {
        let place = hypothesis.free.iter().position(|at| *at == (e, 0));
        let far = |at: usize| (a.values[0] - a.parameters[0].nominal).abs() >= least * spread[at];
        !a.effect.corrects_model() || place.is_some_and(far)
    };
    let effects = hypothesis
        .effects
        .iter()
        .enumerate()
        .filter(|(e, a)| stays(*e, a))
        .map(|(_, a)| a.clone())
        .collect();
    Some(Hypothesis { effects, free: Vec::new(), gain: 0.0, fitted: false, lost: None })
}

//! Exchanges of more than one effect at a time: two for two others, several that are alike for one, a plain law for its elaborate form, an effect with the partner that the search gave it.
//!
//! How it can be wrong: each begins from what is found already, so what needs three exchanges at once is not reached; and only a few of each are tried.

use rayon::prelude::*;

use super::composer::{Composer, Composition, begun_as, in_order, newest, to_be_fitted};
use super::gate::Original;
use super::standing::Standing;
use crate::hypothesis::direction::with;
use crate::hypothesis::effects::Hypothesis;
use deadtime_model::effect::{Applied, Site};

impl Composer<'_, '_> {
    /// Any two effects replaced by what could stand in their places, where that explains more than the composition, or as much with fewer parameters.
    pub(super) fn rearranged(
        &self,
        composition: &Composition,
        original: &Original,
    ) -> Option<Composition> {
        let (likelihood, present) = self.renewed(&composition.hypothesis)?;
        let cost = self.cost(&likelihood);
        let effects: Vec<Applied> =
            present.hypothesis.effects.iter().filter(|a| !self.in_block(a)).cloned().collect();
        let others = |a: &Applied| {
            composition
                .stand_ins_of(a)
                .into_iter()
                .take(self.budget().exchanged)
                .collect::<Vec<_>>()
        };
        let pairs = effects
            .iter()
            .enumerate()
            .flat_map(|(i, a)| effects[i + 1..].iter().map(move |b| (a, b)));
        let exchanged = pairs.flat_map(|(a, b)| {
            let (for_a, for_b) = (others(a), others(b));
            let both = for_a
                .into_iter()
                .flat_map(move |x| for_b.clone().into_iter().map(move |y| (x.clone(), y)));
            both.filter(|(x, y)| x.key() != y.key())
                .map(move |(x, y)| [a.clone(), b.clone(), x, y])
                .collect::<Vec<_>>()
        });
        let known: Vec<String> = effects.iter().map(Applied::key).collect();
        let trials: Vec<[Applied; 4]> = exchanged
            .filter(|[.., x, y]| !known.contains(&x.key()) && !known.contains(&y.key()))
            .collect();
        let trial = |[a, b, x, y]: [Applied; 4]| {
            let kept = present
                .hypothesis
                .effects
                .iter()
                .filter(|e| e.key() != a.key() && e.key() != b.key())
                .cloned();
            let hypothesis = Hypothesis {
                effects: in_order(kept.chain([x, y])),
                free: Vec::new(),
                gain: 0.0,
                fitted: false,
                lost: None,
            };
            Hypothesis::refit(
                &likelihood,
                hypothesis,
                &self.scales,
                cost,
                self.budget().trial_steps,
            )
        };
        let mut fitted: Vec<Hypothesis> = trials.into_par_iter().filter_map(trial).collect();
        fitted.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        fitted.truncate(self.budget().added[1]);
        let to_the_end = |e: Hypothesis| {
            Hypothesis::refit(&likelihood, e, &self.scales, cost, likelihood.budget.steps)
        };
        let standings = fitted
            .into_par_iter()
            .filter_map(to_the_end)
            .filter_map(|e| Standing::of(&likelihood, e, &self.scales));
        let standings: Vec<Standing> = standings.collect();
        let better = |s: &&Standing| self.replaces(&present, s);
        let best =
            standings.iter().filter(better).min_by(|a, b| a.error().total_cmp(&b.error()))?;
        let known = |a: &Applied| composition.hypothesis.effects.iter().any(|e| e.key() == a.key());
        let stand_ins = best
            .hypothesis
            .effects
            .iter()
            .map(|a| if known(a) { composition.stand_ins_of(a) } else { Vec::new() })
            .collect();
        let composition =
            Composition { hypothesis: best.hypothesis.clone(), stand_ins, ..*composition };
        // What came in together may be more than is needed, or a law of many numbers.
        let earlier =
            best.hypothesis.effects.iter().filter(|a| !self.in_block(a)).cloned().collect();
        Some(self.backward(&likelihood, composition, best.clone(), earlier, original))
    }

    /// The same with a plain effect in its elaborate form (a friction that falls with speed), where that does beside the plain one what a further cause must. Taken alone
    /// the form begins far from there: here what both have in common begins as it was fitted.
    pub(super) fn elaborated(
        &self,
        composition: &Composition,
        original: &Original,
    ) -> Option<Composition> {
        let (likelihood, present) = self
            .renewed(&composition.hypothesis)
            .filter(|_| !self.likelihood.system.is_black_box())?;
        let plain = present.hypothesis.effects.iter().filter(|a| !self.in_block(a));
        let forms = plain.flat_map(|old| {
            let elaborates = |a: &&Applied| {
                a.effect.elaborates() == Some(old.effect.name()) && a.channel == old.channel
            };
            self.candidates.iter().filter(elaborates).map(move |form| (old, form))
        });
        let trials: Vec<Hypothesis> = forms
            .flat_map(|(old, form)| {
                let begun = |guess: Vec<f64>| with(form, &in_common(old, form, guess));
                let guesses = likelihood.first_guesses(form, &self.scales).into_iter().map(begun);
                guesses
                    .map(|form| to_be_fitted(&present.hypothesis, Some(form), Some(old)))
                    .collect::<Vec<_>>()
            })
            .collect();
        let fitted =
            self.most_gainful(&likelihood, &present.hypothesis, trials, self.budget().swapped[1]);
        let standings: Vec<Standing> =
            fitted.into_iter().filter_map(|e| Standing::of(&likelihood, e, &self.scales)).collect();
        let accepted =
            standings.iter().filter(|after| self.gate.accepts(&present, after, original));
        let best = accepted.min_by(|a, b| a.error().total_cmp(&b.error()))?;
        let form = newest(&present.hypothesis, &best.hypothesis)?;
        Some(composition.with(&best.hypothesis, &form, Vec::new()))
    }

    /// Effects of one number each, of one unit and kind and about as large, replaced by one, where that is as good: what makes every output late is one delay. And
    /// one law on several channels whose numbers are about as large replaced by the clocks: what makes every command later with time.
    pub(super) fn merged(&self, composition: &Composition) -> Option<Composition> {
        let effects = &composition.hypothesis.effects;
        let singly = || effects.iter().filter(|a| !self.in_block(a));
        let like = |a: &Applied| {
            singly()
                .filter(|b| {
                    b.key() == a.key() || about_as_large(a, b, self.gate.criteria.one_number)
                })
                .cloned()
                .collect::<Vec<_>>()
        };
        let mut groups: Vec<Vec<Applied>> =
            singly().map(like).filter(|group| group.len() > 1).collect();
        groups.dedup_by_key(|group| group.iter().map(Applied::key).collect::<Vec<_>>());
        let known = |a: &Applied| effects.iter().any(|e| e.key() == a.key());
        let merged = groups.iter().flat_map(|group| {
            let kept = effects.iter().filter(|e| group.iter().all(|g| g.key() != e.key()));
            let free = || self.candidates.iter().filter(|c| !known(c));
            let one = free().filter_map(|c| begun_as(&group[0], c)).map(|one| vec![one]);
            let clocks: Vec<Applied> = free()
                .filter(|c| c.effect.site() == Site::Clock)
                .filter_map(|c| begun_as_part(&group[0], c))
                .collect();
            let several = (group[0].values.len() > 1 && clocks.len() == group[0].values.len())
                .then_some(clocks);
            one.chain(several)
                .map(move |new| in_order(kept.clone().cloned().chain(new)))
                .collect::<Vec<_>>()
        });
        let trials: Vec<Hypothesis> = merged
            .map(|effects| Hypothesis {
                effects,
                ..to_be_fitted(&composition.hypothesis, None, None)
            })
            .collect();
        if trials.is_empty() {
            return None;
        }
        let (likelihood, present) = self.renewed(&composition.hypothesis)?;
        let cost = self.cost(&likelihood);
        let fit = |e: Hypothesis| {
            Standing::of(
                &likelihood,
                Hypothesis::refit(&likelihood, e, &self.scales, cost, likelihood.budget.steps)?,
                &self.scales,
            )
        };
        let standings: Vec<Standing> =
            trials.into_par_iter().filter_map(fit).filter(|s| self.as_good(&present, s)).collect();
        let best = standings.iter().min_by(|a, b| a.error().total_cmp(&b.error()))?;
        let others = standings
            .iter()
            .filter(|s| s.hypothesis.key() != best.hypothesis.key() && self.as_good(best, s));
        let instead: Vec<Applied> =
            others.filter_map(|s| newest(&present.hypothesis, &s.hypothesis)).collect();
        let stand_ins_of = |a| if known(a) { composition.stand_ins_of(a) } else { instead.clone() };
        let stand_ins = best.hypothesis.effects.iter().map(stand_ins_of).collect();
        Some(Composition { hypothesis: best.hypothesis.clone(), stand_ins, ..*composition })
    }

    /// A hypothesis with one effect more that the search fitted as a pair with one of its own, both as they were there: beside its partner an effect may be far from
    /// what it is without.
    pub(super) fn as_paired<'s>(
        &'s self,
        from: &'s Hypothesis,
    ) -> impl Iterator<Item = Hypothesis> + 's {
        let known = |a: &Applied| self.candidates.iter().any(|c| c.key() == a.key());
        let present = |a: &Applied| from.effects.iter().any(|e| e.key() == a.key());
        let apart = move |pair: &'s Hypothesis| match &pair.effects[..] {
            [a, b] if pair.fitted && present(a) && !present(b) && known(b) => Some((a, b)),
            [a, b] if pair.fitted && present(b) && !present(a) && known(a) => Some((b, a)),
            _ => None,
        };
        let joined = |(own, new): (&Applied, &Applied)| {
            let mut joined = to_be_fitted(from, Some(new.clone()), Some(own));
            joined.effects = in_order(joined.effects.into_iter().chain([own.clone()]));
            joined
        };
        self.pairs.iter().filter_map(apart).take(self.budget().pairs).map(joined)
    }
}

/// Two effects of one number each, of one unit and kind, or of one law, that are as large but for a part of the larger.
fn about_as_large(a: &Applied, b: &Applied, part: f64) -> bool {
    let law = a.effect.name() == b.effect.name() && a.key() != b.key() && a.values.len() > 1;
    let sizes = |e: &Applied| {
        e.values.iter().zip(&e.parameters).map(|(value, p)| value - p.nominal).collect::<Vec<_>>()
    };
    let alike = |(a, b): (&f64, &f64)| (a - b).abs() <= part * a.abs().max(b.abs());
    (law || begun_as(a, b).is_some()) && sizes(a).iter().zip(&sizes(b)).all(alike)
}

/// An effect of one number with that number of another which is of its unit, as far from nominal.
fn begun_as_part(other: &Applied, applied: &Applied) -> Option<Applied> {
    let [own] = &applied.parameters[..] else { return None };
    let at = other.parameters.iter().position(|p| p.unit == own.unit)?;
    let value = own.nominal + other.values[at] - other.parameters[at].nominal;
    value.is_finite().then(|| with(applied, &[value.clamp(own.lower, own.upper)]))
}

/// A guess of an elaborate form, what it has in common with the plain one as it is there.
fn in_common(plain: &Applied, form: &Applied, mut guess: Vec<f64>) -> Vec<f64> {
    for (value, p) in guess.iter_mut().zip(&form.parameters) {
        if let Some(at) = plain.parameters.iter().position(|q| q.name == p.name) {
            *value = plain.values[at].clamp(p.lower, p.upper);
        }
    }
    guess
}

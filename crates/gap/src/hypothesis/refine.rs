//! Refinements that a fit alone does not reach: minima beyond a kink, omitted limits.

use super::effects::Hypothesis;
use super::penalised_gain::Penalties;
use super::shared_time::put;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Scales};

impl Hypothesis {
    /// Tries steps of each parameter after the fit: a cost with kinks has minima that no gradient leaves.
    pub(crate) fn polished(
        self,
        likelihood: &Likelihood<'_>,
        scales: &Scales,
        nominal_cost: f64,
        iterations: usize,
    ) -> Self {
        let mut best = self;
        let cost_of =
            |e: &Self| likelihood.whitened(e).map_or(f64::INFINITY, |w| likelihood.inner(&w, &w));
        let (mut cost, mut moved) = (cost_of(&best), false);
        let before = cost;
        for at in best.free.clone() {
            let (p, value) =
                (&best.effects[at.0].parameters[at.1], best.effects[at.0].values[at.1]);
            let mut step = p.leap(value, scales);
            let (lower, upper) = p.range(scales);
            for _ in 0..likelihood.budget.polishes {
                let try_at = |value: f64| {
                    let mut there = best.clone();
                    put(&mut there.effects, at, value.clamp(lower, upper));
                    (cost_of(&there), there)
                };
                let here = best.effects[at.0].values[at.1];
                let (lowest, there) = [here + step, here - step]
                    .map(try_at)
                    .into_iter()
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .unwrap_or((f64::INFINITY, best.clone()));
                if lowest < cost {
                    (cost, best, moved) = (lowest, there, true);
                } else {
                    step *= 0.4;
                }
            }
        }
        // A negligible gain is no other minimum.
        if moved && cost < before * (1.0 - 1e-6) {
            Self::refit(likelihood, best.clone(), scales, nominal_cost, iterations).unwrap_or(best)
        } else {
            best
        }
    }

    /// A limit that was left out is tried at several places; the hypothesis with it where that explains more than chance.
    pub(crate) fn with_missing_limits(
        self,
        likelihood: &Likelihood<'_>,
        scales: &Scales,
        nominal_cost: f64,
        iterations: usize,
    ) -> Self {
        let mut best = self;
        let open: Vec<(usize, usize)> = (best.effects.iter().enumerate())
            .flat_map(|(e, a)| {
                (0..a.values.len()).filter(|&i| a.values[i].is_infinite()).map(move |i| (e, i))
            })
            .collect();
        for (e, i) in open {
            // Between the other limit and the end of the signal: all first guesses of the effect are sensible there.
            let applied = &best.effects[e];
            let starts = likelihood.first_guesses(applied, scales);
            let mut tried: Vec<(f64, Vec<Applied>)> = Vec::new();
            for place in starts.iter().filter_map(|s| s.get(i)).filter(|v| v.is_finite()) {
                let mut moved = best.effects.clone();
                moved[e].values[i] = *place;
                tried.extend(
                    likelihood
                        .whitened(ActiveEffects::from(&best).with(&moved))
                        .map(|w| (likelihood.inner(&w, &w), moved)),
                );
            }
            let Some((_, effects)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
                continue;
            };
            let from = Self { effects, ..best.clone() };
            if let Some(better) = Self::refit(likelihood, from, scales, nominal_cost, iterations)
                && better.gain > best.gain + 2.0 * Penalties::of(likelihood).parameter
            {
                best = better;
            }
        }
        best
    }
}

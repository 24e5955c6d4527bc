//! The fit of a hypothesis to the training logs: bounded Gauss-Newton steps.

use nalgebra::{DMatrix, DVector};

use super::effects::Hypothesis;
use super::shared_time::{leading, put};
use super::slopes::{Slopes, slopes};
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::fit::{LevenbergMarquardt, Normal};

impl Hypothesis {
    /// Lowers the cost from the present values by bounded Gauss-Newton steps; `None` where the start cannot be simulated.
    pub(crate) fn fit(
        likelihood: &Likelihood<'_>,
        effects: &[Applied],
        scales: &Scales,
        nominal_cost: f64,
        iterations: usize,
    ) -> Option<Self> {
        Self::refit(
            likelihood,
            Self {
                effects: effects.to_vec(),
                free: Vec::new(),
                gain: 0.0,
                fitted: false,
                lost: None,
            },
            scales,
            nominal_cost,
            iterations,
        )
    }

    /// The same fit with the given lost commands. Their probability is not part of the fit, and neither is the step of a lattice, which raw values determine.
    pub(crate) fn refit(
        likelihood: &Likelihood<'_>,
        from: Self,
        scales: &Scales,
        nominal_cost: f64,
        iterations: usize,
    ) -> Option<Self> {
        let free = from.parameters_to_fit();
        let (effects, lost) = (&from.effects, from.lost.as_ref());
        let priced = |cost: f64| nominal_cost - cost - lost.map_or(0.0, |l| l.price);
        if free.is_empty() {
            let there = likelihood.whitened(&from)?;
            let gain = priced(likelihood.inner(&there, &there));
            return Some(Self { gain, free, fitted: true, ..from });
        }
        // The search has an absolute threshold of 0.001 for small numbers. Tiny parameters, such as a coefficient in SI units, are therefore scaled to their
        // own unit.
        let unit: Vec<f64> = free.iter().map(|&(e, i)| own_unit(effects[e].values[i])).collect();
        let scaled =
            |bounds: Vec<f64>| bounds.iter().zip(&unit).map(|(b, u)| b / u).collect::<Vec<f64>>();
        let in_units =
            |values: &[f64]| values.iter().zip(&unit).map(|(v, u)| v * u).collect::<Vec<f64>>();
        let begin: Vec<f64> =
            free.iter().zip(&unit).map(|(&(e, i), u)| effects[e].values[i] / u).collect();
        let (lower, upper): (Vec<f64>, Vec<f64>) =
            free.iter().map(|&(e, i)| effects[e].range(i, scales)).unzip();
        let search = LevenbergMarquardt {
            max_iterations: iterations,
            gradient_tolerance: 1e-4,
            step_tolerance: 1e-4,
            cost_floor: 0.0,
            lower: scaled(lower),
            upper: scaled(upper),
        };
        let active = ActiveEffects::from(&from);
        let (mut lowest, mut steps) = (f64::INFINITY, vec![None; free.len()]);
        let found = search.minimise(&begin, |values| {
            let there = placed(effects, &free, &in_units(values));
            let active = active.with(&there);
            let residual = likelihood.whitened(active)?;
            let cost =
                likelihood.inner(&residual, &residual) + prior_cost(likelihood, &there, &free);
            // Without a fall of the cost the gradient is not needed.
            if cost >= lowest {
                let k = free.len();
                return Some(Normal {
                    cost,
                    gradient: DVector::zeros(k),
                    information: DMatrix::zeros(k, k),
                });
            }
            let mut normal = normal(
                likelihood,
                &slopes(likelihood, active, residual, &free, scales, &mut steps)?,
            );
            add_prior(likelihood, &there, &free, &mut normal);
            lowest = cost;
            Some(in_own_units(normal, &unit))
        });
        if found.normal.information.is_empty() {
            return None;
        }
        let fitted = placed(effects, &free, &in_units(&found.parameters));
        let cost = found.normal.cost;
        let (mut best, kept) = without_unreached(likelihood, &active, fitted, free, cost);
        for applied in &mut best {
            applied.values = applied.effect.canonical(std::mem::take(&mut applied.values));
        }
        Some(Self { effects: best, free: kept, gain: priced(cost), fitted: true, lost: from.lost })
    }

    /// The free parameters of a fit.
    pub(crate) fn parameters_to_fit(&self) -> Vec<(usize, usize)> {
        (self.effects.iter().enumerate())
            .filter(|(_, a)| {
                (self.lost.is_none() || !a.effect.loses_commands()) && !a.effect.leaves_residual()
            })
            .flat_map(|(e, a)| {
                (0..a.values.len()).filter(|&i| a.values[i].is_finite()).map(move |i| (e, i))
            })
            .filter(|at| leading(&self.effects, *at) == *at)
            .collect()
    }

    /// The gain under the likelihood's present noise, parameters as they are.
    pub(crate) fn rescore(&mut self, likelihood: &Likelihood<'_>, nominal_cost: f64) {
        if self.gain == f64::NEG_INFINITY {
            return;
        }
        let price = self.lost.as_ref().map_or(0.0, |l| l.price);
        self.gain = likelihood
            .whitened(&*self)
            .map_or(f64::NEG_INFINITY, |e| nominal_cost - likelihood.inner(&e, &e) - price);
    }

    /// A parameter is at the edge of its search range.
    pub(crate) fn at_bound(&self, (e, i): (usize, usize), scales: &Scales) -> bool {
        let (lower, upper) = self.effects[e].range(i, scales);
        let value = self.effects[e].values[i];
        value <= lower || value >= upper
    }
}

/// A limit that the training data never reach is infinite, and no longer free.
fn without_unreached(
    likelihood: &Likelihood<'_>,
    active: &ActiveEffects<'_>,
    mut best: Vec<Applied>,
    free: Vec<(usize, usize)>,
    cost: f64,
) -> (Vec<Applied>, Vec<(usize, usize)>) {
    let mut kept = free.clone();
    for &(e, i) in &free {
        if !best[e].parameters[i].nominal.is_infinite() {
            continue;
        }
        let prior = prior_cost(likelihood, &best, &free);
        let mut without = best.clone();
        without[e].values[i] = without[e].parameters[i].nominal;
        if likelihood
            .whitened(active.with(&without))
            .is_some_and(|w| (likelihood.inner(&w, &w) + prior - cost).abs() <= 1e-9 * cost)
        {
            best = without;
            kept.retain(|&at| at != (e, i));
        }
    }
    (best, kept)
}

impl Hypothesis {
    /// Per free parameter the precision of its prior, and its distance from the prior's mean; 0 where it is free.
    pub(crate) fn prior(&self, likelihood: &Likelihood<'_>) -> Vec<(f64, f64)> {
        priors(likelihood, &self.effects, &self.free)
            .map(|known| known.map_or((0.0, 0.0), |(off, std)| (std.powi(-2), off)))
            .collect()
    }
}

/// Per free parameter its distance from its prior's mean, and the prior's standard deviation.
fn priors<'p>(
    likelihood: &'p Likelihood<'_>,
    effects: &'p [Applied],
    free: &'p [(usize, usize)],
) -> impl Iterator<Item = Option<(f64, f64)>> + 'p {
    free.iter().map(|&(e, i)| {
        likelihood.prior_of(&effects[e], i).map(|(mean, std)| (effects[e].values[i] - mean, std))
    })
}

fn prior_cost(likelihood: &Likelihood<'_>, effects: &[Applied], free: &[(usize, usize)]) -> f64 {
    priors(likelihood, effects, free).flatten().map(|(off, std)| (off / std).powi(2)).sum()
}

fn add_prior(
    likelihood: &Likelihood<'_>,
    effects: &[Applied],
    free: &[(usize, usize)],
    normal: &mut Normal,
) {
    for (at, prior) in priors(likelihood, effects, free).enumerate() {
        let Some((off, std)) = prior else { continue };
        normal.cost += (off / std).powi(2);
        normal.gradient[at] += off / (std * std);
        normal.information[(at, at)] += std.powi(-2);
    }
}

fn placed(effects: &[Applied], free: &[(usize, usize)], values: &[f64]) -> Vec<Applied> {
    let mut all = effects.to_vec();
    for (at, v) in free.iter().zip(values) {
        put(&mut all, *at, *v);
    }
    all
}

/// A power of two near a tiny number; 1 for any other.
fn own_unit(value: f64) -> f64 {
    if value != 0.0 && value.abs() < 1e-6 { value.abs().log2().round().exp2() } else { 1.0 }
}

/// The same equations with parameters counted in other units.
fn in_own_units(mut normal: Normal, unit: &[f64]) -> Normal {
    for (i, u) in unit.iter().enumerate() {
        normal.gradient[i] *= u;
        for (j, v) in unit.iter().enumerate() {
            normal.information[(i, j)] *= u * v;
        }
    }
    normal
}

fn normal(likelihood: &Likelihood<'_>, slopes: &Slopes) -> Normal {
    let (e, columns) = (&slopes.residual, &slopes.columns);
    let all: Vec<&Whitened> = columns.iter().chain([e]).collect();
    let k = columns.len();
    let products = likelihood.inner_of_all(&all);
    Normal {
        cost: products[(k, k)],
        gradient: products.view((0, k), (k, 1)).column(0).into_owned(),
        information: products.view((0, 0), (k, k)).into_owned(),
    }
}

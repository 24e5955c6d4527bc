//! A weak prior at the file's values: what the responses do not fix stays there.
//!
//! z ~ N(0, τ²) of every parameter in its size; delays have none, because they start where the identified model's are. τ maximises the evidence.
//!
//! How it can be wrong: τ too small (values that are off pull all others to theirs; the smallest is 10 %), errors of the response that are alike over frequency
//! (they count as often as they are independent), and a structure that cannot follow (its misfit counts as noise).
//!
//! Source: MacKay (1992), "Bayesian interpolation", Neural Computation 4(3), 415-447, doi:10.1162/neco.1992.4.3.415; Satterthwaite (1946), "An approximate
//! distribution of estimates of variance components", Biometrics Bulletin 2(6), 110-114, doi:10.2307/3002019.

use nalgebra::{Complex, DMatrix};

use super::fit::deviations;
use super::norms::Norm;
use super::problem::{Descent, MatchProblem, normal};
use super::structure::Free;
use super::system::GainMatrix;

/// Standard deviations of the file's values, in their sizes, of which the evidence chooses one.
const SPREADS: [f64; 9] = [0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2, 5.6, 10.0];
/// Times that the size of the misfit is taken from the fit before.
const TURNS: usize = 2;
/// A posterior spread above this share of the prior's is the prior's own.
pub(super) const HELD: f64 = 0.7;

/// What holds parameters to the file's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prior {
    /// One standard deviation, in sizes.
    pub(super) spread: f64,
    /// What z² costs, in the norm's squares.
    pub(super) weight: f64,
}

/// How large the norm's square is by the identified model's own errors.
struct Errors {
    /// Expected at the truth.
    mean: f64,
    /// Independent squares that it is made of.
    freedom: f64,
}

impl Errors {
    /// Of the identified model's deviations; `None` where it has none.
    fn of(problem: &MatchProblem<'_>, norm: &Norm) -> Option<Self> {
        let target: Vec<GainMatrix> = problem.at.iter().map(|at| at.target.clone()).collect();
        let moved = deviations(problem.structure, &problem.omegas, &target)?;
        let error = |deviation: &Vec<GainMatrix>| -> Vec<Complex<f64>> {
            let parts = problem.at.iter().zip(deviation).flat_map(|(at, d)| {
                let part =
                    (norm.difference)(at, &(&at.target + d)) - (norm.difference)(at, &at.target);
                part.iter().copied().collect::<Vec<_>>()
            });
            parts.collect()
        };
        let errors: Vec<Vec<Complex<f64>>> = moved.iter().map(error).collect();
        let product =
            |i: usize, j: usize| errors[i].iter().zip(&errors[j]).map(|(a, b)| (a.conj() * b).re);
        let gram = DMatrix::from_fn(errors.len(), errors.len(), |i, j| product(i, j).sum::<f64>());
        let mean = gram.trace();
        (mean > 0.0 && mean.is_finite())
            .then(|| Self { mean, freedom: mean * mean / gram.norm_squared() })
    }
}

impl MatchProblem<'_> {
    /// Whether the prior holds each parameter.
    pub(super) fn held(&self) -> Vec<bool> {
        self.structure.free.iter().map(|free| matches!(free, Free::Parameter(_))).collect()
    }

    /// The prior of greatest evidence, or that of a given spread; `None` where nothing is known of the identified model's errors, or where the norm is no sum of
    /// squares.
    pub(super) fn prior(&self, norm: &Norm, given: Option<f64>) -> Option<Prior> {
        if norm.powers != [2.0] || given.is_some_and(f64::is_infinite) {
            return None;
        }
        let errors = Errors::of(self, norm)?;
        let spreads = given.map_or_else(|| SPREADS.to_vec(), |spread| vec![spread]);
        let (mut z, mut misfit) = (self.near(norm), 1.0);
        let mut best: Option<(f64, Prior)> = None;
        for spread in spreads {
            let mut found = None;
            for _ in 0..TURNS {
                let weight = errors.mean * misfit / (errors.freedom * spread * spread);
                let prior = Prior { spread, weight };
                let Some(end) = self.descend(norm, norm.powers, Some(prior), &z) else { break };
                z.clone_from(&end.z);
                misfit = (end.value * end.value / errors.mean).max(1.0);
                found = Some((prior, end));
            }
            let Some((prior, end)) = found else { continue };
            let evidence = self.evidence(norm, &errors, (&prior, misfit), &end);
            if evidence.is_some_and(|e| best.is_none_or(|(b, _)| e > b)) {
                best = evidence.map(|e| (e, prior));
            }
        }
        best.map(|(_, prior)| prior)
    }

    /// The logarithm of the evidence by Laplace's method, but for a constant.
    fn evidence(
        &self,
        norm: &Norm,
        errors: &Errors,
        (prior, misfit): (&Prior, f64),
        end: &Descent,
    ) -> Option<f64> {
        let held = self.held();
        let scale = errors.freedom / (errors.mean * misfit);
        let square: f64 = end.z.iter().zip(&held).filter(|(_, h)| **h).map(|(z, _)| z * z).sum();
        let mut curvature = normal(&self.parts(norm, &end.z)?, 2.0).information * scale;
        for (at, held) in held.iter().enumerate() {
            curvature[(at, at)] += if *held { prior.spread.powi(-2) } else { f64::MIN_POSITIVE };
        }
        let determinant = 2.0 * curvature.cholesky()?.l().diagonal().map(f64::ln).sum();
        let parameters = held.iter().filter(|h| **h).count() as f64;
        let likelihood = scale * end.value * end.value + errors.freedom * misfit.ln();
        let prior = square / prior.spread.powi(2) + 2.0 * parameters * prior.spread.ln();
        Some(-0.5 * (likelihood + prior + determinant))
    }

    /// The file's values, with its delays or the identified model's, whichever are nearer.
    pub(super) fn near(&self, norm: &Norm) -> Vec<f64> {
        let file = vec![0.0; self.sizes.len()];
        let delay = |at: usize| {
            let (delay_s, _) = self.structure.identified_delay_s(at)?;
            Some((delay_s - self.structure.nominal[at]) / self.sizes[at])
        };
        let late: Vec<f64> = (0..file.len()).map(|at| delay(at).unwrap_or(0.0)).collect();
        let cost = |z: &[f64]| {
            let parts = self.parts(norm, z);
            parts
                .map_or(f64::INFINITY, |p| p.iter().map(|(psi, _)| psi.norm_squared()).sum::<f64>())
        };
        if cost(&late) < cost(&file) { late } else { file }
    }
}

//! The spread of the prior, by its evidence.
//!
//! The prior is z ~ N(0, τ²) for every parameter in its size. Delays have no prior, because they start at the identified model's. τ maximises the evidence: the
//! probability density of the differences at the file's values, in independent standard deviations of the identified model. The weight minimises the expected
//! square error.
//!
//! How it can be wrong: τ too small: wrong values bias all others towards the file's (the smallest τ is 10 %). The differences are nonlinear over the prior.
//! The structure cannot follow: the misfit that no parameter explains scales the identified model's variances, but parameters absorb the remainder.
//!
//! Source: MacKay (1992), "Bayesian interpolation", Neural Computation 4(3), 415-447, doi:10.1162/neco.1992.4.3.415.

use deadtime_signal::decompositions::{svd, symmetric_eigen};
use nalgebra::{DMatrix, DVector};

use super::fit::deviations;
use super::norms::Norm;
use super::prior::Prior;
use super::problem::MatchProblem;
use super::structure::Free;
use super::system::GainMatrix;

/// Candidate standard deviations of the file's values, in their sizes.
const SPREADS: [f64; 9] = [0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2, 5.6, 10.0];
/// Number of linearisations, each about the previous fit.
const TURNS: usize = 3;
/// Directions of the identified model's errors below this share of the largest are rounding.
const SEEN: f64 = 1e-6;
/// The spread of a parameter without a prior, in sizes.
const FREE: f64 = 1e3;
/// Weights per decade of the grid, which reaches decades below and above the information.
const PER_DECADE: f64 = 4.0;
const BEYOND: f64 = 6.0;

/// Errors of the identified model, in real and imaginary parts of the differences.
struct Errors {
    /// One column per independent deviation of one standard deviation.
    columns: DMatrix<f64>,
    /// Transforms differences into independent standard deviations.
    whitens: DMatrix<f64>,
}

impl Errors {
    /// `None` where the identified model has no deviations.
    fn of(problem: &MatchProblem<'_>, norm: &Norm) -> Option<Self> {
        let target: Vec<GainMatrix> = problem.at.iter().map(|at| at.target.clone()).collect();
        let moved = deviations(problem.structure, &problem.omegas, &target)?;
        let error = |deviation: &Vec<GainMatrix>| {
            let parts = problem.at.iter().zip(deviation).map(|(at, d)| {
                (norm.difference)(at, &(&at.target + d)) - (norm.difference)(at, &at.target)
            });
            real(parts)
        };
        let columns: Vec<DVector<f64>> = moved.iter().map(error).collect();
        let all = (!columns.is_empty()).then(|| DMatrix::from_columns(&columns))?;
        let decomposed = svd(&all)?;
        let (u, values) = (decomposed.u?, decomposed.singular_values);
        let most = values.max();
        let kept: Vec<usize> = (0..values.len()).filter(|k| values[*k] > SEEN * most).collect();
        let whitens =
            DMatrix::from_fn(kept.len(), u.nrows(), |i, t| u[(t, kept[i])] / values[kept[i]]);
        (most > 0.0 && most.is_finite()).then_some(Self { columns: all, whitens })
    }
}

/// Real and imaginary parts of all entries.
fn real(parts: impl Iterator<Item = GainMatrix>) -> DVector<f64> {
    let all: Vec<f64> =
        parts.flat_map(|p| p.iter().flat_map(|v| [v.re, v.im]).collect::<Vec<_>>()).collect();
    DVector::from_vec(all)
}

/// The differences about a set of parameters, linear in z.
struct Linear {
    /// The differences at the file's values, in independent standard deviations of the identified model.
    at_file: DVector<f64>,
    /// Their slopes by z.
    slopes: DMatrix<f64>,
    /// Jᵀ J of the norm's own differences.
    information: DMatrix<f64>,
    /// Jᵀ Σ J of these, Σ the covariance of the identified model's errors.
    pulls: DMatrix<f64>,
    held: Vec<bool>,
}

impl Linear {
    fn of(problem: &MatchProblem<'_>, norm: &Norm, errors: &Errors, z: &[f64]) -> Option<Self> {
        let parts = problem.parts(norm, z)?;
        let psi = real(parts.iter().map(|(psi, _)| psi.clone()));
        let column = |k: usize| real(parts.iter().map(|(_, slopes)| slopes[k].clone()));
        let j = DMatrix::from_columns(&(0..z.len()).map(column).collect::<Vec<_>>());
        let pulled = j.tr_mul(&errors.columns);
        let slopes = &errors.whitens * &j;
        Some(Self {
            at_file: &errors.whitens * psi - &slopes * DVector::from_column_slice(z),
            slopes,
            information: j.tr_mul(&j),
            pulls: &pulled * pulled.transpose(),
            held: problem.held(),
        })
    }

    /// The factor, at least 1, on the identified model's variances with which they explain the part that no parameter explains.
    fn misfit(&self) -> Option<f64> {
        let decomposed = svd(&self.slopes)?;
        let (u, values) = (decomposed.u?, decomposed.singular_values);
        let most = values.max();
        let mut residual = self.at_file.clone();
        let mut freedom = self.at_file.len();
        for (column, value) in u.column_iter().zip(values.iter()) {
            if *value > SEEN * most {
                residual -= column * column.dot(&self.at_file);
                freedom -= 1;
            }
        }
        Some(if freedom == 0 { 1.0 } else { (residual.norm_squared() / freedom as f64).max(1.0) })
    }

    /// The logarithm of the evidence of a spread, up to a constant.
    fn evidence(&self, spread: f64, misfit: f64) -> Option<f64> {
        let mut slopes = self.slopes.clone();
        for (mut column, held) in slopes.column_iter_mut().zip(&self.held) {
            column *= if *held { spread } else { FREE };
        }
        let eigen = symmetric_eigen(&(&slopes * slopes.transpose()))?;
        let along = eigen.eigenvectors.tr_mul(&self.at_file);
        let one = |(y, by_prior): (&f64, &f64)| {
            let variance = misfit + by_prior.max(0.0);
            y * y / variance + variance.ln()
        };
        let sum = along.iter().zip(eigen.eigenvalues.iter()).map(one).sum::<f64>();
        Some(-0.5 * sum).filter(|e| e.is_finite())
    }

    /// The weight of the prior that minimises the expected square error of the held parameters. Errors come from the identified model, and from file values
    /// with this spread.
    fn weight(&self, spread: f64, misfit: f64) -> Option<f64> {
        let count = self.held.len();
        let sizes = self.information.diagonal();
        let (least, most) =
            (sizes.iter().copied().filter(|v| *v > 0.0).reduce(f64::min)?, sizes.max());
        let holds = |w: f64| DVector::from_fn(count, |k, _| if self.held[k] { w } else { 0.0 });
        let expected = |w: f64| {
            let inverse =
                (&self.information + DMatrix::from_diagonal(&holds(w))).cholesky()?.inverse();
            let moved = &self.pulls * misfit + DMatrix::from_diagonal(&holds((w * spread).powi(2)));
            let covariance = &inverse * moved * &inverse;
            let held = (0..count).filter(|k| self.held[*k]);
            Some(held.map(|k| covariance[(k, k)]).sum::<f64>()).filter(|e| e.is_finite())
        };
        let decades = (most / least).log10() + 2.0 * BEYOND;
        let steps = (decades * PER_DECADE).ceil() as usize;
        let tried = (0..=steps).map(|k| least * 10f64.powf(k as f64 / PER_DECADE - BEYOND));
        let all = tried.filter_map(|w| Some((expected(w)?, w)));
        all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, w)| w)
    }
}

impl MatchProblem<'_> {
    /// Whether the prior holds each parameter.
    pub(super) fn held(&self) -> Vec<bool> {
        self.structure.free.iter().map(|free| matches!(free, Free::Parameter(_))).collect()
    }

    /// The prior of largest evidence, or that of a given spread. `None` where the identified model's errors are unknown, or where the norm is no sum of
    /// squares.
    pub(super) fn prior(&self, norm: &Norm, given: Option<f64>) -> Option<Prior> {
        if norm.powers != [2.0] || given.is_some_and(f64::is_infinite) {
            return None;
        }
        let errors = Errors::of(self, norm)?;
        let spreads = given.map_or_else(|| SPREADS.to_vec(), |spread| vec![spread]);
        let widest = SPREADS[SPREADS.len() - 1].max(given.unwrap_or(0.0));
        let (_, z) = self.held_by(norm, &errors, widest, 1.0)?;
        let misfit = Linear::of(self, norm, &errors, &z)?.misfit()?;
        let one = |spread: f64| {
            let (prior, z) = self.held_by(norm, &errors, spread, misfit)?;
            Some((Linear::of(self, norm, &errors, &z)?.evidence(spread, misfit)?, prior))
        };
        let best = spreads.into_iter().filter_map(one).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, prior)| prior)
    }

    /// The prior of a spread, and the parameters that it gives.
    fn held_by(
        &self,
        norm: &Norm,
        errors: &Errors,
        spread: f64,
        misfit: f64,
    ) -> Option<(Prior, Vec<f64>)> {
        let mut z = self.near(norm);
        let mut weight = 0.0;
        for _ in 0..TURNS {
            weight = Linear::of(self, norm, errors, &z)?.weight(spread, misfit)?;
            z = self.descend(norm, norm.powers, Some(Prior { spread, weight }), &z)?.z;
        }
        Some((Prior { spread, weight }, z))
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

//! The search: cost, gradient and information of a power of the differences' singular values, from several starts.

use deadtime_signal::decompositions::svd;
use std::cmp::Ordering;

use nalgebra::{Complex, DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use super::norms::{At, NORMS, Norm};
use super::prior::Prior;
use super::structure::{Free, Structure};
use super::system::GainMatrix;
use deadtime_signal::fit::{LevenbergMarquardt, Normal, Stopped};
use deadtime_signal::parallel;

/// Step of the numerical differentiation, as a share of the response.
const STEP: f64 = 1e-4;
/// Factor of a start's error at one standard deviation.
const FACTOR: f64 = 3.0;
/// Values whose power is below this share of the largest one's are negligible.
const NOTHING: f64 = 1e-16;
/// A cost below this share of the identified model's own size, squared, is rounding.
const FLOOR: f64 = 1e-26;

/// Steps of a search, and the number of continuations when they run out.
const ITERATIONS: usize = 100;
const CONTINUED: usize = 20;
/// Largest number of steps of one search.
pub(super) const MOST_STEPS: usize = ITERATIONS * (1 + CONTINUED);
/// Relative difference of costs within which two minima are the same.
const SAME: f64 = 1e-6;

/// A difference below this share of the identified model's own size counts as zero, for any result of the search. At whole samples of delay a response is not
/// smooth.
const NONE: f64 = 1e-7;

/// The constants of a match.
pub(super) struct MatchProblem<'a> {
    pub(super) structure: &'a Structure<'a>,
    pub(super) omegas: Vec<f64>,
    pub(super) at: Vec<At>,
    pub(super) sizes: Vec<f64>,
}

/// The end of one search.
#[derive(Debug, Clone)]
pub(super) struct Descent {
    pub(super) z: Vec<f64>,
    /// The norm.
    pub(super) value: f64,
    /// Its square plus the prior's penalty.
    pub(super) cost: f64,
    pub(super) converged: bool,
}

/// Differences and their slopes, frequency by frequency.
pub(super) type Parts = Vec<(GainMatrix, Vec<GainMatrix>)>;

impl MatchProblem<'_> {
    pub(super) fn values(&self, z: &[f64]) -> Vec<f64> {
        self.structure.nominal.iter().zip(&self.sizes).zip(z).map(|((n, s), z)| n + s * z).collect()
    }

    pub(super) fn parts(&self, norm: &Norm, z: &[f64]) -> Option<Parts> {
        let responses = self.structure.responses(&self.values(z), &self.sizes, &self.omegas)?;
        let part = |(at, (g, slopes)): (&At, (GainMatrix, Vec<GainMatrix>))| {
            let slope = |dg: &GainMatrix| {
                let step = Complex::new(
                    STEP * (g.norm() / dg.norm().max(f64::MIN_POSITIVE)).clamp(1e-6, 1e6),
                    0.0,
                );
                ((norm.difference)(at, &(&g + dg * step))
                    - (norm.difference)(at, &(&g - dg * step)))
                    / (step + step)
            };
            ((norm.difference)(at, &g), slopes.iter().map(slope).collect())
        };
        Some(self.at.iter().zip(responses).map(part).collect())
    }

    /// The norm of the identified model itself, which is that of the difference for a structured model without response.
    fn whole(&self, norm: &Norm) -> f64 {
        self.at
            .iter()
            .map(|at| (norm.difference)(at, &(&at.target * Complex::new(0.0, 0.0))).norm_squared())
            .sum()
    }

    /// Successive searches, one for each of the norm's powers (or the last of them), each from the previous end.
    pub(super) fn descend(
        &self,
        norm: &Norm,
        powers: &[f64],
        prior: Option<Prior>,
        start: &[f64],
    ) -> Option<Descent> {
        let delays = self.structure.free.iter().zip(&self.structure.nominal).zip(&self.sizes);
        let lower = delays.map(|((free, nominal), size)| match free {
            Free::Delay(_) => -nominal / size,
            Free::Parameter(_) => f64::NEG_INFINITY,
        });
        let (lower, whole, held) = (lower.collect::<Vec<f64>>(), self.whole(norm), self.held());
        let prior_cost = |z: &[f64]| -> f64 {
            let squares = z.iter().zip(&held).filter(|(_, h)| **h).map(|(z, _)| z * z);
            prior.map_or(0.0, |p| p.weight * squares.sum::<f64>())
        };
        let mut found: Option<Descent> = None;
        for &power in powers {
            let evaluate = |z: &[f64]| {
                let mut all = normal(&self.parts(norm, z)?, power);
                if let Some(Prior { weight, .. }) = prior {
                    all.cost += prior_cost(z);
                    for at in (0..z.len()).filter(|at| held[*at]) {
                        all.gradient[at] += weight * z[at];
                        all.information[(at, at)] += weight;
                    }
                }
                Some(all)
            };
            let exact = if power == 2.0 { 1e-10 } else { 1e-7 };
            let search = LevenbergMarquardt {
                max_iterations: ITERATIONS,
                gradient_tolerance: exact,
                step_tolerance: exact,
                cost_floor: FLOOR * whole,
                lower: lower.clone(),
                ..LevenbergMarquardt::default()
            };
            let fit = search.minimise(found.as_ref().map_or(start, |f| &f.z), evaluate);
            if fit.normal.cost.is_infinite() {
                return None;
            }
            let still = fit.normal.slope(&vec![true; lower.len()]) < 1e-4;
            let none = fit.normal.cost <= NONE * NONE * whole;
            // With large powers the curvature is below rounding near the minimum: a stalled search is then at its end.
            let stalled = fit.stopped == Stopped::Stalled && (still || power > 2.0);
            let converged = none || fit.stopped.converged() || stalled;
            let cost = fit.normal.cost;
            let value = (cost - prior_cost(&fit.parameters)).max(0.0).sqrt();
            found = Some(Descent { z: fit.parameters, value, cost, converged });
        }
        found
    }

    /// The best of several starts and the number of starts with the same minimum. The first start is the file's values, the others are off by factors. Norms
    /// other than the first start at the least-squares result, which weights all frequencies equally. Among ends that differ by rounding, the one nearest the
    /// file's values is selected.
    pub(super) fn best(
        &self,
        norm: &Norm,
        priors: [Option<Prior>; 2],
        starts: usize,
    ) -> Option<(Descent, usize)> {
        let [first_prior, prior] = priors;
        let from = |k: usize| {
            let start = if k == 0 { self.near(&NORMS[0]) } else { self.start(k) };
            let first = &NORMS[0];
            let warm = if norm.name == first.name {
                None
            } else {
                self.descend(first, first.powers, first_prior, &start).map(|d| d.z)
            };
            self.descend(norm, norm.powers, prior, &warm.unwrap_or(start))
        };
        let ends: Vec<Descent> =
            parallel::map(0..starts.max(1), from).into_iter().flatten().collect();
        let lowest = ends.iter().map(|e| e.cost).fold(f64::INFINITY, f64::min);
        let floor = NONE * NONE * self.whole(norm);
        let within =
            |share: f64| ends.iter().filter(move |e| e.cost <= lowest * (1.0 + share) + floor);
        let held = self.held();
        let away = |e: &Descent| -> f64 {
            e.z.iter().zip(&held).filter(|(_, h)| **h).map(|(z, _)| z * z).sum()
        };
        let best = within(SAME)
            .min_by(|a, b| {
                (!a.converged, away(a))
                    .partial_cmp(&(!b.converged, away(b)))
                    .unwrap_or(Ordering::Equal)
            })?
            .clone();
        let alike = within(2e-3).count();
        Some((self.continued(norm, prior, best), alike))
    }

    /// A search that ran out of steps continues from its end.
    fn continued(&self, norm: &Norm, prior: Option<Prior>, mut end: Descent) -> Descent {
        let last = &norm.powers[norm.powers.len().saturating_sub(1)..];
        for _ in 0..CONTINUED {
            if end.converged {
                break;
            }
            match self.descend(norm, last, prior, &end.z) {
                Some(next) if next.cost < end.cost || next.converged => end = next,
                _ => break,
            }
        }
        end
    }

    fn start(&self, k: usize) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        random.set_stream(k as u64);
        let off = |(nominal, size): (&f64, &f64)| {
            let drawn: f64 = random.sample(StandardNormal);
            if *nominal == 0.0 { drawn } else { nominal * (FACTOR.powf(drawn) - 1.0) / size }
        };
        let start: Vec<f64> = self.structure.nominal.iter().zip(&self.sizes).map(off).collect();
        // A delay starts near the identified model's: one or two samples away the search ends at another minimum. Delays are not negative.
        let delay = |(at, z): (usize, &f64)| match self.structure.identified_delay_s(at) {
            Some((delay_s, step_s)) => {
                let drawn: f64 = random.sample(StandardNormal);
                ((delay_s + drawn * step_s.max(self.sizes[at])).abs() - self.structure.nominal[at])
                    / self.sizes[at]
            }
            None => *z,
        };
        start.iter().enumerate().map(delay).collect()
    }
}

/// F² with F = (Σ σ^p)^(1/p), half its gradient, and half its second derivative without that of the slopes.
///
/// dσ_i = Re(u_i* dΨ v_i); the other nonzero entries of U* dΨ V give the curvature of σ.
pub(super) fn normal(parts: &Parts, power: f64) -> Normal {
    if power == 2.0 {
        return squares(parts);
    }
    let decomposed: Option<Vec<_>> = parts.iter().map(|(psi, _)| svd(psi)).collect::<Option<_>>();
    let Some(decomposed) = decomposed else { return squares(parts) };
    let top = decomposed.iter().flat_map(|s| s.singular_values.iter().copied()).fold(0.0, f64::max);
    if !(top > 0.0 && top.is_finite()) {
        return squares(parts);
    }
    let sum: f64 = decomposed
        .iter()
        .flat_map(|s| s.singular_values.iter())
        .map(|s| (s / top).powf(power))
        .sum();
    let value = top * sum.powf(1.0 / power);
    let count = parts.first().map_or(0, |p| p.1.len());
    let mut information = DMatrix::zeros(count, count);
    let mut first = DVector::zeros(count);
    for ((_, slopes), svd) in parts.iter().zip(&decomposed) {
        let (Some(u), Some(vt)) = (&svd.u, &svd.v_t) else { continue };
        let shares: Vec<f64> = svd.singular_values.iter().map(|s| s / value).collect();
        let weight = |i: usize| shares[i].powf(power - 2.0);
        let largest = (0..shares.len()).map(weight).fold(0.0, f64::max);
        if largest < NOTHING {
            continue;
        }
        let turned: Vec<GainMatrix> = slopes.iter().map(|s| u.ad_mul(s) * vt.adjoint()).collect();
        for (a, m) in turned.iter().enumerate() {
            for i in 0..shares.len() {
                first[a] += shares[i] * weight(i) * m[(i, i)].re;
            }
            for (b, other) in turned.iter().enumerate().take(a + 1) {
                for i in 0..shares.len() {
                    for l in 0..shares.len() {
                        let (x, y) = (m[(i, l)], other[(i, l)]);
                        let bends = if i == l {
                            (power - 1.0) * x.re * y.re + x.im * y.im
                        } else {
                            (x.conj() * y).re
                        };
                        information[(a, b)] += weight(i).max(weight(l)) * bends;
                    }
                }
            }
        }
    }
    information.fill_upper_triangle_with_lower_triangle();
    information -= (power - 2.0) * &first * first.transpose();
    Normal { cost: value * value, gradient: first * value, information }
}

/// The same for a sum of squares.
fn squares(parts: &Parts) -> Normal {
    let count = parts.first().map_or(0, |p| p.1.len());
    let mut all = Normal {
        cost: 0.0,
        gradient: DVector::zeros(count),
        information: DMatrix::zeros(count, count),
    };
    for (psi, slopes) in parts {
        all.cost += psi.norm_squared();
        for (a, slope) in slopes.iter().enumerate() {
            all.gradient[a] += slope.dotc(psi).re;
            for (b, other) in slopes.iter().enumerate().take(a + 1) {
                all.information[(a, b)] += slope.dotc(other).re;
            }
        }
    }
    all.information.fill_upper_triangle_with_lower_triangle();
    all
}

//! Finite impulse responses with a smooth, decaying prior.

use nalgebra::{DMatrix, DVector};

use super::regression::{Record, Regression};

/// A finite impulse response under the tuned/correlated ("TC") prior: hᵢ normal with covariance c·λ^max(i, j), from its first coefficient on.
#[derive(Debug, Clone, PartialEq)]
pub struct RegularisedFir {
    /// Posterior mean of h₀ … h_taps−1.
    pub coefficients: DVector<f64>,
    /// Posterior covariance: the uncertainty of h itself under the prior. The coefficients vary less between records.
    pub covariance: DMatrix<f64>,
    /// Noise variance.
    pub variance: f64,
    /// λ, by marginal likelihood.
    pub decay: f64,
    /// c/variance, by marginal likelihood.
    pub scale: f64,
    /// Rows of the regression.
    pub rows: usize,
}

/// The regression of all taps, reduced to sums, so that a likelihood costs O(taps³) for any number of samples.
pub struct Evidence {
    taps: usize,
    rows: f64,
    /// CᵀC, where column j of C is the sum of regressors 0 … j: coefficients are running sums from their end.
    gram: DMatrix<f64>,
    /// Cᵀy.
    right: DVector<f64>,
    /// yᵀy.
    power: f64,
    /// Mean square norm of a regressor: the unit of 1/scale.
    unit: f64,
}

/// Decay and scale of the prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// λ through ln(−ln λ), free of bounds.
    decay: f64,
    /// ln(c/variance) in units of one over a regressor's norm squared.
    scale: f64,
}

impl Prior {
    fn lambda(self) -> f64 {
        (-self.decay.exp()).exp()
    }
}

/// The increments of a response as unknowns, with their columns A in the regression.
struct System {
    /// I + γAᵀA.
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    /// Aᵀy.
    right: DVector<f64>,
    /// Standard deviations of the increments, in units of √c.
    weights: DVector<f64>,
}

/// Residual variance below this share of the output's is rounding.
const ROUNDING: f64 = 1e-13;

/// Alternating rounds of the start and the prior's tuning for it.
const ROUNDS: usize = 3;

impl Evidence {
    /// `None` without rows, or where a value overflows.
    pub fn new(records: &[Record], taps: usize) -> Option<Self> {
        let triangle = Regression { na: 0, lags: taps }.factor(records);
        let r = triangle.r.view((0, 0), (taps, taps));
        let target = triangle.r.view((0, taps), (taps, 1)).column(0).into_owned();
        let mut sums = r.clone_owned();
        for j in 1..taps {
            let before = sums.column(j - 1).clone_owned();
            sums.column_mut(j).zip_apply(&before, |s, b| *s += b);
        }
        let (rows, count) = (triangle.rows as f64, taps as f64);
        let evidence = Self {
            taps,
            rows,
            gram: sums.tr_mul(&sums),
            right: sums.tr_mul(&target),
            power: target.norm_squared() + triangle.r[(taps, taps)].powi(2),
            unit: r.norm_squared() / count,
        };
        (rows > 0.0
            && evidence.unit > 0.0
            && evidence.power > 0.0
            && evidence.unit.is_finite()
            && evidence.power.is_finite())
        .then_some(evidence)
    }

    /// Standard deviations, in units of √c, of the increments h(i) − h(i + 1) of a response from `start` on. The last increment is h itself.
    fn increments(&self, start: usize, prior: Prior) -> DVector<f64> {
        let (count, lambda) = (self.taps - start, prior.lambda());
        DVector::from_fn(count, |j, _| {
            let power = (prior.decay.exp() * -(j as f64)).exp();
            (power * if j + 1 < count { 1.0 - lambda } else { 1.0 }).sqrt()
        })
    }

    /// The normal equations for the increments of a response from `start` on.
    fn system(&self, start: usize, prior: Prior) -> Option<System> {
        let weights = self.increments(start, prior);
        let gamma = prior.scale.exp() / self.unit;
        // Regressors before the start are absent from every sum.
        let (g, left) = (&self.gram, start.checked_sub(1));
        let entry = |i: usize, j: usize| {
            let (i, j) = (i + start, j + start);
            left.map_or(g[(i, j)], |l| g[(i, j)] - g[(i, l)] - g[(l, j)] + g[(l, l)])
        };
        let count = weights.len();
        let system = DMatrix::from_fn(count, count, |i, j| {
            gamma * weights[i] * weights[j] * entry(i, j) + if i == j { 1.0 } else { 0.0 }
        });
        let right = DVector::from_fn(count, |i, _| {
            weights[i] * (self.right[i + start] - left.map_or(0.0, |l| self.right[l]))
        });
        Some(System { factor: system.cholesky()?, right, weights })
    }

    /// −2·ln of the marginal likelihood of a response that begins at `start`, maximised over the noise variance.
    ///
    /// Source: Chen, Ohlsson and Ljung (2012), doi:10.1016/j.automatica.2012.05.026, section 4.
    pub fn misfit(&self, start: usize, prior: Prior) -> f64 {
        let Some(System { factor: system, right, .. }) = self.system(start, prior) else {
            return f64::INFINITY;
        };
        let gamma = prior.scale.exp() / self.unit;
        let left = self.power - gamma * right.dot(&system.solve(&right));
        let determinant: f64 = system.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        self.rows * left.max(ROUNDING * self.power).ln() + 2.0 * determinant
    }

    /// The prior of largest marginal likelihood for a response that begins at `start`; `near` is an initial value.
    pub fn tune(&self, start: usize, near: Option<Prior>) -> Prior {
        let mut best = near.unwrap_or(Prior { decay: -2.0, scale: 0.0 });
        let mut least = self.misfit(start, best);
        let offer = |prior: Prior, least: &mut f64, best: &mut Prior| {
            let value = self.misfit(start, prior);
            let better = value < *least;
            if better {
                (*least, *best) = (value, prior);
            }
            better
        };
        if near.is_none() {
            // λ from 0.37 to 0.98, and a response from far below the noise to far above it.
            for decay in [0.0, -1.0, -2.0, -3.0, -4.0] {
                for scale in (-2..=10).map(|k| 2.5 * f64::from(k)) {
                    offer(Prior { decay, scale }, &mut least, &mut best);
                }
            }
        }
        let (mut by_decay, mut by_scale) = if near.is_none() { (0.5, 1.2) } else { (0.25, 0.6) };
        while by_decay > 0.03 {
            let moves = [(by_decay, 0.0), (-by_decay, 0.0), (0.0, by_scale), (0.0, -by_scale)];
            let found = moves.into_iter().any(|(d, s)| {
                let prior = Prior {
                    decay: (best.decay + d).clamp(-7.0, 1.5),
                    scale: (best.scale + s).clamp(-15.0, 40.0),
                };
                offer(prior, &mut least, &mut best)
            });
            if !found {
                (by_decay, by_scale) = (0.5 * by_decay, 0.5 * by_scale);
            }
        }
        best
    }

    /// The misfit of a response that begins at each delay up to `longest`. The prior is tuned for the best of them, starting at `start` and `prior`.
    #[must_use]
    pub fn misfits(&self, mut start: usize, mut prior: Prior, longest: usize) -> Vec<f64> {
        let mut misfits = Vec::new();
        for _ in 0..ROUNDS {
            prior = self.tune(start, Some(prior));
            misfits = (0..=longest).map(|k| self.misfit(k, prior)).collect();
            let best =
                (0..=longest).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b])).unwrap_or(start);
            if best == start {
                break;
            }
            start = best;
        }
        misfits
    }

    /// The posterior of a response from `start` on; zero before.
    pub fn response(&self, start: usize, prior: Prior) -> Option<RegularisedFir> {
        let System { factor: system, right, weights } = self.system(start, prior)?;
        let gamma = prior.scale.exp() / self.unit;
        let increments = gamma * system.solve(&right);
        let left = self.power - right.dot(&increments);
        let variance = left.max(ROUNDING * self.power) / self.rows;
        let spread = system.inverse() * (gamma * variance);
        // h(i) = Σ of the increments from i on.
        let count = weights.len();
        let sum = DMatrix::from_fn(self.taps, count, |i, j| {
            if i >= start && j + start >= i { weights[j] } else { 0.0 }
        });
        Some(RegularisedFir {
            coefficients: &sum * increments,
            covariance: &sum * spread * sum.transpose(),
            variance,
            decay: prior.lambda(),
            scale: gamma,
            rows: self.rows as usize,
        })
    }
}

/// A response of `taps` coefficients under the TC prior, its hyperparameters by marginal likelihood; `None` where the records have no row.
///
/// Source: Chen, Ohlsson and Ljung (2012), "On the estimation of transfer functions, regularizations and Gaussian processes - revisited", Automatica 48(8), 1525-1535,
/// doi:10.1016/j.automatica.2012.05.026.
#[must_use]
pub fn fit(records: &[Record], taps: usize) -> Option<RegularisedFir> {
    if taps == 0 {
        return None;
    }
    let evidence = Evidence::new(records, taps)?;
    evidence.response(0, evidence.tune(0, None))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(samples: usize) -> Record<'static> {
        let u: Vec<f64> = (0..samples).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let y: Vec<f64> = (0..samples)
            .map(|t| {
                (2..t.min(12)).map(|i| 0.7_f64.powi(i as i32) * u[t - i]).sum::<f64>()
                    + ((t * 31 % 17) as f64 - 8.0) * 0.1
            })
            .collect();
        Record::new(u, y)
    }

    /// The likelihood of the output itself, y ~ N(0, σ²(I + γΦKΦᵀ)), from the N × N covariance matrix.
    #[test]
    fn the_reduced_likelihood_is_that_of_the_samples() {
        let (r, taps) = (record(80), 9);
        let evidence = Evidence::new(std::slice::from_ref(&r), taps).unwrap();
        let n = 80 - taps + 1;
        let phi = DMatrix::from_fn(n, taps, |t, i| r.u[t + taps - 1 - i]);
        let y = DVector::from_fn(n, |t, _| r.y[t + taps - 1]);
        for start in [0, 3] {
            let prior = Prior { decay: -1.3, scale: 2.0 };
            let gamma = prior.scale.exp() / evidence.unit;
            let kernel = DMatrix::from_fn(taps, taps, |i, j| {
                if i.min(j) < start { 0.0 } else { prior.lambda().powi((i.max(j) - start) as i32) }
            });
            let covariance = DMatrix::identity(n, n) + gamma * &phi * &kernel * phi.transpose();
            let inverse = covariance.clone().try_inverse().unwrap();
            let quadratic = (&inverse * &y).dot(&y);
            let expected = n as f64 * quadratic.ln() + covariance.determinant().ln();
            assert!(
                (evidence.misfit(start, prior) - expected).abs() < 1e-6 * expected.abs(),
                "{start}"
            );
            // The posterior in textbook form: KΦᵀ(ΦKΦᵀ + I/γ)⁻¹y, and K minus the reduction by the data.
            let gain = gamma * &kernel * phi.transpose() * inverse;
            let posterior = evidence.response(start, prior).unwrap();
            assert!((&posterior.coefficients - &gain * &y).amax() < 1e-8);
            let variance = quadratic / n as f64;
            let expected = (&kernel - gain * &phi * &kernel) * (gamma * variance);
            assert!((&posterior.covariance - &expected).amax() < 1e-8 * expected.amax());
        }
    }

    #[test]
    fn tuning_finds_a_prior_that_no_neighbour_beats() {
        let evidence = Evidence::new(&[record(300)], 20).unwrap();
        let best = evidence.tune(0, None);
        let least = evidence.misfit(0, best);
        for decay in (-20..6).map(|k| f64::from(k) * 0.25) {
            for scale in (-10..60).map(|k| f64::from(k) * 0.5) {
                assert!(
                    evidence.misfit(0, Prior { decay, scale }) > least - 0.05,
                    "{decay} {scale}"
                );
            }
        }
    }
}

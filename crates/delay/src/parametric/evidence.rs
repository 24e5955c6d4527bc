//! The evidence of each delay, averaged over the poles with their prior instead of maximised.
//!
//! Equation: p(nk) ∝ ∫ V(nk, F)^(−N/2)·p(F) dF. The loss of the best F alone overrates delays with unusual poles. A resonance that happens to resemble the
//! noise is one pole pair in thousands.

use crate::posterior::{log_sum, log_weight};
use deadtime_identify::{OeFit, OutputError, Record};

/// The shortest time constant of the prior, samples: its pole e^(−1/0.15) is 0.0013.
const SHORTEST: f64 = 0.15;
/// The longest: this share of the longest record, which leaves three time constants to settle.
const LONGEST: f64 = 0.25;
/// Probability of arbitrary poles, so that data can establish negative or undamped ones.
const ANY: f64 = 0.05;
/// Nodes along a time constant or a natural frequency.
const NODES: usize = 14;
/// Nodes along a damping ratio.
const DAMPINGS: usize = 7;
/// Pole distances below this are raised to it: the density of two poles in terms of F is singular, though integrable, where they meet.
const NEAR: f64 = 1e-3;

/// The prior of the poles. Time constants and natural frequencies are log-uniform from [`SHORTEST`] to [`LONGEST`]. Two poles are real or a complex pair with
/// equal probability; the damping ratio is uniform.
struct Prior {
    /// Logarithms of the shortest and longest time constant, samples.
    range: [f64; 2],
}

impl Prior {
    fn new(records: &[Record]) -> Self {
        let longest = records.iter().map(Record::len).max().unwrap_or(0) as f64;
        Self { range: [SHORTEST.ln(), (LONGEST * longest).max(1.0).ln()] }
    }

    fn span(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    /// Denominators distributed as the prior, and the probability of each.
    fn nodes(&self, nf: usize) -> Vec<(Vec<f64>, f64)> {
        let lags: Vec<f64> = (0..NODES)
            .map(|i| (self.range[0] + self.span() * (i as f64 + 0.5) / NODES as f64).exp())
            .collect();
        let poles: Vec<f64> = lags.iter().map(|lag| (-1.0 / lag).exp()).collect();
        if nf == 1 {
            return poles.iter().map(|p| (vec![-p], 1.0 / poles.len() as f64)).collect();
        }
        let mut real = Vec::new();
        for (i, p) in poles.iter().enumerate() {
            real.push((vec![-2.0 * p, p * p], 0.5));
            real.extend(poles[..i].iter().map(|q| (vec![-(p + q), p * q], 1.0)));
        }
        let mut complex = Vec::new();
        for lag in &lags {
            for k in 0..DAMPINGS {
                let damping = (k as f64 + 0.5) / DAMPINGS as f64;
                let (radius, angle) =
                    ((-damping / lag).exp(), (1.0 - damping * damping).sqrt() / lag);
                if angle < std::f64::consts::PI {
                    complex.push((vec![-2.0 * radius * angle.cos(), radius * radius], 1.0));
                }
            }
        }
        for nodes in [&mut real, &mut complex] {
            let total: f64 = nodes.iter().map(|n| n.1).sum();
            nodes.iter_mut().for_each(|n| n.1 *= 0.5 / total);
        }
        real.append(&mut complex);
        real
    }

    /// Its density over the coefficients of F.
    fn density(&self, f: &[f64]) -> f64 {
        let within = |log_lag: f64| self.range[0] <= log_lag && log_lag <= self.range[1];
        // Of a real pole: p = e^(−1/T), so d ln T/dp = 1/(−p·ln p).
        let of_pole = |p: f64| {
            if p > 0.0 && p < 1.0 && within(-(-p.ln()).ln()) {
                1.0 / (self.span() * -p * p.ln())
            } else {
                0.0
            }
        };
        let (shaped, stable) = match *f {
            // Stable where |f₁| < 1: a length of 2.
            [f1] => (of_pole(-f1), 2.0),
            // Stable in a triangle of area 4.
            [f1, f2] => {
                let root = 0.25 * f1 * f1 - f2;
                let density = if root >= 0.0 {
                    // Both orders of two poles; |∂F/∂(p, q)| = p − q.
                    let (p, q) = (-0.5 * f1 + root.sqrt(), -0.5 * f1 - root.sqrt());
                    of_pole(p) * of_pole(q) / (p - q).max(NEAR)
                } else {
                    // The pair is e^(−a ± iθ) with ω² = a² + θ²: ∂(ln ω, ζ)/∂(a, θ) = θ/ω³, ∂F/∂(a, θ) = 4r³·sin θ.
                    let (radius, a) = (f2.sqrt(), -0.5 * f2.ln());
                    let angle = (-0.5 * f1 / radius).clamp(-1.0, 1.0).acos();
                    let frequency = a.hypot(angle);
                    let jacobian =
                        angle / (frequency.powi(3) * 4.0 * radius.powi(3) * angle.sin().max(NEAR));
                    if within(-frequency.ln()) { 0.5 * jacobian / self.span() } else { 0.0 }
                };
                (density, 4.0)
            }
            _ => (0.0, f64::INFINITY),
        };
        (1.0 - ANY) * shaped + ANY / stable
    }
}

/// The logarithm of the evidence of every delay, up to a common constant. `None` for orders without a prior here (other than one or two poles). `independent`
/// of the `samples` are independent.
///
/// The integral is the larger of two approximations. The sum over nodes misses a likelihood narrower than their distance; Laplace's approximation around the
/// best fit misses distant mass.
/// Source: MacKay (2003), "Information Theory, Inference, and Learning Algorithms", chapter 27, for Laplace's method.
pub(super) fn log_evidence(
    orders: &OutputError,
    records: &[Record],
    fits: &[Option<OeFit>],
    floor: f64,
    samples: f64,
    independent: f64,
) -> Option<Vec<f64>> {
    if !(1..=2).contains(&orders.nf) {
        return None;
    }
    let prior = Prior::new(records);
    let (nodes, weights): (Vec<Vec<f64>>, Vec<f64>) = prior.nodes(orders.nf).into_iter().unzip();
    let losses = orders.losses(records, fits.len().saturating_sub(1), &nodes);
    let each = |(nk, fit): (usize, &Option<OeFit>)| {
        let Some(fit) = fit else { return f64::NEG_INFINITY };
        let of_node = |(at, weight): (&Vec<f64>, &f64)| {
            // No node fits better than the best fit, except by rounding.
            let loss = at.get(nk).map_or(f64::NAN, |loss| loss.max(fit.loss));
            log_weight(loss, floor, independent) + weight.ln()
        };
        let sum = log_sum(&losses.iter().zip(&weights).map(of_node).collect::<Vec<f64>>());
        // Poles that the data do not determine have the whole prior mass near the best fit, which is the upper bound.
        let covariance = orders
            .covariance(records, nk, &fit.f)
            .map(|c| c.view((orders.nb, orders.nb), (orders.nf, orders.nf)).into_owned());
        let volume = covariance.map_or(f64::INFINITY, |c| {
            (c * (2.0 * std::f64::consts::PI * samples / independent)).determinant()
        });
        let near = 0.5 * volume.max(f64::MIN_POSITIVE).ln() + prior.density(&fit.f).ln();
        sum.max(log_weight(fit.loss, floor, independent) + near.min(0.0))
    };
    Some(fits.iter().enumerate().map(each).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn prior() -> Prior {
        Prior { range: [SHORTEST.ln(), 100.0_f64.ln()] }
    }

    /// Density and nodes are one prior: over all stable F the density integrates to 1, half of it for real poles.
    #[test]
    fn the_density_is_that_of_the_nodes() {
        let steps = 3000;
        let at =
            |i: usize, from: f64, to: f64| from + (to - from) * (i as f64 + 0.5) / steps as f64;
        let one: f64 =
            (0..steps).map(|i| prior().density(&[at(i, -1.0, 1.0)]) * 2.0 / steps as f64).sum();
        assert!((one - 1.0).abs() < 0.01, "{one}");
        let (mut real, mut complex) = (0.0, 0.0);
        let cell = 4.0 * 2.0 / (steps * steps) as f64;
        for i in 0..steps {
            for j in 0..steps {
                let f = [at(i, -2.0, 2.0), at(j, -1.0, 1.0)];
                if f[1] > f[0].abs() - 1.0 {
                    let share = prior().density(&f) * cell;
                    if f[1] > 0.25 * f[0] * f[0] { complex += share } else { real += share }
                }
            }
        }
        // A third of the triangle, and so of the share for arbitrary poles, is real. Frequencies above the Nyquist one are no sampled poles: the pairs lack 3
        // %.
        assert!(
            (real - 0.5 * (1.0 - ANY) - ANY / 3.0).abs() < 0.04
                && (complex - 0.5 * (1.0 - ANY) - 2.0 * ANY / 3.0).abs() < 0.05,
            "{real} {complex}"
        );
        for nf in [1, 2] {
            let nodes = prior().nodes(nf);
            assert_abs_diff_eq!(nodes.iter().map(|n| n.1).sum::<f64>(), 1.0, epsilon = 1e-12);
            assert!(nodes.iter().all(|n| n.0.len() == nf && prior().density(&n.0) > 0.0));
        }
    }
}

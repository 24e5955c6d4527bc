//! Output-error models of few poles and many numerator coefficients, where a search over each coefficient would be slow.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::polynomial::{filter, is_stable, stabilised};
use super::regression::{Record, Regression, dot};

/// y(t) = B(q)/F(q) u(t) + e(t). The Steiglitz-McBride iteration (ARX on signals filtered by the last 1/F) precedes Levenberg-Marquardt on the simulation
/// error.
///
/// Each step of either is one regression of O(N·(nf + nb)). Records are assumed to begin at rest; the error omits their first nb − 1 samples.
///
/// Source: Steiglitz and McBride (1965), doi:10.1109/TAC.1965.1098181; Ljung (1999), "System Identification", 2nd ed., sections 9.4 and 10.2.
pub struct ManyZeros {
    /// b₀ … b_nb−1.
    pub b: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// The covariance for known F: it omits the part shared by a zero of B and a nearly cancelling pole.
    pub given_poles: DMatrix<f64>,
}

/// Steiglitz-McBride iterations, which only need to find the valley of the minimum.
const ITERATIONS: usize = 10;
/// Levenberg-Marquardt steps. Near the minimum each lowers the error by a large factor; along a pole nearly cancelled by a zero they are short.
const STEPS: usize = 100;
/// A relative change that ends either iteration.
const STILL: f64 = 1e-13;
/// Damping, as a share of the Gram matrix's diagonal, that counts as zero.
const LEAST_DAMPING: f64 = 1e-12;
/// Damping from which a step without a lower error is attributed to rounding.
const MOST_DAMPING: f64 = 1e6;

/// A model simulated on every record.
struct Simulated {
    /// u/F and the model's own output by 1/F: the regressors of the gradient.
    gradients: Vec<Record<'static>>,
    /// y − ŷ.
    residuals: Vec<Vec<f64>>,
    /// Σ e² over the rows.
    cost: f64,
}

fn by(x: &[f64], f: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    filter(x, f, &mut out);
    out
}

impl ManyZeros {
    /// `None` where a sample is missing, the rows are too few, or the input excites too little.
    pub fn fit(records: &[Record], nf: usize, nb: usize) -> Option<Self> {
        if records.iter().any(|r| r.present.is_some()) {
            return None;
        }
        let regression = Regression { na: nf, lags: nb };
        let mut f = vec![0.0; nf];
        let mut b = DVector::zeros(nb);
        for _ in 0..ITERATIONS {
            let filtered: Vec<Record> =
                records.iter().map(|r| Record::new(by(&r.u, &f), by(&r.y, &f))).collect();
            let solution = regression.factor(&filtered).solve()?;
            let next = stabilised(solution.coefficients.iter().take(nf).map(|c| -c).collect())?;
            b = solution.coefficients.rows(nf, nb).into_owned();
            let change = next.iter().zip(&f).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            f = next;
            if change <= STILL {
                break;
            }
        }
        let mut at = simulate(records, regression, &f, &b);
        let mut damping = LEAST_DAMPING;
        for _ in 0..STEPS {
            let (gram, slope) = (gram(regression, &at.gradients)?, slope(regression, &at));
            let mut trial = None;
            while trial.is_none() && damping < MOST_DAMPING {
                let there = damped(&gram, damping).map(|c| c.solve(&slope)).and_then(|step| {
                    let next_f: Vec<f64> = f.iter().zip(&step).map(|(f, s)| f - s).collect();
                    let next_b = &b + step.rows(nf, nb);
                    is_stable(&next_f)
                        .then(|| (simulate(records, regression, &next_f, &next_b), next_f, next_b))
                });
                trial = there.filter(|(there, ..)| there.cost < at.cost);
                damping = if trial.is_some() {
                    (0.1 * damping).max(LEAST_DAMPING)
                } else {
                    10.0 * damping
                };
            }
            let Some((there, next_f, next_b)) = trial else { break };
            let done = at.cost - there.cost <= STILL * at.cost && damping <= LEAST_DAMPING;
            (f, b, at) = (next_f, next_b, there);
            if done {
                break;
            }
        }
        let inverse = inverse(regression, &at.gradients)?;
        let rows: usize =
            records.iter().map(|r| r.len().saturating_sub(regression.first_row())).sum();
        let variance = at.cost / rows.saturating_sub(nf + nb).max(1) as f64;
        let covariance = inverse.view((nf, nf), (nb, nb)) * variance;
        // Past outputs come first: without them the regression is that of B alone, over a few more rows.
        let given_poles = self::inverse(Regression { na: 0, lags: nb }, &at.gradients)? * variance;
        let sound = b.iter().chain(&covariance).chain(&given_poles).all(|v| v.is_finite());
        sound.then_some(Self { b, covariance, given_poles })
    }
}

fn simulate(records: &[Record], regression: Regression, f: &[f64], b: &DVector<f64>) -> Simulated {
    let mut all = Simulated { gradients: Vec::new(), residuals: Vec::new(), cost: 0.0 };
    for record in records {
        let u = by(&record.u, f);
        let model: Vec<f64> = (0..u.len())
            .map(|t| b.iter().zip(u[..=t].iter().rev()).map(|(b, u)| b * u).sum())
            .collect();
        let residual: Vec<f64> = record.y.iter().zip(&model).map(|(y, m)| y - m).collect();
        all.cost += residual.iter().skip(regression.first_row()).map(|e| e * e).sum::<f64>();
        all.gradients.push(Record::new(u, by(&model, f)));
        all.residuals.push(residual);
    }
    all
}

/// Σ over the rows of gradient times error; the sign of F's part is that of −F's coefficients.
fn slope(regression: Regression, at: &Simulated) -> DVector<f64> {
    let first = regression.first_row();
    let mut slope = DVector::zeros(regression.columns());
    for (gradient, residual) in
        at.gradients.iter().zip(&at.residuals).filter(|(g, _)| g.len() > first)
    {
        let n = gradient.len();
        let outputs = (1..=regression.na).map(|i| &gradient.y[first - i..n - i]);
        let inputs = (0..regression.lags).map(|i| &gradient.u[first - i..n - i]);
        for (sum, column) in slope.iter_mut().zip(outputs.chain(inputs)) {
            *sum += dot(column, &residual[first..]);
        }
    }
    slope
}

/// The Gram matrix of the gradients.
fn gram(regression: Regression, gradients: &[Record]) -> Option<DMatrix<f64>> {
    let columns = regression.columns();
    regression.gram(gradients).map(|(gram, _)| gram.view((0, 0), (columns, columns)).into_owned())
}

fn damped(gram: &DMatrix<f64>, damping: f64) -> Option<Cholesky<f64, Dyn>> {
    let mut gram = gram.clone();
    gram.set_diagonal(&(gram.diagonal() * (1.0 + damping)));
    gram.cholesky()
}

/// The inverse Gram matrix of the gradients.
fn inverse(regression: Regression, gradients: &[Record]) -> Option<DMatrix<f64>> {
    match gram(regression, gradients)?.cholesky() {
        Some(factor) => Some(factor.inverse()),
        // Redundant poles give linearly dependent columns.
        None => regression.factor(gradients).solve().map(|s| s.inverse),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oe::model::{Initial, OutputError};

    fn noise(samples: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..samples).map(|_| next()).collect()
    }

    #[test]
    fn it_agrees_with_the_search_over_the_poles() {
        let u = noise(4000, 3);
        let mut y = vec![0.0; 4000];
        filter(&u, &[-1.3, 0.42], &mut y);
        let y: Vec<f64> = y.iter().zip(noise(4000, 4)).map(|(y, e)| 0.4 * y + 0.3 * e).collect();
        let records = [Record::new(u, y)];
        let fit = ManyZeros::fit(&records, 2, 1).unwrap();
        let search = OutputError { nb: 1, nf: 2, initial: Initial::Zero }
            .scan(&records, 0)
            .remove(0)
            .unwrap();
        let std = fit.covariance[(0, 0)].sqrt();
        // The search has two more rows.
        assert!((fit.b[0] - search.b[0]).abs() < 0.02 * std, "{} {} {std}", fit.b[0], search.b[0]);
        assert!((fit.b[0] - 0.4).abs() < 3.0 * std, "{} {std}", fit.b[0]);
    }
}

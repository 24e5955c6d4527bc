//! Bounded Levenberg-Marquardt on the normal equations.

use nalgebra::{DMatrix, DVector};

/// Cost, gradient and information at one point: a least-squares problem in the form of the optimiser.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Σ r².
    pub cost: f64,
    /// Jᵀr, J the Jacobian of the residuals r.
    pub gradient: DVector<f64>,
    /// JᵀJ.
    pub information: DMatrix<f64>,
}

impl Normal {
    /// From residuals and their Jacobian.
    #[must_use]
    pub fn new(residuals: &DVector<f64>, jacobian: &DMatrix<f64>) -> Self {
        Self {
            cost: residuals.norm_squared(),
            gradient: jacobian.tr_mul(residuals),
            information: jacobian.tr_mul(jacobian),
        }
    }

    /// The largest cosine between the residuals and a column of the Jacobian: 0 at a minimum in any units.
    pub fn slope(&self, free: &[bool]) -> f64 {
        let scale = self.cost.sqrt();
        (0..self.gradient.len())
            .filter(|&i| free[i] && self.information[(i, i)] > 0.0)
            .map(|i| {
                self.gradient[i].abs()
                    / (self.information[(i, i)].sqrt() * scale).max(f64::MIN_POSITIVE)
            })
            .fold(0.0, f64::max)
    }
}

/// Why the search stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// The residuals are orthogonal to the Jacobian.
    Gradient,
    /// The last step changed no parameter by more than the tolerance.
    Step,
    /// The cost fell below its floor.
    Cost,
    /// No shorter step lowers the cost although the gradient is not zero: an edge of the domain, or rounding.
    Stalled,
    /// The iterations ran out.
    Iterations,
    /// The problem cannot be evaluated at its start.
    Undefined,
}

impl Stopped {
    /// A minimum was found.
    #[must_use]
    pub fn converged(self) -> bool {
        matches!(self, Self::Gradient | Self::Step | Self::Cost)
    }
}

/// The options of the search.
///
/// Source: Marquardt (1963), J. SIAM 11(2), 431-441, doi:10.1137/0111030; damping scaled by the diagonal of JᵀJ, bounds by freezing parameters that are at a
/// bound with an outward descent direction.
#[derive(Debug, Clone, PartialEq)]
pub struct LevenbergMarquardt {
    /// Largest number of accepted steps; default 100.
    pub max_iterations: usize,
    /// Stop when the largest cosine between residuals and Jacobian is below this; default 1e-10.
    pub gradient_tolerance: f64,
    /// Stop when a step changes every parameter by less than this, relative to its size (at least 1e-3); default 1e-10.
    pub step_tolerance: f64,
    /// Stop when Σ r² is at most this; default 0.
    pub cost_floor: f64,
    /// Lower bounds, one per parameter; empty: none.
    pub lower: Vec<f64>,
    /// Upper bounds, one per parameter; empty: none.
    pub upper: Vec<f64>,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self {
            max_iterations: 100,
            gradient_tolerance: 1e-10,
            step_tolerance: 1e-10,
            cost_floor: 0.0,
            lower: Vec::new(),
            upper: Vec::new(),
        }
    }
}

/// The result of the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The best parameters.
    pub parameters: Vec<f64>,
    /// The problem at the best parameters; empty matrices if it could not be evaluated at all.
    pub normal: Normal,
    /// Why the search stopped.
    pub stopped: Stopped,
    /// Accepted steps.
    pub iterations: usize,
    /// The last relative change of a parameter.
    pub last_change: f64,
}

/// Parameters of a lower cost, and the cost there.
type Better = (Vec<f64>, Normal);

impl LevenbergMarquardt {
    /// Minimises Σ r² from `start`. `evaluate` returns `None` where the problem is not defined (an unstable predictor, for example); such steps are shortened.
    pub fn minimise(
        &self,
        start: &[f64],
        mut evaluate: impl FnMut(&[f64]) -> Option<Normal>,
    ) -> Fit {
        let mut parameters: Vec<f64> =
            start.iter().enumerate().map(|(i, &v)| self.inside(i, v)).collect();
        let mut evaluate = |p: &[f64]| {
            evaluate(p).filter(|normal| {
                normal.cost.is_finite() && normal.gradient.iter().all(|g| g.is_finite())
            })
        };
        let Some(mut normal) = evaluate(&parameters) else {
            let (gradient, information) = (DVector::zeros(0), DMatrix::zeros(0, 0));
            let normal = Normal { cost: f64::INFINITY, gradient, information };
            let (stopped, last_change) = (Stopped::Undefined, f64::NAN);
            return Fit { parameters, normal, stopped, iterations: 0, last_change };
        };
        let mut damping = 1e-4;
        let mut last_change = f64::INFINITY;
        let mut iterations = 0;
        let stopped = loop {
            let free = self.free(&parameters, &normal);
            if normal.cost <= self.cost_floor {
                break Stopped::Cost;
            }
            if normal.slope(&free) <= self.gradient_tolerance {
                break Stopped::Gradient;
            }
            if iterations >= self.max_iterations {
                break Stopped::Iterations;
            }
            let tried = self.improved(&parameters, &normal, &free, &mut damping, &mut evaluate);
            let accepted = tried.as_ref().is_some_and(|(_, better)| better.is_some());
            if let Some((change, better)) = tried {
                last_change = change;
                if let Some(better) = better {
                    (parameters, normal) = better;
                }
            }
            iterations += 1;
            // A step is short at a minimum, or because the damping holds it back before an edge.
            if last_change <= self.step_tolerance && (damping <= 1.0 || normal.slope(&free) <= 1e-6)
            {
                break Stopped::Step;
            }
            if !accepted {
                break Stopped::Stalled;
            }
        };
        Fit { parameters, normal, stopped, iterations, last_change }
    }

    fn lower(&self, i: usize) -> f64 {
        self.lower.get(i).copied().unwrap_or(f64::NEG_INFINITY)
    }

    fn upper(&self, i: usize) -> f64 {
        self.upper.get(i).copied().unwrap_or(f64::INFINITY)
    }

    fn inside(&self, i: usize, value: f64) -> f64 {
        value.max(self.lower(i)).min(self.upper(i))
    }

    /// The moving parameters: one at a bound with an outward descent direction is fixed.
    fn free(&self, parameters: &[f64], normal: &Normal) -> Vec<bool> {
        let outwards = |(i, &v): (usize, &f64)| {
            let down = -normal.gradient[i];
            v <= self.lower(i) && down < 0.0 || v >= self.upper(i) && down > 0.0
        };
        parameters.iter().enumerate().map(|at| !outwards(at)).collect()
    }

    /// The relative change of the last tried step, with its result where that is better. `None` where the damping has no step.
    fn improved(
        &self,
        parameters: &[f64],
        normal: &Normal,
        free: &[bool],
        damping: &mut f64,
        evaluate: &mut impl FnMut(&[f64]) -> Option<Normal>,
    ) -> Option<(f64, Option<Better>)> {
        while *damping < 1e12 {
            let Some(step) = damped_step(normal, free, *damping) else {
                *damping *= 10.0;
                continue;
            };
            let trial: Vec<f64> =
                parameters.iter().enumerate().map(|(i, p)| self.inside(i, p + step[i])).collect();
            let change = trial
                .iter()
                .zip(parameters)
                .map(|(t, p)| (t - p).abs() / p.abs().max(1e-3))
                .fold(0.0, f64::max);
            match evaluate(&trial).filter(|t| t.cost < normal.cost) {
                Some(better) => {
                    *damping = (*damping * 0.1).max(1e-15);
                    return Some((change, Some((trial, better))));
                }
                // The step is too short for distinguishable costs: rounding, not the gradient, decides.
                None if change <= self.step_tolerance => return Some((change, None)),
                None => *damping *= 10.0,
            }
        }
        None
    }
}

/// −(JᵀJ + λ·diag JᵀJ)⁻¹Jᵀr over the free parameters.
fn damped_step(normal: &Normal, free: &[bool], damping: f64) -> Option<DVector<f64>> {
    let index: Vec<usize> = (0..free.len()).filter(|&i| free[i]).collect();
    let k = index.len();
    let largest = normal.information.diagonal().max();
    let matrix = DMatrix::from_fn(k, k, |i, j| {
        let value = normal.information[(index[i], index[j])];
        if i == j { value + damping * value.max(1e-14 * largest) } else { value }
    });
    let right = DVector::from_fn(k, |i, _| -normal.gradient[index[i]]);
    let solution = matrix.cholesky()?.solve(&right);
    let mut step = DVector::zeros(free.len());
    for (i, &at) in index.iter().enumerate() {
        step[at] = solution[i];
    }
    step.iter().all(|v| v.is_finite()).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// Rosenbrock's valley as residuals 10(y − x²), 1 − x.
    fn rosenbrock(p: &[f64]) -> Option<Normal> {
        let r = DVector::from_vec(vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]]);
        let j = DMatrix::from_row_slice(2, 2, &[-20.0 * p[0], 10.0, -1.0, 0.0]);
        Some(Normal::new(&r, &j))
    }

    #[test]
    fn rosenbrock_is_solved_from_the_usual_start() {
        let fit = LevenbergMarquardt::default().minimise(&[-1.2, 1.0], rosenbrock);
        assert!(fit.stopped.converged(), "{fit:?}");
        assert!((fit.parameters[0] - 1.0).abs() < 1e-8 && (fit.parameters[1] - 1.0).abs() < 1e-8);
    }

    #[test]
    fn a_bound_that_acts_holds_and_the_rest_is_optimal() {
        let fit =
            LevenbergMarquardt { upper: vec![0.5, f64::INFINITY], ..LevenbergMarquardt::default() }
                .minimise(&[-1.2, 1.0], rosenbrock);
        assert!(fit.stopped.converged(), "{fit:?}");
        assert_eq!(fit.parameters[0], 0.5);
        assert_abs_diff_eq!(fit.parameters[1], 0.25, epsilon = 1e-8);
    }

    #[test]
    fn an_undefined_start_is_said_and_an_undefined_region_is_not_entered() {
        assert_eq!(
            LevenbergMarquardt::default().minimise(&[0.0, 0.0], |_| None).stopped,
            Stopped::Undefined
        );
        let fit = LevenbergMarquardt::default()
            .minimise(&[-1.2, 1.0], |p| if p[0] < 0.7 { rosenbrock(p) } else { None });
        assert!(fit.parameters[0] < 0.7);
        assert!(!fit.stopped.converged(), "{fit:?}");
    }
}

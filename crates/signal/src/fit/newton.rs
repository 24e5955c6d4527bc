//! The last digits of a minimum: Newton's method on the exact gradient.

use nalgebra::DMatrix;

use super::levenberg_marquardt::{Fit, Normal, Stopped};

/// Share of a parameter (at least of 1e-3) by which it is moved for the second derivatives.
const DIFFERENCE: f64 = 1e-5;
/// The largest slope of a flat cost.
const FLAT: f64 = 1e-13;
/// Newton steps; each one squares the error, so more would find nothing.
const STEPS: usize = 6;

/// Takes a fit to its stationary point by Newton steps, second derivatives being central differences of the gradient.
///
/// Levenberg-Marquardt with approximate second derivatives converges slowly where residuals are large (a model too small for the data). It stops on the
/// cost, which fixes a minimum only to the root of its rounding; the gradient fixes it to rounding. Returns the fit unchanged where no step helps.
/// Source: Nocedal and Wright (2006), "Numerical Optimization", 2nd ed., sections 3.3 and 8.1.
pub fn polish(fit: Fit, evaluate: impl FnMut(&[f64]) -> Option<Normal>) -> Fit {
    steps(fit, evaluate, |fit, evaluate| second_derivatives(&fit.parameters, evaluate))
}

/// The same where `information` holds half the second derivatives themselves.
pub fn polish_exact(fit: Fit, evaluate: impl FnMut(&[f64]) -> Option<Normal>) -> Fit {
    steps(fit, evaluate, |fit, _| Some(fit.normal.information.clone()))
}

fn steps<E: FnMut(&[f64]) -> Option<Normal>>(
    fit: Fit,
    mut evaluate: E,
    curvature: impl Fn(&Fit, &mut E) -> Option<DMatrix<f64>>,
) -> Fit {
    let n = fit.parameters.len();
    if fit.normal.gradient.len() != n || n == 0 {
        return fit;
    }
    let all = vec![true; n];
    let mut best = fit;
    for _ in 0..STEPS {
        let slope = best.normal.slope(&all);
        if slope <= FLAT {
            break;
        }
        let Some(curvature) = curvature(&best, &mut evaluate) else { break };
        // Not positive definite: a saddle or an edge, where Newton would climb.
        let Some(step) = curvature.cholesky().map(|c| c.solve(&best.normal.gradient)) else {
            break;
        };
        let trial: Vec<f64> = best.parameters.iter().zip(step.iter()).map(|(p, s)| p - s).collect();
        let better = evaluate(&trial)
            .filter(|t| t.cost <= best.normal.cost * (1.0 + 1e-12) && t.slope(&all) < slope);
        let Some(normal) = better else { break };
        let change = best
            .parameters
            .iter()
            .zip(step.iter())
            .map(|(p, s)| s.abs() / p.abs().max(1e-3))
            .fold(0.0, f64::max);
        let stopped = if normal.slope(&all) <= 1e-9 { Stopped::Gradient } else { best.stopped };
        best = Fit {
            parameters: trial,
            normal,
            stopped,
            iterations: best.iterations + 1,
            last_change: change,
        };
    }
    best
}

/// Half the second derivatives of the cost, as the gradient is half its first; symmetric.
fn second_derivatives(
    at: &[f64],
    evaluate: &mut impl FnMut(&[f64]) -> Option<Normal>,
) -> Option<DMatrix<f64>> {
    let n = at.len();
    let mut curvature = DMatrix::zeros(n, n);
    let mut shifted = at.to_vec();
    for i in 0..n {
        let h = DIFFERENCE * at[i].abs().max(1e-3);
        shifted[i] = at[i] + h;
        let up = evaluate(&shifted)?.gradient;
        shifted[i] = at[i] - h;
        let down = evaluate(&shifted)?.gradient;
        shifted[i] = at[i];
        curvature.set_column(i, &((up - down) / (2.0 * h)));
    }
    Some((&curvature + curvature.transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::fit::levenberg_marquardt::LevenbergMarquardt;

    /// A straight exponential through data that is none: large residuals at the minimum.
    fn misfit(p: &[f64]) -> Option<Normal> {
        let data = [1.0, -2.0, 3.0, -1.0, 2.5];
        let r = DVector::from_fn(5, |i, _| data[i] - (p[0] * i as f64).exp() * 0.5 - p[1]);
        let j = DMatrix::from_fn(5, 2, |i, k| {
            if k == 0 { -(i as f64) * (p[0] * i as f64).exp() * 0.5 } else { -1.0 }
        });
        Some(Normal::new(&r, &j))
    }

    #[test]
    fn polishing_takes_a_loose_fit_to_the_stationary_point() {
        let loose = LevenbergMarquardt { max_iterations: 3, ..LevenbergMarquardt::default() }
            .minimise(&[0.1, 0.0], misfit);
        let polished = polish(loose.clone(), misfit);
        assert!(polished.stopped.converged(), "{polished:?}");
        assert!(polished.normal.cost <= loose.normal.cost * (1.0 + 1e-12));
        assert!(polished.normal.gradient.amax() < 1e-12, "{polished:?}");
    }

    #[test]
    fn a_point_where_the_problem_is_undefined_nearby_is_left_as_it_is() {
        let fit = LevenbergMarquardt { max_iterations: 1, ..LevenbergMarquardt::default() }
            .minimise(&[0.1, 0.0], misfit);
        assert_eq!(polish(fit.clone(), |_| None), fit);
    }
}

//! Newton steps on a Riccati equation, which remove the residual of rounding.

use nalgebra::DMatrix;

use super::regulator::symmetric;

/// The equation around a solution X with its gain K.
pub(super) struct Newton<G, R, C> {
    /// The gain of a solution.
    pub(super) gain: G,
    /// The residual of a solution with its gain.
    pub(super) residual: R,
    /// The change of X for a residual, by the closed loop of a gain; `None` ends the steps.
    pub(super) correction: C,
    /// Largest number of steps.
    pub(super) steps: usize,
    /// Number of first steps that are accepted with any residual; each later one must halve it.
    pub(super) free: usize,
    /// The residual relative to X at which the steps end.
    pub(super) settled: f64,
}

/// A solution with its gain and its residual.
pub(super) struct Refined {
    pub(super) x: DMatrix<f64>,
    pub(super) k: DMatrix<f64>,
    pub(super) error: DMatrix<f64>,
}

impl<G, R, C> Newton<G, R, C>
where
    G: Fn(&DMatrix<f64>) -> Option<DMatrix<f64>>,
    R: Fn(&DMatrix<f64>, &DMatrix<f64>) -> DMatrix<f64>,
    C: Fn(&DMatrix<f64>, &DMatrix<f64>) -> Option<DMatrix<f64>>,
{
    /// The solution near `x`, symmetric to the last bit; `None` where an intermediate one has no gain.
    pub(super) fn refine(&self, x: DMatrix<f64>) -> Option<Refined> {
        let x = symmetric(x);
        let k = (self.gain)(&x)?;
        let error = (self.residual)(&x, &k);
        let mut now = Refined { x, k, error };
        for round in 0..self.steps {
            if now.error.norm() <= self.settled * now.x.norm() {
                break;
            }
            let Some(step) = (self.correction)(&now.k, &now.error) else { break };
            let x = symmetric(&now.x + step);
            let k = (self.gain)(&x)?;
            let error = (self.residual)(&x, &k);
            let helps = error.norm() < 0.5 * now.error.norm();
            if round >= self.free && !helps {
                break;
            }
            now = Refined { x, k, error };
        }
        Some(now)
    }
}

//! Output-error models by their options and their fits.

use super::model::{OeFit, OutputError};
use super::problem::OeProblem;
use crate::regression::Record;
use deadtime_signal::fit::{LevenbergMarquardt, Stopped};
use nalgebra::DMatrix;

impl OutputError {
    /// The residuals e of a fitted model, record after record (0 where the output is missing).
    #[must_use]
    pub fn residuals(&self, records: &[Record], nk: usize, f: &[f64]) -> Option<Vec<f64>> {
        let mut problem = OeProblem::new(*self, records);
        problem.nk = nk;
        problem.cost(f)?;
        Some(problem.records.into_iter().flat_map(|w| w.residual).collect())
    }

    /// The covariance of b₀ … b_nb−1, f₁ … f_nf of a fitted model, for white residuals. For coloured ones, multiply by the samples per independent sample.
    ///
    /// An estimated initial state is eliminated. `None` where the parameters are indistinguishable.
    /// Source: Ljung (1999), "System Identification", 2nd ed., section 9.4.
    #[must_use]
    pub fn covariance(&self, records: &[Record], nk: usize, f: &[f64]) -> Option<DMatrix<f64>> {
        let mut problem = OeProblem::new(*self, records);
        problem.nk = nk;
        let (information, cost) = problem.information(f)?;
        let freedom = count(records) - information.nrows() as f64;
        if freedom < 1.0 {
            return None;
        }
        // Columns of unit length make the factor independent of units.
        let scale = information.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
        let unit = DMatrix::from_diagonal(&scale) * information * DMatrix::from_diagonal(&scale);
        let inverse = unit.cholesky()?.inverse();
        let all = DMatrix::from_diagonal(&scale)
            * inverse
            * DMatrix::from_diagonal(&scale)
            * (cost / freedom);
        let starts = all.nrows() - self.nb - self.nf;
        let of: Vec<usize> =
            (0..self.nb).chain(self.nb + starts..self.nb + starts + self.nf).collect();
        Some(DMatrix::from_fn(of.len(), of.len(), |i, j| all[(of[i], of[j])]))
    }

    /// The model of delay `nk` at the minimum downhill from the denominator `start`.
    #[must_use]
    pub fn refine(&self, records: &[Record], nk: usize, start: &[f64]) -> Option<OeFit> {
        let mut problem = OeProblem::new(*self, records);
        problem.nk = nk;
        let search = LevenbergMarquardt {
            cost_floor: 1e-28 * problem.power,
            ..LevenbergMarquardt::default()
        };
        let fit = search.minimise(start, |f| problem.evaluate(f, f64::INFINITY));
        if fit.stopped == Stopped::Undefined {
            return None;
        }
        problem.cost(&fit.parameters)?;
        let b = problem.linear.iter().take(self.nb).copied().collect();
        Some(OeFit {
            loss: fit.normal.cost / count(records),
            b,
            f: fit.parameters,
            stopped: fit.stopped,
        })
    }
}

/// Mean square of the measured output samples.
pub fn power(records: &[Record]) -> f64 {
    let measured = |r: &Record| {
        r.y.iter()
            .enumerate()
            .filter(|(t, _)| r.present.as_ref().is_none_or(|p| p[*t]))
            .map(|(_, y)| y * y)
            .sum::<f64>()
    };
    records.iter().map(measured).sum::<f64>() / count(records).max(1.0)
}

/// Measured output samples.
pub(super) fn count(records: &[Record]) -> f64 {
    let samples: usize = records
        .iter()
        .map(|r| r.present.as_ref().map_or(r.len(), |p| p.iter().filter(|&&p| p).count()))
        .sum();

    samples as f64
}

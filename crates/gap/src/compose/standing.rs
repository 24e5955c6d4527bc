//! How good a hypothesis is under one set of weights: on what it was fitted to, on blocks left out in turn, on held-out data.

use nalgebra::DMatrix;

use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::slopes::information;
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use deadtime_model::effect::Scales;

/// A hypothesis and how good it is.
#[derive(Clone)]
pub(super) struct Standing {
    pub(super) hypothesis: Hypothesis,
    pub(super) residuals: Vec<DMatrix<f64>>,
    /// Squared errors of blocks of time that were left out in turn.
    pub(super) blocks: Vec<f64>,
    pub(super) train: Errors,
    pub(super) held: Errors,
    /// The information matrix of the free parameters, their prior's included.
    information: DMatrix<f64>,
}

impl Standing {
    /// `None` where the hypothesis cannot be simulated.
    pub(super) fn of(
        likelihood: &Likelihood<'_>,
        hypothesis: Hypothesis,
        scales: &Scales,
    ) -> Option<Self> {
        let residuals = residuals(likelihood, &hypothesis)?;
        let slopes = hypothesis.slopes(likelihood, scales)?;
        let blocks = likelihood.left_out(
            &slopes.residual,
            &slopes.columns,
            &hypothesis.prior(likelihood),
        )?;
        let train = Errors::of(likelihood.records, &residuals, |r| r.train);
        let held = Errors::of(likelihood.records, &residuals, |r| r.held);
        let information = information(likelihood, &slopes.columns, &hypothesis.prior(likelihood));
        Some(Self { hypothesis, residuals, blocks, train, held, information })
    }

    /// With errors that are given, and so many free numbers.
    #[cfg(test)]
    pub(super) fn judged(blocks: Vec<f64>, train: Errors, held: Errors, numbers: usize) -> Self {
        let hypothesis = Hypothesis {
            effects: Vec::new(),
            free: vec![(0, 0); numbers],
            gain: 0.0,
            fitted: true,
            lost: None,
        };
        Self {
            hypothesis,
            residuals: Vec::new(),
            blocks,
            train,
            held,
            information: DMatrix::zeros(numbers, numbers),
        }
    }

    /// The squared error over all blocks.
    pub(super) fn error(&self) -> f64 {
        self.blocks.iter().sum()
    }

    /// Standard deviations of the free parameters; `None` where the data and the prior leave one open.
    pub(super) fn spread(&self) -> Option<Vec<f64>> {
        let covariance = self.information.clone().cholesky()?.inverse();
        Some(covariance.diagonal().iter().map(|v| v.sqrt()).collect())
    }

    /// The log of the determinant of the information matrix.
    pub(super) fn log_information(&self) -> Option<f64> {
        Some(
            2.0 * self
                .information
                .clone()
                .cholesky()?
                .l()
                .diagonal()
                .iter()
                .map(|d| d.ln())
                .sum::<f64>(),
        )
    }

    /// By how much this is better than another, block by block: Student's t of the mean difference.
    pub(super) fn better_by_t(&self, than: &Self) -> f64 {
        t_of(
            &than
                .blocks
                .iter()
                .zip(&self.blocks)
                .map(|(theirs, own)| theirs - own)
                .collect::<Vec<_>>(),
        )
    }
}

/// Student's t of a mean of 0; 0 where nothing differs.
pub(super) fn t_of(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 2.0 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let error = (variance / n).sqrt();
    if mean == 0.0 { 0.0 } else { mean / error.max(f64::MIN_POSITIVE) }
}

#[cfg(test)]
mod tests {
    use super::t_of;

    #[test]
    fn t_is_the_mean_over_its_standard_error() {
        // Mean 2, standard deviation 1, three values.
        assert!((t_of(&[1.0, 2.0, 3.0]) - 2.0 * 3.0_f64.sqrt()).abs() < 1e-12);
        assert!(t_of(&[0.0, 0.0, 0.0]).abs() < f64::EPSILON);
        assert!(t_of(&[1.0]).abs() < f64::EPSILON);
        assert!(t_of(&[-1.0, -1.0, -1.0]) < -1e10);
    }
}

//! Whether a constant is another in every log, from its values log by log.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// The probability under chance alone below which a result is significant; 1.
const BY_CHANCE: f64 = 0.01;
/// Two values differ from this many standard deviations on.
pub(super) const APART: f64 = 3.0;

/// The one value that would do for all logs, and how far theirs are from it.
pub(super) struct Common {
    pub(super) value: f64,
    pub(super) std: f64,
    /// Σ of squared distances from it, in standard deviations; χ² with one degree of freedom less than logs, where it is one value.
    statistic: f64,
    freedom: f64,
}

impl Common {
    /// `None` of fewer than two logs, or where the covariance has no inverse.
    pub(super) fn of(values: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<Self> {
        if values.len() < 2 {
            return None;
        }
        let precision = covariance.clone().cholesky()?.inverse();
        let weight = precision.column_sum();
        let value = weight.dot(values) / weight.sum();
        let off = values.add_scalar(-value);
        let statistic = off.dot(&(&precision * &off));
        let freedom = (values.len() - 1) as f64;
        (value.is_finite() && statistic.is_finite()).then(|| Self {
            value,
            std: weight.sum().recip().sqrt(),
            statistic,
            freedom,
        })
    }

    /// The logs differ by more than chance.
    pub(super) fn differs(&self) -> bool {
        ChiSquared::new(self.freedom).is_ok_and(|law| law.sf(self.statistic) < BY_CHANCE)
    }

    /// The values are closer to each other than chance allows for independent values of standard deviation `own`, in units of each estimate's standard deviation.
    pub(super) fn alike(&self, own: f64) -> bool {
        !self.differs()
            && ChiSquared::new(self.freedom)
                .is_ok_and(|law| law.cdf(self.statistic / (1.0 + own * own)) < BY_CHANCE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_differ_are_alike_or_neither() {
        let common = |values: &[f64], std: f64| {
            let covariance = DMatrix::from_diagonal_element(values.len(), values.len(), std * std);
            Common::of(&DVector::from_row_slice(values), &covariance).unwrap()
        };
        let apart = common(&[1.0, 2.0], 0.1);
        // (0.5/0.1)² twice, with one degree of freedom.
        assert!(
            (apart.value - 1.5).abs() < 1e-12
                && (apart.statistic - 50.0).abs() < 1e-9
                && apart.differs()
                && !apart.alike(20.0)
        );
        let near = common(&[1.0, 1.1], 0.1);
        assert!((near.std - 0.1 / 2.0_f64.sqrt()).abs() < 1e-12 && !near.differs());
        // Values drawn with the standard deviation of an estimate give no finding; with a wide spread they would not be so near.
        assert!(!near.alike(1.0) && near.alike(100.0));
        assert!(
            Common::of(&DVector::from_element(1, 1.0), &DMatrix::from_element(1, 1, 1.0)).is_none()
        );
    }
}

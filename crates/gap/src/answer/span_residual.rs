//! The residual of a span without the responses to its initial state.

use nalgebra::{DMatrix, DVector};

/// The residual of one span of a log, with the responses to the span's initial state projected out; every output in units of its spread.
pub(super) struct Part {
    pub(super) record: usize,
    pub(super) held: bool,
    /// Kept sample and output.
    pub(super) rows: Vec<(usize, usize)>,
    pub(super) left: DVector<f64>,
    /// Orthonormal responses to the start.
    pub(super) starts: Vec<DVector<f64>>,
}

impl Part {
    /// A response at these rows, turned round by so many kept samples.
    pub(super) fn product(&self, response: &DMatrix<f64>, weights: &[f64], turn: usize) -> f64 {
        let n = response.nrows();
        self.rows
            .iter()
            .zip(self.left.iter())
            .map(|(&(k, o), left)| response[((k + turn) % n, o)] * weights[o] * left)
            .sum()
    }

    /// Responses with the directions of the initial state projected out, one column each.
    pub(super) fn without_starts(
        &self,
        responses: &[DMatrix<f64>],
        weights: &[f64],
    ) -> DMatrix<f64> {
        let mut all = DMatrix::from_fn(self.rows.len(), responses.len(), |r, c| {
            let (k, o) = self.rows[r];
            responses[c][(k, o)] * weights[o]
        });
        for start in &self.starts {
            let along = all.tr_mul(start);
            all.ger(-1.0, start, &along, 1.0);
        }
        all
    }

    /// The squared norm of a response with the directions of the initial state projected out.
    pub(super) fn square(&self, response: &DMatrix<f64>, weights: &[f64]) -> f64 {
        let values = DVector::from_iterator(
            self.rows.len(),
            self.rows.iter().map(|&(k, o)| response[(k, o)] * weights[o]),
        );
        values.norm_squared() - self.starts.iter().map(|q| q.dot(&values).powi(2)).sum::<f64>()
    }
}

//! Inner products of columns by output: least squares under any weights of the outputs, without the samples.

use nalgebra::{DMatrix, DVector};

use super::training::{Stacked, Training};

/// Inner products of columns, the residual last, and of the nuisances' responses, by log and output.
#[derive(Clone)]
pub(super) struct Gram {
    logs: Vec<LogGram>,
}

#[derive(Clone)]
struct LogGram {
    precision: DMatrix<f64>,
    outputs: Vec<OutputGram>,
}

#[derive(Clone)]
struct OutputGram {
    /// NᵀN of the nuisances.
    nuisances: DMatrix<f64>,
    /// NᵀM.
    mixed: DMatrix<f64>,
    /// MᵀM of the columns.
    columns: DMatrix<f64>,
}

/// Normal equations with the nuisances eliminated, and the terms that restore the nuisances.
pub(super) struct Eliminated {
    /// Over all columns.
    pub(super) normal: DMatrix<f64>,
    /// Per log: (P⁻¹ + NᵀWN)⁻¹NᵀWM.
    nuisances: Vec<DMatrix<f64>>,
}

/// The residual after a combination of the columns.
pub(super) struct Left {
    /// Per output, the sum of squares.
    pub(super) squares: Vec<f64>,
    /// The cost of the nuisances under their prior.
    pub(super) prior: f64,
}

impl Gram {
    /// Of columns.
    pub(super) fn of(training: &Training<'_, '_>, columns: &[&Stacked]) -> Self {
        let logs = training.logs.iter().enumerate().map(|(at, log)| {
            let outputs = log.outputs().map(|rows| {
                let n = log.nuisances.rows_range(rows.clone());
                let part = |c: &&Stacked| c[at].rows_range(rows.clone()).into_owned();
                let m = match columns {
                    [] => DMatrix::zeros(rows.len(), 0),
                    _ => DMatrix::from_columns(&columns.iter().map(part).collect::<Vec<_>>()),
                };
                OutputGram { nuisances: n.tr_mul(&n), mixed: n.tr_mul(&m), columns: m.tr_mul(&m) }
            });
            LogGram { precision: log.precision.clone(), outputs: outputs.collect() }
        });
        Self { logs: logs.collect() }
    }

    /// With one column more in front of the residual; `columns`: those that it has.
    pub(super) fn with(
        &self,
        training: &Training<'_, '_>,
        columns: &[&Stacked],
        more: &Stacked,
    ) -> Self {
        let mut gram = self.clone();
        let place = columns.len().saturating_sub(1);
        for (at, (log, of)) in training.logs.iter().zip(&mut gram.logs).enumerate() {
            for (rows, of) in log.outputs().zip(&mut of.outputs) {
                let v = more[at].rows_range(rows.clone());
                let n = log.nuisances.rows_range(rows.clone()).tr_mul(&v);
                of.mixed = of.mixed.clone().insert_column(place, 0.0);
                of.mixed.set_column(place, &n);
                of.columns = of.columns.clone().insert_column(place, 0.0).insert_row(place, 0.0);
                for (i, column) in columns.iter().enumerate() {
                    let product = column[at].rows_range(rows.clone()).dot(&v);
                    let i = if i < place { i } else { i + 1 };
                    of.columns[(i, place)] = product;
                    of.columns[(place, i)] = product;
                }
                of.columns[(place, place)] = v.norm_squared();
            }
        }
        gram
    }

    /// Under weights of the outputs; `None` where the nuisances cannot be eliminated.
    pub(super) fn eliminated(&self, weights: &[f64]) -> Option<Eliminated> {
        let size = self.logs.first()?.outputs.first()?.columns.nrows();
        let mut normal = DMatrix::zeros(size, size);
        let mut nuisances = Vec::with_capacity(self.logs.len());
        for log in &self.logs {
            let mut a = log.precision.clone();
            let mut b = DMatrix::zeros(a.nrows(), size);
            for (output, w) in log.outputs.iter().zip(weights) {
                a += &output.nuisances * *w;
                b += &output.mixed * *w;
                normal += &output.columns * *w;
            }
            let solved = if a.nrows() == 0 { b.clone() } else { a.cholesky()?.solve(&b) };
            normal -= b.tr_mul(&solved);
            nuisances.push(solved);
        }
        Some(Eliminated { normal, nuisances })
    }

    /// The residual less `steps` along the columns, with the best-fitting nuisances.
    pub(super) fn left(&self, eliminated: &Eliminated, steps: &DVector<f64>) -> Left {
        let x = steps.map(|v| -v).push(1.0);
        let outputs = self.logs.first().map_or(0, |log| log.outputs.len());
        let mut left = Left { squares: vec![0.0; outputs], prior: 0.0 };
        for (log, solved) in self.logs.iter().zip(&eliminated.nuisances) {
            let delta = solved * &x;
            left.prior += delta.dot(&(&log.precision * &delta));
            for (sum, output) in left.squares.iter_mut().zip(&log.outputs) {
                let square = x.dot(&(&output.columns * &x))
                    - 2.0 * delta.dot(&(&output.mixed * &x))
                    + delta.dot(&(&output.nuisances * &delta));
                *sum += square.max(0.0);
            }
        }
        left
    }
}

impl Eliminated {
    /// A residual alone, less the nuisances that fit it best.
    pub(super) fn remainder(&self, training: &Training<'_, '_>, residual: &Stacked) -> Stacked {
        let logs = training.logs.iter().zip(residual).zip(&self.nuisances);
        logs.map(|((log, r), solved)| r - &log.nuisances * solved.column(solved.ncols() - 1))
            .collect()
    }
}

//! PBSIDopt: subspace identification from a long predictor; for stable and unstable plants, in open and closed loop.

use faer::Mat;
use nalgebra::DMatrix;

use super::innovations::Direct;
use super::recordings::{Factor, Layout, Recordings, Scales};

/// The long predictor: y(t) = Σ over lags of θ z(t−lag) (+ D u(t)) + c + e, by least squares; scaled channels.
#[derive(Debug, Clone)]
pub(super) struct Predictor {
    /// (columns of the past, and of u(t) with a direct path) × l.
    pub(super) theta: DMatrix<f64>,
    /// Lower triangular square root of the innovations' covariance, l × l.
    pub(super) noise: DMatrix<f64>,
    /// Columns that the regression used.
    kept: Vec<usize>,
    /// Their triangular factor.
    upper: DMatrix<f64>,
}

impl Predictor {
    /// The covariance is diagonal where the innovations of one output, but not of another, are rounding.
    pub(super) fn fit(factor: &Factor, direct: Direct) -> Self {
        let layout = factor.layout;
        let columns = layout.window() + if direct == Direct::Free { layout.m } else { 0 };
        let y = factor.y();
        let kept = factor.independent(columns);
        // The factor of the kept columns, and the outputs.
        let (upper, top) = if kept.len() == columns {
            (
                factor.r.view((0, 0), (columns, columns)).into_owned(),
                y.rows(0, columns).into_owned(),
            )
        } else {
            let chosen = factor.r.select_columns(&kept);
            let both = Mat::from_fn(chosen.nrows(), kept.len() + layout.l, |i, j| {
                if j < kept.len() { chosen[(i, j)] } else { y[(i, j - kept.len())] }
            });
            let qr = both.qr();
            let r = qr.R();
            let k = kept.len();
            let part = |from: usize, n: usize| {
                DMatrix::from_fn(k, n, |i, j| if i <= j + from { r[(i, j + from)] } else { 0.0 })
            };
            (part(0, k), part(k, layout.l))
        };
        let solved = upper
            .solve_upper_triangular(&top)
            .unwrap_or_else(|| DMatrix::zeros(kept.len(), layout.l));
        let mut theta = DMatrix::zeros(columns, layout.l);
        for (row, &column) in kept.iter().enumerate() {
            theta.set_row(column, &solved.row(row));
        }
        let rest = &y - factor.r.columns(0, columns) * &theta;
        let freedom = factor.rows.saturating_sub(kept.len() + 1).max(1) as f64;
        let covariance = rest.transpose() * rest / freedom;
        Self { theta, noise: root(&covariance), kept, upper }
    }

    /// A change of θ drawn from the noise: covariance Σe ⊗ (ZZᵀ)⁻¹; `normal` is kept columns × l of standard normal values.
    pub(super) fn change(&self, normal: &DMatrix<f64>) -> DMatrix<f64> {
        let coloured = normal * self.noise.transpose();
        let solved = self
            .upper
            .solve_upper_triangular(&coloured)
            .unwrap_or_else(|| DMatrix::zeros(coloured.nrows(), coloured.ncols()));
        let mut change = DMatrix::zeros(self.theta.nrows(), self.theta.ncols());
        for (row, &column) in self.kept.iter().enumerate() {
            change.set_row(column, &solved.row(row));
        }
        change
    }

    /// The number of lags of each input with a coefficient more certain than the outputs' standard deviation over the input's; the others are noise.
    pub(super) fn determined(&self, layout: Layout) -> Vec<usize> {
        let noise = self.noise.diagonal().amax();
        let known = |column: usize| {
            let at = self.kept.binary_search(&column).ok();
            at.is_some_and(|k| noise < self.upper[(k, k)].abs())
        };
        let of = |j: usize| (0..layout.past).filter(|lag| known(lag * layout.width() + j)).count();
        (0..layout.m).map(of).collect()
    }

    /// Free coefficients of each output, without the constant.
    pub(super) fn parameters(&self) -> usize {
        self.kept.len()
    }
}

/// A lower triangular L with L·Lᵀ the covariance; for a singular one, the root of the diagonal with a floor.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let floor = covariance.diagonal().max().max(1e-24) * 1e-12;
    let raised = covariance + DMatrix::identity(covariance.nrows(), covariance.nrows()) * floor;
    raised.clone().cholesky().map_or_else(
        || DMatrix::from_diagonal(&raised.diagonal().map(|v| v.max(floor).sqrt())),
        |c| c.l(),
    )
}

/// Row block i: the prediction of y(t+i) from the past of t, without the samples in between: C(A − KC)^(i+lag−1)[B K] on z(t−lag).
///
/// `theta` by columns of the past × l; `horizon`·l × columns of the past.
pub(super) fn predictions(theta: &DMatrix<f64>, factor: &Factor, horizon: usize) -> DMatrix<f64> {
    let (layout, l) = (factor.layout, factor.layout.l);
    let width = layout.width();
    DMatrix::from_fn(horizon * l, layout.window(), |row, column| {
        let (ahead, output) = (row / l, row % l);
        let from = column + ahead * width;
        if from < layout.window() { theta[(from, output)] } else { 0.0 }
    })
}

/// The predictions of a horizon as long as the past, and the triangular factor of the past.
pub(super) fn predicted(predictor: &Predictor, factor: &Factor) -> (DMatrix<f64>, DMatrix<f64>) {
    let window = factor.layout.window();
    let right = factor.r.view((0, 0), (window, window)).into_owned();
    (predictions(&predictor.theta, factor, factor.layout.past), right)
}

/// The transformation to the states, T = S^(−1/2) Uᵀ W P; its first n rows give the states of a model of order n.
#[derive(Debug, Clone)]
pub(super) struct States {
    /// Singular values of the weighted predictions over the square root of the rows, largest first.
    pub(super) singular: Vec<f64>,
    /// S^(−1/2) Uᵀ W: states × (horizon·l).
    pub(super) rows: DMatrix<f64>,
}

impl States {
    /// Weighted by the innovations' covariance, so that units have no influence; `right` is a triangular factor of the past of `rows` samples. At most `most`
    /// states.
    pub(super) fn of(
        predictions: &DMatrix<f64>,
        right: &DMatrix<f64>,
        rows: usize,
        noise: &DMatrix<f64>,
        most: usize,
    ) -> Option<Self> {
        let seen = weighted(predictions, noise)? * right.transpose() / (rows as f64).sqrt();
        let svd = Mat::from_fn(seen.nrows(), seen.ncols(), |i, j| seen[(i, j)]).thin_svd().ok()?;
        let s = svd.S();
        let singular: Vec<f64> = s.column_vector().iter().copied().collect();
        let largest = *singular.first().filter(|v| **v > 0.0 && v.is_finite())?;
        let states = singular.iter().take(most).take_while(|v| **v > 1e-12 * largest).count();
        let u = svd.U();
        let left = DMatrix::from_fn(states, seen.nrows(), |i, j| u[(j, i)] / singular[i].sqrt());
        // Uᵀ W, block by block.
        let inverse = noise
            .clone()
            .solve_lower_triangular(&DMatrix::identity(noise.nrows(), noise.nrows()))?;
        let l = noise.nrows();
        let mut rows = DMatrix::zeros(states, left.ncols());
        for block in 0..left.ncols() / l {
            rows.columns_mut(block * l, l).copy_from(&(left.columns(block * l, l) * &inverse));
        }
        Some(Self { singular, rows })
    }

    /// x(t) = map · past, the first n states.
    pub(super) fn map(&self, predictions: &DMatrix<f64>, order: usize) -> DMatrix<f64> {
        self.rows.rows(0, order) * predictions
    }
}

/// Σe^(−1/2) times every block row.
fn weighted(predictions: &DMatrix<f64>, noise: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let l = noise.nrows();
    let mut out = predictions.clone();
    for block in 0..predictions.nrows() / l {
        let solved = noise.solve_lower_triangular(&predictions.rows(block * l, l))?;
        out.rows_mut(block * l, l).copy_from(&solved);
    }
    Some(out)
}

/// The past window by Akaike's criterion of the long predictor, up to `longest`, and at least `least`.
pub(super) fn past_by_akaike(
    recordings: &Recordings,
    scales: &Scales,
    longest: usize,
    least: usize,
) -> usize {
    let factor = recordings.factor(longest, scales);
    let (layout, y) = (factor.layout, factor.y());
    let rows = factor.rows as f64;
    let criterion = |past: usize| {
        let k = past * layout.width();
        let rest = y.rows(k, y.nrows() - k);
        let covariance = rest.transpose() * rest / rows;
        let floor = DMatrix::identity(layout.l, layout.l) * 1e-20;
        (covariance + floor).determinant().max(f64::MIN_POSITIVE).ln() * rows
            + 2.0 * (k * layout.l) as f64
    };
    let least = least.min(longest);
    (least..=longest).min_by(|a, b| criterion(*a).total_cmp(&criterion(*b))).unwrap_or(longest)
}

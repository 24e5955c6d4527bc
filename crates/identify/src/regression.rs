//! Regressions of an output on its own past and on the input's, with one triangular factor for all ARX and FIR fits.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use super::lag_products::lag_matrices;
use super::triangle::upper;

/// One record of one input and one output on an even grid, owned or borrowed.
#[derive(Debug, Clone, PartialEq)]
pub struct Record<'a> {
    /// Input.
    pub u: Cow<'a, [f64]>,
    /// Output, as long as the input.
    pub y: Cow<'a, [f64]>,
    /// Which output samples were measured; `None`: all.
    pub present: Option<Cow<'a, [bool]>>,
}

impl<'a> Record<'a> {
    /// A record without missing samples; vectors are moved, slices borrowed.
    #[must_use]
    pub fn new(u: impl Into<Cow<'a, [f64]>>, y: impl Into<Cow<'a, [f64]>>) -> Self {
        Self { u: u.into(), y: y.into(), present: None }
    }

    /// The input changes at most once.
    #[must_use]
    pub fn is_one_step(&self) -> bool {
        self.u.windows(2).filter(|pair| pair[0] != pair[1]).count() <= 1
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.u.len().min(self.y.len())
    }

    /// No samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The inputs from `u` on, paired with the outputs from `y` on, borrowed.
    pub fn part(&self, u: usize, y: usize, samples: usize) -> Record<'_> {
        let there = self.present.as_ref().map(|p| Cow::Borrowed(&p[y..y + samples]));
        Record {
            u: Cow::Borrowed(&self.u[u..u + samples]),
            y: Cow::Borrowed(&self.y[y..y + samples]),
            present: there,
        }
    }

    /// Its first samples, borrowed.
    #[must_use]
    pub fn head(&self, samples: usize) -> Record<'_> {
        self.part(0, 0, self.len().min(samples))
    }

    /// The output `samples` earlier, so that lag 0 of the record is lag `samples` of the plant: for plants with a known minimum delay. Borrowed.
    #[must_use]
    pub fn ahead(&self, samples: usize) -> Record<'_> {
        let from = samples.min(self.len());
        self.part(0, from, self.len() - from)
    }

    /// The longest stretches without a missing output, each of at least `least` samples, in order, borrowed. Methods that cannot omit samples use them.
    #[must_use]
    pub fn stretches(&self, least: usize) -> Vec<Record<'_>> {
        let mut stretches = Vec::new();
        let mut from = 0;
        let ends = (0..self.len()).filter(|t| !self.has(*t)).chain([self.len()]);
        for to in ends {
            if to - from >= least.max(1) {
                stretches.push(Record::new(&self.u[from..to], &self.y[from..to]));
            }
            from = to + 1;
        }
        stretches
    }

    fn has(&self, t: usize) -> bool {
        self.present.as_ref().is_none_or(|p| p[t])
    }
}

/// Columns y(t−1) … y(t−na), u(t) … u(t−lags+1) and the target y(t), over every row t ≥ max(na, lags − 1) with complete outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Regression {
    /// Past outputs.
    pub na: usize,
    /// Input lags, from 0.
    pub lags: usize,
}

/// A column whose new part is below this share of its norm depends on the previous ones.
pub(crate) const DEPENDENT: f64 = 1e-11;

/// Number of independent columns of a regression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rank {
    pub rank: usize,
    pub columns: usize,
}

/// The upper triangular factor of [regressors, target], and the number of rows behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangle {
    pub r: DMatrix<f64>,
    pub rows: usize,
    /// Norms of the factored columns: the scale for rounding.
    pub norms: Vec<f64>,
}

/// The coefficients of a regression, and the parts of their covariance: `variance` times `inverse`.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// One for each column, 0 for a column that depends on the previous ones.
    pub coefficients: DVector<f64>,
    /// The inverse Gram matrix; 0 for a column left out.
    pub inverse: DMatrix<f64>,
    /// Residual variance, Σ e²/(rows − rank).
    pub variance: f64,
    pub rows: usize,
    /// Number of independent columns.
    pub rank: usize,
}

impl Triangle {
    /// The least-squares solution. `None` without an independent column, or with no more rows than independent columns.
    pub fn solve(&self) -> Option<Solution> {
        let columns = self.r.ncols() - 1;
        let keep: Vec<usize> = (0..columns)
            .filter(|&i| self.r[(i, i)].abs() > DEPENDENT * self.norms[i].max(f64::MIN_POSITIVE))
            .collect();
        let rank = keep.len();
        if self.rows <= rank || rank == 0 {
            return None;
        }
        let mut chosen = keep.clone();
        chosen.push(columns);
        // A triangle without some of its columns is refactored.
        let r =
            if rank == columns { self.r.clone() } else { upper(self.r.select_columns(&chosen)) };
        let triangle = r.view((0, 0), (rank, rank));
        let solved = triangle
            .solve_upper_triangular(&r.view((0, rank), (rank, 1)).column(0).into_owned())?;
        let root = triangle.solve_upper_triangular(&DMatrix::identity(rank, rank))?;
        let variance = r[(rank, rank)].powi(2) / (self.rows - rank) as f64;
        let each = &root * root.transpose();
        let (mut coefficients, mut inverse) =
            (DVector::zeros(columns), DMatrix::zeros(columns, columns));
        for (i, &row) in keep.iter().enumerate() {
            coefficients[row] = solved[i];
            for (j, &column) in keep.iter().enumerate() {
                inverse[(row, column)] = each[(i, j)];
            }
        }
        let sound = coefficients.iter().chain(&inverse).all(|v: &f64| v.is_finite());
        sound.then_some(Solution { coefficients, inverse, variance, rows: self.rows, rank })
    }
}

impl Regression {
    /// Number of regressors, without the target.
    #[must_use]
    pub fn columns(self) -> usize {
        self.na + self.lags
    }

    /// The first row that needs no sample before the record.
    #[must_use]
    pub fn first_row(self) -> usize {
        self.na.max(self.lags.saturating_sub(1))
    }

    /// The triangular factor over all records: by lag products where they are accurate enough, else by QR of the rows.
    pub fn factor(self, records: &[Record]) -> Triangle {
        if let Some((gram, rows)) = self.gram(records)
            && let Some(triangle) = cholesky(&gram, rows)
        {
            return triangle;
        }
        self.qr(records)
    }

    /// The Gram matrix of [regressors, target] by running lag products, O(samples·columns); `None` where a sample is missing.
    ///
    /// Each product of two lagged signals follows from its neighbour one sample earlier by two corrections at the ends of the record.
    pub fn gram(self, records: &[Record]) -> Option<(DMatrix<f64>, usize)> {
        let size = self.columns() + 1;
        let mut gram = DMatrix::zeros(size, size);
        let mut rows = 0;
        for record in records {
            if record.present.is_some() {
                return None;
            }
            let (first, end) = (self.first_row(), record.len());
            if end <= first {
                continue;
            }
            rows += end - first;
            self.add_lag_products(&mut gram, record, first, end);
        }
        Some((gram, rows))
    }

    fn add_lag_products(self, gram: &mut DMatrix<f64>, record: &Record, first: usize, end: usize) {
        let (y, u) = (&record.y[..end], &record.u[..end]);
        let target = self.columns();
        // Columns of y(t), y(t−1) … and of u(t), u(t−1) …
        let outputs: Vec<usize> = std::iter::once(target).chain(0..self.na).collect();
        let inputs: Vec<usize> = (self.na..target).collect();
        let mut put = |rows: &[usize], columns: &[usize], products: &DMatrix<f64>| {
            for (i, &row) in rows.iter().enumerate() {
                for (j, &column) in columns.iter().enumerate() {
                    gram[(row, column)] += products[(i, j)];
                }
            }
        };
        let [past, cross, input] = lag_matrices(y, u, first, (self.na + 1, self.lags));
        put(&outputs, &outputs, &past);
        put(&inputs, &inputs, &input);
        put(&outputs, &inputs, &cross);
        put(&inputs, &outputs, &cross.transpose());
    }

    /// The triangular factor by Householder reflections of the rows themselves, a block at a time.
    pub fn qr(self, records: &[Record]) -> Triangle {
        let mut rows = Rows::new(self.columns() + 1);
        for record in records {
            for t in self.first_row()..record.len() {
                if !record.has(t) || (1..=self.na).any(|i| !record.has(t - i)) {
                    continue;
                }
                rows.push(|column| match column {
                    c if c < self.na => record.y[t - 1 - c],
                    c if c < self.columns() => record.u[t - (c - self.na)],
                    _ => record.y[t],
                });
            }
        }
        rows.finish()
    }

    /// The factor of all lags of several inputs of one output; `inputs[j]` holds the records of input j. Columns: y(t−1) … y(t−na), then `lags` of each input
    /// in turn, then y(t).
    pub fn joint(self, inputs: &[Vec<Record>]) -> Triangle {
        let size = self.na + self.lags * inputs.len() + 1;
        let mut rows = Rows::new(size);
        for (at, record) in inputs.first().into_iter().flatten().enumerate() {
            for t in self.first_row()..record.len() {
                if !record.has(t) || (1..=self.na).any(|i| !record.has(t - i)) {
                    continue;
                }
                rows.push(|column| match column {
                    c if c < self.na => record.y[t - 1 - c],
                    c if c + 1 < size => {
                        inputs[(c - self.na) / self.lags][at].u[t - (c - self.na) % self.lags]
                    }
                    _ => record.y[t],
                });
            }
        }
        rows.finish()
    }
}

/// Rows added one by one, of which only the triangular factor is kept.
struct Rows {
    block: DMatrix<f64>,
    filled: usize,
    rows: usize,
    squares: Vec<f64>,
}

impl Rows {
    fn new(size: usize) -> Self {
        Self {
            block: DMatrix::zeros(size + ROWS, size),
            filled: 0,
            rows: 0,
            squares: vec![0.0; size],
        }
    }

    fn push(&mut self, value: impl Fn(usize) -> f64) {
        let row = self.squares.len() + self.filled;
        for (column, square) in self.squares.iter_mut().enumerate() {
            self.block[(row, column)] = value(column);
            *square += self.block[(row, column)].powi(2);
        }
        self.rows += 1;
        self.filled += 1;
        if self.filled == ROWS {
            self.reduce();
        }
    }

    fn reduce(&mut self) {
        let size = self.squares.len();
        let r = upper(self.block.rows(0, size + self.filled).into_owned());
        self.block.fill(0.0);
        self.block.view_mut((0, 0), (size, size)).copy_from(&r.view((0, 0), (size, size)));
        self.filled = 0;
    }

    fn finish(mut self) -> Triangle {
        self.reduce();
        let size = self.squares.len();
        let r = self.block.view((0, 0), (size, size)).into_owned();
        Triangle { r, rows: self.rows, norms: self.squares.into_iter().map(f64::sqrt).collect() }
    }
}

/// Rows per QR step.
const ROWS: usize = 256;
/// Σ a·b in eight partial sums.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (left, right) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = left.remainder().iter().zip(right.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in left.zip(right) {
        for l in 0..8 {
            sums[l] += x[l] * y[l];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// The factor of a Gram matrix; `None` where squaring the condition number costs too many digits.
fn cholesky(gram: &DMatrix<f64>, rows: usize) -> Option<Triangle> {
    let n = gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    if norms[..n - 1].contains(&0.0) {
        return None;
    }
    let mut r = DMatrix::zeros(n, n);
    for i in 0..n {
        for j in i..n {
            let inner: f64 = (0..i).map(|k| r[(k, i)] * r[(k, j)]).sum();
            let value = gram[(i, j)] - inner;
            if i < j {
                r[(i, j)] = value / r[(i, i)];
            } else if i + 1 < n {
                // A pivot below this share of its column has lost half of its digits.
                if value <= 1e-7 * gram[(i, i)] {
                    return None;
                }
                r[(i, i)] = value.sqrt();
            } else {
                // A residual of zero up to rounding needs QR.
                if value <= 1e-9 * gram[(i, i)] {
                    return None;
                }
                r[(i, i)] = value.sqrt();
            }
        }
    }
    Some(Triangle { r, rows, norms })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(samples: usize, seed: u64) -> Record<'static> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let [u, y] = [(); 2].map(|()| (0..samples).map(|_| next()).collect::<Vec<f64>>());
        Record::new(u, y)
    }

    /// The oracle: every product summed on its own.
    fn direct(regression: Regression, records: &[Record]) -> DMatrix<f64> {
        let size = regression.columns() + 1;
        let mut gram = DMatrix::zeros(size, size);
        for r in records {
            for t in regression.first_row()..r.len() {
                let row: Vec<f64> = (1..=regression.na)
                    .map(|i| r.y[t - i])
                    .chain((0..regression.lags).map(|j| r.u[t - j]))
                    .chain([r.y[t]])
                    .collect();
                let row = nalgebra::DVector::from_vec(row);
                gram += &row * row.transpose();
            }
        }
        gram
    }

    #[test]
    fn lag_products_equal_the_direct_sums() {
        for (na, lags) in [(0, 1), (0, 7), (3, 1), (10, 40), (1, 71), (4, 0)] {
            let regression = Regression { na, lags };
            let records = [record(150, 3), record(3000, 4), record(5, 9)];
            let (gram, rows) = regression.gram(&records).unwrap();
            let oracle = direct(regression, &records);
            assert!((&gram - &oracle).amax() < 1e-11 * oracle.amax(), "{na} {lags}");
            assert_eq!(
                rows,
                records
                    .iter()
                    .map(|r| r.len().saturating_sub(regression.first_row()))
                    .sum::<usize>()
            );
        }
    }

    #[test]
    fn both_factors_have_the_gram_matrix() {
        let regression = Regression { na: 5, lags: 9 };
        let records = [record(700, 1)];
        let (gram, rows) = regression.gram(&records).unwrap();
        let (a, b) = (cholesky(&gram, rows).unwrap(), regression.qr(&records));
        for triangle in [a, b] {
            assert!((triangle.r.transpose() * &triangle.r - &gram).amax() < 1e-11 * gram.amax());
            assert_eq!(triangle.rows, rows);
        }
    }

    #[test]
    fn stretches_hold_every_sample_between_the_missing_ones() {
        let mut with = record(20, 5);
        with.present = Some((0..20).map(|t| ![0, 5, 6, 19].contains(&t)).collect());
        let found = with.stretches(1);
        assert_eq!(found.iter().map(Record::len).collect::<Vec<_>>(), [4, 12]);
        assert_eq!((found[0].y[0], found[1].u[11]), (with.y[1], with.u[18]));
        assert_eq!(with.stretches(5).len(), 1);
        assert_eq!(record(20, 5).stretches(20), [record(20, 5)]);
    }

    #[test]
    fn missing_outputs_drop_the_rows_that_see_them() {
        let mut with = record(300, 5);
        with.present = Some((0..300).map(|t| t != 120).collect());
        let whole = record(300, 5);
        let regression = Regression { na: 2, lags: 4 };
        assert_eq!(regression.factor(&[with]).rows, regression.factor(&[whole]).rows - 3);
    }
}

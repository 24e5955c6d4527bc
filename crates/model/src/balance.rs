//! Units of states, inputs, outputs and time in which the entries of a model are of similar size. All are powers of two, so the conversion is exact.
//!
//! Every eigenvalue, zero, exponential, logarithm, norm, Riccati equation and realisation is computed in such units, and converted back to those of the model.
//! How it can be wrong: a unit exceeds the range of floating point (units are bounded). A small entry from rounding decides a unit (rows and columns are
//! compared by their 2-norm, which their largest entries dominate).
//!
//! Source: Parlett and Reinsch (1969), "Balancing a matrix for calculation of eigenvalues and eigenvectors", doi:10.1007/BF02165404. James, Langou and Lowery
//! (2014), "On matrix balancing and eigenvector computation", arXiv:1401.5766, for the 2-norm and the stopping rule.

use nalgebra::DMatrix;

use super::matrices::Matrices;

/// Rounds over all states.
const ROUNDS: usize = 60;
/// A round continues if it reduces a row and its column to at most this share.
const WORTH: f64 = 0.95;
/// Units within this factor of each other cost about one digit; they are left unchanged.
const LIKE: f64 = 16.0;
/// The largest exponent of two of a unit; products of two units with an entry stay within floating point.
const LARGEST: f64 = 300.0;

/// The power of two nearest to a positive number, within bounds.
fn power_of_two(v: f64) -> f64 {
    v.log2().round().clamp(-LARGEST, LARGEST).exp2()
}

/// Units t with which T⁻¹·M·T has rows and columns of similar size, T = diag(t).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Units(Vec<f64>);

impl Units {
    /// Those of a square matrix of finite entries.
    pub(super) fn of(m: &DMatrix<f64>) -> Self {
        Self::of_model(m, &DMatrix::zeros(m.nrows(), 0), &DMatrix::zeros(0, m.nrows()))
    }

    /// Those of the states of a model A, B, C, which inputs drive and outputs show.
    pub(super) fn of_model(a: &DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>) -> Self {
        let n = a.nrows();
        let mut t = vec![1.0; n];
        for _ in 0..ROUNDS {
            let mut still = true;
            // A state without a row, or without a column, is scaled down to the largest of the others.
            let whole = (0..n)
                .map(|i| {
                    let [row, column] = row_and_column([a, b, c], &t, i);
                    (row * column).sqrt().max(a[(i, i)].abs())
                })
                .fold(0.0, f64::max);
            for i in 0..n {
                let [row, column] = row_and_column([a, b, c], &t, i);
                let factor = match (row > 0.0, column > 0.0) {
                    (true, true) => (row / column).sqrt(),
                    (true, false) if row > whole && whole > 0.0 => row / whole,
                    (false, true) if column > whole && whole > 0.0 => whole / column,
                    _ => continue,
                };
                let next = (t[i] * power_of_two(factor)).clamp((-LARGEST).exp2(), LARGEST.exp2());
                let (factor, own) = (next / t[i], a[(i, i)].abs());
                if own.hypot(row / factor) + own.hypot(column * factor)
                    < WORTH * (own.hypot(row) + own.hypot(column))
                {
                    still = false;
                    t[i] = next;
                }
            }
            if still {
                break;
            }
        }
        Self(t)
    }

    /// The same, or `None` for similar units: balancing is then useless, and the bits of the result stay.
    pub(super) fn worth(self) -> Option<Self> {
        let least = self.0.iter().copied().fold(f64::INFINITY, f64::min);
        let most = self.0.iter().copied().fold(0.0, f64::max);
        (most >= LIKE * least).then_some(self)
    }

    /// T⁻¹·M·T: a matrix on the states.
    pub(super) fn scaled(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / self.0[i] * self.0[j])
    }

    /// T·M·T⁻¹, the inverse of [`Self::scaled`].
    pub(super) fn unscaled(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * self.0[i] / self.0[j])
    }

    /// T⁻¹·M: a matrix that drives the states.
    pub(super) fn driven(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / self.0[i])
    }

    /// M·T⁻¹, the inverse of [`Self::shown`].
    pub(super) fn unshown(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / self.0[j])
    }

    /// T·M·T: a weight of the states.
    pub(super) fn weighed(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * self.0[i] * self.0[j])
    }

    /// T⁻¹·M·T⁻¹, the inverse of [`Self::weighed`].
    pub(super) fn unweighed(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / self.0[i] / self.0[j])
    }

    /// M·T: a matrix from the states to the outputs.
    pub(super) fn shown(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * self.0[j])
    }
}

/// The 2-norms of a row and a column without the diagonal, in units t.
fn row_and_column([a, b, c]: [&DMatrix<f64>; 3], t: &[f64], i: usize) -> [f64; 2] {
    let (mut row, mut column) = (0.0, 0.0);
    for (j, unit) in t.iter().enumerate().filter(|(j, _)| *j != i) {
        row += (a[(i, j)] / t[i] * unit).powi(2);
        column += (a[(j, i)] / unit * t[i]).powi(2);
    }
    row += b.row(i).iter().map(|v| (v / t[i]).powi(2)).sum::<f64>();
    column += c.column(i).iter().map(|v| (v * t[i]).powi(2)).sum::<f64>();
    [row.sqrt(), column.sqrt()]
}

impl Matrices {
    /// The same model in units of its states that make rows and columns of [A B; C 0] equally large.
    pub(super) fn balanced(self) -> Self {
        let units = Units::of_model(&self.a, &self.b, &self.c);
        self.in_units(&units)
    }

    fn in_units(self, units: &Units) -> Self {
        Self {
            a: units.scaled(&self.a),
            b: units.driven(&self.b),
            c: units.shown(&self.c),
            d: self.d,
        }
    }

    /// The same model in balanced units of its states if the present ones differ widely, else unchanged.
    pub(super) fn in_like_units(self) -> Self {
        match Units::of_model(&self.a, &self.b, &self.c).worth() {
            Some(units) => self.in_units(&units),
            None => self,
        }
    }

    /// The same zeros, in units of states, inputs, outputs and time in which A, B and C are of similar size. The zeros are multiplied by the unit of time,
    /// which is returned.
    pub(super) fn for_zeros(self) -> (Self, f64) {
        let Self { mut a, mut b, mut c, mut d } = self.balanced();
        let size = a.norm();
        let time = if size > 0.0 { power_of_two(size) } else { 1.0 };
        a /= time;
        b /= time;
        // An input's unit is its column of [B; D], an output's its row of [C D], against A.
        for _ in 0..4 {
            for j in 0..d.ncols() {
                let size = b.column(j).norm().hypot(d.column(j).norm());
                if size > 0.0 {
                    let unit = power_of_two(size);
                    b.column_mut(j).unscale_mut(unit);
                    d.column_mut(j).unscale_mut(unit);
                }
            }
            for i in 0..d.nrows() {
                let size = c.row(i).norm().hypot(d.row(i).norm());
                if size > 0.0 {
                    let unit = power_of_two(size);
                    c.row_mut(i).unscale_mut(unit);
                    d.row_mut(i).unscale_mut(unit);
                }
            }
            let units = Units::of_model(&a, &b, &c);
            (a, b, c) = (units.scaled(&a), units.driven(&b), units.shown(&c));
        }
        (Self { a, b, c, d }, time)
    }
}

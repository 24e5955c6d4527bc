//! Symmetric positive definite matrices whose rows begin at a column that never goes back: their Cholesky factor has the same shape.
//!
//! Source: Jennings (1966), The Computer Journal 9(3), 281-285, doi:10.1093/comjnl/9.3.281.

/// The lower triangle, row by row.
#[derive(Debug, Clone)]
pub(super) struct Skyline {
    /// The first column of every row.
    first: Vec<usize>,
    /// From there to the diagonal.
    rows: Vec<Vec<f64>>,
}

impl Skyline {
    /// From the first column of every row, never before that of the row above, and its entries.
    pub(super) fn new(first: Vec<usize>, entry: impl Fn(usize, usize) -> f64) -> Self {
        let rows = first
            .iter()
            .enumerate()
            .map(|(i, &from)| (from..=i).map(|j| entry(i, j)).collect())
            .collect();
        Self { first, rows }
    }

    /// Adds to an entry that the shape has.
    pub(super) fn add(&mut self, (i, j): (usize, usize), value: f64) {
        if let Some(entry) = j.checked_sub(self.first[i]).and_then(|at| self.rows[i].get_mut(at)) {
            *entry += value;
        }
    }

    /// An entry of the diagonal.
    pub(super) fn diagonal(&self, i: usize) -> f64 {
        self.rows[i].last().copied().unwrap_or(0.0)
    }

    /// Its product with a vector.
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (i, (row, &from)) in self.rows.iter().zip(&self.first).enumerate() {
            for (entry, j) in row.iter().zip(from..) {
                product[i] += entry * x[j];
                if j < i {
                    product[j] += entry * x[i];
                }
            }
        }
        product
    }

    /// Its Cholesky factor; `None` where it is not positive definite.
    pub(super) fn factor(mut self) -> Option<Factor> {
        for i in 0..self.rows.len() {
            let from = self.first[i];
            let (above, rest) = self.rows.split_at_mut(i);
            let row = &mut rest[0];
            for j in from..i {
                let begin = from.max(self.first[j]);
                let (mine, other) = (
                    &row[begin - from..j - from],
                    &above[j][begin - self.first[j]..j - self.first[j]],
                );
                let known: f64 = mine.iter().zip(other).map(|(a, b)| a * b).sum();
                let diagonal = above[j][j - self.first[j]];
                row[j - from] = (row[j - from] - known) / diagonal;
            }
            let (before, diagonal) = row.split_at_mut(i - from);
            let left = diagonal[0] - before.iter().map(|v| v * v).sum::<f64>();
            if !(left > 0.0 && left.is_finite()) {
                return None;
            }
            diagonal[0] = left.sqrt();
        }
        Some(Factor(self))
    }
}

/// A Cholesky factor.
pub(super) struct Factor(Skyline);

impl Factor {
    /// The logarithm of the matrix's determinant.
    pub(super) fn log_determinant(&self) -> f64 {
        2.0 * (0..self.0.rows.len()).map(|i| self.0.diagonal(i).ln()).sum::<f64>()
    }

    /// The solution of the matrix's equations.
    pub(super) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        for i in 0..x.len() {
            let from = self.0.first[i];
            let row = &self.0.rows[i];
            let known: f64 = row[..i - from].iter().zip(&x[from..i]).map(|(a, b)| a * b).sum();
            x[i] = (x[i] - known) / self.0.diagonal(i);
        }
        for i in (0..x.len()).rev() {
            x[i] /= self.0.diagonal(i);
            let (value, from) = (x[i], self.0.first[i]);
            for (entry, at) in self.0.rows[i][..i - from].iter().zip(from..) {
                x[at] -= entry * value;
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn solutions_and_determinants_are_those_of_the_full_matrix() {
        let first = vec![0, 0, 1, 1, 3, 3];
        let entry = |i: usize, j: usize| {
            if i == j { 4.0 + i as f64 } else { 1.0 / (1.0 + (i + 2 * j) as f64) }
        };
        let mut sky = Skyline::new(first.clone(), entry);
        sky.add((2, 1), 0.25);
        let full = DMatrix::from_fn(6, 6, |i, j| {
            let (i, j) = (i.max(j), i.min(j));
            let more = if (i, j) == (2, 1) { 0.25 } else { 0.0 };
            if j < first[i] { 0.0 } else { entry(i, j) + more }
        });
        let b: Vec<f64> = (0..6).map(|i| f64::from(i) - 2.0).collect();
        let product = DVector::from_vec(sky.times(&b)) - &full * DVector::from_column_slice(&b);
        assert!(product.norm() < 1e-12);
        let factor = sky.factor().unwrap();
        assert!((factor.log_determinant() - full.determinant().ln()).abs() < 1e-12);
        let solved = DVector::from_vec(factor.solve(&b))
            - full.lu().solve(&DVector::from_column_slice(&b)).unwrap();
        assert!(solved.norm() < 1e-12);
        assert!(Skyline::new(vec![0, 0], |i, j| if i == j { 1.0 } else { 2.0 }).factor().is_none());
    }
}

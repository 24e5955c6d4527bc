//! Decoupled parts of a model: computations cubic in the number of states run on each part separately.

use nalgebra::DMatrix;

/// Indices by part, each ascending, and the parts ordered by their first index. i and j are in one part if an entry (i, j) or (j, i) of one of the n×n matrices
/// is not 0.
pub(super) fn parts(n: usize, matrices: &[&DMatrix<f64>]) -> Vec<Vec<usize>> {
    let mut of: Vec<usize> = (0..n).collect();
    let mut count = n;
    for m in matrices {
        for j in 0..n {
            for (i, &value) in m.column(j).iter().enumerate() {
                let (one, other) = (of[i].min(of[j]), of[i].max(of[j]));
                if value != 0.0 && one != other {
                    for part in &mut of {
                        if *part == other {
                            *part = one;
                        }
                    }
                    count -= 1;
                }
            }
            if count == 1 {
                return vec![(0..n).collect()];
            }
        }
    }
    let mut parts = vec![Vec::new(); n];
    for (i, part) in of.into_iter().enumerate() {
        parts[part].push(i);
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// The rows and columns of a part.
pub(super) fn taken(m: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
}

/// The inverse of [`taken`].
pub(super) fn put(into: &mut DMatrix<f64>, rows: &[usize], columns: &[usize], part: &DMatrix<f64>) {
    for (j, &column) in columns.iter().enumerate() {
        for (i, &row) in rows.iter().enumerate() {
            into[(row, column)] = part[(i, j)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_what_entries_join_in_either_direction() {
        let mut m = DMatrix::zeros(6, 6);
        m[(4, 0)] = 1.0;
        m[(2, 4)] = -1.0;
        m[(1, 1)] = 3.0;
        m[(5, 3)] = f64::NAN;
        assert_eq!(parts(6, &[&m]), [vec![0, 2, 4], vec![1], vec![3, 5]]);
        let mut other = DMatrix::zeros(6, 6);
        other[(1, 3)] = 1.0;
        assert_eq!(parts(6, &[&m, &other]), [vec![0, 2, 4], vec![1, 3, 5]]);
        other[(0, 1)] = 1.0;
        assert_eq!(parts(6, &[&m, &other]), [vec![0, 1, 2, 3, 4, 5]]);
        assert!(parts(0, &[]).is_empty());
    }
}

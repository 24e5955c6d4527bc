//! LU decomposition with partial pivoting of a small matrix, in place.

/// Decomposes the n × n matrix (column by column); `pivots` gets the row interchanges. `false` for a singular matrix.
pub(super) fn decompose(n: usize, m: &mut [f64], pivots: &mut [usize]) -> bool {
    for k in 0..n {
        let column = &m[n * k..n * k + n];
        let mut pivot = k;
        for i in k + 1..n {
            if column[i].abs() > column[pivot].abs() {
                pivot = i;
            }
        }
        let largest = column[pivot];
        pivots[k] = pivot;
        if largest == 0.0 || !largest.is_finite() {
            return false;
        }
        if pivot != k {
            for j in 0..n {
                m.swap(k + n * j, pivot + n * j);
            }
        }
        for i in k + 1..n {
            m[i + n * k] /= largest;
        }
        for j in k + 1..n {
            let factor = m[k + n * j];
            if factor != 0.0 {
                for i in k + 1..n {
                    m[i + n * j] -= m[i + n * k] * factor;
                }
            }
        }
    }
    true
}

/// Solves with a decomposition; the right-hand side becomes the solution.
pub(super) fn solve(n: usize, m: &[f64], pivots: &[usize], b: &mut [f64]) {
    for (k, &pivot) in pivots.iter().enumerate() {
        b.swap(k, pivot);
    }
    for k in 0..n {
        for i in k + 1..n {
            b[i] -= m[i + n * k] * b[k];
        }
    }
    for k in (0..n).rev() {
        b[k] /= m[k + n * k];
        for i in 0..k {
            b[i] -= m[i + n * k] * b[k];
        }
    }
}

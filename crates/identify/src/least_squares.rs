//! A small least-squares problem inside a triangular factor, by Householder reflections.

/// min ‖t − X·b‖² over a few columns; columns that depend on the previous ones are left out.
pub(super) struct Solved {
    /// Coefficients, 0 for a column left out.
    pub(super) coefficients: Vec<f64>,
    /// The smallest Σ of squares.
    pub(super) residual: f64,
    /// Number of independent columns.
    pub(super) rank: usize,
    /// The reduction of the sum of squares by each column, after the previous ones.
    pub(super) shares: Vec<f64>,
}

/// `columns` and `target` have equal lengths and are overwritten; `small[i]` is the norm below which column i depends on the previous ones.
pub(super) fn solve(columns: &mut [Vec<f64>], target: &mut [f64], small: &[f64]) -> Solved {
    let rows = target.len();
    let mut pivots = Vec::with_capacity(columns.len());
    let mut top = 0;
    for (i, &small) in small.iter().enumerate().take(columns.len()) {
        let Some((column, later)) = columns[i..].split_first_mut() else { break };
        let norm = column[top.min(rows)..].iter().map(|v| v * v).sum::<f64>().sqrt();
        if top >= rows || norm <= small {
            continue;
        }
        // Reflect column[top..] onto the first axis.
        let alpha = if column[top] > 0.0 { -norm } else { norm };
        column[top] -= alpha;
        let scale = 2.0 / column[top..].iter().map(|v| v * v).sum::<f64>();
        let vector = &column[top..];
        let reflect = |x: &mut [f64]| {
            let share = scale * vector.iter().zip(x.iter()).map(|(v, x)| v * x).sum::<f64>();
            for (x, v) in x.iter_mut().zip(vector) {
                *x -= share * v;
            }
        };
        for other in later {
            reflect(&mut other[top..]);
        }
        reflect(&mut target[top..]);
        column[top] = alpha;
        pivots.push(i);
        top += 1;
    }
    let mut coefficients = vec![0.0; columns.len()];
    for (row, &i) in pivots.iter().enumerate().rev() {
        let known: f64 = pivots[row + 1..].iter().map(|&j| columns[j][row] * coefficients[j]).sum();
        coefficients[i] = (target[row] - known) / columns[i][row];
    }
    let mut shares = vec![0.0; columns.len()];
    for (row, &i) in pivots.iter().enumerate() {
        shares[i] = target[row] * target[row];
    }
    Solved {
        coefficients,
        shares,
        residual: target[top.min(rows)..].iter().map(|v| v * v).sum(),
        rank: pivots.len(),
    }
}

//! MOESP's realisation: A and C by the shift of the observability matrix, B and D by least squares of a free run.
//!
//! How it can be wrong: an unstable plant has no free run over a record, so an observer's run replaces it. An input that depends on the output gives a bias. An
//! input of few lines leaves states undetermined: K uses them, A, C, B and D do not.

use faer::Mat;
use nalgebra::{DMatrix, DVector};

use super::innovations::{Direct, InnovationsModel, column_norms, decays};
use super::offset::Constants;
use super::recordings::{Factor, Stretch, triangle};
use super::single::{join, solve};

/// Rows of the free run in memory at a time.
const BLOCK: usize = 4096;

/// The observability matrix, (horizon·l) × n: the predictions regressed on the states, over a past with the triangular factor `right`.
pub(super) fn observability(
    predictions: &DMatrix<f64>,
    right: &DMatrix<f64>,
    map: &DMatrix<f64>,
) -> DMatrix<f64> {
    let states = (map * right.transpose()).transpose();
    let seen = (predictions * right.transpose()).transpose();
    solve(&states, &seen, &column_norms(&states)).0.transpose()
}

/// The model with this observability matrix and the constants of its regressions. `stretches` are scaled, `noise` is a lower triangular root of the
/// innovations' covariance, `weight` is the weight of a sample of a stretch.
///
/// Source: Verhaegen (1994), Automatica 30(1), 61-74, doi:10.1016/0005-1098(94)90229-1, section 5; B and D as in section 4 of Verhaegen and Dewilde (1992),
/// Int. J. Control 56(5), 1187-1210, doi:10.1080/00207179208934363.
pub(super) fn realise(
    (factor, y): (&Factor, &DMatrix<f64>),
    (map, gamma): (&DMatrix<f64>, &DMatrix<f64>),
    (noise, direct): (&DMatrix<f64>, Direct),
    stretches: &[Stretch],
    weight: &dyn Fn(usize, usize) -> f64,
) -> (InnovationsModel, Constants) {
    let (m, l) = (factor.layout.m, factor.layout.l);
    let unit = DMatrix::identity(l, l);
    let whitens = noise.solve_lower_triangular(&unit).unwrap_or(unit);
    let (a, c) = shifted(gamma, &whitens);
    let k = gain((factor, y), map, (&a, &c), direct);
    let n = a.nrows();
    let stable = decays(&a);
    let run = Run {
        observer: if stable { DMatrix::zeros(n, l) } else { k.clone() },
        model: InnovationsModel { a, c, k, b: DMatrix::zeros(n, m), d: DMatrix::zeros(l, m) },
        whitens,
        direct,
    };
    run.fitted(stretches, weight)
}

/// A and C.
fn shifted(gamma: &DMatrix<f64>, whitens: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let l = whitens.nrows();
    let rows = gamma.nrows() - l;
    let mut white = gamma.clone();
    for block in 0..gamma.nrows() / l {
        white.rows_mut(block * l, l).copy_from(&(whitens * gamma.rows(block * l, l)));
    }
    let above = white.rows(0, rows).into_owned();
    let (a, _) = solve(&above, &white.rows(l, rows).into_owned(), &column_norms(&above));
    (a, gamma.rows(0, l).into_owned())
}

/// The Kalman gain for the covariances of the residuals of A and C in states and outputs, given the inputs.
fn gain(
    (factor, y): (&Factor, &DMatrix<f64>),
    map: &DMatrix<f64>,
    (a, c): (&DMatrix<f64>, &DMatrix<f64>),
    direct: Direct,
) -> DMatrix<f64> {
    let (n, l) = (a.nrows(), c.nrows());
    let (x, next, u) = (factor.states(map), factor.next_states(map, y), factor.u());
    let norms = column_norms(&u);
    let (_, states) = solve(&u, &(next - &x * a.transpose()), &norms);
    let rest = y - &x * c.transpose();
    let outputs = if direct == Direct::Free { solve(&u, &rest, &norms).1 } else { rest };
    let model = InnovationsModel {
        a: a.clone(),
        b: DMatrix::zeros(n, factor.layout.m),
        c: c.clone(),
        d: DMatrix::zeros(l, factor.layout.m),
        k: DMatrix::zeros(n, l),
    };
    model.kalman(&states.tr_mul(&states), &outputs.tr_mul(&outputs), &states.tr_mul(&outputs), y)
}

/// A run of x(t+1) = (A − LC) x + (B − LD) u + L y. The run is linear in B, D, constants and initial states.
struct Run {
    model: InnovationsModel,
    /// L: 0 for a free run.
    observer: DMatrix<f64>,
    /// The inverse root of the innovations' covariance: the weight of the outputs.
    whitens: DMatrix<f64>,
    direct: Direct,
}

impl Run {
    fn fitted(
        mut self,
        stretches: &[Stretch],
        weight: &dyn Fn(usize, usize) -> f64,
    ) -> (InnovationsModel, Constants) {
        let (n, m, l) = (self.model.order(), self.model.b.ncols(), self.model.c.nrows());
        let parts = stretches.iter().enumerate().filter(|(_, s)| s.len() > 2 * n);
        let parts: Vec<DMatrix<f64>> =
            parts.map(|(i, s)| self.part(s, &|t| weight(i, t))).collect();
        let width = parts.first().map_or(0, DMatrix::ncols);
        let rows = parts.iter().map(DMatrix::nrows).sum();
        let mut all = DMatrix::zeros(rows, width);
        let mut at = 0;
        for part in &parts {
            all.rows_mut(at, part.nrows()).copy_from(part);
            at += part.nrows();
        }
        if width == 0 {
            return (self.model, Constants { moves: DVector::zeros(n), reads: DVector::zeros(l) });
        }
        let columns = all.columns(0, width - 1).into_owned();
        let target = all.columns(width - 1, 1).into_owned();
        let (solved, _) = solve(&columns, &target, &column_norms(&columns));
        let reads = solved.rows(0, l).column(0).into_owned();
        let direct = if self.direct == Direct::Free { l * m } else { 0 };
        let matrix = |from: usize, rows: usize, columns: usize| {
            DMatrix::from_fn(rows, columns, |i, j| solved[(from + j * rows + i, 0)])
        };
        if direct > 0 {
            self.model.d = matrix(l, l, m);
        }
        self.model.b = matrix(l + direct, n, m) + &self.observer * &self.model.d;
        let moves = matrix(l + direct + n * m, n, 1).column(0) + &self.observer * &reads;
        (self.model, Constants { moves, reads })
    }

    /// The triangular factor of a stretch's equations after its initial state: constants of outputs, D, B, constants of states, outputs.
    fn part(&self, s: &Stretch, weight: &dyn Fn(usize) -> f64) -> DMatrix<f64> {
        let (n, m, l) = (self.model.order(), self.model.b.ncols(), self.model.c.nrows());
        let f = &self.model.a - &self.observer * &self.model.c;
        let direct = if self.direct == Direct::Free { l * m } else { 0 };
        let driven = n * m + n;
        let width = n + l + direct + driven + 1;
        // States by column: the initial state's, those of every entry of B, of the constants, and of the observed outputs.
        let mut x = DMatrix::zeros(n, n + driven + 1);
        x.columns_mut(0, n).fill_with_identity();
        let mut held = Mat::<f64>::zeros(0, width);
        let mut from = 0;
        while from < s.len() {
            let to = (from + BLOCK).min(s.len());
            let mut rows = DMatrix::zeros((to - from) * l, width);
            for t in from..to {
                let seen = &self.model.c * &x;
                let mut block = DMatrix::zeros(l, width);
                block.columns_mut(0, n).copy_from(&seen.columns(0, n));
                block.columns_mut(n, l).fill_with_identity();
                for j in 0..direct / l {
                    block.columns_mut(n + l + j * l, l).fill_diagonal(s.u[(j, t)]);
                }
                block.columns_mut(n + l + direct, driven).copy_from(&seen.columns(n, driven));
                block.set_column(width - 1, &(s.y.column(t) - seen.column(n + driven)));
                let block = &self.whitens * block * weight(t);
                rows.rows_mut((t - from) * l, l).copy_from(&block);
                x = &f * x;
                for j in 0..m {
                    for i in 0..n {
                        x[(i, n + j * n + i)] += s.u[(j, t)];
                    }
                }
                for i in 0..n {
                    x[(i, n + n * m + i)] += 1.0;
                }
                let observed = &self.observer * s.y.column(t);
                let mut last = x.column_mut(n + driven);
                last += observed;
            }
            let above = held.nrows();
            held = triangle(&Mat::from_fn(above + rows.nrows(), width, |i, j| {
                if i < above { held[(i, j)] } else { rows[(i - above, j)] }
            }));
            from = to;
        }
        let kept = held.nrows().saturating_sub(n);
        DMatrix::from_fn(kept, width - n, |i, j| held[(i + n, j + n)])
    }
}

/// The one-step errors of the model given states and inputs, rows × l, without the first `skip` samples of every stretch.
pub(super) fn residuals(model: &InnovationsModel, scaled: &[Stretch], skip: usize) -> DMatrix<f64> {
    let late = scaled.iter().filter(|s| s.len() > skip).map(|s| {
        let e = model.innovations(s);
        e.columns(skip, s.len() - skip).transpose()
    });
    late.reduce(|above, below| join(&above.transpose(), &below.transpose()).transpose())
        .unwrap_or_else(|| DMatrix::zeros(0, model.c.nrows()))
}

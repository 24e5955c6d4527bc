//! State-space models in innovations form from data, by PBSIDopt: for stable and unstable plants, in open and closed loop.

use deadtime_signal::decompositions::{eigenvalues, svd};
use nalgebra::{DMatrix, DVector};

use crate::polynomial::{from_roots, reflected};
use crate::regression::{DEPENDENT, Record, Regression};

/// x(t+1) = A x + B u + K e, y = C x + D u + e, one input and one output.
#[derive(Debug, Clone, PartialEq)]
pub struct Innovations {
    /// n×n.
    pub a: DMatrix<f64>,
    /// n.
    pub b: DVector<f64>,
    /// n.
    pub c: DVector<f64>,
    /// 0 without a direct path.
    pub d: f64,
    /// n.
    pub k: DVector<f64>,
    /// Σ e²/rows.
    pub loss: f64,
    /// The singular values behind the order, largest first.
    pub singular: Vec<f64>,
}

/// Options of the identification.
///
/// A long predictor, an ARX model of `past` samples, gives the predictor's Markov parameters C(A − KC)ʲ[B K]. The Markov parameters times the past of the data
/// predict the future outputs. The singular value decomposition of the predictions is observability matrix times states. Given states, least squares give A, B,
/// C, D and K. All steps use one triangular factor of the lagged data, so the cost is that of one long ARX model.
///
/// Source: Chiuso (2007), "The role of vector autoregressive modeling in predictor-based subspace identification", Automatica 43(6), 1034-1048,
/// doi:10.1016/j.automatica.2006.12.005. Van der Veen, van Wingerden, Bergamasco, Lovera and Verhaegen (2013), "Closed-loop subspace identification methods: an
/// overview", IET Control Theory Appl. 7(10), 1339-1358, doi:10.1049/iet-cta.2012.0653, sections 3 and 4. The sources leave the past window to the user: it
/// must exceed the predictor's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subspace {
    /// Largest number of states; Schwarz's criterion selects from 1 to this number, with three parameters per state.
    pub order: usize,
    /// Past samples in the predictor; at least `order`.
    pub past: usize,
    /// Whether the input acts within the sample; feedback within the sample is indistinguishable from it.
    pub direct: bool,
}

impl Subspace {
    /// Minimum number of rows: twice the parameters of the long predictor.
    #[must_use]
    pub fn rows_needed(&self) -> usize {
        4 * self.past + 2
    }

    /// The model; `None` where the records are too short or uninformative.
    #[must_use]
    pub fn fit(&self, records: &[Record]) -> Option<Innovations> {
        let Self { order, past, direct } = *self;
        // Columns y(t−1) … y(t−past), u(t) … u(t−past), y(t).
        let triangle = Regression { na: past, lags: past + 1 }.factor(records);
        if triangle.rows < self.rows_needed() || order == 0 || order > past {
            return None;
        }
        let data = &triangle.r;
        let output = |lag: usize| if lag == 0 { 2 * past + 1 } else { lag - 1 };
        let input = |lag: usize| past + lag;
        // z(t−1) … z(t−past), z = [u, y].
        let window = |from: usize| -> Vec<usize> {
            (from..from + past).flat_map(|lag| [input(lag), output(lag)]).collect()
        };
        let mut regressors = window(1);
        if direct {
            regressors.push(input(0));
        }
        let (mut markov, _) = solve(
            &data.select_columns(&regressors),
            &data.select_columns(&[output(0)]),
            &norms(&triangle.norms, &regressors),
        );
        let markov = markov.rows_mut(0, 2 * past).column(0).into_owned();
        // Row i: the prediction i samples ahead, without the samples in between: C(A − KC)^(i+l−1)[B K] on z(t−l).
        let horizon = past;
        let predict = DMatrix::from_fn(horizon, 2 * past, |i, column| {
            markov.get(column + 2 * i).copied().unwrap_or(0.0)
        });
        let now = data.select_columns(&window(1));
        let next = data.select_columns(&window(0));
        let future = &now * predict.transpose();
        let found = svd(&future)?;
        let right = found.v_t?;
        let singular: Vec<f64> = found.singular_values.iter().copied().collect();
        let largest = *singular.first().filter(|s| **s > 0.0 && s.is_finite())?;
        let most = singular.iter().take(order).take_while(|s| **s > DEPENDENT * largest).count();
        // States x = S^(−1/2)·Vᵀ·predictions: each with the norm √s.
        let states =
            DMatrix::from_fn(most, horizon, |i, j| right[(i, j)] / singular[i].sqrt()) * &predict;
        let (x, shifted) = (&now * states.transpose(), &next * states.transpose());
        let realisation = Realisation {
            x,
            next: shifted,
            u: data.select_columns(&[input(0)]),
            y: data.select_columns(&[output(0)]),
            rows: triangle.rows,
        };
        let criterion = |m: &Innovations| {
            let rows = triangle.rows as f64;
            rows * m.loss.max(DEPENDENT * DEPENDENT * triangle.norms[output(0)].powi(2) / rows).ln()
                + 3.0 * m.b.len() as f64 * rows.ln()
        };
        let models = (1..=most).filter_map(|n| realisation.model(n, direct));
        models
            .min_by(|a, b| criterion(a).total_cmp(&criterion(b)))
            .map(|model| Innovations { singular, ..model })
    }
}

/// States, the next ones, input and output, one row each per row of the triangular factor.
struct Realisation {
    x: DMatrix<f64>,
    next: DMatrix<f64>,
    u: DMatrix<f64>,
    y: DMatrix<f64>,
    rows: usize,
}

impl Realisation {
    /// The model of the first `n` states.
    fn model(&self, n: usize, direct: bool) -> Option<Innovations> {
        let small = |m: &DMatrix<f64>| m.column_iter().map(|c| c.norm()).collect::<Vec<_>>();
        let (x, next) = (self.x.columns(0, n).into_owned(), self.next.columns(0, n).into_owned());
        let seen = if direct { join(&x, &self.u) } else { x.clone() };
        let (of_output, e) = solve(&seen, &self.y, &small(&seen));
        let moved = join(&join(&x, &self.u), &e);
        let (of_states, _) = solve(&moved, &next, &small(&moved));
        let loss = e.norm_squared() / self.rows as f64;
        let model = Innovations {
            a: of_states.rows(0, n).transpose(),
            b: of_states.row(n).transpose(),
            c: of_output.rows(0, n).column(0).into_owned(),
            d: if direct { of_output[(n, 0)] } else { 0.0 },
            k: of_states.row(n + 1).transpose(),
            loss,
            singular: Vec::new(),
        };
        model
            .a
            .iter()
            .chain(model.k.iter())
            .chain(model.c.iter())
            .all(|v| v.is_finite())
            .then_some(model)
    }
}

impl Innovations {
    /// c₁ … c_n of C(q) = det(I − (A − KC)q⁻¹). A(q) y = B(q) u + C(q) e with A(q) = det(I − Aq⁻¹) is the same model. Roots outside the unit circle, which
    /// occur for short records only, are mirrored into it.
    #[must_use]
    pub fn noise_polynomial(&self) -> Option<Vec<f64>> {
        let roots = eigenvalues(&(&self.a - &self.k * self.c.transpose()));
        reflected(&from_roots(&roots))
    }
}

fn norms(all: &[f64], columns: &[usize]) -> Vec<f64> {
    columns.iter().map(|&c| all[c]).collect()
}

pub(super) fn join(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut both = a.clone().resize_horizontally(a.ncols() + b.ncols(), 0.0);
    both.columns_mut(a.ncols(), b.ncols()).copy_from(b);
    both
}

/// Coefficients and residuals of every target on the columns; dependent columns get 0.
pub(super) fn solve(
    columns: &DMatrix<f64>,
    targets: &DMatrix<f64>,
    norms: &[f64],
) -> (DMatrix<f64>, DMatrix<f64>) {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut kept = Vec::new();
    let mut upper = DMatrix::zeros(columns.ncols(), columns.ncols());
    for (at, column) in columns.column_iter().enumerate() {
        let mut rest = column.into_owned();
        let mut shares = vec![0.0; basis.len()];
        // Two passes suffice: the second removes the rounding of the first.
        for _ in 0..2 {
            for (share, q) in shares.iter_mut().zip(&basis) {
                let s = q.dot(&rest);
                *share += s;
                rest.axpy(-s, q, 1.0);
            }
        }
        let norm = rest.norm();
        if norm <= DEPENDENT * norms[at] || norm == 0.0 {
            continue;
        }
        let row = kept.len();
        for (i, share) in shares.into_iter().enumerate() {
            upper[(i, row)] = share;
        }
        upper[(row, row)] = norm;
        basis.push(rest / norm);
        kept.push(at);
    }
    let mut coefficients = DMatrix::zeros(columns.ncols(), targets.ncols());
    let mut residuals = targets.clone();
    for (t, mut target) in residuals.column_iter_mut().enumerate() {
        let mut shares = vec![0.0; basis.len()];
        for _ in 0..2 {
            for (share, q) in shares.iter_mut().zip(&basis) {
                let s = q.dot(&target);
                *share += s;
                target.axpy(-s, q, 1.0);
            }
        }
        for row in (0..kept.len()).rev() {
            let known: f64 =
                (row + 1..kept.len()).map(|j| upper[(row, j)] * coefficients[(kept[j], t)]).sum();
            coefficients[(kept[row], t)] = (shares[row] - known) / upper[(row, row)];
        }
    }
    (coefficients, residuals)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = 0.5·q⁻¹/((1 − 1.05q⁻¹)(1 − 0.6q⁻¹)) u + C/A e with C = 1 − 0.5q⁻¹. The controller u = r − 0.8y(t) stabilises the loop.
    fn loops(samples: usize) -> Record<'static> {
        let mut state = 11_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let (mut u, mut y, mut e) = (vec![0.0; samples], vec![0.0; samples], vec![0.0; samples]);
        for t in 0..samples {
            e[t] = 0.5 * next();
            let past = |x: &[f64], lag: usize| if t >= lag { x[t - lag] } else { 0.0 };
            y[t] = 1.65 * past(&y, 1) - 0.63 * past(&y, 2) + 0.5 * past(&u, 1) + e[t]
                - 0.5 * past(&e, 1);
            u[t] = next() - 0.8 * y[t];
        }
        Record::new(u, y)
    }

    #[test]
    fn an_unstable_plant_in_closed_loop_is_identified() {
        let fit = Subspace { order: 2, past: 25, direct: false }.fit(&[loops(40_000)]).unwrap();
        let mut poles: Vec<f64> = eigenvalues(&fit.a).iter().map(|p| p.re).collect();
        poles.sort_by(f64::total_cmp);
        assert!((poles[0] - 0.6).abs() < 0.03 && (poles[1] - 1.05).abs() < 0.01, "{poles:?}");
        // C B = 0.5, C A B = 0.825; C K = −a₁ + c₁ = 1.15.
        let markov = |v: &DVector<f64>| (fit.c.dot(v), fit.c.dot(&(&fit.a * v)));
        let ((b1, b2), (k1, _)) = (markov(&fit.b), markov(&fit.k));
        assert!(
            (b1 - 0.5).abs() < 0.01 && (b2 - 0.825).abs() < 0.02 && (k1 - 1.15).abs() < 0.03,
            "{b1} {b2} {k1}"
        );
        // C(q) = (1 − 0.5q⁻¹) and a root at 0 from the second order of A.
        let c = fit.noise_polynomial().unwrap();
        assert!((c[0] + 0.5).abs() < 0.05 && c[1].abs() < 0.05, "{c:?}");
    }

    #[test]
    fn records_in_pieces_say_the_same() {
        let whole = loops(6000);
        let cut = |from: usize, to: usize| {
            Record::new(whole.u[from..to].to_vec(), whole.y[from..to].to_vec())
        };
        let subspace = Subspace { order: 2, past: 15, direct: false };
        let (one, two) = (
            subspace.fit(std::slice::from_ref(&whole)).unwrap(),
            subspace.fit(&[cut(0, 2500), cut(2500, 6000)]).unwrap(),
        );
        let (one, two) = (one.noise_polynomial().unwrap(), two.noise_polynomial().unwrap());
        assert!(one.iter().zip(&two).all(|(a, b)| (a - b).abs() < 0.02), "{one:?} {two:?}");
    }
}

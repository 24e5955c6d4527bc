//! ARX models for every delay from one factorisation.

use nalgebra::DMatrix;

use super::least_squares;
use super::regression::{DEPENDENT, Record, Regression, Triangle};
use super::triangle::upper;

/// The losses of A(q) y = B(q) u(t − nk) for nk = 0, 1, …, all over the same rows.
#[derive(Debug, Clone, PartialEq)]
pub struct ArxScan {
    /// Σ e²/rows for every nk.
    pub loss: Vec<f64>,
    /// −a₁ … −a_na, b₀ … for every nk.
    pub coefficients: Vec<Vec<f64>>,
    /// The loss without any input: A(q) y = e.
    pub loss_without_input: f64,
    /// Σ y²/rows.
    pub power: f64,
    /// Rows behind every loss.
    pub rows: usize,
    /// Number of independent columns among the `nb` of the input, with past outputs projected out, for every nk.
    pub input_rank: Vec<usize>,
    /// Σ e²/rows with only the last 1, 2, … nb of the input's coefficients: `by_count[nk][m − 1]` has m of them, from lag nk on.
    pub by_count: Vec<Vec<f64>>,
}

/// ARX(na, nb, nk) for nk = 0 … `max_delay`.
///
/// All delays use the rows of the longest delay, so that losses are comparable. One triangular factor of all lags comes from lag products in O(N·(na + lags)).
/// Each delay then costs a least-squares problem of nb columns inside that triangle, independent of N.
///
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2 and 10.1; MATLAB `arxstruc`.
#[must_use]
pub fn scan(records: &[Record], na: usize, nb: usize, max_delay: usize) -> ArxScan {
    let lags = max_delay + nb;
    let regression = Regression { na, lags };
    read(&regression.factor(records), na, nb, max_delay)
}

/// The lags of an output and of several inputs, for ARX models with one delay per input.
#[derive(Debug, Clone, PartialEq)]
pub struct JointArx {
    triangle: Triangle,
    na: usize,
    nb: usize,
    max_delay: usize,
}

impl JointArx {
    /// `inputs[j]` holds the records of input j with the output, which is the same in all. O(N·(na + inputs·lags)²), once for all delays.
    #[must_use]
    pub fn new(inputs: &[Vec<Record>], na: usize, nb: usize, max_delay: usize) -> Self {
        Self { triangle: Regression { na, lags: max_delay + nb }.joint(inputs), na, nb, max_delay }
    }

    /// The scan of one input. Every model also fits the coefficients of the `others` (input and delay), which follow those of past outputs.
    #[must_use]
    pub fn scan(&self, input: usize, others: &[(usize, usize)]) -> ArxScan {
        let Self { triangle, na, nb, max_delay } = self;
        let lags = max_delay + nb;
        let of = |input: usize, from: usize, count: usize| {
            (0..count).map(move |i| na + input * lags + from + i)
        };
        let last = triangle.r.ncols() - 1;
        let mut columns: Vec<usize> = (0..*na).collect();
        others.iter().for_each(|&(other, nk)| columns.extend(of(other, nk, *nb)));
        let beside = columns.len();
        columns.extend(of(input, 0, lags));
        columns.push(last);
        // The factor replaces the rows: fewer columns of it have a factor of their own.
        let mut r = DMatrix::zeros(columns.len().max(last + 1), columns.len());
        r.rows_mut(0, last + 1).copy_from(&triangle.r.select_columns(&columns));
        let triangle = Triangle {
            r: upper(r),
            rows: triangle.rows,
            norms: columns.iter().map(|&c| triangle.norms[c]).collect(),
        };
        read(&triangle, beside, *nb, *max_delay)
    }

    /// One delay per input by coordinate descent from the given delays: each input's best one with the others fixed, until convergence. No delay is below
    /// `first`.
    #[must_use]
    pub fn descend(&self, mut delays: Vec<usize>) -> Vec<usize> {
        for _ in 0..SWEEPS {
            let before = delays.clone();
            for input in 0..delays.len() {
                let loss = self.scan(input, &beside(&delays, input)).loss;
                let usable = (0..loss.len()).filter(|&nk| loss[nk].is_finite());
                if let Some(best) = usable.min_by(|&a, &b| loss[a].total_cmp(&loss[b])) {
                    delays[input] = best;
                }
            }
            if delays == before {
                break;
            }
        }
        delays
    }
}

/// Every input but one, with its delay.
pub fn beside(delays: &[usize], input: usize) -> Vec<(usize, usize)> {
    delays.iter().copied().enumerate().filter(|(other, _)| *other != input).collect()
}

/// Largest number of sweeps of a coordinate descent over delays; a sweep that does not lower the loss is the last.
const SWEEPS: usize = 20;

/// The scan in a triangular factor whose first `na` columns are in every model.
fn read(triangle: &Triangle, na: usize, nb: usize, max_delay: usize) -> ArxScan {
    let (r, norms) = (&triangle.r, &triangle.norms);
    let last = na + max_delay + nb;
    // Rows that the past outputs occupy; the row of a dependent output is left to the input.
    let (used, free): (Vec<usize>, Vec<usize>) =
        (0..na).partition(|&i| r[(i, i)].abs() > DEPENDENT * norms[i]);
    let rows = triangle.rows.max(1) as f64;
    let tail = |column: usize, from: usize| -> Vec<f64> {
        free.iter().map(|&i| r[(i, column)]).chain((na..from).map(|i| r[(i, column)])).collect()
    };
    let everything = tail(last, last + 1);
    let without: f64 = everything.iter().map(|v| v * v).sum();
    let mut scan = ArxScan {
        loss: Vec::with_capacity(max_delay + 1),
        coefficients: Vec::with_capacity(max_delay + 1),
        loss_without_input: without / rows,
        power: norms[last].powi(2) / rows,
        rows: triangle.rows,
        input_rank: Vec::with_capacity(max_delay + 1),
        by_count: Vec::with_capacity(max_delay + 1),
    };
    for nk in 0..=max_delay {
        // Columns nk … nk+nb−1 of a triangle end at row na+nk+nb; below, the target is untouched.
        let end = na + nk + nb;
        let mut columns: Vec<Vec<f64>> = (0..nb).map(|j| tail(na + nk + j, end)).collect();
        let mut target = tail(last, end);
        let below: f64 = (end..=last).map(|i| r[(i, last)].powi(2)).sum();
        let small: Vec<f64> = (0..nb).map(|j| DEPENDENT * norms[na + nk + j]).collect();
        let solved = least_squares::solve(&mut columns, &mut target, &small);
        scan.loss.push((solved.residual + below) / rows);
        // Each column subtracts its own share from the loss: omitting the later ones gives the shorter numerators.
        let mut residual = solved.residual + below;
        let mut counts: Vec<f64> = vec![residual / rows];
        for share in solved.shares.iter().skip(1).rev() {
            residual += share;
            counts.push(residual / rows);
        }
        counts.reverse();
        scan.by_count.push(counts);
        scan.input_rank.push(solved.rank);
        // Past outputs by back substitution in the rows they occupy.
        let mut coefficients = vec![0.0; na];
        for &i in used.iter().rev() {
            let inputs: f64 = (0..nb).map(|j| r[(i, na + nk + j)] * solved.coefficients[j]).sum();
            let outputs: f64 = (i + 1..na).map(|k| r[(i, k)] * coefficients[k]).sum();
            coefficients[i] = (r[(i, last)] - inputs - outputs) / r[(i, i)];
        }
        coefficients.extend(solved.coefficients);
        scan.coefficients.push(coefficients);
    }
    scan
}

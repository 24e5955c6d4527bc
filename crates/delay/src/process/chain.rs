//! A process model as one chain of first- and second-order sections. The chain's states give the response and its derivatives by poles and delay.
//!
//! Time is in samples. D(s) = (a²ρ·s² + a·s + 1)·(T·s + 1); the first factor exists from two poles on, the second for one or three. a is the sum of two time
//! constants and ρ their product over its square (up to ¼: real poles; above: a complex pair). An invisibly fast pole is then simply ρ = 0. The chain is D
//! twice in series: ŷ = φ·b and φ = 1/D·u (and s/D·u). Then ∂ŷ/∂θ = −(∂D/∂θ)/D·ŷ is a sum of its states, and so is ∂ŷ/∂L = −s·ŷ. After the fraction g of a hold
//! the states are Φ(g)·x + Γ(g)·u: one filter pass gives every delay, whole or not.

use nalgebra::DMatrix;

use deadtime_model::c2d::{Hold, transition};

/// Largest number of states, and the input.
const WIDTH: usize = 7;

/// Weights of the states, and of the input in the last place.
pub(super) type Row = [f64; WIDTH];

/// The index of the input.
pub(super) const INPUT: usize = WIDTH - 1;

/// The number of poles, and the presence of a zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) poles: usize,
    pub(super) zero: bool,
}

/// Smallest ρ: a second time constant of 1e-4 of the first, which is invisible in any record.
pub(super) const LEAST_RATIO: f64 = 1e-4;
/// ρ of two equal real poles.
pub(super) const REAL_RATIO: f64 = 0.25;
/// Largest ρ: a damping ratio of 0.02.
pub(super) const MOST_RATIO: f64 = 625.0;
/// Smallest time constant, samples.
pub(super) const LEAST_LAG: f64 = 0.01;

impl Shape {
    /// Parameters of D: ln a, ρ where there are two poles, then ln T.
    pub(super) fn denominator(self) -> usize {
        self.poles
    }

    /// Parameters of the numerator.
    pub(super) fn numerator(self) -> usize {
        1 + usize::from(self.zero)
    }

    /// States of the chain.
    pub(super) fn states(self) -> usize {
        2 * self.poles
    }

    /// A direct path and one pole. The jump of a held input is visible at the next sample, wherever it occurred in between, so delays are whole samples.
    pub(super) fn whole(self) -> bool {
        self.poles == 1 && self.zero
    }

    /// The index of ρ among the parameters.
    pub(super) fn ratio(self) -> Option<usize> {
        (self.poles > 1).then_some(1)
    }
}

/// Indices of the states: x₁ and x₂ of the first pole pair, w = u/D, z₁ = w/(pair) and z₂, q = w/(single pole).
struct Places {
    x: [usize; 2],
    w: usize,
    z: [usize; 2],
    q: usize,
}

fn places(poles: usize) -> Places {
    match poles {
        1 => Places { x: [0, 0], w: 0, z: [0, 0], q: 1 },
        2 => Places { x: [0, 1], w: 0, z: [2, 3], q: 0 },
        _ => Places { x: [0, 1], w: 2, z: [3, 4], q: 5 },
    }
}

/// The chain at one set of poles.
pub(super) struct Chain {
    pub(super) shape: Shape,
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    phi: DMatrix<f64>,
    gamma: DMatrix<f64>,
    /// 1/D and, with a zero, its scaled derivative.
    pub(super) basis: Vec<Row>,
    /// The derivatives of each of these by the parameters of D (up to multiples of the basis).
    pub(super) slopes: Vec<Vec<Row>>,
}

fn row(terms: &[(usize, f64)]) -> Row {
    let mut row = [0.0; WIDTH];
    for &(at, value) in terms {
        row[at] += value;
    }
    row
}

fn plus(terms: &[(f64, &Row)]) -> Row {
    std::array::from_fn(|i| terms.iter().map(|(c, r)| c * r[i]).sum())
}

impl Chain {
    /// The chain of `theta` (see [`Shape::denominator`]).
    pub(super) fn new(shape: Shape, theta: &[f64]) -> Self {
        let n = shape.states();
        let Places { x, w, z, q } = places(shape.poles);
        let (mut a, mut b) = (DMatrix::zeros(n, n), DMatrix::zeros(n, 1));
        let pair = (shape.poles > 1).then(|| {
            let (sum, ratio) = (theta[0].exp(), theta[1]);
            // T = a·√ρ, ζ = 1/(2√ρ).
            (sum * ratio.sqrt(), 0.5 / ratio.sqrt(), ratio)
        });
        let single = (shape.poles != 2).then(|| theta[shape.poles - 1].exp());
        if let Some((t, zeta, _)) = pair {
            for (first, second) in [(x[0], x[1]), (z[0], z[1])] {
                a[(first, second)] = 1.0 / t;
                a[(second, first)] = -1.0 / t;
                a[(second, second)] = -2.0 * zeta / t;
            }
            b[(x[1], 0)] = 1.0 / t;
            a[(z[1], w)] += 1.0 / t;
        }
        if let Some(t) = single {
            if pair.is_some() {
                a[(w, x[0])] = 1.0 / t;
            } else {
                b[(w, 0)] = 1.0 / t;
            }
            a[(w, w)] = -1.0 / t;
            a[(q, w)] = 1.0 / t;
            a[(q, q)] = -1.0 / t;
        }
        let (phi, gamma, _) = transition(&a, &b, 1.0, Hold::Zero);
        let (basis, slopes) = rows(shape, pair, single);
        Self { shape, a, b, phi, gamma, basis, slopes }
    }

    /// Rows that read the states of the last sample, after `g` of a sample has passed.
    pub(super) fn after(&self, g: f64, rows: &[Row]) -> Vec<Row> {
        if g == 0.0 {
            return rows.to_vec();
        }
        let (phi, gamma, _) = transition(&self.a, &self.b, g, Hold::Zero);
        rows.iter().map(|r| through(r, &phi, &gamma, true)).collect()
    }

    /// The time derivative of a row's sum.
    pub(super) fn rate(&self, r: &Row) -> Row {
        through(r, &self.a, &self.b, false)
    }

    /// The states at every sample, from `start`, one column each.
    pub(super) fn states(&self, u: &[f64], start: &[f64]) -> Vec<Vec<f64>> {
        match self.shape.poles {
            1 => self.propagate::<2>(u, start),
            2 => self.propagate::<4>(u, start),
            _ => self.propagate::<6>(u, start),
        }
    }

    fn propagate<const M: usize>(&self, u: &[f64], start: &[f64]) -> Vec<Vec<f64>> {
        let phi: [[f64; M]; M] = std::array::from_fn(|j| std::array::from_fn(|i| self.phi[(i, j)]));
        let gamma: [f64; M] = std::array::from_fn(|i| self.gamma[(i, 0)]);
        let mut x: [f64; M] = std::array::from_fn(|i| start.get(i).copied().unwrap_or(0.0));
        let mut columns = vec![vec![0.0; u.len()]; M];
        for (t, &u) in u.iter().enumerate() {
            for (column, x) in columns.iter_mut().zip(x) {
                column[t] = x;
            }
            let mut next: [f64; M] = std::array::from_fn(|i| gamma[i] * u);
            for (column, x) in phi.iter().zip(x) {
                for (n, p) in next.iter_mut().zip(column) {
                    *n += p * x;
                }
            }
            x = next;
        }
        columns
    }
}

/// r·[A, B], with or without r's own input weight.
fn through(r: &Row, a: &DMatrix<f64>, b: &DMatrix<f64>, keep: bool) -> Row {
    let n = a.nrows();
    let mut out = [0.0; WIDTH];
    for (j, to) in out.iter_mut().enumerate().take(n) {
        *to = (0..n).map(|i| r[i] * a[(i, j)]).sum();
    }
    out[INPUT] = (0..n).map(|i| r[i] * b[(i, 0)]).sum::<f64>() + if keep { r[INPUT] } else { 0.0 };
    out
}

/// Basis and slopes; `pair` is T, ζ and ρ.
fn rows(
    shape: Shape,
    pair: Option<(f64, f64, f64)>,
    single: Option<f64>,
) -> (Vec<Row>, Vec<Vec<Row>>) {
    let Places { x, w, z, q } = places(shape.poles);
    let (w, q) = (row(&[(w, 1.0)]), row(&[(q, 1.0)]));
    // The derivative of w in units of the pair's T, or of the single pole's.
    let scale = match (pair, single) {
        (Some((t, ..)), Some(single)) => t / single,
        _ => 1.0,
    };
    let input = row(&[(INPUT, 1.0)]);
    let derivative = match (pair, single) {
        (None, _) => plus(&[(1.0, &input), (-1.0, &w)]),
        (_, None) => row(&[(x[1], 1.0)]),
        _ => plus(&[(scale, &row(&[(x[0], 1.0)])), (-scale, &w)]),
    };
    let (mut of_w, mut of_derivative) = (Vec::new(), Vec::new());
    if let Some((_, zeta, ratio)) = pair {
        // z₁ = w over the pair, and its first three derivatives in units of T.
        let (z1, z2) = (row(&[(z[0], 1.0)]), row(&[(z[1], 1.0)]));
        let z3 = plus(&[(1.0, &w), (-1.0, &z1), (-2.0 * zeta, &z2)]);
        let z4 = plus(&[(1.0, &derivative), (-1.0, &z2), (-2.0 * zeta, &z3)]);
        for (slopes, first, second) in [(&mut of_w, &z2, &z3), (&mut of_derivative, &z3, &z4)] {
            slopes.push(plus(&[(-2.0, second), (-2.0 * zeta, first)]));
            slopes.push(plus(&[(-1.0 / ratio, second)]));
        }
    }
    if single.is_some() {
        of_w.push(plus(&[(-1.0, &w), (1.0, &q)]));
        of_derivative.push(plus(&[(-1.0, &derivative), (scale, &w), (-scale, &q)]));
    }
    if shape.zero {
        (vec![w, derivative], vec![of_w, of_derivative])
    } else {
        (vec![w], vec![of_w])
    }
}

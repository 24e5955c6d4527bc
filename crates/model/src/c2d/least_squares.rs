//! Least squares: the sampled model of the same order with the closest frequency response up to the Nyquist frequency.

use nalgebra::{Complex, DMatrix, DVector};

use super::conversion::{Conversion, Converted, single};
use super::matched::CANCEL;
use crate::error::ModelError;
use crate::state_space::{Continuous, Sampled, StateSpace};
use crate::transfer_function::TransferFunction;
use crate::zeros;
use deadtime_signal::fit::{Fit, LevenbergMarquardt, Normal, Stopped, polish};
use deadtime_signal::time::SampleTime;

/// Minimises the mean of |G(jω)e^(−jωf) − H(e^(jωTs))|² over ω = (i + ½)π/(grid·Ts), i < grid. f is the delay minus its whole samples, which are removed first.
///
/// H has the order of G after pole-zero cancellation and any numerator up to that degree. Poles stay on their side of the unit circle; those on it
/// (integrators) stay where exp(s·Ts) puts them. The cost has several minima, mainly for a delay of half a sample and a direct path.
///
/// The search starts from exp(s·Ts), from Tustin's poles, and from these with a pole near −1. Further starts are the best of a fixed sequence of pole
/// positions. The result is the lowest minimum. Where the lowest point lies on the unit circle or at infinity, the result is [`ModelError::NotConverged`]. One
/// input, one output.
/// Source: MATLAB `c2d(…, 'least-squares')` has the same definition; its grid and weights are not published.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LeastSquares {
    /// Number of frequencies, evenly spread up to Nyquist; default 200.
    pub grid: usize,
}

impl Default for LeastSquares {
    fn default() -> Self {
        Self { grid: 200 }
    }
}

/// Tested pole positions in addition to those of the model.
const POSITIONS: usize = 240;
/// Number of them used as starts.
const STARTS: usize = 24;
/// A pole within this distance of the unit circle is on it.
const ON_CIRCLE: f64 = 1e-9;
/// 1/z of a pole outside the circle below which the pole counts as infinite.
const INFINITE: f64 = 1e-9;

const ONE: Complex<f64> = Complex::new(1.0, 0.0);

impl Conversion for LeastSquares {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        single("least squares", sys)?;
        let ts = sample_time.seconds();
        let tf = sys.transfer_function(0, 0)?.cancelled(CANCEL);
        let delay = sample_time.samples(sys.input_delay()[0])?;
        let needed = 4 * (tf.poles().len() + 1);
        if self.grid < needed {
            return Err(ModelError::Count {
                what: "grid frequencies for a least-squares conversion",
                needed,
                got: self.grid,
            });
        }
        let omegas: Vec<f64> = (0..self.grid)
            .map(|i| (i as f64 + 0.5) * sample_time.nyquist_rad_s() / self.grid as f64)
            .collect();
        let target = omegas
            .iter()
            .map(|&w| {
                tf.at(Complex::new(0.0, w)) * Complex::from_polar(1.0, -w * ts * delay.fraction)
            })
            .collect();
        let problem = ResponseFit::new(tf.poles(), ts, &omegas, target);
        let fit = problem.best();
        let (iterations, change) = (fit.iterations, fit.last_change);
        let not_converged =
            ModelError::NotConverged { method: "least squares", iterations, change };
        if !fit.stopped.converged() {
            return Err(not_converged);
        }
        let Some((zeros, poles, gain)) = problem.model(&fit.parameters)? else {
            return Err(not_converged);
        };
        TransferFunction::from_zeros_poles_gain(
            zeros,
            poles,
            gain,
            delay.whole,
            Sampled(sample_time),
        )?
        .to_state_space()
    }
}

/// H = N(δ)/(A(δ)·Ā(μ)·F(δ)), up to the factor zᵏ of Ā, which has magnitude 1. A contains the poles inside the circle, Ā those outside, F those on it.
///
/// δ = (z − 1)/scale and μ = (1/z − 1)/scale. Coefficients in z lose digits by cancellation for poles close to z = 1. In 1/z a pole that moves through infinity
/// to the other side of the axis meets no singularity. The numerator is linear, so the search is over A and Ā only (variable projection).
struct ResponseFit {
    deltas: Vec<Complex<f64>>,
    mus: Vec<Complex<f64>>,
    /// The target response, real parts above imaginary ones.
    target: DVector<f64>,
    /// 1/(zᵏ·F) at every frequency.
    common: Vec<Complex<f64>>,
    scale: f64,
    /// exp(s·Ts) inside the circle, and 1/exp(s·Ts) of the poles outside.
    inside: Vec<Complex<f64>>,
    outside: Vec<Complex<f64>>,
    /// exp(s·Ts) on the circle.
    fixed: Vec<Complex<f64>>,
    /// The same two groups mapped by Tustin's rule.
    tustin: [Vec<Complex<f64>>; 2],
    order: usize,
}

type ZerosPolesGain = (Vec<Complex<f64>>, Vec<Complex<f64>>, f64);

impl ResponseFit {
    fn new(poles: &[Complex<f64>], ts: f64, omegas: &[f64], target: Vec<Complex<f64>>) -> Self {
        let on_circle = |s: &Complex<f64>| (s.re * ts).abs() <= ON_CIRCLE;
        let (fixed, free): (Vec<Complex<f64>>, Vec<Complex<f64>>) =
            poles.iter().copied().partition(on_circle);
        let (left, right): (Vec<Complex<f64>>, Vec<Complex<f64>>) =
            free.into_iter().partition(|s| s.re < 0.0);
        let map = |roots: &[Complex<f64>], sign: f64| {
            roots.iter().map(|s| (s * (sign * ts)).exp()).collect::<Vec<_>>()
        };
        // Outside the circle 1/z is mapped.
        let tustin = |roots: &[Complex<f64>], sign: f64| {
            let half = sign * ts / 2.0;
            roots.iter().map(|s| (ONE + s * half) / (ONE - s * half)).collect::<Vec<_>>()
        };
        let (inside, outside, fixed) = (map(&left, 1.0), map(&right, -1.0), map(&fixed, 1.0));
        let reach = inside.iter().chain(&outside).map(|p| (p - ONE).norm()).fold(0.0, f64::max);
        let scale = if reach > 0.0 { reach.max(1e-6) } else { 1.0 };
        let points: Vec<_> = omegas.iter().map(|&w| Complex::from_polar(1.0, w * ts)).collect();
        let turns = i32::try_from(outside.len()).unwrap_or(i32::MAX);
        let common = points
            .iter()
            .map(|z| {
                ONE / (z.powi(turns)
                    * fixed.iter().map(|p| (z - p) / scale).product::<Complex<f64>>())
            })
            .collect();
        let rows = target.len();
        Self {
            deltas: points.iter().map(|z| (z - ONE) / scale).collect(),
            mus: points.iter().map(|z| (z.conj() - ONE) / scale).collect(),
            target: DVector::from_fn(2 * rows, |i, _| {
                if i < rows { target[i].re } else { target[i - rows].im }
            }),
            tustin: [tustin(&left, 1.0), tustin(&right, -1.0)],
            order: poles.len(),
            common,
            scale,
            inside,
            outside,
            fixed,
        }
    }

    /// Coefficients of A and Ā without their leading ones, from poles (inside) and their reciprocals (outside).
    fn parameters(&self, inside: &[Complex<f64>], outside: &[Complex<f64>]) -> Vec<f64> {
        let group = |roots: &[Complex<f64>]| expand(roots.iter().map(|z| (z - ONE) / self.scale));
        [group(inside), group(outside)].concat()
    }

    /// Poles inside, and reciprocals of the poles outside.
    fn roots(&self, theta: &[f64]) -> [Vec<Complex<f64>>; 2] {
        let (inside, outside) = theta.split_at(self.inside.len());
        [inside, outside].map(|c| {
            let n = c.len();
            let companion = DMatrix::from_fn(n, n, |i, j| {
                if i == 0 { -c[j] } else { f64::from(u8::from(i == j + 1)) }
            });
            zeros::eigenvalues(&companion).into_iter().map(|d| d * self.scale + ONE).collect()
        })
    }

    fn allowed(&self, theta: &[f64]) -> bool {
        self.roots(theta).iter().flatten().all(|z| z.norm() < 1.0)
    }

    /// A and Ā at every frequency, and 1/(A·Ā·zᵏ·F).
    fn denominators(&self, theta: &[f64]) -> [Vec<Complex<f64>>; 3] {
        let (inside, outside) = theta.split_at(self.inside.len());
        let monic = |c: &[f64], x: Complex<f64>| c.iter().fold(ONE, |sum, &a| sum * x + a);
        let a: Vec<_> = self.deltas.iter().map(|&d| monic(inside, d)).collect();
        let b: Vec<_> = self.mus.iter().map(|&m| monic(outside, m)).collect();
        let inverse = (0..a.len()).map(|i| self.common[i] / (a[i] * b[i])).collect();
        [a, b, inverse]
    }

    /// The best numerator's coefficients (lowest power last), its orthonormal basis and the residual.
    fn project(&self, theta: &[f64]) -> Option<Projection> {
        let [a, b, inverse] = self.denominators(theta);
        let columns = powers(&self.deltas, &inverse, self.order);
        let qr = columns.clone().qr();
        let (q, r) = (qr.q(), qr.r());
        let coefficients = r.solve_upper_triangular(&q.tr_mul(&self.target))?;
        let model = columns * &coefficients;
        let residual = &self.target - &model;
        // Once more against the rounding error in the column space.
        let residual = &residual - &q * q.tr_mul(&residual);
        Some(Projection { a, b, q, coefficients, model, residual })
    }

    fn cost(&self, theta: &[f64]) -> f64 {
        if self.allowed(theta) {
            self.project(theta).map_or(f64::INFINITY, |p| p.residual.norm_squared())
        } else {
            f64::INFINITY
        }
    }

    /// Residuals of the projected problem and their Jacobian (Kaufman's approximation: Golub and Pereyra 2003, doi:10.1088/0266-5611/19/2/201).
    fn normal(&self, theta: &[f64]) -> Option<Normal> {
        if !self.allowed(theta) {
            return None;
        }
        let Projection { a, b, q, model, residual, .. } = self.project(theta)?;
        // d(model)/da_k = −δ^(n−1−k)·model/A, and the same in μ for Ā.
        let rows = self.deltas.len();
        let over = |values: &[Complex<f64>]| {
            (0..rows)
                .map(|i| Complex::new(model[i], model[rows + i]) / values[i])
                .collect::<Vec<_>>()
        };
        let group = |x: &[Complex<f64>], values: &[Complex<f64>], n: usize| {
            if n == 0 { DMatrix::zeros(2 * rows, 0) } else { powers(x, &over(values), n - 1) }
        };
        let (left, right) =
            (group(&self.deltas, &a, self.inside.len()), group(&self.mus, &b, self.outside.len()));
        let mut derivative = DMatrix::zeros(2 * rows, theta.len());
        derivative.columns_mut(0, left.ncols()).copy_from(&left);
        derivative.columns_mut(left.ncols(), right.ncols()).copy_from(&right);
        derivative -= &q * q.tr_mul(&derivative);
        Some(Normal::new(&residual, &derivative))
    }

    /// The lowest point found from all starts.
    fn best(&self) -> Fit {
        let search = LevenbergMarquardt {
            max_iterations: 200,
            gradient_tolerance: 1e-13,
            step_tolerance: 1e-12,
            ..LevenbergMarquardt::default()
        };
        let mut best: Option<Fit> = None;
        for start in self.starts() {
            let fit = search.minimise(&start, |theta| self.normal(theta));
            // Minima far above the best need no full accuracy.
            let promising = best.as_ref().is_none_or(|b| fit.normal.cost <= b.normal.cost * 1.01);
            if !promising {
                continue;
            }
            let fit = if fit.stopped == Stopped::Undefined {
                fit
            } else {
                polish(fit, |theta| self.normal(theta))
            };
            let better = best.as_ref().is_none_or(|b| {
                let same = (fit.normal.cost - b.normal.cost).abs() <= 1e-9 * b.normal.cost;
                if same {
                    fit.stopped.converged() && !b.stopped.converged()
                } else {
                    fit.normal.cost < b.normal.cost
                }
            });
            if better {
                best = Some(fit);
            }
        }
        best.unwrap_or_else(|| search.minimise(&[], |_| None))
    }

    /// Starting denominators: exp(s·Ts), Tustin's, and the best of a fixed sequence of pole positions.
    fn starts(&self) -> Vec<Vec<f64>> {
        let matched = self.parameters(&self.inside, &self.outside);
        let mut starts = vec![matched.clone(), self.parameters(&self.tustin[0], &self.tustin[1])];
        if matched.is_empty() {
            starts.truncate(1);
            return starts;
        }
        // Narrow minima need a pole near −1 next to the model's own, as for a delay of half a sample.
        for (inside, outside) in [(true, false), (false, true), (true, true)] {
            let group = |roots: &[Complex<f64>], part: bool| {
                if part { with_alternating_pole(roots) } else { roots.to_vec() }
            };
            starts.push(
                self.parameters(&group(&self.inside, inside), &group(&self.outside, outside)),
            );
        }
        let mut positions: Vec<(f64, Vec<f64>)> = Vec::with_capacity(POSITIONS);
        let mut sequence = Sequence { at: 0, dimensions: matched.len() };
        for round in 0..POSITIONS {
            let draw = sequence.next_point();
            let (first, second) = draw.split_at(self.inside.len());
            // Alternately: both groups new, or one of them from exp(s·Ts).
            let inside =
                if round % 3 == 1 { self.inside.clone() } else { scatter(first, round % 2 == 0) };
            let outside = if round % 3 == 2 {
                self.outside.clone()
            } else {
                scatter(second, round / 2 % 2 == 0)
            };
            let theta = self.parameters(&inside, &outside);
            positions.push((self.cost(&theta), theta));
        }
        positions.retain(|(cost, _)| cost.is_finite());
        positions.sort_by(|a, b| a.0.total_cmp(&b.0));
        starts.extend(positions.into_iter().take(STARTS).map(|(_, theta)| theta));
        starts
    }

    /// Zeros, poles and gain in z; `None` where a pole is at infinity.
    fn model(&self, theta: &[f64]) -> Result<Option<ZerosPolesGain>, ModelError> {
        let Some(projection) = self.project(theta) else { return Ok(None) };
        let [inside, reciprocals] = self.roots(theta);
        if reciprocals.iter().any(|w| w.norm() < INFINITE) {
            return Ok(None);
        }
        let numerator = TransferFunction::from_polynomials(
            projection.coefficients.as_slice(),
            &monomial(self.order),
            0.0,
            Continuous,
        )?;
        let zeros: Vec<_> = numerator.zeros().iter().map(|d| d * self.scale + ONE).collect();
        // μ − μ_j = −(w_j/scale)(z − 1/w_j)/z, w_j = 1/z_j.
        let turned: Complex<f64> = reciprocals.iter().map(|w| -w).product();
        let degree = i32::try_from(self.order - zeros.len()).unwrap_or(0);
        let gain = numerator.gain() * self.scale.powi(degree) / turned.re;
        let mut poles = inside;
        poles.extend(reciprocals.iter().map(|w| ONE / w));
        poles.extend(&self.fixed);
        Ok(Some((zeros, poles, gain)))
    }
}

struct Projection {
    a: Vec<Complex<f64>>,
    b: Vec<Complex<f64>>,
    q: DMatrix<f64>,
    coefficients: DVector<f64>,
    model: DVector<f64>,
    residual: DVector<f64>,
}

/// Columns factor·xⁿ … factor·x⁰, real parts above imaginary ones.
fn powers(x: &[Complex<f64>], factor: &[Complex<f64>], highest: usize) -> DMatrix<f64> {
    let rows = x.len();
    let mut columns = DMatrix::zeros(2 * rows, highest + 1);
    for (i, (x, factor)) in x.iter().zip(factor).enumerate() {
        let mut value = *factor;
        for k in (0..=highest).rev() {
            columns[(i, k)] = value.re;
            columns[(rows + i, k)] = value.im;
            value *= x;
        }
    }
    columns
}

/// Coefficients of Π(x − root) below the leading 1.
fn expand(roots: impl Iterator<Item = Complex<f64>>) -> Vec<f64> {
    let mut coefficients = vec![ONE];
    for root in roots {
        coefficients.push(Complex::default());
        for i in (1..coefficients.len()).rev() {
            let previous = coefficients[i - 1];
            coefficients[i] -= root * previous;
        }
    }
    coefficients[1..].iter().map(|c| c.re).collect()
}

/// xⁿ.
fn monomial(n: usize) -> Vec<f64> {
    let mut coefficients = vec![0.0; n + 1];
    coefficients[0] = 1.0;
    coefficients
}

/// Points inside the unit circle from numbers in [0, 1): complex pairs (radius, angle) or real ones, the odd one real.
fn scatter(numbers: &[f64], pairs: bool) -> Vec<Complex<f64>> {
    let real = |v: f64| Complex::new(1.96 * v - 0.98, 0.0);
    if !pairs {
        return numbers.iter().map(|&v| real(v)).collect();
    }
    let mut points = Vec::with_capacity(numbers.len());
    for pair in numbers.chunks(2) {
        match *pair {
            [radius, angle] => {
                let z = Complex::from_polar(0.98 * radius.sqrt(), std::f64::consts::PI * angle);
                points.extend([z, z.conj()]);
            }
            [v] => points.push(real(v)),
            _ => {}
        }
    }
    points
}

/// The same points, with the first pair split into its radius and −0.8, or without a pair the last point moved to −0.5.
fn with_alternating_pole(points: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let mut moved = points.to_vec();
    let pair = (0..points.len()).find(|&i| points[i].im > 0.0);
    let partner = pair.and_then(|i| {
        (0..points.len())
            .find(|&j| points[j].im < 0.0 && (points[j] - points[i].conj()).norm() < 1e-9)
    });
    if let (Some(i), Some(j)) = (pair, partner) {
        moved[i] = Complex::new(points[i].norm(), 0.0);
        moved[j] = Complex::new(-0.8, 0.0);
    } else if let Some(last) = moved.last_mut() {
        *last = Complex::new(-0.5, 0.0);
    }
    moved
}

/// Points that fill the unit cube evenly, deterministic.
///
/// Source: Roberts (2018), "The unreasonable effectiveness of quasirandom sequences" (the R sequence, from the generalised golden ratio).
struct Sequence {
    at: usize,
    dimensions: usize,
}

impl Sequence {
    fn next_point(&mut self) -> Vec<f64> {
        self.at += 1;
        let (at, dimensions) = (self.at as f64, self.dimensions as f64);
        let mut ratio = 2.0_f64;
        for _ in 0..40 {
            ratio = (1.0 + ratio).powf(1.0 / (dimensions + 1.0));
        }
        (1..=self.dimensions)
            .map(|i| (0.5 + at * ratio.powi(-i32::try_from(i).unwrap_or(i32::MAX))).fract())
            .collect()
    }
}

//! Least squares: the sampled model of the same order with the nearest frequency response up to the Nyquist frequency.

use nalgebra::{Complex, DMatrix, DVector};

use super::{Conversion, matched::CANCEL, single};
use crate::fit::{LevenbergMarquardt, Normal};
use crate::model::{Continuous, ModelError, Sampled, StateSpace, TransferFunction, zeros};
use crate::time::SampleTime;

/// Minimises the mean of |G(jω)e^(−jωf) − H(e^(jωTs))|² over ω = (i + ½)π/(grid·Ts), i < grid; whole samples of delay are taken out first, f is the rest.
///
/// H has the order of G after pole-zero cancellation and any numerator up to that degree. Poles start at exp(s·Ts) and stay on their side of the unit
/// circle, where the cost is infinite. One input, one output.
/// Source: MATLAB `c2d(…, 'least-squares')`, whose definition says the same and whose grid and weights are not published.
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

impl Conversion for LeastSquares {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Result<StateSpace<Sampled>, ModelError> {
        single("least squares", sys)?;
        let ts = sample_time.seconds();
        let tf = sys.transfer_function(0, 0)?.cancelled(CANCEL);
        let delay = sample_time.samples(sys.input_delay()[0])?;
        let n = tf.poles().len();
        let needed = 4 * (n + 1);
        if self.grid < needed {
            return Err(ModelError::Count { what: "grid frequencies for a least-squares conversion", needed, got: self.grid });
        }
        #[allow(clippy::cast_precision_loss)]
        let omegas: Vec<f64> = (0..self.grid).map(|i| (i as f64 + 0.5) * sample_time.nyquist_rad_s() / self.grid as f64).collect();
        let target: Vec<Complex<f64>> =
            omegas.iter().map(|&w| tf.at(Complex::new(0.0, w)) * Complex::from_polar(1.0, -w * ts * delay.fraction)).collect();
        let poles: Vec<Complex<f64>> = tf.poles().iter().map(|s| (s * ts).exp()).collect();
        // Polynomials in δ = (z − 1)/scale: coefficients in z lose their digits to each other where poles crowd at z = 1.
        let one = Complex::new(1.0, 0.0);
        let scale = poles.iter().map(|p| (p - one).norm()).fold(0.0, f64::max).max(1e-6);
        let deltas: Vec<Complex<f64>> = omegas.iter().map(|&w| (Complex::from_polar(1.0, w * ts) - one) / scale).collect();
        let start: Vec<Complex<f64>> = poles.iter().map(|p| (p - one) / scale).collect();
        let start = TransferFunction::from_zeros_poles_gain(Vec::new(), start, 1.0, 0.0, Continuous)?.denominator();
        let problem = Problem { deltas, target, order: n };
        let inside = |theta: &[f64]| problem.poles(theta).iter().filter(|d| (*d * scale + one).norm() < 1.0).count();
        let side = inside(&start[1..]);
        let fit =
            LevenbergMarquardt { max_iterations: 400, gradient_tolerance: 1e-14, step_tolerance: 1e-14, ..LevenbergMarquardt::default() }
                .minimise(&start[1..], |theta| (inside(theta) == side).then(|| problem.normal(theta)).flatten());
        if !fit.stopped.converged() {
            return Err(ModelError::NotConverged { method: "least squares", iterations: fit.iterations, change: fit.last_change });
        }
        let numerator = problem.numerator(&fit.parameters).ok_or(ModelError::NotConverged {
            method: "least squares",
            iterations: fit.iterations,
            change: fit.last_change,
        })?;
        let back = |roots: Vec<Complex<f64>>| roots.into_iter().map(|d| d * scale + one).collect::<Vec<_>>();
        let mut denominator = vec![1.0];
        denominator.extend(&fit.parameters);
        let delta_form = TransferFunction::from_polynomials(&numerator, &denominator, 0.0, Continuous)?;
        let relative_degree = i32::try_from(delta_form.relative_degree()).unwrap_or(0);
        let gain = delta_form.gain() * scale.powi(relative_degree);
        TransferFunction::from_zeros_poles_gain(
            back(delta_form.zeros().to_vec()),
            back(delta_form.poles().to_vec()),
            gain,
            delay.whole,
            Sampled(sample_time),
        )?
        .to_state_space()
    }
}

/// The numerator is linear, so only the denominator is searched (variable projection).
struct Problem {
    deltas: Vec<Complex<f64>>,
    target: Vec<Complex<f64>>,
    order: usize,
}

impl Problem {
    fn poles(&self, theta: &[f64]) -> Vec<Complex<f64>> {
        let n = self.order;
        zeros::eigenvalues(&DMatrix::from_fn(n, n, |i, j| if i == 0 { -theta[j] } else { f64::from(u8::from(i == j + 1)) }))
    }

    /// 1/A(δ) at every frequency.
    fn inverse_denominator(&self, theta: &[f64]) -> Vec<Complex<f64>> {
        let polynomial = |d: &Complex<f64>| theta.iter().fold(Complex::new(1.0, 0.0), |sum, &a| sum * d + a);
        self.deltas.iter().map(|d| Complex::new(1.0, 0.0) / polynomial(d)).collect()
    }

    /// Columns δᵏ/A, real parts above imaginary ones.
    fn basis(&self, inverse: &[Complex<f64>], highest: usize) -> DMatrix<f64> {
        let rows = self.deltas.len();
        let mut basis = DMatrix::zeros(2 * rows, highest + 1);
        for (i, (d, inv)) in self.deltas.iter().zip(inverse).enumerate() {
            let mut value = *inv;
            for k in (0..=highest).rev() {
                basis[(i, k)] = value.re;
                basis[(rows + i, k)] = value.im;
                value *= d;
            }
        }
        basis
    }

    fn stacked_target(&self) -> DVector<f64> {
        let rows = self.target.len();
        DVector::from_fn(2 * rows, |i, _| if i < rows { self.target[i].re } else { self.target[i - rows].im })
    }

    /// The best numerator for this denominator, highest power first.
    fn numerator(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let basis = self.basis(&self.inverse_denominator(theta), self.order);
        let qr = basis.qr();
        let coefficients = qr.r().solve_upper_triangular(&(qr.q().transpose() * self.stacked_target()))?;
        Some(coefficients.iter().copied().collect())
    }

    /// Residuals of the projected problem and their Jacobian (Kaufman's approximation: Golub and Pereyra 2003, doi:10.1088/0266-5611/19/2/201).
    fn normal(&self, theta: &[f64]) -> Option<Normal> {
        let inverse = self.inverse_denominator(theta);
        let basis = self.basis(&inverse, self.order);
        let qr = basis.clone().qr();
        let (q, r) = (qr.q(), qr.r());
        let target = self.stacked_target();
        let coefficients = r.solve_upper_triangular(&(q.transpose() * &target))?;
        let project = |v: DMatrix<f64>| &v - &q * (q.transpose() * &v);
        let residual = project(DMatrix::from_column_slice(target.len(), 1, target.as_slice())).column(0).into_owned();
        // d(B/A)/da_k = −δ^(n−1−k) B/A²
        let rows = self.deltas.len();
        let model = basis * coefficients;
        let quotient: Vec<Complex<f64>> = (0..rows).map(|i| Complex::new(model[i], model[rows + i]) * inverse[i]).collect();
        let derivative = if self.order > 0 { self.basis(&quotient, self.order - 1) } else { DMatrix::zeros(2 * rows, 0) };
        Some(Normal::new(&residual, &project(derivative)))
    }
}

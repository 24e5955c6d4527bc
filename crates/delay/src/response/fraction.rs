//! A rational function times a delay, fitted to a frequency response.
//!
//! Equation: min Σ w²·|H(iω) − e^(−iωτ)·B(iω)/A(iω)|², A monic with its roots in the left half-plane, or slower than half the lowest frequency. For a given τ,
//! linear least squares repeated with the last A as a weight gives poles and zeros. From the best delays of a grid, a descent refines all parameters and τ
//! together.
//!
//! Source: Sanathanan and Koerner (1963), IEEE Trans. Autom. Control 8(1), 56-58, doi:10.1109/TAC.1963.1105517, for the repetition.

use nalgebra::{Complex, DMatrix, DVector};

use deadtime_signal::fit::{LevenbergMarquardt, Normal};
use deadtime_signal::roots;
use deadtime_signal::stop::Stop;

/// The data of a fit: frequencies in units of one, so that powers stay near 1.
#[derive(Debug, Clone)]
pub(super) struct Points {
    pub(super) x: Vec<f64>,
    pub(super) h: Vec<Complex<f64>>,
    /// One over the standard deviation, up to a common factor.
    pub(super) w: Vec<f64>,
}

/// Numbers of poles and of zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Orders {
    pub(super) poles: usize,
    pub(super) zeros: usize,
}

/// One fitted model.
#[derive(Debug, Clone)]
pub(super) struct FittedFraction {
    pub(super) orders: Orders,
    /// a₀ … aₙ₋₁, then b₀ … bₘ.
    pub(super) coefficients: Vec<f64>,
    /// τ in units of one over that of the frequencies.
    pub(super) delay: f64,
    /// Σ w²|e|².
    pub(super) cost: f64,
    /// Variance of the delay per unit of the residuals' variance.
    pub(super) variance: f64,
}

impl FittedFraction {
    /// Pairs of complex poles.
    pub(super) fn resonances(&self) -> usize {
        let a: Vec<f64> =
            self.coefficients.iter().take(self.orders.poles).copied().chain([1.0]).collect();
        roots(&a).iter().filter(|r| r.im > 1e-6 * r.norm()).count()
    }
}

/// Iterations at each delay of the grid; each starts with the A of the previous delay.
const SWEEPS: usize = 3;
/// Iterations before the descent.
const SETTLED: usize = 12;
/// Grid minima from which a descent starts, for each pair of orders.
const MINIMA: usize = 3;
/// Relative ridge that keeps normal equations solvable.
const RIDGE: f64 = 1e-13;

impl Points {
    /// Every `stride`th point.
    pub(super) fn thinned(&self, stride: usize) -> Self {
        let each = |v: &[f64]| v.iter().step_by(stride.max(1)).copied().collect();
        Self {
            x: each(&self.x),
            h: self.h.iter().step_by(stride.max(1)).copied().collect(),
            w: each(&self.w),
        }
    }

    /// Poles below this are indistinguishable from integrators.
    fn slow(&self) -> f64 {
        0.5 * self.x.first().copied().unwrap_or(0.0)
    }

    /// Σ w²|H|².
    pub(super) fn power(&self) -> f64 {
        self.h.iter().zip(&self.w).map(|(h, w)| w * w * h.norm_sqr()).sum()
    }

    /// The best models of these orders, each at its own minimum over the delays of the grid.
    pub(super) fn minima(
        &self,
        scan: &Self,
        orders: Orders,
        delays: &[f64],
        stop: &Stop,
    ) -> Vec<FittedFraction> {
        let mut previous: Option<Vec<f64>> = None;
        let mut profile = Vec::with_capacity(delays.len());
        for &delay in delays {
            if stop.is_set() {
                return Vec::new();
            }
            let fresh = scan.linear(orders, delay, None, SWEEPS);
            let carried = previous.as_ref().and_then(|p| scan.linear(orders, delay, Some(p), 1));
            let best = [fresh, carried].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1));
            previous = best.as_ref().map(|(c, _)| c.clone());
            profile.push(best);
        }
        let cost = |at: usize| {
            profile.get(at).and_then(Option::as_ref).map_or(f64::INFINITY, |(_, cost)| *cost)
        };
        let mut starts: Vec<usize> = (0..profile.len())
            .filter(|&at| {
                cost(at).is_finite()
                    && (at == 0 || cost(at) <= cost(at - 1))
                    && cost(at) <= cost(at + 1)
            })
            .collect();
        starts.sort_by(|&a, &b| cost(a).total_cmp(&cost(b)));
        starts.truncate(MINIMA);
        let longest = delays.last().copied().unwrap_or(0.0);
        let mut found: Vec<FittedFraction> = Vec::new();
        for at in starts {
            let (Some(Some((coefficients, _))), Some(&delay)) = (profile.get(at), delays.get(at))
            else {
                continue;
            };
            let settled = self.linear(orders, delay, Some(coefficients), SETTLED);
            let carried =
                self.costs(orders, coefficients, delay).map(|cost| (coefficients.clone(), cost));
            let Some((start, _)) =
                [settled, carried].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1))
            else {
                continue;
            };
            let Some(fitted) = self.descended(orders, &start, delay, longest) else { continue };
            if found.iter().all(|f| (f.delay - fitted.delay).abs() > 1e-6 * longest) {
                found.push(fitted);
            }
        }
        found
    }

    /// Coefficients and cost by iterated linear least squares at a given delay.
    fn linear(
        &self,
        orders: Orders,
        delay: f64,
        start: Option<&[f64]>,
        sweeps: usize,
    ) -> Option<(Vec<f64>, f64)> {
        let turned: Vec<Complex<f64>> =
            self.h.iter().zip(&self.x).map(|(h, x)| h * Complex::cis(x * delay)).collect();
        let mut a: Option<Vec<f64>> = start.map(|c| c.iter().take(orders.poles).copied().collect());
        let mut best: Option<(Vec<f64>, f64)> = None;
        for _ in 0..sweeps {
            let weights: Vec<f64> = self
                .x
                .iter()
                .zip(&self.w)
                .map(|(x, w)| w * w / a.as_ref().map_or(1.0, |a| monic(a, *x).norm_sqr()))
                .collect();
            let solved = self.weighted(orders, &turned, &weights)?;
            let (poles, zeros) = solved.split_at(orders.poles);
            let (poles, zeros) = match stable(poles, self.slow()) {
                None => (poles.to_vec(), zeros.to_vec()),
                Some(mirrored) => {
                    let zeros = self.numerator(orders, &turned, &mirrored)?;
                    (mirrored, zeros)
                }
            };
            a = Some(poles.clone());
            let coefficients: Vec<f64> = poles.into_iter().chain(zeros).collect();
            if let Some(cost) = self.costs(orders, &coefficients, delay)
                && best.as_ref().is_none_or(|(_, known)| cost < *known)
            {
                best = Some((coefficients, cost));
            }
            // Without poles no iteration is needed.
            if orders.poles == 0 {
                break;
            }
        }
        best
    }

    /// One solution of min Σ v·|A·z − B|², A monic.
    fn weighted(&self, orders: Orders, z: &[Complex<f64>], v: &[f64]) -> Option<Vec<f64>> {
        let (n, m) = (orders.poles, orders.zeros + 1);
        let top = 2 * n.max(orders.zeros) + 1;
        // Σ v|z|²x^k, Σ v·x^k, Σ v·z·x^k.
        let (mut of_a, mut of_b, mut cross) =
            (vec![0.0; top], vec![0.0; top], vec![Complex::ZERO; top]);
        for ((x, z), v) in self.x.iter().zip(z).zip(v) {
            let (mut a, mut b, mut c) = (v * z.norm_sqr(), *v, z * *v);
            for k in 0..top {
                of_a[k] += a;
                of_b[k] += b;
                cross[k] += c;
                a *= x;
                b *= x;
                c *= *x;
            }
        }
        let entry = |i: usize, j: usize| -> f64 {
            match (i < n, j < n) {
                (true, true) => of_a[i + j] * quarter(j, i).re,
                (false, false) => of_b[i + j - 2 * n] * quarter(j, i).re,
                (true, false) => -twisted(cross[i + j - n].conj(), quarter(j - n, i)),
                (false, true) => -twisted(cross[i + j - n].conj(), quarter(i - n, j)),
            }
        };
        let target = |i: usize| -> f64 {
            if i < n {
                -of_a[i + n] * quarter(n, i).re
            } else {
                twisted(cross[i], quarter(n, i - n))
            }
        };
        solved(n + m, entry, target)
    }

    /// The best numerator for a denominator.
    fn numerator(&self, orders: Orders, z: &[Complex<f64>], a: &[f64]) -> Option<Vec<f64>> {
        let m = orders.zeros + 1;
        let (mut gram, mut right) = (vec![0.0; 2 * m], vec![0.0; m]);
        for ((x, z), w) in self.x.iter().zip(z).zip(&self.w) {
            let denominator = monic(a, *x);
            let v = w * w / denominator.norm_sqr();
            let target = z * denominator;
            let (mut power, mut s) = (v, Complex::new(v, 0.0));
            for (k, g) in gram.iter_mut().enumerate() {
                *g += power;
                power *= x;
                if let Some(r) = right.get_mut(k) {
                    *r += (s.conj() * target).re;
                    s *= Complex::new(0.0, *x);
                }
            }
        }
        solved(m, |i, j| gram[i + j] * quarter(j, i).re, |i| right[i])
    }

    /// Σ w²|e|².
    fn costs(&self, orders: Orders, coefficients: &[f64], delay: f64) -> Option<f64> {
        let cost: f64 = self.residuals(orders, coefficients, delay).map(|e| e.norm_sqr()).sum();
        cost.is_finite().then_some(cost)
    }

    /// w·(H − e^(−ixτ)·B/A).
    fn residuals<'a>(
        &'a self,
        orders: Orders,
        coefficients: &'a [f64],
        delay: f64,
    ) -> impl Iterator<Item = Complex<f64>> + 'a {
        let (a, b) = coefficients.split_at(orders.poles.min(coefficients.len()));
        self.x
            .iter()
            .zip(&self.h)
            .zip(&self.w)
            .map(move |((x, h), w)| (h - model(a, b, delay, *x)) * *w)
    }

    /// The residuals of a model, in units of the weights.
    pub(super) fn left(&self, fitted: &FittedFraction) -> Vec<Complex<f64>> {
        self.residuals(fitted.orders, &fitted.coefficients, fitted.delay).collect()
    }

    /// Descends over all parameters and the delay together.
    fn descended(
        &self,
        orders: Orders,
        start: &[f64],
        delay: f64,
        longest: f64,
    ) -> Option<FittedFraction> {
        let count = start.len() + 1;
        let mut lower = vec![f64::NEG_INFINITY; count];
        let mut upper = vec![f64::INFINITY; count];
        (lower[count - 1], upper[count - 1]) = (0.0, longest);
        let search = LevenbergMarquardt {
            max_iterations: 60,
            gradient_tolerance: 1e-8,
            step_tolerance: 1e-9,
            cost_floor: 1e-26 * self.power(),
            lower,
            upper,
        };
        let from: Vec<f64> = start.iter().copied().chain([delay]).collect();
        let fit = search.minimise(&from, |p| self.normal(orders, p));
        let (delay, coefficients) = fit.parameters.split_last()?;
        let information = &fit.normal.information;
        if information.nrows() != count || !fit.normal.cost.is_finite() {
            return None;
        }
        let variance = last_variance(information)?;
        Some(FittedFraction {
            orders,
            coefficients: coefficients.to_vec(),
            delay: *delay,
            cost: fit.normal.cost,
            variance,
        })
    }

    fn normal(&self, orders: Orders, parameters: &[f64]) -> Option<Normal> {
        let (delay, coefficients) = parameters.split_last()?;
        let (a, b) = coefficients.split_at(orders.poles);
        if stable(a, self.slow()).is_some() {
            return None;
        }
        let count = parameters.len();
        let (mut cost, mut gradient, mut information) =
            (0.0, DVector::zeros(count), DMatrix::zeros(count, count));
        let mut row = vec![Complex::ZERO; count];
        for ((x, h), w) in self.x.iter().zip(&self.h).zip(&self.w) {
            let (s, turn, denominator) =
                (Complex::new(0.0, *x), Complex::cis(-x * delay), monic(a, *x));
            let value = turn * horner(b, s) / denominator;
            let e = (h - value) * *w;
            let (mut by_a, mut by_b) = (value / denominator * *w, -turn / denominator * *w);
            for (i, to) in row.iter_mut().enumerate() {
                if i < orders.poles {
                    *to = by_a;
                    by_a *= s;
                } else if i + 1 < count {
                    *to = by_b;
                    by_b *= s;
                } else {
                    *to = s * value * *w;
                }
            }
            cost += e.norm_sqr();
            for i in 0..count {
                gradient[i] += row[i].re * e.re + row[i].im * e.im;
                for j in 0..=i {
                    information[(i, j)] += row[i].re * row[j].re + row[i].im * row[j].im;
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        cost.is_finite().then_some(Normal { cost, gradient, information })
    }
}

/// The zeros of a model, in units of the frequencies.
pub(super) fn zeros(fitted: &FittedFraction) -> Vec<Complex<f64>> {
    let b = fitted.coefficients.get(fitted.orders.poles..).unwrap_or_default();
    roots(b)
}

/// i^(a − b).
fn quarter(a: usize, b: usize) -> Complex<f64> {
    match (a + 4 * b - b) % 4 {
        0 => Complex::new(1.0, 0.0),
        1 => Complex::new(0.0, 1.0),
        2 => Complex::new(-1.0, 0.0),
        _ => Complex::new(0.0, -1.0),
    }
}

/// Re(z·t).
fn twisted(z: Complex<f64>, t: Complex<f64>) -> f64 {
    z.re * t.re - z.im * t.im
}

fn horner(c: &[f64], s: Complex<f64>) -> Complex<f64> {
    c.iter().rev().fold(Complex::ZERO, |sum, c| sum * s + c)
}

/// A(ix), its highest coefficient 1.
fn monic(a: &[f64], x: f64) -> Complex<f64> {
    let s = Complex::new(0.0, x);
    a.iter().rev().fold(Complex::new(1.0, 0.0), |sum, c| sum * s + c)
}

fn model(a: &[f64], b: &[f64], delay: f64, x: f64) -> Complex<f64> {
    Complex::cis(-x * delay) * horner(b, Complex::new(0.0, x)) / monic(a, x)
}

/// A with its roots mirrored into the left half-plane. `None` where they are there already, or smaller than `slow`: an integrator, on either side by noise.
fn stable(a: &[f64], slow: f64) -> Option<Vec<f64>> {
    // A root of 0 is an integrator, on the edge and allowed.
    let first = a.iter().position(|c| *c != 0.0)?;
    let whole: Vec<f64> = a.iter().skip(first).copied().chain([1.0]).collect();
    let found = roots(&whole);
    if found.iter().all(|r| r.re <= 0.0 || r.norm() < slow) {
        return None;
    }
    let mut product = vec![Complex::new(1.0, 0.0)];
    for root in found {
        let root = Complex::new(-root.re.abs(), root.im);
        let mut next = vec![Complex::ZERO; product.len() + 1];
        for (k, c) in product.iter().enumerate() {
            next[k] -= c * root;
            next[k + 1] += c;
        }
        product = next;
    }
    let mut mirrored = vec![0.0; first];
    mirrored.extend(product.iter().take(product.len() - 1).map(|c| c.re));
    Some(mirrored)
}

/// The solution of symmetric equations, with equally scaled columns.
fn solved(
    count: usize,
    entry: impl Fn(usize, usize) -> f64,
    target: impl Fn(usize) -> f64,
) -> Option<Vec<f64>> {
    let scale: Vec<f64> = (0..count).map(|i| entry(i, i).max(f64::MIN_POSITIVE).sqrt()).collect();
    let matrix = DMatrix::from_fn(count, count, |i, j| {
        entry(i, j) / scale[i] / scale[j] + if i == j { RIDGE } else { 0.0 }
    });
    let right = DVector::from_fn(count, |i, _| target(i) / scale[i]);
    let solution = matrix.cholesky()?.solve(&right);
    let values: Vec<f64> = solution.iter().zip(&scale).map(|(v, s)| v / s).collect();
    values.iter().all(|v| v.is_finite()).then_some(values)
}

/// The last diagonal element of the inverse.
fn last_variance(information: &DMatrix<f64>) -> Option<f64> {
    let count = information.nrows();
    let scale: Vec<f64> =
        (0..count).map(|i| information[(i, i)].max(f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        information[(i, j)] / scale[i] / scale[j] + if i == j { RIDGE } else { 0.0 }
    });
    let mut unit = DVector::zeros(count);
    unit[count - 1] = 1.0;
    let column = scaled.cholesky()?.solve(&unit);
    let variance = column[count - 1] / scale[count - 1].powi(2);
    (variance.is_finite() && variance > 0.0).then_some(variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_and_the_information_are_those_of_difference_quotients() {
        let orders = Orders { poles: 2, zeros: 1 };
        let p = [1.3, 0.2, 0.9, -0.4, 0.35];
        let x: Vec<f64> = (1..30).map(|k| 0.1 * f64::from(k)).collect();
        let h: Vec<Complex<f64>> = x.iter().map(|x| Complex::new(x.cos(), 0.3 - x)).collect();
        let w: Vec<f64> = x.iter().map(|x| 1.0 / (1.0 + x)).collect();
        let points = Points { x, h, w };
        let normal = points.normal(orders, &p).unwrap();
        let residuals = |p: &[f64]| -> Vec<f64> {
            points.residuals(orders, &p[..4], p[4]).flat_map(|e| [e.re, e.im]).collect()
        };
        let columns: Vec<Vec<f64>> = (0..5)
            .map(|i| {
                let moved = |h: f64| {
                    let mut q = p;
                    q[i] += h;
                    residuals(&q)
                };
                moved(1e-6).iter().zip(moved(-1e-6)).map(|(a, b)| (a - b) / 2e-6).collect()
            })
            .collect();
        let here = residuals(&p);
        for i in 0..5 {
            let gradient: f64 = columns[i].iter().zip(&here).map(|(a, b)| a * b).sum();
            assert!((gradient - normal.gradient[i]).abs() < 1e-6, "{i}");
            for j in 0..5 {
                let information: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
                assert!((information - normal.information[(i, j)]).abs() < 1e-6, "{i} {j}");
            }
        }
    }

    #[test]
    fn an_exact_response_is_found_whatever_its_orders() {
        let x: Vec<f64> = (0..60).map(|k| 10.0_f64.powf(-1.0 + f64::from(k) / 30.0)).collect();
        for (a, b, delay) in [
            (vec![0.8], vec![2.0], 0.4),
            (vec![1.0, 0.05], vec![1.0], 1.7),
            (vec![2.0, 2.5, 1.1], vec![1.0, -0.2], 0.9),
        ] {
            let orders = Orders { poles: a.len(), zeros: b.len() - 1 };
            let h = x.iter().map(|x| model(&a, &b, delay, *x)).collect();
            let points = Points { x: x.clone(), h, w: vec![1.0; x.len()] };
            let delays: Vec<f64> = (0..40).map(|k| 0.15 * f64::from(k)).collect();
            let found = points.minima(&points, orders, &delays, &Stop::default());
            let best = found.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).unwrap();
            assert!((best.delay - delay).abs() < 1e-6, "{orders:?}: {}", best.delay);
            assert!(
                best.coefficients.iter().zip(a.iter().chain(&b)).all(|(f, t)| (f - t).abs() < 1e-5),
                "{:?}",
                best.coefficients
            );
        }
    }
}

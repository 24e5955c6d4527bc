//! The discrete algebraic Riccati equation and the linear-quadratic regulator.

use deadtime_signal::decompositions::singular_values;
use nalgebra::{Cholesky, Complex, DMatrix, Dyn};

use super::doubling::doubling;
use super::newton::{Newton, Refined};
use super::regulator::{Lqr, check_weights, smallest_eigenvalue, symmetric};
use crate::balance::Units;
use crate::error::ModelError;
use crate::parts::{parts, put, taken};
use crate::shape::check_matrix;
use crate::zeros;

/// The gain K that minimises Σ xᵀQx + uᵀRu + 2xᵀNu over x(k+1) = A x(k) + B u(k) by u = −K x. MATLAB: `dlqr`.
///
/// Shapes: A n×n, B n×m, Q n×n, R m×m, N n×m (`None`: 0). The gain belongs to the state's realisation: two realisations of one transfer function
/// (the Tustin models of different tools, say) have different gains.
///
/// # Errors
/// As [`dare`].
pub fn dlqr(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Lqr, ModelError> {
    Regulation { a, b, q, r, n }.solve()
}

/// The stabilising solution X of AᵀXA − X − (AᵀXB + N)(R + BᵀXB)⁻¹(BᵀXA + Nᵀ) + Q = 0.
///
/// Structure-preserving doubling: quadratic convergence without eigenvalue ordering. If Q does not observe an unstable mode, Hewer's policy iteration replaces
/// it. Newton steps remove a residual from rounding. Widely different units are rescaled first.
///
/// Source: Chu, Fan, Lin and Wang (2004), "Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations",
/// Int. J. Control 77(8), 767-788, doi:10.1080/00207170410001714988.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`], [`ModelError::NotSymmetric`], [`ModelError::WeightR`]. Without a stabilising solution the violated
/// assumption: [`ModelError::NotStabilisable`], [`ModelError::UnseenOnCircle`] or [`ModelError::Indefinite`]; [`ModelError::IllConditioned`] for an inaccurate
/// solution.
pub fn dare(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<DMatrix<f64>, ModelError> {
    Ok(Regulation { a, b, q, r, n }.solve()?.x)
}

/// The stabilising solution X of the generalised equation AᵀXA − EᵀXE − (AᵀXB + N)(R + BᵀXB)⁻¹(BᵀXA + Nᵀ) + Q = 0. Also the gain of u = −K x over E x(k+1) = A
/// x(k) + B u(k).
///
/// As scipy's `solve_discrete_are` and MATLAB's `idare` with E, which is regular (n×n).
///
/// # Errors
/// As [`dare`]; [`ModelError::IllConditioned`] for a singular E.
pub fn gdare(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
    e: &DMatrix<f64>,
) -> Result<Lqr, ModelError> {
    check_matrix("E", e, (a.nrows(), a.nrows()))?;
    Regulation { a, b, q, r, n }.check()?;
    // With E x as the state: A E⁻¹, E⁻ᵀQE⁻¹ and E⁻ᵀN, with X unchanged.
    let back = e.clone().lu();
    let ahead = e.transpose().lu();
    let singular = || ModelError::IllConditioned { residual: f64::INFINITY };
    let behind = |m: &DMatrix<f64>| ahead.solve(&m.transpose()).map(|m| m.transpose());
    let own_a = behind(a).ok_or_else(singular)?;
    let own_q = ahead.solve(&behind(q).ok_or_else(singular)?).map(symmetric);
    let own_q = own_q.ok_or_else(singular)?;
    let own_n = n.map(|n| ahead.solve(n).ok_or_else(singular)).transpose()?;
    if back.determinant() == 0.0 || !own_a.iter().all(|v| v.is_finite()) {
        return Err(singular());
    }
    let lqr = Regulation { a: &own_a, b, q: &own_q, r, n: own_n.as_ref() }.solve()?;
    Ok(Lqr { k: lqr.k * e, ..lqr })
}

/// Newton steps against rounding; each one after the first at least halves the residual.
const NEWTON_STEPS: usize = 12;
/// Largest residual of an accepted solution, relative to the solution.
const TRUSTED: f64 = 1e-8;
/// Cost of otherwise cost-free inputs in the first regulator, relative to their effect.
const COSTLIER: f64 = 1e-3;

/// A regulator's plant and weights: x(k+1) = A x(k) + B u(k) at the cost Σ xᵀQx + uᵀRu + 2xᵀNu.
#[derive(Clone, Copy)]
struct Regulation<'a> {
    a: &'a DMatrix<f64>,
    b: &'a DMatrix<f64>,
    q: &'a DMatrix<f64>,
    r: &'a DMatrix<f64>,
    n: Option<&'a DMatrix<f64>>,
}

impl Regulation<'_> {
    fn check(self) -> Result<(), ModelError> {
        let Self { a, b, q, r, n } = self;
        let zero = DMatrix::zeros(a.nrows(), b.ncols());
        check_weights([a, b, q, r, n.unwrap_or(&zero)])
    }

    /// The solution with its gain and closed loop, which verify it. States and inputs that neither the plant nor the cost couples are separate parts.
    fn solve(self) -> Result<Lqr, ModelError> {
        let Self { a, b, q, r, n } = self;
        self.check()?;
        let (order, inputs) = b.shape();
        let joined =
            DMatrix::from_fn(order + inputs, order + inputs, |i, j| match (i < order, j < order) {
                (true, true) => a[(i, j)].abs() + q[(i, j)].abs(),
                (true, false) => {
                    b[(i, j - order)].abs() + n.map_or(0.0, |n| n[(i, j - order)].abs())
                }
                (false, true) => 0.0,
                (false, false) => r[(i - order, j - order)],
            });
        let parts = parts(order + inputs, &[&joined]);
        if parts.len() <= 1 {
            return self.solve_part();
        }
        let (mut k, mut x, mut poles) = (
            DMatrix::zeros(inputs, order),
            DMatrix::zeros(order, order),
            Vec::with_capacity(order),
        );
        for part in &parts {
            let states = &part[..part.partition_point(|&at| at < order)];
            let steered: Vec<usize> = part[states.len()..].iter().map(|at| at - order).collect();
            let [of_a, of_q] = [a, q].map(|m| taken(m, states, states));
            let of_n = n.map(|n| taken(n, states, &steered));
            // The error is that of the whole, which may concern another part.
            let (of_b, of_r) = (taken(b, states, &steered), taken(r, &steered, &steered));
            let part = Regulation { a: &of_a, b: &of_b, q: &of_q, r: &of_r, n: of_n.as_ref() };
            let Ok(lqr) = part.solve_part() else {
                return self.solve_part();
            };
            put(&mut k, &steered, states, &lqr.k);
            put(&mut x, states, states, &lqr.x);
            poles.extend(lqr.poles);
        }
        Ok(Lqr { k, x, poles })
    }

    /// As [`Self::solve`], without decoupling: in the present units, and in balanced ones where these differ widely. The result with the smaller residual is
    /// returned.
    fn solve_part(self) -> Result<Lqr, ModelError> {
        let given = self.solve_in_units();
        let Some((units, inputs)) = self.units() else { return given };
        let Self { a, b, q, r, n } = self;
        let by_inputs =
            |m: &DMatrix<f64>| DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * inputs[j]);
        let (a, b) = (units.scaled(a), by_inputs(&units.driven(b)));
        let q = units.weighed(q);
        let r = by_inputs(&by_inputs(r).transpose());
        let n = n.map(|n| by_inputs(&units.shown(&n.transpose()).transpose()));
        let like = Regulation { a: &a, b: &b, q: &q, r: &r, n: n.as_ref() };
        let scaled = like.solve_in_units();
        let back = |lqr: &Lqr| Lqr {
            k: units.unshown(&by_inputs(&lqr.k.transpose()).transpose()),
            x: units.unweighed(&lqr.x),
            poles: lqr.poles.clone(),
        };
        let into = |lqr: &Lqr| Lqr {
            k: units.shown(&DMatrix::from_fn(lqr.k.nrows(), lqr.k.ncols(), |i, j| {
                lqr.k[(i, j)] / inputs[i]
            })),
            x: units.weighed(&lqr.x),
            poles: Vec::new(),
        };
        match (given, scaled) {
            (Ok(given), Ok(scaled)) => {
                let own = self.relative(&given) + like.relative(&into(&given));
                let other = back(&scaled);
                let theirs = self.relative(&other) + like.relative(&scaled);
                Ok(if theirs < own { other } else { given })
            }
            (Ok(given), Err(_)) => Ok(given),
            (Err(_), Ok(scaled)) => Ok(back(&scaled)),
            (Err(_), Err(error)) => Err(error),
        }
    }

    /// Units of the states that balance the entries of plant and weights, and of the inputs that balance the diagonal of R. `None` where the present ones are
    /// near them.
    fn units(self) -> Option<(Units, Vec<f64>)> {
        let Self { a, b, q, r, .. } = self;
        let inputs: Vec<f64> = r
            .diagonal()
            .iter()
            .map(|v| if *v > 0.0 { (-0.5 * v.log2()).round().exp2() } else { 1.0 })
            .collect();
        let b = DMatrix::from_fn(b.nrows(), b.ncols(), |i, j| b[(i, j)] * inputs[j]);
        let seen = DMatrix::from_diagonal(&q.diagonal().map(|v| v.abs().sqrt()));
        Some((Units::of_model(a, &b, &seen).worth()?, inputs))
    }

    /// The residual relative to the solution.
    fn relative(self, lqr: &Lqr) -> f64 {
        let size = lqr.x.norm().max(self.q.norm()).max(f64::MIN_POSITIVE);
        self.residual(&lqr.x, &lqr.k).norm() / size
    }

    /// As [`Self::solve_part`], in the present units.
    fn solve_in_units(self) -> Result<Lqr, ModelError> {
        let Self { a, b, q, r, n } = self;
        let (order, inputs) = b.shape();
        if order == 0 && (inputs == 0 || r.clone().cholesky().is_some()) {
            return Ok(Lqr {
                k: DMatrix::zeros(inputs, 0),
                x: DMatrix::zeros(0, 0),
                poles: Vec::new(),
            });
        }
        if inputs == 0 {
            // No inputs: replaced by one without an effect.
            let (b, r) = (DMatrix::zeros(order, 1), DMatrix::identity(1, 1));
            let still = Regulation { b: &b, r: &r, n: None, ..self }.solve_in_units()?;
            return Ok(Lqr { k: DMatrix::zeros(0, order), ..still });
        }
        let Some(r_factor) = r.clone().cholesky() else { return self.with_free_inputs() };
        // The cross term is moved into A and Q: u = v − R⁻¹Nᵀx.
        let (a0, q0) = match n {
            None => (a.clone(), q.clone()),
            Some(n) => {
                let shift = r_factor.solve(&n.transpose());
                (a - b * &shift, symmetric(q - n * shift))
            }
        };
        let g0 = symmetric(b * r_factor.solve(&b.transpose()));
        let polished = |first| self.polished(first);
        let without = Regulation { a: &a0, q: &q0, n: None, ..self };
        let trusted = |lqr: &Lqr| self.relative(lqr) <= TRUSTED * (1.0 + a.norm().powi(2));
        let doubled = doubling(&a0, &g0, &q0).and_then(polished);
        if let Some(lqr) = doubled.filter(trusted) {
            return Ok(lqr);
        }
        let ill = match self.why_none(&a0, &q0) {
            // No assumption is violated: an unstable mode without cost, which doubling leaves unchanged, or a loss of digits from widely different weights.
            ill @ ModelError::IllConditioned { .. } => ill,
            reason => return Err(reason),
        };
        for gain in [without.gain_for_unit_cost(&g0), without.gain_for_mild_cost()] {
            let found = gain.and_then(|k| without.policy_iteration(k)).and_then(polished);
            if let Some(lqr) = found.filter(trusted) {
                return Ok(lqr);
            }
        }
        Err(ill)
    }

    /// As [`Self::solve_in_units`] for an input without a cost of its own: R is singular, R + BᵀXB is not. Policy iteration starts from the regulator with more
    /// expensive inputs, or from zero gain for a stable plant.
    fn with_free_inputs(self) -> Result<Lqr, ModelError> {
        let Self { a, b, q, r, .. } = self;
        let smallest = smallest_eigenvalue(r);
        let refused = || ModelError::WeightR { smallest };
        if smallest < -1e-12 * r.norm() {
            return Err(refused());
        }
        let cost = COSTLIER * (r.norm() + q.norm() * b.norm_squared()).max(f64::MIN_POSITIVE);
        let costlier = r + DMatrix::from_diagonal_element(r.nrows(), r.nrows(), cost);
        let regulator = Regulation { r: &costlier, ..self }.solve_in_units().ok().map(|lqr| lqr.k);
        let none = (radius(a) < 1.0).then(|| DMatrix::zeros(b.ncols(), a.nrows()));
        let found = [regulator, none].into_iter().flatten().find_map(|gain| {
            let lqr = self.polished(self.policy_iteration(gain)?)?;
            (self.relative(&lqr) <= TRUSTED * (1.0 + a.norm().powi(2))).then_some(lqr)
        });
        found.ok_or_else(refused)
    }

    /// A solution with its gain and the poles of its loop; `None` where it is not the stabilising one.
    fn polished(self, first: DMatrix<f64>) -> Option<Lqr> {
        let Self { a, b, r, .. } = self;
        let newton = Newton {
            gain: |x: &DMatrix<f64>| self.gain(x),
            residual: |x: &DMatrix<f64>, k: &DMatrix<f64>| self.residual(x, k),
            // The correction solves a Stein equation with the closed loop; for an unstable loop it overflows.
            correction: |k: &DMatrix<f64>, error: &DMatrix<f64>| Some(stein(&(a - b * k), error)),
            steps: NEWTON_STEPS,
            free: 1,
            settled: 1e-14,
        };
        let Refined { x, k, .. } = newton.refine(first)?;
        // If R + BᵀXB is not positive definite, the stationary point is no minimum.
        (r + b.transpose() * &x * b).cholesky()?;
        let poles = zeros::eigenvalues(&(a - b * &k));
        poles.iter().all(|p| p.norm() < 1.0).then_some(Lqr { k, x, poles })
    }

    /// A stabilising gain: the optimal one for Q = I.
    fn gain_for_unit_cost(self, g: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let order = self.a.nrows();
        self.gain(&doubling(self.a, g, &DMatrix::identity(order, order))?)
    }

    /// A stabilising gain: the optimal one for Q = I and inputs whose cost equals their effect.
    fn gain_for_mild_cost(self) -> Option<DMatrix<f64>> {
        let Self { a, b, .. } = self;
        let (order, inputs) = b.shape();
        let weight = b.norm_squared();
        let r = DMatrix::from_diagonal_element(inputs, inputs, weight);
        let q = DMatrix::identity(order, order);
        let x = doubling(a, &(b * b.transpose() / weight), &q)?;
        Regulation { r: &r, q: &q, ..self }.gain(&x)
    }

    /// The largest solution, from a stabilising gain: X of the present closed loop, then the gain for that X, until convergence.
    ///
    /// Source: Hewer (1971), "An iterative technique for the computation of the steady state gains
    /// for the discrete optimal regulator", IEEE Trans. Automatic Control 16(4), 382-384,
    /// doi:10.1109/TAC.1971.1099755.
    fn policy_iteration(self, mut k: DMatrix<f64>) -> Option<DMatrix<f64>> {
        let Self { a, b, q, r, n } = self;
        let mut x: Option<DMatrix<f64>> = None;
        let mut least = f64::INFINITY;
        for _ in 0..60 {
            let loop_matrix = a - b * &k;
            if radius(&loop_matrix) >= 1.0 {
                return None;
            }
            let mut cost = q + k.transpose() * r * &k;
            if let Some(n) = n {
                let nk = n * &k;
                cost -= &nk + nk.transpose();
            }
            let next = symmetric(stein(&loop_matrix, &symmetric(cost)));
            let change = x.as_ref().map_or(f64::INFINITY, |x| (&next - x).norm() / next.norm());
            // Changes decrease until rounding keeps them constant.
            if change <= 1e-14 || (change < 1e-6 && change >= least) {
                return Some(next);
            }
            least = least.min(change);
            k = self.gain(&next)?;
            x = Some(next);
        }
        None
    }

    /// The violated assumption, by the Popov-Belevitch-Hautus tests.
    fn why_none(self, a0: &DMatrix<f64>, q0: &DMatrix<f64>) -> ModelError {
        let Self { b, q, r, n, .. } = self;
        let order = a0.nrows();
        let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
        let loses_rank = |lambda: Complex<f64>, columns: &DMatrix<f64>, stacked: &DMatrix<f64>| {
            let mut pencil = DMatrix::zeros(order, order + columns.ncols());
            pencil.view_mut((0, 0), (order, order)).copy_from(
                &(complex(stacked) - DMatrix::from_diagonal_element(order, order, lambda)),
            );
            pencil.view_mut((0, order), columns.shape()).copy_from(&complex(columns));
            singular_values(&pencil).is_some_and(|s| s.min() <= 1e-8 * s.max())
        };
        let poles = zeros::eigenvalues(a0);
        if let Some(p) = poles.iter().find(|p| p.norm() >= 1.0 - 1e-9 && loses_rank(**p, b, a0)) {
            return ModelError::NotStabilisable { re: p.re, im: p.im, magnitude: p.norm() };
        }
        if let Some(p) = poles
            .iter()
            .find(|p| (p.norm() - 1.0).abs() <= 1e-6 && loses_rank(**p, q0, &a0.transpose()))
        {
            return ModelError::UnseenOnCircle { re: p.re, im: p.im };
        }
        let inputs = b.ncols();
        let mut joint = DMatrix::zeros(order + inputs, order + inputs);
        joint.view_mut((0, 0), (order, order)).copy_from(q);
        joint.view_mut((order, order), (inputs, inputs)).copy_from(r);
        if let Some(n) = n {
            joint.view_mut((0, order), (order, inputs)).copy_from(n);
            joint.view_mut((order, 0), (inputs, order)).copy_from(&n.transpose());
        }
        let smallest = smallest_eigenvalue(&joint);
        if smallest < -1e-12 * joint.norm() {
            ModelError::Indefinite { smallest }
        } else {
            ModelError::IllConditioned { residual: f64::NAN }
        }
    }

    /// (R + BᵀXB)⁻¹(BᵀXA + Nᵀ).
    fn gain(self, x: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let Self { a, b, r, n, .. } = self;
        if a.is_empty() || b.is_empty() {
            return Some(DMatrix::zeros(b.ncols(), a.nrows()));
        }
        if b.ncols() > b.nrows()
            && let Some(factor) = r.clone().cholesky()
        {
            return self.gain_of_many_inputs(x, &factor);
        }
        let xb = x * b;
        let weight = r + b.transpose() * &xb;
        let mut right = xb.transpose() * a;
        if let Some(n) = n {
            right += n.transpose();
        }
        weight.lu().solve(&right)
    }

    /// As [`Self::gain`] for more inputs than states, R⁻¹Nᵀ + R⁻¹BᵀX(I + GX)⁻¹(A − BR⁻¹Nᵀ). In directions without effect R alone decides, and a sum with BᵀXB
    /// would lose it to rounding.
    fn gain_of_many_inputs(
        self,
        x: &DMatrix<f64>,
        factor: &Cholesky<f64, Dyn>,
    ) -> Option<DMatrix<f64>> {
        let Self { a, b, n, .. } = self;
        let through = factor.solve(&b.transpose());
        let mut w = b * &through * x;
        for i in 0..w.nrows() {
            w[(i, i)] += 1.0;
        }
        let Some(n) = n else { return Some(through * x * w.lu().solve(a)?) };
        let shift = factor.solve(&n.transpose());
        let moved = w.lu().solve(&(a - b * &shift))?;
        Some(through * x * moved + shift)
    }

    /// The residual in its most accurate form: (A − BK)ᵀX(A − BK) + Q + KᵀRK − NK − KᵀNᵀ − X.
    fn residual(self, x: &DMatrix<f64>, k: &DMatrix<f64>) -> DMatrix<f64> {
        let Self { a, b, q, r, n } = self;
        let loop_matrix = a - b * k;
        let mut sum = loop_matrix.transpose() * x * &loop_matrix + q + k.transpose() * r * k - x;
        if let Some(n) = n {
            let nk = n * k;
            sum -= &nk + nk.transpose();
        }
        symmetric(sum)
    }
}

fn radius(m: &DMatrix<f64>) -> f64 {
    zeros::eigenvalues(m).iter().map(|p| p.norm()).fold(0.0, f64::max)
}

/// Σ (Fᵀ)ⁱ E Fⁱ, by doubling; F is stable.
fn stein(f: &DMatrix<f64>, e: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut f, mut sum) = (f.clone(), e.clone());
    for _ in 0..60 {
        let step = f.transpose() * &sum * &f;
        sum += &step;
        f = &f * &f;
        if step.norm() <= 1e-17 * sum.norm() {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn m(rows: usize, columns: usize, entries: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(rows, columns, entries)
    }

    fn identity(n: usize) -> DMatrix<f64> {
        DMatrix::identity(n, n)
    }

    /// x = a²x − (abx)²/(r + b²x) + q by hand: a = b = q = r = 1 gives the golden ratio.
    #[test]
    fn the_scalar_equation_has_the_golden_ratio_as_its_solution() {
        let one = identity(1);
        let solution = dlqr(&one, &one, &one, &one, None).unwrap();
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        assert_abs_diff_eq!(solution.x[(0, 0)], golden, epsilon = 1e-15);
        assert_abs_diff_eq!(solution.k[(0, 0)], golden / (1.0 + golden), epsilon = 1e-15);
    }

    #[test]
    fn an_unstable_mode_that_no_input_moves_is_named() {
        let a = m(2, 2, &[1.2, 0.0, 0.0, 0.5]);
        let error = dlqr(&a, &m(2, 1, &[0.0, 1.0]), &identity(2), &identity(1), None).unwrap_err();
        assert!(
            matches!(error, ModelError::NotStabilisable { re, magnitude, .. } if (re - 1.2).abs() < 1e-12 && (magnitude - 1.2).abs() < 1e-12)
        );
    }

    #[test]
    fn an_unmoved_mode_on_the_circle_is_not_stabilisable_either() {
        let error = dlqr(
            &m(2, 2, &[1.0, 0.0, 0.0, 0.5]),
            &m(2, 1, &[0.0, 1.0]),
            &identity(2),
            &identity(1),
            None,
        )
        .unwrap_err();
        assert!(matches!(error, ModelError::NotStabilisable { .. }), "{error}");
    }

    #[test]
    fn a_mode_on_the_circle_without_cost_is_named() {
        for (a, q) in [
            (m(1, 1, &[1.0]), m(1, 1, &[0.0])),
            (m(2, 2, &[1.0, 0.1, 0.0, 0.7]), m(2, 2, &[0.0, 0.0, 0.0, 1.0])),
            (m(2, 2, &[0.6, 0.8, -0.8, 0.6]), m(2, 2, &[0.0, 0.0, 0.0, 0.0])),
        ] {
            let n = a.nrows();
            let b = DMatrix::from_element(n, 1, 1.0);
            let error = dlqr(&a, &b, &q, &identity(1), None).unwrap_err();
            assert!(matches!(error, ModelError::UnseenOnCircle { .. }), "{a} {error}");
        }
    }

    #[test]
    fn an_indefinite_cost_without_minimum_is_named() {
        let error = dlqr(&m(1, 1, &[2.0]), &identity(1), &m(1, 1, &[-100.0]), &identity(1), None)
            .unwrap_err();
        assert!(
            matches!(error, ModelError::Indefinite { smallest } if (smallest + 100.0).abs() < 1e-9),
            "{error}"
        );
        let error = dlqr(
            &m(1, 1, &[0.5]),
            &identity(1),
            &identity(1),
            &identity(1),
            Some(&m(1, 1, &[30.0])),
        )
        .unwrap_err();
        assert!(matches!(error, ModelError::Indefinite { .. }), "{error}");
    }

    /// Three plants and an input without effect, mixed: the parts against the whole in coordinates without zero entries.
    #[test]
    fn parts_that_do_not_touch_have_the_solution_of_the_whole() {
        let a = m(
            4,
            4,
            &[1.1, 0.0, 0.2, 0.0, 0.0, 0.8, 0.0, 0.0, 0.1, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 1.3],
        );
        let b = m(
            4,
            4,
            &[0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0],
        );
        let n = m(
            4,
            4,
            &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        let r = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1.0, 2.0, 0.5, 3.0]));
        let turn =
            DMatrix::from_fn(4, 4, |i, j| (1.0 + i as f64 + 2.3 * (j * j) as f64).sin()).qr().q();
        let (q, back) = (identity(4), turn.transpose());
        let parts = dlqr(&a, &b, &q, &r, Some(&n)).unwrap();
        let whole =
            dlqr(&(&turn * &a * &back), &(&turn * &b), &q, &r, Some(&(&turn * &n))).unwrap();
        assert_abs_diff_eq!(parts.k, &whole.k * &turn, epsilon = 1e-13);
        assert_abs_diff_eq!(parts.x, &back * &whole.x * &turn, epsilon = 1e-12);
        let sum = |poles: &[Complex<f64>]| poles.iter().sum::<Complex<f64>>();
        assert_eq!(parts.poles.len(), 4);
        assert_abs_diff_eq!(sum(&parts.poles).re, sum(&whole.poles).re, epsilon = 1e-13);
        assert!(parts.k.row(1).iter().all(|k| *k == 0.0));
    }

    /// A part without a solution gives the error of the whole.
    #[test]
    fn an_input_without_cost_is_named_in_a_part_too() {
        let r = m(2, 2, &[1.0, 0.0, 0.0, -2.0]);
        let error = dlqr(&identity(2), &m(2, 2, &[1.0, 0.0, 0.0, 0.0]), &identity(2), &r, None)
            .unwrap_err();
        assert!(matches!(error, ModelError::WeightR { smallest } if smallest == -2.0), "{error}");
    }

    #[test]
    fn an_input_without_cost_is_named() {
        // An input without effect has no optimal gain at zero cost; a negative cost has none either.
        for (b, r) in [(0.0, 0.0), (1.0, -1.0)] {
            let (half, b) = (m(1, 1, &[0.5]), m(1, 1, &[b]));
            let error = dlqr(&half, &b, &identity(1), &m(1, 1, &[r]), None).unwrap_err();
            assert!(matches!(error, ModelError::WeightR { smallest } if smallest == r), "{error}");
        }
    }

    /// R singular, R + BᵀXB regular: deadbeat and a chain of three, by hand.
    #[test]
    fn inputs_that_cost_only_what_they_move_are_solved() {
        let one = identity(1);
        let deadbeat = dlqr(&m(1, 1, &[1.7]), &one, &one, &m(1, 1, &[0.0]), None).unwrap();
        assert_abs_diff_eq!(deadbeat.x[(0, 0)], 1.0, epsilon = 1e-14);
        assert_abs_diff_eq!(deadbeat.k[(0, 0)], 1.7, epsilon = 1e-14);
        let (a, b) = (
            m(3, 3, &[0.0, 0.1, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0]),
            m(3, 2, &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        );
        let q = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1e5, 1e3, 10.0]));
        let found = dlqr(&a, &b, &q, &m(2, 2, &[0.0, 0.0, 0.0, 1.0]), None).unwrap();
        // x₁₁ = q₁₁, x₂₂ = q₂₂ (the first input cancels the change of x₁), x₃₃ = q₃₃ + 0.01²·x₂₂.
        let mut by_hand = q.clone();
        by_hand[(2, 2)] = 10.1;
        assert_abs_diff_eq!(found.x, by_hand, epsilon = 1e-10);
    }

    #[test]
    fn the_generalised_equation_holds_on_drawn_plants() {
        let entry = |seed: usize| {
            move |i: usize, j: usize| {
                (1.3 + seed as f64 + 2.1 * i as f64 + 3.7 * (j * j) as f64).sin()
            }
        };
        for (n, inputs) in [(1, 1), (2, 1), (3, 2), (5, 2)] {
            let (a, b) = (DMatrix::from_fn(n, n, entry(1)), DMatrix::from_fn(n, inputs, entry(2)));
            let e = identity(n) * 2.0 + DMatrix::from_fn(n, n, entry(3)) * 0.4;
            let s = DMatrix::from_fn(n, inputs, entry(4)) * 0.1;
            let mut r = identity(inputs);
            r[(0, 0)] = if inputs > 1 { 0.0 } else { 1.0 };
            let s = if inputs > 1 { s * 0.0 } else { s };
            let q = identity(n);
            let found = gdare(&a, &b, &q, &r, Some(&s), &e).unwrap();
            let x = &found.x;
            let k = (&r + b.transpose() * x * &b)
                .lu()
                .solve(&(b.transpose() * x * &a + s.transpose()))
                .unwrap();
            let left = a.transpose() * x * &a
                - e.transpose() * x * &e
                - (a.transpose() * x * &b + &s) * &k
                + &q;
            assert!(left.norm() < 1e-12 * (1.0 + x.norm()), "{n}: {left}");
            assert_abs_diff_eq!(found.k, k, epsilon = 1e-11);
            let poles = zeros::eigenvalues(&(e.lu().solve(&(&a - &b * &found.k)).unwrap()));
            assert!(poles.iter().all(|p| p.norm() < 1.0), "{n}");
        }
    }

    #[test]
    fn shapes_symmetry_and_numbers_are_checked() {
        let (one, two) = (identity(1), identity(2));
        assert!(matches!(
            dare(&two, &one, &two, &one, None),
            Err(ModelError::Shape { matrix: "B", .. })
        ));
        assert!(matches!(
            dare(&m(1, 2, &[1.0, 1.0]), &one, &one, &one, None),
            Err(ModelError::Shape { matrix: "A", .. })
        ));
        assert!(matches!(
            dare(&one, &one, &one, &one, Some(&two)),
            Err(ModelError::Shape { matrix: "N", .. })
        ));
        let skew = m(2, 2, &[1.0, 0.5, 0.0, 1.0]);
        assert!(matches!(
            dare(&two, &two, &skew, &two, None),
            Err(ModelError::NotSymmetric { matrix: "Q", row: 1, column: 2, .. })
        ));
        assert!(matches!(
            dare(&two, &two, &two, &skew, None),
            Err(ModelError::NotSymmetric { matrix: "R", .. })
        ));
        let nan = m(1, 1, &[f64::NAN]);
        assert!(matches!(
            dare(&nan, &one, &one, &one, None),
            Err(ModelError::NotFinite { matrix: "A", row: 1, column: 1, .. })
        ));
    }

    #[test]
    fn an_unstable_mode_without_cost_is_reflected_into_the_circle() {
        let solution =
            dlqr(&m(1, 1, &[2.0]), &identity(1), &m(1, 1, &[0.0]), &identity(1), None).unwrap();
        assert_abs_diff_eq!(solution.poles[0].re, 0.5, epsilon = 1e-12);
        assert_abs_diff_eq!(solution.x[(0, 0)], 3.0, epsilon = 1e-12);
    }

    /// With R = 1 and a = 2 the stationary point for Q = −100 has a stable loop. The point is a maximum, because R + BᵀXB < 0.
    #[test]
    fn a_stationary_point_that_is_no_minimum_is_refused() {
        let error = dare(&m(1, 1, &[2.0]), &identity(1), &m(1, 1, &[-100.0]), &identity(1), None)
            .unwrap_err();
        assert!(matches!(error, ModelError::Indefinite { .. }), "{error}");
    }
}

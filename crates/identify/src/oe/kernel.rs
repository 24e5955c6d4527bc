//! A fast kernel for the most frequent model, y = b/(1 + f₁q⁻¹ + f₂q⁻²) u(t − nk).

use nalgebra::{DMatrix, DVector};
use pulp::{Simd, WithSimd};

use super::work::Work;
use crate::regression::dot;
use deadtime_signal::fit::Normal;

/// One evaluation of y = b/(1 + f₁q⁻¹ + f₂q⁻²) u(t − nk), in two passes over the records. The kernel returns cost, gradient, and exact second derivatives
/// instead of the Gauss-Newton approximation. At a wrong delay residuals are large, and the approximation converges slowly.
pub(super) struct SecondOrder<'a, 'b> {
    pub(super) records: &'a mut [Work<'b>],
    pub(super) nk: usize,
    pub(super) f1: f64,
    pub(super) f2: f64,
    pub(super) power: f64,
    pub(super) limit: f64,
    pub(super) exact: bool,
}

impl WithSimd for SecondOrder<'_, '_> {
    type Output = Option<Normal>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<Normal> {
        // Fused multiply-add where the processor has it (always with vectors of four): it halves the latency of the recursion.
        let fused =
            |a: f64, b: f64, c: f64| if S::F64_LANES >= 4 { a.mul_add(b, c) } else { a * b + c };
        let Self { records, nk, f1, f2, power, limit, exact: wanted } = self;
        let (mut gram, mut right) = (0.0, 0.0);
        for work in records.iter_mut() {
            let delayed = work.y.get(nk..).unwrap_or_default();
            let (mut x1, mut x2) = (0.0, 0.0);
            for ((to, &u), &y) in work.uf.iter_mut().zip(work.u).zip(delayed) {
                let x = fused(-f1, x1, fused(-f2, x2, u));
                (x2, x1) = (x1, x);
                *to = x;
                gram = fused(x, x, gram);
                right = fused(x, y, right);
            }
        }
        // As in `project`.
        let ridged = gram + (1e-13 * gram + f64::MIN_POSITIVE);
        let b = right / ridged;
        // By Pythagoras, with a margin for its rounding.
        if power - b * right > limit + 1e-9 * power {
            return None;
        }
        let (mut cost, mut gradient, mut information, mut cross, mut bend) =
            (0.0, [0.0; 2], [0.0; 3], [0.0; 2], [0.0; 3]);
        for work in records.iter() {
            let (before, delayed) = work.y.split_at(nk.min(work.y.len()));
            cost += dot(before, before);
            let (mut w1, mut w2) = (0.0, 0.0);
            let (mut z1, mut z2, mut z3, mut z4) = (0.0, 0.0, 0.0, 0.0);
            for (&x, &y) in work.uf.iter().zip(delayed) {
                let model = b * x;
                let r = y - model;
                cost = fused(r, r, cost);
                gradient[0] = fused(w1, r, gradient[0]);
                gradient[1] = fused(w2, r, gradient[1]);
                information[0] = fused(w1, w1, information[0]);
                information[1] = fused(w1, w2, information[1]);
                information[2] = fused(w2, w2, information[2]);
                cross[0] = fused(x, w1, cross[0]);
                cross[1] = fused(x, w2, cross[1]);
                bend[0] = fused(r, z2, bend[0]);
                bend[1] = fused(r, z3, bend[1]);
                bend[2] = fused(r, z4, bend[2]);
                let w = fused(-f1, w1, fused(-f2, w2, model));
                let z = fused(-f1, z1, fused(-f2, z2, w));
                (w2, w1) = (w1, w);
                (z4, z3, z2, z1) = (z3, z2, z1, z);
            }
        }
        if !ridged.is_finite() {
            return None;
        }
        let sums = Sums { gradient, information, cross, bend };
        let information = sums.curvature(b, ridged, wanted);
        Some(Normal { cost, gradient: DVector::from_column_slice(&gradient), information })
    }
}

/// The sums of the second pass: residual and model by the derivatives of F.
struct Sums {
    gradient: [f64; 2],
    information: [f64; 3],
    cross: [f64; 2],
    bend: [f64; 3],
}

impl Sums {
    /// Half the second derivatives by b and F, with b eliminated; under negative curvature, only the product of first derivatives.
    #[inline(always)]
    fn curvature(&self, b: f64, ridged: f64, wanted: bool) -> DMatrix<f64> {
        let Self { gradient, information, cross, bend } = self;
        let mixed = |i: usize| gradient[i] / b - cross[i];
        let exact = |i: usize, j: usize| {
            information[i + j] - 2.0 * bend[i + j] - mixed(i) * mixed(j) / ridged
        };
        let projected = |i: usize, j: usize| information[i + j] - cross[i] * cross[j] / ridged;
        let upwards = wanted
            && exact(0, 0) > 0.0
            && exact(0, 0) * exact(1, 1) - exact(0, 1).powi(2) > CURVED * exact(0, 0) * exact(1, 1);
        if upwards { DMatrix::from_fn(2, 2, exact) } else { DMatrix::from_fn(2, 2, projected) }
    }
}

/// A curvature matrix is not inverted if its determinant is below this share of its diagonal's product.
const CURVED: f64 = 1e-9;

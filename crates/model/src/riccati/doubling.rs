//! The structure-preserving doubling shared by the discrete and the continuous equation.

use nalgebra::allocator::Allocator;
use nalgebra::{Const, DMatrix, DefaultAllocator, DimMin, OMatrix};

/// The smallest nonnegative solution for A, G = BR⁻¹Bᵀ and Q, by doubling: the stabilising one where Q observes every unstable mode.
///
/// A small number of states is fixed at compile time, which takes 1/3 of the run time for three states and 1/2 for nine.
pub(super) fn doubling(
    a: &DMatrix<f64>,
    g: &DMatrix<f64>,
    q: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    match a.nrows() {
        1 => doubling_of::<1>(a, g, q),
        2 => doubling_of::<2>(a, g, q),
        3 => doubling_of::<3>(a, g, q),
        4 => doubling_of::<4>(a, g, q),
        5 => doubling_of::<5>(a, g, q),
        6 => doubling_of::<6>(a, g, q),
        7 => doubling_of::<7>(a, g, q),
        8 => doubling_of::<8>(a, g, q),
        9 => doubling_of::<9>(a, g, q),
        _ => doubled(a.clone(), g.clone(), q.clone()),
    }
}

fn doubling_of<const N: usize>(
    a: &DMatrix<f64>,
    g: &DMatrix<f64>,
    q: &DMatrix<f64>,
) -> Option<DMatrix<f64>>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    let [a, g, q] = [a, g, q].map(|m| m.fixed_view::<N, N>(0, 0).into_owned());
    doubled(a, g, q).map(|x| DMatrix::from_column_slice(N, N, x.as_slice()))
}

/// As [`doubling`], for any size.
fn doubled<D>(
    mut ak: OMatrix<f64, D, D>,
    mut gk: OMatrix<f64, D, D>,
    mut hk: OMatrix<f64, D, D>,
) -> Option<OMatrix<f64, D, D>>
where
    D: DimMin<D, Output = D>,
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let symmetric = |m: OMatrix<f64, D, D>| (&m + m.transpose()) * 0.5;
    for _ in 0..60 {
        let mut w = &gk * &hk;
        for i in 0..w.nrows() {
            w[(i, i)] += 1.0;
        }
        let w = w.lu();
        let (mut wa, mut wg) = (ak.clone(), gk.clone());
        if !(w.solve_mut(&mut wa) && w.solve_mut(&mut wg)) {
            return None;
        }
        let step = symmetric(ak.tr_mul(&(&hk * &wa)));
        gk += symmetric(&ak * wg * ak.transpose());
        ak = &ak * wa;
        hk += &step;
        let norm = hk.norm();
        if !norm.is_finite() {
            return None;
        }
        // The next step is AᵀH(I + GH)⁻¹A, bounded by AᵀHA.
        if step.norm() <= 1e-16 * norm || ak.norm_squared() <= 1e-16 {
            return Some(hk);
        }
    }
    None
}

//! The largest chordal distance of the responses over the band: the nu-gap where the two models wind alike, for models of any poles.
//!
//! Equation:  min_θ max_ω σmax((I + G G*)^(−1/2) (G − Ĝ) (I + Ĝ* Ĝ)^(−1/2))
//! Fails when: both gains are large (or small) everywhere: then all pairs are far apart (or near), and the channels want other units.
//! Source: Vinnicombe (1993), IEEE Trans. Automat. Contr. 38(9), 1371-1383.

use nalgebra::{Complex, DMatrix, SymmetricEigen};

use super::criterion::{At, Norm, TO_THE_LARGEST};
use crate::matching::system::Response;

pub(super) const NU_GAP: Norm = Norm {
    name: "nu-gap",
    summary: "largest chordal distance within the band: what a controller cannot tell apart",
    difference,
    powers: TO_THE_LARGEST,
};

fn difference(at: &At, structured: &Response) -> Response {
    let target = &at.target;
    shrunk(structured * structured.adjoint())
        * (structured - target)
        * shrunk(target.adjoint() * target)
}

/// (I + M)^(−1/2) of a Hermitian M.
fn shrunk(m: Response) -> Response {
    let eigen = SymmetricEigen::new(m);
    let roots = eigen.eigenvalues.map(|v| Complex::new(1.0 / (1.0 + v.max(0.0)).sqrt(), 0.0));
    &eigen.eigenvectors * DMatrix::from_diagonal(&roots) * eigen.eigenvectors.adjoint()
}

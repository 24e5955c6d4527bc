//! Weighted least squares: every entry at every frequency in its own standard deviations, or in shares of its magnitude where none are known.
//!
//! Equation:  min_θ Σ_k s_k Σ_ij |w_ij(ω_k) (G_ij(ω_k, θ) − Ĝ_ij(ω_k))|², s_k the share of ω_k in the band's logarithm
//! Source: Pintelon and Schoukens (2012), System Identification: A Frequency Domain Approach, 2nd ed., chapter 9, doi:10.1002/9781118287422.

use super::criterion::{At, Norm};
use crate::matching::system::Response;

pub(super) const WLS: Norm = Norm {
    name: "wls",
    summary: "weighted least squares: by standard deviations, or relative where none are known",
    difference,
    powers: &[2.0],
};

fn difference(at: &At, structured: &Response) -> Response {
    let scale = (at.share / at.target.len() as f64).sqrt();
    (structured - &at.target).zip_map(&at.weight, |d, w| d * (w * scale))
}

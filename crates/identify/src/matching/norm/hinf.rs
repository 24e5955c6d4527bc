//! The H-infinity norm of the difference over the band: its largest gain in any direction, whatever the poles.
//!
//! Equation:  min_θ max_ω σmax(G(ω, θ) − Ĝ(ω)), by (Σ_k Σ_i σ_i(ω_k)^p)^(1/p) with p doubled from 2 to 512
//! Source: the thesis' criterion (Fumai's PBSID-H∞); Charalambous and Bandler (1976), "Non-linear minimax optimization as a sequence of least pth optimization
//! with finite values of p", doi:10.1080/00207727608941924.

use super::criterion::{At, Norm, TO_THE_LARGEST};
use crate::matching::system::Response;

pub(super) const HINF: Norm = Norm {
    name: "hinf",
    summary: "largest gain of the difference within the band",
    difference,
    powers: TO_THE_LARGEST,
};

fn difference(at: &At, structured: &Response) -> Response {
    structured - &at.target
}

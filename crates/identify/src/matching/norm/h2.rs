//! The H2 norm of the difference over the band: the energy of its impulse response there.
//!
//! Equation:  ‖Δ‖² = (Ts)/π ∫ ‖Δ(ω)‖_F² dω, by the trapezoidal rule (Ts for sampled models, 1 for continuous ones)
//! Source: Zhou, Doyle and Glover (1996), Robust and Optimal Control, section 4.3.

use super::criterion::{At, Norm};
use crate::matching::system::Response;

pub(super) const H2: Norm = Norm {
    name: "h2",
    summary: "energy of the difference's impulse response within the band",
    difference,
    powers: &[2.0],
};

fn difference(at: &At, structured: &Response) -> Response {
    let scale = (at.step_s * at.width_rad_s / std::f64::consts::PI).sqrt();
    (structured - &at.target) * nalgebra::Complex::new(scale, 0.0)
}

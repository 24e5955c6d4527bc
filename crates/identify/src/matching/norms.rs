//! Norms of the difference of two responses.

use deadtime_signal::decompositions::symmetric_eigen;
use nalgebra::{Complex, DMatrix};

use super::system::GainMatrix;
use deadtime_signal::registry::RegistryError;

/// The data at a frequency.
pub(crate) struct At {
    /// The identified model's response.
    pub(crate) target: GainMatrix,
    /// One over the error of each entry: its standard deviation, or its magnitude where that is unknown.
    pub(crate) weight: DMatrix<f64>,
    /// The frequency's share of the band on a logarithmic scale; the shares add up to 1.
    pub(crate) share: f64,
    /// The width of the band that it represents, rad/s, by the trapezoidal rule.
    pub(crate) width_rad_s: f64,
    /// The sample time, s; 1 in continuous time.
    pub(crate) step_s: f64,
}

/// A norm of the difference of two responses.
pub struct Norm {
    /// The name in the command line.
    pub name: &'static str,
    /// A summary in one line.
    pub summary: &'static str,
    /// The matrix to minimise at one frequency; 0 for equal responses.
    pub(crate) difference: fn(&At, &GainMatrix) -> GainMatrix,
    /// Powers for the sum of the differences' singular values, one search after the other: 2 is least squares, the last one approximates the maximum.
    pub(crate) powers: &'static [f64],
}

/// Every norm; the first is the default.
pub const NORMS: &[Norm] = &[WLS, H2, HINF, NU_GAP];

/// The norm called `name`.
///
/// # Errors
/// [`RegistryError::Unknown`], with the known names.
pub fn norm(name: &str) -> Result<&'static Norm, RegistryError> {
    NORMS.iter().find(|n| n.name == name).ok_or_else(|| RegistryError::Unknown {
        kind: "norm",
        name: name.to_owned(),
        known: NORMS.iter().map(|n| n.name).collect(),
    })
}

/// From least squares to the largest value. The sum of a large power exceeds the maximum by at most a factor of the 512th root of the number of values.
const TO_THE_LARGEST: &[f64] = &[2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

/// Weighted least squares: every entry at every frequency in units of its own standard deviation, or of its magnitude where that is unknown.
///
/// Equation: min_θ Σ_k s_k Σ_ij |w_ij(ω_k) (G_ij(ω_k, θ) − Ĝ_ij(ω_k))|², s_k the share of ω_k in the band's logarithm.
/// Source: Pintelon and Schoukens (2012), System Identification: A Frequency Domain Approach, 2nd
/// ed., chapter 9, doi:10.1002/9781118287422.
const WLS: Norm = Norm {
    name: "wls",
    summary: "weighted least squares: by standard deviations, or relative where none are known",
    difference: wls,
    powers: &[2.0],
};

fn wls(at: &At, structured: &GainMatrix) -> GainMatrix {
    let scale = (at.share / at.target.len() as f64).sqrt();
    (structured - &at.target).zip_map(&at.weight, |d, w| d * (w * scale))
}

/// The H2 norm of the difference over the band: the energy of its impulse response there.
///
/// Equation: ‖Δ‖² = (Ts)/π ∫ ‖Δ(ω)‖_F² dω, by the trapezoidal rule (Ts for sampled models, 1 for continuous ones).
/// Source: Zhou, Doyle and Glover (1996), Robust and Optimal Control, section 4.3.
const H2: Norm = Norm {
    name: "h2",
    summary: "energy of the difference's impulse response within the band",
    difference: h2,
    powers: &[2.0],
};

fn h2(at: &At, structured: &GainMatrix) -> GainMatrix {
    let scale = (at.step_s * at.width_rad_s / std::f64::consts::PI).sqrt();
    (structured - &at.target) * Complex::new(scale, 0.0)
}

/// The H-infinity norm of the difference over the band: its largest gain in any direction, for any poles.
///
/// Equation: min_θ max_ω σmax(G(ω, θ) − Ĝ(ω)), by (Σ_k Σ_i σ_i(ω_k)^p)^(1/p) with p doubled from 2 to 512.
/// Source: the thesis' criterion (Fumai's PBSID-H∞). Charalambous and Bandler (1976), "Non-linear minimax optimization as a sequence of least pth optimization
/// with finite values of p", doi:10.1080/00207727608941924.
const HINF: Norm = Norm {
    name: "hinf",
    summary: "largest gain of the difference within the band",
    difference: hinf,
    powers: TO_THE_LARGEST,
};

fn hinf(at: &At, structured: &GainMatrix) -> GainMatrix {
    structured - &at.target
}

/// The largest chordal distance of the responses over the band: the nu-gap for models of equal winding number, with any poles.
///
/// Equation: min_θ max_ω σmax((I + G G*)^(−1/2) (G − Ĝ) (I + Ĝ* Ĝ)^(−1/2)).
/// Fails when: both gains are large (or small) everywhere: all pairs are then far apart (or near), and the channels need other units.
/// Source: Vinnicombe (1993), IEEE Trans. Automat. Contr. 38(9), 1371-1383.
const NU_GAP: Norm = Norm {
    name: "nu-gap",
    summary: "largest chordal distance within the band: what is the same for a controller",
    difference: nu_gap,
    powers: TO_THE_LARGEST,
};

fn nu_gap(at: &At, structured: &GainMatrix) -> GainMatrix {
    let target = &at.target;
    shrunk(structured * structured.adjoint())
        * (structured - target)
        * shrunk(target.adjoint() * target)
}

/// (I + M)^(−1/2) of a Hermitian M.
fn shrunk(m: GainMatrix) -> GainMatrix {
    let (rows, columns) = m.shape();
    let Some(eigen) = symmetric_eigen(&m) else {
        return DMatrix::from_element(rows, columns, Complex::new(f64::NAN, f64::NAN));
    };
    let roots = eigen.eigenvalues.map(|v| Complex::new(1.0 / (1.0 + v.max(0.0)).sqrt(), 0.0));
    &eigen.eigenvectors * DMatrix::from_diagonal(&roots) * eigen.eigenvectors.adjoint()
}

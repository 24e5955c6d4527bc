//! By what two responses are compared: one file a norm, one line each in [`NORMS`].

mod h2;
mod hinf;
mod nu_gap;
mod wls;

use nalgebra::DMatrix;

use super::system::Response;
use deadtime_signal::registry::RegistryError;

/// What is known at a frequency.
pub(super) struct At {
    /// The identified model's response.
    pub(super) target: Response,
    /// One over the size of an error of each entry: its standard deviation, or where none is known its magnitude.
    pub(super) weight: DMatrix<f64>,
    /// The frequency's share of the band on a logarithmic scale; the shares add up to 1.
    pub(super) share: f64,
    /// The part of the band that it stands for, rad/s, by the trapezoidal rule.
    pub(super) width_rad_s: f64,
    /// The sample time, s; 1 in continuous time.
    pub(super) step_s: f64,
}

/// A way to compare two responses.
pub struct Norm {
    /// The name that the command line uses.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// What is to be small at one frequency; 0 where the two are equal.
    pub(super) difference: fn(&At, &Response) -> Response,
    /// The differences' singular values are summed in these powers, one search after the other: 2 is least squares, the last one stands for the largest.
    pub(super) powers: &'static [f64],
}

/// Every norm; the first is the default.
pub const NORMS: &[Norm] = &[wls::WLS, h2::H2, hinf::HINF, nu_gap::NU_GAP];

/// From least squares to the largest value: a large power of many values is their largest but for less than the hundredth root of their number.
const TO_THE_LARGEST: &[f64] = &[2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

/// The norm called `name`.
///
/// # Errors
/// [`RegistryError::Unknown`], with the names there are.
pub fn norm(name: &str) -> Result<&'static Norm, RegistryError> {
    NORMS.iter().find(|n| n.name == name).ok_or_else(|| RegistryError::Unknown {
        kind: "norm",
        name: name.to_owned(),
        known: NORMS.iter().map(|n| n.name).collect(),
    })
}

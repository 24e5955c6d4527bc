//! The list of norms.

use super::criterion::Norm;
use super::{h2, hinf, nu_gap, wls};
use deadtime_signal::registry::RegistryError;

/// Every norm; the first is the default.
pub const NORMS: &[Norm] = &[wls::WLS, h2::H2, hinf::HINF, nu_gap::NU_GAP];

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

//! The list of excitations.

use super::chirp::Chirp;
use super::doublet::Doublet;
use super::generator::Excitation;
use super::impulse::Impulse;
use super::multisine::Multisine;
use super::prbs::Prbs;
use super::rbs::Rbs;
use super::staircase::Staircase;
use super::step::Step;
use super::three_two_one_one::ThreeTwoOneOne;
use super::two_ramps::TwoRamps;
use crate::registry::{self, Entry, RegistryError, entry};

/// Every excitation there is.
pub const EXCITATIONS: &[Entry<dyn Excitation>] = &[
    entry!(
        "two_ramps",
        "two ramps, up and down again, then zero (the thesis' algorithm 4.1)",
        TwoRamps
    ),
    entry!("impulse", "one sample that is not zero", Impulse),
    entry!("step", "zero, then a constant", Step),
    entry!("rbs", "random binary signal with a frequency band, as MATLAB's idinput makes it", Rbs),
    entry!("prbs", "pseudo-random binary sequence of a maximum-length shift register", Prbs),
    entry!(
        "multisine",
        "sum of harmonics with a flat spectrum, Schroeder or random phases",
        Multisine
    ),
    entry!("chirp", "sine whose frequency sweeps linearly or logarithmically", Chirp),
    entry!("staircase", "levels, each held for a number of samples", Staircase),
    entry!("doublet", "a pulse up, then the same pulse down", Doublet),
    entry!(
        "three_two_one_one",
        "pulses of 3, 2, 1 and 1 units of alternating sign",
        ThreeTwoOneOne
    ),
];

/// The excitation called `name`.
///
/// # Errors
/// [`RegistryError::Unknown`], with the names there are.
///
/// # Example
/// ```
/// use deadtime_signal::excitation::by_name;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let prbs = by_name("prbs")?.with(serde_json::json!({ "order": 3 }))?;
/// let u = prbs.generate(7, &mut ChaCha8Rng::seed_from_u64(1))?;
/// assert_eq!(u.iter().sum::<f64>(), 1.0); // four of seven are high
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn by_name(name: &str) -> Result<&'static Entry<dyn Excitation>, RegistryError> {
    registry::find(EXCITATIONS, "excitation", name)
}

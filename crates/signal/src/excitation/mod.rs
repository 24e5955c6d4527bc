//! Signals that excite a system so that its response is informative. One file per signal, one line in [`EXCITATIONS`].

mod check;
mod chirp;
mod doublet;
pub(crate) mod excitations;
pub(crate) mod generator;
mod impulse;
mod multisine;
mod prbs;
mod rbs;
mod staircase;
mod step;
mod three_two_one_one;
mod two_ramps;

pub use chirp::{Chirp, Sweep};
pub use doublet::Doublet;
pub use excitations::{EXCITATIONS, by_name};
pub use generator::Excitation;
pub use impulse::Impulse;
pub use multisine::{Harmonics, Multisine, Normalise, Phase};
pub use prbs::{Prbs, RegisterStart};
pub use rbs::Rbs;
pub use staircase::Staircase;
pub use step::Step;
pub use three_two_one_one::ThreeTwoOneOne;
pub use two_ramps::TwoRamps;

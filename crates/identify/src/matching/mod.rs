//! Free parameters of a structured model from an identified one, by frequency: the second step of the thesis' way from a flight to physical parameters.
//!
//! Equation:  θ̂ = argmin_θ ‖W(G(θ) − Ĝ)‖ over a band; the norms are listed in [`NORMS`]
//!
//! The structured model (equations, linearised at an operating point) is sampled behind a zero-order hold where the identified one is sampled, so that what is
//! compared is what was recorded; dead times are part of both responses.
//! Assumes: inputs that are held between samples; a linearisation that holds for the flights.
//! How it can be wrong: another minimum (several starts, and how many of them agree), a band in which the structure cannot follow (the largest difference is reported, in
//! standard deviations where they are known), parameters that act together only (the null space is reported), intervals that know nothing of a wrong structure or of
//! the identified model's bias, models of unlike stability with responses that are near (the nu-gap tells).
//! Fails when: a pole lies on a frequency of the band; the identified model has other channels or units.
//! Source: the thesis' PBSID-H∞ (Fumai), after Bergamasco and Lovera (2013), "State space model identification: from unstructured to structured models with an H∞
//! approach", for the criterion; Charalambous and Bandler (1976), doi:10.1080/00207727608941924, for the search.

pub(crate) mod error;
mod evidence;
mod fit;
mod grid;
mod norms;
mod options;
mod prior;
mod problem;
mod structure;
mod system;
mod target;

pub use error::MatchingError;
pub use fit::{Compared, ComparedPoint, Gain, Matched, MatchedParameter, Misfit};
pub use norms::{NORMS, Norm, norm};
pub use options::Matching;
pub use target::Target;

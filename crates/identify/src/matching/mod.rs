//! Free parameters of a structured model from an identified one, by frequency: the second step of the thesis from a flight to physical parameters.
//!
//! Equation:  θ̂ = argmin_θ ‖W(G(θ) − Ĝ)‖ over a band; the norms are listed in [`NORMS`]
//!
//! The structured model (equations, linearised at an operating point) is sampled behind a zero-order hold if the identified one is sampled. Both responses
//! include dead times, so the comparison is that of the record.
//! Assumes: inputs held between samples; a linearisation valid for the flights. How it can be wrong: another minimum; several starts are used, and their
//! agreement is reported. A band in which the structure cannot follow; the largest difference is reported, in standard deviations where known. Parameters that
//! act only jointly; the null space is reported. Intervals ignore a wrong structure and the identified model's bias. Models of different stability can have
//! similar responses; the nu-gap reveals them.
//! Fails when: a pole lies on a frequency of the band; the identified model has other channels or units.
//! Source: the thesis' PBSID-H∞ (Fumai). For the criterion after Bergamasco and Lovera (2013), "State space model identification: from unstructured to
//! structured models with an H∞ approach". For the search Charalambous and Bandler (1976), doi:10.1080/00207727608941924.

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

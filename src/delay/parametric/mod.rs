//! Sampled models of low order, the delay a parameter of theirs.

pub(super) mod arxstruc;
pub(super) mod delayest;
pub(super) mod elnaggar;
pub(super) mod oe_posterior;
pub(super) mod oestruc;
mod profile;
pub(super) mod sampling_zero;
pub(super) mod two_step;

pub use arxstruc::Arxstruc;
pub use delayest::Delayest;
pub use elnaggar::{Cost, Elnaggar};
pub use oe_posterior::{Center, OePosterior};
pub use oestruc::Oestruc;
pub use sampling_zero::SamplingZero;
pub use two_step::TwoStep;

//! Several causes at once: effects added one at a time, everything refitted together.

mod additions;
pub(crate) mod composed;
mod composer;
mod exchange;
mod gate;
mod recalibration;
mod standing;
mod weak;

//! Several causes at once: effects added one at a time, everything refitted together.

pub(in crate::diagnose) mod composer;
pub(in crate::diagnose) mod gate;
mod standing;

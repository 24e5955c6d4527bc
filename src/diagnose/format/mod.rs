//! The diagnosis as data, and what is said beside it: caveats, errors, progress.

pub(in crate::diagnose) mod caveat;
pub(in crate::diagnose) mod contributions;
pub(in crate::diagnose) mod diagnosis;
pub(in crate::diagnose) mod error;
pub(in crate::diagnose) mod found;
pub(in crate::diagnose) mod nuisance;
pub(in crate::diagnose) mod place;
pub(in crate::diagnose) mod progress;

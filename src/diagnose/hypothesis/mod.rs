//! Effects with parameters: their fit, the commands that they lose, and what they gain once the search is paid for.

pub(in crate::diagnose) mod arrivals;
pub(in crate::diagnose) mod direction;
pub(in crate::diagnose) mod dropouts;
pub(in crate::diagnose) mod effects;
pub(in crate::diagnose) mod fit;
pub(in crate::diagnose) mod level;
pub(in crate::diagnose) mod penalised_gain;
mod queue;
pub(in crate::diagnose) mod refine;
mod response;
pub(in crate::diagnose) mod sequence;
mod skyline;
pub(in crate::diagnose) mod slopes;
pub(in crate::diagnose) mod waits;

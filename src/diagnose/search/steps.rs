//! How long fits of a search go on.

/// Steps of a full fit, and of a fit that starts where another ended.
pub(in crate::diagnose) const STEPS: usize = 15;
/// Steps after which all but the best pairs are given up, and how many are left then.
pub(in crate::diagnose) const TRIAL: (usize, usize) = (3, 8);

//! Effects with parameters: their fit, their lost commands, and their gain less the price of the search.

mod arrival_equations;
mod arrival_law;
pub(crate) mod arrivals;
pub(crate) mod direction;
pub(crate) mod dropouts;
pub(crate) mod effects;
pub(crate) mod event;
pub(crate) mod fit;
pub(crate) mod level;
pub(crate) mod penalised_gain;
mod queue;
pub(crate) mod refine;
mod response;
pub(crate) mod sequence;
pub(crate) mod shared_time;
mod skyline;
pub(crate) mod slopes;
pub(crate) mod waits;

//! The inputs of a diagnosis: the simulator, its logs and their division.

pub(crate) mod black_box;
pub(crate) mod budget;
pub(crate) mod cost;
pub(crate) mod criteria;
pub(crate) mod first_part;
pub(crate) mod inputs;
pub(crate) mod log_caveats;
pub(crate) mod nuisance;
pub(crate) mod options;
pub(crate) mod poles;
pub(crate) mod record;
pub(crate) mod restart;
pub(crate) mod spans;
pub(crate) mod subject;

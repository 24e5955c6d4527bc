//! What a diagnosis begins with: the simulator, its logs and how they are divided.

pub(in crate::diagnose) mod black_box;
pub(in crate::diagnose) mod budget;
pub(in crate::diagnose) mod criteria;
pub(in crate::diagnose) mod first_part;
pub(in crate::diagnose) mod inputs;
pub(in crate::diagnose) mod log_caveats;
pub(in crate::diagnose) mod nuisance;
pub(in crate::diagnose) mod options;
pub(in crate::diagnose) mod poles;
pub(in crate::diagnose) mod record;
pub(in crate::diagnose) mod restart;
pub(in crate::diagnose) mod spans;
pub(in crate::diagnose) mod subject;

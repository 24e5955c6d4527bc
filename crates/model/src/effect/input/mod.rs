//! Effects between a command in the log and the plant.

pub(super) mod actuator_lag;
pub(super) mod backlash;
pub(super) mod curve;
pub(super) mod deadband;
pub(super) mod delay;
pub(super) mod delay_drift;
pub(super) mod delay_jitter;
pub(super) mod delay_jump;
pub(super) mod dropped_commands;
pub(super) mod gain;
pub(super) mod gain_fade;
pub(super) mod gain_jump;
pub(super) mod multi_rate;
pub(super) mod offset;
pub(super) mod rate_limit;
pub(super) mod saturation;
pub(super) mod swapped_inputs;

//! Effects in the plant's differential equations.

pub(super) mod candidate;
pub(super) mod constant_disturbance;
pub(super) mod coulomb_friction;
pub(super) mod cross_coupling;
pub(super) mod cubic_stiffness;
pub(super) mod driveline_backlash;
pub(super) mod driveline_friction;
pub(super) mod exchange;
pub(super) mod hysteresis;
mod internal;
pub(super) mod internal_deadband;
pub(super) mod internal_delay;
pub(super) mod internal_lag;
pub(super) mod internal_saturation;
pub(super) mod parameter_error;
pub(super) mod parameter_jump;
pub(super) mod periodic_disturbance;
pub(super) mod quadratic_drag;
pub(super) mod stribeck_friction;
pub(super) mod unmodelled_mode;

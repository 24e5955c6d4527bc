//! Effects in the plant's differential equations.

pub(super) mod candidate;
pub(super) mod constant_disturbance;
pub(super) mod coulomb_friction;
pub(super) mod cross_coupling;
pub(super) mod cubic_stiffness;
pub(super) mod exchange;
pub(super) mod hysteresis;
pub(super) mod parameter_error;
pub(super) mod parameter_jump;
pub(super) mod periodic_disturbance;
pub(super) mod quadratic_drag;
pub(super) mod stribeck_friction;
pub(super) mod unmodelled_mode;

//! Effects between the plant and an output in the log.

pub(super) mod delay;
pub(super) mod misalignment;
pub(super) mod output_backlash;
pub(super) mod sensor_bias;
pub(super) mod sensor_drift;
pub(super) mod sensor_gain;
pub(super) mod sensor_lag;
pub(super) mod sensor_quantisation;
pub(super) mod sensor_saturation;
pub(super) mod static_nonlinearity;
pub(super) mod swapped_outputs;

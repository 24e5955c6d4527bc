//! The list of effects.

use super::definition::{Effect, Lateness};
use super::error::{EffectError, Result};
use super::{clock, dynamics, input, output};

/// All effects, in the order of the format's table; among equivalent effects the first has priority.
pub static EFFECTS: [&dyn Effect; 49] = [
    &input::delay::InputDelay,
    &input::delay_jump::DelayJump,
    &input::delay_drift::DelayDrift,
    &input::multi_rate::MultiRate,
    &input::gain::InputGain,
    &input::curve::InputCurve,
    &input::gain_fade::GainFade,
    &input::gain_jump::GainJump,
    &input::offset::InputOffset,
    &input::deadband::Deadband,
    &input::backlash::Backlash,
    &input::saturation::Saturation,
    &input::rate_limit::RateLimit,
    &input::actuator_lag::ActuatorLag,
    &input::swapped_inputs::SwappedInputs,
    &input::dropped_commands::DroppedCommands,
    &input::delay_jitter::DelayJitter,
    &dynamics::candidate::CandidateTerm,
    &dynamics::parameter_error::ParameterError,
    &dynamics::parameter_jump::ParameterJump,
    &dynamics::cross_coupling::CrossCoupling,
    &dynamics::exchange::Exchange,
    &dynamics::internal_saturation::InternalSaturation,
    &dynamics::internal_deadband::InternalDeadband,
    &dynamics::internal_delay::InternalDelay,
    &dynamics::internal_lag::InternalLag,
    &dynamics::driveline_backlash::DrivelineBacklash,
    &dynamics::driveline_friction::DrivelineFriction,
    &dynamics::coulomb_friction::CoulombFriction,
    &dynamics::stribeck_friction::StribeckFriction,
    &dynamics::hysteresis::Hysteresis,
    &dynamics::quadratic_drag::QuadraticDrag,
    &dynamics::cubic_stiffness::CubicStiffness,
    &dynamics::unmodelled_mode::UnmodelledMode,
    &dynamics::constant_disturbance::ConstantDisturbance,
    &dynamics::periodic_disturbance::PeriodicDisturbance,
    &output::delay::OutputDelay,
    &output::sensor_lag::SensorLag,
    &output::output_backlash::OutputBacklash,
    &output::static_nonlinearity::StaticNonlinearity,
    &output::sensor_gain::SensorGain,
    &output::sensor_bias::SensorBias,
    &output::sensor_drift::SensorDrift,
    &output::sensor_saturation::SensorSaturation,
    &output::sensor_quantisation::SensorQuantisation,
    &output::misalignment::Misalignment,
    &output::swapped_outputs::SwappedOutputs,
    &clock::skew::ClockSkew,
    &clock::offset::ClockOffset,
];

/// The row of an effect in the table.
#[must_use]
pub fn row(effect: &dyn Effect) -> usize {
    EFFECTS.iter().position(|e| e.name() == effect.name()).unwrap_or(EFFECTS.len())
}

/// The effect called `name`.
///
/// # Errors
/// [`EffectError::Unknown`], with the known names.
pub fn find(name: &str) -> Result<&'static dyn Effect, EffectError> {
    EFFECTS.iter().find(|e| e.name() == name).copied().ok_or_else(|| EffectError::Unknown {
        name: name.to_owned(),
        known: EFFECTS.iter().map(|e| e.name()).collect(),
    })
}

impl Lateness {
    /// The effect for this kind of lateness.
    ///
    /// # Errors
    /// [`EffectError::Unknown`] where the table has none.
    pub fn effect(self) -> Result<&'static dyn Effect> {
        let known = || EFFECTS.iter().map(|e| e.name()).collect();
        EFFECTS
            .iter()
            .copied()
            .find(|e| e.lateness() == Some(self))
            .ok_or_else(|| EffectError::Unknown { name: format!("{self:?}"), known: known() })
    }
}

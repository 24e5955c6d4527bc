//! Checks that need no dynamics: the commonest and cheapest causes of a gap, tested before any effect is fitted. They change no log.
//!
//! One file per check. All checks share prepared inputs: the logs with the nominal model ([`view`]) and the lags of the outputs ([`timing`]). [`kinematics`]
//! has the outputs of which one is the derivative of another by the model's equations; [`pairs`] compares two such sensors. [`faults`] has the signs, units and
//! places of channels that would make model and log agree.

mod alike;
mod axes;
mod clipped;
mod clock_offset;
mod clock_skew;
pub(crate) mod every;
mod evidence;
mod excitation;
mod faults;
pub(crate) mod inspection;
mod kinematics;
mod moments;
mod one_sample_shift;
pub(crate) mod operating_point;
mod pairs;
mod runs;
mod sign;
mod stuck;
mod timing;
pub(crate) mod topics;
mod turned;
mod unit;
mod units;
mod view;

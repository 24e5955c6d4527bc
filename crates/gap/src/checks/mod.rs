//! Checks that need no dynamics: the commonest and cheapest causes of a gap, looked at before any effect is fitted. They change no log.
//!
//! One file per check. What they look at is prepared once: the logs beside the nominal model ([`view`]), the outputs of which the model says that one is the
//! derivative of another ([`kinematics`]; two such sensors beside each other: [`pairs`]), the signs, units and places of channels that would make model and log go together ([`faults`]), and how late the
//! outputs are ([`timing`]).

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

//! The effects that a simulator may lack, one file each: delays, dead zones, friction, wrong parameters, sensors, clocks.
//!
//! An effect turns its parameters into hooks of a [`Plan`](crate::simulate::plan::Plan). At its nominal parameters it adds none, so the simulation is identical
//! to the bit. The plan defines the order in which hooks act, not the order of a list of effects.

pub(crate) mod applied;
mod channel;
mod clock;
mod definition;
mod dynamics;
pub(crate) mod effects;
pub(crate) mod error;
mod input;
mod on_log;
mod output;
mod parameter;
mod scales;
mod table;

pub use applied::{Applied, Chance, Fates};
pub use channel::depends;
pub use definition::{Change, Effect, Facts, Lateness, OnChannel, Site, Telling};
pub use effects::{EFFECTS, find, row};
pub use error::EffectError;
pub use on_log::{OnLog, Still, check_units};
pub use parameter::{Parameter, Role};
pub use scales::{Scales, Scanned, Spread};
pub use table::{Line, menu, table};

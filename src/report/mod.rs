//! What people and machines read. Nothing is computed here.

pub mod blind;
mod chart;
pub mod checks;
pub mod diagnosis;
pub mod effects;
pub mod estimate;
pub mod gate;
pub mod html;
pub mod identify;
pub mod isolability;
pub mod junit;
pub mod methods;
#[cfg(feature = "cli")]
pub mod picture;
pub mod study;
mod text;

pub use text::{Table, seconds};

//! The outputs for people and machines. Nothing is computed here.

pub mod blind;
pub mod bounds;
pub mod checks;
pub mod compare;
pub mod diagnosis;
mod drawing;
pub mod effects;
mod escape;
pub mod estimate;
mod facts;
pub(crate) mod folder;
pub mod gate;
pub mod identify;
pub mod isolability;
pub mod junit;
pub mod log;
pub mod matching;
pub mod methods;
pub mod page;
pub mod picture;
pub mod response;
pub mod speed;
pub mod standing;
pub mod structured;
pub mod study;
pub mod styled;
pub mod terminal;
pub(crate) mod text;

pub use folder::{save, save_study};
pub use text::{Table, seconds};

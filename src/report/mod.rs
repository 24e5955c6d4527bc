//! What people and machines read. Nothing is computed here.

pub mod estimate;
pub mod study;
mod text;

pub use text::{Table, seconds};

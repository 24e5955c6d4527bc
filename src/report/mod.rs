//! What people and machines read. Nothing is computed here.

pub mod estimate;
mod text;

pub use text::{Table, seconds};

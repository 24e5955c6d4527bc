#![doc = include_str!("../README.md")]
#![doc = include_str!("../docs/library.md")]

pub mod blind;
#[cfg(feature = "cli")]
pub mod cli;
pub mod compare;
pub mod delay;
pub mod diagnose;
pub mod effect;
pub mod error;
pub mod export;
pub mod file;
pub mod fit;
pub mod identify;
pub mod log;
pub mod model;
pub mod progress;
#[cfg(feature = "python")]
mod python;
pub mod registry;
pub mod report;
pub mod signal;
pub mod simulate;
pub mod stop;
pub mod study;
pub mod text;
pub mod threads;
pub mod time;

pub use error::{Error, Result};
// Matrices and random numbers stand in the library's own signatures: whoever calls it needs these versions.
pub use {nalgebra, rand};

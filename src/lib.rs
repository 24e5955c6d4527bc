#![doc = include_str!("../README.md")]
#![doc = include_str!("../docs/library.md")]

#[cfg(feature = "cli")]
pub mod cli;
pub mod error;
pub mod report;

pub use deadtime_delay as delay;
pub use deadtime_gap as diagnose;
pub use deadtime_gap::export;
pub use deadtime_identify as identify;
pub use deadtime_log as log;
pub use deadtime_model as model;
pub use deadtime_model::{effect, simulate};
pub use deadtime_signal as signal;
pub use deadtime_signal::{file, fit, progress, registry, remedy, stop, text, threads, time};
pub use deadtime_study as study;
pub use deadtime_study::{blind, compare};

pub use error::{Error, Result};
// Matrices and random numbers are in the library's own signatures: every caller needs these versions.
pub use {nalgebra, rand};

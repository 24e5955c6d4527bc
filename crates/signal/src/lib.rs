//! The lowest layer of `deadtime`: time, signals and their noise, spectra, statistics, least squares, text, threads, progress, files.

mod butterworth;
mod correlation;
pub mod decompositions;
mod error;
pub mod excitation;
mod factors;
pub mod file;
pub mod fit;
mod flatten;
mod fourier;
mod fractional_delay;
mod noise;
pub mod parallel;
mod polynomial;
pub mod progress;
pub mod registry;
pub mod remedy;
mod spectra;
mod spectral_matrix;
pub mod stats;
pub mod stop;
pub mod text;
pub mod threads;
pub mod time;

pub use crate::excitation::excitations::EXCITATIONS;
pub use crate::excitation::generator::Excitation;
pub use correlation::{Correlator, correlation};
pub use error::{Allowed, SignalError};
pub use fractional_delay::fractional_delay;
pub use noise::{Noise, NoiseColour, NoiseScaling, add_noise, unit_noise};
pub use spectra::{CrossSpectra, HANN_LINES};
pub use spectral_matrix::SpectralMatrix;

pub use fourier::{RealFourier, dft, fast_length};

pub use factors::{refined_roots, unlike};
pub use polynomial::{evaluate as polynomial, roots};

/// The most samples one call makes: 8 GB of numbers. More is taken for a slip of the keyboard.
pub const MOST_SAMPLES: usize = 1_000_000_000;

//! Models from data: finite impulse responses, ARX, ARMAX and output-error models; state-space models by subspace methods. Many parameters of a model file at
//! once, by time (`structured`) and by frequency (`matching`).

mod armax;
mod arx;
mod error;
mod fir;
mod fir_regularised;
mod iv;
mod lag_products;
mod laguerre;
#[cfg(test)]
mod laws;
mod least_squares;
mod many_zeros;
mod markov;
pub mod matching;
mod oe;
mod parametric;
mod polynomial;
mod regression;
pub mod response;
mod rival;
mod srivc;
pub mod structured;
pub mod subspace;
mod transfer;
mod triangle;

pub use crate::oe::model::{Initial, OeFit, OutputError};
pub use crate::subspace::identifier::{Identified, Identifier};
pub use crate::subspace::single::{Innovations, Subspace};
pub use armax::{Armax, ArmaxFit, ArmaxScan};
pub use arx::{ArxScan, JointArx, scan as arx_scan};
pub use error::{Error, IdentifyError, Result};
pub use fir::{Fir, fit as fir};
pub use fir_regularised::{RegularisedFir, fit as fir_regularised};
pub use iv::{IvFit, RefinedIv};
pub use markov::{era, markov, okid};
pub use parametric::{Guess, Parameter, Parametric};
pub use polynomial::MAX_ORDER as MAX_OE_ORDER;
pub use regression::dot;
pub use regression::{Record, Regression};
pub use srivc::Srivc;
pub use transfer::Riv;

pub use crate::oe::output_error::power;
pub use arx::beside;
pub use fir::estimate as fir_or_rank;
pub use fir_regularised::Evidence;
pub use lag_products::{lag_matrix, lag_vector};
pub use laguerre::{Laguerre, laguerre, laguerre_spectra};
pub use many_zeros::ManyZeros;
pub use parametric::{Cloud, Coloured, coloured, given, usable};
pub use polynomial::{filtered, largest_pole, prefiltered};

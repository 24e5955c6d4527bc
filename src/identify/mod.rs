//! Models from data: finite impulse responses, ARX, ARMAX and output-error models; state-space models by subspace methods; many parameters of a model file at
//! once, by time (`structured`) and by frequency (`matching`).

mod armax;
mod arx;
mod error;
mod fir;
mod fir_regularised;
mod iv;
mod lag_products;
mod laguerre;
mod least_squares;
mod many_zeros;
pub mod matching;
mod oe;
mod parametric;
mod polynomial;
mod regression;
pub mod response;
pub mod structured;
pub mod subspace;
mod transfer;
mod triangle;

pub use armax::{Armax, ArmaxFit, ArmaxScan};
pub use arx::{ArxScan, JointArx, scan as arx_scan};
pub use error::IdentifyError;
pub use fir::{Fir, fit as fir};
pub use fir_regularised::{RegularisedFir, fit as fir_regularised};
pub use iv::{IvFit, RefinedIv};
pub use oe::{Initial, OeFit, OutputError};
pub use parametric::{Guess, Parameter, Parametric};
pub use polynomial::MAX_ORDER as MAX_OE_ORDER;
pub(crate) use regression::dot;
pub use regression::{Record, Regression};
pub use subspace::{Identified, Identifier, Innovations, Subspace};
pub use transfer::Riv;

pub(crate) use arx::beside;
pub(crate) use fir::estimate as fir_or_rank;
pub(crate) use fir_regularised::Evidence;
pub(crate) use lag_products::{lag_matrix, lag_vector};
pub(crate) use laguerre::{Laguerre, laguerre, laguerre_spectra};
pub(crate) use many_zeros::ManyZeros;
pub(crate) use oe::power;
pub(crate) use parametric::{Cloud, Coloured, coloured, given, usable};
pub(crate) use polynomial::{filtered, largest_pole, prefiltered};

//! Models from data: finite impulse responses, ARX and output-error models.

mod arx;
mod fir;
mod lag_products;
mod laguerre;
mod least_squares;
mod many_zeros;
mod oe;
mod regression;

pub use arx::{ArxScan, scan as arx_scan};
pub use fir::{Fir, fit as fir};
pub use oe::{Initial, MAX_ORDER as MAX_OE_ORDER, OeFit, OutputError};
pub use regression::{Record, Regression};

pub(crate) use fir::estimate as fir_or_rank;
pub(crate) use lag_products::lag_matrix;
pub(crate) use laguerre::{Laguerre, laguerre, laguerre_spectra};
pub(crate) use many_zeros::ManyZeros;
pub(crate) use oe::{largest_pole, power};

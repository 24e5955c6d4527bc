//! Models from data: finite impulse responses, ARX and output-error models.

mod arx;
mod fir;
mod fir_regularised;
mod lag_products;
mod least_squares;
mod oe;
mod regression;

pub use arx::{ArxScan, scan as arx_scan};
pub use fir::{Fir, fit as fir};
pub use fir_regularised::{RegularisedFir, fit as fir_regularised};
pub use oe::{Initial, MAX_ORDER as MAX_OE_ORDER, OeFit, OutputError};
pub use regression::{Record, Regression};

pub(crate) use fir::estimate as fir_or_rank;
pub(crate) use fir_regularised::Evidence;
pub(crate) use lag_products::lag_matrix;
pub(crate) use oe::{filtered, largest_pole, power};

//! Models from data: finite impulse responses, ARX, ARMAX and output-error models.

mod armax;
mod arx;
mod fir;
mod iv;
mod lag_products;
mod least_squares;
mod oe;
mod polynomial;
mod regression;
mod subspace;

pub use armax::{Armax, ArmaxFit, ArmaxScan};
pub use arx::{ArxScan, JointArx, scan as arx_scan};
pub use fir::{Fir, fit as fir};
pub use iv::{IvFit, RefinedIv};
pub use oe::{Initial, MAX_ORDER as MAX_OE_ORDER, OeFit, OutputError};
pub use regression::{Record, Regression};
pub use subspace::{Innovations, Subspace};

pub(crate) use arx::beside;
pub(crate) use fir::estimate as fir_or_rank;
pub(crate) use lag_products::lag_matrix;
pub(crate) use oe::{largest_pole, power, prefiltered};

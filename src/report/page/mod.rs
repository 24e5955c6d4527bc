//! Pages: one file each, that needs no other. The text is there without a script; curves are drawn by uPlot, which is part of the page (src/report/vendor/uplot
//! has the reason).

mod bars;
mod blind;
mod bode;
mod check;
mod compare;
mod curves;
mod estimate;
mod force;
mod frame;
mod gap;
mod identify;
mod laws;
mod matching;
mod residual;
mod response;
mod series;
mod structured;
mod study;

pub use blind::blind;
pub use check::{Measured, check};
pub use compare::{compared_diagnoses, compared_studies};
pub use estimate::estimate;
pub use gap::gap;
pub use identify::identify;
pub use matching::matching;
pub use response::response;
pub use structured::structured;
pub use study::study;

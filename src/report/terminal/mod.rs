//! The first output on a terminal: the answer in two lines, then a table of 80 columns with bars on a common axis.

pub(crate) mod axis;
pub(crate) mod delay;
mod gap;

pub use delay::{brief, short};
pub use gap::{diagnosis, short_diagnosis, verdict};

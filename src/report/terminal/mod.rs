//! What a terminal shows first: the answer in two lines, then a table of 80 columns with bars on a common axis.

mod axis;
mod delay;
mod gap;

pub(super) use axis::Axis;
pub(super) use delay::without_lists;
pub use delay::{brief, short};
pub use gap::{diagnosis, verdict};

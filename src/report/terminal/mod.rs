//! What a terminal shows first: the answer in two lines, then a table of 80 columns with bars on a common axis.

mod axis;
mod delay;
mod gap;
mod styled;

pub(super) use axis::Axis;
pub(super) use delay::without_lists;
pub use gap::{diagnosis, verdict};
pub use styled::{Role, Styled};
pub(super) use styled::{cell, columns, wrapped};

/// Columns that fit every terminal.
pub const WIDTH: usize = 80;

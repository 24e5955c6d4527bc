//! Accuracy on delays that were injected and so are known.

mod common;
mod injected;

pub use common::{Common, MethodRow, Score};
pub use injected::{Cell, Injected};

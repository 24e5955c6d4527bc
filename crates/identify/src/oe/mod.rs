//! Output-error models y = B(q)/F(q) u(t − nk) + e, fitted for many delays at once.

mod kernel;
pub(crate) mod model;
pub(crate) mod output_error;
mod problem;
mod scan;
mod work;

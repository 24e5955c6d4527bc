//! Nonlinear least squares: bounded Levenberg-Marquardt, and Newton's method for the last digits.

mod levenberg_marquardt;
mod newton;

pub use levenberg_marquardt::{Fit, LevenbergMarquardt, Normal, Stopped};
pub use newton::polish;
pub use newton::polish_exact;

//! Nonlinear least squares: bounded Levenberg-Marquardt.

mod levenberg_marquardt;

pub use levenberg_marquardt::{Fit, LevenbergMarquardt, Normal, Stopped};

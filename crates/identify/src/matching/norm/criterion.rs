//! A norm of a deviation, and where it is evaluated.

use crate::matching::system::Response;
use nalgebra::DMatrix;

/// What is known at a frequency.
pub(crate) struct At {
    /// The identified model's response.
    pub(crate) target: Response,
    /// One over the size of an error of each entry: its standard deviation, or where none is known its magnitude.
    pub(crate) weight: DMatrix<f64>,
    /// The frequency's share of the band on a logarithmic scale; the shares add up to 1.
    pub(crate) share: f64,
    /// The part of the band that it stands for, rad/s, by the trapezoidal rule.
    pub(crate) width_rad_s: f64,
    /// The sample time, s; 1 in continuous time.
    pub(crate) step_s: f64,
}

/// A way to compare two responses.
pub struct Norm {
    /// The name that the command line uses.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// What is to be small at one frequency; 0 where the two are equal.
    pub(crate) difference: fn(&At, &Response) -> Response,
    /// The differences' singular values are summed in these powers, one search after the other: 2 is least squares, the last one stands for the largest.
    pub(crate) powers: &'static [f64],
}

/// From least squares to the largest value: a large power of many values is their largest but for less than the hundredth root of their number.
pub(super) const TO_THE_LARGEST: &[f64] = &[2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

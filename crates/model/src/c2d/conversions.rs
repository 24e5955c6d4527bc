//! The list of conversions.

use super::conversion::Conversion;
use super::differences::{BackwardDifference, ForwardDifference, GeneralisedBilinear};
use super::first_order_hold::FirstOrderHold;
use super::impulse::ImpulseInvariant;
use super::least_squares::LeastSquares;
use super::matched::ZeroPoleMatching;
use super::tustin::Tustin;
use super::zero_order_hold::ZeroOrderHold;
use deadtime_signal::registry::{Entry, entry};

/// Every conversion.
pub const CONVERSIONS: &[Entry<dyn Conversion>] = &[
    entry!("zoh", "zero-order hold: exact where the input is held between samples", ZeroOrderHold),
    entry!(
        "foh",
        "first-order (triangle) hold: exact where the input is a straight line between samples",
        FirstOrderHold
    ),
    entry!(
        "impulse",
        "impulse-invariant: the sampled impulse response times the sample time",
        ImpulseInvariant
    ),
    entry!(
        "tustin",
        "Tustin (bilinear), with an optional frequency at which the response is exact",
        Tustin
    ),
    entry!(
        "gbt",
        "generalised bilinear: alpha 0 is the forward difference, 1/2 Tustin, 1 the backward difference",
        GeneralisedBilinear
    ),
    entry!("euler", "forward difference; a stable model may become unstable", ForwardDifference),
    entry!("backward_diff", "backward difference; stable models stay stable", BackwardDifference),
    entry!("matched", "zero-pole matching, for one input and one output", ZeroPoleMatching),
    entry!(
        "least_squares",
        "the nearest frequency response up to Nyquist, for one input and one output",
        LeastSquares
    ),
];

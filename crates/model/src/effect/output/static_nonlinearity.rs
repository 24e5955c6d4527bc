//! A sensor's characteristic is nonlinear: y + quadratic·y² + cubic·y³.
//!
//! Equation: v = p(min(max(y, lower), upper)) with p(y) = y + quadratic·y² + cubic·y³. The curve p rises from 0 to `lower` and to `upper`, and is constant
//! beyond.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensor's characteristic is nonlinear.
///
/// Assumes: a smooth, nondecreasing characteristic without memory and with slope one at zero; offset and scale factor are effects of their own.
/// Fails when: the measured output stays far from zero or moves little: the curve is then equivalent to a gain and an offset. A slowly driven nonlinear plant
/// resembles it.
/// Source: IEEE Std 1293-1998, section 8.3, model equation of a linear accelerometer (second- and third-order coefficients).
#[derive(Debug, Clone, Copy)]
pub(crate) struct StaticNonlinearity;

impl Effect for StaticNonlinearity {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("sensor_gain"),
            told_by: Some(Telling::Amplitude),
            ..Facts::of("static_nonlinearity", Site::Output, "the sensor's characteristic is bent")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.outputs[on.output()?]);
        Ok(vec![
            channel::free("quadratic", format!("1/({unit})"), 0.0),
            channel::free("cubic", format!("1/({unit})^2"), 0.0),
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        let largest = spread.quantiles[5].max(f64::MIN_POSITIVE);
        // The screening tests both coefficients, with either sign.
        vec![vec![0.2 / largest, 0.0], vec![0.0, 0.2 / (largest * largest)]]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (quadratic, cubic) = (values[0], values[1]);
        let (lower, upper) = rising(quadratic, cubic);
        let bent = move |_, y: f64| {
            let y = y.clamp(lower, upper);
            y * (1.0 + y * (quadratic + y * cubic))
        };
        plan.outputs[on.output()?].maps.push(Arc::new(bent));
        Ok(())
    }
}

/// The range about 0 in which the curve rises. The slope is 1 + 2·quadratic·y + 3·cubic·y². With w = 1/y it is 0 where w² + 2·quadratic·w + 3·cubic is.
fn rising(quadratic: f64, cubic: f64) -> (f64, f64) {
    let square = quadratic * quadratic - 3.0 * cubic;
    if square <= 0.0 || !square.is_finite() {
        return (f64::NEG_INFINITY, f64::INFINITY);
    }
    // The root without cancellation, and the other by their product.
    let one = -quadratic - square.sqrt().copysign(quadratic);
    let other = 3.0 * cubic / one;
    let (most, least) = (one.max(other), one.min(other));
    (
        if least < 0.0 { 1.0 / least } else { f64::NEG_INFINITY },
        if most > 0.0 { 1.0 / most } else { f64::INFINITY },
    )
}

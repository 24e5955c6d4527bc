//! The distance from a minimum to an end of a likelihood-ratio interval.
//!
//! Equation: the step s > 0 with r(s) = 1, r² the share of the interval's likelihood deficit. False position on r, which is linear where the cost is a parabola;
//! bisection elsewhere.

/// Largest number of steps towards an end of the interval.
const REACHES: usize = 40;

/// Relative tolerance of the distance to an end.
const ENDS: f64 = 1e-4;

/// The distance at which `root` is 1, at most `limit`. `root` is `start` at the minimum; the first step is `first`. The distance found so far where `root` is
/// `None`.
pub(super) fn reach(
    start: f64,
    first: f64,
    limit: f64,
    mut root: impl FnMut(f64) -> Option<f64>,
) -> f64 {
    let (mut inner, mut outer) = ((0.0, start), None::<(f64, f64)>);
    let mut step = first.min(limit);
    let mut widths = [f64::INFINITY; 2];
    for _ in 0..REACHES {
        let Some(found) = root(step) else { break };
        let here = (step, found);
        if here.1 < 1.0 {
            if step >= limit {
                return limit;
            }
            inner = here;
        } else {
            outer = Some(here);
        }
        step = match outer {
            None => (step * (1.1 / here.1.max(0.1)).clamp(1.2, 2.5)).min(limit),
            Some(outer) => {
                let (width, share) = (
                    outer.0 - inner.0,
                    (1.0 - inner.1) / (outer.1 - inner.1).max(f64::MIN_POSITIVE),
                );
                if width <= ENDS * outer.0 {
                    return inner.0 + share * width;
                }
                let slow = width > 0.5 * widths[0];
                widths = [widths[1], width];
                // Alternately on either side of the crossing, so that the bracket closes from both.
                let shift = if here.1 < 1.0 { 1e-3 } else { -1e-3 };
                inner.0 + if slow { 0.5 } else { (share + shift).clamp(0.02, 0.98) } * width
            }
        };
    }
    outer.map_or(inner.0, |o| o.0)
}

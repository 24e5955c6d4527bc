//! The location of a sign change of a function of time and state within a step.

use super::integrator::{Integrator, Method};
use super::rhs::Rhs;

/// A function of time and state whose sign is watched.
pub(super) type Event<'a> = &'a mut dyn FnMut(f64, &[f64]) -> f64;

/// Shares of a step at which the sign is evaluated.
const LOOKS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Share of a step after which an event that began at 0 has its sign.
const DEPARTURE: f64 = 1e-6;
/// Accuracy of the event's location, relative to the step.
const CLOSE: f64 = 1e-13;

/// Searches the first change of sign in the last step, from (t, x) to (end, `integrator.next`). If there is one, x becomes the state just behind it.
///
/// `sign` is the value whose sign must change; where it is 0, the first sign found replaces it.
pub(super) fn within<R: Rhs + ?Sized>(
    integrator: &mut Integrator,
    rhs: &mut R,
    (t, end): (f64, f64),
    x: &mut [f64],
    event: Event<'_>,
    sign: &mut f64,
) -> Option<f64> {
    let h = end - t;
    if *sign == 0.0 {
        // The event begins at 0, as just after a bounce: its first direction counts, for any step length.
        *sign = on_curve(integrator, t, h, x, DEPARTURE, event);
    }
    let (mut before, mut before_value) = (0.0, *sign);
    for look in LOOKS {
        let value = on_curve(integrator, t, h, x, look, event);
        if *sign == 0.0 {
            *sign = value;
        } else if changed(*sign, value) {
            let behind = located(
                before,
                before_value,
                look,
                value,
                |theta| on_curve(integrator, t, h, x, theta, event),
                *sign,
            );
            return Some(restep(integrator, rhs, (t, end), x, event, behind, *sign));
        }
        (before, before_value) = (look, value);
    }
    None
}

fn changed(sign: f64, value: f64) -> bool {
    value == 0.0 || value * sign.signum() < 0.0
}

/// The event's value on the curve through the step (the step's own dense output, or a cubic through both ends).
fn on_curve(
    integrator: &mut Integrator,
    t: f64,
    h: f64,
    x: &[f64],
    theta: f64,
    event: &mut dyn FnMut(f64, &[f64]) -> f64,
) -> f64 {
    if theta == 1.0 {
        return event(t + h, &integrator.next);
    }
    let n = integrator.n;
    match integrator.method {
        Method::Explicit => {
            integrator.explicit.dense(theta, h, x, &integrator.next, &mut integrator.between)
        }
        Method::Rosenbrock => {
            let (k, rest) = (&integrator.explicit.k, 1.0 - theta);
            for i in 0..n {
                let difference = integrator.next[i] - x[i];
                let (start, last) = (h * k[i] - difference, difference - h * k[6 * n + i]);
                integrator.between[i] =
                    x[i] + theta * (difference + rest * (start * rest + last * theta));
            }
        }
    }
    event(t + theta * h, &integrator.between)
}

/// Root of `value` between a and b (different signs there), from behind: regula falsi with the Illinois rule, and bisection where that is slow.
fn located(
    mut a: f64,
    mut at_a: f64,
    mut b: f64,
    mut at_b: f64,
    mut value: impl FnMut(f64) -> f64,
    sign: f64,
) -> f64 {
    // The end that remained last time: its value is halved if it remains again.
    let mut stayed = 0;
    for round in 0..200 {
        if b - a <= CLOSE * b.abs().max(f64::MIN_POSITIVE) || at_b == 0.0 {
            break;
        }
        let secant = b - at_b * (b - a) / (at_b - at_a);
        let inside = secant > a && secant < b && round % 4 != 3;
        let middle = if inside { secant } else { 0.5 * (a + b) };
        if middle <= a || middle >= b {
            break;
        }
        let at_middle = value(middle);
        if changed(sign, at_middle) {
            (b, at_b) = (middle, at_middle);
            at_a *= if stayed == -1 { 0.5 } else { 1.0 };
            stayed = -1;
        } else {
            (a, at_a) = (middle, at_middle);
            at_b *= if stayed == 1 { 0.5 } else { 1.0 };
            stayed = 1;
        }
    }
    b
}

/// Repeats the step from its start right to the event, so that the state there has full accuracy; the dense output is less accurate.
fn restep<R: Rhs + ?Sized>(
    integrator: &mut Integrator,
    rhs: &mut R,
    (t, end): (f64, f64),
    x: &mut [f64],
    event: Event<'_>,
    theta: f64,
    sign: f64,
) -> f64 {
    let h = end - t;
    let mut step = |integrator: &mut Integrator, share: f64| {
        match integrator.method {
            Method::Explicit => {
                integrator.explicit.step(rhs, t, share * h, x, &mut integrator.next)
            }
            Method::Rosenbrock => {
                let dx = &integrator.explicit.k[..integrator.n];
                integrator.rosenbrock.step(
                    rhs,
                    t,
                    share * h,
                    x,
                    dx,
                    &mut integrator.next,
                    &mut integrator.error,
                );
            }
        }
        event(t + share * h, &integrator.next)
    };
    let mut behind = theta;
    let mut value = step(integrator, behind);
    // The step's own solution differs from the dense one by less than the tolerance: the bracket is nearby.
    let (mut wide, mut before, mut before_value) = (1e-10, behind, value);
    if changed(sign, value) {
        while changed(sign, before_value) && before > 0.0 && wide < 1.0 {
            (behind, value) = (before, before_value);
            before = (behind - wide).max(0.0);
            before_value = if before > 0.0 { step(integrator, before) } else { sign };
            wide *= 10.0;
        }
    } else {
        while !changed(sign, value) && behind < 1.0 {
            (before, before_value) = (behind, value);
            behind = (before + wide).min(1.0);
            value = step(integrator, behind);
            wide *= 10.0;
        }
    }
    if changed(sign, value) && !changed(sign, before_value) {
        behind =
            located(before, before_value, behind, value, |share| step(integrator, share), sign);
    }
    step(integrator, behind);
    x.copy_from_slice(&integrator.next);
    if behind >= 1.0 { end } else { t + behind * h }
}

//! The integration: step-size control, the choice of the method, and exact ends.

use super::event::{self, Event};
use super::integrator::{Integrator, Method};
use super::rhs::Rhs;
use crate::simulate::error::SimulateError;

/// |hλ| at the edge of the explicit method's stability (Hairer & Wanner, IV.2), and how many steps
/// there mean stiffness.
const STABILITY_EDGE: f64 = 3.25;
const STEPS_AT_THE_EDGE: u32 = 15;
const STEPS_AWAY: u32 = 6;
/// Rosenbrock steps within the stability limit of the explicit method, before the latter is tried again.
const EASY_STEPS: u32 = 20;
const SAFETY: f64 = 0.9;

impl Integrator {
    /// The error of too stiff equations, with the state responsible: the one with the largest √|Jᵢⱼ·Jⱼᵢ|. For i = j this is its own rate, otherwise the
    /// frequency of an oscillation between two states. Units have no influence.
    fn stiff<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        x: &[f64],
        steps: usize,
        step_s: f64,
    ) -> SimulateError {
        let n = self.n;
        let (mut at, mut dx, mut scratch, mut jacobian) =
            (x.to_vec(), vec![0.0; n], vec![0.0; 2 * n], vec![0.0; n * n]);
        rhs.eval(t, &at, &mut dx);
        rhs.jacobian(t, &mut at, &dx, &mut scratch, &mut jacobian);
        let entry = |i: usize, j: usize| jacobian.get(i + n * j).copied().unwrap_or(0.0);
        let rate = |i: usize| {
            (0..n)
                .map(|j| (entry(i, j).abs().sqrt()) * entry(j, i).abs().sqrt())
                .fold(0.0, f64::max)
        };
        let fastest = (0..n)
            .map(|i| (i, rate(i)))
            .filter(|(_, rate)| rate.is_finite() && *rate > 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1));
        self.fastest = fastest.map(|(state, rate)| (state, 1.0 / rate));
        SimulateError::Stiff { time_s: t, steps, step_s }
    }

    /// Integrates x from t0 exactly to t1. On an error x is the last valid state.
    ///
    /// # Errors
    /// [`SimulateError`] for an undefined start, a diverging state, too stiff equations, time running backwards.
    #[inline]
    pub fn advance<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t0: f64,
        t1: f64,
        x: &mut [f64],
    ) -> Result<(), SimulateError> {
        self.drive(rhs, (t0, t1), t1, x, None).map(drop)
    }

    /// As [`Self::advance`], but stops just behind the first change of sign of `event` in (t0, t1]. x is then the state there; the time is returned. Neither a
    /// value of 0 at t0 nor the first sign after it is a change. Double changes within 25 % of a step may be missed.
    ///
    /// # Errors
    /// As [`Self::advance`].
    pub fn advance_until<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t0: f64,
        t1: f64,
        x: &mut [f64],
        event: &mut impl FnMut(f64, &[f64]) -> f64,
    ) -> Result<Option<f64>, SimulateError> {
        self.drive(rhs, (t0, t1), t1, x, Some(event))
    }

    /// Integrates x from t0 to t1 as [`Integrator::advance`] does, by steps that may pass t1 up to `until`. The state at t1 is then that of the step's curve,
    /// which has order 4. A call continues the last step if it starts at the end of the last call, with the same right-hand side and unchanged x.
    ///
    /// # Errors
    /// As [`Integrator::advance`].
    pub fn advance_past<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        (t0, t1): (f64, f64),
        until: f64,
        x: &mut [f64],
    ) -> Result<(), SimulateError> {
        let known = self.past.span.take().filter(|_| self.same && self.past.reached == t0);
        let (start, end) = match known {
            Some(span) if t1 <= span.1 => span,
            _ if until <= t1 && known.is_none() => return self.advance(rhs, t0, t1, x),
            _ => {
                let mut from = std::mem::take(&mut self.past.from);
                let begin = match known {
                    // The slope at the start is the last one of the previous step.
                    Some((_, end)) => {
                        from.copy_from_slice(&self.next);
                        self.end = end;
                        end
                    }
                    None => {
                        from.copy_from_slice(x);
                        t0
                    }
                };
                let moved = self.drive(rhs, (begin, until), t1.min(until), &mut from, None);
                self.past.from = from;
                moved?;
                match self.past.span {
                    Some(span) => span,
                    // The step ends at the end of known data.
                    None => {
                        x.copy_from_slice(&self.next);
                        return Ok(());
                    }
                }
            }
        };
        self.same = false;
        (self.past.span, self.past.reached) = (Some((start, end)), t1);
        if t1 >= end {
            x.copy_from_slice(&self.next);
        } else {
            self.explicit.dense(
                (t1 - start) / (end - start),
                end - start,
                &self.past.from,
                &self.next,
                x,
            );
        }
        Ok(())
    }

    /// Integrates to t1, or until a step reaches `wanted` before it. x is then the state at that step's start, and `past` holds the step.
    pub(super) fn drive<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        (t0, t1): (f64, f64),
        wanted: f64,
        x: &mut [f64],
        mut event: Option<Event<'_>>,
    ) -> Result<Option<f64>, SimulateError> {
        if !self.begin(rhs, (t0, t1), x)? {
            return Ok(None);
        }
        let mut t = t0;
        let mut sign = event.as_mut().map_or(0.0, |event| event(t, x));
        let smallest = 16.0 * f64::EPSILON * t0.abs().max(t1.abs()).max((t1 - t0).min(1.0) * 1e-3);
        let (mut steps, mut after_rejection, mut broken_h) = (0, false, None);
        loop {
            // The curve through a Rosenbrock step has a low order: the step ends at the requested state.
            let target = if self.method == Method::Explicit { t1 } else { wanted };
            let remaining = target - t;
            let (h, last) = cut(self.h, remaining);
            steps += 1;
            self.affords(rhs, t, x, &mut steps)?;
            let error = self.step(rhs, t, h, x);
            let (order, growth) = self.method.order_and_growth();
            if error > 1.0 || error.is_nan() {
                after_rejection = true;
                broken_h = if error.is_finite() { broken_h } else { Some(h) };
                self.reject(h, error, order);
                if self.h < smallest {
                    self.change_method(rhs, (t, x), smallest, broken_h)?;
                    self.h = broken_h.unwrap_or(h).min(remaining);
                }
                continue;
            }
            let end = if last { target } else { t + h };
            if let Some(event) = event.as_mut()
                && let Some(at) = event::within(self, rhs, (t, end), x, *event, &mut sign)
            {
                return Ok(Some(at));
            }
            self.steps += 1;
            let most = if std::mem::take(&mut after_rejection) { 1.0 } else { growth };
            let factor = growth_factor(error, order, most);
            // A step shortened by the end is no evidence against a longer one.
            self.h = if last && factor >= 1.0 { self.h.max(h * factor) } else { h * factor };
            self.choose(h, steps > 1 || !last);
            if end >= wanted && wanted < t1 {
                self.past.keep(t, end);
                return Ok(None);
            }
            x.copy_from_slice(&self.next);
            if last {
                self.end = t1;
                return Ok(None);
            }
            t = end;
            self.explicit.advance();
        }
    }

    /// No step of this method is small enough: the other method continues; after the last one there is none.
    fn change_method<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        (t, x): (f64, &[f64]),
        smallest: f64,
        broken_h: Option<f64>,
    ) -> Result<(), SimulateError> {
        if self.method == Method::Rosenbrock {
            return Err(self.failure(rhs, t, x, smallest, broken_h));
        }
        self.method = Method::Rosenbrock;
        Ok(())
    }

    /// Another step is within the limits; after too many explicit steps in this call, the other method starts to count.
    fn affords<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        x: &[f64],
        steps: &mut usize,
    ) -> Result<(), SimulateError> {
        let too_many = if self.steps + self.rejected >= self.budget {
            self.budget
        } else if *steps > self.max_steps && self.method == Method::Rosenbrock {
            self.max_steps
        } else {
            if *steps > self.max_steps {
                (self.method, *steps) = (Method::Rosenbrock, 0);
            }
            return Ok(());
        };
        let step_s = self.h;
        Err(self.stiff(rhs, t, x, too_many, step_s))
    }

    /// Finds the slope at the start of a call, or reuses that at the last end, and a first step. `false`: nothing to integrate.
    fn begin<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        (t0, t1): (f64, f64),
        x: &[f64],
    ) -> Result<bool, SimulateError> {
        let same = std::mem::take(&mut self.same);
        if x.len() != self.n || rhs.dim() != self.n {
            return Err(SimulateError::InitialState {
                needed: self.n,
                got: if x.len() == self.n { rhs.dim() } else { x.len() },
            });
        }
        if t0 == t1 {
            return Ok(false);
        }
        if !(t1 > t0 && (t1 - t0).is_finite()) {
            return Err(SimulateError::Backwards { from_s: t0, to_s: t1 });
        }
        self.broken = None;
        if same && self.end == t0 && *x == self.next[..] {
            self.explicit.advance();
        } else {
            rhs.eval(t0, x, self.explicit.first());
        }
        self.end = f64::NAN;
        if !finite(self.explicit.first()) {
            self.broken = Some(t0);
            self.broken_x.copy_from_slice(x);
            return Err(SimulateError::Undefined { time_s: t0 });
        }
        if self.h == 0.0 {
            self.h = self.first_step(rhs, t0, t1, x);
        }
        Ok(true)
    }

    /// The step to try after one whose error was too large or not finite.
    fn reject(&mut self, h: f64, error: f64, order: f64) {
        self.rejected += 1;
        self.h = if error.is_finite() {
            h * (SAFETY * error.powf(-1.0 / order)).max(0.1)
        } else {
            0.1 * h
        };
    }

    /// Tries a step into `next`; the error over the tolerance.
    #[inline]
    fn step<R: Rhs + ?Sized>(&mut self, rhs: &mut R, t: f64, h: f64, x: &[f64]) -> f64 {
        match self.method {
            Method::Explicit => {
                self.explicit.step(rhs, t, h, x, &mut self.next);
                self.explicit.finish(rhs, t, h, x, &self.next, (self.rtol, self.atol))
            }
            Method::Rosenbrock => self.rosenbrock_step(rhs, t, h, x),
        }
    }

    fn rosenbrock_step<R: Rhs + ?Sized>(&mut self, rhs: &mut R, t: f64, h: f64, x: &[f64]) -> f64 {
        let n = self.n;
        let (dx, rest) = self.explicit.k.split_at_mut(n);
        self.rosenbrock.prepare(rhs, t, x, dx, h);
        if !self.rosenbrock.step(rhs, t, h, x, dx, &mut self.next, &mut self.error) {
            return f64::NAN;
        }
        let slope = &mut rest[5 * n..];
        rhs.eval(t + h, &self.next, slope);
        if !finite(slope) {
            return f64::NAN;
        }
        let states = self.error.iter().zip(x).zip(&self.next);
        let sum: f64 = states
            .map(|((error, x), next)| {
                (error / (self.atol + self.rtol * x.abs().max(next.abs()))).powi(2)
            })
            .sum();
        let count = n.max(1) as f64;
        (sum / count).sqrt()
    }

    /// After an accepted step of `h`: decides whether the other method is better. `limited`: the error control chose the step, not the end of the interval.
    fn choose(&mut self, h: f64, limited: bool) {
        match self.method {
            Method::Explicit if limited => {
                if self.explicit.stiffness(h, &self.next) > STABILITY_EDGE {
                    self.at_the_edge += 1;
                    self.away = 0;
                } else {
                    self.away += 1;
                    if self.away == STEPS_AWAY {
                        self.at_the_edge = 0;
                    }
                }
                if self.at_the_edge >= STEPS_AT_THE_EDGE {
                    self.method = Method::Rosenbrock;
                    (self.at_the_edge, self.away, self.easy) = (0, 0, 0);
                }
            }
            Method::Explicit => {}
            Method::Rosenbrock => {
                self.easy =
                    if h * self.rosenbrock.jacobian_norm() < 1.0 { self.easy + 1 } else { 0 };
                if self.easy >= EASY_STEPS {
                    self.method = Method::Explicit;
                    self.easy = 0;
                }
            }
        }
    }

    /// A first step by Hairer, Nørsett & Wanner II.4: an Euler step of 1 % of the state gives the second derivative.
    fn first_step<R: Rhs + ?Sized>(&mut self, rhs: &mut R, t: f64, t1: f64, x: &[f64]) -> f64 {
        let n = self.n;
        let (rtol, atol) = (self.rtol, self.atol);
        let norm = |v: &dyn Fn(usize) -> f64| {
            (0..n).map(|i| (v(i) / (atol + rtol * x[i].abs())).powi(2)).sum::<f64>().sqrt()
        };
        let (dx, rest) = self.explicit.k.split_at_mut(n);
        let (size, slope) = (norm(&|i| x[i]), norm(&|i| dx[i]));
        let h0 = if size < 1e-10 || slope < 1e-10 { 1e-6 } else { 0.01 * size / slope }.min(t1 - t);
        for i in 0..n {
            self.next[i] = x[i] + h0 * dx[i];
        }
        let moved = &mut rest[..n];
        rhs.eval(t + h0, &self.next, moved);
        let curve = norm(&|i| moved[i] - dx[i]) / h0;
        let largest = slope.max(curve);
        let h1 =
            if largest <= 1e-15 { f64::max(1e-6, h0 * 1e-3) } else { (0.01 / largest).powf(0.2) };
        let h = (100.0 * h0).min(h1).min(t1 - t);
        if h.is_finite() && h > 0.0 { h } else { h0.max(f64::MIN_POSITIVE) }
    }

    /// The reason why no step is small enough.
    fn failure<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        x: &[f64],
        smallest: f64,
        broken_h: Option<f64>,
    ) -> SimulateError {
        let dx = self.explicit.first();
        let size = x.iter().fold(0.0, |s: f64, v| s.max(v.abs()));
        // The time in which some state would grow by its own size.
        let runaway =
            x.iter().zip(dx.iter()).any(|(x, d)| d.abs() * 1e3 * smallest >= x.abs().max(1.0));
        if size > 1e100 || runaway {
            return SimulateError::Explodes { time_s: t };
        }
        if let Some(h) = broken_h {
            let mut probe = Probe { rhs, broken: None, x: &mut self.broken_x };
            self.explicit.step(&mut probe, t, h, x, &mut self.next);
            probe.eval_probe(t + h, &self.next, &mut self.error);
            if let Some(at) = probe.broken {
                self.broken = Some(at);
                return SimulateError::Undefined { time_s: at };
            }
        }
        let steps = self.steps;
        self.stiff(rhs, t, x, steps, smallest)
    }
}

impl Method {
    /// Its order, and the largest growth of a step.
    fn order_and_growth(self) -> (f64, f64) {
        match self {
            Self::Explicit => (5.0, 10.0),
            Self::Rosenbrock => (4.0, 6.0),
        }
    }
}

/// The step to try, and whether it is the last: if two steps remain, each takes half, so that the last one is not tiny.
#[inline]
fn cut(h: f64, remaining: f64) -> (f64, bool) {
    if h >= 0.99 * remaining {
        (remaining, true)
    } else if 2.0 * h > remaining {
        (0.5 * remaining, false)
    } else {
        (h, false)
    }
}

/// Growth factor of the next step, between 0.2 and `most`. Far below the tolerance the factor is `most`, without computing a root.
#[inline]
fn growth_factor(error: f64, order: f64, most: f64) -> f64 {
    if error < 1e-6 { most } else { (SAFETY * rough_root(error, order)).clamp(0.2, most) }
}

/// error^(−1/order), accurate enough for a step size.
#[inline]
fn rough_root(error: f64, order: f64) -> f64 {
    f64::from((error as f32).powf(-1.0 / order as f32))
}

fn finite(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// Records the first point at which a right-hand side was not finite.
struct Probe<'a, R: Rhs + ?Sized> {
    rhs: &'a mut R,
    broken: Option<f64>,
    x: &'a mut [f64],
}

impl<R: Rhs + ?Sized> Probe<'_, R> {
    fn eval_probe(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.rhs.eval(t, x, dx);
        if self.broken.is_none() && !finite(dx) {
            self.broken = Some(t);
            self.x.copy_from_slice(x);
        }
    }
}

impl<R: Rhs + ?Sized> Rhs for Probe<'_, R> {
    fn dim(&self) -> usize {
        self.rhs.dim()
    }

    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.eval_probe(t, x, dx);
    }
}

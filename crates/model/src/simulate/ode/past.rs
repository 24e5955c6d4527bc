//! Steps that go past the instants at which a state is wanted: it is read off the curve of the step.

use super::integrator::Integrator;
use super::rhs::Rhs;
use crate::simulate::error::SimulateError;

/// The step that went past the end of the last call.
#[derive(Debug, Clone)]
pub(super) struct Past {
    /// The state at its start; that at its end is the integrator's `next`.
    from: Vec<f64>,
    /// Its start and end.
    span: Option<(f64, f64)>,
    /// Where the last call ended.
    reached: f64,
}

impl Past {
    pub(super) fn new(n: usize) -> Self {
        Self { from: vec![0.0; n], span: None, reached: f64::NAN }
    }

    pub(super) fn keep(&mut self, start: f64, end: f64) {
        self.span = Some((start, end));
    }

    pub(super) fn forget(&mut self) {
        self.span = None;
    }
}

impl Integrator {
    /// Integrates x from t0 to t1 as [`Integrator::advance`] does, by steps that may go past t1 as far as `until`: the state at t1 is then that of the step's
    /// curve, which is of order 4. A call that goes on where the last one ended, with the same right-hand side and x as that one left it, goes on with its step.
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
                    // The slope at the start is the last of the step before.
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
                    // The step ends where nothing more is known.
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
}

//! The integrator, which keeps its step size and method between calls.

use super::dormand_prince::DormandPrince;
use super::past::Past;
use super::rodas::Rodas;

/// The integration method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Dormand–Prince 5(4), for equations that are not stiff.
    Explicit,
    /// RODAS 4(3), an L-stable Rosenbrock method.
    Rosenbrock,
}

/// An adaptive integrator that keeps its step size and method between calls.
///
/// ```
/// use deadtime_model::simulate::ode::{Integrator, Rhs};
/// struct Decay;
/// impl Rhs for Decay {
///     fn dim(&self) -> usize {
///         1
///     }
///     fn eval(&mut self, _t: f64, x: &[f64], dx: &mut [f64]) {
///         dx[0] = -x[0];
///     }
/// }
/// let (mut integrator, mut x) = (Integrator::new(1), [1.0]);
/// integrator.advance(&mut Decay, 0.0, 1.0, &mut x)?;
/// assert!((x[0] - (-1f64).exp()).abs() < 1e-7);
/// # Ok::<(), deadtime_model::simulate::SimulateError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Integrator {
    /// Error allowed in one step relative to a state's size; 1e-8 by default.
    pub rtol: f64,
    /// Absolute error allowed in one step, in the states' units; 1e-10 by default.
    pub atol: f64,
    /// Steps of one call before the equations count as too stiff; 100 000 by default.
    pub max_steps: usize,
    /// Steps of all calls together, repeated ones included, before the run fails; no limit by default.
    pub budget: usize,
    pub(super) n: usize,
    /// The next step, 0: unknown.
    pub(super) h: f64,
    pub(super) method: Method,
    pub(super) explicit: DormandPrince,
    pub(super) rosenbrock: Rodas,
    pub(super) next: Vec<f64>,
    pub(super) error: Vec<f64>,
    pub(super) between: Vec<f64>,
    pub(super) at_the_edge: u32,
    pub(super) away: u32,
    pub(super) easy: u32,
    /// The end of the last call, NaN: unknown. The slope there is the last of the step's.
    pub(super) end: f64,
    /// The right-hand side is that of the last call.
    pub(super) same: bool,
    /// A step that passed the end of the last call.
    pub(super) past: Past,
    pub(super) broken: Option<f64>,
    pub(super) broken_x: Vec<f64>,
    pub(super) fastest: Option<(usize, f64)>,
    pub(super) steps: usize,
    pub(super) rejected: usize,
}

impl Integrator {
    /// Memory for `n` states, and the default tolerances.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self::with_tolerance(n, 1e-8, 1e-10)
    }

    /// Memory for `n` states.
    #[must_use]
    pub fn with_tolerance(n: usize, rtol: f64, atol: f64) -> Self {
        Self {
            rtol,
            atol,
            max_steps: 100_000,
            budget: usize::MAX,
            n,
            h: 0.0,
            method: Method::Explicit,
            explicit: DormandPrince::new(n),
            rosenbrock: Rodas::new(n),
            next: vec![0.0; n],
            error: vec![0.0; n],
            between: vec![0.0; n],
            at_the_edge: 0,
            away: 0,
            easy: 0,
            end: f64::NAN,
            same: false,
            past: Past::new(n),
            broken: None,
            broken_x: vec![0.0; n],
            fastest: None,
            steps: 0,
            rejected: 0,
        }
    }

    /// Resets step size and method for another run.
    pub fn restart(&mut self) {
        (self.h, self.method) = (0.0, Method::Explicit);
        (self.at_the_edge, self.away, self.easy) = (0, 0, 0);
        (self.end, self.broken) = (f64::NAN, None);
        self.past.forget();
    }

    /// Declares that the next call has the same right-hand side as the last one. If it also begins at the last end, the slope there is reused.
    pub fn same_right_hand_side(&mut self) {
        self.same = true;
    }

    /// The present method.
    #[must_use]
    pub fn method(&self) -> Method {
        self.method
    }

    /// Steps made so far, and steps that were repeated with a shorter length.
    #[must_use]
    pub fn steps(&self) -> (usize, usize) {
        (self.steps, self.rejected)
    }

    /// After an error: time and state where the right-hand side was not finite, if that was the cause.
    #[must_use]
    pub fn breakdown(&self) -> Option<(f64, &[f64])> {
        self.broken.map(|t| (t, self.broken_x.as_slice()))
    }

    /// After `SimulateError::Stiff`: the state that requires the shortest steps, and its time constant there, s.
    #[must_use]
    pub fn fastest(&self) -> Option<(usize, f64)> {
        self.fastest
    }
}

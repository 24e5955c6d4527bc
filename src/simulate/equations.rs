//! Response of a nonlinear model to a sampled input.

use nalgebra::DMatrix;

use super::ode::{Integrator, Rhs};
use super::{Hold, Response, SimulateError};
use crate::model::{Equations, Workspace, Wrt};

/// How to simulate a nonlinear model.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationOptions {
    /// Error allowed in one step relative to a state's size.
    pub rtol: f64,
    /// Error allowed in one step beside that, in the states' units.
    pub atol: f64,
    /// How the input runs between samples; default held. Before the first sample it is u(0).
    pub hold: Hold,
    /// Delay of each input, seconds; empty: none.
    pub input_delay_s: Vec<f64>,
}

impl Default for EquationOptions {
    /// Tight tolerances: the response is to differ from a measured one by the model alone.
    fn default() -> Self {
        Self { rtol: 1e-9, atol: 1e-12, hold: Hold::Zero, input_delay_s: Vec::new() }
    }
}

/// Equations with their input and parameters, as the right-hand side of an integration. The input is u + slope·(t − since).
#[derive(Debug)]
pub struct DrivenEquations<'a> {
    equations: &'a Equations,
    p: &'a [f64],
    workspace: Workspace,
    u: Vec<f64>,
    slope: Vec<f64>,
    since: f64,
    now: Vec<f64>,
}

impl<'a> DrivenEquations<'a> {
    /// With all inputs at 0.
    #[must_use]
    pub fn new(equations: &'a Equations, p: &'a [f64]) -> Self {
        let zeros = vec![0.0; equations.input_symbols().len()];
        Self { equations, p, workspace: equations.workspace(), u: zeros.clone(), slope: zeros.clone(), since: 0.0, now: zeros }
    }

    /// Holds the inputs at these values.
    pub fn hold(&mut self, u: &[f64]) {
        self.u.copy_from_slice(u);
        self.now.copy_from_slice(u);
        self.slope.fill(0.0);
    }

    fn ramp(&mut self, since: f64, u: &[f64], slope: &[f64]) {
        self.u.copy_from_slice(u);
        self.now.copy_from_slice(u);
        self.slope.copy_from_slice(slope);
        self.since = since;
    }

    /// The input at time t.
    fn input(&mut self, t: f64) {
        if self.slope.iter().any(|s| *s != 0.0) {
            for ((now, u), slope) in self.now.iter_mut().zip(&self.u).zip(&self.slope) {
                *now = u + slope * (t - self.since);
            }
        }
    }
}

impl Rhs for DrivenEquations<'_> {
    fn dim(&self) -> usize {
        self.equations.state_variables().len()
    }

    #[inline]
    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.input(t);
        self.equations.derivatives(t, x, &self.now, self.p, &mut self.workspace, dx);
    }

    fn jacobian(&mut self, t: f64, x: &mut [f64], _dx: &[f64], _scratch: &mut [f64], jacobian: &mut [f64]) {
        self.input(t);
        self.equations.derivatives_jacobian(Wrt::States, t, x, &self.now, self.p, &mut self.workspace, jacobian);
    }
}

/// The input of a log as a function of time, with a delay per input.
struct Signal<'a> {
    time_s: &'a [f64],
    u: &'a DMatrix<f64>,
    delays: Vec<f64>,
    hold: Hold,
}

impl Signal<'_> {
    /// Value and slope of input j in the stretch of time around t, which no edge lies in; the value is that at `from`.
    fn around(&self, j: usize, t: f64, from: f64) -> (f64, f64) {
        let (t, from) = (t - self.delays[j], from - self.delays[j]);
        let after = self.time_s.partition_point(|s| *s <= t);
        match (after.checked_sub(1), self.hold) {
            (None, _) => (self.u[(0, j)], 0.0),
            (Some(k), Hold::Linear) if k + 1 < self.time_s.len() => {
                let slope = (self.u[(k + 1, j)] - self.u[(k, j)]) / (self.time_s[k + 1] - self.time_s[k]);
                (self.u[(k, j)] + slope * (from - self.time_s[k]), slope)
            }
            (Some(k), _) => (self.u[(k, j)], 0.0),
        }
    }

    /// Edges of delayed inputs within a sample, and the sample's end.
    fn edges(&self, from: f64, to: f64, edges: &mut Vec<f64>) {
        edges.clear();
        let near = 1e-9 * (to - from) + 4.0 * f64::EPSILON * to.abs();
        for &delay in self.delays.iter().filter(|d| **d > 0.0) {
            let first = self.time_s.partition_point(|s| s + delay <= from + near);
            edges.extend(self.time_s[first..].iter().map(|s| s + delay).take_while(|&e| e < to - near));
        }
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|later, earlier| *later - *earlier <= near);
        edges.push(to);
    }
}

fn check(
    equations: &Equations,
    time_s: &[f64],
    u: &DMatrix<f64>,
    x0: &[f64],
    p: &[f64],
    options: &EquationOptions,
) -> Result<(), SimulateError> {
    let (inputs, states, parameters) = (equations.input_symbols().len(), equations.state_variables().len(), equations.parameters().len());
    if u.ncols() != inputs {
        return Err(SimulateError::Inputs { needed: inputs, got: u.ncols() });
    }
    if u.nrows() != time_s.len() {
        return Err(SimulateError::Samples { time: time_s.len(), input: u.nrows() });
    }
    if x0.len() != states {
        return Err(SimulateError::InitialState { needed: states, got: x0.len() });
    }
    if p.len() != parameters {
        return Err(SimulateError::Parameters { needed: parameters, got: p.len() });
    }
    if !(options.input_delay_s.is_empty() || options.input_delay_s.len() == inputs) {
        return Err(SimulateError::Inputs { needed: inputs, got: options.input_delay_s.len() });
    }
    if let Some(&seconds) = options.input_delay_s.iter().find(|d| !(d.is_finite() && **d >= 0.0)) {
        return Err(crate::time::TimeError::Delay { seconds }.into());
    }
    if let Some(k) = (1..time_s.len()).find(|&k| time_s[k].partial_cmp(&time_s[k - 1]) != Some(std::cmp::Ordering::Greater)) {
        return Err(SimulateError::Time { sample: k, before_s: time_s[k - 1], after_s: time_s[k] });
    }
    match u.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(SimulateError::NotFinite { input: at / u.nrows(), sample: at % u.nrows(), value: u.as_slice()[at] }),
        None => Ok(()),
    }
}

/// Response of a nonlinear model on time stamps that need not be even; u is samples × inputs, `x0` the state at the first sample, `p` the parameters.
///
/// The equations' `time` counts from the first stamp, as everything that speaks of a log's time does.
///
/// # Errors
/// [`SimulateError`]: shapes that do not fit, an input that is not finite, equations that are undefined (which, and which part), explode or are too stiff.
pub fn simulate_equations(
    equations: &Equations,
    time_s: &[f64],
    u: &DMatrix<f64>,
    x0: &[f64],
    p: &[f64],
    options: &EquationOptions,
) -> Result<Response, SimulateError> {
    check(equations, time_s, u, x0, p, options)?;
    let (samples, n, m) = (time_s.len(), x0.len(), u.ncols());
    let outputs = equations.output_variables().len();
    let delays = if options.input_delay_s.is_empty() { vec![0.0; m] } else { options.input_delay_s.clone() };
    let start = time_s.first().copied().unwrap_or(0.0);
    let time_s: Vec<f64> = time_s.iter().map(|t| t - start).collect();
    let signal = Signal { time_s: &time_s, u, delays, hold: options.hold };
    let mut rhs = DrivenEquations::new(equations, p);
    let mut integrator = Integrator::with_tolerance(n, options.rtol, options.atol);
    let mut workspace = equations.workspace();
    let (mut state, mut row, mut value, mut slope) = (x0.to_vec(), vec![0.0; outputs], vec![0.0; m], vec![0.0; m]);
    let (mut y, mut x) = (DMatrix::zeros(samples, outputs), DMatrix::zeros(samples, n));
    let mut edges = Vec::new();
    for k in 0..samples {
        let t = time_s[k];
        let next = time_s.get(k + 1).copied();
        // A delayed edge that only rounding parts from the sample belongs to it.
        let just_after = t + next.map_or(0.0, |next| 2e-9 * (next - t)) + 8.0 * f64::EPSILON * t;
        for (j, value) in value.iter_mut().enumerate() {
            *value = signal.around(j, just_after, t).0;
        }
        equations.outputs(t, &state, &value, p, &mut workspace, &mut row);
        if !row.iter().all(|v| v.is_finite()) {
            return Err(undefined(equations, t, &state, &value, p));
        }
        row.iter().enumerate().for_each(|(i, v)| y[(k, i)] = *v);
        state.iter().enumerate().for_each(|(i, v)| x[(k, i)] = *v);
        let Some(next) = next else { break };
        signal.edges(t, next, &mut edges);
        let mut at = t;
        for &edge in &edges {
            for j in 0..m {
                (value[j], slope[j]) = signal.around(j, 0.5 * (at + edge), at);
            }
            rhs.ramp(at, &value, &slope);
            if let Err(error) = integrator.advance(&mut rhs, at, edge, &mut state) {
                return Err(match (error, integrator.breakdown()) {
                    (SimulateError::Undefined { time_s }, Some((t, x))) => {
                        rhs.input(t);
                        equations.explain(t, x, &rhs.now, p).map_or(SimulateError::Undefined { time_s }, SimulateError::Equation)
                    }
                    (error, _) => error,
                });
            }
            at = edge;
        }
    }
    Ok(Response { y, x })
}

fn undefined(equations: &Equations, t: f64, x: &[f64], u: &[f64], p: &[f64]) -> SimulateError {
    equations.explain(t, x, u, p).map_or(SimulateError::Undefined { time_s: t }, SimulateError::Equation)
}

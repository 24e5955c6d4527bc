//! One window: the model from a row of the log over the horizon, with exact sensitivities (the tangents of a Runge-Kutta step of order four).

use super::group::Group;
use super::record::LogRecord;
use deadtime_model::{Directions, Equations, Workspace};

/// What all windows share.
#[derive(Debug)]
pub(super) struct Simulator<'a> {
    pub(super) equations: &'a Equations,
    /// Starts that are expressions, and whose they are.
    pub(super) starts: Option<&'a (Equations, Vec<usize>)>,
    pub(super) groups: &'a [Group],
    /// Which states start from the log.
    pub(super) logged: &'a [bool],
    pub(super) step_s: f64,
    pub(super) substeps: usize,
    pub(super) horizon: usize,
}

/// Parameters, the directions in which they move, and how far the unlogged states' starts are moved.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowPoint<'a> {
    pub(super) p: &'a [f64],
    /// Which parameter each direction moves, and by how much for a unit step.
    pub(super) columns: &'a [(usize, f64)],
    /// States whose start is a further direction.
    pub(super) starts: &'a [usize],
    /// How far each of those starts from the model's `initial`.
    pub(super) shift: &'a [f64],
}

/// Memory of a walk; one for each thread at work.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    workspace: Workspace,
    seeds: Vec<f64>,
    x: [Vec<f64>; 2],
    s: [Vec<f64>; 2],
    k: [Vec<f64>; 4],
    dk: [Vec<f64>; 4],
    y: Vec<f64>,
    dy: Vec<f64>,
    e: Vec<f64>,
    de: Vec<f64>,
}

/// The error of one group at one horizon.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowError<'a> {
    pub(super) group: usize,
    /// From 1.
    pub(super) horizon: usize,
    pub(super) error: &'a [f64],
    /// Components × directions, row by row.
    pub(super) slopes: &'a [f64],
}

impl Simulator<'_> {
    /// Walks a window and shows every error there is. False where the model left the finite numbers.
    pub(super) fn walk(
        &self,
        record: &LogRecord,
        start: usize,
        at: WindowPoint<'_>,
        b: &mut Buffers,
        mut see: impl FnMut(WindowError<'_>),
    ) -> bool {
        let m = self.equations.input_symbols().len();
        let outputs = self.equations.output_variables().len();
        let count = at.columns.len() + at.starts.len();
        self.clear(&at, count, b);
        self.start(record, start, &at, count, b);
        let h = self.step_s / self.substeps as f64;
        for step in 1..=self.horizon {
            let row = start + step - 1;
            let u = &record.u[row * m..(row + 1) * m];
            for sub in 0..self.substeps {
                self.runge_kutta(row as f64 * self.step_s + sub as f64 * h, h, u, at.p, count, b);
            }
            if !b.x[0].iter().all(|v| v.is_finite()) {
                return false;
            }
            let row = start + step;
            let directions = Directions { count, states: &b.s[0], parameters: &b.seeds };
            let u = &record.u[row * m..(row + 1) * m];
            self.equations.outputs_along(
                row as f64 * self.step_s,
                &b.x[0],
                u,
                at.p,
                directions,
                &mut b.workspace,
                &mut b.y,
                &mut b.dy,
            );
            let logged = &record.y[row * outputs..(row + 1) * outputs];
            for (g, group) in self.groups.iter().enumerate() {
                if !group.error(&b.y, &b.dy, count, logged, &mut b.e, &mut b.de) {
                    continue;
                }
                let (error, slopes) = (&b.e[..group.size()], &b.de[..group.size() * count]);
                if !error.iter().all(|v| v.is_finite()) {
                    return false;
                }
                see(WindowError { group: g, horizon: step, error, slopes });
            }
        }
        true
    }

    /// Buffers of the right sizes, zero but for the parameters' directions.
    fn clear(&self, at: &WindowPoint<'_>, count: usize, b: &mut Buffers) {
        let (n, outputs) =
            (self.equations.state_variables().len(), self.equations.output_variables().len());
        let resize = |v: &mut Vec<f64>, size: usize| {
            v.clear();
            v.resize(size, 0.0);
        };
        resize(&mut b.seeds, at.p.len() * count);
        for (j, &(parameter, unit)) in at.columns.iter().enumerate() {
            b.seeds[parameter * count + j] = unit;
        }
        b.x.iter_mut().chain(&mut b.k).for_each(|v| resize(v, n));
        b.s.iter_mut().chain(&mut b.dk).for_each(|v| resize(v, n * count));
        resize(&mut b.y, outputs);
        resize(&mut b.dy, outputs * count);
        let widest = self.groups.iter().map(Group::size).max().unwrap_or(0);
        resize(&mut b.e, widest);
        resize(&mut b.de, widest * count);
    }

    /// The states and sensitivities at the start of a window.
    fn start(
        &self,
        record: &LogRecord,
        start: usize,
        at: &WindowPoint<'_>,
        count: usize,
        b: &mut Buffers,
    ) {
        let (n, m) = (self.equations.state_variables().len(), self.equations.input_symbols().len());
        for (i, state) in self.equations.state_variables().iter().enumerate() {
            b.x[0][i] = if self.logged[i] { record.x[start * n + i] } else { state.initial };
        }
        for (j, (&i, shift)) in at.starts.iter().zip(at.shift).enumerate() {
            b.x[0][i] += shift;
            b.s[0][i * count + at.columns.len() + j] = 1.0;
        }
        let Some((equations, states)) = self.starts else { return };
        let (mut values, mut slopes) = (vec![0.0; states.len()], vec![0.0; states.len() * count]);
        let directions = Directions { count, states: &b.s[0], parameters: &b.seeds };
        let (t, u) = (start as f64 * self.step_s, &record.u[start * m..(start + 1) * m]);
        equations.outputs_along(
            t,
            &b.x[0],
            u,
            at.p,
            directions,
            &mut b.workspace,
            &mut values,
            &mut slopes,
        );
        for (k, &i) in states.iter().enumerate() {
            b.x[0][i] = values[k];
            b.s[0][i * count..(i + 1) * count].copy_from_slice(&slopes[k * count..(k + 1) * count]);
        }
    }

    /// One step of the classical method for states and sensitivities at once.
    fn runge_kutta(&self, t: f64, h: f64, u: &[f64], p: &[f64], count: usize, b: &mut Buffers) {
        let Buffers { workspace, seeds, x, s, k, dk, .. } = b;
        let [x0, x1] = x;
        let [s0, s1] = s;
        for stage in 0..4 {
            let part = [0.0, 0.5, 0.5, 1.0][stage];
            if stage == 0 {
                x1.copy_from_slice(x0);
                s1.copy_from_slice(s0);
            } else {
                let (slope, dslope) = (&k[stage - 1], &dk[stage - 1]);
                for ((to, from), by) in x1.iter_mut().zip(x0.iter()).zip(slope) {
                    *to = from + part * h * by;
                }
                for ((to, from), by) in s1.iter_mut().zip(s0.iter()).zip(dslope) {
                    *to = from + part * h * by;
                }
            }
            let directions = Directions { count, states: s1, parameters: seeds };
            self.equations.derivatives_along(
                t + part * h,
                x1,
                u,
                p,
                directions,
                workspace,
                &mut k[stage],
                &mut dk[stage],
            );
        }
        for (i, to) in x0.iter_mut().enumerate() {
            *to += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
        }
        for (i, to) in s0.iter_mut().enumerate() {
            *to += h / 6.0 * (dk[0][i] + 2.0 * dk[1][i] + 2.0 * dk[2][i] + dk[3][i]);
        }
    }
}

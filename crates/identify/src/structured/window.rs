//! One window: the model from a row of the log over the horizon, with exact sensitivities (the tangents of a fourth-order Runge-Kutta step).

use super::group::Group;
use super::hold::Hold;
use super::record::LogRecord;
use deadtime_model::{Directions, Equations, Workspace};

/// The data common to all windows.
#[derive(Debug)]
pub(super) struct Simulator<'a> {
    pub(super) equations: &'a Equations,
    /// Initial values given by expressions, and their states.
    pub(super) starts: Option<&'a (Equations, Vec<usize>)>,
    pub(super) groups: &'a [Group],
    /// Flags of the states that start from the log.
    pub(super) logged: &'a [bool],
    /// For each input, the input whose dead time applies to it.
    pub(super) leaders: &'a [usize],
    pub(super) step_s: f64,
    pub(super) substeps: usize,
    pub(super) horizon: usize,
}

/// Parameters (dead times last), their directions of change, and the shifts of the unlogged initial states.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowPoint<'a> {
    pub(super) p: &'a [f64],
    /// The parameter that each direction moves, and its change for a unit step.
    pub(super) columns: &'a [(usize, f64)],
    /// States whose initial value is a further direction.
    pub(super) starts: &'a [usize],
    /// The shift of each of those initial values from the model's `initial`.
    pub(super) shift: &'a [f64],
}

/// Work memory of a walk, one per thread.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    workspace: Workspace,
    seeds: Vec<f64>,
    x: [Vec<f64>; 2],
    s: [Vec<f64>; 2],
    k: [Vec<f64>; 4],
    dk: [Vec<f64>; 4],
    /// The acting inputs, and those before the last switch.
    u: [Vec<f64>; 2],
    y: Vec<f64>,
    dy: Vec<f64>,
    e: Vec<f64>,
    de: Vec<f64>,
}

/// The error of one group at one horizon.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowError<'a> {
    pub(super) group: usize,
    /// Horizon, from 1.
    pub(super) horizon: usize,
    pub(super) error: &'a [f64],
    /// All outputs of the model at this horizon.
    pub(super) outputs: &'a [f64],
    /// Components × directions, row by row.
    pub(super) slopes: &'a [f64],
}

impl Simulator<'_> {
    /// Simulates a window and reports every available error. `false` where the model diverges.
    pub(super) fn walk(
        &self,
        record: &LogRecord,
        start: usize,
        at: WindowPoint<'_>,
        b: &mut Buffers,
        mut see: impl FnMut(WindowError<'_>),
    ) -> bool {
        let outputs = self.equations.output_variables().len();
        let count = at.columns.len() + at.starts.len();
        let split = self.equations.parameters().len();
        let (p, delays_s) = at.p.split_at(split);
        let hold = Hold::new(delays_s, self.step_s);
        self.clear(&at, count, b);
        self.start(record, start, &at, &hold, count, b);
        for step in 1..=self.horizon {
            let row = start + step - 1;
            for segment in hold.segments() {
                let t = (row as f64 + segment.from) * self.step_s;
                hold.inputs(record, row, segment.from, &mut b.u[0]);
                self.switch(t, record, (row, segment.from), &at, &hold, count, b);
                // No step is longer than that of a sample without a switch.
                let steps = (self.substeps as f64 * segment.length).ceil().max(1.0);
                let h = segment.length * self.step_s / steps;
                for sub in 0..steps as usize {
                    self.runge_kutta(t + sub as f64 * h, h, p, count, b);
                }
            }
            if !b.x[0].iter().all(|v| v.is_finite()) {
                return false;
            }
            let row = start + step;
            let directions = Directions { count, states: &b.s[0], parameters: &b.seeds };
            // An output with a direct input depends on the value at the sample: between switches a dead time does not move it.
            hold.inputs(record, row, 0.0, &mut b.u[0]);
            self.equations.outputs_along(
                row as f64 * self.step_s,
                &b.x[0],
                &b.u[0],
                p,
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
                see(WindowError { group: g, horizon: step, error, outputs: &b.y, slopes });
            }
        }
        true
    }

    /// Buffers of the right sizes, zero except for the parameters' directions.
    fn clear(&self, at: &WindowPoint<'_>, count: usize, b: &mut Buffers) {
        let (n, outputs) =
            (self.equations.state_variables().len(), self.equations.output_variables().len());
        let resize = |v: &mut Vec<f64>, size: usize| {
            v.clear();
            v.resize(size, 0.0);
        };
        let parameters = self.equations.parameters().len();
        resize(&mut b.seeds, parameters * count);
        for (j, &(i, unit)) in at.columns.iter().enumerate() {
            if i < parameters {
                b.seeds[i * count + j] = unit;
            }
        }
        b.u.iter_mut().for_each(|v| resize(v, self.leaders.len()));
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
        hold: &Hold,
        count: usize,
        b: &mut Buffers,
    ) {
        let n = self.equations.state_variables().len();
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
        hold.inputs(record, start, 0.0, &mut b.u[0]);
        equations.outputs_along(
            start as f64 * self.step_s,
            &b.x[0],
            &b.u[0],
            &at.p[..self.equations.parameters().len()],
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

    /// The effect of switching inputs' dead times on the sensitivities. With a dead time longer by δ, the earlier input acts δ longer; the states move by δ
    /// (f(x, u before) − f(x, u after)).
    ///
    /// Source: Rozenvasser (1967), General sensitivity equations of discontinuous systems, Automation and Remote Control 28, 400-404.
    #[allow(clippy::too_many_arguments)]
    fn switch(
        &self,
        t: f64,
        record: &LogRecord,
        (row, from): (usize, f64),
        at: &WindowPoint<'_>,
        hold: &Hold,
        count: usize,
        b: &mut Buffers,
    ) {
        let p = &at.p[..self.equations.parameters().len()];
        let Buffers { workspace, x, s, k, u, .. } = b;
        let [after, before] = u;
        for (j, &(i, unit)) in at.columns.iter().enumerate() {
            let Some(delayed) = i.checked_sub(p.len()) else { continue };
            before.copy_from_slice(after);
            for (i, _) in self.leaders.iter().enumerate().filter(|(_, l)| **l == delayed) {
                before[i] = hold.before(record, row, from, i).unwrap_or(after[i]);
            }
            if before == after {
                continue;
            }
            let [old, new, ..] = k;
            for (u, to) in [(&*before, old), (&*after, new)] {
                self.equations.derivatives(t, &x[0], u, p, workspace, to);
            }
            for (row, (old, new)) in s[0].chunks_exact_mut(count).zip(k[0].iter().zip(&k[1])) {
                row[j] += unit * (old - new);
            }
        }
    }

    /// One classical Runge-Kutta step for states and sensitivities together.
    fn runge_kutta(&self, t: f64, h: f64, p: &[f64], count: usize, b: &mut Buffers) {
        let Buffers { workspace, seeds, x, s, k, dk, u: [u, _], .. } = b;
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

//! The weighted least-squares problem over all windows: cost, gradient and information of each cluster of windows.

use nalgebra::{DMatrix, DVector};

use super::free::Quantity;
use super::record::LogRecord;
use super::window::{Buffers, Simulator, WindowPoint};
use deadtime_signal::fit::Normal;
use deadtime_signal::parallel;

/// Gauss-Newton rounds for the initial values of unlogged states within a window.
const START_ROUNDS: usize = 4;

/// Approximate number of window clusters behind the covariance.
pub(super) const CLUSTERS: usize = 60;

/// Sizes of the errors by group and horizon, `scale[group][horizon - 1]`, and the limit of the quadratic loss.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    pub(super) scale: Vec<Vec<f64>>,
    /// Huber's threshold in scales.
    pub(super) threshold: f64,
    /// The loss's own curvature instead of the weighted squares': a covariance needs it. Beyond the threshold an error's length has no curvature.
    pub(super) curvature: bool,
}

/// Neighbouring windows of one record: the unit of resampling for the covariance.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    pub(super) record: usize,
    pub(super) starts: Vec<usize>,
}

/// States whose initial value is neither logged nor exactly known.
#[derive(Debug, Clone)]
pub(super) struct Starts {
    pub(super) states: Vec<usize>,
    /// The model's standard deviation of each initial value; infinite: unknown.
    pub(super) std: Vec<f64>,
}

/// The constants of the windows.
#[derive(Debug)]
pub(super) struct StructuredProblem<'a> {
    pub(super) simulator: Simulator<'a>,
    pub(super) records: &'a [LogRecord],
    pub(super) clusters: Vec<Cluster>,
    pub(super) starts: Starts,
    pub(super) quantities: &'a [Quantity],
    /// The longest dead time allowed, in samples: no window starts before that row.
    pub(super) reach: usize,
    /// Parameters of all records: index and size of a unit step.
    pub(super) free: Vec<(usize, f64)>,
    /// Parameters with a deviation by record.
    pub(super) own: Vec<(usize, f64)>,
}

impl StructuredProblem<'_> {
    /// Unknowns: the shared ones, then each record's own.
    pub(super) fn unknowns(&self) -> usize {
        self.free.len() + self.own.len() * self.records.len()
    }

    /// The file's value of a quantity.
    pub(super) fn nominal(&self, i: usize) -> f64 {
        self.quantities[i].nominal
    }

    /// The input of which this quantity is the dead time.
    pub(super) fn delayed(&self, i: usize) -> Option<usize> {
        i.checked_sub(self.simulator.equations.parameters().len())
    }

    /// A record's parameters, then its dead times; no dead time is negative.
    pub(super) fn parameters(&self, record: usize, z: &[f64]) -> Vec<f64> {
        let mut p: Vec<f64> = self.quantities.iter().map(|q| q.nominal).collect();
        let first = self.simulator.equations.parameters().len();
        let own = self.free.len() + record * self.own.len();
        let shared = self.free.iter().zip(z);
        for (&(i, unit), v) in shared.chain(self.own.iter().zip(z.get(own..).unwrap_or(&[]))) {
            match self.delayed(i) {
                None => p[i] += unit * v,
                Some(input) => {
                    let led = self.simulator.leaders.iter().zip(&mut p[first..]);
                    led.filter(|(l, _)| **l == input).for_each(|(_, to)| *to += unit * v);
                }
            }
        }
        p[first..].iter_mut().for_each(|delay_s| *delay_s = delay_s.max(0.0));
        p
    }

    /// Excludes windows that start before row `reach`: a dead time up to that many samples then needs no input from before a record. All dead times are
    /// compared on the same windows, at least half of them. `reach` is therefore bounded by the row at which half of the windows have begun.
    pub(super) fn reach(&mut self, reach: usize) {
        let mut starts: Vec<usize> =
            self.records.iter().flat_map(|r| r.windows.iter().copied()).collect();
        starts.sort_unstable();
        self.reach = reach.min(starts.get(starts.len() / 2).copied().unwrap_or(0));
        self.clusters = clusters(self.records, self.reach);
    }

    /// Bounds of the unknowns: shared dead times are not negative, and no longer than [`Self::reach`] allows.
    pub(super) fn bounds(&self) -> [Vec<f64>; 2] {
        let longest_s = self.simulator.step_s * self.reach as f64;
        let mut bounds =
            [vec![f64::NEG_INFINITY; self.unknowns()], vec![f64::INFINITY; self.unknowns()]];
        for (at, &(i, size)) in self.free.iter().enumerate() {
            if self.delayed(i).is_some() {
                let nominal = self.nominal(i);
                bounds[0][at] = -nominal / size;
                bounds[1][at] = (longest_s - nominal) / size;
            }
        }
        bounds
    }

    /// The index of a cluster's direction among the unknowns.
    pub(super) fn place(&self, record: usize, direction: usize) -> usize {
        if direction < self.free.len() { direction } else { direction + record * self.own.len() }
    }

    /// Cost, gradient and information of every cluster, in its own directions (shared, then its record's). `None` where a window diverges.
    pub(super) fn clusters(&self, z: &[f64], weights: &Weights) -> Option<Vec<Normal>> {
        let columns: Vec<(usize, f64)> = self.free.iter().chain(&self.own).copied().collect();
        let one = |cluster: &Cluster| {
            let p = self.parameters(cluster.record, z);
            let record = &self.records[cluster.record];
            let mut buffers = Buffers::default();
            let mut sum = Sum::new(columns.len() + self.starts.states.len());
            let mut total = Sum::new(columns.len());
            for &start in &cluster.starts {
                self.window(record, start, &p, &columns, weights, &mut buffers, &mut sum)?;
                total.add_reduced(&sum);
            }
            Some(total.normal())
        };
        parallel::try_map(&self.clusters, one)
    }

    /// Adds one window to `sum`, with the optimal initial values of unlogged states. Returns the deviations of these initial values from the model's own.
    /// `None` where the window diverges.
    #[allow(clippy::too_many_arguments)]
    fn window(
        &self,
        record: &LogRecord,
        start: usize,
        p: &[f64],
        columns: &[(usize, f64)],
        weights: &Weights,
        buffers: &mut Buffers,
        sum: &mut Sum,
    ) -> Option<Vec<f64>> {
        let Starts { states, std } = &self.starts;
        let mut shift = vec![0.0; states.len()];
        let shared = columns.len();
        // The model's own initial value is known only at the start of the log.
        let trusted = |s: f64| if start == 0 { s } else { f64::INFINITY };
        let mut pass = |shift: &[f64], curvature: bool, sum: &mut Sum| {
            sum.clear();
            let at = WindowPoint { p, columns, starts: states, shift };
            let finite = self.simulator.walk(record, start, at, buffers, |seen| {
                let scale = weights.scale[seen.group][seen.horizon - 1];
                sum.add(seen.error, seen.slopes, scale, weights.threshold, curvature);
            });
            for (j, (s, v)) in std.iter().zip(shift).enumerate() {
                sum.prior(shared + j, *v, trusted(*s));
            }
            finite.then_some(())
        };
        // Steps by weighted squares: far from the minimum, the loss's own curvature is not that of the minimum.
        for _ in 0..if states.is_empty() { 0 } else { START_ROUNDS } {
            pass(&shift, false, sum)?;
            let Some(step) = sum.start_step(shared) else { break };
            let small = step
                .iter()
                .zip(std)
                .all(|(d, s)| d.abs() <= 1e-9 * if s.is_finite() { *s } else { d.abs().max(1.0) });
            shift.iter_mut().zip(&step).for_each(|(v, d)| *v += d);
            if small {
                break;
            }
        }
        pass(&shift, weights.curvature, sum)?;
        Some(shift)
    }

    /// Squared errors without Huber's limit, each group's errors relative to its spread in a record.
    pub(super) fn plain_weights(&self, record: usize) -> Weights {
        let (y, outputs) =
            (&self.records[record].y, self.simulator.equations.output_variables().len());
        let scale = self
            .simulator
            .groups
            .iter()
            .map(|group| vec![group.spread(y, outputs); self.simulator.horizon])
            .collect();
        Weights { scale, threshold: f64::INFINITY, curvature: false }
    }

    /// The best initial values of a window with these weights.
    pub(super) fn start_of(
        &self,
        record: usize,
        start: usize,
        p: &[f64],
        weights: &Weights,
        buffers: &mut Buffers,
    ) -> Option<Vec<f64>> {
        if self.starts.states.is_empty() {
            return Some(Vec::new());
        }
        self.window(
            &self.records[record],
            start,
            p,
            &[],
            weights,
            buffers,
            &mut Sum::new(self.starts.states.len()),
        )
    }

    /// The clusters' sums over all unknowns, with a prior of unit size times `weight` on each.
    pub(super) fn normal(&self, clusters: &[Normal], z: &[f64], prior: &[f64]) -> Normal {
        let size = self.unknowns();
        let mut all = Normal {
            cost: 0.0,
            gradient: DVector::zeros(size),
            information: DMatrix::zeros(size, size),
        };
        for (cluster, normal) in self.clusters.iter().zip(clusters) {
            self.scatter(cluster.record, normal, &mut all, 1.0);
        }
        for i in 0..size {
            all.cost += prior[i] * z[i] * z[i];
            all.gradient[i] += prior[i] * z[i];
            all.information[(i, i)] += prior[i];
        }
        all
    }

    /// Adds a cluster's sums times `sign` to those of all unknowns.
    pub(super) fn scatter(&self, record: usize, normal: &Normal, all: &mut Normal, sign: f64) {
        all.cost += sign * normal.cost;
        let places: Vec<usize> =
            (0..normal.gradient.len()).map(|i| self.place(record, i)).collect();
        for (i, &to) in places.iter().enumerate() {
            all.gradient[to] += sign * normal.gradient[i];
            for (j, &other) in places.iter().enumerate() {
                all.information[(to, other)] += sign * normal.information[(i, j)];
            }
        }
    }
}

/// Groups of neighbouring windows, about [`CLUSTERS`] of them, each within one record. Windows that start before row `from` are excluded.
pub(super) fn clusters(records: &[LogRecord], from: usize) -> Vec<Cluster> {
    let kept = |r: &LogRecord| {
        r.windows.iter().copied().filter(|start| *start >= from).collect::<Vec<_>>()
    };
    let all: usize = records.iter().map(|r| kept(r).len()).sum();
    let size = all.div_ceil(CLUSTERS).max(1);
    let of = |(record, r): (usize, &LogRecord)| {
        let windows = kept(r);
        let parts = windows.len().div_ceil(size);
        let each = windows.len().div_ceil(parts.max(1)).max(1);
        windows
            .chunks(each)
            .map(|starts| Cluster { record, starts: starts.to_vec() })
            .collect::<Vec<_>>()
    };
    records.iter().enumerate().flat_map(of).collect()
}

/// Sums of one window or cluster; only the lower half of the information is kept.
#[derive(Debug)]
struct Sum {
    size: usize,
    cost: f64,
    gradient: Vec<f64>,
    information: Vec<f64>,
}

impl Sum {
    fn new(size: usize) -> Self {
        Self { size, cost: 0.0, gradient: vec![0.0; size], information: vec![0.0; size * size] }
    }

    fn clear(&mut self) {
        self.cost = 0.0;
        self.gradient.fill(0.0);
        self.information.fill(0.0);
    }

    /// Huber's loss of an error's length in scales, as weighted squares (twice the loss, so that small errors count as their squares).
    fn add(&mut self, error: &[f64], slopes: &[f64], scale: f64, threshold: f64, curvature: bool) {
        let n = self.size;
        let length = error.iter().map(|e| e * e).sum::<f64>().sqrt() / scale;
        let mut weight = 1.0 / (scale * scale);
        if length <= threshold {
            self.cost += length * length;
        } else {
            self.cost += threshold * (2.0 * length - threshold);
            weight *= threshold / length;
            if curvature {
                let along = |i: usize| {
                    error.iter().enumerate().map(|(k, e)| e * slopes[k * n + i]).sum::<f64>()
                        / (length * scale)
                };
                let along: Vec<f64> = (0..n).map(along).collect();
                for (i, by) in along.iter().enumerate() {
                    for (to, of) in self.information[i * n..=i * n + i].iter_mut().zip(&along) {
                        *to -= weight * by * of;
                    }
                }
            }
        }
        for (e, row) in error.iter().zip(slopes.chunks_exact(n.max(1))) {
            for i in 0..n {
                let by = weight * row[i];
                if by != 0.0 {
                    self.gradient[i] += by * e;
                    for (to, s) in self.information[i * n..=i * n + i].iter_mut().zip(row) {
                        *to += by * s;
                    }
                }
            }
        }
    }

    fn prior(&mut self, at: usize, value: f64, std: f64) {
        if std.is_finite() {
            self.cost += (value / std).powi(2);
            self.gradient[at] += value / (std * std);
            self.information[at * self.size + at] += 1.0 / (std * std);
        }
    }

    fn lower(&self, i: usize, j: usize) -> f64 {
        let (i, j) = (i.max(j), i.min(j));
        self.information[i * self.size + j]
    }

    /// The information of the directions from `first` on, with a small ridge for undetermined directions.
    fn of_starts(&self, first: usize) -> Option<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
        let count = self.size - first;
        let largest =
            (first..self.size).map(|i| self.lower(i, i)).fold(f64::MIN_POSITIVE, f64::max);
        DMatrix::from_fn(count, count, |i, j| {
            self.lower(first + i, first + j) + if i == j { 1e-12 * largest } else { 0.0 }
        })
        .cholesky()
    }

    fn start_step(&self, first: usize) -> Option<Vec<f64>> {
        let right =
            DVector::from_iterator(self.size - first, self.gradient[first..].iter().map(|g| -g));
        Some(self.of_starts(first)?.solve(&right).iter().copied().collect())
    }

    /// Adds a window, its own initial values eliminated (Schur complement).
    fn add_reduced(&mut self, window: &Self) {
        let n = self.size;
        self.cost += window.cost;
        for i in 0..n {
            self.gradient[i] += window.gradient[i];
            for j in 0..=i {
                self.information[i * n + j] += window.lower(i, j);
            }
        }
        let count = window.size - n;
        let Some(factor) = (count > 0).then(|| window.of_starts(n)).flatten() else { return };
        let cross = DMatrix::from_fn(count, n, |i, j| window.lower(n + i, j));
        let solved = factor.solve(&cross);
        let own = DVector::from_column_slice(&window.gradient[n..]);
        for i in 0..n {
            self.gradient[i] -= solved.column(i).dot(&own);
            for j in 0..=i {
                self.information[i * n + j] -= solved.column(i).dot(&cross.column(j));
            }
        }
    }

    fn normal(&self) -> Normal {
        Normal {
            cost: self.cost,
            gradient: DVector::from_column_slice(&self.gradient),
            information: DMatrix::from_fn(self.size, self.size, |i, j| self.lower(i, j)),
        }
    }
}

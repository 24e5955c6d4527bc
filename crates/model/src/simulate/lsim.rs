//! Response of a linear model to a sampled input.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use pulp::{Arch, Simd, WithSimd};

use super::error::SimulateError;
use crate::c2d::hold::{Hold, delayed_taps, transition};
use crate::state_space::{Continuous, Sampled, StateSpace, TimeDomain};
use deadtime_signal::time::SampleTime;

/// The input before the first sample, on which a delayed input depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prehistory {
    /// u(0), as in the log format.
    #[default]
    Held,
    /// 0.
    Rest,
}

/// Options of the simulation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// The state at the first sample; `None`: 0.
    pub initial: Option<DVector<f64>>,
    /// The hold of the input between samples; default zero-order.
    pub hold: Hold,
    /// The input before the first sample; default u(0).
    pub prehistory: Prehistory,
}

/// A simulated response; one row per sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Outputs, samples × outputs.
    pub y: DMatrix<f64>,
    /// States at the sampling instants, samples × states.
    pub x: DMatrix<f64>,
}

/// One step of the recursion without its zeros: rows of x(k+1) and y(k) as sums over (x(k), tap values).
struct Recursion {
    /// Row ends into `terms`: first the states, then the outputs.
    ends: Vec<usize>,
    /// (index into the vector of states and taps, coefficient).
    terms: Vec<(u32, f64)>,
    /// Input column and lag of every tap.
    taps: Vec<(usize, isize)>,
    states: usize,
}

impl Recursion {
    /// From Φ, C and, for every tap, its input, lag, Γ and its column of D.
    fn new(
        phi: &DMatrix<f64>,
        c: &DMatrix<f64>,
        taps: &[(usize, isize, DVector<f64>, DVector<f64>)],
    ) -> Self {
        let n = phi.nrows();
        let (mut ends, mut terms) = (Vec::with_capacity(n + c.nrows()), Vec::new());
        // Indices count states and taps of one model: far below 2³².
        let mut row = |of_state: &dyn Fn(usize) -> f64, of_tap: &dyn Fn(usize) -> f64| {
            let states = (0..n).map(|j| (j as u32, of_state(j)));
            let inputs = (0..taps.len()).map(|t| ((n + t) as u32, of_tap(t)));
            terms.extend(states.chain(inputs).filter(|(_, v)| *v != 0.0));
            ends.push(terms.len());
        };
        for i in 0..n {
            row(&|j| phi[(i, j)], &|t| taps[t].2[i]);
        }
        for i in 0..c.nrows() {
            row(&|j| c[(i, j)], &|t| taps[t].3[i]);
        }
        Self { ends, terms, taps: taps.iter().map(|t| (t.0, t.1)).collect(), states: n }
    }

    /// The delayed inputs of a block of samples, sample by sample.
    fn gather(
        &self,
        u: &DMatrix<f64>,
        prehistory: Prehistory,
        block: Range<usize>,
        taps: &mut [f64],
    ) {
        let (samples, width, start, count) = (u.nrows(), self.taps.len(), block.start, block.len());
        for (t, &(input, lag)) in self.taps.iter().enumerate() {
            let column = &u.as_slice()[input * samples..(input + 1) * samples];
            let past =
                start.checked_add_signed(-lag).and_then(|from| column.get(from..from + count));
            if let Some(past) = past {
                for (k, &value) in past.iter().enumerate() {
                    taps[k * width + t] = value;
                }
                continue;
            }
            for k in 0..count {
                taps[k * width + t] = match (start + k).checked_add_signed(-lag) {
                    Some(at) if at < samples => column[at],
                    Some(_) => column[samples - 1],
                    None if prehistory == Prehistory::Held => column[0],
                    None => 0.0,
                };
            }
        }
    }

    fn run(
        &self,
        u: &DMatrix<f64>,
        initial: Option<&DVector<f64>>,
        prehistory: Prehistory,
        ts: f64,
    ) -> Result<Response, SimulateError> {
        let samples = u.nrows();
        let n = self.states;
        let outputs = self.ends.len() - n;
        // Zeroed memory that is first touched when it is written.
        let (mut y, mut x) = (vec![0.0; samples * outputs], vec![0.0; samples * n]);
        let arch = Arch::new();
        let dense = Dense::new(self);
        let (width, stride) = (self.taps.len(), dense.stride);
        let mut taps = vec![0.0; BLOCK * width];
        // The first row holds the initial state of a block.
        let mut rows = vec![0.0; (BLOCK + 1) * stride];
        if let Some(x0) = initial {
            rows[..n].copy_from_slice(x0.as_slice());
        }
        if samples > 0 {
            for (i, &value) in rows[..n].iter().enumerate() {
                x[i * samples] = value;
            }
        }
        for start in (0..samples).step_by(BLOCK) {
            let count = BLOCK.min(samples - start);
            self.gather(u, prehistory, start..start + count, &mut taps);
            arch.dispatch(Steps { dense: &dense, taps: &taps, count, rows: &mut rows });
            // Row k of the block holds x[start + k + 1], then y[start + k].
            let block = &rows[stride..(count + 1) * stride];
            let known = count.min(samples - start - 1);
            let mut finite = true;
            for i in 0..n {
                let to = i * samples + start + 1;
                let to = &mut x[to..to + known];
                put_column(to, block, stride, i);
                finite &= to.iter().fold(true, |finite, value| finite & value.is_finite());
            }
            for i in 0..outputs {
                let to = i * samples + start;
                put_column(&mut y[to..to + count], block, stride, n + i);
            }
            if !finite {
                let first = block
                    .chunks_exact(stride)
                    .position(|row| row[..n].iter().any(|v| !v.is_finite()))
                    .unwrap_or(0);
                return Err(SimulateError::Explodes { time_s: (start + first + 1) as f64 * ts });
            }
            rows.copy_within(count * stride..(count + 1) * stride, 0);
        }
        Ok(Response {
            y: DMatrix::from_vec(samples, outputs, y),
            x: DMatrix::from_vec(samples, n, x),
        })
    }
}

/// One entry of every row.
fn put_column(to: &mut [f64], rows: &[f64], stride: usize, at: usize) {
    for (to, row) in to.iter_mut().zip(rows.chunks_exact(stride)) {
        *to = row[at];
    }
}

/// Samples between two checks that the state is finite.
const BLOCK: usize = 128;
/// Entries of a row that are stepped together; a multiple of every vector length.
const PAD: usize = 8;

/// The recursion as columns of a padded matrix, or by its terms where it is large and sparse.
struct Dense<'a> {
    of: &'a Recursion,
    /// Length of a padded column.
    stride: usize,
    /// One padded column per state, then per tap; empty where the terms are fewer.
    columns: Vec<f64>,
}

impl<'a> Dense<'a> {
    fn new(of: &'a Recursion) -> Self {
        let stride = of.ends.len().max(1).next_multiple_of(PAD);
        let size = stride * (of.states + of.taps.len());
        if stride > 4 * PAD || size > 8 * of.terms.len() {
            return Self { of, stride, columns: Vec::new() };
        }
        let mut columns = vec![0.0; size];
        let mut start = 0;
        for (row, &end) in of.ends.iter().enumerate() {
            for &(at, coefficient) in &of.terms[start..end] {
                columns[at as usize * stride + row] = coefficient;
            }
            start = end;
        }
        Self { of, stride, columns }
    }
}

/// One block of samples: row k + 1 of `rows` becomes x(k+1), y(k); row 0 starts with x\[0\].
struct Steps<'a> {
    dense: &'a Dense<'a>,
    taps: &'a [f64],
    count: usize,
    rows: &'a mut [f64],
}

impl WithSimd for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.dense.columns.is_empty(), self.dense.stride / S::F64_LANES) {
            (false, 1) => self.dense::<S, 1>(simd),
            (false, 2) => self.dense::<S, 2>(simd),
            (false, 3) => self.dense::<S, 3>(simd),
            (false, 4) => self.dense::<S, 4>(simd),
            (false, 6) => self.dense::<S, 6>(simd),
            (false, 8) => self.dense::<S, 8>(simd),
            _ => self.by_terms(),
        }
    }
}

impl Steps<'_> {
    /// V vectors of rows; the taps first, because they are independent of the state.
    #[inline(always)]
    fn dense<S: Simd, const V: usize>(self, simd: S) {
        let (n, stride) = (self.dense.of.states, self.dense.stride);
        let (columns, _) = S::as_simd_f64s(&self.dense.columns);
        let (states, inputs) = columns.split_at(n * V);
        let zero = simd.splat_f64s(0.0);
        let width = self.dense.of.taps.len();
        let mut rows = self.rows.chunks_exact_mut(stride).take(self.count + 1);
        let Some(mut state) = rows.next() else { return };
        for (k, row) in rows.enumerate() {
            let taps = &self.taps[k * width..(k + 1) * width];
            let driven = combine::<S, V>(simd, inputs, taps, [[zero; V]; 2]);
            let sum = combine::<S, V>(simd, states, &state[..n], driven);
            let (to, _) = S::as_mut_simd_f64s(row);
            for v in 0..V {
                to[v] = simd.add_f64s(sum[0][v], sum[1][v]);
            }
            state = row;
        }
    }

    fn by_terms(self) {
        let Recursion { ends, terms, taps, states } = self.dense.of;
        let mut rows = self.rows.chunks_exact_mut(self.dense.stride).take(self.count + 1);
        let Some(mut state) = rows.next() else { return };
        for (k, row) in rows.enumerate() {
            let taps = &self.taps[k * taps.len()..(k + 1) * taps.len()];
            let value = |at: u32| {
                state[..*states]
                    .get(at as usize)
                    .or_else(|| taps.get(at as usize - states))
                    .copied()
                    .unwrap_or(0.0)
            };
            let mut start = 0;
            for (to, &end) in row.iter_mut().zip(ends) {
                *to = terms[start..end]
                    .iter()
                    .map(|&(at, coefficient)| coefficient * value(at))
                    .sum();
                start = end;
            }
            state = row;
        }
    }
}

/// Σ columns·values in two partial sums, which halves the latency.
#[inline(always)]
fn combine<S: Simd, const V: usize>(
    simd: S,
    columns: &[S::f64s],
    values: &[f64],
    mut sum: [[S::f64s; V]; 2],
) -> [[S::f64s; V]; 2] {
    let (pairs, of_pairs) = (values.chunks_exact(2), columns.chunks_exact(2 * V));
    let (last, of_last) = (pairs.remainder(), of_pairs.remainder());
    for (values, columns) in pairs.zip(of_pairs) {
        let (even, odd) = (simd.splat_f64s(values[0]), simd.splat_f64s(values[1]));
        for v in 0..V {
            sum[0][v] = simd.mul_add_e_f64s(columns[v], even, sum[0][v]);
            sum[1][v] = simd.mul_add_e_f64s(columns[V + v], odd, sum[1][v]);
        }
    }
    if let (&[value], true) = (last, of_last.len() >= V) {
        let value = simd.splat_f64s(value);
        for v in 0..V {
            sum[0][v] = simd.mul_add_e_f64s(of_last[v], value, sum[0][v]);
        }
    }
    sum
}

fn check(
    u: &DMatrix<f64>,
    inputs: usize,
    states: usize,
    options: &Options,
) -> Result<(), SimulateError> {
    if u.ncols() != inputs {
        return Err(SimulateError::Inputs { needed: inputs, got: u.ncols() });
    }
    if let Some(x0) = options.initial.as_ref().filter(|x0| x0.len() != states) {
        return Err(SimulateError::InitialState { needed: states, got: x0.len() });
    }
    match u.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(SimulateError::NotFinite {
            input: at / u.nrows(),
            sample: at % u.nrows(),
            value: u.as_slice()[at],
        }),
        None => Ok(()),
    }
}

/// The sampling times of an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Grid<'a> {
    /// A constant sample time.
    Every(SampleTime),
    /// These times (s, increasing), even or uneven.
    At(&'a [f64]),
}

impl<'a> Grid<'a> {
    /// The grid of these times (s): even where they differ from an even grid by rounding only, which is much faster.
    #[must_use]
    pub fn of(time_s: &'a [f64]) -> Self {
        even(time_s).map_or(Self::At(time_s), Self::Every)
    }
}

impl From<SampleTime> for Grid<'_> {
    fn from(sample_time: SampleTime) -> Self {
        Self::Every(sample_time)
    }
}

impl<'a> From<&'a [f64]> for Grid<'a> {
    fn from(time_s: &'a [f64]) -> Self {
        Self::At(time_s)
    }
}

/// A time domain, [`Continuous`] or [`Sampled`], with a response of linear models.
pub trait Responds: TimeDomain {
    /// As [`lsim`], with checked shapes.
    ///
    /// # Errors
    /// As [`lsim`].
    fn response(
        sys: &StateSpace<Self>,
        u: &DMatrix<f64>,
        grid: Grid<'_>,
        options: &Options,
    ) -> Result<Response, SimulateError>
    where
        Self: Sized;
}

/// Response of a linear model to a sampled input; u is samples × inputs. Exact: no integration error, delays of any size.
///
/// For a continuous model the input is held or interpolated by `options.hold`. On uneven times every piece is integrated exactly and split at the edges of
/// delayed inputs. The cost is one matrix exponential per distinct step length. A sampled model has the grid of its own sample time, and ignores the hold.
///
/// # Errors
/// [`SimulateError`] for shapes that do not match, an input that is not finite, a state that diverges. Likewise for times that do not increase or are
/// not a sampled model's.
pub fn lsim<'g, T: Responds>(
    sys: &StateSpace<T>,
    u: &DMatrix<f64>,
    grid: impl Into<Grid<'g>>,
    options: &Options,
) -> Result<Response, SimulateError> {
    let grid = grid.into();
    if let Grid::At(time_s) = grid
        && time_s.len() != u.nrows()
    {
        return Err(SimulateError::Samples { time: time_s.len(), input: u.nrows() });
    }
    check(u, sys.inputs(), sys.order(), options)?;
    T::response(sys, u, grid, options)
}

impl Responds for Continuous {
    fn response(
        sys: &StateSpace<Self>,
        u: &DMatrix<f64>,
        grid: Grid<'_>,
        options: &Options,
    ) -> Result<Response, SimulateError> {
        match grid {
            Grid::Every(sample_time) => on_even_grid(sys, u, sample_time, options),
            Grid::At(time_s) => at_times(sys, time_s, u, options),
        }
    }
}

impl Responds for Sampled {
    fn response(
        sys: &StateSpace<Self>,
        u: &DMatrix<f64>,
        grid: Grid<'_>,
        options: &Options,
    ) -> Result<Response, SimulateError> {
        let ts = sys.sample_time();
        match grid {
            Grid::Every(given) => off_grid(ts, &[0.0, given.seconds()])?,
            Grid::At(time_s) => off_grid(ts, time_s)?,
        }
        let column = |m: &DMatrix<f64>, j: usize| m.column(j).into_owned();
        let taps: Vec<_> = (sys.input_delay().iter().enumerate())
            .map(|(j, &delay)| {
                (j, 0_isize.saturating_add_unsigned(delay), column(sys.b(), j), column(sys.d(), j))
            })
            .collect();
        Recursion::new(sys.a(), sys.c(), &taps).run(
            u,
            options.initial.as_ref(),
            options.prehistory,
            ts.seconds(),
        )
    }
}

/// Times that are not on a sampled model's grid.
fn off_grid(ts: SampleTime, time_s: &[f64]) -> Result<(), SimulateError> {
    let start_s = time_s.first().copied().unwrap_or(0.0);
    let due = |k: usize| start_s + ts.to_seconds(k as f64);
    // A larger deviation, in samples, indicates another grid.
    let off = |k: &usize| {
        let by_s = (time_s[*k] - due(*k)).abs();
        by_s.is_nan() || by_s > 1e-3 * ts.seconds()
    };
    match (0..time_s.len()).find(off) {
        Some(sample) => {
            Err(SimulateError::Grid { sample, time_s: time_s[sample], due_s: due(sample) })
        }
        None => Ok(()),
    }
}

/// Response of a continuous model to an input sampled every `sample_time`.
fn on_even_grid(
    sys: &StateSpace<Continuous>,
    u: &DMatrix<f64>,
    sample_time: SampleTime,
    options: &Options,
) -> Result<Response, SimulateError> {
    let ts = sample_time.seconds();
    let split = |&delay_s: &f64| match options.hold {
        Hold::Zero => sample_time.samples(delay_s),
        Hold::Linear => sample_time.exact_samples(delay_s),
    };
    let delays = sys.input_delay().iter().map(split).collect::<Result<Vec<_>, _>>()?;
    if (options.hold, options.prehistory) == (Hold::Linear, Prehistory::Rest)
        && delays.iter().any(|d| d.total() > 0.0)
    {
        // The delayed jump from rest to u[0] is not linear between two samples.
        let time_s: Vec<f64> = (0..u.nrows()).map(|k| sample_time.to_seconds(k as f64)).collect();
        return at_times(sys, &time_s, u, options);
    }
    let mut taps = Vec::new();
    let mut push = |input: usize, lag: isize, whole: usize, gamma: DVector<f64>, direct: f64| {
        taps.push((
            input,
            lag.saturating_add_unsigned(whole),
            gamma,
            sys.d().column(input) * direct,
        ));
    };
    let phi = if delays.iter().all(|d| d.fraction == 0.0) {
        let (phi, held, ramp) = transition(sys.a(), sys.b(), ts, options.hold);
        for (input, delay) in delays.iter().enumerate() {
            let held = held.column(input).into_owned();
            match options.hold {
                Hold::Zero => push(input, 0, delay.whole, held, 1.0),
                Hold::Linear => {
                    let ramp = ramp.column(input).into_owned();
                    push(input, 0, delay.whole, held - &ramp, 1.0);
                    push(input, -1, delay.whole, ramp, 0.0);
                }
            }
        }
        phi
    } else {
        for (input, &delay) in delays.iter().enumerate() {
            for tap in delayed_taps(sys.a(), sys.b().column(input), ts, delay, options.hold) {
                push(input, tap.lag, delay.whole, tap.gamma, tap.direct);
            }
        }
        transition(sys.a(), sys.b(), ts, Hold::Zero).0
    };
    Recursion::new(&phi, sys.c(), &taps).run(u, options.initial.as_ref(), options.prehistory, ts)
}

/// Inputs at even or uneven time stamps.
struct Stamped<'a> {
    time_s: &'a [f64],
    u: &'a DMatrix<f64>,
    hold: Hold,
    prehistory: Prehistory,
}

impl Stamped<'_> {
    /// Value of input j at time t, from the left or from the right of an edge. A time within rounding of a stamp equals that stamp.
    fn value(&self, j: usize, t: f64, from_left: bool) -> f64 {
        let (stamps, u) = (self.time_s, self.u);
        let mut after = stamps.partition_point(|s| if from_left { *s < t } else { *s <= t });
        if from_left && after > 0 && t - stamps[after - 1] <= self.slack(after - 1) {
            after -= 1;
        } else if !from_left && after < stamps.len() && stamps[after] - t <= self.slack(after) {
            after += 1;
        }
        match (after, self.hold) {
            (0, _) => match self.prehistory {
                Prehistory::Held => u[(0, j)],
                Prehistory::Rest => 0.0,
            },
            (k, Hold::Linear) if k < stamps.len() => {
                let share = ((t - stamps[k - 1]) / (stamps[k] - stamps[k - 1])).clamp(0.0, 1.0);
                u[(k - 1, j)] * (1.0 - share) + u[(k, j)] * share
            }
            (k, _) => u[(k - 1, j)],
        }
    }

    /// The distance from the stamp `at` within which an instant equals it.
    fn slack(&self, at: usize) -> f64 {
        let stamps = self.time_s;
        let before = at.checked_sub(1).map(|i| stamps[at] - stamps[i]);
        let after = stamps.get(at + 1).map(|next| next - stamps[at]);
        self.coincide() * before.into_iter().chain(after).reduce(f64::min).unwrap_or(0.0)
            + rounding(stamps[at])
    }

    /// The share of a sample within which two instants coincide.
    fn coincide(&self) -> f64 {
        match self.hold {
            Hold::Zero => COINCIDE,
            Hold::Linear => 0.0,
        }
    }

    /// The times of delayed input changes between two times, in order; the later time is the last.
    fn edges(&self, delays: &[f64], (t, end): (f64, f64), edges: &mut Vec<f64>) {
        edges.clear();
        let near = self.coincide() * (end - t) + rounding(end);
        for &delay in delays {
            let first = self.time_s.partition_point(|s| s + delay <= t + near);
            edges.extend(
                self.time_s[first..].iter().map(|s| s + delay).take_while(|&e| e < end - near),
            );
        }
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|later, earlier| *later - *earlier <= near);
        edges.push(end);
    }
}

/// Response of a continuous model on even or uneven time stamps (s, increasing).
fn at_times(
    sys: &StateSpace<Continuous>,
    time_s: &[f64],
    u: &DMatrix<f64>,
    options: &Options,
) -> Result<Response, SimulateError> {
    if let Some(k) = (1..time_s.len())
        .find(|&k| time_s[k].partial_cmp(&time_s[k - 1]) != Some(std::cmp::Ordering::Greater))
    {
        return Err(SimulateError::Time { sample: k, before_s: time_s[k - 1], after_s: time_s[k] });
    }
    let (samples, n, m) = (time_s.len().min(u.nrows()), sys.order(), sys.inputs());
    let inputs = Stamped {
        time_s: &time_s[..samples],
        u,
        hold: options.hold,
        prehistory: options.prehistory,
    };
    let value = |j: usize, t: f64, from_left: bool| inputs.value(j, t, from_left);
    let mut steps = std::collections::HashMap::new();
    let mut state = options.initial.clone().unwrap_or_else(|| DVector::zeros(n));
    let (mut y, mut x) = (DMatrix::zeros(samples, sys.outputs()), DMatrix::zeros(samples, n));
    let delays = sys.input_delay();
    let mut edges = Vec::new();
    for k in 0..samples {
        let t = time_s[k];
        let input = DVector::from_fn(m, |j, _| value(j, t - delays[j], false));
        y.set_row(k, &(sys.c() * &state + sys.d() * input).transpose());
        x.set_row(k, &state.transpose());
        let Some(&end) = time_s[..samples].get(k + 1) else { break };
        inputs.edges(delays, (t, end), &mut edges);
        let mut at = t;
        for &edge in &edges {
            let h = edge - at;
            let (phi, held, ramp) = steps
                .entry(h.to_bits())
                .or_insert_with(|| transition(sys.a(), sys.b(), h, Hold::Linear));
            let (begin, finish) = match options.hold {
                Hold::Zero => {
                    let middle = 0.5 * (at + edge);
                    let held = DVector::from_fn(m, |j, _| value(j, middle - delays[j], false));
                    (held.clone(), held)
                }
                Hold::Linear => (
                    DVector::from_fn(m, |j, _| value(j, at - delays[j], false)),
                    DVector::from_fn(m, |j, _| value(j, edge - delays[j], true)),
                ),
            };
            state = &*phi * state + &*held * &begin + &*ramp * (finish - begin);
            at = edge;
        }
        if state.iter().any(|v| !v.is_finite()) {
            return Err(SimulateError::Explodes { time_s: end });
        }
        if steps.len() > 4096 {
            steps.clear();
        }
    }
    Ok(Response { y, x })
}

/// The sample time of stamps within rounding of an even grid.
pub(super) fn even(time_s: &[f64]) -> Option<SampleTime> {
    let (&[first, .., last], count) = (time_s, time_s.len()) else { return None };
    let step = (last - first) / (count - 1) as f64;
    let near = EVEN * step;
    let on_line = |(k, t): (usize, &f64)| (t - (first + k as f64 * step)).abs() <= near;
    if time_s.iter().enumerate().all(on_line) { SampleTime::new(step).ok() } else { None }
}

/// Largest deviation from an even grid, in samples, of rounded stamps: the rounding of a million samples.
const EVEN: f64 = 1e-9;

/// Two instants within this share of a sample coincide for jumps of an input, as in [`SampleTime::samples`].
const COINCIDE: f64 = 1e-9;

/// The rounding of an instant computed as a stamp plus or minus a delay.
fn rounding(time_s: f64) -> f64 {
    4.0 * f64::EPSILON * time_s.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uav::{self, Dynamics};

    fn input(samples: usize, m: usize) -> DMatrix<f64> {
        DMatrix::from_fn(samples, m, |k, j| ((k * 7919 + j * 104_729) % 23) as f64 / 11.0 - 1.0)
    }

    #[test]
    fn the_uneven_simulation_agrees_with_the_even_one_on_an_even_grid() {
        let ts = SampleTime::new(0.05).unwrap();
        let sys = uav::model().with_input_delay(vec![0.013, 0.0, 0.1, 0.171]).unwrap();
        let u = input(60, 4);
        let time_s: Vec<f64> = (0..60).map(|k| k as f64 * 0.05).collect();
        let initial = Some(DVector::from_fn(9, |i, _| 0.1 * i as f64 - 0.3));
        for hold in [Hold::Zero, Hold::Linear] {
            for prehistory in [Prehistory::Held, Prehistory::Rest] {
                let options = Options { initial: initial.clone(), hold, prehistory };
                let even = lsim(&sys, &u, ts, &options).unwrap();
                let uneven = lsim(&sys, &u, time_s.as_slice(), &options).unwrap();
                let scale = even.x.amax();
                assert!((even.x - uneven.x).amax() < 1e-10 * scale, "{hold:?} {prehistory:?}");
                assert!((even.y - uneven.y).amax() < 1e-10 * scale, "{hold:?} {prehistory:?}");
            }
        }
    }

    /// ẏ = u(t − d) − y with piecewise linear u: ∂y/∂d is e^(−t)·u(0) − ẏ for any d.
    #[test]
    fn interpolated_inputs_are_late_by_delays_of_any_size() {
        let one = |v: f64| DMatrix::from_element(1, 1, v);
        let sys = StateSpace::continuous(one(-1.0), one(1.0), one(1.0), one(0.0)).unwrap();
        let (u, ts) = (input(50, 1), SampleTime::new(0.1).unwrap());
        let time_s: Vec<f64> = (0..50).map(|k| 0.1 * k as f64).collect();
        let options = Options { hold: Hold::Linear, ..Options::default() };
        for share in [1e-4, 1e-6, 1e-9, 1e-11] {
            let late = sys.clone().with_input_delay(vec![0.1 * share]).unwrap();
            let even = |sys| lsim(sys, &u, ts, &options).unwrap().y;
            let uneven = |sys| lsim(sys, &u, time_s.as_slice(), &options).unwrap().y;
            for (moved, still) in [(even(&late), even(&sys)), (uneven(&late), uneven(&sys))] {
                for (k, t) in time_s.iter().enumerate() {
                    let slope = (moved[k] - still[k]) / (0.1 * share);
                    let expected = (-t).exp() * u[0] - (u[k] - still[k]);
                    assert!((slope - expected).abs() < 1e-2, "{share} {t}: {slope} {expected}");
                }
            }
        }
    }

    #[test]
    fn superposition_and_shift_hold() {
        let ts = SampleTime::new(0.1).unwrap();
        let sys = Dynamics::Directional.model();
        let (u, v) = (input(80, 1), input(80, 1).map(|x| x * x - 0.4));
        let run = |sys: &StateSpace<Continuous>, u: &DMatrix<f64>| {
            lsim(sys, u, ts, &Options { prehistory: Prehistory::Rest, ..Options::default() })
                .unwrap()
                .y
        };
        let sum = run(&sys, &(&u * 2.0 + &v));
        assert!((sum - (run(&sys, &u) * 2.0 + run(&sys, &v))).amax() < 1e-11);
        let delayed = run(&sys.clone().with_input_delay(vec![0.3]).unwrap(), &u);
        assert!((delayed.rows(3, 77) - run(&sys, &u).rows(0, 77)).amax() < 1e-11);
    }

    #[test]
    fn faults_are_distinguished() {
        let ts = SampleTime::new(0.5).unwrap();
        let sys = Dynamics::Lateral.model();
        let fails = |u: DMatrix<f64>, options: &Options| lsim(&sys, &u, ts, options).unwrap_err();
        assert!(matches!(
            fails(input(9, 2), &Options::default()),
            SimulateError::Inputs { needed: 1, got: 2 }
        ));
        let wrong = Options { initial: Some(DVector::zeros(2)), ..Options::default() };
        assert!(matches!(
            fails(input(9, 1), &wrong),
            SimulateError::InitialState { needed: 3, got: 2 }
        ));
        let mut u = input(9, 1);
        u[4] = f64::NAN;
        assert!(matches!(
            fails(u, &Options::default()),
            SimulateError::NotFinite { input: 0, sample: 4, .. }
        ));
        assert!(matches!(
            fails(input(5000, 1), &Options::default()),
            SimulateError::Explodes { .. }
        ));
        let backwards = lsim(&sys, &input(3, 1), [0.0, 1.0, 0.5].as_slice(), &Options::default());
        assert!(matches!(backwards, Err(SimulateError::Time { sample: 2, .. })));
    }
}

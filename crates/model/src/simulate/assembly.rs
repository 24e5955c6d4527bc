//! The plant with its hooks as one system: every intermediate signal is a row over (states, signals, 1, the plant's own outputs). Delayed quantities are
//! signals after those of the inputs.

use std::ops::Range;

use super::history::{Histories, History};
use super::piecewise::TOGETHER;
use super::plan::{InnerFilter, ModeSite, Plan, Source, Term};
use super::system::{Affine, System};

/// Coefficients over (states, signals, 1, the plant's own outputs).
type Row = Vec<f64>;

/// The assembled system. For an affine plant the rows contain the plant, and the coefficients of its outputs are 0. For equations the plant's rows contain only
/// the terms added to them.
pub(super) struct Assembly {
    /// States of the plant, which come first.
    pub(super) plant: usize,
    /// All states.
    pub(super) states: usize,
    /// Signals: one per input, then one per delayed quantity.
    pub(super) signals: usize,
    /// The plant's input, one row per input.
    pub(super) inputs: Vec<Row>,
    /// Derivatives, one row per state.
    pub(super) derivatives: Vec<Row>,
    /// The plant's own outputs, those of quantities inside it last.
    pub(super) own: usize,
    /// Outputs at the sensors, one row per output.
    pub(super) outputs: Vec<Row>,
    /// The initial state.
    pub(super) start: Vec<f64>,
    /// The states of hysteresis, in the order of the plan's terms.
    pub(super) memories: Vec<usize>,
    /// The delayed quantities before their delay, one row each.
    pub(super) raw: Vec<Row>,
    /// Their values before the start.
    pub(super) late: Histories,
}

/// The shortest dead time inside equations that is simulated by its history, in samples: each needs four steps. The effect's search has the same bound.
const SHORTEST: f64 = 0.02;
/// A shorter dead time, in samples, is a lag. The two differ by (ω·delay)²/2, which is 5e-8 at the highest frequency that samples resolve.
const A_LAG: f64 = 1e-4;

/// The simulation of a dead time inside the plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum InnerDelays {
    /// By its history, for an integrator with this sample time, s; below `SHORTEST` samples by an approximant.
    Exact(f64),
    /// By an approximant that is linear and has states.
    Pade,
}

impl Assembly {
    /// From the plant at that time, where it is affine, and the signals' first values. For other plants, from a function that gives the outputs for given
    /// inputs at the start.
    pub(super) fn new(
        system: &System,
        (plan, plant): (&Plan, Option<&Affine>),
        delays: InnerDelays,
        (x0, first): (&[f64], &[f64]),
        own_outputs: impl Fn(&[f64]) -> Vec<f64>,
    ) -> Self {
        let (n, m, p) = (system.states.len(), system.inputs.len(), system.outputs.len());
        let realised: Vec<InnerFilter> = plan.filters.iter().map(|f| delays.realised(*f)).collect();
        let waits: Vec<Option<f64>> = realised.iter().map(|f| delays.waits(*f)).collect();
        let late_s: Vec<f64> = waits.iter().flatten().copied().collect();
        let mut build = Build::new((plan, &realised), &waits, [n, m + late_s.len(), p]);
        build.least_s = delays.least_s();
        let states = build.states;
        // The values of (states, signals, 1, outputs) at the start, filled in as they are determined.
        build.now[..n].copy_from_slice(x0);
        build.now[states..states + m].copy_from_slice(first);
        let one = states + m + late_s.len();
        build.now[one] = 1.0;
        let arriving = build.swapped(plan);
        let mut inputs: Vec<Row> = (arriving.iter().zip(&system.input_operating))
            .map(|(v, operating)| {
                let mut w = v.clone();
                w[one] -= operating;
                w
            })
            .collect();
        let filters = build.quantities((&realised, &waits), states + m..one, &mut inputs);
        let mut outputs: Vec<Row> = match plant {
            Some(plant) => build.plant(plant, &inputs),
            None => (0..p + filters.len()).map(|i| build.unit(one + 1 + i)).collect(),
        };
        let mut raw = outputs.split_off(p);
        build.settle(&inputs, (&filters, &raw), plant.is_none().then_some(&own_outputs));
        for (at, (filter, waits)) in realised.iter().zip(&waits).enumerate() {
            if waits.is_none() {
                build.drive(*filter, filters[at], &raw[at]);
            }
        }
        let mut waits = waits.iter();
        raw.retain(|_| waits.next().is_some_and(Option::is_some));
        build.modes(plan, &arriving, &mut outputs);
        build.terms(plan, &inputs, one);
        build.sensors(plan, &mut outputs);
        let start = build.now[..states].to_vec();
        let rested = build.now[states + m..one].iter().zip(&late_s);
        let late = rested.map(|(value, delay_s)| History::at_rest(*delay_s, *value)).collect();
        Self {
            plant: n,
            states,
            signals: m + late_s.len(),
            inputs,
            own: p + filters.len(),
            derivatives: build.derivatives,
            outputs,
            start,
            memories: build.memories,
            raw,
            late: Histories::new(late),
        }
    }
}

impl InnerDelays {
    /// The dead time of a filter that is simulated by its history, s.
    fn waits(self, filter: InnerFilter) -> Option<f64> {
        match (self, filter) {
            (Self::Exact(sample_s), InnerFilter::Delay(delay_s))
                if delay_s >= SHORTEST * sample_s =>
            {
                Some(delay_s)
            }
            _ => None,
        }
    }

    /// The filter in its simulated form.
    fn realised(self, filter: InnerFilter) -> InnerFilter {
        match (self, filter) {
            (Self::Exact(sample_s), InnerFilter::Delay(delay_s)) if delay_s < A_LAG * sample_s => {
                InnerFilter::Lag(delay_s)
            }
            _ => filter,
        }
    }

    /// The shortest time constant of a filter, s. Shorter times have the same effect; faster poles would only overflow the integrator's steps.
    fn least_s(self) -> f64 {
        match self {
            Self::Exact(sample_s) => TOGETHER * sample_s,
            Self::Pade => 0.0,
        }
    }
}

fn add(to: &mut [f64], gain: f64, row: &[f64]) {
    for (to, value) in to.iter_mut().zip(row) {
        *to += gain * value;
    }
}

/// The rows under construction.
struct Build {
    states: usize,
    signals: usize,
    outputs: usize,
    /// Number of allocated states.
    used: usize,
    derivatives: Vec<Row>,
    /// The factors of the rows, at the start.
    now: Row,
    /// The states of hysteresis.
    memories: Vec<usize>,
    /// The shortest time constant, s.
    least_s: f64,
}

impl Build {
    /// For a plant with these numbers of states, signals and outputs, whose quantities with these dead times are signals.
    fn new(
        (plan, inner): (&Plan, &[InnerFilter]),
        waits: &[Option<f64>],
        [n, signals, outputs]: [usize; 3],
    ) -> Self {
        let lags = plan.inputs.iter().map(|i| i.lags_s.len());
        let lags = lags.chain(plan.outputs.iter().map(|o| o.lags_s.len())).sum::<usize>();
        let of_term = |term: &Term| match term {
            Term::Sine { .. } => 2,
            Term::Hysteresis { .. } => 1,
            _ => 0,
        };
        let terms = plan.terms.iter().map(of_term).sum::<usize>();
        let with_states = inner.iter().zip(waits).filter(|(_, waits)| waits.is_none());
        let filters = with_states.map(|(f, _)| f.order()).sum::<usize>();
        let states = n + lags + filters + 2 * plan.modes.len() + terms;
        let outputs = outputs + inner.len();
        let (derivatives, now, memories) = (Vec::new(), Vec::new(), Vec::new());
        let mut build =
            Self { states, signals, outputs, used: n, derivatives, now, memories, least_s: 0.0 };
        build.derivatives = vec![build.zero(); states];
        build.now = build.zero();
        build
    }

    /// The arriving values of all inputs, shares of swapped commands included.
    fn swapped(&mut self, plan: &Plan) -> Vec<Row> {
        let mut arriving: Vec<Row> =
            (0..plan.inputs.len()).map(|i| self.arriving(plan, i)).collect();
        for &(a, b, share) in &plan.swaps {
            let both = [arriving[a].clone(), arriving[b].clone()];
            for (to, other) in [(a, &both[1]), (b, &both[0])] {
                arriving[to].iter_mut().for_each(|v| *v *= 1.0 - share);
                add(&mut arriving[to], share, other);
            }
        }
        arriving
    }

    /// The signal or the first state of each quantity inside the plant; the plant receives them as further inputs.
    fn quantities(
        &mut self,
        (realised, waits): (&[InnerFilter], &[Option<f64>]),
        mut signals: Range<usize>,
        inputs: &mut Vec<Row>,
    ) -> Vec<usize> {
        (realised.iter().zip(waits))
            .map(|(filter, waits)| match waits.and_then(|_| signals.next()) {
                Some(signal) => {
                    inputs.push(self.unit(signal));
                    signal
                }
                None => self.filter(*filter, inputs),
            })
            .collect()
    }

    /// Sets the quantities inside the plant to their values at the start; the rows in `raw` give them. For a plant that is not affine, `own_outputs` gives the
    /// outputs. A quantity may depend on earlier ones: each round determines one more.
    fn settle(
        &mut self,
        inputs: &[Row],
        (filters, raw): (&[usize], &[Row]),
        own_outputs: Option<impl Fn(&[f64]) -> Vec<f64>>,
    ) {
        let one = self.states + self.signals;
        for _ in 0..=filters.len() {
            if let Some(own_outputs) = &own_outputs {
                let received: Vec<f64> = inputs.iter().map(|row| self.value(row)).collect();
                self.now[one + 1..].copy_from_slice(&own_outputs(&received));
            }
            for (state, row) in filters.iter().zip(raw) {
                self.now[*state] = self.value(row);
            }
        }
    }

    /// The arriving value of an input: behind its lags, with the modes that act on it.
    fn arriving(&mut self, plan: &Plan, input: usize) -> Row {
        let mut v = self.unit(self.states + input);
        for &lag_s in &plan.inputs[input].lags_s {
            v = self.lag(&v, lag_s);
        }
        for mode in plan.modes.iter().filter(|mode| mode.site == ModeSite::Input(input)) {
            let q = self.mode(&v, mode.omega_rad_s, mode.damping);
            v[q] += mode.gain;
        }
        v
    }

    /// The states of a filter of a quantity inside the plant; the plant receives the filter's output. Returns the first state, which holds the quantity at
    /// rest.
    fn filter(&mut self, filter: InnerFilter, inputs: &mut Vec<Row>) -> usize {
        let (_, over, _) = filter.transfer();
        let first = self.state(0.0);
        (1..filter.order()).for_each(|_| {
            self.state(0.0);
        });
        let mut row = self.zero();
        row[first..first + over.len()].copy_from_slice(&over);
        inputs.push(row);
        first
    }

    /// The input of these states: a chain of derivatives of the quantity over the denominator.
    fn drive(&mut self, filter: InnerFilter, first: usize, raw: &Row) {
        let (time_s, _, under) = filter.transfer();
        let time_s = time_s.max(self.least_s);
        let last = filter.order() - 1;
        for i in 0..last {
            self.derivatives[first + i][first + i + 1] = time_s.recip();
        }
        let gain = (under[last + 1] * time_s).recip();
        add(&mut self.derivatives[first + last], gain, raw);
        for (i, coefficient) in under[..=last].iter().enumerate() {
            self.derivatives[first + last][first + i] -= gain * coefficient;
        }
    }

    /// The modes that act on states and outputs.
    fn modes(&mut self, plan: &Plan, arriving: &[Row], outputs: &mut [Row]) {
        for mode in &plan.modes {
            let Some(driver) =
                arriving.get(mode.input).filter(|_| !matches!(mode.site, ModeSite::Input(_)))
            else {
                continue;
            };
            let q = self.mode(driver, mode.omega_rad_s, mode.damping);
            match mode.site {
                ModeSite::State(to) => self.derivatives[to][q] += mode.gain,
                ModeSite::Output(to) => outputs[to][q] += mode.gain,
                ModeSite::Input(_) => {}
            }
        }
    }

    /// The terms of derivatives that are linear or autonomous; `one` is the index of the constant.
    fn terms(&mut self, plan: &Plan, inputs: &[Row], one: usize) {
        for term in &plan.terms {
            match *term {
                Term::Linear { to, from: Source::State(from), gain } => {
                    self.derivatives[to][from] += gain
                }
                Term::Linear { to, from: Source::Input(from), gain } => {
                    add(&mut self.derivatives[to], gain, &inputs[from])
                }
                Term::Constant { to, level } => self.derivatives[to][one] += level,
                Term::Sine { to, omega_rad_s, amplitude, phase_rad } => {
                    let sine = self.oscillator(omega_rad_s, phase_rad);
                    self.derivatives[to][sine] += amplitude;
                }
                Term::Hysteresis { velocity, level, .. } => {
                    let memory = self.state(0.0);
                    self.derivatives[velocity][memory] -= level;
                    self.memories.push(memory);
                }
                Term::Function { .. } | Term::Friction { .. } => {}
            }
        }
    }

    /// Between plant and measurement: mixing outputs, then lags.
    fn sensors(&mut self, plan: &Plan, outputs: &mut [Row]) {
        let before = outputs.to_vec();
        for (to, path) in plan.outputs.iter().enumerate() {
            for &(from, gain) in &path.mixing {
                add(&mut outputs[to], gain, &before[from]);
            }
            for &lag_s in &path.lags_s {
                outputs[to] = self.lag(&outputs[to], lag_s);
            }
        }
    }

    fn zero(&self) -> Row {
        vec![0.0; self.states + self.signals + 1 + self.outputs]
    }

    fn unit(&self, at: usize) -> Row {
        let mut row = self.zero();
        row[at] = 1.0;
        row
    }

    fn value(&self, row: &[f64]) -> f64 {
        row.iter().zip(&self.now).map(|(a, b)| a * b).sum()
    }

    /// The next state, which starts at `value`.
    fn state(&mut self, value: f64) -> usize {
        self.now[self.used] = value;
        self.used += 1;
        self.used - 1
    }

    /// A first-order lag of a signal, settled.
    fn lag(&mut self, v: &Row, lag_s: f64) -> Row {
        let z = self.state(self.value(v));
        let lag_s = lag_s.max(self.least_s);
        add(&mut self.derivatives[z], 1.0 / lag_s, v);
        self.derivatives[z][z] -= 1.0 / lag_s;
        self.unit(z)
    }

    /// A resonance of a signal, at rest at its static value; the state that holds q.
    fn mode(&mut self, v: &Row, omega: f64, damping: f64) -> usize {
        let q = self.state(self.value(v));
        let rate = self.state(0.0);
        self.derivatives[q][rate] = 1.0;
        add(&mut self.derivatives[rate], omega * omega, v);
        self.derivatives[rate][q] -= omega * omega;
        self.derivatives[rate][rate] -= 2.0 * damping * omega;
        q
    }

    /// sin(ωt + phase); returns the state that holds it.
    fn oscillator(&mut self, omega: f64, phase: f64) -> usize {
        let sine = self.state(phase.sin());
        let cosine = self.state(phase.cos());
        self.derivatives[sine][cosine] = omega;
        self.derivatives[cosine][sine] = -omega;
        sine
    }

    /// The rows of an affine plant; its outputs.
    fn plant(&mut self, Affine { matrices, drift, level }: &Affine, inputs: &[Row]) -> Vec<Row> {
        let one = self.states + self.signals;
        let rows = |build: &Self,
                    of_state: &nalgebra::DMatrix<f64>,
                    of_input: &nalgebra::DMatrix<f64>,
                    i: usize| {
            let mut row = build.zero();
            for (j, value) in of_state.row(i).iter().enumerate() {
                row[j] = *value;
            }
            for (input, gain) in inputs.iter().zip(of_input.row(i).iter()) {
                add(&mut row, *gain, input);
            }
            row
        };
        for (i, drift) in drift.iter().enumerate() {
            self.derivatives[i] = rows(self, &matrices.a, &matrices.b, i);
            self.derivatives[i][one] += drift;
        }
        (0..matrices.c.nrows())
            .map(|i| {
                let mut row = rows(self, &matrices.c, &matrices.d, i);
                row[one] += level[i];
                row
            })
            .collect()
    }
}

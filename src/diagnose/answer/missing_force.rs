//! What stays of a gap, told as a missing force: on which state's derivative, and with which variable it goes.
//!
//! The model as it is handed over is linearised along its own run. For each state and each simple function φ of a state or a command, the response of the outputs to φ
//! on the state's derivative is regressed on what is left, the start of every span being free. That is the least-squares estimate of g in ẋ_i = f_i + g·φ, without
//! a smoothed force in between whose own roughness would have to be chosen. g comes from the training spans; the part of what is left that it predicts (R²) is
//! that of the held-out spans.
//!
//! How it can be wrong: many functions are tried, and something goes with the rest by chance, above all where both are slow. So the same search is done with the
//! responses turned round in time against what is left, which keeps the colour of both; nothing is said unless the true R² is larger than the largest of all
//! turns. A periodic command fits again after a period: then nothing is said, too. Two functions may go together on these data, and the plainer one is told.
//! Past the linearisation, and behind a lag or a delay of a sensor, the response is another: R² is smaller then. It describes, and is no cause.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::along_the_run::{Run, runs};
use super::force_profile::{ForceProfile, profile};
use crate::diagnose::format::contributions::Description;
use crate::diagnose::input::record::Span;
use crate::diagnose::likelihood::errors::Errors;
use crate::diagnose::likelihood::gaussian::Likelihood;
use crate::effect::Applied;
use crate::simulate::System;

/// Turns of the responses against what is left: what chance does. The largest of so many is passed once in 60 times.
const TURNS: usize = 59;
/// A part of what is left that is worth a sentence.
const WORTH: f64 = 0.1;
/// Functions whose R² is so near to the best one's are as good.
const AS_GOOD: f64 = 0.02;
/// Samples of all logs that are regressed on; of more every second, third … one is.
const SAMPLES: usize = 6000;
/// With more variables than this, products of two are left out; with more states nothing is described.
const VARIABLES: usize = 8;
const STATES: usize = 16;
/// What of a start's response is no more than rounding beside the starts before it.
const INDEPENDENT: f64 = 1e-6;

/// A function of one or two variables, by their places among states and then inputs; plainer ones first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    Plain(usize),
    Sign(usize),
    Drag(usize),
    Square(usize),
    Product(usize, usize),
}

impl Form {
    fn of(self, value: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::Plain(v) => value(v),
            Self::Sign(v) => f64::from(i8::from(value(v) > 0.0) - i8::from(value(v) < 0.0)),
            Self::Drag(v) => value(v) * value(v).abs(),
            Self::Square(v) => value(v).powi(2),
            Self::Product(v, w) => value(v) * value(w),
        }
    }

    /// What it is a function of: a variable, or a product of two.
    pub(super) fn argument(self, value: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::Plain(v) | Self::Sign(v) | Self::Drag(v) | Self::Square(v) => value(v),
            Self::Product(v, w) => value(v) * value(w),
        }
    }

    /// Its value over the argument.
    pub(super) fn law(self, argument: f64) -> f64 {
        match self {
            Self::Product(..) => argument,
            of_one => of_one.of(|_| argument),
        }
    }

    /// The argument as an expression of the model file.
    pub(super) fn over(self, name: impl Fn(usize) -> String) -> String {
        match self {
            Self::Plain(v) | Self::Sign(v) | Self::Drag(v) | Self::Square(v) => name(v),
            Self::Product(v, w) => format!("{}*{}", name(v), name(w)),
        }
    }

    /// As an expression of the model file.
    pub(super) fn text(self, name: impl Fn(usize) -> String) -> String {
        match self {
            Self::Plain(v) => name(v),
            Self::Sign(v) => format!("sign({})", name(v)),
            Self::Drag(v) => format!("{0}*abs({0})", name(v)),
            Self::Square(v) => format!("{}^2", name(v)),
            Self::Product(v, w) => format!("{}*{}", name(v), name(w)),
        }
    }

    fn all(variables: usize) -> Vec<Self> {
        let of_one = [Self::Plain as fn(usize) -> Self, Self::Sign, Self::Drag, Self::Square];
        let mut all: Vec<Self> = of_one.iter().flat_map(|form| (0..variables).map(form)).collect();
        if variables <= VARIABLES {
            all.extend((0..variables).flat_map(|v| (0..v).map(move |w| Self::Product(w, v))));
        }
        all
    }
}

/// What is left in a span of a log, the responses to the span's start taken out; every output in units of its spread.
pub(super) struct Part {
    pub(super) record: usize,
    held: bool,
    /// Kept sample and output.
    rows: Vec<(usize, usize)>,
    pub(super) left: DVector<f64>,
    /// Orthonormal responses to the start.
    starts: Vec<DVector<f64>>,
}

impl Part {
    /// A response at these rows, turned round by so many kept samples.
    fn product(&self, response: &DMatrix<f64>, weights: &[f64], turn: usize) -> f64 {
        let n = response.nrows();
        self.rows.iter().zip(self.left.iter()).map(|(&(k, o), left)| response[((k + turn) % n, o)] * weights[o] * left).sum()
    }

    /// Responses beside the starts, one column each.
    pub(super) fn beside_starts(&self, responses: &[DMatrix<f64>], weights: &[f64]) -> DMatrix<f64> {
        let mut all = DMatrix::from_fn(self.rows.len(), responses.len(), |r, c| {
            let (k, o) = self.rows[r];
            responses[c][(k, o)] * weights[o]
        });
        for start in &self.starts {
            let along = all.tr_mul(start);
            all.ger(-1.0, start, &along, 1.0);
        }
        all
    }

    /// The square of a response beside the starts.
    fn square(&self, response: &DMatrix<f64>, weights: &[f64]) -> f64 {
        let values = DVector::from_iterator(self.rows.len(), self.rows.iter().map(|&(k, o)| response[(k, o)] * weights[o]));
        values.norm_squared() - self.starts.iter().map(|q| q.dot(&values).powi(2)).sum::<f64>()
    }
}

/// Sums over the parts of one kind: response by what is left, and by itself.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    product: f64,
    square: f64,
}

/// The gain from training spans, and the part of what is left in held-out spans that it predicts.
fn predicted(trained: Sums, held: Sums, left: f64) -> (f64, f64) {
    let gain = trained.product / trained.square;
    (gain, (2.0 * gain * held.product - gain * gain * held.square) / left)
}

/// What is left, told as a missing force, and its curve where that can be had; `None` where chance does as much, and for a simulator without differential equations at hand.
pub(in crate::diagnose) fn describe(
    likelihood: &Likelihood<'_>,
    effects: &[Applied],
    left: &[DMatrix<f64>],
    seed: u64,
) -> Option<(Description, Option<ForceProfile>)> {
    let (system, records) = (likelihood.system, likelihood.records);
    let states = system.states.len();
    if states == 0 || states > STATES {
        return None;
    }
    let every = records.iter().map(|r| r.time_s.len()).sum::<usize>().div_ceil(SAMPLES).max(1);
    let runs = runs(likelihood, effects)?;
    let spread = Errors::of(records, left, |r| r.train.or(r.held));
    let weights: Vec<f64> = spread.deviations.iter().map(|d| if *d > 0.0 { d.sqrt().recip() } else { 0.0 }).collect();
    let parts: Vec<Part> = (0..records.len())
        .flat_map(|at| [(at, false), (at, true)])
        .filter_map(|(at, held)| {
            let record = &records[at];
            let span = if held { record.held } else { record.train }?;
            Some(part(likelihood, (at, held, span), &runs[at], &left[at], &weights, every))
        })
        .collect();
    let energy = |held: bool| parts.iter().filter(|p| p.held == held).map(|p| p.left.norm_squared()).sum::<f64>();
    let held_left = energy(true);
    if !(energy(false) > 0.0 && held_left > 0.0) {
        return None;
    }
    let variables = states + system.inputs.len();
    let forms = Form::all(variables);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let turns: Vec<Vec<usize>> = (0..TURNS)
        .map(|_| runs.iter().map(|run| (rng.random_range(0.1..0.9) * run.samples().div_ceil(every) as f64) as usize).collect())
        .collect();
    let sums = |responses: &[DMatrix<f64>], turn: Option<&[usize]>, held: bool| {
        let mut sums = Sums::default();
        for part in parts.iter().filter(|p| p.held == held) {
            sums.product += part.product(&responses[part.record], &weights, turn.map_or(0, |t| t[part.record]));
            sums.square += part.square(&responses[part.record], &weights);
        }
        sums
    };
    // Per state and function: gain, R², and R² at every turn.
    let tried = |(state, form): (usize, Form)| {
        let responses: Vec<DMatrix<f64>> = runs.iter().map(|run| run.response(state, |k| form.of(|v| run.value(v, k)), every)).collect();
        let (trained, held) = (sums(&responses, None, false), sums(&responses, None, true));
        let (gain, r2) = predicted(trained, held, held_left);
        let turned = |turn: &Vec<usize>| {
            let product = |held: bool| {
                let here = parts.iter().filter(|p| p.held == held);
                here.map(|p| p.product(&responses[p.record], &weights, turn[p.record])).sum::<f64>()
            };
            predicted(Sums { product: product(false), ..trained }, Sums { product: product(true), ..held }, held_left).1
        };
        let chance: Vec<f64> = turns.iter().map(turned).collect();
        (gain.is_finite() && r2.is_finite()).then_some(Tried { state, form, gain, r2, chance })
    };
    let all: Vec<(usize, Form)> = (0..states).flat_map(|i| forms.iter().map(move |f| (i, *f))).collect();
    let found: Vec<Tried> = all.into_par_iter().filter_map(tried).collect();
    let best = found.iter().map(|t| t.r2).fold(f64::NEG_INFINITY, f64::max);
    let chance = found.iter().flat_map(|t| &t.chance).copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    if best < WORTH || best <= chance {
        return None;
    }
    let rank = |t: &Tried| forms.iter().position(|f| *f == t.form);
    let told = found.iter().filter(|t| t.r2 > best - AS_GOOD).min_by(|a, b| rank(a).cmp(&rank(b)).then(b.r2.total_cmp(&a.r2)))?;
    let name = |v: usize| system.states.iter().chain(&system.inputs).nth(v).map(|p| p.name.clone()).unwrap_or_default();
    let curve = profile((told.state, told.form, told.gain), (&runs, &parts), &weights, every, name);
    Some((told.described(system, chance), curve))
}

/// A function on a state's derivative.
struct Tried {
    state: usize,
    form: Form,
    gain: f64,
    r2: f64,
    chance: Vec<f64>,
}

impl Tried {
    fn described(&self, system: &System, chance: f64) -> Description {
        let names = || system.states.iter().chain(&system.inputs);
        let goes_with = self.form.text(|v| names().nth(v).map(|p| p.name.clone()).unwrap_or_default());
        let state = system.states[self.state].name.clone();
        let sentence = format!(
            "what is missing on the derivative of `{state}` goes with {goes_with}, {} times it: held-out R² {:.2}, by chance at most {chance:.2}; \
             it describes and is no cause, which --candidate '{state} += k*{goes_with}' asks for",
            three_digits(self.gain),
            self.r2
        );
        Description { state, goes_with, held_out_r2: self.r2, sentence }
    }
}

fn three_digits(value: f64) -> String {
    let before = value.abs().log10().floor();
    if (-4.0..6.0).contains(&before) { format!("{value:.*}", (2.0 - before).max(0.0) as usize) } else { format!("{value:.2e}") }
}

/// What is left in a span, with the responses to its start.
fn part(
    likelihood: &Likelihood<'_>,
    (at, held, span): (usize, bool, Span),
    run: &Run,
    left: &DMatrix<f64>,
    weights: &[f64],
    every: usize,
) -> Part {
    let record = &likelihood.records[at];
    let rows: Vec<(usize, usize)> = (0..record.time_s.len())
        .step_by(every)
        .flat_map(|k| (0..weights.len()).map(move |o| (k, o)))
        .filter(|&(k, o)| weights[o] > 0.0 && record.measured_in(Some(span), o, k).is_some())
        .collect();
    let first = record.time_s.partition_point(|t| *t < span.from_s);
    let mut starts: Vec<DVector<f64>> = Vec::new();
    for response in run.starts(first) {
        let mut column = DVector::from_iterator(rows.len(), rows.iter().map(|&(k, o)| response[(k, o)] * weights[o]));
        let size = column.norm();
        // Twice, against rounding.
        for q in starts.iter().chain(&starts) {
            column.axpy(-q.dot(&column), q, 1.0);
        }
        let own = column.norm();
        if own > INDEPENDENT * size && own.is_finite() {
            starts.push(column / own);
        }
    }
    let mut residual = DVector::from_iterator(rows.len(), rows.iter().map(|&(k, o)| left[(k, o)] * weights[o]));
    for q in &starts {
        residual.axpy(-q.dot(&residual), q, 1.0);
    }
    let rows = rows.into_iter().map(|(k, o)| (k / every, o)).collect();
    Part { record: at, held, rows, left: residual, starts }
}

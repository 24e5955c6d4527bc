//! The remainder of a gap as a missing force: the state on whose derivative it acts, and the variable that correlates with it.
//!
//! The model that is handed over is linearised along its own run. Every simple function φ of a state or a command is tried on the derivative of every state.
//! The outputs' response to φ is regressed on the residual, with a free initial state in every span.
//! The coefficient is the least-squares estimate of g in ẋ_i = f_i + g·φ; no smoothed force with a roughness parameter is needed.
//! The training spans give g, and choose φ by the part of the residual that g·φ takes there. The held-out spans give R², the part that it predicts.
//!
//! How it can be wrong: many functions are tried, and one may correlate by chance, above all where both signals are slow.
//! The same search therefore runs with circularly shifted responses, which keep their spectra. A force is reported only where the true R² exceeds the largest R² of all shifts.
//! A periodic command fits again after a period; no force is reported then. Of two functions that are collinear on these data, the simpler one is reported.
//! Beyond the linearisation, and behind a lag or a delay of a sensor, the response differs and R² falls. A reported force is a description, not a cause.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::force_profile::{ForceProfile, profile};
use super::held_out::HeldOut;
use super::span_residual::Part;
use crate::format::contributions::Description;
use crate::input::record::Span;
use crate::judge::along_the_run::{Run, runs};
use crate::judge::forms::Form;
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Applied;
use deadtime_model::simulate::{Dynamics, System};
use deadtime_signal::parallel;
use deadtime_signal::remedy::{Message, Remedy};

/// Circular shifts of the responses: the null distribution of R². Chance exceeds the largest of 59 once in 60 times.
const TURNS: usize = 59;
/// Least R² of a reported force; 1.
const WORTH: f64 = 0.1;
/// Functions whose training R² is so near to the best one's are as good.
const AS_GOOD: f64 = 0.02;
/// Functions that are suggested as candidates.
const SUGGESTED: usize = 5;
/// Samples of all logs that are regressed on; of more every second, third … one is.
const SAMPLES: usize = 6000;
/// With more states nothing is described.
const STATES: usize = 16;
/// A start's response whose norm falls below this part after projection on the earlier starts is rounding error.
const INDEPENDENT: f64 = 1e-6;

/// Inner products over the spans of one kind: response with residual, and response with itself.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    product: f64,
    square: f64,
}

/// The gain from training spans, and the part of the held-out residual that it predicts.
fn predicted(trained: Sums, held: Sums, left: f64) -> (f64, f64) {
    let gain = trained.product / trained.square;
    (gain, (2.0 * gain * held.product - gain * gain * held.square) / left)
}

/// A residual as a missing force.
pub(crate) struct MissingForce {
    pub(crate) description: Description,
    /// Its curve, where one can be fitted.
    pub(crate) curve: Option<ForceProfile>,
    /// The part of the training residual that it takes.
    pub(crate) learnt: f64,
}

/// The residual as a missing force.
///
/// `None` where shifted responses reach the same R², and for a simulator without differential equations.
pub(crate) fn describe(
    likelihood: &Likelihood<'_>,
    held_out: &HeldOut,
    effects: &[Applied],
    left: &[DMatrix<f64>],
    seed: u64,
) -> Option<MissingForce> {
    let system = likelihood.system;
    let states = system.states.len();
    if states == 0 || states > STATES {
        return None;
    }
    let residuals = Residuals::of(likelihood, held_out, effects, left)?;
    let forms = forms(system);
    let turns = residuals.turns(seed);
    let all: Vec<(usize, Form)> =
        (0..states).flat_map(|i| forms.iter().map(move |f| (i, *f))).collect();
    let tried = |(state, form)| residuals.tried(state, form, &turns);
    let mut found: Vec<Tried> = parallel::filter_map(all, tried);
    found.sort_by(|a, b| b.learnt.total_cmp(&a.learnt));
    let simplest = simplest(&found, &forms)?;
    let chance =
        found.iter().flat_map(|t| &t.chance).copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    if simplest.r2 < WORTH || simplest.r2 <= chance {
        return None;
    }
    let curve = profile(
        (simplest.state, simplest.form, simplest.gain),
        (&residuals.runs, &residuals.parts),
        &residuals.weights,
        residuals.every,
        |v| variable(system, v),
    );
    let description = simplest.described(system, chance, suggested(system, simplest, &found));
    Some(MissingForce { description, curve, learnt: simplest.learnt })
}

/// The functions that a missing force may follow; waves over states that are angles only.
fn forms(system: &System) -> Vec<Form> {
    let states = system.states.len();
    let in_radians = |v: &usize| system.states[*v].unit.as_deref() == Some("rad");
    let angles: Vec<usize> = (0..states).filter(in_radians).collect();
    Form::all(states + system.inputs.len(), &angles)
}

/// The simplest of the functions that take about as much of the training residual as the first one, the best.
fn simplest<'t>(found: &'t [Tried], forms: &[Form]) -> Option<&'t Tried> {
    let best = found.first()?.learnt;
    let rank = |t: &Tried| forms.iter().position(|f| *f == t.form);
    let as_good = found.iter().take_while(|t| t.learnt > best - AS_GOOD);
    as_good.min_by(|a, b| rank(a).cmp(&rank(b)).then(b.learnt.total_cmp(&a.learnt)))
}

/// The candidates that are suggested: the simplest function, then the best ones with another term.
fn suggested(system: &System, simplest: &Tried, found: &[Tried]) -> Vec<String> {
    let mut different: Vec<(String, &Tried)> = Vec::new();
    for tried in std::iter::once(simplest).chain(found) {
        let term = tried.term(system, 0);
        if different.len() < SUGGESTED && different.iter().all(|(other, _)| *other != term) {
            different.push((term, tried));
        }
    }
    different.iter().enumerate().map(|(at, (_, t))| t.term(system, at)).collect()
}

/// The residuals of all spans, and the runs along which the model responds to a force.
struct Residuals {
    runs: Vec<Run>,
    parts: Vec<Part>,
    /// Per output, the inverse of its spread.
    weights: Vec<f64>,
    /// Of every so many samples one is regressed on.
    every: usize,
    /// The energy of the residual on the training spans, and on the held-out ones.
    trained_left: f64,
    held_left: f64,
}

impl Residuals {
    /// `None` where the model has no linearised run, or where either kind of span leaves no residual.
    fn of(
        likelihood: &Likelihood<'_>,
        held_out: &HeldOut,
        effects: &[Applied],
        left: &[DMatrix<f64>],
    ) -> Option<Self> {
        let records = likelihood.records;
        let every = records.iter().map(|r| r.time_s.len()).sum::<usize>().div_ceil(SAMPLES).max(1);
        let runs = runs(likelihood, effects)?;
        let spread = Errors::trained(records, left);
        let weight = |d: &f64| if *d > 0.0 { d.sqrt().recip() } else { 0.0 };
        let weights: Vec<f64> = spread.deviations.iter().map(weight).collect();
        let parts: Vec<Part> = (0..records.len())
            .flat_map(|at| [(at, false), (at, true)])
            .filter_map(|(at, held)| {
                let span = if held { held_out.span(at) } else { records[at].train }?;
                Some(part(likelihood, (at, held, span), &runs[at], &left[at], &weights, every))
            })
            .collect();
        let energy = |held: bool| {
            parts.iter().filter(|p| p.held == held).map(|p| p.left.norm_squared()).sum::<f64>()
        };
        let (trained_left, held_left) = (energy(false), energy(true));
        (trained_left > 0.0 && held_left > 0.0).then_some(Self {
            runs,
            parts,
            weights,
            every,
            trained_left,
            held_left,
        })
    }

    /// Per circular shift and log, the number of kept samples by which its response is shifted.
    fn turns(&self, seed: u64) -> Vec<Vec<usize>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut turn = |run: &Run| {
            (rng.random_range(0.1..0.9) * run.samples().div_ceil(self.every) as f64) as usize
        };
        (0..TURNS).map(|_| self.runs.iter().map(&mut turn).collect()).collect()
    }

    /// The inner products of the responses of all logs, over the spans of one kind.
    fn sums(&self, responses: &[DMatrix<f64>], held: bool) -> Sums {
        let mut sums = Sums::default();
        for part in self.parts.iter().filter(|p| p.held == held) {
            sums.product += part.product(&responses[part.record], &self.weights, 0);
            sums.square += part.square(&responses[part.record], &self.weights);
        }
        sums
    }

    /// The inner product of shifted responses with the residual, over the spans of one kind.
    fn shifted_product(&self, responses: &[DMatrix<f64>], turn: &[usize], held: bool) -> f64 {
        let here = self.parts.iter().filter(|p| p.held == held);
        here.map(|p| p.product(&responses[p.record], &self.weights, turn[p.record])).sum::<f64>()
    }

    /// A function on a state's derivative with its gain, its R², and its R² at every shift; `None` where one is not finite.
    fn tried(&self, state: usize, form: Form, turns: &[Vec<usize>]) -> Option<Tried> {
        let response =
            |run: &Run| run.response(state, |k| form.of(|v| run.value(v, k)), self.every);
        let responses: Vec<DMatrix<f64>> = self.runs.iter().map(response).collect();
        let (trained, held) = (self.sums(&responses, false), self.sums(&responses, true));
        let (gain, r2) = predicted(trained, held, self.held_left);
        let learnt = trained.product * gain / self.trained_left;
        let shifted_r2 = |turn: &Vec<usize>| {
            let product = |held: bool| self.shifted_product(&responses, turn, held);
            predicted(
                Sums { product: product(false), ..trained },
                Sums { product: product(true), ..held },
                self.held_left,
            )
            .1
        };
        let chance: Vec<f64> = turns.iter().map(shifted_r2).collect();
        let finite = gain.is_finite() && r2.is_finite() && learnt.is_finite();
        finite.then_some(Tried { state, form, gain, learnt, r2, chance })
    }
}

/// A function on a state's derivative.
struct Tried {
    state: usize,
    form: Form,
    gain: f64,
    /// The part of the residual that it takes on training spans, and that it predicts on held-out ones.
    learnt: f64,
    r2: f64,
    chance: Vec<f64>,
}

impl Tried {
    /// As `--candidate` takes it, the so manieth of several; its parameters have names that neither the model nor the others use.
    fn term(&self, system: &System, at: usize) -> String {
        let name = |v: usize| variable(system, v);
        let known = known_names(system);
        let free = |wish: &str| {
            let mut name = if at == 0 { wish.to_owned() } else { format!("{wish}{}", at + 1) };
            while known.contains(&name) {
                name.push('_');
            }
            name
        };
        format!("{} += {}", system.states[self.state].name, self.form.term(name, free))
    }

    fn described(&self, system: &System, chance: f64, suggested: Vec<String>) -> Description {
        let goes_with = self.form.text(|v| variable(system, v));
        let state = system.states[self.state].name.clone();
        let sentence = format!(
            "what is missing on the derivative of `{state}` goes with {goes_with}, {} times it: held-out R² {:.2}, by chance at most {chance:.2}; \
             it describes and is no cause, which ",
            three_digits(self.gain),
            self.r2
        );
        let term = self.term(system, 0);
        let sentence = Message::from(sentence).and(Remedy::Candidate { term }).and(" asks for");
        Description { state, goes_with, held_out_r2: self.r2, suggested, sentence }
    }
}

/// Names that mean something in the model's equations.
fn known_names(system: &System) -> Vec<String> {
    let ports = system.states.iter().chain(&system.inputs).chain(&system.outputs);
    let mut names: Vec<String> = ports.map(|port| port.name.clone()).collect();
    if let Dynamics::Equations(equations, _) = &system.dynamics {
        names.extend(equations.parameters().iter().map(|p| p.name.clone()));
        names.extend(equations.definitions().iter().map(|d| d.name.clone()));
    }
    names
}

/// The name of a state or an input.
fn variable(system: &System, at: usize) -> String {
    let mut names = system.states.iter().chain(&system.inputs).map(|port| port.name.clone());
    names.nth(at).unwrap_or_default()
}

fn three_digits(value: f64) -> String {
    let before = value.abs().log10().floor();
    if (-4.0..6.0).contains(&before) {
        format!("{value:.*}", (2.0 - before).max(0.0) as usize)
    } else {
        format!("{value:.2e}")
    }
}

/// The residual of a span, with the responses to its initial state.
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
        let mut column = DVector::from_iterator(
            rows.len(),
            rows.iter().map(|&(k, o)| response[(k, o)] * weights[o]),
        );
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
    let mut residual =
        DVector::from_iterator(rows.len(), rows.iter().map(|&(k, o)| left[(k, o)] * weights[o]));
    for q in &starts {
        residual.axpy(-q.dot(&residual), q, 1.0);
    }
    let rows = rows.into_iter().map(|(k, o)| (k / every, o)).collect();
    Part { record: at, held, rows, left: residual, starts }
}

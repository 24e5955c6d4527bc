//! Process models as models of records: the best fit of the estimators of dead time, with the covariance of all of its numbers.
//!
//! Equation: ŷ = K·(1 + T_z·s)/((1 + T₁s)(1 + T₂s))·e^(−τs)·u, or K/(s(1 + T₁s))·e^(−τs)·u (`integrator`), sampled exactly, u held between its samples.
//! How it can be wrong: see [`ProcessFit`].

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::chain::{Chain, Shape};
use super::family::{EDGE, Fitted, Poles, Process};
use super::fit::Place;
use super::fit::{Found, Problem, answer, combine};
use super::integrator::Integrator;
use crate::estimate::{DelayEstimate, Outcome};
use deadtime_identify::subspace::{Identified, InnovationsModel, Recordings};
use deadtime_identify::{
    Cloud, Coloured, Guess, Identifier, IdentifyError, Initial, Parameter, Parametric, Record,
    coloured, fir, given, usable,
};
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{Continuous, StateSpace};
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::{NORMAL_95_EXACT, interval95};
use deadtime_signal::stop::Stop;
use deadtime_signal::time::SampleTime;

/// How a record begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Beginning {
    /// At rest, unless a start that is fitted with the rest explains visibly more.
    #[default]
    Auto,
    /// At rest at the first sample's input.
    Rest,
    /// In motion: the start of each record is fitted; the samples within the longest delay do not count.
    Estimated,
}

/// The options of an identified process model.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessOptions {
    /// Which poles two may be; default real ones, `any` a complex pair too.
    pub poles: Poles,
    /// How records begin; default `auto`. An integrator's start is always fitted.
    pub start: Beginning,
    /// Longest dead time that is searched, s; default 35 samples, and twice as long while the best is the longest.
    pub max_delay_s: Option<f64>,
    /// Drawn models for bands, and as many small ones for standard deviations of poles; default 200, 0: none.
    pub draws: usize,
    /// Seed of the draws; default 1.
    pub seed: u64,
}

impl Default for ProcessOptions {
    fn default() -> Self {
        Self { poles: Poles::Real, start: Beginning::Auto, max_delay_s: None, draws: 200, seed: 1 }
    }
}

/// A process model of one input and one output with a dead time that is a real number: `POLES` time constants, with a zero or not, behind an integrator or not.
///
/// Inputs: u, held between its samples, and y, on one even grid; every record has a level of its own. Output: K, T₁, T₂, T_z, s, and the dead time, s, each with its
/// standard deviation and interval, and the model in continuous time.
/// Estimate: least squares over all places of the dead time, then one step of Gauss and Newton under the autoregression that the residuals are fitted with.
/// Intervals: 95 % of draws from that step's covariance; that of the dead time is no narrower than the estimator's likelihood ratio ([`Process`]).
/// Assumes: open loop, noise that does not depend on the input, a plant of this structure.
/// Fails when: the plant has more poles (their lag is called dead time; a note says so where what is left follows the input); the record ends before the response
/// settles (K and T₁ become one number, their intervals say so); under feedback (biased).
/// Source: as [`Process`]; the covariance: Ljung (1999), "System Identification", 2nd ed., section 9.4; first guesses: Åström and Hägglund (1995), "PID Controllers:
/// Theory, Design, and Tuning", 2nd ed., sections 2.4 (areas) and 2.3 (tangent and 63 %).
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct ProcessFit<const POLES: usize, const ZERO: bool, const INTEGRATES: bool>(
    pub ProcessOptions,
);

/// What is fitted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Structure {
    pub(super) poles: usize,
    zero: bool,
    integrates: bool,
}

/// A fit by least squares, time in samples.
pub(super) struct Solved {
    /// ln T₁, or ln a and ρ (see `chain`); the delay; K and what stands for the zero, or K and the slope that a wrong operating input makes.
    pub(super) values: Vec<f64>,
    /// Derivatives of the model by these, then by what else was fitted, all records in a row; zeros where a number is not known to move.
    pub(super) jacobian: Vec<Vec<f64>>,
    /// y − ŷ.
    pub(super) residual: Vec<f64>,
    /// Samples of each record.
    pub(super) lengths: Vec<usize>,
    /// The 95 % interval of the delay, where it is not that of the covariance.
    pub(super) delay: Option<[f64; 2]>,
    /// The noise, and the covariance under it; absent where the numbers cannot be told apart.
    pub(super) noise: Option<Coloured>,
    /// Input and output of the operating point.
    pub(super) operating: [f64; 2],
    pub(super) notes: Vec<String>,
}

/// The numbers of a process model.
#[derive(Debug, Clone, Copy)]
struct Numbers {
    gain: f64,
    /// T₁ + T₂ and T₁·T₂; T₁ and 0 of one pole; zeros of none. s and s².
    lags: [f64; 2],
    zero_s: f64,
    delay_s: f64,
    /// What the operating input is off the one that the record was centred by.
    offset: f64,
}

/// A step of a logarithm or a sample of delay that is too long to be a straight line.
const LONG: f64 = 0.5;

impl Solved {
    /// One step on to the estimate under the noise's own colour, unless it is too long for one; the covariance in any case. `levels`: the derivatives have none of each record's level.
    pub(super) fn weigh(&mut self, poles: usize, levels: bool) {
        self.noise = coloured(&self.jacobian, &self.residual, &self.lengths, levels);
        let Some(noise) = &self.noise else { return };
        if noise.change.iter().take(poles + 1).all(|v| v.abs() < LONG) {
            let moved = self.values[poles];
            for (value, change) in self.values.iter_mut().zip(&noise.change) {
                *value += change;
            }
            self.values[poles] = self.values[poles].max(0.0);
            // Where the delay may be moves with it, and is no narrower than what the covariance says.
            let (delay, std) =
                (self.values[poles], noise.covariance[(poles, poles)].max(0.0).sqrt());
            let [low, high] = interval95(delay, std);
            self.delay = self.delay.map(|[from, to]| {
                [(from + delay - moved).min(low).max(0.0), (to + delay - moved).max(high)]
            });
            self.residual.clone_from(&noise.residual);
        }
    }
}

/// A record may begin at rest: its input stands still through the longest delay, or it is a test of a few steps.
fn may_rest(r: &Record, max_delay: usize) -> bool {
    let moves = |u: &[f64]| u.windows(2).filter(|w| w[0] != w[1]).count();
    moves(&r.u) <= STEPS || moves(r.u.get(..max_delay.min(r.len())).unwrap_or_default()) == 0
}

/// Most changes of the input in a test by steps.
const STEPS: usize = 4;

impl Structure {
    fn shape(self) -> Shape {
        Shape { poles: self.poles, zero: self.zero }
    }

    fn numbers(self, values: &[f64], step: f64, real: bool) -> Numbers {
        let (theta, rest) = values.split_at(self.poles);
        let lags = match theta {
            [sum, ratio, ..] => {
                let most = if real { super::chain::REAL_RATIO } else { super::chain::MOST_RATIO };
                let sum = sum.exp() * step;
                [sum, sum * sum * ratio.clamp(super::chain::LEAST_RATIO, most)]
            }
            [one] => [one.exp() * step, 0.0],
            [] => [0.0; 2],
        };
        let gain = rest.get(1).copied().unwrap_or(0.0);
        let last = rest.get(2).copied().unwrap_or(0.0);
        let unit = if self.poles == 1 { lags[0] } else { lags[1].sqrt() };
        Numbers {
            gain: if self.integrates { gain / step } else { gain },
            lags,
            zero_s: if self.zero { last * unit / gain } else { 0.0 },
            delay_s: rest.first().copied().unwrap_or(0.0).max(0.0) * step,
            offset: if self.integrates { -last / gain } else { 0.0 },
        }
    }

    fn formula(self, complex: bool) -> String {
        let poles = match (self.poles, complex) {
            (0, _) => String::new(),
            (1, _) => "(1 + T1·s)".to_owned(),
            (_, false) => "((1 + T1·s)(1 + T2·s))".to_owned(),
            (_, true) => "(1 + 2·zeta·T·s + T²·s²)".to_owned(),
        };
        let zero = if self.zero { "·(1 + Tz·s)" } else { "" };
        let behind = match (self.integrates, poles.as_str()) {
            (true, "") => "s".to_owned(),
            (true, poles) => format!("(s{poles})"),
            (false, poles) => poles.to_owned(),
        };
        format!("K{zero}/{behind}·e^(−dead_time·s)")
    }
}

impl Numbers {
    fn is_complex(&self) -> bool {
        self.lags[1] > self.lags[0] * self.lags[0] * (super::chain::REAL_RATIO + 1e-12)
    }

    /// Names, values and units of time or gain, in the order of the report.
    fn list(&self, structure: Structure, complex: bool) -> Vec<(&'static str, f64)> {
        let [sum, product] = self.lags;
        let mut list = vec![("K", self.gain)];
        match (structure.poles, complex) {
            (0, _) => {}
            (1, _) => list.push(("T1", sum)),
            (_, false) => {
                let root = (sum * sum - 4.0 * product).max(0.0).sqrt();
                list.extend([("T1", 0.5 * (sum + root)), ("T2", 2.0 * product / (sum + root))]);
            }
            (_, true) => list.extend([("T", product.sqrt()), ("zeta", 0.5 * sum / product.sqrt())]),
        }
        if structure.zero {
            list.push(("Tz", self.zero_s));
        }
        list.push(("dead_time", self.delay_s));
        if structure.integrates {
            list.push(("u0", self.offset));
        }
        list
    }

    fn system(&self, structure: Structure) -> Option<StateSpace<Continuous>> {
        let ([sum, product], gain) = (self.lags, self.gain);
        let (a, b, c, d) = match (structure.poles, structure.integrates) {
            (0, _) => (vec![0.0], vec![1.0], vec![gain], 0.0),
            (1, true) => {
                (vec![0.0, 1.0, 0.0, -1.0 / sum], vec![0.0, 1.0 / sum], vec![gain, 0.0], 0.0)
            }
            (1, false) => (
                vec![-1.0 / sum],
                vec![1.0 / sum],
                vec![gain * (1.0 - self.zero_s / sum)],
                gain * self.zero_s / sum,
            ),
            _ => (
                vec![0.0, 1.0, -1.0 / product, -sum / product],
                vec![0.0, 1.0 / product],
                vec![gain, gain * self.zero_s],
                0.0,
            ),
        };
        let n = b.len();
        let matrix = |rows, columns, v: &[f64]| DMatrix::from_row_slice(rows, columns, v);
        let system = StateSpace::continuous(
            matrix(n, n, &a),
            matrix(n, 1, &b),
            matrix(1, n, &c),
            matrix(1, 1, &[d]),
        )
        .ok()?;
        system.with_input_delay(vec![self.delay_s]).ok()
    }
}

fn sampled(
    system: &StateSpace<Continuous>,
    step: SampleTime,
) -> Option<(InnovationsModel, Vec<usize>)> {
    let s = ZeroOrderHold::default().c2d(system, step).ok()?;
    let k = DMatrix::zeros(s.order(), 1);
    Some((
        InnovationsModel {
            a: s.a().clone(),
            b: s.b().clone(),
            c: s.c().clone(),
            d: s.d().clone(),
            k,
        },
        s.input_delay().to_vec(),
    ))
}

/// Draws that intervals are read from.
const DRAWS: usize = 4000;
/// Longest part of a record that is used, samples.
const LONGEST: usize = 50_000;
/// A longest delay that nobody asked for, samples.
const SEARCHED: usize = 35;
/// What the errors keep of a constant, so that they drift: 1 + Σ d.
const DRIFTS: f64 = 0.02;

impl<const POLES: usize, const ZERO: bool, const INTEGRATES: bool> Identifier
    for ProcessFit<POLES, ZERO, INTEGRATES>
{
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        self.0.identify(
            Structure { poles: POLES, zero: ZERO, integrates: INTEGRATES },
            recordings,
            far,
        )
    }
}

impl ProcessOptions {
    fn identify(
        &self,
        structure: Structure,
        recordings: &Recordings,
        far: &HowFar,
    ) -> Result<Identified, IdentifyError> {
        let method = match (structure.integrates, structure.poles, structure.zero) {
            (true, 0, _) => "p0di",
            (true, ..) => "p1di",
            (_, 1, false) => "p1d",
            (_, 1, true) => "p1dz",
            (_, _, false) => "p2d",
            (_, _, true) => "p2dz",
        };
        if recordings.inputs.len() != 1 {
            return Err(IdentifyError::Inputs { method, inputs: recordings.inputs.len() });
        }
        let step = recordings.sample_time;
        let asked = match self.max_delay_s {
            Some(value) if !(value.is_finite() && value >= 0.0) => {
                return Err(IdentifyError::Option {
                    option: "max_delay_s",
                    value,
                    rule: "it must be 0 or more",
                });
            }
            Some(value) => Some((value / step.seconds()).ceil() as usize),
            None => None,
        };
        let numbers = 3 * (structure.poles + usize::from(structure.zero) + 4);
        let longest = recordings.stretches.iter().map(|s| s.len()).max().unwrap_or(0);
        let mut max_delay = asked.unwrap_or_else(|| SEARCHED.min(longest / 4)).max(1);
        let (used, said) = usable(method, recordings, max_delay + numbers)?;
        let scales = used.scales()?;
        let records: Vec<Record<'static>> = used
            .stretches
            .iter()
            .map(|s| {
                let row =
                    |m: &DMatrix<f64>| m.row(0).iter().take(LONGEST).copied().collect::<Vec<f64>>();
                Record::new(row(&s.u), row(&s.y))
            })
            .collect();
        let shortest = records.iter().map(Record::len).min().unwrap_or(0);
        far.at(0.1, &"fitting the process model");
        let solved = loop {
            let solved = self.solve(structure, &records, max_delay, scales.inputs[0].0, method)?;
            let last = solved.delay.map_or(solved.values[structure.poles], |[_, to]| {
                to.max(solved.values[structure.poles])
            });
            let at_edge = last >= max_delay as f64 - EDGE;
            let wider = 2 * max_delay;
            if at_edge && asked.is_none() && wider + numbers <= shortest && wider <= longest / 2 {
                max_delay = wider;
                continue;
            }
            break if at_edge {
                let note =
                    "the interval of the dead time ends at the longest that was searched: set a longer max_delay_s, or record longer"
                        .to_owned();
                Solved { notes: solved.notes.into_iter().chain([note]).collect(), ..solved }
            } else {
                solved
            };
        };
        far.at(0.8, &"drawing models for the intervals");
        let mut scales = scales;
        (scales.inputs[0].0, scales.outputs[0].0) = (solved.operating[0], solved.operating[1]);
        let failed = |reason: &str| IdentifyError::Unfit { method, reason: reason.to_owned() };
        let Some(Coloured { covariance, d: noise, variance, .. }) = solved.noise else {
            return Err(failed(
                "the numbers cannot be told apart; take a smaller model, or record with a stronger excitation",
            ));
        };
        let count = solved.values.len();
        let real = self.poles == Poles::Real;
        let of = |values: &[f64]| structure.numbers(values, step.seconds(), real);
        let best = of(&solved.values);
        let complex = best.is_complex();
        let cloud = Cloud::of(
            solved.values.clone(),
            &covariance.view((0, 0), (count, count)).into_owned(),
            self.seed,
        );
        // A drawn delay stays near its interval, which knows more of it than a straight line does.
        let bounds =
            solved.delay.map(|[from, to]| [from - 0.5 * (to - from), to + 0.5 * (to - from)]);
        let tamed = |mut values: Vec<f64>| {
            if let Some([from, to]) = bounds {
                values[structure.poles] = values[structure.poles].clamp(from.max(0.0), to);
            }
            values
        };
        let build = |values: &[f64]| sampled(&of(&tamed(values.to_vec())).system(structure)?, step);
        let draws = cloud.as_ref().map(|c| c.models(self.draws, &build)).unwrap_or_default();
        let freedom = (solved.residual.len() as f64 - solved.jacobian.len() as f64).max(1.0);
        let wider = StudentsT::new(0.0, 1.0, freedom)
            .map_or(1.0, |t| t.inverse_cdf(0.975) / NORMAL_95_EXACT);
        let drawn: Vec<Vec<f64>> = cloud
            .iter()
            .flat_map(|c| (0..DRAWS).map(|i| c.draw(i, wider)))
            .map(|v| {
                of(&tamed(v)).list(structure, complex).into_iter().map(|(_, value)| value).collect()
            })
            .collect();
        let units = Units {
            input: used.inputs[0].unit.as_deref(),
            output: used.outputs[0].unit.as_deref(),
            integrates: structure.integrates,
        };
        let mut parameters: Vec<Parameter> = best
            .list(structure, complex)
            .into_iter()
            .enumerate()
            .map(|(i, (name, value))| {
                let spread = spread(drawn.iter().map(|d| d[i]).collect());
                Parameter {
                    name: name.to_owned(),
                    input: None,
                    value,
                    unit: units.of(name),
                    std: spread.map(|s| s.0 / wider),
                    ci95: spread.map(|s| s.1),
                }
            })
            .collect();
        for p in &mut parameters {
            if let ("dead_time", Some([from, to])) = (p.name.as_str(), solved.delay) {
                let ends = [from, to].map(|e| step.to_seconds(e));
                p.std =
                    Some((p.value - ends[0]).max(ends[1] - p.value) / (wider * NORMAL_95_EXACT));
                p.ci95 = Some(ends);
            }
            if p.name == "u0" {
                p.value += scales.inputs[0].0 - best.offset;
                let moved = scales.inputs[0].0 - best.offset;
                p.ci95 = p.ci95.map(|ends| ends.map(|e| e + moved));
            }
        }
        let nominal = best
            .system(structure)
            .ok_or_else(|| failed("its numbers make no model; take a smaller model"))?;
        let (model, delays) = sampled(&nominal, step)
            .ok_or_else(|| failed("it cannot be sampled; take a smaller model"))?;
        let mut notes: Vec<String> = said.into_iter().chain(solved.notes).collect();
        if longest > LONGEST {
            notes.push(format!("the first {LONGEST} samples of each record are used"));
        }
        if 1.0 + noise.iter().sum::<f64>() < DRIFTS {
            notes.push(
                "what the model leaves drifts: a disturbance that the intervals hardly know of; p0di or p1di may suit, or shorter records"
                    .to_owned(),
            );
        }
        Ok(Identified {
            method,
            sample_time: step,
            inputs: used.inputs.clone(),
            outputs: used.outputs.clone(),
            past: noise.len(),
            rows: solved.residual.len(),
            order: given(model.order()),
            innovations: DMatrix::from_element(1, 1, variance),
            model,
            draws,
            notes,
            scales,
            parametric: Some(Parametric {
                structure: structure.formula(complex),
                parameters,
                delays,
                noise,
                continuous: Some(nominal),
                guesses: if structure.integrates {
                    Vec::new()
                } else {
                    guesses(&records, step, max_delay)
                },
            }),
        })
    }

    fn solve(
        &self,
        structure: Structure,
        records: &[Record<'static>],
        max_delay: usize,
        mean: f64,
        method: &'static str,
    ) -> Result<Solved, IdentifyError> {
        let unfit = |reason: String| IdentifyError::Unfit { method, reason };
        if structure.integrates {
            return Integrator { lag: structure.poles > 0, records, max_delay, mean }
                .solve()
                .map_err(unfit);
        }
        let offset = |by: &dyn Fn(&Record) -> f64| -> Vec<Record<'static>> {
            records
                .iter()
                .map(|r| {
                    let by = by(r);
                    Record::new(r.u.iter().map(|u| u - by).collect::<Vec<f64>>(), r.y.to_vec())
                })
                .collect()
        };
        let (resting, moving) =
            (offset(&|r| r.u.first().copied().unwrap_or(0.0)), offset(&|_| mean));
        let guess =
            guesses(records, SampleTime::new(1.0).map_err(|e| unfit(e.to_string()))?, max_delay)
                .first()
                .map(|g| g.dead_time_s);
        let fit = |initial, own| self.fit(structure.shape(), initial, own, max_delay, guess);
        let still = self.start == Beginning::Rest
            || self.start == Beginning::Auto && records.iter().all(|r| may_rest(r, max_delay));
        let started = (self.start != Beginning::Rest).then(|| fit(Initial::Estimated, &moving));
        let rest = (still || matches!(&started, Some(Err(_))) && self.start == Beginning::Auto)
            .then(|| fit(Initial::Zero, &resting));
        let (fitted, own, initial) = match (rest, started) {
            (Some(Ok(rest)), Some(Ok(started))) => {
                let better = started.knowledge.counting
                    * (late(&rest, records, max_delay)
                        / started.knowledge.floored(started.best.cost))
                    .ln();
                // A start left out is a bias, one too many a little scatter: Akaike's price.
                if better > 2.0 * started.problem.parameters() as f64 {
                    (started, &moving, Initial::Estimated)
                } else {
                    (rest, &resting, Initial::Zero)
                }
            }
            (_, Some(Ok(started))) => (started, &moving, Initial::Estimated),
            (Some(Ok(rest)), _) => (rest, &resting, Initial::Zero),
            (Some(Err(said)), _) | (_, Some(Err(said))) => {
                let why = said.note.unwrap_or_else(|| "no model fits".into());
                let integrates =
                    matches!(said.outcome, Outcome::NotConverged | Outcome::NotVisible);
                let remedy =
                    if integrates { "; if the plant integrates, use p0di or p1di" } else { "" };
                return Err(unfit(format!("{why}{remedy}")));
            }
            (None, None) => return Err(unfit("no start is allowed".to_owned())),
        };
        let mut solved = finished(structure, fitted, own, initial, max_delay)
            .ok_or_else(|| unfit("the model cannot be evaluated at its minimum".to_owned()))?;
        solved.weigh(structure.poles, true);
        solved.operating[0] = mean;
        // A level belongs to the input that its record was centred by.
        let levels: Vec<f64> = levels(structure.shape(), &solved, own, initial, max_delay)
            .into_iter()
            .zip(records.iter().zip(own))
            .map(|(level, (r, own))| {
                let by =
                    r.u.first().copied().unwrap_or(0.0) - own.u.first().copied().unwrap_or(0.0);
                level + solved.values[structure.poles + 1] * (mean - by)
            })
            .collect();
        let (total, sum) = levels
            .iter()
            .zip(records)
            .fold((0.0, 0.0), |(n, s), (l, r)| (n + r.len() as f64, s + l * r.len() as f64));
        solved.operating[1] = sum / f64::max(total, 1.0);
        if initial == Initial::Estimated {
            let note = "records do not begin at rest: their starts were fitted, and the samples within the longest delay do not count";
            solved.notes.push(note.to_owned());
        }
        let ends = levels
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], l| [a.min(*l), b.max(*l)]);
        if levels.len() > 1 {
            solved.notes.push(format!(
                "the output's level at the mean input is from {:.5} to {:.5}, by record",
                ends[0], ends[1]
            ));
        }
        Ok(solved)
    }

    fn fit<'a>(
        &self,
        shape: Shape,
        initial: Initial,
        records: &'a [Record<'static>],
        max_delay: usize,
        guess: Option<f64>,
    ) -> Result<Fitted<'a>, DelayEstimate> {
        let process = Process { poles: self.poles, initial, ..Process::default() };
        let problem = Problem::new(
            shape,
            self.poles == Poles::Real,
            initial,
            records,
            max_delay,
            &Stop::default(),
        );
        let fitted = Fitted::of(problem, guess)
            .and_then(|f| process.visible(f, shape, max_delay))?
            .seen_poles(guess)?;
        let Fitted { problem, minima, mut best, knowledge } = fitted;
        if !problem.whole() {
            best = knowledge.middle(&problem, best);
        }
        Ok(Fitted { problem, minima, best, knowledge })
    }
}

/// Σ e² of a fit over the samples behind the first `skip` of each record, each record's own mean taken off.
fn late(fitted: &Fitted<'_>, records: &[Record], skip: usize) -> f64 {
    let mut from = 0;
    let one = |r: &Record| {
        let part = fitted.knowledge.residual.get(from + skip..from + r.len()).unwrap_or_default();
        from += r.len();
        let mean = part.iter().sum::<f64>() / part.len().max(1) as f64;
        part.iter().map(|e| (e - mean).powi(2)).sum::<f64>()
    };
    records.iter().map(one).sum()
}

/// All numbers of a fit with the derivatives by them.
fn finished(
    structure: Structure,
    fitted: Fitted<'_>,
    records: &[Record],
    initial: Initial,
    max_delay: usize,
) -> Option<Solved> {
    let Fitted { problem, minima, best, knowledge } = fitted;
    let Found { theta, place, .. } = &best;
    let signals = problem.signals(theta, *place)?;
    let delay = knowledge.interval(&problem, &best, &minima);
    let numerator = structure.shape().numerator();
    let mut values = theta.clone();
    values.push(place.delay());
    values.extend(signals.coefficients.iter().take(numerator));
    // By the delay, which is the lag less g; where whole samples are all that shows, it is not known to move.
    let fixed = problem.whole();
    let by_delay: Vec<f64> =
        signals.by_delay().iter().map(|v| if fixed { 0.0 } else { -v }).collect();
    let mut jacobian: Vec<Vec<f64>> =
        signals.slopes.iter().take(structure.poles).cloned().collect();
    jacobian.push(by_delay);
    jacobian.extend(signals.linear.iter().cloned());
    // Samples before the first that counts.
    let skip = if initial == Initial::Estimated { max_delay } else { 0 };
    let counted = |column: &Vec<f64>| {
        let mut from = 0;
        let part = |r: &Record| {
            let range = from + skip..from + r.len();
            from += r.len();
            column.get(range).unwrap_or_default().to_vec()
        };
        records.iter().flat_map(part).collect::<Vec<f64>>()
    };
    let left = knowledge.leaves(records, max_delay);
    let note = "what the model leaves over still follows the input: a plant of another structure, whose lag may be in the dead time";
    Some(Solved {
        values,
        jacobian: jacobian.iter().map(counted).collect(),
        residual: counted(&signals.residual),
        lengths: records.iter().map(|r| r.len().saturating_sub(skip)).collect(),
        delay: Some(delay),
        noise: None,
        operating: [0.0; 2],
        notes: left.then(|| note.to_owned()).into_iter().collect(),
    })
}

/// The level of each record's output at the input 0 of `records`.
fn levels(
    shape: Shape,
    solved: &Solved,
    records: &[Record],
    initial: Initial,
    max_delay: usize,
) -> Vec<f64> {
    let (theta, rest) = solved.values.split_at(shape.poles);
    let coefficients = rest.get(1..).unwrap_or_default();
    let place = Place::of(rest.first().copied().unwrap_or(0.0));
    let skip = if initial == Initial::Estimated { max_delay } else { 0 };
    let chain = Chain::new(shape, theta);
    let one = |r: &Record| {
        let y = answer(shape, theta, place, coefficients, &r.u);
        let rest: Vec<f64> = r.y.iter().zip(&y).skip(skip).map(|(y, m)| y - m).collect();
        // Level and starts together, by least squares.
        let mut columns = vec![vec![1.0; rest.len()]];
        if initial == Initial::Estimated {
            let still = vec![0.0; rest.len()];
            for i in 0..shape.poles {
                let mut start = vec![0.0; shape.states()];
                start[i] = 1.0;
                let mut column = vec![0.0; rest.len()];
                combine(
                    &chain.basis[0],
                    &chain.states(&still, &start),
                    &still,
                    0,
                    None,
                    &mut column,
                );
                columns.push(column);
            }
        }
        let all = DMatrix::from_fn(rest.len(), columns.len(), |t, j| columns[j][t]);
        let solved = all.svd(true, true).solve(&DVector::from_vec(rest), 1e-12);
        solved.map_or(0.0, |s| s[0])
    };
    records.iter().map(one).collect()
}

/// Half the width of the middle 68 %, and the ends of the middle 95 %.
fn spread(mut values: Vec<f64>) -> Option<(f64, [f64; 2])> {
    values.retain(|v| v.is_finite());
    if values.len() < 100 {
        return None;
    }
    values.sort_by(f64::total_cmp);
    let at = |p: f64| values[((values.len() - 1) as f64 * p).round() as usize];
    Some((0.5 * (at(0.841_345) - at(0.158_655)), [at(0.025), at(0.975)]))
}

/// Units of what a process model has.
struct Units<'a> {
    input: Option<&'a str>,
    output: Option<&'a str>,
    integrates: bool,
}

impl Units<'_> {
    fn of(&self, name: &str) -> Option<String> {
        match name {
            "zeta" => None,
            "K" => {
                let own = |unit: &str| {
                    if unit.chars().all(|c| c.is_alphanumeric() || c == '°' || c == '%') {
                        unit.to_owned()
                    } else {
                        format!("({unit})")
                    }
                };
                let ratio = match self.input? {
                    "1" => own(self.output?),
                    input => format!("{}/{}", own(self.output?), own(input)),
                };
                Some(if self.integrates { format!("{ratio}/s") } else { ratio })
            }
            "u0" => self.input.map(str::to_owned),
            _ => Some("s".to_owned()),
        }
    }
}

/// Coefficients beyond the longest delay that a step response is read from.
const BEYOND: usize = 100;
/// Share of a step's response that its end is averaged over.
const END: usize = 10;

/// First guesses of K/(1 + T·s)·e^(−τ·s): the step itself where the record is one, else the running sum of an impulse response by least squares.
fn guesses(records: &[Record], step: SampleTime, max_delay: usize) -> Vec<Guess> {
    let response = match records {
        [one] if one.is_one_step() => of_step(one),
        _ => {
            let shortest = records.iter().map(Record::len).min().unwrap_or(0);
            let centred: Vec<Record<'static>> = records
                .iter()
                .map(|r| {
                    let off = |x: &[f64]| {
                        let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
                        x.iter().map(|v| v - mean).collect::<Vec<f64>>()
                    };
                    Record::new(off(&r.u), off(&r.y))
                })
                .collect();
            let heads: Vec<Record<'_>> = centred.iter().map(|r| r.head(20 * BEYOND)).collect();
            fir(&heads, (max_delay + BEYOND).min(shortest / 4)).map(|fir| {
                let mut sum = 0.0;
                fir.coefficients
                    .iter()
                    .map(|h| {
                        sum += h;
                        sum
                    })
                    .collect()
            })
        }
    };
    response
        .map(|s: Vec<f64>| [by_area(&s), by_tangent(&s)].into_iter().flatten().collect::<Vec<_>>())
        .unwrap_or_default()
        .into_iter()
        .map(|g: Guess| Guess {
            lag_s: step.to_seconds(g.lag_s),
            dead_time_s: step.to_seconds(g.dead_time_s),
            ..g
        })
        .collect()
}

/// The output after the only step of the input, from its level before and for a unit step.
fn of_step(record: &Record) -> Option<Vec<f64>> {
    let at = record.u.windows(2).position(|w| w[0] != w[1])? + 1;
    let size = record.u.last()? - record.u.first()?;
    let before = record.y.get(..=at)?;
    let rest = before.iter().sum::<f64>() / before.len() as f64;
    Some(record.y.get(at..)?.iter().map(|y| (y - rest) / size).collect())
}

/// Åström and Hägglund's areas: T_ar = ∫(1 − s/K) dt, A₁ = ∫₀^T_ar s/K dt, T = e·A₁, τ = T_ar − T.
fn by_area(step: &[f64]) -> Option<Guess> {
    let (gain, s) = scaled(step)?;
    let t_ar: f64 = s.windows(2).map(|w| 1.0 - 0.5 * (w[0] + w[1])).sum();
    if !(0.0..s.len() as f64 - 1.0).contains(&t_ar) {
        return None;
    }
    let (whole, part) = (t_ar as usize, t_ar.fract());
    let next = s[whole + 1];
    let a1 = s[..=whole].windows(2).map(|w| 0.5 * (w[0] + w[1])).sum::<f64>()
        + part * (s[whole] + 0.5 * part * (next - s[whole]));
    let lag = std::f64::consts::E * a1;
    (lag > 0.0).then_some(Guess {
        by: "area",
        gain,
        lag_s: lag,
        dead_time_s: (t_ar - lag).max(0.0),
    })
}

/// The steepest tangent meets the start level at τ; the response reaches 63 % at τ + T.
fn by_tangent(step: &[f64]) -> Option<Guess> {
    let (gain, s) = scaled(step)?;
    // Over a few samples, so that noise is not the steepest.
    let span = (s.len() / 40).max(1);
    let slope = |k: usize| (s[k + span] - s[k]) / span as f64;
    let at = (0..s.len().checked_sub(span + 1)?).max_by(|a, b| slope(*a).total_cmp(&slope(*b)))?;
    let dead = (at as f64 + 0.5 * span as f64 - 0.5 * (s[at] + s[at + span]) / slope(at)).max(0.0);
    let reached = s.iter().position(|v| *v >= 1.0 - (-1.0_f64).exp())?;
    let lag = reached as f64 - dead;
    (slope(at) > 0.0 && lag > 0.0).then_some(Guess {
        by: "tangent",
        gain,
        lag_s: lag,
        dead_time_s: dead,
    })
}

/// A step response over its end, and its end.
fn scaled(step: &[f64]) -> Option<(f64, Vec<f64>)> {
    let end = step.get(step.len() - (step.len() / END).max(1)..)?;
    let gain = end.iter().sum::<f64>() / end.len() as f64;
    (gain != 0.0 && gain.is_finite() && step.len() > 3)
        .then(|| (gain, step.iter().map(|s| s / gain).collect()))
}

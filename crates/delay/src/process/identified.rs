//! Process models as models of records: the best fit of the dead-time estimators, with the covariance of all parameters.
//!
//! Equation: ŷ = K·(1 + T_z·s)/((1 + T₁s)(1 + T₂s))·e^(−τs)·u, or K/(s(1 + T₁s))·e^(−τs)·u (`integrator`). The model is sampled exactly, with u held between
//! its samples. How it can be wrong: see [`ProcessFit`].

use deadtime_signal::decompositions::svd;
use nalgebra::{DMatrix, DVector};

use super::chain::{Chain, Shape};
use super::family::{EDGE, Fitted, Poles, Process};
use super::fit::{Found, Place, Problem, answer, combine};
use super::guesses::guesses;
use super::integrator::Integrator;
use super::solved::Solved;
use super::structure::{Numbers, ProcessStructure, ProcessUnits, sampled};
use crate::estimate::{DelayEstimate, Outcome};
use deadtime_identify::subspace::{Draws, Identified, Recordings};
use deadtime_identify::{
    Cloud, Coloured, Identifier, IdentifyError, Initial, Parameter, Parametric, Record, given,
    usable,
};
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::students_t;
use deadtime_signal::stats::{self, NORMAL_95_EXACT};
use deadtime_signal::stop::Stop;
use deadtime_signal::time::SampleTime;

/// The initial state of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Beginning {
    /// At rest, unless a fitted initial state explains significantly more.
    #[default]
    Auto,
    /// At rest at the first sample's input.
    Rest,
    /// In motion: the initial state of each record is fitted; samples within the longest delay are left out.
    Estimated,
}

/// The options of an identified process model.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessOptions {
    /// The allowed poles; default real ones, `any` also a complex pair.
    pub poles: Poles,
    /// The initial state of records; default `auto`. An integrator's initial state is always fitted.
    pub start: Beginning,
    /// Longest dead time that is searched, s; default 35 samples, doubled while the best is the longest.
    pub max_delay_s: Option<f64>,
    /// Drawn models for bands, and as many small ones for standard deviations of poles; default 200; 0: none.
    pub draws: usize,
    /// Seed of the draws; default 1.
    pub seed: u64,
}

impl Default for ProcessOptions {
    fn default() -> Self {
        Self { poles: Poles::Real, start: Beginning::Auto, max_delay_s: None, draws: 200, seed: 1 }
    }
}

/// A process model of one input and one output with a real-valued dead time. The model has `POLES` time constants, with or without a zero, and with or without
/// an integrator.
///
/// Inputs: u, held between its samples, and y, on one even grid; every record has its own offset. Output: K, T₁, T₂, T_z, s, and the dead time, s, each with
/// its standard deviation and interval. Also the model in continuous time. Estimate: least squares over all dead times, then one Gauss-Newton step under the
/// autoregression of the residuals. Intervals: 95 % of draws from that step's covariance; the dead time's interval is at least the estimator's likelihood-ratio
/// interval ([`Process`]).
/// Assumes: open loop, noise independent of the input, a plant of this structure.
/// Fails when: the plant has more poles: the dead time then includes their lag, and a note reports a residual that follows the input. In a record that ends
/// before the response settles, K and T₁ become one parameter, visible in their intervals. Feedback biases the estimate.
/// Source: as [`Process`]. For the covariance Ljung (1999), "System Identification", 2nd ed., section 9.4. For the initial guesses Åström and Hägglund (1995),
/// "PID Controllers: Theory, Design, and Tuning", 2nd ed., sections 2.4 (areas) and 2.3 (tangent and 63 %).
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct ProcessFit<const POLES: usize, const ZERO: bool, const INTEGRATES: bool>(
    pub ProcessOptions,
);

/// A record may begin at rest: its input is constant through the longest delay, or it is a test of a few steps.
fn may_rest(r: &Record, max_delay: usize) -> bool {
    let moves = |u: &[f64]| u.windows(2).filter(|w| w[0] != w[1]).count();
    moves(&r.u) <= STEPS || moves(r.u.get(..max_delay.min(r.len())).unwrap_or_default()) == 0
}

/// Largest number of input changes in a test by steps.
const STEPS: usize = 4;

/// Draws for the intervals.
const DRAWS: usize = 4000;
/// Longest part of a record that is used, samples.
const LONGEST: usize = 50_000;
/// Default longest delay, samples.
const SEARCHED: usize = 35;
/// Constant gain of the noise filter, 1 + Σ d, below which the errors count as drifting.
const DRIFTS: f64 = 0.02;

impl<const POLES: usize, const ZERO: bool, const INTEGRATES: bool> Identifier
    for ProcessFit<POLES, ZERO, INTEGRATES>
{
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        self.0.identify(
            ProcessStructure { poles: POLES, zero: ZERO, integrates: INTEGRATES },
            recordings,
            far,
        )
    }
}

impl ProcessOptions {
    fn identify(
        &self,
        structure: ProcessStructure,
        recordings: &Recordings,
        far: &HowFar,
    ) -> Result<Identified, IdentifyError> {
        let method = structure.method();
        if recordings.inputs.len() != 1 {
            return Err(IdentifyError::Inputs { method, inputs: recordings.inputs.len() });
        }
        let step = recordings.sample_time;
        let longest = recordings.stretches.iter().map(|s| s.len()).max().unwrap_or(0);
        let asked = self.asked(step)?;
        let max_delay = asked.unwrap_or_else(|| SEARCHED.min(longest / 4)).max(1);
        let least = 3 * (structure.poles + usize::from(structure.zero) + 4);
        let (used, said) = usable(method, recordings, max_delay + least)?;
        let mut scales = used.scales()?;
        let records = heads(&used);
        far.at(0.1, &"fitting the process model");
        let shortest = records.iter().map(Record::len).min().unwrap_or(0);
        let most =
            if asked.is_some() { 0 } else { (longest / 2).min(shortest.saturating_sub(least)) };
        let window = [max_delay, most];
        let (solved, max_delay) = self.widened(structure, &records, window, scales.inputs[0].0)?;
        far.at(0.8, &"drawing models for the intervals");
        (scales.inputs[0].0, scales.outputs[0].0) = (solved.operating[0], solved.operating[1]);
        let failed = |reason: &str| IdentifyError::Unfit { method, reason: reason.to_owned() };
        let Some(Coloured { covariance, d: noise, variance, .. }) = &solved.noise else {
            return Err(failed(
                "the parameters are indistinguishable; take a smaller model, or record with a stronger excitation",
            ));
        };
        let spread = Spread::of(self, structure, step, &solved, covariance);
        let parameters = spread.parameters(&used, scales.inputs[0].0);
        let nominal = (spread.best.system(structure))
            .ok_or_else(|| failed("its numbers make no model; take a smaller model"))?;
        let (model, delays) = sampled(&nominal, step)
            .ok_or_else(|| failed("it cannot be sampled; take a smaller model"))?;
        let draws = spread.models();
        let complex = spread.best.is_complex();
        let mut notes: Vec<String> = said.into_iter().chain(solved.notes.iter().cloned()).collect();
        notes.extend(caveats(longest, noise));
        let guesses =
            if structure.integrates { Vec::new() } else { guesses(&records, step, max_delay) };
        Ok(Identified {
            method,
            sample_time: step,
            inputs: used.inputs.clone(),
            outputs: used.outputs.clone(),
            past: noise.len(),
            rows: solved.residual.len(),
            order: given(model.order()),
            innovations: DMatrix::from_element(1, 1, *variance),
            model,
            draws,
            notes,
            scales,
            parametric: Some(Parametric {
                structure: structure.formula(complex),
                parameters,
                delays,
                noise: noise.clone(),
                continuous: Some(nominal),
                guesses,
            }),
        })
    }

    /// The requested longest delay, samples.
    fn asked(&self, step: SampleTime) -> Result<Option<usize>, IdentifyError> {
        match self.max_delay_s {
            Some(value) if !(value.is_finite() && value >= 0.0) => Err(IdentifyError::Option {
                option: "max_delay_s",
                value,
                rule: "it must be 0 or more",
            }),
            asked => Ok(asked.map(|value| (value / step.seconds()).ceil() as usize)),
        }
    }

    /// The fit, and its window. The window doubles up to `most` while the dead time may be the longest in it.
    fn widened(
        &self,
        structure: ProcessStructure,
        records: &[Record<'static>],
        [mut max_delay, most]: [usize; 2],
        mean: f64,
    ) -> Result<(Solved, usize), IdentifyError> {
        loop {
            let mut solved = self.solve(structure, records, max_delay, mean)?;
            let delay = solved.values[structure.poles];
            let last = solved.delay.map_or(delay, |[_, to]| to.max(delay));
            let at_edge = last >= max_delay as f64 - EDGE;
            if !at_edge {
                return Ok((solved, max_delay));
            }
            if 2 * max_delay > most {
                solved.notes.push(
                    "the interval of the dead time ends at the longest that was searched: set a longer max_delay_s, or record longer"
                        .to_owned(),
                );
                return Ok((solved, max_delay));
            }
            max_delay *= 2;
        }
    }

    fn solve(
        &self,
        structure: ProcessStructure,
        records: &[Record<'static>],
        max_delay: usize,
        mean: f64,
    ) -> Result<Solved, IdentifyError> {
        let unfit = |reason: String| IdentifyError::Unfit { method: structure.method(), reason };
        if structure.integrates {
            return Integrator::new(structure.poles > 0, records, max_delay, mean)
                .solve()
                .map_err(unfit);
        }
        let offset = |by: &dyn Fn(&Record) -> f64| -> Vec<Record<'static>> {
            let one = |r: &Record<'static>| {
                let by = by(r);
                Record::new(r.u.iter().map(|u| u - by).collect::<Vec<f64>>(), r.y.to_vec())
            };
            records.iter().map(one).collect()
        };
        let first = |r: &Record| r.u.first().copied().unwrap_or(0.0);
        let (resting, moving) = (offset(&first), offset(&|_| mean));
        let guess =
            guesses(records, SampleTime::new(1.0).map_err(|e| unfit(e.to_string()))?, max_delay)
                .first()
                .map(|g| g.dead_time_s);
        let (fitted, initial) = self
            .begun(structure.shape(), records, [&resting, &moving], max_delay, guess)
            .map_err(unfit)?;
        let own = if initial == Initial::Estimated { &moving } else { &resting };
        let mut solved = finished(structure, fitted, own, initial, max_delay)
            .ok_or_else(|| unfit("the model cannot be evaluated at its minimum".to_owned()))?;
        solved.weigh(structure.poles, true);
        // An offset belongs to the input mean of its record.
        let levels: Vec<f64> = levels(structure.shape(), &solved, own, initial, max_delay)
            .into_iter()
            .zip(records.iter().zip(own))
            .map(|(level, (r, own))| {
                let by = first(r) - first(own);
                level + solved.values[structure.poles + 1] * (mean - by)
            })
            .collect();
        let (total, sum) = levels
            .iter()
            .zip(records)
            .fold((0.0, 0.0), |(n, s), (l, r)| (n + r.len() as f64, s + l * r.len() as f64));
        solved.operating = [mean, sum / f64::max(total, 1.0)];
        if initial == Initial::Estimated {
            let note = "records do not begin at rest: their initial states were fitted, and the samples within the longest delay are left out";
            solved.notes.push(note.to_owned());
        }
        if levels.len() > 1 {
            let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
            let most = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            solved.notes.push(format!(
                "the output's level at the mean input is from {least:.5} to {most:.5}, by record"
            ));
        }
        Ok(solved)
    }

    /// The fit of the records from rest, or with fitted initial states. Errors: why neither exists.
    fn begun<'a>(
        &self,
        shape: Shape,
        records: &[Record],
        [resting, moving]: [&'a [Record<'static>]; 2],
        max_delay: usize,
        guess: Option<f64>,
    ) -> Result<(Fitted<'a>, Initial), String> {
        let fit = |initial, own| self.fit(shape, initial, own, max_delay, guess);
        let still = self.start == Beginning::Rest
            || self.start == Beginning::Auto && records.iter().all(|r| may_rest(r, max_delay));
        let started = (self.start != Beginning::Rest).then(|| fit(Initial::Estimated, moving));
        let rest = (still || matches!(&started, Some(Err(_))) && self.start == Beginning::Auto)
            .then(|| fit(Initial::Zero, resting));
        match (rest, started) {
            (Some(Ok(rest)), Some(Ok(started))) => {
                let better = started.knowledge.counting
                    * (late(&rest, records, max_delay)
                        / started.knowledge.floored(started.best.cost))
                    .ln();
                // An omitted initial state is a bias, a redundant one a little variance: Akaike's criterion.
                if better > 2.0 * started.problem.parameters() as f64 {
                    Ok((started, Initial::Estimated))
                } else {
                    Ok((rest, Initial::Zero))
                }
            }
            (_, Some(Ok(started))) => Ok((started, Initial::Estimated)),
            (Some(Ok(rest)), _) => Ok((rest, Initial::Zero)),
            (Some(Err(said)), _) | (_, Some(Err(said))) => {
                let why = said.note.unwrap_or_else(|| "no model fits".into());
                let integrates =
                    matches!(said.outcome, Outcome::NotConverged | Outcome::NotVisible);
                let remedy =
                    if integrates { "; if the plant integrates, use p0di or p1di" } else { "" };
                Err(format!("{why}{remedy}"))
            }
            (None, None) => Err("no start is allowed".to_owned()),
        }
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
        let real = self.poles == Poles::Real;
        let problem = Problem::new(shape, real, initial, records, max_delay, &Stop::default());
        let fitted = Fitted::of(problem, guess)
            .and_then(|f| process.visible(f, shape, max_delay))?
            .seen_poles(guess)?;
        Ok(fitted.centred())
    }
}

/// Notes on records longer than [`LONGEST`], and on a residual that drifts.
fn caveats(longest: usize, noise: &[f64]) -> Vec<String> {
    let mut notes = Vec::new();
    if longest > LONGEST {
        notes.push(format!("the first {LONGEST} samples of each record are used"));
    }
    if 1.0 + noise.iter().sum::<f64>() < DRIFTS {
        notes.push(
            "the residual drifts: a disturbance that the intervals do not include; p0di or p1di may suit, or shorter records"
                .to_owned(),
        );
    }
    notes
}

/// The first samples of every stretch, as records.
fn heads(used: &Recordings) -> Vec<Record<'static>> {
    let row = |m: &DMatrix<f64>| m.row(0).iter().take(LONGEST).copied().collect::<Vec<f64>>();
    used.stretches.iter().map(|s| Record::new(row(&s.u), row(&s.y))).collect()
}

/// A fit with models drawn from its covariance.
struct Spread<'a> {
    options: &'a ProcessOptions,
    structure: ProcessStructure,
    step: SampleTime,
    solved: &'a Solved,
    best: Numbers,
    cloud: Option<Cloud>,
    /// Student's 97.5 % quantile over the normal one.
    wider: f64,
}

impl<'a> Spread<'a> {
    fn of(
        options: &'a ProcessOptions,
        structure: ProcessStructure,
        step: SampleTime,
        solved: &'a Solved,
        covariance: &DMatrix<f64>,
    ) -> Self {
        let count = solved.values.len();
        let covariance = covariance.view((0, 0), (count, count)).into_owned();
        let cloud = Cloud::of(solved.values.clone(), &covariance, options.seed);
        let freedom = (solved.residual.len() as f64 - solved.jacobian.len() as f64).max(1.0);
        let wider = students_t(0.975, freedom).map_or(1.0, |t| t / NORMAL_95_EXACT);
        let best = structure.numbers(&solved.values, step.seconds(), options.poles == Poles::Real);
        Self { options, structure, step, solved, best, cloud, wider }
    }

    /// The parameters of drawn values. A drawn delay stays near its interval, which is more accurate than linearisation.
    fn numbers(&self, mut values: Vec<f64>) -> Numbers {
        if let Some([from, to]) = self.solved.delay {
            let [from, to] = [from - 0.5 * (to - from), to + 0.5 * (to - from)];
            let delay = &mut values[self.structure.poles];
            *delay = delay.clamp(from.max(0.0), to);
        }
        self.structure.numbers(&values, self.step.seconds(), self.options.poles == Poles::Real)
    }

    /// The drawn models.
    fn models(&self) -> Draws {
        let build = |values: &[f64]| {
            sampled(&self.numbers(values.to_vec()).system(self.structure)?, self.step)
        };
        self.cloud.as_ref().map(|c| c.models(self.options.draws, &build)).unwrap_or_default()
    }

    /// Every parameter with its spread; `mean` is the operating input.
    fn parameters(&self, used: &Recordings, mean: f64) -> Vec<Parameter> {
        let Self { structure, best, wider, .. } = self;
        let units = ProcessUnits {
            input: used.inputs[0].unit.as_deref(),
            output: used.outputs[0].unit.as_deref(),
            integrates: structure.integrates,
        };
        let complex = best.is_complex();
        let list = |n: &Numbers| n.list(*structure, complex);
        let drawn: Vec<Vec<f64>> = self
            .cloud
            .iter()
            .flat_map(|c| (0..DRAWS).map(|i| c.draw(i, *wider)))
            .map(|v| list(&self.numbers(v)).into_iter().map(|(_, value)| value).collect())
            .collect();
        let parameter = |(i, (name, value)): (usize, (&'static str, f64))| {
            let spread = spread(drawn.iter().map(|d| d[i]).collect());
            let mut p = Parameter {
                name: name.to_owned(),
                input: None,
                value,
                unit: units.of(name),
                std: spread.map(|s| s.0 / wider),
                ci95: spread.map(|s| s.1),
            };
            if let ("dead_time", Some(ends)) = (name, self.solved.delay) {
                let ends = ends.map(|e| self.step.to_seconds(e));
                p.std = Some((value - ends[0]).max(ends[1] - value) / (wider * NORMAL_95_EXACT));
                p.ci95 = Some(ends);
            }
            if name == "u0" {
                let moved = mean - best.offset;
                p.value += moved;
                p.ci95 = p.ci95.map(|ends| ends.map(|e| e + moved));
            }
            p
        };
        list(best).into_iter().enumerate().map(parameter).collect()
    }
}

/// Σ e² of a fit over the samples behind the first `skip` of each record, with each record's own mean subtracted.
fn late(fitted: &Fitted<'_>, records: &[Record], skip: usize) -> f64 {
    let mut from = 0;
    let one = |r: &Record| {
        let part = fitted.knowledge.residual.get(from + skip..from + r.len()).unwrap_or_default();
        from += r.len();
        let mean = stats::mean(part.iter().copied()).unwrap_or(0.0);
        part.iter().map(|e| (e - mean).powi(2)).sum::<f64>()
    };
    records.iter().map(one).sum()
}

/// All parameters of a fit with the derivatives by them.
fn finished(
    structure: ProcessStructure,
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
    // The derivative by the delay, which is the lag minus g; with whole-sample delays it is treated as fixed.
    let fixed = problem.whole();
    let by_delay: Vec<f64> =
        signals.by_delay().iter().map(|v| if fixed { 0.0 } else { -v }).collect();
    let mut jacobian: Vec<Vec<f64>> =
        signals.slopes.iter().take(structure.poles).cloned().collect();
    jacobian.push(by_delay);
    jacobian.extend(signals.linear.iter().cloned());
    // Samples before the first used one.
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

/// The offset of each record's output at the input 0 of `records`.
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
        // Offset and initial states together, by least squares.
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
        let solved = svd(&all).and_then(|found| found.solve(&DVector::from_vec(rest), 1e-12).ok());
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

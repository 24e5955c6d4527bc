//! Every method on the same few kinds of record: its own kind, a plant with a lag, and a loop.

use std::f64::consts::PI;
use std::time::Instant;

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Exp1, StandardNormal};

use super::error::Result;
use deadtime_delay::{
    Class, DelayError, DelayEstimator, Detrend, Events, Experiment, METHODS, Method, PlantModel,
    Recording, ReferenceExperiment, Scope, Search, Start,
};
use deadtime_model::simulate::{Options, Response, lsim};
use deadtime_model::uav::Dynamics;
use deadtime_model::{Continuous, StateSpace};
use deadtime_signal::excitation::Rbs;
use deadtime_signal::parallel;
use deadtime_signal::time::SampleTime;
use deadtime_signal::{Excitation, Noise, NoiseColour, NoiseScaling, stats};

/// A small study that every method of the list takes part in.
///
/// True delays are uniform from 2 to 12 samples, fractions included; every kind of record has a noise of a hundredth of the signal's power. All methods see
/// the same records of a kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Common {
    /// Records of each kind.
    pub trials: usize,
    /// Samples of a record.
    pub samples: usize,
    /// Seed; every record has its own stream.
    pub seed: u64,
}

impl Default for Common {
    fn default() -> Self {
        Self { trials: 100, samples: 500, seed: 1 }
    }
}

/// How a method did on one kind of record.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CommonScore {
    /// Records.
    pub trials: usize,
    /// Records for which it gave a delay.
    pub found: usize,
    /// Root mean square error of those, samples.
    pub rms_samples: Option<f64>,
    /// Mean error of those, samples.
    pub bias_samples: Option<f64>,
    /// Share of those whose 95 % interval holds the truth.
    pub coverage95: Option<f64>,
}

/// One method in the study.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MethodRow {
    /// The method.
    pub method: &'static str,
    /// Its class.
    pub class: Class,
    /// On the kind of record that it is made for.
    pub on_reference: CommonScore,
    /// On a plant with a time constant of 8 samples, moved by a random binary input; `None` for a method without pairs.
    pub lag: Option<CommonScore>,
    /// On the same plant under feedback, with 10 % of the signal's power as noise, from the plant's true input; `None` as above.
    pub feedback: Option<CommonScore>,
    /// Median time of an estimate on a record of its reference experiment, s.
    pub time_s: f64,
}

/// A record, its true delay in samples, and the shortest raw delay to search.
type Known = (Experiment<'static>, f64, usize);

impl Common {
    /// One row per method, in the order of the list; `progress` receives the name of each finished one. The rows do not depend on the number of threads, except for the run times.
    ///
    /// # Errors
    /// The error of a record or of a method's options.
    pub fn run(&self, progress: &mut dyn FnMut(&str)) -> Result<Vec<MethodRow>> {
        let mut records =
            vec![(ReferenceExperiment::Plant, self.records(ReferenceExperiment::Plant)?)];
        for method in METHODS {
            if records.iter().all(|(kind, _)| *kind != method.reference) {
                records.push((method.reference, self.records(method.reference)?));
            }
        }
        let of = |kind: ReferenceExperiment| {
            records.iter().find(|(k, _)| *k == kind).map_or(&[][..], |(_, r)| r)
        };
        let loops: Vec<Known> = (0..self.trials).map(|t| self.closed(t)).collect::<Result<_>>()?;
        METHODS
            .iter()
            .map(|method| {
                let estimator = method.entry.with(serde_json::json!({}))?;
                let pairs = |records: &[Known]| {
                    (method.scope == Scope::Pair)
                        .then(|| score(method, estimator.as_ref(), records))
                };
                let row = MethodRow {
                    method: method.entry.name,
                    class: method.class,
                    on_reference: score(method, estimator.as_ref(), of(method.reference)),
                    lag: pairs(of(ReferenceExperiment::Plant)),
                    feedback: pairs(&loops),
                    time_s: time(method, estimator.as_ref(), of(method.reference)),
                };
                progress(method.entry.name);
                Ok(row)
            })
            .collect()
    }

    fn records(&self, kind: ReferenceExperiment) -> Result<Vec<Known>> {
        parallel::try_map(0..self.trials, |t| {
            self.experiment(kind, t).map(|(experiment, delay)| (experiment, delay, 0))
        })
    }

    /// The random numbers of record `trial`, its true delay drawn first: the same for every kind.
    fn draw(&self, trial: usize) -> (ChaCha8Rng, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(trial as u64);
        let delay = rng.random_range(2.0..12.0);
        (rng, delay)
    }

    /// Record `trial` of a kind and its true delay, samples.
    ///
    /// # Errors
    /// The error of the record.
    pub fn experiment(
        &self,
        kind: ReferenceExperiment,
        trial: usize,
    ) -> Result<(Experiment<'static>, f64)> {
        let (mut rng, delay) = self.draw(trial);
        let sample_time = SampleTime::new(1.0)?;
        let n = self.samples;
        let siso = |u: Vec<f64>, y: Vec<f64>| Experiment::siso(sample_time, u, y);
        let experiment = match kind {
            ReferenceExperiment::Plant => {
                let u = Rbs::default().generate(n, &mut rng)?;
                let y = First::new(delay).respond(&u);
                siso(u, noisy(&y, &mut rng)?)?
            }
            ReferenceExperiment::Process { poles, zero } => {
                let u = Rbs::default().generate(n, &mut rng)?;
                let times = [8.0, 4.0, 2.0];
                let y = held(
                    &lags(&times[..poles.clamp(1, times.len())], zero.then_some(5.0))?,
                    &u,
                    delay,
                    sample_time,
                )?;
                siso(u, noisy(&y, &mut rng)?)?
            }
            ReferenceExperiment::Copy => {
                let at = tones(&mut rng);
                copy(n, delay, at, siso, &mut rng)?
            }
            ReferenceExperiment::Skewed => {
                let at = pulses(f(n), &mut rng);
                copy(n, delay, at, siso, &mut rng)?
            }
            ReferenceExperiment::Steps => {
                let u: Vec<f64> = (0..n)
                    .map(|t| if t >= n / 10 && t < n * 11 / 20 { 1.0 } else { 0.0 })
                    .collect();
                let y = held(&lags(&[10.0, 1.0], None)?, &u, delay, sample_time)?;
                siso(u, noisy(&y, &mut rng)?)?
            }
            ReferenceExperiment::States => states(n, delay, &mut rng)?,
            ReferenceExperiment::Events => {
                Experiment::of_events(sample_time, ["a", "b"], vec![events(n, delay, &mut rng)])?
            }
        };
        Ok((experiment, delay))
    }

    /// The plant of [`ReferenceExperiment::Plant`] under proportional feedback of a noisy output, with a random binary reference.
    fn closed(&self, trial: usize) -> Result<Known> {
        let (mut rng, delay) = self.draw(trial);
        let reference =
            Rbs { band: [0.0, 0.3], ..Rbs::default() }.generate(self.samples, &mut rng)?;
        let plant = First::new(delay);
        let (mut u, mut x, mut y) = (Vec::new(), Vec::new(), Vec::new());
        for r in reference {
            let state = plant.next(&x, &u);
            let noise: f64 = StandardNormal.sample(&mut rng);
            x.push(state);
            y.push(state + 0.4 * noise);
            // A gain of a half keeps a gain margin of two at the longest delay.
            u.push(r - 0.5 * y[y.len() - 1]);
        }
        // The controller answers within the sample, the plant does not.
        Ok((Experiment::siso(SampleTime::new(1.0)?, u, y)?, delay, 1))
    }
}

/// A sum of 200 cosines.
fn tones(rng: &mut ChaCha8Rng) -> impl Fn(f64) -> f64 + use<> {
    let tones: Vec<[f64; 2]> = (0..200)
        .map(|_| [rng.random_range(0.0..0.8 * PI), rng.random_range(0.0..2.0 * PI)])
        .collect();
    move |t| tones.iter().map(|[w, phase]| (w * t + phase).cos()).sum::<f64>()
}

/// Pulses of random times and sizes.
fn pulses(end: f64, rng: &mut ChaCha8Rng) -> impl Fn(f64) -> f64 + use<> {
    let mut pulses = Vec::new();
    let mut when = -40.0;
    while when < end + 40.0 {
        let gap: f64 = Exp1.sample(rng);
        let size: f64 = Exp1.sample(rng);
        when += 4.0 * gap;
        pulses.push([when, size]);
    }
    move |t| {
        // Beyond 12 samples a pulse is below rounding.
        let near = pulses.partition_point(|p| p[0] < t - 12.0)
            ..pulses.partition_point(|p| p[0] < t + 12.0);
        let shape = |[when, size]: &[f64; 2]| size * (-((t - when) / 1.5).powi(2)).exp();
        pulses[near].iter().map(shape).sum::<f64>()
    }
}

/// A plant whose states are measured too.
fn states(n: usize, delay: f64, rng: &mut ChaCha8Rng) -> Result<Experiment<'static>> {
    let u = Rbs::default().generate(n, rng)?;
    let sample_time = SampleTime::new(0.1)?;
    let plant = Dynamics::Directional.model();
    let response = respond(&plant, &u, delay, sample_time)?;
    let column = |m: &DMatrix<f64>, i: usize| m.column(i).iter().copied().collect::<Vec<f64>>();
    let states = (0..plant.order())
        .map(|i| Ok(noisy(&column(&response.x, i), rng)?.into()))
        .collect::<Result<_>>()?;
    let outputs = vec![column(&response.y, 0).into()];
    let recording = Recording { inputs: vec![u.into()], outputs, states };
    Ok(Experiment::new(sample_time, vec!["u".into()], vec!["y".into()], vec![recording])?
        .with_model(PlantModel::Continuous(plant)))
}

/// Events at two places, with errors of their times.
fn events(n: usize, delay: f64, rng: &mut ChaCha8Rng) -> Events {
    let mut time = 0.0;
    let (mut first, mut second) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for _ in 0..n {
        let gap: f64 = Exp1.sample(rng);
        let jitter: f64 = StandardNormal.sample(rng);
        time += 2.0 + 4.0 * gap;
        first.push(time);
        second.push(time + delay + 0.2 * jitter);
    }
    Events { first, second, ..Events::default() }
}

fn f(n: usize) -> f64 {
    n as f64
}

/// 1/(8s + 1) behind a zero-order hold of one second and a dead time.
struct First {
    pole: f64,
    /// Gains of the input `whole` + 1 and `whole` + 2 samples ago.
    gains: [f64; 2],
    whole: usize,
}

impl First {
    fn new(delay: f64) -> Self {
        let pole = (-1.0 / 8.0_f64).exp();
        let rest = (-(1.0 - delay.fract()) / 8.0).exp();
        Self { pole, gains: [1.0 - rest, rest - pole], whole: delay.floor() as usize }
    }

    /// The next state after the past ones `x` and inputs `u`.
    fn next(&self, x: &[f64], u: &[f64]) -> f64 {
        let before = |lag: usize| u.len().checked_sub(lag).map_or(0.0, |t| u[t]);
        let drive = self.gains[0] * before(self.whole + 1) + self.gains[1] * before(self.whole + 2);
        self.pole * x.last().copied().unwrap_or(0.0) + drive
    }

    fn respond(&self, u: &[f64]) -> Vec<f64> {
        let mut x = Vec::with_capacity(u.len());
        for t in 0..u.len() {
            x.push(self.next(&x, &u[..t]));
        }
        x
    }
}

/// (zs + 1)/((t₁s + 1)(t₂s + 1)…), a chain of first-order lags.
fn lags(times: &[f64], zero: Option<f64>) -> Result<StateSpace<Continuous>> {
    let order = times.len();
    // Each lag follows the one before, the first the input; the zero adds the rate of the last.
    let a = DMatrix::from_fn(order, order, |i, j| match i.checked_sub(j) {
        Some(0) => -1.0 / times[i],
        Some(1) => 1.0 / times[i],
        _ => 0.0,
    });
    let b = DMatrix::from_fn(order, 1, |i, _| if i == 0 { 1.0 / times[0] } else { 0.0 });
    let last = DMatrix::from_fn(1, order, |_, j| if j + 1 == order { 1.0 } else { 0.0 });
    let z = zero.unwrap_or(0.0);
    let (c, d) = (&last + z * (&last * &a), z * (&last * &b));
    Ok(StateSpace::continuous(a, b, c, d)?)
}

/// The response of a plant to a held input, later by `delay` samples.
fn respond(
    plant: &StateSpace<Continuous>,
    u: &[f64],
    delay: f64,
    sample_time: SampleTime,
) -> Result<Response> {
    let delayed = plant.clone().with_input_delay(vec![sample_time.to_seconds(delay)])?;
    let u = DMatrix::from_column_slice(u.len(), 1, u);
    Ok(lsim(&delayed, &u, sample_time, &Options::default())?)
}

/// Its first output.
fn held(
    plant: &StateSpace<Continuous>,
    u: &[f64],
    delay: f64,
    sample_time: SampleTime,
) -> Result<Vec<f64>> {
    Ok(respond(plant, u, delay, sample_time)?.y.column(0).iter().copied().collect())
}

/// A signal and the same signal later. One sample of the delay is the hold's, which every method subtracts.
fn copy(
    n: usize,
    delay: f64,
    at: impl Fn(f64) -> f64,
    siso: impl Fn(Vec<f64>, Vec<f64>) -> Result<Experiment<'static>, DelayError>,
    rng: &mut ChaCha8Rng,
) -> Result<Experiment<'static>> {
    let u = (0..n).map(|t| at(f(t))).collect();
    let y: Vec<f64> = (0..n).map(|t| at(f(t) - delay - 1.0)).collect();
    Ok(siso(u, noisy(&y, rng)?)?)
}

fn noisy(y: &[f64], rng: &mut ChaCha8Rng) -> Result<Vec<f64>> {
    Ok(Noise { snr: 100.0, colour: NoiseColour::White, scaling: NoiseScaling::Expected }
        .add(y, rng)?)
}

/// Without means, or measured from its rest for a method that counts on it: as the command line gives records to methods.
fn prepared<'a>(method: &Method, experiment: &'a Experiment<'_>) -> Option<Experiment<'a>> {
    if method.scope != Scope::Pair {
        return Some(experiment.borrowed());
    }
    if method.start == Start::Rest
        && let Some(rested) = experiment.borrowed().from_rest()
    {
        return Some(rested);
    }
    experiment.detrended(Detrend::Mean).ok()
}

/// Error in samples and whether the interval holds the truth; `None` without a delay.
fn answer(
    method: &Method,
    estimator: &dyn DelayEstimator,
    (experiment, delay, min_delay): &Known,
) -> Option<(f64, bool)> {
    let ts = experiment.sample_time();
    let estimate = estimator
        .estimate(
            &prepared(method, experiment)?,
            &Search { min_delay: *min_delay, ..Search::default() },
        )
        .ok()?;
    let truth_s = ts.to_seconds(*delay);
    let inside = estimate.ci95_s.is_some_and(|[from, to]| from <= truth_s && truth_s <= to);
    Some((
        (estimate.delay_s.filter(|_| estimate.outcome.has_delay())? - truth_s) / ts.seconds(),
        inside,
    ))
}

fn score(method: &Method, estimator: &dyn DelayEstimator, records: &[Known]) -> CommonScore {
    let answers: Vec<(f64, bool)> = parallel::map(records.iter(), |r| answer(method, estimator, r))
        .into_iter()
        .flatten()
        .collect();
    let mean = |g: &dyn Fn(&(f64, bool)) -> f64| stats::mean(answers.iter().map(g));
    CommonScore {
        trials: records.len(),
        found: answers.len(),
        rms_samples: mean(&|a| a.0 * a.0).map(f64::sqrt),
        bias_samples: mean(&|a| a.0),
        coverage95: mean(&|a| f64::from(u8::from(a.1))),
    }
}

/// Median of as many runs as the first records allow, one at a time.
fn time(method: &Method, estimator: &dyn DelayEstimator, records: &[Known]) -> f64 {
    let times: Vec<f64> = records
        .iter()
        .take(TIMED)
        .map(|(experiment, _, _)| {
            let Some(experiment) = prepared(method, experiment) else { return f64::INFINITY };
            let clock = Instant::now();
            std::hint::black_box(estimator.estimate(&experiment, &Search::default())).ok();
            clock.elapsed().as_secs_f64()
        })
        .collect();
    stats::upper_median(times).unwrap_or(0.0)
}

/// Records that are timed.
const TIMED: usize = 11;

//! Plants, inputs and records with a known dead time, for the tests of the estimators.

use deadtime::delay::{
    DelayError, DelayEstimate, DelayEstimator, Events, Experiment, Method, PlantModel, Recording,
    Scope, Search,
};
use deadtime::model::{Sampled, StateSpace};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::Rbs;
use deadtime::simulate::{Options, Prehistory, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// The sample time of the thesis, s.
pub(crate) const TS: f64 = 0.1;

/// Whole samples in seconds carry no more than rounding.
pub(crate) const ROUNDING_S: f64 = 1e-9;

pub(crate) fn ts(seconds: f64) -> SampleTime {
    SampleTime::new(seconds).unwrap()
}

pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A white random binary signal of ±`level`.
pub(crate) fn rbs(samples: usize, level: f64, seed: u64) -> Vec<f64> {
    Rbs { levels: [-level, level], ..Rbs::default() }.generate(samples, &mut rng(seed)).unwrap()
}

/// Independent Gaussian numbers of this standard deviation.
pub(crate) fn white(samples: usize, std: f64, seed: u64) -> Vec<f64> {
    let mut rng = rng(seed);
    let draw = |_| -> f64 { StandardNormal.sample(&mut rng) };
    (0..samples).map(draw).map(|v| std * v).collect()
}

pub(crate) fn std_dev(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

pub(crate) fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

pub(crate) fn times(x: &[f64], gain: f64) -> Vec<f64> {
    x.iter().map(|v| gain * v).collect()
}

/// `x` delayed by `k` samples, zero before.
pub(crate) fn delayed(x: &[f64], k: usize) -> Vec<f64> {
    (0..x.len()).map(|t| if t < k { 0.0 } else { x[t - k] }).collect()
}

/// Outputs and states of a plant that rests before the first sample, its input delayed by `delay` samples.
pub(crate) fn respond(
    sys: &StateSpace<Sampled>,
    inputs: &[Vec<f64>],
    delay: &[usize],
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let sys = sys.clone().with_input_delay(delay.to_vec()).unwrap();
    let u = DMatrix::from_fn(inputs[0].len(), inputs.len(), |t, j| inputs[j][t]);
    let response = lsim(
        &sys,
        &u,
        sys.sample_time(),
        &Options { prehistory: Prehistory::Rest, ..Options::default() },
    )
    .unwrap();
    let columns = |m: &DMatrix<f64>| m.column_iter().map(|c| c.iter().copied().collect()).collect();
    (columns(&response.y), columns(&response.x))
}

/// The response of b·q⁻¹/(1 + f₁q⁻¹ + f₂q⁻²) behind `delay` samples, at rest before the first sample.
pub(crate) fn second_order(u: &[f64], b: f64, f: [f64; 2], delay: usize) -> Vec<f64> {
    let mut y = vec![0.0; u.len()];
    for t in 0..u.len() {
        let past = |lag: usize| if t >= lag { y[t - lag] } else { 0.0 };
        let drive = if t > delay { u[t - 1 - delay] } else { 0.0 };
        y[t] = b * drive - f[0] * past(1) - f[1] * past(2);
    }
    y
}

/// A continuous plant of real poles (time constants in s, from the slowest) and perhaps a zero, unit gain, and its response to a held input after a dead time, s.
///
/// Integrated exactly over each stretch of constant input by the crate's `lsim`, which is tested against other tools on its own.
pub(crate) fn process(
    u: &[f64],
    lags_s: &[f64],
    zero_s: Option<f64>,
    delay_s: f64,
    ts_s: f64,
) -> Vec<f64> {
    use deadtime::model::{Continuous, TransferFunction};
    let times = |a: &[f64], lag: f64| -> Vec<f64> {
        let (up, same) =
            (a.iter().map(|v| v * lag).chain([0.0]), [0.0].into_iter().chain(a.iter().copied()));
        up.zip(same).map(|(a, b)| a + b).collect()
    };
    let denominator = lags_s.iter().fold(vec![1.0], |d, &lag| times(&d, lag));
    let numerator = zero_s.map_or(vec![1.0], |z| vec![z, 1.0]);
    let plant = TransferFunction::from_polynomials(&numerator, &denominator, delay_s, Continuous)
        .unwrap()
        .to_state_space()
        .unwrap();
    let input = DMatrix::from_column_slice(u.len(), 1, u);
    let options = Options { prehistory: Prehistory::Rest, ..Options::default() };
    lsim(&plant, &input, ts(ts_s), &options).unwrap().y.column(0).iter().copied().collect()
}

/// The one answer of a method that looks at a pair.
pub(crate) fn answer(
    method: &Method,
    experiment: &Experiment<'_>,
    search: &Search,
) -> DelayEstimate {
    method.entry.with(serde_json::json!({})).unwrap().estimate(experiment, search).unwrap()
}

/// What was measured, not yet checked, for tests that spoil it.
#[derive(Debug, Clone)]
pub(crate) struct Measured {
    pub(crate) sample_time: SampleTime,
    pub(crate) inputs: Vec<String>,
    pub(crate) outputs: Vec<String>,
    pub(crate) recordings: Vec<Recording<'static>>,
    pub(crate) model: Option<PlantModel>,
    pub(crate) events: Vec<Events>,
}

impl Measured {
    pub(crate) fn siso(sample_time: SampleTime, u: Vec<f64>, y: Vec<f64>) -> Self {
        let recordings =
            vec![Recording { inputs: vec![u.into()], outputs: vec![y.into()], states: Vec::new() }];
        let (inputs, outputs) = (vec!["u".into()], vec!["y".into()]);
        Self { sample_time, inputs, outputs, recordings, model: None, events: Vec::new() }
    }

    pub(crate) fn of_events(sample_time: SampleTime, events: Vec<Events>) -> Self {
        let (inputs, outputs) = (vec!["a".into()], vec!["b".into()]);
        Self { sample_time, inputs, outputs, recordings: Vec::new(), model: None, events }
    }

    pub(crate) fn checked(&self) -> Result<Experiment<'static>, DelayError> {
        let Self { sample_time, inputs, outputs, recordings, model, events } = self.clone();
        if !events.is_empty() {
            return Experiment::of_events(sample_time, [&inputs[0], &outputs[0]], events);
        }
        let experiment = Experiment::new(sample_time, inputs, outputs, recordings)?;
        Ok(match model {
            Some(model) => experiment.with_model(model),
            None => experiment,
        })
    }
}

/// What a method answers: of one that looks at states the delays of all inputs.
pub(crate) fn estimates(
    method: &Method,
    estimator: &dyn DelayEstimator,
    measured: &Measured,
    search: &Search,
) -> Result<Vec<DelayEstimate>, DelayError> {
    let experiment = measured.checked()?;
    if method.scope == Scope::States {
        return estimator.estimate_inputs(&experiment, search);
    }
    Ok(vec![estimator.estimate(&experiment, search)?])
}

/// Seconds as samples.
pub(crate) fn samples(delay_s: f64, ts_s: f64) -> f64 {
    delay_s / ts_s
}

/// The delay found, as a whole number of samples; `None` for any other outcome or a fraction.
pub(crate) fn whole(estimate: &DelayEstimate, ts_s: f64) -> Option<usize> {
    let found = samples(estimate.delay_s?, ts_s);
    let nearest = found.round();
    ((found - nearest).abs() < 1e-6 && estimate.outcome == deadtime::delay::Outcome::Found)
        .then_some(nearest as usize)
}

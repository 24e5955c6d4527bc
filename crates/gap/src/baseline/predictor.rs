//! The meaning of "predicted": a free run, one-step predictions of a fixed-gain observer, or free runs over a horizon from the observer's estimated states.
//! The nominal model alone decides which, and all hypotheses share the decision.
//!
//! How a horizon can be wrong: an observer that trusts the model starts every run at the free run's state. An observer that trusts the samples starts every run in their noise.
//! The process noise of the states is therefore a scale chosen by the nominal model's one-step predictions.
//! Where the model is far off, the starts are off as well, alike for all hypotheses.

use std::num::NonZeroUsize;

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::format::diagnosis::{Mode, Prediction};
use crate::input::black_box::Probed;
use crate::input::criteria::Criteria;
use crate::input::poles::{Poles, sampled};
use crate::input::record::LogRecord;
use deadtime_model::dare;
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::{Correction, Measured, Plan, System};
use deadtime_signal::parallel;
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// The mode and, for a predictor, one gain per record.
#[derive(Debug, Clone)]
pub(crate) struct Predictor {
    pub(crate) mode: Mode,
    pub(crate) why: String,
    /// Filter gains, states × outputs; empty for a free run.
    pub(crate) gains: Vec<DMatrix<f64>>,
    /// Time in which the nominal model settles, seconds.
    pub(crate) settling_s: f64,
    /// Samples that are predicted from one state; `None`: one, or all.
    pub(crate) horizon: Option<NonZeroUsize>,
    /// The process noise of the states over the motion of the commands.
    unknown: f64,
}

/// The scale of the process noise over the motion of the commands, in steps from 10⁻⁴ to 10².
const UNKNOWN: [f64; 7] = [1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2];

impl Predictor {
    /// For any simulator: one that can only be called is simulated freely.
    pub(crate) fn of(
        system: &System,
        records: &[LogRecord],
        poles: &Poles,
        probed: Option<&Probed>,
        asked: Option<Mode>,
        criteria: &Criteria,
    ) -> Self {
        match probed {
            Some(probed) => Self {
                mode: Mode::Simulation,
                why: probed.why.clone(),
                gains: Vec::new(),
                settling_s: probed.settling_s,
                horizon: None,
                unknown: 0.0,
            },
            None => Self::choose(system, records, poles, asked, criteria),
        }
    }

    /// Chosen from the poles of the nominal model, or by the caller.
    fn choose(
        system: &System,
        records: &[LogRecord],
        poles: &Poles,
        asked: Option<Mode>,
        criteria: &Criteria,
    ) -> Self {
        let (mode, why) = match (asked, &poles.slow) {
            (Some(mode), _) => (mode, "asked for".to_owned()),
            (None, Some(why)) => (Mode::Predictor, why.clone()),
            (None, None) => {
                (Mode::Simulation, "every pole of the model decays within a log".to_owned())
            }
        };
        let gains = match mode {
            Mode::Simulation | Mode::Horizon => Vec::new(),
            Mode::Predictor => {
                records.iter().map(|r| gain(system, r, criteria, criteria.uncertain)).collect()
            }
        };
        let unknown = criteria.uncertain;
        Self { mode, why, gains, settling_s: poles.settling_s, horizon: None, unknown }
    }

    /// Free runs over a horizon, for a model that may already have effects. The observer maximises the likelihood of one-step predictions of the training spans
    /// under white normal noise of unknown variance in every output.
    ///
    /// # Errors
    /// Those of [`Applied::plan`].
    pub(crate) fn over(
        horizon: NonZeroUsize,
        system: &System,
        own: &[Applied],
        records: &[LogRecord],
        poles: &Poles,
        criteria: &Criteria,
    ) -> Result<Self> {
        let plan = Applied::plan(system, own, Chance::Mean)?;
        let of_scale = |scale: &f64| {
            let gains: Vec<DMatrix<f64>> =
                records.iter().map(|r| gain(system, r, criteria, *scale)).collect();
            let misfit = misfit(system, &plan, records, &gains).unwrap_or(f64::INFINITY);
            (misfit, gains, *scale)
        };
        let tried = parallel::map(UNKNOWN.iter(), of_scale).into_iter();
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
        let (gains, unknown) = best.map_or((Vec::new(), 0.0), |(_, gains, scale)| (gains, scale));
        let why = format!("asked for: from estimated states, over {horizon} samples each");
        Ok(Self {
            mode: Mode::Horizon,
            why,
            gains,
            settling_s: poles.settling_s,
            horizon: Some(horizon),
            unknown,
        })
    }

    /// The same observer on further records behind those that it was made of.
    pub(crate) fn on(&self, system: &System, records: &[LogRecord], criteria: &Criteria) -> Self {
        if self.gains.is_empty() {
            return self.clone();
        }
        let further = records.iter().skip(self.gains.len());
        let gains = further.map(|record| gain(system, record, criteria, self.unknown));
        Self { gains: self.gains.iter().cloned().chain(gains).collect(), ..self.clone() }
    }

    /// The prediction in the form of the answer.
    pub(crate) fn reported(&self) -> Prediction {
        Prediction {
            mode: self.mode,
            why: self.why.clone(),
            horizon: self.horizon.map(NonZeroUsize::get),
        }
    }

    /// The correction of the state in a record.
    pub(crate) fn correction<'c>(
        &'c self,
        record: usize,
        measured: &'c [Measured],
    ) -> Option<Correction<'c>> {
        self.gains.get(record).map(|gain| Correction { gain, measured, horizon: self.horizon })
    }
}

/// Minus twice the log-likelihood of one-step predictions of the training spans; `None` where the predictions fail.
fn misfit(
    system: &System,
    plan: &Plan,
    records: &[LogRecord],
    gains: &[DMatrix<f64>],
) -> Option<f64> {
    let mut squares = vec![(0.0, 0.0); system.outputs.len()];
    for (record, gain) in records.iter().zip(gains).filter(|(r, _)| r.train.is_some()) {
        let correction = Correction { gain, measured: &record.measured, horizon: None };
        let run = system.simulate(plan, record.commands(), &record.start, Some(correction)).ok()?;
        for (i, (square, count)) in squares.iter_mut().enumerate() {
            let errors = (0..record.time_s.len())
                .filter_map(|k| Some(record.measured_in(record.train, i, k)? - run.y[(k, i)]));
            errors.for_each(|e| (*square, *count) = (*square + e * e, *count + 1.0));
        }
    }
    let misfit: f64 = squares
        .iter()
        .filter(|(square, _)| *square > 0.0)
        .map(|(square, count)| count * (square / count).ln())
        .sum();
    misfit.is_finite().then_some(misfit)
}

/// The filter gain K of x ← x + K(y − ŷ) for process noise of a given size and a prescribed degree of stability. Poles outside the circle of radius 1/α are
/// mirrored about it, all others stay. Source: Anderson and Moore 1969, "Linear system optimization with prescribed degree of stability", Proc. IEE 116(12),
/// 2083-2087, doi:10.1049/piee.1969.0379.
///
/// Process noise moves the states like the inputs, with `unknown` times the motion of the commands.
fn gain(system: &System, record: &LogRecord, criteria: &Criteria, unknown: f64) -> DMatrix<f64> {
    let (n, p) = (system.states.len(), system.outputs.len());
    let none = DMatrix::zeros(n, p);
    let Some([phi, gamma, c]) =
        SampleTime::new(record.sample_time_s).ok().and_then(|ts| sampled(system, record, ts))
    else {
        return none;
    };
    let alpha = 1.0 / (1.0 - (criteria.forgets / record.time_s.len() as f64).min(0.5));
    let a = phi * alpha;
    let r = DMatrix::from_diagonal(&DVector::from_fn(p, |i, _| roughness(record, i)));
    let moved = DVector::from_fn(gamma.ncols(), |j, _| {
        (unknown * stats::deviation(&record.inputs[j]).unwrap_or(0.0)).powi(2)
    });
    let q = &gamma * DMatrix::from_diagonal(&moved) * gamma.transpose();
    let q = (&q + q.transpose()) * 0.5;
    let covariance = match dare(&a.transpose(), &c.transpose(), &q, &r, None) {
        Ok(x) => Some(x),
        Err(_) => iterate(&a, &c, &q, &r, record.time_s.len()),
    };
    let Some(x) = covariance else { return none };
    let innovation = &c * &x * c.transpose() + r;
    innovation.cholesky().map_or(none, |chol| chol.solve(&(&c * x.transpose())).transpose())
}

/// The Riccati recursion from a wide start, for models with modes that no output sees.
fn iterate(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    steps: usize,
) -> Option<DMatrix<f64>> {
    let mut x = DMatrix::identity(a.nrows(), a.nrows()) * r.trace();
    for _ in 0..steps.clamp(200, 5000) {
        let innovation = (c * &x * c.transpose() + r).cholesky()?;
        let k = innovation.solve(&(c * &x)).transpose();
        let filtered = &x - &k * c * &x;
        x = a * filtered * a.transpose() + q;
        x = (&x + x.transpose()) * 0.5;
        if x.iter().any(|v| !v.is_finite()) {
            return None;
        }
    }
    Some(x)
}

/// The variance of an output's white noise, from its second differences; not less than a millionth of its variance.
fn roughness(record: &LogRecord, output: usize) -> f64 {
    let values: Vec<f64> =
        (0..record.time_s.len()).filter_map(|k| record.measured[output].get(k)).collect();
    let variance = stats::variance(&values).unwrap_or(0.0);
    let second = stats::mean(values.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)))
        .unwrap_or(0.0)
        / 6.0;
    second.max(1e-6 * variance).max(f64::MIN_POSITIVE)
}

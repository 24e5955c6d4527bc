//! What "predicted" means: a free run, or one-step predictions of a fixed-gain observer. Decided once from the nominal model, the same for all rivals.

use nalgebra::{DMatrix, DVector};

use crate::diagnose::format::diagnosis::Mode;
use crate::diagnose::input::black_box::Probed;
use crate::diagnose::input::criteria::Criteria;
use crate::diagnose::input::poles::{Poles, sampled};
use crate::diagnose::input::record::LogRecord;
use crate::model::dare;
use crate::signal::stats;
use crate::simulate::System;
use crate::time::SampleTime;

/// The mode and, for a predictor, one gain per record.
#[derive(Debug, Clone)]
pub(in crate::diagnose) struct Predictor {
    pub(in crate::diagnose) mode: Mode,
    pub(in crate::diagnose) why: String,
    /// Filter gains, states × outputs; empty for a free run.
    pub(in crate::diagnose) gains: Vec<DMatrix<f64>>,
    /// Time in which the nominal model settles, seconds.
    pub(in crate::diagnose) settling_s: f64,
}

impl Predictor {
    /// Of whatever simulator: one that can only be called is simulated freely.
    pub(in crate::diagnose) fn of(
        system: &System,
        records: &[LogRecord],
        poles: &Poles,
        probed: Option<&Probed>,
        asked: Option<Mode>,
        criteria: &Criteria,
    ) -> Self {
        match probed {
            Some(probed) => Self { mode: Mode::Simulation, why: probed.why.clone(), gains: Vec::new(), settling_s: probed.settling_s },
            None => Self::choose(system, records, poles, asked, criteria),
        }
    }

    /// Chosen from the poles of the nominal model, or as asked for.
    fn choose(system: &System, records: &[LogRecord], poles: &Poles, asked: Option<Mode>, criteria: &Criteria) -> Self {
        let (mode, why) = match (asked, &poles.slow) {
            (Some(mode), _) => (mode, "asked for".to_owned()),
            (None, Some(why)) => (Mode::Predictor, why.clone()),
            (None, None) => (Mode::Simulation, "every pole of the model decays within a log".to_owned()),
        };
        let gains = match mode {
            Mode::Simulation => Vec::new(),
            Mode::Predictor => records.iter().map(|r| gain(system, r, criteria)).collect(),
        };
        Self { mode, why, gains, settling_s: poles.settling_s }
    }
}

/// The filter gain K of x ← x + K(y − ŷ) with hardly any process noise and a prescribed degree of stability (Anderson and Moore 1969, "Linear system optimization
/// with prescribed degree of stability", Proc. IEE 116(12), 2083-2087, doi:10.1049/piee.1969.0379): poles outside the circle of radius 1/α are mirrored
/// about it, all others stay.
fn gain(system: &System, record: &LogRecord, criteria: &Criteria) -> DMatrix<f64> {
    let (n, p) = (system.states.len(), system.outputs.len());
    let none = DMatrix::zeros(n, p);
    let Some([phi, gamma, c]) = SampleTime::new(record.sample_time_s).ok().and_then(|ts| sampled(system, record, ts)) else { return none };
    let alpha = 1.0 / (1.0 - (criteria.forgets / record.time_s.len() as f64).min(0.5));
    let a = phi * alpha;
    let r = DMatrix::from_diagonal(&DVector::from_fn(p, |i, _| roughness(record, i)));
    let moved = DVector::from_fn(gamma.ncols(), |j, _| (criteria.uncertain * stats::deviation(&record.inputs[j]).unwrap_or(0.0)).powi(2));
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
fn iterate(a: &DMatrix<f64>, c: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>, steps: usize) -> Option<DMatrix<f64>> {
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
    let values: Vec<f64> = (0..record.time_s.len()).filter_map(|k| record.measured[output].get(k)).collect();
    let variance = stats::variance(&values).unwrap_or(0.0);
    let second = stats::mean(values.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2))).unwrap_or(0.0) / 6.0;
    second.max(1e-6 * variance).max(f64::MIN_POSITIVE)
}

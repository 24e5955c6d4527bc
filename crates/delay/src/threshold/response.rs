//! Responses with their uncertainty, shared by all thresholds, and the possible beginning of a response.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::error::LengthRemedy;
use crate::estimator::{NoDelay, impulse_response, long_enough};
use deadtime_identify::{Fir, Record};
use deadtime_signal::stats;

/// The combination of several records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Records {
    /// One regression over the rows of all records.
    #[default]
    Joint,
    /// One response per record; responses and standard deviations averaged (algorithm 3.2 of the thesis).
    Averaged,
}

/// The assumption on the input before a record. A row needs as many past inputs as the response has coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prewindow {
    /// None: rows that reach back before the record are left out.
    None,
    /// The plant rested: at the input's first value where the first ten samples are constant, else at zero. The data must be relative to the rest, not to the
    /// mean.
    Rest,
    /// As `none`. The option acts as `rest` only if the remaining rows do not excite every coefficient and every record begins with ten constant input samples.
    /// An estimate by `none` has priority.
    #[default]
    Auto,
}

/// Constant input samples at the start of a record that count as rest.
const STILL: usize = 10;

/// A response, its standard deviations and the correlation of its errors.
pub(super) struct EstimatedResponse {
    pub(super) values: DVector<f64>,
    pub(super) std: DVector<f64>,
    /// The coefficients behind it and their standard deviations: the response to an impulse.
    pub(super) each: [DVector<f64>; 2],
    pub(super) correlation: DMatrix<f64>,
    pub(super) freedom: usize,
    /// A note on its computation.
    pub(super) note: Option<String>,
}

/// The response behind the estimate.
#[derive(Clone, Copy)]
pub(super) enum ResponseKind {
    /// The response to an impulse.
    Impulse,
    /// The response to a step: the running sum.
    Step,
}

/// The averaged response of the records.
pub(super) fn response(
    name: &'static str,
    kind: ResponseKind,
    records: &[Record],
    taps: usize,
    (together, prewindow): (Records, Prewindow),
) -> Result<EstimatedResponse, NoDelay> {
    // Two rows more than coefficients.
    let needed = taps + 2 + if prewindow == Prewindow::Rest { 0 } else { taps - 1 };
    let got = records.iter().map(Record::len).max().unwrap_or(0);
    long_enough(name, needed, got, LengthRemedy::WindowOr("set fewer taps"))?;
    let rested;
    let records = if prewindow == Prewindow::Rest {
        rested = records.iter().map(|r| from_rest(r, taps)).collect::<Vec<_>>();
        &rested
    } else {
        records
    };
    let groups: Vec<&[Record]> = match together {
        Records::Joint => vec![records],
        Records::Averaged => records.chunks(1).collect(),
    };
    let begins_still = || records.iter().all(|r| still(r) >= STILL);
    let each = groups.into_iter().map(|group| Ok(one(kind, &impulse_response(group, taps)?)));
    match each.collect() {
        Err(NoDelay::Answer(_)) if prewindow == Prewindow::Auto && begins_still() => {
            let at_rest = (together, Prewindow::Rest);
            let note = "the rows after the first do not excite every coefficient: the input, still at first, was taken to have stood there before";
            let response = response(name, kind, records, taps, at_rest)?;
            Ok(EstimatedResponse { note: Some(note.to_owned()), ..response })
        }
        responses => Ok(averaged(responses?)),
    }
}

fn one(kind: ResponseKind, fir: &Fir) -> EstimatedResponse {
    let taps = fir.coefficients.len();
    let (values, covariance) = match kind {
        ResponseKind::Impulse => (fir.coefficients.clone(), fir.covariance.clone()),
        ResponseKind::Step => {
            let sum = DMatrix::from_fn(taps, taps, |i, j| f64::from(u8::from(j <= i)));
            (&sum * &fir.coefficients, &sum * &fir.covariance * sum.transpose())
        }
    };
    let std = covariance.diagonal().map(|v| v.max(0.0).sqrt());
    let correlation = DMatrix::from_fn(taps, taps, |i, j| {
        covariance[(i, j)] / (std[i] * std[j]).max(f64::MIN_POSITIVE)
    });
    let each = [fir.coefficients.clone(), fir.covariance.diagonal().map(|v| v.max(0.0).sqrt())];
    EstimatedResponse { values, std, each, correlation, freedom: fir.rows - taps, note: None }
}

/// Mean response and mean standard deviation over records.
fn averaged(responses: Vec<EstimatedResponse>) -> EstimatedResponse {
    let share = 1.0 / responses.len().max(1) as f64;
    let mut all = responses.into_iter();
    let Some(mut sum) = all.next() else {
        let none = DVector::zeros(0);
        return EstimatedResponse {
            values: none.clone(),
            std: none.clone(),
            each: [none.clone(), none],
            correlation: DMatrix::zeros(0, 0),
            freedom: 0,
            note: None,
        };
    };
    for next in all {
        sum.values += next.values;
        sum.std += next.std;
        for (sum, next) in sum.each.iter_mut().zip(next.each) {
            *sum += next;
        }
        sum.correlation += next.correlation;
        sum.freedom = sum.freedom.min(next.freedom);
    }
    sum.values *= share;
    sum.std *= share;
    for each in &mut sum.each {
        *each *= share;
    }
    sum.correlation *= share;
    sum
}

/// The number of constant input samples at the start.
fn still(record: &Record) -> usize {
    record.u.iter().position(|v| *v != record.u[0]).unwrap_or(record.len())
}

/// The record relative to its rest, behind as many samples of rest as `taps` coefficients look back. A regression without past outputs does not use those
/// outputs as rows.
fn from_rest<'b>(record: &Record<'_>, taps: usize) -> Record<'b> {
    let before = taps - 1;
    let rest = still(record);
    let there = |t: usize| record.present.as_ref().is_none_or(|p| p[t]);
    let (mut level_u, mut level_y) = (0.0, 0.0);
    if rest >= STILL {
        let resting = (0..rest).filter(|&t| there(t)).map(|t| record.y[t]);
        (level_u, level_y) = (record.u[0], stats::mean(resting).unwrap_or(0.0));
    }
    let behind = |x: &[f64], level: f64| -> Cow<'b, [f64]> {
        vec![0.0; before].into_iter().chain(x.iter().map(|v| v - level)).collect()
    };
    let n = record.len();
    Record {
        u: behind(&record.u[..n], level_u),
        y: behind(&record.y[..n], level_y),
        present: record
            .present
            .as_ref()
            .map(|p| vec![true; before].into_iter().chain(p[..n].iter().copied()).collect()),
    }
}

/// Share of the largest value below which a standard deviation is rounding.
const ROUNDING: f64 = 1e-9;

/// For every start up to the crossing: the misfit of a ramp from there to the crossing on the samples up to it, in variances.
pub(super) fn misfits(values: &DVector<f64>, std: &DVector<f64>, crossing: usize) -> Vec<f64> {
    let misfit = |start: usize| {
        let (mut up, mut down, mut total) = (0.0, 0.0, 0.0);
        for k in 0..=crossing {
            let weight = 1.0
                / std[k]
                    .max(ROUNDING * values[crossing].abs())
                    .max(f64::MIN_POSITIVE)
                    .powi(2)
                    .max(f64::MIN_POSITIVE);
            let ramp = if k < start { 0.0 } else { (k - start + 1) as f64 };
            up += weight * ramp * values[k];
            down += weight * ramp * ramp;
            total += weight * values[k].powi(2);
        }
        total - up * up / down
    };
    (0..=crossing).map(misfit).collect()
}

/// The earliest possible beginning of the response. A ramp from there to the crossing fits the earlier samples as well as the best ramp, within a likelihood
/// ratio of 3.84 (95 %). A crossing by noise alone is so rare at the limits used that no later beginning is considered.
pub(super) fn onset(misfits: &[f64]) -> usize {
    let best = misfits.iter().copied().fold(f64::INFINITY, f64::min);
    misfits.iter().position(|&m| m - best <= 3.84).unwrap_or(misfits.len().saturating_sub(1))
}

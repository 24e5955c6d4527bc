//! Feedback without a delay: a command that reacts to the noise of its own sample.
//!
//! Under such feedback u(k) contains a part of the noise in y(k). Every hypothesis with a direct path from u(k) into an output then gains falsely. Past
//! commands and outputs do not predict a part of u(k). This part is a nuisance regressor of the residual of the same sample, alike for all hypotheses. This is
//! equivalent to direct paths from the predicted command only (Frisch and Waugh 1933, doi:10.2307/1907330).
//!
//! How it can be wrong: in open loop an unpredicted command correlates with the residual of a wrong direct path. This path is a cause and no feedback. The
//! commands must therefore also depend on past outputs (Granger 1969, doi:10.2307/1912791), by the margin `fed_back`.

use nalgebra::{DMatrix, DVector};

use super::noise::autoregression_of;
use crate::input::criteria::Criteria;
use crate::input::record::LogRecord;

/// The nuisance regressors of one record, samples × outputs each. A regressor is the unpredicted part of a command, in the output whose noise it contains.
/// `residual` is that of the nominal model.
pub(crate) fn regressors(
    record: &LogRecord,
    residual: &DMatrix<f64>,
    criteria: &Criteria,
) -> Vec<DMatrix<f64>> {
    let outputs = record.measured.len();
    let (samples, past) = (record.time_s.len(), criteria.feedback_past);
    let rows: Vec<usize> = (past..samples)
        .filter(|&k| {
            (0..outputs).all(|i| (0..=past).all(|lag| record.measured[i].get(k - lag).is_some()))
        })
        .collect();
    let mut found = Vec::new();
    for input in 0..record.inputs.len() {
        let Some(alone) = unpredicted(record, input, &rows, past, false) else { continue };
        let Some(with_outputs) = unpredicted(record, input, &rows, past, true) else { continue };
        if with_outputs.norm_squared() > (1.0 - criteria.fed_back) * alone.norm_squared() {
            continue;
        }
        for output in 0..outputs {
            let innovations = innovations(record, residual, output, criteria);
            let here = DVector::from_iterator(rows.len(), rows.iter().map(|&k| innovations[k]));
            let scale = (rows.len() as f64).sqrt();
            let correlation = with_outputs.dot(&here)
                / (with_outputs.norm() * here.norm()).max(f64::MIN_POSITIVE);
            if correlation.abs() * scale > criteria.correlated {
                let mut column = DMatrix::zeros(samples, outputs);
                for (&k, value) in rows.iter().zip(with_outputs.iter()) {
                    column[(k, output)] = *value;
                }
                found.push(column);
            }
        }
    }
    found
}

/// The unpredicted part of a command at some rows. The regressors are its own past, the past of all other commands and, if given, the past of the outputs. `None` where
/// the prediction is exact or the rows are too few.
fn unpredicted(
    record: &LogRecord,
    input: usize,
    rows: &[usize],
    past: usize,
    outputs: bool,
) -> Option<DVector<f64>> {
    let regressors = |k: usize| {
        let mut row = vec![1.0];
        for lag in 1..=past {
            row.extend(record.inputs.iter().map(|u| u[k - lag]));
            if outputs {
                row.extend(record.measured.iter().map(|y| y.get(k - lag).unwrap_or(0.0)));
            }
        }
        row
    };
    let width = regressors(*rows.first()?).len();
    if rows.len() < 10 * width {
        return None;
    }
    let x = DMatrix::from_row_iterator(rows.len(), width, rows.iter().flat_map(|&k| regressors(k)));
    let u = DVector::from_iterator(rows.len(), rows.iter().map(|&k| record.inputs[input][k]));
    let scale: Vec<f64> = x.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let scaled = DMatrix::from_fn(rows.len(), width, |r, c| x[(r, c)] / scale[c]);
    let gram = scaled.tr_mul(&scaled) + DMatrix::identity(width, width) * 1e-10;
    let beta = gram.cholesky()?.solve(&scaled.tr_mul(&u));
    let left = &u - scaled * beta;
    let mean = u.mean();
    let spread = u.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (left.norm_squared() > 1e-9 * spread).then_some(left)
}

/// The part of an output's residual that its own past does not predict.
fn innovations(
    record: &LogRecord,
    residual: &DMatrix<f64>,
    output: usize,
    criteria: &Criteria,
) -> Vec<f64> {
    let series: Vec<Option<f64>> = (0..record.time_s.len())
        .map(|k| record.measured[output].get(k).map(|_| residual[(k, output)]))
        .collect();
    let ar = autoregression_of(std::slice::from_ref(&series), criteria);
    let filled: Vec<f64> = series.iter().map(|v| v.unwrap_or(0.0)).collect();
    (0..filled.len())
        .map(|k| {
            filled[k] - ar.iter().zip(filled[..k].iter().rev()).map(|(a, r)| a * r).sum::<f64>()
        })
        .collect()
}

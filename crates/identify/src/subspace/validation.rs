//! Validation of a model on held-out data: fits, and tests of its one-step errors.

use deadtime_signal::decompositions::symmetric_eigen;
use nalgebra::DMatrix;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::innovations::InnovationsModel;
use super::recordings::{Named, Stretch};
use crate::iv::whitened;
use deadtime_signal::stats;

/// The fit of one output.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fit {
    /// 100·(1 − rms error/standard deviation of the measurement).
    pub fit_percent: f64,
    /// 100·(1 − variance of the error/variance of the measurement).
    pub vaf_percent: f64,
    /// rms error/standard deviation of the measurement.
    pub nrmse: f64,
}

/// A test of the one-step errors; a small p rejects the model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Test {
    /// Number of tested lags.
    pub lags: usize,
    /// Its statistic, chi-squared for a correct model.
    pub statistic: f64,
    /// The probability of a larger statistic for a correct model.
    pub p: f64,
}

/// The fit of one output, and tests of its one-step errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutputCheck {
    /// The output.
    pub output: String,
    /// All its samples are equal up to rounding: no fit is relative to its spread.
    #[serde(skip)]
    pub stands_still: bool,
    /// One-step predictions; absent for a constant output.
    pub one_step: Option<Fit>,
    /// Free run from the best initial state; absent for an unstable model or a constant output.
    pub simulation: Option<Fit>,
    /// The errors are white (Ljung and Box 1978, doi:10.1093/biomet/65.2.297).
    pub white: Option<Test>,
    /// The errors are independent of earlier inputs; one test per input.
    pub inputs: Vec<InputTest>,
}

/// A test whether an output's errors depend on earlier samples of an input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputTest {
    /// The input.
    pub input: String,
    /// The test.
    #[serde(flatten)]
    pub test: Test,
    /// The largest correlation by magnitude.
    pub largest: f64,
    /// Its lag.
    pub at_lag: usize,
}

/// Number of lags in the tests.
const LAGS: usize = 25;

/// Every output of deviations `s` (centred, the channels' units); one-step errors omit the first `skip` samples of each stretch. With a noise polynomial D the
/// one-step errors are D times those of a free run, otherwise those of the model's own predictor.
pub(super) fn check(
    (model, noise): (&InnovationsModel, Option<&[f64]>),
    stretches: &[Stretch],
    skip: usize,
    (inputs, outputs): (&[Named], &[Named]),
    stable: bool,
) -> Vec<OutputCheck> {
    let used: Vec<&Stretch> = stretches.iter().filter(|s| s.len() > skip + LAGS + 2).collect();
    let free: Vec<DMatrix<f64>> =
        if stable { used.iter().map(|s| model.free_run(s)).collect() } else { Vec::new() };
    let error = |(i, s): (usize, &&Stretch)| match (noise, free.get(i)) {
        (Some(d), Some(y)) => {
            let left = &s.y - y;
            let rows: Vec<_> = left
                .row_iter()
                .map(|r| whitened(&r.iter().copied().collect::<Vec<f64>>(), d))
                .collect();
            DMatrix::from_fn(left.nrows(), left.ncols(), |i, t| rows[i][t])
        }
        _ => model.innovations(s),
    };
    let errors: Vec<DMatrix<f64>> = used.iter().enumerate().map(error).collect();
    outputs
        .iter()
        .enumerate()
        .map(|(i, named)| {
            let measured: Vec<Vec<f64>> =
                used.iter().map(|s| s.y.row(i).iter().skip(skip).copied().collect()).collect();
            let late: Vec<Vec<f64>> =
                errors.iter().map(|e| e.row(i).iter().skip(skip).copied().collect()).collect();
            let all: Vec<Vec<f64>> =
                used.iter().map(|s| s.y.row(i).iter().copied().collect()).collect();
            let missed: Vec<Vec<f64>> = free
                .iter()
                .zip(&used)
                .map(|(y, s)| s.y.row(i).iter().zip(y.row(i).iter()).map(|(a, b)| a - b).collect())
                .collect();
            let test = |(j, input): (usize, &Named)| {
                let u: Vec<Vec<f64>> =
                    used.iter().map(|s| s.u.row(j).iter().skip(skip).copied().collect()).collect();
                cross(&late, &u).map(|(test, largest, at_lag)| InputTest {
                    input: input.name.clone(),
                    test,
                    largest,
                    at_lag,
                })
            };
            OutputCheck {
                output: named.name.clone(),
                stands_still: !all.iter().all(Vec::is_empty) && spread(&all) == 0.0,
                one_step: fit(&measured, &late),
                simulation: if stable { fit(&all, &missed) } else { None },
                white: white(&late),
                inputs: inputs.iter().enumerate().filter_map(test).collect(),
            }
        })
        .collect()
}

/// Largest minus smallest value; 0 where that is rounding.
fn spread(values: &[Vec<f64>]) -> f64 {
    let of = |v: &f64| (*v, *v);
    let wider = |(a, b): (f64, f64), (c, d): (f64, f64)| (a.min(c), b.max(d));
    let Some((low, high)) = values.iter().flatten().map(of).reduce(wider) else { return 0.0 };
    if high - low > 1e-12 * low.abs().max(high.abs()) { high - low } else { 0.0 }
}

fn fit(measured: &[Vec<f64>], error: &[Vec<f64>]) -> Option<Fit> {
    let n = measured.iter().map(Vec::len).sum::<usize>() as f64;
    let mean = |x: &[Vec<f64>]| x.iter().flatten().sum::<f64>() / n;
    let variance = |x: &[Vec<f64>], about: f64| {
        x.iter().flatten().map(|v| (v - about).powi(2)).sum::<f64>() / n
    };
    let moves = spread(measured) > 0.0;
    let spread = variance(measured, mean(measured));
    let (square, own) = (variance(error, 0.0), variance(error, mean(error)));
    let nrmse = (square / spread).sqrt();
    (moves && nrmse.is_finite()).then(|| Fit {
        fit_percent: 100.0 * (1.0 - nrmse),
        vaf_percent: 100.0 * (1.0 - own / spread),
        nrmse,
    })
}

/// Σ over stretches and samples of a(t)·b(t−lag).
fn product(a: &[Vec<f64>], b: &[Vec<f64>], lag: usize) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.iter().skip(lag).zip(b).map(|(x, y)| x * y).sum::<f64>()).sum()
}

fn centred(x: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mean = stats::mean(x.iter().flatten().copied()).unwrap_or(0.0);
    x.iter().map(|x| x.iter().map(|v| v - mean).collect()).collect()
}

fn chance(statistic: f64, freedom: f64) -> Option<f64> {
    ChiSquared::new(freedom).ok().map(|d| d.sf(statistic))
}

fn white(errors: &[Vec<f64>]) -> Option<Test> {
    let e = centred(errors);
    let n = e.iter().map(Vec::len).sum::<usize>() as f64;
    let power = product(&e, &e, 0);
    if power <= 0.0 || n <= 2.0 * LAGS as f64 {
        return None;
    }
    let statistic = n
        * (n + 2.0)
        * (1..=LAGS)
            .map(|lag| (product(&e, &e, lag) / power).powi(2) / (n - lag as f64))
            .sum::<f64>();
    Some(Test { lags: LAGS, statistic, p: chance(statistic, LAGS as f64)? })
}

/// n·rᵀ·Ru⁻¹·r of the correlations r of the errors with the input 1 to `LAGS` samples earlier, Ru the input's own correlations. The statistic is chi-squared
/// for white errors that are independent of earlier inputs.
fn cross(errors: &[Vec<f64>], u: &[Vec<f64>]) -> Option<(Test, f64, usize)> {
    let (e, u) = (centred(errors), centred(u));
    let n = e.iter().map(Vec::len).sum::<usize>() as f64;
    let (pe, pu) = (product(&e, &e, 0), product(&u, &u, 0));
    if pe <= 0.0 || pu <= 0.0 || n <= 2.0 * LAGS as f64 {
        return None;
    }
    let own: Vec<f64> = (0..LAGS).map(|lag| product(&u, &u, lag) / pu).collect();
    let r: Vec<f64> = (1..=LAGS).map(|lag| product(&e, &u, lag) / (pe * pu).sqrt()).collect();
    let matrix = DMatrix::from_fn(LAGS, LAGS, |i, j| own[i.abs_diff(j)]);
    // Directions with less than 0.1 % of the input's power are left out.
    let eigen = symmetric_eigen(&matrix)?;
    let (mut statistic, mut freedom) = (0.0, 0);
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > 1e-3 {
            let share: f64 = vector.iter().zip(&r).map(|(v, r)| v * r).sum();
            statistic += n * share * share / value;
            freedom += 1;
        }
    }
    let (at, largest) = r.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    Some((
        Test { lags: LAGS, statistic, p: chance(statistic, f64::from(freedom))? },
        *largest,
        at + 1,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_that_stands_still_has_no_fit_whatever_its_level() {
        let errors = vec![vec![0.3, -0.2, 0.1], vec![0.5]];
        for level in [0.0, 1e-9, -3.7, 1e12] {
            // Subtracting a mean leaves rounding.
            let rounded = level * (1.0 + 1e-16);
            let still = vec![vec![level, rounded, level], vec![level]];
            assert!(fit(&still, &errors).is_none(), "{level}");
            let moved = vec![vec![level, level + 1e-3 * (1.0 + level.abs()), level], vec![level]];
            assert!(fit(&moved, &errors).is_some(), "{level}");
        }
        assert!(fit(&[vec![0.0, 1.0]], &[vec![0.0, 0.0]]).is_some_and(|f| f.fit_percent == 100.0));
    }
}

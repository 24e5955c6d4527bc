//! Learning: the best delay and its shape from one Gram matrix of all lags.

use nalgebra::DMatrix;

use super::following::{Following, FollowingStart};
use super::options::TrackerOptions;
use super::past::Past;
use super::rows::{accumulate, fill, inverse};
use crate::track::rows::{ResponseShape, solve};

/// Standard deviations from which a coefficient is significant.
const ACTS: f64 = 4.0;

/// The running Gram matrix of [past outputs, inputs at every lag, 1, output].
#[derive(Debug, Clone)]
pub(super) struct Learning {
    gram: DMatrix<f64>,
    row: Vec<f64>,
    pub(super) rows: usize,
}

impl Learning {
    /// A learner without data.
    pub(super) fn new(options: &TrackerOptions) -> Self {
        let size = options.na + options.max_delay + options.nb + 2;
        Self { gram: DMatrix::zeros(size, size), row: vec![0.0; size], rows: 0 }
    }

    /// Adds one row, unless a sample in it is missing.
    pub(super) fn add(
        &mut self,
        options: &TrackerOptions,
        u: &Past<f64>,
        y: &Past<Option<f64>>,
        now: f64,
    ) {
        if fill(&mut self.row, u, y, now, options.na, 0..options.max_delay + options.nb) {
            accumulate(&mut self.gram, &self.row, 1.0);
            self.rows += 1;
        }
    }

    /// The best delay and its shape, where the input explains a sufficient share of the output.
    pub(super) fn fitted(&self, options: &TrackerOptions, u: &Past<f64>) -> Option<Following> {
        let TrackerOptions { na, nb, max_delay, .. } = *options;
        let last = self.gram.nrows() - 1;
        let mut full = self.gram.clone();
        full.fill_lower_triangle_with_upper_triangle();
        let part = |columns: &[usize]| full.select_columns(columns).select_rows(columns);
        let columns = |d: usize| -> Vec<usize> {
            (0..na).chain(na + d..na + d + nb).chain([last - 1, last]).collect()
        };
        let without: Vec<usize> = (0..na).chain([last - 1, last]).collect();
        let (_, alone) = solve(&part(&without))?;
        let fits = (0..=max_delay).filter_map(|d| Some((d, solve(&part(&columns(d)))?)));
        let (delay, (theta, left)) = fits.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let power = full[(last, last)]
            - full[(last - 1, last)].powi(2) / full[(last - 1, last - 1)].max(1.0);
        let left = left.max(1e-12 * power);
        if left <= 0.0 || 0.5 * self.rows as f64 * (alone / left).ln() < options.alarm {
            return None;
        }
        let gram = part(&columns(delay));
        let variance = left / self.rows as f64;
        let inverse = inverse(&gram)?;
        let ahead = first_acting(&inverse, &theta, na, nb, variance)?;
        let shape = ResponseShape {
            a: theta[..na].to_vec(),
            b: theta[na..na + nb].to_vec(),
            level: theta[na + nb],
        };
        Some(Following::new(
            options,
            shape,
            FollowingStart { variance, delay, ahead, gram, inverse },
            u,
        ))
    }
}

/// The number of coefficients before the first significant one.
fn first_acting(
    inverse: &DMatrix<f64>,
    theta: &[f64],
    na: usize,
    nb: usize,
    variance: f64,
) -> Option<f64> {
    let most = theta[na..na + nb].iter().fold(0.0, |m: f64, b| m.max(b.abs()));
    let acts = |j: &usize| {
        let b = theta[na + j].abs();
        b > 0.1 * most && b > ACTS * (variance * inverse[(na + j, na + j)]).max(0.0).sqrt()
    };
    (0..nb).find(acts).map(|j| j as f64)
}

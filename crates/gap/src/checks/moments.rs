//! Means and standard deviations, 0 of nothing, and correlations.

use deadtime_signal::stats;

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    stats::mean(values).unwrap_or(0.0)
}

/// Correlation and ratio of standard deviations of y(k) and x(k − lag) at the samples given, each part about its own means.
pub(super) fn correlation(parts: &[(&[usize], &[f64], &[f64])], lag: isize) -> Option<(f64, f64)> {
    let (mut yy, mut xx, mut xy) = (0.0, 0.0, 0.0);
    for (samples, y, x) in parts {
        let pairs = || {
            samples.iter().filter_map(|&k| Some((*y.get(k)?, *x.get(k.checked_add_signed(-lag)?)?)))
        };
        let (y_mean, x_mean) = (mean(pairs().map(|p| p.0)), mean(pairs().map(|p| p.1)));
        for (y, x) in pairs() {
            let (y, x) = (y - y_mean, x - x_mean);
            (yy, xx, xy) = (yy + y * y, xx + x * x, xy + x * y);
        }
    }
    (yy > 0.0 && xx > 0.0)
        .then(|| (xy / (yy * xx).sqrt(), (yy / xx).sqrt()))
        .filter(|(c, r)| c.is_finite() && r.is_finite() && *r > 0.0)
}

pub(super) fn deviation(values: &[f64]) -> f64 {
    stats::deviation(values).unwrap_or(0.0)
}

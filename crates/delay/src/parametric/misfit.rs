//! Tests whether the residuals of a parametric model contradict it.

/// Lags of the residual tests.
pub(super) const LAGS: usize = 20;

/// Residuals of a stretch, and its input.
pub(super) type ResidualStretch = (Vec<f64>, Vec<f64>);

/// Residual tests of a model, each at the 1 % level. Residuals may be coloured (Ljung-Box), or correlated with inputs from lag `after` on that the model has
/// not used. Residuals and inputs are given by stretch.
///
/// Source: Ljung and Box (1978), Biometrika 65(2), 297-303, doi:10.1093/biomet/65.2.297; Ljung (1999), "System Identification", 2nd ed., section 16.6.
pub(super) fn misfit(
    residuals: &[ResidualStretch],
    parameters: usize,
    after: usize,
) -> Option<String> {
    use statrs::distribution::{ChiSquared, ContinuousCDF};
    let real = |i: usize| i as f64;
    let sum = |a: fn(&ResidualStretch) -> &Vec<f64>, lag: usize| -> f64 {
        let each = |s: &ResidualStretch| {
            s.0.get(lag..).unwrap_or_default().iter().zip(a(s)).map(|(e, x)| e * x).sum::<f64>()
        };
        residuals.iter().map(each).sum()
    };
    let rows: usize = residuals.iter().map(|s| s.0.len()).sum();
    let power = sum(|s| &s.0, 0);
    let input: f64 = residuals.iter().flat_map(|s| &s.1).map(|u| u * u).sum();
    if rows <= 4 * LAGS || power <= 0.0 || input <= 0.0 {
        return None;
    }
    let beyond = |q: f64, freedom: usize| {
        ChiSquared::new(real(freedom.max(1))).is_ok_and(|d| q > d.inverse_cdf(0.99))
    };
    let mut notes = Vec::new();
    let coloured: f64 = (1..=LAGS)
        .map(|k| real(rows) * real(rows + 2) / real(rows - k) * (sum(|s| &s.0, k) / power).powi(2))
        .sum();
    if beyond(coloured, LAGS.saturating_sub(parameters)) {
        notes.push("the residuals are coloured");
    }
    // For white residuals each correlation has the variance 1/rows, for any colour of the input; the largest of the lags is tested.
    let largest = (after..after + LAGS)
        .map(|k| real(rows) * (sum(|s| &s.1, k)).powi(2) / (power * input))
        .fold(0.0, f64::max);
    if ChiSquared::new(1.0).is_ok_and(|d| largest > d.inverse_cdf(1.0 - 0.01 / real(LAGS))) {
        notes.push("the residuals follow past inputs");
    }
    (!notes.is_empty()).then(|| {
        format!(
            "{}: the orders are too low for plant and noise, or they change",
            notes.join(" and ")
        )
    })
}

//! How many states: three criteria, and how far they agree.

use nalgebra::DMatrix;
use serde::Serialize;

use super::innovations::InnovationsModel;
use super::recordings::Stretch;

/// How sure a chosen order is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sure {
    /// It was given.
    Given,
    /// All three criteria say so.
    Clear,
    /// Schwarz's criterion and one other say so.
    Likely,
    /// The criteria differ.
    Unclear,
}

impl std::fmt::Display for Sure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Given => "given",
            Self::Clear => "clear: all three criteria agree",
            Self::Likely => "likely: two of three criteria agree",
            Self::Unclear => "unclear: the criteria differ",
        })
    }
}

/// One order that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// States.
    pub order: usize,
    /// Its singular value.
    pub singular_value: f64,
    /// Logarithm of the determinant of the one-step prediction errors' covariance (scaled channels); absent where its predictor is unstable.
    pub log_loss: Option<f64>,
    /// Schwarz's criterion over twice the rows' logarithm, against the best: 0 for the best one.
    pub schwarz: Option<f64>,
    /// Its weight among all that were tried.
    pub weight: f64,
}

/// The order and what speaks for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrderChoice {
    /// The order of the model.
    pub order: usize,
    /// How sure.
    pub sure: Sure,
    /// By Schwarz's criterion of the models' own one-step errors.
    pub by_schwarz: usize,
    /// By the largest ratio of a singular value to the next.
    pub by_gap: usize,
    /// By Akaike's criterion of the same errors.
    pub by_akaike: usize,
    /// The orders that were tried.
    pub candidates: Vec<Candidate>,
}

/// Logarithm of the determinant of the one-step errors' covariance, the first `skip` samples of every stretch left out; `None` where they grow.
pub(super) fn log_loss(model: &InnovationsModel, scaled: &[Stretch], skip: usize) -> Option<f64> {
    if !model.is_finite() {
        return None;
    }
    let l = model.c.nrows();
    let (mut sum, mut rows) = (DMatrix::<f64>::zeros(l, l), 0_usize);
    for s in scaled.iter().filter(|s| s.len() > skip) {
        let e = model.innovations(s);
        let late = e.columns(skip, s.len() - skip);
        sum += late * late.transpose();
        rows += s.len() - skip;
    }
    let loss = (sum / rows.max(1) as f64 + DMatrix::identity(l, l) * FLOOR).determinant().ln();
    loss.is_finite().then_some(loss)
}

/// Errors of this variance, channels of variance 1, are rounding.
const FLOOR: f64 = 1e-22;

/// The choice among models of order 1, 2, … with these log losses.
pub(super) fn choose(
    given: Option<usize>,
    losses: &[Option<f64>],
    singular: &[f64],
    rows: usize,
    (m, l): (usize, usize),
) -> OrderChoice {
    let n = rows.max(2) as f64;
    // Twice the logarithm of the likelihood, and a price of every free parameter.
    let criterion = |price: f64| -> Vec<Option<f64>> {
        let value = |(i, loss): (usize, &Option<f64>)| {
            loss.map(|loss| n * loss + price * ((i + 1) * (m + 2 * l)) as f64)
        };
        losses.iter().enumerate().map(value).collect()
    };
    let least = |values: &[Option<f64>]| {
        let found = values
            .iter()
            .enumerate()
            .filter_map(|(i, v)| v.map(|v| (i, v)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        found.map_or(1, |(i, _)| i + 1)
    };
    let values = criterion(n.ln());
    let best = values.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> =
        values.iter().map(|v| v.map_or(0.0, |v| (-(v - best) / 2.0).exp())).collect();
    let total: f64 = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let (by_schwarz, by_akaike) = (least(&values), least(&criterion(2.0)));
    // The last singular value of all has none to be compared with.
    let ratio = |i: usize| singular[i] / singular[i + 1].max(1e-12 * singular[0]);
    let compared = losses.len().min(singular.len().saturating_sub(1));
    let by_gap = (0..compared).max_by(|a, b| ratio(*a).total_cmp(&ratio(*b))).map_or(1, |i| i + 1);
    let agree = usize::from(by_gap == by_schwarz) + usize::from(by_akaike == by_schwarz);
    let sure = match (given, agree) {
        (Some(_), _) => Sure::Given,
        (None, 2) => Sure::Clear,
        (None, 1) => Sure::Likely,
        (None, _) => Sure::Unclear,
    };
    let candidate = |i: usize| Candidate {
        order: i + 1,
        singular_value: singular[i],
        log_loss: losses[i],
        schwarz: values[i].map(|v| (v - best) / (2.0 * n.ln())),
        weight: weights[i] / total,
    };
    OrderChoice {
        order: given.unwrap_or(by_schwarz),
        sure,
        by_schwarz,
        by_gap,
        by_akaike,
        candidates: (0..losses.len()).map(candidate).collect(),
    }
}

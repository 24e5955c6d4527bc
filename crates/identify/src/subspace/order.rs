//! The number of states: three criteria of one-step errors, their agreement, and free runs of held-out data, which may reject their choice.

use deadtime_signal::stats::students_t;
use nalgebra::DMatrix;
use serde::Serialize;

use super::innovations::InnovationsModel;
use super::recordings::Stretch;

/// The confidence in a chosen order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sure {
    /// It was given.
    Given,
    /// All three criteria agree.
    Clear,
    /// Schwarz's criterion and one other agree.
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

/// One tested order.
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
    /// Its weight among all tested orders.
    pub weight: f64,
    /// Free-run errors on the last 30 % of each record by the model of the first 70 %. Mean square, summed over outputs of variance 1. Absent for an unstable
    /// model and for a given order.
    pub free_run: Option<f64>,
}

/// The order and its evidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrderChoice {
    /// The order of the model.
    pub order: usize,
    /// The confidence.
    pub sure: Sure,
    /// By Schwarz's criterion of the models' own one-step errors.
    pub by_schwarz: usize,
    /// By the largest ratio of a singular value to the next.
    pub by_gap: usize,
    /// By Akaike's criterion of the same errors.
    pub by_akaike: usize,
    /// The smallest order whose free runs of held-out data are within the noise of the best. Absent without a stable model, and for a given order.
    pub by_free_run: Option<usize>,
    /// The tested orders.
    pub candidates: Vec<Candidate>,
}

/// Logarithm of the determinant of the one-step errors' covariance, without the first `skip` samples of every stretch. `None` where they diverge.
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

/// Errors below this variance (channels of variance 1) are rounding.
const FLOOR: f64 = 1e-22;

/// Squared errors of a model on held-out data, summed over outputs of variance 1, as means of blocks.
#[derive(Debug, Clone, Default)]
pub(super) struct FreeRuns {
    pub(super) one_step: Vec<f64>,
    /// Absent where this model, or that of the whole record, is unstable.
    pub(super) free: Option<Vec<f64>>,
}

/// Probability that noise rejects the order of Schwarz's criterion, over all compared orders.
const BY_CHANCE: f64 = 0.01;
/// The same for one order against the best.
const BY_ITSELF: f64 = 0.05;
/// Stable models reject an unstable one if their free-run errors are below this multiple of its one-step power.
const FAR: f64 = 2.0;

fn mean(of: &[f64]) -> f64 {
    of.iter().sum::<f64>() / of.len().max(1) as f64
}

/// The excess of `one` over `other` is significant over blocks: Student's t, one-sided.
fn worse(one: &[f64], other: &[f64], chance: f64) -> bool {
    let excess: Vec<f64> = one.iter().zip(other).map(|(a, b)| a - b).collect();
    let n = excess.len() as f64;
    let centre = mean(&excess);
    let variance = excess.iter().map(|e| (e - centre).powi(2)).sum::<f64>() / (n - 1.0);
    let limit = students_t(1.0 - chance, n - 1.0);
    centre > limit.unwrap_or(f64::INFINITY) * (variance / n).sqrt()
}

/// The smallest order whose free runs are within the noise of the best, and whether they reject `order`.
///
/// Source of the rule: Breiman et al. (1984), "Classification and Regression Trees", section 3.4.3, on paired differences over blocks.
fn of_free_runs(free: &[FreeRuns], order: usize) -> (Option<usize>, bool) {
    let runs = || free.iter().enumerate().filter_map(|(i, f)| Some((i, f.free.as_ref()?)));
    let best = runs().min_by(|a, b| mean(a.1).total_cmp(&mean(b.1)));
    let Some((_, best)) = best.filter(|b| mean(b.1).is_finite()) else { return (None, false) };
    let chance = BY_CHANCE / runs().count() as f64;
    let smallest = runs().find(|(_, errors)| !worse(errors, best, BY_ITSELF)).map(|(i, _)| i + 1);
    let rejected = free.get(order - 1).is_some_and(|own| match &own.free {
        Some(errors) => worse(errors, best, chance),
        None => mean(best) < FAR * mean(&own.one_step),
    });
    (smallest, rejected)
}

/// The confidence in an order, from the number of other rules that agree with Schwarz's.
fn certainty(given: bool, rejected: bool, agree: usize) -> Sure {
    match (given, rejected, agree) {
        (true, ..) => Sure::Given,
        (_, true, _) => Sure::Unclear,
        (_, _, 2) => Sure::Clear,
        (_, _, 1) => Sure::Likely,
        _ => Sure::Unclear,
    }
}

/// The index of the smallest existing value, counted from 1.
fn least(values: &[Option<f64>]) -> usize {
    let there = values.iter().enumerate().filter_map(|(i, v)| Some((i, (*v)?)));
    there.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(1, |(i, _)| i + 1)
}

/// The choice among models of order 1, 2, … with these log losses.
pub(super) fn choose(
    given: Option<usize>,
    (losses, free): (&[Option<f64>], &[FreeRuns]),
    singular: &[f64],
    rows: usize,
    (m, l): (usize, usize),
) -> OrderChoice {
    let n = rows.max(2) as f64;
    // Twice the logarithm of the likelihood, minus a penalty per free parameter.
    let criterion = |price: f64| -> Vec<Option<f64>> {
        let value = |(i, loss): (usize, &Option<f64>)| {
            loss.map(|loss| n * loss + price * ((i + 1) * (m + 2 * l)) as f64)
        };
        losses.iter().enumerate().map(value).collect()
    };
    let values = criterion(n.ln());
    let best = values.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> =
        values.iter().map(|v| v.map_or(0.0, |v| (-(v - best) / 2.0).exp())).collect();
    let total: f64 = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let (by_schwarz, by_akaike) = (least(&values), least(&criterion(2.0)));
    // The last singular value has no successor.
    let ratio = |i: usize| singular[i] / singular[i + 1].max(1e-12 * singular[0]);
    let compared = losses.len().min(singular.len().saturating_sub(1));
    let by_gap = (0..compared).max_by(|a, b| ratio(*a).total_cmp(&ratio(*b))).map_or(1, |i| i + 1);
    let (by_free_run, rejected) = of_free_runs(free, by_schwarz);
    let order =
        given.unwrap_or(if rejected { by_free_run.unwrap_or(by_schwarz) } else { by_schwarz });
    let agree = usize::from(by_gap == by_schwarz) + usize::from(by_akaike == by_schwarz);
    let sure = certainty(given.is_some(), rejected, agree);
    let candidate = |i: usize| Candidate {
        order: i + 1,
        singular_value: singular[i],
        log_loss: losses[i],
        schwarz: values[i].map(|v| (v - best) / (2.0 * n.ln())),
        weight: weights[i] / total,
        free_run: free.get(i).and_then(|f| f.free.as_deref()).map(mean),
    };
    OrderChoice {
        order,
        sure,
        by_schwarz,
        by_gap,
        by_akaike,
        by_free_run,
        candidates: (0..losses.len()).map(candidate).collect(),
    }
}

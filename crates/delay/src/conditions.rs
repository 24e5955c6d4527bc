//! Conditions of a record that decide which methods to trust: feedback, an unstable plant, coloured noise, plant dynamics, missing samples.

use super::colour::colour;
use super::estimator::Search;
use super::experiment::Experiment;
use super::feedback::{in_loop, lags};
use super::finding::Finding;
use super::method::Condition;
use crate::posterior::{ARX_ORDERS, smallest};
use deadtime_identify::{Record, Regression, arx_scan, largest_pole};

/// Coefficients after which a long response is truncated.
const LAGS: usize = 71;
/// Samples between the first response and the centre of the response that indicate a lag. A copy delayed by a fraction of a sample has 0.5.
const LAG: f64 = 0.75;
/// Share of the largest coefficient from which a coefficient is included.
const BEGUN: f64 = 0.1;

/// Conditions that the records of one pair show, from ARX models of the orders of [`Arxstruc`](crate::Arxstruc) over the same window.
///
/// * Feedback: see [`in_loop`], for a plant that is strictly proper.
/// * Unstable plant: a pole outside the unit circle by more than 3/N. An estimated pole at 1 converges at the rate 1/N.
/// * Coloured noise: past outputs predict the residual of a free response with a slow tail (see `colour`).
/// * Dynamics: the response's centre lies later than its beginning.
///
/// Each can be wrong: a lightly damped response that rings slowly beyond 71 samples can pass for coloured noise. Too short a record reveals no condition.
#[must_use]
pub fn conditions(records: &[Record], max_delay: usize) -> Vec<Finding> {
    let mut found = of_the_plant(records, max_delay);
    found.extend(in_loop(records, max_delay, Search::default().default_bias).finding());
    found
}

/// The same without the feedback test.
pub(super) fn of_the_plant(records: &[Record], max_delay: usize) -> Vec<Finding> {
    let mut found = Vec::new();
    let missing: usize = records
        .iter()
        .filter_map(|r| r.present.as_ref())
        .map(|p| p.iter().filter(|p| !**p).count())
        .sum();
    if missing > 0 {
        found.push(Finding {
            condition: Condition::MissingOutputs,
            evidence: format!("{missing} output samples are missing").into(),
        });
    }
    let [na, nb] = ARX_ORDERS;
    let scan = arx_scan(records, na, nb, max_delay);
    let rows = scan.rows as f64;
    let best = smallest(&scan.loss);
    let Some(best) = best.filter(|_| scan.rows > 4 * (na + nb)) else { return found };
    let coefficients = &scan.coefficients[best];
    let a: Vec<f64> = coefficients[..na].iter().map(|c| -c).collect();
    let pole = largest_pole(&a);
    if pole > 1.0 + 3.0 / rows {
        found.push(Finding {
            condition: Condition::UnstablePlant,
            evidence: format!("a pole at |z| = {pole:.4}").into(),
        });
    }
    let lag = lag(&a, &coefficients[na..]);
    if lag > LAG {
        found.push(Finding {
            condition: Condition::Dynamics,
            evidence: format!("the response lasts {lag:.1} samples on average").into(),
        });
    }
    found.extend(colour(records, na, max_delay));
    found
}

/// Share of the largest coefficient from which the response has begun; ringing on either side is allowed.
const HALF: f64 = 0.5;
/// Coefficients on either side of the beginning that determine the ringing,
const AROUND: usize = 4;
/// and their share of all: 94 % for a copy delayed by half a sample, 40 % for a response over 20 samples.
const MOST: f64 = 0.8;
/// Limit of Σ|h| over |Σh| around the beginning. A copy delayed by half a sample reaches 2.3, because its response is sin(πx)/(πx).
const RINGS: f64 = 2.5;

/// Whether the response lasts one sample, including the ringing of a fractional delay. A one-sample response has its signed centre near the first coefficient
/// of half its height.
///
/// How it can be wrong: a plant whose overshoot equals the ringing of a fractional delay is taken for a copy.
pub(super) fn lasts_one_sample(records: &[Record], max_delay: usize) -> bool {
    // No past outputs: those of a copy that rings on either side contain its later samples.
    let free = Regression { na: 0, lags: lags(records, max_delay) };
    let Some(solution) = free.factor(records).solve() else { return false };
    let response = solution.coefficients;
    let largest = response.iter().fold(0.0, |m: f64, h| m.max(h.abs()));
    let counted = || response.iter().enumerate().filter(|(_, h)| h.abs() > BEGUN * largest);
    let begun = counted().find(|(_, h)| h.abs() > HALF * largest).map_or(0, |(k, _)| k);
    // Both sides have equally many coefficients for a delay of half a sample.
    let near = || counted().filter(|(k, _)| k + AROUND > begun && *k <= begun + AROUND);
    let sum: f64 = near().map(|(_, h)| h).sum();
    let [all, around]: [f64; 2] =
        [counted().map(|(_, h)| h.abs()).sum(), near().map(|(_, h)| h.abs()).sum()];
    let moment: f64 = near().map(|(k, h)| (k as f64 - begun as f64) * h).sum();
    around > MOST * all && around < RINGS * sum.abs() && (moment / sum).abs() < LAG
}

/// A single output sample is isolated from this distance to its five neighbours' median, in multiples of the 95 % quantile of all distances.
const STANDS_OFF: f64 = 5.0;

/// Isolated output samples, far from those before and after. Outliers are isolated; samples of a response seldom are.
///
/// The distance is the smaller of two: to the median, and to the cubic through two samples on either side, (4·(y₋₁+y₁) − (y₋₂+y₂))/6. The crest of a smooth
/// signal is far from the median alone.
///
/// The scale is the 95 % quantile of all distances; Hampel's filter uses their median. A response to a random input mostly stays near its neighbours, and then
/// moves.
#[must_use]
pub fn standing_off(records: &[Record]) -> usize {
    let mut off: Vec<Vec<f64>> = Vec::with_capacity(records.len());
    for record in records {
        let there = record
            .y
            .iter()
            .enumerate()
            .filter(|(t, _)| record.present.as_ref().is_none_or(|p| p[*t]));
        let values: Vec<f64> = there.map(|(_, y)| *y).collect();
        let cubic = |w: &[f64]| (4.0 * (w[1] + w[3]) - (w[0] + w[4])) / 6.0;
        let distance =
            |w: &[f64]| (w[2] - point(w.to_vec(), 10)).abs().min((w[2] - cubic(w)).abs());
        off.push(values.windows(5).map(distance).collect());
    }
    let scale = point(off.iter().flatten().copied().collect(), 19);
    let far = |d: f64| scale > 0.0 && d > STANDS_OFF * scale;
    let alone = |d: &&[f64]| far(d[1]) && !far(d[0]) && !far(d[2]);
    off.iter().map(|d| d.windows(3).filter(alone).count()).sum()
}

/// The quantile at this number of twentieths; 0 for no values.
fn point(mut values: Vec<f64>, twentieths: usize) -> f64 {
    let at = values.len() * twentieths / 20;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// Correlation of two inputs, at any lag of the window, from which their effects are indistinguishable.
const TOGETHER: f64 = 0.3;

/// Another input correlated with the first: its effect is then no noise that would average out.
#[must_use]
pub fn moving_together(experiment: &Experiment<'_>, max_delay: usize) -> Option<Finding> {
    let correlation = |other: usize| {
        let lags =
            -isize::try_from(max_delay).unwrap_or(0)..=isize::try_from(max_delay).unwrap_or(0);
        let mut sums = vec![0.0; 2 * max_delay + 1];
        let (mut power, mut other_power) = (0.0, 0.0);
        for recording in experiment.recordings() {
            let (u, v) = (&recording.inputs[0], &recording.inputs[other]);
            power += u.iter().map(|x| x * x).sum::<f64>();
            other_power += v.iter().map(|x| x * x).sum::<f64>();
            for (sum, product) in
                sums.iter_mut().zip(deadtime_signal::correlation(u, v, lags.clone()))
            {
                *sum += product;
            }
        }
        sums.iter().fold(0.0, |m: f64, s| m.max(s.abs()))
            / (power * other_power).sqrt().max(f64::MIN_POSITIVE)
    };
    let others = (1..experiment.inputs().len()).map(|other| (other, correlation(other)));
    let (other, most) =
        others.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, most)| *most > TOGETHER)?;
    let evidence =
        format!("`{}` is correlated with it by {most:.2}", experiment.inputs()[other]).into();
    Some(Finding { condition: Condition::OtherInputs, evidence })
}

/// Samples from the beginning of the response to the centre of its coefficients, those below 10 % of the largest left out.
fn lag(a: &[f64], b: &[f64]) -> f64 {
    let Some(response) = response(a, b) else { return f64::INFINITY };
    let least = BEGUN * response.iter().fold(0.0, |m: f64, h| m.max(h.abs()));
    let counted: Vec<(usize, f64)> =
        response.iter().map(|h| h.abs()).enumerate().filter(|(_, h)| *h > least).collect();
    let begun = counted.first().map_or(0, |(k, _)| *k);
    let total: f64 = counted.iter().map(|(_, h)| h).sum();
    let moment: f64 = counted.iter().map(|(k, h)| (k - begun) as f64 * h).sum();
    if total > 0.0 { moment / total } else { 0.0 }
}

/// The impulse response of past outputs and inputs; `None` where it diverges.
fn response(a: &[f64], b: &[f64]) -> Option<Vec<f64>> {
    let mut response: Vec<f64> = Vec::with_capacity(10 * LAGS);
    for k in 0..10 * LAGS {
        let past: f64 = a
            .iter()
            .enumerate()
            .filter(|(i, _)| *i < k)
            .map(|(i, c)| c * response[k - 1 - i])
            .sum();
        let next = b.get(k).copied().unwrap_or(0.0) - past;
        if !next.is_finite() || next.abs() > 1e100 {
            return None;
        }
        response.push(next);
    }
    Some(response)
}

#[cfg(test)]
mod tests {
    use super::standing_off;
    use deadtime_identify::Record;
    use rand::{RngExt, SeedableRng};

    /// A smooth signal at rest most of the time, with occasional crests.
    fn crests(rng: &mut rand_chacha::ChaCha8Rng, noise: f64) -> Vec<f64> {
        let mut y = vec![0.0; 1200];
        for crest in 0..12 {
            let at = [300, 600, 900][crest % 3] + rng.random_range(-40..40_i32);
            let width = rng.random_range(8.0..12.0);
            let height = rng.random_range(-3.0..3.0);
            for (t, v) in (0..).zip(&mut y) {
                *v += height * (-0.5 * (f64::from(t - at) / width).powi(2)).exp();
            }
        }
        y.iter_mut().for_each(|v| *v += noise * rng.random_range(-1.0..1.0));
        y
    }

    #[test]
    fn crests_of_a_smooth_signal_are_no_outliers_and_single_samples_are() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(81);
        for round in 0..60 {
            let noise = [0.001, 0.003, 0.01][round % 3];
            let mut y = crests(&mut rng, noise);
            let u = vec![0.0; y.len()];
            assert_eq!(standing_off(&[Record::new(u.clone(), y.clone())]), 0, "{noise}");
            // Samples where the signal rests.
            let places = [100, 450, 750, 1100].map(|at| at + rng.random_range(0..10_usize));
            places.iter().for_each(|at| y[*at] += 20.0);
            assert_eq!(standing_off(&[Record::new(u, y)]), 4, "{noise}");
        }
    }
}

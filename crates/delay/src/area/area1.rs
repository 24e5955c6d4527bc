//! The dead time of one lag from two areas of a measured step response.
//!
//! Equation: K·e^(−Ls)/(1 + sT): L = A₀/K − e·A₁/K, A₀ = ∫(K − s) dt, A₁ = ∫₀^(A₀/K) s dt. Here s is the mean output after each input step, weighted with the
//! step heights.

use super::reading::{Area, BEYOND, Lags, Reading, SIGNIFICANT, answer, area};
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, noted, options};
use crate::method::{Information, Law, Method, ReferenceExperiment, Start, method_line};
use deadtime_identify::Record;
use deadtime_signal::stats;

/// Areas of the measured step response, read as one lag.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
///
/// Assumes: an input held exactly between steps, each longer than the longest delay plus the response. A plant of dead time and one lag, settled before each
/// step. White noise; no missing samples.
/// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N).
/// Fails when: the input has no such steps (`not_applicable`). A plant of another order biases the delay: +0.53·T for two equal lags T, more for more lags. An
/// input that moves again before the response ends biases it, too (reported in a note). Noise may hide the end of the response (`singular`). A₀ accumulates
/// noise with every summed sample, so the sum ends at five average residence times. The interval covers plants of one lag to two equal lags, and none beyond
/// them.
/// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4. Björklund (2003), LiU-TEK-LIC-2003:60, class 3. The
/// thesis does not define how its `area1` to `area3` differ; `area1` here applies the book's method to a measured step. The end of the sum is this program's
/// choice.
///
/// # Example
/// ```
/// use deadtime_delay::{Area1, DelayEstimator, Experiment, Search};
/// use deadtime_signal::time::SampleTime;
/// let u: Vec<f64> = (0..400).map(|t| if t < 50 { 0.0 } else { 1.0 }).collect();
/// let mut y = vec![0.0; 401];
/// for t in 4..400 {
///     y[t + 1] = 0.8 * y[t] + 0.2 * u[t - 4];
/// }
/// y.pop();
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Area1::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Area1 {
    /// Samples for which a step, and the input before it, must be held; default 71, more where the search window needs them.
    pub held: usize,
}

impl Default for Area1 {
    fn default() -> Self {
        Self { held: 71 }
    }
}

const NAME: &str = "area1";

/// Samples of rest before the first step that suffice for the initial level.
const REST: usize = 10;
/// The last 1/`END` of a held step gives its final value.
const END: usize = 4;
/// Average residence times after which a response is over: L + 5T and more.
const OVER: f64 = 5.0;
/// A change in the last half of a held step below this share of the whole counts as settled.
const STILL: f64 = 0.05;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    reference: ReferenceExperiment::Steps,
    information: Information::Poles(1),
    tolerance: 2.0,
    needs: "steps that are held until the response is over, a plant of one lag that rests before them",
    blind_to: "the order of the plant, which it takes for granted; oscillation; feedback",
    exempt: &[(
        Law::Exact,
        "it needs steps, and reads their response as that of one lag, which most plants are not",
    )],
    ..method_line!(
        "area1",
        "dead time of one lag from areas of the measured step response",
        Area1,
        Area
    )
};

/// The mean response to a unit step.
struct StepResponse {
    step: Vec<f64>,
    /// Variance of each of its samples.
    variance: f64,
}

fn mean(x: &[f64]) -> f64 {
    stats::mean(x.iter().copied()).unwrap_or(0.0)
}

/// The mean over all steps held for at least `held` samples after a constant input (at the start of a record: [`REST`] samples). `None` without such a step.
fn response(records: &[Record], held: usize) -> Option<StepResponse> {
    // (height, output from the step on, level before)
    let mut steps: Vec<(f64, &[f64], f64)> = Vec::new();
    for record in records {
        let mut edges: Vec<usize> =
            (1..record.len()).filter(|&t| record.u[t] != record.u[t - 1]).collect();
        edges.insert(0, 0);
        edges.push(record.len());
        for window in edges.windows(3) {
            let &[before, at, end] = window else { continue };
            let rest = if before == 0 { REST } else { held };
            if at - before >= rest && end - at >= held {
                let settled = &record.y[at - ((at - before) / END).max(REST.min(at - before))..at];
                steps.push((record.u[at] - record.u[at - 1], &record.y[at..end], mean(settled)));
            }
        }
    }
    let shortest = steps.iter().map(|(_, y, _)| y.len()).min()?;
    let weight: f64 = steps.iter().map(|(height, _, _)| height * height).sum();
    let step: Vec<f64> = (0..shortest)
        .map(|i| {
            steps.iter().map(|(height, y, level)| height * (y[i] - level)).sum::<f64>() / weight
        })
        .collect();
    // The residual at the end of each step is noise.
    let ends: Vec<f64> = steps
        .iter()
        .flat_map(|(_, y, _)| {
            let end = &y[shortest - shortest / END..shortest];
            let level = mean(end);
            end.iter().map(move |v| (v - level).powi(2))
        })
        .collect();
    Some(StepResponse { step, variance: mean(&ends) / weight })
}

impl PairMethod for Area1 {
    fn check(&self) -> Result<(), DelayError> {
        options(NAME, [("held", self.held as f64, self.held >= END, "4 or more")])
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let held = self.held.max(pair.max_delay + BEYOND);
        pair.at_least(NAME, REST + held, LengthRemedy::WindowOr("set a smaller held"))?;
        pair.complete("output samples are missing, and their areas with them")?;
        let Some(response) = response(pair.records, held) else {
            let note =
                format!("the input has no step that is held for {held} samples after a rest");
            return Err(NoDelay::new(Outcome::NotApplicable, note));
        };
        pair.visible()?;
        let step = &response.step;
        let end = step.len() - step.len() / END;
        let (gain, before) = (mean(&step[end..]), mean(&step[step.len() / 2..end]));
        let noise = (response.variance / (step.len() - end) as f64).sqrt();
        let singular = |note| NoDelay::new(Outcome::Singular, note);
        let significant = gain.abs() > SIGNIFICANT * noise;
        if !significant {
            return Err(singular(
                "the final value of the response, by which areas are divided, does not exceed the noise",
            ));
        }
        let readings = readings(&response, gain, end).ok_or_else(|| {
            singular(
                "the average residence time lies outside the response: the areas have no solution",
            )
        })?;
        let moves = (gain - before).abs() > STILL * gain.abs() + SIGNIFICANT * noise;
        let note = moves.then(|| "the response is not over where the steps end: the dead time is read too early or too late".to_owned());
        noted(answer(Lags::One, readings, pair), note)
    }
}

/// Both readings of a step response whose final value is the mean from `end` on; `None` where the areas have no solution.
fn readings(response: &StepResponse, gain: f64, end: usize) -> Option<[Reading; 2]> {
    let step = &response.step;
    // Straight lines between the samples: half a sample less than the sum of K − s.
    let residence =
        |until: usize| step.iter().take(until).map(|s| 1.0 - s / gain).sum::<f64>() - 0.5;
    let mut until = end;
    for _ in 0..3 {
        let over = (OVER * residence(until)).max(OVER) as usize;
        until = over.min(end);
    }
    let t_ar = residence(until);
    let Area { a1, height, weights } = area(step, gain, t_ar)?;
    let reading = |lags: Lags| {
        let c = lags.of_area();
        let (tail, summed) = ((step.len() - end) as f64, until as f64);
        // Each sample as part of A₀, of A₁, and of the end.
        let gradient: Vec<f64> = (0..step.len())
            .map(|i| {
                let sum = if i < until { -(1.0 - c * height) } else { 0.0 };
                let last = if i >= end {
                    ((1.0 - c * height) * (summed - t_ar - 0.5) + c * a1) / tail
                } else {
                    0.0
                };
                (sum - c * weights[i] + last) / gain
            })
            .collect();
        // All are measured from one level, which is the mean of at least as many samples as a rest has.
        let level = gradient.iter().sum::<f64>().powi(2) / REST as f64;
        let squares: f64 = gradient.iter().map(|g| g * g).sum();
        Reading { delay: t_ar - c * a1, std: (response.variance * (squares + level)).sqrt() }
    };
    let readings = [reading(Lags::One), reading(Lags::Two)];
    readings.iter().all(|r| r.delay.is_finite() && r.std.is_finite()).then_some(readings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_deviation_is_that_of_the_difference_quotients() {
        let step: Vec<f64> =
            (0..80).map(|i| if i > 7 { 1.0 - 0.8_f64.powi(i - 7) } else { 0.0 }).collect();
        let end = 60;
        let read = |step: &[f64]| {
            readings(&StepResponse { step: step.to_vec(), variance: 1.0 }, mean(&step[end..]), end)
                .unwrap()
        };
        for k in 0..2 {
            let moved = |which: &dyn Fn(usize) -> bool, h: f64| {
                let other: Vec<f64> = step
                    .iter()
                    .enumerate()
                    .map(|(i, s)| if which(i) { s + h } else { *s })
                    .collect();
                read(&other)[k].delay
            };
            let slope =
                |which: &dyn Fn(usize) -> bool| (moved(which, 1e-6) - moved(which, -1e-6)) / 2e-6;
            let squares: f64 = (0..80).map(|j| slope(&|i| i == j).powi(2)).sum();
            let expected = (squares + slope(&|_| true).powi(2) / REST as f64).sqrt();
            let std = read(&step)[k].std;
            assert!((std / expected - 1.0).abs() < 1e-3, "{std} {expected}");
        }
    }

    #[test]
    fn only_steps_that_are_held_count() {
        let u: Vec<f64> = (0..300)
            .map(|t| {
                if t < 20 {
                    0.0
                } else if t < 120 {
                    1.0
                } else if t < 130 {
                    2.0
                } else {
                    0.0
                }
            })
            .collect();
        let record = Record::new(&u, u.iter().map(|v| 3.0 * v + 7.0).collect::<Vec<f64>>());
        let found = response(std::slice::from_ref(&record), 71).unwrap();
        // The step at 20 alone: that at 120 is too short, that at 130 follows it too soon.
        assert_eq!(found.step, vec![3.0; 100]);
        assert!(response(&[Record::new(vec![0.0; 40], vec![0.0; 40])], 71).is_none());
    }
}

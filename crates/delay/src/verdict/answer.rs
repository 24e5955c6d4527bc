//! The estimate of a method, and the conditions of the record under which it is not trusted.

use super::earned::Study;
use super::mixture::Answer;
use crate::estimate::{DelayEstimate, Outcome};
use crate::finding::Finding;
use crate::method::{Basis, Class, Condition, Method, WHOLE};
use crate::posterior::RESOLUTION;
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::time::SampleTime;

/// A method, its estimate, and its predicted standard deviation, s.
pub type Said<'a> = (&'a Method, &'a DelayEstimate, Option<f64>);

/// The conditions of the record that an estimate does not withstand; empty for a usable estimate.
///
/// An estimate from the open-loop part of the input withstands feedback with any method. The disturbance of that part is the loop's, which is never white.
/// Where the record is of one step and no model of more poles fits it better, the model includes the plant's lag.
#[must_use]
pub fn distrust(method: &Method, estimate: &DelayEstimate, findings: &[Finding]) -> Vec<Condition> {
    let shown = findings
        .iter()
        .map(|f| f.condition)
        .filter(|c| !(estimate.open_part && *c == Condition::Feedback));
    let shown = shown.filter(|c| !(estimate.enough_poles && *c == Condition::Dynamics));
    let coloured =
        estimate.open_part && findings.iter().all(|f| f.condition != Condition::ColouredNoise);
    shown
        .chain(coloured.then_some(Condition::ColouredNoise))
        .filter(|c| !method.withstands(*c))
        .collect()
}

/// Addition to the squared error of an estimate without a standard deviation.
const VAGUE: f64 = 1e12;

/// An estimate with a delay.
pub(super) struct FoundDelay<'a> {
    pub(super) method: &'a str,
    pub(super) class: Class,
    pub(super) basis: Basis,
    pub(super) delay_s: f64,
    /// The study of records like this one.
    pub(super) study: &'static Study,
    /// The squared error of the method in the study, as a ratio.
    pub(super) square_error: f64,
    /// Lower bound on its standard deviation, s.
    least_s: f64,
    interval_s: [f64; 2],
    /// The same, at least as wide as the resolution of whole samples.
    open_s: [f64; 2],
    pub(super) distrust: Vec<Condition>,
    pub(super) contradicted: bool,
    /// The estimate is earlier than the plant can respond.
    pub(super) within: bool,
    /// Standard deviation, s, of a model that resolves fractions of a sample and has enough poles; at least its tolerance and its predicted accuracy.
    pub(super) of_all_inputs_s: Option<f64>,
}

impl<'a> FoundDelay<'a> {
    /// `None` for an estimate without a delay.
    pub(super) fn new(
        (method, estimate, predicted_s): &Said<'a>,
        findings: &[Finding],
        sample_time: SampleTime,
    ) -> Option<Self> {
        let delay_s = estimate.delay_s.filter(|_| estimate.outcome == Outcome::Found)?;
        let resolution_s = sample_time.to_seconds(RESOLUTION.sqrt());
        let interval_s = estimate.ci95_s.unwrap_or([delay_s, delay_s]);
        let vague = if estimate.std_s.is_none() { VAGUE } else { 0.0 };
        let study = Study::of(findings.iter().any(|f| f.condition == Condition::Feedback));
        let resolves = estimate.enough_poles && method.tolerance > WHOLE && method.tolerance < 1.0;
        let least_s = sample_time.to_seconds(method.tolerance).max(predicted_s.unwrap_or(0.0));
        Some(Self {
            method: method.entry.name,
            class: method.class,
            basis: method.basis,
            delay_s,
            study,
            square_error: study.error(method.entry.name).powi(2) + vague,
            least_s: if method.tolerance < 1.0 {
                sample_time.to_seconds(method.tolerance)
            } else {
                resolution_s
            },
            interval_s,
            open_s: [
                interval_s[0].min(delay_s - NORMAL_95 * resolution_s),
                interval_s[1].max(delay_s + NORMAL_95 * resolution_s),
            ],
            distrust: distrust(method, estimate, findings),
            contradicted: estimate.contradicted,
            of_all_inputs_s: estimate.std_s.filter(|_| resolves).map(|std_s| std_s.max(least_s)),
            within: estimate.raw_delay_s.is_some_and(|raw| {
                raw < sample_time.to_seconds(estimate.degree_bias_samples - 0.5)
            }),
        })
    }

    /// The error of the method in the study, as a ratio.
    pub(super) fn error(&self) -> f64 {
        self.study.error(self.method)
    }

    /// The estimate in a mixture, with this weight.
    pub(super) fn answer(&self, weight: f64) -> Answer {
        Answer { delay_s: self.delay_s, interval_s: self.interval_s, least_s: self.least_s, weight }
    }

    /// The delay lies inside the interval.
    pub(super) fn holds(&self, delay_s: f64) -> bool {
        delay_s >= self.open_s[0] && delay_s <= self.open_s[1]
    }
}

//! The estimates of all methods for one pair, and the verdict on them.

use std::time::Instant;

use super::chosen::Ready;
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::usable;
use crate::finding::Finding;
use crate::method::{Condition, Information, Method};
use crate::report::{Estimate, Pair};
use crate::richness::Richness;
use crate::verdict::answer::distrust;
use crate::verdict::conclusion::RecordFacts;
use crate::verdict::weighing::verdict;
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::time::SampleTime;

/// A method's estimate, its predicted accuracy, and its run time, s.
pub(super) struct MethodAnswer {
    pub(super) method: &'static Method,
    pub(super) estimate: DelayEstimate,
    pub(super) predicted: Option<Richness>,
    pub(super) time_s: f64,
}

impl MethodAnswer {
    /// The estimate from `estimate`; a failure of the method on the data becomes an outcome.
    pub(super) fn of(
        ready: &Ready,
        predicted: Option<Richness>,
        estimate: impl FnOnce(&Ready) -> Result<DelayEstimate, DelayError>,
    ) -> Result<Self, DelayError> {
        let clock = Instant::now();
        let estimate = usable(estimate(ready))?;
        let time_s = clock.elapsed().as_secs_f64();
        Ok(Self { method: ready.method, estimate, predicted, time_s })
    }

    fn predicted_std_s(&self) -> Option<f64> {
        self.predicted.map(|p| p.std_s)
    }
}

/// The pair with its estimates and its verdict.
pub(super) fn pair(
    input: &str,
    output: &str,
    answers: &[MethodAnswer],
    findings: Vec<Finding>,
    sample_time: SampleTime,
    facts: &RecordFacts,
) -> Pair {
    let by_trust: Vec<_> =
        answers.iter().map(|a| (a.method, &a.estimate, a.predicted_std_s())).collect();
    let verdict = verdict(&by_trust, &findings, sample_time, facts);
    let estimate = |a: &MethodAnswer| {
        Estimate::new(a.method, &a.estimate, a.predicted_std_s(), a.time_s, &findings)
    };
    let estimates = answers.iter().map(estimate).collect();
    let poor_std_s = poor(answers, &findings, verdict.ci95_s);
    Pair { poor_std_s, findings, ..Pair::new([input, output], estimates, verdict) }
}

/// The best predicted standard deviation, s, where neighbouring delays are nearly indistinguishable. The value is that of a method with unknown gain and poles
/// whose estimate is used (of any such method where none is used). `None` where the verdict's interval is far narrower: the prediction's rough model does not
/// describe this plant.
fn poor(
    answers: &[MethodAnswer],
    findings: &[Finding],
    interval_s: Option<[f64; 2]>,
) -> Option<f64> {
    // The predictions hold for stable plants in open loop.
    if findings
        .iter()
        .any(|f| matches!(f.condition, Condition::Feedback | Condition::UnstablePlant))
    {
        return None;
    }
    let counts = |a: &MethodAnswer| {
        a.estimate.outcome == Outcome::Found
            && !a.estimate.contradicted
            && distrust(a.method, &a.estimate, findings).is_empty()
    };
    let of_poles = |a: &&MethodAnswer| matches!(a.method.information, Information::Poles(_));
    let best = |which: &dyn Fn(&MethodAnswer) -> bool| {
        let expected =
            answers.iter().filter(of_poles).filter(|a| which(a)).filter_map(|a| a.predicted);
        expected.max_by(|a, b| a.separation.total_cmp(&b.separation))
    };
    let predicted =
        best(&counts).or_else(|| best(&|_| true)).filter(|p| p.separation < DISTINGUISHABLE)?;
    let narrower = interval_s.is_some_and(|[from, to]| to - from < NORMAL_95 * predicted.std_s);
    (!narrower).then_some(predicted.std_s)
}

/// Half the distance between two responses, in standard deviations of the noise, from which they are distinguishable.
const DISTINGUISHABLE: f64 = 3.0;

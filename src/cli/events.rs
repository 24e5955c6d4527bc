//! `deadtime estimate --events`: the delay between two sequences of event times.

use std::time::Instant;

use anyhow::{Context, bail};

use super::estimate::{Ready, pair};
use super::source::Source;
use crate::delay::{DelayEstimate, Events, Experiment, Outcome, Search};
use crate::report::estimate::{FORMAT, Report};
use crate::time::SampleTime;

/// Parts of a typical interval in which the window is counted.
const PARTS: u8 = 100;

/// The report, and a sentence on what was searched.
pub(super) fn run(source: &Source, columns: &str, methods: &[Ready], max_delay_s: Option<f64>) -> anyhow::Result<(Report, String)> {
    let name = source.log.display().to_string();
    let Some((a, b)) = columns.split_once(',').map(|(a, b)| (a.trim(), b.trim())).filter(|(a, b)| !a.is_empty() && !b.is_empty() && a != b)
    else {
        bail!("--events {columns}: write the two columns as A,B");
    };
    let [first, second] = source.events([a, b])?;
    let mut intervals: Vec<f64> = first.times.windows(2).map(|w| w[1] - w[0]).collect();
    intervals.sort_by(f64::total_cmp);
    let Some(&interval) = intervals.get(intervals.len() / 2) else { bail!("{name}: `{a}` holds one event; at least two are needed") };
    let step = SampleTime::new(interval / f64::from(PARTS)).with_context(|| format!("{name}: the intervals between events of `{a}`"))?;
    let max_delay = match max_delay_s {
        None => Search::default().max_delay * usize::from(PARTS),
        Some(seconds) => {
            let samples = step.samples(seconds)?;
            samples.whole + usize::from(samples.fraction > 0.0)
        }
    };
    if max_delay == 0 {
        bail!("--max-delay 0: give a longer one");
    }
    let (counts, units) = ([first.times.len(), second.times.len()], [first.unit, second.unit]);
    let mut experiment = Experiment::of_events(step, Vec::new(), Vec::new());
    (experiment.inputs, experiment.outputs) = (vec![a.to_owned()], vec![b.to_owned()]);
    experiment.events = vec![Events { first: first.times, second: second.times, units }];
    let search = Search { max_delay, ..Search::default() };
    let mut answers = Vec::new();
    for ready in methods {
        let clock = Instant::now();
        // What a method cannot do with these sequences is its answer; the others go on.
        let estimate = match ready.estimator.estimate(&experiment, &search) {
            Ok(mut estimates) if estimates.len() == 1 => estimates.remove(0).estimate,
            Ok(_) => DelayEstimate::without(Outcome::NotApplicable, "no answer for these sequences"),
            Err(e) => DelayEstimate::without(Outcome::NotApplicable, e.to_string()),
        };
        answers.push((ready.method, estimate, clock.elapsed().as_secs_f64()));
    }
    #[allow(clippy::cast_precision_loss)]
    let window_s = step.to_seconds(max_delay as f64);
    let preamble = format!(
        "{name}: {} events of `{a}` and {} of `{b}`, typically {interval:.4} s apart; searched 0 to {window_s:.4} s",
        counts[0], counts[1]
    );
    let pairs = vec![pair(a, b, &answers, Vec::new(), step)];
    Ok((Report { format: FORMAT, log: name, sample_time_s: step.seconds(), max_delay_s: window_s, pairs }, preamble))
}

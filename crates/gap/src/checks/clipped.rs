//! An output at its limit: its largest or smallest value comes again and again, to the bit.

use super::evidence::{ALL, Evidence, result, short};
use super::faults::agrees;
use super::moments::deviation;
use super::moments::mean;
use super::runs::Trace;
use crate::format::diagnosis::{Check, CheckKind};
use deadtime_model::effect::{Applied, find};

/// The least number of samples at the limit,
const FEWEST: usize = 5;
/// and this part of all.
const PART: f64 = 0.003;
/// A channel that repeats more often than this elsewhere is coarse or settles: then the model must go on moving, beyond the limit.
const RARELY: f64 = 0.2;
/// The distance beyond the limit, and the required motion there, as a part of the output's standard deviation.
const BEYOND: f64 = 0.1;
/// The last step before a limit is reached, as a part of the median step: what settles arrives with smaller and smaller ones.
const ARRIVES: f64 = 0.2;
/// The same of a coarse channel, in its steps.
const ROWS: f64 = 3.0;
/// Or so many times as many samples at the limit as one step before it.
const PILED: usize = 5;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for i in 0..e.view.outputs() {
        let name = e.output(i);
        let unit =
            e.view.system.outputs[i].unit.as_deref().map(|u| format!(" {u}")).unwrap_or_default();
        let hit = (0..e.view.records.len())
            .flat_map(|at| [true, false].map(|upper| (at, upper)))
            .find_map(|(at, upper)| {
                let trace = Trace::output(e.view.records[at], i);
                limit(e, at, i, &trace, upper).map(|(value, count)| {
                    (value, count, trace.values.len(), e.view.records[at].name.clone())
                })
            });
        if let Some((value, count, of, log)) = hit {
            let finding = format!(
                "`{name}` stops at {}{unit}: {count} of {of} samples of {log} have exactly that value: a limit of the sensor or of the logger's number; leave these cells empty",
                short(value)
            );
            found.push(result(CheckKind::Clipped, name, Some(false), finding));
        }
    }
    if found.is_empty() {
        found.push(result(
            CheckKind::Clipped,
            ALL,
            Some(true),
            "no output stops at a limit".to_owned(),
        ));
    }
    found
}

/// The limits at which an output stops in a log.
pub(super) fn limits(e: &Evidence<'_>, at: usize, output: usize) -> [Option<f64>; 2] {
    let trace = Trace::output(e.view.records[at], output);
    [true, false].map(|upper| limit(e, at, output, &trace, upper).map(|(value, _)| value))
}

/// The limits of every output that stops at one, as effects of the catalogue.
pub(super) fn as_effects(e: &Evidence<'_>) -> Vec<Applied> {
    let Ok(effect) = find("sensor_saturation") else { return Vec::new() };
    let of = |output: usize| {
        let found = (0..e.view.records.len()).map(|at| limits(e, at, output));
        let [upper, lower] =
            found.fold([None, None], |[upper, lower], [high, low]| [upper.or(high), lower.or(low)]);
        upper.or(lower)?;
        let mut limited = Applied::nominal(e.view.system, effect, e.output(output)).ok()?;
        limited.values = vec![lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY)];
        Some(limited)
    };
    (0..e.view.outputs()).filter_map(of).collect()
}

/// The limit and how many samples are at it.
fn limit(
    e: &Evidence<'_>,
    at: usize,
    output: usize,
    trace: &Trace<'_>,
    upper: bool,
) -> Option<(f64, usize)> {
    let value = if upper { trace.largest() } else { trace.smallest() };
    if !value.is_finite() || trace.smallest() == trace.largest() {
        return None;
    }
    let there: Vec<usize> = (0..trace.values.len()).filter(|&k| trace.values[k] == value).collect();
    if there.len() < FEWEST || (there.len() as f64) < PART * trace.values.len() as f64 {
        return None;
    }
    let step = |k: usize| (trace.values[k] - trace.values[k - 1]).abs();
    let mut steps: Vec<f64> = (1..trace.values.len()).map(step).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let median = steps.get(steps.len() / 2)?;
    let coarse = trace.is_coarse() || trace.repeats(|k| trace.values[k] != value) > RARELY;
    // In a coarse channel the last steps may be single ones by chance.
    let least =
        if coarse { (ARRIVES * median).max(ROWS * steps.first()?) } else { ARRIVES * median };
    let entries: Vec<f64> = there
        .iter()
        .filter(|&&k| k >= 2 && trace.values[k - 1] != value)
        .map(|&k| step(k - 1))
        .collect();
    let abrupt = entries.iter().filter(|s| **s >= least).count();
    let next = trace
        .values
        .iter()
        .filter(|v| **v != value && (**v - value).abs() < 1.5 * steps[0])
        .count();
    let piled = coarse && there.len() >= PILED * next.max(1);
    if entries.is_empty() || (2 * abrupt < entries.len() && !piled) {
        return None;
    }
    if !coarse {
        return Some((value, there.len()));
    }
    // A coarse or settled channel.
    let search = e.search.as_ref().filter(|_| !e.view.predicts())?;
    search.fits.get(output).copied().flatten().filter(agrees)?;
    let modelled: Vec<f64> =
        there.iter().map(|&k| search.modelled[at][output][trace.index[k]]).collect();
    let size = deviation(&trace.values);
    let beyond = mean(modelled.iter().map(|m| if upper { m - value } else { value - m }));
    (beyond > BEYOND * size && deviation(&modelled) > BEYOND * size).then_some((value, there.len()))
}

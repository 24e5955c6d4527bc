//! A pair's verdict with a time-varying delay, which replaces the single value.

use super::conditions::of_the_plant;
use super::error::DelayError;
use super::estimate::DelayEstimate;
use super::estimator::{Search, usable};
use super::experiment::{Experiment, Recording, Series};
use super::finding::Finding;
use super::job::chosen::Ready;
use super::method::Condition;
use super::report::Pair;
use super::verdict::conclusion::{RecordFacts, Verdict};
use super::verdict::weighing::verdict;
use crate::track::answer::{Anchor, AtOneDelay, Kind, Moving, tracked};
use crate::track::watch::{Stretch, Watch, Watched};
use deadtime_identify::Record;
use deadtime_signal::time::SampleTime;

/// Requested results of the test.
pub(super) struct Wanted {
    /// The delay against time, also where one delay describes the records.
    pub(super) track: bool,
    /// The known facts of the record.
    pub(super) facts: RecordFacts,
}

/// Methods that estimate the delay of the record without its changes; if none of them is requested, the requested ones.
const ANCHORS: [&str; 4] = ["oestruc", "oe_posterior", "arxstruc", "p2d"];
/// Largest number of methods that run a second time.
const MOST: usize = 4;
/// Error of the watch's own model, samples, 95 %: its first coefficient may be zero.
const OWN: f64 = 3.0;
/// Error of a straightened record's dead time, samples, 95 %: its held input is moved by fractions of a sample, with an error that is uniform over one.
const MOVED: f64 = 0.57;
/// Largest number of stretches in a sentence.
const NAMED: usize = 6;

/// Watches the delay of a pair over time, reports it, and withdraws the single value where one delay does not describe the records.
pub(super) fn tell(
    pair: &mut Pair,
    one: &Experiment<'_>,
    search: &Search,
    methods: &[&Ready],
    asked: &Wanted,
) -> Result<(), DelayError> {
    let records = one.pair(0, 0)?;
    let watch = Watch::default();
    let Some(seen) = watch.look(&records, search) else { return Ok(()) };
    search.go_on()?;
    let steady = is_steady(&seen, &records);
    if steady && !asked.track {
        return Ok(());
    }
    let track = seen.track();
    search.go_on()?;
    let ts = one.sample_time();
    let bias = search.bias(0, 0);
    // The delay of longest duration.
    let longest = seen.stretches().into_iter().max_by_key(|s| s.samples.len());
    let reference = longest.map_or(bias as f64, |s| s.delay as f64);
    let straight = if steady {
        pair.verdict.clone()
    } else {
        let straightened = track.straightened(&records, reference).into_iter();
        let recordings = straightened.map(|r| Recording {
            inputs: vec![r.u],
            outputs: vec![Series { values: r.y, present: r.present }],
            states: Vec::new(),
        });
        straight_verdict(pair, &one.with_recordings(recordings.collect()), search, methods, asked)?
    };
    let own = ts.to_seconds(reference - bias as f64);
    let anchor = match (straight.delay_s, straight.ci95_s) {
        (Some(delay_s), Some([from_s, to_s])) => {
            let own = if steady { 0.0 } else { ts.to_seconds(MOVED) };
            let [below, above] = [(delay_s - from_s).hypot(own), (to_s - delay_s).hypot(own)];
            Anchor { reference, delay_s, ci95_s: [delay_s - below, delay_s + above] }
        }
        _ => Anchor {
            reference,
            delay_s: own.max(0.0),
            ci95_s: [own - ts.to_seconds(OWN), own + ts.to_seconds(OWN)],
        },
    };
    if asked.track {
        pair.track = Some(tracked(&track, &anchor, ts));
    }
    if !steady {
        let drift = seen.drift(&track, watch.price);
        let lengths: Vec<usize> = records.iter().map(Record::len).collect();
        let moving = Moving::new(&seen, &track, drift, &anchor, &lengths, bias, ts);
        pair.verdict = Verdict::none(sentence(&moving, lengths.len(), ts));
        pair.moving = Some(moving);
    }
    Ok(())
}

/// One delay describes the pair's records.
pub(super) fn stands(one: &Experiment<'_>, search: &Search) -> Result<bool, DelayError> {
    let records = one.pair(0, 0)?;
    Ok(Watch::default().look(&records, search).is_none_or(|seen| is_steady(&seen, &records)))
}

/// One delay describes the records, or the input rests in a stretch of another delay.
fn is_steady(seen: &Watched, records: &[Record<'_>]) -> bool {
    seen.is_steady() || !moves_throughout(records, &seen.of_one_change())
}

/// The input moves in every stretch: a stretch without motion has no delay of its own.
fn moves_throughout(records: &[Record<'_>], stretches: &[Stretch]) -> bool {
    stretches.iter().all(|s| {
        let u = records.get(s.record).map_or(&[][..], |r| &r.u);
        let [from, to] =
            [s.samples.start, s.samples.end].map(|at| at.saturating_sub(s.delay).min(u.len()));
        u[from..to].windows(2).any(|pair| pair[0] != pair[1])
    })
}

/// The verdict of a few methods on the records without their changes.
fn straight_verdict(
    pair: &Pair,
    straight: &Experiment<'_>,
    search: &Search,
    methods: &[&Ready],
    asked: &Wanted,
) -> Result<Verdict, DelayError> {
    let known: Vec<&&Ready> =
        methods.iter().filter(|r| ANCHORS.contains(&r.method.entry.name)).collect();
    let ask: Vec<&&Ready> =
        if known.is_empty() { methods.iter().take(MOST).collect() } else { known };
    let mut answers: Vec<DelayEstimate> = Vec::with_capacity(ask.len());
    for ready in &ask {
        answers.push(usable(ready.estimator.estimate(straight, search))?);
    }
    let said: Vec<_> = ask.iter().zip(&answers).map(|(r, a)| (r.method, a, None)).collect();
    // A delay that moves makes a plant look unstable, and its noise coloured.
    let plant = [Condition::UnstablePlant, Condition::Dynamics, Condition::ColouredNoise];
    let others = pair.findings.iter().filter(|f| !plant.contains(&f.condition)).cloned();
    let findings: Vec<Finding> =
        others.chain(of_the_plant(&straight.pair(0, 0)?, search.max_delay)).collect();
    Ok(verdict(&said, &findings, straight.sample_time(), &asked.facts))
}

/// `One delay does not describe this record: 0.10 s until 12.4 s, 0.30 s from then on`.
fn sentence(moving: &Moving, records: usize, ts: SampleTime) -> String {
    let digits = |v: f64, step: f64| {
        let places = (1.0 - step.log10()).ceil().clamp(0.0, 9.0) as usize;
        format!("{v:.places$}")
    };
    let delay = |v: f64| digits(v, ts.seconds());
    let time = |v: f64| digits(v, 10.0 * ts.seconds());
    let [low, middle, high] = moving.quantiles_s;
    let what = if records > 1 { "these records" } else { "this record" };
    let intro = format!("One delay does not describe {what}");
    if let (Kind::Drifts, Some(rate)) = (moving.kind, moving.rate) {
        return format!(
            "{intro}: it drifts by {rate:.2e} s each second, between {} and {} s",
            delay(low),
            delay(high)
        );
    }
    let changes = moving.stretches.len().saturating_sub(1);
    if changes >= NAMED {
        return format!(
            "{intro}: it changes {changes} times; {} s or less for 5 % of the time, {} s for half of it, {} s for 95 %",
            delay(low),
            delay(middle),
            delay(high)
        );
    }
    let part = |(i, s): (usize, &AtOneDelay)| {
        let next = moving.stretches.get(i + 1).filter(|n| n.record == s.record);
        let first = i == 0 || moving.stretches[i - 1].record != s.record;
        let which = if records > 1 && first {
            format!("in record {} ", s.record + 1)
        } else {
            String::new()
        };
        let value = format!(
            "{which}{} s ({} to {} s)",
            delay(s.delay_s),
            delay(s.ci95_s[0]),
            delay(s.ci95_s[1])
        );
        match (next.and_then(|n| n.from_ci95_s), first) {
            (Some([a, b]), _) => {
                format!("{value} until {} s ({} to {} s)", time(s.to_s), time(a), time(b))
            }
            (None, true) => value,
            (None, false) => format!("{value} from then on"),
        }
    };
    format!(
        "{intro}: {}",
        moving.stretches.iter().enumerate().map(part).collect::<Vec<_>>().join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_in_which_the_input_rests_has_no_delay_of_its_own() {
        let mut u = vec![0.0; 100];
        u[40..].fill(1.0);
        let stretch =
            |from, to, delay| Stretch { record: 0, samples: from..to, began: None, delay };
        let one_step = [Record::new(u.clone(), vec![0.0; 100])];
        let stretches = [stretch(0, 60, 10), stretch(60, 100, 15)];
        assert!(!moves_throughout(&one_step, &stretches));
        u[70..].fill(0.0);
        let two_steps = [Record::new(u.clone(), vec![0.0; 100])];
        assert!(moves_throughout(&two_steps, &stretches));
        // By its own delay the second step no longer belongs to any stretch.
        let late = [stretch(0, 60, 10), stretch(60, 100, 60)];
        assert!(!moves_throughout(&two_steps, &late));
    }
}

//! Events paired at each offset.

use super::times::Events;
use crate::correlation::generalised::real;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{Search, long_enough};
use crate::experiment::Experiment;
use crate::method::Law;
use crate::posterior;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;
use deadtime_signal::stats::students_t;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

/// The treatment of sequences in different units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// Refuse them: differences of times in different units are meaningless.
    #[default]
    Refuse,
    /// Convert the second sequence to the unit of the first, by the intervals' standard deviation and then by the slope of the paired times. Both clocks must
    /// begin at the same instant; the slope's uncertainty widens the interval.
    Standardise,
}

/// Why no criterion is invariant to magnitudes.
pub(crate) const NO_MAGNITUDES: &[(Law, &str)] = &[
    (Law::Gain, "times have no gain: a factor on one sequence is another unit"),
    (Law::Sign, "times have no sign: turned round they are another sequence"),
    (Law::Exact, "there is no plant between two sensors"),
    (
        Law::Silence,
        "sequences of events are no samples of noise; unrelated sequences have a test of their own",
    ),
    (Law::Window, "offsets that put the mean delay outside the window are not tried at all"),
];

/// Intervals that an offset must pair.
pub(super) const LEAST: usize = 10;

/// Share of a typical interval within which two times belong to one event.
pub(super) const GATE: f64 = 0.25;

/// Standard deviations of Fisher's z within which another offset is equally good.
pub(super) const ALIKE: f64 = 3.0;

/// Blocks of a long sequence: enough to estimate the correlation of neighbours, few enough for sums over all lags.
pub(super) const BLOCKS: usize = 4096;

/// Another offset counts as equally close up to this multiple of the best offset's typical interval difference.
pub(super) const AS_CLOSE: f64 = 3.0;

/// Standard deviations (from the median of absolute deviations) beyond which a paired time belongs to another event.
pub(super) const STRAY: f64 = 6.0;

/// Median of the absolute deviations of a normal number, over its standard deviation.
pub(super) const MEDIAN_DEVIATION: f64 = 0.6745;

/// The events that one offset pairs.
pub(crate) struct Paired<'a> {
    pub(super) first: &'a [f64],
    pub(super) second: &'a [f64],
}

impl<'a> Paired<'a> {
    /// T(i + k) paired with t(i), for all i at which both exist.
    fn new(events: (&'a [f64], &'a [f64]), k: isize) -> Self {
        let (from, shift) = (k.min(0).unsigned_abs(), k.max(0).unsigned_abs());
        let (first, second) =
            (events.0.get(from..).unwrap_or_default(), events.1.get(shift..).unwrap_or_default());
        let n = first.len().min(second.len());
        Self { first: &first[..n], second: &second[..n] }
    }

    /// Δ(i + k, i).
    pub(crate) fn delays(&self) -> impl Iterator<Item = f64> {
        self.second.iter().zip(self.first).map(|(b, a)| b - a)
    }

    /// (ΔT(i + k), Δt(i)).
    pub(crate) fn intervals(&self) -> impl Iterator<Item = (f64, f64)> {
        self.second.windows(2).zip(self.first.windows(2)).map(|(b, a)| (b[1] - b[0], a[1] - a[0]))
    }

    /// Δ(i + k, i) − Δ(i + k − 1, i − 1) = ΔT(i + k) − Δt(i).
    pub(crate) fn differences(&self) -> impl Iterator<Item = f64> {
        self.intervals().map(|(b, a)| b - a)
    }

    /// ⟨ΔT·Δt⟩ − ⟨ΔT⟩⟨Δt⟩ over the root of the variances; 0 where an interval never varies.
    pub(crate) fn correlation(&self) -> f64 {
        let n = real(self.first.len().saturating_sub(1).max(1));
        let (b, a) = self.intervals().fold((0.0, 0.0), |s, (b, a)| (s.0 + b / n, s.1 + a / n));
        let (bb, aa, ba) = self.intervals().fold((0.0, 0.0, 0.0), |s, (y, x)| {
            let (y, x) = (y - b, x - a);
            (s.0 + y * y, s.1 + x * x, s.2 + y * x)
        });
        // Intervals that vary by rounding alone do not vary.
        if bb > n * (1e-9 * b).powi(2) && aa > n * (1e-9 * a).powi(2) {
            (ba / (bb * aa).sqrt()).clamp(-1.0, 1.0)
        } else {
            0.0
        }
    }

    /// Fisher's z of the correlation, in standard deviations.
    fn strength(&self) -> f64 {
        let n = real(self.first.len().saturating_sub(1));
        self.correlation().min(1.0 - 1e-12).atanh() * (n - 3.0).max(0.0).sqrt()
    }

    /// The correlation of the intervals exceeds the best of this many offsets, `k`, by chance.
    fn correlated(&self, k: isize, offsets: usize) -> Result<(), (Outcome, Message)> {
        let correlation = self.correlation();
        if correlation == 0.0 {
            let note = "the intervals between events never vary: every offset fits alike";
            return Err((Outcome::NotRichEnough, note.into()));
        }
        let limit = Normal::new(0.0, 1.0)
            .map_or(f64::INFINITY, |n| n.inverse_cdf(1.0 - 0.01 / real(offsets)));
        if self.strength() < limit {
            let note = format!(
                "the intervals of the two sequences are not alike at the best offset ({k}: correlation {correlation:.2}, {limit:.1} standard deviations of chance needed): they do not show the same events, or too many are missing"
            );
            return Err((Outcome::NotVisible, note.into()));
        }
        Ok(())
    }

    /// The typical delay and the typical interval difference of the half of the events whose intervals agree most.
    fn typical(&self) -> [f64; 2] {
        let mut both: Vec<(f64, f64)> =
            self.differences().map(f64::abs).zip(self.delays().skip(1)).collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both.truncate(both.len().div_ceil(2));
        [median(both.iter().map(|b| b.1).collect()), median(both.iter().map(|b| b.0).collect())]
    }
}

pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    stats::mean(values).unwrap_or(0.0)
}

/// ⟨v²⟩ − ⟨v⟩², by deviations from the mean.
pub(crate) fn variance<I: Iterator<Item = f64>>(values: impl Fn() -> I) -> f64 {
    let centre = mean(values());
    mean(values().map(|v| (v - centre).powi(2)))
}

pub(super) fn median(values: Vec<f64>) -> f64 {
    stats::median(values).unwrap_or(0.0)
}

/// Refuses unusable sequences.
pub(super) fn check(
    method: &'static str,
    units: Units,
    experiment: &Experiment,
) -> Result<(), DelayError> {
    if experiment.events().is_empty() {
        return Err(DelayError::Count { what: "sequences of event times", needed: 1, got: 0 });
    }
    for events in experiment.events() {
        if let ([Some(first), Some(second)], Units::Refuse) = (&events.units, units)
            && first != second
        {
            return Err(DelayError::Units { first: first.clone(), second: second.clone() });
        }
    }
    let got = experiment.events().iter().map(Events::possible).max().unwrap_or(0);
    long_enough(method, LEAST + 2, got, LengthRemedy::Events)
}

/// The delay by the offset with the smallest criterion.
pub(crate) fn by_offset(
    method: &'static str,
    units: Units,
    criterion: fn(&Paired<'_>) -> f64,
    experiment: &Experiment,
    search: &Search,
) -> Result<DelayEstimate, DelayError> {
    check(method, units, experiment)?;
    let window = experiment.sample_time().to_seconds(real(search.max_delay));
    let long = experiment.events().iter().filter(|e| e.possible() >= LEAST + 2);
    let answers: Vec<Answer> = long.map(|e| one(e, units, criterion, window)).collect();
    Ok(combined(&answers, window))
}

/// The estimate from one pair of sequences.
pub(super) struct Shown {
    /// Mean delay of the events paired by time.
    delay: f64,
    /// Its variance.
    variance: f64,
    /// Mean delay at the best offset, missed events included: the criterion's own estimate.
    raw: f64,
    note: Option<String>,
}

/// The estimate, or why there is none.
pub(super) type Answer = Result<Shown, (Outcome, Message)>;

pub(super) fn one(
    events: &Events,
    units: Units,
    criterion: fn(&Paired<'_>) -> f64,
    window: f64,
) -> Answer {
    let other_units =
        units == Units::Standardise && matches!(&events.units, [Some(a), Some(b)] if a != b);
    let first = &events.first[..];
    let scaled: Vec<f64>;
    let mut second = &events.second[..];
    if other_units {
        let spread = |times: &[f64]| variance(|| times.windows(2).map(|w| w[1] - w[0])).sqrt();
        let scale = spread(first) / spread(second).max(f64::MIN_POSITIVE);
        scaled = second.iter().map(|t| t * scale).collect();
        second = &scaled;
    }
    let matched = match Matched::of(
        first,
        second,
        criterion,
        if other_units { None } else { Some(window) },
    ) {
        Ok(matched) => matched,
        Err(without) => return by_rows(events).ok_or(without),
    };
    let raw = mean(matched.pairs.delays());
    let by_time = &matched.by_time;
    let note = (by_time.len() < first.len().max(second.len())).then(|| {
        format!("{} events paired, of {} and {}", by_time.len(), first.len(), second.len())
    });
    let (delay, variance) = if other_units { along_a_line(by_time) } else { across(by_time) };
    Ok(Shown { delay, variance, raw, note })
}

/// The delays of the events that the record itself pairs, where nearly constant intervals do not distinguish the offsets; `None` where nothing pairs them, or the
/// typical delay of a part of the record is nearer to a shift by an interval than to that of the whole: a row then holds two events.
pub(super) fn rows(events: &Events) -> Option<&[f64]> {
    let usable = |d: &&[f64]| d.len() > LEAST && d.iter().all(|delay| delay.is_finite());
    let delays = events.in_rows.as_deref().filter(usable)?;
    let typical = median(delays.to_vec());
    let interval = median(events.first.windows(2).map(|w| w[1] - w[0]).collect());
    let steady = |part: &[f64]| (median(part.to_vec()) - typical).abs() <= 0.5 * interval;
    delays.chunks(delays.len().div_ceil(PARTS)).all(steady).then_some(delays)
}

/// The estimate from the rows.
fn by_rows(events: &Events) -> Option<Shown> {
    let pairs: Vec<(f64, f64)> = rows(events)?.iter().map(|delay| (0.0, *delay)).collect();
    let (delay, variance) = across(&pairs);
    let note = "the intervals do not distinguish the offsets; the rows pair the events";
    Some(Shown { delay, variance, raw: delay, note: Some(note.to_owned()) })
}

/// Parts of the sequence whose typical delays are compared: a missed event shifts all later pairs by an interval.
pub(super) const PARTS: usize = 8;

/// The pairing of the events at the two places.
pub(super) struct Matched<'a> {
    /// By the best offset, missed events included.
    pub(super) pairs: Paired<'a>,
    /// By time: each with its neighbour at the typical delay, strays left out.
    pub(super) by_time: Vec<(f64, f64)>,
    /// The delay of the half of the events whose intervals agree most.
    pub(super) typical: f64,
    /// The distance from the typical delay within which two times belong to one event.
    pub(super) gate: f64,
}

impl<'a> Matched<'a> {
    /// By the offset with the smallest criterion. Errors: why there is none.
    pub(super) fn of(
        first: &'a [f64],
        second: &'a [f64],
        criterion: fn(&Paired<'_>) -> f64,
        window: Option<f64>,
    ) -> Result<Self, (Outcome, Message)> {
        let typical_interval = median(first.windows(2).map(|w| w[1] - w[0]).collect());
        let offsets = offsets(first, second, window, typical_interval);
        let paired = |k: isize| Paired::new((first, second), k);
        let Some(best) = offsets
            .iter()
            .map(|&k| (criterion(&paired(k)), k))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|b| b.1)
        else {
            let note = Message::from("no offset puts the second sequence behind the first by a delay of the window: search a longer ")
                .and(Remedy::MaxDelay)
                .and(", or swap them");
            return Err((Outcome::NotVisible, note));
        };
        let pairs = paired(best);
        pairs.correlated(best, offsets.len())?;
        let [typical, apart] = pairs.typical();
        let gate = GATE * typical_interval;
        let least = pairs.strength() - ALIKE * std::f64::consts::SQRT_2;
        let mut alternatives =
            offsets.iter().filter(|&&k| k != best && paired(k).strength() > least);
        let elsewhere = |k: &&isize| {
            let [delay, difference] = paired(**k).typical();
            (delay - typical).abs() > gate && difference <= AS_CLOSE * apart
        };
        if let Some(k) = alternatives.find(elsewhere) {
            let note = format!("offsets {best} and {k} pair the events equally well");
            return Err((Outcome::Flat, note.into()));
        }
        let by_time = partners(first, second, typical, gate);
        let possible = first.len().min(second.len());
        if by_time.len() < LEAST || 2 * by_time.len() < possible {
            let note = format!(
                "only {} of {possible} events have a partner {typical:.6} later",
                by_time.len()
            );
            return Err((Outcome::NotVisible, note.into()));
        }
        Ok(Self { pairs, by_time, typical, gate })
    }
}

/// The offsets that pair enough intervals; their mean delay lies within half an interval of the window, where there is one.
pub(super) fn offsets(
    first: &[f64],
    second: &[f64],
    window: Option<f64>,
    interval: f64,
) -> Vec<isize> {
    let sums = |times: &[f64]| -> Vec<f64> {
        let mut sum = 0.0;
        std::iter::once(0.0)
            .chain(times.iter().map(|t| {
                sum += t - times[0];
                sum
            }))
            .collect()
    };
    let (of_first, of_second) = (sums(first), sums(second));
    let start = second[0] - first[0];
    let most = |n: usize| isize::try_from(n.saturating_sub(LEAST + 1)).unwrap_or(0);
    // Without a window, as many offsets as the default one has lags.
    let (from, to) = if window.is_some() {
        (-most(first.len()), most(second.len()))
    } else {
        (-most(first.len()).min(35), most(second.len()).min(35))
    };
    (from..=to)
        .filter(|&k| {
            let (a, b) = (k.min(0).unsigned_abs(), k.max(0).unsigned_abs());
            let n = (first.len() - a).min(second.len() - b);
            let delay =
                (of_second[b + n] - of_second[b] - of_first[a + n] + of_first[a]) / real(n) + start;
            n > LEAST
                && window.is_none_or(|w| (-0.5 * interval..=w + 0.5 * interval).contains(&delay))
        })
        .collect()
}

/// Pairs every event of the first sequence with the nearest one of the second about `delay` later. Each event is used once; strays are left out.
pub(super) fn partners(first: &[f64], second: &[f64], delay: f64, gate: f64) -> Vec<(f64, f64)> {
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    let mut j = 0;
    for &t in first {
        while j + 1 < second.len()
            && (second[j + 1] - t - delay).abs() <= (second[j] - t - delay).abs()
        {
            j += 1;
        }
        let Some(&nearest) = second.get(j) else { break };
        if (nearest - t - delay).abs() <= gate {
            match pairs.last_mut() {
                // One event cannot pair with two: the nearer one is kept.
                Some(last) if last.1 == nearest => {
                    if (nearest - t - delay).abs() < (last.1 - last.0 - delay).abs() {
                        *last = (t, nearest);
                    }
                }
                _ => pairs.push((t, nearest)),
            }
        }
    }
    let of = |p: &(f64, f64)| p.1 - p.0;
    let centre = median(pairs.iter().map(of).collect());
    let deviation =
        median(pairs.iter().map(|p| (of(p) - centre).abs()).collect()) / MEDIAN_DEVIATION;
    if deviation > 0.0 {
        pairs.retain(|p| (of(p) - centre).abs() <= STRAY * deviation);
    }
    pairs
}

/// Mean difference and its variance, with the number of independent values.
pub(super) fn across(pairs: &[(f64, f64)]) -> (f64, f64) {
    let delay = mean(pairs.iter().map(|p| p.1 - p.0));
    let rest: Vec<f64> = pairs.iter().map(|p| p.1 - p.0 - delay).collect();
    (delay, variance_of_mean(&rest, 1.0))
}

/// Variance of the mean of correlated values, `fitted` of them spent on a fit. The variance is that of block means, with the number of independent blocks.
pub(super) fn variance_of_mean(rest: &[f64], fitted: f64) -> f64 {
    let blocks: Vec<f64> = rest
        .chunks(rest.len().div_ceil(BLOCKS).max(1))
        .map(|block| mean(block.iter().copied()))
        .collect();
    let freedom = (real(blocks.len()) - fitted).max(1.0);
    blocks.iter().map(|b| b * b).sum::<f64>() / freedom / posterior::effective_samples(&blocks)
}

/// The same by the straight line T = a·t + b: b/a at the common start of both clocks, and its variance.
pub(super) fn along_a_line(pairs: &[(f64, f64)]) -> (f64, f64) {
    let (t, big) = (mean(pairs.iter().map(|p| p.0)), mean(pairs.iter().map(|p| p.1)));
    let spread: f64 = pairs.iter().map(|p| (p.0 - t).powi(2)).sum();
    let slope =
        pairs.iter().map(|p| (p.0 - t) * (p.1 - big)).sum::<f64>() / spread.max(f64::MIN_POSITIVE);
    let rest: Vec<f64> = pairs.iter().map(|p| p.1 - big - slope * (p.0 - t)).collect();
    let noise = variance_of_mean(&rest, 2.0) / (slope * slope);
    // b/a = T̄/a − t̄, in the first sequence's unit: its slope error acts on T̄/a.
    (big / slope - t, noise * (1.0 + real(rest.len()) * (big / slope).powi(2) / spread))
}

/// All recordings together, weighted by their inverse variances.
pub(super) fn combined(answers: &[Answer], window: f64) -> DelayEstimate {
    let found: Vec<&Shown> = answers.iter().filter_map(|a| a.as_ref().ok()).collect();
    let Some(most_certain) = found.iter().min_by(|a, b| a.variance.total_cmp(&b.variance)) else {
        let (outcome, note) = answers
            .iter()
            .find_map(|a| a.as_ref().err())
            .cloned()
            .unwrap_or((Outcome::NotVisible, "no events".into()));
        return DelayEstimate::without(outcome, note);
    };
    // Times that agree to rounding have at least this variance.
    let least = (ROUNDING * most_certain.delay.abs().max(window)).powi(2);
    let weight = |a: &Shown| 1.0 / a.variance.max(least);
    let total: f64 = found.iter().map(|a| weight(a)).sum();
    let weighted =
        |f: &dyn Fn(&Shown) -> f64| found.iter().map(|a| weight(a) * f(a)).sum::<f64>() / total;
    let (delay, raw, std) = (weighted(&|a| a.delay), weighted(&|a| a.raw), (1.0 / total).sqrt());
    let quantile = students_t(0.975, real(LEAST)).unwrap_or(f64::INFINITY);
    let ends = [delay - quantile * std, delay + quantile * std];
    if ends[1] < 0.0 {
        return DelayEstimate::without(
            Outcome::NotApplicable,
            format!("the second place sees the events first, by {:.6} s: exchange the two", -delay),
        );
    }
    let outcome = if delay > window { Outcome::AtEdge } else { Outcome::Found };
    let estimate = DelayEstimate {
        delay_s: Some(delay.max(0.0)),
        std_s: Some(std),
        ci95_s: Some(ends.map(|d| d.max(0.0))),
        raw_delay_s: Some(raw),
        ..DelayEstimate::bare(outcome)
    };
    let refused = answers.len() - found.len();
    let estimate = estimate.noting(
        (refused > 0).then(|| format!("{refused} of {} recordings show no delay", answers.len())),
    );
    let notes: Vec<String> = found.iter().filter_map(|a| a.note.clone()).collect();
    estimate.noting((!notes.is_empty()).then(|| notes.join("; ")))
}

/// Share of a time below which differences are rounding.
pub(super) const ROUNDING: f64 = 1e-12;

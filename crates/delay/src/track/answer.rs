//! The report of a time-varying delay, in seconds, as in `deadtime/estimate@1`.

use serde::Serialize;

use super::smooth::{Drift, Track};
use super::watch::Watched;
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// A delay that changes within a record, or between records.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moving {
    /// The kind of change.
    pub kind: Kind,
    /// Stretches of constant delay, in order.
    pub stretches: Vec<AtOneDelay>,
    /// Rate of a drift, s/s.
    pub rate: Option<f64>,
    /// The 5, 50 and 95 % quantiles of the delay over time, s.
    pub quantiles_s: [f64; 3],
    /// Gain in log-likelihood of the changes over one delay, minus their penalties.
    pub gain: f64,
}

/// The kind of a change of the delay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// From one value to another.
    Jumps,
    /// At a constant rate.
    Drifts,
}

/// A stretch of constant delay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtOneDelay {
    /// Record, counted from 0.
    pub record: usize,
    /// Its beginning, s from the record's first sample.
    pub from_s: f64,
    /// The 95 % interval of the beginning; `null` where the record begins.
    pub from_ci95_s: Option<[f64; 2]>,
    /// Its end, s from the record's first sample.
    pub to_s: f64,
    /// The dead time, s.
    pub delay_s: f64,
    /// Its 95 % interval, s.
    pub ci95_s: [f64; 2],
}

/// The dead time against time, one entry for each sample with a delay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracked {
    /// Record, counted from 0.
    pub record: Vec<usize>,
    /// Time from the record's first sample, s.
    pub time_s: Vec<f64>,
    /// The dead time, s.
    pub delay_s: Vec<f64>,
    /// Lower end of its 95 % band, s.
    pub low_s: Vec<f64>,
    /// Upper end of its 95 % band, s.
    pub high_s: Vec<f64>,
}

/// The dead time of the records at a given raw delay, from the methods' estimates after the changes are removed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Raw delay of the straightened records, samples.
    pub reference: f64,
    /// Their dead time, s.
    pub delay_s: f64,
    /// Its 95 % interval, s.
    pub ci95_s: [f64; 2],
}

/// Samples by which a change's interval widens at each end: around a change, input coefficients act at either the earlier or the later delay.
const AROUND: f64 = 3.0;

impl Anchor {
    /// Seconds of a raw delay.
    fn seconds(&self, raw: f64, ts: SampleTime) -> f64 {
        (self.delay_s + ts.to_seconds(raw - self.reference)).max(0.0)
    }

    /// A band of raw delays, widened by the anchor's uncertainty; the two are independent.
    fn band(&self, mean: f64, [low, high]: [f64; 2], ts: SampleTime) -> [f64; 2] {
        let [below, above] = [self.delay_s - self.ci95_s[0], self.ci95_s[1] - self.delay_s];
        let at = self.delay_s + ts.to_seconds(mean - self.reference);
        let down = below.hypot(ts.to_seconds((mean - low).max(0.0)));
        let up = above.hypot(ts.to_seconds((high - mean).max(0.0)));
        [(at - down).max(0.0), (at + up).max(0.0)]
    }
}

/// The track in seconds.
#[must_use]
pub fn tracked(track: &Track, anchor: &Anchor, ts: SampleTime) -> Tracked {
    let bands = track.mean.iter().zip(&track.band).map(|(m, b)| anchor.band(*m, *b, ts));
    let (low_s, high_s) = bands.map(|b| (b[0], b[1])).unzip();
    Tracked {
        record: track.at.iter().map(|a| a.0).collect(),
        time_s: track.at.iter().map(|a| ts.to_seconds(a.1 as f64)).collect(),
        delay_s: track.mean.iter().map(|m| anchor.seconds(*m, ts)).collect(),
        low_s,
        high_s,
    }
}

impl Moving {
    /// The watched records, of given lengths, in seconds; `bias`: samples after which the plant responds without any dead time.
    #[must_use]
    pub fn new(
        seen: &Watched,
        track: &Track,
        drift: Option<Drift>,
        anchor: &Anchor,
        lengths: &[usize],
        bias: usize,
        ts: SampleTime,
    ) -> Self {
        let found = seen.stretches();
        let drift = drift.filter(|d| seen.line.is_some() || d.gain > seen.gain);
        let time = |sample: f64| ts.to_seconds((sample - bias as f64).max(0.0));
        let mut stretches: Vec<AtOneDelay> = Vec::with_capacity(found.len());
        for (s, stretch) in found.iter().enumerate() {
            // Away from the ends, which are uncertain.
            let from = stretch.began.map_or(stretch.samples.start, |b| b[1]);
            let next = found.get(s + 1).filter(|n| n.record == stretch.record);
            let to = next.and_then(|n| n.began).map_or(stretch.samples.end, |b| b[0]);
            let range = if from < to { from..to } else { stretch.samples.clone() };
            let rows = || {
                track
                    .at
                    .iter()
                    .enumerate()
                    .filter(|(_, at)| at.0 == stretch.record && range.contains(&at.1))
                    .map(|(i, _)| i)
            };
            let middle = |of: &dyn Fn(usize) -> f64| {
                stats::median(rows().map(of).collect()).unwrap_or(stretch.delay as f64)
            };
            let raw = middle(&|i| track.mean[i]);
            let band = [middle(&|i| track.band[i][0]), middle(&|i| track.band[i][1])];
            let from_s = stretch.began.map_or(0.0, |_| time(stretch.samples.start as f64));
            if let Some(before) = stretches.last_mut().filter(|b| b.record == stretch.record) {
                before.to_s = from_s;
            }
            stretches.push(AtOneDelay {
                record: stretch.record,
                from_s,
                from_ci95_s: stretch
                    .began
                    .map(|b| [time(b[0] as f64 - AROUND), time(b[1] as f64 + AROUND)]),
                to_s: ts.to_seconds(
                    lengths.get(stretch.record).copied().unwrap_or(stretch.samples.end) as f64,
                ),
                delay_s: anchor.seconds(raw, ts),
                ci95_s: anchor.band(raw, band, ts),
            });
        }
        let quantile = |q: f64| {
            anchor.seconds(stats::quantile(&track.mean, q).unwrap_or(anchor.reference), ts)
        };
        Self {
            kind: if drift.is_some() { Kind::Drifts } else { Kind::Jumps },
            rate: drift.map(|d| d.rate),
            quantiles_s: [quantile(0.05), quantile(0.5), quantile(0.95)],
            gain: drift.map_or(seen.gain, |d| d.gain),
            stretches,
        }
    }
}

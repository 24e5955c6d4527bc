//! A growing log, converted row by row into the even samples of a tracker, and the events to report.
//!
//! Wrong when: most time steps differ from one another by more than half of their median; no sample time then exists.

use std::collections::VecDeque;

use crate::track::tracker::online::{Alarm, Tracker};
use crate::track::tracker::options::TrackerOptions;
use deadtime_log::neighbours;
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// Rows from which the sample time is estimated.
const FIRST: usize = 100;
/// Share of a row's distance from the grid by which grid and step follow (critically damped). A slightly fast clock of the log then causes no extra rows.
const FOLLOWED: f64 = 0.02;
const STEP_FOLLOWED: f64 = FOLLOWED * FOLLOWED / 4.0;
/// Number of missing rows after which the grid restarts.
const ANEW: f64 = 10.0;
/// Number of stored time stamps, for the start of a change.
const STAMPS: usize = 1 << 16;
/// Samples after an alarm until the band surrounds the alarm's delay.
const SETTLING: usize = 200;
/// A dead time has moved where its band is below this width, samples, and excludes the reported one for this number of samples. At a jump the band is wide.
const NARROW: f64 = 5.0;
const HELD: usize = 100;

/// The configuration for watching a growing log.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LiveOptions {
    /// Longest dead time, s; default: that of `tracker`.
    pub max_delay_s: Option<f64>,
    /// The tracker's options. `learn` and `forget` are raised to the values that the search window needs.
    pub tracker: TrackerOptions,
}

/// An event.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Told {
    /// The sample time is known, and the response is being identified.
    Learning {
        /// Time of the row, s.
        time_s: f64,
        /// From sample to sample, s.
        sample_time_s: f64,
        /// Longest dead time that is searched, s.
        max_delay_s: f64,
    },
    /// The response is identified; the first dead time.
    Delay {
        /// Time of the row, s.
        time_s: f64,
        /// The dead time, s.
        delay_s: f64,
        /// Its 95 % band, s.
        ci95_s: [f64; 2],
    },
    /// The dead time changed.
    DelayChanged {
        /// Time of the row, s.
        time_s: f64,
        /// Dead time before, s.
        from_s: f64,
        /// Dead time now, s.
        to_s: f64,
        /// Time of the first row with the new dead time, s; `None`: earlier than the stored stamps.
        since_s: Option<f64>,
    },
    /// The dead time moved gradually out of the band reported last.
    DelayMoved {
        /// Time of the row, s.
        time_s: f64,
        /// The dead time reported before, s.
        from_s: f64,
        /// The dead time, s.
        delay_s: f64,
        /// Its 95 % band, s.
        ci95_s: [f64; 2],
    },
    /// No dead time explains the response any more; it is identified again.
    ResponseChanged {
        /// Time of the row, s.
        time_s: f64,
        /// Time of the first row with the new response, s; `None`: earlier than the stored stamps.
        since_s: Option<f64>,
    },
    /// Rows are missing, and with them the command. Reports resume once the command is known over the whole search window.
    RowsMissing {
        /// Time of the last row before the gap, s.
        from_s: f64,
        /// Time of the first row after the gap, s.
        to_s: f64,
    },
}

/// Takes the rows of a log and returns events.
#[derive(Debug, Clone)]
pub struct Live {
    options: LiveOptions,
    stage: LiveStage,
}

#[derive(Debug, Clone)]
enum LiveStage {
    First(Vec<Sample>),
    Running(Box<Running>),
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    time_s: f64,
    u: Option<f64>,
    y: Option<f64>,
}

#[derive(Debug, Clone)]
struct Running {
    tracker: Tracker,
    ts: SampleTime,
    /// The grid's step, s: the sample time of the stamps so far.
    step_s: f64,
    /// Samples after a missing command until its effects have passed.
    window: usize,
    /// The last sample on the grid, s.
    grid_s: f64,
    /// Its stamp, s.
    at_s: f64,
    /// The command held where the command is missing.
    u: f64,
    /// Samples until the command is known again over the whole window.
    blind: usize,
    pushed: u64,
    /// Stamps of the last samples.
    stamps: VecDeque<f64>,
    reported: Option<(f64, [f64; 2])>,
    /// Samples for which the band has excluded the delay reported.
    outside: usize,
    /// Dead time of an alarm, and the samples since.
    alarmed: Option<(f64, usize)>,
    extra: u64,
}

impl Live {
    /// A watcher without data.
    #[must_use]
    pub fn new(options: LiveOptions) -> Self {
        Self { options, stage: LiveStage::First(Vec::new()) }
    }

    /// Takes a row: its time, s, later than that of the previous row; the command and the response, `None` where missing.
    ///
    /// # Errors
    /// [`crate::error::DelayError`] for an option out of its range, once the sample time is known, and for a value that is not finite.
    pub fn push(
        &mut self,
        time_s: f64,
        u: Option<f64>,
        y: Option<f64>,
    ) -> crate::error::Result<Vec<Told>> {
        let sample = Sample { time_s, u, y };
        let mut reported = Vec::new();
        match &mut self.stage {
            LiveStage::First(first) => {
                first.push(sample);
                if first.len() >= FIRST {
                    let first = std::mem::take(first);
                    let mut running = Running::new(&self.options, &first, &mut reported)?;
                    for sample in first {
                        running.take(sample, &mut reported)?;
                    }
                    self.stage = LiveStage::Running(Box::new(running));
                }
            }
            LiveStage::Running(running) => running.take(sample, &mut reported)?,
        }
        Ok(reported)
    }

    /// Discards all data: the recorder restarted.
    pub fn restart(&mut self) {
        self.stage = LiveStage::First(Vec::new());
    }

    /// Rows between two samples of the grid, which were left out.
    #[must_use]
    pub fn extra(&self) -> u64 {
        if let LiveStage::Running(running) = &self.stage { running.extra } else { 0 }
    }

    /// The response is identified.
    #[must_use]
    pub fn has_learnt(&self) -> bool {
        matches!(&self.stage, LiveStage::Running(r) if r.reported.is_some() || r.alarmed.is_some())
    }
}

/// The mean of the steps within half of their median around it: stamps may be rounded, and rows may be missing.
fn step_s(first: &[Sample]) -> f64 {
    let stamps: Vec<f64> = first.iter().map(|s| s.time_s).collect();
    let mut steps: Vec<f64> = neighbours(&stamps).map(|(before, after)| after - before).collect();
    let middle = steps.len() / 2;
    let median = if steps.is_empty() {
        0.0
    } else {
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let near = steps.into_iter().filter(|s| (s - median).abs() <= 0.5 * median);
    stats::mean(near).unwrap_or(0.0)
}

impl Running {
    fn new(
        options: &LiveOptions,
        first: &[Sample],
        reported: &mut Vec<Told>,
    ) -> crate::error::Result<Self> {
        let ts = SampleTime::new(step_s(first))?;
        let mut tracker = options.tracker.clone();
        if let Some(max_s) = options.max_delay_s {
            // Beyond its range the tracker returns an error.
            tracker.max_delay =
                (max_s / ts.seconds()).ceil().clamp(0.0, 1e6) as usize + tracker.bias;
        }
        tracker.learn = tracker.learn.max(2 * (tracker.na + tracker.nb + tracker.max_delay + 2));
        tracker.forget = tracker.forget.max(tracker.learn);
        let (window, time_s) =
            (tracker.max_delay + tracker.nb, first.last().map_or(0.0, |s| s.time_s));
        let max_delay_s = ts.to_seconds(tracker.max_delay.saturating_sub(tracker.bias) as f64);
        reported.push(Told::Learning { time_s, sample_time_s: ts.seconds(), max_delay_s });
        Ok(Self {
            tracker: Tracker::new(ts, tracker)?,
            ts,
            step_s: ts.seconds(),
            window,
            grid_s: first.first().map_or(0.0, |s| s.time_s - ts.seconds()),
            at_s: first.first().map_or(0.0, |s| s.time_s),
            u: first.iter().find_map(|s| s.u).unwrap_or(0.0),
            blind: 0,
            pushed: 0,
            stamps: VecDeque::new(),
            reported: None,
            outside: 0,
            alarmed: None,
            extra: 0,
        })
    }

    /// Puts a row onto the grid.
    fn take(&mut self, sample: Sample, reported: &mut Vec<Told>) -> crate::error::Result<()> {
        let ts_s = self.step_s;
        let steps = ((sample.time_s - self.grid_s) / ts_s).round();
        if steps < 1.0 {
            self.extra += 1;
            return Ok(());
        }
        let missing = steps - 1.0;
        if missing >= self.window as f64 {
            reported.push(Told::RowsMissing { from_s: self.at_s, to_s: sample.time_s });
        }
        // Gaps longer than the window count as the window.
        let held = missing.min(self.window as f64) as usize;
        for k in (1..=held).rev() {
            self.blind = self.window;
            self.one(sample.time_s - k as f64 * ts_s, self.u, None, reported)?;
        }
        let due_s = self.grid_s + steps * ts_s;
        if missing >= ANEW {
            self.grid_s = sample.time_s;
        } else {
            self.grid_s = due_s + FOLLOWED * (sample.time_s - due_s);
            self.step_s += STEP_FOLLOWED * (sample.time_s - due_s);
        }
        self.at_s = sample.time_s;
        match sample.u {
            Some(u) => self.u = u,
            None => self.blind = self.window,
        }
        self.one(sample.time_s, self.u, sample.y, reported)
    }

    /// A sample of the grid.
    fn one(
        &mut self,
        time_s: f64,
        u: f64,
        y: Option<f64>,
        reported: &mut Vec<Told>,
    ) -> crate::error::Result<()> {
        let known = self.blind == 0;
        self.blind = self.blind.saturating_sub(1);
        if self.stamps.len() == STAMPS {
            self.stamps.pop_front();
        }
        self.stamps.push_back(time_s);
        self.pushed += 1;
        let tracking = self.tracker.push(u, y.filter(|_| known))?;
        match tracking.alarm {
            Some(Alarm::DelayChanged { from_s, to_s, since_s }) => {
                let since_s = self.stamp(since_s);
                reported.push(Told::DelayChanged { time_s, from_s, to_s, since_s });
                (self.alarmed, self.outside) = (Some((to_s, 0)), 0);
            }
            Some(Alarm::ResponseChanged { since_s }) => {
                reported.push(Told::ResponseChanged { time_s, since_s: self.stamp(since_s) });
                (self.reported, self.alarmed) = (None, None);
            }
            None => {}
        }
        if let (Some(delay_s), Some(ci95_s)) = (tracking.delay_s, tracking.band_s) {
            self.follow(time_s, delay_s, ci95_s, reported);
        }
        Ok(())
    }

    /// Reports the delay of a sample where it differs from the last report.
    fn follow(&mut self, time_s: f64, delay_s: f64, ci95_s: [f64; 2], reported: &mut Vec<Told>) {
        let narrow = ci95_s[1] - ci95_s[0] <= self.ts.to_seconds(NARROW);
        match (self.alarmed, self.reported) {
            (Some((to_s, _)), _) if (delay_s - to_s).abs() <= self.ts.seconds() => {
                (self.reported, self.alarmed) = (Some((delay_s, ci95_s)), None);
            }
            (Some((to_s, SETTLING..)), _) if narrow => {
                self.moved(time_s, to_s, delay_s, ci95_s, reported)
            }
            (Some((to_s, samples)), _) => self.alarmed = Some((to_s, samples + 1)),
            (None, None) => {
                reported.push(Told::Delay { time_s, delay_s, ci95_s });
                self.reported = Some((delay_s, ci95_s));
            }
            (None, Some((from_s, [low, high]))) => {
                let apart = narrow && (ci95_s[0] > high || ci95_s[1] < low);
                self.outside = if apart { self.outside + 1 } else { 0 };
                if self.outside >= HELD {
                    self.moved(time_s, from_s, delay_s, ci95_s, reported);
                }
            }
        }
    }

    fn moved(
        &mut self,
        time_s: f64,
        from_s: f64,
        delay_s: f64,
        ci95_s: [f64; 2],
        reported: &mut Vec<Told>,
    ) {
        reported.push(Told::DelayMoved { time_s, from_s, delay_s, ci95_s });
        (self.reported, self.alarmed, self.outside) = (Some((delay_s, ci95_s)), None, 0);
    }

    /// The stamp of a sample given by the tracker's own time, s.
    fn stamp(&self, since_s: f64) -> Option<f64> {
        let sample = (since_s / self.ts.seconds()).round().max(0.0) as u64;
        let first = self.pushed - self.stamps.len() as u64;
        let place = usize::try_from(sample.checked_sub(first)?).ok()?;
        self.stamps.get(place).copied()
    }
}

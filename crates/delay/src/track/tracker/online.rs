//! The tracker, sample by sample.

use super::following::{Event, Following};
use super::learning::Learning;
use super::options::TrackerOptions;
use super::past::Past;
use crate::error::DelayError;
use deadtime_signal::time::SampleTime;

/// The reason of an alarm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alarm {
    /// The delay changed some samples ago.
    DelayChanged {
        /// The dead time before, s.
        from_s: f64,
        /// The dead time now, s.
        to_s: f64,
        /// Start of the change, s from the first sample.
        since_s: f64,
    },
    /// No delay explains the output any more: the plant or its noise changed. The response is identified again.
    ResponseChanged {
        /// Start of the change, s from the first sample.
        since_s: f64,
    },
}

/// The state after a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracking {
    /// The sample's time, s from the first.
    pub time_s: f64,
    /// The dead time, s; `None` while the response is identified.
    pub delay_s: Option<f64>,
    /// Its 95 % band, s: wide where the input does not move.
    pub band_s: Option<[f64; 2]>,
    /// The event at this sample.
    pub alarm: Option<Alarm>,
}

/// Tracks the dead time between a command and a response, sample by sample.
///
/// The response is identified first. The regression y(t) = Σ aᵢ·y(t−i) + Σ bⱼ·u(t−d−j) + c for every delay d uses one running Gram matrix. Then each sample
/// costs, for each delay, one error, a step of a filter over delays (the band), and one sum. The sum compares the delay with the current one (Page's CUSUM of
/// the log-likelihood ratio). The shape a, b, c is solved anew from a Gram matrix with exponential forgetting. After an alarm, all delays are compared again
/// over the last rows with the shape integrated out. A new input makes the fitted shape equally wrong in all rows. The options bound the memory, for any number
/// of samples.
///
/// Wrong when: the delay changes during identification: the first reported delay lies between, without a reported change. An input that repeats within the
/// window has aliases. A plant change may resemble another delay more than no change. While the input rests, no event is reported and the band widens.
///
/// Source: E. S. Page (1954), "Continuous inspection schemes", Biometrika 41, 100-115, doi:10.1093/biomet/41.1-2.100. Basseville and Nikiforov (1993),
/// "Detection of Abrupt Changes", section 2.2. L. Ljung (1999), "System Identification", 2nd ed., section 11.2 (forgetting).
///
/// # Example
/// ```
/// use deadtime_delay::track::{Alarm, Tracker, TrackerOptions};
/// use rand::{RngExt, SeedableRng};
/// use deadtime_signal::time::SampleTime;
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let mut tracker = Tracker::new(SampleTime::new(0.01)?, TrackerOptions::default())?;
/// let (mut sent, mut y, mut alarms) = (vec![], 0.0, vec![]);
/// for k in 0..1500 {
///     // A lag whose command comes 4 samples late, and 9 after ten seconds.
///     let late = if k < 1000 { 5 } else { 10 };
///     sent.push(if rng.random() { 1.0 } else { -1.0 });
///     y = 0.8 * y + if k >= late { sent[k - late] } else { 0.0 } + 0.1 * rng.random_range(-1.0..1.0);
///     alarms.extend(tracker.push(sent[k], Some(y))?.alarm);
/// }
/// let Alarm::DelayChanged { from_s, to_s, since_s } = alarms[0] else { panic!("{alarms:?}") };
/// assert!((from_s - 0.04).abs() < 1e-9 && (to_s - 0.09).abs() < 1e-9 && (since_s - 10.0).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Tracker {
    options: TrackerOptions,
    sample_time: SampleTime,
    /// Number of samples so far.
    count: u64,
    /// u(t), u(t−1), … and y(t−1), y(t−2), …; `None` where it was not measured.
    u: Past<f64>,
    y: Past<Option<f64>>,
    stage: Stage,
}

#[derive(Debug, Clone)]
pub(super) enum Stage {
    Learning(Learning),
    Following(Box<Following>),
}

/// Samples between two attempts to end learning.
pub(super) const TRY_EVERY: usize = 50;

impl Tracker {
    /// A tracker without data.
    ///
    /// # Errors
    /// [`DelayError::Option`] for an option out of its range.
    pub fn new(sample_time: SampleTime, options: TrackerOptions) -> Result<Self, DelayError> {
        let wrong = |option, value: usize, allowed| DelayError::Option {
            method: "tracker",
            option,
            value: value as f64,
            allowed,
        };
        for (option, value) in [("na", options.na), ("nb", options.nb)] {
            if !(1..=50).contains(&value) {
                return Err(wrong(option, value, "from 1 to 50"));
            }
        }
        if !(1..=1000).contains(&options.max_delay) {
            return Err(wrong("max_delay", options.max_delay, "from 1 to 1000"));
        }
        let least = 2 * (options.na + options.nb + options.max_delay + 2);
        if options.learn < least {
            return Err(wrong(
                "learn",
                options.learn,
                "at least twice the sum of max_delay, na, nb and 2",
            ));
        }
        if options.forget < options.learn {
            return Err(wrong("forget", options.forget, "at least `learn`"));
        }
        if !(options.alarm.is_finite() && options.alarm > 0.0) {
            return Err(DelayError::Option {
                method: "tracker",
                option: "alarm",
                value: options.alarm,
                allowed: "finite and above 0",
            });
        }
        let (u, y) = (Past::new(options.max_delay + options.nb, 0.0), Past::new(options.na, None));
        let stage = Stage::Learning(Learning::new(&options));
        Ok(Self { options, sample_time, count: 0, u, y, stage })
    }

    /// Takes the command given at this sample and the response measured at it; `None` where missing.
    ///
    /// # Errors
    /// [`DelayError::NotFinite`] for a value that is not finite; the sample is then left out.
    pub fn push(&mut self, u: f64, y: Option<f64>) -> Result<Tracking, DelayError> {
        let bad = |role, value| DelayError::NotFinite {
            role,
            channel: if role == "input" { "u" } else { "y" }.to_owned(),
            sample: usize::try_from(self.count).unwrap_or(usize::MAX),
            value,
        };
        if !u.is_finite() {
            return Err(bad("input", u));
        }
        if let Some(value) = y.filter(|v| !v.is_finite()) {
            return Err(bad("output", value));
        }
        self.u.push(u);
        let mut alarm = None;
        let mut next = None;
        let whole = self.u.is_full() && self.y.is_full();
        match &mut self.stage {
            Stage::Learning(learning) => {
                if whole && let Some(y) = y {
                    learning.add(&self.options, &self.u, &self.y, y);
                }
                if learning.rows >= self.options.learn && learning.rows.is_multiple_of(TRY_EVERY) {
                    next = learning
                        .fitted(&self.options, &self.u)
                        .map(|f| Stage::Following(Box::new(f)));
                    // Counted once: without another row, no new attempt is made.
                    learning.rows += usize::from(next.is_none());
                }
            }
            Stage::Following(following) => {
                alarm = following.step(&self.options, &self.u, &self.y, y, self.count);
                if matches!(alarm, Some(Event::Response(_))) {
                    next = Some(Stage::Learning(Learning::new(&self.options)));
                }
            }
        }
        self.y.push(y);
        let alarm = alarm.map(|event| self.alarm(event));
        if let Some(next) = next {
            self.stage = next;
        }
        let time_s = self.sample_time.to_seconds(self.count as f64);
        self.count += 1;
        let (delay_s, band_s) = match &self.stage {
            Stage::Learning(_) => (None, None),
            Stage::Following(f) => {
                let [mean, low, high] = f.band();
                (
                    Some(self.seconds(mean + f.ahead)),
                    Some([self.seconds(low + f.ahead), self.seconds(high + f.ahead)]),
                )
            }
        };
        Ok(Tracking { time_s, delay_s, band_s, alarm })
    }

    /// The dead time of a raw delay, s.
    fn seconds(&self, raw: f64) -> f64 {
        self.sample_time.to_seconds((raw - self.options.bias as f64).max(0.0))
    }

    fn alarm(&self, event: Event) -> Alarm {
        let since = |sample: u64| {
            self.sample_time.to_seconds((sample as f64 - self.options.bias as f64).max(0.0))
        };
        match event {
            Event::Delay { from, to, since: sample } => Alarm::DelayChanged {
                from_s: self.seconds(from),
                to_s: self.seconds(to),
                since_s: since(sample),
            },
            Event::Response(sample) => Alarm::ResponseChanged { since_s: since(sample) },
        }
    }
}

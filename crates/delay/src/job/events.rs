//! The estimation between two sequences of event times.

use super::answers::{MethodAnswer, pair};
use super::asked::whole;
use super::chosen::Ready;
use crate::error::{DelayError, Result};
use crate::estimator::Search;
use crate::events::jitter::Jitter;
use crate::events::times::Events;
use crate::experiment::Experiment;
use crate::report::{FORMAT, Pair, Report, Searched};
use crate::verdict::conclusion::RecordFacts;
use deadtime_log::EventTimes;
use deadtime_signal::stats;
use deadtime_signal::stop::Stop;
use deadtime_signal::time::SampleTime;

/// The configuration of an estimation between two sequences of event times; [`EventsJob::new`] has every method and the defaults.
pub struct EventsJob {
    /// The name of the log.
    pub name: String,
    /// The names of the two sequences.
    pub channels: [String; 2],
    /// Times of the events at the first place, and at the second.
    pub events: [EventTimes; 2],
    /// The methods, as `chosen` makes them.
    pub methods: Vec<Ready>,
    /// Longest delay to search, s; `None`: the window of `Search` in typical intervals.
    pub max_delay_s: Option<f64>,
    /// Cancellation, checked between methods.
    pub stop: Stop,
}

/// Window units per typical interval.
const PARTS: u8 = 100;

impl EventsJob {
    /// Every event method between two named sequences, with the defaults of `Search`.
    pub fn new(name: impl Into<String>, channels: [&str; 2], events: [EventTimes; 2]) -> Self {
        Self {
            name: name.into(),
            channels: channels.map(str::to_owned),
            events,
            methods: Ready::of_events(),
            max_delay_s: None,
            stop: Stop::default(),
        }
    }

    /// Estimates the delay by every method.
    ///
    /// # Errors
    /// [`DelayError::OneEvent`], [`DelayError::Intervals`], [`DelayError::NoWindow`], [`deadtime_signal::time::TimeError`];
    /// [`crate::error::Error::Stopped`]. A method that cannot use the events gives an outcome.
    pub fn run(&self) -> Result<Report> {
        let Self { name, channels: [a, b], events: [first, second], methods, stop, .. } = self;
        if let Some(none) = [first, second].into_iter().find(|e| e.times.is_empty()) {
            return Err(
                DelayError::Count { what: "events", needed: 2, got: none.times.len() }.into()
            );
        }
        let units = [first.unit.clone(), second.unit.clone()];
        let paired = first.in_rows && second.in_rows && units[0] == units[1];
        let delays = || second.times.iter().zip(&first.times).map(|(b, a)| b - a).collect();
        let in_rows = paired.then(delays);
        let (first, mut later) = (first.times.clone(), second.times.clone());
        if in_rows.is_some() {
            later.sort_by(f64::total_cmp);
            // Two events of one instant are one to the second place.
            later.dedup();
        }
        let counts = [first.len(), later.len()];
        let events = vec![Events { first, second: later, units, in_rows }];
        let experiment = Experiment::of_events(SampleTime::new(1.0)?, [a, b], events)?;
        let (interval_s, step) = self.interval()?;
        let max_delay = match self.max_delay_s {
            None => Search::default().max_delay * usize::from(PARTS),
            Some(seconds) => whole(step, seconds)?,
        };
        if max_delay == 0 {
            return Err(DelayError::NoWindow.into());
        }
        let experiment = experiment.with_sample_time(step);
        let search = Search { max_delay, stop: stop.clone(), ..Search::default() };
        let mut answers = Vec::new();
        for ready in methods {
            stop.check()?;
            answers.push(MethodAnswer::of(ready, None, |r| {
                r.estimator.estimate(&experiment, &search)
            })?);
        }
        let jitter = Jitter::of(&experiment, &search);
        let pair = pair(a, b, &answers, Vec::new(), step, &RecordFacts::default());
        Ok(Report {
            format: FORMAT,
            log: name.clone(),
            sample_time_s: step.seconds(),
            max_delay_s: step.to_seconds(max_delay as f64),
            pairs: vec![Pair { jitter, ..pair }],
            searched: Searched::Events { counts, interval_s },
        })
    }

    /// The typical interval of the first sequence, s, and the fraction of it that is the window's unit.
    fn interval(&self) -> Result<(f64, SampleTime)> {
        let (log, channel) = (self.name.clone(), self.channels[0].clone());
        let intervals = self.events[0].times.windows(2).map(|w| w[1] - w[0]).collect();
        match stats::upper_median(intervals) {
            None => Err(DelayError::OneEvent { log, channel }.into()),
            Some(interval_s) => match SampleTime::new(interval_s / f64::from(PARTS)) {
                Ok(step) => Ok((interval_s, step)),
                Err(error) => Err(DelayError::Intervals { log, channel, error }.into()),
            },
        }
    }
}

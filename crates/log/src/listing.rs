//! The content of a recording in numbers: rates, gaps, ranges and the course of every channel.

use std::collections::HashMap;

use serde::Serialize;

use super::align::{GAP_STEPS, shortest_name};
use crate::notes::Notes;

use super::channels::{Channel, Log};
use super::place::neighbours;
use super::recording::{Recording, Topic};

/// Gaps beyond this many are counted, not listed.
const LISTED_GAPS: usize = 20;
/// Points of a course.
const POINTS: usize = 32;

/// Everything that a file holds, `deadtime/log@1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Listing {
    /// `deadtime/log@1`.
    pub format: &'static str,
    /// The file.
    pub file: String,
    /// The reader that read it.
    pub reader: &'static str,
    /// Guesses, omissions and truncations.
    pub notes: Notes,
    /// Its topics.
    pub topics: Vec<TopicListing>,
}

/// One topic of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicListing {
    /// Its name; empty where the file has no topics.
    pub name: String,
    /// The number of samples.
    pub samples: usize,
    /// Its first time stamp, s.
    pub from_s: f64,
    /// Its last time stamp, s.
    pub to_s: f64,
    /// The median step, s; `None` for one sample.
    pub step_s: Option<f64>,
    /// Standard deviation of the steps that are no gaps, s.
    pub jitter_s: Option<f64>,
    /// Whether the stamps lie on an even grid.
    pub even: bool,
    /// The number of gaps: steps longer than three median ones.
    pub gap_count: usize,
    /// The first of them.
    pub gaps: Vec<GapListing>,
    /// Columns that hold something else than numbers.
    pub not_numbers: Vec<String>,
    /// Its channels.
    pub channels: Vec<ChannelListing>,
}

/// A stretch without samples.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapListing {
    /// The last stamp before it, s.
    pub from_s: f64,
    /// The first one behind it, s.
    pub to_s: f64,
}

/// One channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelListing {
    /// Its name within the topic.
    pub name: String,
    /// The shortest unique name in this file.
    pub short: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Smallest value; `None` where no sample is there.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Mean of the samples.
    pub mean: Option<f64>,
    /// Samples that are missing.
    pub missing: usize,
    /// Means over 32 equal parts of the topic's time; `None` where a part holds no sample.
    pub course: Vec<Option<f64>>,
}

impl Recording {
    /// The content of the file.
    #[must_use]
    pub fn listing(&self) -> Listing {
        let ends = self.ends();
        let topics = self.topics.iter().map(|topic| topic_listing(topic, &ends)).collect();
        Listing {
            format: "deadtime/log@1",
            file: self.source.clone(),
            reader: self.format,
            notes: self.notes.clone(),
            topics,
        }
    }
}

fn topic_listing(topic: &Topic, ends: &HashMap<String, usize>) -> TopicListing {
    let log = &topic.log;
    let time_s = log.time_s();
    let steps = || neighbours(time_s).map(|(before, after)| after - before);
    let step_s = (log.len() > 1).then(|| log.median_step_s());
    let longest_s = step_s.map_or(f64::INFINITY, |step| GAP_STEPS * step);
    let usual: Vec<f64> = steps().filter(|step| *step <= longest_s).collect();
    let mean = usual.iter().sum::<f64>() / usual.len().max(1) as f64;
    let variance =
        usual.iter().map(|step| (step - mean).powi(2)).sum::<f64>() / usual.len().max(1) as f64;
    let gaps = || neighbours(time_s).filter(|(from, to)| to - from > longest_s);
    TopicListing {
        name: topic.name.clone(),
        samples: log.len(),
        from_s: time_s.first().copied().unwrap_or(0.0),
        to_s: time_s.last().copied().unwrap_or(0.0),
        step_s,
        jitter_s: step_s.map(|_| variance.sqrt()),
        even: log.even_grid().is_ok(),
        gap_count: gaps().count(),
        gaps: gaps().take(LISTED_GAPS).map(|(from_s, to_s)| GapListing { from_s, to_s }).collect(),
        not_numbers: log.unusable.iter().map(|column| column.name.clone()).collect(),
        channels: log.channels().map(|channel| channel_listing(topic, channel, ends)).collect(),
    }
}

fn channel_listing(
    topic: &Topic,
    channel: &Channel,
    ends: &HashMap<String, usize>,
) -> ChannelListing {
    let there = || channel.iter().flatten();
    let (mut count, mut mean) = (0, 0.0);
    for x in there() {
        count += 1;
        // A running mean cannot overflow.
        mean += (x - mean) / count as f64;
    }
    ChannelListing {
        name: channel.name().to_owned(),
        short: shortest_name(&topic.name, channel.name(), ends),
        unit: channel.unit().map(ToOwned::to_owned),
        min: there().reduce(f64::min),
        max: there().reduce(f64::max),
        mean: (count > 0).then_some(mean),
        missing: topic.log.len() - count,
        course: course(&topic.log, channel),
    }
}

fn course(log: &Log, channel: &Channel) -> Vec<Option<f64>> {
    let (start_s, duration_s) = (log.start_s(), log.duration_s());
    let mut parts = [(0.0_f64, 0_usize); POINTS];
    for (t, x) in log.time_s().iter().zip(channel.iter()) {
        let at = if duration_s > 0.0 {
            ((t - start_s) / duration_s * POINTS as f64) as usize
        } else {
            0
        };
        if let (Some(part), Some(x)) = (parts.get_mut(at.min(POINTS - 1)), x) {
            part.1 += 1;
            part.0 += (x - part.0) / part.1 as f64;
        }
    }
    parts.iter().map(|(mean, count)| (*count > 0).then_some(*mean)).collect()
}

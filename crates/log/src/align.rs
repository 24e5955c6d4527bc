//! Channels of a recording by name, and channels of several topics on one grid.

use std::collections::HashMap;

use super::channels::{Channel, Log, Output};
use super::error::LogError;
use super::recording::{Recording, Topic};
use deadtime_signal::text::closest;
use deadtime_signal::time::SampleTime;

/// A step longer than this many median steps is a gap.
pub(super) const GAP_STEPS: f64 = 3.0;
/// Half the length of the interpolation kernel, in zero crossings.
const CROSSINGS: f64 = 16.0;
/// Shape of the Kaiser window: 80 dB of stop band.
const KAISER_BETA: f64 = 8.0;
/// Where the pass band ends when the rate falls, as a part of half the new rate: the kernel's edge lies below the fold.
const EDGE: f64 = 0.85;
/// Points of the kernel's table per zero crossing.
const TABLE: usize = 1024;
/// A command with fewer stamps than this part of those of the densest output is sparse: its stamps would hold little of the output.
const SPARSE: f64 = 0.1;
/// A common grid may have at most this many samples.
const MOST_SAMPLES: f64 = 2e8;

/// A requested channel of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Its name: `topic.field`, or the end of it where only one channel ends so.
    pub name: String,
    /// Whether it keeps its value between samples, as commands do.
    pub held: bool,
    /// Whether it must be there.
    pub required: bool,
}

/// A channel that is wanted, where it was found.
type Chosen<'w, 'r> = (&'w Wanted, &'r Topic, &'r Channel);

impl Recording {
    /// The channels' full names: `topic.field`, or `field` in a file without topics.
    pub fn names(&self) -> impl Iterator<Item = String> {
        self.topics
            .iter()
            .flat_map(|topic| topic.log.names().map(|channel| full(&topic.name, channel)))
    }

    /// The number of channels with a given end of their name, for every end.
    pub(super) fn ends(&self) -> HashMap<String, usize> {
        let mut count = HashMap::new();
        for name in self.names() {
            for end in ends(&plain(&name)) {
                *count.entry(end.to_owned()).or_insert(0) += 1;
            }
        }
        count
    }

    fn called(&self, wanted: &str) -> Vec<(&Topic, &Channel)> {
        let all = || {
            self.topics
                .iter()
                .flat_map(|topic| topic.log.channels().map(move |channel| (topic, channel)))
        };
        let wanted = plain(wanted);
        let named: Vec<_> = all()
            .map(|(topic, channel)| (plain(&full(&topic.name, channel.name())), topic, channel))
            .collect();
        let exact: Vec<_> =
            named.iter().filter(|(name, ..)| *name == wanted).map(|(_, t, c)| (*t, *c)).collect();
        if !exact.is_empty() {
            return exact;
        }
        let ends = |name: &str| {
            name.strip_suffix(wanted.as_str()).is_some_and(|start| start.ends_with('.'))
        };
        named.iter().filter(|(name, ..)| ends(name)).map(|(_, t, c)| (*t, *c)).collect()
    }

    /// A channel by its full name or by an end of it that is unique.
    fn find(&self, wanted: &str) -> Result<(&Topic, &Channel), LogError> {
        let found = self.called(wanted);
        match found.as_slice() {
            [only] => Ok(*only),
            [] => {
                let names: Vec<String> = self.names().collect();
                let ends = names
                    .iter()
                    .flat_map(|n| [n.as_str(), n.rsplit(['.', '/']).next().unwrap_or(n)]);
                Err(LogError::UnknownChannel {
                    file: self.source.clone(),
                    channel: wanted.into(),
                    closest: closest(wanted, ends).map(Into::into),
                    existing: names,
                })
            }
            several => Err(LogError::AmbiguousChannel {
                file: self.source.clone(),
                channel: wanted.into(),
                matches: several
                    .iter()
                    .map(|(topic, channel)| full(&topic.name, channel.name()))
                    .collect(),
            }),
        }
    }

    /// A channel with its topic, by its full name or by an end of it that is unique.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<(&Topic, &Channel)> {
        self.find(name).ok()
    }

    /// The wanted channels as one log, each under its requested name. A file without topics gives all its channels. Its held channels with numbers in half of
    /// the rows or fewer are held from row to row.
    ///
    /// Channels of one topic keep its stamps. Channels of several topics are resampled onto one grid: the stamps of the first held channel's topic, or an even
    /// grid of `grid`. Where held channels have under 10 % of the stamps of the densest other topic, the grid is that topic's. Held channels keep their value
    /// until the next one, and the last one to the log's end. The others are interpolated with a Kaiser-windowed sinc of 16 zero crossings a side. Its band
    /// passes the frequencies of both rates and stops those that the slower one would alias. The kernel reaches both ways, so an edge is blurred, not moved.
    /// Nothing is interpolated across a gap. The second value reports the resampling.
    ///
    /// # Errors
    /// [`LogError::UnknownChannel`], [`LogError::AmbiguousChannel`]; [`LogError::NoCommonTime`] for topics that do not overlap; [`LogError::TooFine`].
    pub fn together(
        &self,
        wanted: &[Wanted],
        grid: Option<SampleTime>,
    ) -> Result<(Log, Vec<String>), LogError> {
        if let [Topic { name, log }] = self.topics.as_slice()
            && name.is_empty()
        {
            return Ok(held_between_rows(log.clone(), wanted));
        }
        let chosen = self.chosen(wanted)?;
        let Some((base, sparse)) = base(&chosen) else {
            let name = wanted.first().map_or("", |one| one.name.as_str());
            return self.find(name).map(|(topic, _)| (topic.log.clone(), Vec::new()));
        };
        let named =
            |one: &Wanted, channel: &Channel| Channel { name: one.name.clone(), ..channel.clone() };
        if grid.is_none() && chosen.iter().all(|(_, topic, _)| std::ptr::eq(*topic, base)) {
            let channels = chosen.iter().map(|(one, _, channel)| named(one, channel)).collect();
            let log = Log::assemble(
                self.source.clone(),
                base.log.time_s.clone(),
                channels,
                Vec::new(),
                base.log.rows.clone(),
            )?;
            return Ok((log, Vec::new()));
        }
        let time_s = self.common_times(&chosen, base, grid)?;
        let step_s = grid.map_or_else(|| base.log.median_step_s(), SampleTime::seconds);
        let moved = moved(&chosen, base, grid);
        let early_s = moved.map(|(_, topic, _)| topic.log.median_step_s()).fold(0.0, f64::max);
        let channels = chosen.iter().map(|(one, topic, channel)| {
            let (stamps, samples) = (topic.log.time_s(), channel.samples());
            let (values, present) = if one.held {
                hold(stamps, samples, &time_s)
            } else {
                band_limited(stamps, samples, &time_s, step_s)
            };
            let (name, unit) = (one.name.clone(), channel.unit.clone());
            Channel { name, unit, values: values.into(), present: Some(present) }
        });
        let channels = channels.collect();
        let note = note(&chosen, base, grid, sparse, &time_s);
        // A command that is resampled to other stamps appears later than it was, by up to a step.
        let log = Log::new(self.source.clone(), time_s, channels)?;
        Ok((Log { early_s: early_s + step_s, ..log }, vec![note]))
    }

    /// As [`Recording::into_log`], with sparse commands held between their rows, as in [`Recording::together`], and the notes on it.
    ///
    /// # Errors
    /// As [`Recording::into_log`].
    pub fn into_log_of(self, wanted: &[Wanted]) -> Result<(Log, Vec<String>), LogError> {
        self.into_log().map(|log| held_between_rows(log, wanted))
    }

    /// The channels that are wanted; those that are not required may be missing.
    fn chosen<'w>(&self, wanted: &'w [Wanted]) -> Result<Vec<Chosen<'w, '_>>, LogError> {
        let mut chosen = Vec::with_capacity(wanted.len());
        for one in wanted {
            match self.find(&one.name) {
                Ok((topic, channel)) => chosen.push((one, topic, channel)),
                Err(LogError::UnknownChannel { .. }) if !one.required => {}
                Err(error) => return Err(error),
            }
        }
        Ok(chosen)
    }

    /// The stamps of one topic, or those of an even grid. The range is from the time at which all topics have begun to the end of the first topic that is not
    /// held.
    fn common_times(
        &self,
        chosen: &[Chosen<'_, '_>],
        base: &Topic,
        grid: Option<SampleTime>,
    ) -> Result<Vec<f64>, LogError> {
        let from_s =
            chosen.iter().map(|(_, t, _)| t.log.start_s()).fold(f64::NEG_INFINITY, f64::max);
        let ends = |held: bool| {
            chosen.iter().filter(move |(one, ..)| one.held == held).map(|(_, t, _)| t.log.end_s())
        };
        let to_s = ends(false)
            .reduce(f64::min)
            .or_else(|| ends(true).reduce(f64::max))
            .unwrap_or(f64::INFINITY);
        let time_s: Vec<f64> = match grid {
            None => {
                base.log.time_s.iter().copied().filter(|t| (from_s..=to_s).contains(t)).collect()
            }
            Some(step) => self.even(from_s, to_s, step.seconds())?,
        };
        if time_s.is_empty() {
            let spans = chosen
                .iter()
                .map(|(one, t, _)| (one.name.clone(), t.log.start_s(), t.log.end_s()))
                .collect();
            return Err(LogError::NoCommonTime { file: self.source.clone(), spans });
        }
        Ok(time_s)
    }

    fn even(&self, from_s: f64, to_s: f64, step_s: f64) -> Result<Vec<f64>, LogError> {
        let last = ((to_s - from_s) / step_s + 1e-6).floor();
        if last >= MOST_SAMPLES {
            let (samples, duration_s) = (last + 1.0, to_s - from_s);
            return Err(LogError::TooFine {
                file: self.source.clone(),
                sample_time_s: step_s,
                samples,
                duration_s,
            });
        }
        Ok(if last < 0.0 {
            Vec::new()
        } else {
            (0..=last as usize).map(|k| from_s + k as f64 * step_s).collect()
        })
    }
}

/// The topic whose stamps are the grid: that of the first held channel, where one is dense enough, else the densest of the others. Also whether commands were
/// too sparse.
fn base<'r>(chosen: &[Chosen<'_, 'r>]) -> Option<(&'r Topic, bool)> {
    let others = chosen
        .iter()
        .filter(|(one, topic, _)| !one.held && topic.log.len() > 1)
        .map(|(_, topic, _)| *topic);
    let densest = others.min_by(|a, b| a.log.median_step_s().total_cmp(&b.log.median_step_s()));
    let dense = |topic: &Topic| {
        densest.is_none_or(|other| {
            let from_s = topic.log.start_s().max(other.log.start_s());
            let stamps = |log: &Log| {
                log.time_s.iter().filter(|t| (from_s..=other.log.end_s()).contains(*t)).count()
                    as f64
            };
            stamps(&topic.log) >= SPARSE * stamps(&other.log)
        })
    };
    let held = || chosen.iter().filter(|(one, ..)| one.held).map(|(_, topic, _)| *topic);
    match (held().find(|topic| dense(topic)), held().next(), densest) {
        (Some(topic), ..) => Some((topic, false)),
        (None, Some(_), Some(other)) => Some((other, true)),
        (None, held, _) => {
            held.or(chosen.first().map(|(_, topic, _)| *topic)).map(|topic| (topic, false))
        }
    }
}

/// The note on the resampled channels.
fn note(
    chosen: &[Chosen<'_, '_>],
    base: &Topic,
    grid: Option<SampleTime>,
    sparse: bool,
    time_s: &[f64],
) -> String {
    let onto = grid.map_or_else(
        || format!("the stamps of {}", base.name),
        |step| format!("an even grid of {} s", step.seconds()),
    );
    let mut note = format!("channels are put onto {onto}");
    if sparse && grid.is_none() {
        note += " (the commands are too sparse to be the grid)";
    }
    if let Some(held) = names(chosen.iter().filter(|(one, ..)| one.held)) {
        note += &format!("; {held} held");
    }
    note += &held_on(chosen, time_s);
    if let Some(moved) = names(moved(chosen, base, grid)) {
        note += &format!("; {moved} interpolated within what both rates carry");
    }
    note
}

/// Interpolated channels: those that are not held and have other stamps.
fn moved<'c, 'w, 'r>(
    chosen: &'c [Chosen<'w, 'r>],
    base: &'c Topic,
    grid: Option<SampleTime>,
) -> impl Iterator<Item = &'c Chosen<'w, 'r>> {
    let own = move |topic: &Topic| grid.is_none() && std::ptr::eq(topic, base);
    chosen.iter().filter(move |(one, topic, _)| !one.held && !own(topic))
}

/// The names of channels, one behind the other; `None` where there is none.
fn names<'c, 'w: 'c, 'r: 'c>(chosen: impl Iterator<Item = &'c Chosen<'w, 'r>>) -> Option<String> {
    let names: Vec<&str> = chosen.map(|(one, ..)| one.name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// Which commands are held far behind their last stamp, as a part of a sentence.
fn held_on(chosen: &[Chosen<'_, '_>], time_s: &[f64]) -> String {
    let end_s = time_s.last().copied().unwrap_or(0.0);
    let far = |log: &Log| {
        end_s - log.end_s()
            > GAP_STEPS * log.median_step_s().max(crate::csv::clock::median_step(time_s))
    };
    let late: Vec<String> = chosen
        .iter()
        .filter(|(one, topic, _)| one.held && far(&topic.log))
        .map(|(one, topic, _)| {
            format!(
                "{} keeps its last value for {:.3} s, to the end",
                one.name,
                end_s - topic.log.end_s()
            )
        })
        .collect();
    if late.is_empty() { String::new() } else { format!("; {}", late.join(", ")) }
}

fn full(topic: &str, channel: &str) -> String {
    if topic.is_empty() { channel.to_owned() } else { format!("{topic}.{channel}") }
}

/// The shortest end of a channel's full name that no other channel has.
pub(super) fn shortest_name(topic: &str, channel: &str, count: &HashMap<String, usize>) -> String {
    let name = full(topic, channel);
    let unique = ends(&plain(&name))
        .into_iter()
        .rev()
        .find(|end| count.get(*end) == Some(&1))
        .map(ToOwned::to_owned);
    unique.unwrap_or(name)
}

/// A plain name and the part after each of its dots.
fn ends(name: &str) -> Vec<&str> {
    let behind =
        name.char_indices().filter(|(_, c)| *c == '.').filter_map(|(at, _)| name.get(at + 1..));
    std::iter::once(name).chain(behind).filter(|end| !end.is_empty()).collect()
}

/// `/cmd_vel/linear/x`, `cmd_vel.linear.x` and `/cmd_vel.linear.x` are one.
fn plain(name: &str) -> String {
    name.trim_start_matches('/').replace('/', ".")
}

/// Share of rows with a number. A channel up to this share is a command that is logged in some rows only, and keeps its value between them. A denser channel
/// has missing samples.
const SOME_ROWS: f64 = 0.5;

/// A table with its sparse commands held from row to row, from the first row on with values of all commands, and its notes.
fn held_between_rows(mut log: Log, wanted: &[Wanted]) -> (Log, Vec<String>) {
    let (rows, mut notes, mut from) = (log.len(), Vec::new(), 0);
    let named = |channel: &Channel| wanted.iter().any(|one| one.held && one.name == channel.name);
    for channel in log.channels.iter_mut().filter(|channel| named(channel)) {
        let samples = channel.samples();
        let count = samples.present_count();
        let Some(first) = (0..rows).find(|k| samples.get(*k).is_some()) else { continue };
        if count as f64 > SOME_ROWS * rows as f64 {
            continue;
        }
        let mut last = 0.0;
        let values: Vec<f64> = (0..rows)
            .map(|k| {
                last = samples.get(k).unwrap_or(last);
                last
            })
            .collect();
        from = from.max(first);
        channel.values = values.into();
        channel.present = None;
        notes.push(format!(
            "{} has a number in {count} of {rows} rows: it keeps its value between them",
            channel.name
        ));
    }
    let start_s = log.time_s().get(from).copied().filter(|_| from > 0);
    match start_s.map(|at| log.window(Some(at - log.start_s()), None)) {
        Some(Ok(part)) => (part, notes),
        _ => (log, notes),
    }
}

/// The value of the last sample at or before each time; missing before the first and where that sample is missing.
fn hold(stamps: &[f64], samples: Output<'_>, at_s: &[f64]) -> (Vec<f64>, Vec<bool>) {
    let mut next = 0;
    let held = at_s.iter().map(|t| {
        while stamps.get(next).is_some_and(|stamp| stamp <= t) {
            next += 1;
        }
        next.checked_sub(1).and_then(|last| samples.get(last))
    });
    held.map(|value| (value.unwrap_or(0.0), value.is_some())).unzip()
}

/// Samples at other times, without the frequencies that a step of `step_s` would fold.
///
/// How it can be wrong: energy above half the new rate folds into the result (a sine there must vanish). The signal below is damped or moved in time (a sine
/// there must keep phase and size). A straight line bends at the ends (the samples are continued by odd reflection). Values are made up inside a gap (missing
/// there instead).
pub(super) fn band_limited(
    stamps: &[f64],
    samples: Output<'_>,
    at_s: &[f64],
    step_s: f64,
) -> (Vec<f64>, Vec<bool>) {
    let own_s = crate::csv::clock::median_step(stamps);
    let longest_s = GAP_STEPS * own_s;
    // Band edge as a part of half the samples' own rate.
    let edge = if step_s > 1.001 * own_s { EDGE * own_s / step_s } else { 1.0 };
    let reach = CROSSINGS / edge;
    let kernel = Kernel::new();
    let joined = |i: usize| match (stamps.get(i), stamps.get(i + 1)) {
        (Some(a), Some(b)) => {
            b - a <= longest_s && samples.get(i).is_some() && samples.get(i + 1).is_some()
        }
        _ => false,
    };
    let (mut i, mut run) = (0, (0, 0));
    let value = |t: &f64| -> Option<f64> {
        while stamps.get(i + 1).is_some_and(|next| next <= t) {
            i += 1;
        }
        let (before_s, after_s) = (stamps.get(i)?, stamps.get(i + 1));
        if t < before_s {
            return None;
        }
        let fraction = after_s.map_or(0.0, |after| (t - before_s) / (after - before_s));
        if fraction > 0.0 && !joined(i) || fraction == 0.0 && t > before_s {
            return None;
        }
        samples.get(i)?;
        if fraction == 0.0 && edge == 1.0 {
            return samples.get(i);
        }
        // The stretch without gaps around the place.
        if i < run.0 || i > run.1 || run == (0, 0) {
            let first = (0..i).rev().find(|&k| !joined(k)).map_or(0, |k| k + 1);
            let last = (i..stamps.len()).find(|&k| !joined(k)).unwrap_or(i);
            run = (first, last);
        }
        let place = i as f64 + fraction;
        let (mut sum, mut weights) = (0.0, 0.0);
        for k in (place - reach).ceil() as i64..=(place + reach).floor() as i64 {
            let weight = kernel.at((place - k as f64).abs() * edge);
            sum += weight * reflected(samples.values, run, k);
            weights += weight;
        }
        Some(sum / weights).filter(|x| x.is_finite())
    };
    at_s.iter().map(value).map(|value| (value.unwrap_or(0.0), value.is_some())).unzip()
}

/// The sample of this number; beyond the ends of a run odd about them, again and again where the
/// run is short.
fn reflected(values: &[f64], (first, last): (usize, usize), mut k: i64) -> f64 {
    let (first, last) = (first as i64, last as i64);
    let at = |k: i64| values.get(k as usize).copied().unwrap_or(0.0);
    let (mut sum, mut sign) = (0.0, 1.0);
    while (k < first || k > last) && first < last {
        let end = if k < first { first } else { last };
        sum += sign * 2.0 * at(end);
        (sign, k) = (-sign, 2 * end - k);
    }
    sum + sign * at(k.clamp(first, last))
}

/// A Kaiser-windowed sinc, tabulated.
struct Kernel(Vec<f64>);

impl Kernel {
    fn new() -> Self {
        let points = CROSSINGS as usize * TABLE;
        let value = |j: usize| {
            let x = j as f64 / TABLE as f64;
            let arc = std::f64::consts::PI * x;
            let sinc = if j == 0 { 1.0 } else { arc.sin() / arc };
            sinc * bessel_i0(KAISER_BETA * (1.0 - (x / CROSSINGS).powi(2)).max(0.0).sqrt())
                / bessel_i0(KAISER_BETA)
        };
        Self((0..=points + 1).map(value).collect())
    }

    /// At a distance in zero crossings; 0 beyond the last.
    fn at(&self, distance: f64) -> f64 {
        let place = distance * TABLE as f64;
        let (whole, fraction) = (place as usize, place.fract());
        match (self.0.get(whole), self.0.get(whole + 1)) {
            (Some(a), Some(b)) if distance <= CROSSINGS => a + (b - a) * fraction,
            _ => 0.0,
        }
    }
}

/// The modified Bessel function of the first kind and order 0, by its power series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..60 {
        term *= quarter / f64::from(k * k);
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(hz: f64, t: f64) -> f64 {
        (std::f64::consts::TAU * hz * t).sin()
    }

    fn worst(hz: f64, from_step: f64, to_step: f64, expected: impl Fn(f64) -> f64) -> f64 {
        let stamps: Vec<f64> = (0..4000).map(|k| k as f64 * from_step).collect();
        let values: Vec<f64> = stamps.iter().map(|t| sine(hz, *t)).collect();
        let end = 4000.0 * from_step;
        let at: Vec<f64> = (0..)
            .map(|k| 0.0013 + k as f64 * to_step)
            .take_while(|t| *t < end - 2.0 * from_step)
            .collect();
        let (made, there) =
            band_limited(&stamps, Output { values: &values, present: None }, &at, to_step);
        assert!(there.iter().all(|x| *x));
        // Away from the ends, where the kernel reaches beyond the record.
        let inner = at.iter().zip(&made).filter(|(t, _)| **t > 0.2 * end && **t < 0.8 * end);
        inner.map(|(t, x)| (x - expected(*t)).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_command_in_some_rows_of_a_dense_table_is_held_between_them() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(91);
        for _ in 0..40 {
            let (every, late) = (rng.random_range(2..9_usize), rng.random_range(0..3_usize));
            let truth: Vec<f64> = (0..200).map(|k| ((k / every) * 7 % 11) as f64).collect();
            let mut text = "time,cmd,y\n".to_owned();
            for (k, value) in truth.iter().enumerate() {
                let there = k % every == 0 && k >= late * every;
                let cell = if there { value.to_string() } else { String::new() };
                text += &format!("{:.2},{cell},{k}\n", 5.0 + 0.01 * k as f64);
            }
            let read = crate::csv::table::recording_from(
                "a.csv",
                text.as_bytes(),
                &crate::ReadOptions::default(),
            )
            .unwrap();
            let wanted = [("cmd", true), ("y", false)].map(|(name, held)| Wanted {
                name: name.into(),
                held,
                required: true,
            });
            let (log, notes) = read.together(&wanted, None).unwrap();
            assert!(notes.join("|").contains("keeps its value between them"), "{notes:?}");
            let from = late * every;
            assert_eq!(log.input("cmd").unwrap(), &truth[from..], "{every} {late}");
            assert_eq!(log.output("y").unwrap().get(0), Some(from as f64));
            // As an output it is as it was logged, with gaps.
            let outputs = wanted.map(|one| Wanted { held: false, ..one });
            let (log, _) = read.together(&outputs, None).unwrap();
            assert_eq!(log.output("cmd").unwrap().get(every * late + 1), None);
        }
    }

    #[test]
    fn a_sine_that_both_rates_carry_keeps_size_and_phase() {
        // 250 Hz to 100 Hz: 30 Hz passes. 100 Hz to 250 Hz: 30 Hz passes too.
        assert!(worst(30.0, 0.004, 0.01, |t| sine(30.0, t)) < 2e-3);
        assert!(worst(30.0, 0.01, 0.004, |t| sine(30.0, t)) < 2e-3);
    }

    #[test]
    fn a_sine_that_would_fold_vanishes() {
        // 70 Hz at 250 Hz would appear as 30 Hz at 100 Hz.
        assert!(worst(70.0, 0.004, 0.01, |_| 0.0) < 2e-3);
    }

    #[test]
    fn a_line_stays_a_line_to_its_ends_and_a_gap_stays_empty() {
        let stamps: Vec<f64> =
            (0..100).filter(|k| !(40..60).contains(k)).map(|k| f64::from(k) * 0.01).collect();
        let values: Vec<f64> = stamps.iter().map(|t| 3.0 + 2.0 * t).collect();
        let at: Vec<f64> = (0..99).map(|k| 0.005 + f64::from(k) * 0.01).collect();
        for step in [0.01, 0.05] {
            let (made, there) =
                band_limited(&stamps, Output { values: &values, present: None }, &at, step);
            for ((t, x), there) in at.iter().zip(made).zip(there) {
                assert_eq!(there, !(0.39..0.60).contains(t), "{t}");
                assert!(!there || (x - 3.0 - 2.0 * t).abs() < 1e-9, "{t}: {x}");
            }
        }
    }

    /// A topic `name` with one channel of that name, which is a function of time.
    fn topic(name: &str, stamps: Vec<f64>, value: impl Fn(f64) -> f64) -> Topic {
        let channel = Channel::new(name, None, stamps.iter().map(|t| value(*t)).collect());
        Topic { name: name.to_owned(), log: Log::new(name, stamps, vec![channel]).unwrap() }
    }

    fn even(from_s: f64, step_s: f64, count: usize) -> Vec<f64> {
        (0..count).map(|k| from_s + step_s * k as f64).collect()
    }

    fn both(command: Topic, output: Topic, grid: Option<f64>) -> (Log, String) {
        let recording = Recording {
            source: "a.ulg".into(),
            format: "ulog",
            topics: vec![command, output],
            notes: crate::notes::Notes::default(),
        };
        let wanted = [("u", true), ("y", false)].map(|(name, held)| Wanted {
            name: name.into(),
            held,
            required: true,
        });
        let (log, notes) =
            recording.together(&wanted, grid.map(|step| SampleTime::new(step).unwrap())).unwrap();
        (log, notes.join("|"))
    }

    #[test]
    fn sparse_commands_last_to_the_end_and_leave_the_grid_to_the_output() {
        let output = || topic("y", even(0.0, 0.01, 1001), |t| t);
        // One set point near the start.
        let (log, said) = both(topic("u", vec![0.055], |_| 3.0), output(), None);
        assert_eq!(log.len(), 995);
        assert!(
            log.input("u").unwrap().iter().all(|u| *u == 3.0)
                && (log.time_s()[994] - 10.0).abs() < 1e-9
        );
        assert!(
            said.contains("stamps of y (the commands are too sparse")
                && said.contains("u keeps its last value for 9.945 s"),
            "{said}"
        );
        assert!(log.early_s() > 0.0, "a command between two stamps of the output is put behind it");
        // One each second, until 6 s.
        let seconds = || topic("u", even(0.0, 1.0, 7), |t| t);
        let (log, said) = both(seconds(), output(), None);
        assert_eq!(log.len(), 1001);
        for (t, u) in log.time_s().iter().zip(log.input("u").unwrap()) {
            assert_eq!(*u, (t + 1e-9).floor().min(6.0), "{t}");
        }
        assert_eq!(log.output("y").unwrap().get(437), Some(4.37), "the output's own samples");
        assert!(said.contains("for 4.000 s"), "{said}");
        // Onto an even grid, to the end too.
        assert_eq!(both(seconds(), output(), Some(0.1)).0.len(), 101);
    }

    #[test]
    fn dense_commands_are_the_grid() {
        let (log, said) = both(
            topic("u", even(0.0, 0.05, 200), |t| t),
            topic("y", even(0.0, 0.01, 1001), |t| t),
            None,
        );
        assert_eq!(log.len(), 200);
        assert!(
            said.contains("stamps of u;") && !said.contains("sparse") && !said.contains("keeps"),
            "{said}"
        );
    }

    #[test]
    fn what_is_held_keeps_its_value() {
        let samples = Output { values: &[1.0, 2.0, 3.0], present: Some(&[true, false, true]) };
        let (values, present) = hold(&[0.0, 1.0, 2.0], samples, &[-0.5, 0.0, 0.9, 1.0, 2.0, 7.0]);
        assert_eq!(
            (values, present),
            (vec![0.0, 1.0, 1.0, 0.0, 3.0, 3.0], vec![false, true, true, false, true, true])
        );
    }
}

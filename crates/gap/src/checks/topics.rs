//! The clocks of a recording's topics: the evenness of each topic's stamps, and the offset between the stamps of two topics with the same motion.
//!
//! Two outputs of different topics are compared by their cross-spectrum S(ω) over many stretches. An offset of τ turns its phase by −ωτ, and changes nothing
//! else. One output may be the negative, the derivative or the integral of the other, with a constant phase of 180°, 90° or −90°.
//!
//! How it can be wrong: a filter or a slower bus at one of two sensors has the same signature as a clock offset. The finding names this. No
//! offset is reported where the phase is not straight (a dynamic relation), or where two offsets or two relations fit alike (narrow band). The same holds at
//! low coherence and for a short record. An offset that changes over the record widens the interval, which is that of the stretches.
//!
//! Source: Knapp and Carter (1976), "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP 24(4), 320-327, doi:10.1109/TASSP.1976.1162830
//! (weights γ²/(1 − γ²)); variance of the phase (1 − γ²)/(2γ²·K): Bendat and Piersol (2010), "Random Data", 4th ed., eq. 9.52.

use nalgebra::Complex;
use serde::{Deserialize, Serialize};

use super::evidence::short;
use deadtime_log::{Channel, Log, Recording, Topic, Wanted};
use deadtime_signal::CrossSpectra;
use deadtime_signal::stats::quantile;
use deadtime_signal::stats::students_t;
use deadtime_signal::time::SampleTime;

/// Samples of a stretch, at most and at least.
const LONGEST: usize = 2048;
const SHORTEST: usize = 64;
/// Stretches for the scatter of the offset; a record with fewer than the least gives no result.
const STRETCHES: usize = 12;
const FEWEST: usize = 6;
/// The number of shifts of the second signal onto the first.
const TURNS: usize = 4;
/// Offsets are searched up to this part of a stretch.
const SEARCHED: f64 = 0.25;
/// Steps of the search in a sample.
const FINE: f64 = 8.0;
/// A line is used from this coherence on, and from this part of the strongest line's power: weaker lines may be leakage from there.
const COHERENT: f64 = 0.5;
const STRONG: f64 = 0.01;
/// and no line counts more than one of this.
const MOST: f64 = 0.98;
/// Lines that must count.
const LINES: usize = 8;
/// The share of the lines' weight with one sign that an offset needs.
const POINTS: f64 = 0.5;
/// Squared phase that a straight line leaves, over its variance.
const LEFT: f64 = 3.0;
/// The phase accuracy of the interpolation, rad.
const PHASE: f64 = 0.03;
/// No offset is known more closely, steps of the slower topic.
const LEAST: f64 = 0.02;

/// The clocks of a log's topics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogClocks {
    /// The log.
    pub log: String,
    /// The topics of the model's channels; one without a name where a file has no topics.
    pub topics: Vec<TopicClock>,
    /// Pairs of outputs of different topics.
    pub offsets: Vec<ClockOffset>,
}

/// How even a topic's stamps are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TopicClock {
    /// Its name; empty where the file has no topics.
    pub topic: String,
    /// Samples.
    pub samples: usize,
    /// Steps from stamp to stamp below which 5 %, 50 % and 95 % of them lie, s; `None` for one sample.
    pub steps_s: Option<[f64; 3]>,
    /// The longest step, s.
    pub longest_s: Option<f64>,
}

/// The offset between the stamps of two topics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockOffset {
    /// An output.
    pub first: String,
    /// An output of another topic.
    pub second: String,
    /// The time by which the second topic's stamps are later, s; `None` where no estimate is possible.
    pub offset_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The estimate in words, or the reason for none.
    pub finding: String,
}

/// How two outputs of one motion go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Relation {
    Same,
    Reversed,
    Derivative,
    Integral,
}

impl Relation {
    const ALL: [Self; 4] = [Self::Same, Self::Reversed, Self::Derivative, Self::Integral];

    /// Takes the relation's own phase off.
    fn without(self, z: Complex<f64>) -> Complex<f64> {
        match self {
            Self::Same => z,
            Self::Reversed => -z,
            Self::Derivative => z * Complex::new(0.0, -1.0),
            Self::Integral => z * Complex::new(0.0, 1.0),
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Same => "moves as",
            Self::Reversed => "moves against",
            Self::Derivative => "moves as the derivative of",
            Self::Integral => "moves as the integral of",
        }
    }
}

/// The clocks of the topics that these channels are of.
#[must_use]
pub fn clocks(recording: &Recording, wanted: &[Wanted]) -> LogClocks {
    let found = wanted.iter().filter_map(|w| {
        recording.channel(&w.name).map(|(topic, channel)| Side { wanted: w, topic, channel })
    });
    let found: Vec<Side<'_>> = found.collect();
    let mut topics: Vec<&Topic> = Vec::new();
    for side in &found {
        if !topics.iter().any(|t| std::ptr::eq(*t, side.topic)) {
            topics.push(side.topic);
        }
    }
    let mut offsets = Vec::new();
    let measured: Vec<&Side<'_>> = found.iter().filter(|side| !side.wanted.held).collect();
    for (at, first) in measured.iter().enumerate() {
        for second in measured.iter().skip(at + 1).filter(|s| !std::ptr::eq(s.topic, first.topic)) {
            offsets.push(offset([first, second]));
        }
    }
    LogClocks {
        log: recording.source.clone(),
        topics: topics.into_iter().map(clock).collect(),
        offsets,
    }
}

/// An output and its place.
struct Side<'a> {
    wanted: &'a Wanted,
    topic: &'a Topic,
    channel: &'a Channel,
}

fn clock(topic: &Topic) -> TopicClock {
    let steps: Vec<f64> = topic.log.time_s().windows(2).map(|pair| pair[1] - pair[0]).collect();
    let at = |q| quantile(&steps, q);
    let steps_s =
        at(0.05).zip(at(0.5)).zip(at(0.95)).map(|((low, middle), high)| [low, middle, high]);
    TopicClock {
        topic: topic.name.clone(),
        samples: topic.log.len(),
        steps_s,
        longest_s: steps.into_iter().reduce(f64::max),
    }
}

fn offset(sides: [&Side<'_>; 2]) -> ClockOffset {
    let [a, b] = sides.map(|s| s.wanted.name.clone());
    // On the slower one's grid: the faster signal has no counterpart beyond.
    let step_s = sides
        .iter()
        .filter_map(|s| clock(s.topic).steps_s)
        .map(|[_, middle, _]| middle)
        .fold(0.0, f64::max);
    let found = SampleTime::new(step_s)
        .map_err(|_| "a topic has one sample only".to_owned())
        .and_then(|ts| Ok((ts, lag(sides, ts)?)));
    match found {
        Err(why) => ClockOffset {
            first: a,
            second: b,
            offset_s: None,
            ci95_s: None,
            finding: format!("undecided: {why}"),
        },
        Ok((ts, Lag { relation, samples, half })) => {
            let [offset_s, half_s] = [samples, half].map(|x| ts.to_seconds(x));
            let size = format!("{} s (± {} s)", short(offset_s.abs()), short(half_s));
            let which = if offset_s.abs() <= half_s {
                format!("no offset is seen: {size}")
            } else {
                let (late, early) = if offset_s > 0.0 { (&b, &a) } else { (&a, &b) };
                format!(
                    "`{late}` is stamped {size} later than `{early}`: the clocks, or a filter or a bus of one of them"
                )
            };
            let finding = format!("`{b}` {} `{a}`; {which}", relation.words());
            ClockOffset {
                first: a,
                second: b,
                offset_s: Some(offset_s),
                ci95_s: Some([offset_s - half_s, offset_s + half_s]),
                finding,
            }
        }
    }
}

/// By how many samples the second comes later, half its 95 % interval, and how the two go together.
struct Lag {
    relation: Relation,
    samples: f64,
    half: f64,
}

/// Both on one even grid, the second's stamps moved by so much.
fn together(sides: [&Side<'_>; 2], ts: SampleTime, moved_s: f64) -> Result<Log, String> {
    let mut topics = Vec::with_capacity(2);
    for (name, side, moved_s) in [("first", sides[0], 0.0), ("second", sides[1], moved_s)] {
        let stamps = side.topic.log.time_s().iter().map(|t| t + moved_s).collect();
        let samples = side.channel.samples();
        let channel = match samples.present {
            Some(present) => Channel::partial("x", None, samples.values.to_vec(), present.to_vec()),
            None => Channel::new("x", None, samples.values.to_vec()),
        };
        topics.push(Topic {
            name: name.to_owned(),
            log: Log::new(name, stamps, vec![channel]).map_err(|e| e.to_string())?,
        });
    }
    let recording = Recording {
        source: "log".to_owned(),
        format: "",
        topics,
        notes: deadtime_log::Notes::default(),
    };
    let wanted = ["first.x", "second.x"].map(|name| Wanted {
        name: name.to_owned(),
        held: false,
        required: true,
    });
    recording.together(&wanted, Some(ts)).map(|(log, _)| log).map_err(|e| e.to_string())
}

/// The lag is found iteratively: where one signal is later than the window's range, leakage from line to line pulls the phase towards 0. After the shift by the
/// lag the phase has no such bias.
fn lag(sides: [&Side<'_>; 2], ts: SampleTime) -> Result<Lag, String> {
    let mut samples = 0.0;
    for turn in 0..TURNS {
        let parts = stretches(&together(sides, ts, -ts.to_seconds(samples))?)?;
        let lines = Lines::of(&spectra(&parts, None));
        if lines.0.len() < LINES {
            return Err("the two do not move alike over a wide enough band".to_owned());
        }
        let most = SEARCHED * parts.first().map_or(0, |[a, _]| a.len()) as f64;
        if turn + 1 < TURNS {
            samples += lines.nearest(most)?.1;
            continue;
        }
        let (relation, rest) = lines.only(most)?;
        let n = parts.len() as f64;
        let others: Vec<f64> = (0..parts.len())
            .map(|out| Lines::of(&spectra(&parts, Some(out))).refined(relation, rest))
            .collect();
        let mean = others.iter().sum::<f64>() / n;
        let std = ((n - 1.0) / n * others.iter().map(|x| (x - mean).powi(2)).sum::<f64>()).sqrt();
        let t = students_t(0.975, n - 1.0).unwrap_or(f64::INFINITY);
        let (samples, half) = (samples + rest, (t * std).max(LEAST));
        if samples.is_finite() && half.is_finite() {
            return Ok(Lag { relation, samples, half });
        }
    }
    Err("the stretches do not agree".to_owned())
}

/// Stretches of equal length that both have, their means taken off.
fn stretches(log: &Log) -> Result<Vec<[Vec<f64>; 2]>, String> {
    let channels = ["first.x", "second.x"].map(|name| log.output(name).map_err(|e| e.to_string()));
    let [a, b] = channels;
    let (a, b) = (a?, b?);
    let there = |k: usize| a.get(k).is_some() && b.get(k).is_some();
    let usable = (0..log.len()).filter(|k| there(*k)).count();
    let length = (usable / STRETCHES).clamp(SHORTEST, LONGEST);
    let (mut parts, mut from) = (Vec::new(), 0);
    let centred = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter().map(|v| v - mean).collect::<Vec<f64>>()
    };
    for k in 0..log.len() {
        if !there(k) {
            from = k + 1;
        } else if k + 1 - from == length {
            parts.push([centred(&a.values[from..=k]), centred(&b.values[from..=k])]);
            from = k + 1;
        }
    }
    if parts.len() < FEWEST {
        return Err(format!(
            "{} stretches of {length} samples without a gap, at least {FEWEST} are needed",
            parts.len()
        ));
    }
    Ok(parts)
}

fn spectra(parts: &[[Vec<f64>; 2]], left_out: Option<usize>) -> CrossSpectra {
    let kept = parts.iter().enumerate().filter(move |(at, _)| Some(*at) != left_out);
    CrossSpectra::welch(
        kept.map(|(_, [a, b])| (a.as_slice(), b.as_slice())),
        parts.first().map_or(1, |[a, _]| a.len()),
    )
}

/// The lines of a spectrum that count: frequency in rad per sample, direction of the cross-spectrum, weight, variance of the phase.
struct Lines(Vec<(f64, Complex<f64>, f64, f64)>);

impl Lines {
    fn of(spectra: &CrossSpectra) -> Self {
        let coherence = spectra.coherence();
        let strongest = |power: &[f64]| power.iter().skip(2).copied().fold(0.0, f64::max);
        let least = [STRONG * strongest(&spectra.uu), STRONG * strongest(&spectra.yy)];
        let strong = |k: usize| spectra.uu[k] >= least[0] && spectra.yy[k] >= least[1];
        // The lowest lines have the part of the mean that the window leaves.
        let lines = spectra
            .uy
            .iter()
            .zip(&coherence)
            .enumerate()
            .skip(2)
            .filter(|(k, (s, c))| **c >= COHERENT && strong(*k) && s.norm() > 0.0)
            .map(|(k, (s, c))| {
                let sure = c.min(MOST);
                let variance = (1.0 - sure) / (2.0 * sure * spectra.looks.max(1.0));
                (spectra.omega(k), s / s.norm(), sure / (1.0 - sure), variance)
            });
        Self(lines.collect())
    }

    fn weight(&self) -> f64 {
        self.0.iter().map(|(_, _, w, _)| w).sum()
    }

    /// The weighted mean of the directions once a lag is taken off.
    fn at(&self, lag: f64) -> Complex<f64> {
        self.0
            .iter()
            .map(|(omega, s, w, _)| s * Complex::from_polar(*w, omega * lag))
            .sum::<Complex<f64>>()
            / self.weight()
    }

    /// The relation and the lag whose phase is nearest to a straight line.
    fn nearest(&self, most: f64) -> Result<(Relation, f64), String> {
        let fits = self.fits(most);
        let first = fits.first().filter(|fit| !fit.2.is_nan());
        first.map(|(relation, lag, _)| (*relation, *lag)).ok_or_else(|| {
            "no offset makes one of the other, of its derivative or of its integral".to_owned()
        })
    }

    /// The same, where its phase is a straight line but for what its variance leaves, and no other's is.
    fn only(&self, most: f64) -> Result<(Relation, f64), String> {
        let nearest = self.nearest(most)?;
        match self.fits(most).as_slice() {
            [(_, _, left), ..] if *left > LEFT => Err(
                "one is not the other at another time: its phase is no straight line over frequency, so that a lag or other dynamics lie between them".to_owned(),
            ),
            [(relation, at, _), (other, also, left), ..] if *left <= LEFT => Err(format!(
                "the motion has too narrow a band: the second {} the first, or {} it {} samples later",
                relation.words(),
                other.words(),
                short(also - at)
            )),
            _ => Ok(nearest),
        }
    }

    /// Relations and lags at which the lines point one way, with the mean squared phase that is left, over its variance; the least first.
    fn fits(&self, most: f64) -> Vec<(Relation, f64, f64)> {
        let steps = (most * FINE) as i64;
        let lag = |k: i64| k as f64 / FINE;
        let scores: Vec<(i64, [f64; 4])> = (-steps..=steps)
            .map(|k| (k, self.at(lag(k))))
            .map(|(k, z)| (k, Relation::ALL.map(|r| r.without(z).re)))
            .collect();
        let mut fits: Vec<(Relation, f64, f64)> = Vec::new();
        for around in scores.windows(3) {
            let [before, (k, here), after] = around else { continue };
            for (r, relation) in Relation::ALL.into_iter().enumerate() {
                if here[r] < POINTS || here[r] < before.1[r] || here[r] <= after.1[r] {
                    continue;
                }
                let refined = self.refined(relation, lag(*k));
                if !fits
                    .iter()
                    .any(|(other, at, _)| *other == relation && (at - refined).abs() < 0.5)
                {
                    fits.push((relation, refined, self.misfit(relation, refined)));
                }
            }
        }
        fits.sort_by(|a, b| a.2.total_cmp(&b.2));
        fits
    }

    /// The lag of least weighted squared phase near one, by Gauss and Newton.
    fn refined(&self, relation: Relation, mut lag: f64) -> f64 {
        for _ in 0..8 {
            let (mut slope, mut bend) = (0.0, 0.0);
            for (omega, s, w, _) in &self.0 {
                let left = relation.without(s * Complex::from_polar(1.0, omega * lag)).arg();
                slope += w * omega * left;
                bend += w * omega * omega;
            }
            lag -= slope / bend;
        }
        lag
    }

    /// The mean squared phase that a straight line leaves, over its variance.
    fn misfit(&self, relation: Relation, lag: f64) -> f64 {
        let left = |(omega, s, _, _): &(f64, Complex<f64>, f64, f64)| {
            relation.without(s * Complex::from_polar(1.0, omega * lag)).arg()
        };
        self.0.iter().map(|line| left(line).powi(2) / (line.3 + PHASE * PHASE)).sum::<f64>()
            / self.0.len() as f64
    }
}

//! Even grids, windows and resampling.

use super::channels::{Channel, Log, Rows};
use super::error::LogError;
use super::place::neighbours;
use deadtime_signal::time::SampleTime;

/// No time stamp of an even grid is further than this from the straight line through all, in samples.
const EVEN_SAMPLES: f64 = 0.05;
/// Two times closer than this are one, in samples: 0.3 s and 3 · 0.1 s differ in binary.
const SAME_SAMPLES: f64 = 1e-6;
/// A resampled log may have at most this many samples (1.6 GB a channel).
const MOST_SAMPLES: f64 = 2e8;

impl Log {
    /// The sample time of an evenly sampled log: the slope of the least-squares straight line through all time stamps.
    ///
    /// Even means that no stamp is further than 0.05 samples from that line. Where the stamps' own rounding hides a short decimal
    /// from the slope, that decimal is taken, so that 0.08 s stays 0.08 s.
    ///
    /// # Errors
    /// [`LogError::TooShort`] below two samples; [`LogError::UnevenTime`] naming the worst stamp.
    pub fn even_grid(&self) -> Result<SampleTime, LogError> {
        let (start_s, n) = (self.start_s(), self.len());
        if n < 2 {
            return Err(LogError::TooShort { file: self.source.clone(), needed: 2, found: n });
        }
        let count = n as f64;
        // t_k = t_0 + k·h + r_k: the residuals r_k of the chord are small, so their sums lose nothing over millions of rows.
        let h = self.duration_s() / (count - 1.0);
        let centre = (count - 1.0) / 2.0;
        let residuals = || {
            self.time_s
                .iter()
                .enumerate()
                .map(|(k, t)| (k as f64 - centre, (t - start_s) - k as f64 * h))
        };
        let (mut sum, mut moment) = (0.0, 0.0);
        for (x, r) in residuals() {
            sum += r;
            moment += x * r;
        }
        // Σ x² over the centred index.
        let tilt = moment / (count * (count * count - 1.0) / 12.0);
        let (mean, slope_s) = (sum / count, h + tilt);
        let (mut worst, mut worst_off_s) = (0, 0.0_f64);
        for (k, (x, r)) in residuals().enumerate() {
            let off_s = r - mean - tilt * x;
            if off_s.abs() > worst_off_s.abs() {
                (worst, worst_off_s) = (k, off_s);
            }
        }
        let deviation_samples = worst_off_s / slope_s;
        let uneven = || LogError::UnevenTime {
            file: self.source.clone(),
            place: self.rows.place(worst),
            time_s: self.time_s.get(worst).copied().unwrap_or(start_s),
            deviation_samples,
            suggested_s: rounded(self.median_step_s(), 6),
        };
        if deviation_samples.abs() <= EVEN_SAMPLES {
            SampleTime::new(self.decimal(slope_s)).map_err(|_| uneven())
        } else {
            Err(uneven())
        }
    }

    /// The log with one more channel: the slope of another channel from the sample before, in its units per second; 0 at the first sample.
    ///
    /// # Errors
    /// [`LogError`] for a channel that is not there or misses samples, and for a name that is taken.
    pub fn with_slope(self, name: &str, of: &str) -> Result<Self, LogError> {
        let values = self.input(of)?;
        let pairs = neighbours(values).zip(neighbours(&self.time_s));
        let slopes = std::iter::once(0.0)
            .chain(pairs.map(|((from, to), (before, after))| (to - from) / (after - before)))
            .collect();
        self.with_channel(Channel::new(name, None, slopes))
    }

    /// The log with one more channel.
    ///
    /// # Errors
    /// [`LogError`] for a name that is taken, and for another number of samples.
    pub fn with_channel(mut self, channel: Channel) -> Result<Self, LogError> {
        self.channels.push(channel);
        let early_s = self.early_s;
        Self::assemble(self.source, self.time_s, self.channels, self.unusable, self.rows)
            .map(|log| Self { early_s, ..log })
    }

    /// The part from `from_s` to `to_s`, both included, in seconds from the log's first sample; `None` is that end of the log.
    /// Time stamps stay as logged.
    ///
    /// # Errors
    /// [`LogError::EmptyWindow`] when no sample lies in it.
    pub fn window(&self, from_s: Option<f64>, to_s: Option<f64>) -> Result<Self, LogError> {
        let (start_s, duration_s) = (self.start_s(), self.duration_s());
        let slack_s = SAME_SAMPLES * duration_s / self.len() as f64;
        let (from_s, to_s) = (from_s.unwrap_or(0.0), to_s.unwrap_or(duration_s));
        let from = self.time_s.partition_point(|t| t - start_s < from_s - slack_s);
        let to = self.time_s.partition_point(|t| t - start_s <= to_s + slack_s);
        let empty =
            || LogError::EmptyWindow { file: self.source.clone(), from_s, to_s, duration_s };
        if from_s.is_nan() || to_s.is_nan() {
            return Err(empty());
        }
        let time_s =
            self.time_s.get(from..to).filter(|part| !part.is_empty()).ok_or_else(empty)?.to_vec();
        let channels = self.channels.iter().map(|channel| Channel {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
            values: channel.values.numbers().part(from, to).into(),
            present: channel
                .present
                .as_ref()
                .map(|present| present.get(from..to).unwrap_or_default().to_vec()),
        });
        let part = Self::assemble(
            self.source.clone(),
            time_s,
            channels.collect(),
            self.unusable.clone(),
            self.rows.cut(from, to),
        )?;
        Ok(Self { early_s: self.early_s, ..part })
    }

    /// The log on an even grid from its first sample to its last. The channels named in `held` keep their previous value (as a held input does), the others are
    /// interpolated linearly between neighbours. A sample is missing where a neighbour that it needs is missing.
    ///
    /// Nothing is filtered: a sample time well above the logged one folds frequencies above half its rate into the result.
    ///
    /// # Errors
    /// As [`Log::channel`] for the names in `held`. [`LogError::TooFine`] beyond 200 million samples. [`LogError::TimeStandsStill`] when the time stamps are
    /// too large for so small a step.
    pub fn resample(&self, sample_time: SampleTime, held: &[&str]) -> Result<Self, LogError> {
        for name in held {
            self.channel(name)?;
        }
        let (ts, start_s, duration_s) = (sample_time.seconds(), self.start_s(), self.duration_s());
        let last = (duration_s / ts + SAME_SAMPLES).floor();
        if last >= MOST_SAMPLES {
            let samples = last + 1.0;
            return Err(LogError::TooFine {
                file: self.source.clone(),
                sample_time_s: ts,
                samples,
                duration_s,
            });
        }
        let count = last as usize + 1;
        let slack_s = SAME_SAMPLES * ts;
        let (mut time_s, mut places, mut rows) =
            (Vec::with_capacity(count), Vec::with_capacity(count), Rows::new(self.rows.origin));
        let mut i = 0;
        for k in 0..count {
            let t = start_s + k as f64 * ts;
            while self.time_s.get(i + 1).is_some_and(|next| *next <= t + slack_s) {
                i += 1;
            }
            let before = self.time_s.get(i).copied().unwrap_or(start_s);
            let fraction = match self.time_s.get(i + 1) {
                Some(next) if t > before + slack_s => (t - before) / (next - before),
                _ => 0.0,
            };
            rows.note(k, self.rows.of(i));
            places.push((i, fraction));
            time_s.push(t);
        }
        let channels = self
            .channels
            .iter()
            .map(|channel| channel.at(&places, held.contains(&channel.name.as_str())));
        let moved = places.iter().any(|(_, fraction)| fraction.min(1.0 - fraction) > EVEN_SAMPLES);
        let early_s = self.early_s + if moved { self.median_step_s() + ts } else { 0.0 };
        let even = Self::assemble(
            self.source.clone(),
            time_s,
            channels.collect(),
            self.unusable.clone(),
            rows,
        )?;
        Ok(Self { early_s, ..even })
    }

    /// The median distance of two samples, s.
    pub fn median_step_s(&self) -> f64 {
        crate::csv::clock::median_step(&self.time_s)
    }

    /// The shortest decimal, of at most twelve digits, that the rounding of the time stamps hides from `slope_s` over the whole log.
    fn decimal(&self, slope_s: f64) -> f64 {
        let largest_s = self.time_s.last().copied().unwrap_or(0.0).abs().max(self.start_s().abs());
        let hidden_s = 4.0 * f64::EPSILON * largest_s / self.len() as f64;
        (1..=12)
            .map(|digits| rounded(slope_s, digits))
            .find(|short| (short - slope_s).abs() <= hidden_s)
            .unwrap_or(slope_s)
    }
}

impl Channel {
    /// The channel at places (sample before, fraction of the way to the next one).
    fn at(&self, places: &[(usize, f64)], held: bool) -> Self {
        let samples = self.samples();
        let pick = |&(i, fraction): &(usize, f64)| {
            let before = samples.get(i)?;
            if held || fraction == 0.0 {
                return Some(before);
            }
            Some(before * (1.0 - fraction) + samples.get(i + 1)? * fraction)
        };
        let picked = || places.iter().map(pick);
        Self {
            name: self.name.clone(),
            unit: self.unit.clone(),
            values: picked().map(|value| value.unwrap_or(0.0)).collect::<Vec<f64>>().into(),
            present: self.present.as_ref().map(|_| picked().map(|value| value.is_some()).collect()),
        }
    }
}

/// `x` to so many significant digits.
fn rounded(x: f64, digits: usize) -> f64 {
    format!("{x:.*e}", digits.saturating_sub(1)).parse().unwrap_or(x)
}

//! Time stamps and named channels, checked once when built.

use super::error::LogError;
use super::header::name_and_unit;
use super::numbers::Values;
use super::place::Place;
use deadtime_signal::time::LEAST_S;
use std::collections::HashSet;

/// Time stamps beyond this many seconds are refused: their differences would lose all meaning long before they overflow.
pub(super) const TIME_LIMIT_S: f64 = 1e100;

/// A measured log: N time stamps (strictly increasing, perhaps uneven) and channels of N samples each, N at least 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    pub(super) source: String,
    pub(super) time_s: Vec<f64>,
    pub(super) channels: Vec<Channel>,
    pub(super) unusable: Vec<Unusable>,
    pub(super) rows: Rows,
    pub(super) early_s: f64,
}

/// One named column of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    pub(super) name: String,
    pub(super) unit: Option<String>,
    pub(super) values: Values,
    pub(super) present: Option<Vec<bool>>,
}

/// A channel that may miss samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output<'a> {
    /// One value per time stamp, in the channel's unit; 0 where missing.
    pub values: &'a [f64],
    /// Which samples are there; `None` when all are.
    pub present: Option<&'a [bool]>,
}

/// A column without numbers, and the message for its request.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unusable {
    pub(super) name: String,
    pub(super) error: LogError,
}

/// The origin of a log's samples. From sample `.0` of a mark on, lines of the file (or indices of the arrays in memory) count up from the mark's `.1`.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    pub(super) origin: Origin,
    marks: Vec<(usize, usize)>,
}

/// Logs of the same samples are equal, independent of their place in a file.
impl PartialEq for Rows {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// The source of a log.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Origin {
    /// Numbers in memory: without a mark sample 0 is the first.
    #[default]
    Memory,
    /// A file: without a mark the first sample is in line 2, below a header.
    File,
}

impl Rows {
    pub(super) fn new(origin: Origin) -> Self {
        Self { origin, marks: Vec::new() }
    }

    pub(super) fn of(&self, sample: usize) -> usize {
        let after = self.marks.partition_point(|&(first, _)| first <= sample);
        let start = match self.origin {
            Origin::Memory => 0,
            Origin::File => 2,
        };
        let (first, row) =
            after.checked_sub(1).and_then(|i| self.marks.get(i)).copied().unwrap_or((0, start));
        row + (sample - first)
    }

    pub(super) fn place(&self, sample: usize) -> Place {
        match self.origin {
            Origin::Memory => Place::Sample(self.of(sample)),
            Origin::File => Place::Row(self.of(sample)),
        }
    }

    /// Notes the line of `sample`; samples come in order.
    pub(super) fn note(&mut self, sample: usize, row: usize) {
        if self.of(sample) != row {
            self.marks.push((sample, row));
        }
    }

    /// The lines of the samples `from..to` of this log, counted from 0.
    pub(super) fn cut(&self, from: usize, to: usize) -> Self {
        let mut rows = Self::new(self.origin);
        rows.note(0, self.of(from));
        for &(first, row) in self.marks.iter().filter(|(first, _)| (from + 1..to).contains(first)) {
            rows.note(first - from, row);
        }
        rows
    }
}

impl<'a> Output<'a> {
    /// The sample at `index`; `None` when it is missing or beyond the end.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<f64> {
        let there = self.present.is_none_or(|present| present.get(index).copied().unwrap_or(false));
        if there { self.values.get(index).copied() } else { None }
    }

    /// The number of existing samples.
    #[must_use]
    pub fn present_count(&self) -> usize {
        self.present
            .map_or(self.values.len(), |present| present.iter().filter(|there| **there).count())
    }
}

impl Channel {
    /// A channel without missing samples; `values` in `unit`, one per time stamp. [`Log::new`] checks it.
    pub fn new(name: impl Into<String>, unit: Option<&str>, values: Vec<f64>) -> Self {
        Self { name: name.into(), unit: unit.map(Into::into), values: values.into(), present: None }
    }

    /// A channel with missing samples, `present` false for these; their values do not matter. [`Log::new`] checks it.
    pub fn partial(
        name: impl Into<String>,
        unit: Option<&str>,
        values: Vec<f64>,
        present: Vec<bool>,
    ) -> Self {
        Self {
            name: name.into(),
            unit: unit.map(Into::into),
            values: values.into(),
            present: Some(present),
        }
    }

    /// A channel whose column is headed `name` or `name [unit]`. [`Log::new`] checks it.
    #[must_use]
    pub fn headed(header: &str, values: Vec<f64>, present: Option<Vec<bool>>) -> Self {
        let (name, unit) = name_and_unit(header);
        Self { name: name.into(), unit: unit.map(Into::into), values: values.into(), present }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its unit, if the log gives one.
    #[must_use]
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Its samples, missing ones marked.
    #[must_use]
    pub fn samples(&self) -> Output<'_> {
        Output { values: self.values.wide(), present: self.present.as_deref() }
    }

    /// Its samples one after the other, `None` where one is missing. Unlike [`Channel::samples`] it makes no room for all of them in double precision.
    pub fn iter(&self) -> impl Iterator<Item = Option<f64>> {
        let there = |at: usize| {
            self.present.as_ref().is_none_or(|present| present.get(at).copied().unwrap_or(false))
        };
        self.values.numbers().iter().enumerate().map(move |(at, value)| there(at).then_some(value))
    }

    /// Its header in a CSV file: `name` or `name [unit]`.
    pub fn header(&self) -> String {
        self.unit
            .as_ref()
            .map_or_else(|| self.name.clone(), |unit| format!("{} [{unit}]", self.name))
    }

    /// Checks name, lengths and numbers; missing values become 0 and a mark that marks nothing goes.
    fn checked(mut self, file: &str, samples: usize, rows: &Rows) -> Result<Self, LogError> {
        let header = self.header();
        let (name, unit) = name_and_unit(&header);
        let one_line = !header.chars().any(|c| c.is_control() && c != '\t');
        if name != self.name
            || unit != self.unit.as_deref()
            || name.is_empty()
            || name == "time"
            || !one_line
        {
            return Err(LogError::BadName { file: file.into(), channel: header });
        }
        let length = |found| LogError::Length {
            file: file.into(),
            channel: self.name.clone(),
            expected: samples,
            found,
        };
        if self.values.numbers().len() != samples {
            return Err(length(self.values.numbers().len()));
        }
        if let Some(present) = &self.present {
            if present.len() != samples {
                return Err(length(present.len()));
            }
            for (at, _) in present.iter().enumerate().filter(|(_, there)| !**there) {
                self.values.clear(at);
            }
            if present.iter().all(|there| *there) {
                self.present = None;
            }
        }
        match self.values.numbers().not_finite(0) {
            Some(i) => {
                let text = self
                    .values
                    .numbers()
                    .get(i)
                    .map_or_else(String::new, |value| value.to_string());
                Err(LogError::NotFinite {
                    file: file.into(),
                    place: rows.place(i),
                    channel: self.name,
                    text,
                })
            }
            None => Ok(self),
        }
    }
}

impl Log {
    /// A log from numbers in memory. `source` names it in errors and results (a file's name, for example), `time_s` in seconds.
    ///
    /// Errors name the sample, counted from 0.
    ///
    /// # Errors
    /// [`LogError`] for no sample, time that does not increase, a number that is not finite, or different lengths. Also for a name that is taken or cannot be a header.
    ///
    /// # Example
    /// ```
    /// use deadtime_log::{Channel, Log};
    /// let log = Log::new("dryer", vec![0.0, 0.08, 0.16], vec![Channel::new("heater", Some("V"), vec![3.4, 6.4, 6.4])])?;
    /// assert_eq!(log.even_grid()?.seconds(), 0.08);
    /// assert_eq!(log.input("heater")?, [3.4, 6.4, 6.4]);
    /// # Ok::<(), deadtime_log::LogError>(())
    /// ```
    pub fn new(
        source: impl Into<String>,
        time_s: Vec<f64>,
        channels: Vec<Channel>,
    ) -> Result<Self, LogError> {
        Self::assemble(source.into(), time_s, channels, Vec::new(), Rows::default())
    }

    /// The log with a non-numeric column: `text` at `sample` is its first invalid cell. A request for the column returns this error.
    ///
    /// # Errors
    /// [`LogError::DuplicateChannel`].
    pub fn without_numbers(
        mut self,
        name: impl Into<String>,
        sample: usize,
        text: impl Into<String>,
    ) -> Result<Self, LogError> {
        let (name, file) = (name.into(), self.source.clone());
        let error = LogError::NotANumber {
            file,
            place: self.rows.place(sample),
            channel: name.clone(),
            text: text.into(),
        };
        self.unusable.push(Unusable { name, error });
        let early_s = self.early_s;
        Self::assemble(self.source, self.time_s, self.channels, self.unusable, self.rows)
            .map(|log| Self { early_s, ..log })
    }

    pub(super) fn assemble(
        source: String,
        time_s: Vec<f64>,
        channels: Vec<Channel>,
        unusable: Vec<Unusable>,
        rows: Rows,
    ) -> Result<Self, LogError> {
        if time_s.is_empty() {
            return Err(match rows.origin {
                Origin::Memory => LogError::Nothing { file: source },
                Origin::File => LogError::NoSamples { file: source },
            });
        }
        let mut before_s = None;
        for (i, &now_s) in time_s.iter().enumerate() {
            time_follows(&source, || rows.place(i), before_s, now_s)?;
            before_s = Some(now_s);
        }
        if let (Some(first), Some(last)) = (time_s.first(), time_s.last())
            && time_s.len() > 1
        {
            let step_s = (last - first) / (time_s.len() - 1) as f64;
            if step_s < LEAST_S {
                return Err(LogError::TooFast { file: source, step_s });
            }
        }
        let channels = channels
            .into_iter()
            .map(|channel| channel.checked(&source, time_s.len(), &rows))
            .collect::<Result<Vec<_>, _>>()?;
        let log = Self { source, time_s, channels, unusable, rows, early_s: 0.0 };
        let mut seen = HashSet::new();
        if let Some(twice) = log.all_names().find(|name| !seen.insert(*name)) {
            return Err(LogError::DuplicateChannel {
                file: log.source.clone(),
                channel: twice.into(),
            });
        }
        Ok(log)
    }

    /// Where the log came from: the file as it was given, `FILE#VALUE` for one of several records.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The largest time by which a response may appear too early because the log was resampled, s. It is a step of the log's own, as outputs are interpolated,
    /// and one of the grid, as inputs are held. 0 where no sample had to be moved.
    #[must_use]
    pub fn early_s(&self) -> f64 {
        self.early_s
    }

    /// The time stamps as logged, in seconds; strictly increasing.
    #[must_use]
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// The number of samples, at least 1.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Never: a log has at least one sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// The time from the first sample to the last, in seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0) - self.start_s()
    }

    /// The channels of numbers, in the file's order.
    pub fn channels(&self) -> impl ExactSizeIterator<Item = &Channel> {
        self.channels.iter()
    }

    /// The names of the channels of numbers, in the file's order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.channels.iter().map(Channel::name)
    }

    /// The unit of a channel; `None` when the log gives none or has no such channel.
    #[must_use]
    pub fn unit(&self, name: &str) -> Option<&str> {
        self.channels.iter().find(|channel| channel.name == name).and_then(Channel::unit)
    }

    /// Checks a channel's unit against the one a model gives it. Where either gives none, or the log has no such channel, there is nothing to check;
    /// `m/s²` is `m/s^2`, and a dot is a blank.
    ///
    /// # Errors
    /// [`LogError::Unit`].
    pub fn check_unit(&self, name: &str, modelled: Option<&str>) -> Result<(), LogError> {
        let plain = |unit: &str| {
            let spelt: String = unit.replace('²', "^2").replace('³', "^3").replace(['·', '*'], " ");
            spelt.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        match (self.unit(name), modelled) {
            (Some(logged), Some(modelled)) if plain(logged) != plain(modelled) => {
                Err(LogError::Unit {
                    file: self.source.clone(),
                    channel: name.into(),
                    logged: logged.into(),
                    modelled: modelled.into(),
                })
            }
            _ => Ok(()),
        }
    }

    /// Where a sample came from, for messages: the line of the file, or the sample that was given. After [`Log::resample`], that of the
    /// logged sample at or before it.
    #[must_use]
    pub fn place(&self, sample: usize) -> Place {
        self.rows.place(sample)
    }

    /// A channel by its name.
    ///
    /// # Errors
    /// [`LogError::UnknownChannel`] with the names there are; [`LogError::NotANumber`] or [`LogError::NotFinite`] when the column holds
    /// such a cell.
    pub fn channel(&self, name: &str) -> Result<&Channel, LogError> {
        if let Some(channel) = self.channels.iter().find(|channel| channel.name == name) {
            return Ok(channel);
        }
        match self.unusable.iter().find(|column| column.name == name) {
            Some(column) => Err(column.error.clone()),
            None => Err(LogError::unknown_channel(&self.source, name, self.all_names())),
        }
    }

    /// A channel that must have every sample: one value per time stamp, in the channel's unit.
    ///
    /// # Errors
    /// As [`Log::channel`]; [`LogError::MissingInput`] naming the first missing sample.
    pub fn input(&self, name: &str) -> Result<&[f64], LogError> {
        let channel = self.channel(name)?;
        let missing =
            channel.present.as_ref().and_then(|present| present.iter().position(|there| !there));
        match missing {
            None => Ok(channel.values.wide()),
            Some(i) => Err(LogError::MissingInput {
                file: self.source.clone(),
                place: self.rows.place(i),
                channel: name.into(),
                time_s: self.time_s.get(i).copied().unwrap_or(0.0),
            }),
        }
    }

    /// A channel that may miss samples, but not all of them.
    ///
    /// # Errors
    /// As [`Log::channel`]; [`LogError::MissingThroughout`].
    pub fn output(&self, name: &str) -> Result<Output<'_>, LogError> {
        let output = self.channel(name)?.samples();
        if output.present_count() == 0 {
            return Err(LogError::MissingThroughout {
                file: self.source.clone(),
                channel: name.into(),
            });
        }
        Ok(output)
    }

    /// The log with columns called by the model's names: pairs (model name, column), applied at once, so two columns may swap names.
    ///
    /// # Errors
    /// [`LogError::UnknownChannel`] for a column that is not there, [`LogError::MappedTwice`], [`LogError::NameTaken`],
    /// [`LogError::BadName`]; [`LogError::NotANumber`] or [`LogError::NotFinite`] for a column that cannot be used.
    pub fn rename(mut self, map: &[(String, String)]) -> Result<Self, LogError> {
        let mut targets: Vec<Option<&str>> = vec![None; self.channels.len()];
        for (name, column) in map {
            self.channel(column)?;
            let place = self.channels.iter().position(|channel| channel.name == *column);
            let Some(target) = place.and_then(|i| targets.get_mut(i)) else { continue };
            if let Some(first) = target.replace(name) {
                return Err(LogError::MappedTwice {
                    file: self.source,
                    channel: column.clone(),
                    first: first.into(),
                    second: name.clone(),
                });
            }
        }
        for (channel, target) in self.channels.iter_mut().zip(targets) {
            if let Some(name) = target {
                channel.name = name.into();
            }
        }
        let early_s = self.early_s;
        let renamed =
            Self::assemble(self.source, self.time_s, self.channels, self.unusable, self.rows);
        renamed.map(|log| Self { early_s, ..log }).map_err(|error| match error {
            LogError::DuplicateChannel { file, channel } => LogError::NameTaken { file, channel },
            other => other,
        })
    }

    /// All columns' names, those that hold no numbers last.
    fn all_names(&self) -> impl Iterator<Item = &str> + Clone {
        let unusable = self.unusable.iter().map(|column| column.name.as_str());
        self.channels.iter().map(Channel::name).chain(unusable)
    }

    pub(super) fn start_s(&self) -> f64 {
        self.time_s.first().copied().unwrap_or(0.0)
    }

    pub(super) fn end_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }
}

/// Checks one time stamp against the one before it.
pub(super) fn time_follows(
    file: &str,
    place: impl Fn() -> Place,
    before_s: Option<f64>,
    time_s: f64,
) -> Result<(), LogError> {
    if !time_s.is_finite() {
        return Err(LogError::NotFinite {
            file: file.into(),
            place: place(),
            channel: "time".into(),
            text: time_s.to_string(),
        });
    }
    if time_s.abs() > TIME_LIMIT_S {
        return Err(LogError::TimeRange { file: file.into(), place: place(), time_s });
    }
    match before_s {
        Some(before_s) if time_s == before_s => {
            Err(LogError::TimeStandsStill { file: file.into(), place: place(), time_s })
        }
        Some(before_s) if time_s < before_s => {
            Err(LogError::TimeRunsBack { file: file.into(), place: place(), before_s, time_s })
        }
        _ => Ok(()),
    }
}

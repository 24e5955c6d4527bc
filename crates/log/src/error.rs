//! The errors of a log; every variant holds the facts, every message has the fault, the place and the remedy.

use std::path::Path;

use deadtime_signal::file::FileError;
use deadtime_signal::remedied;
use deadtime_signal::remedy::{Message, Remedied, Remedy};
use deadtime_signal::text::closest;
use deadtime_signal::time::{LEAST_S, TimeError};

use super::frequency::FrequencyError;
use super::place::Place;
use crate::notes::Notes;

/// The errors of reading and using a log.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A log that cannot be read or used.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A file that the operating system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// A sample time that cannot be.
    #[error(transparent)]
    Time(#[from] TimeError),
}

impl Error {
    /// An operating-system error with the file it is about.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::io(path, source).into()
    }
}

/// A log that cannot be read or used. `file` is the log's source. `row` is the line as an editor counts it; the header is row 1. `place` is that line
/// or, for numbers in memory, the sample counted from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// Nothing in the file.
    #[error(
        "{file}: the file is empty; it needs a header row that begins with `time` and one row per sample"
    )]
    Empty {
        /// The log.
        file: String,
    },
    /// No samples in memory.
    #[error("{file}: no samples; a log has at least one")]
    Nothing {
        /// The log.
        file: String,
    },
    /// A header and nothing below it.
    #[error("{file}: no samples below the header row; record or export at least one row")]
    NoSamples {
        /// The log.
        file: String,
    },
    /// Bytes that are no UTF-8 text.
    #[error("{file}, row {row}: not text; export the log as CSV in UTF-8 (or as .csv.gz)")]
    NotText {
        /// The log.
        file: String,
        /// The line with the first such byte.
        row: usize,
    },
    /// Called .gz and is none.
    #[error(
        "{file}: called .gz but not compressed by gzip; rename it to .csv if it is plain text, or compress it with gzip"
    )]
    NotGzip {
        /// The log.
        file: String,
    },
    /// A gzip stream that breaks off or does not decode.
    #[error(
        "{file}: the gzip stream is damaged or cut off after row {row} ({reason}); copy or compress the file again"
    )]
    Gzip {
        /// The log.
        file: String,
        /// The last line that could be read; 0 when there was none.
        row: usize,
        /// The message of the decoder.
        reason: String,
    },
    /// No column can be the time.
    #[error("{}", self.remedied().unwrap_or_default())]
    FirstColumn {
        /// The log.
        file: String,
        /// The line of the header.
        row: usize,
        /// The first cell of the header.
        found: String,
    },
    /// The first row is numbers.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoHeader {
        /// The log.
        file: String,
        /// The first row.
        row: usize,
        /// Its cells.
        cells: usize,
    },
    /// No row has the requested value.
    #[error("{file}: no row has `{value}` in the column `{column}`; there are {}", listing(there))]
    NoSuchRows {
        /// The log.
        file: String,
        /// The column.
        column: Box<str>,
        /// The value.
        value: Box<str>,
        /// Some values of it.
        there: Vec<String>,
    },
    /// Rows of several instances take turns.
    #[error("{}", self.remedied().unwrap_or_default())]
    Instances {
        /// The log.
        file: String,
        /// The first row whose time does not follow.
        row: usize,
        /// The column that separates them.
        column: String,
        /// Its values.
        values: Vec<String>,
    },
    /// A date that may be read day first or month first.
    #[error("{}", self.remedied().unwrap_or_default())]
    DayOrMonth {
        /// The log.
        file: String,
        /// The row.
        row: usize,
        /// The date.
        text: String,
    },
    /// A cell of the time that is no number and no date that is known.
    #[error(
        "{file}, row {row}: the time `{text}` in `{column}` is not understood{}; write it as `2026-02-01 13:00:00.5` or as a number of seconds",
        if *half { " (hours and minutes, or minutes and seconds?)" } else { "" }
    )]
    NotATime {
        /// The log.
        file: String,
        /// The row.
        row: usize,
        /// The column of time.
        column: String,
        /// The cell, shortened if long.
        text: String,
        /// It is two numbers with a colon between them.
        half: bool,
    },
    /// Time in a unit that is not known.
    #[error("{}", self.remedied().unwrap_or_default())]
    TimeUnit {
        /// The log.
        file: String,
        /// The line of the header.
        row: usize,
        /// The unit that the header gives.
        unit: String,
    },
    /// Several topics where one log is wanted.
    #[error("{file}: several topics; name channels as TOPIC.FIELD; there are {}", listing(topics))]
    SeveralTopics {
        /// The log.
        file: String,
        /// The topics.
        topics: Vec<String>,
    },
    /// A file of a known format with a wrong beginning or an unsupported feature.
    #[error("{file}: {format}: {what}")]
    Format {
        /// The log.
        file: String,
        /// The name of the format.
        format: &'static str,
        /// The fault and the remedy.
        what: String,
    },
    /// Samples closer to each other than any recorder takes them.
    #[error(
        "{file}: a sample every {step_s:e} s, which no recorder takes ({LEAST_S:e} s is the least); is time in another unit?"
    )]
    TooFast {
        /// The log.
        file: String,
        /// The mean time from sample to sample, s.
        step_s: f64,
    },
    /// A file that takes more memory than may be taken.
    #[error("{}", self.remedied().unwrap_or_default())]
    Memory {
        /// The log.
        file: String,
        /// The limit, MiB.
        limit_mb: u64,
    },
    /// A path that is neither a file nor a folder.
    #[error(
        "{file}: a pipe or a device, which has no beginning to come back to; write it to a file first"
    )]
    NoFile {
        /// The log.
        file: String,
    },
    /// A file of topics without a single number.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoTopics {
        /// The log.
        file: String,
        /// The name of the format.
        format: &'static str,
        /// The notes of the reading.
        notes: Notes,
    },
    /// A channel in another unit than the model's.
    #[error(
        "{file}: `{channel}` is in {logged} here and in {modelled} in the model; convert one of them"
    )]
    Unit {
        /// The log.
        file: String,
        /// The channel.
        channel: String,
        /// The unit that the log's header gives.
        logged: String,
        /// The unit that the model gives.
        modelled: String,
    },
    /// Event times that do not increase.
    #[error(
        "{file}, row {row}: the event of `{channel}` at {time} is not behind the one before it ({before}); event times must increase"
    )]
    EventOrder {
        /// The log.
        file: String,
        /// The line of the event.
        row: usize,
        /// The column.
        channel: String,
        /// Time of the event before it.
        before: f64,
        /// Its time.
        time: f64,
    },
    /// A column without a name.
    #[error("{file}, row {row}: column {column} has no name; name it or delete it")]
    UnnamedColumn {
        /// The log.
        file: String,
        /// The line of the header.
        row: usize,
        /// Its number; the first is 1.
        column: usize,
    },
    /// Two columns of one name.
    #[error("{file}: two columns are called `{channel}`; rename or delete one of them")]
    DuplicateChannel {
        /// The log.
        file: String,
        /// Their name.
        channel: String,
    },
    /// A name or unit that a header could not carry: empty, `time`, with control characters, or ending like a unit.
    #[error(
        "{file}: `{channel}` cannot be the header of a channel; choose a name other than `time`, of one line, that \
         does not end like ` [unit]`"
    )]
    BadName {
        /// The log.
        file: String,
        /// The header it would get.
        channel: String,
    },
    /// Too many or too few cells.
    #[error(
        "{file}, row {row}: {found} cells where the header has {expected}; complete or delete the row, and write \
         numbers with a decimal point"
    )]
    RowLength {
        /// The log.
        file: String,
        /// The line.
        row: usize,
        /// The cells of the header.
        expected: usize,
        /// The cells of this row.
        found: usize,
    },
    /// A quoted cell does not end in its line.
    #[error(
        "{file}, row {row}: a quote is opened and not closed; keep each sample on one line and close the quote"
    )]
    OpenQuote {
        /// The log.
        file: String,
        /// The line.
        row: usize,
    },
    /// Channels of different lengths.
    #[error(
        "{file}: channel `{channel}` has {found} samples where time has {expected}; give every channel one value per time stamp"
    )]
    Length {
        /// The log.
        file: String,
        /// The channel.
        channel: String,
        /// The number of time stamps.
        expected: usize,
        /// The channel's number of values (or of marks for missing ones).
        found: usize,
    },
    /// Text where a number belongs.
    #[error(
        "{file}, {place}: channel `{channel}` holds `{text}`, which is no number; correct it, or {}",
        place.either("leave the cell empty for a missing sample", "mark a missing sample as such")
    )]
    NotANumber {
        /// The log.
        file: String,
        /// Where.
        place: Place,
        /// The column.
        channel: String,
        /// The cell, shortened if long.
        text: String,
    },
    /// A comma in a number that commas separate from others.
    #[error(
        "{file}, {place}: channel `{channel}` holds `{text}`, whose comma may be a decimal one or stand between thousands; \
         write numbers with a decimal point, or separate the columns by semicolons"
    )]
    Comma {
        /// The log.
        file: String,
        /// Where.
        place: Place,
        /// The column.
        channel: String,
        /// The cell, shortened if long.
        text: String,
    },
    /// NaN, an infinity, or a number beyond the range of `f64`.
    #[error(
        "{file}, {place}: channel `{channel}` holds `{text}`, which is no finite number; {}",
        place.either("leave the cell empty for a missing sample", "mark a missing sample as such")
    )]
    NotFinite {
        /// The log.
        file: String,
        /// Where.
        place: Place,
        /// The column.
        channel: String,
        /// The cell, shortened if long.
        text: String,
    },
    /// A row without a time.
    #[error(
        "{file}, row {row}: the `time` cell is empty; give every row its time in seconds or delete the row"
    )]
    EmptyTime {
        /// The log.
        file: String,
        /// The line.
        row: usize,
    },
    /// A time stamp too large for arithmetic.
    #[error(
        "{file}, {place}: channel `time` holds {time_s:e} s, beyond ±1e100 s; {}",
        place.either("correct it or delete the row", "correct it or leave the sample out")
    )]
    TimeRange {
        /// The log.
        file: String,
        /// Where.
        place: Place,
        /// The time stamp, in seconds.
        time_s: f64,
    },
    /// The same time stamp twice running.
    #[error(
        "{file}, {place}: channel `time` stands still at {time_s} s while other channels may go on; log time with more digits, or give every {} a time of its own",
        place.either("row", "sample")
    )]
    TimeStandsStill {
        /// The log.
        file: String,
        /// Where the second of the two is.
        place: Place,
        /// Both time stamps, in seconds.
        time_s: f64,
    },
    /// A time stamp before its predecessor.
    #[error("{}", self.remedied().unwrap_or_default())]
    TimeRunsBack {
        /// The log.
        file: String,
        /// Where time runs back.
        place: Place,
        /// The time stamp before, in seconds.
        before_s: f64,
        /// The time stamp there, in seconds.
        time_s: f64,
    },
    /// A frequency response that cannot be used.
    #[error("{file}: {error}")]
    Frequency {
        /// The file.
        file: String,
        /// Its fault.
        error: FrequencyError,
    },
    /// A step that a table of its response cannot have.
    #[error("{}", self.remedied().unwrap_or_default())]
    StepTime {
        /// The table.
        file: String,
        /// The declared time of the step, s.
        at_s: f64,
        /// The first row, s.
        first_s: f64,
        /// The last, s.
        last_s: f64,
        /// Their distance, s.
        step_s: f64,
    },
    /// A row that belongs to no record.
    #[error(
        "{file}, row {row}: the cell of `{channel}`, which names the record, is empty; fill it or delete the row"
    )]
    EmptyRecord {
        /// The log.
        file: String,
        /// The line.
        row: usize,
        /// The column that separates the records.
        channel: String,
    },
    /// No such channel.
    #[error("{file}: no channel is called `{channel}`{}; it has {}", suggestion(closest.as_deref()), listing(existing))]
    UnknownChannel {
        /// The log.
        file: String,
        /// The requested name.
        channel: String,
        /// The name nearest to it by edit distance, if any is near.
        closest: Option<String>,
        /// The log's channels.
        existing: Vec<String>,
    },
    /// Several channels end in the requested name.
    #[error("{file}: several channels are called `{channel}`; say which: {}", listing(matches))]
    AmbiguousChannel {
        /// The log.
        file: String,
        /// The requested name.
        channel: String,
        /// Their full names.
        matches: Vec<String>,
    },
    /// Channels of topics that were never logged at the same time.
    #[error("{file}: the channels have no time in common: {}", spans.iter().map(|(name, a, b)| format!("`{name}` {a} s to {b} s")).collect::<Vec<_>>().join(", "))]
    NoCommonTime {
        /// The log.
        file: String,
        /// Name, first and last stamp of each, s.
        spans: Vec<(String, f64, f64)>,
    },
    /// An input must be known at every sample.
    #[error("{}", self.remedied().unwrap_or_default())]
    MissingInput {
        /// The log.
        file: String,
        /// Where the first missing sample is.
        place: Place,
        /// The input.
        channel: String,
        /// Its time as logged, in seconds.
        time_s: f64,
    },
    /// A channel without a single sample.
    #[error(
        "{file}: channel `{channel}` has no sample in any row; choose another channel or another part of the log"
    )]
    MissingThroughout {
        /// The log.
        file: String,
        /// The channel.
        channel: String,
    },
    /// A grid needs two samples.
    #[error("{}", self.remedied().unwrap_or_default())]
    TooShort {
        /// The log.
        file: String,
        /// The samples needed.
        needed: usize,
        /// The samples there are.
        found: usize,
    },
    /// Time stamps off the straight line through all of them.
    #[error("{}", self.remedied().unwrap_or_default())]
    UnevenTime {
        /// The log.
        file: String,
        /// Where the worst stamp is.
        place: Place,
        /// The worst stamp as logged, in seconds.
        time_s: f64,
        /// Its distance from the line, in samples; positive when it is late.
        deviation_samples: f64,
        /// The median step to six digits, in seconds.
        suggested_s: f64,
    },
    /// A window that holds no sample.
    #[error("{}", self.remedied().unwrap_or_default())]
    EmptyWindow {
        /// The log.
        file: String,
        /// Where the window begins, in seconds from the first sample.
        from_s: f64,
        /// Where it ends, in seconds from the first sample.
        to_s: f64,
        /// The log's last sample, in seconds from its first.
        duration_s: f64,
    },
    /// A resampled log that would not fit.
    #[error("{}", self.remedied().unwrap_or_default())]
    TooFine {
        /// The log.
        file: String,
        /// The requested sample time, in seconds.
        sample_time_s: f64,
        /// The samples that it would make.
        samples: f64,
        /// The log's length, in seconds.
        duration_s: f64,
    },
    /// More numbers than are read into memory.
    #[error(
        "{file}, row {row}: more than {most:e} numbers, {gb:.1} GB of memory; leave out columns, or cut the file into parts"
    )]
    TooLarge {
        /// The log.
        file: String,
        /// The first row that is too much.
        row: usize,
        /// The numbers of all rows that are read.
        most: f64,
        /// Their need, 10⁹ bytes.
        gb: f64,
    },
    /// A column is given two names.
    #[error("{}", self.remedied().unwrap_or_default())]
    MappedTwice {
        /// The log.
        file: String,
        /// The column.
        channel: String,
        /// Its first new name.
        first: String,
        /// Its second new name.
        second: String,
    },
    /// Two columns would have the same name.
    #[error("{}", self.remedied().unwrap_or_default())]
    NameTaken {
        /// The log.
        file: String,
        /// The name.
        channel: String,
    },
}

remedied!(Error { Log });

impl LogError {
    /// A file that violates its format.
    pub(super) fn format(file: &str, format: &'static str, what: impl Into<String>) -> Self {
        Self::Format { file: file.to_owned(), format, what: what.into() }
    }

    /// A channel that is none of these.
    pub(super) fn unknown_channel<'a>(
        file: &str,
        wanted: &str,
        names: impl Iterator<Item = &'a str> + Clone,
    ) -> Self {
        Self::UnknownChannel {
            file: file.to_owned(),
            channel: wanted.to_owned(),
            closest: closest(wanted, names.clone()).map(Into::into),
            existing: names.map(Into::into).collect(),
        }
    }
}

impl Remedied for LogError {
    fn remedied(&self) -> Option<Message> {
        self.on_columns().or_else(|| self.on_time()).or_else(|| self.on_samples())
    }
}

impl LogError {
    /// The message on a header, on columns and on their names.
    fn on_columns(&self) -> Option<Message> {
        Some(match self {
            Self::FirstColumn { file, row, found } => {
                Message::from(format!("{file}, row {row}: no column is called `time` (the first is `{found}`); call it `time`, or say which it is with "))
                    .and(Remedy::TimeColumn)
            }
            Self::NoHeader { file, row, cells } => {
                Message::from(format!("{file}, row {row}: numbers only, where a header row should name the {cells} columns; name them with ")).and(Remedy::ColumnNames)
            }
            Self::Instances { file, row, column, values } => {
                let value = values.first().cloned().unwrap_or_default();
                let all = values.join(", ");
                Message::from(format!("{file}, row {row}: rows of several instances take turns, by the column `{column}` ({all}); read one of them with "))
                    .and(Remedy::Only { column: column.as_str().into(), value: value.into() })
            }
            Self::NoTopics { file, format, notes } => Message::from(format!("{file}: {format}: no topic with numbers")).and(why(notes)),
            Self::MappedTwice { file, channel, first, second } => {
                Message::from(format!("{file}: column `{channel}` is mapped twice, to `{first}` and to `{second}`; give each column one new name by "))
                    .and(Remedy::Rename)
            }
            Self::NameTaken { file, channel } => Message::from(format!("{file}: ")).and(Remedy::NewNames).and(format!(
                " two columns called `{channel}`; give each column a name of its own, and map an existing `{channel}` to another name"
            )),
            _ => return None,
        })
    }

    /// The message on time stamps.
    fn on_time(&self) -> Option<Message> {
        Some(match self {
            Self::DayOrMonth { file, row, text } => {
                Message::from(format!("{file}, row {row}: `{text}` may be read day first or month first; say which, `dmy` or `mdy`, with ")).and(Remedy::TimeUnit)
            }
            Self::TimeUnit { file, row, unit } => {
                Message::from(format!("{file}, row {row}: time is in `{unit}`; convert it to seconds, or say the unit with ")).and(Remedy::TimeUnit)
            }
            Self::TimeRunsBack { file, place, before_s, time_s } => {
                let back = Message::from(format!("{file}, {place}: channel `time` runs back from {before_s} s to {time_s} s; "));
                match place {
                    Place::Row(_) => back
                        .and("where single rows were written late, sort the rows by time; where the clock was set back or another record begins, sorting would mix the two: name the column that separates them ")
                        .and(Remedy::Records),
                    Place::Sample(_) => back.and("sort the samples by time, or, if they are of several records, make a log of each"),
                }
            }
            Self::StepTime { file, at_s, first_s, last_s, step_s } => Message::from(format!(
                "{file}: the step at {at_s} s is not at a row of the table, which reaches from {first_s} s to {last_s} s, a row every {step_s} s; give the time of a row as "
            ))
            .and(Remedy::StepTime),
            Self::UnevenTime { file, place, time_s, deviation_samples, suggested_s } => Message::from(format!(
                "{file}, {place}: time is uneven: the stamp {time_s} s is {deviation_samples:.3} samples from the straight \
                 line through all stamps (at most 0.05 counts as even); put the log on an even grid with "
            ))
            .and(Remedy::Resample)
            .and(", for instance ")
            .and(Remedy::ResampleAt { seconds: *suggested_s }),
            _ => return None,
        })
    }

    /// The message on the samples of a log, and on their number.
    fn on_samples(&self) -> Option<Message> {
        Some(match self {
            Self::MissingInput { file, place, channel, time_s } => {
                let fill = place.either("fill the cell, delete the row", "fill it in, leave the sample out");
                Message::from(format!("{file}, {place}: input `{channel}` has no sample at {time_s} s; {fill}, or choose another part of the log by "))
                    .and(Remedy::Window)
                    .and(" (only outputs may miss samples)")
            }
            Self::TooShort { file, needed, found } => {
                Message::from(format!("{file}: {found} samples, at least {needed} are needed; give a longer log or a wider ")).and(Remedy::Window)
            }
            Self::Memory { file, limit_mb } => Message::from(format!("{file}: reading it takes more than {limit_mb} MiB of memory, the limit for a file of its size: it is damaged, or packed unusually well; lift the limit by "))
                .and(Remedy::MaxMemory),
            Self::EmptyWindow { file, from_s, to_s, duration_s } => Message::from(format!("{file}: no sample from {from_s} s to {to_s} s; choose "))
                .and(Remedy::Window)
                .and(format!(" within 0 s to {duration_s} s, counted from the first sample")),
            Self::TooFine { file, sample_time_s, samples, duration_s } => {
                Message::from(format!("{file}: a sample time of {sample_time_s} s makes {samples:e} samples of {duration_s} s; give "))
                    .and(Remedy::Resample)
                    .and(" a larger sample time")
            }
            _ => return None,
        })
    }
}

/// Names in a message beyond this many are counted, not listed.
const LISTED: usize = 40;

fn why(notes: &[Message]) -> Message {
    let Some((first, others)) = notes.split_first() else { return Message::default() };
    others
        .iter()
        .fold(Message::from(" (").and(first.clone()), |all, note| all.and("; ").and(note.clone()))
        .and(")")
}

fn suggestion(closest: Option<&str>) -> String {
    closest.map_or_else(String::new, |name| format!(" (did you mean `{name}`?)"))
}

fn listing(names: &[String]) -> String {
    if names.is_empty() {
        return "no channels besides `time`".into();
    }
    let shown: Vec<String> = names.iter().take(LISTED).map(|name| format!("`{name}`")).collect();
    let rest = names.len() - shown.len();
    if rest == 0 { shown.join(", ") } else { format!("{} and {rest} more", shown.join(", ")) }
}

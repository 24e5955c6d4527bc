//! Options and calls that a message names: facts, which each face writes in its own words.

use std::fmt;
use std::ops::Deref;

/// An option or a call by which a reader changes what a message reports. Its `Display` is the library's own name for it.
#[derive(Debug, Clone, PartialEq)]
pub enum Remedy {
    /// The longest delay that is searched.
    MaxDelay,
    /// The time of a step in a table of its response.
    StepTime,
    /// The model of the plant.
    Model,
    /// Other names for the columns of a log.
    Rename,
    /// The column for one channel of the model.
    ColumnOf {
        /// The channel, by the model's name.
        channel: String,
    },
    /// Columns for channels of the model.
    Columns {
        /// Channel and column of each.
        of: Vec<(String, String)>,
    },
    /// The new names, as the cause of a conflict.
    NewNames,
    /// Two sequences of event times.
    Events,
    /// An input and an output.
    Channels,
    /// The column that separates the records of a file.
    Records,
    /// A part of the log.
    Window,
    /// An even grid of a sample time to choose.
    Resample,
    /// An even grid of a suggested sample time.
    ResampleAt {
        /// The sample time, s.
        seconds: f64,
    },
    /// The column of time.
    TimeColumn,
    /// The unit of time.
    TimeUnit,
    /// The senders' stamps in place of the recorder's.
    HeaderStamps,
    /// Reading parts whose checksum does not match, too.
    Unchecked,
    /// The names of the columns of a file without a header row.
    ColumnNames,
    /// The rows of a file that are read.
    Only {
        /// The column.
        column: Box<str>,
        /// The value of the rows to read.
        value: Box<str>,
    },
    /// A number that means a missing sample.
    Missing {
        /// The number.
        number: f64,
    },
    /// The declaration that the log is of a closed loop.
    ClosedLoop,
    /// The dead times that an identification is given.
    Delay,
    /// The channels of a simulator's states.
    States,
    /// A term that the model may lack.
    Candidate {
        /// The term, as `state += expression`.
        term: String,
    },
    /// A fit of all parameters of a model in equations.
    FitParameters,
    /// The identification of a model from logs.
    Identify,
    /// The time between two starts of a simulator.
    RestartEvery,
    /// The number of used rows.
    LookAt,
    /// The tried effects, and the longest time that a diagnosis may take.
    Effects,
    /// An option of the target of an export.
    ExportOption {
        /// Its name.
        name: &'static str,
    },
    /// The continuation of an unfinished study.
    Resume,
    /// A new baseline.
    Update,
    /// The folder of the blind cases.
    Cases,
    /// The memory that a study may take.
    MaxMemory,
    /// The room on the disk that a study may take.
    MaxDisk,
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::MaxDelay => "`max_delay`",
            Self::StepTime => "`step_time`",
            Self::Model => "`model`",
            Self::Rename | Self::ColumnOf { .. } | Self::Columns { .. } => "`rename`",
            Self::NewNames => "the new names make",
            Self::Events => "two sequences of them",
            Self::Channels => "an input and an output",
            Self::Records => "to `read_records`",
            Self::Window => "`window`",
            Self::Resample => "`resample(sample_time)`",
            Self::ResampleAt { seconds } => return write!(f, "`resample({seconds})`"),
            Self::TimeColumn => "`time`",
            Self::TimeUnit => "`time_unit`",
            Self::ColumnNames => "`columns`",
            Self::Only { column, value } => return write!(f, "`only` ({column}, {value})"),
            Self::Missing { number } => return write!(f, "`missing` of {number}"),
            Self::Unchecked => "`unchecked`",
            Self::HeaderStamps => "`stamps` of the header",
            Self::ClosedLoop => "the log is declared to be of a closed loop",
            Self::Delay => "`delay`",
            Self::States => "`states`",
            Self::Candidate { term } => return write!(f, "the candidate `{term}`"),
            Self::FitParameters => "`identify_structure`",
            Self::Identify => "`identify`",
            Self::RestartEvery => "`restart_every`",
            Self::LookAt => "`look_at`",
            Self::Effects => "`effects` or `longest_run_s`",
            Self::ExportOption { name } => return write!(f, "the option {name}"),
            Self::Resume => "`resume`",
            Self::Update => "`update`",
            Self::Cases => "`cases`",
            Self::MaxMemory => "`max_memory_gb`",
            Self::MaxDisk => "`max_disk_gb`",
        })
    }
}

/// How a face names a remedy.
pub type Words = fn(&Remedy) -> String;

/// A message with the remedies in it. It reads as the library's own text; [`Message::worded`] is the text of a face.
///
/// ```
/// use deadtime_signal::remedy::{Message, Remedy};
/// let message = Message::from("no delay within the window: give a longer ").and(Remedy::MaxDelay).and(", or exchange them");
/// assert_eq!(&*message, "no delay within the window: give a longer `max_delay`, or exchange them");
/// assert_eq!(message.worded(|_| "--max-delay".into()), "no delay within the window: give a longer --max-delay, or exchange them");
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Message(Box<Parts>);

/// A message's parts; on the heap, so that results with a message in their errors stay small.
#[derive(Debug, Clone, Default, PartialEq)]
struct Parts {
    text: String,
    /// Where in the text each remedy begins, in order.
    remedies: Vec<(usize, Remedy)>,
}

impl Message {
    /// The message, and more of it.
    #[must_use]
    pub fn and(mut self, more: impl Into<Self>) -> Self {
        let more = more.into();
        let from = self.0.text.len();
        self.0.text += &more.0.text;
        self.0.remedies.extend(more.0.remedies.into_iter().map(|(at, remedy)| (from + at, remedy)));
        self
    }

    /// Puts the message into the words of a face.
    pub fn word(&mut self, words: Words) {
        *self = self.worded(words).into();
    }

    /// The text in the words of a face.
    #[must_use]
    pub fn worded(&self, words: Words) -> String {
        let (mut text, mut done) = (String::with_capacity(self.0.text.len()), 0);
        for (at, remedy) in &self.0.remedies {
            text += self.0.text.get(done..*at).unwrap_or_default();
            text += &words(remedy);
            done = at + remedy.to_string().len();
        }
        text + self.0.text.get(done..).unwrap_or_default()
    }
}

impl From<&str> for Message {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl From<String> for Message {
    fn from(text: String) -> Self {
        Self(Box::new(Parts { text, remedies: Vec::new() }))
    }
}

impl From<Remedy> for Message {
    fn from(remedy: Remedy) -> Self {
        Self(Box::new(Parts { text: remedy.to_string(), remedies: vec![(0, remedy)] }))
    }
}

impl std::borrow::Borrow<str> for Message {
    fn borrow(&self) -> &str {
        &self.0.text
    }
}

impl Deref for Message {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0.text
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.text)
    }
}

impl serde::Serialize for Message {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0.text)
    }
}

impl<'de> serde::Deserialize<'de> for Message {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(Self::from)
    }
}

/// An error some of whose messages name remedies.
pub trait Remedied: fmt::Display {
    /// The message where it names a remedy.
    fn remedied(&self) -> Option<Message>;

    /// The message, whether it names one or not.
    fn message(&self) -> Message {
        self.remedied().unwrap_or_else(|| self.to_string().into())
    }
}

/// A layer's error names the remedies of the errors that it holds: `remedied!(Error { Log, Delay })`.
#[macro_export]
macro_rules! remedied {
    ($error:ty { $($variant:ident),+ $(,)? }) => {
        impl $crate::remedy::Remedied for $error {
            fn remedied(&self) -> Option<$crate::remedy::Message> {
                match self {
                    $(Self::$variant(inner) => $crate::remedy::Remedied::remedied(inner),)+
                    _ => None,
                }
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_remedy_of_a_joined_message_takes_the_words_of_the_face() {
        let first = Message::from("ä: ").and(Remedy::ResampleAt { seconds: 0.125 });
        let both = first.and("; ").and(Message::from(Remedy::Resume).and(" is a `resume`"));
        assert_eq!(both.to_string(), "ä: `resample(0.125)`; `resume` is a `resume`");
        let words = |remedy: &Remedy| {
            if *remedy == Remedy::Resume { "R".to_owned() } else { "long words".to_owned() }
        };
        assert_eq!(both.worded(words), "ä: long words; R is a `resume`");
    }
}

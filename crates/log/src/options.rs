//! How a file is to be read.

use deadtime_signal::progress::HowFar;

/// The unit of time stamps in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Seconds.
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
    /// Minutes.
    Min,
    /// Hours.
    H,
    /// Days, also as spreadsheets count them.
    D,
    /// Dates by ISO 8601.
    Iso,
    /// Dates with slashes or dashes, the day first.
    Dmy,
    /// Dates with slashes or dashes, the month first.
    Mdy,
}

impl TimeUnit {
    /// Their number in a second, below 1 where they are longer; dates are counted in nanoseconds.
    #[must_use]
    pub fn per_second(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e3,
            Self::Us => 1e6,
            Self::Ns | Self::Iso | Self::Dmy | Self::Mdy => 1e9,
            Self::Min => 1.0 / 60.0,
            Self::H => 1.0 / 3600.0,
            Self::D => 1.0 / 86_400.0,
        }
    }

    /// Its name in a sentence.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::S => "seconds",
            Self::Ms => "milliseconds",
            Self::Us => "microseconds",
            Self::Ns => "nanoseconds",
            Self::Min => "minutes",
            Self::H => "hours",
            Self::D => "days",
            Self::Iso | Self::Dmy | Self::Mdy => "dates",
        }
    }

    /// The stamps are dates.
    pub(super) fn is_dates(self) -> bool {
        matches!(self, Self::Iso | Self::Dmy | Self::Mdy)
    }
}

/// Which clock stamps the messages of a bag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Stamps {
    /// When the recorder got them: the same clock for all topics.
    #[default]
    Arrival,
    /// The sender's stamp in `header.stamp` or `timestamp`, for the topics that have it.
    Header,
}

/// How a file is to be read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadOptions {
    /// The column of time; `None`: by its name.
    pub time: Option<String>,
    /// The unit of time; `None`: by the name of its column and the size of its numbers.
    pub time_unit: Option<TimeUnit>,
    /// The clock of bags.
    pub stamps: Stamps,
    /// Reads parts whose checksum does not match, too; else they are left out and counted.
    pub unchecked: bool,
    /// The names of the columns of a text file without a header row; empty: its first row has them.
    pub columns: Vec<String>,
    /// The rows of a text file that are read: those whose cell in this column has this text or number; `None`: all.
    pub only: Option<(String, String)>,
    /// Numbers that mean a missing sample.
    pub missing: Vec<f64>,
    /// Memory that reading may take, bytes; `None`: 4 times the file and 64 MiB.
    pub memory: Option<u64>,
    /// The progress report of the reading.
    pub far: HowFar,
}

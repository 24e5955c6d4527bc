//! The options that say which log to read and which part of it.

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::log::{EventTimes, Log, read, read_events, read_records};
use crate::time::SampleTime;

/// Where the data come from.
#[derive(Debug, clap::Args)]
pub(super) struct Source {
    /// The log: CSV (or .csv.gz) with a header row, the first column `time` in seconds
    #[arg(value_name = "LOG")]
    pub(super) log: PathBuf,
    #[command(flatten)]
    pub(super) reading: Reading,
}

/// How logs are read, one or several.
#[derive(Debug, clap::Args)]
pub(super) struct Reading {
    /// Split the file into records at each new value of this column
    #[arg(long, value_name = "COLUMN")]
    records: Option<String>,
    /// Start of the part to use, seconds from the log's first sample
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// End of the part to use, seconds from the log's first sample
    #[arg(long, value_name = "S")]
    to: Option<f64>,
    /// Put an uneven log onto an even grid with this sample time (inputs held, the rest interpolated)
    #[arg(long, value_name = "S")]
    pub(super) resample: Option<f64>,
    /// Column of the log that carries a name of the model; may be repeated
    #[arg(long, value_name = "MODEL_NAME=COLUMN")]
    map: Vec<String>,
}

impl Source {
    /// The log's records; `held` are the channels that keep their value between samples.
    pub(super) fn read(&self, held: &[String]) -> anyhow::Result<Vec<Log>> {
        self.reading.read(&self.log, held)
    }
}

impl Source {
    /// Two columns of event times; what cuts, renames or resamples a log of samples means nothing there.
    pub(super) fn events(&self, columns: [&str; 2]) -> anyhow::Result<[EventTimes; 2]> {
        let r = &self.reading;
        if r.records.is_some() || r.from.is_some() || r.to.is_some() || r.resample.is_some() || !r.map.is_empty() {
            bail!("--events reads whole columns of event times: leave out --records, --from, --to, --resample and --map");
        }
        Ok(read_events(&self.log, columns)?)
    }
}

impl Reading {
    /// The records of one log; `held` are the channels that keep their value between samples.
    pub(super) fn read(&self, log: &Path, held: &[String]) -> anyhow::Result<Vec<Log>> {
        let mut map = Vec::with_capacity(self.map.len());
        for text in &self.map {
            let Some((name, column)) = text.split_once('=') else {
                bail!("--map {text}: write it as MODEL_NAME=COLUMN");
            };
            map.push((name.to_owned(), column.to_owned()));
        }
        let logs = match &self.records {
            Some(column) => read_records(log, column)?,
            None => vec![read(log)?],
        };
        let held: Vec<&str> = held.iter().map(String::as_str).collect();
        logs.into_iter()
            .map(|log| {
                let mut log = log.rename(&map)?;
                if self.from.is_some() || self.to.is_some() {
                    log = log.window(self.from, self.to)?;
                }
                if let Some(seconds) = self.resample {
                    log = log.resample(SampleTime::new(seconds)?, &held)?;
                }
                Ok(log)
            })
            .collect()
    }
}

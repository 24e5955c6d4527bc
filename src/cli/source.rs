//! The options for the log to read and its part.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;

use super::progress::Bar;
use super::show::Out;
use super::words::{option, pair};
use deadtime_log::{
    EventTimes, Log, ReadOptions, Recording, Stamps, TimeUnit, Wanted, csv, open, read_events,
    reader,
};
use deadtime_model::{Derived, ModelDocument};
use deadtime_signal::progress::HowFar;
use deadtime_signal::time::SampleTime;

/// Where the data come from.
#[derive(Debug, Args)]
pub(super) struct Source {
    /// The log: text with a header row and a column `time` in seconds (.csv, .csv.gz), or another format of `deadtime list readers`
    #[arg(value_name = "LOG")]
    pub(super) log: PathBuf,
    #[command(flatten)]
    pub(super) reading: Reading,
}

/// How logs are read, one or several.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading the log")]
pub(super) struct Reading {
    /// Split the file into records at each new value of this column
    #[arg(long, value_name = "COLUMN", hide_short_help = true)]
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
    /// A channel calculated from others, such as "speed [m/s]=hypot(vx,vy)"; may be repeated, see docs/logs.md
    #[arg(long, value_name = "NAME=EXPRESSION", hide_short_help = true)]
    channel: Vec<String>,
    #[command(flatten)]
    clock: Clock,
}

/// The words of a command line for the reading of logs, with their values.
pub(super) fn reading_words(arguments: impl Iterator<Item = String>) -> Vec<String> {
    let options = Reading::augment_args(clap::Command::new(""));
    let takes_value = |word: &str| {
        let (name, joined) = word
            .strip_prefix("--")?
            .split_once('=')
            .map_or_else(|| (word.trim_start_matches('-'), false), |(name, _)| (name, true));
        let option = options.get_arguments().find(|a| a.get_long() == Some(name))?;
        Some(!joined && option.get_action().takes_values())
    };
    let (mut words, mut value) = (Vec::new(), false);
    for word in arguments {
        let own = if value { Some(false) } else { takes_value(&word) };
        words.extend(own.map(|_| word));
        value = own == Some(true);
    }
    words
}

/// How time stamps are to be understood.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Reading the log")]
pub(super) struct Clock {
    /// Column of time in a log of text; default: the one called `time`, or like it
    #[arg(long, value_name = "COLUMN", hide_short_help = true)]
    time: Option<String>,
    /// Unit of that column; default: by its name and the size of its numbers, which is said
    #[arg(long, value_enum, value_name = "s|ms|us|ns|min|h|d|iso|dmy|mdy", hide_short_help = true)]
    time_unit: Option<UnitName>,
    /// Which stamps of a ROS bag to use
    #[arg(long, value_enum, default_value_t = StampsName::Arrival, hide_short_help = true)]
    stamps: StampsName,
    /// Read parts whose checksum does not match, too; default: they are named, left out and counted
    #[arg(long, hide_short_help = true)]
    unchecked: bool,
    /// Names of the columns of a text file without a header row, such as time,u,y
    #[arg(long, value_name = "NAME,NAME,…", value_delimiter = ',', hide_short_help = true)]
    columns: Vec<String>,
    /// Read the rows of a text file whose cell in this column has this value, such as I=0
    #[arg(
        long = "where",
        value_name = "COLUMN=VALUE",
        value_parser = one_of_rows,
        hide_short_help = true
    )]
    only: Option<(String, String)>,
    /// A number that stands for a missing sample, such as -9999 or -999.25; may be repeated
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, hide_short_help = true)]
    missing: Vec<f64>,
    /// Memory that reading a log may take, in GB; default: 4 times the file and 64 MiB
    #[arg(long, value_name = "GB", hide_short_help = true)]
    max_memory_gb: Option<f64>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum UnitName {
    S,
    Ms,
    Us,
    Ns,
    Min,
    H,
    D,
    Iso,
    /// Dates with slashes, the day first
    Dmy,
    /// Dates with slashes, the month first
    Mdy,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum StampsName {
    /// When the recorder got a message
    Arrival,
    /// What the sender wrote into `header.stamp` or `timestamp`
    Header,
}

/// A column and its value.
fn one_of_rows(text: &str) -> Result<(String, String), String> {
    let (column, value) = text.split_once('=').ok_or("write it as COLUMN=VALUE")?;
    Ok((column.to_owned(), value.to_owned()))
}

impl Clock {
    /// The options in the form of the library.
    pub(super) fn options(&self, far: &HowFar) -> ReadOptions {
        ReadOptions {
            time: self.time.clone(),
            time_unit: self.time_unit.map(|unit| match unit {
                UnitName::S => TimeUnit::S,
                UnitName::Ms => TimeUnit::Ms,
                UnitName::Us => TimeUnit::Us,
                UnitName::Ns => TimeUnit::Ns,
                UnitName::Min => TimeUnit::Min,
                UnitName::H => TimeUnit::H,
                UnitName::D => TimeUnit::D,
                UnitName::Iso => TimeUnit::Iso,
                UnitName::Dmy => TimeUnit::Dmy,
                UnitName::Mdy => TimeUnit::Mdy,
            }),
            stamps: match self.stamps {
                StampsName::Arrival => Stamps::Arrival,
                StampsName::Header => Stamps::Header,
            },
            unchecked: self.unchecked,
            columns: self.columns.clone(),
            only: self.only.clone(),
            missing: self.missing.clone(),
            memory: self.max_memory_gb.map(|gb| (gb * 1e9) as u64),
            far: far.clone(),
        }
    }
}

/// The channels that a command needs.
pub(super) struct Needed<'a> {
    /// Those that keep their value between samples.
    pub(super) inputs: &'a [String],
    /// Those that are measured.
    pub(super) outputs: &'a [String],
    /// Whether all outputs must be there.
    pub(super) required: bool,
}

impl Needed<'_> {
    /// The same channels as the file has them: behind `--map`, and the sources of those that are calculated.
    fn of_the_file(&self, map: &[(String, String)], derived: &[Derived]) -> Vec<Wanted> {
        let column = |name: &String| {
            map.iter().find(|(new, _)| new == name).map_or(name, |(_, column)| column).clone()
        };
        let held = [(self.inputs, true), (self.outputs, false)];
        let channels = held.iter().flat_map(|(names, held)| names.iter().map(|n| (n, *held)));
        let mut wanted: Vec<Wanted> = Vec::new();
        for (name, held) in channels {
            let channel = Wanted { name: column(name), held, required: self.required };
            for one in of_the_file(channel, derived) {
                if wanted.iter().all(|w| w.name != one.name) {
                    wanted.push(one);
                }
            }
        }
        wanted
    }
}

/// Looks at a file that was read.
pub(super) type See<'a> = &'a mut dyn FnMut(&Recording, &[Wanted]);

/// The channels of the file behind a wanted channel: itself, or the sources of a calculated one.
fn of_the_file(wanted: Wanted, derived: &[Derived]) -> Vec<Wanted> {
    let Some((last, before)) = derived.split_last() else { return vec![wanted] };
    if last.name() != wanted.name {
        return of_the_file(wanted, before);
    }
    // A source may be calculated by one of those before it.
    let sources = last.sources().iter().map(|name| Wanted { name: name.clone(), ..wanted });
    sources.flat_map(|source| of_the_file(source, before)).collect()
}

/// A check continues without missing channels; every other command reports the missing one.
fn sources_there(derived: &Derived, log: &Log, needed: &Needed<'_>) -> bool {
    needed.required || derived.sources().iter().all(|s| log.names().any(|n| n == s))
}

impl Reading {
    /// Two columns of event times; what cuts, renames or resamples a log of samples means nothing there.
    pub(super) fn events(&self, log: &Path, columns: [&str; 2]) -> anyhow::Result<[EventTimes; 2]> {
        let cut = self.records.is_some()
            || self.from.is_some()
            || self.to.is_some()
            || self.resample.is_some();
        if cut || !self.map.is_empty() || !self.channel.is_empty() {
            bail!(
                "--events reads whole columns of event times: leave out --records, --from, --to, --resample, --map and --channel"
            );
        }
        if reader(log)?.name != "csv" {
            bail!("{}: --events reads columns of text files only", log.display());
        }
        Ok(read_events(log, columns)?)
    }

    /// Whole logs, of a command in which `--to` means something else.
    pub(super) fn whole(map: Vec<String>, clock: Clock) -> Self {
        Self {
            records: None,
            from: None,
            to: None,
            resample: None,
            map,
            channel: Vec::new(),
            clock,
        }
    }

    /// The records of one log with the channels of a model, and the slopes that its inputs ask for.
    pub(super) fn read_for(
        &self,
        to: &Out<'_>,
        log: &Path,
        model: &ModelDocument,
        required: bool,
        see: See<'_>,
    ) -> anyhow::Result<Vec<Log>> {
        let inputs: Vec<String> = model
            .inputs()
            .iter()
            .filter(|c| c.derivative_of.is_none())
            .map(|c| c.name.clone())
            .collect();
        let outputs: Vec<String> = model.outputs().iter().map(|c| c.name.clone()).collect();
        let logs = self.read_seeing(
            to,
            log,
            &Needed { inputs: &inputs, outputs: &outputs, required },
            see,
        )?;
        Ok(logs.into_iter().map(|log| model.complete(log)).collect::<Result<_, _>>()?)
    }

    /// The records of one log.
    pub(super) fn read(
        &self,
        to: &Out<'_>,
        log: &Path,
        needed: &Needed<'_>,
    ) -> anyhow::Result<Vec<Log>> {
        self.read_seeing(to, log, needed, &mut |_, _| {})
    }

    /// The same; content of the file and wanted channels are shown before channels of several topics are resampled to one grid. Records of a file are of one
    /// topic.
    pub(super) fn read_seeing(
        &self,
        to: &Out<'_>,
        log: &Path,
        needed: &Needed<'_>,
        see: See<'_>,
    ) -> anyhow::Result<Vec<Log>> {
        let map = self.map.iter().map(|text| {
            let (name, column) = pair("map", text, "MODEL_NAME=COLUMN")?;
            Ok((name.to_owned(), column.to_owned()))
        });
        let map = map.collect::<anyhow::Result<Vec<_>>>()?;
        let derived =
            self.channel.iter().map(|text| Derived::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let bar = Bar::new(to);
        let options = self.clock.options(bar.far());
        let grid = self.resample.map(SampleTime::new).transpose()?;
        let mut even = false;
        let (logs, notes) = match &self.records {
            Some(_) if reader(log)?.name != "csv" => {
                bail!("{}: --records splits text files only", log.display())
            }
            Some(column) => csv::records(log, column, &options)?,
            None => {
                let mut recording = open(log, &options)?;
                let mut notes = std::mem::take(&mut recording.notes);
                let wanted = needed.of_the_file(&map, &derived);
                see(&recording, &wanted);
                even = recording.topics.iter().any(|topic| !topic.name.is_empty());
                // A file without topics is used unchanged: a long one is not held twice.
                let (log, more) = if even {
                    recording.together(&wanted, grid)?
                } else {
                    recording.into_log_of(&wanted)?
                };
                notes.extend(more);
                (vec![log], notes)
            }
        };
        drop(bar);
        for note in notes {
            eprintln!("{}: {}", log.display(), note.worded(option));
        }
        let held: Vec<&str> = needed.inputs.iter().map(String::as_str).collect();
        logs.into_iter()
            .map(|log| {
                let mut log = derived.iter().try_fold(log, |log, one| {
                    if sources_there(one, &log, needed) { one.add_to(log) } else { Ok(log) }
                })?;
                log = log.rename(&map)?;
                if self.from.is_some() || self.to.is_some() {
                    log = log.window(self.from, self.to)?;
                }
                if let Some(step) = grid.filter(|_| !even) {
                    log = log.resample(step, &held)?;
                }
                Ok(log)
            })
            .collect()
    }
}

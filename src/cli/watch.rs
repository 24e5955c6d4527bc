//! `deadtime watch`: the dead time of a machine whose log still grows, and its gap to a model.

use super::words::{option, worded};
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use serde::Serialize;

use super::show::Out;
use super::source::Clock;
use crate::report::text::unit;
use deadtime_delay::track::{Live, LiveOptions, Told, TrackerOptions};
use deadtime_gap::{ActingEffect, FoundParameter, GapOptions, GapTold, GapWatch};
use deadtime_log::{Follower, News, Row, reader};
use deadtime_model::ModelDocument;
use deadtime_signal::file::write_lines;
use deadtime_signal::progress::HowFar;

/// Watch a log of text that grows, and print changes of the dead time, and of the gap to a model, as they come
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime watch flight.csv --input rudder --output yaw_rate
  deadtime watch flight.csv --input rudder --output yaw_rate --until-idle 10 --json changes.jsonl
  deadtime watch flight.csv --input rudder --output yaw_rate --model model.toml --window 60
  deadtime watch flight.csv --input rudder --output yaw_rate --once --quiet --json -")]
pub(super) struct Watch {
    /// The log: text with a header row and a column of time; rows are added at its end
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Input channel (the command)
    #[arg(long, value_name = "U")]
    input: String,
    /// Output channel (the response)
    #[arg(long, value_name = "Y")]
    output: String,
    /// Longest delay to search, seconds; default 34 samples
    #[arg(long, value_name = "S")]
    max_delay: Option<f64>,
    /// Samples that the plant needs to respond without any dead time (its relative degree when sampled)
    #[arg(long, value_name = "N", default_value_t = TrackerOptions::default().bias)]
    degree_bias: usize,
    /// Samples that the first response is fitted to, before anything is reported
    #[arg(long, value_name = "N", default_value_t = TrackerOptions::default().learn)]
    learn: usize,
    /// Log-likelihood that a change must gain before it is reported: a lower one reports sooner, with more false alarms
    #[arg(long, value_name = "GAIN", default_value_t = TrackerOptions::default().alarm)]
    alarm: f64,
    /// A model, deadtime/model@1, whose gap to the log is diagnosed stretch by stretch; the log has its channels by their names
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Length of a stretch that is diagnosed, seconds
    #[arg(long, value_name = "S", default_value_t = 30.0, requires = "model")]
    window: f64,
    /// Seconds from look to look at the file
    #[arg(long, value_name = "S", default_value_t = 0.2)]
    every: f64,
    /// End when nothing was added for so many seconds; default: never
    #[arg(long, value_name = "S")]
    until_idle: Option<f64>,
    /// Read what is there, and end
    #[arg(long, conflicts_with = "until_idle")]
    once: bool,
    #[command(flatten)]
    clock: Clock,
}

/// Refused rows that are named on standard error; those behind are counted.
const NAMED: u64 = 20;

/// A line of JSON, in addition to those of [`Told`].
#[derive(Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
enum Line<'a> {
    Started { format: &'static str, log: &'a str, input: &'a str, output: &'a str },
    RowSkipped { why: &'a str },
    Replaced {},
    TimeBegins { row: usize },
    Ended { rows: u64, skipped: u64, between: u64, unfinished_row: Option<usize>, learnt: bool },
}

/// The output of lines, and the counts.
struct Said<'a> {
    to: &'a Out<'a>,
    json: Option<Box<dyn Write>>,
    log: String,
    rows: u64,
    skipped: u64,
}

/// The watch over the rows: the dead time, and the gap where there is a model, with the places of its channels in a row.
struct Watched {
    live: Live,
    gap: Option<GapWatch>,
    places: Vec<usize>,
}

impl Watch {
    /// Prints changes until it is ended; the JSON lines are deadtime/watch@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let every = seconds("--every", self.every)?;
        let idle = self.until_idle.map(|s| seconds("--until-idle", s)).transpose()?;
        self.max_delay.map(|s| seconds("--max-delay", s)).transpose()?;
        if reader(&self.log)?.name != "csv"
            || self.log.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"))
        {
            bail!(
                "{}: only plain text can be watched while it grows; `deadtime estimate --track` reads whole logs",
                self.log.display()
            );
        }
        let gap = match &self.model {
            Some(path) => {
                seconds("--window", self.window)?;
                Some(GapWatch::new(&ModelDocument::read(path)?, self.window, GapOptions::default()))
            }
            None => None,
        };
        let mut columns = vec![self.input.clone(), self.output.clone()];
        let mut places = Vec::new();
        for name in gap.iter().flat_map(GapWatch::channels) {
            let at = columns.iter().position(|c| c == name);
            places.push(at.unwrap_or(columns.len()));
            columns.extend(at.is_none().then(|| name.clone()));
        }
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let mut follower =
            Follower::open(&self.log, &columns, &self.clock.options(&HowFar::default()))?;
        let tracker = TrackerOptions {
            bias: self.degree_bias,
            learn: self.learn,
            alarm: self.alarm,
            ..TrackerOptions::default()
        };
        let live = Live::new(LiveOptions { max_delay_s: self.max_delay, tracker });
        let mut watched = Watched { live, gap, places };
        let (json, log) =
            (to.json_file().map(write_lines).transpose()?, self.log.display().to_string());
        let mut out = Said { to, json, log: log.clone(), rows: 0, skipped: 0 };
        out.line(&Line::Started {
            format: "deadtime/watch@1",
            log: &log,
            input: &self.input,
            output: &self.output,
        })?;
        let ends = |still: Duration| self.once || idle.is_some_and(|idle| still >= idle);
        follow(&mut follower, &mut out, &mut watched, every, ends)?;
        out.end(&mut watched, follower.unfinished())
    }
}

/// Takes rows as they come, until the log has been still for so long that this ends.
fn follow(
    follower: &mut Follower,
    out: &mut Said<'_>,
    watched: &mut Watched,
    every: Duration,
    ends: impl Fn(Duration) -> bool,
) -> anyhow::Result<()> {
    let mut grew = Instant::now();
    loop {
        let polled = follower.poll()?;
        for news in polled.news {
            out.news(news, watched)?;
        }
        if polled.grown {
            grew = Instant::now();
        } else if ends(grew.elapsed()) {
            break;
        } else {
            std::thread::sleep(every);
        }
    }
    for news in follower.finish() {
        out.news(news, watched)?;
    }
    Ok(())
}

fn seconds(option: &str, s: f64) -> anyhow::Result<Duration> {
    let duration = Duration::try_from_secs_f64(s).ok().filter(|d| !d.is_zero());
    duration.with_context(|| format!("{option} {s}: give a finite number of seconds above 0"))
}

impl Said<'_> {
    fn line(&mut self, what: &impl Serialize) -> anyhow::Result<()> {
        let Some(json) = &mut self.json else { return Ok(()) };
        let mut text = serde_json::to_string(what)?;
        text.push('\n');
        json.write_all(text.as_bytes()).and_then(|()| json.flush()).context("JSON lines")
    }

    fn news(&mut self, news: News, watched: &mut Watched) -> anyhow::Result<()> {
        match news {
            News::Row(Row { time_s, values, .. }) => {
                self.rows += 1;
                let value = |at: usize| values.get(at).copied().flatten();
                for told in watched.live.push(time_s, value(0), value(1))? {
                    self.line(&told)?;
                    self.to.line(&said(&told))?;
                }
                let of_model: Vec<Option<f64>> =
                    watched.places.iter().map(|at| value(*at)).collect();
                let told = match &mut watched.gap {
                    Some(gap) => gap.push(time_s, &of_model)?,
                    None => None,
                };
                self.gap(told)?;
            }
            News::Bad(error) => {
                self.skipped += 1;
                let why = worded(&error);
                self.line(&Line::RowSkipped { why: &why })?;
                if self.skipped <= NAMED {
                    eprintln!("{}; skipped", deadtime_signal::text::message(&why));
                }
                if self.skipped == NAMED {
                    eprintln!(
                        "{}: more rows that are skipped are counted, not named",
                        deadtime_signal::text::shown(&self.log)
                    );
                }
            }
            News::Note(note) => eprintln!(
                "{}",
                deadtime_signal::text::message(&format!("{}: {}", self.log, note.worded(option)))
            ),
            News::Replaced => {
                self.line(&Line::Replaced {})?;
                eprintln!(
                    "{}: truncated or replaced: read from its beginning",
                    deadtime_signal::text::shown(&self.log)
                );
            }
            News::TimeBegins { row } => {
                watched.live.restart();
                watched.gap.iter_mut().for_each(GapWatch::restart);
                self.line(&Line::TimeBegins { row })?;
                self.to
                    .line(&format!("row {row}: time begins anew, learning the response anew"))?;
            }
        }
        Ok(())
    }

    /// Every stretch as JSON, on the terminal what changed.
    fn gap(&mut self, told: Option<GapTold>) -> anyhow::Result<()> {
        let Some(mut told) = told else { return Ok(()) };
        if let GapTold::GapNotTold { why, .. } = &mut told {
            *why = why.worded(option).into();
        }
        self.line(&told)?;
        gap_said(&told).map_or(Ok(()), |text| self.to.line(&text))
    }

    fn end(
        &mut self,
        Watched { live, gap, .. }: &mut Watched,
        unfinished_row: Option<usize>,
    ) -> anyhow::Result<()> {
        let told = match gap {
            Some(gap) => gap.finish()?,
            None => None,
        };
        self.gap(told)?;
        let (rows, skipped, between, learnt) =
            (self.rows, self.skipped, live.extra(), live.has_learnt());
        self.line(&Line::Ended { rows, skipped, between, unfinished_row, learnt })?;
        let mut text = format!("{rows} rows read");
        for (count, what) in
            [(skipped, "skipped"), (between, "left out between two samples of the even grid")]
        {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        if let Some(row) = unfinished_row {
            text += &format!("; row {row} has no end yet and was left out");
        }
        if !learnt {
            text +=
                "; the response is not fitted yet: more rows in which the input moves are needed";
        }
        self.to.line(&text)
    }
}

/// The news of the gap, in words; `None` without news.
fn gap_said(told: &GapTold) -> Option<String> {
    match told {
        GapTold::Gap { changed: false, .. } => None,
        GapTold::Gap { from_s, to_s, error, floor, verdict, effects, .. } => {
            let per_cent = |v: &Option<f64>| {
                v.map_or_else(|| "not known".to_owned(), |v| format!("{:.1} %", 100.0 * v))
            };
            let number =
                |p: &FoundParameter| p.value.map(|v| format!("{} {v:.4}{}", p.name, unit(&p.unit)));
            let one = |e: &ActingEffect| {
                let numbers: Vec<String> = e.parameters.iter().filter_map(number).collect();
                format!("{} on {} ({})", e.effect, e.channel, numbers.join(", "))
            };
            let acting = match effects.as_slice() {
                [] => format!("nothing is named ({verdict})"),
                effects => effects.iter().map(one).collect::<Vec<_>>().join("; "),
            };
            Some(format!(
                "{from_s:.3} to {to_s:.3} s: gap {}, floor {}: {acting}",
                per_cent(error),
                per_cent(floor)
            ))
        }
        GapTold::GapNotTold { from_s, to_s, why } => {
            Some(format!("{from_s:.3} to {to_s:.3} s: no diagnosis: {why}"))
        }
    }
}

/// The news, in words.
fn said(told: &Told) -> String {
    let since = |since_s: &Option<f64>| {
        since_s.map_or_else(|| "long ago".to_owned(), |s| format!("{s:.3} s"))
    };
    match told {
        Told::Learning { time_s, sample_time_s, max_delay_s } => {
            let ts = format!("{sample_time_s:.4e}").parse().unwrap_or(*sample_time_s);
            format!(
                "{time_s:.3} s: a sample every {ts} s, dead times up to {max_delay_s:.4} s; learning the response"
            )
        }
        Told::Delay { time_s, delay_s, ci95_s: [low, high] } => {
            format!("{time_s:.3} s: dead time {delay_s:.4} s ({:.4} to {high:.4})", low.max(0.0))
        }
        Told::DelayChanged { time_s, from_s, to_s, since_s } => {
            format!(
                "{time_s:.3} s: dead time changed from {from_s:.4} s to {to_s:.4} s, since {}",
                since(since_s)
            )
        }
        Told::DelayMoved { time_s, from_s, delay_s, ci95_s: [low, high] } => {
            format!(
                "{time_s:.3} s: dead time moved from {from_s:.4} s to {delay_s:.4} s ({low:.4} to {high:.4})"
            )
        }
        Told::ResponseChanged { time_s, since_s } => {
            format!(
                "{time_s:.3} s: the response changed, since {}; learning it anew",
                since(since_s)
            )
        }
        Told::RowsMissing { from_s, to_s } => format!("{to_s:.3} s: no rows since {from_s:.3} s"),
    }
}

//! `deadtime gap`: where model and machine differ, which effect causes it, and how far the gap shrinks.

use std::path::PathBuf;

use super::criteria::Thresholds;
use super::progress::Bar;
use super::show::{Out, write};
use super::simulator::{Simulated, SimulatorArgs};
use super::source::{Reading, reading_words};
use super::words::option;
use crate::error::Error;
use crate::report::diagnosis::{caveat_lines, parameters_to_fit, ranking, summary};
use crate::report::folder::save;
use crate::report::isolability::text as isolability_text;
use crate::report::page;
use crate::report::terminal;
use deadtime_gap::{Diagnosis, GapError, GapOptions, Mode, diagnose, isolability};
use deadtime_log::{Log, LogError};
use deadtime_model::CandidateEntry;
use deadtime_model::effect::find;
use deadtime_signal::file::Lock;

/// Diagnose the gap between a model and logs of the real machine: where it lies, which unmodelled effect causes it, how far it shrinks
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime gap --model model.toml --log flight.csv
  deadtime gap --model model.toml --log flight.csv --out gap
  deadtime gap --model model.toml --log a.csv --log b.csv --holdout c.csv --out gap --full
  deadtime gap --model tanks.toml --log run.csv --candidate 'level2 += k*(level1 - level2); k in 0 to 1' --out gap
  deadtime gap --model model.toml --log flight.csv --horizon 50 --out gap
  deadtime gap --model model.toml --log flight.csv --isolability
  deadtime gap --simulator ./servo_model --input u --output angle --parameter damping=0.06 --log run.csv --out gap")]
pub(super) struct Gap {
    /// The model, deadtime/model@1; or give --simulator
    #[arg(
        long,
        value_name = "MODEL",
        required_unless_present = "simulator",
        conflicts_with = "simulator"
    )]
    model: Option<PathBuf>,
    /// A training log; may be repeated
    #[arg(long, value_name = "LOG", required = true)]
    log: Vec<PathBuf>,
    /// A held-out log, on which the reduction is measured; may be repeated. Without one, the last 30 % of each log are held out
    #[arg(long, value_name = "LOG")]
    holdout: Vec<PathBuf>,
    /// A term that the model may lack, as 'state += expression'. Names that the model does not know are free parameters, 0 where the term is nothing. After a
    /// semicolon follow their ranges, as 'k in 0 to 2, width = 0.1 in 0.01 to 1'. May be repeated
    #[arg(long, value_name = "TERM", conflicts_with = "simulator")]
    candidate: Vec<String>,
    /// Try the five terms that best describe what remains as candidates, in a second diagnosis
    #[arg(long, conflicts_with_all = ["simulator", "isolability"])]
    suggest: bool,
    /// What "predicted" means; default: simulation, or the predictor where the model has poles that do not decay within a log
    #[arg(long, value_enum, hide_short_help = true)]
    prediction: Option<ModeName>,
    /// Predict over this number of samples at a time, each time from the state that an observer has estimated from the log. A planner or a policy uses such
    /// predictions. The answer then has the error by horizon
    #[arg(long, value_name = "SAMPLES", conflicts_with_all = ["prediction", "simulator"], hide_short_help = true)]
    horizon: Option<usize>,
    /// Longest delay and lag to look for, seconds; default: 35 samples, at most a tenth of the shortest log
    #[arg(long, value_name = "S")]
    max_delay: Option<f64>,
    /// Rows to use of all logs together, from their beginning; --from and --to choose another part
    #[arg(long, value_name = "ROWS", default_value_t = 100_000, hide_short_help = true)]
    look_at: usize,
    /// Effects to try, by the names of `deadtime list effects`; default: all
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', hide_short_help = true)]
    effects: Vec<String>,
    /// The longest time of a diagnosis, minutes: one that is estimated to take longer is refused
    #[arg(long, value_name = "MINUTES", default_value_t = 10.0, hide_short_help = true)]
    max_minutes: f64,
    /// Seed of the bootstrap
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
    #[command(flatten)]
    thresholds: Thresholds,
    /// Only the answer, in two sentences
    #[arg(long, conflicts_with = "full")]
    brief: bool,
    /// Every sentence of the diagnosis in full, and the ranking with four digits
    #[arg(long)]
    full: bool,
    /// With --full: rows of the ranking to print
    #[arg(long, value_name = "N", default_value_t = 8, hide_short_help = true)]
    rows: usize,
    /// Only report which effects are distinguishable in these logs; nothing is diagnosed
    #[arg(long)]
    isolability: bool,
    /// Folder to write diagnosis.json, report.html and model_with_effects.toml to; without it the answer is printed alone
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Also write the page alone, one HTML file that needs no network
    #[arg(long, value_name = "FILE", conflicts_with = "isolability")]
    html: Option<PathBuf>,
    #[command(flatten)]
    simulator: SimulatorArgs,
    #[command(flatten)]
    reading: Reading,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ModeName {
    /// A free run of the model
    Simulation,
    /// One-step predictions of a fixed-gain observer
    Predictor,
}

/// The names of effects, each known.
fn known_effects(names: &[String]) -> anyhow::Result<Vec<String>> {
    for name in names {
        find(name)?;
    }
    Ok(names.to_vec())
}

impl Gap {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let mut subject = Simulated::new(self.model.as_deref(), &self.simulator)?;
        for term in &self.candidate {
            subject.suspect(CandidateEntry::from_text(term)?)?;
        }
        // From here on: of two runs into one folder the second is refused before it works.
        let _held = self.out.as_deref().filter(|_| !self.isolability).map(Lock::of).transpose()?;
        let read = |paths: &[PathBuf]| -> anyhow::Result<Vec<Log>> {
            let mut logs = Vec::new();
            for path in paths {
                logs.extend(subject.read(to, &self.reading, path, true, &mut |_, _| {})?);
            }
            Ok(logs)
        };
        let (logs, holdout) = (read(&self.log)?, read(&self.holdout)?);
        let options = self.options()?;
        if self.isolability {
            let bar = Bar::new(to);
            let found =
                isolability(&subject, &logs, &options, bar.far()).map_err(|e| self.in_file(e))?;
            drop(bar);
            to.json(&found)?;
            say!(to, "{}", isolability_text(&found).trim_end());
            return Ok(());
        }
        let bar = Bar::new(to);
        let found = diagnose(&subject, &logs, &holdout, &options, &|stage| {
            bar.far().at(stage.begins_at(), &stage)
        });
        drop(bar);
        let found = found.map_err(|e| self.in_file(e))?.worded(option);
        let written = self.out.as_deref().map(|out| save(&found, out)).transpose()?;
        write(self.html.as_ref(), || page::gap(&found))?;
        to.json(&found.diagnosis)?;
        if self.brief {
            return to.styled(&terminal::verdict(&found.diagnosis));
        }
        if self.full {
            say!(to, "{}", summary(&found));
            for caveat in caveat_lines(&found) {
                say!(to, "{caveat}");
            }
            say!(to, "\n{}", ranking(&found.diagnosis, self.rows).to_string().trim_end());
        } else {
            to.styled(&terminal::diagnosis(&found))?;
        }
        if let Some(command) = self.identify_command(&found.diagnosis, &logs) {
            say!(to, "\nTo fit these parameters alone:\n  {command}");
        }
        if let Some((out, written)) = self.out.as_deref().zip(written) {
            say!(to, "\nWritten to {}: {}.", out.display(), written.join(", "));
        }
        Ok(())
    }

    /// The options of the diagnosis.
    fn options(&self) -> anyhow::Result<GapOptions> {
        Ok(GapOptions {
            prediction: self.prediction.map(|mode| match mode {
                ModeName::Simulation => Mode::Simulation,
                ModeName::Predictor => Mode::Predictor,
            }),
            horizon: self.horizon,
            longest_delay_s: self.max_delay,
            rows: self.look_at,
            suggest: self.suggest,
            effects: known_effects(&self.effects)?,
            longest_run_s: 60.0 * self.max_minutes,
            seed: self.seed,
            criteria: self.thresholds.criteria()?,
            ..GapOptions::default()
        })
    }

    /// The command that fits the found effects; `None` where other effects than values of parameters act. It reads logs as this one does; uneven ones are
    /// resampled.
    fn identify_command(&self, d: &Diagnosis, logs: &[Log]) -> Option<String> {
        let (model, names) = (self.model.as_ref()?, parameters_to_fit(d)?);
        let word = |text: &str| {
            let plain = |c: char| c.is_alphanumeric() || "/._-=\\:".contains(c);
            if text.chars().all(plain) { text.to_owned() } else { format!("\"{text}\"") }
        };
        let file = |path: &PathBuf| word(&path.display().to_string());
        let mut words = vec![format!("deadtime identify --structure {}", file(model))];
        words.extend(self.log.iter().map(file));
        words.extend(self.holdout.iter().map(|path| format!("--holdout {}", file(path))));
        words.extend(reading_words(std::env::args()).iter().map(|text| word(text)));
        let uneven = |log: &Log| match log.even_grid() {
            Err(LogError::UnevenTime { suggested_s, .. }) => Some(suggested_s),
            _ => None,
        };
        words.extend(logs.iter().find_map(uneven).map(|ts| format!("--resample {ts}")));
        words.push(format!("--free {} --out fitted.toml", names.join(",")));
        Some(words.join(" "))
    }

    /// An error with its file.
    fn in_file(&self, error: deadtime_gap::Error) -> anyhow::Error {
        let error = Error::from(error);
        match (&error, &self.model) {
            (Error::Gap(GapError::Nuisance { .. }), Some(path)) => {
                anyhow::Error::from(error).context(path.display().to_string())
            }
            _ => error.into(),
        }
    }
}

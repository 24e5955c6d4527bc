//! `deadtime/study@1`: the results of a study.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::{Result, StudyError};
use super::keys::{Delay, Loop, Place, Truth};
use deadtime_signal::file::{read_text, write_atomic};

/// The format's name.
pub const FORMAT: &str = "deadtime/study@1";

/// A whole study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// `deadtime/study@1`.
    pub format: String,
    /// The plan's name.
    pub plan: String,
    /// The purpose of the plan.
    #[serde(default)]
    pub about: String,
    /// Seed.
    pub seed: u64,
    /// The program that ran it.
    pub program: String,
    /// Every cell.
    pub cells: Vec<Cell>,
    /// Means over the cells of a grid.
    #[serde(default)]
    pub scores: Vec<Score>,
}

/// One method on one setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The grid of the plan.
    #[serde(default)]
    pub grid: String,
    /// The plant.
    pub plant: String,
    /// The input.
    pub input: String,
    /// The output; `*`: all.
    pub output: String,
    /// The conversion to sampled time.
    pub c2d: String,
    /// The excitation.
    pub excitation: String,
    /// var(noise-free output)/var(noise); `None`: no noise, or one with an absolute level.
    pub snr: Option<f64>,
    /// The noise.
    pub noise: String,
    /// The loop.
    #[serde(rename = "loop")]
    pub loops: Loop,
    /// The controller of a closed loop.
    #[serde(default)]
    pub controller: Option<String>,
    /// Estimated from u or r.
    pub place: Place,
    /// Injected at this input, s, or how it was drawn.
    pub delay_s: Delay,
    /// Samples of a record.
    #[serde(default)]
    pub samples: usize,
    /// The sample time, s.
    #[serde(default)]
    pub sample_time_s: f64,
    /// Longest raw delay searched, samples.
    #[serde(default)]
    pub max_delay: usize,
    /// The reference of the answers.
    pub truth: Truth,
    /// The method.
    pub method: String,
    /// Options that differ from its defaults.
    pub options: Map<String, Value>,
    /// How its records were logged; `None`: every sample at its time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub logging: Option<String>,
    /// Digest of the definitions behind the names of this cell in its plan, and of the scoring. Cells of one key are comparable where the digest is the same.
    #[serde(default)]
    pub definition: String,
    /// Every record is the same for any seed: no noise, and nothing drawn.
    #[serde(default)]
    pub repeatable: bool,
    /// Records.
    pub trials: usize,
    /// Records whose error counts: those with an answer, or all where missing answers count.
    #[serde(default)]
    pub scored: usize,
    /// Root mean square error over the answers (over all records where missing answers count), samples.
    pub rms_samples: Option<f64>,
    /// Its 95 % interval.
    pub rms_ci95_samples: Option<[f64; 2]>,
    /// Mean error over the same, samples.
    pub bias_samples: Option<f64>,
    /// Mean of the raw answers, s.
    #[serde(default)]
    pub mean_raw_s: Option<f64>,
    /// Their standard deviation, s.
    #[serde(default)]
    pub std_raw_s: Option<f64>,
    /// Records without an answer: the method reported that it is undetermined.
    pub flagged: usize,
    /// Answers that are off by more than the plan's `wrong_samples` and whose interval leaves out the truth.
    pub unflagged_wrong: usize,
    /// Answers with an interval.
    #[serde(default)]
    pub intervals: usize,
    /// Share of the intervals that hold the truth.
    pub coverage95: Option<f64>,
    /// Root mean square of the records' Cramér-Rao bounds, samples.
    pub bound_rms_samples: Option<f64>,
    /// Root mean square of the standard deviations predicted before estimating, samples; `None` where the plan does not show them.
    #[serde(default)]
    pub predicted_rms_samples: Option<f64>,
    /// Mean processor time of an estimate on one core, s; no part of the result.
    pub time_per_estimate_s: Option<f64>,
    /// Root mean square error with the worst of the method's answers in this grid left out, in the order of the plan's `kept_percent`.
    #[serde(default)]
    pub kept: Vec<Kept>,
}

/// Root mean square error of a cell, with a share of all answers of its method in its grid kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// The share, percent.
    pub percent: f64,
    /// Root mean square error, samples; `None`: nothing of this cell is kept.
    pub rms_samples: Option<f64>,
}

/// A method over the cells of a grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// The grid.
    #[serde(default)]
    pub grid: String,
    /// Estimated from u or r.
    #[serde(default = "at_u")]
    pub place: Place,
    /// The method.
    pub method: String,
    /// Its options.
    #[serde(default)]
    pub options: Map<String, Value>,
    /// Answers kept, the worst left out, percent.
    pub kept_percent: f64,
    /// Mean over the cells of their root mean square errors, samples.
    pub mean_rms_samples: Option<f64>,
    /// Its 95 % interval at all answers kept; `None` else, as leaving out the worst has no simple one.
    #[serde(default)]
    pub ci95_samples: Option<[f64; 2]>,
}

fn at_u() -> Place {
    Place::U
}

impl Cell {
    /// The method with its options, as plans write them.
    #[must_use]
    pub fn method_text(&self) -> String {
        text(&self.method, &self.options)
    }

    /// Its results with nine digits, without run time and shares kept.
    fn brief(&self) -> Self {
        Self {
            rms_samples: self.rms_samples.map(nine_digits),
            rms_ci95_samples: self.rms_ci95_samples.map(|i| i.map(nine_digits)),
            bias_samples: self.bias_samples.map(nine_digits),
            mean_raw_s: self.mean_raw_s.map(nine_digits),
            std_raw_s: self.std_raw_s.map(nine_digits),
            coverage95: self.coverage95.map(nine_digits),
            bound_rms_samples: self.bound_rms_samples.map(nine_digits),
            time_per_estimate_s: None,
            kept: Vec::new(),
            ..self.clone()
        }
    }

    /// The identity of this cell in a study.
    #[must_use]
    pub fn key(&self) -> String {
        let Self {
            grid,
            plant,
            input,
            output,
            c2d,
            excitation,
            noise,
            delay_s,
            samples,
            sample_time_s,
            max_delay,
            ..
        } = self;
        let snr = self.snr.map_or_else(|| "–".to_owned(), |v| v.to_string());
        let controller = self.controller.as_deref().unwrap_or("–");
        let logging = self.logging.as_ref().map_or_else(String::new, |l| format!(" {l}"));
        format!(
            "{grid}: {plant} {input}→{output} {c2d} {excitation} snr {snr} {noise} {:?} {controller} {:?} {delay_s} s {samples}×{sample_time_s} s ≤{max_delay}{logging}: {}",
            self.loops,
            self.place,
            self.method_text()
        )
    }
}

impl Score {
    fn brief(&self) -> Self {
        Self {
            mean_rms_samples: self.mean_rms_samples.map(nine_digits),
            ci95_samples: self.ci95_samples.map(|i| i.map(nine_digits)),
            ..self.clone()
        }
    }

    /// The method with its options, as plans write them.
    #[must_use]
    pub fn method_text(&self) -> String {
        text(&self.method, &self.options)
    }
}

fn text(method: &str, options: &Map<String, Value>) -> String {
    let options = options
        .iter()
        .map(|(k, v)| format!(" {k}={}", v.as_str().map_or_else(|| v.to_string(), str::to_owned)));
    method.to_owned() + &options.collect::<String>()
}

fn nine_digits(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

/// Members with defaults in readers: unknown values, and empty lists.
fn without_blanks(value: Value) -> Value {
    let blank = |v: &Value| v.is_null() || v.as_array().is_some_and(Vec::is_empty);
    match value {
        Value::Object(members) => members.into_iter().filter(|(_, v)| !blank(v)).collect(),
        other => other,
    }
}

impl Study {
    /// Reads `study.json`, or the folder that holds it.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`StudyError::Results`] for another format.
    pub fn read(path: &Path) -> Result<Self> {
        let path = if path.is_dir() { path.join("study.json") } else { path.to_owned() };
        let text = read_text(&path)?;
        let wrong =
            |detail: String| StudyError::Results { path: path.clone(), detail: detail.into() };
        let study: Self =
            serde_json::from_str(&text).map_err(|e| wrong(format!("no {FORMAT}: {e}")))?;
        if study.format != FORMAT {
            return Err(wrong(format!(
                "format is `{}`; this program reads `{FORMAT}`",
                study.format
            ))
            .into());
        }
        Ok(study)
    }

    /// Writes the baseline that a repository keeps for later comparisons: `study.json`, or the given file. It has no run times and no kept shares, nine digits
    /// of every result (on which processors agree), and one line per cell.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn write_baseline(&self, path: &Path) -> Result<()> {
        let path =
            if path.extension().is_some() { path.to_owned() } else { path.join("study.json") };
        let lines = |list: &mut dyn Iterator<Item = serde_json::Result<Value>>| -> serde_json::Result<String> {
            Ok(list.map(|v| v.map(|v| format!("    {}", without_blanks(v)))).collect::<serde_json::Result<Vec<_>>>()?.join(",\n"))
        };
        let text = |v: &str| Value::from(v).to_string();
        let whole = || -> serde_json::Result<String> {
            let cells = lines(&mut self.cells.iter().map(|c| serde_json::to_value(c.brief())))?;
            let scores = lines(&mut self.scores.iter().map(|s| serde_json::to_value(s.brief())))?;
            let (format, plan, about, program) =
                (text(&self.format), text(&self.plan), text(&self.about), text(&self.program));
            Ok(format!(
                "{{ \"format\": {format}, \"plan\": {plan}, \"about\": {about}, \"seed\": {}, \"program\": {program},\n  \"cells\": [\n{cells}\n  ],\n  \"scores\": [\n{scores}\n  ]\n}}",
                self.seed
            ))
        };
        let whole = whole().map_err(|e| StudyError::Results {
            path: path.clone(),
            detail: e.to_string().into(),
        })?;
        Ok(write_atomic(&path, |out| writeln!(out, "{whole}"))?)
    }

    /// Writes `study.json`.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).map_err(|e| StudyError::Results {
            path: path.to_owned(),
            detail: e.to_string().into(),
        })?;
        Ok(write_atomic(path, |out| writeln!(out, "{text}"))?)
    }
}

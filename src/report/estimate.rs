//! Estimates for people (a table and a sentence) and for machines (`deadtime/estimate@1`).

use std::fmt::Write;

use serde::Serialize;

use super::{Table, seconds};
use crate::delay::{Class, Condition, DelayEstimate, Finding, Method, Outcome, Verdict, distrust};

/// One method's answer, as the file has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// The method.
    pub method: String,
    /// What came of it.
    pub outcome: Outcome,
    /// The dead time, s.
    pub delay_s: Option<f64>,
    /// Its standard deviation, s.
    pub std_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// What the method's original definition returns, s.
    pub raw_delay_s: Option<f64>,
    /// Samples taken off the raw value.
    #[serde(serialize_with = "whole_if_it_is")]
    pub degree_bias_samples: f64,
    /// What a reader must know besides.
    pub note: Option<String>,
    /// The standard deviation that was to be expected of the method before it ran, s ([`crate::delay::richness`]).
    pub predicted_std_s: Option<f64>,
    /// Run time, s.
    pub time_s: f64,
    /// The heading it stands under.
    #[serde(skip)]
    pub class: Class,
    /// What the record shows that the method does not withstand.
    #[serde(skip)]
    pub distrust: Vec<Condition>,
    /// What the method leaves over contradicts its own model.
    #[serde(skip)]
    pub contradicted: bool,
}

impl Estimate {
    /// An answer with its method, what was to be expected of it, its run time, and what the record shows.
    #[must_use]
    pub fn new(method: &Method, estimate: &DelayEstimate, predicted_std_s: Option<f64>, time_s: f64, findings: &[Finding]) -> Self {
        Self {
            method: method.entry.name.to_owned(),
            outcome: estimate.outcome,
            delay_s: estimate.delay_s,
            std_s: estimate.std_s,
            ci95_s: estimate.ci95_s,
            raw_delay_s: estimate.raw_delay_s,
            degree_bias_samples: estimate.degree_bias_samples,
            note: estimate.note.clone(),
            predicted_std_s,
            time_s,
            class: method.class,
            distrust: distrust(method, findings),
            contradicted: estimate.contradicted,
        }
    }
}

/// All answers for one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// The input.
    pub input: String,
    /// The output; `*` where an answer holds whatever the output.
    pub output: String,
    /// What the record shows.
    #[serde(skip)]
    pub findings: Vec<Finding>,
    /// One answer per method, class by class.
    pub estimates: Vec<Estimate>,
    /// That neighbouring delays are hardly told apart, if so.
    #[serde(skip)]
    pub warning: Option<String>,
    /// What to believe.
    pub verdict: Verdict,
}

/// The file `deadtime/estimate@1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// `deadtime/estimate@1`.
    pub format: &'static str,
    /// The log.
    pub log: String,
    /// The sample time, s.
    pub sample_time_s: f64,
    /// The longest delay searched, s.
    pub max_delay_s: f64,
    /// One entry per input and output.
    pub pairs: Vec<Pair>,
}

/// The value of [`Report::format`].
pub const FORMAT: &str = "deadtime/estimate@1";

impl Report {
    /// The tables and sentences for a terminal: of many methods those whose answers count, unless the `full` table is asked for.
    #[must_use]
    pub fn text(&self, full: bool) -> String {
        let mut text = String::new();
        for pair in &self.pairs {
            let arrow = if pair.output == "*" { "the states".to_owned() } else { pair.output.clone() };
            let _ = writeln!(text, "\n{} → {arrow}", pair.input);
            if !pair.findings.is_empty() {
                let shown: Vec<String> = pair.findings.iter().map(|f| format!("{} ({})", f.condition.words(), f.evidence)).collect();
                let _ = writeln!(text, "The record shows {}.", shown.join("; "));
            }
            let shown = Shown::of(pair, full);
            text.push_str(&self.table(&shown).to_string());
            for estimate in &shown.rows {
                if let Some(note) = &estimate.note {
                    let _ = writeln!(text, "  {}: {note}", estimate.method);
                }
            }
            if let Some(warning) = &pair.warning {
                let _ = writeln!(text, "  {warning}");
            }
            let step = self.sample_time_s;
            let _ = match (&pair.verdict.delay_s, &pair.verdict.ci95_s) {
                (Some(delay), Some([from, to])) => writeln!(
                    text,
                    "Believe a dead time of {} s ({} to {} s): {}.",
                    seconds(*delay, step),
                    seconds(*from, step),
                    seconds(*to, step),
                    pair.verdict.why
                ),
                _ => writeln!(text, "Believe none of it: {}.", pair.verdict.why),
            };
        }
        text
    }

    fn table(&self, shown: &Shown<'_>) -> Table {
        let headings = [
            "method",
            "outcome",
            "dead time (s)",
            "std (s)",
            "predicted (s)",
            "95 % interval (s)",
            "raw (s)",
            "bias (samples)",
            "counts",
            "run time",
        ];
        let mut table = Table::new(&headings, &[0, 1, 8]);
        let step = self.sample_time_s;
        let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| seconds(v, step));
        let mut class = None;
        for e in &shown.rows {
            if shown.headed && class != Some(e.class) {
                class = Some(e.class);
                table.row(vec![format!("{}:", e.class.title())]);
            }
            let interval = e.ci95_s.map_or_else(|| "–".to_owned(), |[a, b]| format!("{} … {}", seconds(a, step), seconds(b, step)));
            let bias = if e.delay_s.is_some() { e.degree_bias_samples.to_string() } else { "–".to_owned() };
            let counts = match (e.outcome, e.distrust.as_slice()) {
                (Outcome::Found, []) if e.contradicted => "no: contradicted".to_owned(),
                (Outcome::Found, []) => "yes".to_owned(),
                (Outcome::Found, reasons) => format!("no: {}", reasons.iter().map(|c| c.words()).collect::<Vec<_>>().join(", ")),
                _ => "–".to_owned(),
            };
            table.row(vec![
                e.method.clone(),
                e.outcome.name().replace('_', " "),
                number(e.delay_s),
                number(e.std_s),
                number(e.predicted_std_s),
                interval,
                number(e.raw_delay_s),
                bias,
                counts,
                run_time(e.time_s),
            ]);
        }
        table
    }
}

/// As many methods as a person reads at a glance.
pub(super) const A_HANDFUL: usize = 8;

/// What a table shows of a pair: of many methods those whose answers count, the sentence below it names the others.
struct Shown<'a> {
    rows: Vec<&'a Estimate>,
    /// Under the headings of the classes.
    headed: bool,
}

impl<'a> Shown<'a> {
    fn of(pair: &'a Pair, full: bool) -> Self {
        let headed = pair.estimates.len() > A_HANDFUL;
        let folded = headed && !full && pair.estimates.iter().any(Estimate::counts);
        let mut rows: Vec<&Estimate> = pair.estimates.iter().filter(|e| !folded || e.counts()).collect();
        if headed {
            // Stable: within a class the order of the list.
            rows.sort_by_key(|e| e.class);
        }
        Self { rows, headed }
    }
}

impl Estimate {
    /// A delay was found, and the record shows nothing that the method does not withstand.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.outcome == Outcome::Found && self.distrust.is_empty() && !self.contradicted
    }
}

/// A whole number without a point, as the format has it.
#[allow(clippy::trivially_copy_pass_by_ref, clippy::cast_possible_truncation)]
fn whole_if_it_is<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.fract() == 0.0 && value.abs() < 1e15 { serializer.serialize_i64(*value as i64) } else { serializer.serialize_f64(*value) }
}

pub(super) fn run_time(time_s: f64) -> String {
    if time_s < 1e-3 {
        format!("{:.0} µs", time_s * 1e6)
    } else if time_s < 1.0 {
        format!("{:.1} ms", time_s * 1e3)
    } else {
        format!("{time_s:.1} s")
    }
}

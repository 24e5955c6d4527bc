//! `deadtime identify`: a linear model of inputs and outputs.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::Common;
use crate::cli::Out;
use crate::cli::progress::Waiting;
use crate::cli::source::Needed;
use crate::delay::{Job, Scope, chosen};
use crate::identify::subspace::{Direct, Identified, Recordings, identifier};
use crate::log::Log;
use crate::registry;
use crate::report::identify::Report;
use crate::time::SampleTime;

/// The options of a linear model.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "A linear model of inputs and outputs")]
pub(super) struct Linear {
    /// Input channel (the command); may be repeated
    #[arg(long, value_name = "U", required_unless_present = "structure", conflicts_with = "structure")]
    input: Vec<String>,
    /// Output channel (the response); may be repeated
    #[arg(long, value_name = "Y", required_unless_present = "structure", conflicts_with = "structure")]
    output: Vec<String>,
    /// Method; `deadtime list identifiers` shows them
    #[arg(long, value_name = "NAME", default_value = "pbsidopt")]
    method: String,
    /// Number of states, or `auto`
    #[arg(long, value_name = "N", default_value = "auto")]
    order: String,
    /// Samples of the past that predict, or `auto`
    #[arg(long, value_name = "P", default_value = "auto")]
    past: String,
    /// Dead time of an input, taken out first: INPUT=SECONDS (may be repeated), `none`, or `auto` to estimate it
    #[arg(long, value_name = "INPUT=S", default_value = "auto")]
    delay: Vec<String>,
    /// Estimate a direct path D too: the input acts within the sample
    #[arg(long)]
    direct: bool,
    /// Write the continuous model behind a zero-order hold, not the sampled one
    #[arg(long)]
    continuous: bool,
    /// Another option of the method, such as `max_order=20`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Share of each log that the model is learnt from where nothing is named to judge it on.
const LEARNT: f64 = 0.7;
/// What the delays are estimated by: established, fast, and of several classes.
const DELAY_METHODS: [&str; 3] = ["arxstruc", "oestruc", "threshold"];
/// A delay that misses a whole sample by less than this is that whole sample.
const NEARLY_WHOLE: f64 = 0.1;
/// A delay stays unless the model behind it is worse by this much in twice the log-likelihood.
const WORSE: f64 = 6.0;

impl Linear {
    pub(super) fn run(&self, common: &Common, to: &Out<'_>) -> anyhow::Result<()> {
        let waiting = Waiting::new(to, "identifying");
        let Some(out) = &common.out else { bail!("--out FILE is missing: where the model is to be written") };
        let logs = self.read(common, &common.logs)?;
        let all = Recordings::from_logs(&logs, &self.input, &self.output)?;
        let (learnt, judged, held_out) = if common.holdout.is_empty() {
            let (learnt, judged) = all.split(LEARNT);
            (learnt, judged, format!("the last {:.0} % of each record", 100.0 * (1.0 - LEARNT)))
        } else {
            let judged = Recordings::from_logs(&self.read(common, &common.holdout)?, &self.input, &self.output)?;
            all.sample_time.must_equal(judged.sample_time).context("--holdout")?;
            (all, judged, common.holdout.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", "))
        };
        let (identified, delays, delay_notes) = self.identified(&learnt, &logs)?;
        let file = identified.file(&name(out), &delays, self.continuous).map_err(|e| {
            anyhow::Error::new(e).context(if self.continuous {
                "--continuous: leave it out to write the sampled model"
            } else {
                "the model"
            })
        })?;
        let judged = judged.behind_delays(&delays)?;
        let report = Report {
            logs: common.logs.iter().map(|p| p.display().to_string()).collect(),
            model: &identified,
            delays: &delays,
            delay_notes,
            held_out,
            held_out_samples: judged.samples(),
            checks: identified.check(&judged),
        };
        drop(waiting);
        file.write(out)?;
        if to.wants_json() {
            to.json(&report.data()?)?;
        }
        say!(to, "{}\nwritten to {}", report.text().trim_end(), out.display());
        Ok(())
    }

    fn read(&self, common: &Common, paths: &[PathBuf]) -> anyhow::Result<Vec<Log>> {
        let needed = Needed { inputs: &self.input, outputs: &self.output, required: true };
        let records = paths.iter().map(|path| common.reading.read(path, &needed)).collect::<anyhow::Result<Vec<_>>>()?;
        Ok(records.into_iter().flatten().collect())
    }

    /// The method's options.
    fn options(&self, draws: Option<usize>) -> anyhow::Result<Value> {
        let mut options = registry::options(self.set.iter().map(String::as_str))?;
        let number = |option: &str, text: &str| match text {
            "auto" => Ok(None),
            text => match text.parse::<usize>() {
                Ok(n) if n > 0 => Ok(Some(n)),
                _ => bail!("--{option} {text}: write a whole number above 0, or auto"),
            },
        };
        if let Some(object) = options.as_object_mut() {
            for (option, text) in [("order", &self.order), ("past", &self.past)] {
                if let Some(n) = number(option, text)? {
                    object.insert(option.to_owned(), json!(n));
                }
            }
            if self.direct {
                object.insert("direct".to_owned(), json!(Direct::Free));
            }
            if let Some(draws) = draws {
                object.insert("draws".to_owned(), json!(draws));
            }
        }
        Ok(options)
    }

    /// The model and the delays, in samples, that were taken out first.
    fn identified(&self, learnt: &Recordings, logs: &[Log]) -> anyhow::Result<(Identified, Vec<usize>, Vec<String>)> {
        let line = identifier(&self.method)?;
        let whole = line.entry.with(self.options(None)?)?;
        let ts = learnt.sample_time;
        let none = vec![0; self.input.len()];
        let (delays, mut notes, estimated) = match self.delay.as_slice() {
            [one] if one == "auto" => {
                let (delays, notes) = self.estimated(logs, ts)?;
                (delays, notes, true)
            }
            [one] if one == "none" => (none.clone(), Vec::new(), false),
            given => {
                let (delays, notes) = self.given(given, ts)?;
                (delays, notes, false)
            }
        };
        if estimated && delays != none {
            // Without the delays the model must not be better.
            let quick = line.entry.with(self.options(Some(0))?)?;
            let longest = delays.iter().max().copied().unwrap_or(0);
            let same_rows = learnt.behind_delays(&vec![longest; delays.len()]).and(learnt.behind_delays(&delays))?;
            let (with, without) = (quick.identify(&same_rows)?, quick.identify(learnt)?);
            let criterion = |m: &Identified| {
                let parameters = m.order.order * (m.inputs.len() + 2 * m.outputs.len());
                let loss = m.order.candidates.get(m.order.order - 1).and_then(|c| c.log_loss).unwrap_or(f64::INFINITY);
                loss * m.rows as f64 + parameters as f64 * (m.rows as f64).ln()
            };
            let scaled = criterion(&without) * with.rows as f64 / without.rows as f64;
            if criterion(&with) > scaled + WORSE {
                notes.push("the estimated delays make the model worse, so none was taken out; give them with --delay".to_owned());
                return Ok((whole.identify(learnt)?, none, notes));
            }
        }
        Ok((whole.identify(&learnt.behind_delays(&delays)?)?, delays, notes))
    }

    fn given(&self, texts: &[String], ts: SampleTime) -> anyhow::Result<(Vec<usize>, Vec<String>)> {
        let (mut delays, mut notes) = (vec![0; self.input.len()], Vec::new());
        for text in texts {
            let Some((name, delay_s)) = text.split_once('=').and_then(|(name, s)| Some((name, s.parse::<f64>().ok()?))) else {
                bail!("--delay {text}: write it as INPUT=SECONDS with an input of the model ({}), or auto or none", self.input.join(", "));
            };
            let Some((_, delay)) = self.input.iter().zip(&mut delays).find(|(input, _)| *input == name) else {
                bail!("--delay {text}: write it as INPUT=SECONDS with an input of the model ({}), or auto or none", self.input.join(", "));
            };
            let samples = ts.samples(delay_s).with_context(|| format!("--delay {text}"))?;
            if samples.fraction != 0.0 {
                let share = samples.fraction;
                notes.push(format!("{}: {share:.2} of a sample of its delay stays within the model", name));
            }
            *delay = samples.whole;
        }
        Ok((delays, notes))
    }

    /// The shortest delay of each input to any output that is to be believed, as the existing estimators say.
    fn estimated(&self, logs: &[Log], ts: SampleTime) -> anyhow::Result<(Vec<usize>, Vec<String>)> {
        let names: Vec<String> = DELAY_METHODS.iter().map(|n| (*n).to_owned()).collect();
        let methods = chosen(&names, &std::collections::BTreeMap::new(), &[Scope::Pair])?;
        let job = Job { name: String::new(), methods, ..Job::new(logs.to_vec(), &self.input, &self.output) };
        let report = job.run()?;
        let mut notes = Vec::new();
        let delay = |input: &String| {
            let of_input = report.pairs.iter().filter(|p| p.input == *input);
            let believed = of_input.filter_map(|p| {
                let delay_s = p.verdict.delay_s?;
                // Where the interval is wider than two samples, its lower end: too long a delay harms, too short a one costs a state.
                let unsure = p.verdict.ci95_s.filter(|ci| ci[1] - ci[0] > 2.0 * ts.seconds());
                Some(unsure.map_or(delay_s, |ci| ci[0].min(delay_s)))
            });
            believed.reduce(f64::min).map(|s| (s.max(0.0) / ts.seconds() + NEARLY_WHOLE).floor() as usize)
        };
        let delays = self.input.iter().map(|input| match delay(input) {
            Some(samples) => samples,
            None => {
                notes.push(format!(
                    "{input}: its dead time cannot be told beforehand, so none is taken out; give it with --delay if it is known"
                ));
                0
            }
        });
        let delays = delays.collect();
        Ok((delays, notes))
    }
}

/// What a model is called: as its file.
fn name(out: &Path) -> String {
    out.file_stem().map_or_else(|| "identified".to_owned(), |s| s.to_string_lossy().into_owned())
}

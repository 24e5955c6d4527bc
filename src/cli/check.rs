//! `deadtime check`: whether a model and logs fit, before anyone diagnoses.

use super::words::option;
use std::path::PathBuf;

use super::progress::Bar;
use super::show::{Out, write};
use super::simulator::{Simulated, SimulatorArgs};
use super::source::Reading;
use crate::report::checks::text;
use crate::report::page;
use crate::report::page::Measured;
use deadtime_gap::{Inspection, clocks, inspect};
use deadtime_log::{Channel, Log};
use deadtime_model::effect::OnLog;
use deadtime_signal::stop::Stop;

/// Check a model and logs before diagnosing: names, units, time stamps, signs, axes, clocks, stuck and clipped channels, excitation, operating point
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime check --model model.toml --log flight.csv
  deadtime check --model model.toml --log a.csv --log b.csv --json checks.json")]
pub(super) struct Check {
    /// The model, deadtime/model@1; or give --simulator
    #[arg(
        long,
        value_name = "MODEL",
        required_unless_present = "simulator",
        conflicts_with = "simulator"
    )]
    model: Option<PathBuf>,
    /// A log; may be repeated
    #[arg(long, value_name = "LOG", required = true)]
    log: Vec<PathBuf>,
    /// Also write what was found as a page, one file that needs no network
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    simulator: SimulatorArgs,
    #[command(flatten)]
    reading: Reading,
}

impl Check {
    /// Prints the findings; as JSON they are deadtime/check@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let subject = Simulated::new(self.model.as_deref(), &self.simulator)?;
        let mut logs: Vec<Log> = Vec::new();
        let mut seen = Vec::new();
        for path in &self.log {
            logs.extend(subject.read(
                to,
                &self.reading,
                path,
                false,
                &mut |recording, wanted| seen.push(clocks(recording, wanted)),
            )?);
        }
        let bar = Bar::new(to);
        let mut found = inspect(&subject, &logs, &Stop::default(), bar.far())?;
        found.clocks = seen;
        drop(bar);
        let found = found.worded(option);
        to.json(&found)?;
        write(self.html.as_ref(), || page::check(&found, &curves(&subject, &logs, &found)))?;
        say!(to, "{}", text(&found).trim_end());
        Ok(())
    }
}

/// Outputs that are drawn where the finding is of no single one.
const OUTPUTS: usize = 4;

/// The outputs with a finding, or the first ones where it is of another channel, and the model's response. A model that cannot be simulated has none.
fn curves(subject: &Simulated, logs: &[Log], found: &Inspection) -> Vec<Measured> {
    let Simulated::Model(document) = subject else { return Vec::new() };
    let failed: Vec<&str> =
        found.checks.iter().filter(|c| c.ok == Some(false)).map(|c| c.channel.as_str()).collect();
    if failed.is_empty() {
        return Vec::new();
    }
    let outputs: Vec<&str> = document.outputs().iter().map(|c| c.name.as_str()).collect();
    let own: Vec<&str> = outputs.iter().copied().filter(|o| failed.contains(o)).collect();
    let shown = if own.is_empty() { outputs.into_iter().take(OUTPUTS).collect() } else { own };
    let of_log = |log: &Log| -> Vec<Measured> {
        let Ok(simulation) = OnLog::new(document, log) else { return Vec::new() };
        let Ok(simulated) = simulation
            .response()
            .and_then(|response| simulation.to_log(&response, log.source(), false, None))
        else {
            return Vec::new();
        };
        let values =
            |channel: &Channel| channel.iter().map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<f64>>();
        let first = log.time_s().first().copied().unwrap_or_default();
        let one = |name: &&str| {
            Some(Measured {
                channel: (*name).to_owned(),
                log: log.source().to_owned(),
                time_s: log.time_s().iter().map(|t| t - first).collect(),
                measured: values(log.channel(name).ok()?),
                simulated: values(simulated.channel(name).ok()?),
            })
        };
        shown.iter().filter_map(one).collect()
    };
    logs.iter().flat_map(of_log).collect()
}

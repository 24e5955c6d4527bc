//! `deadtime simulate`: the response of a model to the inputs of a log.

use std::path::PathBuf;

use anyhow::{Context, bail};

use super::progress::Bar;
use super::show::Out;
use super::source::Source;
use super::words::delay_of;
use deadtime_model::ModelDocument;
use deadtime_model::effect::{OnLog, Still, check_units};
use deadtime_model::simulate::Hold;

/// Simulate a model with its effects on the inputs of a log and write the response as a log. Outputs that the log has are compared
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime simulate model.toml flight.csv --out simulated.csv
  deadtime simulate model.toml flight.csv --delay rudder=0.13 --states --out simulated.csv")]
pub(super) struct Simulate {
    /// The model, deadtime/model@1
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    #[command(flatten)]
    source: Source,
    /// How the inputs run between samples
    #[arg(long, value_enum, default_value_t = HoldName::Zero)]
    hold: HoldName,
    /// Delay of an input in seconds, added to the model's own; may be repeated
    #[arg(long, value_name = "INPUT=S")]
    delay: Vec<String>,
    /// Write the states too
    #[arg(long)]
    states: bool,
    /// Add white noise to every written signal, at this ratio of variances (signal to noise)
    #[arg(long, value_name = "RATIO")]
    snr: Option<f64>,
    /// Seed of all chance: the noise, the losses of dropped_commands and the delays of delay_jitter
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum HoldName {
    /// Held (zero-order hold)
    Zero,
    /// Straight lines between samples (first-order hold)
    Linear,
}

impl Simulate {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let model = ModelDocument::read(&self.model)?;
        let logs =
            self.source.reading.read_for(to, &self.source.log, &model, false, &mut |_, _| {})?;
        let [log] = logs.as_slice() else {
            bail!(
                "{}: simulate takes one record at a time; cut it out with --from and --to",
                self.source.log.display()
            );
        };
        check_units(&model, log)?;
        let mut simulation =
            OnLog::new(&model, log).with_context(|| self.model.display().to_string())?;
        simulation.seed = self.seed;
        simulation.hold = match self.hold {
            HoldName::Zero => Hold::Zero,
            HoldName::Linear => Hold::Linear,
        };
        self.delays(&model, &mut simulation)?;
        let bar = Bar::new(to);
        simulation.far = bar.far().clone();
        let response = simulation
            .response()
            .with_context(|| format!("model {} and log {}", self.model.display(), log.source()))?;
        let comparison = simulation.nrmse(&response)?;
        simulation
            .to_log(&response, &self.out.display().to_string(), self.states, self.snr)?
            .write_csv(&self.out)?;
        drop(bar);
        let errors: serde_json::Map<_, _> = comparison
            .iter()
            .map(|(name, nrmse)| ((*name).to_owned(), serde_json::json!(nrmse.ok())))
            .collect();
        to.json(
            &serde_json::json!({ "model": model.name(), "log": log.source(), "out": self.out, "samples": log.len(), "nrmse": errors }),
        )?;
        let (name, out) = (model.name(), self.out.display());
        say!(to, "{name} on {}: {} samples written to {out}", log.source(), log.len());
        for (name, nrmse) in comparison {
            let said = match nrmse {
                Ok(v) => format!(
                    "nrmse {v:.4} (rms of measured minus simulated over the measured standard deviation)"
                ),
                Err(Still::Stands) => {
                    "the measured channel stands still, so it has no nrmse".to_owned()
                }
                Err(Still::Empty) => {
                    "the log has this channel but no sample of it, so there is nothing to compare"
                        .to_owned()
                }
            };
            say!(to, "  {name}: {said}");
        }
        Ok(())
    }

    /// The delays of `--delay`.
    fn delays(&self, model: &ModelDocument, simulation: &mut OnLog<'_>) -> anyhow::Result<()> {
        if model.is_sampled() && !self.delay.is_empty() {
            bail!(
                "--delay needs a continuous model; {} is sampled: write whole samples into its input_delay_s",
                model.name()
            );
        }
        let inputs: Vec<String> = model.inputs().iter().map(|c| c.name.clone()).collect();
        for text in &self.delay {
            let (input, seconds) = delay_of(text, &inputs).with_context(|| {
                format!(
                    "--delay {text}: write it as INPUT=SECONDS with an input of the model ({})",
                    inputs.join(", ")
                )
            })?;
            simulation.delay(input, seconds).with_context(|| format!("--delay {text}"))?;
        }
        Ok(())
    }
}

//! `deadtime simulate`: what a model says to the inputs of a log.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::source::Source;
use super::write_json;
use crate::log::{Channel, Log};
use crate::model::{EquationsFile, ModelDocument, ModelFile, Operating};
use crate::signal::{Noise, NoiseColour, NoiseScaling};
use crate::simulate::{EquationOptions, Hold, Options, Response, lsim, lsim_sampled, lsim_uneven, simulate_equations};

/// Simulate a model on the inputs of a log and write the response as a log; outputs that the log has are compared
#[derive(Debug, clap::Args)]
pub(super) struct Simulate {
    /// The model, deadtime/model@1
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    #[command(flatten)]
    source: Source,
    /// How the inputs run between samples
    #[arg(long, value_enum, default_value_t = HoldName::Zero)]
    hold: HoldName,
    /// Delay of an input in seconds, beside the model's own; may be repeated
    #[arg(long, value_name = "INPUT=S")]
    delay: Vec<String>,
    /// Write the states too
    #[arg(long)]
    states: bool,
    /// Add white noise to every written signal, at this ratio of variances (signal to noise)
    #[arg(long, value_name = "RATIO")]
    snr: Option<f64>,
    /// Seed of the noise
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
    pub(super) fn run(&self, json: Option<&Path>) -> anyhow::Result<()> {
        let model = ModelDocument::read(&self.model)?;
        if !model.effects().is_empty() {
            bail!(
                "{}: this version simulates without effects; take the [[effects]] out of the file (a delay can stand in input_delay_s)",
                self.model.display()
            );
        }
        let inputs: Vec<String> = model.inputs().iter().map(|c| c.name.clone()).collect();
        let logs = self.source.read(&inputs)?;
        let [log] = logs.as_slice() else {
            bail!("{}: simulate takes one record at a time; cut it out with --from and --to", self.source.log.display());
        };
        let (u, offsets) = self.inputs(&model, log)?;
        let response = self.response(&model, log, &u)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut channels: Vec<Channel> = model
            .inputs()
            .iter()
            .enumerate()
            .map(|(j, c)| {
                let values = u.column(j).iter().map(|v| v + offsets[j]).collect();
                Channel::new(&c.name, c.unit.as_deref(), values)
            })
            .collect();
        let mut comparison = Vec::new();
        let mut add = |name: &str, unit: Option<&str>, values: Vec<f64>, channels: &mut Vec<Channel>| -> anyhow::Result<()> {
            if channels.iter().any(|c| c.name() == name) {
                return Ok(());
            }
            let values = match self.snr {
                Some(snr) => Noise { snr, colour: NoiseColour::White, scaling: NoiseScaling::Expected }
                    .add(&values, &mut rng)
                    .with_context(|| format!("noise on `{name}`"))?,
                None => values,
            };
            channels.push(Channel::new(name, unit, values));
            Ok(())
        };
        for (i, c) in model.outputs().iter().enumerate() {
            let measured = log.output(&c.name).ok();
            let operating = match (c.operating, &measured) {
                (Operating::Value(v), _) => v,
                (Operating::Mean(_), Some(m)) => mean((0..log.len()).filter_map(|k| m.get(k))),
                (Operating::Mean(_), None) => {
                    bail!("the operating point of output `{}` is the log's mean, but {} has no such channel", c.name, log.source())
                }
            };
            let values: Vec<f64> = response.y.column(i).iter().map(|v| v + operating).collect();
            if let Some(measured) = measured {
                comparison.push((c.name.clone(), nrmse(&values, |k| measured.get(k))));
            }
            add(&c.name, c.unit.as_deref(), values, &mut channels)?;
        }
        if self.states {
            for (i, (name, unit)) in model.states().enumerate() {
                add(name, unit, response.x.column(i).iter().copied().collect(), &mut channels)?;
            }
        }
        Log::new(self.out.display().to_string(), log.time_s().to_vec(), channels)?.write_csv(&self.out)?;
        let errors: serde_json::Map<_, _> = comparison.iter().map(|(name, nrmse)| (name.clone(), serde_json::json!(nrmse))).collect();
        write_json(
            json,
            &serde_json::json!({ "model": model.name(), "log": log.source(), "out": self.out, "samples": log.len(), "nrmse": errors }),
        )?;
        say!("{} on {}: {} samples written to {}", model.name(), log.source(), log.len(), self.out.display());
        for (name, nrmse) in comparison {
            match nrmse {
                Some(v) => say!("  {name}: nrmse {v:.4} (rms of measured minus simulated over the measured standard deviation)"),
                None => say!("  {name}: the measured channel stands still, so it has no nrmse"),
            }
        }
        Ok(())
    }

    /// Inputs about their operating points, samples × inputs, and the operating points.
    fn inputs(&self, model: &ModelDocument, log: &Log) -> anyhow::Result<(DMatrix<f64>, Vec<f64>)> {
        let mut u = DMatrix::zeros(log.len(), model.inputs().len());
        let mut offsets = Vec::with_capacity(model.inputs().len());
        for (j, c) in model.inputs().iter().enumerate() {
            let values = log.input(&c.name)?;
            let operating = match c.operating {
                Operating::Value(v) => v,
                Operating::Mean(_) => mean(values.iter().copied()),
            };
            u.set_column(j, &DVector::from_iterator(values.len(), values.iter().map(|v| v - operating)));
            offsets.push(operating);
        }
        Ok((u, offsets))
    }

    fn response(&self, model: &ModelDocument, log: &Log, u: &DMatrix<f64>) -> anyhow::Result<Response> {
        let hold = match self.hold {
            HoldName::Zero => Hold::Zero,
            HoldName::Linear => Hold::Linear,
        };
        match model {
            ModelDocument::Lti(file) => self.linear(file, log, u, hold),
            ModelDocument::Equations(file) => self.nonlinear(file, log, u, hold),
        }
    }

    fn linear(&self, model: &ModelFile, log: &Log, u: &DMatrix<f64>, hold: Hold) -> anyhow::Result<Response> {
        let initial = (!model.initial.is_empty()).then(|| DVector::from_column_slice(&model.initial));
        let options = Options { initial, hold, ..Options::default() };
        if model.is_sampled() {
            let sys = model.sampled()?;
            sys.sample_time().must_equal(log.even_grid()?).with_context(|| format!("model {} and log {}", model.name, log.source()))?;
            if !self.delay.is_empty() {
                bail!("--delay needs a continuous model; {} is sampled: write whole samples into its input_delay_s", model.name);
            }
            return Ok(lsim_sampled(&sys, u, &options)?);
        }
        let sys = model.continuous()?;
        let mut delays = sys.input_delay().to_vec();
        self.add_delays(&model.inputs, &mut delays)?;
        let sys = sys.with_input_delay(delays)?;
        Ok(match log.even_grid() {
            Ok(ts) => lsim(&sys, u, ts, &options)?,
            Err(_) => lsim_uneven(&sys, log.time_s(), u, &options)?,
        })
    }

    fn nonlinear(&self, model: &EquationsFile, log: &Log, u: &DMatrix<f64>, hold: Hold) -> anyhow::Result<Response> {
        let equations = model.equations()?;
        let mut input_delay_s = model.input_delay_s.clone();
        input_delay_s.resize(model.inputs.len(), 0.0);
        self.add_delays(&model.inputs, &mut input_delay_s)?;
        let options = EquationOptions { hold, input_delay_s, ..EquationOptions::default() };
        simulate_equations(&equations, log.time_s(), u, &equations.initial(), &equations.nominal(), &options)
            .with_context(|| format!("model {} and log {}", self.model.display(), log.source()))
    }

    /// The delays of the command line on top of the model's own.
    fn add_delays(&self, inputs: &[crate::model::Channel], delays: &mut [f64]) -> anyhow::Result<()> {
        for text in &self.delay {
            let parsed =
                text.split_once('=').and_then(|(name, s)| Some((inputs.iter().position(|c| c.name == name)?, s.parse::<f64>().ok()?)));
            let Some((input, seconds)) = parsed else {
                let names: Vec<&str> = inputs.iter().map(|c| c.name.as_str()).collect();
                bail!("--delay {text}: write it as INPUT=SECONDS with an input of the model ({})", names.join(", "));
            };
            delays[input] += seconds;
        }
        Ok(())
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(count, 1.0)
}

/// rms(measured − simulated)/std(measured) over the samples there are; `None` where the measurement stands still.
fn nrmse(simulated: &[f64], measured: impl Fn(usize) -> Option<f64>) -> Option<f64> {
    let pairs: Vec<(f64, f64)> = simulated.iter().enumerate().filter_map(|(k, s)| Some((*s, measured(k)?))).collect();
    let centre = mean(pairs.iter().map(|p| p.1));
    let variance = mean(pairs.iter().map(|p| (p.1 - centre).powi(2)));
    (variance > 0.0).then(|| (mean(pairs.iter().map(|p| (p.1 - p.0).powi(2))) / variance).sqrt())
}

//! `deadtime simulate`: what a model says to the inputs of a log.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::source::Source;
use super::write_json;
use crate::effect::{Applied, Chance};
use crate::log::{Channel, Log, LogError};
use crate::model::{ModelDocument, ModelFile};
use crate::signal::{Noise, NoiseColour, NoiseScaling};
use crate::simulate::{Commands, Hold, Options, Plan, Response, System, Tolerance, lsim, lsim_sampled, lsim_uneven};
use crate::time::TimeError;

/// Tight: a simulation on paper is to differ from a measurement by the model alone.
const TOLERANCE: Tolerance = Tolerance { relative: 1e-9, absolute: 1e-12, steps: 100_000, budget: usize::MAX };

/// Simulate a model with its effects on the inputs of a log and write the response as a log; outputs that the log has are compared
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
    /// Seed of all chance: the noise, and the losses of dropped_commands
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
        let inputs: Vec<String> = model.inputs().iter().map(|c| c.name.clone()).collect();
        let logs = self.source.read(&inputs)?;
        let [log] = logs.as_slice() else {
            bail!("{}: simulate takes one record at a time; cut it out with --from and --to", self.source.log.display());
        };
        check_units(&model, log)?;
        let response = self.response(&model, log)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut channels = Vec::with_capacity(inputs.len());
        for c in model.inputs() {
            channels.push(Channel::new(&c.name, c.unit.as_deref(), log.input(&c.name)?.to_vec()));
        }
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
            let values: Vec<f64> = response.y.column(i).iter().copied().collect();
            match log.output(&c.name) {
                Ok(measured) => {
                    let nrmse = nrmse(&values, |k| measured.get(k));
                    comparison.push((c.name.clone(), nrmse.ok_or("the measured channel stands still, so it has no nrmse")));
                }
                Err(LogError::MissingThroughout { .. }) => {
                    comparison.push((c.name.clone(), Err("the log has this channel but no sample of it, so there is nothing to compare")));
                }
                Err(LogError::UnknownChannel { .. }) => {}
                Err(unusable) => return Err(unusable.into()),
            }
            add(&c.name, c.unit.as_deref(), values, &mut channels)?;
        }
        if self.states {
            for (i, (name, unit)) in model.states().enumerate() {
                add(name, unit, response.x.column(i).iter().copied().collect(), &mut channels)?;
            }
        }
        Log::new(self.out.display().to_string(), log.time_s().to_vec(), channels)?.write_csv(&self.out)?;
        let errors: serde_json::Map<_, _> = comparison.iter().map(|(name, nrmse)| (name.clone(), serde_json::json!(nrmse.ok()))).collect();
        write_json(
            json,
            &serde_json::json!({ "model": model.name(), "log": log.source(), "out": self.out, "samples": log.len(), "nrmse": errors }),
        )?;
        say!("{} on {}: {} samples written to {}", model.name(), log.source(), log.len(), self.out.display());
        for (name, nrmse) in comparison {
            match nrmse {
                Ok(v) => say!("  {name}: nrmse {v:.4} (rms of measured minus simulated over the measured standard deviation)"),
                Err(why) => say!("  {name}: {why}"),
            }
        }
        Ok(())
    }

    fn response(&self, model: &ModelDocument, log: &Log) -> anyhow::Result<Response> {
        let mut system = System::new(model, |channel| {
            let measured = log.output(channel)?;
            Ok(mean((0..log.len()).filter_map(|k| measured.get(k))))
        })
        .with_context(|| self.model.display().to_string())?;
        if model.is_sampled() && !self.delay.is_empty() {
            bail!("--delay needs a continuous model; {} is sampled: write whole samples into its input_delay_s", model.name());
        }
        self.add_delays(&mut system)?;
        let both = || format!("model {} and log {}", self.model.display(), log.source());
        match model {
            ModelDocument::Lti(file) if file.effects.is_empty() => self.linear(file, &system, log).with_context(both),
            _ => self.with_effects(model, &system, log).with_context(both),
        }
    }

    fn hold(&self) -> Hold {
        match self.hold {
            HoldName::Zero => Hold::Zero,
            HoldName::Linear => Hold::Linear,
        }
    }

    /// A bare linear model.
    fn linear(&self, model: &ModelFile, system: &System, log: &Log) -> anyhow::Result<Response> {
        let mut u = DMatrix::zeros(log.len(), system.inputs.len());
        for (j, (port, operating)) in system.inputs.iter().zip(&system.input_operating).enumerate() {
            let values = log.input(&port.name)?;
            u.set_column(j, &DVector::from_iterator(values.len(), values.iter().map(|v| v - operating)));
        }
        let options = Options { initial: Some(DVector::from_column_slice(&system.initial)), hold: self.hold(), ..Options::default() };
        let mut response = if model.is_sampled() {
            let sys = model.sampled()?;
            sys.sample_time().must_equal(log.even_grid()?)?;
            lsim_sampled(&sys, &u, &options)?
        } else {
            let sys = model.continuous()?.with_input_delay(system.input_delay_s.clone())?;
            match log.even_grid() {
                Ok(ts) => lsim(&sys, &u, ts, &options)?,
                Err(_) => lsim_uneven(&sys, log.time_s(), &u, &options)?,
            }
        };
        for (mut column, operating) in response.y.column_iter_mut().zip(&system.output_operating) {
            column.add_scalar_mut(*operating);
        }
        Ok(response)
    }

    /// A model of any kind with its effects.
    fn with_effects(&self, model: &ModelDocument, system: &System, log: &Log) -> anyhow::Result<Response> {
        let effects = model.effects().iter().map(|entry| Applied::from_entry(system, entry)).collect::<Result<Vec<_>, _>>()?;
        let mut plan: Plan = Applied::plan(system, &effects, Chance::Seed(self.seed))?;
        (plan.hold, plan.tolerance) = (self.hold(), TOLERANCE);
        if let ModelDocument::Lti(file) = model
            && file.is_sampled()
        {
            file.sampled()?.sample_time().must_equal(log.even_grid()?)?;
        }
        let start_s = log.time_s().first().copied().unwrap_or(0.0);
        let time_s: Vec<f64> = log.time_s().iter().map(|t| t - start_s).collect();
        let inputs = system.inputs.iter().map(|port| log.input(&port.name).map(<[f64]>::to_vec)).collect::<Result<Vec<_>, _>>()?;
        let run = system.simulate(&plan, Commands { time_s: &time_s, inputs: &inputs }, &system.initial, None)?;
        Ok(Response { y: run.y, x: run.x })
    }

    /// The delays of the command line on top of the model's own.
    fn add_delays(&self, system: &mut System) -> anyhow::Result<()> {
        for text in &self.delay {
            let input = |name: &str| system.inputs.iter().position(|port| port.name == name);
            let parsed = text.split_once('=').and_then(|(name, s)| Some((input(name)?, s.parse::<f64>().ok()?)));
            let Some((input, seconds)) = parsed else {
                let names: Vec<&str> = system.inputs.iter().map(|port| port.name.as_str()).collect();
                bail!("--delay {text}: write it as INPUT=SECONDS with an input of the model ({})", names.join(", "));
            };
            let total = &mut system.input_delay_s[input];
            *total += seconds;
            if !(total.is_finite() && *total >= 0.0) {
                return Err(TimeError::Delay { seconds: *total }).with_context(|| format!("--delay {text}"));
            }
        }
        Ok(())
    }
}

/// Where model and log both give a unit, it is the same.
fn check_units(model: &ModelDocument, log: &Log) -> Result<(), LogError> {
    model.inputs().iter().chain(model.outputs()).try_for_each(|c| log.check_unit(&c.name, c.unit.as_deref()))
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

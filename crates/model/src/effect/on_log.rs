//! A model with its effects on the inputs of a log: the simulator's outputs for measured commands, compared with the measured ones.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::applied::{Applied, Chance};
use crate::c2d::hold::Hold;
use crate::error::Result;
use crate::file::document::ModelDocument;
use crate::file::lti::ModelFile;
use crate::simulate::error::SimulateError;
use crate::simulate::lsim::{Options, Response, lsim};
use crate::simulate::plan::Tolerance;
use crate::simulate::run::Commands;
use crate::simulate::system::System;
use deadtime_log::{Channel, Log, LogError};
use deadtime_signal::progress::HowFar;
use deadtime_signal::time::TimeError;
use deadtime_signal::{Noise, NoiseColour, NoiseScaling, SignalError, stats};

/// Tight, so that the simulation error is negligible against the difference between model and measurement.
const TOLERANCE: Tolerance = Tolerance {
    relative: 1e-9,
    absolute: 1e-12,
    steps: 100_000,
    budget: usize::MAX,
    past_samples: false,
};

/// Checks that the units of model and log agree where both give one.
///
/// # Errors
/// [`LogError`] naming the channel.
pub fn check_units(model: &ModelDocument, log: &Log) -> Result<(), LogError> {
    model
        .inputs()
        .iter()
        .chain(model.outputs())
        .try_for_each(|c| log.check_unit(&c.name, c.unit.as_deref()))
}

/// The reason for a missing error of a simulated output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Still {
    /// The measured channel is constant, so that its error has no scale.
    Stands,
    /// The log has the channel but no sample of it.
    Empty,
}

/// A model on a log.
#[derive(Debug, Clone)]
pub struct OnLog<'a> {
    model: &'a ModelDocument,
    log: &'a Log,
    system: System,
    /// The hold of the inputs between samples.
    pub hold: Hold,
    /// Seed of all random sequences: the noise, and the losses of dropped commands.
    pub seed: u64,
    /// Progress of the simulation.
    pub far: HowFar,
}

impl<'a> OnLog<'a> {
    /// The model and the log together; an operating point of `"mean"` is the log's.
    ///
    /// # Errors
    /// [`crate::error::ModelError`] for an invalid model file, [`LogError`] where the log lacks a channel of the operating points.
    pub fn new(model: &'a ModelDocument, log: &'a Log) -> Result<Self> {
        let system = System::new(model, |channel| {
            let measured = log.output(channel)?;
            Ok(mean((0..log.len()).filter_map(|k| measured.get(k))))
        })?;
        Ok(Self { model, log, system, hold: Hold::Zero, seed: 1, far: HowFar::default() })
    }

    /// Adds a delay of an input to the model's own, s.
    ///
    /// # Errors
    /// [`SimulateError::SampledDelay`], [`SimulateError::NoInput`], [`TimeError::Delay`] where the sum is negative or not finite.
    pub fn delay(&mut self, input: &str, seconds: f64) -> Result<()> {
        if self.model.is_sampled() {
            return Err(SimulateError::SampledDelay { model: self.model.name().to_owned() }.into());
        }
        let Some(at) = self.system.inputs.iter().position(|port| port.name == input) else {
            let known = self.system.inputs.iter().map(|port| port.name.clone()).collect();
            return Err(SimulateError::NoInput { input: input.to_owned(), known }.into());
        };
        let total = &mut self.system.input_delay_s[at];
        *total += seconds;
        if total.is_finite() && *total >= 0.0 {
            Ok(())
        } else {
            Err(TimeError::Delay { seconds: *total }.into())
        }
    }

    /// The response to the log's inputs.
    ///
    /// # Errors
    /// [`SimulateError`], [`super::error::EffectError`], [`LogError`] for an input with missing samples, [`TimeError`] for a log off a sampled model's
    /// grid.
    pub fn response(&self) -> Result<Response> {
        match self.model {
            ModelDocument::Lti(file) if file.effects.is_empty() => self.linear(file),
            _ => self.with_effects(),
        }
    }

    /// A linear model without effects.
    fn linear(&self, model: &ModelFile) -> Result<Response> {
        let (log, system) = (self.log, &self.system);
        let mut u = DMatrix::zeros(log.len(), system.inputs.len());
        for (j, (port, operating)) in system.inputs.iter().zip(&system.input_operating).enumerate()
        {
            let values = log.input(&port.name)?;
            u.set_column(
                j,
                &DVector::from_iterator(values.len(), values.iter().map(|v| v - operating)),
            );
        }
        let options = Options {
            initial: Some(DVector::from_column_slice(&system.initial)),
            hold: self.hold,
            ..Options::default()
        };
        let mut response = if model.is_sampled() {
            let sys = model.sampled()?;
            sys.sample_time().must_equal(log.even_grid()?)?;
            lsim(&sys, &u, sys.sample_time(), &options)?
        } else {
            let sys = model.continuous()?.with_input_delay(system.input_delay_s.clone())?;
            match log.even_grid() {
                Ok(ts) => lsim(&sys, &u, ts, &options)?,
                Err(_) => lsim(&sys, &u, log.time_s(), &options)?,
            }
        };
        for (mut column, operating) in response.y.column_iter_mut().zip(&system.output_operating) {
            column.add_scalar_mut(*operating);
        }
        Ok(response)
    }

    /// A model of any kind with its effects.
    fn with_effects(&self) -> Result<Response> {
        let (log, system) = (self.log, &self.system);
        let effects = self.model.effects().iter().map(|entry| Applied::from_entry(system, entry));
        let effects = effects.collect::<Result<Vec<_>, _>>()?;
        let mut plan = Applied::plan(system, &effects, Chance::Seed(self.seed))?;
        (plan.hold, plan.tolerance, plan.far) = (self.hold, TOLERANCE, self.far.clone());
        if let ModelDocument::Lti(file) = self.model
            && file.is_sampled()
        {
            file.sampled()?.sample_time().must_equal(log.even_grid()?)?;
        }
        let start_s = log.time_s().first().copied().unwrap_or(0.0);
        let time_s: Vec<f64> = log.time_s().iter().map(|t| t - start_s).collect();
        let inputs = system.inputs.iter().map(|port| log.input(&port.name).map(<[f64]>::to_vec));
        let inputs = inputs.collect::<Result<Vec<_>, _>>()?;
        let run = system.simulate(
            &plan,
            Commands { time_s: &time_s, inputs: &inputs },
            &system.initial,
            None,
        )?;
        Ok(Response { y: run.y, x: run.x })
    }

    /// A log of the model's inputs and its response, called `source`. Options add the states, and white noise at a ratio of variances.
    ///
    /// # Errors
    /// [`SignalError::Noise`] for a constant signal, [`LogError`] for inputs with missing samples.
    pub fn to_log(
        &self,
        response: &Response,
        source: &str,
        states: bool,
        snr: Option<f64>,
    ) -> Result<Log> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut channels: Vec<Channel> = Vec::new();
        for c in self.model.inputs() {
            channels.push(Channel::new(
                &c.name,
                c.unit.as_deref(),
                self.log.input(&c.name)?.to_vec(),
            ));
        }
        let outputs = self
            .model
            .outputs()
            .iter()
            .map(|c| (c.name.as_str(), c.unit.as_deref()))
            .zip(response.y.column_iter());
        let states = self.model.states().zip(response.x.column_iter()).filter(|_| states);
        for ((name, unit), values) in outputs.chain(states) {
            // An output that is an input or a state already exists.
            if channels.iter().any(|c| c.name() == name) {
                continue;
            }
            let mut values: Vec<f64> = values.iter().copied().collect();
            if let Some(snr) = snr {
                let noise =
                    Noise { snr, colour: NoiseColour::White, scaling: NoiseScaling::Expected };
                let wrong =
                    |cause| SignalError::Noise { channel: name.to_owned(), cause: Box::new(cause) };
                values = noise.add(&values, &mut rng).map_err(wrong)?;
            }
            channels.push(Channel::new(name, unit, values));
        }
        Ok(Log::new(source, self.log.time_s().to_vec(), channels)?)
    }

    /// The nrmse of the outputs in the log: rms(measured − simulated)/std(measured) over the measured samples.
    ///
    /// # Errors
    /// [`LogError`] for a column that is not numeric.
    pub fn nrmse(&self, response: &Response) -> Result<Vec<(&'a str, Result<f64, Still>)>> {
        let mut comparison = Vec::new();
        for (c, simulated) in self.model.outputs().iter().zip(response.y.column_iter()) {
            match self.log.output(&c.name) {
                Ok(measured) => {
                    let pairs = simulated
                        .iter()
                        .enumerate()
                        .filter_map(|(k, s)| Some((*s, measured.get(k)?)));
                    comparison.push((
                        c.name.as_str(),
                        nrmse(&pairs.collect::<Vec<_>>()).ok_or(Still::Stands),
                    ));
                }
                Err(LogError::MissingThroughout { .. }) => {
                    comparison.push((c.name.as_str(), Err(Still::Empty)))
                }
                Err(LogError::UnknownChannel { .. }) => {}
                Err(unusable) => return Err(unusable.into()),
            }
        }
        Ok(comparison)
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    stats::mean(values).unwrap_or(0.0)
}

/// For pairs (simulated, measured); `None` for a constant measurement.
fn nrmse(pairs: &[(f64, f64)]) -> Option<f64> {
    let centre = mean(pairs.iter().map(|p| p.1));
    let variance = mean(pairs.iter().map(|p| (p.1 - centre).powi(2)));
    (variance > 0.0).then(|| (mean(pairs.iter().map(|p| (p.1 - p.0).powi(2))) / variance).sqrt())
}

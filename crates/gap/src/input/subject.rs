//! The subject of a diagnosis: a model file, or any simulator with the names of its channels.

use std::borrow::Cow;

use super::record::channels_fit;
use crate::error::Result;
use deadtime_log::{Log, LogError};
use deadtime_model::simulate::{Port, System};
use deadtime_model::{EffectEntry, ModelDocument, NuisanceEntry, Operating};
use deadtime_signal::stats;

/// The simulator that is compared with the logs.
#[derive(Debug, Clone, Copy)]
pub enum Subject<'a> {
    /// A model file.
    Model(&'a ModelDocument),
    /// A simulator, such as [`System::black_box`] makes one of a function.
    Simulator(&'a System),
}

impl<'a> From<&'a ModelDocument> for Subject<'a> {
    fn from(document: &'a ModelDocument) -> Self {
        Self::Model(document)
    }
}

impl<'a> From<&'a System> for Subject<'a> {
    fn from(system: &'a System) -> Self {
        Self::Simulator(system)
    }
}

impl<'a> Subject<'a> {
    pub(crate) fn name(self) -> &'a str {
        match self {
            Self::Model(document) => document.name(),
            Self::Simulator(system) => &system.name,
        }
    }

    /// The logs as the model takes them.
    ///
    /// # Errors
    /// [`LogError`] where a log lacks the input of a slope.
    pub(crate) fn completed<'b>(
        self,
        logs: &'b [Log],
    ) -> std::result::Result<Cow<'b, [Log]>, LogError> {
        match self {
            Self::Model(document) if document.asks_of_logs() => Ok(Cow::Owned(
                logs.iter()
                    .map(|log| document.complete(log.clone()))
                    .collect::<std::result::Result<_, _>>()?,
            )),
            _ => Ok(Cow::Borrowed(logs)),
        }
    }

    pub(crate) fn inputs(self) -> Vec<Port> {
        match self {
            Self::Model(document) => ports(document.inputs()),
            Self::Simulator(system) => system.inputs.clone(),
        }
    }

    pub(crate) fn outputs(self) -> Vec<Port> {
        match self {
            Self::Model(document) => ports(document.outputs()),
            Self::Simulator(system) => system.outputs.clone(),
        }
    }

    /// Effects that belong to it already.
    pub(crate) fn effects(self) -> &'a [EffectEntry] {
        match self {
            Self::Model(document) => document.effects(),
            Self::Simulator(_) => &[],
        }
    }

    /// The declared constants with a separate value in every log, which are no cause of a gap.
    pub(crate) fn nuisances(self) -> &'a [NuisanceEntry] {
        match self {
            Self::Model(document) => document.nuisances(),
            Self::Simulator(_) => &[],
        }
    }

    /// Outputs whose operating point in the model file is only the mean of the logs, with the spread of their samples.
    pub(crate) fn unknown_levels(self, logs: &[Log]) -> Vec<(String, f64)> {
        let Self::Model(document) = self else { return Vec::new() };
        let mean = document.outputs().iter().filter(|c| matches!(c.operating, Operating::Mean(_)));
        let spread = |name: &str| stats::deviation(&samples(logs, name).ok()?).filter(|s| *s > 0.0);
        mean.filter_map(|c| Some((c.name.clone(), spread(&c.name)?))).collect()
    }

    /// The simulator, its operating points `"mean"` taken over the training logs.
    pub(crate) fn system(self, logs: &[Log]) -> Result<System> {
        match self {
            Self::Model(document) => system(document, logs),
            Self::Simulator(system) => {
                logs.iter()
                    .try_for_each(|log| channels_fit(log, &system.inputs, &system.outputs))?;
                Ok(system.clone())
            }
        }
    }

    /// The model file with further effects, at the operating point at which it was diagnosed: the mean of another log would be another model. `None` where there is no file.
    pub(crate) fn with(
        self,
        found: impl Iterator<Item = EffectEntry>,
        logs: &[Log],
    ) -> Option<ModelDocument> {
        let Self::Model(document) = self else { return None };
        let mut model = document.clone();
        if let ModelDocument::Lti(file) = &mut model {
            for channel in file.inputs.iter_mut().chain(&mut file.outputs) {
                if let (Operating::Mean(_), Ok(mean)) =
                    (channel.operating, mean_over(logs, &channel.name))
                {
                    channel.operating = Operating::Value(mean);
                }
            }
        }
        model.effects_mut().extend(found);
        Some(model)
    }
}

fn ports(channels: &[deadtime_model::Channel]) -> Vec<Port> {
    channels.iter().map(|c| Port { name: c.name.clone(), unit: c.unit.clone() }).collect()
}

/// The simulator of a model file, its operating points `"mean"` taken over the training logs.
///
/// # Errors
/// As [`LogRecord::new`] of channels, and [`deadtime_model::ModelError`].
pub(crate) fn system(document: &ModelDocument, logs: &[Log]) -> Result<System> {
    let subject = Subject::from(document);
    let (inputs, outputs) = (subject.inputs(), subject.outputs());
    logs.iter().try_for_each(|log| channels_fit(log, &inputs, &outputs))?;
    let asked = document
        .inputs()
        .iter()
        .chain(document.outputs())
        .any(|c| matches!(c.operating, Operating::Mean(_)));
    Ok(System::new(document, |name| if asked { Ok(mean_over(logs, name)?) } else { Ok(0.0) })?)
}

/// The mean of a channel over all its samples; 0 where there is none.
fn mean_over(logs: &[Log], name: &str) -> std::result::Result<f64, LogError> {
    Ok(stats::mean(samples(logs, name)?).unwrap_or(0.0))
}

/// All samples of a channel.
fn samples(logs: &[Log], name: &str) -> std::result::Result<Vec<f64>, LogError> {
    let mut all = Vec::new();
    for log in logs {
        let output = log.output(name)?;
        all.extend((0..log.len()).filter_map(|k| output.get(k)));
    }
    Ok(all)
}

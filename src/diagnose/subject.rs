//! What is diagnosed: a model file, or any simulator with the names of its channels.

use crate::error::Result;
use crate::log::Log;
use crate::model::{EffectEntry, ModelDocument};
use crate::simulate::{Port, System};

use super::data;

/// What is held against the logs.
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
    pub(super) fn name(self) -> &'a str {
        match self {
            Self::Model(document) => document.name(),
            Self::Simulator(system) => &system.name,
        }
    }

    pub(super) fn inputs(self) -> Vec<Port> {
        match self {
            Self::Model(document) => ports(document.inputs()),
            Self::Simulator(system) => system.inputs.clone(),
        }
    }

    pub(super) fn outputs(self) -> Vec<Port> {
        match self {
            Self::Model(document) => ports(document.outputs()),
            Self::Simulator(system) => system.outputs.clone(),
        }
    }

    /// Effects that belong to it already.
    pub(super) fn effects(self) -> &'a [EffectEntry] {
        match self {
            Self::Model(document) => document.effects(),
            Self::Simulator(_) => &[],
        }
    }

    /// The simulator, its operating points `"mean"` taken over the training logs.
    pub(super) fn system(self, logs: &[Log]) -> Result<System> {
        match self {
            Self::Model(document) => data::system(document, logs),
            Self::Simulator(system) => {
                logs.iter().try_for_each(|log| data::channels_fit(log, &system.inputs, &system.outputs))?;
                Ok(system.clone())
            }
        }
    }

    /// The model file with further effects; `None` where there is none.
    pub(super) fn with(self, found: impl Iterator<Item = EffectEntry>) -> Option<ModelDocument> {
        let Self::Model(document) = self else { return None };
        let mut model = document.clone();
        model.effects_mut().extend(found);
        Some(model)
    }
}

fn ports(channels: &[crate::model::Channel]) -> Vec<Port> {
    channels.iter().map(|c| Port { name: c.name.clone(), unit: c.unit.clone() }).collect()
}

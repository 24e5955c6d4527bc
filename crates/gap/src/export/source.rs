//! The source of an export, and the errors of a missing one.

use crate::format::diagnosis::Diagnosis;
use deadtime_model::ModelDocument;
use deadtime_signal::remedy::{Message, Remedied, Remedy};

/// The source of an export.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The diagnosis.
    pub diagnosis: &'a Diagnosis,
    /// The model with the effects that were found, where there is one.
    pub model: Option<&'a ModelDocument>,
    /// Standard deviation of outputs in the logs, by name: the diagnosis has noise only as a part of it.
    pub deviations: &'a [(String, f64)],
    /// The half-width of every interval is multiplied by this; 1: the 95 % intervals as they are.
    pub widen: f64,
}

/// A diagnosis that cannot be handed over.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The target needs a model.
    #[error("{}", self.remedied().unwrap_or_default())]
    NeedsModel {
        /// The target.
        target: &'static str,
    },
    /// The target needs an option.
    #[error("{}", self.remedied().unwrap_or_default())]
    NeedsOption {
        /// The target.
        target: &'static str,
        /// The option.
        option: &'static str,
        /// The meaning of the option.
        why: &'static str,
    },
    /// A number that must be larger than 0.
    #[error("{option} is {value}; it must be a number above 0")]
    NotPositive {
        /// The option.
        option: &'static str,
        /// The value given.
        value: f64,
    },
    /// The model is none of the diagnosis.
    #[error(
        "the model is `{model}` and the diagnosis is of `{diagnosed}`: give the model that was diagnosed"
    )]
    OtherModel {
        /// The model given.
        model: String,
        /// The model of the diagnosis.
        diagnosed: String,
    },
    /// The equations have no finite slope where a log starts.
    #[error(
        "the equations of `{model}` cannot be linearised where a log starts: a slope there is not finite"
    )]
    NoSlope {
        /// The model.
        model: String,
    },
}

impl Remedied for ExportError {
    fn remedied(&self) -> Option<Message> {
        match self {
            Self::NeedsModel { target } => Some(
                Message::from(format!("{target} needs the model: give "))
                    .and(Remedy::Model)
                    .and(", such as the model_with_effects.toml in the diagnosis' folder"),
            ),
            Self::NeedsOption { target, option, why } => Some(
                Message::from(format!("{target} needs "))
                    .and(Remedy::ExportOption { name: option })
                    .and(format!(": {why}")),
            ),
            _ => None,
        }
    }
}

//! A model file of any kind.

use std::path::Path;

use serde::Serialize;

use super::{CandidateEntry, Channel, EffectEntry, EquationsFile, ModelFile, Syntax, read_text};
use crate::error::Result;
use crate::log::{Log, LogError};
use crate::model::ModelError;

/// A model file, linear or as equations.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ModelDocument {
    /// `kind = "lti"`; `tf` and `zpk` are read as such.
    Lti(ModelFile),
    /// `kind = "equations"`.
    Equations(EquationsFile),
}

impl ModelDocument {
    /// Reads and checks a model file of any kind.
    ///
    /// # Errors
    /// [`crate::Error::Io`], or a [`ModelError`] that names the file and what is wrong in it.
    pub fn read(path: &Path) -> Result<Self> {
        let (text, syntax) = read_text(path)?;
        Ok(Self::parse(&text, syntax, path)?)
    }

    /// From the text of a TOML file; `source` is what error messages call it.
    ///
    /// # Errors
    /// A [`ModelError`] that says what is wrong in it.
    pub fn from_toml(text: &str, source: &Path) -> std::result::Result<Self, ModelError> {
        Self::parse(text, Syntax::Toml, source)
    }

    /// From the same keys as JSON.
    ///
    /// # Errors
    /// As [`Self::from_toml`].
    pub fn from_json(text: &str, source: &Path) -> std::result::Result<Self, ModelError> {
        Self::parse(text, Syntax::Json, source)
    }

    fn parse(text: &str, syntax: Syntax, path: &Path) -> std::result::Result<Self, ModelError> {
        let kind = super::kind(text, syntax, path)?;
        Ok(if kind == "equations" {
            Self::Equations(EquationsFile::parse(text, syntax, path)?)
        } else {
            Self::Lti(ModelFile::parse(text, syntax, path)?)
        })
    }

    /// Writes the file, as TOML or JSON by its extension.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`ModelError::Extension`].
    pub fn write(&self, path: &Path) -> Result<()> {
        match self {
            Self::Lti(file) => file.write(path),
            Self::Equations(file) => file.write(path),
        }
    }

    /// The file's text as TOML.
    ///
    /// # Errors
    /// [`ModelError::File`] if the writer refuses it.
    pub fn to_toml(&self) -> std::result::Result<String, ModelError> {
        match self {
            Self::Lti(file) => file.to_toml(),
            Self::Equations(file) => file.to_toml(),
        }
    }

    /// The file's kind, `lti` or `equations`.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Lti(_) => "lti",
            Self::Equations(_) => "equations",
        }
    }

    /// The model's name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Lti(file) => &file.name,
            Self::Equations(file) => &file.name,
        }
    }

    /// The inputs, in order.
    #[must_use]
    pub fn inputs(&self) -> &[Channel] {
        match self {
            Self::Lti(file) => &file.inputs,
            Self::Equations(file) => &file.inputs,
        }
    }

    /// The log with the slopes that the model's inputs ask for (`derivative_of`) and the log lacks.
    ///
    /// # Errors
    /// [`crate::log::LogError`] where the log lacks the input itself, or samples of it.
    pub fn complete(&self, log: Log) -> std::result::Result<Log, LogError> {
        let slopes = self.inputs().iter().filter_map(|c| Some((c.name.as_str(), c.derivative_of.as_deref()?)));
        slopes
            .filter(|(name, _)| !log.names().any(|n| n == *name))
            .collect::<Vec<_>>()
            .into_iter()
            .try_fold(log, |log, (name, of)| log.with_slope(name, of))
    }

    /// The outputs, in order.
    #[must_use]
    pub fn outputs(&self) -> &[Channel] {
        match self {
            Self::Lti(file) => &file.outputs,
            Self::Equations(file) => &file.outputs,
        }
    }

    /// Name and unit of each state, in order.
    pub fn states(&self) -> impl Iterator<Item = (&str, Option<&str>)> {
        let (lti, equations): (&[_], &[_]) = match self {
            Self::Lti(file) => (&file.states, &[]),
            Self::Equations(file) => (&[], &file.states),
        };
        let lti = lti.iter().map(|s: &super::State| (s.name.as_str(), s.unit.as_deref()));
        lti.chain(equations.iter().map(|(name, s)| (name.as_str(), s.unit.as_deref())))
    }

    /// Adds a term that is suspected to be missing.
    ///
    /// # Errors
    /// [`ModelError`] where the model cannot have it.
    pub fn suspect(&mut self, candidate: CandidateEntry) -> std::result::Result<(), ModelError> {
        match self {
            Self::Lti(file) => {
                file.candidates.push(candidate);
                file.to_equations(&[])?.candidates().map(drop)
            }
            Self::Equations(file) => {
                file.candidates.push(candidate);
                file.candidates().map(drop)
            }
        }
    }

    /// Effects that already belong to the simulator.
    #[must_use]
    pub fn effects(&self) -> &[EffectEntry] {
        match self {
            Self::Lti(file) => &file.effects,
            Self::Equations(file) => &file.effects,
        }
    }

    /// The same, to be changed.
    pub fn effects_mut(&mut self) -> &mut Vec<EffectEntry> {
        match self {
            Self::Lti(file) => &mut file.effects,
            Self::Equations(file) => &mut file.effects,
        }
    }

    /// Sampled, not continuous.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        matches!(self, Self::Lti(file) if file.is_sampled())
    }
}

//! A model file of any kind.

use std::path::Path;

use serde::Serialize;

use super::candidate::CandidateEntry;
use super::channel::{Channel, EffectEntry, Operating};
use super::check::unmatched;
use super::equations::{EquationsFile, GroupEntry, GroupKind};
use super::lti::{ModelFile, State};
use super::nuisance::NuisanceEntry;
use super::text::{Syntax, parse_text, read_text};
use super::transfer;
use crate::error::{ModelError, Result};
use deadtime_log::{Log, LogError};

/// A model file, linear or as equations.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ModelDocument {
    /// `kind = "lti"`; files of kind `tf` and `zpk` are converted to it.
    Lti(ModelFile),
    /// `kind = "equations"`.
    Equations(EquationsFile),
}

/// The same expression for a file of either kind.
macro_rules! either {
    ($document:expr, $file:ident => $value:expr) => {
        match $document {
            ModelDocument::Lti($file) => $value,
            ModelDocument::Equations($file) => $value,
        }
    };
}

impl ModelDocument {
    /// Reads and checks a model file of any kind.
    ///
    /// # Errors
    /// [`FileError`](deadtime_signal::file::FileError), or a [`ModelError`] with the file and the fault.
    pub fn read(path: &Path) -> Result<Self> {
        let (text, syntax) = read_text(path)?;
        Ok(Self::parse(&text, syntax, path)?)
    }

    /// From the text of a TOML file; `source` is its name in messages.
    ///
    /// # Errors
    /// A [`ModelError`] with the fault.
    pub fn from_toml(text: &str, source: &Path) -> Result<Self, ModelError> {
        Self::parse(text, Syntax::Toml, source)
    }

    /// From the same keys as JSON.
    ///
    /// # Errors
    /// As [`Self::from_toml`].
    pub fn from_json(text: &str, source: &Path) -> Result<Self, ModelError> {
        Self::parse(text, Syntax::Json, source)
    }

    fn parse(text: &str, syntax: Syntax, path: &Path) -> Result<Self, ModelError> {
        let kind = super::text::kind(text, syntax, path)?;
        Ok(if kind == "equations" {
            Self::Equations(EquationsFile::parse(text, syntax, path)?)
        } else {
            Self::Lti(ModelFile::parse(text, syntax, path)?)
        })
    }

    /// Writes the file, as TOML or JSON by its extension.
    ///
    /// # Errors
    /// [`FileError`](deadtime_signal::file::FileError), [`ModelError::Extension`].
    pub fn write(&self, path: &Path) -> Result<()> {
        either!(self, file => file.write(path))
    }

    /// The file's text as TOML.
    ///
    /// # Errors
    /// [`ModelError::File`] if the writer refuses it.
    pub fn to_toml(&self) -> Result<String, ModelError> {
        either!(self, file => file.to_toml())
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
        either!(self, file => &file.name)
    }

    /// The inputs, in order.
    #[must_use]
    pub fn inputs(&self) -> &[Channel] {
        either!(self, file => &file.inputs)
    }

    /// The log in the model's form: angles without whole turns, attitudes of one sign. Missing slopes of inputs (`derivative_of`) are added.
    ///
    /// # Errors
    /// [`deadtime_log::LogError`] where the log lacks the input of a slope, or samples of it.
    pub fn complete(&self, mut log: Log) -> Result<Log, LogError> {
        for (channel, turn) in
            self.inputs().iter().chain(self.outputs()).filter_map(|c| Some((c, c.turn()?)))
        {
            if log.channel(&channel.name).is_ok() {
                log = log.without_turns(&channel.name, turn)?;
            }
        }
        for names in self
            .attitudes()
            .filter(|names| names.iter().all(|name| log.channel(name).is_ok()))
            .collect::<Vec<_>>()
        {
            log = log.of_one_sign(names)?;
        }
        for (name, of) in self
            .inputs()
            .iter()
            .filter_map(|c| Some((c.name.as_str(), c.derivative_of.as_deref()?)))
        {
            if !log.names().any(|n| n == name) {
                log = log.with_slope(name, of)?;
            }
        }
        Ok(log)
    }

    /// Whether [`Self::complete`] may change a log.
    #[must_use]
    pub fn asks_of_logs(&self) -> bool {
        let of_channel = |c: &Channel| c.turn().is_some() || c.derivative_of.is_some();
        self.inputs().iter().chain(self.outputs()).any(of_channel)
            || self.attitudes().next().is_some()
    }

    /// The outputs that are quaternions, scalar last.
    fn attitudes(&self) -> impl Iterator<Item = [&str; 4]> {
        let groups: &[(String, GroupEntry)] = match self {
            Self::Lti(_) => &[],
            Self::Equations(file) => &file.groups,
        };
        groups.iter().filter(|(_, group)| group.kind == GroupKind::Attitude).filter_map(
            |(_, group)| match group.outputs.as_slice() {
                [x, y, z, w] => Some([x.as_str(), y.as_str(), z.as_str(), w.as_str()]),
                _ => None,
            },
        )
    }

    /// The outputs, in order.
    #[must_use]
    pub fn outputs(&self) -> &[Channel] {
        either!(self, file => &file.outputs)
    }

    /// Name and unit of each state, in order.
    pub fn states(&self) -> impl Iterator<Item = (&str, Option<&str>)> {
        let (lti, equations): (&[_], &[_]) = match self {
            Self::Lti(file) => (&file.states, &[]),
            Self::Equations(file) => (&[], &file.states),
        };
        let lti = lti.iter().map(|s: &State| (s.name.as_str(), s.unit.as_deref()));
        lti.chain(equations.iter().map(|(name, s)| (name.as_str(), s.unit.as_deref())))
    }

    /// The model as equations, about its operating point, with parameters to fit. For a linear model these are the nonzero entries of A and B, `A_x_from` and
    /// `B_x_from`.
    ///
    /// # Errors
    /// [`ModelError`] for a sampled model, a name that is invalid in an expression, or an operating point `"mean"`.
    pub fn structure(&self) -> Result<EquationsFile, ModelError> {
        let file = match self {
            Self::Equations(file) => return Ok(file.clone()),
            Self::Lti(file) => file,
        };
        let about = |channels: &[Channel]| {
            let value = |c: &Channel| match c.operating {
                Operating::Value(value) => Ok(value),
                Operating::Mean(_) => Err(ModelError::File {
                    path: file.name.clone().into(),
                    detail: format!(
                        "the operating point of `{}` is \"mean\", which equations do not have: write its number",
                        c.name
                    ),
                }),
            };
            channels.iter().map(value).collect::<Result<Vec<f64>, ModelError>>()
        };
        let (inputs, outputs) = (about(&file.inputs)?, about(&file.outputs)?);
        // A state measured under its own name has the measurement's operating point.
        let sys = file.continuous()?;
        let level = |(j, state): (usize, &State)| {
            let Some(i) = file.outputs.iter().position(|o| o.name == state.name) else {
                return Ok(0.0);
            };
            let itself = (0..sys.order()).all(|k| sys.c()[(i, k)] == f64::from(u8::from(k == j)))
                && sys.d().row(i).iter().all(|d| *d == 0.0);
            if itself {
                return Ok(outputs.get(i).copied().unwrap_or(0.0));
            }
            let lacks = "has the name of an output that is another quantity; windows of a log would start there: give it another name";
            Err(unmatched(Path::new(&file.name), "the state", &state.name, lacks))
        };
        let states =
            file.states.iter().enumerate().map(level).collect::<Result<Vec<f64>, ModelError>>()?;
        file.to_equations([&inputs, &states, &outputs])
    }

    /// Adds a term that may be missing.
    ///
    /// # Errors
    /// [`ModelError`] for a term that is invalid in this model.
    pub fn suspect(&mut self, candidate: CandidateEntry) -> Result<(), ModelError> {
        match self {
            Self::Lti(file) => {
                file.candidates.push(candidate);
                file.to_equations([&[], &[], &[]])?.candidates().map(drop)
            }
            Self::Equations(file) => {
                file.candidates.push(candidate);
                file.candidates().map(drop)
            }
        }
    }

    /// Effects that are already part of the simulator.
    #[must_use]
    pub fn effects(&self) -> &[EffectEntry] {
        either!(self, file => &file.effects)
    }

    /// The same, mutable.
    pub fn effects_mut(&mut self) -> &mut Vec<EffectEntry> {
        either!(self, file => &mut file.effects)
    }

    /// Values that are unknown in every log and no cause of a gap.
    #[must_use]
    pub fn nuisances(&self) -> &[NuisanceEntry] {
        either!(self, file => &file.nuisances)
    }

    /// Sampled, not continuous.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        matches!(self, Self::Lti(file) if file.is_sampled())
    }
}

impl ModelFile {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// [`FileError`](deadtime_signal::file::FileError), or a [`ModelError`] with the file and the fault.
    pub fn read(path: &Path) -> Result<Self> {
        let (text, syntax) = read_text(path)?;
        Ok(Self::parse(&text, syntax, path)?)
    }

    pub(super) fn parse(text: &str, syntax: Syntax, path: &Path) -> Result<Self, ModelError> {
        let kind = super::text::kind(text, syntax, path)?;
        if kind == "tf" || kind == "zpk" {
            return transfer::parse(text, syntax, path);
        }
        if kind != "lti" {
            return Err(ModelError::NotLinear { path: path.to_owned(), kind });
        }
        let model: Self = parse_text(text, syntax, path)?;
        model.check(path)?;
        Ok(model)
    }
}

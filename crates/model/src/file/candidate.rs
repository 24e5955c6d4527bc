//! A term that a user suspects the model lacks: `[[candidates]]` of a model file, or `state += expression`.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::equations::{EquationsFile, ParameterEntry};
use super::table;
use crate::equations::parse::reserved;
use crate::equations::system::{Equations, Workspace};
use crate::equations::token::names;
use crate::error::ModelError;

/// A term on the derivative of a state. Names in it that the model does not know are its free parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateEntry {
    /// What it is called; absent: `state += adds`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The state on whose derivative it acts.
    pub state: String,
    /// The expression that is added.
    pub adds: String,
    /// What is known of its free parameters.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<(String, CandidateParameter)>,
}

/// What is known of a candidate's free parameter.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateParameter {
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// 0, where the term is nothing; another value is where the search for a width, a power or the like begins.
    #[serde(default)]
    pub value: f64,
    /// The smallest value that makes sense; absent: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// The largest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
}

/// A candidate that was checked against its model.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// What it is called.
    pub name: String,
    /// The state on whose derivative it acts.
    pub state: usize,
    /// Where its parameters begin among those of the equations.
    pub first: usize,
    /// Its parameters.
    pub parameters: Vec<(String, CandidateParameter)>,
}

/// The model's equations with every candidate in them, whose parameters stand behind the model's own.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// The equations.
    pub equations: Arc<Equations>,
    /// The candidates, in the file's order.
    pub list: Vec<Candidate>,
}

impl CandidateEntry {
    /// From `state += expression`, then, after a semicolon, what is known of its parameters: `k in 0 to 2, width = 0.1 in 0.01 to 1`.
    ///
    /// # Errors
    /// [`ModelError::Candidate`] that says how it is written.
    pub fn from_text(text: &str) -> Result<Self, ModelError> {
        let wrong =
            |why: &str| ModelError::Candidate { candidate: text.to_owned(), why: why.to_owned() };
        let (term, known) =
            text.split_once(';').map_or((text, None), |(term, known)| (term, Some(known)));
        let (state, adds) =
            term.split_once("+=").ok_or_else(|| wrong("write it as `state += expression`"))?;
        let parameters = known.into_iter().flat_map(|known| known.split(',')).map(|said| {
            known_parameter(said).ok_or_else(|| {
                wrong("after `;` write `name in LOWER to UPPER` or `name = VALUE in LOWER to UPPER`, with commas between them")
            })
        });
        Ok(Self {
            name: None,
            state: state.trim().to_owned(),
            adds: adds.trim().to_owned(),
            parameters: parameters.collect::<Result<_, _>>()?,
        })
    }

    fn called(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("{} += {}", self.state, self.adds))
    }
}

/// `name`, `name = VALUE`, `name in LOWER to UPPER` or both.
fn known_parameter(said: &str) -> Option<(String, CandidateParameter)> {
    let (front, range) =
        said.split_once(" in ").map_or((said, None), |(front, range)| (front, Some(range)));
    let (name, value) =
        front.split_once('=').map_or((front, None), |(name, value)| (name, Some(value)));
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let (lower, upper) = match range {
        Some(range) => {
            let (lower, upper) = range.split_once(" to ")?;
            (Some(number(lower)?), Some(number(upper)?))
        }
        None => (None, None),
    };
    let name = name.trim();
    let value = value.map_or(Some(0.0), number)?;
    (!name.is_empty())
        .then(|| (name.to_owned(), CandidateParameter { unit: None, value, lower, upper }))
}

impl EquationsFile {
    /// The equations with the file's candidates in them; `None` where it has none.
    ///
    /// # Errors
    /// [`ModelError::Candidate`] for one that is no term that can be searched for; [`ModelError::Equations`], which points into the expression.
    pub(super) fn compile_candidates(&self, path: &Path) -> Result<Option<Candidates>, ModelError> {
        if self.candidates.is_empty() {
            return Ok(None);
        }
        let base = self.compile(path)?;
        let mut extended = Self { candidates: Vec::new(), ..self.clone() };
        let mut list: Vec<Candidate> = Vec::new();
        for entry in &self.candidates {
            let name = entry.called();
            let wrong = |why: String| ModelError::Candidate { candidate: name.clone(), why };
            let state = self.states.iter().position(|(state, _)| *state == entry.state);
            let state = state.ok_or_else(|| {
                wrong(format!("the model has no state `{}`; name one of its states", entry.state))
            })?;
            if list.iter().any(|c| c.name == name) {
                return Err(wrong(
                    "it stands there twice; leave one, or give each a name".to_owned(),
                ));
            }
            let parameters = self.free_parameters(entry)?;
            if let Some((taken, _)) = parameters
                .iter()
                .find(|(p, _)| extended.parameters.iter().any(|(known, _)| known == p))
            {
                return Err(wrong(format!(
                    "its parameter `{taken}` is one of another candidate too; give each its own name"
                )));
            }
            let first = extended.parameters.len();
            let added = parameters.iter().map(|(name, p)| {
                (name.clone(), ParameterEntry { unit: p.unit.clone(), value: p.value })
            });
            extended.parameters.extend(added);
            if let Some((_, derivative)) =
                extended.derivatives.iter_mut().find(|(of, _)| *of == entry.state)
            {
                *derivative = format!("({derivative}) + ({})", entry.adds);
            }
            list.push(Candidate { name, state, first, parameters });
        }
        let equations = extended.compile(path)?;
        for candidate in &list {
            if !vanishes(&base, &equations, candidate.state) {
                let sizes: Vec<String> = candidate
                    .parameters
                    .iter()
                    .filter(|(_, p)| p.value == 0.0)
                    .map(|(name, _)| format!("{name} = 0"))
                    .collect();
                let why = format!(
                    "it is not nothing at {}: a candidate adds to the model, so write it as a free factor times the rest",
                    sizes.join(", ")
                );
                return Err(ModelError::Candidate { candidate: candidate.name.clone(), why });
            }
        }
        Ok(Some(Candidates { equations: Arc::new(equations), list }))
    }

    /// The names in a candidate's expression that the model does not know, in their order, with what is known of them.
    fn free_parameters(
        &self,
        entry: &CandidateEntry,
    ) -> Result<Vec<(String, CandidateParameter)>, ModelError> {
        let wrong = |why: String| ModelError::Candidate { candidate: entry.called(), why };
        let known = |name: &str| {
            reserved(name).is_some()
                || self.inputs.iter().any(|c| c.name == name)
                || self.states.iter().any(|(n, _)| n == name)
                || self.parameters.iter().any(|(n, _)| n == name)
                || self.definitions.iter().any(|(n, _)| n == name)
        };
        // Of what is no expression the equations say where it is wrong.
        let Some(names) = names(&entry.adds) else { return Ok(entry.parameters.clone()) };
        let free: Vec<String> = names.into_iter().filter(|name| !known(name)).collect();
        if let Some((name, _)) = entry.parameters.iter().find(|(name, _)| !free.contains(name)) {
            let why = if known(name) {
                "is a name of the model already"
            } else {
                "does not stand in its expression"
            };
            return Err(wrong(format!("its parameter `{name}` {why}; correct the name")));
        }
        let parameters: Vec<(String, CandidateParameter)> = free
            .into_iter()
            .map(|name| {
                let said =
                    entry.parameters.iter().find(|(n, _)| *n == name).map(|(_, p)| p.clone());
                (name, said.unwrap_or_default())
            })
            .collect();
        for (name, p) in &parameters {
            let (lower, upper) =
                (p.lower.unwrap_or(f64::NEG_INFINITY), p.upper.unwrap_or(f64::INFINITY));
            if !(p.value.is_finite() && lower < upper && lower <= p.value && p.value <= upper) {
                return Err(wrong(format!(
                    "its parameter `{name}` is {} in {lower} to {upper}; the value must lie in a range that is not empty",
                    p.value
                )));
            }
        }
        if parameters.iter().all(|(_, p)| p.value != 0.0) {
            let why = "it has no free parameter that is 0 where the term is nothing; multiply it by a name that the model does not know";
            return Err(wrong(why.to_owned()));
        }
        Ok(parameters)
    }
}

/// The state's derivative is the same with and without candidates at their nominal values, wherever both are defined.
fn vanishes(base: &Equations, extended: &Equations, state: usize) -> bool {
    let (own, with) = (base.nominal(), extended.nominal());
    let initial = base.initial();
    let slope = |equations: &Equations, p: &[f64], x: &[f64], u: &[f64]| {
        let mut workspace: Workspace = equations.workspace();
        let mut dx = vec![0.0; x.len()];
        equations.derivatives(0.3, x, u, p, &mut workspace, &mut dx);
        dx.get(state).copied().unwrap_or(f64::NAN)
    };
    [0.5, -0.7, 1.3, 20.0].iter().all(|size| {
        let x: Vec<f64> =
            initial.iter().enumerate().map(|(i, x)| x + size * (1.0 + 0.37 * i as f64)).collect();
        let u: Vec<f64> =
            (0..base.input_symbols().len()).map(|j| size * (1.0 + 0.21 * j as f64)).collect();
        let (without, together) = (slope(base, &own, &x, &u), slope(extended, &with, &x, &u));
        !(without.is_finite() && together.is_finite())
            || (without - together).abs() <= 1e-12 * without.abs()
    })
}

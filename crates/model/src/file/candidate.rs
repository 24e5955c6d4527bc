//! A term that a user suspects the model lacks: `[[candidates]]` of a model file, or `state += expression`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::table;
use crate::equations::system::Equations;
use crate::error::ModelError;

/// A term on the derivative of a state. Unknown names in it are its free parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateEntry {
    /// Its name; absent: `state += adds`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The state on whose derivative it acts.
    pub state: String,
    /// The additional expression.
    pub adds: String,
    /// Properties of its free parameters.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<(String, CandidateParameter)>,
}

/// Properties of a candidate's free parameter.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateParameter {
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// 0, where the term vanishes; another value is the start of the search for a width, a power or the like.
    #[serde(default)]
    pub value: f64,
    /// The smallest valid value; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// The largest valid value; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
}

/// A candidate that was checked against its model.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Its name.
    pub name: String,
    /// The state on whose derivative it acts.
    pub state: usize,
    /// Index of its first parameter among those of the equations.
    pub first: usize,
    /// Its parameters.
    pub parameters: Vec<(String, CandidateParameter)>,
}

/// The model's equations with all candidates; the candidates' parameters follow the model's own.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// The equations.
    pub equations: Arc<Equations>,
    /// The candidates, in the file's order.
    pub list: Vec<Candidate>,
}

impl CandidateEntry {
    /// From `state += expression`. After a semicolon follow properties of its parameters: `k in 0 to 2, width = 0.1 in 0.01 to 1`.
    ///
    /// # Errors
    /// [`ModelError::Candidate`] with the correct syntax.
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

    pub(super) fn called(&self) -> String {
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

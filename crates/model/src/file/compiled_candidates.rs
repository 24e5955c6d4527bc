//! Candidates checked against their model, and compiled into its equations.

use std::path::Path;
use std::sync::Arc;

use super::candidate::{Candidate, CandidateEntry, CandidateParameter, Candidates};
use super::equations::{EquationsFile, ParameterEntry};
use crate::equations::parse::reserved;
use crate::equations::system::{Equations, Workspace};
use crate::equations::token::names;
use crate::error::ModelError;

impl EquationsFile {
    /// The equations with the file's candidates; `None` without candidates.
    ///
    /// # Errors
    /// [`ModelError::Candidate`] for a term that cannot be searched; [`ModelError::Equations`], which points into the expression.
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
            let added = parameters
                .iter()
                .map(|(name, p)| (name.clone(), ParameterEntry::new(p.unit.clone(), p.value)));
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

    /// The unknown names in a candidate's expression, in order, with their properties.
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
        // The equations report the position of an error in an invalid expression.
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

/// The state's derivative is equal with and without candidates at their nominal values, wherever both are defined.
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

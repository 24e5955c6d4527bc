//! The use of a model in an estimation: relative degrees, and the state methods.

use std::time::Instant;

use nalgebra::DVector;

use super::answers::{MethodAnswer, pair};
use super::asked::Job;
use crate::error::{DelayError, Result};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::Search;
use crate::experiment::{Experiment, PlantModel, recordings};
use crate::method::Scope;
use crate::report::Pair;
use crate::verdict::conclusion::RecordFacts;
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{ModelFile, Operating, Sampled, StateSpace};
use deadtime_signal::remedy::{Message, Remedied};
use deadtime_signal::time::SampleTime;

impl Job {
    /// Every input of the model by every state method.
    pub(super) fn inputs_by_state(
        &self,
        model: &ModelFile,
        ts: SampleTime,
        search: &Search,
    ) -> Result<Vec<Pair>> {
        let experiment = self.with_states(model, ts)?;
        let facts = RecordFacts { early_s: self.early_s(), ..RecordFacts::default() };
        let mut pairs = Vec::new();
        for ready in self.methods.iter().filter(|r| r.method.scope == Scope::States) {
            self.stop.check()?;
            let clock = Instant::now();
            let answers = experiment
                .as_ref()
                .map_err(Clone::clone)
                .and_then(|e| ready.estimator.estimate_inputs(e, search));
            let time_s = clock.elapsed().as_secs_f64();
            for (i, input) in model.inputs.iter().enumerate() {
                let none = |note| DelayEstimate::without(Outcome::NotApplicable, note);
                let estimate = match &answers {
                    Ok(all) => all
                        .get(i)
                        .cloned()
                        .unwrap_or_else(|| none(Message::from("no answer for this input"))),
                    Err(e) => none(e.message()),
                };
                let answer =
                    MethodAnswer { method: ready.method, estimate, predicted: None, time_s };
                pairs.push(pair(&input.name, "*", &[answer], Vec::new(), ts, &facts));
            }
        }
        Ok(pairs)
    }

    /// Relative degrees of the sampled model by the job's outputs and inputs; 1 where the model lacks the pair.
    pub(super) fn relative_degrees(
        &self,
        model: &ModelFile,
        ts: SampleTime,
    ) -> Result<Vec<Vec<usize>>> {
        let sampled = sampled(model, ts)?;
        let degree = |output: &String, input: &String| {
            let output = model.outputs.iter().position(|c| &c.name == output)?;
            let input = model.inputs.iter().position(|c| &c.name == input)?;
            sampled.relative_degree(output, input)
        };
        Ok(self
            .outputs
            .iter()
            .map(|o| self.inputs.iter().map(|i| degree(o, i).unwrap_or(1)).collect())
            .collect())
    }

    /// All inputs of the model and its states, as logged: A and B describe the channels themselves, so nothing is detrended. The inner error reports unusable
    /// channels as the methods' outcome.
    fn with_states(
        &self,
        model: &ModelFile,
        ts: SampleTime,
    ) -> Result<std::result::Result<Experiment<'_>, DelayError>> {
        let inputs: Vec<String> = model.inputs.iter().map(|c| c.name.clone()).collect();
        let plant = if model.is_sampled() {
            PlantModel::Sampled(sampled(model, ts)?)
        } else {
            PlantModel::Continuous(model.continuous()?)
        };
        let (ts, mut recordings) = recordings(&self.logs, &inputs, &self.outputs)?;
        for (log, recording) in self.logs.iter().zip(&mut recordings) {
            for (channel, values) in model.inputs.iter().zip(&mut recording.inputs) {
                let operating = match channel.operating {
                    Operating::Value(v) => v,
                    Operating::Mean(_) => DVector::from_column_slice(values).mean(),
                };
                values.to_mut().iter_mut().for_each(|v| *v -= operating);
            }
            // The states, where the log has all of them.
            let columns: std::result::Result<Vec<&[f64]>, _> =
                model.states.iter().map(|s| log.input(&s.name)).collect();
            recording.states = columns.unwrap_or_default().into_iter().map(Into::into).collect();
        }
        Ok(Experiment::new(ts, inputs, self.outputs.clone(), recordings)
            .map(|e| e.with_model(plant)))
    }
}

fn sampled(model: &ModelFile, ts: SampleTime) -> Result<StateSpace<Sampled>> {
    if model.is_sampled() {
        let sampled = model.sampled()?;
        let grid = |error| DelayError::ModelGrid { model: model.name.clone(), error };
        sampled.sample_time().must_equal(ts).map_err(grid)?;
        return Ok(sampled);
    }
    Ok(ZeroOrderHold {}.c2d(&model.continuous()?, ts)?)
}

//! A diagnosis with its curves and its model.

use super::force_profile::ForceProfile;
use super::traces::{CommandTrace, Trace};
use crate::format::caveat::Caveat;
use crate::format::diagnosis::Diagnosis;
use crate::format::next_experiment::NextExperiment;
use deadtime_model::ModelDocument;
use deadtime_model::effect::Applied;
use deadtime_signal::remedy::Words;

/// A diagnosis, and the model with the effects that it found.
#[derive(Debug, Clone)]
pub struct Diagnosed {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The model with the found effects added, in the form that improves a simulation; `None` for a simulator without a model file.
    pub model: Option<ModelDocument>,
    /// The active effects.
    pub effects: Vec<Applied>,
    /// The same in the form that the model carries: nothing that is random, nothing that makes held-out data worse.
    pub handed_over: Vec<Applied>,
    /// Measurement and prediction, by output and then by log.
    pub traces: Vec<Trace>,
    /// The commands, by log and then by input.
    pub commands: Vec<CommandTrace>,
    /// The experiment that `next_experiment` of the diagnosis is about.
    pub next_experiment: Option<NextExperiment>,
    /// The remainder as a force over the variable that correlates with it; `None` where no force is reported.
    pub missing_force: Option<ForceProfile>,
    /// Caveats on the data for the reader.
    pub caveats: Vec<Caveat>,
    /// The number of calls of a simulator that can only be called; `None` for a model file.
    pub calls: Option<usize>,
}

impl Diagnosed {
    /// The diagnosis with its findings and caveats in the words of a face.
    #[must_use]
    pub fn worded(mut self, words: Words) -> Self {
        let checks = self.diagnosis.checks.iter_mut().map(|check| &mut check.finding);
        let remainder = &mut self.diagnosis.cause.remainder;
        let described = remainder.iter_mut().filter_map(|r| r.description.as_mut());
        checks.chain(described.map(|d| &mut d.sentence)).for_each(|text| text.word(words));
        self.caveats.iter_mut().for_each(|caveat| caveat.word(words));
        self
    }
}

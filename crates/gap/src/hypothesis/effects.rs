//! One or more effects that together explain a gap.

use super::waits::Wait;
use crate::input::record::LogRecord;
use crate::likelihood::active_effects::{ActiveEffects, LostCommands};
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Applied;

/// Effects with their best parameters so far.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    /// In the order of the table of effects; in a verdict by what each contributes.
    pub(crate) effects: Vec<Applied>,
    /// Parameters that were fitted, as effect and place; limits that do not act are not among them.
    pub(crate) free: Vec<(usize, usize)>,
    /// The reduction of the whitened cost against no effect.
    pub(crate) gain: f64,
    /// Fitted in full, not only screened.
    pub(crate) fitted: bool,
    /// The commands that were lost, where an effect loses some.
    pub(crate) lost: Option<Dropouts>,
}

/// Lost commands of all records.
#[derive(Debug, Clone)]
pub(crate) struct Dropouts {
    /// One per record.
    pub(crate) sequences: Vec<LostCommands>,
    /// Twice the negative log-probability of the decisions on the training logs.
    pub(crate) price: f64,
    /// Per input, the waits of commands that show on the training logs.
    pub(crate) waits: Vec<Vec<Wait>>,
    /// Per input, standard deviations of the first parameters of what makes its commands late, as far as they could be estimated.
    pub(crate) std: Vec<Vec<f64>>,
    /// Effective number of noise values that the latent sequence fits: the residual is smaller than the noise by these degrees of freedom. 0 where decisions are few.
    pub(crate) followed: f64,
}

impl Dropouts {
    /// Nothing is known yet.
    pub(super) fn none(likelihood: &Likelihood<'_>) -> Self {
        let inputs = likelihood.system.inputs.len();
        Self {
            sequences: vec![vec![None; inputs]; likelihood.records.len()],
            price: 0.0,
            waits: vec![Vec::new(); inputs],
            std: vec![Vec::new(); inputs],
            followed: 0.0,
        }
    }
}

impl<'e> From<&'e Hypothesis> for ActiveEffects<'e> {
    fn from(hypothesis: &'e Hypothesis) -> Self {
        Self {
            effects: &hypothesis.effects,
            lost: hypothesis.lost.as_ref().map(|l| l.sequences.as_slice()),
        }
    }
}

impl Hypothesis {
    /// One effect, not fitted yet.
    pub(crate) fn screened(applied: Applied, gain: f64) -> Self {
        Self { effects: vec![applied], free: Vec::new(), gain, fitted: false, lost: None }
    }

    /// `effect:channel`, of several joined by " + ", in any order.
    pub(crate) fn key(&self) -> String {
        let mut keys: Vec<String> = self.effects.iter().map(Applied::key).collect();
        keys.sort();
        keys.join(" + ")
    }

    /// Parameters beyond the first of every effect.
    pub(crate) fn further_parameters(&self) -> usize {
        self.free.len().saturating_sub(self.effects.len())
    }

    /// Some effect loses commands.
    pub(crate) fn loses_commands(&self) -> bool {
        self.effects.iter().any(|a| a.effect.loses_commands())
    }

    /// The noise over the residual that this hypothesis leaves of it on the training logs. A Gaussian process of delays leaves N − tr S of N squares (Rasmussen
    /// and Williams 2006, section 2.6). S is the map from the outputs to their explained part.
    pub(crate) fn noise_over_left(&self, likelihood: &Likelihood<'_>) -> f64 {
        let followed = self.lost.as_ref().map_or(0.0, |l| l.followed);
        if followed <= 0.0 {
            return 1.0;
        }
        let there = |r: &LogRecord, i: usize| {
            (0..r.time_s.len()).filter(|&k| r.measured_in(r.train, i, k).is_some()).count()
        };
        let samples: usize = likelihood
            .records
            .iter()
            .flat_map(|r| (0..r.measured.len()).map(move |i| there(r, i)))
            .sum();
        let samples = samples.max(1) as f64;
        // At most half of the samples can be followed, so that the remainder still has information.
        (samples / (samples - followed.min(0.5 * samples))).sqrt()
    }

    /// One of the effects, with its value from the joint fit.
    pub(crate) fn only(&self, place: usize) -> Self {
        let effects = self.effects.get(place).cloned().into_iter().collect();
        let free = self.free.iter().filter(|f| f.0 == place).map(|f| (0, f.1)).collect();
        Self { effects, free, lost: None, ..self.clone() }
    }

    /// Its effects by what each explains, most first.
    pub(crate) fn ordered(mut self, explains: impl Fn(&Applied) -> f64) -> Self {
        let mut order: Vec<usize> = (0..self.effects.len()).collect();
        order.sort_by(|&a, &b| explains(&self.effects[b]).total_cmp(&explains(&self.effects[a])));
        let effects = order.iter().map(|&e| self.effects[e].clone()).collect();
        for free in &mut self.free {
            free.0 = order.iter().position(|&e| e == free.0).unwrap_or(free.0);
        }
        self.effects = effects;
        self
    }
}

//! An effect on a channel with values for its parameters, and a list of such effects as a plan.

use super::definition::{Effect, OnChannel, Site};
use super::effects::{EFFECTS, find};
use super::error::{EffectError, Result};
use super::parameter::{Parameter, Role};
use super::scales::Scales;
use crate::file::channel::EffectEntry;
use crate::simulate::plan::{Delays, Drops, Losses, Plan, Realisation};
use crate::simulate::system::System;

/// Upper bound of any parameter.
const BOUNDLESS: f64 = 1e50;

/// The random sequences of the effects; when given, one per input.
pub type Chance<'a> = Realisation<&'a [Option<Fates>]>;

/// The latent sequence of an input's commands, one entry for each sample of the log.
#[derive(Debug, Clone, PartialEq)]
pub enum Fates {
    /// Samples in which the sent command was late or lost.
    Missing(Vec<bool>),
    /// The delay of each command, s.
    Late(Vec<f64>),
}

/// An effect on a channel with its values.
#[derive(Clone)]
pub struct Applied {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Its channel.
    pub channel: String,
    /// Its parameters on this channel.
    pub parameters: Vec<Parameter>,
    /// One value per parameter.
    pub values: Vec<f64>,
}

impl std::fmt::Debug for Applied {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}{:?}", self.effect.name(), self.channel, self.values)
    }
}

impl Applied {
    /// The effect at its nominal parameters: the identity.
    ///
    /// # Errors
    /// [`EffectError::Channel`], [`EffectError::Sampled`] or [`EffectError::BlackBox`] where the effect cannot act there.
    pub fn nominal(system: &System, effect: &'static dyn Effect, channel: &str) -> Result<Self> {
        if system.is_sampled() && effect.site() == Site::Dynamics {
            return Err(EffectError::Sampled { effect: effect.name() });
        }
        if system.is_black_box() && effect.facts().needs_equations {
            return Err(EffectError::BlackBox { effect: effect.name() });
        }
        let parameters = effect.parameters(OnChannel { effect, system, channel })?;
        let values = parameters.iter().map(|p| p.nominal).collect();
        Ok(Self { effect, channel: channel.to_owned(), parameters, values })
    }

    /// Its channel, of this system.
    fn on<'a>(&'a self, system: &'a System) -> OnChannel<'a> {
        OnChannel { effect: self.effect, system, channel: &self.channel }
    }

    /// The same, with the search bounded to values that these logs can reveal.
    #[must_use]
    pub fn shown_by(mut self, system: &System, scales: &Scales) -> Self {
        let least = self.effect.least(self.on(system), scales);
        for (parameter, least) in self.parameters.iter_mut().zip(least) {
            parameter.lower = parameter.lower.max(least).min(parameter.upper);
        }
        self
    }

    /// Initial parameters from sizes of the data; those from a division by zero motion are left out.
    #[must_use]
    pub fn starts(&self, system: &System, scales: &Scales) -> Vec<Vec<f64>> {
        let mut starts = self.effect.starts(self.on(system), scales);
        starts.retain(|s| s.iter().all(|v| v.is_infinite() || v.abs() < BOUNDLESS));
        for (value, parameter) in
            starts.iter_mut().flat_map(|start| start.iter_mut().zip(&self.parameters))
        {
            if parameter.role == Role::Shape {
                *value = value.max(parameter.lower);
            }
        }
        starts
    }

    /// From an entry of a model file.
    ///
    /// # Errors
    /// [`EffectError`] for an unknown effect, channel or parameter, and for a parameter that is missing or outside its bounds.
    pub fn from_entry(system: &System, entry: &EffectEntry) -> Result<Self> {
        let mut applied = Self::nominal(system, find(&entry.effect)?, &entry.channel)?;
        let (effect, channel) = (applied.effect.name(), applied.channel.clone());
        if let Some(parameter) = entry
            .parameters
            .keys()
            .find(|key| applied.parameters.iter().all(|p| p.name != key.as_str()))
        {
            let known = applied.parameters.iter().map(|p| p.name.to_string()).collect();
            return Err(EffectError::UnknownParameter {
                effect,
                channel,
                parameter: parameter.clone(),
                known,
            });
        }
        for (value, parameter) in applied.values.iter_mut().zip(&applied.parameters) {
            match entry.parameters.get(parameter.name.as_ref()) {
                Some(given) => *value = *given,
                None if parameter.nominal.is_infinite() => {}
                None => {
                    return Err(EffectError::MissingParameter {
                        effect,
                        channel,
                        parameter: parameter.name.to_string(),
                    });
                }
            }
        }
        applied.check()?;
        Ok(applied)
    }

    /// As an entry of a model file; infinite limits are left out.
    #[must_use]
    pub fn to_entry(&self) -> EffectEntry {
        let finite = self.parameters.iter().zip(&self.values).filter(|(_, v)| v.is_finite());
        EffectEntry {
            effect: self.effect.name().to_owned(),
            channel: self.channel.clone(),
            parameters: finite.map(|(p, v)| (p.name.to_string(), *v)).collect(),
        }
    }

    /// The search bounds of a parameter.
    #[must_use]
    pub fn range(&self, at: usize, scales: &Scales) -> (f64, f64) {
        self.parameters[at].range(scales)
    }

    /// `effect:channel`.
    #[must_use]
    pub fn key(&self) -> String {
        format!("{}:{}", self.effect.name(), self.channel)
    }

    fn check(&self) -> Result<()> {
        let effect = self.effect.name();
        for (&value, p) in self.values.iter().zip(&self.parameters) {
            if !(value >= p.lower && value <= p.upper) {
                let (channel, parameter) = (self.channel.clone(), p.name.to_string());
                return Err(EffectError::Bounds {
                    effect,
                    channel,
                    parameter,
                    value,
                    lower: p.lower,
                    upper: p.upper,
                });
            }
        }
        let named = |name: &str| {
            self.parameters.iter().position(|p| p.name == name).map(|i| self.values[i])
        };
        match (named("lower"), named("upper")) {
            (Some(lower), Some(upper)) if lower >= upper => {
                Err(EffectError::Limits { effect, channel: self.channel.clone(), lower, upper })
            }
            _ => Ok(()),
        }
    }

    /// Adds the effect's hooks; none where its values make it the identity.
    fn apply(&self, system: &System, plan: &mut Plan) -> Result<()> {
        self.check()?;
        if self.effect.is_identity(&self.values, &self.parameters) {
            return Ok(());
        }
        self.effect.apply(self.on(system), &self.values, plan)
    }

    /// The plan of a system with these effects, in the order of the table instead of the list.
    ///
    /// # Errors
    /// [`EffectError`] for values outside their bounds.
    pub fn plan<'a>(
        system: &System,
        effects: impl IntoIterator<Item = &'a Self, IntoIter: Clone>,
        chance: Chance<'_>,
    ) -> Result<Plan> {
        let mut plan = Plan::new(system);
        let effects = effects.into_iter();
        for effect in EFFECTS {
            for applied in effects.clone().filter(|a| a.effect.name() == effect.name()) {
                applied.apply(system, &mut plan)?;
            }
        }
        for (i, path) in plan.inputs.iter_mut().enumerate() {
            let seed_of = |seed: u64| seed.wrapping_add(i as u64);
            let known = match chance {
                Chance::Known(sequences) => sequences.get(i).cloned().flatten(),
                Chance::Mean | Chance::Seed(_) => None,
            };
            match (known, &mut path.late) {
                (Some(Fates::Missing(missing)), late) if late.is_some() || path.drops.is_some() => {
                    let losses = path.drops.as_ref().map_or_else(Losses::default, |d| d.losses);
                    path.drops = Some(Drops { losses, lost: Realisation::Known(missing) });
                    *late = None;
                }
                (Some(Fates::Late(delays)), Some(late)) => late.delays = Delays::Known(delays),
                _ => {}
            }
            let Chance::Seed(seed) = chance else { continue };
            if let Some(late) = &mut path.late {
                late.delays = Delays::Seed(seed_of(seed));
            }
            if let Some(drops) = &mut path.drops {
                drops.lost = Realisation::Seed(seed_of(seed));
            }
        }
        Ok(plan)
    }
}

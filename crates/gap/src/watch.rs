//! The gap of a machine whose log still grows: a diagnosis of each stretch of the log, and its changes.
//!
//! How it can be wrong: an effect in a part of a stretch is diluted there. The initial state of a stretch is estimated from the stretch, so earlier memory is
//! not visible. A stretch with almost constant inputs names nothing; the event reports that.

use deadtime_signal::remedy::{Message, Remedied};
use serde::Serialize;

use super::error::Result;
use crate::answer::diagnosed::Diagnosed;
use crate::format::found::FoundParameter;
use crate::input::options::GapOptions;
use crate::pipeline::diagnose;
use deadtime_log::{Channel, Log};
use deadtime_model::ModelDocument;
use deadtime_signal::time::SampleTime;

/// Rows below which a stretch is not diagnosed.
const FEWEST: usize = 100;

/// Diagnoses a log stretch by stretch, as its rows come.
#[derive(Debug, Clone)]
pub struct GapWatch {
    model: ModelDocument,
    options: GapOptions,
    length_s: f64,
    names: Vec<String>,
    time_s: Vec<f64>,
    /// One column per name.
    values: Vec<Vec<Option<f64>>>,
    last: Option<Vec<ActingEffect>>,
}

/// An effect that was found to act in a stretch.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ActingEffect {
    /// Its name.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// Its parameters.
    pub parameters: Vec<FoundParameter>,
}

/// The result of one stretch of the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum GapTold {
    /// Its gap.
    Gap {
        /// Time of its first row, s.
        from_s: f64,
        /// Time of its last row, s.
        to_s: f64,
        /// The nrmse of the nominal model; missing where every output is constant.
        error: Option<f64>,
        /// The part of it that no model can explain.
        floor: Option<f64>,
        /// `none`, `unknown`, or the effect that leads.
        verdict: String,
        /// Everything that was found to act, the largest first.
        effects: Vec<ActingEffect>,
        /// The effects differ from those of the stretch before, or the 95 % intervals of one parameter are disjoint; always so for the first.
        changed: bool,
    },
    /// It could not be diagnosed.
    GapNotTold {
        /// Time of its first row, s.
        from_s: f64,
        /// Time of its last row, s.
        to_s: f64,
        /// The reason.
        why: Message,
    },
}

impl GapWatch {
    /// A watch over stretches of `length_s` seconds. The state at the start of each is unknown, for any initial state of the model.
    #[must_use]
    pub fn new(model: &ModelDocument, length_s: f64, options: GapOptions) -> Self {
        let mut model = model.clone();
        match &mut model {
            ModelDocument::Lti(file) => file.initial_std.clear(),
            ModelDocument::Equations(file) => {
                file.states.iter_mut().for_each(|(_, state)| state.initial_std = None)
            }
        }
        let mut names: Vec<String> = model
            .inputs()
            .iter()
            .filter(|c| c.derivative_of.is_none())
            .map(|c| c.name.clone())
            .collect();
        names.extend(model.outputs().iter().map(|c| c.name.clone()));
        let values = vec![Vec::new(); names.len()];
        Self { model, options, length_s, names, time_s: Vec::new(), values, last: None }
    }

    /// The channels of a row, in the order in which [`Self::push`] takes them: inputs, then outputs.
    #[must_use]
    pub fn channels(&self) -> &[String] {
        &self.names
    }

    /// Takes a row: its time, s, later than that of the row before, and the channels' values, `None` where they are missing. A stretch that is full is diagnosed,
    /// which takes seconds.
    ///
    /// # Errors
    /// [`super::error::Error::Stopped`]. A stretch without a diagnosis is an event, not an error.
    pub fn push(&mut self, time_s: f64, values: &[Option<f64>]) -> Result<Option<GapTold>> {
        let full = self.time_s.first().is_some_and(|first| time_s - first >= self.length_s);
        let reported = if full { Some(self.stretch()?) } else { None };
        self.time_s.push(time_s);
        for (at, column) in self.values.iter_mut().enumerate() {
            column.push(values.get(at).copied().flatten());
        }
        Ok(reported)
    }

    /// The remainder of the log, where it is long enough.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn finish(&mut self) -> Result<Option<GapTold>> {
        if self.time_s.len() < FEWEST { Ok(None) } else { self.stretch().map(Some) }
    }

    /// The recorder began anew: the undiagnosed samples are dropped.
    pub fn restart(&mut self) {
        self.time_s.clear();
        self.values.iter_mut().for_each(Vec::clear);
    }

    /// Diagnoses the rows so far, and lets them go.
    fn stretch(&mut self) -> Result<GapTold> {
        let (from_s, to_s) = (
            self.time_s.first().copied().unwrap_or(0.0),
            self.time_s.last().copied().unwrap_or(0.0),
        );
        let reported = match self.diagnosed() {
            Ok(found) => self.reported(from_s, to_s, &found),
            Err(stopped @ super::error::Error::Stopped(_)) => return Err(stopped),
            Err(error) => GapTold::GapNotTold { from_s, to_s, why: error.message() },
        };
        self.restart();
        Ok(reported)
    }

    fn diagnosed(&self) -> Result<Diagnosed> {
        let first_s = self.time_s.first().copied().unwrap_or(0.0);
        let source =
            format!("{first_s:.3} s to {:.3} s", self.time_s.last().copied().unwrap_or(0.0));
        let column = |(name, values): (&String, &Vec<Option<f64>>)| {
            let present = values.iter().map(Option::is_some).collect();
            Channel::partial(name, None, values.iter().map(|v| v.unwrap_or(0.0)).collect(), present)
        };
        let channels = self.names.iter().zip(&self.values).map(column).collect();
        let log = Log::new(source, self.time_s.iter().map(|t| t - first_s).collect(), channels)?;
        let held: Vec<&str> = self.model.inputs().iter().map(|c| c.name.as_str()).collect();
        let log = match log.even_grid() {
            Ok(_) => log,
            Err(_) => log.resample(SampleTime::new(log.median_step_s())?, &held)?,
        };
        diagnose(&self.model, &[self.model.complete(log)?], &[], &self.options, &|_| ())
    }

    fn reported(&mut self, from_s: f64, to_s: f64, found: &Diagnosed) -> GapTold {
        let cause = &found.diagnosis.cause;
        let acting = |effect: &str, channel: &str, parameters: &[FoundParameter]| ActingEffect {
            effect: effect.to_owned(),
            channel: channel.to_owned(),
            parameters: parameters.to_vec(),
        };
        let effects: Vec<ActingEffect> = match cause.contributions.as_slice() {
            [] => {
                cause.effects.iter().map(|e| acting(&e.effect, &e.channel, &e.parameters)).collect()
            }
            contributions => {
                contributions.iter().map(|c| acting(&c.effect, &c.channel, &c.parameters)).collect()
            }
        };
        let changed = self.last.as_ref().is_none_or(|before| differ(before, &effects));
        self.last = Some(effects.clone());
        let (error, floor) = (found.diagnosis.gap.before, found.diagnosis.gap.floor);
        GapTold::Gap {
            from_s,
            to_s,
            error,
            floor,
            verdict: cause.verdict.clone(),
            effects,
            changed,
        }
    }
}

/// The effects differ, or the 95 % intervals of one of their parameters are disjoint.
fn differ(before: &[ActingEffect], now: &[ActingEffect]) -> bool {
    let disjoint = |(a, b): (&FoundParameter, &FoundParameter)| matches!((a.ci95, b.ci95), (Some(a), Some(b)) if a[1] < b[0] || b[1] < a[0]);
    let moved = |a: &ActingEffect| match now
        .iter()
        .find(|b| a.effect == b.effect && a.channel == b.channel)
    {
        None => true,
        Some(b) => a.parameters.iter().zip(&b.parameters).any(disjoint),
    };
    before.len() != now.len() || before.iter().any(moved)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_other_effects_and_numbers_apart_are_a_change() {
        let of = |effect: &str, ci95| {
            let delay = FoundParameter {
                name: "delay".into(),
                unit: "s".into(),
                value: None,
                std: None,
                ci95,
            };
            vec![ActingEffect {
                effect: effect.into(),
                channel: "u".into(),
                parameters: vec![delay],
            }]
        };
        let first = of("input_delay", Some([0.1, 0.2]));
        assert!(!differ(&first, &of("input_delay", Some([0.19, 0.3]))));
        assert!(differ(&first, &of("input_delay", Some([0.21, 0.3]))));
        assert!(
            !differ(&first, &of("input_delay", None))
                && differ(&first, &of("actuator_lag", Some([0.1, 0.2])))
        );
        assert!(differ(&first, &[]) && !differ(&[], &[]));
    }
}

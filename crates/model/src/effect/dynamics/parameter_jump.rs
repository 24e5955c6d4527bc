//! A number of the model is another from a time on: a mass when a load drops, a coefficient when ice sets in.
//!
//! Equation: x′ = f(x, u; p) with p = value until `time` and p = later from then on; for an entry of A or B the same. The state runs on through the change.

use super::parameter_error::number;
use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Switch};
use crate::simulate::system::System;

/// A parameter of the model that steps, at the same time in every log.
///
/// Assumes: one step, at the same log time in every log; the structure of the model is right before and after, and the state does not jump.
/// Fails when: the step stands close to an end of the log, or what the parameter acts on hardly moves beside it. A step of another number that moves the outputs in
/// the same direction is the same: of an entry of B and of the gain of its input.
/// Source: Willsky and Jones (1976), IEEE Trans. Automat. Contr. 21(1), 108-112, doi:10.1109/TAC.1976.1101146 (jumps in linear systems); Ljung (1999), System
/// Identification: Theory for the User, 2nd edition, for the parameter that stands still.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterJump;

impl Effect for ParameterJump {
    fn name(&self) -> &'static str {
        "parameter_jump"
    }

    fn summary(&self) -> &'static str {
        "a parameter of the model steps at a time"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn rule(&self) -> &'static str {
        super::parameter_error::RULE
    }

    fn elaborates(&self) -> Option<&'static str> {
        Some("parameter_error")
    }

    fn changes(&self) -> Option<Change> {
        Some(Change::Jump)
    }

    fn channels(&self, system: &System) -> Vec<String> {
        super::parameter_error::channels(system)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let (_, unit, nominal) = number(self, system, channel)?;
        Ok(vec![
            channel::free("value", unit.clone(), nominal),
            channel::instant(),
            channel::free("later", unit, nominal),
        ])
    }

    fn starts(&self, _: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        scales.scanned(self, channel)
    }

    fn is_identity(&self, values: &[f64], parameters: &[Parameter]) -> bool {
        values[0] == parameters[0].nominal && values[2] == parameters[2].nominal
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (number, ..) = number(self, system, channel)?;
        plan.dynamics.set(number, values[0]);
        plan.switches.push(Switch { time_s: values[1], number, value: values[2] });
        Ok(())
    }
}

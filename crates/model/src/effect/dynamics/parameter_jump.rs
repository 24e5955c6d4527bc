//! A parameter of the model changes at a time: a mass when a load drops, a coefficient when ice forms.
//!
//! Equation: x′ = f(x, u; p) with p = value until `time` and p = later from then on. An entry of A or B changes in the same way. The state is continuous at the
//! change.

use super::parameter_error::number;
use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Switch};
use crate::simulate::system::System;

/// A parameter of the model that steps, at the same time in every log.
///
/// Assumes: one step, at the same log time in every log. The model's structure is correct before and after, and the state does not jump.
/// Fails when: the step is close to an end of the log, or the parameter's term moves too little on one side of it. A step of another parameter with the same
/// direction of effect is an alias: for an entry of B, the gain of its input.
/// Source: Willsky and Jones (1976), IEEE Trans. Automat. Contr. 21(1), 108-112, doi:10.1109/TAC.1976.1101146 (jumps in linear systems). Ljung (1999), System
/// Identification: Theory for the User, 2nd edition, for the constant parameter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterJump;

impl Effect for ParameterJump {
    fn facts(&self) -> Facts {
        Facts {
            rule: super::parameter_error::RULE,
            elaborates: Some("parameter_error"),
            changes: Some(Change::Jump),
            ..Facts::of(
                "parameter_jump",
                Site::Dynamics,
                "a parameter of the model steps at a time",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        super::parameter_error::channels(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (_, unit, nominal) = number(on)?;
        Ok(vec![
            channel::free("value", unit.clone(), nominal),
            channel::instant(),
            channel::free("later", unit, nominal),
        ])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (number, ..) = number(on)?;
        plan.dynamics.set(number, values[0]);
        plan.switches.push(Switch { time_s: values[1], number, value: values[2] });
        Ok(())
    }
}

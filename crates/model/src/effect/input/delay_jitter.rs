//! Every command has a random delay: its mean, its standard deviation, and whether commands keep their order.
//!
//! Equation: command k acts from t_k + d_k on. d_k is gamma distributed with mean `delay` and standard deviation `spread`; ordered: not before command k − 1.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, Lateness, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{Delays, Late, Plan};

/// From this value on commands keep their order.
const ORDERED: f64 = 0.5;

/// Each logged command's delay is a draw of a gamma distribution; a plan uses the mean until a seed draws the delays.
///
/// Assumes: independent delays of one gamma distribution, one for each command.
/// Fails when: the spread is small compared with the sample time or the plant's own lag: a constant delay explains as much. Jitter with a pattern is not of
/// this kind.
/// Source: Nilsson (1998), Real-Time Control Systems with Delays, doctoral thesis, Lund Institute of Technology.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayJitter;

impl Effect for DelayJitter {
    fn facts(&self) -> Facts {
        Facts {
            lateness: Some(Lateness::Random),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of(
                "delay_jitter",
                Site::Input,
                "every command arrives late by a random delay of its own",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        let ordered = Parameter {
            role: Role::Shape,
            upper: 1.0,
            ..channel::not_negative("ordered", "1".to_owned(), 0.0)
        };
        Ok(vec![
            channel::delay("delay"),
            channel::not_negative("spread", "s".to_owned(), 0.0),
            ordered,
        ])
    }

    /// None: its mean is a constant delay, and only the decoded delay of every single command distinguishes it.
    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[0] == 0.0
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let late = Late {
            delay_s: values[0],
            spread_s: values[1],
            ordered: values[2] >= ORDERED,
            delays: Delays::Mean,
        };
        plan.inputs[on.input()?].late = Some(late);
        Ok(())
    }
}

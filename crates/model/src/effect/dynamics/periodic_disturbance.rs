//! Something shakes: amplitude·sin(2π·frequency·t + phase) on a state's derivative, t from the log's first sample.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::{Parameter, Role};
use crate::simulate::plan::{Plan, Term};
use crate::simulate::system::System;

/// Something shakes at one frequency.
///
/// Assumes: one frequency, amplitude and phase through all logs, each from its own start.
/// Fails when: the log holds few periods, or the command moves at that frequency, too.
/// Source: Bodson and Douglas (1997), Automatica 33, 2213-2221, doi:10.1016/S0005-1098(97)00149-0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PeriodicDisturbance;

impl Effect for PeriodicDisturbance {
    fn name(&self) -> &'static str {
        "periodic_disturbance"
    }

    fn summary(&self) -> &'static str {
        "something shakes at one frequency"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.states)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::per(&system.states[channel::state(self, system, channel)?], "s");
        Ok(vec![
            channel::frequency("frequency"),
            channel::free("amplitude", unit, 0.0),
            Parameter { role: Role::Phase, ..channel::free("phase", "rad".to_owned(), 0.0) },
        ])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) =
            channel::state(self, system, channel).ok().and_then(|i| scales.derivatives.get(i))
        else {
            return Vec::new();
        };
        let guesses =
            |f: &f64| [0.0, std::f64::consts::FRAC_PI_2].map(|phase| vec![*f, 0.1 * size, phase]);
        scales.peaks_hz.iter().flat_map(guesses).collect()
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[1] == 0.0
    }

    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        use std::f64::consts::{PI, TAU};
        let [frequency, amplitude, phase] = values[..] else { return values };
        let phase = if amplitude < 0.0 { phase + PI } else { phase };
        // Into (−π, π].
        vec![frequency, amplitude.abs(), PI - (PI - phase).rem_euclid(TAU)]
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let to = channel::state(self, system, channel)?;
        plan.terms.push(Term::Sine {
            to,
            omega_rad_s: std::f64::consts::TAU * values[0],
            amplitude: values[1],
            phase_rad: values[2],
        });
        Ok(())
    }
}

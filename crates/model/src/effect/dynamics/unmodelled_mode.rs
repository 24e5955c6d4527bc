//! A resonance that the model lacks: q″ + 2ζω·q′ + ω²·q = ω²·u, gain·q added to an input, a state's derivative or an output.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::{Parameter, Role};
use crate::simulate::plan;
use crate::simulate::plan::{Mode, Plan};
use crate::simulate::system::System;

/// A resonance that the model lacks.
///
/// Assumes: one linear resonance, excited by one input.
/// Fails when: the command holds little near the resonance, or it lies above half the sample rate. Strongly damped modes look like a lag.
/// Source: Preumont (2018), Vibration Control of Active Structures, 4th edition.
#[derive(Debug, Clone, Copy)]
pub(crate) struct UnmodelledMode;

impl Effect for UnmodelledMode {
    fn name(&self) -> &'static str {
        "unmodelled_mode"
    }

    fn summary(&self) -> &'static str {
        "a resonance that the model lacks"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn rule(&self) -> &'static str {
        "`u->input:u`, `u->state:x` or `u->output:y`"
    }

    fn channels(&self, system: &System) -> Vec<String> {
        let mut channels = Vec::new();
        for u in &system.inputs {
            channels.push(format!("{0}->input:{0}", u.name));
            channels.extend(system.states.iter().map(|x| format!("{}->state:{}", u.name, x.name)));
            channels
                .extend(system.outputs.iter().map(|y| format!("{}->output:{}", u.name, y.name)));
        }
        channels
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let (input, site) = self.place(system, channel)?;
        let input = channel::unit(&system.inputs[input]);
        let over = |unit: String| if input == "1" { unit } else { format!("({unit})/({input})") };
        let gain = match site {
            plan::Site::Input(_) => "1".to_owned(),
            plan::Site::State(i) => over(channel::per(&system.states[i], "s")),
            plan::Site::Output(i) => over(channel::unit(&system.outputs[i])),
        };
        Ok(vec![
            channel::frequency("frequency"),
            Parameter {
                role: Role::Damping,
                lower: 1e-4,
                upper: 10.0,
                ..channel::free("damping", "1".to_owned(), 0.1)
            },
            channel::free("gain", gain, 0.0),
        ])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((input, site)) = self.place(system, channel) else { return Vec::new() };
        let Some(drive) = scales.inputs.get(input).map(|s| s.std.max(f64::MIN_POSITIVE)) else {
            return Vec::new();
        };
        let size = match site {
            plan::Site::Input(_) => 1.0,
            plan::Site::State(i) => scales.derivatives.get(i).map_or(1.0, |v| v / drive),
            plan::Site::Output(i) => scales.outputs.get(i).map_or(1.0, |v| v.std / drive),
        };
        let guesses = |f: &f64| [0.05, 0.4].map(|damping| vec![*f, damping, 0.1 * size]);
        scales.peaks_hz.iter().flat_map(guesses).collect()
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[2] == 0.0
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Bandwidth)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (input, site) = self.place(system, channel)?;
        let mode = Mode {
            input,
            site,
            omega_rad_s: std::f64::consts::TAU * values[0],
            damping: values[1],
            gain: values[2],
        };
        plan.modes.push(mode);
        Ok(())
    }
}

impl UnmodelledMode {
    /// The input that drives it and where it is added.
    fn place(&self, system: &System, channel: &str) -> Result<(usize, plan::Site), EffectError> {
        let find = || {
            let (from, to) = channel.split_once("->")?;
            let (kind, name) = to.split_once(':')?;
            let input = system.inputs.iter().position(|p| p.name == from)?;
            let at =
                |ports: &[crate::simulate::system::Port]| ports.iter().position(|p| p.name == name);
            let site = match kind {
                "input" => plan::Site::Input(at(&system.inputs).filter(|&i| i == input)?),
                "state" => plan::Site::State(at(&system.states)?),
                "output" => plan::Site::Output(at(&system.outputs)?),
                _ => return None,
            };
            Some((input, site))
        };
        find().ok_or_else(|| EffectError::Channel {
            effect: self.name(),
            channel: channel.to_owned(),
            known: self.channels(system),
        })
    }
}

//! A resonance that the model lacks: q″ + 2ζω·q′ + ω²·q = ω²·u, gain·q added to an input, a state's derivative or an output.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{self, Mode, Plan};
use crate::simulate::system::System;

/// A resonance that the model lacks.
///
/// Assumes: one linear resonance, excited by one input.
/// Fails when: the command has little power near the resonance, or the resonance lies above half the sample rate. Strongly damped modes resemble a lag.
/// Source: Preumont (2018), Vibration Control of Active Structures, 4th edition.
#[derive(Debug, Clone, Copy)]
pub(crate) struct UnmodelledMode;

impl Effect for UnmodelledMode {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`u->input:u`, `u->state:x` or `u->output:y`",
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("unmodelled_mode", Site::Dynamics, "a resonance that the model lacks")
        }
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

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (input, site) = place(on)?;
        let input = channel::unit(&on.system.inputs[input]);
        let over = |unit: String| if input == "1" { unit } else { format!("({unit})/({input})") };
        let gain = match site {
            plan::ModeSite::Input(_) => "1".to_owned(),
            plan::ModeSite::State(i) => over(channel::per(&on.system.states[i], "s")),
            plan::ModeSite::Output(i) => over(channel::unit(&on.system.outputs[i])),
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

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((input, site)) = place(on) else { return Vec::new() };
        let Some(drive) = scales.inputs.get(input).map(|s| s.std.max(f64::MIN_POSITIVE)) else {
            return Vec::new();
        };
        let size = match site {
            plan::ModeSite::Input(_) => 1.0,
            plan::ModeSite::State(i) => scales.derivatives.get(i).map_or(1.0, |v| v / drive),
            plan::ModeSite::Output(i) => scales.outputs.get(i).map_or(1.0, |v| v.std / drive),
        };
        let guesses = |f: &f64| [0.05, 0.4].map(|damping| vec![*f, damping, 0.1 * size]);
        scales.peaks_hz.iter().flat_map(guesses).collect()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (input, site) = place(on)?;
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

/// The input that drives it, and the site where it is added.
fn place(on: OnChannel<'_>) -> Result<(usize, plan::ModeSite)> {
    let System { inputs, states, outputs, .. } = on.system;
    let find = || {
        let (from, to) = on.channel.split_once("->")?;
        let (kind, name) = to.split_once(':')?;
        let input = channel::position(inputs, from)?;
        let site = match kind {
            "input" => {
                plan::ModeSite::Input(channel::position(inputs, name).filter(|&i| i == input)?)
            }
            "state" => plan::ModeSite::State(channel::position(states, name)?),
            "output" => plan::ModeSite::Output(channel::position(outputs, name)?),
            _ => return None,
        };
        Some((input, site))
    };
    find().ok_or_else(|| on.unknown())
}

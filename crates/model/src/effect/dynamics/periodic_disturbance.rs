//! A vibration: amplitude·sin(2π·frequency·t + phase) on a state's derivative, t from the log's first sample.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// A vibration at one frequency.
///
/// Assumes: one frequency, amplitude and phase in all logs, relative to each log's own start.
/// Fails when: the log holds few periods, or the command moves at that frequency, too.
/// Source: Bodson and Douglas (1997), Automatica 33, 2213-2221, doi:10.1016/S0005-1098(97)00149-0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PeriodicDisturbance;

impl Effect for PeriodicDisturbance {
    fn facts(&self) -> Facts {
        Facts::of("periodic_disturbance", Site::Dynamics, "something shakes at one frequency")
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::per(&on.system.states[on.state()?], "s");
        Ok(vec![
            channel::frequency("frequency"),
            channel::free("amplitude", unit, 0.0),
            Parameter { role: Role::Phase, ..channel::free("phase", "rad".to_owned(), 0.0) },
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) = on.derivative(scales) else { return Vec::new() };
        let guesses =
            |f: &f64| [0.0, std::f64::consts::FRAC_PI_2].map(|phase| vec![*f, 0.1 * size, phase]);
        scales.peaks_hz.iter().flat_map(guesses).collect()
    }

    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        use std::f64::consts::{PI, TAU};
        let [frequency, amplitude, phase] = values[..] else { return values };
        let phase = if amplitude < 0.0 { phase + PI } else { phase };
        // Into (−π, π].
        vec![frequency, amplitude.abs(), PI - (PI - phase).rem_euclid(TAU)]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let to = on.state()?;
        plan.terms.push(Term::Sine {
            to,
            omega_rad_s: std::f64::consts::TAU * values[0],
            amplitude: values[1],
            phase_rad: values[2],
        });
        Ok(())
    }
}

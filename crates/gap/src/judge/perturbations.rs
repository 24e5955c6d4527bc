//! Perturbations of the inputs of a simulator that can only be called, as substitutes of the effects on equations.
//!
//! Friction, drag, a hardening spring and wrong dampings are functions of the motion that act at an input, or close to one. Their exact place in
//! the simulator is unknown, so they are no candidates; but a residual that correlates with such a perturbation is no noise.
//!
//! How it can be wrong: an effect where no input acts, or one that depends on unmeasured states, is not covered.

use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Site};
use deadtime_signal::stats;

/// The commands of every record, by input.
pub(crate) type Commanded = Vec<Vec<Vec<f64>>>;

/// The size of a perturbation, as a part of its input's standard deviation.
const PUSH: f64 = 0.1;

/// Perturbations as functions of an output or its rate: dry friction, drag, a hardening spring, a wrong stiffness or damping.
const SHAPES: [fn(f64) -> f64; 4] = [f64::signum, |v| v * v.abs(), |v| v * v * v, |v| v];

/// The commands with one perturbation each; none where the simulator fails.
pub(crate) fn perturbations(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    catalogue: &[Applied],
) -> Vec<Commanded> {
    let records = likelihood.records;
    let predicted: Option<Vec<_>> = (0..records.len())
        .map(|at| {
            if records[at].train.is_some() {
                likelihood.predict(at, active).map(Some)
            } else {
                Some(None)
            }
        })
        .collect();
    let Some(predicted) = predicted else { return Vec::new() };
    // The motion of each output, and its rate, about its mean: per record.
    let motions = (0..likelihood.system.outputs.len()).flat_map(|i| {
        let along = predicted.iter().map(|y| {
            y.as_ref().map_or_else(Vec::new, |y| y.column(i).iter().copied().collect::<Vec<f64>>())
        });
        let along: Vec<Vec<f64>> = along.collect();
        let rate = |y: &Vec<f64>| {
            (0..y.len()).map(|k| y[(k + 1).min(y.len() - 1)] - y[k]).collect::<Vec<f64>>()
        };
        let rates = along.iter().map(rate).collect();
        [along, rates]
    });
    let motions: Vec<Vec<Vec<f64>>> = motions.collect();
    let moving =
        |name: &str| catalogue.iter().any(|a| a.effect.site() == Site::Input && a.channel == name);
    let inputs =
        (0..likelihood.system.inputs.len()).filter(|&j| moving(&likelihood.system.inputs[j].name));
    let mut all = Vec::new();
    for j in inputs {
        let size = PUSH * std(records.iter().map(|r| r.inputs[j].as_slice()));
        for motion in &motions {
            for shape in SHAPES {
                let push: Vec<Vec<f64>> =
                    motion.iter().map(|m| m.iter().map(|v| shape(*v)).collect()).collect();
                let spread = std(push.iter().map(Vec::as_slice));
                if size <= 0.0 || spread <= 0.0 || !spread.is_finite() {
                    continue;
                }
                let mut commanded: Commanded = records.iter().map(|r| r.inputs.clone()).collect();
                for (inputs, push) in commanded.iter_mut().zip(&push) {
                    inputs[j].iter_mut().zip(push).for_each(|(u, p)| *u += size / spread * p);
                }
                all.push(commanded);
            }
        }
    }
    all
}

/// Standard deviation over several records.
fn std<'a>(records: impl Iterator<Item = &'a [f64]> + Clone) -> f64 {
    let mean = stats::mean(records.clone().flatten().copied()).unwrap_or(0.0);
    stats::rms(records.flatten().map(|v| v - mean)).unwrap_or(0.0)
}

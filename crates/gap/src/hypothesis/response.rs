//! The outputs' response to one command, and the command's path through the input effects.

use nalgebra::DMatrix;

use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::plan::InputPath;
use deadtime_model::simulate::{Commands, Piecewise};

/// The static value of a command at the end of its path: the curve and the maps of the path.
pub(super) fn static_value(path: &InputPath, value: f64) -> f64 {
    let mut signal = Piecewise::held(&[0.0], [value]);
    if let Some(curve) = path.curve {
        signal =
            signal.map(|p| (curve.gain * p.value + curve.quadratic * p.value * p.value.abs(), 0.0));
    }
    path.maps.iter().fold(signal, |signal, map| map(signal)).first()
}

/// The outputs' response to one held sample of one unit behind the maps of the path, samples × outputs.
pub(super) fn response(
    likelihood: &Likelihood<'_>,
    at: usize,
    others: &[Applied],
    input: usize,
) -> Option<DMatrix<f64>> {
    let record = &likelihood.records[at];
    let mut plan = likelihood.plan(others, Chance::Mean)?;
    (plan.inputs[input].curve, plan.inputs[input].maps) = (None, Vec::new());
    let samples = record.time_s.len();
    let place = samples / 4;
    let size = 1e-2
        * record.inputs[input].iter().map(|u| u.abs()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let simulate = |by: f64| {
        let mut inputs = record.inputs.clone();
        inputs[input][place] += by;
        let commands = Commands { time_s: &record.time_s, inputs: &inputs };
        let start = likelihood.start_of(at);
        likelihood.system.simulate(&plan, commands, start, likelihood.correction(at)).ok()
    };
    let (up, down) = (simulate(0.5 * size)?.y, simulate(-0.5 * size)?.y);
    let length = likelihood.budget.response.min(samples - place);
    let g = (up.rows(place, length) - down.rows(place, length)) / size;
    g.iter().all(|v| v.is_finite()).then_some(g)
}

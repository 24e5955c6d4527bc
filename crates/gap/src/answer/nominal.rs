//! What has to be said of the nominal model before any cause is: it lives about another operating point than the logs, or it is no better than a constant.
//!
//! How it can be wrong: an output that moves little about an offset that the model misses looks the same where the offset alone is wrong. The caveat reports the offset, which is true.
//! A delay or a wrong sign can make a good model worse than a constant. No caveat is given where the reported effects halve the error.

use nalgebra::DMatrix;

use crate::format::caveat::Caveat;
use crate::format::diagnosis::{Diagnosis, Mode};
use crate::input::record::LogRecord;
use deadtime_model::simulate::System;
use deadtime_signal::stats;

/// The levels are apart by so many times what output and model move together. A constant offset of a sensor or of an input is seldom as large as what it is to measure.
const APART: f64 = 3.0;
/// An error of the spread itself: that of the best constant.
const CONSTANT: f64 = 1.0;
/// The reported effects correct the model where they halve the error.
const MENDED: f64 = 0.5;

/// All that has to be said. `predicted`: by the model as it came, from its own start or with what is a log's own; a predictor follows every level.
pub(crate) fn nominal_caveats(
    system: &System,
    records: &[LogRecord],
    predicted: &[DMatrix<f64>],
    diagnosis: &Diagnosis,
) -> Vec<Caveat> {
    if diagnosis.prediction.mode != Mode::Simulation {
        return Vec::new();
    }
    other_operating_point(system, records, predicted)
        .or_else(|| poor_model(diagnosis))
        .into_iter()
        .collect()
}

fn other_operating_point(
    system: &System,
    records: &[LogRecord],
    predicted: &[DMatrix<f64>],
) -> Option<Caveat> {
    let level = |i: usize| {
        let pairs = records.iter().zip(predicted).flat_map(|(r, model)| {
            (0..model.nrows())
                .filter_map(move |k| r.measured_in(r.train, i, k).map(|y| (y, model[(k, i)])))
        });
        let (measured, modelled): (Vec<f64>, Vec<f64>) = pairs.unzip();
        let (y, m) =
            (stats::mean(measured.iter().copied())?, stats::mean(modelled.iter().copied())?);
        let moves = stats::deviation(&measured)? + stats::deviation(&modelled)?;
        let name = &system.outputs.get(i)?.name;
        let text = || {
            format!(
                "`{name}` is {y:.4} on average where the model gives {m:.4}, and both move by {moves:.3} about that"
            )
        };
        (moves > 0.0 && (y - m).abs() > APART * moves).then(text)
    };
    let levels: Vec<String> = (0..system.outputs.len()).filter_map(level).collect();
    (!levels.is_empty()).then(|| Caveat::OtherOperatingPoint { levels: levels.join("; ") })
}

/// The worst output that a constant would be nearer to, on held-out data.
fn poor_model(diagnosis: &Diagnosis) -> Option<Caveat> {
    let errors =
        diagnosis.shrink.outputs.iter().filter_map(|o| Some((o.name.clone(), o.before?, o.after?)));
    let poor = errors.filter(|(_, before, after)| *before > CONSTANT && *after > MENDED * before);
    let (output, before, after) = poor.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let [percent, left] = [before, after].map(|share| format!("{:.0}", 100.0 * share));
    Some(Caveat::PoorModel { output, percent, left })
}

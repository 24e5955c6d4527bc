//! Caveats on the nominal model, reported before any cause: its operating point differs from that of the logs, or a constant predicts as well.
//!
//! How it can be wrong: an output that moves little about a missed offset has the same signature where the offset alone is wrong. The caveat reports the
//! offset, which is true. A delay or a wrong sign can make a good model worse than a constant. No caveat is given where the reported effects halve the error.

use nalgebra::DMatrix;

use crate::checks::operating_point::apart;
use crate::format::caveat::Caveat;
use crate::format::diagnosis::{Diagnosis, Mode};
use crate::input::record::LogRecord;
use deadtime_model::simulate::System;

/// An error of the spread itself: that of the best constant.
const CONSTANT: f64 = 1.0;
/// The reported effects correct the model where they halve the error.
const MENDED: f64 = 0.5;

/// All caveats on the nominal model. `predicted`: by the nominal model, from its own initial state or with the log's own nuisances; a predictor follows every
/// offset.
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
    let levels: Vec<String> =
        apart(system, records, predicted).iter().map(|levels| levels.words(system)).collect();
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

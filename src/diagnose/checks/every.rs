//! All checks, in the order in which they are reported.

use super::evidence::Evidence;
use super::faults::Search;
use super::view::View;
use super::{axes, clipped, clock_offset, clock_skew, excitation, kinematics, one_sample_shift, sign, stuck, timing, unit};
use crate::diagnose::baseline::predictor::Predictor;
use crate::diagnose::format::diagnosis::Check;
use crate::diagnose::input::record::LogRecord;
use crate::effect::Applied;
use crate::simulate::System;

type Checker = fn(&Evidence<'_>) -> Vec<Check>;

/// The checks, in the order in which they are reported.
const CHECKS: [Checker; 9] = [
    sign::check,
    axes::check,
    unit::check,
    one_sample_shift::check,
    clock_offset::check,
    clock_skew::check,
    stuck::check,
    clipped::check,
    excitation::check,
];

/// What all checks found.
#[derive(Default)]
pub(in crate::diagnose) struct Checked {
    pub(in crate::diagnose) checks: Vec<Check>,
    /// Signs and units that are wrong, each as an effect that does the same.
    pub(in crate::diagnose) remedies: Vec<Applied>,
}

/// All checks on the training logs. `predictor`: as it is chosen from the simulator, whatever a diagnosis is asked for.
pub(in crate::diagnose) fn checks(system: &System, model_effects: &[Applied], records: &[LogRecord], predictor: Predictor) -> Checked {
    let view = View::new(system, model_effects, records, predictor);
    if view.records.is_empty() {
        return Checked::default();
    }
    let search = Search::run(&view);
    let kinematics = kinematics::measure(&view);
    let timing = search.as_ref().map_or_else(|| vec![None; view.outputs()], |s| timing::measure(&view, s));
    let remedies = search.iter().flat_map(|s| &s.faults).filter_map(|f| f.fault.as_effect(system)).collect();
    let evidence = Evidence { view, search, kinematics, timing };
    Checked { checks: CHECKS.iter().flat_map(|check| check(&evidence)).collect(), remedies }
}

//! All checks, in the order in which they are reported.

use super::evidence::Evidence;
use super::faults::Search;
use super::view::View;
use super::{
    axes, clipped, clock_offset, clock_skew, excitation, kinematics, one_sample_shift, pairs, sign,
    stuck, timing, unit,
};
use crate::baseline::predictor::Predictor;
use crate::format::diagnosis::Check;
use crate::input::record::LogRecord;
use deadtime_model::effect::Applied;
use deadtime_model::simulate::System;
use deadtime_signal::progress::HowFar;

type Checker = fn(&Evidence<'_>) -> Vec<Check>;

/// The part of the work that the search for wrong signs, units and channels is.
const SEARCH: f64 = 0.5;

/// The checks, in the order in which they are reported.
const CHECKS: [Checker; 10] = [
    sign::check,
    axes::check,
    unit::check,
    pairs::check,
    one_sample_shift::check,
    clock_offset::check,
    clock_skew::check,
    stuck::check,
    clipped::check,
    excitation::check,
];

/// The findings of all checks.
#[derive(Default)]
pub(crate) struct Checked {
    pub(crate) checks: Vec<Check>,
    /// Signs and units that are wrong, each as an effect that does the same.
    pub(crate) remedies: Vec<Applied>,
    /// The limits at which outputs stop, each as an effect with these values.
    pub(crate) limits: Vec<Applied>,
}

/// All checks on the training logs. `predictor`: as chosen from the simulator, for any prediction of the diagnosis.
pub(crate) fn checks(
    system: &System,
    model_effects: &[Applied],
    records: &[LogRecord],
    predictor: Predictor,
    far: &HowFar,
) -> Checked {
    let view = View::new(system, model_effects, records, predictor);
    if view.records.is_empty() {
        return Checked::default();
    }
    let search = Search::run(&view, &far.part(0.0, SEARCH));
    let steps = far.part(SEARCH, 1.0);
    let steps = steps.steps(CHECKS.len() + 2, "checks");
    let relations = kinematics::relations(&view);
    let kinematics = kinematics::measure(&view, &relations);
    steps.one_more();
    let timing =
        search.as_ref().map_or_else(|| vec![None; view.outputs()], |s| timing::measure(&view, s));
    steps.one_more();
    let remedies =
        search.iter().flat_map(|s| &s.faults).filter_map(|f| f.fault.as_effect(system)).collect();
    let evidence = Evidence { view, search, relations, kinematics, timing };
    let run = |check: &Checker| {
        let found = check(&evidence);
        steps.one_more();
        found
    };
    let checks = CHECKS.iter().flat_map(run).collect();
    Checked { checks, remedies, limits: clipped::as_effects(&evidence) }
}

//! The error of the resulting model in the unused later rows of long logs. A free run over the whole log is compared with the error in the used rows.

use std::ops::Range;

use crate::format::caveat::Caveat;
use crate::format::nuisance::NuisanceEstimate;
use crate::input::criteria::Criteria;
use crate::likelihood::errors::overall;
use deadtime_log::Log;
use deadtime_model::effect::OnLog;
use deadtime_model::simulate::Response;
use deadtime_model::{Channel, EffectEntry, ModelDocument};
use deadtime_signal::stats;

/// The error of the resulting model, with the log's own nuisances, in the unused later rows of every cut log. A model that cannot run over a log gets no entry.
pub(crate) fn later_rows(
    cut: &[(&Log, usize)],
    nominal: &ModelDocument,
    found: &ModelDocument,
    nuisances: &[NuisanceEstimate],
    criteria: &Criteria,
) -> Vec<Caveat> {
    let of = |(log, used): &(&Log, usize)| {
        let own: Vec<EffectEntry> = nuisances
            .iter()
            .filter(|n| n.log == log.source())
            .map(NuisanceEstimate::to_entry)
            .collect();
        let run = |model: &ModelDocument| {
            let mut model = model.clone();
            model.effects_mut().extend(own.iter().cloned());
            OnLog::new(&model, log).ok()?.response().ok()
        };
        let (as_it_came, with_found) = (run(nominal)?, run(found)?);
        let later = *used..log.len();
        let before = nrmse(nominal.outputs(), log, &as_it_came, later.clone())?;
        let after = nrmse(found.outputs(), log, &with_found, later)?;
        let within = nrmse(found.outputs(), log, &with_found, 0..*used)?;
        let holds = after <= criteria.above_floor * within;
        let [before, after, within] = [before, after, within].map(|v| format!("{v:.3}"));
        Some(Caveat::LaterRows { log: log.source().to_owned(), before, after, within, holds })
    };
    cut.iter().filter_map(of).collect()
}

/// The error of a run over some rows of a log, all outputs; `None` where none of them moves there.
fn nrmse(outputs: &[Channel], log: &Log, run: &Response, rows: Range<usize>) -> Option<f64> {
    let of = |(at, channel): (usize, &Channel)| {
        let measured = log.output(&channel.name).ok()?;
        let pairs = || rows.clone().filter_map(|k| Some((*run.y.get((k, at))?, measured.get(k)?)));
        let mean = stats::mean(pairs().map(|p| p.1))?;
        let spread = stats::mean(pairs().map(|p| (p.1 - mean).powi(2))).filter(|v| *v > 0.0)?;
        Some((stats::mean(pairs().map(|p| (p.1 - p.0).powi(2)))? / spread).sqrt())
    };
    overall(&outputs.iter().enumerate().map(of).collect::<Vec<_>>())
}

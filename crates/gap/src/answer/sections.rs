//! The sections of a diagnosis, from the judgement.

use nalgebra::DMatrix;

use super::by_mode::ByMode;
use super::cause::cause;
use super::classes::classes;
use super::contributions::{GapBudget, explained, share_classes};
use super::decoded::of_all_logs;
use super::diagnosed::Diagnosed;
use super::force_profile::ForceProfile;
use super::handed::{HandedOver, in_a_form_that_helps};
use super::improvement::improvement;
use super::location::{locate, output_shares};
use super::missing_force::describe;
use super::nominal::nominal_caveats;
use super::nuisances::{nuisance_caveats, nuisance_estimates};
use super::orders::order_caveats;
use super::traces::{command_traces, traces};
use super::trims::constant_caveats;
use super::unrelated::unrelated;
use crate::baseline::motion::Motion;
use crate::causes::conclusion::ActiveCauses;
use crate::error::Result;
use crate::format::caveat::Caveat;
use crate::format::class::CauseClass;
use crate::format::contributions::Description;
use crate::format::diagnosis::{
    Cause, Check, Diagnosis, DiagnosisFormat, Gap, GapOutput, Metric, NotTried,
};
use crate::format::error::not_finite;
use crate::format::next_experiment::NextExperiment;
use crate::input::inputs::{Inputs, Simulator};
use crate::input::log_caveats::log_caveats;
use crate::input::record::LogRecord;
use crate::input::subject::Subject;
use crate::judge::prior_sensitivity::PriorSensitivity;
use crate::judge::rule::GapVerdict;
use crate::judge::verdict::Judged;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::{residuals, residuals_or, simulated, trained};
use crate::search::catalogue_search::SearchResult;
use deadtime_log::Log;
use deadtime_model::effect::{Applied, Scales, row};
use deadtime_model::simulate::Dynamics;
use deadtime_signal::remedy::{Message, Remedy};

/// The inputs of the sections.
pub(crate) struct Answer<'a> {
    pub(crate) subject: Subject<'a>,
    pub(crate) simulator: &'a Simulator,
    pub(crate) inputs: &'a Inputs,
    pub(crate) likelihood: &'a Likelihood<'a>,
    pub(crate) found: &'a SearchResult,
    pub(crate) scales: &'a Scales,
    pub(crate) motion: &'a Motion,
    pub(crate) checks: Vec<Check>,
    pub(crate) left_out: Vec<NotTried>,
    pub(crate) composed: ActiveCauses,
    pub(crate) sensitivities: &'a [PriorSensitivity],
    pub(crate) seed: u64,
    /// Terms that describe the gap are requested, also where effects explain it.
    pub(crate) suggest: bool,
}

/// Residuals of the nominal model, with all that was found, and of the model that is written.
struct Runs {
    handed: HandedOver,
    before: Vec<DMatrix<f64>>,
    with_all: Vec<DMatrix<f64>>,
    after: Vec<DMatrix<f64>>,
    /// Residuals of runs by a user of the written model: before and after.
    written: [Vec<DMatrix<f64>>; 2],
}

impl Answer<'_> {
    /// Reads the held-out samples, once, and writes the report.
    ///
    /// # Errors
    /// [`GapError::Nominal`] where the nominal model cannot be simulated over a held-out log.
    pub(crate) fn sections(self, logs: &[Log]) -> Result<Diagnosed> {
        let (system, records) = (self.likelihood.system, self.inputs.held_out.records());
        let predictor = self.likelihood.predictor.on(system, records, &self.likelihood.criteria);
        let likelihood = self.likelihood.on(records, &predictor)?;
        let held_out = &self.inputs.held_out;
        let composed = of_all_logs(self.composed, &likelihood, held_out, self.scales);
        let report = Answer { likelihood: &likelihood, composed, ..self };
        report.written(logs).ok_or_else(|| not_finite(records))
    }

    /// `None` where the model cannot be simulated.
    fn written(self, logs: &[Log]) -> Option<Diagnosed> {
        let runs = self.runs()?;
        let likelihood = self.likelihood;
        let (diagnosis, next_experiment, missing_force) = self.diagnosis(&runs, logs);
        let caveats = self.all_caveats(&runs, &diagnosis);
        let effects: Vec<Applied> =
            self.composed.hypothesis.iter().flat_map(|e| e.effects.clone()).collect();
        let active = ActiveEffects::from(&runs.handed.effects);
        let active = Some(active).filter(|_| !effects.is_empty());
        let floor = &self.composed.judged.floor.floor;
        let handed_over = runs.handed.effects.clone();
        Some(Diagnosed {
            diagnosis,
            model: self.subject.with(handed_over.iter().map(Applied::to_entry), logs),
            effects,
            traces: traces(likelihood, &self.inputs.held_out, active, floor),
            commands: command_traces(likelihood),
            handed_over,
            next_experiment,
            missing_force,
            caveats,
            calls: None,
        })
    }

    fn runs(&self) -> Option<Runs> {
        let likelihood = self.likelihood;
        let hypothesis = self.composed.hypothesis.as_ref();
        let held = &self.inputs.held_out;
        let handed = in_a_form_that_helps(likelihood, held, hypothesis, self.scales);
        let active = ActiveEffects::from(&handed.effects);
        let before = residuals(likelihood, NO_EFFECT)?;
        let with_all = match hypothesis {
            Some(hypothesis) => residuals_or(likelihood, hypothesis, &before),
            None => before.clone(),
        };
        let after = residuals(likelihood, active)?;
        let written = [simulated(likelihood, NO_EFFECT)?, simulated(likelihood, active)?];
        Some(Runs { handed, before, with_all, after, written })
    }

    fn diagnosis(
        &self,
        runs: &Runs,
        logs: &[Log],
    ) -> (Diagnosis, Option<NextExperiment>, Option<ForceProfile>) {
        let (likelihood, composed) = (self.likelihood, &self.composed);
        let (system, records) = (likelihood.system, likelihood.records);
        let floor = &composed.judged.floor;
        let gap = gap(likelihood, &runs.before, &floor.floor);
        let shares: Vec<Option<f64>> = gap.outputs.iter().map(|o| o.share).collect();
        let (cause, next_experiment, missing_force) = self.cause(runs);
        let known = composed.hypothesis.as_ref().is_some_and(|e| e.lost.is_some());
        let decoded = known.then_some(runs.with_all.as_slice());
        let [run_before, run_after] = &runs.written;
        let written = [run_before.as_slice(), run_after.as_slice()];
        let by_mode = ByMode {
            likelihood,
            inputs: self.inputs,
            held: &self.inputs.held_out,
            written: &runs.handed.effects,
            floor: &floor.floor,
        };
        let diagnosis = Diagnosis {
            format: DiagnosisFormat::V3,
            model: self.subject.name().to_owned(),
            logs: logs.iter().map(|l| l.source().to_owned()).collect(),
            holdout: self.inputs.held_out.listed(),
            prediction: likelihood.predictor.reported(),
            gap,
            place: locate(system, records, &runs.before, floor, &shares, &likelihood.memory()),
            checks: self.checks.clone(),
            cause,
            shrink: improvement(
                likelihood,
                &self.inputs.held_out,
                written,
                decoded,
                &floor.floor,
                self.seed,
            ),
            errors: Some(by_mode.errors(written)),
            nuisances: nuisance_estimates(likelihood, composed.hypothesis.as_ref(), self.scales),
        };
        (diagnosis, next_experiment, missing_force)
    }

    /// The section `cause`, the proposed experiment, and the remainder as a force.
    fn cause(&self, runs: &Runs) -> (Cause, Option<NextExperiment>, Option<ForceProfile>) {
        let (likelihood, composed) = (self.likelihood, &self.composed);
        let budget = GapBudget {
            likelihood,
            held: &self.inputs.held_out,
            composed,
            before: &runs.before,
            // The found effects, not the written ones: held-out data decide on the written ones, and a latent sequence has its share with the decoded sequence.
            after: &runs.with_all,
            scales: self.scales,
            seed: self.seed,
        };
        let (mut contributions, recalibration, mut remainder) =
            budget.sections(composed.estimate.as_ref());
        let classes = classes(likelihood, composed, &mut contributions, &recalibration);
        let (mut cause, next_experiment) = self.verdict(classes);
        share_classes(&mut contributions, &cause.indistinguishable);
        let (description, missing_force) = self.described(runs).unzip();
        remainder.description = description;
        let nothing_acts = contributions.is_empty() && !recalibration.accepted;
        if composed.judged.verdict == GapVerdict::Unknown && nothing_acts {
            remainder.unrelated = unrelated(likelihood, &runs.before, &self.motion.smallest);
        }
        cause.not_tried.clone_from(&self.left_out);
        cause = Cause {
            explained: Some(explained(composed, remainder.share.learnt)),
            contributions,
            order: acting(&runs.handed.effects),
            recalibration: Some(recalibration),
            remainder: Some(remainder),
            ..cause
        };
        (cause, next_experiment, missing_force.flatten())
    }

    fn verdict(&self, classes: Vec<CauseClass>) -> (Cause, Option<NextExperiment>) {
        let after = |e: &_| {
            let residuals = trained(self.likelihood, e)?;
            overall(&Errors::trained(self.likelihood.records, &residuals).nrmse())
        };
        let composed = (&self.composed, classes);
        cause(self.likelihood, composed, self.found, self.scales, self.sensitivities, after)
    }

    /// The remainder as a missing force, with and without the handed-over effects. Effects that are not the causes distort the residual, so the force with the larger held-out R² is reported.
    fn described(&self, runs: &Runs) -> Option<(Description, Option<ForceProfile>)> {
        let explained = self.composed.judged.verdict == GapVerdict::Effects;
        if explained && !self.suggest {
            return None;
        }
        let (likelihood, effects) = (self.likelihood, &runs.handed.effects);
        let of_all = describe(likelihood, &self.inputs.held_out, &[], &runs.before, self.seed);
        let of_rest = (!explained && !effects.is_empty())
            .then(|| describe(likelihood, &self.inputs.held_out, effects, &runs.after, self.seed))
            .flatten();
        let best = of_rest.into_iter().chain(of_all).max_by(|a, b| a.learnt.total_cmp(&b.learnt));
        best.map(|force| (force.description, force.curve))
    }

    fn all_caveats(&self, runs: &Runs, diagnosis: &Diagnosis) -> Vec<Caveat> {
        let likelihood = self.likelihood;
        let (system, records) = (likelihood.system, likelihood.records);
        let mut caveats = match self.with_nuisances() {
            Some(predicted) => nominal_caveats(system, records, &predicted, diagnosis),
            None => nominal_caveats(system, records, &self.motion.predicted, diagnosis),
        };
        caveats.extend(self.caveats(&self.composed.judged));
        caveats.extend(nuisance_caveats(likelihood, &diagnosis.nuisances));
        caveats.extend(constant_caveats(
            likelihood,
            self.composed.hypothesis.as_ref(),
            self.scales,
            &self.motion.smallest,
        ));
        caveats.extend(order_caveats(&diagnosis.cause.effects));
        caveats.extend(runs.handed.caveat.clone());
        caveats
    }

    /// The prediction of the nominal model with the nuisances of every log; `None` without nuisances of the model file.
    fn with_nuisances(&self) -> Option<Vec<DMatrix<f64>>> {
        let likelihood = self.likelihood;
        let predicted = |(at, record): (usize, &LogRecord)| {
            likelihood.predict_from_posterior(at, NO_EFFECT, record.estimated_from()?)
        };
        likelihood.declared.first()?;
        likelihood.records.iter().enumerate().map(predicted).collect()
    }

    fn caveats(&self, judged: &Judged) -> Vec<Caveat> {
        let system = &self.simulator.system;
        let held_out = &self.inputs.held_out;
        let mut caveats = log_caveats(system, held_out.records(), held_out.spans());
        caveats.extend(self.inputs.probed.iter().flat_map(|p| p.caveats.clone()));
        let remedy = match system.dynamics {
            Dynamics::Equations(..) => Message::from(Remedy::FitParameters).and(" fits them"),
            Dynamics::Linear(_) | Dynamics::BlackBox(..) => {
                Message::from("written as equations, the model's numbers are fitted by ")
                    .and(Remedy::FitParameters)
            }
            Dynamics::Sampled(..) => {
                Message::from(Remedy::Identify).and(" fits a sampled model to the logs")
            }
        };
        let of_the_numbers = |effect: &String| Caveat::OfTheNumbers {
            effect: effect.clone(),
            remedy: remedy.clone(),
        };
        caveats.extend(judged.of_the_numbers.iter().map(of_the_numbers));
        let named = judged.found.as_ref().is_some_and(|found| !found.effects.is_empty());
        if let Some((output, times)) = judged.left_over.filter(|_| named) {
            let times = format!("{times:.1}");
            caveats.push(match system.is_black_box() {
                true => Caveat::Incomplete { times },
                false => Caveat::Rest { times, output: system.outputs[output].name.clone() },
            });
        }
        caveats
    }
}

/// Effects in the order in which they act.
fn acting(effects: &[Applied]) -> Vec<String> {
    let mut effects: Vec<&Applied> = effects.iter().collect();
    effects.sort_by_key(|a| row(a.effect));
    effects.into_iter().map(Applied::key).collect()
}

/// The section `gap`, from the residuals of the nominal model and every output's floor.
fn gap(likelihood: &Likelihood<'_>, before: &[DMatrix<f64>], floor: &[f64]) -> Gap {
    let nothing = Errors::trained(likelihood.records, before);
    let (each, each_floor) = (nothing.nrmse(), nothing.relative(floor));
    let shares = output_shares(&each, &each_floor);
    let names = likelihood.system.outputs.iter().map(|o| o.name.clone());
    let outputs = names
        .enumerate()
        .map(|(i, name)| GapOutput {
            name,
            before: each[i],
            floor: each_floor[i],
            share: shares[i],
        })
        .collect();
    Gap { metric: Metric::Nrmse, before: overall(&each), floor: overall(&each_floor), outputs }
}

//! The stages of a diagnosis in a row. Each takes what the ones before it found, as a type of its own.
//!
//! ```text
//! Simulator, Inputs ─► Baseline ─► Likelihood ─► SearchResult ─► Judgement ─► Diagnosed
//!   input/             baseline/   likelihood/   search/          judge/       answer/
//! ```

use std::path::Path;

use nalgebra::DMatrix;

use super::answer::isolability as isolability_of;
use super::error::Result;
use crate::answer::by_mode::ByMode;
use crate::answer::cause::cause;
use crate::answer::classes::classes;
use crate::answer::contributions::{GapBudget, explained, share_classes};
use crate::answer::force_profile::ForceProfile;
use crate::answer::handed::in_a_form_that_helps;
use crate::answer::held_out::HeldOut;
use crate::answer::improvement::improvement;
use crate::answer::isolability::{Isolability, Names};
use crate::answer::later_rows::later_rows;
use crate::answer::location::{locate, output_shares};
use crate::answer::missing_force::describe;
use crate::answer::nominal::nominal_caveats;
use crate::answer::nuisances::{nuisance_caveats, nuisance_estimates};
use crate::answer::traces::{CommandTrace, Trace, command_traces, traces};
use crate::answer::trims::constant_caveats;
use crate::baseline::motion::Motion;
use crate::baseline::predictor::Predictor;
use crate::baseline::runaway::must_not_explode;
use crate::causes::conclusion::{ActiveCauses, Conclusion};
use crate::checks::every::checks;
use crate::format::caveat::Caveat;
use crate::format::class::CauseClass;
use crate::format::contributions::Description;
use crate::format::diagnosis::{
    Cause, Check, Diagnosis, DiagnosisFormat, Gap, GapOutput, Metric, Mode, NotTried,
};
use crate::format::error::GapError;
use crate::format::next_experiment::NextExperiment;
use crate::format::progress::Stage;
use crate::input::first_part::Parts;
use crate::input::inputs::{Inputs, Simulator};
use crate::input::log_caveats::{log_caveats, whole_turns};
use crate::input::options::GapOptions;
use crate::input::record::LogRecord;
use crate::input::subject::Subject;
use crate::judge::prior_sensitivity::{PriorSensitivity, prior_sensitivities};
use crate::judge::rule::GapVerdict;
use crate::judge::verdict::{Judged, judge};
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::{Likelihood, Terms};
use crate::likelihood::residuals::{residuals, simulated, trained};
use crate::search::catalogue::{Catalogue, catalogue};
use crate::search::catalogue_search::{SearchResult, Searched, search};
use crate::search::longer::shift_beyond;
use crate::search::moving::{scanned, typical};
use deadtime_log::Log;
use deadtime_model::ModelDocument;
use deadtime_model::effect::{Applied, Scales, row};
use deadtime_model::simulate::Dynamics;
use deadtime_signal::progress::HowFar;
use deadtime_signal::remedy::{Message, Remedy, Words};

/// A diagnosis, and the model with the effects that it found.
#[derive(Debug, Clone)]
pub struct Diagnosed {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The model with what was found added to its effects, in the form that helps a simulation; `None` for a simulator without a model file.
    pub model: Option<ModelDocument>,
    /// What was found to act.
    pub effects: Vec<Applied>,
    /// The same in the form that the model carries: nothing that is random, nothing that makes held-out data worse.
    pub handed_over: Vec<Applied>,
    /// What was measured and predicted, by output and then by log.
    pub traces: Vec<Trace>,
    /// What was commanded, by log and then by input.
    pub commands: Vec<CommandTrace>,
    /// The experiment that `next_experiment` of the diagnosis is about.
    pub next_experiment: Option<NextExperiment>,
    /// What stays, as a force over what it goes with; `None` where nothing is told.
    pub missing_force: Option<ForceProfile>,
    /// What a reader has to know of the data.
    pub caveats: Vec<Caveat>,
    /// How often a simulator that can only be called was called; `None` for a model file.
    pub calls: Option<usize>,
}

impl Diagnosed {
    /// The diagnosis with its findings and caveats in the words of a face.
    #[must_use]
    pub fn worded(mut self, words: Words) -> Self {
        let checks = self.diagnosis.checks.iter_mut().map(|check| &mut check.finding);
        let remainder = &mut self.diagnosis.cause.remainder;
        let described = remainder.iter_mut().filter_map(|r| r.description.as_mut());
        checks.chain(described.map(|d| &mut d.sentence)).for_each(|text| text.word(words));
        self.caveats.iter_mut().for_each(|caveat| caveat.word(words));
        self
    }
}

/// As [`diagnose`], from files.
///
/// # Errors
/// As [`diagnose`], and of files that cannot be read.
pub fn diagnose_files(
    model: &Path,
    logs: &[impl AsRef<Path>],
    holdout: &[impl AsRef<Path>],
    options: &GapOptions,
) -> Result<Diagnosed> {
    let document = ModelDocument::read(model)?;
    let logs =
        logs.iter().map(|path| deadtime_log::read(path.as_ref())).collect::<Result<Vec<_>, _>>()?;
    let holdout = holdout
        .iter()
        .map(|path| deadtime_log::read(path.as_ref()))
        .collect::<Result<Vec<_>, _>>()?;
    diagnose(&document, &logs, &holdout, options, &|_| ())
}

/// Diagnoses the gap between a model and logs: every effect of the catalogue on every channel, alone and in pairs.
///
/// `progress` is told what is being done.
///
/// # Errors
/// [`GapError`] where model and logs do not fit, the errors of models and logs, [`super::error::Error::Stopped`].
pub fn diagnose<'a>(
    subject: impl Into<Subject<'a>>,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    let begin = || {
        let subject = subject.into();
        let (logs, holdout) = (subject.completed(logs)?, subject.completed(holdout)?);
        let parts = Parts::of(&logs, &holdout, options.rows)?;
        let simulator = Simulator::of(subject, &parts.logs, &options.stop)?;
        let mut found =
            in_stages(subject, &simulator, &parts.logs, &parts.holdout, options, progress)?;
        let later = match (subject, &found.model, found.diagnosis.prediction.mode) {
            (Subject::Model(nominal), Some(model), Mode::Simulation) => later_rows(
                &parts.cut,
                nominal,
                model,
                &found.diagnosis.nuisances,
                &options.criteria,
            ),
            _ => Vec::new(),
        };
        found.caveats.splice(
            0..0,
            whole_turns(subject, &parts.logs).into_iter().chain(parts.caveats).chain(later),
        );
        if let Some(memory) = &simulator.memory {
            let calls = memory.calls();
            if let (failed, Some(why)) = memory.failures() {
                found.caveats.push(Caveat::SimulatorFailed { failed, calls, why });
            }
            found.calls = Some(calls);
        }
        Ok(found)
    };
    let found = begin();
    options.stop.check()?;
    found
}

/// Which effects of the catalogue these logs can tell apart; nothing is fitted, and what the logs measured matters only for the size of the noise.
///
/// # Errors
/// As [`diagnose`].
pub fn isolability<'a>(
    subject: impl Into<Subject<'a>>,
    logs: &[Log],
    options: &GapOptions,
    far: &HowFar,
) -> Result<Isolability> {
    let subject = subject.into();
    let begin = || {
        far.at(0.0, &Stage::Simulating);
        let logs = subject.completed(logs)?;
        let Parts { logs, .. } = Parts::of(&logs, &[], options.rows)?;
        let simulator = Simulator::of(subject, &logs, &options.stop)?;
        let mut inputs = Inputs::new(subject, &simulator, &logs, &[], options)?;
        inputs.learn_from_all(&simulator.system);
        let baseline = Baseline::of(&simulator, &inputs, options)?;
        let likelihood = baseline.likelihood(&simulator, &inputs, options)?;
        let before =
            residuals(&likelihood, NO_EFFECT).ok_or_else(|| not_finite(&inputs.records))?;
        let mut scales = baseline.motion.scales(
            &simulator.system,
            &inputs.records,
            &before,
            inputs.longest_delay_s,
        );
        let candidates =
            catalogue(&simulator.system, &inputs.nuisances, inputs.probed.as_ref(), &scales)
                .candidates;
        scales.scanned = typical(&simulator.system, &candidates, &scales);
        let names = Names {
            model: subject.name(),
            logs: logs.iter().map(|l| l.source().to_owned()).collect(),
        };
        isolability_of::isolability(
            &likelihood,
            candidates,
            &scales,
            &baseline.noise_std,
            names,
            far,
        )
        .ok_or_else(|| not_finite(&inputs.records))
    };
    let found = begin();
    options.stop.check()?;
    found
}

/// The model as it is on the logs.
struct Baseline {
    predictor: Predictor,
    motion: Motion,
    /// A first size of every output's noise.
    noise_std: Vec<f64>,
}

impl Baseline {
    fn of(simulator: &Simulator, inputs: &Inputs, options: &GapOptions) -> Result<Self> {
        let (system, probed) = (&simulator.system, inputs.probed.as_ref());
        let predictor = match inputs.horizon {
            Some(horizon) => Predictor::over(
                horizon,
                system,
                &inputs.model_effects,
                &inputs.records,
                &inputs.poles,
                &options.criteria,
            )?,
            None => Predictor::of(
                system,
                &inputs.records,
                &inputs.poles,
                probed,
                options.prediction,
                &options.criteria,
            ),
        };
        let motion =
            Motion::of(system, &inputs.model_effects, &inputs.records, &predictor, probed)?;
        let noise_std = motion.innovations(&inputs.records, &options.criteria);
        Ok(Self { predictor, motion, noise_std })
    }

    /// The likelihood of the logs under white noise of the first size.
    fn likelihood<'a>(
        &'a self,
        simulator: &'a Simulator,
        inputs: &'a Inputs,
        options: &GapOptions,
    ) -> Result<Likelihood<'a>> {
        let system = &simulator.system;
        Likelihood::new(Terms {
            system,
            records: &inputs.records,
            predictor: &self.predictor,
            model_effects: inputs.model_effects.clone(),
            nuisances: &inputs.nuisances,
            prior: self.motion.prior(system),
            noise_std: &self.noise_std,
            resolution: inputs.probed.as_ref().map(|p| p.resolution.clone()).unwrap_or_default(),
            criteria: options.criteria,
            stop: options.stop.clone(),
        })
    }
}

/// The verdict with all that it rests on.
struct Judgement {
    composed: ActiveCauses,
    sensitivities: Vec<PriorSensitivity>,
}

impl Judgement {
    /// `None` where the model cannot be simulated.
    fn of(
        likelihood: &Likelihood<'_>,
        found: &SearchResult,
        [candidates, remedies]: [&[Applied]; 2],
        scales: &Scales,
        smallest: &[f64],
        progress: &dyn Fn(Stage),
    ) -> Option<Self> {
        let judged = judge(likelihood, found, candidates, scales)?;
        let conclusion =
            Conclusion { likelihood, catalogue: candidates, found, remedies, scales, smallest };
        let composed = conclusion.from(judged, progress)?;
        let judged = &composed.judged;
        let searched = judged.found.as_ref().is_none_or(|e| e.effects.len() < 3);
        let sensitivities = match judged.verdict {
            GapVerdict::None | GapVerdict::Effects if searched => {
                prior_sensitivities(likelihood, found, judged.found.as_ref(), candidates, scales)
            }
            _ => Vec::new(),
        };
        Some(Self { composed, sensitivities })
    }
}

fn in_stages(
    subject: Subject<'_>,
    simulator: &Simulator,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    progress(Stage::Simulating);
    let system = &simulator.system;
    let inputs = Inputs::new(subject, simulator, logs, holdout, options)?;
    let baseline = Baseline::of(simulator, &inputs, options)?;
    let likelihood = baseline.likelihood(simulator, &inputs, options)?;
    let before = residuals(&likelihood, NO_EFFECT).ok_or_else(|| not_finite(&inputs.records))?;
    must_not_explode(system, &inputs.records, &before)?;
    let longer_s = f64::min(options.criteria.longer * inputs.longest_delay_s, 0.5 * inputs.limit_s);
    let may_be_longer = options.longest_delay_s.is_none()
        && longer_s > options.criteria.longer_at_least * inputs.longest_delay_s;
    let once_more = |longer_s: f64| {
        progress(Stage::Longer);
        let longer = GapOptions { longest_delay_s: Some(longer_s), ..options.clone() };
        in_stages(subject, simulator, logs, holdout, &longer, progress)
    };
    if may_be_longer && likelihood.predictor.mode == Mode::Simulation {
        let (longest_s, limit_s) = (inputs.longest_delay_s, 0.5 * inputs.limit_s);
        if let Some(shift_s) =
            shift_beyond(&inputs.records, &before, longest_s, limit_s, &options.criteria)
        {
            return once_more(f64::min(
                f64::max(longer_s, options.criteria.longer_than_moved * shift_s),
                limit_s,
            ));
        }
    }
    let mut scales =
        baseline.motion.scales(system, &inputs.records, &before, inputs.longest_delay_s);

    let chosen = Predictor::of(
        system,
        &inputs.records,
        &inputs.poles,
        inputs.probed.as_ref(),
        None,
        &options.criteria,
    );
    let checked =
        checks(system, &inputs.model_effects, &inputs.records, chosen, &HowFar::default());
    let Catalogue { candidates, left_out } =
        catalogue(system, &inputs.nuisances, inputs.probed.as_ref(), &scales);
    scales.scanned = scanned(&likelihood, &candidates, &scales);
    let Searched { likelihood, found } = search(
        likelihood,
        candidates.clone(),
        &checked.remedies,
        &scales,
        &baseline.motion.smallest,
        progress,
    )
    .ok_or_else(|| not_finite(&inputs.records))?;
    if may_be_longer && found.wants_longer_delays(&likelihood, &scales, &options.criteria) {
        return once_more(longer_s);
    }

    progress(Stage::Judging);
    let smallest = &baseline.motion.smallest;
    let tried = [candidates.as_slice(), checked.remedies.as_slice()];
    let judgement = Judgement::of(&likelihood, &found, tried, &scales, smallest, progress)
        .ok_or_else(|| not_finite(&inputs.records))?;
    progress(Stage::Describing);
    let answer = Answer {
        subject,
        simulator,
        inputs: &inputs,
        likelihood: &likelihood,
        found: &found,
        scales: &scales,
        motion: &baseline.motion,
        checks: checked.checks,
        left_out,
    };
    answer.sections(judgement, logs, options.seed).ok_or_else(|| not_finite(&inputs.records))
}

/// What the sections of a diagnosis are made of, beside the judgement.
struct Answer<'a> {
    subject: Subject<'a>,
    simulator: &'a Simulator,
    inputs: &'a Inputs,
    likelihood: &'a Likelihood<'a>,
    found: &'a SearchResult,
    scales: &'a Scales,
    motion: &'a Motion,
    checks: Vec<Check>,
    left_out: Vec<NotTried>,
}

impl Answer<'_> {
    /// `None` where the model cannot be simulated.
    fn sections(self, judgement: Judgement, logs: &[Log], seed: u64) -> Option<Diagnosed> {
        let (system, records, likelihood) =
            (&self.simulator.system, &self.inputs.records, self.likelihood);
        let composed = &judgement.composed;
        let held = &HeldOut::new(self.inputs.held.clone());
        let handed =
            in_a_form_that_helps(likelihood, held, composed.hypothesis.as_ref(), self.scales);
        let active = ActiveEffects::from(&handed.effects);
        let before = residuals(likelihood, NO_EFFECT)?;
        let after = residuals(likelihood, active)?;
        let (run_before, run_after) =
            (simulated(likelihood, NO_EFFECT)?, simulated(likelihood, active)?);
        let with_all = match &composed.hypothesis {
            Some(hypothesis) => residuals(likelihood, hypothesis)?,
            None => before.clone(),
        };
        let is_decoded = composed.hypothesis.as_ref().is_some_and(|e| e.lost.is_some());
        let decoded = is_decoded.then_some(with_all.as_slice());
        let floor = &composed.judged.floor;
        let gap = gap(likelihood, &before, &floor.floor);
        let shares: Vec<Option<f64>> = gap.outputs.iter().map(|o| o.share).collect();
        let predictor = likelihood.predictor;
        let budget = GapBudget {
            likelihood,
            held,
            composed,
            before: &before,
            // What was found, and not what is written: held-out data decide on that, and a hidden sequence takes its share once it is known.
            after: &with_all,
            scales: self.scales,
            seed,
        };
        let (mut contributions, recalibration, mut remainder) =
            budget.sections(composed.estimate.as_ref());
        let classes = classes(likelihood, composed, &mut contributions, &recalibration, &remainder);
        let (cause, next_experiment) = self.cause(&judgement, classes);
        share_classes(&mut contributions, &cause.indistinguishable);
        let mut missing_force = None;
        if composed.judged.verdict != GapVerdict::Effects {
            // Effects that are none of the causes bend what they leave: the force that predicts more of what it is fitted to is reported.
            let of_all = describe(likelihood, held, &[], &before, seed);
            let of_rest = (!handed.effects.is_empty())
                .then(|| describe(likelihood, held, &handed.effects, &after, seed))
                .flatten();
            let r2 = |found: &(Description, _)| found.0.held_out_r2;
            let more = of_rest.into_iter().chain(of_all).max_by(|a, b| r2(a).total_cmp(&r2(b)));
            (remainder.description, missing_force) = more.unzip();
        }
        let by_mode = ByMode {
            likelihood,
            inputs: self.inputs,
            held,
            written: &handed.effects,
            floor: &floor.floor,
        };
        let diagnosis = Diagnosis {
            format: DiagnosisFormat::V3,
            model: self.subject.name().to_owned(),
            logs: logs.iter().map(|l| l.source().to_owned()).collect(),
            holdout: held.listed(records),
            prediction: predictor.told(),
            gap,
            place: locate(system, records, &before, floor, &shares, &likelihood.memory()),
            checks: self.checks.clone(),
            cause: Cause {
                explained: Some(explained(composed, remainder.share.learnt)),
                contributions,
                order: acting(&handed.effects),
                recalibration: Some(recalibration),
                remainder: Some(remainder),
                ..cause
            },
            shrink: improvement(
                likelihood,
                held,
                [&run_before, &run_after],
                decoded,
                &floor.floor,
                seed,
            ),
            errors: Some(by_mode.errors([&run_before, &run_after])),
            nuisances: nuisance_estimates(likelihood, composed.hypothesis.as_ref(), self.scales),
        };
        let effects: Vec<Applied> =
            composed.hypothesis.iter().flat_map(|e| e.effects.clone()).collect();
        let traces =
            traces(likelihood, held, Some(active).filter(|_| !effects.is_empty()), &floor.floor);
        let mut caveats = match self.with_nuisances() {
            Some(predicted) => nominal_caveats(system, records, &predicted, &diagnosis),
            None => nominal_caveats(system, records, &self.motion.predicted, &diagnosis),
        };
        caveats.extend(self.caveats(&composed.judged));
        caveats.extend(nuisance_caveats(likelihood, &diagnosis.nuisances));
        caveats.extend(constant_caveats(
            likelihood,
            composed.hypothesis.as_ref(),
            self.scales,
            &self.motion.smallest,
        ));
        caveats.extend(handed.caveat);
        let model = self.subject.with(handed.effects.iter().map(Applied::to_entry), logs);
        let commands = command_traces(likelihood);
        Some(Diagnosed {
            diagnosis,
            model,
            effects,
            handed_over: handed.effects,
            traces,
            commands,
            next_experiment,
            missing_force: missing_force.flatten(),
            caveats,
            calls: None,
        })
    }

    /// What the model as it came predicts with what every log has of its own; `None` without nuisances of the model file.
    fn with_nuisances(&self) -> Option<Vec<DMatrix<f64>>> {
        let likelihood = self.likelihood;
        let predicted = |(at, record): (usize, &LogRecord)| {
            likelihood.predict_from_posterior(at, NO_EFFECT, record.estimated_from()?)
        };
        likelihood.declared.first()?;
        likelihood.records.iter().enumerate().map(predicted).collect()
    }

    fn cause(
        &self,
        judgement: &Judgement,
        classes: Vec<CauseClass>,
    ) -> (Cause, Option<NextExperiment>) {
        let after = |e: &_| {
            let residuals = trained(self.likelihood, e)?;
            overall(&Errors::trained(self.likelihood.records, &residuals).nrmse())
        };
        let Judgement { composed, sensitivities } = judgement;
        let (mut cause, next) = cause(
            self.likelihood,
            (composed, classes),
            self.found,
            self.scales,
            sensitivities,
            after,
        );
        cause.not_tried.clone_from(&self.left_out);
        (cause, next)
    }

    fn caveats(&self, judged: &Judged) -> Vec<Caveat> {
        let system = &self.simulator.system;
        let mut caveats = log_caveats(system, &self.inputs.records, &self.inputs.held);
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

/// The section `gap`, from the residuals of the model as it came and every output's floor.
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

fn not_finite(records: &[LogRecord]) -> super::error::Error {
    let log = records.first().map(|r| r.name.clone()).unwrap_or_default();
    GapError::Nominal { log, why: "its predictions are not finite".to_owned() }.into()
}

//! The stages of a diagnosis in a row. Each takes the result of the ones before it, as a type of its own.
//!
//! ```text
//! Simulator, Inputs ─► Baseline ─► Likelihood ─► SearchResult ─► Judgement ─► Diagnosed
//!   input/             baseline/   likelihood/   search/          judge/       answer/
//! ```

use std::path::Path;

use nalgebra::DMatrix;

use super::answer::isolability as isolability_of;
use super::error::Result;
use crate::answer::diagnosed::Diagnosed;
use crate::answer::isolability::{Isolability, Names};
use crate::answer::later_rows::later_rows;
use crate::answer::sections::Answer;
use crate::baseline::motion::Motion;
use crate::baseline::predictor::Predictor;
use crate::baseline::runaway::must_not_explode;
use crate::causes::conclusion::{ActiveCauses, Conclusion};
use crate::checks::every::{Checked, checks};
use crate::format::caveat::Caveat;
use crate::format::diagnosis::Mode;
use crate::format::error::not_finite;
use crate::format::progress::Stage;
use crate::input::cost::must_end_in_time;
use crate::input::first_part::Parts;
use crate::input::inputs::{Inputs, Simulator};
use crate::input::log_caveats::whole_turns;
use crate::input::options::GapOptions;
use crate::input::subject::Subject;
use crate::judge::prior_sensitivity::{PriorSensitivity, prior_sensitivities};
use crate::judge::rule::GapVerdict;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::{Likelihood, Terms};
use crate::likelihood::residuals::residuals;
use crate::search::catalogue::{Catalogue, catalogue};
use crate::search::catalogue_search::{SearchResult, Searched, search};
use crate::search::longer::shift_beyond;
use crate::search::moving::{scanned, typical};
use deadtime_log::Log;
use deadtime_model::effect::{Applied, Scales};
use deadtime_model::simulate::System;
use deadtime_model::{CandidateEntry, ModelDocument};
use deadtime_signal::progress::HowFar;

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
/// `progress` receives each stage as it begins. With [`GapOptions::suggest`] the terms that describe what remains are candidates of a second diagnosis, which is the answer.
///
/// # Errors
/// [`GapError`](crate::format::error::GapError) where model and logs do not fit, the errors of models and logs, [`super::error::Error::Stopped`].
pub fn diagnose<'a>(
    subject: impl Into<Subject<'a>>,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    let subject = subject.into();
    let found = diagnosed_once(subject, logs, holdout, options, progress)?;
    let (true, Subject::Model(document)) = (options.suggest, subject) else { return Ok(found) };
    let remainder = found.diagnosis.cause.remainder.as_ref();
    let Some(described) = remainder.and_then(|r| r.description.as_ref()) else {
        return Ok(found);
    };
    let (mut document, mut terms) = (document.clone(), Vec::new());
    for term in &described.suggested {
        let mut with_it = document.clone();
        // One that the model has already is refused.
        if with_it.suspect(CandidateEntry::from_text(term)?).is_ok() {
            document = with_it;
            terms.push(term.clone());
        }
    }
    let tried = GapOptions { suggest: false, ..options.clone() };
    let mut found = diagnosed_once((&document).into(), logs, holdout, &tried, progress)?;
    found.caveats.insert(0, Caveat::Suggested { terms });
    Ok(found)
}

/// One diagnosis.
fn diagnosed_once(
    subject: Subject<'_>,
    logs: &[Log],
    holdout: &[Log],
    options: &GapOptions,
    progress: &dyn Fn(Stage),
) -> Result<Diagnosed> {
    let begin = || {
        let (logs, holdout) = (subject.completed(logs)?, subject.completed(holdout)?);
        let parts = Parts::of(&logs, &holdout, options.rows)?;
        let simulator = Simulator::of(subject, &parts.logs, &options.stop)?;
        let rows = parts.logs.iter().map(Log::len).sum();
        must_end_in_time(&simulator.system, rows, options)?;
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

/// The effects of the catalogue that these logs make distinguishable. Nothing is fitted, and the measured outputs only give the noise standard deviation.
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
        let inputs = Inputs::of_whole_logs(subject, &simulator, &logs, options)?;
        let baseline = Baseline::of(&simulator, &inputs, options)?;
        let likelihood = baseline.likelihood(&simulator, &inputs, options)?;
        let before =
            residuals(&likelihood, NO_EFFECT).ok_or_else(|| not_finite(&inputs.training))?;
        let mut scales = baseline.motion.scales(
            &simulator.system,
            &inputs.training,
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
        .ok_or_else(|| not_finite(&inputs.training))
    };
    let found = begin();
    options.stop.check()?;
    found
}

/// The nominal model on the logs.
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
                &inputs.training,
                &inputs.poles,
                &options.criteria,
            )?,
            None => Predictor::of(
                system,
                &inputs.training,
                &inputs.poles,
                probed,
                options.prediction,
                &options.criteria,
            ),
        };
        let motion =
            Motion::of(system, &inputs.model_effects, &inputs.training, &predictor, probed)?;
        let noise_std = motion.innovations(&inputs.training, &options.criteria);
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
            records: &inputs.training,
            predictor: &self.predictor,
            model_effects: inputs.model_effects.clone(),
            nuisances: &inputs.nuisances,
            prior: self.motion.prior(system),
            noise_std: self.noise_std.clone(),
            resolution: inputs.probed.as_ref().map(|p| p.resolution.clone()).unwrap_or_default(),
            criteria: options.criteria,
            stop: options.stop.clone(),
        })
    }
}

/// The verdict with all its inputs.
struct Judgement {
    composed: ActiveCauses,
    sensitivities: Vec<PriorSensitivity>,
}

impl Judgement {
    /// `None` where the model cannot be simulated.
    fn of(
        likelihood: &Likelihood<'_>,
        found: &SearchResult,
        [candidates, remedies, limits]: [&[Applied]; 3],
        scales: &Scales,
        smallest: &[f64],
        progress: &dyn Fn(Stage),
    ) -> Option<Self> {
        let conclusion = Conclusion {
            likelihood,
            catalogue: candidates,
            found,
            remedies,
            limits,
            scales,
            smallest,
        };
        let composed = conclusion.from(progress)?;
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

/// The longest delay of a repeated search; `None` where the option fixes the delay, or the logs allow none that is much longer.
fn longer_delay_s(inputs: &Inputs, options: &GapOptions) -> Option<f64> {
    let longer_s = f64::min(options.criteria.longer * inputs.longest_delay_s, 0.5 * inputs.limit_s);
    let may_be_longer = options.longest_delay_s.is_none()
        && longer_s > options.criteria.longer_at_least * inputs.longest_delay_s;
    may_be_longer.then_some(longer_s)
}

/// The longest delay that includes the shift of the outputs, where the shift exceeds the present longest delay.
fn longer_than_shift_s(
    inputs: &Inputs,
    before: &[DMatrix<f64>],
    longer_s: f64,
    options: &GapOptions,
) -> Option<f64> {
    let (longest_s, limit_s) = (inputs.longest_delay_s, 0.5 * inputs.limit_s);
    let shift_s = shift_beyond(&inputs.training, before, longest_s, limit_s, &options.criteria)?;
    Some(f64::min(f64::max(longer_s, options.criteria.longer_than_moved * shift_s), limit_s))
}

/// All checks on the training logs, for any prediction of the diagnosis.
fn checked(system: &System, inputs: &Inputs, options: &GapOptions) -> Checked {
    let predictor = Predictor::of(
        system,
        &inputs.training,
        &inputs.poles,
        inputs.probed.as_ref(),
        None,
        &options.criteria,
    );
    checks(system, &inputs.model_effects, &inputs.training, predictor, &HowFar::default())
}

/// The catalogue, restricted to the effects of the options where they name any.
fn tried(system: &System, inputs: &Inputs, scales: &Scales, options: &GapOptions) -> Catalogue {
    let mut tried = catalogue(system, &inputs.nuisances, inputs.probed.as_ref(), scales);
    if !options.effects.is_empty() {
        tried.candidates.retain(|c| options.effects.iter().any(|name| name == c.effect.name()));
    }
    tried
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
    let before = residuals(&likelihood, NO_EFFECT).ok_or_else(|| not_finite(&inputs.training))?;
    must_not_explode(system, &inputs.training, &before)?;
    let longer_s = longer_delay_s(&inputs, options);
    let once_more = |longer_s: f64| {
        progress(Stage::Longer);
        let longer = GapOptions { longest_delay_s: Some(longer_s), ..options.clone() };
        in_stages(subject, simulator, logs, holdout, &longer, progress)
    };
    let simulated = likelihood.predictor.mode == Mode::Simulation;
    if let Some(longer_s) = longer_s.filter(|_| simulated)
        && let Some(shifted_s) = longer_than_shift_s(&inputs, &before, longer_s, options)
    {
        return once_more(shifted_s);
    }
    let mut scales =
        baseline.motion.scales(system, &inputs.training, &before, inputs.longest_delay_s);

    let checked = checked(system, &inputs, options);
    let Catalogue { candidates, left_out } = tried(system, &inputs, &scales, options);
    progress(Stage::Scanning);
    scales.scanned = scanned(&likelihood, &candidates, &scales);
    let smallest = &baseline.motion.smallest;
    let Searched { likelihood, found } =
        search(likelihood, candidates.clone(), &checked.remedies, &scales, smallest, progress)
            .ok_or_else(|| not_finite(&inputs.training))?;
    if let Some(longer_s) = longer_s
        && found.wants_longer_delays(&likelihood, &scales, &options.criteria)
    {
        return once_more(longer_s);
    }

    progress(Stage::Judging);
    let tried = [&candidates, &checked.remedies, &checked.limits].map(Vec::as_slice);
    let judgement = Judgement::of(&likelihood, &found, tried, &scales, smallest, progress)
        .ok_or_else(|| not_finite(&inputs.training))?;
    progress(Stage::Describing);
    let final_noise = judgement.composed.noise.clone().map(|noise| likelihood.with_noise(noise));
    let answer = Answer {
        subject,
        simulator,
        inputs: &inputs,
        likelihood: final_noise.as_ref().unwrap_or(&likelihood),
        found: &found,
        scales: &scales,
        motion: &baseline.motion,
        checks: checked.checks,
        left_out,
        composed: judgement.composed,
        sensitivities: &judgement.sensitivities,
        seed: options.seed,
        suggest: options.suggest,
    };
    answer.sections(logs)
}

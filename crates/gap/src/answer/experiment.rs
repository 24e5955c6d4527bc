//! The next experiment: what would separate hypotheses that this data cannot.
//!
//! A fixed set of experiments is simulated under both hypotheses. The experiment with the largest expected log-Bayes-factor is proposed.
//! The directions in which the alternative's own parameters can adapt are projected out (T-optimal discrimination; Atkinson and Fedorov 1975, doi:10.1093/biomet/62.1.57).
//!
//! How it can be wrong: the machine's limits are unknown, so an experiment may exceed them.
//! An unstable model cannot be simulated without its controller, and neither can a simulator that is restarted from the log.
//! Both get advice by the kinds of the competing hypotheses only.

use nalgebra::DVector;

use crate::format::diagnosis::Mode;
use crate::format::next_experiment::{Advice, NextExperiment, Proposal, SAMPLES, Signal};
use crate::judge::prior_sensitivity::PriorSensitivity;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance, Scales, Site, Telling};
use deadtime_model::simulate::Commands;
use deadtime_signal::parallel;

/// One experiment: its commands and where the state starts.
struct Trial {
    signal: Signal,
    inputs: Vec<Vec<f64>>,
    start: Vec<f64>,
    /// The start is set by the experiment; otherwise it is a nuisance here too.
    released: bool,
}

/// The experiments that are tried, from the size of the logged commands.
fn trials(likelihood: &Likelihood<'_>, scales: &Scales) -> Option<(Vec<f64>, Vec<Trial>)> {
    let record = likelihood.records.iter().find(|r| r.train.is_some())?;
    let count = record.time_s.len().min(SAMPLES);
    let time_s = record.time_s[..count].to_vec();
    let still = likelihood.system.initial.clone();
    let moved: Vec<f64> = still
        .iter()
        .enumerate()
        .map(|(j, x)| x + scales.states.get(j).map_or(0.0, |s| s.std))
        .collect();
    let std: Vec<f64> = scales.inputs.iter().map(|s| s.std).collect();
    let trial = |signal: Signal| {
        let start = if signal == Signal::Release { moved.clone() } else { still.clone() };
        let inputs = signal.commands(&record.inputs, &std, count);
        Trial { signal, inputs, released: start != still, start }
    };
    Some((time_s, Signal::TRIED.map(trial).into()))
}

/// The experiment that separates two hypotheses of a class of effects; `own` and `rival` are all active effects under each.
pub(crate) fn experiment(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    class: &[Applied],
    own: &[Applied],
    rival: &[Applied],
) -> NextExperiment {
    let ahead =
        likelihood.predictor.mode == Mode::Simulation && likelihood.system.restart.is_none();
    let simulated = ahead.then(|| trials(likelihood, scales)).flatten();
    let Some((time_s, trials)) = simulated else { return by_kind(class) };
    let expected = |trial: &Trial| {
        Some((apart(likelihood, scales, &time_s, trial, own, rival)?, trial.signal))
    };
    let best = parallel::filter_map(trials.iter(), expected)
        .into_iter()
        .max_by(|a, b| a.0.total_cmp(&b.0));
    // A simulator that can only replay its recorded runs.
    if best.is_none() && likelihood.system.is_black_box() {
        return by_kind(class);
    }
    let proposal = match best {
        Some((gain, signal)) if gain > likelihood.criteria.selection_penalty => {
            Proposal::Commands {
                signal,
                log_bayes_factor: 0.5 * gain,
                duration_s: time_s.last().copied().unwrap_or(0.0),
            }
        }
        _ => Proposal::NothingSeparates,
    };
    NextExperiment { separates: names(class), proposal }
}

/// Twice the expected log-Bayes-factor of one experiment: the squared distance of the two trajectories in units of the noise standard deviation.
/// The directions of the alternative's parameters, and of an unknown initial state, are projected out.
/// Samples within the longest delay have no weight, as in a log.
fn apart(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    time_s: &[f64],
    trial: &Trial,
    own: &[Applied],
    rival: &[Applied],
) -> Option<f64> {
    let noise = likelihood.noise_std();
    let from =
        if trial.released { 0 } else { time_s.partition_point(|t| *t < scales.longest_delay_s) };
    let simulate = |effects: &[Applied], start: &[f64]| -> Option<DVector<f64>> {
        let plan = likelihood.plan(effects, Chance::Mean)?;
        let commands = Commands { time_s, inputs: &trial.inputs };
        let run = likelihood.system.simulate(&plan, commands, start, None).ok()?;
        let scaled = run.y.column_iter().zip(&noise).flat_map(|(y, s)| {
            y.iter().skip(from).map(|v| v / s.max(f64::MIN_POSITIVE)).collect::<Vec<_>>()
        });
        Some(DVector::from_vec(scaled.collect()))
    };
    let there = simulate(rival, &trial.start)?;
    let mut left = simulate(own, &trial.start)? - &there;
    let mut directions: Vec<DVector<f64>> = Vec::new();
    let mut take_out = |mut column: DVector<f64>| {
        let whole = column.norm();
        for q in &directions {
            column -= q * q.dot(&column);
        }
        if column.norm() > 1e-9 * whole {
            directions.push(column.normalize());
        }
    };
    for j in (0..trial.start.len()).filter(|_| !trial.released) {
        let mut start = trial.start.clone();
        let step =
            likelihood.budget.ahead_push * scales.states.get(j).map_or(1.0, |s| s.std).max(1e-9);
        start[j] += step;
        take_out((simulate(rival, &start)? - &there) / step);
    }
    for e in 0..rival.len() {
        for i in (0..rival[e].values.len()).filter(|&i| rival[e].values[i].is_finite()) {
            let mut moved = rival.to_vec();
            let step = likelihood.budget.relative_step * moved[e].values[i].abs().max(1e-9);
            moved[e].values[i] += step;
            take_out((simulate(&moved, &trial.start)? - &there) / step);
        }
    }
    for q in &directions {
        left -= q * q.dot(&left);
    }
    Some(left.norm_squared()).filter(|d| d.is_finite())
}

fn names(class: &[Applied]) -> Vec<String> {
    class.iter().map(Applied::key).collect()
}

/// As [`experiment`], by the kinds of a class' members, where nothing can be simulated ahead.
pub(crate) fn by_kind(class: &[Applied]) -> NextExperiment {
    NextExperiment { separates: names(class), proposal: Proposal::Advice(advice(class)) }
}

fn advice(class: &[Applied]) -> Advice {
    let sites = |site: Site| class.iter().any(|c| c.effect.site() == site);
    let told_by =
        |telling| class.iter().filter(|c| c.effect.facts().told_by == Some(telling)).count() > 1;
    if told_by(Telling::Amplitude) {
        Advice::Amplitudes
    } else if told_by(Telling::OperatingPoint) {
        Advice::OperatingPoint
    } else if told_by(Telling::Bandwidth) && !sites(Site::Output) {
        Advice::Bandwidth
    } else if sites(Site::Output) || sites(Site::Clock) {
        Advice::OtherMotion
    } else {
        Advice::Multisine
    }
}

/// The experiment that separates a wrong initial state from an effect.
pub(crate) fn of_starts(sensitivities: &[PriorSensitivity]) -> NextExperiment {
    NextExperiment {
        separates: sensitivities.iter().map(|h| h.state.clone()).collect(),
        proposal: Proposal::KnownStart,
    }
}

//! The next experiment: what would separate hypotheses that this data cannot.
//!
//! Both hypotheses are simulated through a handful of experiments; the one with the largest expected log-Bayes-factor is proposed, what the rival's own
//! parameters could still make up for taken out (T-optimal discrimination; Atkinson and Fedorov 1975, doi:10.1093/biomet/62.1.57).
//!
//! How it can be wrong: the machine's limits are not known here, so an experiment may ask for more than it stands; an unstable model cannot be simulated
//! ahead without its controller, nor a simulator that the log starts again, and gets advice by the kinds of its rivals only.

use nalgebra::DVector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use crate::format::diagnosis::Mode;
use crate::judge::prior_sensitivity::PriorSensitivity;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance, Scales, Site, Telling};
use deadtime_model::simulate::Commands;
use deadtime_signal::stats;

/// Samples of an experiment that is simulated.
const SAMPLES: usize = 3000;

/// One experiment: its name, its commands and where the state starts.
struct Trial {
    words: &'static str,
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
    let spread: Vec<f64> = scales.inputs.iter().map(|s| s.std).collect();
    let trial = |(words, inputs, released): (&'static str, Vec<Vec<f64>>, bool)| {
        let start = if released { moved.clone() } else { still.clone() };
        Trial { words, inputs, released: start != still, start }
    };
    Some((time_s, commands(&record.inputs, &spread, count).into_iter().map(trial).collect()))
}

/// The commands of the experiments that are tried, `count` samples each: what it is called, a list per input, whether the state is to begin displaced.
fn commands(
    inputs: &[Vec<f64>],
    spread: &[f64],
    count: usize,
) -> Vec<(&'static str, Vec<Vec<f64>>, bool)> {
    let mean: Vec<f64> =
        inputs.iter().map(|u| u.iter().sum::<f64>() / u.len().max(1) as f64).collect();
    let each = |value: &mut dyn FnMut(usize, usize) -> f64| -> Vec<Vec<f64>> {
        (0..inputs.len()).map(|j| (0..count).map(|k| value(j, k)).collect()).collect()
    };
    let logged = |scale: f64, shift: f64| {
        each(&mut |j, k| mean[j] + scale * (inputs[j][k] - mean[j]) + shift * spread[j])
    };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let phase = |k: usize| (4 * k) as f64 / count as f64 % 1.0;
    vec![
        ("repeat the commands at twice the amplitude", logged(2.0, 0.0), false),
        ("repeat the commands at a third of the amplitude", logged(1.0 / 3.0, 0.0), false),
        ("repeat the commands about another operating point", logged(1.0, 2.0), false),
        (
            "excite with a signal that reverses at random at every sample",
            each(&mut |j, _| mean[j] + if rng.random::<bool>() { spread[j] } else { -spread[j] }),
            false,
        ),
        (
            "move slowly to and fro, with reversals through zero",
            each(&mut |j, k| mean[j] + 2.0 * spread[j] * (1.0 - 4.0 * (phase(k) - 0.5).abs())),
            false,
        ),
        (
            "command steps and hold them until everything has settled",
            each(&mut |j, k| mean[j] + if phase(k) < 0.5 { 1.5 } else { -1.5 } * spread[j]),
            false,
        ),
        ("record at rest, commands held", logged(0.0, 0.0), false),
        (
            "record motion that is not caused by the commands (a release from a displaced start, a push by hand), commands held",
            logged(0.0, 0.0),
            true,
        ),
    ]
}

/// The commands that a proposed experiment asks for, as long as the logged ones (one list per input, equally long): what is drawn of `next_experiment`. Amplitudes
/// are in standard deviations of the commands given. `None` where the proposal is no signal, but words.
#[must_use]
pub fn proposed(next_experiment: &str, logged: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let count = logged.iter().map(Vec::len).min()?.min(SAMPLES);
    let spread: Vec<f64> = logged.iter().map(|u| stats::deviation(u).unwrap_or(0.0)).collect();
    commands(logged, &spread, count)
        .into_iter()
        .find(|(words, ..)| next_experiment.contains(words))
        .map(|(_, inputs, _)| inputs)
}

/// What would tell two hypotheses apart, as a sentence about a class of effects; `own` and `rival` are all effects at work under each.
pub(crate) fn experiment(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    class: &[Applied],
    own: &[Applied],
    rival: &[Applied],
) -> String {
    let names = names(class);
    let ahead =
        likelihood.predictor.mode == Mode::Simulation && likelihood.system.restart.is_none();
    let simulated = ahead.then(|| trials(likelihood, scales)).flatten();
    let Some((time_s, trials)) = simulated else { return by_kind(class) };
    let expected =
        |trial: &Trial| Some((apart(likelihood, scales, &time_s, trial, own, rival)?, trial.words));
    let best = trials
        .par_iter()
        .filter_map(expected)
        .collect::<Vec<_>>()
        .into_iter()
        .max_by(|a, b| a.0.total_cmp(&b.0));
    // A simulator that only knows the runs it has recorded.
    if best.is_none() && likelihood.system.is_black_box() {
        return by_kind(class);
    }
    let duration_s = time_s.last().copied().unwrap_or(0.0);
    match best {
        Some((gain, words)) if gain > likelihood.criteria.selection_penalty => {
            format!(
                "To separate {names}: {words} (expected log Bayes factor of the first two {:.0} in {duration_s:.3} s).",
                0.5 * gain
            )
        }
        _ => format!(
            "To separate {names}: none of the experiments that were simulated does; measure at another place."
        ),
    }
}

/// Twice the expected log-Bayes-factor of one experiment: the squared distance of the two trajectories in units of the noise, less what the rival's
/// parameters, and a start that is not known, can make up for. As in a log, what happens within the longest delay has no weight.
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

fn names(class: &[Applied]) -> String {
    class.iter().map(Applied::key).collect::<Vec<_>>().join(", ")
}

/// As [`experiment`], by the kinds of a class' members, where nothing can be simulated ahead.
pub(crate) fn by_kind(class: &[Applied]) -> String {
    format!("To separate {}: {}.", names(class), advice(class))
}

fn advice(class: &[Applied]) -> &'static str {
    let sites = |site: Site| class.iter().any(|c| c.effect.site() == site);
    let told_by =
        |telling| class.iter().filter(|c| c.effect.facts().told_by == Some(telling)).count() > 1;
    if told_by(Telling::Amplitude) {
        "repeat the experiment at two or more amplitudes, with slow reversals through zero"
    } else if told_by(Telling::OperatingPoint) {
        "step the operating point, and start from a known state"
    } else if told_by(Telling::Bandwidth) && !sites(Site::Output) {
        "excite with a broadband signal that reaches well above one over the lag, at two amplitudes"
    } else if sites(Site::Output) || sites(Site::Clock) {
        "record motion that is not caused by the commands (a release from a displaced start, a push by hand), beside the same commands"
    } else {
        "excite with a multisine over the whole bandwidth, at two amplitudes and two operating points"
    }
}

/// What would tell a start that is off from an effect.
pub(crate) fn of_starts(sensitivities: &[PriorSensitivity]) -> String {
    let states =
        sensitivities.iter().map(|h| format!("`{}`", h.state)).collect::<Vec<_>>().join(", ");
    format!(
        "The verdict hangs on how far the start of {states} is trusted: begin from a known state (and say so with initial_std), or step the operating point."
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_proposal_that_is_a_signal_has_its_commands() {
        let logged = vec![vec![1.0, 3.0, 1.0, 3.0], vec![0.0, 0.0, 1.0, 1.0]];
        let twice = proposed(
            "To separate a, b: repeat the commands at twice the amplitude (expected log Bayes factor 9 in 4 s).",
            &logged,
        );
        assert_eq!(twice, Some(vec![vec![0.0, 4.0, 0.0, 4.0], vec![-0.5, -0.5, 1.5, 1.5]]));
        let rest =
            proposed("To separate a, b: record at rest, commands held (expected…).", &logged);
        assert_eq!(rest, Some(vec![vec![2.0; 4], vec![0.5; 4]]));
        assert_eq!(
            proposed(
                "To separate a, b: none of the experiments that were simulated does; measure at another place.",
                &logged
            ),
            None
        );
        assert_eq!(proposed("repeat the commands at twice the amplitude", &[]), None);
    }
}

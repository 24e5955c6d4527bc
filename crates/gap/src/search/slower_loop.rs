//! A slower loop from the arrivals of commands: whether decoded as lost or as randomly late, all arrivals lie on one lattice of times.
//!
//! The coherence of the arrivals at a frequency, |Σ exp(2πift)|/n, is 1 where their distances are whole periods. The coherence falls to sinc(f·sample time)
//! where their times are known to a sample (Rayleigh's test; Mardia and Jupp 2000, "Directional Statistics", section 6.3).
//!
//! How it can be wrong: a lattice is contained in every finer one that divides it, so the longest of nearly equal periods is taken. Few arrivals are coherent by chance, so the fit decides.

use std::f64::consts::TAU;

use crate::hypothesis::direction::with;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::waits::Wait;
use crate::likelihood::active_effects::LostCommands;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Fates, Lateness, Scales};
use deadtime_signal::parallel;

/// Fewer arrivals show no lattice.
const FEWEST: usize = 10;
/// Arrivals with a lower coherence lie on no lattice. The values are for lost commands, whose arrivals are known to a sample, and for random delays, which are
/// smeared. By chance n arrivals are more coherent than c with probability exp(−n·c²), and the fit has the last word.
const COHERENT: f64 = 0.6;
const SMEARED: f64 = 0.15;
/// A frequency with nearly the best coherence may be the true one.
const NEARLY: f64 = 0.9;
/// Frequencies per reciprocal of the logs' length, and so many at most.
const FINE: f64 = 6.0;
const FREQUENCIES: f64 = 40_000.0;
/// Lattices that are fitted. Before that, places near them are tried from so many samples on: decoded arrivals are wrong by some samples here and there,
/// and a lattice that is a sample off explains little.
const LATTICES: usize = 2;
const SAMPLES: f64 = 2.0;
/// Steps to a sample at the end of such a search, and its moves at most.
const TO_A_SAMPLE: f64 = 32.0;
const MOVES: usize = 40;
/// Moves at the start of the logs and at their end.
const NEIGHBOURS: [[f64; 2]; 8] = [
    [1.0, 1.0],
    [-1.0, -1.0],
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.0, 1.0],
    [0.0, -1.0],
    [1.0, -1.0],
    [-1.0, 1.0],
];

/// Fits a slower loop where the arrivals of commands decoded as lost or late lie on its lattice. It replaces a loop with a worse fit.
pub(crate) fn from_arrivals(
    likelihood: &Likelihood<'_>,
    singles: &mut [Hypothesis],
    scales: &Scales,
    cost: f64,
) {
    let decoded: Vec<(String, Arrivals)> = singles
        .iter()
        .filter_map(|single| {
            let (applied, lost) = (single.effects.first()?, single.lost.as_ref()?);
            let input = likelihood.system.inputs.iter().position(|p| p.name == applied.channel)?;
            let late = Arrivals::of_late(likelihood, input, &lost.sequences);
            Some((
                applied.channel.clone(),
                if late.times_s.is_empty() {
                    Arrivals::of_lost(lost.waits.get(input)?)
                } else {
                    late
                },
            ))
        })
        .collect();
    for (channel, arrivals) in decoded {
        let Some(nominal) = Lateness::SlowerLoop
            .effect()
            .ok()
            .and_then(|e| Applied::nominal(likelihood.system, e, &channel).ok())
        else {
            continue;
        };
        let Some(single) = singles.iter_mut().find(|s| s.key() == nominal.key()) else { continue };
        let (_, longest_s) = nominal.range(0, scales);
        let reach_s = SAMPLES * arrivals.sample_time_s;
        let fit = |guess: Vec<f64>| {
            let begin = nearby(likelihood, &nominal, &guess, reach_s, scales);
            Hypothesis::fit(likelihood, &[begin], scales, cost, likelihood.budget.steps)
        };
        let fits: Vec<Hypothesis> =
            lattices(&arrivals, longest_s, scales.duration_s).into_iter().filter_map(fit).collect();
        for better in fits {
            if !single.fitted || better.gain > single.gain {
                *single = better;
            }
        }
    }
}

/// When commands were there, as far as it was decoded.
struct Arrivals {
    /// Seconds of their logs.
    times_s: Vec<f64>,
    sample_time_s: f64,
    /// Less coherent ones lie on no lattice.
    coherent: f64,
}

impl Arrivals {
    fn of_lost(waits: &[Wait]) -> Self {
        // A command that is there at a sample came within the one before it, on average at its middle.
        let times_s =
            waits.iter().map(|w| w.sent_s + (w.samples as f64 - 0.5) * w.sample_time_s).collect();
        Self {
            times_s,
            sample_time_s: waits.iter().map(|w| w.sample_time_s).fold(0.0, f64::max),
            coherent: COHERENT,
        }
    }

    fn of_late(likelihood: &Likelihood<'_>, input: usize, sequences: &[LostCommands]) -> Self {
        let mut late = Self { times_s: Vec::new(), sample_time_s: 0.0, coherent: SMEARED };
        for (record, sequence) in
            likelihood.records.iter().zip(sequences).filter(|(r, _)| r.train.is_some())
        {
            if let Some(Fates::Late(delays)) = &sequence[input] {
                let u = &record.inputs[input];
                let changed = (1..delays.len()).filter(|&k| u[k] != u[k - 1]);
                late.times_s.extend(changed.map(|k| record.time_s[k] + delays[k]));
                late.sample_time_s = late.sample_time_s.max(record.sample_time_s);
            }
        }
        late
    }
}

/// Period and phase of the lattices on which the arrivals lie, most coherent first.
fn lattices(arrivals: &Arrivals, longest_s: f64, duration_s: f64) -> Vec<Vec<f64>> {
    let (step_s, times_s) = (arrivals.sample_time_s, &arrivals.times_s);
    if times_s.len() < FEWEST || step_s <= 0.0 || longest_s <= 2.0 * step_s {
        return Vec::new();
    }
    let [from_hz, to_hz] = [1.0 / longest_s, 0.5 / step_s];
    let fine_hz = (1.0 / (FINE * duration_s)).max((to_hz - from_hz) / FREQUENCIES);
    let count = ((to_hz - from_hz) / fine_hz) as usize;
    let coherence = |hz: f64| {
        let (sin, cos) = times_s
            .iter()
            .map(|t| (TAU * hz * t).sin_cos())
            .fold((0.0, 0.0), |sum, v| (sum.0 + v.0, sum.1 + v.1));
        (sin.hypot(cos) / times_s.len() as f64, sin.atan2(cos))
    };
    let all: Vec<(f64, f64, f64)> = parallel::map(0..=count, |n| {
        let hz = from_hz + n as f64 * fine_hz;
        let (coherence, angle) = coherence(hz);
        (hz, coherence, angle)
    });
    let peaks = (0..all.len()).filter(|&n| {
        (n == 0 || all[n].1 >= all[n - 1].1) && (n + 1 == all.len() || all[n].1 > all[n + 1].1)
    });
    let highest = all.iter().map(|a| a.1).fold(0.0, f64::max);
    if highest < arrivals.coherent {
        return Vec::new();
    }
    // In the order of frequency: the longest periods first.
    let chosen = peaks.filter(|&n| all[n].1 >= NEARLY * highest).take(LATTICES);
    chosen.map(|n| vec![1.0 / all[n].0, (all[n].2 / TAU).rem_euclid(1.0) / all[n].0]).collect()
}

/// Period and phase of the lowest cost near a guess. The passing times move at the start of the logs and at their end, first by `reach_s`.
///
/// A compass search (Kolda, Lewis and Torczon 2003, doi:10.1137/S003614450242889) takes steps far larger than a sample first. Within a sample the
/// slope of the cost has no meaning: the passing times move and the commands that pass stay the same ones.
pub(super) fn nearby(
    likelihood: &Likelihood<'_>,
    nominal: &Applied,
    guess: &[f64],
    reach_s: f64,
    scales: &Scales,
) -> Applied {
    let turns = (scales.duration_s / guess[0]).max(1.0);
    // Moved by so much at the start of the logs and at their end.
    let moved = |[first_s, last_s]: [f64; 2]| {
        vec![guess[0] + (last_s - first_s) / turns, guess[1] + first_s]
    };
    let costed = |place: [f64; 2]| {
        let there = likelihood.whitened(&[with(nominal, &moved(place))])?;
        Some((likelihood.inner(&there, &there), place))
    };
    let Some(mut best) = costed([0.0; 2]) else { return with(nominal, guess) };
    let (mut step_s, smallest_s) = (reach_s, scales.sample_time_s / TO_A_SAMPLE);
    for _ in 0..MOVES {
        let [first_s, last_s] = best.1;
        let places = NEIGHBOURS.map(|[f, l]| [first_s + f * step_s, last_s + l * step_s]);
        let costs: Vec<(f64, [f64; 2])> = if likelihood.calls(nominal) {
            places.into_iter().filter_map(costed).collect()
        } else {
            parallel::filter_map(places, costed)
        };
        match costs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some(next) if next.0 < best.0 => best = next,
            _ if step_s <= smallest_s => break,
            _ => step_s *= 0.5,
        }
    }
    with(nominal, &moved(best.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands sent at odd times wait for a slower loop; the arrivals are known to a sample.
    #[test]
    fn the_lattice_of_arrivals_is_found_and_none_where_there_is_none() {
        let sent = |k: usize| 0.02 * ((k * 37) % 31 + 31 * k) as f64;
        let wait = |sent_s: f64, there_s: f64| {
            let samples = ((there_s - sent_s) / 0.02 - 1e-9).ceil().max(0.0) as usize;
            Wait { sent_s, samples, rested: Some(0), sample_time_s: 0.02 }
        };
        for (period, phase) in [(0.2, 0.03), (0.13, 0.05), (0.0777, 0.01)] {
            let arrives = |sent_s: f64| phase + ((sent_s - phase) / period).ceil() * period;
            let waits: Vec<Wait> = (0..50).map(|k| wait(sent(k), arrives(sent(k)))).collect();
            let found = lattices(&Arrivals::of_lost(&waits), 0.6, 35.0);
            let near = |guess: &Vec<f64>| {
                let turns = (30.0 / period).round();
                let off = |t: f64| {
                    ((t - guess[1]) / guess[0] - ((t - guess[1]) / guess[0]).round()).abs()
                        * guess[0]
                };
                off(phase) < 0.02
                    && off(phase + turns * period) < 0.02
                    && (guess[0] / period - 1.0).abs() < 0.01
            };
            assert!(found.iter().any(near), "{period}, {phase}: {found:?}");
        }
        let fixed: Vec<Wait> =
            (0..50).map(|k| wait(sent(k), sent(k) + 0.1 + 0.05 * ((k * k) % 7) as f64)).collect();
        assert!(lattices(&Arrivals::of_lost(&fixed[..5]), 0.6, 35.0).is_empty());
    }
}

//! A slower loop from the waits of commands: where each command waited until it was there, all arrivals lie on one lattice of times.
//!
//! The coherence of the arrivals at a frequency, |Σ exp(2πift)|/n, is 1 where they are whole periods apart, and falls to sinc(f·sample time) where their
//! times are known to a sample (Rayleigh's test; Mardia and Jupp 2000, "Directional Statistics", section 6.3). How it can be wrong: what lies on a lattice
//! lies on every finer one that divides it, so of near equals the longest period counts; few arrivals are coherent by chance, so the fit has the last word.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::diagnose::hypothesis::direction::with;
use crate::diagnose::hypothesis::effects::Hypothesis;
use crate::diagnose::hypothesis::waits::Wait;
use crate::diagnose::likelihood::gaussian::Likelihood;
use crate::effect::{Applied, Lateness, Scales};

/// Fewer arrivals show no lattice.
const FEWEST: usize = 10;
/// Arrivals that are less coherent than this lie on none; and what is nearly as coherent as the best may be the true one.
const COHERENT: f64 = 0.6;
const NEARLY: f64 = 0.9;
/// Frequencies per reciprocal of the logs' length, and so many at most.
const FINE: f64 = 6.0;
const FREQUENCIES: f64 = 40_000.0;
/// Lattices that are fitted, and steps to either side of period and phase that are looked at before.
const LATTICES: usize = 2;
const STEPS: i32 = 3;

/// Fits a slower loop where the waits that were decoded for lost commands show its lattice; in the place of one that was fitted worse.
pub(in crate::diagnose) fn from_waits(likelihood: &Likelihood<'_>, singles: &mut [Hypothesis], scales: &Scales, cost: f64) {
    let lost: Vec<(String, Vec<Wait>)> = singles
        .iter()
        .filter_map(|single| {
            let (applied, lost) = (single.effects.first()?, single.lost.as_ref()?);
            let input = likelihood.system.inputs.iter().position(|p| p.name == applied.channel)?;
            Some((applied.channel.clone(), lost.waits.get(input)?.clone()))
        })
        .collect();
    for (channel, waits) in lost {
        let Some(nominal) = Lateness::SlowerLoop.effect().ok().and_then(|e| Applied::nominal(likelihood.system, e, &channel).ok()) else {
            continue;
        };
        let Some(single) = singles.iter_mut().find(|s| s.key() == nominal.key()) else { continue };
        let (_, longest_s) = nominal.range(0, scales);
        let fit = |guess: Vec<f64>| {
            let begin = nearby(likelihood, &nominal, &guess, scales);
            Hypothesis::fit(likelihood, &[begin], scales, cost, likelihood.budget.steps)
        };
        let fits: Vec<Hypothesis> = lattices(&waits, longest_s, scales.duration_s).into_iter().filter_map(fit).collect();
        for better in fits {
            if !single.fitted || better.gain > single.gain {
                *single = better;
            }
        }
    }
}

/// Period and phase of the lattices on which the arrivals lie, most coherent first.
fn lattices(waits: &[Wait], longest_s: f64, duration_s: f64) -> Vec<Vec<f64>> {
    let step_s = waits.iter().map(|w| w.sample_time_s).fold(0.0, f64::max);
    if waits.len() < FEWEST || step_s <= 0.0 || longest_s <= 2.0 * step_s {
        return Vec::new();
    }
    // A command that is there at a sample came within the one before it, on average at its middle.
    let arrivals: Vec<f64> = waits.iter().map(|w| w.sent_s + (w.samples as f64 - 0.5) * w.sample_time_s).collect();
    let [from_hz, to_hz] = [1.0 / longest_s, 0.5 / step_s];
    let fine_hz = (1.0 / (FINE * duration_s)).max((to_hz - from_hz) / FREQUENCIES);
    let count = ((to_hz - from_hz) / fine_hz) as usize;
    let coherence = |hz: f64| {
        let (sin, cos) = arrivals.iter().map(|t| (TAU * hz * t).sin_cos()).fold((0.0, 0.0), |sum, v| (sum.0 + v.0, sum.1 + v.1));
        (sin.hypot(cos) / arrivals.len() as f64, sin.atan2(cos))
    };
    let all: Vec<(f64, f64, f64)> = (0..=count)
        .into_par_iter()
        .map(|n| {
            let hz = from_hz + n as f64 * fine_hz;
            let (coherence, angle) = coherence(hz);
            (hz, coherence, angle)
        })
        .collect();
    let peaks = (0..all.len()).filter(|&n| (n == 0 || all[n].1 >= all[n - 1].1) && (n + 1 == all.len() || all[n].1 > all[n + 1].1));
    let highest = all.iter().map(|a| a.1).fold(0.0, f64::max);
    if highest < COHERENT {
        return Vec::new();
    }
    // In the order of frequency: the longest periods first.
    let chosen = peaks.filter(|&n| all[n].1 >= NEARLY * highest).take(LATTICES);
    chosen.map(|n| vec![1.0 / all[n].0, (all[n].2 / TAU).rem_euclid(1.0) / all[n].0]).collect()
}

/// The best of periods and phases close to a guess: within a sample at both ends of the logs.
fn nearby(likelihood: &Likelihood<'_>, nominal: &Applied, guess: &[f64], scales: &Scales) -> Applied {
    let step_s = scales.sample_time_s / f64::from(STEPS);
    let turns = (scales.duration_s / guess[0]).max(1.0);
    let places: Vec<Vec<f64>> = (-STEPS..=STEPS)
        .flat_map(|last| (-STEPS..=STEPS).map(move |first| (f64::from(first) * step_s, f64::from(last) * step_s)))
        // Moved by so much at the start of the logs and at their end.
        .map(|(first_s, last_s)| vec![guess[0] + (last_s - first_s) / turns, guess[1] + first_s])
        .collect();
    let costed = |values: &Vec<f64>| {
        let there = likelihood.whitened(&[with(nominal, values)])?;
        Some((likelihood.inner(&there, &there), values.clone()))
    };
    let best = places.par_iter().filter_map(costed).min_by(|a, b| a.0.total_cmp(&b.0));
    with(nominal, best.as_ref().map_or(guess, |(_, values)| values.as_slice()))
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
            Wait { sent_s, samples, sample_time_s: 0.02 }
        };
        for (period, phase) in [(0.2, 0.03), (0.13, 0.05), (0.0777, 0.01)] {
            let arrives = |sent_s: f64| phase + ((sent_s - phase) / period).ceil() * period;
            let waits: Vec<Wait> = (0..50).map(|k| wait(sent(k), arrives(sent(k)))).collect();
            let found = lattices(&waits, 0.6, 35.0);
            let near = |guess: &Vec<f64>| {
                let turns = (30.0 / period).round();
                let off = |t: f64| ((t - guess[1]) / guess[0] - ((t - guess[1]) / guess[0]).round()).abs() * guess[0];
                off(phase) < 0.02 && off(phase + turns * period) < 0.02 && (guess[0] / period - 1.0).abs() < 0.01
            };
            assert!(found.iter().any(near), "{period}, {phase}: {found:?}");
        }
        let fixed: Vec<Wait> = (0..50).map(|k| wait(sent(k), sent(k) + 0.1 + 0.05 * ((k * k) % 7) as f64)).collect();
        assert!(lattices(&fixed[..5], 0.6, 35.0).is_empty());
    }
}

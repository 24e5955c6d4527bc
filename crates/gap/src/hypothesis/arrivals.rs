//! The arrival time of each command: the latent random delays of late commands, estimated from the outputs.
//!
//! A command that differs by c from its predecessor and arrives δ later than expected adds −c·δ·h to the outputs, h being their impulse response. To first
//! order the residual is G(m + δ). The shift m is common to all; δ is normal with the standard deviation s and the correlation of commands that keep their
//! order. With A = P⁻¹ + GᵀG the delays are A⁻¹Gᵀr. The marginal likelihood of a spread is −bᵀA⁻¹b + ln det PA with b = Gᵀr, and the spread minimises it.
//! Source: Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, equations 2.27 to 2.30. The steps repeat about the estimated delays, simulated
//! exactly; the sequence with the lowest cost is kept.
//!
//! Disturbances of equal size at the same instants are the alternative. A delay δ adds −c·δ·h, so its effect is proportional to the command's change c. Where
//! equal sizes have the higher marginal likelihood, the input is disturbed and the delays are rejected.
//!
//! How it can be wrong: command changes of one size do not distinguish the two; delays are then accepted. Delays longer than the plant's smoothing leave the
//! linear range, so the exact simulation decides. A response that varies, or a misfit of another kind, is fitted in part; the misfit stays above the floor. A
//! response that is long relative to the record is truncated.

use nalgebra::DMatrix;

use super::arrival_equations::{Linear, Solved, improbable, information, linear, solve};
use super::arrival_law::{Settled, is_disturbance, spread, waits};
use super::direction::with;
use super::effects::{Dropouts, Hypothesis};
use super::queue::{Waiting, waiting_for};
use super::response::response;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Fates, Lateness};
use deadtime_signal::parallel;

/// Times all is done again about the delays that were found.
const PASSES: usize = 10;
/// A pass that lowers the cost by less than this part is the last one.
const SETTLED: f64 = 2e-3;
/// Parts of the way to where the linear equations lead that are tried, until one lowers the cost.
const PARTS: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];
/// The tail of a response with at most this part of its energy is cut off.
const TAIL: f64 = 1e-5;
/// Multiplications in one factorisation of all records; a longer response is cut off, but not below so many samples.
const WORK: f64 = 1.5e8;
const SHORTEST: usize = 30;
/// Draws have no more of their variance in a trend; 1. Chosen, far above chance: of n that are independent about 1/n along a line, and some more from one level to another.
const BY_CHANCE: f64 = 0.5;

/// The sequence of delays of one input over all records, given the other effects; `late` with its parameters, and the known latent sequence in `lost`.
pub(super) fn decode(
    likelihood: &Likelihood<'_>,
    others: &[Applied],
    late: &Applied,
    input: usize,
    lost: &mut Dropouts,
) -> Option<Applied> {
    let step_s = likelihood.records.iter().find(|r| r.train.is_some())?.sample_time_s;
    let responses = responses(likelihood, others, input)?;
    let search = Search { likelihood, others, input, step_s, responses, price: lost.price };
    let Place { late, known, .. } = search.best(late, lost)?;
    if with_time(likelihood, input, &known) > BY_CHANCE {
        return None;
    }
    let records = search.equations(&late, &known)?;
    if is_disturbance(&records, waits(&late, step_s)?.mean_s) {
        return None;
    }
    *lost = known;
    let Some(Settled { law, std }) = Settled::of(&records, &late, step_s) else {
        return Some(late);
    };
    lost.std[input] = std;
    Some(with(&late, &[law.delay_s, law.spread_s, late.values[2]]))
}

/// The search for the delays of one input, given the other effects.
struct Search<'a> {
    likelihood: &'a Likelihood<'a>,
    others: &'a [Applied],
    input: usize,
    step_s: f64,
    /// Per record the whitened response to one held sample of one unit.
    responses: Vec<DMatrix<f64>>,
    /// The price of the latent sequences of the other inputs.
    price: f64,
}

/// A place in the search for delays.
struct Place {
    late: Applied,
    known: Dropouts,
    cost: f64,
}

/// The solution of the linear equations about a place.
struct Solution {
    records: Vec<Linear>,
    waiting: Waiting,
    solved: Solved,
    /// The effective number of noise values that the delays fit.
    followed: f64,
    /// The law of the delays.
    law: Applied,
}

impl Search<'_> {
    /// The place of the lowest cost, from the delays of a sequence decoded before or from the common delay.
    fn best(&self, late: &Applied, lost: &Dropouts) -> Option<Place> {
        // The mean wait of a sequence decoded before; else the common delay.
        let known_before = lost.sequences.iter().any(|s| s[self.input].is_some());
        let mut wait_s =
            if known_before { waits(late, self.step_s)?.mean_s } else { late.values[0] };
        // The current place of the search, and the best so far; costs are those by the equations there.
        let mut here = self.first_place(late, lost);
        let mut best: Option<Place> = None;
        for pass in 0..PASSES {
            let solution = self.solution(&here, wait_s, pass == 0)?;
            let stood = self.place(&here, &solution, 0.0)?;
            let lowest = stood.cost;
            if (pass > 0 || known_before) && best.as_ref().is_none_or(|b| lowest < b.cost) {
                best = Some(stood);
            }
            let tried = |part| self.place(&here, &solution, part);
            let Some(next) = PARTS.into_iter().filter_map(tried).find(|next| next.cost < lowest)
            else {
                break;
            };
            wait_s = solution.solved.mean_s;
            let settled = next.cost > (1.0 - SETTLED) * lowest;
            here = next;
            if settled || pass + 1 == PASSES {
                best = best.filter(|b| b.cost <= here.cost).or(Some(here));
                break;
            }
        }
        best
    }

    /// The place where the search begins: the delays that are known, the common delay in other records.
    fn first_place(&self, late: &Applied, lost: &Dropouts) -> Place {
        let mut known = lost.clone();
        for (sequences, record) in known.sequences.iter_mut().zip(self.likelihood.records) {
            let sequence = &mut sequences[self.input];
            if !matches!(sequence, Some(Fates::Late(_))) {
                *sequence = Some(Fates::Late(vec![late.values[0]; record.time_s.len()]));
            }
        }
        Place { late: late.clone(), known, cost: f64::INFINITY }
    }

    /// All effects with this law of the delays.
    fn effects(&self, late: &Applied) -> Vec<Applied> {
        self.others.iter().cloned().chain([late.clone()]).collect()
    }

    /// The linear equations of all records about known delays.
    fn equations(&self, late: &Applied, known: &Dropouts) -> Option<Vec<Linear>> {
        let effects = self.effects(late);
        let active = ActiveEffects { effects: &effects, lost: Some(&known.sequences) };
        let one = |at| linear(self.likelihood, active, at, self.input, &self.responses[at]);
        parallel::try_map(0..self.likelihood.records.len(), one)
    }

    /// The solution of the equations about a place, for the most probable spread about a mean wait.
    fn solution(&self, here: &Place, wait_s: f64, first: bool) -> Option<Solution> {
        let records = self.equations(&here.late, &here.known)?;
        let (chosen, waiting) = spread(&records, &here.late, wait_s, self.step_s, first)?;
        let solved = solve(&records, &waiting)?;
        let followed = information(&records, &waiting)?.noise;
        let law = waiting_for(solved.mean_s, chosen.spread_s, chosen.ordered, self.step_s)
            .map_or(chosen, |(law, _)| law);
        let law = with(&here.late, &[law.delay_s, law.spread_s, here.late.values[2]]);
        Some(Solution { records, waiting, solved, followed, law })
    }

    /// The place on a part of the way to the solution: the response to a delay is another one once the delay is there.
    fn place(&self, here: &Place, solution: &Solution, part: f64) -> Option<Place> {
        let Solution { records, waiting, solved, followed, law } = solution;
        let mut there = here.known.clone();
        let mut improbability = 0.0;
        for (at, record) in records.iter().enumerate() {
            let way = record.delays.iter().zip(&solved.delays[at]);
            let delays: Vec<f64> = way.map(|(now, then)| now + part * (then - now)).collect();
            let apart: Vec<f64> = delays.iter().map(|d| d - solved.mean_s).collect();
            improbability += if record.trained { improbable(&apart, record, waiting) } else { 0.0 };
            there.sequences[at][self.input] =
                Some(Fates::Late(record.of_all(&delays, &self.likelihood.records[at].time_s)));
        }
        let sent = records.iter().filter(|r| r.trained).map(|r| r.sent.len()).sum::<usize>();
        there.price = self.price + solved.freedom + improbability + (sent.max(2) as f64).ln();
        there.followed = *followed;
        let effects = self.effects(law);
        let active = ActiveEffects { effects: &effects, lost: Some(&there.sequences) };
        let whitened = self.likelihood.whitened(active)?;
        let cost = self.likelihood.inner(&whitened, &whitened) + there.price;
        Some(Place { late: law.clone(), known: there, cost })
    }
}

/// The part of the variance of all delays on the training logs that follows time: a straight line, or a step between two levels.
fn with_time(likelihood: &Likelihood<'_>, input: usize, found: &Dropouts) -> f64 {
    let mut delays: Vec<(f64, f64)> = Vec::new();
    for (record, sequence) in
        likelihood.records.iter().zip(&found.sequences).filter(|(r, _)| r.train.is_some())
    {
        if let Some(Fates::Late(all)) = &sequence[input] {
            let u = &record.inputs[input];
            let changes = (1..all.len()).filter(|&k| u[k] != u[k - 1]);
            delays.extend(changes.map(|k| (record.time_s[k], all[k])));
        }
    }
    delays.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = delays.len().max(1) as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| delays.iter().map(of).sum::<f64>() / count;
    let (at, level) = (mean(&|d| d.0), mean(&|d| d.1));
    let variance = mean(&|d| (d.1 - level).powi(2));
    let line = mean(&|d| (d.0 - at) * (d.1 - level)).powi(2) / mean(&|d| (d.0 - at).powi(2));
    let (mut before, mut step) = (0.0, 0.0_f64);
    for (k, d) in (1..delays.len()).zip(&delays) {
        before += d.1 - level;
        let first = k as f64;
        step = step.max(before * before / (first * (count - first)));
    }
    let part = line.max(step) / variance;
    if part.is_finite() { part } else { 0.0 }
}

/// Fits every effect whose commands have random delays, from the best fixed delay on its input. Single effects have their current values.
pub(crate) fn refit_from_fixed(likelihood: &Likelihood<'_>, singles: &mut [Hypothesis], cost: f64) {
    let fixed: Vec<(String, f64)> = (singles.iter())
        .filter(|e| e.fitted && e.gain > likelihood.criteria.selection_penalty)
        .filter(|e| e.effects.iter().any(|a| a.effect.lateness() == Some(Lateness::Fixed)))
        .map(|e| (e.effects[0].channel.clone(), e.effects[0].values[0]))
        .collect();
    parallel::for_each(singles, |single| {
        let [applied] = single.effects.as_slice() else { return };
        let Some((_, delay_s)) = fixed.iter().find(|(channel, _)| {
            applied.effect.lateness() == Some(Lateness::Random) && *channel == applied.channel
        }) else {
            return;
        };
        let Some(input) = likelihood.system.inputs.iter().position(|p| p.name == applied.channel)
        else {
            return;
        };
        let mut lost = Dropouts::none(likelihood);
        let begin = with(applied, &[*delay_s, 0.3 * delay_s, 1.0]);
        let Some(late) = decode(likelihood, &[], &begin, input, &mut lost) else { return };
        let found = Hypothesis {
            effects: vec![late],
            free: Vec::new(),
            gain: 0.0,
            fitted: true,
            lost: Some(lost),
        };
        let Some(there) = likelihood.whitened(&found) else { return };
        let price = found.lost.as_ref().map_or(0.0, |l| l.price);
        let gain = cost - likelihood.inner(&there, &there) - price;
        *single = Hypothesis { gain, ..found };
    });
}

/// Per record the whitened response to one held sample of one unit, cut off where little is left of it.
fn responses(
    likelihood: &Likelihood<'_>,
    others: &[Applied],
    input: usize,
) -> Option<Vec<DMatrix<f64>>> {
    let samples: usize = likelihood.records.iter().map(|r| r.time_s.len()).sum();
    let most = ((WORK / samples.max(1) as f64).sqrt() as usize).max(SHORTEST);
    let one = |at: usize| {
        let g = likelihood.filter(at, &response(likelihood, at, others, input)?);
        let energy = |row: usize| g.row(row).norm_squared();
        let whole: f64 = (0..g.nrows()).map(energy).sum();
        let mut left = whole;
        let length = (0..g.nrows())
            .take_while(|&row| {
                let more = left > TAIL * whole;
                left -= energy(row);
                more
            })
            .count();
        (whole > 0.0).then(|| g.rows(0, length.clamp(1, most.min(g.nrows()))).into_owned())
    };
    parallel::try_map(0..likelihood.records.len(), one)
}

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
use rayon::prelude::*;

use super::direction::with;
use super::effects::{Dropouts, Hypothesis};
use super::penalised_gain::NO_EVIDENCE;
use super::queue::{Waiting, waiting_for};
use super::response::{response, static_value};
use super::skyline::Skyline;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance, Fates, Lateness};
use deadtime_model::simulate::{Delays, Late};

/// Times all is done again about the delays that were found.
const PASSES: usize = 10;
/// A pass that lowers the cost by less than this part is the last one.
const SETTLED: f64 = 2e-3;
/// Parts of the way to where the linear equations lead that are tried, until one lowers the cost.
const PARTS: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];
/// Spreads that are tried, as parts of the mean delay: from, to, and how many.
const SPREADS: (f64, f64, usize) = (0.03, 1.5, 9);
/// Around the last one: neighbours by this factor.
const NEIGHBOUR: f64 = 1.3;
/// The tail of a response with at most this part of its energy is cut off.
const TAIL: f64 = 1e-5;
/// Multiplications in one factorisation of all records; a longer response is cut off, but not below so many samples.
const WORK: f64 = 1.5e8;
const SHORTEST: usize = 30;
/// Draws have no more of their variance in a trend; 1. Chosen, far above chance: of n that are independent about 1/n along a line, and some more from one level to another.
const BY_CHANCE: f64 = 0.5;
/// The step of derivatives by differences, of the logarithm of the delays' variance.
const STEP: f64 = 0.1;
/// A command that changes by less than this part of the largest change decides nothing.
const CHANGES: f64 = 1e-6;

/// The equations of one record's delays, about those that are assumed now.
#[derive(Clone)]
struct Linear {
    /// Samples of the commands that change.
    sent: Vec<usize>,
    /// When they were sent, seconds.
    sent_s: Vec<f64>,
    /// Their delays now, seconds.
    delays: Vec<f64>,
    /// The size of each change.
    changes: Vec<f64>,
    /// Per command, the standard deviation of its delay over that of all; 1 for delays of one distribution.
    weights: Vec<f64>,
    /// GᵀG.
    gram: Skyline,
    /// Gᵀe.
    along: Vec<f64>,
    trained: bool,
}

impl Linear {
    /// The same equations for disturbances of equal size: the delay of a small change varies more.
    fn of_equal_disturbances(&self, rms: f64) -> Self {
        let weights = self.changes.iter().map(|c| rms / c).collect();
        Self { weights, ..self.clone() }
    }
}

/// The solution of the equations for one spread.
struct Solved {
    /// Twice the negative log of the marginal likelihood, but for a constant.
    cost: f64,
    /// The mean of all delays, seconds, and the precision of that.
    mean_s: f64,
    precision: f64,
    /// Per record the delays, seconds.
    delays: Vec<Vec<f64>>,
    /// The price of the freedom of the delays, twice a negative log-probability.
    freedom: f64,
}

impl Linear {
    /// Delays of all samples. A command that changes nothing arrives with the one before it; commands after the last timely arrival have its delay.
    fn of_all(&self, delays: &[f64], time_s: &[f64]) -> Vec<f64> {
        let mut next = self.sent.iter().zip(delays).peekable();
        let last_s = delays.last().copied().unwrap_or(0.0);
        let mut there_s = f64::NEG_INFINITY;
        let one = |(k, &sent_s): (usize, &f64)| {
            if let Some((_, delay_s)) = next.next_if(|(at, _)| **at == k) {
                there_s = sent_s + delay_s;
            } else if next.peek().is_none() {
                there_s = there_s.max(sent_s + last_s);
            }
            (there_s - sent_s).max(0.0)
        };
        time_s.iter().enumerate().map(one).collect()
    }
}

/// The sequence of delays of one input over all records, given the other effects; `late` with its parameters, and the known latent sequence in `lost`.
pub(super) fn decode(
    likelihood: &Likelihood<'_>,
    others: &[Applied],
    late: &Applied,
    input: usize,
    lost: &mut Dropouts,
) -> Option<Applied> {
    let step_s = likelihood.records.iter().find(|r| r.train.is_some())?.sample_time_s;
    let mut present = lost.clone();
    for (at, record) in likelihood.records.iter().enumerate() {
        if !matches!(present.sequences[at][input], Some(Fates::Late(_))) {
            present.sequences[at][input] =
                Some(Fates::Late(vec![late.values[0]; record.time_s.len()]));
        }
    }
    let responses = responses(likelihood, others, input)?;
    // The mean wait of a sequence decoded before; else the common delay.
    let known_before = lost.sequences.iter().any(|s| s[input].is_some());
    let mut wait_s = if known_before { waits(late, step_s)?.mean_s } else { late.values[0] };
    // The current place of the search, and the best so far; costs are those by the equations there.
    let mut here = Place { late: late.clone(), known: present.clone(), cost: f64::INFINITY };
    let mut best: Option<Place> = None;
    for pass in 0..PASSES {
        let effects: Vec<Applied> = others.iter().cloned().chain([here.late.clone()]).collect();
        let active = ActiveEffects { effects: &effects, lost: Some(&here.known.sequences) };
        let linear = |at: usize| linear(likelihood, active, at, input, &responses[at]);
        let records: Vec<Linear> =
            (0..likelihood.records.len()).into_par_iter().map(linear).collect::<Option<_>>()?;
        let (chosen, waiting) = spread(&records, &here.late, wait_s, step_s, pass == 0)?;
        let solved = solve(&records, &waiting)?;
        let information = information(&records, &waiting)?;
        let law = waiting_for(solved.mean_s, chosen.spread_s, chosen.ordered, step_s)
            .map_or(chosen, |(law, _)| law);
        let count =
            records.iter().filter(|r| r.trained).map(|r| r.sent.len()).sum::<usize>().max(2) as f64;
        let std =
            vec![solved.precision.sqrt().recip(), law.spread_s / (2.0 * information.spread).sqrt()];
        let law = with(&here.late, &[law.delay_s, law.spread_s, here.late.values[2]]);
        // The way there, or a part of it: the response to a delay is another one once the delay is there.
        let tried = |part: f64| {
            let mut there = present.clone();
            let mut improbability = 0.0;
            for (at, record) in records.iter().enumerate() {
                let way = record.delays.iter().zip(&solved.delays[at]);
                let delays: Vec<f64> = way.map(|(now, then)| now + part * (then - now)).collect();
                let apart: Vec<f64> = delays.iter().map(|d| d - solved.mean_s).collect();
                improbability +=
                    if record.trained { improbable(&apart, record, &waiting) } else { 0.0 };
                there.sequences[at][input] =
                    Some(Fates::Late(record.of_all(&delays, &likelihood.records[at].time_s)));
            }
            there.price = lost.price + solved.freedom + improbability + count.ln();
            there.followed = information.noise;
            there.std[input].clone_from(&std);
            let effects: Vec<Applied> = others.iter().cloned().chain([law.clone()]).collect();
            let whitened = likelihood
                .whitened(ActiveEffects { effects: &effects, lost: Some(&there.sequences) })?;
            Some(Place {
                cost: likelihood.inner(&whitened, &whitened) + there.price,
                late: law.clone(),
                known: there,
            })
        };
        let stood = tried(0.0)?;
        let lowest = stood.cost;
        if (pass > 0 || known_before) && best.as_ref().is_none_or(|b| lowest < b.cost) {
            best = Some(stood);
        }
        let Some(next) = PARTS.into_iter().filter_map(tried).find(|next| next.cost < lowest) else {
            break;
        };
        wait_s = solved.mean_s;
        let settled = next.cost > (1.0 - SETTLED) * lowest;
        here = next;
        if settled || pass + 1 == PASSES {
            best = best.filter(|b| b.cost <= here.cost).or(Some(here));
            break;
        }
    }
    let Place { late, known, .. } = best?;
    if with_time(likelihood, input, &known) > BY_CHANCE {
        return None;
    }
    let effects: Vec<Applied> = others.iter().cloned().chain([late.clone()]).collect();
    let active = ActiveEffects { effects: &effects, lost: Some(&known.sequences) };
    let linear = |at: usize| linear(likelihood, active, at, input, &responses[at]);
    let records: Vec<Linear> =
        (0..likelihood.records.len()).into_par_iter().map(linear).collect::<Option<_>>()?;
    if is_disturbance(&records, waits(&late, step_s)?.mean_s) {
        return None;
    }
    *lost = known;
    Some(late)
}

/// A place in the search for delays.
struct Place {
    late: Applied,
    known: Dropouts,
    cost: f64,
}

/// The information of the outputs on delays.
struct Information {
    /// The effective number of parameters of the delays in the noise of the training logs: tr S = d ln det(1 + KGᵀG)/d ln s². K is the delays' covariance, s
    /// their spread, and S the map from the outputs to their explained part.
    noise: f64,
    /// The number of independent delays with the same information on the spread: tr S² = tr S − d tr S/d ln s². The number is twice Fisher's information on ln s².
    spread: f64,
}

/// By differences of the determinant.
fn information(records: &[Linear], waiting: &Waiting) -> Option<Information> {
    let at = |step: f64| -> Option<f64> {
        let waiting = Waiting { std_s: (0.5 * step).exp() * waiting.std_s, ..*waiting };
        let one = |r: &Linear| {
            let mut equations = r.gram.clone();
            let logs = add_prior(&mut equations, r, &waiting);
            Some(equations.factor()?.log_determinant() + logs)
        };
        records.iter().filter(|r| r.trained).map(one).sum()
    };
    let [less, same, more] = [at(-STEP)?, at(0.0)?, at(STEP)?];
    let noise = (more - less) / (2.0 * STEP);
    let bend = (more - 2.0 * same + less) / (STEP * STEP);
    Some(Information { noise, spread: (noise - bend).clamp(1.0, noise.max(1.0)) })
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
    singles.par_iter_mut().for_each(|single| {
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
    (0..likelihood.records.len()).into_par_iter().map(one).collect()
}

/// The equations of one record about the delays that are at work.
fn linear(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    at: usize,
    input: usize,
    g: &DMatrix<f64>,
) -> Option<Linear> {
    let record = &likelihood.records[at];
    let span = record.estimated_from()?;
    let residual = likelihood.residual(at, &likelihood.predict_from_posterior(at, active, span)?);
    let e = match record.train.is_some() {
        true => likelihood.whiten_in(at, &residual, span),
        false => likelihood.whiten_whole(at, &residual),
    };
    let delays = match active.lost.and_then(|l| l[at][input].as_ref()) {
        Some(Fates::Late(delays)) => delays,
        _ => return None,
    };
    let plan = likelihood.plan(&[], Chance::Mean)?;
    let through: Vec<f64> =
        record.inputs[input].iter().map(|v| static_value(&plan.inputs[input], *v)).collect();
    let changes: Vec<f64> = through.windows(2).map(|w| w[1] - w[0]).collect();
    let largest = changes.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
    let (samples, outputs) = e.shape();
    let (step_s, length) = (record.sample_time_s, g.nrows());
    // Rows without a measurement, or outside the span, are exactly 0.
    let there: Vec<bool> = (0..samples).map(|k| e.row(k).iter().any(|v| *v != 0.0)).collect();
    let (mut sent, mut known, mut sizes, mut starts, mut columns) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut latest_s, mut earliest) = (f64::NEG_INFINITY, 0);
    for (k, change) in (1..).zip(&changes) {
        latest_s = latest_s.max(record.time_s[k] + delays[k]);
        if change.abs() <= CHANGES * largest {
            continue;
        }
        // A pulse about the time of arrival begins half a sample before it.
        let next = record.time_s.partition_point(|t| *t <= latest_s).max(1);
        let place = (next - 1) as f64 + (latest_s - record.time_s[next - 1]) / step_s - 0.5;
        let from = (place.max(0.0).floor() as usize).max(earliest);
        earliest = from;
        if from >= samples {
            break;
        }
        let part = (place - from as f64).clamp(0.0, 1.0);
        let mut column = DMatrix::zeros(length + 1, outputs);
        for n in (0..=length).filter(|n| there.get(from + n).copied().unwrap_or(false)) {
            for i in 0..outputs {
                let (now, before) = (
                    if n < length { g[(n, i)] } else { 0.0 },
                    if n > 0 { g[(n - 1, i)] } else { 0.0 },
                );
                column[(n, i)] = -change / step_s * ((1.0 - part) * now + part * before);
            }
        }
        sent.push(k);
        known.push(latest_s - record.time_s[k]);
        sizes.push(change.abs());
        starts.push(from);
        columns.push(column);
    }
    let first: Vec<usize> =
        starts.iter().map(|from| starts.partition_point(|other| other + length < *from)).collect();
    // The part of two responses that lies at the same time.
    let product = |i: usize, j: usize| {
        let later = starts[i] - starts[j];
        (0..outputs)
            .map(|o| {
                let (a, b) = (columns[i].column(o), columns[j].column(o));
                a.as_slice().iter().zip(&b.as_slice()[later..]).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    };
    let along = (0..sent.len()).map(|i| {
        let rows = (samples - starts[i]).min(length + 1);
        (0..outputs)
            .map(|o| (0..rows).map(|n| columns[i][(n, o)] * e[(starts[i] + n, o)]).sum::<f64>())
            .sum()
    });
    let along: Vec<f64> = along.collect();
    let gram = Skyline::new(first, product);
    let sent_s = sent.iter().map(|&k| record.time_s[k]).collect();
    let weights = vec![1.0; sent.len()];
    let trained = record.train.is_some();
    Some(Linear { sent, sent_s, delays: known, changes: sizes, weights, gram, along, trained })
}

/// The spreads that are tried about a mean wait.
fn spreads(wait_s: f64) -> Vec<f64> {
    let (from, to, count) = SPREADS;
    let at = |i: usize| wait_s * from * (to / from).powf(i as f64 / (count - 1) as f64);
    (0..count).map(at).collect()
}

/// Whether disturbances of equal size explain more than independent delays of one distribution, about a common delay.
fn is_disturbance(records: &[Linear], wait_s: f64) -> bool {
    let squares: Vec<f64> = records.iter().flat_map(|r| r.changes.iter().map(|c| c * c)).collect();
    let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let equal: Vec<Linear> = records.iter().map(|r| r.of_equal_disturbances(rms)).collect();
    let lowest = |records: &[Linear]| {
        let independent = |std_s| Waiting { mean_s: wait_s, std_s, alike: 0.0 };
        let costs = spreads(wait_s)
            .into_par_iter()
            .filter_map(|s| Some(solve(records, &independent(s))?.cost));
        costs.filter(|cost| cost.is_finite()).reduce(|| f64::INFINITY, f64::min)
    };
    lowest(&equal) + NO_EVIDENCE < lowest(records)
}

/// The law with the lowest cost, with the mean wait that is given; spreads from small to large, then neighbours of the best.
fn spread(
    records: &[Linear],
    late: &Applied,
    wait_s: f64,
    step_s: f64,
    first: bool,
) -> Option<(Late, Waiting)> {
    let lowest = |spreads: Vec<f64>| {
        let tried = spreads
            .into_par_iter()
            .filter_map(|s| waiting_for(wait_s, s, is_ordered(late), step_s));
        let costs: Vec<(f64, (Late, Waiting))> =
            tried.filter_map(|law| Some((solve(records, &law.1)?.cost, law))).collect();
        costs
            .into_iter()
            .filter(|(cost, _)| cost.is_finite())
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, law)| law)
    };
    let all = || lowest(spreads(wait_s));
    let spread_s = if first { all()?.0.spread_s } else { late.values[1] };
    lowest([NEIGHBOUR.recip(), 1.0, NEIGHBOUR].into_iter().map(|by| by * spread_s).collect())
        .or_else(all)
}

fn is_ordered(late: &Applied) -> bool {
    late.values[2] >= 0.5
}

/// The waits under a law that is known.
fn waits(late: &Applied, step_s: f64) -> Option<Waiting> {
    Waiting::of(
        &Late {
            delay_s: late.values[0],
            spread_s: late.values[1],
            ordered: is_ordered(late),
            delays: Delays::Mean,
        },
        step_s,
    )
}

/// The delays where commands wait so.
fn solve(records: &[Linear], waiting: &Waiting) -> Option<Solved> {
    // Each record's own equations: for the delays alone, and for a shift of all.
    struct Own {
        target: Vec<f64>,
        shift: Vec<f64>,
        by_target: Vec<f64>,
        by_shift: Vec<f64>,
        freedom: f64,
    }
    let about = waiting.mean_s;
    let own = |r: &Linear| {
        let expected: Vec<f64> = r.delays.iter().map(|d| d - about).collect();
        let target: Vec<f64> =
            r.gram.times(&expected).iter().zip(&r.along).map(|(a, b)| a + b).collect();
        let shift = r.gram.times(&vec![1.0; r.sent.len()]);
        let mut equations = r.gram.clone();
        let logs = add_prior(&mut equations, r, waiting);
        let factor = equations.factor()?;
        let freedom = factor.log_determinant() + logs;
        Some(Own {
            by_target: factor.solve(&target),
            by_shift: factor.solve(&shift),
            target,
            shift,
            freedom,
        })
    };
    let all: Vec<Own> = records.iter().map(own).collect::<Option<_>>()?;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let trained = || all.iter().zip(records).filter(|(_, r)| r.trained);
    let (mut towards, mut precision, mut cost) = (0.0, 0.0, 0.0);
    for (own, r) in trained() {
        let times = |x: &[f64]| r.gram.times(x).iter().sum::<f64>();
        towards += own.target.iter().sum::<f64>() - times(&own.by_target);
        precision += own.shift.iter().sum::<f64>() - times(&own.by_shift);
        cost += own.freedom - dot(&own.target, &own.by_target);
    }
    if precision.is_nan() || precision <= 0.0 {
        return None;
    }
    let shift = towards / precision;
    let apart = |own: &Own| -> Vec<f64> {
        own.by_target.iter().zip(&own.by_shift).map(|(t, s)| t - shift * s).collect()
    };
    let freedom = trained().map(|(own, _)| own.freedom).sum();
    let delays = all
        .iter()
        .zip(records)
        .map(|(own, r)| in_order(r, &apart(own), about + shift, waiting))
        .collect();
    Some(Solved { cost: cost - shift * towards, mean_s: about + shift, precision, delays, freedom })
}

/// The delays closest to the found ones for which no command arrives before an earlier one. Each delay has the weight of its precision.
fn in_order(r: &Linear, apart: &[f64], mean_s: f64, waiting: &Waiting) -> Vec<f64> {
    // Pools of commands that arrive together: the weighted mean of their times, and the weight (pool adjacent violators; Ayer et al. 1955, doi:10.1214/aoms/1177728423).
    let mut pools: Vec<(f64, f64, usize)> = Vec::with_capacity(apart.len());
    for (i, d) in apart.iter().enumerate() {
        let mut pool =
            (r.sent_s[i] + (mean_s + d).max(0.0), r.gram.diagonal(i) + waiting.std_s.powi(-2), 1);
        while let Some(before) = pools.last().copied().filter(|before| before.0 > pool.0) {
            let weight = before.1 + pool.1;
            pool = ((before.0 * before.1 + pool.0 * pool.1) / weight, weight, before.2 + pool.2);
            pools.pop();
        }
        pools.push(pool);
    }
    let times = pools.iter().flat_map(|&(time_s, _, count)| std::iter::repeat_n(time_s, count));
    times.zip(&r.sent_s).map(|(time_s, sent_s)| (time_s - sent_s).max(0.0)).collect()
}

/// Correlation and variance of the innovation of each delay, given the one before.
fn steps<'r>(r: &'r Linear, waiting: &Waiting) -> impl Iterator<Item = (f64, f64)> + 'r {
    let Waiting { std_s, alike, .. } = *waiting;
    (0..r.sent.len()).map(move |i| {
        let gap = if i == 0 { f64::INFINITY } else { (r.sent[i] - r.sent[i - 1]) as f64 };
        let same = if i == 0 { 0.0 } else { alike.powf(gap) };
        (same, (std_s * r.weights[i]).powi(2) * (1.0 - same * same))
    })
}

/// Adds the precision of the delays; the log of the determinant of their covariance.
fn add_prior(equations: &mut Skyline, r: &Linear, waiting: &Waiting) -> f64 {
    let mut logs = 0.0;
    for (i, (same, variance)) in steps(r, waiting).enumerate() {
        equations.add((i, i), 1.0 / variance);
        if i > 0 {
            equations.add((i - 1, i - 1), same * same / variance);
            equations.add((i, i - 1), -same / variance);
        }
        logs += variance.ln();
    }
    logs
}

/// The distance of delays from their expectation, in twice a log-probability.
fn improbable(apart: &[f64], r: &Linear, waiting: &Waiting) -> f64 {
    let before = std::iter::once(&0.0).chain(apart);
    apart
        .iter()
        .zip(before)
        .zip(steps(r, waiting))
        .map(|((d, before), (same, variance))| (d - same * before).powi(2) / variance)
        .sum()
}

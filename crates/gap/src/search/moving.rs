//! First guesses of changes over time: delays that move, and gains and parameters that step.
//!
//! Delays start from fixed ones: the squared error of each delay of a grid is known at every time. A delay that jumps at a time minimises there the sum of the
//! best prefix and the best suffix of squared errors. This is a change-point scan with two segments (Hinkley 1970, doi:10.1093/biomet/57.1.1). A drift is the
//! straight line through the grid with the lowest error. A slower loop has a period of about twice the best fixed delay.
//!
//! Steps of other effects use the signature s: the residual e is about v·s. With separate values v before and after a time the squared error falls by (Σ
//! s·e)²/Σ s² on each side. This is a generalised likelihood ratio on the cumulated score (Basseville and Nikiforov 1993, Detection of Abrupt Changes, section
//! 2.4).
//!
//! How it can be wrong: a plant with memory smears the time over its memory length. The grid is coarse, and a signature is that of a small change. The results
//! are therefore first guesses, which are fitted and compared like all others.

use nalgebra::{DMatrix, DVector};

use super::slower_loop::nearby;
use crate::hypothesis::direction::{NEAR, between, difference, with};
use crate::hypothesis::event::{Stretch, event};
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Change, EFFECTS, Effect, Lateness, Scales, Scanned, find};
use deadtime_model::simulate::System;
use deadtime_signal::parallel;

/// Short delays of the grid, all of them, and the number of the longer ones; a delay of 0 comes in addition.
const SHORT: usize = 12;
const LONG: usize = 14;
/// Stretches of time; changes are searched at their edges.
const BINS: usize = 240;
/// A change is searched no closer than this part of the logs to their ends.
const MARGIN: f64 = 0.03;
/// The search range of its time around a first guess: the number of stretches before and after.
const EARLIER: i32 = 16;
const LATER: i32 = 6;
/// A step is tried where it reduces the squared residual of one value by this part. Chosen: 10 %, as for further causes.
const STEPS: f64 = 0.1;
/// Periods of a slower loop, in units of the best fixed delay; and so many at most, with so many phases each.
const PERIODS: [f64; 2] = [1.2, 3.2];
const TRIED: usize = 16;
const PHASES: usize = 6;
/// First guesses of a slower loop that are handed on.
const KEPT: usize = 3;
/// Periods and phases between those of whole samples that are simulated for each of these.
const BETWEEN: usize = 8;

/// The first guesses of a scan for every candidate that changes with time.
pub(crate) fn scanned(
    likelihood: &Likelihood<'_>,
    candidates: &[Applied],
    scales: &Scales,
) -> Vec<Scanned> {
    let Some(nominal) = likelihood.whitened(NO_EFFECT) else { return Vec::new() };
    let late = candidates.iter().filter(|a| a.effect.lateness() == Some(Lateness::Fixed));
    let mut all: Vec<Scanned> = late
        .flat_map(|delay| of_delay(likelihood, scales, &nominal, delay).unwrap_or_default())
        .collect();
    let steps: Vec<&Applied> = candidates
        .iter()
        .filter(|a| a.effect.changes() == Some(Change::Jump) && !moves_a_delay(a.effect))
        .collect();
    let of_step = |step: &&Applied| {
        let signed = Signed::of(likelihood, scales, &nominal, step)?;
        Some((of_step(likelihood, scales, &nominal, step, &signed), signed))
    };
    // One simulation a candidate; where each is a call, one after the other.
    let calls = steps.iter().any(|step| likelihood.calls(step));
    let found: Vec<Option<(Option<Scanned>, Signed)>> = if calls {
        steps.iter().map(of_step).collect()
    } else {
        parallel::map(steps.iter(), of_step)
    };
    let (mut alone, mut signed) = (Vec::new(), Vec::new());
    for (step, (scanned, own)) in steps.iter().zip(found).filter_map(|(s, f)| Some((*s, f?))) {
        alone.extend(scanned);
        signed.push((step, own));
    }
    for of_event in of_event(likelihood, scales, &nominal, &signed).unwrap_or_default() {
        match alone
            .iter_mut()
            .find(|s| s.effect == of_event.effect && s.channel == of_event.channel)
        {
            Some(own) => own.starts.extend(of_event.starts),
            None => alone.push(of_event),
        }
    }
    all.extend(alone);
    all
}

/// A parameter with the response to a small change of it.
struct Signed {
    plain: Applied,
    start: Vec<f64>,
    signature: Whitened,
}

impl Signed {
    fn of(
        likelihood: &Likelihood<'_>,
        scales: &Scales,
        nominal: &Whitened,
        step: &Applied,
    ) -> Option<Self> {
        let plain = plain(likelihood.system, step)?;
        let start = plain.starts(likelihood.system, scales).into_iter().next()?;
        let near = likelihood.whitened(&[with(&plain, &between(&plain, &start, NEAR))])?;
        let signature = difference(nominal, &near, 1.0 / NEAR);
        Some(Self { plain, start, signature })
    }

    /// The number after so many of these changes.
    fn at(&self, share: f64) -> Option<f64> {
        between(&self.plain, &self.start, share).first().copied()
    }
}

/// First guesses of steps of all parameters at one time, where two sets of values are worth more than one set throughout. An event of a single parameter is the
/// step of this parameter.
fn of_event(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    nominal: &Whitened,
    signed: &[(&Applied, Signed)],
) -> Option<Vec<Scanned>> {
    let count = signed.len();
    if count < 2 {
        return None;
    }
    let bin_s = scales.duration_s / BINS as f64;
    let empty = Stretch { gram: DMatrix::zeros(count, count), along: DVector::zeros(count) };
    let mut stretches = vec![empty; BINS];
    for (i, (_, a)) in signed.iter().enumerate() {
        let along = products(likelihood, &a.signature, nominal, bin_s);
        stretches.iter_mut().zip(along).for_each(|(s, v)| s.along[i] = v);
        for (j, (_, b)) in signed.iter().enumerate().skip(i) {
            let gram = products(likelihood, &a.signature, &b.signature, bin_s);
            for (s, v) in stretches.iter_mut().zip(gram) {
                (s.gram[(i, j)], s.gram[(j, i)]) = (v, v);
            }
        }
    }
    let found = event(&stretches, (MARGIN * BINS as f64).ceil() as usize)?;
    let left = likelihood.inner(nominal, nominal) - found.one;
    if found.fall <= (count as f64 * likelihood.criteria.selection_penalty).max(STEPS * left) {
        return None;
    }
    let time_s = found.stretch as f64 * bin_s;
    let guess = |(i, (step, own)): (usize, &(&Applied, Signed))| {
        let [before, behind] = [&found.shares[0], &found.shares[1]].map(|s| own.at(s[i]));
        let inside =
            |at: usize, v: f64| v.clamp(step.parameters[at].lower, step.parameters[at].upper);
        let moved = own.at(found.shares[1][i] - found.shares[0][i]);
        let nominal = own.plain.values.first().copied();
        let starts = vec![
            vec![inside(0, nominal?), time_s, inside(2, moved?)],
            vec![inside(0, before?), time_s, inside(2, behind?)],
        ];
        Some(self::found(step.effect, &step.channel, starts))
    };
    Some(signed.iter().enumerate().filter_map(guess).collect())
}

/// Guesses that only show typical values of such effects: delays of a few samples, steps as large as a first guess of the stepping parameter. Used without a
/// fit.
pub(crate) fn typical(system: &System, candidates: &[Applied], scales: &Scales) -> Vec<Scanned> {
    let few_s = (4.0 * scales.sample_time_s).min(0.5 * scales.longest_delay_s);
    let guess = |a: &Applied| {
        let (changes, delays) = (a.effect.changes(), moves_a_delay(a.effect));
        Some(match (changes, a.effect.lateness()) {
            (Some(Change::Jump), _) if delays => {
                vec![0.5 * few_s, 0.5 * scales.duration_s, 1.5 * few_s]
            }
            (Some(Change::Drift), _) if delays => {
                vec![0.5 * few_s, few_s / scales.duration_s.max(f64::MIN_POSITIVE)]
            }
            (Some(Change::Jump), _) => {
                let plain = plain(system, a)?;
                let [value] = *plain.starts(system, scales).first()?.as_slice() else {
                    return None;
                };
                vec![*plain.values.first()?, 0.5 * scales.duration_s, value]
            }
            (None, Some(Lateness::SlowerLoop)) => vec![few_s, 0.0],
            _ => return None,
        })
    };
    candidates.iter().filter_map(|a| Some(found(a.effect, &a.channel, vec![guess(a)?]))).collect()
}

fn found(effect: &dyn Effect, channel: &str, starts: Vec<Vec<f64>>) -> Scanned {
    Scanned { effect: effect.name(), channel: channel.to_owned(), starts }
}

/// Whether the changing quantity is a fixed delay.
fn moves_a_delay(effect: &dyn Effect) -> bool {
    let plain = effect.elaborates().and_then(|plain| find(plain).ok());
    effect.changes().is_some()
        && plain.is_some_and(|plain| plain.lateness() == Some(Lateness::Fixed))
}

/// The constant counterpart of a candidate that changes with time.
fn plain(system: &System, a: &Applied) -> Option<Applied> {
    Applied::nominal(system, find(a.effect.elaborates()?).ok()?, &a.channel).ok()
}

/// The lowest cost with one value of a number before a time and another behind it, where that is worth more than one value throughout.
fn of_step(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    nominal: &Whitened,
    step: &Applied,
    signed: &Signed,
) -> Option<Scanned> {
    let signature = &signed.signature;
    let bin_s = scales.duration_s / BINS as f64;
    let along = products(likelihood, signature, nominal, bin_s);
    let length = products(likelihood, signature, signature, bin_s);
    let fall = |along: f64, length: f64| if length > 0.0 { along * along / length } else { 0.0 };
    let whole = (along.iter().sum::<f64>(), length.iter().sum::<f64>());
    let (mut before, mut best) = ((0.0, 0.0), (f64::NEG_INFINITY, 0, [0.0; 2]));
    for bin in 0..BINS {
        if (MARGIN..1.0 - MARGIN).contains(&(bin as f64 / BINS as f64))
            && before.1 > 0.0
            && whole.1 - before.1 > 0.0
        {
            let behind = (whole.0 - before.0, whole.1 - before.1);
            let sum = fall(before.0, before.1) + fall(behind.0, behind.1);
            if sum > best.0 {
                best = (sum, bin, [before.0 / before.1, behind.0 / behind.1]);
            }
        }
        before = (before.0 + along[bin], before.1 + length[bin]);
    }
    let (sum, bin, shares) = best;
    // Given a larger fault of another kind, a step absorbs a little of any residual, which would count as explained noise.
    let one = fall(whole.0, whole.1);
    if sum - one
        <= likelihood
            .criteria
            .selection_penalty
            .max(STEPS * (likelihood.inner(nominal, nominal) - one))
    {
        return None;
    }
    let guess = vec![signed.at(shares[0])?, bin as f64 * bin_s, signed.at(shares[1])?];
    // Where each try is a call the first guess must do.
    let guess =
        if likelihood.calls(step) { guess } else { sharpened(likelihood, step, guess, bin_s) };
    Some(found(step.effect, &step.channel, vec![guess]))
}

/// The time of a jump refined by shifts of the jump itself. A plant with memory responds late, and the cost has local minima where the command is constant.
fn sharpened(likelihood: &Likelihood<'_>, jump: &Applied, guess: Vec<f64>, bin_s: f64) -> Vec<f64> {
    let moved = |bins: i32| {
        guess
            .iter()
            .enumerate()
            .map(|(i, v)| if i == 1 { (v + f64::from(bins) * bin_s).max(0.0) } else { *v })
            .collect::<Vec<f64>>()
    };
    let cost = |values: Vec<f64>| {
        let there = likelihood.whitened(&[with(jump, &values)])?;
        Some((likelihood.inner(&there, &there), values))
    };
    let tried = (-EARLIER..=LATER).filter_map(|bins| cost(moved(bins)));
    tried.min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| guess.clone(), |(_, values)| values)
}

/// The squared errors of a grid of delays, by stretch of time.
struct Grid {
    delays_s: Vec<f64>,
    /// Per delay and stretch.
    squares: Vec<Vec<f64>>,
    /// The length of a stretch, seconds.
    bin_s: f64,
}

/// The apparent change of an input's delay; empty where the delay is constant.
fn of_delay(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    nominal: &Whitened,
    delay: &Applied,
) -> Option<Vec<Scanned>> {
    let guesses = likelihood.first_guesses(delay, scales);
    let (short, long) = guesses.split_at(SHORT.min(guesses.len()));
    let every = long.len().div_ceil(LONG).max(1);
    // The last delay represents all longer ones.
    let chosen: Vec<f64> = short
        .iter()
        .chain(long.iter().rev().step_by(every).rev())
        .filter_map(|g| g.first().copied())
        .collect();
    let errors =
        |delay_s: &f64| Some((*delay_s, likelihood.whitened(&[with(delay, &[*delay_s])])?));
    let errors: Vec<(f64, Whitened)> = if likelihood.calls(delay) {
        chosen.iter().filter_map(errors).collect()
    } else {
        parallel::filter_map(chosen.iter(), errors)
    };
    let bin_s = scales.duration_s / BINS as f64;
    let mut grid = Grid {
        delays_s: vec![0.0],
        squares: vec![products(likelihood, nominal, nominal, bin_s)],
        bin_s,
    };
    for (delay_s, whitened) in &errors {
        grid.delays_s.push(*delay_s);
        grid.squares.push(products(likelihood, whitened, whitened, bin_s));
    }
    let sums: Vec<f64> = grid.squares.iter().map(|s| s.iter().sum()).collect();
    let best = (0..sums.len()).min_by(|&a, &b| sums[a].total_cmp(&sums[b]))?;
    let least = likelihood.criteria.selection_penalty;
    let worth = |(cost, start): (f64, Vec<f64>)| (sums[best] - cost > least).then_some(start);
    let is_late = grid.delays_s[best] > 0.0 && sums[0] - sums[best] > least;
    // Drifts of a sample over the logs, which the grid may be too coarse to show.
    let turns = [-1.0, 1.0]
        .map(|sign| vec![grid.delays_s[best], sign * scales.sample_time_s / scales.duration_s]);
    let starts = |effect: &'static dyn Effect| match (
        effect.changes().filter(|_| moves_a_delay(effect)),
        effect.lateness(),
    ) {
        (Some(Change::Jump), _) => grid.jump().and_then(worth).into_iter().collect(),
        (Some(Change::Drift), _) => grid
            .drift()
            .and_then(worth)
            .into_iter()
            .chain(turns.clone().into_iter().filter(|_| is_late))
            .collect(),
        // A slower loop is late on average: where no fixed delay helps it is none.
        (None, Some(Lateness::SlowerLoop)) if is_late => {
            match Applied::nominal(likelihood.system, effect, &delay.channel) {
                Ok(applied) => slower(likelihood, scales, nominal, &applied, grid.delays_s[best]),
                Err(_) => Vec::new(),
            }
        }
        _ => Vec::new(),
    };
    Some(
        EFFECTS
            .iter()
            .map(|effect| found(*effect, &delay.channel, starts(*effect)))
            .filter(|s| !s.starts.is_empty())
            .collect(),
    )
}

/// Products of two whitened residuals summed by stretch of time, all training records together.
fn products(likelihood: &Likelihood<'_>, a: &Whitened, b: &Whitened, bin_s: f64) -> Vec<f64> {
    let mut bins = vec![0.0; BINS];
    for (record, (a, b)) in likelihood.records.iter().zip(a.iter().zip(b)) {
        let samples = record.time_s.len();
        for (at, (a, b)) in a.iter().zip(b.iter()).enumerate() {
            let bin = (record.time_s[at % samples] / bin_s) as usize;
            bins[bin.min(BINS - 1)] += a * b;
        }
    }
    bins
}

impl Grid {
    /// The lowest cost with one delay before a time and one behind it, and both with the time.
    fn jump(&self) -> Option<(f64, Vec<f64>)> {
        let whole: Vec<f64> = self.squares.iter().map(|s| s.iter().sum()).collect();
        let mut before = vec![0.0; self.squares.len()];
        let mut best: Option<(f64, Vec<f64>)> = None;
        for bin in 0..BINS {
            let place = bin as f64 / BINS as f64;
            if (MARGIN..1.0 - MARGIN).contains(&place) {
                let lowest = |cost: &dyn Fn(usize) -> f64| {
                    (0..before.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b)))
                };
                let (behind, first) = (|d: usize| whole[d] - before[d], lowest(&|d| before[d])?);
                let second = lowest(&behind)?;
                let cost = before[first] + behind(second);
                if first != second && best.as_ref().is_none_or(|(lowest, _)| cost < *lowest) {
                    best = Some((
                        cost,
                        vec![self.delays_s[first], bin as f64 * self.bin_s, self.delays_s[second]],
                    ));
                }
            }
            for (sum, squares) in before.iter_mut().zip(&self.squares) {
                *sum += squares[bin];
            }
        }
        best
    }

    /// The lowest cost along a straight line from one delay to another, and the delay at the start with its rate.
    fn drift(&self) -> Option<(f64, Vec<f64>)> {
        let nearest = |delay_s: f64| {
            let above =
                self.delays_s.partition_point(|d| *d < delay_s).min(self.delays_s.len() - 1);
            let below = above.saturating_sub(1);
            if delay_s - self.delays_s[below] < self.delays_s[above] - delay_s {
                below
            } else {
                above
            }
        };
        let last_s = self.bin_s * BINS as f64;
        let along = |(from, to): (f64, f64)| {
            let at = |bin: usize| from + (to - from) * (bin as f64 + 0.5) / BINS as f64;
            let cost = (0..BINS).map(|bin| self.squares[nearest(at(bin))][bin]).sum::<f64>();
            (cost, vec![from, (to - from) / last_s])
        };
        let ends = self
            .delays_s
            .iter()
            .flat_map(|&from| self.delays_s.iter().map(move |&to| (from, to)))
            .filter(|(from, to)| from != to);
        ends.map(along).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// The best periods and phases of a slower loop that is as late on average as a fixed delay.
///
/// Whole samples of period and a few phases are simulated. A period between them looks near any time like its neighbour with another phase, so
/// the squared errors by stretch of time give the cost of all periods that the logs' length resolves. The best of these are simulated.
fn slower(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    nominal: &Whitened,
    applied: &Applied,
    delay_s: f64,
) -> Vec<Vec<f64>> {
    let cost = likelihood.inner(nominal, nominal);
    let (step_s, duration_s) = (scales.sample_time_s, scales.duration_s);
    let bin_s = duration_s / BINS as f64;
    let [shortest, longest] = PERIODS.map(|times| (times * delay_s / step_s).round() as usize);
    let periods: Vec<usize> = (shortest.max(2)..=longest.max(4)).collect();
    let (tried, phases) =
        if likelihood.calls(applied) { (TRIED / 4, PHASES / 3) } else { (TRIED, PHASES) };
    let every = periods.len().div_ceil(tried).max(1);
    let by_stretch = |guess: &[f64; 2]| {
        let there = likelihood.whitened(&[with(applied, guess)])?;
        Some(products(likelihood, &there, &there, bin_s))
    };
    let of_all = |guesses: &[[f64; 2]]| -> Vec<Option<Vec<f64>>> {
        if likelihood.calls(applied) {
            guesses.iter().map(by_stretch).collect()
        } else {
            parallel::map(guesses.iter(), by_stretch)
        }
    };
    let between = |samples: usize| {
        let period_s = samples as f64 * step_s;
        let squares = of_all(&with_phases(period_s, phases)).into_iter().collect::<Option<_>>()?;
        Some(Lattice { period_s, squares, bin_s }.between(0.5 * every as f64 * step_s))
    };
    let mut costs: Vec<(f64, [f64; 2])> =
        periods.into_iter().step_by(every).filter_map(between).flatten().collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best: Vec<[f64; 2]> = costs.into_iter().take(BETWEEN * KEPT).map(|c| c.1).collect();
    let mut gains: Vec<(f64, [f64; 2])> = of_all(&best)
        .into_iter()
        .zip(&best)
        .filter_map(|(squares, guess)| Some((cost - squares?.iter().sum::<f64>(), *guess)))
        .filter(|(gain, _)| *gain > likelihood.criteria.selection_penalty)
        .collect();
    gains.sort_by(|a, b| b.0.total_cmp(&a.0));
    let near = |guess: [f64; 2]| {
        nearby(likelihood, applied, &guess, 0.5 * guess[0] / phases as f64, scales).values
    };
    gains.into_iter().take(KEPT).map(|(_, guess)| near(guess)).collect()
}

/// The squared errors of a slower loop of one period at equally spaced phases, by stretch of time.
struct Lattice {
    period_s: f64,
    /// Per phase and stretch; phase number n is (n + 1/2)/count of the period.
    squares: Vec<Vec<f64>>,
    /// The length of a stretch, seconds.
    bin_s: f64,
}

impl Lattice {
    /// Approximate costs of the periods up to `reach_s` away at the same phases. The passing times of neighbours differ by 25 % of a period at most
    /// over the logs. Within a stretch the phase moves by 25 % of a period at most, or the neighbour is another one there: the stretches bound the steps.
    fn between(&self, reach_s: f64) -> Vec<(f64, [f64; 2])> {
        let (phases, bins) = (self.squares.len(), self.squares[0].len());
        let duration_s = self.bin_s * bins as f64;
        let fine_s = 0.25 * self.period_s * self.period_s / duration_s;
        let steps = (reach_s / fine_s).floor().min(bins as f64) as i32;
        (-steps..=steps)
            .flat_map(|step| with_phases(self.period_s + f64::from(step) * fine_s, phases))
            .map(|[period_s, phase_s]| {
                let of_bin = |bin: usize| {
                    // The phase that passes commands last at the same time.
                    let middle_s = (bin as f64 + 0.5) * self.bin_s;
                    let age_s = (middle_s - phase_s).rem_euclid(period_s);
                    let phase = (middle_s - age_s).rem_euclid(self.period_s) / self.period_s;
                    self.squares[((phase * phases as f64) as usize).min(phases - 1)][bin]
                };
                ((0..bins).map(of_bin).sum(), [period_s, phase_s])
            })
            .collect()
    }
}

/// A period with equally spaced phases.
fn with_phases(period_s: f64, count: usize) -> Vec<[f64; 2]> {
    (0..count).map(|at| [period_s, (at as f64 + 0.5) / count as f64 * period_s]).collect()
}

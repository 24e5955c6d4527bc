//! The linear equations of the random delays of commands, and their solution for one law.
//!
//! How it can be wrong: the equations hold near the delays about which they are made; [`arrivals`](super::arrivals) simulates every solution exactly.

use nalgebra::DMatrix;

use super::queue::Waiting;
use super::response::static_value;
use super::skyline::Skyline;
use crate::input::record::LogRecord;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Chance, Fates};

/// The step of derivatives by differences, of the logarithm of the delays' variance.
const STEP: f64 = 0.1;
/// A command that changes by less than this part of the largest change decides nothing.
const CHANGES: f64 = 1e-6;

/// The equations of one record's delays, about those that are assumed now.
#[derive(Clone)]
pub(super) struct Linear {
    /// Samples of the commands that change.
    pub(super) sent: Vec<usize>,
    /// When they were sent, seconds.
    sent_s: Vec<f64>,
    /// Their delays now, seconds.
    pub(super) delays: Vec<f64>,
    /// The size of each change.
    pub(super) changes: Vec<f64>,
    /// Per command, the standard deviation of its delay over that of all; 1 for delays of one distribution.
    weights: Vec<f64>,
    /// GᵀG.
    gram: Skyline,
    /// Gᵀe.
    along: Vec<f64>,
    pub(super) trained: bool,
}

impl Linear {
    /// The same equations for disturbances of equal size: the delay of a small change varies more.
    pub(super) fn of_equal_disturbances(&self, rms: f64) -> Self {
        let weights = self.changes.iter().map(|c| rms / c).collect();
        Self { weights, ..self.clone() }
    }
}

/// The solution of the equations for one spread.
pub(super) struct Solved {
    /// Twice the negative log of the marginal likelihood, but for a constant.
    pub(super) cost: f64,
    /// The mean of all delays, seconds, and the precision of that.
    pub(super) mean_s: f64,
    pub(super) precision: f64,
    /// Per record the delays, seconds.
    pub(super) delays: Vec<Vec<f64>>,
    /// The price of the freedom of the delays, twice a negative log-probability.
    pub(super) freedom: f64,
}

impl Linear {
    /// Delays of all samples. A command that changes nothing arrives with the one before it; commands after the last timely arrival have its delay.
    pub(super) fn of_all(&self, delays: &[f64], time_s: &[f64]) -> Vec<f64> {
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

/// The information of the outputs on delays.
pub(super) struct Information {
    /// The effective number of parameters of the delays in the noise of the training logs: tr S = d ln det(1 + KGᵀG)/d ln s². K is the delays' covariance, s
    /// their spread, and S the map from the outputs to their explained part.
    pub(super) noise: f64,
    /// The number of independent delays with the same information on the spread: tr S² = tr S − d tr S/d ln s². The number is twice Fisher's information on ln s².
    pub(super) spread: f64,
}

/// By differences of the determinant.
pub(super) fn information(records: &[Linear], waiting: &Waiting) -> Option<Information> {
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

/// The equations of one record about the delays that are at work.
pub(super) fn linear(
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
    let pulses = pulses(record, &through, delays, &e, g);
    let first = (pulses.iter())
        .map(|pulse| pulses.partition_point(|other| other.from + g.nrows() < pulse.from))
        .collect();
    let gram = Skyline::new(first, |i, j| pulses[i].overlap(&pulses[j]));
    Some(Linear {
        sent: pulses.iter().map(|pulse| pulse.sent).collect(),
        sent_s: pulses.iter().map(|pulse| record.time_s[pulse.sent]).collect(),
        delays: pulses.iter().map(|pulse| pulse.delay_s).collect(),
        changes: pulses.iter().map(|pulse| pulse.change).collect(),
        weights: vec![1.0; pulses.len()],
        along: pulses.iter().map(|pulse| pulse.along(&e)).collect(),
        gram,
        trained: record.train.is_some(),
    })
}

/// The response of the whitened outputs to a longer delay of one command, per second.
struct Pulse {
    /// The sample of the command.
    sent: usize,
    /// Its delay now, seconds.
    delay_s: f64,
    /// The size of its change.
    change: f64,
    /// The sample at which the response begins.
    from: usize,
    response: DMatrix<f64>,
}

impl Pulse {
    /// The inner product with an earlier response, at the samples that both have.
    fn overlap(&self, earlier: &Self) -> f64 {
        let later = self.from - earlier.from;
        (0..self.response.ncols())
            .map(|o| {
                let (a, b) = (self.response.column(o), earlier.response.column(o));
                a.as_slice().iter().zip(&b.as_slice()[later..]).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    }

    /// The inner product with a whitened residual.
    fn along(&self, e: &DMatrix<f64>) -> f64 {
        let rows = (e.nrows() - self.from).min(self.response.nrows());
        (0..e.ncols())
            .map(|o| (0..rows).map(|n| self.response[(n, o)] * e[(self.from + n, o)]).sum::<f64>())
            .sum()
    }
}

/// The responses to the delays of all commands that change and arrive within the record; `through`: the commands behind the maps.
fn pulses(
    record: &LogRecord,
    through: &[f64],
    delays: &[f64],
    e: &DMatrix<f64>,
    g: &DMatrix<f64>,
) -> Vec<Pulse> {
    let changes: Vec<f64> = through.windows(2).map(|w| w[1] - w[0]).collect();
    let largest = changes.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
    let samples = e.nrows();
    let step_s = record.sample_time_s;
    // Rows without a measurement, or outside the span, are exactly 0.
    let there: Vec<bool> = (0..samples).map(|k| e.row(k).iter().any(|v| *v != 0.0)).collect();
    let mut pulses = Vec::new();
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
        pulses.push(Pulse {
            sent: k,
            delay_s: latest_s - record.time_s[k],
            change: change.abs(),
            from,
            response: shifted(g, -change / step_s, part, &there[from..]),
        });
    }
    pulses
}

/// A response times a factor, later by a part of a sample; 0 in rows that are not `there`.
fn shifted(g: &DMatrix<f64>, factor: f64, part: f64, there: &[bool]) -> DMatrix<f64> {
    let (length, outputs) = g.shape();
    let mut response = DMatrix::zeros(length + 1, outputs);
    for n in (0..=length).filter(|n| there.get(*n).copied().unwrap_or(false)) {
        for i in 0..outputs {
            let now = if n < length { g[(n, i)] } else { 0.0 };
            let before = if n > 0 { g[(n - 1, i)] } else { 0.0 };
            response[(n, i)] = factor * ((1.0 - part) * now + part * before);
        }
    }
    response
}

/// The delays where commands wait so.
pub(super) fn solve(records: &[Linear], waiting: &Waiting) -> Option<Solved> {
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
pub(super) fn improbable(apart: &[f64], r: &Linear, waiting: &Waiting) -> f64 {
    let before = std::iter::once(&0.0).chain(apart);
    apart
        .iter()
        .zip(before)
        .zip(steps(r, waiting))
        .map(|((d, before), (same, variance))| (d - same * before).powi(2) / variance)
        .sum()
}

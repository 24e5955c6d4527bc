//! Feedback that a record shows of itself, and the part of its input that the output did not cause.

use std::borrow::Cow;

use statrs::function::beta::checked_beta_reg;

use super::ahead::ahead;
use super::finding::Finding;
use super::method::Condition;
use crate::posterior::ARX_ORDERS;
use deadtime_identify::{Record, Regression};

/// Coefficients of the response that noise colour and feedback are judged beyond; as many as the threshold methods estimate.
const LAGS: usize = 71;
/// Input samples after the output's that open-loop data have no use for.
const FUTURE: usize = 5;
/// Share of the innovations' variance that later inputs explain in a record with feedback: a plant that is not quite linear reaches a few hundredths with smooth inputs.
const FEEDS_BACK: f64 = 0.03;
/// Share of what a causal free response leaves that later inputs explain, where the innovations show them too: what an open-loop model takes for response.
const ACAUSAL: f64 = 0.1;
/// The same for an input that is held for several samples, whose changes are seldom news.
const ACAUSAL_HELD: f64 = 0.03;
/// Share of the output's innovations that a direct path must explain.
const DIRECT: f64 = 0.005;
/// Share of the output's innovations that goes with those of the input of the same sample.
const SAME_SAMPLE: f64 = 0.015;
/// Standard deviations by which what follows must stand out, summed over so many lags, for its sign to say anything.
const FOLLOWS: f64 = 3.5;
/// Lags over which the response is summed.
const SUMS: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// The probability of later inputs by chance where both channels go together within the sample.
const ALSO: f64 = 1e-3;
/// The probability that as much is explained by chance.
const BY_CHANCE: f64 = 1e-4;
/// The same where the share of the innovations is small: in a long record a bend of the plant is significant too.
const HARDLY: f64 = 1e-7;
/// Past inputs and past outputs, the present one among the latter, that hold any PID controller with a filter and a sample of lateness.
const CONTROLLER: (usize, usize) = (4, 7);
/// Share of the input's increments that a function of the output leaves unexplained, for nothing else to move the input.
const TIED: f64 = 1e-9;
/// Share that the input's own past must leave, for its being explained to say anything: what is smooth enough is a function of its own past.
const NEWS: f64 = 1e-3;
/// Share of the samples at which the output moves and the input does not, from which the input is no linear function of the output. One of four levels at random repeats as often.
const RESTS: f64 = 0.25;
/// Past samples of both channels from which the input is predicted before what is new in it is taken.
const MEMORY: usize = 20;
/// Share of the input's variance that what is new in it must explain for the joint method.
const OWN_SHARE: f64 = 0.02;

/// What a record shows of a loop around it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InLoop {
    /// Share of the output's innovations that later inputs explain, where they do.
    pub later: Option<f64>,
    /// Correlation of the innovations of both channels within a sample, where the plant cannot be the cause.
    pub same_sample: Option<f64>,
    /// The input is a function of the output and nothing else moves it: plant and dead time are unidentifiable.
    pub tied: bool,
    /// The output moves before the input, and no controller is the cause: it was smoothed both ways, or its clock is ahead.
    pub ahead: bool,
    /// The output reacts to the input within the sample, and nothing shows that the input reacts to the output.
    pub direct: bool,
}

impl InLoop {
    /// The input depends on the output.
    #[must_use]
    pub fn closed(&self) -> bool {
        self.later.is_some() || self.same_sample.is_some() || self.tied
    }

    /// The evidence as a finding.
    #[must_use]
    pub fn finding(&self) -> Option<Finding> {
        let mut evidence = Vec::new();
        if self.tied {
            evidence.push("the input is a function of the output alone".to_owned());
        }
        if let Some(share) = self.later {
            evidence.push(format!(
                "later inputs explain {:.1} % of the output's innovations",
                100.0 * share
            ));
        }
        if let Some(correlation) = self.same_sample {
            evidence.push(format!("innovations of both go together within the sample by {correlation:.2}, and the plant is not the cause"));
        }
        (!evidence.is_empty()).then(|| Finding {
            condition: Condition::Feedback,
            evidence: evidence.join("; ").into(),
        })
    }
}

/// Looks for a loop in the records of a pair whose plant needs `bias` samples to respond.
///
/// * Later inputs explain innovations of the output by a share that matters, there or in the residual of the free response; and earlier outputs predict the input beyond
///   its own past (Granger, 1969). The former is the causality test with the input's future (Sims, 1972, Am. Econ. Rev. 62(4), 540-552), which stays valid for inputs that
///   are no random process. A plant that is not linear fails the first test alone, an input with a long memory the second alone.
/// * Where the plant cannot react within the sample (`bias` of 1 or more), the innovations of both channels are correlated within it, with the sign opposite to the
///   response's: the controller reacts. With the response's sign and no later input that explains anything it is a direct path. It is a direct path, whatever its sign, where
///   the input is autonomous: it rests while the output moves, and earlier outputs do not predict it, or nothing predicts it and the
///   output has a memory.
/// * Where the response begins smoothly before its command (`ahead`), the output moves before it, and nothing is said of a loop.
/// * A low-order function of the output explains every increment of the input but for rounding, and the input's own past does not: nothing else moves the input.
///
/// How it can be wrong: a plant that is far from linear passes for a loop where its input is smooth. A loop whose noise moves the input by a few hundredths of its
/// variance passes for open; its bias is then small. A controller with more memory than a PID is not recognised as the only source of the input. A record that is too
/// short shows nothing.
#[must_use]
pub fn in_loop(records: &[Record<'_>], max_delay: usize, bias: usize) -> InLoop {
    let [na, _] = ARX_ORDERS;
    let lags = lags(records, max_delay).max(na + 2);
    let (later, chance) = later(records, na, lags).unwrap_or((None, 1.0));
    let ahead = ahead(records, na, lags);
    // What bends the response passes for a loop in one direction of the test only.
    let asked = later.is_some() || chance < ALSO || ahead;
    let reacts = if asked { reacts(records, na, lags) } else { 1.0 };
    if ahead && reacts < BY_CHANCE && !tied(records, bias) {
        return InLoop { ahead, ..InLoop::default() };
    }
    let (later, chance) = (later.filter(|_| reacts < BY_CHANCE), chance.max(reacts));
    let autonomous = later.is_none() && autonomous(records, na);
    let mut seen = InLoop { later, tied: !autonomous && tied(records, bias), ..InLoop::default() };
    if bias > 0
        && let Some(same) = same_sample(records, na, lags)
    {
        let matters = same.correlation.powi(2) > SAME_SAMPLE;
        let reacts = !autonomous && (same.against || chance < ALSO || seen.tied);
        seen.same_sample = (matters && reacts).then_some(same.correlation);
        seen.direct = (same.along || (autonomous && matters)) && !seen.closed();
    }
    seen
}

/// Share of the output's power that its own past must predict where nothing predicts the input: a controller within the sample would make the input as predictable.
const PREDICTABLE: f64 = 0.1;

/// Neither its own past nor earlier outputs predict the input, while its past predicts the output: what has no memory is no function of what has.
fn unpredictable(records: &[Record<'_>], na: usize) -> bool {
    let long = || records.iter().filter(|r| r.len() > 4 * na);
    let turned: Vec<Record<'_>> =
        long().map(|r| Record::new(&r.y[..r.len() - 1], &r.u[1..r.len()])).collect();
    let power = |x: &[f64]| x.iter().skip(na).map(|v| v * v).sum::<f64>();
    let [inputs, outputs] =
        [turned.iter().map(|r| power(&r.y)).sum::<f64>(), long().map(|r| power(&r.y)).sum::<f64>()];
    let both = residual(Regression { na, lags: na }, &turned);
    let own: Vec<Record<'_>> = long().map(|r| r.head(r.len())).collect();
    let own = residual(Regression { na, lags: 0 }, &own);
    both.zip(own).is_some_and(|((both, rows), (own, _))| {
        explained(inputs, both, 2 * na, rows.saturating_sub(2 * na)).1 >= BY_CHANCE
            && own < (1.0 - PREDICTABLE) * outputs
    })
}

/// The input is no function of the output, linear or not: it rests while the output moves, and earlier outputs do not predict it beyond its own past, or nothing predicts it.
fn autonomous(records: &[Record<'_>], na: usize) -> bool {
    if records.iter().any(|r| r.present.is_some()) || held_for(records) > 1 {
        return false;
    }
    if unpredictable(records, na) {
        return true;
    }
    if !rests(records) {
        return false;
    }
    // The output takes the input's place, a sample earlier.
    let turned: Vec<Record<'_>> = (records.iter().filter(|r| r.len() > 4 * na))
        .map(|r| Record::new(&r.y[..r.len() - 1], &r.u[1..r.len()]))
        .collect();
    let own = residual(Regression { na, lags: 0 }, &turned);
    let both = residual(Regression { na, lags: na }, &turned);
    own.zip(both).is_some_and(|((own, rows), (both, _))| {
        explained(own, both, na, rows.saturating_sub(2 * na)).1 >= BY_CHANCE
    })
}

/// The input often rests while the output moves: it is of levels, as a command is, and no sensor's signal.
pub(super) fn rests(records: &[Record<'_>]) -> bool {
    let (mut rests, mut moves) = (0, 0);
    for record in records {
        for (u, _) in record.u.windows(2).zip(record.y.windows(2)).filter(|(_, y)| y[0] != y[1]) {
            moves += 1;
            rests += usize::from(u[0] == u[1]);
        }
    }
    rests as f64 >= RESTS * moves as f64
}

/// The probability that earlier outputs predict the input by chance as well as they do beyond its own past: small where the input reacts to them, whatever the plant.
///
/// Source: Granger (1969), Econometrica 37(3), 424-438, doi:10.2307/1912791.
fn reacts(records: &[Record<'_>], na: usize, lags: usize) -> f64 {
    // The output takes the input's place, a sample earlier.
    let turned: Vec<Record<'_>> = (records.iter().filter(|r| r.len() > 2 * lags))
        .flat_map(|r| r.stretches(2 * lags))
        .map(|r| Record::new(r.y[..r.len() - 1].to_vec(), r.u[1..].to_vec()))
        .collect();
    let own = residual(Regression { na: lags, lags: 0 }, &turned);
    let both = residual(Regression { na: lags, lags: na }, &turned);
    own.zip(both).map_or(0.0, |((own, _), (both, rows))| {
        explained(own, both, na, rows.saturating_sub(lags + na)).1
    })
}

/// Lags that a record of this length can carry.
pub(super) fn lags(records: &[Record<'_>], max_delay: usize) -> usize {
    let samples: usize = records.iter().map(Record::len).sum();
    LAGS.max(max_delay + 1).min(samples / 6)
}

/// What a residual of exact arithmetic may leave by rounding, as a part of what it is the residual of: a command of a few steps is known exactly from its past, and the
/// ratio of two roundings says nothing. The factorisation's own error is some 1e-15 of the amplitude for each of a hundred columns.
const ROUNDING: f64 = 1e-26;

/// Σ e² and rows of a regression over all its columns; nothing below rounding.
pub(super) fn residual(regression: Regression, records: &[Record<'_>]) -> Option<(f64, usize)> {
    let triangle = regression.factor(records);
    let last = regression.columns();
    let whole: f64 = (0..=last).map(|i| triangle.r[(i, last)].powi(2)).sum();
    (triangle.rows > 2 * last)
        .then(|| (triangle.r[(last, last)].powi(2).max(ROUNDING * whole), triangle.rows))
}

/// The share of the residual that goes with `more` columns, and the probability that chance explains as much.
pub(super) fn explained(without: f64, with: f64, more: usize, freedom: usize) -> (f64, f64) {
    let left = (with / without.max(f64::MIN_POSITIVE)).min(1.0);
    // The tail of Fisher's F as an incomplete beta function of the residual's share, which is defined for a residual of zero, too.
    (1.0 - left, checked_beta_reg(0.5 * freedom as f64, 0.5 * more as f64, left).unwrap_or(1.0))
}

/// The share of the output's innovations that later inputs explain, if that says anything, and the probability that chance explains as much.
fn later(records: &[Record<'_>], na: usize, lags: usize) -> Option<(Option<f64>, f64)> {
    let long: Vec<&Record<'_>> = records.iter().filter(|r| r.len() > 2 * FUTURE + lags).collect();
    // The same rows: with the input advanced by FUTURE samples the first of its lags lie after the output.
    let with: Vec<Record<'_>> = long.iter().map(|r| r.part(FUTURE, 0, r.len() - FUTURE)).collect();
    let without: Vec<Record<'_>> =
        long.iter().map(|r| r.part(FUTURE, FUTURE, r.len() - 2 * FUTURE)).collect();
    let by = |na: usize| {
        let (more, rows) = residual(Regression { na, lags: lags + FUTURE }, &with)?;
        let (less, _) = residual(Regression { na, lags }, &without)?;
        Some(explained(less, more, FUTURE, rows - na - lags - FUTURE))
    };
    let (share, chance) = by(na)?;
    let least = if held_for(records) > 1 { ACAUSAL_HELD } else { ACAUSAL };
    let small = || chance < HARDLY && by(0).is_some_and(|(level, _)| level > least);
    Some(((chance < BY_CHANCE && (share > FEEDS_BACK || small())).then_some(share), chance))
}

/// That the innovations of both channels go together within the sample.
struct SameSample {
    correlation: f64,
    /// The response at lag 0 goes against what follows.
    against: bool,
    /// It goes with it.
    along: bool,
}

/// Whether the innovations of both channels go together within the sample by more than chance.
fn same_sample(records: &[Record<'_>], na: usize, lags: usize) -> Option<SameSample> {
    let with = Regression { na, lags };
    let triangle = with.factor(records);
    let (last, rows) = (with.columns(), triangle.rows);
    if rows <= 2 * last {
        return None;
    }
    let later: Vec<Record<'_>> =
        records.iter().filter(|r| r.len() > lags).map(|r| r.ahead(1)).collect();
    let (less, _) = residual(Regression { na, lags: lags - 1 }, &later)?;
    let (share, chance) = explained(less, triangle.r[(last, last)].powi(2), 1, rows - na - lags);
    let solution = triangle.solve()?;
    let coefficients: Vec<f64> = solution.coefficients.iter().copied().collect();
    let (past, input) = coefficients.split_at(na);
    // The response to the input, and that of noise to its innovations, whose squares widen what is known of a coefficient.
    let (mut response, mut noise): (Vec<f64>, Vec<f64>) =
        (Vec::with_capacity(lags), Vec::with_capacity(lags));
    for (k, b) in input.iter().enumerate() {
        let before =
            |x: &[f64]| past.iter().take(k).enumerate().map(|(i, a)| a * x[k - 1 - i]).sum::<f64>();
        let (next, echo) = (b + before(&response), if k == 0 { 1.0 } else { before(&noise) });
        response.push(next);
        noise.push(echo);
    }
    let first = *response.first()?;
    let std = (solution.variance * solution.inverse[(na, na)]).sqrt();
    let mut follows = 0.0_f64;
    for count in SUMS.into_iter().filter(|c| *c < lags) {
        let sum: f64 = response[1..=count].iter().sum();
        let (mut step, mut squares) = (0.0, 0.0);
        for echo in &noise[..count] {
            step += echo;
            squares += f64::powi(step, 2);
        }
        let score = sum / (std * squares.sqrt()).max(f64::MIN_POSITIVE);
        if score.abs() > follows.abs() && score.is_finite() {
            follows = score;
        }
    }
    let correlation = first.signum() * share.max(0.0).sqrt();
    let sure = chance < BY_CHANCE && share > DIRECT && correlation.is_finite();
    let clear = follows.abs() > FOLLOWS;
    sure.then_some(SameSample {
        correlation,
        against: clear && first * follows < 0.0,
        along: clear && first * follows > 0.0,
    })
}

/// Nothing but the output moves the input.
fn tied(records: &[Record<'_>], bias: usize) -> bool {
    let (own, outputs) = CONTROLLER;
    let increments = |x: &[f64]| -> Vec<f64> { x.windows(2).map(|w| w[1] - w[0]).collect() };
    // The output takes the input's place. A constant set point falls out of increments.
    let turned: Vec<Record<'static>> = (records.iter())
        .flat_map(|r| r.stretches(4 * (own + outputs)))
        .map(|r| {
            let (u, mut y) = (increments(&r.u), increments(&r.y));
            if bias == 0 {
                // What reacts within the sample may be the plant.
                y.rotate_right(1);
                return Record::new(y[1..].to_vec(), u[1..].to_vec());
            }
            Record::new(y, u)
        })
        .collect();
    let total: f64 = turned.iter().flat_map(|r| r.y.iter()).map(|v| v * v).sum();
    let past = residual(Regression { na: own, lags: 0 }, &turned);
    let all = residual(Regression { na: own, lags: outputs }, &turned);
    past.zip(all).is_some_and(|((past, _), (all, _))| {
        total > 0.0 && past > NEWS * total && all < TIED * total
    })
}

/// The records with the open-loop part of the input in its place; `None` where there is too little of it or samples are missing.
///
/// The innovation of the input given the past of both channels is independent of all that disturbs the output. Where the plant cannot react within the sample, the
/// output of the same sample is given, too. The input's response to its innovation is the input without disturbances: from it to the output the plant is as in open loop.
///
/// Source: Van den Hof and Schrama (1993), Automatica 29(6), 1523-1527, doi:10.1016/0005-1098(93)90015-L, with the innovation of the joint process instead of a measured
/// reference; Caines and Chan (1975), IEEE Trans. Autom. Control 20(4), 498-508, doi:10.1109/TAC.1975.1101008, for that innovation.
/// Fails when: the reference is a function of its own past (nothing is new), the controller depends on more than 20 past samples and its own output, or does not react linearly.
#[must_use]
pub fn open_part(
    records: &[Record<'_>],
    max_delay: usize,
    bias: usize,
) -> Option<Vec<Record<'static>>> {
    if records.iter().any(|r| r.present.is_some()) {
        return None;
    }
    let lags = lags(records, max_delay);
    let samples: usize = records.iter().map(Record::len).sum();
    let memory = MEMORY.min(samples / 20).max(1);
    // The output takes the input's place; its present sample explains the input only where the plant cannot be the cause.
    let skip = usize::from(bias == 0);
    let turned: Vec<Record<'_>> = (records.iter().filter(|r| r.len() > memory + lags + 1))
        .map(|r| Record {
            u: Cow::Borrowed(&r.y[..r.len() - skip]),
            y: Cow::Borrowed(&r.u[skip..]),
            present: None,
        })
        .collect();
    let joint = Regression { na: memory, lags: memory + 1 };
    let coefficients = joint.factor(&turned).solve()?.coefficients;
    let news: Vec<Record<'static>> = (turned.iter())
        .map(|r| {
            let from = joint.first_row();
            let new = |t: usize| {
                let own: f64 = (0..memory).map(|i| coefficients[i] * r.y[t - 1 - i]).sum();
                let other: f64 = (0..=memory).map(|j| coefficients[memory + j] * r.u[t - j]).sum();
                r.y[t] - own - other
            };
            Record::new((from..r.len()).map(new).collect::<Vec<f64>>(), r.y[from..].to_vec())
        })
        .collect();
    let response = Regression { na: 0, lags }.factor(&news).solve()?.coefficients;
    let (mut part, mut whole) = (0.0, 0.0);
    let mut open = Vec::with_capacity(news.len());
    let long = records.iter().filter(|r| r.len() > memory + lags + 1);
    for (record, new) in long.zip(&news) {
        let of = |t: usize| -> f64 {
            response.iter().take(t + 1).enumerate().map(|(j, h)| h * new.u[t - j]).sum()
        };
        let u: Vec<f64> = (0..new.len()).map(of).collect();
        part += u.iter().map(|v| v * v).sum::<f64>();
        whole += new.y.iter().map(|v| v * v).sum::<f64>();
        open.push(Record::new(u, record.y[record.len() - new.len()..].to_vec()));
    }
    (part > OWN_SHARE * whole && part.is_finite()).then_some(open)
}

/// How many samples the input is held for throughout, where it is and the output moves meanwhile: it was logged, or given, more seldom than the output.
#[must_use]
pub fn held_for(records: &[Record<'_>]) -> usize {
    let mut waits: Vec<usize> = Vec::new();
    let (mut moved, mut pairs) = (0, 0);
    for record in records {
        let changes: Vec<usize> =
            (1..record.len()).filter(|t| record.u[*t] != record.u[*t - 1]).collect();
        waits.extend(changes.windows(2).map(|w| w[1] - w[0]));
        moved += record.y.windows(2).filter(|w| w[0] != w[1]).count();
        pairs += record.len().saturating_sub(1);
    }
    if waits.len() < MANY || 10 * moved < 9 * pairs {
        return 1;
    }
    waits.sort_unstable();
    let (low, high) = (waits[waits.len() / 20], waits[waits.len() - 1 - waits.len() / 20]);
    // A binary signal waits for any multiple of its clock; a clock of its own falls between samples.
    if low >= 2 && high < 2 * low { waits[waits.len() / 2] } else { 1 }
}

/// Changes of an input from which its waits say something.
const MANY: usize = 50;

/// How much less later inputs must leave of the output than present and past ones, for the output to lead.
const LEADS: f64 = 1.25;
/// What later inputs may leave of it then.
const LEFT: f64 = 0.7;

/// By how many samples the output leads the input, where what the input does later explains the output better than what it did before.
///
/// Free responses over the search window to either side; the lag is that of the largest cross-correlation. A loop whose noise moves the input more than its reference
/// looks alike, but there past inputs help to predict the output, unless the input is a response that was smoothed both ways (`ahead`); where the channels may be two copies (`bias` of 0) that says nothing, as an echo does the same.
#[must_use]
pub fn lead(records: &[Record<'_>], max_delay: usize, bias: usize) -> Option<usize> {
    let samples: usize = records.iter().map(Record::len).sum();
    let window = max_delay.min(samples / 8);
    let long = || records.iter().filter(|r| r.len() > 3 * window);
    let before: Vec<Record<'_>> = long().map(|r| r.part(0, 0, r.len() - window)).collect();
    let after: Vec<Record<'_>> = long().map(|r| r.part(window, 0, r.len() - window)).collect();
    let all: f64 = before.iter().flat_map(|r| r.y.iter()).map(|v| v * v).sum();
    let (causal, rows) = residual(Regression { na: 0, lags: window + 1 }, &before)?;
    let (acausal, more) = residual(Regression { na: 0, lags: window }, &after)?;
    let acausal = acausal * rows as f64 / more as f64;
    if window == 0 || causal < LEADS * acausal || acausal > LEFT * all {
        return None;
    }
    let [na, _] = ARX_ORDERS;
    let turned =
        || records.iter().map(|r| Record::new(r.y.to_vec(), r.u.to_vec())).collect::<Vec<_>>();
    let smoothed = || {
        records.iter().all(|r| r.present.is_none())
            && ahead(&turned(), na, lags(records, max_delay).max(na + 2))
    };
    if bias > 0 && follows(records, max_delay) && !smoothed() {
        return None;
    }
    let like = |lead: usize| {
        let products = long().flat_map(|r| r.u[lead..].iter().zip(r.y.iter()).map(|(u, y)| u * y));
        products.sum::<f64>().abs()
    };
    (1..=window)
        .map(|lead| (lead, like(lead)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(lead, _)| lead)
}

/// Past inputs help to predict the output beyond its own past.
fn follows(records: &[Record<'_>], max_delay: usize) -> bool {
    let [na, _] = ARX_ORDERS;
    let lags = lags(records, max_delay).max(na + 2);
    let later: Vec<Record<'_>> =
        records.iter().filter(|r| r.len() > lags).map(|r| r.ahead(1)).collect();
    let alone = residual(Regression { na, lags: 0 }, &later);
    let both = residual(Regression { na, lags }, &later);
    alone.zip(both).is_some_and(|((alone, more), (both, rows))| {
        explained(alone * rows as f64 / more as f64, both, lags, rows - na - lags).1 < BY_CHANCE
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn centred(x: Vec<f64>) -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        x.into_iter().map(|v| v - mean).collect()
    }

    fn gauss(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    /// Steps of ±1 that last any number of samples, through direct·u + lagged·(a lag of u), under noise.
    fn open(seed: u64) -> Record<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (pole, direct) = (rng.random_range(0.1..0.95), rng.random_range(0.3..1.0));
        // A part that goes against the direct path washes it out.
        let lagged = rng.random_range(-1.0..1.0);
        let noise = [0.0, 0.001, 0.02][rng.random_range(0..3_usize)];
        let change = rng.random_range(0.1..0.5);
        let (mut u, mut y) = (Vec::new(), Vec::new());
        let (mut level, mut x) = (1.0, 0.0);
        for _ in 0..1500 {
            if rng.random::<f64>() < change {
                level = -level;
            }
            y.push(direct * level + lagged * x + noise * gauss(&mut rng));
            u.push(level);
            x = pole * x + (1.0 - pole) * level;
        }
        Record::new(centred(u), centred(y))
    }

    /// A random input without memory through a direct path and a lag, under noise.
    fn open_white(seed: u64) -> Record<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (pole, direct) = (rng.random_range(0.4..0.95), rng.random_range(0.2..0.6));
        let noise = [0.0, 0.001, 0.02][rng.random_range(0..3_usize)];
        let sign = if rng.random() { 1.0 } else { -1.0 };
        let (mut u, mut y, mut x) = (Vec::new(), Vec::new(), 0.0);
        for _ in 0..1500 {
            let level = gauss(&mut rng);
            // Of opposite signs both parts may make an output that is as white as the input.
            y.push(sign * (direct * level + x) + noise * gauss(&mut rng));
            u.push(level);
            x = pole * x + (1.0 - pole) * 3.0 * level;
        }
        Record::new(centred(u), centred(y))
    }

    #[test]
    fn an_input_without_memory_is_no_function_of_an_output_with_one() {
        let right = |seed: &u64| {
            let seen = in_loop(&[open_white(*seed)], 35, 1);
            seen.direct && !seen.closed()
        };
        let right = (0..60).filter(right).count();
        assert!(right >= 57, "{right} of 60");
    }

    /// A relay that switches the input by the noisy output of a lag within the sample.
    fn relay(seed: u64) -> Record<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (pole, noise) = (rng.random_range(0.8..0.98), rng.random_range(0.02..0.2));
        let band = rng.random_range(0.0..0.3);
        let (mut u, mut y) = (Vec::new(), Vec::new());
        let (mut x, mut slow, mut level) = (0.0, 0.0, 1.0);
        for _ in 0..1500 {
            slow = 0.9 * slow + noise * gauss(&mut rng);
            let seen: f64 = x + slow;
            if seen.abs() > band {
                level = -seen.signum();
            }
            y.push(seen);
            u.push(level);
            x = pole * x + (1.0 - pole) * level;
        }
        Record::new(centred(u), centred(y))
    }

    #[test]
    fn an_open_plant_that_answers_within_the_sample_is_a_direct_path_and_no_loop() {
        let right = |seed: &u64| {
            let seen = in_loop(&[open(*seed)], 35, 1);
            seen.direct && !seen.closed()
        };
        let right = (0..60).filter(right).count();
        assert!(right >= 57, "{right} of 60");
    }

    #[test]
    fn a_relay_that_reacts_within_the_sample_is_no_direct_path() {
        let direct = (0..60).filter(|seed| in_loop(&[relay(*seed)], 35, 1).direct).count();
        assert!(direct <= 1, "{direct} of 60");
    }
}

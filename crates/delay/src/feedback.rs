//! Feedback in a record, and the part of its input that the output did not cause.

use std::borrow::Cow;

use statrs::function::beta::checked_beta_reg;

use super::ahead::ahead;
use super::finding::Finding;
use super::method::Condition;
use crate::posterior::ARX_ORDERS;
use deadtime_identify::{Record, Regression};

/// Coefficients of the response in the tests of noise colour and feedback, as in the threshold methods.
const LAGS: usize = 71;
/// Input samples after the output's; open-loop data give them no explanatory power.
const FUTURE: usize = 5;
/// Share of the innovations' variance that later inputs explain in a record with feedback. A mildly nonlinear plant reaches a few hundredths with smooth
/// inputs.
const FEEDS_BACK: f64 = 0.03;
/// Share of a causal free response's residual that later inputs explain, if the innovations show them too. An open-loop model takes this share for response.
const ACAUSAL: f64 = 0.1;
/// The same for an input that is held for several samples, whose changes are rarely innovations.
const ACAUSAL_HELD: f64 = 0.03;
/// Share of the output's innovations that a direct path must explain.
const DIRECT: f64 = 0.005;
/// Share of the output's innovations that is correlated with the input's innovations of the same sample.
const SAME_SAMPLE: f64 = 0.015;
/// Standard deviations by which the response, summed over [`SUMS`] lags, must differ from zero for its sign to be known.
const FOLLOWS: f64 = 3.5;
/// Lags over which the response is summed.
const SUMS: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// The probability of later inputs by chance, required where both channels are correlated within the sample.
const ALSO: f64 = 1e-3;
/// The probability of such a share by chance.
const BY_CHANCE: f64 = 1e-4;
/// The same for a small share of the innovations: in a long record a nonlinearity of the plant is significant too.
const HARDLY: f64 = 1e-7;
/// Past inputs and past outputs (the present output included) that represent any PID controller with a filter and one sample of delay.
const CONTROLLER: (usize, usize) = (4, 7);
/// Share of the input's increments that a function of the output leaves unexplained; below it nothing else moves the input.
const TIED: f64 = 1e-9;
/// Share of the input that its own past must leave unexplained for an informative test: a smooth input is a function of its own past.
const NEWS: f64 = 1e-3;
/// Share of samples at which the output moves and the input rests, from which the input is no linear function of the output. A random choice of four levels
/// rests as often.
const RESTS: f64 = 0.25;
/// Past samples of both channels that predict the input; the remainder is the innovation.
const MEMORY: usize = 20;
/// Share of the input's variance that its innovations must explain for the joint method.
const OWN_SHARE: f64 = 0.02;

/// Evidence of a loop in a record.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InLoop {
    /// Share of the output's innovations that later inputs explain, if significant.
    pub later: Option<f64>,
    /// Correlation of both channels' innovations within a sample, where the plant cannot be the cause.
    pub same_sample: Option<f64>,
    /// The input is a function of the output and nothing else moves it: plant and dead time are unidentifiable.
    pub tied: bool,
    /// The output leads the input, and no controller is the cause: a filter smoothed it in both directions, or its clock is ahead.
    pub ahead: bool,
    /// The output reacts to the input within the sample, without evidence that the input reacts to the output.
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

/// Tests for a loop in the records of a pair whose plant needs `bias` samples to respond.
///
/// * Later inputs explain a significant share of the output's innovations, or of the free response's residual. Earlier outputs also predict the input beyond
///   its own past (Granger, 1969). The test with later inputs is the causality test with the input's future (Sims, 1972, Am. Econ. Rev. 62(4), 540-552); it
///   also holds for inputs that are no random process. A nonlinear plant fails the first test alone, an input with a long memory the second alone.
/// * The plant cannot react within the sample (`bias` of 1 or more), but the innovations of both channels are correlated within it. The sign opposite to the
///   response's indicates a controller. The response's sign without explanatory power of later inputs indicates a direct path. With an autonomous input, a
///   direct path is reported for either sign. Such an input rests while the output moves, and earlier outputs do not predict it. An unpredictable input is
///   autonomous, too, if the output has a memory.
/// * Where the response begins smoothly before its command (`ahead`), the output leads, and the loop remains undecided.
/// * A low-order function of the output explains every increment of the input up to rounding; the input's own past does not. Nothing else then moves the input.
///
/// How it can be wrong: a strongly nonlinear plant passes for a loop where its input is smooth. A loop whose noise moves the input by a few hundredths of its
/// variance passes for open; its bias is then small. A controller with more memory than a PID is not recognised as the only source of the input. Too short a
/// record reveals nothing.
#[must_use]
pub fn in_loop(records: &[Record<'_>], max_delay: usize, bias: usize) -> InLoop {
    let [na, _] = ARX_ORDERS;
    let lags = lags(records, max_delay).max(na + 2);
    let (later, chance) = later(records, na, lags).unwrap_or((None, 1.0));
    let ahead = ahead(records, na, lags);
    // A nonlinearity of the response passes for a loop in only one direction of the test.
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

/// Share of the output's power that its own past must predict where nothing predicts the input. A controller within the sample would make the input equally
/// predictable.
const PREDICTABLE: f64 = 0.1;

/// Neither its own past nor earlier outputs predict the input, while the output's past predicts the output. A signal without memory is no function of one with
/// memory.
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

/// The input is no function of the output, linear or not. The input rests while the output moves, and earlier outputs do not predict it beyond its own past; or
/// nothing predicts it.
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
    // Input and output are swapped, the output one sample earlier.
    let turned: Vec<Record<'_>> = (records.iter().filter(|r| r.len() > 4 * na))
        .map(|r| Record::new(&r.y[..r.len() - 1], &r.u[1..r.len()]))
        .collect();
    let own = residual(Regression { na, lags: 0 }, &turned);
    let both = residual(Regression { na, lags: na }, &turned);
    own.zip(both).is_some_and(|((own, rows), (both, _))| {
        explained(own, both, na, rows.saturating_sub(2 * na)).1 >= BY_CHANCE
    })
}

/// The input often rests while the output moves. Commands of levels do so; a sensor's signal does not.
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

/// The probability that earlier outputs predict the input, beyond its own past, by chance alone. The probability is small where the input reacts to earlier
/// outputs, for any plant.
///
/// Source: Granger (1969), Econometrica 37(3), 424-438, doi:10.2307/1912791.
fn reacts(records: &[Record<'_>], na: usize, lags: usize) -> f64 {
    // Input and output are swapped, the output one sample earlier.
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

/// Lags that a record of this length supports.
pub(super) fn lags(records: &[Record<'_>], max_delay: usize) -> usize {
    let samples: usize = records.iter().map(Record::len).sum();
    LAGS.max(max_delay + 1).min(samples / 6)
}

/// Rounding of an exactly zero residual, as a share of the signal's power. A command of a few steps is known exactly from its past; the ratio of two roundings
/// is meaningless. The factorisation error is about 1e-15 of the amplitude for each of 100 columns.
const ROUNDING: f64 = 1e-26;

/// Σ e², bounded from below by rounding, and the rows of a regression over all its columns.
pub(super) fn residual(regression: Regression, records: &[Record<'_>]) -> Option<(f64, usize)> {
    let triangle = regression.factor(records);
    let last = regression.columns();
    let whole: f64 = (0..=last).map(|i| triangle.r[(i, last)].powi(2)).sum();
    (triangle.rows > 2 * last)
        .then(|| (triangle.r[(last, last)].powi(2).max(ROUNDING * whole), triangle.rows))
}

/// The share of the residual that `more` columns explain, and the probability of that share by chance.
pub(super) fn explained(without: f64, with: f64, more: usize, freedom: usize) -> (f64, f64) {
    let left = (with / without.max(f64::MIN_POSITIVE)).min(1.0);
    // The tail of Fisher's F as an incomplete beta function of the residual's share; it is defined for a zero residual, too.
    (1.0 - left, checked_beta_reg(0.5 * freedom as f64, 0.5 * more as f64, left).unwrap_or(1.0))
}

/// The share of the output's innovations that later inputs explain, if significant, and its probability by chance.
fn later(records: &[Record<'_>], na: usize, lags: usize) -> Option<(Option<f64>, f64)> {
    let long: Vec<&Record<'_>> = records.iter().filter(|r| r.len() > 2 * FUTURE + lags).collect();
    // The same rows: with the input advanced by FUTURE samples, its first lags lie after the output.
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

/// Correlation of both channels' innovations within the sample.
struct SameSample {
    correlation: f64,
    /// The response at lag 0 has the opposite sign to later lags.
    against: bool,
    /// It has the same sign.
    along: bool,
}

/// Tests whether both channels' innovations are correlated within the sample beyond chance.
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
    // The responses to the input and to the noise's innovations; the squares of the latter widen a coefficient's variance.
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

/// Only the output moves the input.
fn tied(records: &[Record<'_>], bias: usize) -> bool {
    let (own, outputs) = CONTROLLER;
    let increments = |x: &[f64]| -> Vec<f64> { x.windows(2).map(|w| w[1] - w[0]).collect() };
    // Input and output are swapped. Increments cancel a constant set point.
    let turned: Vec<Record<'static>> = (records.iter())
        .flat_map(|r| r.stretches(4 * (own + outputs)))
        .map(|r| {
            let (u, mut y) = (increments(&r.u), increments(&r.y));
            if bias == 0 {
                // A reaction within the sample may be the plant's.
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

/// The records with the open-loop part of the input in its place; `None` where that part is too small or samples are missing.
///
/// The innovation of the input given the past of both channels is independent of all output disturbances. Where the plant cannot react within the sample, the
/// regression includes the output of the same sample. The input's response to its innovation is the input without disturbances. From it to the output the plant
/// acts as in open loop.
///
/// Source: Van den Hof and Schrama (1993), Automatica 29(6), 1523-1527, doi:10.1016/0005-1098(93)90015-L, with the joint process's innovation instead of a
/// measured reference. For that innovation Caines and Chan (1975), IEEE Trans. Autom. Control 20(4), 498-508, doi:10.1109/TAC.1975.1101008.
/// Fails when: the reference is a function of its own past (no innovation). A nonlinear controller fails, too, as does one with more memory than 20 samples and
/// its own output.
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
    // Input and output are swapped; the present output explains the input only where the plant cannot be the cause.
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

/// The number of samples for which the input is held throughout while the output moves; 1 otherwise. Such an input was logged, or given, less often than the
/// output.
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
    // A binary signal holds for any multiple of its clock period; an asynchronous clock changes between samples.
    if low >= 2 && high < 2 * low { waits[waits.len() / 2] } else { 1 }
}

/// Changes of an input from which its hold times are informative.
const MANY: usize = 50;

/// Factor between the residuals with present and past inputs and with later inputs, from which the output leads.
const LEADS: f64 = 1.25;
/// Largest residual with later inputs, as a share of the output's power, for a lead.
const LEFT: f64 = 0.7;

/// The number of samples by which the output leads the input, where later inputs explain the output better than earlier inputs.
///
/// Free responses cover the search window on either side; the lag is that of the largest cross-correlation. A loop whose noise moves the input more than its
/// reference is an alias. There past inputs help to predict the output, which excludes a lead unless the input is a two-sided smoothed response (`ahead`). With
/// a `bias` of 0 the channels may be two copies; an echo then passes the prediction test, which is omitted.
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

    /// Steps of ±1 of random duration through direct·u + lagged·(a lag of u), with noise.
    fn open(seed: u64) -> Record<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (pole, direct) = (rng.random_range(0.1..0.95), rng.random_range(0.3..1.0));
        // A lagged part of the opposite sign cancels the direct path.
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

    /// A white input through a direct path and a lag, with noise.
    fn open_white(seed: u64) -> Record<'static> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (pole, direct) = (rng.random_range(0.4..0.95), rng.random_range(0.2..0.6));
        let noise = [0.0, 0.001, 0.02][rng.random_range(0..3_usize)];
        let sign = if rng.random() { 1.0 } else { -1.0 };
        let (mut u, mut y, mut x) = (Vec::new(), Vec::new(), 0.0);
        for _ in 0..1500 {
            let level = gauss(&mut rng);
            // Parts of opposite signs can make the output as white as the input.
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

    /// A relay switches the input within the sample, by the noisy output of a lag.
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

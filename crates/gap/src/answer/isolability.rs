//! Effects that an excitation makes distinguishable, from signatures alone, before any fit.
//!
//! A signature is the whitened change of the predictions by an effect of a plausible size, with the initial state integrated out. Two effects with parallel
//! signatures are indistinguishable by any fit (isolability by the angle between signatures). Source: Basseville and Nikiforov 1993, "Detection of Abrupt
//! Changes", Prentice Hall, section 7.2.

use deadtime_signal::decompositions::{singular_values, symmetric_eigen};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::experiment;
use crate::format::diagnosis::Prediction;
use crate::input::record::LogRecord;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Role, Scales};
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats;

/// Effects whose cosine is at least this are alike.
const ALIKE: f64 = 0.95;

/// The number of sizes of an effect in the comparison.
const SIZES: usize = 4;
/// An effect that changes the outputs by more than this part of the measured motion's power is no longer small. The program then uses a smaller effect.
const PLAUSIBLE: f64 = 0.1;
/// The number of halvings of a size that is not plausible.
const HALVINGS: usize = 6;
/// Rows of signatures that are compared; longer ones are thinned.
const ROWS: usize = 24_000;
/// Directions of a signature's space that are smaller than this, relative to the largest, are rounding.
const RANK: f64 = 1e-6;

/// The format line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum IsolabilityFormat {
    /// The only format there is.
    #[default]
    #[serde(rename = "deadtime/isolability@1")]
    V1,
}

/// The distinguishable effects of an excitation, `deadtime/isolability@1`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Isolability {
    /// The format line.
    pub format: IsolabilityFormat,
    /// The model's name.
    pub model: String,
    /// The logs.
    pub logs: Vec<String>,
    /// The meaning of "predicted" in this answer.
    pub prediction: Prediction,
    /// Absolute cosines from which on effects are alike.
    pub alike_from: f64,
    /// Twice the log-likelihood from which on an effect is visible.
    pub visible_from: f64,
    /// Every candidate, in the order of the table of effects.
    pub effects: Vec<EffectVisibility>,
    /// Absolute cosines between the signatures, in the order of `effects`: the mean over an effect's sizes of the cosine to the other's most similar signature.
    /// The smaller of the two directions is taken. An effect without any response has 0.
    pub cosines: Vec<Vec<f64>>,
    /// Groups of visible effects that are alike: each with the first of the group, which comes first in the table.
    pub classes: Vec<Class>,
}

/// How well one effect can be seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectVisibility {
    /// The effect.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// It is visible at a plausible size.
    pub visible: bool,
    /// The smallest size that would be seen in this noise; missing where none would.
    pub smallest: Option<Size>,
    /// The visible effect that is most like it; missing where there is none.
    pub rival: Option<Rival>,
}

/// A value of an effect's parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// The parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// Its value; for a limit, the loosest that would be seen.
    pub value: f64,
    /// Where the effect is the identity; missing for a limit.
    pub nominal: Option<f64>,
}

/// The effect that is most like another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rival {
    /// `effect:channel`.
    pub name: String,
    /// The absolute cosine between their signatures.
    pub cosine: f64,
}

/// Effects that are alike.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Class {
    /// `effect:channel`.
    pub members: Vec<String>,
    /// The excitation that would separate them.
    pub next_experiment: String,
}

/// The names of the compared candidates.
pub(crate) struct Names<'a> {
    pub(crate) model: &'a str,
    pub(crate) logs: Vec<String>,
}

/// The candidates' signatures on these logs, and how alike they are. `noise` per output, `subject` and `logs` by name.
pub(crate) fn isolability(
    likelihood: &Likelihood<'_>,
    catalogue: Vec<Applied>,
    scales: &Scales,
    noise: &[f64],
    names: Names<'_>,
    far: &HowFar,
) -> Option<Isolability> {
    let nominal = likelihood.whitened(NO_EFFECT)?;
    let visible_from = likelihood.criteria.selection_penalty;
    let limit = PLAUSIBLE * motion_size(likelihood.records, noise);
    let steps = far.steps(catalogue.len(), "effects simulated");
    let candidate = |applied: Applied| {
        let signatures = signatures(likelihood, &applied, scales, &nominal, limit);
        steps.one_more();
        Candidate { signatures, applied }
    };
    let candidates: Vec<Candidate> = parallel::map(catalogue, candidate);
    let visible = |c: &Candidate| c.signatures.iter().any(|s| s.strength >= visible_from);
    let cosines = cosines(&candidates);
    let rival = |i: usize| {
        let others = (0..candidates.len())
            .filter(|&j| j != i && visible(&candidates[j]))
            .map(|j| (j, cosines[(i, j)]));
        others
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .map(|(j, cosine)| Rival { name: candidates[j].applied.key(), cosine })
    };
    let effects = candidates.iter().enumerate().map(|(i, c)| EffectVisibility {
        effect: c.applied.effect.name().to_owned(),
        channel: c.applied.channel.clone(),
        visible: visible(c),
        smallest: smallest(c, visible_from),
        rival: if visible(c) { rival(i) } else { None },
    });
    Some(Isolability {
        format: IsolabilityFormat::V1,
        model: names.model.to_owned(),
        logs: names.logs,
        prediction: likelihood.predictor.reported(),
        alike_from: ALIKE,
        visible_from,
        effects: effects.collect(),
        cosines: cosines.row_iter().map(|row| row.iter().copied().collect()).collect(),
        classes: classes(&candidates, &cosines, visible),
    })
}

/// An effect at one size.
struct Signature {
    values: Vec<f64>,
    /// Squared length: twice the log-likelihood that it would gain.
    strength: f64,
    /// The columns that span its directions, thinned.
    columns: Vec<DVector<f64>>,
    /// The same with the start integrated out: the one side of every inner product.
    reduced: Vec<DVector<f64>>,
}

/// An effect at several sizes.
struct Candidate {
    applied: Applied,
    signatures: Vec<Signature>,
}

/// The squared length of the measured motion about its mean, in units of the noise.
fn motion_size(records: &[LogRecord], noise: &[f64]) -> f64 {
    let output = |(i, noise): (usize, &f64)| {
        let of = |record: &LogRecord| {
            let values: Vec<f64> = (0..record.time_s.len())
                .filter_map(|k| record.measured_in(record.train, i, k))
                .collect();
            let mean = stats::mean(values.iter().copied()).unwrap_or(0.0);
            values.iter().map(|v| ((v - mean) / noise.max(f64::MIN_POSITIVE)).powi(2)).sum::<f64>()
        };
        records.iter().map(of).sum::<f64>()
    };
    noise.iter().enumerate().map(output).sum()
}

fn moved(applied: &Applied, values: &[f64]) -> Applied {
    Applied { values: values.to_vec(), ..applied.clone() }
}

/// The whitened change that these values make; `None` where they cannot be simulated.
fn change(
    likelihood: &Likelihood<'_>,
    applied: &Applied,
    values: &[f64],
    nominal: &Whitened,
) -> Option<Whitened> {
    let there = likelihood.whitened(&[moved(applied, values)])?;
    Some(nominal.iter().zip(&there).map(|(n, t)| n - t).collect())
}

/// An effect at a few of its starts, made smaller until it is plausible.
fn signatures(
    likelihood: &Likelihood<'_>,
    applied: &Applied,
    scales: &Scales,
    nominal: &Whitened,
    limit: f64,
) -> Vec<Signature> {
    let mut starts = likelihood.first_guesses(applied, scales);
    // Limits on both sides hold the directions of each alone.
    if starts.iter().any(|s| s.iter().all(|v| v.is_finite())) {
        starts.retain(|s| s.iter().all(|v| v.is_finite()));
    }
    let every = starts.len().div_ceil(SIZES).max(1);
    let all = starts
        .into_iter()
        .step_by(every)
        .filter_map(|start| signature(likelihood, applied, start, nominal, limit));
    let (mut small, large): (Vec<Signature>, Vec<Signature>) =
        all.partition(|s| s.strength <= limit);
    if small.is_empty() {
        small.extend(large.into_iter().min_by(|a, b| a.strength.total_cmp(&b.strength)));
    }
    small
}

fn signature(
    likelihood: &Likelihood<'_>,
    applied: &Applied,
    start: Vec<f64>,
    nominal: &Whitened,
    limit: f64,
) -> Option<Signature> {
    let parameters = &applied.parameters;
    let halfway = |values: &[f64]| -> Vec<f64> {
        let half = |(v, p): (&f64, &deadtime_model::effect::Parameter)| {
            if p.nominal.is_infinite() || p.role.is_shape() {
                *v
            } else {
                p.nominal + 0.5 * (v - p.nominal)
            }
        };
        values.iter().zip(parameters).map(half).collect()
    };
    let mut values = start;
    let mut found = change(likelihood, applied, &values, nominal);
    // Limits cannot be halved towards infinity.
    let halves = parameters.iter().all(|p| p.nominal.is_finite());
    for _ in 0..HALVINGS {
        let small = found.as_ref().is_some_and(|d| likelihood.inner(d, d) <= limit);
        if small || !halves {
            break;
        }
        values = halfway(&values);
        found = change(likelihood, applied, &values, nominal);
    }
    let whole = found?;
    let strength = likelihood.inner(&whole, &whole);
    if !(strength > 0.0 && strength.is_finite()) {
        return None;
    }
    let mut directions = vec![whole];
    // A sine of any phase, limits of either side: all directions that the effect has at this size.
    for (at, p) in parameters.iter().enumerate().filter(|_| parameters.len() > 1) {
        let mut other = values.clone();
        if p.role == Role::Phase {
            other[at] += std::f64::consts::FRAC_PI_2;
        } else if p.nominal.is_infinite() && values.iter().filter(|v| v.is_finite()).count() > 1 {
            other[at] = p.nominal;
        } else {
            continue;
        }
        directions.extend(change(likelihood, applied, &other, nominal));
    }
    let reduced = directions.iter().map(|d| thinned(&likelihood.reduced(d))).collect();
    Some(Signature { values, strength, columns: directions.iter().map(thinned).collect(), reduced })
}

/// All rows of all records in one column, or every so many of them.
fn thinned(whitened: &Whitened) -> DVector<f64> {
    let rows: usize = whitened.iter().map(DVector::len).sum();
    let every = rows.div_ceil(ROWS).max(1);
    DVector::from_iterator(
        rows.div_ceil(every),
        whitened.iter().flat_map(|r| r.iter().copied()).step_by(every),
    )
}

/// Pairwise cosines of all candidates.
fn cosines(candidates: &[Candidate]) -> DMatrix<f64> {
    let all: Vec<&Signature> = candidates.iter().flat_map(|c| &c.signatures).collect();
    let count = candidates.len();
    let mut cosines = DMatrix::identity(count, count);
    if all.is_empty() {
        return cosines;
    }
    let side = |of: fn(&Signature) -> &Vec<DVector<f64>>| {
        DMatrix::from_columns(&all.iter().flat_map(|s| of(s).iter().cloned()).collect::<Vec<_>>())
    };
    let gram = side(|s| &s.columns).tr_mul(&side(|s| &s.reduced));
    // Thinning leaves it not quite symmetric.
    let gram = (&gram + gram.transpose()) * 0.5;
    // Every signature's columns, and an orthonormal basis of their span in these coordinates.
    let mut first = 0;
    let bases: Vec<(usize, DMatrix<f64>)> = all
        .iter()
        .map(|s| {
            let from = first;
            first += s.columns.len();
            (from, basis(&gram.view((from, from), (s.columns.len(), s.columns.len())).into_owned()))
        })
        .collect();
    let between = |(a, left): &(usize, DMatrix<f64>), (b, right): &(usize, DMatrix<f64>)| {
        let cross = left.tr_mul(&gram.view((*a, *b), (left.nrows(), right.nrows()))) * right;
        singular_values(&cross).map_or(0.0, |s| s.max().min(1.0))
    };
    let mut ends = Vec::with_capacity(count);
    let mut end = 0;
    for c in candidates {
        ends.push(end..end + c.signatures.len());
        end += c.signatures.len();
    }
    for i in 0..count {
        for j in 0..i {
            let (a, b) = (&bases[ends[i].clone()], &bases[ends[j].clone()]);
            let toward = |a: &[(usize, DMatrix<f64>)], b: &[(usize, DMatrix<f64>)]| {
                let best = |one: &(usize, DMatrix<f64>)| {
                    b.iter().map(|other| between(one, other)).fold(0.0, f64::max)
                };

                a.iter().map(best).sum::<f64>() / a.len().max(1) as f64
            };
            // Alike in both directions.
            let cosine = toward(a, b).min(toward(b, a));
            (cosines[(i, j)], cosines[(j, i)]) = (cosine, cosine);
        }
    }
    cosines
}

/// Columns with the same span as a Gram matrix's vectors, orthonormal under it.
fn basis(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let none = DMatrix::zeros(gram.nrows(), 0);
    let Some(eigen) = symmetric_eigen(gram) else { return none };
    let largest = eigen.eigenvalues.max();
    let kept = (0..gram.nrows())
        .filter(|&i| eigen.eigenvalues[i] > RANK * largest && eigen.eigenvalues[i] > 0.0);
    let columns: Vec<DVector<f64>> =
        kept.map(|i| eigen.eigenvectors.column(i) / eigen.eigenvalues[i].sqrt()).collect();
    if columns.is_empty() { none } else { DMatrix::from_columns(&columns) }
}

/// The smallest size that would be seen, from the weakest signature that is.
fn smallest(c: &Candidate, visible_from: f64) -> Option<Size> {
    let weakest = c
        .signatures
        .iter()
        .filter(|s| s.strength >= visible_from)
        .min_by(|a, b| a.strength.total_cmp(&b.strength))?;
    let named = c.applied.parameters.iter().zip(&weakest.values);
    let (p, value) = named.rev().find(|(p, v)| !p.role.is_shape() && v.is_finite())?;
    let nominal = p.nominal.is_finite().then_some(p.nominal);
    // Small effects grow with their size.
    let value =
        nominal.map_or(*value, |n| n + (value - n) * (visible_from / weakest.strength).sqrt());
    Some(Size { parameter: p.name.to_string(), unit: p.unit.clone(), value, nominal })
}

/// Groups by their first member in the order of the table.
fn classes(
    candidates: &[Candidate],
    cosines: &DMatrix<f64>,
    visible: impl Fn(&Candidate) -> bool,
) -> Vec<Class> {
    let mut left: Vec<usize> = (0..candidates.len()).filter(|&i| visible(&candidates[i])).collect();
    let mut classes = Vec::new();
    while let Some(&first) = left.first() {
        let (members, rest): (Vec<usize>, Vec<usize>) =
            left.iter().partition(|&&j| j == first || cosines[(first, j)] >= ALIKE);
        left = rest;
        if members.len() > 1 {
            let class: Vec<Applied> =
                members.iter().map(|&j| candidates[j].applied.clone()).collect();
            classes.push(Class {
                members: class.iter().map(Applied::key).collect(),
                next_experiment: experiment::by_kind(&class).to_string(),
            });
        }
    }
    classes
}

//! Parameters with intervals that account for two errors: the nominal model's own parameters are inexact, and residuals are coloured.
//!
//! How it can be wrong: with a perfect nominal model a fit without recalibration has the smallest variance, and the joint fit gains nothing. With a nominal
//! model that is 1 % off, a fit without recalibration absorbs the error and its interval is many times too narrow. The relative errors of all nominal
//! parameters therefore join the fit, with a common normal prior. The covariance is the average over sizes of this prior, each weighted by its evidence (`MacKay` 1992,
//! doi:10.1162/neco.1992.4.3.415; Hoeting et al. 1999, doi:10.1214/ss/1009212519). The value is that of the fit without recalibration, as in the model with its effects. The variance is the larger of the
//! posterior's and that of the scores of separate blocks of time (Liang and Zeger 1986, doi:10.1093/biomet/73.1.13). The squared distance to the joint estimate
//! is added.

use nalgebra::{DMatrix, DVector};

use crate::hypothesis::direction::difference;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::shared_time::put;
use crate::hypothesis::slopes::Slopes;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, EFFECTS, Role, Scales};
use deadtime_signal::stats::{NORMAL_95, NORMAL_95_EXACT, students_t};

/// Prior sizes of the nominal parameters' relative errors that are tried.
const SIZES: [f64; 7] = [0.0, 1e-3, 3e-3, 0.01, 0.02, 0.05, 0.1];
/// Blocks of time per record for the scores.
const BLOCKS: usize = 12;
/// The relative step of central differences by the nominal parameters, as of `Parameter::central_step`.
const CENTRAL: f64 = 1e-2;
/// The largest number of doublings of an interval.
const DOUBLINGS: usize = 20;

/// Standard deviations of a hypothesis's free parameters.
pub(crate) struct Estimate {
    /// In the order of the hypothesis's `free`; `None` at a bound, or where the data hold no information; infinite where the data allow any size.
    pub(crate) std: Vec<Option<f64>>,
    /// The distance of the recalibrated parameters together from their nominal values; `None` without any.
    pub(crate) together: Option<Together>,
}

/// The distance of several parameters from their nominal values, along the direction in which it is most standard deviations.
///
/// Parameters of which only a ratio shows are each unknown, and their ratio is known.
#[derive(Debug, Clone)]
pub(crate) struct Together {
    /// Of a parameter, its place and its weight in the direction.
    weights: Vec<(usize, f64)>,
    distance: f64,
    variance: f64,
}

impl Together {
    /// In standard deviations.
    pub(crate) fn deviations(&self) -> f64 {
        if self.variance > 0.0 { self.distance / self.variance.sqrt() } else { 0.0 }
    }
}

/// The nominal parameters whose error could be mistaken for a part of an effect: one column each for a relative error of 1.
fn nominal_columns(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    residual: &Whitened,
) -> Vec<(Applied, Whitened)> {
    let Some(effect) = EFFECTS.iter().find(|e| e.corrects_model()) else { return Vec::new() };
    let found: Vec<String> = hypothesis.effects.iter().map(Applied::key).collect();
    let central = likelihood.has_central_differences() && !likelihood.system.is_black_box();
    let step = if central { CENTRAL } else { likelihood.budget.relative_step };
    let column = |channel: String| {
        let mut applied = Applied::nominal(likelihood.system, *effect, &channel)
            .ok()
            .filter(|a| !found.contains(&a.key()))?;
        let nominal = applied.values[0];
        let mut at = |share: f64| {
            applied.values[0] = nominal + share * nominal.abs();
            let moved: Vec<Applied> =
                hypothesis.effects.iter().cloned().chain([applied.clone()]).collect();
            likelihood.whitened(ActiveEffects::from(hypothesis).with(&moved))
        };
        let column = if central {
            difference(&at(step)?, &at(-step)?, 0.5 / step)
        } else {
            difference(&at(step)?, residual, 1.0 / step)
        };
        applied.values[0] = nominal;
        Some((applied, column))
    };
    if likelihood.system.is_sampled() {
        Vec::new()
    } else {
        effect.channels(likelihood.system).into_iter().filter_map(column).collect()
    }
}

/// The normal equations of the free parameters and the nominal ones together; every column is scaled to unit length, for conditioning.
struct Equations {
    /// The number of free parameters, which are the first.
    own: usize,
    /// The length of every column before the scaling.
    length: Vec<f64>,
    gram: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Equations {
    /// `None` where a free parameter moves nothing.
    fn new(
        likelihood: &Likelihood<'_>,
        columns: &[Whitened],
        residual: &Whitened,
        own: usize,
    ) -> Option<Self> {
        let length: Vec<f64> = columns.iter().map(|c| likelihood.inner(c, c).sqrt()).collect();
        if length[..own]
            .iter()
            .any(|l| l.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) || !l.is_finite())
        {
            return None;
        }
        let all = columns.len();
        let gram = DMatrix::from_fn(all, all, |i, j| {
            if length[i] * length[j] > 0.0 {
                likelihood.inner(&columns[i], &columns[j]) / (length[i] * length[j])
            } else {
                0.0
            }
        });
        let gradient = DVector::from_fn(all, |i, _| {
            if length[i] > 0.0 { likelihood.inner(&columns[i], residual) / length[i] } else { 0.0 }
        });
        Some(Self { own, length, gram, gradient })
    }

    /// The evidence, as minus twice its logarithm, and the covariance for one prior size of the nominal parameters; `precision`: that of the free ones' prior.
    fn solve(&self, size: f64, precision: &[f64]) -> Option<(f64, DMatrix<f64>)> {
        let Self { own, length, .. } = self;
        // Nominal parameters have the precision 1/size², in units of their columns' length.
        let mut information = self.gram.clone();
        let mut determinant = 0.0;
        for i in 0..length.len() {
            information[(i, i)] += if i < *own {
                1e-12 + precision[i] / (length[i] * length[i])
            } else if size > 0.0 && length[i] > 0.0 {
                let spread = size * length[i];
                determinant += 2.0 * spread.ln();
                spread.powi(-2)
            } else {
                determinant += -(1e12_f64).ln();
                1e12
            };
        }
        let factor = information.cholesky()?;
        let explained = self.gradient.dot(&factor.solve(&self.gradient));
        let log_determinant = 2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        Some((log_determinant + determinant - explained, factor.inverse()))
    }

    /// The average covariance over the prior sizes, each weighted by its evidence: the data often leave several.
    fn averaged(&self, precision: &[f64]) -> Option<DMatrix<f64>> {
        let tried: Vec<_> = SIZES.iter().filter_map(|&size| self.solve(size, precision)).collect();
        let least = tried.iter().map(|(evidence, _)| *evidence).reduce(f64::min)?;
        let weight = |evidence: f64| ((least - evidence) / 2.0).exp();
        let weights: f64 = tried.iter().map(|(evidence, _)| weight(*evidence)).sum();
        let of = |(evidence, covariance)| covariance * (weight(evidence) / weights);
        tried.into_iter().map(of).reduce(|sum, one: DMatrix<f64>| sum + one)
    }

    /// The covariance under a prior of the recalibrated parameters that is wider by the uncertainty of its size.
    fn covariance(&self, precision: &[f64]) -> Option<DMatrix<f64>> {
        let covariance = self.averaged(precision)?;
        let held =
            |at: usize| covariance[(at, at)] * precision[at] / (self.length[at] * self.length[at]);
        let held: Vec<f64> = (0..self.own).filter(|&at| precision[at] > 0.0).map(held).collect();
        let wider = prior_wider(&held);
        self.averaged(&precision.iter().map(|p| p / (wider * wider)).collect::<Vec<_>>())
    }
}

/// The joint fit of all parameters, in units of their columns' lengths.
struct JointFit {
    length: Vec<f64>,
    covariance: DMatrix<f64>,
    /// The covariance by the scores of blocks of time.
    sandwich: DMatrix<f64>,
    step: DVector<f64>,
    /// The cost of the fit without recalibration.
    cost: f64,
}

impl JointFit {
    /// The standard deviation of a free parameter by its slopes.
    fn std(&self, at: usize) -> f64 {
        // The shift of the parameter with free nominal parameters is part of the uncertainty.
        let variance =
            self.covariance[(at, at)].max(self.sandwich[(at, at)]) + self.step[at] * self.step[at];
        variance.sqrt() / self.length[at]
    }

    /// The moves of all free parameters for a move of 1 of one, by the posterior: the cost's profile to first order.
    fn profile(&self, at: usize, own: usize) -> Vec<f64> {
        let follows = |to| {
            self.covariance[(to, at)] / self.covariance[(at, at)] * self.length[at]
                / self.length[to]
        };
        (0..own).map(follows).collect()
    }

    /// The standard deviation of a free parameter, widened as far as a move leaves the cost the same; `None` at a bound.
    fn widest_std(
        &self,
        likelihood: &Likelihood<'_>,
        hypothesis: &Hypothesis,
        scales: &Scales,
        at: usize,
    ) -> Option<f64> {
        let (e, i) = hypothesis.free[at];
        let std =
            Some(self.std(at)).filter(|s| s.is_finite() && !hypothesis.at_bound((e, i), scales))?;
        // Between two commands the time of a jump changes nothing: slopes give more than the spread of a uniform distribution over the logs, and the width is searched.
        let is_instant = hypothesis.effects[e].parameters[i].role == Role::Instant;
        let unknown = is_instant && std > scales.duration_s / 12.0_f64.sqrt();
        let std = if unknown { scales.sample_time_s } else { std };
        let own = hypothesis.free.len();
        let alone: Vec<f64> = (0..own).map(|to| if to == at { 1.0 } else { 0.0 }).collect();
        let directions =
            if own > 1 && !unknown { vec![alone, self.profile(at, own)] } else { vec![alone] };
        let widest = directions
            .iter()
            .map(|by| as_far_as_unnoticed(likelihood, hypothesis, by, e, std, self.cost));
        Some(widest.fold(0.0, f64::max))
    }
}

/// The standard deviations of a fit without recalibration whose nominal parameters may be off: from one Gauss-Newton step of all together.
pub(crate) fn estimate(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    scales: &Scales,
) -> Option<Estimate> {
    let Slopes { residual, mut columns } = hypothesis.slopes(likelihood, scales)?;
    let own = columns.len();
    let precision: Vec<f64> =
        hypothesis.prior(likelihood).iter().map(|(precision, _)| *precision).collect();
    let (nominal, more): (Vec<Applied>, Vec<Whitened>) =
        nominal_columns(likelihood, hypothesis, &residual).into_iter().unzip();
    columns.extend(more);
    let equations = Equations::new(likelihood, &columns, &residual, own)?;
    let covariance = equations.covariance(&precision)?;
    let Equations { length, gradient, .. } = equations;
    let mut step = -(&covariance * &gradient);
    if !holds(likelihood, hypothesis, &nominal, &step, &length, &residual) {
        step.fill(0.0);
    }
    let blocks = block_scores(likelihood, &columns, &residual, &length, &step);
    let sandwich = &covariance * &blocks * &covariance;
    let cost = likelihood.inner(&residual, &residual);
    let together = together(hypothesis, &precision, &length, [&covariance, &sandwich], &step);
    let fit = JointFit { length, covariance, sandwich, step, cost };
    let std = (0..own).map(|at| fit.widest_std(likelihood, hypothesis, scales, at)).collect();
    Some(Estimate { std, together })
}

/// The recalibrated parameters together; `covariances`: that of the posterior, and that of the scores of blocks of time; both and the step in units of the
/// columns' lengths.
fn together(
    hypothesis: &Hypothesis,
    precision: &[f64],
    length: &[f64],
    covariances: [&DMatrix<f64>; 2],
    step: &DVector<f64>,
) -> Option<Together> {
    let block: Vec<usize> = (0..precision.len()).filter(|&at| precision[at] > 0.0).collect();
    if block.is_empty() {
        return None;
    }
    let off = DVector::from_iterator(
        block.len(),
        block.iter().map(|&at| {
            let (e, i) = hypothesis.free[at];
            let applied = &hypothesis.effects[e];
            (applied.values[i] - applied.parameters[i].nominal) * length[at]
        }),
    );
    let of = |all: &DMatrix<f64>| {
        DMatrix::from_fn(block.len(), block.len(), |i, j| all[(block[i], block[j])])
    };
    let [posterior, sandwich] = covariances.map(of);
    let direction = posterior.clone().cholesky()?.solve(&off);
    let variance = |of: &DMatrix<f64>| direction.dot(&(of * &direction));
    let shift: f64 = block.iter().zip(direction.iter()).map(|(&at, w)| w * step[at]).sum();
    Some(Together {
        weights: block.iter().zip(direction.iter()).map(|(&at, w)| (at, w * length[at])).collect(),
        distance: direction.dot(&off),
        variance: variance(&posterior).max(variance(&sandwich)) + shift * shift,
    })
}

/// The factor of the prior on recalibrated parameters over the rms of the fitted errors. The data determine γ = n − Σ held of the n parameters (MacKay 1992);
/// `held` is the prior's part of each variance's precision. The rms of all n lacks the others. With a size known from γ parameters a normal prior becomes a
/// Student t of γ degrees of freedom; its 95 % point is used.
fn prior_wider(held: &[f64]) -> f64 {
    let count = held.len() as f64;
    let determined = (count - held.iter().sum::<f64>()).clamp(1.0, count.max(1.0));
    let point = students_t(0.975, determined).map_or(1.0, |t| t / NORMAL_95_EXACT);
    (count / determined).max(1.0).sqrt() * point
}

/// No effect has an interval that holds the value at which it does nothing. In these data each effect is more than slightly wrong nominal parameters, and each
/// limit is reached. An effect without an interval is accepted.
pub(crate) fn established(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    scales: &Scales,
) -> bool {
    estimate(likelihood, hypothesis, scales)
        .is_none_or(|estimate| estimate.apart(hypothesis, NORMAL_95))
}

impl Estimate {
    /// With a further variance of each parameter, by the key of its effect and its place.
    pub(crate) fn widened(
        self,
        hypothesis: &Hypothesis,
        variance: impl Fn((&str, usize)) -> f64,
    ) -> Self {
        let of = |&(e, i): &(usize, usize)| variance((&hypothesis.effects[e].key(), i));
        let wider =
            |(std, at): (Option<f64>, &(usize, usize))| std.map(|std| std.hypot(of(at).sqrt()));
        let together = self.together.map(|together| {
            let more = |(at, weight): &(usize, f64)| weight * weight * of(&hypothesis.free[*at]);
            let variance = together.variance + together.weights.iter().map(more).sum::<f64>();
            Together { variance, ..together }
        });
        Self { std: self.std.into_iter().zip(&hypothesis.free).map(wider).collect(), together }
    }

    /// Every effect is so many standard deviations away from the value at which it does nothing.
    pub(crate) fn apart(&self, hypothesis: &Hypothesis, deviations: f64) -> bool {
        (0..hypothesis.effects.len()).all(|e| self.one_apart(hypothesis, e, deviations))
    }

    /// One effect is so far away, a limit where its interval has an end. An effect without an interval is accepted.
    pub(crate) fn one_apart(&self, hypothesis: &Hypothesis, e: usize, deviations: f64) -> bool {
        let applied = &hypothesis.effects[e];
        let own = hypothesis.free.iter().zip(&self.std).filter(|((of, _), _)| *of == e);
        let sizes = own.map(|((_, i), std)| (&applied.parameters[*i], applied.values[*i], std));
        let sizes = sizes.filter(|(p, _, _)| !p.role.is_shape());
        let mut apart = sizes
            .map(|(p, value, std)| std.is_none_or(|s| (value - p.nominal).abs() > deviations * s));
        let first = apart.next();
        first.is_none_or(|first| first || apart.any(|a| a))
    }
}

/// The standard deviation, doubled while the cost at either end of its 95 % interval differs by less than `unnoticed`, and the distance to the parameter's own
/// minimum. A cost with jumps or kinks has no curvature that determines its width. An example is a delay together with a direct path: uneven samples pass edges
/// of the commands one by one. A smooth cost rises by 3.84 or more at the end of a 95 % interval, and the standard deviation stays. Infinite where the cost never
/// changes: a limit that nothing reaches. Where the cost falls, another noise model has the minimum elsewhere; its distance is a part of the uncertainty.
///
/// `direction`: the moves of all free parameters for a move of 1 of the one of effect `e`. Alone, neither period nor phase of a slower loop could move.
fn as_far_as_unnoticed(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    direction: &[f64],
    e: usize,
    std: f64,
    cost: f64,
) -> f64 {
    if likelihood.calls(&hypothesis.effects[e]) {
        return std;
    }
    let rise = |move_by: f64| {
        let mut effects = hypothesis.effects.clone();
        for (&(e, i), by) in hypothesis.free.iter().zip(direction) {
            put(&mut effects, (e, i), hypothesis.effects[e].values[i] + by * move_by);
        }
        let there = likelihood.whitened(ActiveEffects::from(hypothesis).with(&effects));
        there.map_or(f64::INFINITY, |there| likelihood.inner(&there, &there) - cost)
    };
    width(rise, std, likelihood.criteria.unnoticed)
}

/// The same for a rise of the cost by a move of the parameter.
fn width(rise: impl Fn(f64) -> f64, std: f64, unnoticed: f64) -> f64 {
    let mut reach = std;
    let ends = |reach: f64| [1.0, -1.0].map(|side| (side, rise(side * NORMAL_95 * reach)));
    let mut there = ends(reach);
    for _ in 0..DOUBLINGS {
        if there.iter().all(|(_, rise)| rise.abs() >= unnoticed) {
            break;
        }
        reach *= 2.0;
        there = ends(reach);
    }
    if there.iter().any(|(_, rise)| rise.abs() < unnoticed) {
        return f64::INFINITY;
    }
    let [(side, mut least), _] = {
        there.sort_by(|a, b| a.1.total_cmp(&b.1));
        there
    };
    if least >= 0.0 {
        return reach;
    }
    let mut distance = NORMAL_95 * reach;
    for _ in 0..DOUBLINGS {
        let further = rise(2.0 * side * distance);
        if further > least - unnoticed {
            break;
        }
        (distance, least) = (2.0 * distance, further);
    }
    // The minimum lies between half and twice the distance: a parabola through the three.
    let [near, far] = [0.5, 2.0].map(|by| rise(side * by * distance));
    let [below, above] = [(near - least) / -0.5, (far - least) / 1.0];
    let bend = (above - below) / 1.5;
    let by = if bend > 0.0 { 1.0 - (below + 0.5 * bend) / (2.0 * bend) } else { 1.0 };
    reach.hypot(distance * by.clamp(0.5, 2.0))
}

/// The step lowers the cost in fact: a strongly nonlinear likelihood makes one step meaningless.
fn holds(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    nominal: &[Applied],
    step: &DVector<f64>,
    length: &[f64],
    residual: &Whitened,
) -> bool {
    let own = hypothesis.free.len();
    let by = |at: usize| if length[at] > 0.0 { step[at] / length[at] } else { 0.0 };
    let mut effects = hypothesis.effects.clone();
    for (at, &(e, i)) in hypothesis.free.iter().enumerate() {
        put(&mut effects, (e, i), hypothesis.effects[e].values[i] + by(at));
    }
    effects.extend(nominal.iter().enumerate().map(|(n, applied)| {
        let mut moved = applied.clone();
        moved.values[0] += by(own + n) * moved.values[0].abs();
        moved
    }));
    let there = likelihood.whitened(ActiveEffects::from(hypothesis).with(&effects));
    there.is_some_and(|there| {
        likelihood.inner(&there, &there) <= likelihood.inner(residual, residual)
    })
}

/// Σ over blocks of time of the scores' outer products, at the residual after the step.
fn block_scores(
    likelihood: &Likelihood<'_>,
    columns: &[Whitened],
    residual: &Whitened,
    length: &[f64],
    step: &DVector<f64>,
) -> DMatrix<f64> {
    let all = columns.len();
    let mut sum = DMatrix::zeros(all, all);
    let reduced: Vec<Whitened> = columns.iter().map(|c| likelihood.reduced(c)).collect();
    for (at, record) in likelihood.records.iter().enumerate() {
        if residual[at].is_empty() {
            continue;
        }
        let mut left = residual[at].clone();
        for ((column, length), step) in columns.iter().zip(length).zip(step.iter()) {
            if *length > 0.0 {
                left.axpy(step / length, &column[at], 1.0);
            }
        }
        let samples = record.time_s.len();
        let size = samples.div_ceil(BLOCKS).max(1);
        for from in (0..samples).step_by(size) {
            let score = DVector::from_fn(all, |i, _| {
                let inside = (0..record.measured.len())
                    .flat_map(|o| (from..(from + size).min(samples)).map(move |k| o * samples + k));
                if length[i] > 0.0 {
                    inside.map(|r| reduced[i][at][r] * left[r]).sum::<f64>() / length[i]
                } else {
                    0.0
                }
            });
            sum += &score * score.transpose();
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::ModelDocument;
    use deadtime_model::effect::{Parameter, Role, find};
    use deadtime_model::simulate::System;

    const MODEL: &str = r#"
format = "deadtime/model@1"
name = "lag"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "x" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[1.0]]
C = [[1.0]]
D = [[0.0]]
"#;

    /// Three of four numbers determined: √(4/3) and t₃ = 3.182 (tables); all of many: 1.
    #[test]
    fn a_prior_of_few_numbers_is_wider() {
        let wider = prior_wider(&[0.25; 4]);
        assert!((wider - (4.0_f64 / 3.0).sqrt() * 3.182 / 1.960).abs() < 1e-3, "{wider}");
        assert!((prior_wider(&[0.0; 4000]) - 1.0).abs() < 1e-3);
        assert!(prior_wider(&[1.0]).is_finite());
    }

    /// Two recalibrated parameters of which the data know the difference to 0.01 and the sum not at all, both under a prior of 0.1: moved apart by 0.2, they are
    /// 20 standard deviations from nominal together and less than 2 each.
    #[test]
    fn parameters_that_are_known_together_are_far_from_nominal_together() {
        let number = |channel: &str, value: f64| Applied {
            effect: find("parameter_error").unwrap(),
            channel: channel.into(),
            parameters: vec![Parameter {
                name: "value".into(),
                unit: "1".into(),
                role: Role::Size,
                nominal: 1.0,
                lower: 0.0,
                upper: 2.0,
            }],
            values: vec![value],
        };
        let hypothesis = Hypothesis {
            effects: vec![number("mass", 0.9), number("thrust", 1.1)],
            free: vec![(0, 0), (1, 0)],
            gain: 0.0,
            fitted: true,
            lost: None,
        };
        let (precision, difference) = (100.0, 1e4);
        let information = DMatrix::from_row_slice(
            2,
            2,
            &[precision + difference, -difference, -difference, precision + difference],
        );
        let covariance = information.try_inverse().unwrap();
        let none = DMatrix::zeros(2, 2);
        let found = together(
            &hypothesis,
            &[precision; 2],
            &[1.0; 2],
            [&covariance, &none],
            &DVector::zeros(2),
        )
        .unwrap();
        let expected = (0.02 * precision + 0.04 * difference).sqrt();
        assert!((found.deviations() - expected).abs() < 1e-6 * expected, "{}", found.deviations());
        assert!(expected > 20.0 && 0.1 / covariance[(0, 0)].sqrt() < 2.0);
    }

    #[test]
    fn a_width_reaches_to_where_the_cost_changes_and_to_its_minimum() {
        // A smooth cost about the value.
        let parabola = |centre: f64| move |x: f64| (x - centre).powi(2) - centre * centre;
        assert_eq!(width(parabola(0.0), 1.0, 1.0), 1.0);
        // The minimum is elsewhere: its distance counts, however narrow the curvature.
        for centre in [3.0, -7.0, 20.0] {
            let found = width(parabola(centre), 1.0, 1.0);
            assert!((found - 1.0_f64.hypot(centre)).abs() < 0.01 * found, "{centre} {found}");
        }
        // A plateau of half-width 10, and one without an end.
        let plateau = |x: f64| if x.abs() < 10.0 { 0.0 } else { 50.0 };
        assert!((8.0..=16.0).contains(&width(plateau, 1.0, 1.0)));
        assert_eq!(width(|_| 0.0, 1.0, 1.0), f64::INFINITY);
        // A limit that is better gone: the fall ends at some distance.
        let gone = |x: f64| if x < -2.0 { -40.0 } else { 20.0 * x };
        assert!((1.9..8.0).contains(&width(gone, 0.1, 1.0)));
    }

    #[test]
    fn a_limit_that_may_be_anywhere_is_not_established_and_one_that_is_reached_is() {
        let document = ModelDocument::from_toml(MODEL, std::path::Path::new("lag.toml")).unwrap();
        let system = System::new(&document, |_| Ok(0.0)).unwrap();
        let mut stops = Applied::nominal(&system, find("saturation").unwrap(), "u").unwrap();
        stops.values[1] = 0.7;
        let hypothesis = Hypothesis {
            effects: vec![stops],
            free: vec![(0, 1)],
            gain: 0.0,
            fitted: true,
            lost: None,
        };
        let apart = |std: Option<f64>| {
            Estimate { std: vec![std], together: None }.one_apart(&hypothesis, 0, NORMAL_95)
        };
        assert!(apart(Some(0.1)) && apart(None) && !apart(Some(f64::INFINITY)));
    }
}

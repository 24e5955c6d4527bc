//! The joint fit of a set: bounded Levenberg-Marquardt steps on the concentrated likelihood, with the initial states eliminated.
//!
//! How it can be wrong: a parameter without influence has no derivative, so it keeps its value and is not counted. A kink has no derivative, so limits are
//! moved by a larger step. The response to an initial state is that of the nominal model.

use nalgebra::{DMatrix, DVector};

use super::gram::{Gram, Left};
use super::removals::removals;
use super::score::Score;
use super::set::CauseSet;
use super::training::{Stacked, Training};
use crate::hypothesis::shared_time::{joined, leading, put};
use crate::likelihood::active_effects::ActiveEffects;
use deadtime_model::effect::{Applied, Parameter, Role, Scales};
use deadtime_signal::parallel;

/// Steps of a fit.
const STEPS: usize = 6;
/// A set that stays so far above the best is no alternative, and evidence beyond it is all alike.
const FAR: f64 = 100.0;
/// A step that lowers the score by less ends a fit: it changes no decision.
const SMALL: f64 = 0.3;
/// Derivatives are taken over this part of a parameter's distance from nominal: far above the tolerance of the integration.
const PART: f64 = 2e-3;
/// The same where the response has a kink.
const PART_AT_KINK: f64 = 2e-2;
/// An effect that moves the outputs by more than a hundred times the gap is as improbable as one that moves it a hundred times.
const MOST_MOVED: f64 = 1e4;
/// Damping of the first step, and its factor between trials.
const DAMPING: f64 = 1e-3;
const TRIALS: usize = 5;

/// The common inputs of all fits of a search.
pub(super) struct Fit<'f, 'l, 'a> {
    pub(super) training: &'f Training<'l, 'a>,
    pub(super) score: &'f Score,
    pub(super) scales: &'f Scales,
    /// The nominal model's residual.
    pub(super) nominal: &'f Stacked,
    /// The lowest score of all sets so far.
    pub(super) least: f64,
}

/// Derivatives of the predicted outputs at a set's values.
pub(super) struct Directions {
    /// One per free parameter; of a logarithmic one by its logarithm.
    pub(super) columns: Vec<Stacked>,
    pub(super) residual: Stacked,
}

impl Directions {
    /// The columns, then the residual.
    pub(super) fn all(&self) -> Vec<&Stacked> {
        self.columns.iter().chain([&self.residual]).collect()
    }
}

/// Normal prior on a free parameter: its deviation from the mean, and its standard deviation.
type Prior = Option<(f64, f64)>;

impl Fit<'_, '_, '_> {
    /// Fits a set from the values of its effects; `None` where it cannot be simulated. A decoded sequence is kept. Changes at nearby times are one event where
    /// the score is lower so.
    pub(super) fn of(&self, set: CauseSet) -> Option<CauseSet> {
        let mut best = self.once(set)?;
        loop {
            let one_event = |effects| {
                self.once(CauseSet::begun(effects, best.recalibration, best.lost.clone()))
            };
            let better = joined(&best.effects).into_iter().filter_map(one_event);
            let better = better.min_by(|a, b| self.score.total(a).total_cmp(&self.score.total(b)));
            match better.filter(|set| self.score.total(set) < self.score.total(&best)) {
                Some(set) => best = set,
                None => return Some(best),
            }
        }
    }

    /// Fits a set whose events are those of its effects' times.
    fn once(&self, mut set: CauseSet) -> Option<CauseSet> {
        set.free = free(&set.effects);
        let mut residual = self.training.residual(&set)?;
        let (mut value, mut left) = self.profiled(&residual, &self.priors(&set), None)?;
        let mut directions = None;
        let single = |(e, _): &&(usize, usize)| !set.recalibrates(&set.effects[*e]);
        let price = self
            .score
            .price(set.free.iter().filter(single).count(), self.score.choices(set.singly()));
        for step in 1..=STEPS {
            let at =
                Directions { columns: self.columns(&set, &residual), residual: residual.clone() };
            let gram = Gram::of(self.training, &at.all());
            directions = Some(gram.clone());
            let Some((better, there, cost, leaves)) = self.step(&set, &gram, &left.squares, value)
            else {
                break;
            };
            let fall = value - cost;
            (set.effects, residual, value, left) = (better, there, cost, leaves);
            // The reductions by steps decrease: the possible rest cannot bring the set near the best.
            let least = value + price - (STEPS - step) as f64 * fall;
            if fall < SMALL || least > self.least + FAR {
                break;
            }
        }
        let eliminated = directions?.eliminated(&self.score.weights(&left.squares))?;
        let moves = |at: &usize| eliminated.normal[(*at, *at)] > 0.0;
        let places: Vec<usize> = (0..set.free.len()).filter(moves).collect();
        let determinant = self.determinant(&set, &eliminated.normal);
        let with_priors = with_priors(&eliminated.normal, &self.priors(&set));
        set.removals = removals(&set, &set.free, &with_priors);
        let parameters: f64 =
            self.priors(&set).iter().flatten().map(|(off, s)| (off / s).powi(2)).sum();
        set.free = places.iter().map(|&at| set.free[at]).collect();
        let hidden = set.effects.iter().filter(|a| a.effect.loses_commands());
        set.acting = set.free.iter().filter(|(e, _)| !set.recalibrates(&set.effects[*e])).count()
            + hidden.map(|a| a.values.len()).sum::<usize>();
        let sequence = set.lost.as_ref().map_or(0.0, |lost| lost.price);
        set.priors = left.prior + parameters + determinant + sequence + self.moved_alone(&set);
        set.squares = left.squares;
        for applied in &mut set.effects {
            applied.values = applied.effect.canonical(std::mem::take(&mut applied.values));
        }
        Some(set)
    }

    /// A step from the values of this set is predicted to fit better than the finished fit of the same set. That fit ended at another minimum.
    pub(super) fn ended_elsewhere(&self, fitted: &CauseSet, from: &CauseSet) -> bool {
        let from = CauseSet { free: free(&from.effects), ..from.clone() };
        let predicted = || -> Option<f64> {
            let directions = self.directions(&from)?;
            let gram = Gram::of(self.training, &directions.all());
            let (lower, upper) = self.room(&from);
            let mut squares = self.training.squares(&directions.residual);
            for _ in 0..ROUNDS {
                let eliminated = gram.eliminated(&self.score.weights(&squares))?;
                let normal = with_priors(&eliminated.normal, &self.priors(&from));
                let steps = bounded(&normal, 0.0, &lower, &upper);
                squares = gram.left(&eliminated, &steps).squares;
            }
            Some(self.score.misfit(&squares))
        };
        predicted().is_some_and(|there| there < self.score.misfit(&fitted.squares) - SMALL)
    }

    /// Derivatives at the values of a set that is fitted; `None` where it cannot be simulated.
    pub(super) fn directions(&self, set: &CauseSet) -> Option<Directions> {
        let residual = self.training.residual(set)?;
        Some(Directions { columns: self.columns(set, &residual), residual })
    }

    /// The remainder of a residual after a fit of the initial states and nuisances.
    pub(super) fn remainder(&self, residual: &Stacked) -> Option<Stacked> {
        let gram = Gram::of(self.training, &[residual]);
        let mut squares = self.training.squares(residual);
        let mut eliminated = gram.eliminated(&self.score.weights(&squares))?;
        for _ in 0..ROUNDS {
            squares = gram.left(&eliminated, &DVector::zeros(0)).squares;
            eliminated = gram.eliminated(&self.score.weights(&squares))?;
        }
        Some(eliminated.remainder(self.training, residual))
    }

    /// The misfit with priors of a residual without a step, and the remaining residual.
    fn profiled(
        &self,
        residual: &Stacked,
        priors: &[Prior],
        squares: Option<&[f64]>,
    ) -> Option<(f64, Left)> {
        let gram = Gram::of(self.training, &[residual]);
        let mut squares = squares.map_or_else(|| self.training.squares(residual), <[f64]>::to_vec);
        let mut left = None;
        for _ in 0..ROUNDS {
            let eliminated = gram.eliminated(&self.score.weights(&squares))?;
            let there = gram.left(&eliminated, &DVector::zeros(0));
            squares.clone_from(&there.squares);
            left = Some(there);
        }
        let left = left?;
        let prior: f64 = priors.iter().flatten().map(|(off, s)| (off / s).powi(2)).sum();
        let value = self.score.misfit(&left.squares) + left.prior + prior;
        value.is_finite().then_some((value, left))
    }

    /// The best of several damped steps, simulated; `None` where none lowers the cost.
    fn step(
        &self,
        set: &CauseSet,
        gram: &Gram,
        squares: &[f64],
        value: f64,
    ) -> Option<(Vec<Applied>, Stacked, f64, Left)> {
        let priors = self.priors(set);
        let (lower, upper) = self.room(set);
        let mut damping = DAMPING;
        for _ in 0..TRIALS {
            let mut weights = self.score.weights(squares);
            let mut steps = DVector::zeros(set.free.len());
            // Weights follow the residual after the step.
            for _ in 0..2 {
                let eliminated = gram.eliminated(&weights)?;
                let normal = with_priors(&eliminated.normal, &priors);
                steps = bounded(&normal, damping, &lower, &upper);
                weights = self.score.weights(&gram.left(&eliminated, &steps).squares);
            }
            if steps.iter().all(|v| *v == 0.0) {
                return None;
            }
            let effects = moved(set, &steps, self.scales);
            let there = CauseSet { effects, ..set.clone() };
            if let Some(residual) = self.training.residual(&there) {
                let found = self.profiled(&residual, &self.priors(&there), Some(squares));
                if let Some((cost, left)) = found.filter(|(cost, _)| *cost < value) {
                    return Some((there.effects, residual, cost, left));
                }
            }
            damping = (10.0 * damping).max(0.1);
        }
        None
    }

    /// Derivatives of the outputs by the free parameters; 0 where a simulation fails on both sides.
    fn columns(&self, set: &CauseSet, residual: &Stacked) -> Vec<Stacked> {
        let one = |&(e, i): &(usize, usize)| {
            let (p, value) = (&set.effects[e].parameters[i], set.effects[e].values[i]);
            let least = self.least(&set.effects[e], i);
            let (step, unit) = (derivative_step(p, value, least, self.scales), unit(p, value));
            [step, -step]
                .into_iter()
                .find_map(|h| {
                    let mut effects = set.effects.clone();
                    put(&mut effects, (e, i), value + h);
                    let moved = self.training.residual(ActiveEffects::from(set).with(&effects))?;
                    let scale = unit / h;
                    Some(residual.iter().zip(&moved).map(|(a, b)| (a - b) * scale).collect())
                })
                .unwrap_or_else(|| residual.iter().map(|r| DVector::zeros(r.len())).collect())
        };
        parallel::map(set.free.iter(), one)
    }

    /// The least distance from nominal that a derivative is taken over, before `PART`: 10 % of that of the smallest first guess. Nearer to nominal an effect is lost in the
    /// tolerance of the integration.
    fn least(&self, applied: &Applied, i: usize) -> f64 {
        let p = &applied.parameters[i];
        let guesses = applied.starts(self.training.likelihood.system, self.scales);
        let away = guesses.iter().filter_map(|guess| guess.get(i)).map(|v| p.departure(*v));
        let least = away.filter(|d| *d > 0.0 && d.is_finite()).fold(f64::INFINITY, f64::min);
        if least.is_finite() { 0.1 * least } else { 0.0 }
    }

    /// The bounds of the next step.
    fn room(&self, set: &CauseSet) -> (Vec<f64>, Vec<f64>) {
        let one = |&(e, i): &(usize, usize)| {
            let (lower, upper) = set.effects[e].range(i, self.scales);
            let (p, value) = (&set.effects[e].parameters[i], set.effects[e].values[i]);
            if is_logarithmic(p, value) {
                let log = |bound: f64| (bound.max(f64::MIN_POSITIVE) / value).ln();
                (log(lower).min(0.0), log(upper).max(0.0))
            } else {
                ((lower - value).min(0.0), (upper - value).max(0.0))
            }
        };
        set.free.iter().map(one).unzip()
    }

    /// Per free parameter, its prior: of the joint recalibration only.
    fn priors(&self, set: &CauseSet) -> Vec<Prior> {
        set.free
            .iter()
            .map(|&(e, i)| {
                let applied = &set.effects[e];
                let size = set.recalibration.filter(|_| set.recalibrates(applied))?;
                let nominal = applied.parameters[i].nominal;
                Some((applied.values[i] - nominal, size * nominal.abs()))
            })
            .collect()
    }

    /// ln det(I + s p₀ H s p₀) over the parameters of the joint recalibration.
    fn determinant(&self, set: &CauseSet, normal: &DMatrix<f64>) -> f64 {
        let block: Vec<(usize, f64)> = self
            .priors(set)
            .iter()
            .enumerate()
            .filter_map(|(at, prior)| Some((at, prior.as_ref()?.1)))
            .collect();
        let size = block.len();
        let matrix = DMatrix::from_fn(size, size, |i, j| {
            let ((a, s), (b, t)) = (block[i], block[j]);
            s * normal[(a, b)] * t + if i == j { 1.0 } else { 0.0 }
        });
        let factor = if size == 0 { None } else { matrix.cholesky() };
        factor.map_or(0.0, |c| 2.0 * c.l_dirty().diagonal().iter().map(|v| v.ln()).sum::<f64>())
    }

    /// Per effect, its response alone over the whole gap, every output over its variance.
    fn moved_alone(&self, set: &CauseSet) -> f64 {
        let relative = |squares: &[f64]| -> f64 {
            squares
                .iter()
                .zip(&self.training.variances)
                .filter(|(_, v)| **v > 0.0)
                .map(|(s, v)| s / v)
                .sum()
        };
        let gap = relative(&self.training.squares(self.nominal)).max(f64::MIN_POSITIVE);
        let one = |applied: &Applied| {
            let alone = self.training.residual(&set.with(vec![applied.clone()]));
            let moved = alone.map(|alone| -> Stacked {
                alone.iter().zip(self.nominal).map(|(a, b)| a - b).collect()
            });
            moved.map_or(MOST_MOVED, |m| {
                (relative(&self.training.squares(&m)) / gap).min(MOST_MOVED)
            })
        };
        set.singly().map(one).sum()
    }
}

/// Rounds in which weights and nuisances follow each other.
pub(super) const ROUNDS: usize = 3;

/// Parameters that a fit may change: finite ones of effects that are no hidden sequence, and of each event one time.
fn free(effects: &[Applied]) -> Vec<(usize, usize)> {
    effects
        .iter()
        .enumerate()
        .filter(|(_, a)| !a.effect.loses_commands() && !a.effect.leaves_residual())
        .flat_map(|(e, a)| {
            (0..a.values.len()).filter(|&i| a.values[i].is_finite()).map(move |i| (e, i))
        })
        .filter(|at| leading(effects, *at) == *at)
        .collect()
}

/// Frequencies and damping ratios are fitted as logarithms.
fn is_logarithmic(p: &Parameter, value: f64) -> bool {
    matches!(p.role, Role::Frequency | Role::Damping) && value > 0.0
}

fn unit(p: &Parameter, value: f64) -> f64 {
    if is_logarithmic(p, value) { value } else { 1.0 }
}

/// The step of a derivative, inside the upper bound.
fn derivative_step(p: &Parameter, value: f64, least: f64, scales: &Scales) -> f64 {
    let part = if p.role == Role::Limit { PART_AT_KINK } else { PART };
    let step = (part * p.departure(value).max(least)).max(p.derivative_step(value, scales).abs());
    if value + step > p.upper { -step } else { step }
}

/// The set's effects after steps of its free parameters.
fn moved(set: &CauseSet, steps: &DVector<f64>, scales: &Scales) -> Vec<Applied> {
    let mut effects = set.effects.clone();
    for (&(e, i), step) in set.free.iter().zip(steps.iter()) {
        let (p, value) = (&set.effects[e].parameters[i], set.effects[e].values[i]);
        let there = if is_logarithmic(p, value) { value * step.exp() } else { value + step };
        let (lower, upper) = set.effects[e].range(i, scales);
        put(&mut effects, (e, i), there.clamp(lower.min(value), upper.max(value)));
    }
    effects
}

/// Normal equations in which free parameters have priors; the residual is their last column.
fn with_priors(normal: &DMatrix<f64>, priors: &[Prior]) -> DMatrix<f64> {
    let (mut normal, last) = (normal.clone(), normal.ncols() - 1);
    for (at, prior) in priors.iter().enumerate() {
        let Some((off, std)) = prior else { continue };
        let precision = std.powi(-2);
        normal[(at, at)] += precision;
        normal[(at, last)] -= off * precision;
        normal[(last, at)] = normal[(at, last)];
    }
    normal
}

/// The minimum of a damped quadratic form inside bounds, found by fixing the violated coordinates one at a time. A coordinate without influence does not move.
pub(super) fn bounded(
    normal: &DMatrix<f64>,
    damping: f64,
    lower: &[f64],
    upper: &[f64],
) -> DVector<f64> {
    let count = normal.ncols() - 1;
    let mut steps = DVector::zeros(count);
    let mut open: Vec<usize> = (0..count).filter(|&i| normal[(i, i)] > 0.0).collect();
    while !open.is_empty() {
        let unit: Vec<f64> = open.iter().map(|&i| normal[(i, i)].sqrt()).collect();
        let size = open.len();
        let matrix = DMatrix::from_fn(size, size, |a, b| {
            let scaled = normal[(open[a], open[b])] / (unit[a] * unit[b]);
            if a == b { scaled * (1.0 + damping) } else { scaled }
        });
        let towards = DVector::from_fn(size, |a, _| {
            let fixed: f64 = (0..count)
                .filter(|j| !open.contains(j))
                .map(|j| normal[(open[a], j)] * steps[j])
                .sum();
            (normal[(open[a], count)] - fixed) / unit[a]
        });
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&towards)) else { break };
        for (a, &i) in open.iter().enumerate() {
            steps[i] = solved[a] / unit[a];
        }
        let beyond =
            |i: usize| (lower[i] - steps[i]).max(steps[i] - upper[i]) * normal[(i, i)].sqrt();
        let worst = open.iter().copied().max_by(|&a, &b| beyond(a).total_cmp(&beyond(b)));
        match worst.filter(|&i| beyond(i) > 0.0) {
            Some(i) => {
                steps[i] = steps[i].clamp(lower[i], upper[i]);
                open.retain(|&j| j != i);
            }
            None => break,
        }
    }
    for i in 0..count {
        steps[i] = steps[i].clamp(lower[i], upper[i]);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A positive definite form of three parameters, the residual last, and their bounds.
    fn problem() -> impl Strategy<Value = (DMatrix<f64>, Vec<f64>, Vec<f64>)> {
        let numbers = prop::collection::vec(-1.0..1.0, 16);
        let ends = prop::collection::vec((-2.0..0.0, 0.0..2.0), 3);
        (numbers, ends).prop_map(|(numbers, ends)| {
            let root = DMatrix::from_vec(4, 4, numbers) + DMatrix::identity(4, 4) * 1.5;
            let (lower, upper) = ends.into_iter().unzip();
            (root.tr_mul(&root), lower, upper)
        })
    }

    proptest! {
        /// The derivative of ½xᵀHx − gᵀx is 0 inside the bounds and points outwards at them (Karush 1939), where one parameter at most leaves them.
        #[test]
        fn a_bounded_minimum_fulfils_the_conditions_of_karush((normal, lower, upper) in problem()) {
            let steps = bounded(&normal, 0.0, &lower, &upper);
            let free = normal.view((0, 0), (3, 3)).into_owned();
            let towards = normal.view((0, 3), (3, 1)).column(0).into_owned();
            let slope = &free * &steps - towards;
            for i in 0..3 {
                prop_assert!(steps[i] >= lower[i] && steps[i] <= upper[i]);
                let inside = steps[i] > lower[i] && steps[i] < upper[i];
                prop_assert!(!inside || slope[i].abs() < 1e-9, "{slope}");
            }
        }

        #[test]
        fn what_has_no_influence_stays((mut normal, lower, upper) in problem()) {
            normal.row_mut(1).fill(0.0);
            normal.column_mut(1).fill(0.0);
            prop_assert_eq!(bounded(&normal, 0.0, &lower, &upper)[1], 0.0);
        }
    }
}

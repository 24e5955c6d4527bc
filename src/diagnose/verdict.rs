//! The verdict: no effect, an effect, two of them, or something that is in no catalogue.

use nalgebra::DMatrix;

use super::data::{Record, Span};
use super::explanation::Explanation;
use super::floor::{self, Floor};
use super::intervals;
use super::problem::{Acting, NOTHING, Problem};
use super::rank::{leader, odds};
use super::related;
use super::search::Found;
use super::shrink::{self, Errors, together};
use crate::effect::{Applied, Scales};

/// A residual this many times its floor has something left in it that an effect did not explain.
const ABOVE_FLOOR: f64 = 1.5;
/// The same where no effect helps at all: a gap worth the name is well above the noise.
const ABOVE_FLOOR_ALONE: f64 = 1.75;
/// An effect that lowers the rms of no output by this factor is within the noise: the model as it is stands at the floor. A second effect likewise.
const MATTERS: [f64; 2] = [1.3, 1.25];
/// The share of the explainable that one effect must explain, and two.
const EXPLAINS: [f64; 2] = [0.93, 0.97];
/// The share of the explainable that one effect, and two, must explain on held-out data: less, and they describe the training logs and no cause.
const GENERALISES: [f64; 2] = [0.5, 0.75];

/// The verdict and what it rests on.
pub(super) struct Judged {
    pub(super) verdict: Verdict,
    /// What was found to act; `None` for the other verdicts.
    pub(super) found: Option<Explanation>,
    /// What explains best, even where the verdict is another.
    pub(super) best: Option<Explanation>,
    /// Probability of `unknown`.
    pub(super) unknown: f64,
    /// How many times the noise floor is left, where that is more than noise: on the output on which the verdict was decided.
    pub(super) left_over: Option<f64>,
    pub(super) floor: Floor,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    None,
    Unknown,
    Effects,
}

/// Residuals of one explanation with their sizes.
struct Level {
    explanation: Option<Explanation>,
    residuals: Vec<DMatrix<f64>>,
    train: Errors,
    held: Errors,
}

impl Level {
    fn of(problem: &Problem<'_>, explanation: Option<&Explanation>) -> Option<Self> {
        let residuals = shrink::residuals(problem, explanation.map_or(NOTHING, Acting::from))?;
        let errors = |span: &dyn Fn(&Record) -> Option<Span>| Errors::of(problem.records, &residuals, span);
        let (train, held) = (errors(&|r| r.train), errors(&|r| r.held));
        Some(Self { explanation: explanation.cloned(), residuals, train, held })
    }

    fn odds(&self, weight: f64) -> f64 {
        self.explanation.as_ref().map_or(0.0, |e| odds(e, weight))
    }

    /// Noise decides single samples: its lattice speaks for it.
    fn is_chance(&self) -> bool {
        self.explanation.as_ref().is_some_and(|e| e.effects.iter().any(|a| a.effect.leaves_residual()))
    }

    /// Training errors without the effects whose single samples noise decides: beside a lattice, a little more or less of anything moves many samples.
    fn smooth(&self, problem: &Problem<'_>) -> Option<Errors> {
        let Some(explanation) = self.explanation.as_ref().filter(|_| self.is_chance()) else { return Some(self.train.clone()) };
        let effects: Vec<Applied> = explanation.effects.iter().filter(|a| !a.effect.leaves_residual()).cloned().collect();
        let acting = Acting::from(explanation).with(&effects);
        Some(Errors::of(problem.records, &shrink::residuals(problem, acting)?, |r| r.train))
    }

    fn size(&self) -> usize {
        self.explanation.as_ref().map_or(0, |e| e.effects.len())
    }
}

/// `after` lowers the rms of some output by more than a factor.
fn matters(before: &Errors, after: &Errors, factor: f64) -> bool {
    before.nrmse().iter().zip(after.nrmse()).any(|(b, a)| b.zip(a).is_some_and(|(b, a)| b > factor * a))
}

/// Decides between no effect, the leaders of the search and something that is in no catalogue; `None` where the model cannot be simulated.
pub(super) fn judge(problem: &Problem<'_>, found: &Found, catalogue: &[Applied], scales: &Scales) -> Option<Judged> {
    let weight = problem.weight();
    let nothing = Level::of(problem, None)?;
    let mut best = Level::of(problem, None)?;
    let mut reached = vec![(nothing.train.clone(), nothing.residuals.clone())];
    for (size, explanations) in [&found.singles, &found.pairs].into_iter().enumerate() {
        let Some(next) = leader(explanations, weight).and_then(|e| Level::of(problem, Some(e))) else { continue };
        reached.push((next.train.clone(), next.residuals.clone()));
        let better = next.odds(weight) > best.odds(weight);
        // A lattice needs not lower the error to be seen.
        let lattice = next.is_chance() && !best.is_chance();
        let matters = lattice || matters(&best.smooth(problem)?, &next.smooth(problem)?, MATTERS[size]);
        // Two effects are named only where each is more than a nominal model that is a little off.
        let established = |e: &Explanation| e.effects.len() < 2 || intervals::established(problem, e, scales);
        if better && matters && next.explanation.as_ref().is_none_or(established) {
            best = next;
        }
    }
    let acting = best.explanation.as_ref().map_or(NOTHING, Acting::from);
    let related = related::shares(problem, acting, &best.residuals, catalogue, scales);
    let floor = floor::estimate(problem, &best.residuals, &reached, &related);
    let (all, left) = (nothing.train.nrmse(), best.train.nrmse());
    let noise = best.train.relative(&floor.floor);
    let size = best.size();
    let chance = best.is_chance() && size > 0;
    // Judged on the output that gains most; where nothing gains, on the one that is furthest above its floor.
    let gained = |i: usize| Some(all[i]?.powi(2) - left[i]?.powi(2));
    let ratio = |i: usize| Some(left[i]? / noise[i]?.max(1e-9));
    let by = |key: &dyn Fn(usize) -> Option<f64>| (0..all.len()).max_by(|&a, &b| key(a).unwrap_or(0.0).total_cmp(&key(b).unwrap_or(0.0)));
    let decisive = if size > 0 { by(&gained) } else { by(&ratio) };
    let mut unknown: f64 = 0.0;
    let mut left_over = None;
    if let Some(i) = decisive
        && let (Some(all), Some(left), Some(noise)) = (all[i], left[i], noise[i])
    {
        let above = left / noise.max(1e-9);
        let share = if all > noise { (all * all - left * left) / (all * all - noise * noise) } else { 1.0 };
        let limit = if size > 0 { ABOVE_FLOOR } else { ABOVE_FLOOR_ALONE };
        left_over = Some(above).filter(|above| *above > limit && !chance);
        if above > limit && share < EXPLAINS[size.clamp(1, 2) - 1] && !chance {
            unknown = 1.0 - 0.5 * (limit - above).exp();
        }
    }
    // What does not hold on data that it was not fitted to is no explanation.
    let held = |e: &Errors| together(&e.nrmse()).unwrap_or(0.0);
    let (b, a, f) = (held(&nothing.held), held(&best.held), together(&nothing.held.relative(&floor.floor)).unwrap_or(0.0));
    if size > 0 && !chance && b * b - a * a < GENERALISES[size.min(2) - 1] * (b * b - f * f).max(0.0) {
        unknown = f64::max(unknown, 0.9);
    }
    let verdict = match (unknown > 0.5, size) {
        (true, _) => Verdict::Unknown,
        (false, 0) => Verdict::None,
        (false, _) => Verdict::Effects,
    };
    // What one of several explains alone orders them.
    let alone = |a: &Applied| found.singles.iter().find(|s| s.effects.iter().all(|e| e.key() == a.key())).map_or(0.0, |s| s.gain);
    let best = best.explanation.map(|e| e.ordered(alone));
    Some(Judged { verdict, found: best.clone().filter(|_| verdict == Verdict::Effects), best, unknown, left_over, floor })
}

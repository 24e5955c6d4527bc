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
/// An effect that lowers the rms of no output by this factor is within the noise: the model as it is stands at the floor. A second effect likewise,
/// on the training logs and the held-out data together.
const MATTERS: [f64; 2] = [1.3, 1.25];
/// The same once more for every parameter beyond a second effect's first: what can take many shapes takes that of a simulator's own errors, too.
const FLEXIBLE: f64 = 1.1;
/// A second effect that lowers the rms by this factor is no simulator's own error, however little is known of its parameters.
const CLEAR: f64 = 2.0;
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
    /// The output on which the verdict was decided, and how many times the noise floor is left of it, where that is more than noise.
    pub(super) left_over: Option<(usize, f64)>,
    /// Twice the log-likelihood that a further effect would gain which does not matter: so far off is the simulator beside what was found.
    pub(super) inexact: f64,
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
    /// Mean squares of the whitened residuals, on the training and on the held-out data: the error beside noise of its colour.
    white: [f64; 2],
}

impl Level {
    fn of(problem: &Problem<'_>, explanation: Option<&Explanation>) -> Option<Self> {
        let residuals = shrink::residuals(problem, explanation.map_or(NOTHING, Acting::from))?;
        let errors = |span: &dyn Fn(&Record) -> Option<Span>| Errors::of(problem.records, &residuals, span);
        let (train, held) = (errors(&|r| r.train), errors(&|r| r.held));
        let white = [white(problem, &residuals, |r| r.train), white(problem, &residuals, |r| r.held)];
        Some(Self { explanation: explanation.cloned(), residuals, train, held, white })
    }

    fn gain(&self) -> f64 {
        self.explanation.as_ref().map_or(0.0, |e| e.gain)
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

/// Mean square of the whitened residuals inside a span.
fn white(problem: &Problem<'_>, residuals: &[DMatrix<f64>], span: impl Fn(&Record) -> Option<Span>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for ((at, record), residual) in problem.records.iter().enumerate().zip(residuals) {
        let Some(inside) = span(record) else { continue };
        sum += problem.whiten_in(at, residual, inside).norm_squared();
        let there = |i: usize| (0..record.time_s.len()).filter(move |&k| record.measured_in(Some(inside), i, k).is_some()).count();
        count += (0..record.measured.len()).map(there).sum::<usize>();
    }
    sum / count.max(1) as f64
}

/// `after` lowers the whitened error by more than a factor, on data that it was not fitted to as well: what noise with a long memory hides from the rms.
fn stands_out(before: &Level, after: &Level, factor: f64) -> bool {
    !after.is_chance() && before.white.iter().zip(after.white).all(|(b, a)| *b > factor * factor * a)
}

/// `after` lowers the rms of some output by more than a factor; `held` too, errors of the held-out data, where a second effect is asked for: the geometric mean.
fn matters(before: &Errors, after: &Errors, held: Option<[&Errors; 2]>, factor: f64) -> bool {
    let falls = |before: &Errors, after: &Errors| -> Vec<Option<f64>> {
        before.nrmse().iter().zip(after.nrmse()).map(|(b, a)| b.zip(a).map(|(b, a)| b / a)).collect()
    };
    let elsewhere = held.map(|[before, after]| falls(before, after));
    // An output without a held-out sample has only the one.
    let together = |(i, fall): (usize, f64)| elsewhere.as_ref().and_then(|e| e[i]).map_or(fall, |there| (fall * there).sqrt());
    falls(before, after).into_iter().enumerate().filter_map(|(i, fall)| Some((i, fall?))).map(together).any(|fall| fall > factor)
}

/// The factor by which an explanation must lower the error of the one before it.
fn needed(before: &Level, after: &Level) -> f64 {
    let parameters = |level: &Level| level.explanation.as_ref().map_or(0, |e| e.free.len());
    let steps: f64 = MATTERS[before.size().min(1)..after.size().min(2)].iter().product();
    let further = if after.size() > 1 { parameters(after).saturating_sub(parameters(before) + after.size() - before.size()) } else { 0 };
    let flexible = FLEXIBLE.powf(further as f64);
    steps * flexible
}

/// Decides between no effect, the leaders of the search and something that is in no catalogue; `None` where the model cannot be simulated.
pub(super) fn judge(problem: &Problem<'_>, found: &Found, catalogue: &[Applied], scales: &Scales) -> Option<Judged> {
    let weight = problem.weight();
    let nothing = Level::of(problem, None)?;
    let mut best = Level::of(problem, None)?;
    // Something beats no effect, by whatever measure; the best matters only beside noise of its colour; what a further effect would gain that does not matter.
    let (mut beaten, mut hidden, mut inexact) = (false, false, 0.0);
    let mut reached = vec![(nothing.train.clone(), nothing.residuals.clone())];
    for (size, explanations) in [&found.singles, &found.pairs].into_iter().enumerate() {
        let Some(next) = leader(explanations, weight).and_then(|e| Level::of(problem, Some(e))) else { continue };
        reached.push((next.train.clone(), next.residuals.clone()));
        let better = next.odds(weight) > best.odds(weight);
        // A lattice needs not lower the error to be seen.
        let lattice = next.is_chance() && !best.is_chance();
        let factor = needed(&best, &next);
        let held = (size > 0).then_some([&best.held, &next.held]);
        let (before, after) = (best.smooth(problem)?, next.smooth(problem)?);
        let clear = matters(&before, &after, held, factor.max(CLEAR));
        let matters = lattice || matters(&before, &after, held, factor);
        // Two effects that do not matter clearly are named only where each is more than a nominal model that is a little off.
        let established = |e: &Explanation| e.effects.len() < 2 || clear || intervals::established(problem, e, scales);
        beaten |= better;
        if better && (matters || stands_out(&best, &next, factor)) && next.explanation.as_ref().is_none_or(established) {
            hidden = !matters;
            best = next;
        } else if better && best.size() > 0 {
            inexact = next.gain() - best.gain();
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
        let limit = if size > 0 || beaten { ABOVE_FLOOR } else { ABOVE_FLOOR_ALONE };
        left_over = Some((i, above)).filter(|(_, above)| *above > limit && !chance);
        if above > limit && share < EXPLAINS[size.clamp(1, 2) - 1] && !chance {
            unknown = 1.0 - 0.5 * (limit - above).exp();
        }
    }
    // What does not hold on data that it was not fitted to is no explanation. A single effect answers for that output, a pair for all of them; what matters
    // only beside noise of its colour is asked by that measure.
    let held = |each: Vec<Option<f64>>| if size == 1 { decisive.and_then(|i| each[i]) } else { together(&each) }.unwrap_or(0.0);
    let (before, after, noise) = if hidden {
        (nothing.white[1].sqrt(), best.white[1].sqrt(), best.white[0].sqrt())
    } else {
        (held(nothing.held.nrmse()), held(best.held.nrmse()), held(nothing.held.relative(&floor.floor)))
    };
    let taken = before * before - after * after;
    if size > 0 && !chance && taken < GENERALISES[size.min(2) - 1] * (before * before - noise * noise).max(0.0) {
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
    Some(Judged { verdict, found: best.clone().filter(|_| verdict == Verdict::Effects), best, unknown, left_over, inexact, floor })
}

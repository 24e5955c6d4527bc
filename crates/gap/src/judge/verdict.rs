//! The verdict: no effect, an effect, two effects, or a cause outside the catalogue.

use nalgebra::DMatrix;

use super::explainable;
use super::floor;
use super::floor::Floor;
use super::intervals;
use super::rule::{GapVerdict, Levels, Ruling, Sizes, rule};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::hypothesis::penalised_gain::Penalties;
use crate::input::criteria::Criteria;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::{Applied, Scales};

/// The verdict and its inputs.
pub(crate) struct Judged {
    pub(crate) verdict: GapVerdict,
    /// The effects of the verdict; `None` for the other verdicts.
    pub(crate) found: Option<Hypothesis>,
    /// The best hypothesis, also under another verdict.
    pub(crate) best: Option<Hypothesis>,
    /// Probability of `unknown`.
    pub(crate) unknown: f64,
    /// The output on which the verdict was decided, and how many times the noise floor is left of it, where that is more than noise.
    pub(crate) left_over: Option<(usize, f64)>,
    /// The residual is noise, or within the inexactness of every simulator.
    pub(crate) complete: bool,
    /// Twice the log-likelihood gain of a further effect that does not matter: the simulator's own error, given the reported effects.
    pub(crate) inexact: f64,
    pub(crate) floor: Floor,
    /// The effect that is not named, because the model's numbers, each a little off, explain as much.
    pub(crate) of_the_numbers: Option<String>,
}

impl Judged {
    /// A verdict that names nothing yet.
    pub(crate) fn of(
        Ruling { verdict, unknown, left_over, complete }: Ruling,
        floor: Floor,
    ) -> Self {
        Self {
            verdict,
            found: None,
            best: None,
            unknown,
            left_over,
            complete,
            inexact: 0.0,
            floor,
            of_the_numbers: None,
        }
    }
}

/// `after` lowers the whitened error by more than a factor: what noise with a long memory hides from the rms.
fn stands_out(before: &Level, after: &Level, factor: f64) -> bool {
    !after.is_chance() && before.white > factor * factor * after.white
}

/// The factor by which a hypothesis must lower the error of the one before it.
fn needed(before: &Level, after: &Level, criteria: &Criteria) -> f64 {
    let parameters = |level: &Level| level.hypothesis.as_ref().map_or(0, |e| e.free.len());
    let steps: f64 = [criteria.first_matters, criteria.second_matters]
        [before.size().min(1)..after.size().min(2)]
        .iter()
        .product();
    let further = if after.size() > 1 {
        parameters(after).saturating_sub(parameters(before) + after.size() - before.size())
    } else {
        0
    };
    let flexible = criteria.flexible.powf(further as f64);
    steps * flexible
}

/// Decides between no effect, the leaders of the search and something that is in no catalogue; `None` where the model cannot be simulated.
pub(crate) fn judge(
    likelihood: &Likelihood<'_>,
    found: &SearchResult,
    catalogue: &[Applied],
    scales: &Scales,
) -> Option<Judged> {
    let (criteria, penalties) = (likelihood.criteria, Penalties::of(likelihood));
    let nothing = Level::of(likelihood, None)?;
    let mut best = Level::of(likelihood, None)?;
    // Some hypothesis is better than no effect, by any measure; the gain of a further irrelevant effect.
    let (mut beaten, mut inexact) = (false, 0.0);
    let mut reached = vec![nothing.noise(likelihood)];
    for hypotheses in [&found.singles, &found.pairs] {
        let Some(next) = penalties.leader(hypotheses).and_then(|e| Level::of(likelihood, Some(e)))
        else {
            continue;
        };
        reached.push(next.noise(likelihood));
        let better = next.penalised_gain(&penalties) > best.penalised_gain(&penalties);
        // A lattice needs not lower the error to be seen.
        let lattice = next.is_chance() && !best.is_chance();
        let factor = needed(&best, &next, &criteria);
        let (before, after) = (best.smooth(likelihood)?, next.smooth(likelihood)?);
        let clear = before.largest_fall(&after) > factor.max(criteria.clear);
        let matters = lattice || before.largest_fall(&after) > factor;
        // Two effects that do not matter clearly are named only where each is more than a nominal model that is a little off.
        let established = |e: &Hypothesis| {
            e.effects.len() < 2 || clear || intervals::established(likelihood, e, scales)
        };
        beaten |= better;
        if better
            && (matters || stands_out(&best, &next, factor))
            && next.hypothesis.as_ref().is_none_or(established)
        {
            best = next;
        } else if better && best.size() > 0 {
            inexact = next.gain() - best.gain();
        }
    }
    let (floor, Ruling { verdict, unknown, left_over, complete }) =
        ruled(likelihood, [&nothing, &best], &reached, catalogue, scales, beaten);
    // Several effects are ordered by the part that each explains alone.
    let alone = |a: &Applied| {
        found
            .singles
            .iter()
            .find(|s| s.effects.iter().all(|e| e.key() == a.key()))
            .map_or(0.0, |s| s.gain)
    };
    let best = best.hypothesis.map(|e| e.ordered(alone));
    Some(Judged {
        verdict,
        found: best.clone().filter(|_| verdict == GapVerdict::Effects),
        best,
        unknown,
        left_over,
        complete,
        inexact,
        floor,
        of_the_numbers: None,
    })
}

/// The noise floor given the best hypothesis, and the ruling that follows. `reached`: errors and residuals of the leading hypotheses, no effect first.
/// The floor is never above the residual of any of them. `beaten`: some hypothesis beats no effect by any measure.
pub(crate) fn ruled(
    likelihood: &Likelihood<'_>,
    [nothing, best]: [&Level; 2],
    reached: &[(Errors, Vec<DMatrix<f64>>)],
    catalogue: &[Applied],
    scales: &Scales,
    beaten: bool,
) -> (Floor, Ruling) {
    let active = best.hypothesis.as_ref().map_or(NO_EFFECT, ActiveEffects::from);
    let explainable = explainable::shares(likelihood, active, &best.residuals, catalogue, scales);
    let floor = floor::estimate(likelihood, &best.noise(likelihood).1, reached, &explainable);
    let sizes = |before: &Errors, after: &Errors| Sizes {
        before: before.nrmse(),
        after: after.nrmse(),
        floor: before.relative(&floor.floor),
    };
    let levels = Levels {
        train: sizes(&nothing.train, &best.train),
        effects: best.size(),
        chance: best.is_chance(),
        beaten,
    };
    let ruling = rule(&levels, &likelihood.criteria);
    (floor, ruling)
}

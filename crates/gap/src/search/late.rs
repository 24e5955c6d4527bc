//! Late commands instead of lost ones: the same latent sequence with another cause.

use crate::hypothesis::direction::with;
use crate::hypothesis::effects::{Dropouts, Hypothesis};
use crate::hypothesis::waits;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Lateness};

/// Commands hide each other where losses leave so many times what delays leave that were decoded by themselves; 1. Chosen: 1.5 to 2.5 times in tests where commands
/// rest for a while, 4.5 to 100 times where they never do.
const HIDDEN: f64 = 3.5;

/// Adds to every hypothesis that loses commands the one whose commands are late, with the same trajectory; both pay for the waits of commands alike.
pub(crate) fn add_late_twins(likelihood: &Likelihood<'_>, hypotheses: &mut Vec<Hypothesis>) {
    let twins: Vec<Hypothesis> = hypotheses
        .iter_mut()
        .filter(|e| e.fitted)
        .filter_map(|e| priced_with_twin(likelihood, e))
        .collect();
    let nominal = likelihood.whitened(NO_EFFECT).map_or(0.0, |w| likelihood.inner(&w, &w));
    for twin in twins {
        // The same law may have been decoded by itself. Where commands are visible one by one their waits are known, and both reasons have equal prices. Where
        // commands hide each other, delays explain much more than losses.
        let explained = |e: &Hypothesis| e.gain + e.lost.as_ref().map_or(0.0, |l| l.price);
        let much = |e: &Hypothesis| nominal - explained(&twin) > HIDDEN * (nominal - explained(e));
        if hypotheses
            .iter()
            .any(|e| e.key() == twin.key() && e.lost.is_some() && e.gain >= twin.gain && much(e))
        {
            continue;
        }
        hypotheses.retain(|e| e.key() != twin.key());
        hypotheses.push(twin);
    }
    hypotheses.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

fn priced_with_twin(
    likelihood: &Likelihood<'_>,
    hypothesis: &mut Hypothesis,
) -> Option<Hypothesis> {
    let place =
        hypothesis.effects.iter().position(|a| a.effect.lateness() == Some(Lateness::Lost))?;
    let channel = hypothesis.effects[place].channel.clone();
    let input = likelihood.system.inputs.iter().position(|p| p.name == channel)?;
    let own = hypothesis.lost.as_ref()?.waits.get(input)?.clone();
    let late =
        Applied::nominal(likelihood.system, Lateness::Random.effect().ok()?, &channel).ok()?;
    let [delay_s, spread_s] = waits::delay_and_spread(&own);
    if waits::steady(&own) {
        // All waited alike: a delay, and nothing that chance decides.
        hypothesis.gain = f64::NEG_INFINITY;
        return None;
    }
    let as_lost = waits::as_lost(&own);
    let mut twin = hypothesis.clone();
    repriced(hypothesis, as_lost - waits::as_lost_alone(&own));
    repriced(&mut twin, waits::as_late(&own) - waits::as_lost_alone(&own));
    twin.effects[place] = with(&late, &[delay_s, spread_s, 1.0]);
    if let Some(Dropouts { std, .. }) = &mut twin.lost {
        // A mean, and a standard deviation, which so many waits tell better by √2.
        let of_mean = spread_s / (own.len() as f64).sqrt();
        std[input] = if own.len() > 1 {
            vec![of_mean, of_mean * std::f64::consts::FRAC_1_SQRT_2]
        } else {
            Vec::new()
        };
    }
    twin.effects.sort_by_key(|a| deadtime_model::effect::row(a.effect));
    // None of a hidden sequence's numbers is free; those of the others keep their places.
    let places: Vec<usize> = hypothesis
        .effects
        .iter()
        .enumerate()
        .filter(|(at, _)| *at != place)
        .map(|(at, _)| at)
        .collect();
    let moved = |at: usize| {
        twin.effects
            .iter()
            .position(|a| places.contains(&at) && a.key() == hypothesis.effects[at].key())
    };
    twin.free = hypothesis.free.iter().filter_map(|&(at, i)| Some((moved(at)?, i))).collect();
    Some(twin)
}

/// Pays more for its sequence, or less.
fn repriced(hypothesis: &mut Hypothesis, by: f64) {
    hypothesis.gain -= by;
    if let Some(lost) = &mut hypothesis.lost {
        lost.price += by;
    }
}

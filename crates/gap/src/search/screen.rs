//! The screen: every candidate of the catalogue by its signature.

use crate::hypothesis::direction::{NEAR, between, difference, has_limit, with};
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Parameter, Scales};
use deadtime_signal::parallel;

/// The number of halvings of a step along a signature before it is given up.
const HALVINGS: i32 = 5;

/// The residual is proportional to the size where a signature near nominal and one at the first guess differ by at most this part.
const PROPORTIONAL: f64 = 1e-9;

/// A candidate with its starts, best first.
pub(crate) struct Screened {
    pub(crate) applied: Applied,
    pub(crate) starts: Vec<Vec<f64>>,
    pub(crate) gain: f64,
    /// The residual moves in proportion to its parameters: its signature is the same at any size.
    pub(crate) proportional: bool,
}

/// No bound is in the way from nominal to a share of a start.
fn unbounded(applied: &Applied, start: &[f64], share: f64) -> bool {
    let free = |(value, p): (&f64, &Parameter)| {
        p.role.is_shape()
            || (p.lower..=p.upper).contains(&(p.nominal + share * (value - p.nominal)))
    };
    start.iter().zip(&applied.parameters).all(free)
}

/// Two signatures are one but for rounding.
fn same(a: &Whitened, b: &Whitened) -> bool {
    let (apart, size) = a.iter().zip(b).fold((0.0, 0.0), |(apart, size), (a, b)| {
        (apart + (a - b).norm_squared(), size + a.norm_squared())
    });
    apart <= PROPORTIONAL * PROPORTIONAL * size
}

/// Screens all candidates: the fall of the cost along each start's signature, or at the start itself where that is more.
pub(crate) fn screen(
    likelihood: &Likelihood<'_>,
    catalogue: Vec<Applied>,
    scales: &Scales,
    nominal: &Whitened,
) -> Vec<Screened> {
    let cost = likelihood.inner(nominal, nominal);
    let mut candidates: Vec<Screened> =
        parallel::map(catalogue, |applied| screened(likelihood, applied, scales, nominal, cost));
    // Stable: of equals the first of the table leads.
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    candidates
}

/// One candidate at each of its starts and along each start's signature, the best values first.
fn screened(
    likelihood: &Likelihood<'_>,
    applied: Applied,
    scales: &Scales,
    nominal: &Whitened,
    cost: f64,
) -> Screened {
    let mut tried: Vec<(f64, Vec<f64>)> = Vec::new();
    let mut starts = likelihood.first_guesses(&applied, scales);
    starts.extend(applied.effect.scan(scales));
    let evaluate = |values: &[f64]| likelihood.whitened(&[with(&applied, values)]);
    let shaped = applied.parameters.iter().any(|p| p.role.is_shape());
    let (mut proportional, mut always) = (false, true);
    for (at, start) in starts.iter().enumerate() {
        let there = evaluate(start);
        if let Some(there) = &there {
            tried.push((cost - likelihood.inner(there, there), start.clone()));
        }
        // All starts of one parameter have the same signature; a limit has none.
        if has_limit(&applied) || (at > 0 && applied.parameters.len() == 1) {
            continue;
        }
        // The signature close to nominal, scaled by least squares. One signature at the start is sufficient where the residual is proportional to the size, at
        // any frequency.
        let whole = there.map(|there| difference(nominal, &there, 1.0));
        let signature = match &whole {
            Some(whole) if proportional && shaped => whole.clone(),
            _ => {
                let Some(near) = evaluate(&between(&applied, start, NEAR)) else { continue };
                let signature = difference(nominal, &near, 1.0 / NEAR);
                proportional = whole.as_ref().is_some_and(|whole| same(whole, &signature))
                    && unbounded(&applied, start, NEAR);
                always &= proportional;
                signature
            }
        };
        let (along, length) =
            (likelihood.inner(&signature, nominal), likelihood.inner(&signature, &signature));
        let share = along / length;
        if !share.is_finite() {
            continue;
        }
        // Shorter where the whole way makes things worse or cannot be simulated.
        for halved in 0..HALVINGS {
            let share = share.clamp(-20.0, 20.0) * 0.5_f64.powi(halved);
            let values = between(&applied, start, share);
            let gain = if proportional && unbounded(&applied, start, share) {
                Some(share * (2.0 * along - share * length))
            } else {
                evaluate(&values).map(|there| cost - likelihood.inner(&there, &there))
            };
            tried.extend(gain.map(|gain| (gain, values)));
            if gain.is_some_and(|g| g > 0.0) {
                break;
            }
        }
    }
    tried.retain(|(gain, _)| gain.is_finite());
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let gain = tried.first().map_or(f64::NEG_INFINITY, |t| t.0);
    Screened {
        applied,
        starts: tried.into_iter().map(|t| t.1).collect(),
        gain,
        proportional: proportional && always,
    }
}

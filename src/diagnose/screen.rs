//! The screen: every candidate of the catalogue by its signature.

use rayon::prelude::*;

use super::black_box::Probed;
use super::explanation::{difference, with};
use super::problem::{Problem, Whitened};
use crate::effect::{Applied, EFFECTS, Parameter, Scales, Site};
use crate::simulate::System;

/// Where a signature is taken, as a share of the way from nominal to a start.
pub(super) const NEAR: f64 = 0.02;
/// How often the way along a signature is halved before it is given up.
const HALVINGS: i32 = 5;

/// The residual moves in proportion where a signature found near nominal and one found at the start differ by no more than this part.
const PROPORTIONAL: f64 = 1e-9;

/// A candidate with its starts, best first.
pub(super) struct Screened {
    pub(super) applied: Applied,
    pub(super) starts: Vec<Vec<f64>>,
    pub(super) gain: f64,
    /// The residual moves in proportion to its parameters: its signature is the same at any size.
    pub(super) proportional: bool,
}

/// All candidates of a system, in the order of the effects' table, with the reasons for those that cannot act.
pub(super) fn catalogue(system: &System, probed: Option<&Probed>) -> (Vec<Applied>, Vec<(&'static str, String)>) {
    let (mut all, mut left_out) = (Vec::new(), Vec::new());
    for effect in EFFECTS {
        if effect.site() == Site::Dynamics && system.is_sampled() {
            left_out.push((effect.name(), "the model is sampled".to_owned()));
            continue;
        }
        if effect.needs_equations() && system.is_black_box() {
            left_out.push((effect.name(), "the simulator is a black box: its equations cannot be changed".to_owned()));
            continue;
        }
        let mut channels = effect.channels(system);
        if channels.is_empty() && effect.site() == Site::Dynamics && system.is_black_box() {
            left_out.push((effect.name(), "the simulator is a black box, and no parameter of it is named".to_owned()));
        } else if channels.is_empty() {
            left_out.push((effect.name(), "the model has no channel for it".to_owned()));
        }
        let idle = probed.map_or(&[][..], |p| match effect.site() {
            Site::Input => &p.idle_inputs,
            Site::Dynamics => &p.idle_parameters,
            Site::Output | Site::Clock => &[],
        });
        for channel in channels.extract_if(.., |channel| idle.contains(channel)) {
            let what = if effect.site() == Site::Input { "input" } else { "parameter" };
            left_out.push((effect.name(), format!("no output of the simulator depends on the {what} `{channel}`")));
        }
        all.extend(channels.iter().filter_map(|channel| Applied::nominal(system, effect, channel).ok()));
    }
    (all, left_out)
}

/// Values moved a share of the way from nominal to a start; infinite limits stay.
pub(super) fn between(applied: &Applied, start: &[f64], share: f64) -> Vec<f64> {
    let move_one = |(value, p): (&f64, &Parameter)| {
        let moved = p.nominal + share * (value - p.nominal);
        if p.nominal.is_infinite() || !moved.is_finite() { *value } else { moved.clamp(p.lower, p.upper) }
    };
    keep_shape(applied, start, start.iter().zip(&applied.parameters).map(move_one).collect())
}

/// A parameter that says what an effect is like, not how large it is.
pub(super) fn is_shape(parameter: &Parameter) -> bool {
    matches!(parameter.name, "frequency" | "damping" | "phase")
}

/// Frequency, damping and phase keep the start's value when a signature is scaled.
fn keep_shape(applied: &Applied, start: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    for ((value, start), p) in values.iter_mut().zip(start).zip(&applied.parameters) {
        if is_shape(p) {
            *value = *start;
        }
    }
    values
}

/// No bound is in the way from nominal to a share of a start.
fn unbounded(applied: &Applied, start: &[f64], share: f64) -> bool {
    let free = |(value, p): (&f64, &Parameter)| is_shape(p) || (p.lower..=p.upper).contains(&(p.nominal + share * (value - p.nominal)));
    start.iter().zip(&applied.parameters).all(free)
}

/// Two signatures are one but for rounding.
fn same(a: &Whitened, b: &Whitened) -> bool {
    let (apart, size) = a.iter().zip(b).fold((0.0, 0.0), |(apart, size), (a, b)| (apart + (a - b).norm_squared(), size + a.norm_squared()));
    apart <= PROPORTIONAL * PROPORTIONAL * size
}

/// Some parameter is a limit, infinite when nominal.
pub(super) fn has_limit(applied: &Applied) -> bool {
    applied.parameters.iter().any(|p| p.nominal.is_infinite())
}

/// Screens all candidates: the fall of the cost along each start's signature, or at the start itself where that is more.
pub(super) fn screen(problem: &Problem<'_>, catalogue: Vec<Applied>, scales: &Scales, nominal: &Whitened) -> Vec<Screened> {
    let cost = problem.inner(nominal, nominal);
    let mut candidates: Vec<Screened> = catalogue
        .into_par_iter()
        .map(|applied| {
            let mut tried: Vec<(f64, Vec<f64>)> = Vec::new();
            let mut starts = problem.first_guesses(&applied, scales);
            starts.extend(applied.effect.scan(scales));
            let evaluate = |values: &[f64]| problem.whitened(&[with(&applied, values)]);
            let shaped = applied.parameters.iter().any(is_shape);
            let (mut proportional, mut always) = (false, true);
            for (at, start) in starts.iter().enumerate() {
                let there = evaluate(start);
                if let Some(there) = &there {
                    tried.push((cost - problem.inner(there, there), start.clone()));
                }
                // All starts of one parameter have the same signature; a limit has none.
                if has_limit(&applied) || (at > 0 && applied.parameters.len() == 1) {
                    continue;
                }
                // The signature close to nominal, scaled as it fits best: one and the same at the start where the residual moves in proportion, of
                // whatever frequency.
                let whole = there.map(|there| difference(nominal, &there, 1.0));
                let signature = match &whole {
                    Some(whole) if proportional && shaped => whole.clone(),
                    _ => {
                        let Some(near) = evaluate(&between(&applied, start, NEAR)) else { continue };
                        let signature = difference(nominal, &near, 1.0 / NEAR);
                        proportional = whole.as_ref().is_some_and(|whole| same(whole, &signature)) && unbounded(&applied, start, NEAR);
                        always &= proportional;
                        signature
                    }
                };
                let (along, length) = (problem.inner(&signature, nominal), problem.inner(&signature, &signature));
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
                        evaluate(&values).map(|there| cost - problem.inner(&there, &there))
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
            Screened { applied, starts: tried.into_iter().map(|t| t.1).collect(), gain, proportional: proportional && always }
        })
        .collect();
    // Stable: of equals the first of the table leads.
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    candidates
}

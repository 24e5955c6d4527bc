//! The candidates: every effect on every channel of a system that it can act on.

use crate::format::diagnosis::NotTried;
use crate::input::black_box::Probed;
use crate::input::nuisance::Nuisance;
use deadtime_model::effect::{Applied, EFFECTS, Effect, OnChannel, Scales, Site, find};
use deadtime_model::simulate::{Dynamics, System};

/// The tried candidates, in the order of the effects' table, and those that cannot act.
pub(crate) struct Catalogue {
    pub(crate) candidates: Vec<Applied>,
    pub(crate) left_out: Vec<NotTried>,
}

/// All candidates of a system, with the reasons for those that cannot act.
pub(crate) fn catalogue(
    system: &System,
    nuisances: &[Nuisance],
    probed: Option<&Probed>,
    scales: &Scales,
) -> Catalogue {
    let (mut all, mut left_out) = (Vec::new(), Vec::new());
    let kinematic = kinematic(system);
    for effect in EFFECTS {
        let mut channels = effect.channels(system);
        if effect.facts().is_declared && channels.is_empty() {
            continue;
        }
        if let Some(why) = why_on_no_channel(effect, system, &channels) {
            left_out.push(not_tried(effect, why.to_owned()));
            continue;
        }
        let mut leave_out = |of: &dyn Fn(&String) -> bool, why: &dyn Fn(&str) -> String| {
            let out = channels.extract_if(.., |channel| of(channel));
            left_out.extend(out.map(|channel| not_tried(effect, why(&channel))));
        };
        let (idle, what) = idle(effect, probed);
        leave_out(&|c| idle.contains(c), &|c| {
            format!("no output of the simulator depends on the {what} `{c}`")
        });
        let changes_model = changes_model(effect);
        leave_out(&|c| changes_model && kinematic.contains(c), &|c| {
            format!("`{c}` says that one state is the derivative of another")
        });
        leave_out(&|c| changes_model && system.known.contains(c), &|c| {
            format!("`{c}` is `known` in the model file")
        });
        for nuisance in nuisances {
            leave_out(&|c| nuisance.is(effect, c), &|_| nuisance.why_not_tried());
        }
        let on = |channel: &String| {
            Some(Applied::nominal(system, effect, channel).ok()?.shown_by(system, scales))
        };
        all.extend(channels.iter().filter_map(on));
    }
    Catalogue { candidates: all, left_out }
}

/// The reason why an effect cannot be tried on any channel.
fn why_on_no_channel(
    effect: &dyn Effect,
    system: &System,
    channels: &[String],
) -> Option<&'static str> {
    let (site, black_box) = (effect.site(), system.is_black_box());
    if site == Site::Dynamics && system.is_sampled() {
        return Some("the model is sampled");
    }
    if effect.facts().needs_equations && black_box {
        return Some("the simulator is a black box: its equations cannot be changed");
    }
    // Where other laws cannot be tried, friction above all, an effect of many shapes imitates their causes.
    if site == Site::Output && effect.elaborates().is_some() && black_box {
        return Some(
            "the simulator is a black box: laws of its own that cannot be tried would take the same shape",
        );
    }
    match channels.is_empty() {
        true if site == Site::Dynamics && black_box => {
            Some("the simulator is a black box, and no parameter of it is named")
        }
        true => Some("the model has no channel for it"),
        false => None,
    }
}

/// The channels on which no output of the simulator depends, and what they are.
fn idle<'p>(effect: &dyn Effect, probed: Option<&'p Probed>) -> (&'p [String], &'static str) {
    match (effect.site(), probed) {
        (Site::Input, Some(probed)) => (&probed.idle_inputs, "input"),
        (Site::Dynamics, Some(probed)) => (&probed.idle_parameters, "parameter"),
        _ => (&[], "channel"),
    }
}

/// Every parameter of the nominal model, also where a law in continuous time could not be tried. Empty for a simulator that can only be called.
pub(crate) fn numbers(system: &System) -> Vec<Applied> {
    let kinematic = &kinematic(system);
    let of = |effect: &'static dyn Effect| {
        let channels = effect.channels(system).into_iter();
        let channels = channels.filter(|c| !kinematic.contains(c) && !system.known.contains(c));
        channels.filter_map(move |channel| {
            let parameters =
                effect.parameters(OnChannel { effect, system, channel: &channel }).ok()?;
            let values = parameters.iter().map(|p| p.nominal).collect();
            Some(Applied { effect, channel, parameters, values })
        })
    };
    EFFECTS
        .into_iter()
        .filter(|e| e.corrects_model() && !system.is_black_box())
        .flat_map(of)
        .collect()
}

/// Whether an effect changes a number that the model has, for good or from a time on.
fn changes_model(effect: &dyn Effect) -> bool {
    let plain = effect.elaborates().and_then(|plain| find(plain).ok());
    effect.corrects_model() || plain.is_some_and(Effect::corrects_model)
}

/// Entries of A by which one state is the derivative of another: a row whose only entry is 1. No machine has another value there.
#[allow(clippy::float_cmp)]
fn kinematic(system: &System) -> Vec<String> {
    let Dynamics::Linear(matrices) = &system.dynamics else { return Vec::new() };
    let name = |at: usize| &system.states[at].name;
    let entry = |row: usize| {
        let entries = matrices.a.row(row);
        let column = entries.iter().position(|v| *v != 0.0)?;
        let alone = entries.iter().filter(|v| **v != 0.0).count() == 1
            && matrices.b.row(row).iter().all(|v| *v == 0.0);
        let is_one = entries[column] == 1.0 && column != row && alone;
        is_one.then(|| format!("A[{},{}]", name(row), name(column)))
    };
    (0..matrices.a.nrows()).filter_map(entry).collect()
}

fn not_tried(effect: &dyn Effect, why: String) -> NotTried {
    NotTried { effect: effect.name().to_owned(), why }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::ModelDocument;

    #[test]
    fn known_parameters_are_no_candidates() {
        let text = r#"
format = "deadtime/model@1"
name = "servo"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "q" }]
[states]
q = {}
w = {}
[parameters]
kp = { value = 20.0, known = true }
damping = { value = 3.0 }
[derivatives]
q = "w"
w = "kp*(u - q) - damping*w"
[output_equations]
q = "q"
"#;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        std::fs::write(&path, text).unwrap();
        let system = System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap();
        let found = catalogue(&system, &[], None, &Scales::default());
        let channels = |effect: &str| -> Vec<&str> {
            let of = found.candidates.iter().filter(|a| a.effect.name() == effect);
            of.map(|a| a.channel.as_str()).collect()
        };
        assert_eq!(channels("parameter_error"), ["damping"]);
        assert_eq!(channels("parameter_jump"), ["damping"]);
        assert_eq!(channels("internal_saturation"), ["kp*(u - q)"]);
        assert!(found.left_out.iter().any(|n| n.why.contains("`kp` is `known`")));
        assert_eq!(numbers(&system).len(), 1);
    }
}

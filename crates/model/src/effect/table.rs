//! What there is to choose from: all effects in general, and all of them on the channels of one model.

use nalgebra::DMatrix;

use super::applied::Applied;
use super::definition::{Effect, OnChannel, Site};
use super::effects::EFFECTS;
use super::parameter::Parameter;
use crate::matrices::Matrices;
use crate::simulate::simulator::Port;
use crate::simulate::system::{Dynamics, System};

/// An effect in general.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Where it acts.
    pub site: Site,
    /// Its name.
    pub effect: &'static str,
    /// Which channels it can act on, in words.
    pub channels: &'static str,
    /// Its parameters. In their units u, x and y stand for the unit of that input, state or output, and `from` for that of the other channel.
    pub parameters: Vec<Parameter>,
    /// What it is.
    pub summary: &'static str,
}

/// The channel that shows an effect's units best, where it is not the first one.
const TELLING: [&str; 5] = ["from->x", "from->y", "u->output:y", "A[x,from]", "x<->from"];

/// All effects, in the order in which they act.
#[must_use]
pub fn table() -> Vec<Line> {
    let system = template();
    let line = |effect: &&'static dyn Effect| {
        let first = effect.channels(&system);
        let channels = TELLING.iter().copied().chain(first.iter().map(String::as_str));
        Line {
            site: effect.site(),
            effect: effect.name(),
            channels: effect.facts().rule,
            parameters: channels
                .filter_map(|channel| {
                    effect.parameters(OnChannel { effect: *effect, system: &system, channel }).ok()
                })
                .next()
                .unwrap_or_default(),
            summary: effect.facts().summary,
        }
    };
    EFFECTS.iter().map(line).collect()
}

/// A system whose units are called as its channels.
fn template() -> System {
    let ports = |names: &[&str]| {
        names
            .iter()
            .map(|n| Port { name: (*n).to_owned(), unit: Some((*n).to_owned()) })
            .collect::<Vec<_>>()
    };
    let zero = DMatrix::zeros;
    System {
        name: String::new(),
        inputs: ports(&["u"]),
        states: ports(&["x", "from"]),
        outputs: ports(&["y", "from"]),
        parameters: Vec::new(),
        known: Vec::new(),
        dynamics: Dynamics::Linear(Matrices {
            a: zero(2, 2),
            b: zero(2, 1),
            c: zero(2, 2),
            d: zero(2, 1),
        }),
        input_delay_s: vec![0.0],
        initial: vec![0.0; 2],
        initial_std: vec![None; 2],
        input_operating: vec![0.0],
        output_operating: vec![0.0; 2],
        candidates: None,
        restart: None,
    }
}

/// Every effect on every channel of a system that it can act on, at its nominal parameters. None acts on the dynamics of a sampled model.
#[must_use]
pub fn menu(system: &System) -> Vec<Applied> {
    let on_channels = |effect: &&'static dyn Effect| {
        let effect = *effect;
        effect
            .channels(system)
            .into_iter()
            .filter_map(move |channel| Applied::nominal(system, effect, &channel).ok())
    };
    EFFECTS.iter().flat_map(on_channels).collect()
}

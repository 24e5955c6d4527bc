//! The available effects: all of them in general, and all of them on the channels of one model.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::applied::Applied;
use super::definition::{Effect, OnChannel, Site};
use super::effects::EFFECTS;
use super::parameter::Parameter;
use crate::equations::system::{Definition, Equations, OutputVariable, StateVariable, Symbol};
use crate::matrices::Matrices;
use crate::simulate::simulator::Port;
use crate::simulate::system::{Dynamics, System};

/// An effect in general.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Its site.
    pub site: Site,
    /// Its name.
    pub effect: &'static str,
    /// The channels on which it can act, in words.
    pub channels: &'static str,
    /// Its parameters. In their units u, x and y represent the unit of that input, state or output, and `from` that of the other channel.
    pub parameters: Vec<Parameter>,
    /// A summary.
    pub summary: &'static str,
}

/// The channel that shows an effect's units best, where it is not the first one.
const TELLING: [&str; 5] = ["from->x", "from->y", "u->output:y", "A[x,from]", "x<->from"];

/// All effects, in the order in which they act.
#[must_use]
pub fn table() -> Vec<Line> {
    let systems: Vec<System> = std::iter::once(template()).chain(loop_template()).collect();
    let line = |effect: &&'static dyn Effect| {
        let of = |system: &System| {
            let first = effect.channels(system);
            let channels = TELLING.iter().copied().chain(first.iter().map(String::as_str));
            let parameters =
                |channel| effect.parameters(OnChannel { effect: *effect, system, channel }).ok();
            channels.filter_map(parameters).next()
        };
        Line {
            site: effect.site(),
            effect: effect.name(),
            channels: effect.facts().rule,
            parameters: systems.iter().find_map(of).unwrap_or_default(),
            summary: effect.facts().summary,
        }
    };
    EFFECTS.iter().map(line).collect()
}

/// A loop with a link between two bodies, two inputs and two outputs, for effects without a channel in the other template.
fn loop_template() -> Option<System> {
    let symbol = |name: &str, unit: &str| Symbol { name: name.into(), unit: Some(unit.into()) };
    let state = |name: &str, derivative: &str| StateVariable {
        name: name.into(),
        unit: Some("x".into()),
        initial: 0.0,
        initial_std: None,
        derivative: derivative.into(),
    };
    let output = |name: &str| OutputVariable {
        name: name.into(),
        unit: Some("y".into()),
        equation: "x".into(),
    };
    let inputs = vec![symbol("u", "u"), symbol("other", "u")];
    let states = vec![
        state("x", "v"),
        state("load", "w"),
        state("v", "quantity - (x - load)"),
        state("w", "x - load"),
    ];
    let quantity = Definition { name: "quantity".into(), expression: "u - x".into() };
    let outputs = vec![output("y"), output("z")];
    let equations =
        Equations::with_definitions(inputs, states, Vec::new(), vec![quantity], outputs).ok()?;
    let port = |name: &str, unit: &Option<String>| Port { name: name.into(), unit: unit.clone() };
    Some(System {
        inputs: equations.input_symbols().iter().map(|s| port(&s.name, &s.unit)).collect(),
        states: equations.state_variables().iter().map(|s| port(&s.name, &s.unit)).collect(),
        outputs: equations.output_variables().iter().map(|s| port(&s.name, &s.unit)).collect(),
        dynamics: Dynamics::Equations(Arc::new(equations), Vec::new()),
        input_delay_s: vec![0.0; 2],
        initial: vec![0.0; 4],
        initial_std: vec![None; 4],
        input_operating: vec![0.0; 2],
        ..template()
    })
}

/// A system whose units have the names of its channels.
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

/// Every effect on every valid channel of a system, at its nominal parameters. Sampled models have no dynamics effects.
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

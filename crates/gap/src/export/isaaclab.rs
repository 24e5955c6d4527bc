//! Arguments of Isaac Lab's configuration classes: `DelayedPDActuatorCfg`, `randomize_joint_parameters`, `NoiseModelWithAdditiveBiasCfg`.
//!
//! Isaac Lab draws a delay as a whole number of physics steps, min_delay to max_delay with both ends, anew at every reset of an environment.
//!
//! How it can be wrong: a delay between two steps is not possible, so both neighbours are in the range. The diagnosis has a friction as an acceleration. Isaac
//! Lab needs a joint's friction in the form of its version (a torque from Isaac Sim 5 on), and therefore the joint's `inertia`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::node::Node;
use super::ranges::{Range, Ranges};
use super::source::{ExportError, Source};
use super::target::Target;
use crate::error::Result;

/// Arguments of Isaac Lab's configuration classes.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IsaacLab {
    /// The physics step, s (`sim.dt`); needed.
    pub physics_dt: Option<f64>,
    /// Moment of inertia (or mass) of the joint behind each state on which dry friction acts.
    pub inertia: BTreeMap<String, f64>,
}

/// A delay in whole steps: the neighbours below and above, where it is none.
fn steps(seconds: f64, dt: f64, up: bool) -> i64 {
    let steps = seconds / dt;
    // Numbers that are whole except for rounding stay whole.
    let whole = steps.round();
    let near = (steps - whole).abs() < 1e-6 * steps.abs().max(1.0);
    let steps = if near {
        whole
    } else if up {
        steps.ceil()
    } else {
        steps.floor()
    };
    steps.clamp(0.0, 1e9) as i64
}

/// The smallest and largest value of the draws.
fn span<'a>(ranges: impl Iterator<Item = &'a Range>) -> Option<[f64; 2]> {
    ranges.map(|r| [r.low, r.high]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

impl Target for IsaacLab {
    fn export(&self, ranges: &Ranges, source: &Source<'_>) -> Result<Node> {
        let dt = self.checked_step()?;
        let (mut actuators, mut events, mut by_hand) = (Vec::new(), Vec::new(), Vec::new());
        for range in &ranges.ranges {
            match range.effect.as_str() {
                _ if is_command_delay(range) => actuators.extend(delayed_actuator(range, ranges, dt)),
                "coulomb_friction" => match self.inertia.get(&range.channel) {
                    Some(inertia) => events.push((format!("friction_{}", range.channel), friction(range, *inertia))),
                    None => by_hand.push(range.by_hand(&format!(
                        "an acceleration: give the option inertia={{\"{}\": VALUE}}, or multiply by the joint's inertia for its friction",
                        range.channel
                    ))),
                },
                "sensor_bias" => {}
                "output_delay" => {
                    let (low, high) = (steps(range.low, dt, false), steps(range.high, dt, true));
                    by_hand.push(range.by_hand(&format!("delay the observation by {low} to {high} physics steps (DelayBuffer)")));
                }
                _ => by_hand.push(range.by_hand(&format!("no argument of Isaac Lab's classes: {}", range.place()))),
            }
        }
        Ok(Node::map([
            ("format", "deadtime/isaaclab@1".into()),
            ("model", source.diagnosis.model.as_str().into()),
            ("physics_dt", dt.into()),
            ("actuators", Node::Map(actuators)),
            ("events", Node::Map(events)),
            ("observations", Node::Map(observations(ranges))),
            ("by_hand", Node::List(by_hand)),
        ]))
    }
}

impl IsaacLab {
    /// The physics step, seconds, once all options make sense.
    fn checked_step(&self) -> std::result::Result<f64, ExportError> {
        let dt = self.physics_dt.ok_or(ExportError::NeedsOption {
            target: "isaaclab",
            option: "physics_dt",
            why: "the physics step in seconds, sim.dt",
        })?;
        if !(dt.is_finite() && dt > 0.0) {
            return Err(ExportError::NotPositive { option: "physics_dt", value: dt });
        }
        match self.inertia.values().find(|v| !(v.is_finite() && **v > 0.0)) {
            Some(&value) => Err(ExportError::NotPositive { option: "inertia", value }),
            None => Ok(dt),
        }
    }
}

/// A delay of a command, or one of the two of a delay that jumps.
fn is_command_delay(range: &Range) -> bool {
    range.effect == "input_delay" || (range.effect == "delay_jump" && range.parameter != "time")
}

/// The actuator of a command's delays, all of them as one span: at the first of them, `None` at the others.
fn delayed_actuator(range: &Range, ranges: &Ranges, dt: f64) -> Option<(String, Node)> {
    let mut own =
        ranges.ranges.iter().filter(|r| r.channel == range.channel && is_command_delay(r));
    let [low, high] = span(own.clone())?;
    let arguments = || {
        Node::map([
            ("class_type", "DelayedPDActuatorCfg".into()),
            ("min_delay", Node::Whole(steps(low, dt, false))),
            ("max_delay", Node::Whole(steps(high, dt, true))),
        ])
    };
    (own.next() == Some(range)).then(|| (range.channel.clone(), arguments()))
}

/// The noise of every output that has a bias or a noise.
fn observations(ranges: &Ranges) -> Vec<(String, Node)> {
    let biases = |r: &&Range| r.effect == "sensor_bias";
    let noisy = ranges.noise.iter().filter(|n| n.std.is_some()).map(|n| n.output.as_str());
    let mut outputs: Vec<&str> = Vec::new();
    for output in ranges.ranges.iter().filter(biases).map(|r| r.channel.as_str()).chain(noisy) {
        if !outputs.contains(&output) {
            outputs.push(output);
        }
    }
    let of = |output: &str| {
        let std = ranges.noise.iter().find(|n| n.output == output).and_then(|n| n.std);
        let bias = span(ranges.ranges.iter().filter(|r| r.channel == output && biases(r)));
        (output.to_owned(), noise(std, bias))
    };
    outputs.into_iter().map(of).collect()
}

/// The event that draws a joint's friction.
fn friction(range: &Range, inertia: f64) -> Node {
    Node::map([
        ("func", "randomize_joint_parameters".into()),
        ("mode", "reset".into()),
        (
            "params",
            Node::map([
                (
                    "friction_distribution_params",
                    vec![inertia * range.low, inertia * range.high].into(),
                ),
                ("operation", "abs".into()),
                ("distribution", "uniform".into()),
            ]),
        ),
    ])
}

/// Noise at every step, and a bias that is drawn at every reset.
fn noise(std: Option<f64>, bias: Option<[f64; 2]>) -> Node {
    let each = std.map(|std| {
        Node::map([
            ("class_type", "GaussianNoiseCfg".into()),
            ("mean", 0.0.into()),
            ("std", std.into()),
            ("operation", "add".into()),
        ])
    });
    let Some([low, high]) = bias else { return Node::map([("noise", each.into())]) };
    // The bias is added to 0 when it is drawn: `abs` sets it.
    let drawn = Node::map([
        ("class_type", "UniformNoiseCfg".into()),
        ("n_min", low.into()),
        ("n_max", high.into()),
        ("operation", "abs".into()),
    ]);
    let none = || {
        Node::map([
            ("class_type", "GaussianNoiseCfg".into()),
            ("mean", 0.0.into()),
            ("std", 0.0.into()),
            ("operation", "add".into()),
        ])
    };
    let model = Node::map([
        ("class_type", "NoiseModelWithAdditiveBiasCfg".into()),
        ("noise_cfg", each.unwrap_or_else(none)),
        ("bias_noise_cfg", drawn),
    ]);
    Node::map([("noise", model)])
}

#[cfg(test)]
mod tests {
    use super::steps;

    #[test]
    fn a_delay_between_two_steps_has_both_in_its_range_and_one_on_a_step_only_that() {
        assert_eq!((steps(0.0298, 0.005, false), steps(0.0322, 0.005, true)), (5, 7));
        assert_eq!((steps(0.03, 0.005, false), steps(0.03, 0.005, true)), (6, 6));
        assert_eq!((steps(0.3, 0.1, false), steps(0.3, 0.1, true)), (3, 3));
        assert_eq!(steps(-1.0, 0.1, false), 0);
    }
}

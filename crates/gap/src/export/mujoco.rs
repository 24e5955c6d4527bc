//! Fields of MuJoCo's mjModel, for MuJoCo Playground's randomisation functions and for `deadtime.mujoco.randomise`.
//!
//! A command is an actuator of the same name, an output a sensor, and a state with friction on its derivative a joint. Other names are mapped by `names`. Delays need
//! MuJoCo's history buffers (`nsample`), which are made when the XML is compiled; each delay carries the number of samples that it needs.
//!
//! How it can be wrong: the diagnosis has a dry friction as an acceleration, and MuJoCo needs a force. The joint's own inertia at the reference pose,
//! `dof_M0`, is the factor between them where no other joint moves along.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::node::Node;
use super::ranges::{Range, Ranges};
use super::source::{ExportError, Source};
use super::target::Target;
use crate::error::Result;

/// Fields of mjModel.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MuJoCo {
    /// The model's time step, s.
    pub timestep: f64,
    /// Names in MuJoCo of channels that are called otherwise in the log.
    pub names: BTreeMap<String, String>,
}

impl Default for MuJoCo {
    fn default() -> Self {
        Self { timestep: 0.002, names: BTreeMap::new() }
    }
}

/// A field of mjModel that holds a parameter.
struct Place {
    /// The element of the XML.
    element: &'static str,
    /// The field, and the column of it.
    field: &'static str,
    index: Option<i64>,
    /// Another field by which the number is multiplied first.
    times: Option<&'static str>,
    /// The attributes that the XML must also have.
    needs: Option<String>,
}

impl MuJoCo {
    fn name(&self, channel: &str) -> String {
        self.names.get(channel).cloned().unwrap_or_else(|| channel.to_owned())
    }

    fn place(&self, range: &Range) -> Option<Place> {
        let plain =
            |element, field, index| Place { element, field, index, times: None, needs: None };
        let history = || {
            let samples = (range.high / self.timestep - 1e-9).ceil().max(0.0) + 1.0;
            Some(format!(
                "nsample=\"{samples}\" in the XML, or more: the history that the longest delay needs"
            ))
        };
        let needing = |place: Place, needs: &str| Place { needs: Some(needs.to_owned()), ..place };
        Some(match (range.effect.as_str(), range.parameter.as_str()) {
            ("input_delay", "delay") => {
                Place { needs: history(), ..plain("actuator", "actuator_delay", None) }
            }
            ("output_delay", "delay") if range.channel != "*" => {
                Place { needs: history(), ..plain("sensor", "sensor_delay", None) }
            }
            ("actuator_lag", "time_constant") => needing(
                plain("actuator", "actuator_dynprm", Some(0)),
                "dyntype=\"filterexact\" in the XML, of a general actuator",
            ),
            ("input_gain", "gain") => plain("actuator", "actuator_gainprm", Some(0)),
            ("saturation", "lower") => needing(
                plain("actuator", "actuator_ctrlrange", Some(0)),
                "ctrllimited=\"true\" in the XML",
            ),
            ("saturation", "upper") => needing(
                plain("actuator", "actuator_ctrlrange", Some(1)),
                "ctrllimited=\"true\" in the XML",
            ),
            ("coulomb_friction", "level") => {
                Place { times: Some("dof_M0"), ..plain("joint", "dof_frictionloss", None) }
            }
            _ => return None,
        })
    }
}

impl Target for MuJoCo {
    fn export(&self, ranges: &Ranges, source: &Source<'_>) -> Result<Node> {
        if !(self.timestep.is_finite() && self.timestep > 0.0) {
            return Err(
                ExportError::NotPositive { option: "timestep", value: self.timestep }.into()
            );
        }
        let (mut fields, mut by_hand) = (Vec::new(), Vec::new());
        for range in &ranges.ranges {
            let Some(place) = self.place(range) else {
                let path =
                    range.effect == "parameter_error" && range.channel.split('/').count() == 3;
                if path {
                    fields.push(parameter(range));
                } else {
                    by_hand.push(range.by_hand(&format!("no field of mjModel: {}", range.place())));
                }
                continue;
            };
            fields.push(Node::map([
                ("element", place.element.into()),
                ("name", self.name(&range.channel).into()),
                ("field", place.field.into()),
                ("index", place.index.map_or(Node::Null, Node::Whole)),
                ("operation", range.operation.name().into()),
                ("times", place.times.into()),
                ("value", range.value.into()),
                ("low", range.low.into()),
                ("high", range.high.into()),
                ("unit", range.unit.as_str().into()),
                ("needs", place.needs.into()),
            ]));
        }
        let noise = ranges.noise.iter().map(|n| {
            Node::map([
                ("name", self.name(&n.output).into()),
                ("unit", n.unit.clone().into()),
                ("std", n.std.into()),
                ("of_deviation", n.of_deviation.into()),
            ])
        });
        Ok(Node::map([
            ("format", "deadtime/mujoco@1".into()),
            ("model", source.diagnosis.model.as_str().into()),
            ("timestep", self.timestep.into()),
            ("fields", Node::List(fields)),
            ("sensor_noise", Node::List(noise.collect())),
            ("by_hand", Node::List(by_hand)),
        ]))
    }
}

/// A parameter that is called by its path, as `deadtime.mujoco.simulator` calls them: `joint/elbow/damping`.
fn parameter(range: &Range) -> Node {
    Node::map([
        ("path", range.channel.as_str().into()),
        ("operation", "set".into()),
        ("value", range.value.into()),
        ("low", range.low.into()),
        ("high", range.high.into()),
        ("unit", range.unit.as_str().into()),
    ])
}

//! The effects as ranges: every parameter of every active effect, between its least and its largest value.
//!
//! How it can be wrong: an interval is the uncertainty of one machine's parameter, not the spread over machines of one kind. A parameter at a bound has no interval;
//! its range is one number, and a note reports that. The parameter of an alias (`surrogate`) predicts, but is not the physical value.

use super::node::Node;
use super::source::{ExportError, Source};
use crate::error::Result;
use crate::format::diagnosis::Mode;
use crate::format::found::FoundParameter;
use deadtime_model::effect::{Line, Site, table};

/// How a drawn number is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// The number replaces that of the simulator.
    Set,
    /// The simulator's number is multiplied by it.
    Scale,
    /// It is added.
    Add,
}

impl Operation {
    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Set => "set",
            Self::Scale => "scale",
            Self::Add => "add",
        }
    }

    fn of(effect: &str) -> Self {
        match effect {
            "input_gain" | "sensor_gain" => Self::Scale,
            "input_offset" | "sensor_bias" | "constant_disturbance" => Self::Add,
            _ => Self::Set,
        }
    }
}

/// A parameter and where it lies.
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    /// The effect.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// Where that is: input, dynamics, output or clock.
    pub site: Option<Site>,
    /// The parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// How a drawn number is used.
    pub operation: Operation,
    /// Where the effect does nothing; missing for a parameter of the model, and for a limit.
    pub nominal: Option<f64>,
    /// The found value.
    pub value: f64,
    /// The least it may be.
    pub low: f64,
    /// The most it may be.
    pub high: f64,
    /// The range is the 95 % interval; else it is the value alone.
    pub interval: bool,
    /// It predicts, but its value is not the physics'.
    pub surrogate: bool,
    /// Its aliases in the data, as `effect:channel`.
    pub alike: Vec<String>,
}

/// The noise of an output.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// The output.
    pub output: String,
    /// Its standard deviation as a part of the output's own.
    pub of_deviation: f64,
    /// Its standard deviation in the output's unit, where that of the output is known.
    pub std: Option<f64>,
    /// The output's unit, if the model has one.
    pub unit: Option<String>,
}

/// Everything that was found, as ranges.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranges {
    /// The ranges of all parameters.
    pub ranges: Vec<Range>,
    /// The noise of all outputs; empty where outputs are predicted one step ahead, whose residual is not the sensor's noise.
    pub noise: Vec<Noise>,
}

impl Ranges {
    /// From a diagnosis: all active effects, for any verdict, and the model's own parameters where they were recalibrated.
    ///
    /// # Errors
    /// [`ExportError::NotPositive`] for a factor that is not above 0.
    pub fn new(source: &Source<'_>) -> Result<Self> {
        if !(source.widen.is_finite() && source.widen > 0.0) {
            return Err(ExportError::NotPositive { option: "widen", value: source.widen }.into());
        }
        let (cause, lines) = (&source.diagnosis.cause, table());
        let mut ranges = Vec::new();
        for c in &cause.contributions {
            ranges.extend(c.parameters.iter().filter_map(|p| {
                let alike = c
                    .class
                    .iter()
                    .filter(|other| **other != format!("{}:{}", c.effect, c.channel))
                    .cloned()
                    .collect();
                Some(Range {
                    surrogate: c.surrogate,
                    alike,
                    ..range(&lines, (&c.effect, &c.channel), p, source.widen)?
                })
            }));
        }
        // Files without contributions.
        for e in cause.effects.iter().filter(|_| cause.contributions.is_empty()) {
            ranges.extend(
                e.parameters
                    .iter()
                    .filter_map(|p| range(&lines, (&e.effect, &e.channel), p, source.widen)),
            );
        }
        for p in cause.recalibration.iter().filter(|r| r.accepted).flat_map(|r| &r.parameters) {
            let known = |r: &Range| r.effect == "parameter_error" && r.channel == p.name;
            if !ranges.iter().any(known) {
                let named = FoundParameter { name: "value".to_owned(), ..p.clone() };
                ranges.extend(range(&lines, ("parameter_error", &p.name), &named, source.widen));
            }
        }
        Ok(Self { ranges, noise: noise(source) })
    }

    /// The ranges of one effect.
    pub(super) fn of<'a>(&'a self, effect: &'a str) -> impl Iterator<Item = &'a Range> {
        self.ranges.iter().filter(move |r| r.effect == effect)
    }
}

/// Effects whose parameters are the model's own when nominal, and so are in no table of effects.
const OF_MODEL: [&str; 2] = ["parameter_error", "parameter_jump"];

fn range(
    lines: &[Line],
    (effect, channel): (&str, &str),
    found: &FoundParameter,
    widen: f64,
) -> Option<Range> {
    let value = found.value?;
    let line = lines.iter().find(|line| line.effect == effect);
    let parameter = line.and_then(|line| line.parameters.iter().find(|p| p.name == found.name));
    let [low, high] = found.ci95.map_or([value; 2], |[low, high]| {
        [low + (1.0 - widen) * (value - low), high + (widen - 1.0) * (high - value)]
    });
    // Physically impossible values are left out of the range, for any interval.
    let (least, most) =
        parameter.map_or((f64::NEG_INFINITY, f64::INFINITY), |p| (p.lower, p.upper));
    let inside = |v: f64| v.max(least).min(most);
    Some(Range {
        effect: effect.to_owned(),
        channel: channel.to_owned(),
        site: line.map(|line| line.site),
        parameter: found.name.clone(),
        unit: found.unit.clone(),
        operation: Operation::of(effect),
        nominal: parameter
            .map(|p| p.nominal)
            .filter(|v| v.is_finite() && !OF_MODEL.contains(&effect)),
        value,
        low: inside(low),
        high: inside(high),
        interval: found.ci95.is_some(),
        surrogate: false,
        alike: Vec::new(),
    })
}

fn noise(source: &Source<'_>) -> Vec<Noise> {
    if source.diagnosis.prediction.mode != Mode::Simulation {
        return Vec::new();
    }
    let outputs = source.diagnosis.gap.outputs.iter();
    let one = |output: &crate::format::diagnosis::GapOutput| {
        let of_deviation = output.floor?;
        let deviation = source
            .deviations
            .iter()
            .find(|(name, _)| *name == output.name)
            .map(|(_, d)| d * of_deviation);
        let channel = source.model.and_then(|m| m.outputs().iter().find(|c| c.name == output.name));
        Some(Noise {
            output: output.name.clone(),
            of_deviation,
            std: deviation,
            unit: channel.and_then(|c| c.unit.clone()),
        })
    };
    outputs.filter_map(one).collect()
}

impl Range {
    /// Its facts, for files.
    pub(super) fn node(&self) -> Node {
        Node::map([
            ("effect", self.effect.as_str().into()),
            ("channel", self.channel.as_str().into()),
            ("site", self.site.map(Site::name).into()),
            ("parameter", self.parameter.as_str().into()),
            ("unit", self.unit.as_str().into()),
            ("operation", self.operation.name().into()),
            ("nominal", self.nominal.into()),
            ("value", self.value.into()),
            ("low", self.low.into()),
            ("high", self.high.into()),
            ("from", if self.interval { "ci95" } else { "value" }.into()),
            ("surrogate", self.surrogate.into()),
            ("alike", Node::from(self.alike.clone())),
        ])
    }

    /// The same for an effect without a place in the target, with the manual step.
    pub(super) fn by_hand(&self, what: &str) -> Node {
        Node::map([
            ("effect", self.effect.as_str().into()),
            ("channel", self.channel.as_str().into()),
            ("parameter", self.parameter.as_str().into()),
            ("unit", self.unit.as_str().into()),
            ("operation", self.operation.name().into()),
            ("value", self.value.into()),
            ("low", self.low.into()),
            ("high", self.high.into()),
            ("what", what.into()),
        ])
    }

    /// Where a person applies it who writes the loop.
    pub(super) fn place(&self) -> String {
        let channel = &self.channel;
        match self.site {
            Some(Site::Input) => {
                format!("apply it to the command `{channel}` before the simulator gets it")
            }
            Some(Site::Output) if channel == "*" => {
                "apply it to what every sensor reads".to_owned()
            }
            Some(Site::Output) => format!("apply it to what the sensor `{channel}` reads"),
            Some(Site::Clock) => {
                "shift the stamps of the sensors against those of the commands".to_owned()
            }
            _ if self.effect == "parameter_error" => {
                format!("set the parameter `{channel}` of the simulator")
            }
            _ => format!("add it to the equations of `{channel}`"),
        }
    }
}

impl Noise {
    pub(super) fn node(&self) -> Node {
        Node::map([
            ("output", self.output.as_str().into()),
            ("unit", self.unit.clone().into()),
            ("std", self.std.into()),
            ("of_deviation", self.of_deviation.into()),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_holds_a_nominal_value_only_where_the_table_knows_it() {
        let lines = table();
        for (effect, parameter, nominal) in [
            ("input_gain", "gain", Some(1.0)),
            ("gain_jump", "later", Some(1.0)),
            ("clock_skew", "ratio", Some(1.0)),
            ("input_delay", "delay", Some(0.0)),
            ("saturation", "upper", None),
            ("parameter_error", "value", None),
            ("parameter_jump", "value", None),
            ("parameter_jump", "later", None),
        ] {
            let found = FoundParameter {
                name: parameter.into(),
                unit: "1".into(),
                value: Some(2.0),
                std: None,
                ci95: None,
            };
            let line = lines.iter().find(|line| line.effect == effect).unwrap();
            assert!(
                line.parameters.iter().any(|p| p.name == parameter),
                "{effect} has no {parameter}"
            );
            assert_eq!(
                range(&lines, (effect, "u"), &found, 1.0).unwrap().nominal,
                nominal,
                "{effect} {parameter}"
            );
        }
    }
}

//! Channels by name: `name`, `from->to`, `u->site:name`, `*`.

use std::borrow::Cow;

use super::definition::{ALL, OnChannel, names};
use super::error::{EffectError, Result};
use super::parameter::{Parameter, Role};
use super::scales::{Scales, Spread};
use crate::equations::system::Wrt;
use crate::simulate::plan::Source;
use crate::simulate::simulator::Port;
use crate::simulate::system::{Dynamics, System};

/// A parameter without bounds: a size, or a limit that is infinite when nominal.
pub(super) fn free(name: impl Into<Cow<'static, str>>, unit: String, nominal: f64) -> Parameter {
    let role = if nominal.is_infinite() { Role::Limit } else { Role::Size };
    Parameter {
        name: name.into(),
        unit,
        role,
        nominal,
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
    }
}

/// A nonnegative parameter.
pub(super) fn not_negative(
    name: impl Into<Cow<'static, str>>,
    unit: String,
    nominal: f64,
) -> Parameter {
    Parameter { lower: 0.0, ..free(name, unit, nominal) }
}

/// A dead time.
pub(super) fn delay(name: impl Into<Cow<'static, str>>) -> Parameter {
    Parameter { role: Role::Delay, ..not_negative(name, "s".to_owned(), 0.0) }
}

/// The time constant of a lag.
pub(super) fn time_constant(name: impl Into<Cow<'static, str>>) -> Parameter {
    Parameter { role: Role::TimeConstant, ..not_negative(name, "s".to_owned(), 0.0) }
}

/// A frequency.
pub(super) fn frequency(name: impl Into<Cow<'static, str>>) -> Parameter {
    Parameter { role: Role::Frequency, lower: 1e-9, ..free(name, "Hz".to_owned(), 1.0) }
}

pub(super) fn position(ports: &[Port], name: &str) -> Option<usize> {
    ports.iter().position(|p| p.name == name)
}

pub(super) fn unit(port: &Port) -> String {
    port.unit.clone().unwrap_or_else(|| "1".to_owned())
}

/// The unit of a port per another unit, as in `m/s^2`.
pub(super) fn per(port: &Port, other: &str) -> String {
    match port.unit.as_deref() {
        Some(unit) if unit != "1" => format!("({unit})/{other}"),
        _ => format!("1/{other}"),
    }
}

/// The unit of one port over that of another, as of a gain between channels.
pub(super) fn ratio(to: &Port, from: &Port) -> String {
    if to.unit == from.unit { "1".to_owned() } else { format!("({})/({})", unit(to), unit(from)) }
}

impl<'a> OnChannel<'a> {
    /// The error for a channel on which the effect cannot act.
    pub(super) fn unknown(self) -> EffectError {
        EffectError::Channel {
            effect: self.effect.name(),
            channel: self.channel.to_owned(),
            known: self.effect.channels(self.system),
        }
    }

    fn place(self, ports: &[Port]) -> Result<usize> {
        position(ports, self.channel).ok_or_else(|| self.unknown())
    }

    pub(super) fn input(self) -> Result<usize> {
        self.place(&self.system.inputs)
    }

    pub(super) fn state(self) -> Result<usize> {
        self.place(&self.system.states)
    }

    pub(super) fn output(self) -> Result<usize> {
        self.place(&self.system.outputs)
    }

    /// The spread of the input.
    pub(super) fn input_spread(self, scales: &Scales) -> Option<&Spread> {
        scales.inputs.get(self.input().ok()?)
    }

    /// The spread of the output.
    pub(super) fn output_spread(self, scales: &Scales) -> Option<&Spread> {
        scales.outputs.get(self.output().ok()?)
    }

    /// The rms of the state's derivative.
    pub(super) fn derivative(self, scales: &Scales) -> Option<f64> {
        scales.derivatives.get(self.state().ok()?).copied()
    }

    /// The outputs of a name or `*`.
    pub(super) fn outputs(self) -> Result<Vec<usize>> {
        if self.channel == ALL {
            Ok((0..self.system.outputs.len()).collect())
        } else {
            self.output().map(|i| vec![i])
        }
    }

    /// Two ports by their names, `from` and `to`, with the arrow between them.
    fn pair<T>(self, arrow: &str, find: impl Fn(&str, &str) -> Option<T>) -> Result<T> {
        let found = self.channel.split_once(arrow).and_then(|(from, to)| find(from, to));
        found.ok_or_else(|| self.unknown())
    }

    /// `from->to` between two ports of one kind.
    pub(super) fn arrow(self, ports: &[Port]) -> Result<(usize, usize)> {
        self.pair("->", |from, to| two(ports, from, to))
    }

    /// `a<->b` between two states.
    pub(super) fn exchange(self) -> Result<(usize, usize)> {
        self.pair("<->", |a, b| two(&self.system.states, a, b))
    }

    /// `a<->b` between two ports of one kind.
    pub(super) fn swap(self, ports: &[Port]) -> Result<(usize, usize)> {
        self.pair("<->", |a, b| two(ports, a, b))
    }

    /// `from->to`, from a state or an input to a state.
    pub(super) fn coupling(self) -> Result<(Source, usize)> {
        let System { states, inputs, .. } = self.system;
        self.pair("->", |from, to| {
            let source = position(states, from).map(Source::State);
            let source = source.or_else(|| position(inputs, from).map(Source::Input))?;
            Some((source, position(states, to)?))
        })
    }
}

/// Two different ports.
fn two(ports: &[Port], from: &str, to: &str) -> Option<(usize, usize)> {
    Some((position(ports, from)?, position(ports, to)?)).filter(|(from, to)| from != to)
}

/// `from->to` for every two of these ports.
pub(super) fn arrows(ports: &[Port]) -> Vec<String> {
    let to = |from: &Port| {
        let others = ports.iter().filter(|to| to.name != from.name);
        others.map(|to| format!("{}->{}", from.name, to.name)).collect::<Vec<_>>()
    };
    ports.iter().flat_map(to).collect()
}

/// `a<->b` for every two of these ports with one unit.
pub(super) fn alike(ports: &[Port]) -> Vec<String> {
    let with = |(at, a): (usize, &Port)| {
        let others = ports[at + 1..].iter().filter(|b| a.unit == b.unit);
        others.map(|b| format!("{}<->{}", a.name, b.name)).collect::<Vec<_>>()
    };
    ports.iter().enumerate().flat_map(with).collect()
}

/// The share of a swap of two channels.
pub(super) fn share() -> Parameter {
    Parameter { upper: 1.0, ..not_negative("share", "1".to_owned(), 0.0) }
}

/// The channels of an effect that outputs may share: each output and `*`, or `*` alone for a single output.
pub(super) fn shared(system: &System) -> Vec<String> {
    let mut channels = if system.outputs.len() > 1 { names(&system.outputs) } else { Vec::new() };
    channels.push(ALL.to_owned());
    channels
}

/// The derivative of state `to` depends on `from` in the model.
#[must_use]
pub fn depends(system: &System, to: usize, from: Source) -> bool {
    match (&system.dynamics, from) {
        (Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _), Source::State(j)) => {
            matrices.a[(to, j)] != 0.0
        }
        (Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _), Source::Input(j)) => {
            matrices.b[(to, j)] != 0.0
        }
        (Dynamics::Equations(equations, _), Source::State(j)) => {
            equations.derivative_depends(to, Wrt::States, j)
        }
        // The dependence is unknown, so nothing counts as missing.
        (Dynamics::BlackBox(..), _) => true,
        (Dynamics::Equations(equations, _), Source::Input(j)) => {
            equations.derivative_depends(to, Wrt::Inputs, j)
        }
    }
}

/// ± each size.
pub(super) fn both_signs(sizes: impl IntoIterator<Item = f64>) -> Vec<Vec<f64>> {
    sizes.into_iter().flat_map(|v| [vec![v], vec![-v]]).collect()
}

/// The log time of a change.
pub(super) fn instant() -> Parameter {
    Parameter { role: Role::Instant, ..not_negative("time", "s".to_owned(), 0.0) }
}

/// Delays of half a sample, one and a half and so on up to the longest in the search. A direct path or fast edges give the cost one minimum per sample.
pub(super) fn delays(scales: &Scales) -> Vec<Vec<f64>> {
    // At most 40 of them, for any longest delay.
    let step = scales.sample_time_s.max(scales.longest_delay_s / 40.0);
    let mut delay = 0.5 * step;
    let mut delays = Vec::new();
    while delay <= scales.longest_delay_s && delays.len() < 50 {
        delays.push(vec![delay]);
        delay += step;
    }
    delays
}

/// Time constants from below a sample to the longest delay of the search, one per octave.
pub(super) fn times(scales: &Scales) -> Vec<Vec<f64>> {
    let mut times = Vec::new();
    let mut time = 0.5 * scales.sample_time_s;
    while time < scales.longest_delay_s {
        times.push(vec![time]);
        time *= 2.0;
    }
    times.push(vec![scales.longest_delay_s]);
    times
}

/// Limits that a part of the data reaches: on both sides, and on each alone.
pub(super) fn limits(spread: &Spread) -> Vec<Vec<f64>> {
    let (middle, half) =
        (0.5 * (spread.largest + spread.smallest), 0.5 * (spread.largest - spread.smallest));
    let mut starts = Vec::new();
    for share in [1.0, 0.9, 0.7, 0.45, 0.25] {
        let (lower, upper) = (middle - share * half, middle + share * half);
        starts.extend([
            vec![lower, upper],
            vec![f64::NEG_INFINITY, upper],
            vec![lower, f64::INFINITY],
        ]);
    }
    starts
}

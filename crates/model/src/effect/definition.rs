//! What an effect is.

use super::error::Result;
use super::parameter::Parameter;
use super::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::simulator::Port;
use crate::simulate::system::System;

/// Where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Site {
    /// Between a command in the log and the plant.
    Input,
    /// In the plant's differential equations.
    Dynamics,
    /// Between the plant and an output in the log.
    Output,
    /// Between the clocks of commands and sensors.
    Clock,
}

impl Site {
    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Dynamics => "dynamics",
            Self::Output => "output",
            Self::Clock => "clock",
        }
    }
}

/// What holds for an effect on every channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// Its name in files.
    pub name: &'static str,
    /// Where it acts.
    pub site: Site,
    /// What it is, in one line.
    pub summary: &'static str,
    /// Which channels it can act on, in words.
    pub rule: &'static str,
    /// It changes equations: a simulator that can only be called has none at hand.
    pub needs_equations: bool,
    /// It is there only where a model declares it: nobody misses it elsewhere.
    pub is_declared: bool,
    /// Even the right parameters leave a residual: noise decides what it does to single samples.
    pub leaves_residual: bool,
    /// How it makes commands late, where it does that and nothing else.
    pub lateness: Option<Lateness>,
    /// It changes a number that the model already has: all of them together are what a model that
    /// is a little off may be off by.
    pub corrects_model: bool,
    /// It adds a constant and does nothing else, in proportion to its one parameter: what may be
    /// another in every log, as a trim is.
    pub is_constant: bool,
    /// The special case of which it is the general form: the same effect on a channel at some of its
    /// parameters, or indistinguishable in as many logs as one likes.
    pub elaborates: Option<&'static str>,
    /// How it changes with log time what the plainer form holds still; first guesses of it come of
    /// a scan of the logs.
    pub changes: Option<Change>,
    /// What tells it from effects that are like it; `None` where that depends on the case.
    pub told_by: Option<Telling>,
}

impl Facts {
    /// Those of an effect of which nothing else is to be said.
    #[must_use]
    pub const fn of(name: &'static str, site: Site, summary: &'static str) -> Self {
        Self {
            name,
            site,
            summary,
            rule: match site {
                Site::Input => "an input",
                Site::Dynamics => "a state",
                Site::Output => "an output",
                Site::Clock => "`*`: all outputs",
            },
            needs_equations: matches!(site, Site::Dynamics),
            is_declared: false,
            leaves_residual: false,
            lateness: None,
            corrects_model: false,
            is_constant: false,
            elaborates: None,
            changes: None,
            told_by: None,
        }
    }
}

/// How an effect varies with log time what a plainer one holds still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// From a time on another value. Its parameters: the value before, the time, the value from
    /// then on.
    Jump,
    /// Evenly. Its parameters: the value at the start of the log, and its rate.
    Drift,
}

/// What tells an effect from others that are like it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telling {
    /// It changes with the amplitude, or with the direction of motion.
    Amplitude,
    /// It is a constant or a slow change: another operating point and a known start.
    OperatingPoint,
    /// It shows at high frequencies.
    Bandwidth,
}

/// How an effect makes commands late, for one that does nothing else; each says what its parameters
/// are, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lateness {
    /// All by the same time: the delay, seconds.
    Fixed,
    /// Smeared by a first-order lag: the time constant, seconds.
    Lag,
    /// Until the next turn of a slower loop: its period and its phase, seconds.
    SlowerLoop,
    /// Some never arrive, and the one before holds on: the part of them, 1.
    Lost,
    /// Each by a draw of its own: mean and standard deviation of the delay, seconds, and 1 where
    /// they keep their order.
    Random,
}

impl Lateness {
    /// What happens to the single command is a hidden sequence, which only outputs reveal.
    #[must_use]
    pub fn is_hidden(self) -> bool {
        matches!(self, Self::Lost | Self::Random)
    }
}

/// All outputs.
pub(super) const ALL: &str = "*";

/// A channel of a system, named to an effect.
#[derive(Clone, Copy)]
pub struct OnChannel<'a> {
    /// The effect.
    pub effect: &'a dyn Effect,
    /// The system.
    pub system: &'a System,
    /// The channel's name.
    pub channel: &'a str,
}

/// The names of ports.
pub(super) fn names(ports: &[Port]) -> Vec<String> {
    ports.iter().map(|p| p.name.clone()).collect()
}

/// An effect.
pub trait Effect: Sync {
    /// What holds on every channel.
    fn facts(&self) -> Facts;
    /// The channels of this system that it can act on.
    fn channels(&self, system: &System) -> Vec<String> {
        match self.site() {
            Site::Input => names(&system.inputs),
            Site::Dynamics => names(&system.states),
            Site::Output => names(&system.outputs),
            Site::Clock => vec![ALL.to_owned()],
        }
    }
    /// Its parameters on this channel.
    ///
    /// # Errors
    /// [`EffectError`](super::error::EffectError) for a channel that it cannot act on.
    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>>;
    /// First guesses of the parameters; each is a full set. Sizes of the data give them, or a scan
    /// of the logs.
    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let found =
            scales.scanned.iter().find(|s| s.effect == self.name() && s.channel == on.channel);
        found.map(|s| s.starts.clone()).unwrap_or_default()
    }
    /// The smallest values that a search may take, one per parameter; empty: those of the
    /// parameters. Below what samples resolve, a general form is indistinguishable from its
    /// special case, and simulates ever more slowly.
    fn least(&self, _: OnChannel<'_>, _: &Scales) -> Vec<f64> {
        Vec::new()
    }
    /// Further first guesses for a cost with many minima: for a candidate alone,
    /// not for one of several.
    fn scan(&self, _: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }
    /// The parameters make it the identity: those of its size are nominal, whatever its shape.
    fn is_identity(&self, values: &[f64], parameters: &[Parameter]) -> bool {
        values.iter().zip(parameters).all(|(v, p)| p.role.is_shape() || *v == p.nominal)
    }
    /// The values with which it does what a column does that is logged as so many times what the
    /// channel is: a wrong sign (−1), or a wrong unit.
    fn of_factor(&self, _: f64) -> Option<Vec<f64>> {
        None
    }
    /// Parameters that mean the same written in the one usual way.
    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        values
    }
    /// Adds its hooks. Only called away from the identity and inside the bounds.
    ///
    /// # Errors
    /// [`EffectError`](super::error::EffectError) for a channel that it cannot act on.
    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()>;

    /// Its name in files.
    fn name(&self) -> &'static str {
        self.facts().name
    }
    /// Where it acts.
    fn site(&self) -> Site {
        self.facts().site
    }
    /// How it makes commands late, where it does that and nothing else.
    fn lateness(&self) -> Option<Lateness> {
        self.facts().lateness
    }
    /// What it does to single samples is a hidden sequence of lost or late commands, which outputs
    /// reveal.
    fn loses_commands(&self) -> bool {
        self.lateness().is_some_and(Lateness::is_hidden)
    }
    /// Even the right parameters leave a residual.
    fn leaves_residual(&self) -> bool {
        self.facts().leaves_residual
    }
    /// It changes a number that the model already has.
    fn corrects_model(&self) -> bool {
        self.facts().corrects_model
    }
    /// It adds a constant and does nothing else.
    fn is_constant(&self) -> bool {
        self.facts().is_constant
    }
    /// The special case of which it is the general form.
    fn elaborates(&self) -> Option<&'static str> {
        self.facts().elaborates
    }
    /// How it changes with log time what [`Effect::elaborates`] holds still.
    fn changes(&self) -> Option<Change> {
        self.facts().changes
    }
}

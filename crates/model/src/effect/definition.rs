//! The definition of an effect.

use super::error::Result;
use super::parameter::Parameter;
use super::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::simulator::Port;
use crate::simulate::system::System;

/// The site of an effect.
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

/// The properties of an effect that are common to all channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// Its name in files.
    pub name: &'static str,
    /// Its site.
    pub site: Site,
    /// A summary in one line.
    pub summary: &'static str,
    /// The channels on which it can act, in words.
    pub rule: &'static str,
    /// The effect changes equations, which a black-box simulator does not provide.
    pub needs_equations: bool,
    /// The effect exists only where a model declares it; the search does not add it.
    pub is_declared: bool,
    /// A residual remains with exact parameters: noise decides its effect on single samples.
    pub leaves_residual: bool,
    /// The kind of lateness of an effect that only makes commands late.
    pub lateness: Option<Lateness>,
    /// The effect changes a parameter of the model; together these effects are the joint recalibration of all parameters.
    pub corrects_model: bool,
    /// The effect adds a constant in proportion to its one parameter. Such a constant may differ between logs, as a trim does.
    pub is_constant: bool,
    /// Its special case, which it generalises: the same effect on a channel at some of its parameters, or an alias for any number of logs.
    pub elaborates: Option<&'static str>,
    /// The change with log time of the value that is constant in the special case; a scan of the logs gives its initial values.
    pub changes: Option<Change>,
    /// The property that distinguishes the effect from its aliases; `None` where that depends on the case.
    pub told_by: Option<Telling>,
}

impl Facts {
    /// The properties of an effect with defaults for all others.
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

/// The change of a value with log time that is constant in the special case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// A step at a time. Parameters: the value before, the time, the value from then on.
    Jump,
    /// A constant rate. Parameters: the value at the start of the log, and its rate.
    Drift,
}

/// The property that distinguishes an effect from its aliases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telling {
    /// Its dependence on the amplitude, or on the direction of motion.
    Amplitude,
    /// It is a constant or a slow change: another operating point and a known initial state distinguish it.
    OperatingPoint,
    /// Its visibility at high frequencies.
    Bandwidth,
}

/// The kinds of lateness of commands, for effects without any other action. Each kind lists its parameters in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lateness {
    /// One delay for all: the delay, s.
    Fixed,
    /// A first-order lag: the time constant, s.
    Lag,
    /// Until the next cycle of a slower loop: its period and its phase, s.
    SlowerLoop,
    /// Some are lost, and the previous one is held: their share, 1.
    Lost,
    /// One random delay per command: mean and standard deviation, s, and 1 where commands keep their order.
    Random,
}

impl Lateness {
    /// Each command's lateness is a latent sequence, visible only in the outputs.
    #[must_use]
    pub fn is_hidden(self) -> bool {
        matches!(self, Self::Lost | Self::Random)
    }
}

/// All outputs.
pub(super) const ALL: &str = "*";

/// A channel of a system, as given to an effect.
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
    /// The properties common to all channels.
    fn facts(&self) -> Facts;
    /// The channels of this system on which it can act.
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
    /// [`EffectError`](super::error::EffectError) for a channel on which it cannot act.
    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>>;
    /// Initial parameters; each entry is a full set. Sizes of the data or a scan of the logs give the values.
    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let found =
            scales.scanned.iter().find(|s| s.effect == self.name() && s.channel == on.channel);
        found.map(|s| s.starts.clone()).unwrap_or_default()
    }
    /// The lower bounds of a search, one per parameter; empty: those of the parameters. Below the resolution of the samples, a general form is
    /// indistinguishable from its special case, and its simulation slower.
    fn least(&self, _: OnChannel<'_>, _: &Scales) -> Vec<f64> {
        Vec::new()
    }
    /// Further initial values for a cost with many minima: for a candidate alone, not for one of several.
    fn scan(&self, _: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }
    /// The parameters make the effect the identity: its sizes are nominal, for any shape.
    fn is_identity(&self, values: &[f64], parameters: &[Parameter]) -> bool {
        values.iter().zip(parameters).all(|(v, p)| p.role.is_shape() || *v == p.nominal)
    }
    /// The values that represent a channel logged with this factor: a wrong sign (−1), or a wrong unit.
    fn of_factor(&self, _: f64) -> Option<Vec<f64>> {
        None
    }
    /// Equivalent parameters in the canonical form.
    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        values
    }
    /// Adds its hooks. Called only away from the identity and inside the bounds.
    ///
    /// # Errors
    /// [`EffectError`](super::error::EffectError) for a channel on which it cannot act.
    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()>;

    /// Its name in files.
    fn name(&self) -> &'static str {
        self.facts().name
    }
    /// Its site.
    fn site(&self) -> Site {
        self.facts().site
    }
    /// The kind of lateness of an effect that only makes commands late.
    fn lateness(&self) -> Option<Lateness> {
        self.facts().lateness
    }
    /// Its effect on single samples is a latent sequence of lost or late commands, visible in the outputs.
    fn loses_commands(&self) -> bool {
        self.lateness().is_some_and(Lateness::is_hidden)
    }
    /// A residual remains with exact parameters.
    fn leaves_residual(&self) -> bool {
        self.facts().leaves_residual
    }
    /// The effect changes a parameter of the model.
    fn corrects_model(&self) -> bool {
        self.facts().corrects_model
    }
    /// The effect only adds a constant.
    fn is_constant(&self) -> bool {
        self.facts().is_constant
    }
    /// The special case that it generalises.
    fn elaborates(&self) -> Option<&'static str> {
        self.facts().elaborates
    }
    /// The change with log time of the value that is constant in [`Effect::elaborates`].
    fn changes(&self) -> Option<Change> {
        self.facts().changes
    }
}

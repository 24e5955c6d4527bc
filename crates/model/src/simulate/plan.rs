//! Hooks around and inside a simulator for one run: on its inputs, in its dynamics, on its outputs and on the clock.
//!
//! A new plan adds nothing. This file alone defines the order in which a signal passes the hooks. Inputs: `drops`, `late`, `passing`, `delay_s`, `gain` and
//! `quadratic`, `maps` in the order pushed, `lags`, `modes`, `swaps`. Outputs: modes, `mixing`, `lag_s`, `delay_s` and the clock, `play`, `maps`.

use deadtime_signal::progress::HowFar;
use std::sync::{Arc, OnceLock};

use super::piecewise::Piecewise;
use super::system::{Dynamics, ModelNumber, System};
use crate::c2d::hold::Hold;

/// A map of a whole piecewise linear signal: memoryless, or with a memory such as a play's.
pub type SignalMap = Arc<dyn Fn(Piecewise) -> Piecewise + Send + Sync>;
/// A map of one sample: log time (s) and value.
pub type SampleMap = Arc<dyn Fn(f64, f64) -> f64 + Send + Sync>;

/// The loss of commands; by default none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Losses {
    /// Probability of a loss.
    pub probability: f64,
    /// Mean length of a loss, commands; `None`: independent losses.
    pub burst: Option<f64>,
}

impl Losses {
    /// Probabilities that a loss begins, and that it continues.
    #[must_use]
    pub fn begins_and_goes_on(&self) -> [f64; 2] {
        let p = self.probability;
        self.burst.map_or([p, p], |burst| [(p / (burst * (1.0 - p))).min(1.0), 1.0 - burst.recip()])
    }
}

/// The realisation of a random sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Realisation<K> {
    /// Its mean, which is what a fit can predict.
    Mean,
    /// A draw from this seed.
    Seed(u64),
    /// The known sequence.
    Known(K),
}

/// Lost commands: the last one that arrived is held. The first sample always arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct Drops {
    /// The statistics of the losses.
    pub losses: Losses,
    /// The lost samples of the log.
    pub lost: Realisation<Vec<bool>>,
}

/// Commands with individual delays: draws of a gamma distribution. The first sample has always arrived.
#[derive(Debug, Clone, PartialEq)]
pub struct Late {
    /// Mean delay, seconds.
    pub delay_s: f64,
    /// Standard deviation of the delay, seconds.
    pub spread_s: f64,
    /// No command overtakes another: it waits for those sent before it. Otherwise the last to arrive acts.
    pub ordered: bool,
    /// The delays of single commands, seconds, one for each sample of the log.
    pub delays: Delays,
}

/// The delays of single commands.
pub type Delays = Realisation<Vec<f64>>;

/// The path of one input from the log to the plant.
#[derive(Clone, Default)]
pub struct InputPath {
    /// Lost commands.
    pub drops: Option<Drops>,
    /// Commands with individual delays.
    pub late: Option<Late>,
    /// Period and phase, s: commands pass at phase + n·period only, and are held.
    pub passing: Option<(f64, f64)>,
    /// Delay, seconds.
    pub delay_s: f64,
    /// Static curve gain·v + quadratic·v·|v|; `None`: v.
    pub curve: Option<Curve>,
    /// Maps, in the order of action.
    pub maps: Vec<SignalMap>,
    /// Time constants of first-order lags, s, in series.
    pub lags_s: Vec<f64>,
    /// The plant's input at rest at the start of the run, where known: the initial state of a map with a memory.
    pub rest: Arc<OnceLock<f64>>,
}

/// gain·v + quadratic·v·|v|.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curve {
    /// Gain at 0.
    pub gain: f64,
    /// Per unit of the input.
    pub quadratic: f64,
}

impl Default for Curve {
    fn default() -> Self {
        Self { gain: 1.0, quadratic: 0.0 }
    }
}

/// The path of one output from the plant to the log.
#[derive(Clone)]
pub struct OutputPath {
    /// (output, gain): outputs to add, with their values before any addition.
    pub mixing: Vec<(usize, f64)>,
    /// Time constants of first-order lags, seconds, in series.
    pub lags_s: Vec<f64>,
    /// Delay, seconds.
    pub delay_s: f64,
    /// Half the play between the plant and the sensor, from sample to sample; its initial position is the middle. The play acts before the maps.
    pub play: f64,
    /// Maps of the samples, in the order of action.
    pub maps: Vec<SampleMap>,
    /// The slope of those maps. A correction by measured outputs is divided by it, so that the observer's poles are independent of a sensor's gain.
    pub slope: f64,
}

impl Default for OutputPath {
    fn default() -> Self {
        Self {
            mixing: Vec::new(),
            lags_s: Vec::new(),
            delay_s: 0.0,
            play: 0.0,
            maps: Vec::new(),
            slope: 1.0,
        }
    }
}

impl OutputPath {
    /// A sample after the play and the maps; `position` is the play's far side, NaN before the first sample.
    pub(super) fn shown(&self, value: f64, time_s: f64, position: &mut f64) -> f64 {
        let mut value = value;
        if self.play > 0.0 {
            let before = if position.is_nan() { value } else { *position };
            value = before.max(value - self.play).min(value + self.play);
            *position = value;
        }
        self.maps.iter().fold(value, |value, map| map(time_s, value))
    }

    /// The factor on a correction by this output's innovation; 1 for a sensor with a gain near zero.
    pub(super) fn correction(&self) -> f64 {
        if self.slope.abs() > 1e-3 { 1.0 / self.slope } else { 1.0 }
    }
}

/// The site of a resonance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModeSite {
    /// An input of the plant.
    Input(usize),
    /// A state's derivative.
    State(usize),
    /// An output.
    Output(usize),
}

/// A resonance q'' + 2ζω q' + ω² q = ω² v, driven by an input; gain·q is added at the site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// The input that drives it. A mode at the same input uses the signal within that input's path. Other modes use its end, before an operating point is
    /// subtracted.
    pub input: usize,
    /// Its site.
    pub site: ModeSite,
    /// ω, rad/s.
    pub omega_rad_s: f64,
    /// ζ.
    pub damping: f64,
    /// Gain.
    pub gain: f64,
}

/// An additional term of a state's derivative.
pub enum Term {
    /// gain times another state or an input of the plant.
    Linear {
        /// The state whose derivative changes.
        to: usize,
        /// The source of the term.
        from: Source,
        /// Gain.
        gain: f64,
    },
    /// A constant.
    Constant {
        /// The state whose derivative changes.
        to: usize,
        /// Level, the derivative's unit.
        level: f64,
    },
    /// amplitude·sin(ωt + phase), t from the log's first sample.
    Sine {
        /// The state whose derivative changes.
        to: usize,
        /// ω, rad/s.
        omega_rad_s: f64,
        /// Amplitude, the derivative's unit.
        amplitude: f64,
        /// Phase, rad.
        phase_rad: f64,
    },
    /// A function of one state.
    Function {
        /// The state whose derivative changes.
        to: usize,
        /// The state that it depends on.
        from: usize,
        /// The function.
        f: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
    },
    /// −level·sign(x) on the derivative of x, which sticks at 0 while the remainder of its derivative is within ±level.
    Friction {
        /// The state.
        state: usize,
        /// Level, the derivative's unit.
        level: f64,
    },
    /// −level·z on the derivative of x, where z follows x. ż = x/displacement·(1 − |z|^sharpness) while x and z have one sign, else ż = x/displacement.
    Hysteresis {
        /// The state x.
        velocity: usize,
        /// Level, the derivative's unit.
        level: f64,
        /// Displacement, the unit of x times s.
        displacement: f64,
        /// Sharpness, 1.
        sharpness: f64,
    },
}

/// A parameter of the model that changes at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Switch {
    /// The time, seconds from the log's first sample.
    pub time_s: f64,
    /// The parameter.
    pub number: ModelNumber,
    /// Its value from then on.
    pub value: f64,
}

/// A filter of a quantity inside the plant. In the dynamics the quantity is an input after the plant's own. The unfiltered value is an output after them, in
/// the order of the plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InnerFilter {
    /// A first-order lag of this time constant, seconds, settled at the start.
    Lag(f64),
    /// A dead time, s, settled at the start; without a stored history, a Padé approximant of order 3 over 4.
    Delay(f64),
}

/// Orders of numerator and denominator of a dead time's approximant.
const PADE: [usize; 2] = [3, 4];

impl InnerFilter {
    /// Number of states.
    pub(super) fn order(self) -> usize {
        match self {
            Self::Lag(_) => 1,
            Self::Delay(_) => PADE[1],
        }
    }

    /// Its time, s, and coefficients of numerator and denominator over powers of s times that.
    pub(crate) fn transfer(self) -> (f64, Vec<f64>, Vec<f64>) {
        let [m, n] = PADE;
        let factorial = |k: usize| (1..=k).map(|i| i as f64).product::<f64>();
        let coefficient = |order: usize, k: usize| {
            factorial(m + n - k) * factorial(order)
                / (factorial(m + n) * factorial(k) * factorial(order - k))
        };
        match self {
            Self::Lag(time_s) => (time_s, vec![1.0], vec![1.0, 1.0]),
            Self::Delay(time_s) => {
                let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
                let over = (0..=m).map(|k| sign(k) * coefficient(m, k)).collect();
                (time_s, over, (0..=n).map(|k| coefficient(n, k)).collect())
            }
        }
    }
}

/// The source of a linear term.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A state.
    State(usize),
    /// An input, as received by the plant.
    Input(usize),
}

/// The sensors' clock: when the commands' clock reads t, it reads ratio·t + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorClock {
    /// Ratio.
    pub ratio: f64,
    /// Offset, seconds.
    pub offset_s: f64,
}

impl SensorClock {
    /// The commands' time at which the sensors' clock reads `stamp_s`.
    #[must_use]
    pub fn commands_time_s(&self, stamp_s: f64) -> f64 {
        (stamp_s - self.offset_s) / self.ratio
    }
}

impl Default for SensorClock {
    fn default() -> Self {
        Self { ratio: 1.0, offset_s: 0.0 }
    }
}

/// The accuracy of the integration of nonlinear dynamics: the error allowed in one step. Linear dynamics are exact for any tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Relative to a state's size.
    pub relative: f64,
    /// The absolute part, in the states' units.
    pub absolute: f64,
    /// Steps between two edges or samples before the simulation fails.
    pub steps: usize,
    /// Steps of the whole run before it fails.
    pub budget: usize,
    /// Steps may pass samples, up to the next edge. The state at a sample then comes from the step's curve, with the same tolerance but one order lower.
    pub past_samples: bool,
}

impl Default for Tolerance {
    /// Errors far below the resolution of a sensor, at a cost acceptable for a fit.
    fn default() -> Self {
        Self {
            relative: 1e-8,
            absolute: 1e-10,
            steps: 100_000,
            budget: usize::MAX,
            past_samples: false,
        }
    }
}

/// The requested parts of a simulation; the others are not computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Number of samples of the log, from its first on: outputs after them stay 0. A sampled model and a black-box simulator compute all.
    pub samples: usize,
    /// Also the plant's states at the log's stamps.
    pub states: bool,
}

impl Default for Wanted {
    /// Everything.
    fn default() -> Self {
        Self { samples: usize::MAX, states: true }
    }
}

/// All hooks of one simulation, on a copy of the dynamics that a wrong parameter may change.
pub struct Plan {
    /// The dynamics.
    pub dynamics: Dynamics,
    /// Parameters of the dynamics that change at a time; not available for a sampled model and a black-box simulator.
    pub switches: Vec<Switch>,
    /// One path per input.
    pub inputs: Vec<InputPath>,
    /// Two inputs, and the share of their swap at the end of their paths: 0 none, 1 complete.
    pub swaps: Vec<(usize, usize, f64)>,
    /// Filters of quantities inside the plant.
    pub filters: Vec<InnerFilter>,
    /// Terms of the dynamics.
    pub terms: Vec<Term>,
    /// Resonances.
    pub modes: Vec<Mode>,
    /// One path per output.
    pub outputs: Vec<OutputPath>,
    /// The sensors' clock.
    pub clock: SensorClock,
    /// The hold of the commands between samples. Linear interpolation supports delays, lags and modes only; a sampled model and a black-box simulator have no
    /// values between the samples.
    pub hold: Hold,
    /// The accuracy of the integration of nonlinear dynamics.
    pub tolerance: Tolerance,
    /// The requested parts.
    pub wanted: Wanted,
    /// Progress of the simulation.
    pub far: HowFar,
}

impl Plan {
    /// The simulator without hooks.
    #[must_use]
    pub fn new(system: &System) -> Self {
        let inputs = system
            .input_delay_s
            .iter()
            .map(|&delay_s| InputPath { delay_s, ..InputPath::default() })
            .collect();
        let outputs = system.outputs.iter().map(|_| OutputPath::default()).collect();
        Self {
            dynamics: system.dynamics.clone(),
            switches: Vec::new(),
            inputs,
            swaps: Vec::new(),
            filters: Vec::new(),
            terms: Vec::new(),
            modes: Vec::new(),
            outputs,
            clock: SensorClock::default(),
            hold: Hold::Zero,
            tolerance: Tolerance::default(),
            wanted: Wanted::default(),
            far: HowFar::default(),
        }
    }

    /// The dynamics from every switch on, with its time, in order of time.
    pub(super) fn phases(&self) -> Vec<(f64, Dynamics)> {
        let mut switches = self.switches.clone();
        switches.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let mut dynamics = self.dynamics.clone();
        let phase = |switch: Switch| {
            dynamics.set(switch.number, switch.value);
            (switch.time_s, dynamics.clone())
        };
        switches.into_iter().map(phase).collect()
    }
}

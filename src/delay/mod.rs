//! Dead-time estimation: what an estimator is, and the list of all there are.

mod arxstruc;
mod estimate;
mod experiment;
mod oestruc;
mod posterior;
mod state_least_squares;
mod threshold;
mod verdict;

pub use arxstruc::Arxstruc;
pub use estimate::{DelayEstimate, Outcome, PairEstimate};
pub use experiment::{Detrend, Experiment, PlantModel, Recording, Series};
pub use oestruc::Oestruc;
pub use state_least_squares::{Coefficients, Selection, StateLeastSquares};
pub use threshold::{Records, Step, Threshold};
pub use verdict::{Verdict, verdict};

pub use crate::identify::{Initial, Record};
use crate::registry::{Entry, entry};

/// An estimation that cannot be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DelayError {
    /// Fewer samples than the regression needs.
    #[error("{method} needs at least {needed} samples for these orders and this search window, the longest record has {got}; {remedy}")]
    TooShort {
        /// The method.
        method: &'static str,
        /// Samples it needs.
        needed: usize,
        /// Samples of the longest record.
        got: usize,
        /// Which options would make it fit.
        remedy: &'static str,
    },
    /// A channel that never changes.
    #[error("{role} `{channel}` never changes (it is {value} throughout); a dead time shows only where it moves")]
    Constant {
        /// Input or output.
        role: &'static str,
        /// The channel.
        channel: String,
        /// Its value.
        value: f64,
    },
    /// A sample that is NaN or infinite.
    #[error("{role} `{channel}` is {value} at sample {sample}; every sample must be finite")]
    NotFinite {
        /// Input, output or state.
        role: &'static str,
        /// The channel.
        channel: String,
        /// Sample, counted from 0.
        sample: usize,
        /// The value.
        value: f64,
    },
    /// Records or channels of lengths that do not fit.
    #[error("{what}: {got} given, {needed} needed")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there should be.
        needed: usize,
        /// How many there are.
        got: usize,
    },
    /// An option out of its range.
    #[error("{method}: {option} = {value}; it must be {allowed}")]
    Option {
        /// The method.
        method: &'static str,
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// Regressors that are combinations of each other, where the coefficients themselves were asked for.
    #[error("{method}: the lags of the inputs are combinations of each other; use inputs that move more, and not together")]
    Dependent {
        /// The method.
        method: &'static str,
    },
    /// A method that needs a model and measured states got none.
    #[error(
        "{method} needs a model and a measured channel for each of its states; give --model and name the columns as the states are named (--map)"
    )]
    NoStates {
        /// The method.
        method: &'static str,
    },
}

/// How far to search, and what to take off the answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Longest delay searched, samples; default 35. When the answer is the longest, the window doubles once.
    pub max_delay: usize,
    /// Samples that a delay-free plant already needs to respond (its relative degree), by output and input; pairs beyond the table take `default_bias`.
    pub bias: Vec<Vec<usize>>,
    /// The bias of every other pair; default 1, a strictly proper plant behind a zero-order hold.
    pub default_bias: usize,
}

impl Default for Search {
    fn default() -> Self {
        Self { max_delay: 35, bias: Vec::new(), default_bias: 1 }
    }
}

impl Search {
    fn bias(&self, input: usize, output: usize) -> usize {
        self.bias.get(output).and_then(|row| row.get(input)).copied().unwrap_or(self.default_bias)
    }
}

/// An estimator; the implementor is its option struct.
pub trait DelayEstimator: Send + Sync {
    /// The delay of every pair (or of every input).
    ///
    /// # Errors
    /// [`DelayError`] where the data cannot be used at all; what the data do not show is an [`Outcome`].
    fn estimate(&self, experiment: &Experiment, search: &Search) -> Result<Vec<PairEstimate>, DelayError>;
}

/// Runs `method` on every pair, with the window doubled once where its answer is the longest delay searched.
fn every_pair(
    experiment: &Experiment,
    search: &Search,
    method: impl Fn(&[Record], usize, usize) -> Result<DelayEstimate, DelayError>,
) -> Result<Vec<PairEstimate>, DelayError> {
    experiment.check()?;
    let mut estimates = Vec::new();
    for output in 0..experiment.outputs.len() {
        for input in 0..experiment.inputs.len() {
            let records = experiment.pair(input, output)?;
            let bias = search.bias(input, output);
            let mut estimate = method(&records, search.max_delay, bias)?;
            if estimate.outcome == Outcome::AtEdge
                // A record too short for the wider window leaves the answer at the edge of the narrow one.
                && let Ok(wider) = method(&records, 2 * search.max_delay, bias)
            {
                estimate = wider;
            }
            estimates.push(PairEstimate { input, output: Some(output), estimate });
        }
    }
    Ok(estimates)
}

/// What a method looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// One input and one output at a time.
    Pair,
    /// All inputs and the states together; needs a model.
    States,
}

/// A law that an estimator may promise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// Delaying y by k samples moves the answer by k samples.
    Shift,
    /// A gain on u or y changes nothing.
    Gain,
    /// Another sign of u or y changes nothing.
    Sign,
    /// Whole-sample delays are found exactly on noise-free rich input.
    Exact,
}

/// What a method takes for granted about the start of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Nothing: samples that reach back before the record are left out.
    Any,
    /// That the plant rested: a record that begins at rest is measured from there, not from its mean.
    Rest,
}

/// One line of the list of methods.
pub struct Method {
    /// Name, summary and options.
    pub entry: Entry<dyn DelayEstimator>,
    /// What it looks at.
    pub scope: Scope,
    /// What it takes for granted about the start.
    pub start: Start,
    /// Laws that it does not promise, and why.
    pub exempt: &'static [(Law, &'static str)],
}

/// Every estimator.
pub const METHODS: &[Method] = &[
    Method {
        entry: entry!(
            "oestruc",
            "best output-error model B/F over all delays (nb 1, nf 2): the most accurate on open-loop data",
            Oestruc,
            dyn DelayEstimator
        ),
        scope: Scope::Pair,
        start: Start::Rest,
        exempt: &[],
    },
    Method {
        entry: entry!(
            "arxstruc",
            "best ARX model over all delays (na 10, nb 5): fast, also for unstable plants and under feedback",
            Arxstruc,
            dyn DelayEstimator
        ),
        scope: Scope::Pair,
        start: Start::Any,
        exempt: &[],
    },
    Method {
        entry: entry!(
            "threshold",
            "first coefficient of the estimated impulse response above its threshold",
            Threshold,
            dyn DelayEstimator
        ),
        scope: Scope::Pair,
        start: Start::Any,
        exempt: &[],
    },
    Method {
        entry: entry!("threshold_step", "first sample of the estimated step response above its threshold", Step, dyn DelayEstimator),
        scope: Scope::Pair,
        start: Start::Any,
        exempt: &[(
            Law::Exact,
            "the running sum gathers the errors of all coefficients before it, such as those of a response that outlives the taps",
        )],
    },
    Method {
        entry: entry!(
            "state_least_squares",
            "delay of every input from measured states and known A and B",
            StateLeastSquares,
            dyn DelayEstimator
        ),
        scope: Scope::States,
        start: Start::Any,
        exempt: &[
            (Law::Shift, "it compares states with a model: an output that is delayed alone is not what the model says"),
            (Law::Gain, "the model's B fixes the gain"),
            (Law::Sign, "the model's B fixes the sign"),
        ],
    },
];

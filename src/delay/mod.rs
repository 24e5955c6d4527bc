//! Dead-time estimation: what an estimator is, and the list of all there are.

mod arxstruc;
mod oestruc;
mod posterior;
mod state_least_squares;
mod threshold;
mod verdict;

pub use arxstruc::Arxstruc;
pub use oestruc::Oestruc;
pub use state_least_squares::{Coefficients, Selection, StateLeastSquares};
pub use threshold::{Records, Step, Threshold};
pub use verdict::{Verdict, verdict};

pub use crate::identify::{Initial, Record};
use crate::model::{Continuous, Sampled, StateSpace};
use crate::registry::{Entry, entry};
use crate::time::SampleTime;

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

/// What came of an estimation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// A delay was found.
    Found,
    /// The best delay is the longest that was searched.
    AtEdge,
    /// The output does not visibly follow the input.
    NotVisible,
    /// The input does not excite what the method must estimate.
    NotRichEnough,
    /// The equations have no unique solution.
    Singular,
    /// The optimiser found no minimum.
    NotConverged,
    /// Many delays fit equally well.
    Flat,
    /// The method cannot be used on this data.
    NotApplicable,
}

impl Outcome {
    /// A delay comes with it.
    #[must_use]
    pub fn has_delay(self) -> bool {
        matches!(self, Self::Found | Self::AtEdge)
    }

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::AtEdge => "at_edge",
            Self::NotVisible => "not_visible",
            Self::NotRichEnough => "not_rich_enough",
            Self::Singular => "singular",
            Self::NotConverged => "not_converged",
            Self::Flat => "flat",
            Self::NotApplicable => "not_applicable",
        }
    }
}

/// One method's answer for one input and one output.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayEstimate {
    /// What came of it.
    pub outcome: Outcome,
    /// The dead time, s, the degree bias taken off; with `Found` and `AtEdge` only.
    pub delay_s: Option<f64>,
    /// Its standard deviation, s, the resolution of the method included.
    pub std_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// What the method's original definition returns, s.
    pub raw_delay_s: Option<f64>,
    /// Samples that were taken off the raw value: the relative degree of the sampled plant.
    pub degree_bias_samples: usize,
    /// What a reader must know besides.
    pub note: Option<String>,
}

impl DelayEstimate {
    /// An answer without a delay.
    #[must_use]
    pub fn without(outcome: Outcome, note: impl Into<String>) -> Self {
        Self { outcome, delay_s: None, std_s: None, ci95_s: None, raw_delay_s: None, degree_bias_samples: 0, note: Some(note.into()) }
    }

    /// An answer of a method that counts samples: raw value, standard deviation and interval in samples, before the bias is taken off.
    fn counted(raw: f64, std: f64, interval: [f64; 2], at_edge: bool, bias: usize, sample_time: SampleTime) -> Self {
        #[allow(clippy::cast_precision_loss)]
        let off = bias as f64;
        let seconds = |samples: f64| sample_time.to_seconds((samples - off).max(0.0));
        let mut notes = Vec::new();
        if raw < off {
            notes.push("the output reacts within the sample: no dead time, and a direct path or a faster response than assumed".to_owned());
        }
        if at_edge {
            notes.push("the best delay is the longest searched: give a longer --max-delay".to_owned());
        }
        Self {
            outcome: if at_edge { Outcome::AtEdge } else { Outcome::Found },
            delay_s: Some(seconds(raw)),
            std_s: Some(sample_time.to_seconds(std)),
            ci95_s: Some(interval.map(seconds)),
            raw_delay_s: Some(sample_time.to_seconds(raw)),
            degree_bias_samples: bias,
            note: if notes.is_empty() { None } else { Some(notes.join("; ")) },
        }
    }

    /// Adds a sentence to the note.
    #[must_use]
    fn noting(mut self, more: Option<String>) -> Self {
        self.note = match (self.note, more) {
            (Some(a), Some(b)) => Some(format!("{a}; {b}")),
            (a, b) => a.or(b),
        };
        self
    }
}

/// An estimate and the pair it belongs to; `output: None` where it holds for the input whatever the output.
#[derive(Debug, Clone, PartialEq)]
pub struct PairEstimate {
    /// Input, counted from 0.
    pub input: usize,
    /// Output, counted from 0.
    pub output: Option<usize>,
    /// The answer.
    pub estimate: DelayEstimate,
}

/// A measured channel over one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Samples; whatever stands at a missing one is not looked at.
    pub values: Vec<f64>,
    /// Which samples were measured; `None`: all.
    pub present: Option<Vec<bool>>,
}

impl From<Vec<f64>> for Series {
    fn from(values: Vec<f64>) -> Self {
        Self { values, present: None }
    }
}

/// All channels over one stretch of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// One series per input.
    pub inputs: Vec<Vec<f64>>,
    /// One series per output.
    pub outputs: Vec<Series>,
    /// One series per state of the model; empty where they were not measured.
    pub states: Vec<Vec<f64>>,
}

/// The model that goes with an experiment.
#[derive(Debug, Clone, PartialEq)]
pub enum PlantModel {
    /// Continuous: fractional delays can be resolved exactly.
    Continuous(StateSpace<Continuous>),
    /// Sampled, at the experiment's sample time.
    Sampled(StateSpace<Sampled>),
}

/// What was measured: one or several recordings on one even grid, names, and what is known of the plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// The sample time.
    pub sample_time: SampleTime,
    /// Input names.
    pub inputs: Vec<String>,
    /// Output names.
    pub outputs: Vec<String>,
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// The plant, for methods that need A and B.
    pub model: Option<PlantModel>,
}

impl Experiment {
    /// One input, one output, one recording.
    #[must_use]
    pub fn siso(sample_time: SampleTime, u: Vec<f64>, y: Vec<f64>) -> Self {
        Self {
            sample_time,
            inputs: vec!["u".into()],
            outputs: vec!["y".into()],
            recordings: vec![Recording { inputs: vec![u], outputs: vec![y.into()], states: Vec::new() }],
            model: None,
        }
    }

    /// Checks lengths and numbers, and that inputs and outputs move.
    ///
    /// # Errors
    /// [`DelayError::Count`], [`DelayError::NotFinite`] or [`DelayError::Constant`].
    pub fn check(&self) -> Result<(), DelayError> {
        if self.recordings.is_empty() {
            return Err(DelayError::Count { what: "recordings", needed: 1, got: 0 });
        }
        for recording in &self.recordings {
            let samples = recording.inputs.first().map_or(0, Vec::len);
            let counts = [
                ("inputs of a recording", self.inputs.len(), recording.inputs.len()),
                ("outputs of a recording", self.outputs.len(), recording.outputs.len()),
            ];
            for (what, needed, got) in counts {
                if needed != got || needed == 0 {
                    return Err(DelayError::Count { what, needed: needed.max(1), got });
                }
            }
            let outputs = recording
                .outputs
                .iter()
                .map(|s| s.values.len())
                .chain(recording.outputs.iter().filter_map(|s| Some(s.present.as_ref()?.len())));
            let lengths = recording.inputs.iter().chain(&recording.states).map(Vec::len).chain(outputs);
            if let Some(got) = lengths.into_iter().find(|&l| l != samples) {
                return Err(DelayError::Count { what: "samples of a channel", needed: samples, got });
            }
        }
        for (i, channel) in self.inputs.iter().enumerate() {
            let samples = || self.recordings.iter().flat_map(move |r| r.inputs[i].iter().map(|v| (*v, true)));
            moves("input", channel, samples)?;
        }
        for (i, channel) in self.outputs.iter().enumerate() {
            let samples = || {
                self.recordings.iter().flat_map(move |r| {
                    let series = &r.outputs[i];
                    series.values.iter().enumerate().map(move |(t, v)| (*v, series.present.as_ref().is_none_or(|p| p[t])))
                })
            };
            moves("output", channel, samples)?;
        }
        Ok(())
    }

    /// The records of one pair.
    ///
    /// # Errors
    /// [`DelayError::Count`] for a pair that does not exist.
    pub fn pair(&self, input: usize, output: usize) -> Result<Vec<Record>, DelayError> {
        if input >= self.inputs.len() || output >= self.outputs.len() {
            let (needed, got) = if input >= self.inputs.len() { (input + 1, self.inputs.len()) } else { (output + 1, self.outputs.len()) };
            return Err(DelayError::Count { what: "channels", needed, got });
        }
        Ok((self.recordings.iter())
            .map(|r| Record { u: r.inputs[input].clone(), y: r.outputs[output].values.clone(), present: r.outputs[output].present.clone() })
            .collect())
    }

    /// This experiment with one input and one output.
    ///
    /// # Errors
    /// As [`Experiment::pair`].
    pub fn select(&self, input: usize, output: usize) -> Result<Self, DelayError> {
        let recordings = self.pair(input, output)?.into_iter();
        Ok(Self {
            sample_time: self.sample_time,
            inputs: vec![self.inputs[input].clone()],
            outputs: vec![self.outputs[output].clone()],
            recordings: recordings
                .map(|r| Recording { inputs: vec![r.u], outputs: vec![Series { values: r.y, present: r.present }], states: Vec::new() })
                .collect(),
            model: None,
        })
    }

    /// Samples of the longest recording.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.recordings.iter().filter_map(|r| r.inputs.first()).map(Vec::len).max().unwrap_or(0)
    }
}

/// All values are finite and not all are equal.
fn moves<I: Iterator<Item = (f64, bool)>>(role: &'static str, channel: &str, samples: impl Fn() -> I) -> Result<(), DelayError> {
    let present = || samples().enumerate().filter(|(_, (_, present))| *present).map(|(t, (v, _))| (t, v));
    if let Some((sample, value)) = present().find(|(_, v)| !v.is_finite()) {
        return Err(DelayError::NotFinite { role, channel: channel.to_owned(), sample, value });
    }
    let value = present().next().map_or(0.0, |(_, v)| v);
    if present().all(|(_, v)| v == value) {
        return Err(DelayError::Constant { role, channel: channel.to_owned(), value });
    }
    Ok(())
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

/// One line of the list of methods.
pub struct Method {
    /// Name, summary and options.
    pub entry: Entry<dyn DelayEstimator>,
    /// What it looks at.
    pub scope: Scope,
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
        exempt: &[],
    },
    Method {
        entry: entry!("threshold_step", "first sample of the estimated step response above its threshold", Step, dyn DelayEstimator),
        scope: Scope::Pair,
        exempt: &[],
    },
    Method {
        entry: entry!(
            "state_least_squares",
            "delay of every input from measured states and known A and B",
            StateLeastSquares,
            dyn DelayEstimator
        ),
        scope: Scope::States,
        exempt: &[
            (Law::Shift, "it compares states with a model: an output that is delayed alone is not what the model says"),
            (Law::Gain, "the model's B fixes the gain"),
            (Law::Sign, "the model's B fixes the sign"),
        ],
    },
];

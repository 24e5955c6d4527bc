//! What the list of methods says of each: its class, what it needs, what it promises, and where it still holds.

use super::estimator::DelayEstimator;
use deadtime_signal::registry::Entry;

/// Methods that see a record alike, and so err alike: each class has one vote in a verdict.
///
/// Source: after Björklund (2003), LiU-TEK-LIC-2003:60, pp. 13-14, whose four classes are split where the methods see different things.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Sampled models of low order, the delay a parameter of theirs.
    Parametric,
    /// Continuous models of low order with a fractional delay.
    Process,
    /// Thresholds on an estimated impulse or step response.
    Threshold,
    /// The lag at which input and output are most alike.
    Correlation,
    /// Phase: of the spectra, or of the all-pass part of a model.
    Frequency,
    /// Laguerre series of the response.
    Laguerre,
    /// Areas and moments of the response.
    Area,
    /// Third-order statistics.
    HigherOrder,
    /// Known A and B, measured states.
    States,
    /// Two sequences of event times.
    Events,
}

impl Class {
    /// Every class, in the order in which answers are shown.
    pub const ALL: &[Self] = &[
        Self::Parametric,
        Self::Process,
        Self::Threshold,
        Self::Correlation,
        Self::Frequency,
        Self::Laguerre,
        Self::Area,
        Self::HigherOrder,
        Self::States,
        Self::Events,
    ];

    /// What the class weighs in a verdict: half of the others where the delay is read off an estimated response instead of being fitted. In the comparison of
    /// Björklund (2003), p. 109, all of those stand behind the best fitted ones.
    #[must_use]
    pub fn vote_weight(self) -> f64 {
        match self {
            Self::Parametric | Self::Process | Self::States | Self::Events => 1.0,
            Self::Threshold
            | Self::Correlation
            | Self::Frequency
            | Self::Laguerre
            | Self::Area
            | Self::HigherOrder => 0.5,
        }
    }

    /// The heading of its answers.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Parametric => "sampled models",
            Self::Process => "continuous process models",
            Self::Threshold => "thresholds on a response",
            Self::Correlation => "correlation",
            Self::Frequency => "phase",
            Self::Laguerre => "Laguerre series",
            Self::Area => "areas and moments",
            Self::HigherOrder => "higher-order statistics",
            Self::States => "measured states",
            Self::Events => "event times",
        }
    }
}

/// What a method looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// One input and one output at a time.
    Pair,
    /// All inputs and the states together; needs a model.
    States,
    /// Two sequences of event times.
    Events,
}

/// The kind of experiment that a method is made for, and on which it is held to its promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReferenceExperiment {
    /// A plant with dynamics of its own, moved by a rich input.
    Plant,
    /// A continuous plant of so many real poles, with a zero or not, behind a hold.
    Process {
        /// Its poles, one to three.
        poles: usize,
        /// It has a zero.
        zero: bool,
    },
    /// An output that is a delayed copy of the input, with noise.
    Copy,
    /// A plant at rest that answers to steps.
    Steps,
    /// A delayed copy of an input whose distribution is skewed.
    Skewed,
    /// Measured states and their A and B.
    States,
    /// Times of the same events at two places.
    Events,
}

/// What a method takes for granted about the start of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Nothing: samples that reach back before the record are left out.
    Any,
    /// That the plant rested: a record that begins at rest is measured from there, not from its mean.
    Rest,
}

/// A complication under which a method's answer may still be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// A plant that is unstable.
    UnstablePlant,
    /// An input that depends on the output.
    Feedback,
    /// Noise that is not white.
    ColouredNoise,
    /// A plant whose own lag is long against a sample (a method without it takes lag for delay).
    Dynamics,
    /// Output samples that were not measured.
    MissingOutputs,
    /// Other inputs that move with this one.
    OtherInputs,
    /// A step response that starts against its end, as a zero in the right half-plane makes it.
    InverseResponse,
    /// A plant that integrates.
    Integrating,
    /// Two sensors of one signal: the output is a copy of the input, and no hold lies between them (a method that assumes one is undecided within a sample).
    TwoSensors,
}

impl Condition {
    /// What it is called in a sentence.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::UnstablePlant => "an unstable plant",
            Self::Feedback => "feedback",
            Self::ColouredNoise => "coloured noise",
            Self::Dynamics => "a lag of the plant's own",
            Self::MissingOutputs => "missing outputs",
            Self::OtherInputs => "inputs that move together",
            Self::InverseResponse => "an inverse response",
            Self::Integrating => "a plant that integrates",
            Self::TwoSensors => "two sensors of one signal",
        }
    }
}

/// What the data can know of the delay, for the standard deviation that is predicted before estimating ([`super::richness::richness`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Information {
    /// Both channels are noisy copies of one signal: the two-sensor bound.
    TwoSensors,
    /// A plant of that many unknown poles and an unknown gain: the joint bound.
    Poles(usize),
    /// A response of free coefficients: what its first ones stand out by.
    Response,
    /// A known plant.
    KnownModel,
    /// The spread of the delays of single events.
    Events,
}

/// What a method reads its answer from: those that read the same intermediate result err together, and have one vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// The losses or the polynomials of an ARX scan.
    Arx,
    /// The losses or the polynomials of an output-error scan.
    OutputError,
    /// A plain finite impulse response.
    FiniteResponse,
    /// The cross-spectrum of the two channels.
    CrossSpectrum,
    /// Something that no other method uses.
    Own,
}

/// A law that an estimator may promise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Delaying y by k samples moves the answer by k samples.
    Shift,
    /// A gain on u or y changes nothing.
    Gain,
    /// Another sign of u or y changes nothing.
    Sign,
    /// Whole-sample delays are found exactly on noise-free rich input.
    Exact,
    /// Noise alone, white or slow, is seldom taken for a response.
    Silence,
    /// A delay beyond the search window is never `found` elsewhere.
    Window,
}

/// One line of the list of methods.
pub struct Method {
    /// Name, summary and options.
    pub entry: Entry<dyn DelayEstimator>,
    /// What it sees a record by.
    pub class: Class,
    /// What it looks at.
    pub scope: Scope,
    /// What it takes for granted about the start.
    pub start: Start,
    /// The experiment that it is made for.
    pub reference: ReferenceExperiment,
    /// What bounds its uncertainty from below.
    pub information: Information,
    /// What it shares with other methods.
    pub basis: Basis,
    /// Samples to which it keeps the laws it promises, and within which its answer lies on its reference experiment (1 % noise).
    pub tolerance: f64,
    /// What the record must show for it to be asked at all.
    pub made_for: Option<Condition>,
    /// Complications that it withstands.
    pub withstands: &'static [Condition],
    /// What it needs, in a few words.
    pub needs: &'static str,
    /// What it cannot see, in a few words.
    pub blind_to: &'static str,
    /// Laws that it does not promise, and why.
    pub exempt: &'static [(Law, &'static str)],
}

/// What prediction-error methods withstand, whatever the loop around the plant.
pub(super) const PREDICTS: &[Condition] = &[
    Condition::UnstablePlant,
    Condition::Feedback,
    Condition::ColouredNoise,
    Condition::Dynamics,
    Condition::MissingOutputs,
];

/// The tolerance of a method that counts samples.
pub(super) const WHOLE: f64 = 1e-6;

impl Method {
    /// A line of a method that sees one pair at a time and promises every law, to be completed by
    /// what else it says of itself.
    pub(super) const fn of(class: Class, entry: Entry<dyn DelayEstimator>) -> Self {
        Self {
            entry,
            class,
            scope: Scope::Pair,
            start: Start::Any,
            reference: ReferenceExperiment::Plant,
            information: Information::Response,
            basis: Basis::Own,
            tolerance: WHOLE,
            made_for: None,
            withstands: &[],
            needs: "",
            blind_to: "",
            exempt: &[],
        }
    }

    /// What the list says of it, as data: name, summary, options, class, needs, what it cannot see, and what it withstands.
    #[must_use]
    pub fn data(&self) -> serde_json::Value {
        let mut data = self.entry.data();
        data["class"] = self.class.title().into();
        data["needs"] = self.needs.into();
        data["cannot_see"] = self.blind_to.into();
        data["withstands"] = self.withstands.iter().map(|c| c.words()).collect();
        data["does_not_promise"] = self
            .exempt
            .iter()
            .map(|(law, why)| serde_json::json!({ "law": law, "why": why }))
            .collect();
        data
    }

    /// It withstands this complication.
    #[must_use]
    pub fn withstands(&self, condition: Condition) -> bool {
        self.withstands.contains(&condition)
    }

    /// It promises this law.
    #[must_use]
    pub fn promises(&self, law: Law) -> bool {
        self.exempt.iter().all(|(exempt, _)| *exempt != law)
    }
}

/// The line of a method as [`Method::of`] has it: `method_line!("name", "summary", OptionStruct, Class)`.
macro_rules! method_line {
    ($name:literal, $summary:literal, $options:ty, $class:ident) => {
        $crate::method::Method::of(
            $crate::method::Class::$class,
            deadtime_signal::registry::entry!(
                $name,
                $summary,
                $options,
                dyn $crate::estimator::DelayEstimator
            ),
        )
    };
}
pub(super) use method_line;

/// The example of a method for plants with dynamics: samples, the plant's pole, and how near the
/// answer comes, s.
macro_rules! plant_example {
    ($options:ident, $samples:literal, $pole:literal, $near:literal) => {
        concat!(
            "
# Example
```
use deadtime_delay::{DelayEstimator, Experiment, Search, ",
            stringify!($options),
            "};
use deadtime_signal::{Excitation, excitation::Rbs};
use deadtime_signal::time::SampleTime;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
let u = Rbs::default().generate(",
            $samples,
            ", &mut ChaCha8Rng::seed_from_u64(1))?;
let mut y = vec![0.0; u.len()];
for t in 5..u.len() {
    y[t] = ",
            $pole,
            " * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
}
let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
let answer = ",
            stringify!($options),
            "::default().estimate(&experiment, &Search::default())?;
assert!((answer.delay_s.unwrap() - 0.4).abs() < ",
            $near,
            ");
# Ok::<(), Box<dyn std::error::Error>>(())
```"
        )
    };
}
pub(super) use plant_example;

/// The example of a method for delayed copies.
macro_rules! copy_example {
    ($options:ident) => {
        concat!(
            "
# Example
```
use deadtime_delay::{DelayEstimator, Experiment, Search, ",
            stringify!($options),
            "};
use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
use deadtime_signal::time::SampleTime;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
let y = fractional_delay(&u, 7.3);
let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
let answer = ",
            stringify!($options),
            "::default().estimate(&experiment, &search)?;
assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
# Ok::<(), Box<dyn std::error::Error>>(())
```"
        )
    };
}
pub(super) use copy_example;

//! The properties of each method in the list: its class, its needs, its laws, and its valid conditions.

use super::estimator::DelayEstimator;
use deadtime_signal::registry::Entry;

/// Methods with the same kind of evaluation have correlated errors: each class has one vote in a verdict.
///
/// Source: after Björklund (2003), LiU-TEK-LIC-2003:60, pp. 13-14, whose four classes are split where the methods evaluate different quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Sampled models of low order with the delay as a parameter.
    Parametric,
    /// Continuous models of low order with a fractional delay.
    Process,
    /// Thresholds on an estimated impulse or step response.
    Threshold,
    /// The lag at which input and output are most similar.
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
    /// Every class, in the order of display.
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

    /// The class's weight in a verdict: half of the others where the delay is read from an estimated response instead of being fitted. In the comparison of
    /// Björklund (2003), p. 109, all of those rank behind the best fitted ones.
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

    /// The heading of its estimates.
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

/// The data that a method uses.
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

/// The reference experiment of a method, on which its laws and tolerance are tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReferenceExperiment {
    /// A plant with dynamics of its own and a rich input.
    Plant,
    /// A continuous plant with this many real poles, with or without a zero, behind a hold.
    Process {
        /// Its poles, one to three.
        poles: usize,
        /// It has a zero.
        zero: bool,
    },
    /// An output that is a delayed copy of the input, with noise.
    Copy,
    /// A plant at rest that responds to steps.
    Steps,
    /// A delayed copy of an input whose distribution is skewed.
    Skewed,
    /// Measured states and their A and B.
    States,
    /// Times of the same events at two places.
    Events,
}

/// A method's assumption on the start of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// None: samples that reach back before the record are left out.
    Any,
    /// The plant rests: a record that begins at rest is measured from there, not from its mean.
    Rest,
}

/// A condition under which a method's estimate may still be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// A plant that is unstable.
    UnstablePlant,
    /// An input that depends on the output.
    Feedback,
    /// Noise that is not white.
    ColouredNoise,
    /// A plant whose own lag is long compared with a sample (a method without dynamics takes lag for delay).
    Dynamics,
    /// Output samples that were not measured.
    MissingOutputs,
    /// Other inputs correlated with this one.
    OtherInputs,
    /// A step response that starts opposite to its final value, as with a zero in the right half-plane.
    InverseResponse,
    /// A plant that integrates.
    Integrating,
    /// Two sensors of one signal: the output is a copy of the input, and no hold lies between them (a method that assumes one is undecided within a sample).
    TwoSensors,
}

impl Condition {
    /// Its name in a sentence.
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

/// The information on the delay in the data, for the standard deviation predicted before estimating ([`super::richness::richness`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Information {
    /// Both channels are noisy copies of one signal: the two-sensor bound.
    TwoSensors,
    /// A plant with this number of unknown poles and an unknown gain: the joint bound.
    Poles(usize),
    /// A response of free coefficients: the significance of its first ones.
    Response,
    /// A known plant.
    KnownModel,
    /// The spread of the delays of single events.
    Events,
}

/// The intermediate result from which a method reads its estimate. Methods with the same basis have correlated errors, and one vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// The losses or the polynomials of an ARX scan.
    Arx,
    /// The losses or the polynomials of an output-error scan.
    OutputError,
    /// A finite impulse response without regularisation.
    FiniteResponse,
    /// The cross-spectrum of the two channels.
    CrossSpectrum,
    /// Something that no other method uses.
    Own,
}

/// A law that an estimator may guarantee.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Delaying y by k samples moves the estimate by k samples.
    Shift,
    /// A gain on u or y has no influence.
    Gain,
    /// Another sign of u or y has no influence.
    Sign,
    /// The estimate of a whole-sample delay is exact on noise-free rich input.
    Exact,
    /// Noise alone, white or slow, seldom passes for a response.
    Silence,
    /// A delay beyond the search window is never `found` elsewhere.
    Window,
}

/// One line of the list of methods.
pub struct Method {
    /// Name, summary and options.
    pub entry: Entry<dyn DelayEstimator>,
    /// Its class of evaluation.
    pub class: Class,
    /// The data that it uses.
    pub scope: Scope,
    /// Its assumption on the start.
    pub start: Start,
    /// Its reference experiment.
    pub reference: ReferenceExperiment,
    /// The lower bound of its uncertainty.
    pub information: Information,
    /// The intermediate result that it shares with other methods.
    pub basis: Basis,
    /// Tolerance of its laws, samples, and of its error on its reference experiment (1 % noise).
    pub tolerance: f64,
    /// The condition of the record that the method requires, if any.
    pub made_for: Option<Condition>,
    /// Conditions that it withstands.
    pub withstands: &'static [Condition],
    /// Its needs, in a few words.
    pub needs: &'static str,
    /// Effects that it cannot detect, in a few words.
    pub blind_to: &'static str,
    /// Laws that it does not guarantee, and why.
    pub exempt: &'static [(Law, &'static str)],
}

/// Conditions that prediction-error methods withstand, for any loop around the plant.
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
    /// The line of a pair method that guarantees every law; its other properties are added afterwards.
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

    /// Its properties as data: name, summary, options, class, needs, blind spots, and conditions that it withstands.
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

    /// It withstands this condition.
    #[must_use]
    pub fn withstands(&self, condition: Condition) -> bool {
        self.withstands.contains(&condition)
    }

    /// It guarantees this law.
    #[must_use]
    pub fn promises(&self, law: Law) -> bool {
        self.exempt.iter().all(|(exempt, _)| *exempt != law)
    }
}

/// The line of a method as in [`Method::of`]: `method_line!("name", "summary", OptionStruct, Class)`.
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

/// The example of a method for plants with dynamics: samples, the plant's pole, and the tolerance of the estimate, s.
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

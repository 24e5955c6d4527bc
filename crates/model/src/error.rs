//! Models that cannot be built, read, converted or simulated.

use deadtime_log::LogError;
use deadtime_signal::file::FileError;
use deadtime_signal::time::TimeError;
use deadtime_signal::{SignalError, flatten, remedied};

use super::derived::DerivedError;
use crate::effect::error::EffectError;
use crate::equations::error::EquationError;
use crate::simulate::error::SimulateError;

/// The kind of a file whose extension is neither `.toml` nor `.json`, and its use. Renaming does not convert a file of another program.
fn foreign(path: &std::path::Path) -> &'static str {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("slx" | "mdl" | "xml" | "mjcf" | "urdf" | "sdf" | "usd" | "fmu" | "mo" | "m") => {
            "a model of another simulator, which is not read; let that simulator be called (`deadtime gap --simulator`, or a function of Python), or write its equations or its linearisation to a model file (`deadtime model new`)"
        }
        Some("csv" | "mat" | "ulg" | "bag" | "db3" | "mcap" | "parquet" | "h5" | "hdf5") => {
            "a log in the place of a model; `deadtime model new` and `deadtime identify` write model files, .toml or .json"
        }
        Some("py" | "exe" | "sh") => {
            "a program in the place of a model; give it as `--simulator`, or its function to `deadtime.gap` in Python"
        }
        _ => "a model file ends in .toml or .json; `deadtime model new` writes one",
    }
}

/// Any error of building, reading, converting or simulating a model.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A model that cannot be built, read or converted.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A channel that cannot be computed from others.
    #[error(transparent)]
    Derived(#[from] DerivedError),
    /// A simulation that cannot be run.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// An effect that cannot be applied.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A signal that cannot be made.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// A log that cannot be read or used.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A file error of the operating system.
    #[error(transparent)]
    File(#[from] FileError),
    /// An invalid sample time or delay.
    #[error(transparent)]
    Time(#[from] TimeError),
}

remedied!(Error { Log });
flatten!(deadtime_log::Error => Error { Log, File, Time });

/// The result of work on models.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A model that cannot be built, read or converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A matrix whose shape contradicts the others.
    #[error(
        "matrix {matrix} is {got_rows} by {got_columns}, but the other matrices and names ask for {rows} by {columns}"
    )]
    Shape {
        /// The matrix.
        matrix: &'static str,
        /// Rows required.
        rows: usize,
        /// Columns required.
        columns: usize,
        /// Rows present.
        got_rows: usize,
        /// Columns present.
        got_columns: usize,
    },
    /// A matrix contains NaN or infinity.
    #[error(
        "matrix {matrix} holds {value} at row {row}, column {column}; every entry must be finite"
    )]
    NotFinite {
        /// The matrix.
        matrix: &'static str,
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// A list has the wrong length.
    #[error("{what}: {got} given, {needed} needed")]
    Count {
        /// The contents of the list.
        what: &'static str,
        /// The length required.
        needed: usize,
        /// The length present.
        got: usize,
    },
    /// An input or output index that the model does not have.
    #[error("there is no {what} {index}; the model has {count} (counted from 0)")]
    Index {
        /// Input, output or state.
        what: &'static str,
        /// The requested index.
        index: usize,
        /// The number available.
        count: usize,
    },
    /// A conversion for one input and one output, applied to more.
    #[error(
        "{method} is defined for one input and one output; this model has {inputs} and {outputs}: select a pair first"
    )]
    NotSingle {
        /// The conversion.
        method: &'static str,
        /// Inputs of the model.
        inputs: usize,
        /// Outputs of the model.
        outputs: usize,
    },
    /// An impulse-invariant model of a delayed direct path: the impulse falls between two samples.
    #[error(
        "impulse invariance with feedthrough kept: input {input} is delayed by {samples} samples, so the impulse of D falls between two samples; \
         use feedthrough = drop, a whole delay or another conversion"
    )]
    ImpulseBetweenSamples {
        /// The input, counted from 0.
        input: usize,
        /// Its delay in samples.
        samples: f64,
    },
    /// The prewarp frequency must lie inside the band.
    #[error(
        "prewarp frequency {rad_s} rad/s must be above 0 and below the Nyquist frequency, {nyquist_rad_s} rad/s"
    )]
    Prewarp {
        /// The frequency given, rad/s.
        rad_s: f64,
        /// The Nyquist frequency, rad/s.
        nyquist_rad_s: f64,
    },
    /// A share of the later sample outside 0 to 1.
    #[error("alpha is {alpha}; it must be 0 (forward difference) to 1 (backward difference)")]
    Alpha {
        /// The share given.
        alpha: f64,
    },
    /// Tustin's map, or another difference map, sends this pole to infinity.
    #[error(
        "the model has a pole at s = {s}, which the conversion's map with this sample time sends to infinity; choose another sample time"
    )]
    TustinPole {
        /// The pole (2/Ts, or 1/(αTs)).
        s: f64,
    },
    /// The sampled model has no continuous counterpart under a zero-order hold.
    #[error(
        "the sampled model has a pole at z = {re}: no real continuous model under a zero-order hold has it; poles must not be zero or real and negative"
    )]
    NoLogarithm {
        /// Real part of the pole.
        re: f64,
    },
    /// The iteration behind a conversion did not converge.
    #[error(
        "{method}: the fit did not converge in {iterations} iterations (last relative change {change:e})"
    )]
    NotConverged {
        /// The conversion.
        method: &'static str,
        /// Iterations made.
        iterations: usize,
        /// Last relative change of the cost.
        change: f64,
    },
    /// The transfer function is identically zero.
    #[error(
        "the transfer function from input {input} to output {output} is zero: nothing to convert"
    )]
    ZeroTransfer {
        /// The input, counted from 0.
        input: usize,
        /// The output, counted from 0.
        output: usize,
    },
    /// A transfer function with more zeros than poles.
    #[error("{zeros} zeros and {poles} poles: a model needs at least as many poles as zeros")]
    Improper {
        /// Number of zeros.
        zeros: usize,
        /// Number of poles.
        poles: usize,
    },
    /// An equation that two poles make singular.
    #[error("the equation has no unique solution: A has poles {first} and {second}, and {rule}")]
    Singular {
        /// A pole.
        first: String,
        /// Another, or the same.
        second: String,
        /// The relation between the two.
        rule: &'static str,
    },
    /// A polynomial whose computed roots do not reproduce it.
    #[error(
        "the roots of the {what} do not reproduce it (relative error {error:e} at a frequency): its coefficients are too close to those of repeated roots; \
         give zeros, poles and gain (kind `zpk`) in their place"
    )]
    Unfactored {
        /// Numerator or denominator.
        what: &'static str,
        /// The largest relative error of the product of the factors.
        error: f64,
    },
    /// A zero or pole without its complex conjugate.
    #[error("{what} {re}{im:+}i stands without its complex conjugate: a real model has both")]
    Unpaired {
        /// Zero or pole.
        what: &'static str,
        /// Real part.
        re: f64,
        /// Imaginary part.
        im: f64,
    },
    /// The weight of the inputs is not positive definite.
    #[error(
        "R must be symmetric and positive definite (its smallest eigenvalue is {smallest:e}): every input needs a cost"
    )]
    WeightR {
        /// Smallest eigenvalue of the symmetric part.
        smallest: f64,
    },
    /// A connection would leave a continuous delay inside the model.
    #[error(
        "a delay of {delay_s} s {what} has no states in continuous time: convert both systems with c2d first, or approximate it by pade"
    )]
    DelayInside {
        /// The position.
        what: &'static str,
        /// The delay, s.
        delay_s: f64,
    },
    /// The direct paths of a loop make its equation singular.
    #[error(
        "the loop has no solution: its direct paths make I − D₁D₂ singular; leave one of them out"
    )]
    AlgebraicLoop,
    /// A weight is not symmetric.
    #[error(
        "{matrix} is not symmetric: entries ({row}, {column}) and ({column}, {row}) differ by {difference:e}"
    )]
    NotSymmetric {
        /// The weight.
        matrix: &'static str,
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
        /// The difference.
        difference: f64,
    },
    /// An unstable mode that is not controllable.
    #[error(
        "no stabilising solution: the mode at z = {re}{im:+}i (|z| = {magnitude}) is not stabilisable, no input reaches it"
    )]
    NotStabilisable {
        /// Real part.
        re: f64,
        /// Imaginary part.
        im: f64,
        /// Magnitude.
        magnitude: f64,
    },
    /// A mode on the unit circle without a cost.
    #[error(
        "no stabilising solution: the mode at z = {re}{im:+}i lies on the unit circle and the state weight does not see it; give it a cost in Q"
    )]
    UnseenOnCircle {
        /// Real part.
        re: f64,
        /// Imaginary part.
        im: f64,
    },
    /// The Riccati equation has no stabilising solution for another reason.
    #[error(
        "no stabilising solution was found: [Q N; N' R] is not positive semidefinite (smallest eigenvalue {smallest:e}), so the cost may have no minimum"
    )]
    Indefinite {
        /// Smallest eigenvalue of the joint weight.
        smallest: f64,
    },
    /// The iteration for the Riccati equation ended above its tolerance.
    #[error(
        "the Riccati equation is too ill conditioned: residual {residual:e} relative to its solution; scale states, inputs or weights"
    )]
    IllConditioned {
        /// Relative residual.
        residual: f64,
    },
    /// A model file that cannot be parsed.
    #[error("{path}: {detail}", path = path.display())]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// The parser's message, with line and column where known.
        detail: String,
    },
    /// A model file of an unsupported format or kind.
    #[error("{path}: {key} is `{found}`; this version reads {known}", path = path.display())]
    Kind {
        /// The file.
        path: std::path::PathBuf,
        /// The key.
        key: &'static str,
        /// Its value.
        found: String,
        /// The supported values.
        known: &'static str,
    },
    /// A nonlinear model where a linear one is needed.
    #[error("{path}: this needs a linear model (kind `lti`); the file's kind is `{kind}`", path = path.display())]
    NotLinear {
        /// The file.
        path: std::path::PathBuf,
        /// Its kind.
        kind: String,
    },
    /// Equations that cannot be compiled.
    #[error("{path}: {source}", path = path.display())]
    Equations {
        /// The file.
        path: std::path::PathBuf,
        /// The error, and its position in the equation.
        source: Box<EquationError>,
    },
    /// A state without a derivative, an output without an equation, or the reverse.
    #[error("{path}: {what} `{name}` {lacks}", path = path.display())]
    Unmatched {
        /// The file.
        path: std::path::PathBuf,
        /// The kind of the named item.
        what: &'static str,
        /// The name.
        name: String,
        /// The missing part, and the remedy.
        lacks: &'static str,
    },
    /// A suspected term that cannot be searched.
    #[error("the candidate `{candidate}`: {why}")]
    Candidate {
        /// Its name, or its text.
        candidate: String,
        /// The fault, and the remedy.
        why: String,
    },
    /// An invalid nuisance.
    #[error("{path}: the nuisance `{nuisance}`: {why}", path = path.display())]
    Nuisance {
        /// The file.
        path: std::path::PathBuf,
        /// The entry, as `effect:channel`.
        nuisance: String,
        /// The fault, and the remedy.
        why: String,
    },
    /// A file name whose extension is neither TOML nor JSON.
    #[error("{path}: {remedy}", path = path.display(), remedy = foreign(path))]
    Extension {
        /// The file.
        path: std::path::PathBuf,
    },
    /// Two channels or states with one name.
    #[error("{path}: the {what} `{name}` is named twice", path = path.display())]
    Duplicate {
        /// The file.
        path: std::path::PathBuf,
        /// Input, state or output.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A value that must be finite or not negative is neither.
    #[error("{path}: {key} holds {value}; {rule}", path = path.display())]
    Number {
        /// The file.
        path: std::path::PathBuf,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// The rule.
        rule: &'static str,
    },
    /// A continuous model where a sampled one is needed, or the reverse.
    #[error("{what} needs a {needed} model; `{name}` is {found}")]
    Domain {
        /// The operation.
        what: &'static str,
        /// Continuous or sampled.
        needed: &'static str,
        /// The model's name.
        name: String,
        /// Its actual domain.
        found: &'static str,
    },
    /// A model with effects where one without effects is needed.
    #[error(
        "c2d converts the bare model; take the [[effects]] of `{name}` out (a delay of an input can stand in input_delay_s)"
    )]
    Effects {
        /// The model's name.
        name: String,
    },
    /// Two models that cannot be compared.
    #[error(
        "the two models have different {what}: {first} and {second}; compare models of the same channels, in the same time and behind the same delays"
    )]
    Unlike {
        /// The difference.
        what: &'static str,
        /// The first model's value.
        first: f64,
        /// The second model's value.
        second: f64,
    },
    /// An invalid sample time or delay.
    #[error(transparent)]
    Time(#[from] deadtime_signal::time::TimeError),
}

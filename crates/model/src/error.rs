//! Models that cannot be built, read, converted or simulated.

use deadtime_log::LogError;
use deadtime_signal::file::FileError;
use deadtime_signal::time::TimeError;
use deadtime_signal::{SignalError, flatten, remedied};

use super::derived::DerivedError;
use crate::effect::error::EffectError;
use crate::equations::error::EquationError;
use crate::simulate::error::SimulateError;

/// What a file is whose extension is neither `.toml` nor `.json`, and how it can be used. A file of another program stays what it is under another name.
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

/// Whatever keeps a model from being built, read, converted or simulated.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A model that cannot be built, read or converted.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A channel that cannot be calculated from others.
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
    /// A file that the operating system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// A sample time or delay that cannot be.
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
    /// A matrix does not have the shape that the others ask for.
    #[error(
        "matrix {matrix} is {got_rows} by {got_columns}, but the other matrices and names ask for {rows} by {columns}"
    )]
    Shape {
        /// Which matrix.
        matrix: &'static str,
        /// Rows it should have.
        rows: usize,
        /// Columns it should have.
        columns: usize,
        /// Rows it has.
        got_rows: usize,
        /// Columns it has.
        got_columns: usize,
    },
    /// A matrix holds NaN or infinity.
    #[error(
        "matrix {matrix} holds {value} at row {row}, column {column}; every entry must be finite"
    )]
    NotFinite {
        /// Which matrix.
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
        /// What the list holds.
        what: &'static str,
        /// How many there should be.
        needed: usize,
        /// How many there are.
        got: usize,
    },
    /// An input or output number that the model does not have.
    #[error("there is no {what} {index}; the model has {count} (counted from 0)")]
    Index {
        /// Input, output or state.
        what: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A conversion for one input and one output got more.
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
    /// A share of the later sample that is none.
    #[error("alpha is {alpha}; it must be 0 (forward difference) to 1 (backward difference)")]
    Alpha {
        /// The share given.
        alpha: f64,
    },
    /// Tustin's map, or another of differences, sends this pole to infinity.
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
    /// The iteration behind a conversion did not settle.
    #[error(
        "{method}: the fit did not converge in {iterations} iterations (last relative change {change:e})"
    )]
    NotConverged {
        /// Which conversion.
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
        /// What the two have in common.
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
    /// A connection would leave a continuous delay inside.
    #[error(
        "a delay of {delay_s} s {what} has no states in continuous time: convert both systems with c2d first, or approximate it by pade"
    )]
    DelayInside {
        /// Where.
        what: &'static str,
        /// The delay, s.
        delay_s: f64,
    },
    /// The direct paths of a loop leave no solution.
    #[error(
        "the loop has no solution: its direct paths make I − D₁D₂ singular; leave one of them out"
    )]
    AlgebraicLoop,
    /// A weight is not symmetric.
    #[error(
        "{matrix} is not symmetric: entries ({row}, {column}) and ({column}, {row}) differ by {difference:e}"
    )]
    NotSymmetric {
        /// Which weight.
        matrix: &'static str,
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
        /// By how much.
        difference: f64,
    },
    /// An unstable mode that no input moves.
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
    /// A mode on the unit circle that costs nothing.
    #[error(
        "no stabilising solution: the mode at z = {re}{im:+}i lies on the unit circle and the state weight does not see it; give it a cost in Q"
    )]
    UnseenOnCircle {
        /// Real part.
        re: f64,
        /// Imaginary part.
        im: f64,
    },
    /// The Riccati equation has no stabilising solution for a reason other than those above.
    #[error(
        "no stabilising solution was found: [Q N; N' R] is not positive semidefinite (smallest eigenvalue {smallest:e}), so the cost may have no minimum"
    )]
    Indefinite {
        /// Smallest eigenvalue of the joint weight.
        smallest: f64,
    },
    /// The iteration for the Riccati equation stopped short of its accuracy.
    #[error(
        "the Riccati equation is too ill conditioned: residual {residual:e} relative to its solution; scale states, inputs or weights"
    )]
    IllConditioned {
        /// Relative residual.
        residual: f64,
    },
    /// A model file that cannot be understood.
    #[error("{path}: {detail}", path = path.display())]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// What the parser said, with line and column where it knows them.
        detail: String,
    },
    /// A model file of a format or kind that this version does not read.
    #[error("{path}: {key} is `{found}`; this version reads {known}", path = path.display())]
    Kind {
        /// The file.
        path: std::path::PathBuf,
        /// Which key.
        key: &'static str,
        /// What it says.
        found: String,
        /// What is understood.
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
        /// What is wrong, and where in the equation.
        source: Box<EquationError>,
    },
    /// A state without a derivative, an output without an equation, or the reverse.
    #[error("{path}: {what} `{name}` {lacks}", path = path.display())]
    Unmatched {
        /// The file.
        path: std::path::PathBuf,
        /// What has the name.
        what: &'static str,
        /// The name.
        name: String,
        /// What is missing, and the remedy.
        lacks: &'static str,
    },
    /// A suspected term that cannot be searched for.
    #[error("the candidate `{candidate}`: {why}")]
    Candidate {
        /// What it is called, or its text.
        candidate: String,
        /// What is wrong, and the remedy.
        why: String,
    },
    /// A nuisance that is none.
    #[error("{path}: the nuisance `{nuisance}`: {why}", path = path.display())]
    Nuisance {
        /// The file.
        path: std::path::PathBuf,
        /// The entry, as `effect:channel`.
        nuisance: String,
        /// What is wrong, and the remedy.
        why: String,
    },
    /// A file name whose extension says neither TOML nor JSON.
    #[error("{path}: {remedy}", path = path.display(), remedy = foreign(path))]
    Extension {
        /// The file.
        path: std::path::PathBuf,
    },
    /// Two channels or states of one name.
    #[error("{path}: the {what} `{name}` is named twice", path = path.display())]
    Duplicate {
        /// The file.
        path: std::path::PathBuf,
        /// Input, state or output.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A number that must be finite or not negative is neither.
    #[error("{path}: {key} holds {value}; {rule}", path = path.display())]
    Number {
        /// The file.
        path: std::path::PathBuf,
        /// Which key.
        key: &'static str,
        /// The number.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// A continuous model where a sampled one is needed, or the reverse.
    #[error("{what} needs a {needed} model; `{name}` is {found}")]
    Domain {
        /// What was to be done.
        what: &'static str,
        /// Continuous or sampled.
        needed: &'static str,
        /// The model's name.
        name: String,
        /// What it is.
        found: &'static str,
    },
    /// A model with effects where a bare one is needed.
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
        /// What differs.
        what: &'static str,
        /// That of the first.
        first: f64,
        /// That of the second.
        second: f64,
    },
    /// A sample time or delay that cannot be.
    #[error(transparent)]
    Time(#[from] deadtime_signal::time::TimeError),
}

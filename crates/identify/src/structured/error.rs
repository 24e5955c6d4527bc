//! Errors of a structured fit.

/// The model, its logs and the options are incompatible.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StructuredError {
    /// A name that is no parameter of the model and no dead time.
    #[error("the model has no parameter `{name}`; it has {}", known.join(", "))]
    NoParameter {
        /// The name.
        name: String,
        /// The model's parameters and dead times.
        known: Vec<String>,
    },
    /// No parameter is free.
    #[error("no parameter is free: name some, or `all`")]
    NothingFree,
    /// The model has parts without a window simulation.
    #[error("the model {model} has {what}, which a fit over windows does not simulate: {remedy}")]
    Unsupported {
        /// The model's name.
        model: String,
        /// The unsupported part.
        what: &'static str,
        /// The remedy.
        remedy: &'static str,
    },
    /// An invalid horizon or stride.
    #[error(
        "a horizon of {horizon} steps with windows {stride} steps apart: both must be at least 1"
    )]
    Horizon {
        /// Steps of a window.
        horizon: usize,
        /// Steps from one window's start to the next.
        stride: usize,
    },
    /// No record is long enough for a window that starts at a complete row.
    #[error(
        "{file}: no window of {horizon} steps that starts at a row with every logged state and input; the log has {rows} rows: use a shorter horizon"
    )]
    NoWindow {
        /// The log.
        file: String,
        /// Steps of a window.
        horizon: usize,
        /// Rows of the log.
        rows: usize,
    },
    /// Logs of different sample times.
    #[error(
        "{file} has a sample time of {found_s} s, the first log {first_s} s: resample them alike"
    )]
    SampleTime {
        /// The log.
        file: String,
        /// Its sample time, s.
        found_s: f64,
        /// That of the first log, s.
        first_s: f64,
    },
    /// The model cannot be simulated over a window even at its nominal parameters.
    #[error(
        "{file}: the nominal model leaves the finite numbers in the window that starts at {time_s} s; check units and the start"
    )]
    Diverges {
        /// The log.
        file: String,
        /// The window's start, s.
        time_s: f64,
    },
}

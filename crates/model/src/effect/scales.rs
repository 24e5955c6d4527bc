//! The sizes of the data that first guesses of parameters are made of.

/// What a search over parameters may know of the data: the sizes that its first guesses are made
/// of.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scales {
    /// Mean sample time, seconds.
    pub sample_time_s: f64,
    /// Length of the longest log, seconds.
    pub duration_s: f64,
    /// The time in which the fastest output of the nominal simulation moves by its standard
    /// deviation, seconds; 0 where none moves.
    pub timescale_s: f64,
    /// The longest delay and lag that are looked for, seconds.
    pub longest_delay_s: f64,
    /// Every input's |u| at quantiles 0.1, 0.25, 0.5, 0.75, 0.9, 1; then its rms, smallest and
    /// largest value, largest change per second.
    pub inputs: Vec<Spread>,
    /// The same for the nominal simulation's states.
    pub states: Vec<Spread>,
    /// The same for quantities inside the model, by name.
    pub inner: Vec<(String, Spread)>,
    /// Rms of every state's derivative in the nominal simulation.
    pub derivatives: Vec<f64>,
    /// The same for the measured outputs.
    pub outputs: Vec<Spread>,
    /// Frequencies at which the residual is strong, Hz.
    pub peaks_hz: Vec<f64>,
    /// First guesses of what changes with time, as a scan of the logs suggests them; empty where
    /// nothing does.
    pub scanned: Vec<Scanned>,
}

/// First guesses that come of a scan of the logs, not of sizes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scanned {
    /// The effect.
    pub effect: &'static str,
    /// Where it acts.
    pub channel: String,
    /// Full sets of its parameters.
    pub starts: Vec<Vec<f64>>,
}

/// How far a signal goes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Spread {
    /// |v| at quantiles 0.1, 0.25, 0.5, 0.75, 0.9 and 1.
    pub quantiles: [f64; 6],
    /// Root of the mean square.
    pub rms: f64,
    /// Standard deviation.
    pub std: f64,
    /// Smallest value.
    pub smallest: f64,
    /// Largest value.
    pub largest: f64,
    /// Largest change from sample to sample, per second.
    pub fastest: f64,
    /// The step of the lattice on which all values lie, if they lie on one that is coarse.
    pub lattice: Option<f64>,
}

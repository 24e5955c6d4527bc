//! The sizes of the data behind initial parameter values.

/// Properties of the data that a search over parameters uses: the sizes behind its initial values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scales {
    /// Mean sample time, s.
    pub sample_time_s: f64,
    /// Length of the longest log, s.
    pub duration_s: f64,
    /// The time in which the fastest output of the nominal simulation moves by its standard deviation, s; 0 where none moves.
    pub timescale_s: f64,
    /// The longest delay and lag of the search, s.
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
    /// Initial values for time-varying effects from a scan of the logs; empty without any change.
    pub scanned: Vec<Scanned>,
}

/// Initial values from a scan of the logs instead of sizes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scanned {
    /// The effect.
    pub effect: &'static str,
    /// Its channel.
    pub channel: String,
    /// Full sets of its parameters.
    pub starts: Vec<Vec<f64>>,
}

/// The spread of a signal.
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
    /// The step of the lattice on which all values lie, if there is a coarse one.
    pub lattice: Option<f64>,
}

//! The options of a tracker.

/// The options of the tracker of a running machine; all in samples.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOptions {
    /// Longest raw delay; default 35.
    pub max_delay: usize,
    /// Samples after which the plant responds without any dead time; default 1.
    pub bias: usize,
    /// Past outputs of the model; default 6.
    pub na: usize,
    /// Input coefficients of the model; default 4.
    pub nb: usize,
    /// Samples from which the response is identified before anything is reported; default 600. A resting input prolongs it.
    pub learn: usize,
    /// Samples after which a row's weight falls to 1/e, so that the tracker follows slow plant changes; default 4000.
    pub forget: usize,
    /// The gain in log-likelihood from which a change of the delay is reported; default 20. A lower value reports sooner and has more false alarms.
    pub alarm: f64,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self { max_delay: 35, bias: 1, na: 6, nb: 4, learn: 600, forget: 4000, alarm: 20.0 }
    }
}

//! How a tracker watches.

/// How a running machine is watched; all in samples.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOptions {
    /// Longest raw delay; default 35.
    pub max_delay: usize,
    /// Samples that the plant needs to respond without any dead time; default 1.
    pub bias: usize,
    /// Past outputs of the model; default 6.
    pub na: usize,
    /// Input coefficients of the model; default 4.
    pub nb: usize,
    /// Samples from which the response is identified before anything is reported; default 600. It takes longer where the input does not move.
    pub learn: usize,
    /// Samples after which a row's weight falls to 1/e: a plant that changes slowly is followed; default 4000.
    pub forget: usize,
    /// What a change of the delay must gain before it is reported, in units of the logarithm of the likelihood; default 20. A lower value reports sooner and is wrong more often.
    pub alarm: f64,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self { max_delay: 35, bias: 1, na: 6, nb: 4, learn: 600, forget: 4000, alarm: 20.0 }
    }
}

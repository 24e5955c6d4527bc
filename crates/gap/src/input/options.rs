//! How to diagnose.

use super::criteria::Criteria;
use crate::format::diagnosis::Mode;
use deadtime_signal::stop::Stop;

/// How to diagnose.
#[derive(Debug, Clone, PartialEq)]
pub struct GapOptions {
    /// The prediction mode; `None`: chosen from the model's poles.
    pub prediction: Option<Mode>,
    /// Samples over which [`Mode::Horizon`] predicts; `None`: predictions are of another mode. With it `prediction` is left open, or is that mode.
    pub horizon: Option<usize>,
    /// The longest delay and lag of the search, seconds. `None`: 35 samples or half the settling time of the model, at most a tenth of the shortest log. This
    /// duration at the start of every log carries no weight.
    pub longest_delay_s: Option<f64>,
    /// The number of used rows, of all logs together. From longer logs the first part is used, a share of each log, and a caveat reports it. Default 100 000.
    pub rows: usize,
    /// Seed of the bootstrap. Default 1.
    pub seed: u64,
    /// The terms that describe what remains are tried as candidates, in a second diagnosis. Default false.
    pub suggest: bool,
    /// Effects of the catalogue that are tried, by name; empty: all.
    pub effects: Vec<String>,
    /// The longest time that a diagnosis of a linear model may take, s: one whose estimate is above it is refused. Default: infinite.
    pub longest_run_s: f64,
    /// The thresholds on which the verdict rests.
    pub criteria: Criteria,
    /// A stop request, checked before every prediction.
    pub stop: Stop,
}

impl Default for GapOptions {
    fn default() -> Self {
        Self {
            prediction: None,
            horizon: None,
            longest_delay_s: None,
            rows: 100_000,
            seed: 1,
            suggest: false,
            effects: Vec::new(),
            longest_run_s: f64::INFINITY,
            criteria: Criteria::default(),
            stop: Stop::default(),
        }
    }
}

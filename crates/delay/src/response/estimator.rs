//! An estimator from a frequency response.

use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::method::Class;
use deadtime_log::FrequencyResponse;
use deadtime_signal::registry::Entry;
use deadtime_signal::stop::Stop;

/// The search window.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseSearch {
    /// Longest delay, s.
    pub max_delay_s: f64,
    /// Cancellation, checked inside long scans.
    pub stop: Stop,
}

/// An estimator; the implementor is its option struct.
pub trait ResponseEstimator: Send + Sync {
    /// The delay of a response.
    ///
    /// # Errors
    /// [`DelayError`] for unusable data. Data without a visible delay are an [`Outcome`](crate::estimate::Outcome).
    fn estimate(
        &self,
        response: &FrequencyResponse,
        search: &ResponseSearch,
    ) -> std::result::Result<DelayEstimate, DelayError>;
}

/// One line of the list.
pub struct ResponseMethod {
    /// Name, summary and options.
    pub entry: Entry<dyn ResponseEstimator>,
    /// Its class of evaluation.
    pub class: Class,
    /// Its needs, in a few words.
    pub needs: &'static str,
    /// Effects that it cannot detect, in a few words.
    pub blind_to: &'static str,
}

/// The first and the last angular frequency, rad/s.
pub(super) fn ends(response: &FrequencyResponse) -> (f64, f64) {
    let omega = response.omega_rad_s();
    (omega.first().copied().unwrap_or(1.0), omega.last().copied().unwrap_or(1.0))
}

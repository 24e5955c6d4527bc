//! Times of events at two places.

use crate::error::DelayError;

/// Times of the same events at two places. Either place may miss some, or add spurious ones.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Events {
    /// Times at the first place, increasing.
    pub first: Vec<f64>,
    /// Times at the second place, increasing, on the same clock.
    pub second: Vec<f64>,
    /// Units of the two sequences where known; seconds where not.
    pub units: [Option<String>; 2],
    /// Delays of the events that the record itself pairs, one for each event of the first place, s; `None` where nothing pairs them.
    pub in_rows: Option<Vec<f64>>,
}

impl Events {
    /// The largest possible number of pairs.
    pub(super) fn possible(&self) -> usize {
        self.first.len().min(self.second.len())
    }
}

/// Refuses times that are not finite or do not increase.
pub(crate) fn check_times(events: &[Events], [first, second]: [&str; 2]) -> Result<(), DelayError> {
    for events in events {
        for (role, name, times) in
            [("input", first, &events.first), ("output", second, &events.second)]
        {
            let channel = || name.to_owned();
            if let Some(sample) = times.iter().position(|t| !t.is_finite()) {
                return Err(DelayError::NotFinite {
                    role,
                    channel: channel(),
                    sample,
                    value: times[sample],
                });
            }
            if let Some(&value) = times.first()
                && times.len() > 1
                && times.iter().all(|t| *t == value)
            {
                return Err(DelayError::Constant { role, channel: channel(), value });
            }
            if let Some(event) = times.windows(2).position(|w| w[1] <= w[0]) {
                return Err(DelayError::EventOrder {
                    channel: channel(),
                    event: event + 1,
                    before: times[event],
                    time: times[event + 1],
                });
            }
        }
    }
    Ok(())
}

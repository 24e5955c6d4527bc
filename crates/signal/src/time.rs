//! Sample times, and the only place that converts between seconds and samples.

/// A sample time or delay that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimeError {
    /// A sample time is finite and not below [`LEAST_S`].
    #[error(
        "sample time {seconds} s: give a finite number of seconds above 0, {LEAST_S} or more (is time in another unit?)"
    )]
    SampleTime {
        /// The given value, in seconds.
        seconds: f64,
    },
    /// A delay is finite and not negative.
    #[error("delay {seconds} s: give a finite number of seconds, 0 or more")]
    Delay {
        /// The given value, in seconds.
        seconds: f64,
    },
    /// Two systems or signals of different sample times met.
    #[error("sample times differ: {left_s} s and {right_s} s; resample one of them")]
    Mismatch {
        /// The first sample time, in seconds.
        left_s: f64,
        /// The second sample time, in seconds.
        right_s: f64,
    },
}

/// A sample time: finite and above zero, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, serde::Serialize)]
pub struct SampleTime(f64);

/// A delay in samples, split at the sample: `whole + fraction`, `0 <= fraction < 1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Samples {
    /// Whole samples.
    pub whole: usize,
    /// The rest, in samples, at least 0 and below 1.
    pub fraction: f64,
}

/// The shortest sample time, s: no recorder is faster, and a model's response to one sample is lost in rounding long before.
pub const LEAST_S: f64 = 1e-12;

/// A delay this close to a whole number of samples (in samples) is one. Seconds such as 0.3 are no exact multiples of 0.1 in binary.
const WHOLE: f64 = 1e-9;

impl SampleTime {
    /// Checks and wraps a number of seconds.
    ///
    /// # Errors
    /// [`TimeError::SampleTime`] unless finite and [`LEAST_S`] or more.
    pub fn new(seconds: f64) -> Result<Self, TimeError> {
        if seconds.is_finite() && seconds >= LEAST_S {
            Ok(Self(seconds))
        } else {
            Err(TimeError::SampleTime { seconds })
        }
    }

    /// The sample time in seconds.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0
    }

    /// The Nyquist frequency π/Ts, in rad/s.
    #[must_use]
    pub fn nyquist_rad_s(self) -> f64 {
        std::f64::consts::PI / self.0
    }

    /// A delay in seconds as samples.
    ///
    /// # Errors
    /// [`TimeError::Delay`] unless finite and not negative.
    pub fn samples(self, delay_s: f64) -> Result<Samples, TimeError> {
        let samples = delay_s / self.0;
        if !(delay_s.is_finite() && delay_s >= 0.0 && samples < 1e15) {
            return Err(TimeError::Delay { seconds: delay_s });
        }
        Ok(Samples::split(samples, WHOLE))
    }

    /// A delay in seconds as samples, without more correction than the rounding of the division. It is for responses that are continuous in the delay.
    ///
    /// # Errors
    /// As [`Self::samples`].
    pub fn exact_samples(self, delay_s: f64) -> Result<Samples, TimeError> {
        self.samples(delay_s)?;
        let samples = delay_s / self.0;
        Ok(Samples::split(samples, 4.0 * f64::EPSILON * samples))
    }

    /// Samples as seconds.
    #[must_use]
    pub fn to_seconds(self, samples: f64) -> f64 {
        samples * self.0
    }

    /// The two are the same to rounding.
    ///
    /// # Errors
    /// [`TimeError::Mismatch`] when they differ by more than a part in 10⁹.
    pub fn must_equal(self, other: Self) -> Result<(), TimeError> {
        if (self.0 - other.0).abs() <= 1e-9 * self.0 {
            Ok(())
        } else {
            Err(TimeError::Mismatch { left_s: self.0, right_s: other.0 })
        }
    }
}

impl Samples {
    /// A number of samples below 10¹⁵; a number this near a whole number is whole.
    fn split(samples: f64, near: f64) -> Self {
        let nearest = samples.round();
        if (samples - nearest).abs() < near {
            Self { whole: nearest as usize, fraction: 0.0 }
        } else {
            Self { whole: samples.floor() as usize, fraction: samples - samples.floor() }
        }
    }

    /// The delay as one number of samples.
    #[must_use]
    pub fn total(self) -> f64 {
        self.whole as f64 + self.fraction
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn samples_snap_to_whole_when_only_rounding_separates_them() {
        let ts = SampleTime::new(0.1).unwrap();
        assert_eq!(ts.samples(0.3).unwrap(), Samples { whole: 3, fraction: 0.0 });
        let odd = ts.samples(0.25).unwrap();
        assert_eq!(odd.whole, 2);
        assert_abs_diff_eq!(odd.fraction, 0.5, epsilon = 1e-12);
        assert_abs_diff_eq!(odd.total(), 2.5, epsilon = 1e-12);
    }

    #[test]
    fn exact_samples_snap_by_rounding_alone() {
        let ts = SampleTime::new(0.1).unwrap();
        assert_eq!(ts.exact_samples(0.3).unwrap(), Samples { whole: 3, fraction: 0.0 });
        assert_eq!(ts.exact_samples(0.0).unwrap(), Samples { whole: 0, fraction: 0.0 });
        let late = ts.exact_samples(1e-10).unwrap();
        assert_eq!((late.whole, ts.samples(0.9e-10).unwrap().fraction), (0, 0.0));
        assert_abs_diff_eq!(late.fraction, 1e-9, epsilon = 1e-20);
    }

    #[test]
    fn impossible_times_are_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(SampleTime::new(bad).is_err());
        }
        let ts = SampleTime::new(0.1).unwrap();
        assert!(ts.samples(-0.1).is_err());
        assert!(ts.samples(f64::NAN).is_err());
        assert!(ts.must_equal(SampleTime::new(0.2).unwrap()).is_err());
    }
}

//! Measured frequency responses: complex numbers over frequency, with the known facts of their noise.

use nalgebra::Complex;

use super::place::Place;

/// The noise information of a frequency response.
#[derive(Debug, Clone, PartialEq)]
pub enum Quality {
    /// Nothing.
    Unknown,
    /// The squared coherence γ² at each frequency, between 0 and 1: variances are in proportion to |H|²(1 − γ²)/γ².
    Coherence(Vec<f64>),
    /// The standard deviation of the real part, and of the imaginary part, at each frequency.
    Std(Vec<f64>),
}

/// A response H(iω) from one input to one output, at N frequencies above 0, increasing.
#[derive(Debug, Clone, PartialEq)]
pub struct FrequencyResponse {
    source: String,
    omega_rad_s: Vec<f64>,
    values: Vec<Complex<f64>>,
    quality: Quality,
    notes: Vec<String>,
}

/// A frequency response that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrequencyError {
    /// No column has the required quantity.
    #[error(
        "no column with the {needed}; there are {}; name them `frequency [Hz]` (or `[rad/s]`) and `real`, `imag`, or `magnitude [dB]` (or `magnitude`) and `phase [deg]` (or `[rad]`); `coherence` or `std` are optional",
        existing.join(", ")
    )]
    NoColumn {
        /// The missing quantity.
        needed: &'static str,
        /// The columns there are.
        existing: Vec<String>,
    },
    /// Two columns of one kind.
    #[error(
        "the columns `{first}` and `{second}` both look like the {role}; keep one response from one input to one output, and delete the other columns"
    )]
    Twice {
        /// The common role.
        role: &'static str,
        /// One of them.
        first: String,
        /// The other.
        second: String,
    },
    /// A column without a unit where two are usual.
    #[error("the column `{column}` says no unit; call it `{column} [{}]` or `{column} [{}]`", units[0], units[1])]
    NoUnit {
        /// The column.
        column: String,
        /// The units that are usual.
        units: [&'static str; 2],
    },
    /// An empty cell in a row whose other cells are not empty.
    #[error("row {row}: `{column}` is empty; fill the cell or delete the row")]
    EmptyCell {
        /// The line of the file.
        row: usize,
        /// The column.
        column: String,
    },
    /// A value outside its range.
    #[error("{place}: `{column}` is {value}; {remedy}")]
    OutOfRange {
        /// Where.
        place: Place,
        /// The column.
        column: String,
        /// The value.
        value: f64,
        /// The remedy.
        remedy: &'static str,
    },
    /// Frequencies that do not increase.
    #[error(
        "{place}: the frequency {value} is not above the one before it ({before}); sort the rows by frequency and keep one row for each"
    )]
    Order {
        /// Where.
        place: Place,
        /// The frequency before it.
        before: f64,
        /// The frequency.
        value: f64,
    },
    /// Arrays of different lengths.
    #[error("{found} values of the {what} for {expected} frequencies; give one for each")]
    Length {
        /// Which.
        what: &'static str,
        /// As many frequencies.
        expected: usize,
        /// As many values.
        found: usize,
    },
    /// Too few frequencies for any method.
    #[error("{found} frequencies above 0; at least {needed} are needed")]
    TooFew {
        /// At least.
        needed: usize,
        /// There are.
        found: usize,
    },
}

/// Frequencies that any method needs.
pub(super) const NEEDED: usize = 8;

impl Quality {
    /// Its name; empty where it is unknown.
    fn name(&self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::Coherence(_) => "coherence",
            Self::Std(_) => "standard deviation",
        }
    }

    fn values(&self) -> &[f64] {
        match self {
            Self::Unknown => &[],
            Self::Coherence(values) | Self::Std(values) => values,
        }
    }

    fn check(&self, places: &[Place]) -> Result<(), FrequencyError> {
        for (place, &value) in places.iter().zip(self.values()) {
            let remedy = match self {
                Self::Coherence(_) if !(0.0..=1.0).contains(&value) => {
                    "a squared coherence is between 0 and 1"
                }
                Self::Std(_) if !(value.is_finite() && value > 0.0) => {
                    "a standard deviation is above 0; leave the frequency out"
                }
                _ => continue,
            };
            return Err(out_of_range(*place, self.name(), value, remedy));
        }
        Ok(())
    }
}

fn out_of_range(place: Place, column: &str, value: f64, remedy: &'static str) -> FrequencyError {
    FrequencyError::OutOfRange { place, column: column.to_owned(), value, remedy }
}

/// Frequencies increase, and all numbers are finite.
fn check_values(
    places: &[Place],
    omega_rad_s: &[f64],
    values: &[Complex<f64>],
) -> Result<(), FrequencyError> {
    let mut before = None;
    for ((&place, &omega), value) in places.iter().zip(omega_rad_s).zip(values) {
        if !(omega.is_finite() && omega >= 0.0) {
            let remedy = "frequencies are finite and 0 or more; leave the others out";
            return Err(out_of_range(place, "frequency", omega, remedy));
        }
        if let Some(before) = before.filter(|before| *before >= omega) {
            return Err(FrequencyError::Order { place, before, value: omega });
        }
        before = Some(omega);
        if let Some(part) = [value.re, value.im].into_iter().find(|part| !part.is_finite()) {
            let remedy = "every value must be finite; leave the frequency out";
            return Err(out_of_range(place, "response", part, remedy));
        }
    }
    Ok(())
}

/// Those that are kept.
fn kept<T>(values: Vec<T>, keep: &[bool]) -> Vec<T> {
    values.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| value).collect()
}

impl FrequencyResponse {
    /// A response from arrays: angular frequencies, rad/s; complex values; the known facts of their noise. The frequency 0, whose phase has no information on
    /// the delay, is left out.
    ///
    /// # Errors
    /// [`FrequencyError`] with the place of what cannot be used.
    pub fn new(
        source: impl Into<String>,
        omega_rad_s: Vec<f64>,
        values: Vec<Complex<f64>>,
        quality: Quality,
    ) -> Result<Self, FrequencyError> {
        let places = (0..omega_rad_s.len()).map(Place::Sample).collect();
        Self::checked(source.into(), omega_rad_s, values, quality, places)
    }

    /// The same with the place of each frequency for messages.
    pub(super) fn checked(
        source: String,
        omega_rad_s: Vec<f64>,
        values: Vec<Complex<f64>>,
        quality: Quality,
        places: Vec<Place>,
    ) -> Result<Self, FrequencyError> {
        let expected = omega_rad_s.len();
        for (what, found) in [("response", values.len()), (quality.name(), quality.values().len())]
        {
            if found != expected && !what.is_empty() {
                return Err(FrequencyError::Length { what, expected, found });
            }
        }
        check_values(&places, &omega_rad_s, &values)?;
        quality.check(&places)?;
        // A response of exactly 0 has no phase; neither has a coherence of 0 any information.
        let coherent = |i: usize| !matches!(&quality, Quality::Coherence(c) if c.get(i).is_some_and(|c| *c <= 0.0));
        let keep: Vec<bool> = (omega_rad_s.iter().zip(&values).enumerate())
            .map(|(i, (w, v))| *w > 0.0 && v.norm_sqr() > 0.0 && coherent(i))
            .collect();
        let mut notes = Vec::new();
        let left_out = keep.iter().filter(|k| !**k).count();
        if left_out > 0 {
            notes.push(format!(
                "left out {left_out} rows at frequency 0, with a response of 0 or without coherence: they know nothing of a delay"
            ));
        }
        let quality = match quality {
            Quality::Unknown => Quality::Unknown,
            Quality::Coherence(values) => Quality::Coherence(kept(values, &keep)),
            Quality::Std(values) => Quality::Std(kept(values, &keep)),
        };
        let (omega_rad_s, values) = (kept(omega_rad_s, &keep), kept(values, &keep));
        if omega_rad_s.len() < NEEDED {
            return Err(FrequencyError::TooFew { needed: NEEDED, found: omega_rad_s.len() });
        }
        Ok(Self { source, omega_rad_s, values, quality, notes })
    }

    /// Its name.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Angular frequencies, rad/s, increasing.
    #[must_use]
    pub fn omega_rad_s(&self) -> &[f64] {
        &self.omega_rad_s
    }

    /// H(iω).
    #[must_use]
    pub fn values(&self) -> &[Complex<f64>] {
        &self.values
    }

    /// The known facts of the noise.
    #[must_use]
    pub fn quality(&self) -> &Quality {
        &self.quality
    }

    /// Notes on the reading, a sentence each.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// With sentences on how it was read before its own.
    pub(super) fn noting(mut self, mut notes: Vec<String>) -> Self {
        notes.append(&mut self.notes);
        self.notes = notes;
        self
    }

    /// The delay from which on delays are aliases because of the spacing of the frequencies, s: a turn over the smallest distance of neighbours.
    #[must_use]
    pub fn unambiguous_s(&self) -> f64 {
        let mut gaps: Vec<f64> =
            super::place::neighbours(&self.omega_rad_s).map(|(a, b)| b - a).collect();
        gaps.sort_by(f64::total_cmp);
        gaps.first().map_or(f64::INFINITY, |gap| std::f64::consts::TAU / gap)
    }
}

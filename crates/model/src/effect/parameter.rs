//! A parameter of an effect: what it is for, how far it is searched and in which steps.

use std::borrow::Cow;

use super::scales::Scales;

/// What a parameter is for. It decides how far a search goes and how small a change matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A dead time, s.
    Delay,
    /// The period of something that is late by half of it on average, s.
    Period,
    /// The time constant of a lag, s.
    TimeConstant,
    /// A difference between clocks, s, of either sign.
    Clock,
    /// A time of the log at which something changes, s.
    Instant,
    /// A frequency, Hz.
    Frequency,
    /// A damping ratio, 1.
    Damping,
    /// A phase, rad.
    Phase,
    /// Where something ends; infinite when nominal.
    Limit,
    /// Another number that says what an effect is like, not how large it is.
    Shape,
    /// How large the effect is.
    Size,
}

impl Role {
    /// It says what an effect is like, not how large it is: as an effect fades, it keeps its value.
    #[must_use]
    pub fn is_shape(self) -> bool {
        matches!(self, Self::Instant | Self::Frequency | Self::Damping | Self::Phase | Self::Shape)
    }

    /// A time that samples resolve only to one period, s.
    #[must_use]
    pub fn is_time(self) -> bool {
        matches!(self, Self::Delay | Self::Period | Self::TimeConstant | Self::Clock)
    }
}

/// A parameter of an effect on one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Its unit.
    pub unit: String,
    /// What it is for.
    pub role: Role,
    /// Where the effect is the identity; infinite for a limit.
    pub nominal: f64,
    /// The smallest value that makes sense.
    pub lower: f64,
    /// The largest.
    pub upper: f64,
}

impl Parameter {
    /// The bounds of a search: its own, and what these logs can show at all.
    #[must_use]
    pub fn range(&self, scales: &Scales) -> (f64, f64) {
        let (lower, upper) = match self.role {
            // From 20 % of a period in the whole log to near the Nyquist frequency.
            Role::Frequency => (0.2 / scales.duration_s, 0.45 / scales.sample_time_s),
            Role::Damping => (1e-3, 2.0),
            Role::Delay => (0.0, scales.longest_delay_s),
            Role::Period => (0.0, 2.0 * scales.longest_delay_s),
            Role::TimeConstant => (0.0, 0.25 * scales.duration_s),
            Role::Instant => (0.0, scales.duration_s),
            Role::Clock => (-scales.longest_delay_s, scales.longest_delay_s),
            Role::Phase | Role::Limit | Role::Shape | Role::Size => (self.lower, self.upper),
        };
        (lower.max(self.lower), upper.min(self.upper))
    }

    /// How far a value is from doing nothing; of a limit, its size.
    fn distance(&self, value: f64) -> f64 {
        if self.nominal.is_finite() { (value - self.nominal).abs() } else { value.abs() }
    }

    /// How far a value is from where the effect is the identity. A shape's nominal value is no such place: its size counts, as that of a limit.
    #[must_use]
    pub fn departure(&self, value: f64) -> f64 {
        if self.role.is_shape() { value.abs() } else { self.distance(value) }
    }

    /// The step for a numerical derivative at a value, inside the bounds.
    #[must_use]
    pub fn derivative_step(&self, value: f64, scales: &Scales) -> f64 {
        let least =
            if self.role.is_time() { 0.01 * scales.sample_time_s } else { 1e-6 * value.abs() };
        if self.role == Role::Instant {
            // A command that is held hides where in between the change was.
            return if value + scales.sample_time_s > self.upper {
                -scales.sample_time_s
            } else {
                scales.sample_time_s
            };
        }
        let step = (1e-4 * self.distance(value)).max(1e-4 * least).max(1e-12);
        if value + step > self.upper { -step } else { step }
    }

    /// The step to either side for a central difference, 1 % of the distance from nominal; `None` where it is not inside the bounds, and for an instant.
    ///
    /// The truncation error is h²/6, some 2e-5 of the derivative (Nocedal and Wright 2006, section 8.1, doi:10.1007/978-0-387-40065-5). Simulations need a tolerance that is
    /// small against what this step moves.
    #[must_use]
    pub fn central_step(&self, value: f64, scales: &Scales) -> Option<f64> {
        let least =
            if self.role.is_time() { 0.01 * scales.sample_time_s } else { 1e-6 * value.abs() };
        let step = (1e-2 * self.distance(value)).max(least).max(1e-12);
        let inside = value - step > self.lower && value + step < self.upper;
        (inside && self.role != Role::Instant).then_some(step)
    }

    /// A first step for the numerical derivative of a simulator that can only be called, and may be rough.
    #[must_use]
    pub fn rough_derivative_step(&self, value: f64, scales: &Scales) -> f64 {
        let least =
            if self.role.is_time() { 0.02 * scales.sample_time_s } else { 1e-3 * value.abs() };
        let step = (1e-2 * self.distance(value)).max(least);
        if step > 0.0 { step } else { 1e-9 }
    }

    /// A step to either side that may lead into another minimum of the cost.
    #[must_use]
    pub fn leap(&self, value: f64, scales: &Scales) -> f64 {
        match self.role {
            Role::Instant => 8.0 * scales.sample_time_s,
            role if role.is_time() => 0.5 * scales.sample_time_s,
            _ => 0.1 * self.distance(value),
        }
    }
}

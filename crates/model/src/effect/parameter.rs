//! A parameter of an effect: its role, its search bounds and its steps.

use std::borrow::Cow;

use super::scales::Scales;

/// The role of a parameter. The role defines the bounds of a search and the size of a relevant change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A dead time, s.
    Delay,
    /// The period of an effect with a mean delay of half a period, s.
    Period,
    /// The time constant of a lag, s.
    TimeConstant,
    /// A difference between clocks, s, of either sign.
    Clock,
    /// A log time at which a value changes, s.
    Instant,
    /// A frequency, Hz.
    Frequency,
    /// A damping ratio, 1.
    Damping,
    /// A phase, rad.
    Phase,
    /// A limit; infinite when nominal.
    Limit,
    /// Another parameter that describes the kind of an effect instead of its size.
    Shape,
    /// The size of the effect.
    Size,
}

impl Role {
    /// The parameter describes the kind of an effect: it keeps its value as the effect vanishes.
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
    /// Its role.
    pub role: Role,
    /// The value at which the effect is the identity; infinite for a limit.
    pub nominal: f64,
    /// The smallest valid value.
    pub lower: f64,
    /// The largest valid value.
    pub upper: f64,
}

impl Parameter {
    /// The bounds of a search: its own, restricted to values that these logs can reveal.
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

    /// The distance of a value from the identity; for a limit, its magnitude.
    fn distance(&self, value: f64) -> f64 {
        if self.nominal.is_finite() { (value - self.nominal).abs() } else { value.abs() }
    }

    /// The distance of a value from that of the identity. A shape's nominal value is no identity: its magnitude is used, as that of a limit.
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
            // A held command hides the exact time of a change between its samples.
            return if value + scales.sample_time_s > self.upper {
                -scales.sample_time_s
            } else {
                scales.sample_time_s
            };
        }
        let step = (1e-4 * self.distance(value)).max(1e-4 * least).max(1e-12);
        if value + step > self.upper { -step } else { step }
    }

    /// The step to either side for a central difference, 1 % of the distance from nominal. `None` where it is not inside the bounds, and for an instant.
    ///
    /// The truncation error is h²/6, about 2e-5 of the derivative (Nocedal and Wright 2006, section 8.1, doi:10.1007/978-0-387-40065-5). The simulation
    /// tolerance must be small compared with the effect of this step.
    #[must_use]
    pub fn central_step(&self, value: f64, scales: &Scales) -> Option<f64> {
        let least =
            if self.role.is_time() { 0.01 * scales.sample_time_s } else { 1e-6 * value.abs() };
        let step = (1e-2 * self.distance(value)).max(least).max(1e-12);
        let inside = value - step > self.lower && value + step < self.upper;
        (inside && self.role != Role::Instant).then_some(step)
    }

    /// An initial step for the numerical derivative of a black-box simulator, which may be rough.
    #[must_use]
    pub fn rough_derivative_step(&self, value: f64, scales: &Scales) -> f64 {
        let least =
            if self.role.is_time() { 0.02 * scales.sample_time_s } else { 1e-3 * value.abs() };
        let step = (1e-2 * self.distance(value)).max(least);
        if step > 0.0 { step } else { 1e-9 }
    }

    /// A step to either side that may reach another minimum of the cost.
    #[must_use]
    pub fn leap(&self, value: f64, scales: &Scales) -> f64 {
        match self.role {
            Role::Instant => 8.0 * scales.sample_time_s,
            role if role.is_time() => 0.5 * scales.sample_time_s,
            _ => 0.1 * self.distance(value),
        }
    }
}

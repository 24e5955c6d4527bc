//! The result of a method at one frequency, and quantities derived from it.

use nalgebra::{Complex, DMatrix};

use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::stats::students_t;

type Matrix = DMatrix<Complex<f64>>;

/// y = G·u + v at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// ω, rad/s.
    pub omega_rad_s: f64,
    /// G, l × m, in the outputs' units per the inputs'.
    pub g: Matrix,
    /// Covariance of v, l × l.
    pub noise: Matrix,
    /// W, m × m: the covariance of the entries (a, i) and (b, j) of G is `noise[a, b]`·`W[j, i]`.
    pub weight: Matrix,
    /// Inverse of the inputs' mean spectrum on the scale of `noise`, m × m, for the coherence.
    pub inverse_power: Matrix,
    /// Degrees of freedom of `noise`, real.
    pub freedom: f64,
}

/// All lines of a method.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// By frequency, increasing.
    pub lines: Vec<Line>,
    /// Notes to report, one sentence each.
    pub notes: Vec<String>,
}

/// The response of one input and output at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// ω, rad/s.
    pub omega_rad_s: f64,
    /// G.
    pub value: Complex<f64>,
    /// Standard deviation of the real part, and of the imaginary part.
    pub std: f64,
    /// Squared coherence of this input and output without the other inputs' parts: |G|²/(|G|² + noise over input), from 0 to 1.
    pub coherence: f64,
    /// Half width of a 95 % interval of a part, in standard deviations: Student's quantile.
    pub quantile: f64,
}

/// Lower bound of a standard deviation, as a share of |G|: rounding.
const ROUNDING: f64 = 1e-12;

impl Line {
    /// One entry of G with its noise; `None` where it is not finite or rounding hides it.
    #[must_use]
    pub fn point(&self, output: usize, input: usize) -> Option<Point> {
        let value = *self.g.get((output, input))?;
        let noise = self.noise.get((output, output))?.re.max(0.0);
        let (own, power) =
            (self.weight.get((input, input))?.re, self.inverse_power.get((input, input))?.re);
        let std = (0.5 * noise * own).sqrt().max(ROUNDING * value.norm());
        let explained = value.norm_sqr();
        let coherence =
            if explained > 0.0 { explained / (explained + noise * power.max(0.0)) } else { 0.0 };
        let quantile = students_t(0.975, self.freedom.max(1.0)).unwrap_or(NORMAL_95);
        let point = Point { omega_rad_s: self.omega_rad_s, value, std, coherence, quantile };
        (value.re.is_finite() && value.im.is_finite() && std.is_finite() && coherence.is_finite())
            .then_some(point)
    }
}

impl Point {
    /// |G|.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.value.norm()
    }

    /// Phase, rad, between −π and π.
    #[must_use]
    pub fn phase_rad(&self) -> f64 {
        self.value.arg()
    }

    /// 95 % interval of the gain: along G, no lower than 0.
    #[must_use]
    pub fn gain_ci95(&self) -> [f64; 2] {
        let half = self.quantile * self.std;
        [(self.gain() - half).max(0.0), self.gain() + half]
    }

    /// 95 % interval of the phase, rad: across G; absent where the interval of G holds 0, and so every phase.
    #[must_use]
    pub fn phase_ci95_rad(&self) -> Option<[f64; 2]> {
        let half = self.quantile * self.std / self.gain();
        (half < 1.0).then(|| [self.phase_rad() - half.asin(), self.phase_rad() + half.asin()])
    }
}

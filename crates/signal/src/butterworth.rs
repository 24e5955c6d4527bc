//! Butterworth filters of order 8, as cascaded second-order sections.
//!
//! |H|² = 1 / (1 + Ω¹⁶), with Ω = w/w_c (low-pass), w_c/w (high-pass) or (w² − w₀²)/(b·w) (band-pass: w₀² = w₁·w₂, b = w₂ − w₁) and
//! w = tan(π·f/2), f in fractions of the Nyquist frequency: the bilinear transform, prewarped to place the band's edges exactly.
//!
//! Source: S. Butterworth, 1930, "On the theory of filter amplifiers"; the transforms as in A. V. Oppenheim and R. W. Schafer,
//! "Discrete-Time Signal Processing", chapter on filter design.

use std::f64::consts::PI;

use nalgebra::Complex;

/// Order of the low-pass prototype; a band-pass has twice as many poles.
const ORDER: usize = 8;

/// One second-order section b(z⁻¹)/a(z⁻¹), a₀ = 1, with its state (transposed direct form II).
#[derive(Debug, Clone)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
}

/// A causal filter that starts at rest.
#[derive(Debug, Clone)]
pub(super) struct Butterworth {
    sections: Vec<Section>,
}

impl Section {
    /// (n₀ + n₁·s + n₂·s²) / (s² − 2·Re(pole)·s + |pole|²) under s = (z − 1)/(z + 1).
    fn bilinear(numerator: [f64; 3], pole: Complex<f64>) -> Self {
        let [n0, n1, n2] = numerator;
        let (re2, sq) = (2.0 * pole.re, pole.norm_sqr());
        let a0 = 1.0 - re2 + sq;
        Self {
            b: [(n0 + n1 + n2) / a0, 2.0 * (n0 - n2) / a0, (n0 - n1 + n2) / a0],
            a: [2.0 * (sq - 1.0) / a0, (1.0 + re2 + sq) / a0],
            state: [0.0; 2],
        }
    }

    fn step(&mut self, u: f64) -> f64 {
        let y = self.b[0] * u + self.state[0];
        self.state[0] = self.b[1] * u - self.a[0] * y + self.state[1];
        self.state[1] = self.b[2] * u - self.a[1] * y;
        y
    }
}

impl Butterworth {
    /// The filter that passes `low..high`, in fractions of the Nyquist frequency, 0 ≤ low < high ≤ 1; no section when that is everything.
    pub(super) fn pass(low: f64, high: f64) -> Self {
        let w = |f: f64| (PI * f / 2.0).tan();
        // The prototype's poles above the real axis; each section holds one and its conjugate.
        let poles = (0..ORDER / 2).map(|k| {
            Complex::from_polar(1.0, PI * (2 * k + ORDER + 1) as f64 / (2 * ORDER) as f64)
        });
        let sections = match (low > 0.0, high < 1.0) {
            (false, false) => Vec::new(),
            (false, true) => {
                poles.map(|p| Section::bilinear([w(high).powi(2), 0.0, 0.0], p * w(high))).collect()
            }
            (true, false) => {
                poles.map(|p| Section::bilinear([0.0, 0.0, 1.0], p.inv() * w(low))).collect()
            }
            (true, true) => {
                let (b, w0_sq) = (w(high) - w(low), w(low) * w(high));
                poles
                    .flat_map(|p| {
                        // s² − b·p·s + w₀² = 0: the larger root first, the smaller one from the roots' product.
                        let half = p * (b / 2.0);
                        let root = (half * half - w0_sq).sqrt();
                        let large = if (half + root).norm() >= (half - root).norm() {
                            half + root
                        } else {
                            half - root
                        };
                        [large, large.inv() * w0_sq]
                    })
                    .map(|s| Section::bilinear([0.0, b, 0.0], s))
                    .collect()
            }
        };
        Self { sections }
    }

    /// The output that belongs to the next input.
    pub(super) fn step(&mut self, u: f64) -> f64 {
        self.sections.iter_mut().fold(u, |v, section| section.step(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    const BANDS: [(f64, f64); 7] =
        [(0.0, 0.3), (0.0, 0.01), (0.2, 1.0), (0.9, 1.0), (0.1, 0.3), (0.45, 0.5), (0.01, 0.9)];

    fn analytic(low: f64, high: f64, f: f64) -> f64 {
        let w = |f: f64| (PI * f / 2.0).tan();
        let omega = if low <= 0.0 {
            w(f) / w(high)
        } else if high >= 1.0 {
            w(low) / w(f)
        } else {
            (w(f).powi(2) - w(low) * w(high)) / ((w(high) - w(low)) * w(f))
        };
        1.0 / (1.0 + omega.powi(16))
    }

    fn magnitude_squared(filter: &Butterworth, f: f64) -> f64 {
        let q = Complex::from_polar(1.0, -PI * f);
        filter
            .sections
            .iter()
            .map(|s| ((q * s.b[2] + s.b[1]) * q + s.b[0]) / ((q * s.a[1] + s.a[0]) * q + 1.0))
            .product::<Complex<f64>>()
            .norm_sqr()
    }

    #[test]
    fn magnitude_is_the_analytic_butterworth_one_in_and_outside_the_band() {
        for (low, high) in BANDS {
            let filter = Butterworth::pass(low, high);
            for f in
                [0.005, 0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.45, 0.48, 0.5, 0.6, 0.8, 0.9, 0.95]
            {
                let (got, want) = (magnitude_squared(&filter, f), analytic(low, high, f));
                assert!(
                    (got - want).abs() <= 1e-8 * want,
                    "band [{low}, {high}] at {f}: {got} instead of {want}"
                );
            }
        }
    }

    #[test]
    fn edges_of_the_band_lie_at_half_power() {
        for (low, high) in BANDS {
            let filter = Butterworth::pass(low, high);
            for edge in [low, high] {
                if edge > 0.0 && edge < 1.0 {
                    assert_abs_diff_eq!(magnitude_squared(&filter, edge), 0.5, epsilon = 1e-9);
                }
            }
        }
    }

    #[test]
    fn impulse_response_decays_and_has_the_filters_spectrum() {
        for (low, high) in [(0.0, 0.3), (0.2, 1.0), (0.1, 0.3)] {
            let mut filter = Butterworth::pass(low, high);
            let h: Vec<f64> =
                (0..4000).map(|k| filter.step(if k == 0 { 1.0 } else { 0.0 })).collect();
            assert!(h[3000..].iter().all(|v| v.abs() < 1e-12));
            for f in [0.05, 0.15, 0.2, 0.5, 0.8] {
                let at: Complex<f64> = h
                    .iter()
                    .enumerate()
                    .map(|(k, &v)| Complex::from_polar(v, -PI * f * k as f64))
                    .sum();
                assert_abs_diff_eq!(at.norm_sqr(), analytic(low, high, f), epsilon = 1e-10);
            }
        }
    }

    #[test]
    fn full_band_passes_everything_untouched() {
        let mut filter = Butterworth::pass(0.0, 1.0);
        assert_eq!(filter.step(0.37).to_bits(), 0.37_f64.to_bits());
    }
}

//! From drawn models to reported uncertainty: standard deviations of poles, bands of frequency responses.

use nalgebra::{Complex, DMatrix};
use serde::Serialize;

use super::innovations::InnovationsModel;
use deadtime_model::{ModelError, Sampled, StateSpace};
use deadtime_signal::stats::NORMAL_95_EXACT;
use deadtime_signal::time::SampleTime;

/// Models drawn from the covariance of the long predictor, Σe ⊗ (ZZᵀ)⁻¹.
///
/// Source: the thesis (random draws carried to frequency responses); Chiuso (2007), doi:10.1016/j.automatica.2006.12.005, for the asymptotic covariance.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Draws {
    /// Whole draws, for quantiles.
    pub whole: Vec<InnovationsModel>,
    /// Draws scaled by `step`, for derivatives: the delta method without analytic derivatives.
    pub small: Vec<InnovationsModel>,
    /// Size of the small draws.
    pub step: f64,
    /// Input delays of each whole draw, samples; empty: those of the model.
    pub whole_delays: Vec<Vec<usize>>,
    /// Input delays of each small draw, samples; empty: those of the model.
    pub small_delays: Vec<Vec<usize>>,
}

/// A pole or zero of the sampled model, with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Root {
    /// Real part, in the z plane.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
    /// Standard deviation of the real part; absent without draws.
    pub std_re: Option<f64>,
    /// Standard deviation of the imaginary part.
    pub std_im: Option<f64>,
    /// Covariance of the two, for the ellipse.
    pub covariance: Option<f64>,
    /// The ellipse that holds the root with 95 %; absent without draws, and for a real root, which has an interval.
    pub ellipse95: Option<Ellipse>,
    /// Natural frequency of the continuous pole, Hz; absent at z = 0.
    pub frequency_hz: Option<f64>,
    /// Damping ratio of the continuous pole.
    pub damping: Option<f64>,
    /// Time constant −1/Re s of the continuous pole, s; negative for an unstable pole.
    pub time_constant_s: Option<f64>,
    /// Standard deviation of `time_constant_s`.
    pub time_constant_std_s: Option<f64>,
}

/// An ellipse around a root of the z plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ellipse {
    /// The longer half-axis.
    pub major: f64,
    /// The shorter half-axis.
    pub minor: f64,
    /// Angle from the real axis to the longer half-axis, rad, between −π/2 and π/2.
    pub angle_rad: f64,
}

impl Ellipse {
    /// For two normal parts with these standard deviations and this covariance. The half-axes are √(5.991·λ), λ the covariance's eigenvalues, 5.991 the 95 %
    /// quantile of chi-squared with two degrees of freedom.
    fn of(std_re: f64, std_im: f64, covariance: f64) -> Self {
        let (a, b) = (std_re * std_re, std_im * std_im);
        let (middle, half) = (0.5 * (a + b), (0.5 * (a - b)).hypot(covariance));
        let axis = |eigenvalue: f64| (CHI_SQUARED_95 * eigenvalue.max(0.0)).sqrt();
        Self {
            major: axis(middle + half),
            minor: axis(middle - half),
            angle_rad: 0.5 * (2.0 * covariance).atan2(a - b),
        }
    }
}

/// The 95 % quantile of chi-squared with two degrees of freedom.
const CHI_SQUARED_95: f64 = 5.991_465;

impl Root {
    /// Whether `z` lies within the 95 % ellipse (for a real root, the 95 % interval).
    #[must_use]
    pub fn covers(&self, z: Complex<f64>) -> bool {
        let (dre, dim) = (z.re - self.re, z.im - self.im);
        let (Some(sr), Some(si), Some(c)) = (self.std_re, self.std_im, self.covariance) else {
            return false;
        };
        let determinant = sr * sr * si * si - c * c;
        if self.im == 0.0 || determinant <= 0.0 {
            return dre.abs() <= NORMAL_95_EXACT * sr && dim == 0.0;
        }
        (dre * dre * si * si - 2.0 * dre * dim * c + dim * dim * sr * sr) / determinant
            <= CHI_SQUARED_95
    }
}

/// The frequency response of one pair at one frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Band {
    /// Frequency, rad/s.
    pub omega_rad_s: f64,
    /// |G|, in the output's unit per input's.
    pub gain: f64,
    /// Phase, rad, delays included.
    pub phase_rad: f64,
    /// 95 % of the draws' gains.
    pub gain_ci95: Option<[f64; 2]>,
    /// Standard deviation of the gain by the delta method.
    pub gain_std: Option<f64>,
    /// Standard deviation of the phase by the delta method, rad.
    pub phase_std_rad: Option<f64>,
}

/// The frequency response of one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Response {
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// By frequency, increasing.
    pub bands: Vec<Band>,
}

/// The covariance of A, B, C and D as independent deviations of one standard deviation each, flattened in row-major order, A first. Σ dᵀd over them is the
/// covariance, in the states of the nominal model. Empty without draws.
pub(super) fn deviations(nominal: &InnovationsModel, draws: &Draws) -> Vec<Vec<f64>> {
    let flat = |m: &InnovationsModel| {
        [&m.a, &m.b, &m.c, &m.d]
            .map(|m| m.transpose().iter().copied().collect::<Vec<f64>>())
            .concat()
    };
    let (own, count) = (flat(nominal), draws.small.len());
    let drawn: Vec<Vec<f64>> =
        draws.small.iter().map(flat).filter(|d| d.len() == own.len()).collect();
    if drawn.len() <= 10 {
        return Vec::new();
    }
    let size = draws.step * (count as f64).sqrt();
    let all = DMatrix::from_fn(drawn.len(), own.len(), |i, j| (drawn[i][j] - own[j]) / size);
    // The triangular factor has the same sum of products in the fewest rows.
    all.qr().r().row_iter().map(|row| row.iter().copied().collect()).collect()
}

/// The model without its predictor.
///
/// # Errors
/// [`ModelError::NotFinite`].
pub(super) fn system(
    model: &InnovationsModel,
    ts: SampleTime,
    delays: &[usize],
) -> Result<StateSpace<Sampled>, ModelError> {
    StateSpace::sampled(model.a.clone(), model.b.clone(), model.c.clone(), model.d.clone(), ts)?
        .with_input_delay(delays.to_vec())
}

/// Roots within this relative distance coincide.
const COINCIDE: f64 = 1e-5;

/// Roots of the model as `of` finds them, with their deviations over the small draws.
pub(super) fn roots(
    nominal: &[Complex<f64>],
    drawn: &[Vec<Complex<f64>>],
    step: f64,
    ts: SampleTime,
) -> Vec<Root> {
    let matched: Vec<Vec<Complex<f64>>> =
        drawn.iter().filter_map(|d| matched(nominal, d)).collect();
    let known = matched.len() > 10;
    nominal
        .iter()
        .enumerate()
        .map(|(i, &z)| {
            // Coinciding roots have no derivative.
            let known = known
                && !nominal
                    .iter()
                    .enumerate()
                    .any(|(j, other)| j != i && (other - z).norm() < COINCIDE * z.norm());
            let mean = |f: &dyn Fn(Complex<f64>) -> f64| {
                matched.iter().map(|d| f((d[i] - z) / step)).sum::<f64>() / matched.len() as f64
            };
            let (vr, vi, c) =
                (mean(&|d| d.re * d.re), mean(&|d| d.im * d.im), mean(&|d| d.re * d.im));
            let s = (z.norm() > 1e-6).then(|| z.ln() / ts.seconds());
            // ds = dz/(z·Ts).
            let growth = s.map(|s| (s.re, (mean(&|d| (d / z).re.powi(2))).sqrt() / ts.seconds()));
            Root {
                re: z.re,
                im: z.im,
                std_re: known.then(|| vr.sqrt()),
                std_im: known.then(|| vi.sqrt()),
                covariance: known.then_some(c),
                ellipse95: (known && z.im != 0.0).then(|| Ellipse::of(vr.sqrt(), vi.sqrt(), c)),
                frequency_hz: s.map(|s| s.norm() / std::f64::consts::TAU),
                damping: s.filter(|s| s.norm() > 0.0).map(|s| -s.re / s.norm()),
                time_constant_s: growth.filter(|g| g.0 != 0.0).map(|g| -1.0 / g.0),
                time_constant_std_s: growth
                    .filter(|g| known && g.0 != 0.0)
                    .map(|g| g.1 / (g.0 * g.0)),
            }
        })
        .collect()
}

/// The drawn roots in the order of the nominal ones, each paired with its nearest; `None` where their numbers differ.
fn matched(nominal: &[Complex<f64>], drawn: &[Complex<f64>]) -> Option<Vec<Complex<f64>>> {
    if nominal.len() != drawn.len() || drawn.iter().any(|z| !z.re.is_finite()) {
        return None;
    }
    let mut left = drawn.to_vec();
    let mut found = vec![Complex::default(); nominal.len()];
    let mut open: Vec<usize> = (0..nominal.len()).collect();
    while !open.is_empty() {
        let pairs = open.iter().flat_map(|&i| (0..left.len()).map(move |j| (i, j)));
        let (i, j) = pairs.min_by(|a, b| {
            (nominal[a.0] - left[a.1]).norm().total_cmp(&(nominal[b.0] - left[b.1]).norm())
        })?;
        found[i] = left.swap_remove(j);
        open.retain(|k| *k != i);
    }
    Some(found)
}

/// Logarithmically even frequencies from a few periods in the data to the Nyquist frequency, rad/s.
pub(super) fn frequencies(ts: SampleTime, samples: usize, count: usize) -> Vec<f64> {
    let high = ts.nyquist_rad_s() * 0.99;
    let low =
        (std::f64::consts::TAU * 2.0 / (samples.max(8) as f64 * ts.seconds())).min(high / 10.0);
    (0..count).map(|k| low * (high / low).powf(k as f64 / (count - 1).max(1) as f64)).collect()
}

/// The response of every pair at these frequencies: input by input, output by output, with bands.
pub(super) fn responses(
    nominal: &StateSpace<Sampled>,
    draws: &Draws,
    frequencies: &[f64],
) -> Vec<Vec<Vec<Band>>> {
    let (ts, delays) = (nominal.sample_time(), nominal.input_delay());
    let systems = |models: &[InnovationsModel], own: &[Vec<usize>]| {
        let one = |(i, m): (usize, &InnovationsModel)| {
            system(m, ts, own.get(i).map_or(delays, Vec::as_slice)).ok()
        };
        models.iter().enumerate().filter_map(one).collect::<Vec<_>>()
    };
    let (whole, small) =
        (systems(&draws.whole, &draws.whole_delays), systems(&draws.small, &draws.small_delays));
    let (m, l) = (nominal.inputs(), nominal.outputs());
    let mut found = vec![vec![Vec::with_capacity(frequencies.len()); l]; m];
    for &omega in frequencies {
        let at = |all: &[StateSpace<Sampled>]| {
            all.iter().map(|s| s.frequency_response(omega)).collect::<Vec<DMatrix<Complex<f64>>>>()
        };
        let (g, whole, small) = (nominal.frequency_response(omega), at(&whole), at(&small));
        for (j, of_input) in found.iter_mut().enumerate() {
            for (i, bands) in of_input.iter_mut().enumerate() {
                let value = g[(i, j)];
                let mut gains: Vec<f64> =
                    whole.iter().map(|h| h[(i, j)].norm()).filter(|v| v.is_finite()).collect();
                gains.sort_by(f64::total_cmp);
                let quantile = |p: f64| gains[((gains.len() - 1) as f64 * p).round() as usize];
                let deviation = |f: &dyn Fn(Complex<f64>) -> f64| {
                    let sum: f64 = small.iter().map(|h| (f(h[(i, j)]) / draws.step).powi(2)).sum();
                    (small.len() > 10)
                        .then(|| (sum / small.len() as f64).sqrt())
                        .filter(|v| v.is_finite())
                };
                bands.push(Band {
                    omega_rad_s: omega,
                    gain: value.norm(),
                    phase_rad: value.arg(),
                    gain_ci95: (gains.len() > 40).then(|| [quantile(0.025), quantile(0.975)]),
                    gain_std: deviation(&|h| h.norm() - value.norm()),
                    phase_std_rad: deviation(&|h| (h / value).arg()),
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_is_where_the_quadratic_form_is_the_quantile() {
        let (sr, si, c) = (0.03, 0.01, 0.00021);
        let ellipse = Ellipse::of(sr, si, c);
        let root = Root {
            re: 0.5,
            im: 0.4,
            std_re: Some(sr),
            std_im: Some(si),
            covariance: Some(c),
            ellipse95: Some(ellipse),
            frequency_hz: None,
            damping: None,
            time_constant_s: None,
            time_constant_std_s: None,
        };
        for turn in 0..24 {
            let angle = f64::from(turn) * std::f64::consts::TAU / 24.0;
            let on = Complex::new(ellipse.major * angle.cos(), ellipse.minor * angle.sin())
                * Complex::cis(ellipse.angle_rad);
            let centre = Complex::new(root.re, root.im);
            assert!(
                root.covers(centre + on * 0.999) && !root.covers(centre + on * 1.001),
                "{turn}"
            );
        }
    }
}

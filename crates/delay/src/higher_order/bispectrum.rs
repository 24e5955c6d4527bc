//! The delay between the bispectra of two sensors.
//!
//! Equation: τ̂ = argmax |T(τ)|, T(τ) = Σ over ω₁, ω₂ of W·Buyu(ω₁, ω₂)·conj(Buuu(ω₁, ω₂))·exp(iω₂τ). Here Buyu = E[U(ω₁)·Y(ω₂)·conj U(ω₁ + ω₂)], which is
//! Buuu·exp(−iω₂D) where y is u delayed by D. The weight is W = 1/(Puu(ω₁)·Puu(ω₁ + ω₂)·Pyy(ω₂)).
//!
//! Third-order statistics of noise with a symmetric distribution are zero, for any colour and any share common to both sensors. Correlation takes common noise
//! for the signal; the bispectrum does not.

use nalgebra::Complex;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::correlation::generalised::{Alike, Centred, Interpolant, LATE, real};
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, long_enough, noted, options};
use crate::method::{Condition, Information, Law, Method, ReferenceExperiment, method_line};
use deadtime_identify::Record;
use deadtime_signal::stats::students_t;
use deadtime_signal::{RealFourier, stats};

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: u is skewed (large values on one side: rectified, bursting, popping). y is a delayed, scaled copy of u plus noise with a symmetric distribution,
/// possibly coloured and shared by both sensors.
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·(4·segment + `max_delay`)), long records cut at `max_samples`.
/// Fails when: the skewness of u is not significant (`not_applicable`): Gaussian and symmetric inputs, random binary ones included. On short records
/// third-order averages have not converged (`not_visible`). The delay of skewed noise may dominate. Plant dynamics bias the delay late.
/// Source: Nikias and Pan (1988), IEEE Trans. Acoust. Speech Signal Process. 36(11), 1803-1814, doi:10.1109/29.9008. Hinich and Wilson (1992), IEEE Trans.
/// Signal Process. 40(7), 1777-1783, doi:10.1109/78.143447. The former sums phases of Buyu/Buuu without weights. The weights here are inverse noise powers
/// times the signal's own bispectrum, so frequencies without third-order signal have no weight. Neither source gives an uncertainty; here it is the scatter of
/// dT/dτ over stretches of the record.
///
/// # Example
/// ```
/// use deadtime_delay::{Bispectrum, DelayEstimator, Experiment, Search};
/// use deadtime_signal::time::SampleTime;
/// use rand::RngExt;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// let u: Vec<f64> = (0..600).map(|_| -rng.random_range(1e-9_f64..1.0).ln()).collect(); // exponential: skewed
/// let y: Vec<f64> = (0..600_usize).map(|t| t.checked_sub(7).map_or(0.0, |i| u[i]) + rng.random_range(-0.1..0.1)).collect();
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = Bispectrum::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.7).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bispectrum {
    /// Samples of a segment; default 32: twice as many lags as the memory of most sources, and many segments.
    pub segment: usize,
    /// Longest part of a record that is used, samples; default 100 000, about 1 s of work.
    pub max_samples: usize,
}

impl Default for Bispectrum {
    fn default() -> Self {
        Self { segment: 32, max_samples: 100_000 }
    }
}

const NAME: &str = "bispectrum";
/// Segments that the shortest record must hold.
const SEGMENTS: usize = 4;
/// Standard deviations of the skewness of a Gaussian record beyond which the input counts as skewed.
const SKEWED: f64 = 3.5;
/// A spectrum below this share of its largest line is rounding; the divisors of the weights are bounded by it.
const FLOOR: f64 = 1e-6;
/// Stretches of the record whose scatter gives the uncertainty.
const STRETCHES: usize = 40;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    reference: ReferenceExperiment::Skewed,
    information: Information::TwoSensors,
    tolerance: 0.05,
    withstands: &[Condition::ColouredNoise, Condition::MissingOutputs, Condition::TwoSensors],
    needs: "a skewed input, an output that is a delayed copy of it, noise of a symmetric distribution",
    blind_to: "the plant's own lag; inputs of a symmetric distribution, random binary ones among them",
    exempt: &[(Law::Exact, LATE)],
    ..method_line!(
        "bispectrum",
        "delay between third-order spectra: blind to symmetric noise, also to noise that both sensors share",
        Bispectrum,
        HigherOrder
    )
};

impl PairMethod for Bispectrum {
    fn check(&self) -> Result<(), DelayError> {
        let Self { segment, max_samples } = *self;
        let rows = [
            ("segment", segment as f64, (8..=256).contains(&segment), "from 8 to 256"),
            ("max_samples", max_samples as f64, max_samples >= 1000, "1000 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let (got, needed) = (pair.experiment.longest(), pair.max_delay + SEGMENTS * self.segment);
        long_enough(NAME, needed, got, LengthRemedy::WindowOr("set a shorter segment"))?;
        // The part is limited by the cap, but never shorter than the window needs.
        let most = self.max_samples.max(needed);
        let cut: Vec<Record> = pair.records.iter().map(|r| r.head(most)).collect();
        let signals = Centred::new(&cut);
        let (skewness, chance) = skewness(&signals);
        if skewness.abs() <= SKEWED * chance {
            let note = format!(
                "the input's skewness {skewness:.2} is within what chance makes of a symmetric one (±{:.2}): no third-order signal",
                SKEWED * chance
            );
            return Err(NoDelay::new(Outcome::NotApplicable, note));
        }
        let found = Third::new(&signals, self.segment, pair.max_delay)
            .peak(pair.max_delay)
            .map_err(|note| NoDelay::new(Outcome::NotVisible, note))?;
        let note = (got > most).then(|| format!("used the first {most} of {got} samples"));
        noted(found.answer(pair), note)
    }
}

/// Skewness of the input, and its standard deviation for a Gaussian signal with the same autocorrelation: √(6·Σρ³/N).
///
/// Source: Lomnicki (1961), Metrika 4, 37-62, doi:10.1007/BF02613866.
fn skewness(signals: &Centred) -> (f64, f64) {
    let all = || signals.records().flat_map(|(u, _)| u.iter());
    let samples = real(all().count().max(1));
    let moment = |power: i32| all().map(|v| v.powi(power)).sum::<f64>() / samples;
    let variance = moment(2).max(f64::MIN_POSITIVE);
    let mut memory = 1.0;
    for lag in 1..200 {
        let product: f64 = signals
            .records()
            .map(|(u, _)| u.iter().zip(u.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>())
            .sum();
        let rho = product / samples / variance;
        if rho.abs() < 2.0 / samples.sqrt() {
            break;
        }
        memory += 2.0 * rho.powi(3).max(0.0);
    }
    (moment(3) / variance.powf(1.5), (6.0 * memory / samples).sqrt())
}

/// Every segment of the records, to be transformed.
struct Segments<'a> {
    records: Vec<(&'a [f64], &'a [f64])>,
    /// Record and first sample of each segment.
    starts: Vec<(usize, usize)>,
    fourier: &'a RealFourier,
    window: Vec<f64>,
    margin: usize,
    reach: usize,
}

impl Segments<'_> {
    /// U under the window, and U and Y around it.
    fn of(&self, (record, start): (usize, usize)) -> [Vec<Complex<f64>>; 3] {
        let (u, y) = self.records[record];
        let windowed = std::iter::repeat_n(0.0, self.margin)
            .chain(self.window.iter().zip(&u[start..]).map(|(w, u)| w * u));
        let around = |x: &[f64]| {
            let zeros = self.margin.saturating_sub(start);
            let first = start.saturating_sub(self.margin);
            self.fourier.spectrum(
                std::iter::repeat_n(0.0, zeros)
                    .chain(x[first..].iter().copied().take(self.reach - zeros)),
            )
        };
        [self.fourier.spectrum(windowed), around(u), around(y)]
    }

    /// The whole circle of a real signal's spectrum, from −length/2 or so on.
    fn circle(&self, x: &[Complex<f64>]) -> Vec<Complex<f64>> {
        let length = self.fourier.length();
        let half = length / 2;
        (0..length).map(|k| if k <= half { x[k] } else { x[length - k].conj() }).collect()
    }

    /// W·conj Buuu at (ω₁, ω₂): ω₁ over the whole circle, ω₂ over its half.
    fn weights(&self) -> Vec<Complex<f64>> {
        let length = self.fourier.length();
        let lines = length / 2 + 1;
        let (mut power_u, mut power_y) = (vec![0.0; lines], vec![0.0; lines]);
        let mut own = vec![Complex::new(0.0, 0.0); length * lines];
        for &start in &self.starts {
            let [windowed, around, y] = self.of(start);
            let whole = self.circle(&windowed);
            for l in 0..lines {
                power_u[l] += windowed[l].norm_sqr();
                power_y[l] += y[l].norm_sqr();
                let row = &mut own[l * length..(l + 1) * length];
                for (k, sum) in row.iter_mut().enumerate() {
                    *sum += whole[k] * whole[(k + l) % length].conj() * around[l];
                }
            }
        }
        let inverse = |power: &[f64]| -> Vec<f64> {
            let largest = power.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            power.iter().map(|p| largest / p.max(FLOOR * largest)).collect()
        };
        let (inverse_u, inverse_y) = (inverse(&power_u), inverse(&power_y));
        let of_u = |k: usize| inverse_u[k.min(length - k)];
        for (l, inverse) in inverse_y.iter().enumerate() {
            for k in 0..length {
                let sum = (k + l) % length;
                own[l * length + k] = own[l * length + k].conj() * (of_u(k) * of_u(sum) * inverse);
            }
        }
        own
    }

    /// T of every segment, as its lines over ω₂.
    fn lines(&self, weights: &[Complex<f64>]) -> Vec<Vec<Complex<f64>>> {
        let length = self.fourier.length();
        let segment = |&start: &(usize, usize)| {
            let [windowed, _, y] = self.of(start);
            let whole = self.circle(&windowed);
            let line = |l: usize| -> Complex<f64> {
                let row = &weights[l * length..(l + 1) * length];
                row.iter()
                    .enumerate()
                    .map(|(k, own)| whole[k] * whole[(k + l) % length].conj() * own)
                    .sum::<Complex<f64>>()
                    * y[l]
            };
            (0..=length / 2).map(line).collect()
        };
        self.starts.iter().map(segment).collect()
    }
}

/// T, as its lines over ω₂, of every segment.
struct Third {
    fourier: RealFourier,
    /// One list of lines per segment, in order.
    segments: Vec<Vec<Complex<f64>>>,
    /// Lags on either side of the window that the segments also cover.
    margin: usize,
}

impl Third {
    fn new(signals: &Centred, segment: usize, max_delay: usize) -> Self {
        let margin = segment / 2;
        let records: Vec<(&[f64], &[f64])> = signals.records().collect();
        // Every segment whose longest delay lies in the record.
        let starts: Vec<(usize, usize)> = (records.iter().enumerate())
            .flat_map(|(r, (u, _))| {
                (0..(u.len() + 1).saturating_sub(segment + max_delay))
                    .step_by(margin.max(1))
                    .map(move |s| (r, s))
            })
            .collect();
        // u under its window, y and the third u from `margin` samples before it to the longest delay behind it.
        let reach = segment + 2 * margin + max_delay;
        let fourier = RealFourier::new(deadtime_signal::fast_length(reach));
        let window: Vec<f64> = (0..segment)
            .map(|t| (std::f64::consts::PI * (t as f64 + 0.5) / segment as f64).sin().powi(2))
            .collect();
        let spectra = Segments { records, starts, fourier: &fourier, window, margin, reach };
        let segments = spectra.lines(&spectra.weights());
        Self { fourier, segments, margin }
    }

    fn interpolant(&self, lines: &[Complex<f64>]) -> Interpolant {
        let length = real(self.fourier.length());
        let last = lines.len() - 1;
        // The last line may be the Nyquist frequency, where a fraction of a sample has no phase.
        Interpolant::new(
            lines[..last]
                .iter()
                .enumerate()
                .map(|(l, a)| (2.0 * std::f64::consts::PI * real(l) / length, *a))
                .collect(),
        )
    }

    /// The largest |T| in the window; a sentence where it is not significant.
    fn peak(&self, max_delay: usize) -> Result<Alike, String> {
        let zero = vec![Complex::new(0.0, 0.0); self.fourier.length() / 2 + 1];
        let add = |mut sum: Vec<Complex<f64>>, lines: &Vec<Complex<f64>>| {
            sum.iter_mut().zip(lines).for_each(|(s, l)| *s += l);
            sum
        };
        let total = self.segments.iter().fold(zero.clone(), add);
        let series = self.fourier.series(total.clone());
        let length = series.len();
        let t = |lag: isize| {
            series[lag.rem_euclid(isize::try_from(length).unwrap_or(1)).unsigned_abs() % length]
        };
        let signed = |lag: usize| isize::try_from(lag).unwrap_or(0);
        let size = |lag: usize| t(signed(lag)).abs();
        let lag = (0..=max_delay)
            .max_by(|&a, &b| size(a).total_cmp(&size(b)).then(b.cmp(&a)))
            .unwrap_or(0);
        let margin = signed(self.margin);
        // The chance level: |T| at lags away from the peak.
        let others: Vec<f64> = (-margin..=signed(max_delay) + margin)
            .filter(|l| l.abs_diff(signed(lag)) > 2)
            .map(&t)
            .collect();
        let chance = stats::rms(others.iter().copied()).unwrap_or(0.0);
        let z = size(lag) / chance.max(f64::MIN_POSITIVE);
        // Neighbouring lags share half of their data.
        let freedom = (0.5 * real(others.len())).max(1.0);
        let limit = students_t(1.0 - 0.005 / real(max_delay + 1), freedom).unwrap_or(f64::INFINITY);
        if z.is_nan() || z < limit {
            return Err(format!(
                "no delay stands out of the third-order statistics ({z:.1} times their scatter, {limit:.1} needed)"
            ));
        }
        let sign = t(signed(lag)).signum();
        let interpolant = self.interpolant(&total);
        let at = interpolant.peak(real(lag), sign);
        let bend = -sign * interpolant.at(at)[2];
        let stretch = self.segments.len().div_ceil(STRETCHES).max(2);
        let slopes: Vec<f64> = self
            .segments
            .chunks(stretch)
            .map(|part| self.interpolant(&part.iter().fold(zero.clone(), add)).at(at)[1])
            .collect();
        let count = real(slopes.len());
        // Neighbouring stretches share a segment's end.
        let shared: f64 = slopes.iter().zip(slopes.iter().skip(1)).map(|(a, b)| 2.0 * a * b).sum();
        let variance =
            (slopes.iter().map(|s| s * s).sum::<f64>() + shared.max(0.0)) * count / (count - 1.0);
        let std = variance.sqrt() / bend;
        let normal = Normal::new(0.0, 1.0).map_err(|e| e.to_string())?;
        let alternatives = (0..=max_delay)
            .filter(|&l| {
                l.abs_diff(lag) > 1 && size(l) >= t(signed(l) - 1).abs() && size(l) > size(l + 1)
            })
            .map(|l| (l, normal.sf((size(lag) - size(l)) / (std::f64::consts::SQRT_2 * chance))))
            .collect();
        let fraction = (bend > 0.0 && std.is_finite()).then_some(at - real(lag));
        let leads = lag == 0 && t(-1).abs() > size(0);
        Ok(Alike { lag, fraction, std, freedom: count - 1.0, alternatives, leads, bent: None })
    }
}

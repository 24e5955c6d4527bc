//! Generalised cross-correlation.

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairRecords, options};
use crate::method::Condition;
use deadtime_identify::Record;
use deadtime_signal::stats;
use deadtime_signal::stats::students_t;
use deadtime_signal::{CrossSpectra, HANN_LINES, RealFourier, correlation};
use nalgebra::Complex;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Conditions under which all weights remain valid.
pub(crate) const WITHSTANDS: &[Condition] =
    &[Condition::ColouredNoise, Condition::MissingOutputs, Condition::TwoSensors];

/// Data that all weights need.
pub(crate) const NEEDS: &str =
    "an output that is a delayed copy of the input, and noise that knows nothing of either";

/// Why no weight gives the delay of a plant with dynamics in samples.
pub(crate) const LATE: &str =
    "a plant's own lag counts as delay: on anything but a delayed copy the answer is late";

/// Samples that input and output must have in common behind the longest delay.
pub(super) const LEAST: usize = 100;

/// Minimum number of non-overlapping segments in a record; fewer do not determine the coherence.
pub(super) const LOOKS: usize = 6;

/// Bounds of the automatic length of a segment.
pub(super) const SEGMENT: [usize; 2] = [16, 1024];

/// The shortest segment that the option allows.
pub(super) const SHORTEST_SEGMENT: usize = 8;

/// A spectrum below this share of its largest line is rounding; the divisors of the weights are bounded by it.
pub(super) const FLOOR: f64 = 1e-10;

/// The second bound, as a multiple of the mean line over the number of samples: record ends leak this share into all frequencies.
pub(super) const ENDS: f64 = 4.0;

/// Upper bound of the coherence of a finite record.
pub(super) const CERTAIN: f64 = 1.0 - 1e-6;

/// Squared coherence from which the variance of a line's phase is defined.
pub(super) const PHASED: f64 = 0.5;

/// Share of lines that must have this coherence: single lines reach it by chance.
pub(super) const JUDGED: f64 = 0.125;

/// Probability that the phases of a pure delayed copy are called bent.
pub(super) const FALSE_ALARM: f64 = 1e-4;

/// Alignments after which the best lag is accepted; further disagreement means two peaks of equal height.
pub(super) const ALIGNMENTS: usize = 4;

/// One frequency, with the data of a weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    /// Frequency, rad per sample.
    pub(crate) omega: f64,
    /// Spectrum of the input.
    pub(crate) uu: f64,
    /// Spectrum of the output.
    pub(crate) yy: f64,
    /// Magnitude of the cross-spectrum.
    pub(crate) cross: f64,
    /// Expected magnitude of the cross-spectrum by chance alone.
    pub(crate) chance: f64,
    /// Squared coherence, corrected for its bias; below 1.
    pub(crate) coherence: f64,
    /// Variance of the cross-spectrum's real and of its imaginary part in one look.
    pub(crate) noise: f64,
    /// Its multiplicity on the whole circle: twice, once at frequency 0, and never at the Nyquist frequency.
    pub(crate) times: f64,
}

/// The records of one pair, centred and scaled.
pub(crate) struct Centred(Vec<(Vec<f64>, Vec<f64>)>);

impl Centred {
    /// Removes the means (of the measured outputs; the missing ones are zero) and scales the largest value of each channel to 1.
    pub(crate) fn new(records: &[Record]) -> Self {
        let there = |r: &Record, t: usize| r.present.as_ref().is_none_or(|p| p[t]);
        let largest = |values: &mut dyn Iterator<Item = f64>| {
            values.map(f64::abs).fold(f64::MIN_POSITIVE, f64::max)
        };
        let scale_u = largest(&mut records.iter().flat_map(|r| r.u.iter().copied()));
        let scale_y = largest(&mut records.iter().flat_map(|r| r.y.iter().copied()));
        let centred = |values: &[f64], scale: f64, there: &dyn Fn(usize) -> bool| -> Vec<f64> {
            let present =
                || values.iter().enumerate().filter(|(t, _)| there(*t)).map(|(_, v)| v / scale);
            let mean = stats::mean(present()).unwrap_or(0.0);
            values
                .iter()
                .enumerate()
                .map(|(t, v)| if there(t) { v / scale - mean } else { 0.0 })
                .collect()
        };
        Self(
            records
                .iter()
                .map(|r| {
                    (centred(&r.u, scale_u, &|_| true), centred(&r.y, scale_y, &|t| there(r, t)))
                })
                .collect(),
        )
    }

    pub(crate) fn records(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        self.0.iter().map(|(u, y)| (&u[..], &y[..]))
    }

    /// Mean products at every lag of `from ..= to`.
    fn products(&self, from: isize, to: isize) -> Vec<f64> {
        let samples: usize = self.0.iter().map(|(u, _)| u.len()).sum();
        let mut sums = vec![0.0; to.abs_diff(from) + 1];
        for (u, y) in self.records() {
            for (sum, r) in sums.iter_mut().zip(correlation(u, y, from..=to)) {
                *sum += r / real(samples);
            }
        }
        sums
    }

    /// Averaged spectra with y moved back by `lag` samples.
    pub(crate) fn aligned(&self, lag: usize, segment: usize) -> CrossSpectra {
        let pairs = self
            .records()
            .filter_map(|(u, y)| Some((u.get(..u.len().checked_sub(lag)?)?, y.get(lag..)?)));
        CrossSpectra::welch(pairs, segment)
    }
}

/// The segment length in use; 0 selects it automatically.
pub(crate) fn segment_length(asked: usize, longest: usize, max_delay: usize) -> usize {
    if asked > 0 {
        return asked;
    }
    let [least, most] = SEGMENT;
    let fits = (longest.saturating_sub(max_delay) / LOOKS).max(1);
    (1 << fits.ilog2()).clamp(least, most)
}

/// Refuses a segment that is too short.
pub(crate) fn check(method: &'static str, segment: usize) -> Result<(), DelayError> {
    let ok = segment == 0 || segment >= SHORTEST_SEGMENT;
    options(method, [("segment", segment as f64, ok, "0 (automatic) or 8 and more")])
}

/// The segment length in use. Errors: records in which no delay is visible.
pub(crate) fn segment_of(
    method: &'static str,
    segment: usize,
    pair: &PairRecords,
) -> Result<usize, NoDelay> {
    pair.at_least(method, pair.max_delay + LEAST.max(segment), LengthRemedy::Window)?;
    pair.visible()?;
    Ok(segment_length(segment, pair.experiment.longest(), pair.max_delay))
}

/// Estimates at every frequency of the averaged spectra.
pub(crate) fn lines(spectra: &CrossSpectra) -> Vec<Line> {
    let looks = spectra.looks * HANN_LINES;
    let largest =
        |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let ends = ENDS / (spectra.looks * real(spectra.segment)).max(ENDS);
    let floor = |values: &[f64]| {
        let mean = stats::mean(values.iter().copied()).unwrap_or(0.0);
        (ends * mean).max(FLOOR * largest(&mut values.iter().copied()))
    };
    let (floor_u, floor_y) = (floor(&spectra.uu), floor(&spectra.yy));
    let floor_cross = (floor_u * floor_y).sqrt();
    let of = |(k, seen): (usize, f64)| {
        let (uu, yy, cross) = (
            spectra.uu[k].max(floor_u),
            spectra.yy[k].max(floor_y),
            spectra.uy[k].norm().max(floor_cross),
        );
        // Without coherence the average of few looks is (1 − γ²)/looks; the remainder 1 − γ² is too small by as much.
        let (coherence, rest) = if looks > 1.0 {
            (seen - (1.0 - seen) / (looks - 1.0), ((1.0 - seen) * looks / (looks - 1.0)).min(1.0))
        } else {
            (0.0, 1.0)
        };
        let noise = 0.5 * uu * yy * rest.max(1.0 - CERTAIN);
        let chance = (uu * yy / looks.max(1.0)).sqrt();
        let times = match k {
            0 => 1.0,
            // Hann's window contains both sides of the Nyquist frequency, where a fractional delay gives their phases opposite signs.
            _ if 2 * (k + 1) >= spectra.segment => 0.0,
            _ => 2.0,
        };
        Line {
            omega: spectra.omega(k),
            uu,
            yy,
            cross,
            chance,
            coherence: coherence.clamp(0.0, CERTAIN),
            noise,
            times,
        }
    };
    spectra.coherence().into_iter().enumerate().map(of).collect()
}

/// R(τ) = Σ Re(a·exp(iωτ)), a band-limited function of any lag: (ω, a) of every line.
pub(crate) struct Interpolant(Vec<(f64, Complex<f64>)>);

impl Interpolant {
    pub(crate) fn new(terms: Vec<(f64, Complex<f64>)>) -> Self {
        Self(terms)
    }

    /// The value, and the first and second derivative.
    pub(crate) fn at(&self, lag: f64) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (omega, amplitude) in &self.0 {
            let turned = amplitude * Complex::from_polar(1.0, omega * lag);
            sums[0] += turned.re;
            sums[1] -= omega * turned.im;
            sums[2] -= omega * omega * turned.re;
        }
        sums
    }

    /// The maximum of sign·R within one sample of `near`: Newton's steps, with bisection where a step leaves the bracket.
    pub(crate) fn peak(&self, near: f64, sign: f64) -> f64 {
        let grid = |i: i32| near + f64::from(i) / 8.0;
        let value = |i: i32| sign * self.at(grid(i))[0];
        let best = (-8..=8)
            .max_by(|&a, &b| value(a).total_cmp(&value(b)).then(b.abs().cmp(&a.abs())))
            .unwrap_or(0);
        let (mut low, mut high) = (grid((best - 1).max(-8)), grid((best + 1).min(8)));
        let mut at = grid(best);
        // Each step squares the error or halves the bracket: 60 reach rounding.
        for _ in 0..60 {
            let [_, first, second] = self.at(at);
            if sign * first > 0.0 {
                low = at
            } else {
                high = at
            }
            let newton = at - first / second;
            let next = if sign * second < 0.0 && newton > low && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            if (next - at).abs() < 1e-14 {
                return next;
            }
            at = next;
        }
        at
    }
}

/// The delay of a pair by the maximum of the correlation with these weights.
pub(crate) fn generalised(
    method: &'static str,
    segment: usize,
    weight: fn(&Line) -> f64,
    pair: &PairRecords,
) -> Result<DelayEstimate, NoDelay> {
    let segment = segment_of(method, segment, pair)?;
    alike(&Centred::new(pair.records), segment, weight, pair.max_delay).0.answer(pair)
}

/// The lag at which two signals are most similar.
#[derive(Debug, Clone, Default)]
pub(crate) struct Alike {
    /// Whole samples.
    pub(crate) lag: usize,
    /// Fraction added to the lag; `None` where R has no curvature.
    pub(crate) fraction: Option<f64>,
    /// Standard deviation of the fraction.
    pub(crate) std: f64,
    /// Degrees of freedom of that standard deviation.
    pub(crate) freedom: f64,
    /// Other lags that may be the true one, and their probability relative to this lag.
    pub(crate) alternatives: Vec<(usize, f64)>,
    /// The correlation |R| is larger at a lag where the output leads.
    pub(crate) leads: bool,
    /// Standard deviation of the delays at single frequencies, where they differ significantly: the output is no delayed copy.
    pub(crate) bent: Option<f64>,
}

/// The spectra of the last alignment.
pub(crate) struct LastAlignment {
    /// Spectra, y moved back by the whole lag.
    pub(crate) spectra: CrossSpectra,
    /// The estimates at every frequency of the spectra.
    pub(crate) lines: Vec<Line>,
    /// Sign of the gain.
    pub(crate) sign: f64,
}

/// R at every lag under the weights of the last alignment.
struct Aligned {
    lag: usize,
    spectra: CrossSpectra,
    lines: Vec<Line>,
    weights: Vec<f64>,
    /// R from lag −1 on.
    filtered: Vec<f64>,
}

/// The lag of the largest |R|; y is moved back by the best lag so far until the lag no longer changes.
fn aligned(
    signals: &Centred,
    segment: usize,
    weight: fn(&Line) -> f64,
    max_delay: usize,
) -> Option<Aligned> {
    let reach = segment / 2;
    let margin = isize::try_from(reach).unwrap_or(0) + 1;
    let products = signals.products(
        -margin,
        isize::try_from(max_delay).unwrap_or(isize::MAX / 2).saturating_add(margin),
    );
    // products[margin + lag]
    let centre = reach + 1;
    let largest = |r: &[f64]| {
        (0..=max_delay)
            .max_by(|&a, &b| r[a + 1].abs().total_cmp(&r[b + 1].abs()).then(b.cmp(&a)))
            .unwrap_or(0)
    };
    let mut lag = largest(&products[centre - 1..=centre + max_delay + 1]);
    let mut aligned = None;
    for _ in 0..ALIGNMENTS {
        let spectra = signals.aligned(lag, segment);
        let lines = lines(&spectra);
        let weights: Vec<f64> =
            lines.iter().map(|line| if line.times > 0.0 { weight(line) } else { 0.0 }).collect();
        // The weights as a filter of the lags from −segment/2 to segment/2; the two ends share one lag.
        let filter = RealFourier::new(segment)
            .series(weights.iter().map(|w| Complex::new(*w, 0.0)).collect());
        let tap = |j: isize| {
            let even = segment.is_multiple_of(2) && j.unsigned_abs() == reach;
            filter[j.rem_euclid(isize::try_from(segment).unwrap_or(1)).unsigned_abs()]
                * if even { 0.5 } else { 1.0 }
        };
        let taps: Vec<f64> = (-(margin - 1)..margin).map(tap).collect();
        let filtered: Vec<f64> = (0..=max_delay + 2)
            .map(|i| taps.iter().rev().zip(&products[i..]).map(|(h, r)| h * r).sum())
            .collect();
        let next = largest(&filtered);
        aligned = Some(Aligned { lag, spectra, lines, weights, filtered });
        if next == lag {
            break;
        }
        lag = next;
    }
    // Without a fixed point, the best lag of the last alignment is used.
    aligned.map(|a| Aligned { lag, ..a })
}

/// The lag of the largest |R| in the window.
pub(crate) fn alike(
    signals: &Centred,
    segment: usize,
    weight: fn(&Line) -> f64,
    max_delay: usize,
) -> (Alike, Option<LastAlignment>) {
    let Some(aligned) = aligned(signals, segment, weight, max_delay) else {
        return (Alike::default(), None);
    };
    let Aligned { lag, spectra, lines, weights, filtered } = aligned;
    let here = filtered[lag + 1];
    let sign = if here < 0.0 { -1.0 } else { 1.0 };
    let terms = spectra
        .uy
        .iter()
        .zip(&lines)
        .zip(&weights)
        .map(|((s, line), weight)| (line.omega, s * (line.times * weight)));
    let interpolant = Interpolant::new(terms.collect());
    let at = interpolant.peak(0.0, sign);
    let bend = -sign * interpolant.at(at)[2];
    let (mut by_noise, mut by_phase) = (0.0, 0.0);
    for ((s, line), weight) in spectra.uy.iter().zip(&lines).zip(&weights) {
        let share = (line.times * weight * line.omega).powi(2);
        by_noise += share * line.noise / spectra.looks;
        by_phase += share * HANN_LINES * (s * Complex::from_polar(1.0, line.omega * at)).im.powi(2);
    }
    let std = by_noise.max(by_phase).sqrt() / bend;
    let alternatives = alternatives(&filtered, lag, &lines, &weights, &spectra);
    let fraction = (bend > 0.0 && std.is_finite()).then_some(at);
    let leads = lag == 0 && filtered[0].abs() > here.abs();
    let bent = bent(&spectra, &lines, &weights, at, sign);
    (
        Alike {
            lag,
            fraction,
            std,
            freedom: independent_lines(&spectra),
            alternatives,
            leads,
            bent,
        },
        Some(LastAlignment { spectra, lines, sign }),
    )
}

/// Tests whether the residual phases after a delay of `at` samples exceed chance. Returns the spread of the delays at single frequencies if they do.
///
/// The phase variance is noise/|Ĝuy|² over the looks of a line. Σ phase²/variance is chi-squared.
pub(super) fn bent(
    spectra: &CrossSpectra,
    lines: &[Line],
    weights: &[f64],
    at: f64,
    sign: f64,
) -> Option<f64> {
    let looks = spectra.looks * HANN_LINES;
    let (mut misfit, mut count, mut square, mut total) = (0.0, 0.0, 0.0, 0.0);
    for ((s, line), weight) in spectra.uy.iter().zip(lines).zip(weights) {
        if line.times < 2.0 || line.coherence < PHASED {
            continue;
        }
        let phase = (s * Complex::from_polar(sign, line.omega * at)).arg();
        misfit += phase * phase * looks * line.cross * line.cross / line.noise;
        count += 1.0;
        let share = weight * line.cross * line.omega * line.omega;
        square += share * (phase / line.omega).powi(2);
        total += share;
    }
    let freedom = count / HANN_LINES;
    let limit = ChiSquared::new(freedom.max(1.0))
        .map_or(f64::INFINITY, |c| c.inverse_cdf(1.0 - FALSE_ALARM));
    (count >= JUDGED * real(lines.len()) && total > 0.0 && misfit / HANN_LINES > limit)
        .then(|| (square / total).sqrt())
}

/// Mutually independent lines of Hann's window: the degrees of freedom of the phases' scatter.
pub(crate) fn independent_lines(spectra: &CrossSpectra) -> f64 {
    real(spectra.segment) / 2.0 / HANN_LINES
}

/// Other local maxima of |R|, each with the probability that noise alone lowered it below the largest.
///
/// Source: after Ianniello (1982), IEEE Trans. Acoust. Speech Signal Process. 30(6), 998-1003, doi:10.1109/TASSP.1982.1163992, who counts peaks of equal
/// height. Here each peak is weighted with its own height.
pub(super) fn alternatives(
    filtered: &[f64],
    lag: usize,
    lines: &[Line],
    weights: &[f64],
    spectra: &CrossSpectra,
) -> Vec<(usize, f64)> {
    let Ok(normal) = Normal::new(0.0, 1.0) else { return Vec::new() };
    let r = |l: usize| filtered[l + 1].abs();
    let peaks = (0..filtered.len() - 2).filter(|&l| {
        l != lag && r(l) > 0.0 && r(l) >= filtered[l].abs() && r(l) > filtered[l + 2].abs()
    });
    let probable = |l: usize| {
        let opposite = filtered[l + 1] * filtered[lag + 1] < 0.0;
        // Variance of R(lag) ∓ R(l), with the noise common to both removed.
        let variance: f64 = (lines.iter().zip(weights))
            .map(|(line, weight)| {
                let half = 0.5 * line.omega * (real(l) - real(lag));
                let apart = if opposite { half.cos() } else { half.sin() };
                4.0 * (line.times * weight * apart).powi(2) * line.noise
            })
            .sum::<f64>()
            / spectra.looks
            / real(spectra.segment).powi(2);
        let z = (r(lag) - r(l)).max(0.0) / variance.max(f64::MIN_POSITIVE).sqrt();
        normal.sf(z)
    };
    peaks.map(|l| (l, probable(l))).collect()
}

impl Alike {
    /// The estimate of a method.
    pub(crate) fn answer(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        if self.leads {
            let note = "the two are most alike where the output leads the input: swap them, or look for feedback";
            return Err(NoDelay::new(Outcome::NotApplicable, note));
        }
        let Some(fraction) = self.fraction else {
            let note = "the correlation has no peak: the input is almost constant where the output can answer";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        let raw = real(self.lag) + fraction;
        let std = self.std.hypot(self.bent.unwrap_or(0.0));
        let total: f64 = 1.0 + self.alternatives.iter().map(|(_, p)| p).sum::<f64>();
        let spread: f64 =
            self.alternatives.iter().map(|(l, p)| p / total * (real(*l) - raw).powi(2)).sum();
        let quantile = students_t(0.975, self.freedom.max(1.0)).unwrap_or(f64::INFINITY);
        let also = self.probable_alternatives(total);
        // An unrefined peak is uncertain by half a sample.
        let ends = also.iter().fold([raw - quantile * std, raw + quantile * std], |ends, l| {
            [ends[0].min(real(*l) - 0.5), ends[1].max(real(*l) + 0.5)]
        });
        if ends[1] - ends[0] > 0.5 * real(pair.max_delay) {
            let note = format!("peaks at {} other delays are as high within the noise", also.len());
            return Err(NoDelay::new(Outcome::Flat, note));
        }
        // The precision of an exact copy is bounded by rounding.
        let std = (std.powi(2) + spread).sqrt().max(ROUNDING);
        let ends = [ends[0].min(raw - ROUNDING), ends[1].max(raw + ROUNDING)];
        let estimate = pair.counted_at(raw, std, ends, self.lag == pair.max_delay);
        let estimate = estimate.contradicted(self.bent.map(|spread| {
            format!("frequencies differ in their delay by {spread:.2} samples: the output is no delayed copy, and the plant's own lag counts as delay")
        }));
        Ok(estimate.noting((!also.is_empty()).then(|| {
            format!("the interval holds {} other peaks that noise may have lowered", also.len())
        })))
    }

    /// The other peaks within 95 % of the probability, the most probable first.
    fn probable_alternatives(&self, total: f64) -> Vec<usize> {
        let (mut mass, mut by_height) = (1.0 / total, self.alternatives.clone());
        by_height.sort_by(|a, b| b.1.total_cmp(&a.1));
        let within = |(_, p): &&(usize, f64)| {
            let more = mass < 0.95;
            mass += p / total;
            more
        };
        by_height.iter().take_while(within).map(|(l, _)| *l).collect()
    }
}

/// Samples below which a delay is rounding.
pub(super) const ROUNDING: f64 = 1e-9;

pub(crate) fn real(i: usize) -> f64 {
    i as f64
}

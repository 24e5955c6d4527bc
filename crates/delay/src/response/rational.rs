//! The delay fitted together with poles and zeros; Schwarz's criterion weights the numbers of poles and zeros.
//!
//! Equation: (τ̂, Â, B̂) = argmin Σ |H(iωₖ) − e^(−iωₖτ)·B(iωₖ)/A(iωₖ)|²/σₖ² for each number of poles n and of zeros m ≤ n. Each minimum has the weight
//! V^(−N)·N^(−p/2) of Schwarz's criterion, V the mean square residual, N real numbers, p parameters.

use nalgebra::Complex;
use statrs::distribution::{ContinuousCDF, Normal};

use super::estimator::{ResponseEstimator, ResponseMethod, ResponseSearch, ends};
use super::fraction::{FittedFraction, Orders, Points, zeros};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::options;
use crate::method::Class;
use crate::posterior;
use deadtime_log::{FrequencyResponse, Quality};
use deadtime_signal::parallel;
use deadtime_signal::registry::entry;

/// Inputs: H(iω) at N frequencies, of a continuous plant, with its coherence or standard deviations if known. Output: seconds. The half sample of a hold, where H is that of a sampled
/// plant behind one, is part of the delay.
///
/// Assumes: a stable plant (an integrator is on the edge and allowed) of at most `max_poles` poles and as many zeros. Errors of H that are equal, proportional
/// to H, or given by coherence or standard deviations. Without given errors the first two are both tested and weighted.
/// Resolution and cost: a fraction of the highest frequency's period, down to the Cramér-Rao bound; about 1000 small least-squares problems.
/// Interval: the 95 % of all minima of all orders, weighted by Schwarz's criterion. A pole beyond the last frequency is an alias of a longer delay, and so are
/// delays one turn apart. The interval holds all such aliases. Errors correlated over frequency (windowed spectra) count as fewer.
/// Fails when: the plant is unstable, or has more poles than allowed (contradicted: the residual is smooth). In a very narrow band any lag is a delay (`flat`).
/// A zero in the right half-plane beyond the last frequency is indistinguishable from a delay; inside the band it is found and reported.
/// Source: Sanathanan and Koerner (1963), doi:10.1109/TAC.1963.1105517, for poles and zeros at a given delay. Pintelon and Van Biesen (1990), IEEE Trans.
/// Instrum. Meas. 39(6), 932-938, doi:10.1109/19.65798, for the delay as a parameter of the same fit. Schwarz (1978), doi:10.1214/aos/1176344136, for the
/// weights.
///
/// # Example
/// ```
/// use deadtime_delay::{Rational, ResponseEstimator, ResponseSearch};
/// use deadtime_log::{FrequencyResponse, Quality};
/// use nalgebra::Complex;
/// let omega: Vec<f64> = (0..60).map(|k| 0.1 * 10.0_f64.powf(f64::from(k) / 25.0)).collect();
/// let plant = |w: &f64| Complex::cis(-0.43 * w) * 2.0 / Complex::new(1.0, 0.8 * w);
/// let values = omega.iter().map(plant).collect();
/// let response = FrequencyResponse::new("sweep", omega, values, Quality::Unknown)?;
/// let search = ResponseSearch { max_delay_s: 2.0, stop: Default::default() };
/// let answer = Rational::default().estimate(&response, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.43).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Rational {
    /// Largest number of poles tested; default 6, at most 10.
    pub max_poles: usize,
}

impl Default for Rational {
    fn default() -> Self {
        Self { max_poles: 6 }
    }
}

/// Its line in the list.
pub(super) const METHOD: ResponseMethod = ResponseMethod {
    entry: entry!(
        "rational",
        "poles, zeros and a delay fitted together, their numbers weighed",
        Rational,
        dyn ResponseEstimator
    ),
    class: Class::Process,
    needs: "a stable plant, frequencies on both sides of its poles, at least one turn's tenth of delay at the last",
    blind_to: "zeros in the right half-plane and poles beyond the last frequency: they look like delay and lag",
};

/// Delays tested per period of the highest frequency.
const STEPS: f64 = 4.0;
/// Number of frequencies that suffices for a scan over delays.
const SCANNED: usize = 300;
/// Upper bound of the option `max_poles`.
const MOST: usize = 10;
/// A minimum below this weight, relative to the best, is left out.
const LIGHT: f64 = 1e-6;
/// Increase of the delay's standard deviation from which further poles and zeros are undetermined.
const VAGUE: f64 = 3.0;
/// Correlation of neighbouring residuals from which the plant has another shape.
const SMOOTH: f64 = 0.6;

/// A minimum with its weighting and its criterion.
struct Minimum {
    fitted: FittedFraction,
    weighting: usize,
    /// Standard deviation of the delay.
    std: f64,
    criterion: f64,
}

impl ResponseEstimator for Rational {
    fn estimate(
        &self,
        response: &FrequencyResponse,
        search: &ResponseSearch,
    ) -> Result<DelayEstimate, DelayError> {
        let allowed = self.max_poles <= MOST;
        options("rational", [("max_poles", self.max_poles as f64, allowed, "10 or less")])?;
        let (first, last) = ends(response);
        let unit = (first * last).sqrt();
        let weightings = weightings(response, unit);
        let numbers = 2.0 * response.omega_rad_s().len() as f64;
        // At least twice as many numbers as parameters.
        let poles = self.max_poles.min(((0.5 * numbers - 2.0) / 2.0).max(0.0) as usize);
        let asked = Asked { response, search, unit, poles };
        let delays = asked.delays(last);
        let fits = asked.fits(&weightings, &delays, last / unit);
        if search.stop.is_set() {
            return Err(DelayError::Stopped);
        }
        let mut all = weighed(&weightings, fits, numbers, 1.0);
        let share = all.first().map_or(1.0, |best| independent(&weightings, best));
        if share < 1.0 {
            let fits = all.into_iter().map(|c| (c.weighting, c.fitted)).collect();
            all = weighed(&weightings, fits, numbers, share);
        }
        let minima = undominated(all);
        let best = minima.first().and_then(|best| Some((best, weightings.get(best.weighting)?)));
        let Some((best, points)) = best else {
            let note = "no model of any order can be fitted to these numbers";
            return Ok(DelayEstimate::without(Outcome::Singular, note));
        };
        let gain =
            numbers * share * (points.power() / best.fitted.cost.max(f64::MIN_POSITIVE)).ln();
        let parameters = best.fitted.coefficients.len();
        // A pair of poles may converge to any frequency, which adds to the number of tests.
        let tries = (0..best.fitted.resonances())
            .fold(delays.len(), |tries, _| tries.saturating_mul(response.omega_rad_s().len()));
        if gain < posterior::visible_gain(parameters, tries) {
            let note =
                format!("no model explains the response better than chance (gain {gain:.1})");
            return Ok(DelayEstimate::without(Outcome::NotVisible, note));
        }
        Ok(asked.answer(best, &minima, points))
    }
}

/// The data and limits of a fit.
struct Asked<'a> {
    response: &'a FrequencyResponse,
    search: &'a ResponseSearch,
    /// The angular frequency used as the unit.
    unit: f64,
    /// Largest number of poles.
    poles: usize,
}

impl Asked<'_> {
    /// The delays of a scan, in units of time.
    fn delays(&self, last: f64) -> Vec<f64> {
        let longest = self.search.max_delay_s * self.unit;
        let turns = self.search.max_delay_s * last * STEPS / std::f64::consts::TAU;
        let steps = turns.ceil().max(8.0) as usize;
        (0..=steps).map(|k| longest * k as f64 / steps as f64).collect()
    }

    /// The minima of every order under every weighting; `end` is the last frequency.
    fn fits(
        &self,
        weightings: &[Points],
        delays: &[f64],
        end: f64,
    ) -> Vec<(usize, FittedFraction)> {
        let stride = stride(self.response, self.search);
        let most = self.poles;
        let orders: Vec<(usize, Orders)> = (0..weightings.len())
            .flat_map(|w| (0..=most).map(move |poles| (w, poles)))
            .flat_map(|(w, poles)| (0..=poles).map(move |zeros| (w, Orders { poles, zeros })))
            .collect();
        // Beyond the band a zero in the right half-plane acts as a delay, and is counted as one.
        let beyond = |f: &FittedFraction| zeros(f).iter().any(|z| z.re > 0.0 && z.norm() > end);
        let minima = parallel::map(orders, |(w, orders)| {
            let mut found = weightings.get(w).map_or_else(Vec::new, |points| {
                points.minima(&points.thinned(stride), orders, delays, &self.search.stop)
            });
            found.retain(|f| !beyond(f));
            found.into_iter().map(|f| (w, f)).collect::<Vec<_>>()
        });
        minima.into_iter().flatten().collect()
    }

    /// The estimate of the best of all minima.
    fn answer(&self, best: &Minimum, minima: &[Minimum], points: &Points) -> DelayEstimate {
        let Self { response, search, unit, poles } = *self;
        let delay = best.fitted.delay / unit;
        let ends =
            mixture(minima, best.criterion).map(|v| (v / unit).clamp(0.0, search.max_delay_s));
        let ends = [ends[0].min(delay), ends[1].max(delay)];
        let mut notes = vec![orders_note(best.fitted.orders)];
        notes.extend(turned_note(&best.fitted, unit));
        notes.extend(others_note(best, minima, unit));
        if let Quality::Std(_) = response.quality() {
            let freedom = 2.0 * points.x.len() as f64 - best.fitted.coefficients.len() as f64 - 1.0;
            let times = (best.fitted.cost / freedom.max(1.0)).sqrt();
            if times > 2.0 {
                notes.push(format!(
                    "the residual is {times:.1} times the given standard deviations"
                ));
            }
        }
        let notes = notes.join("; ");
        if ends[1] - ends[0] > 0.5 * search.max_delay_s {
            let [from, to] = ends;
            let note = format!("delays from {from:.4} to {to:.4} s fit about alike; {notes}");
            return DelayEstimate::without(Outcome::Flat, note);
        }
        let at_edge = delay >= search.max_delay_s * (1.0 - 1e-6);
        let std = (delay - ends[0]).max(ends[1] - delay) / deadtime_signal::stats::NORMAL_95;
        let estimate = DelayEstimate::in_seconds(delay, std, ends, at_edge).noting(Some(notes));
        let left = points.left(&best.fitted);
        let exact = best.fitted.cost <= 1e-16 * points.power();
        let smooth = !exact && best.fitted.orders.poles == poles && alike(&left) > SMOOTH;
        estimate.contradicted(
            smooth.then(|| {
                "what the model leaves over is smooth over frequency: a plant of more poles (max_poles), or an unstable one".to_owned()
            }),
        )
    }
}

fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

fn orders_note(Orders { poles, zeros }: Orders) -> String {
    format!("{poles} pole{} and {zeros} zero{}", plural(poles), plural(zeros))
}

/// The note on the phase of (1 − s/z)/(1 + s/z) at low frequencies.
fn turned_note(fitted: &FittedFraction, unit: f64) -> Option<String> {
    let right: Vec<f64> = zeros(fitted)
        .into_iter()
        .filter(|z| z.re > 1e-9 * z.norm())
        .map(|z| 2.0 * z.re / (z.norm_sqr() * unit))
        .collect();
    let (lag, count): (f64, usize) = (right.iter().sum(), right.len());
    let (turn, are) = if count == 1 { ("turns", "is") } else { ("turn", "are") };
    (count > 0).then(|| {
        format!(
            "{count} zero{} in the right half-plane {turn} the phase like another {lag:.4} s at low frequencies and {are} no part of the delay",
            plural(count)
        )
    })
}

/// The note on delays that fit nearly as well with other numbers of poles and zeros.
fn others_note(best: &Minimum, minima: &[Minimum], unit: f64) -> Option<String> {
    let apart = || {
        let near = minima.iter().filter(|c| {
            (c.criterion - best.criterion) < 6.0
                && (c.fitted.delay - best.fitted.delay).abs() > 4.0 * (c.std + best.std).max(1e-9)
        });
        near.map(|c| c.fitted.delay / unit)
    };
    let (from, to) = (apart().reduce(f64::min)?, apart().reduce(f64::max)?);
    let range = if from == to { format!("{from:.4} s") } else { format!("{from:.4} to {to:.4} s") };
    Some(format!(
        "with other numbers of poles and zeros, or a turn more or less, {range} fit nearly as well"
    ))
}

/// The stride between the frequencies of a scan, without aliases among the delays of the window.
fn stride(response: &FrequencyResponse, search: &ResponseSearch) -> usize {
    let wanted = response.omega_rad_s().len() / SCANNED;
    let allowed = (response.unambiguous_s() / (2.0 * search.max_delay_s)).min(1e9) as usize;
    wanted.min(allowed).max(1)
}

/// The points with each weighting that the given quality allows.
fn weightings(response: &FrequencyResponse, unit: f64) -> Vec<Points> {
    let x: Vec<f64> = response.omega_rad_s().iter().map(|w| w / unit).collect();
    let h = response.values().to_vec();
    let magnitudes = smoothed(&h);
    let points = |w: Vec<f64>| Points { x: x.clone(), h: h.clone(), w };
    match response.quality() {
        Quality::Unknown => {
            let largest = magnitudes.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            vec![
                points(magnitudes.iter().map(|m| largest / m).collect()),
                points(vec![1.0; x.len()]),
            ]
        }
        Quality::Coherence(coherence) => {
            let weight = |(c, m): (&f64, &f64)| {
                let c = c.clamp(1e-6, 1.0 - 1e-6);
                (c / (1.0 - c)).sqrt() / m
            };
            vec![points(coherence.iter().zip(&magnitudes).map(weight).collect())]
        }
        Quality::Std(std) => vec![points(std.iter().map(|s| 1.0 / s).collect())],
    }
}

/// Magnitudes, each the median of three neighbours: a weight must not follow the noise of its own point.
fn smoothed(h: &[Complex<f64>]) -> Vec<f64> {
    let m: Vec<f64> = h.iter().map(|h| h.norm()).collect();
    let at = |i: usize| m.get(i).copied().unwrap_or(f64::NAN);
    (0..m.len())
        .map(|i| {
            let mut three = [at(i.saturating_sub(1)), at(i), at((i + 1).min(m.len() - 1))];
            three.sort_by(f64::total_cmp);
            three[1]
        })
        .collect()
}

/// The minima by their criterion, the best first; `share` of the residuals are independent.
fn weighed(
    weightings: &[Points],
    fits: Vec<(usize, FittedFraction)>,
    numbers: f64,
    share: f64,
) -> Vec<Minimum> {
    let logs: Vec<f64> =
        weightings.iter().map(|p| p.w.iter().map(|w| w.ln()).sum::<f64>()).collect();
    let floors: Vec<f64> = weightings.iter().map(|p| posterior::ROUNDING * p.power()).collect();
    let minimum = |(weighting, fitted): (usize, FittedFraction)| {
        let (log, floor) = (logs.get(weighting)?, floors.get(weighting)?);
        let cost = fitted.cost.max(*floor).max(f64::MIN_POSITIVE);
        let parameters = fitted.coefficients.len() as f64 + 1.0;
        let freedom = (numbers - parameters).max(1.0);
        // Two real numbers for each weight. Each pair of complex poles is the best of as many positions as there are frequencies.
        let tries = 2.0 * fitted.resonances() as f64 * (0.5 * numbers).ln();
        let criterion = share * (numbers * (cost / numbers).ln() - 4.0 * log)
            + parameters * (share * numbers).ln()
            + tries;
        let std = (cost / freedom / share * fitted.variance).sqrt().max(1e-9);
        (criterion.is_finite() && std.is_finite()).then_some(Minimum {
            fitted,
            weighting,
            std,
            criterion,
        })
    };
    let mut all: Vec<Minimum> = fits.into_iter().filter_map(minimum).collect();
    all.sort_by(|a, b| a.criterion.total_cmp(&b.criterion));
    all
}

/// Drops models with a less certain delay than a simpler, more probable nested model: the data do not determine their further poles and zeros.
fn undominated(all: Vec<Minimum>) -> Vec<Minimum> {
    let contains = |c: &Minimum, simpler: &Minimum| {
        let (o, s) = (c.fitted.orders, simpler.fitted.orders);
        c.weighting == simpler.weighting && o != s && o.poles >= s.poles && o.zeros >= s.zeros
    };
    let mut kept: Vec<Minimum> = Vec::with_capacity(all.len());
    // The more probable come first, so that a dominating model is kept earlier.
    for minimum in all {
        if !kept.iter().any(|k| contains(&minimum, k) && minimum.std > VAGUE * k.std) {
            kept.push(minimum);
        }
    }
    kept
}

/// The share of the residuals that is independent of their neighbours.
fn independent(weightings: &[Points], best: &Minimum) -> f64 {
    let Some(points) = weightings.get(best.weighting) else { return 1.0 };
    if best.fitted.cost <= 1e-16 * points.power() {
        return 1.0;
    }
    let left = points.left(&best.fitted);
    let power: f64 = left.iter().map(|e| e.norm_sqr()).sum();
    let count = left.len() as f64;
    let mut sum = 0.0;
    for lag in 1..(left.len() / 4).max(1) {
        let rho =
            left.iter().zip(left.iter().skip(lag)).map(|(a, b)| (a.conj() * b).re).sum::<f64>()
                / power;
        // A correlation within its standard error counts as zero.
        if rho.is_nan() || rho <= 1.0 / count.sqrt() {
            break;
        }
        sum += rho;
    }
    1.0 / (1.0 + 2.0 * sum)
}

/// The correlation of neighbouring residuals.
fn alike(left: &[Complex<f64>]) -> f64 {
    let power: f64 = left.iter().map(|e| e.norm_sqr()).sum();
    left.iter().zip(left.iter().skip(1)).map(|(a, b)| (a.conj() * b).re).sum::<f64>()
        / power.max(f64::MIN_POSITIVE)
}

/// The ends that leave 2.5 % of the weighted normal distributions on each side.
fn mixture(minima: &[Minimum], best: f64) -> [f64; 2] {
    let all: Vec<(f64, f64, f64)> = minima
        .iter()
        .map(|c| ((-0.5 * (c.criterion - best)).exp(), c.fitted.delay, c.std))
        .filter(|(w, ..)| *w > LIGHT)
        .collect();
    let total: f64 = all.iter().map(|(w, ..)| w).sum();
    let Ok(unit) = Normal::new(0.0, 1.0) else { return [0.0, f64::INFINITY] };
    let below =
        |v: f64| all.iter().map(|(w, at, std)| w * unit.cdf((v - at) / std)).sum::<f64>() / total;
    let lowest = all.iter().map(|(_, at, std)| at - 6.0 * std).fold(f64::INFINITY, f64::min);
    let highest = all.iter().map(|(_, at, std)| at + 6.0 * std).fold(f64::NEG_INFINITY, f64::max);
    [0.025, 0.975].map(|share| {
        let (mut from, mut to) = (lowest, highest);
        for _ in 0..100 {
            let middle = 0.5 * (from + to);
            if below(middle) < share {
                from = middle;
            } else {
                to = middle;
            }
        }
        0.5 * (from + to)
    })
}

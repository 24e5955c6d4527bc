//! How a measured rate relates to the slope of another measured output: factor, lag and offset, with intervals.
//!
//! Possible errors, and their countermeasures:
//! - A difference of two samples is mostly noise. Slope and rate pass the same symmetric filter, and the one of twelve through which they agree best is taken.
//! - Noise of the slope makes a factor too small, noise of the rate too large, for noise of any colour. Both regressions are made; the factor lies between the
//!   two (Frisch 1934, "Statistical Confluence Analysis", Oslo) if the two noises are independent. Two estimates of one observer may be dependent.
//! - Rates that the logger held, or a slow filter, look late; the lag is a lag, not its cause.
//! - The stretches of a log need not agree. Sixteen are left out in turn (delete-a-group jackknife; Künsch 1989, doi:10.1214/aos/1176347265). The noise may be neither
//!   white nor Gaussian; only its correlation length must be shorter than a stretch.

use deadtime_signal::stats;
use deadtime_signal::stats::students_t;

/// Stretches that are left out in turn.
const STRETCHES: usize = 16;
/// Half the width of the two moving means that make a filter, samples.
const HALVES: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// The slow part that a band leaves out has moving means so many times as wide.
const SLOW: usize = 6;
/// Samples that are compared: the fewest, and the most of one log; longer ones are thinned.
const FEWEST: usize = 200;
const MOST: usize = 10_000;
/// A filter needs a log of so many times its width.
const WIDTHS: usize = 5;
/// Only filters with this correlation of the two signals decide whether the factor changes with frequency.
const CLEAR: f64 = 0.95;
/// A change of the factor with frequency that counts, beyond the intervals.
const CHANGE: f64 = 0.03;

/// Slope and rate in the middle of every step of a log; NaN where a sample is missing.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub(super) slope: Vec<f64>,
    pub(super) rate: Vec<f64>,
}

/// A value and half its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Known {
    pub(super) value: f64,
    pub(super) half: f64,
}

/// How the two go together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alike {
    /// At the lag at which they agree best; negative where one is turned round.
    pub(super) correlation: f64,
    /// The rate over the slope, without its sign: 95 % interval.
    pub(super) factor: [f64; 2],
    /// By how many samples the rate comes later.
    pub(super) lag: Known,
    /// The part of the rate beyond factor times slope, in its unit.
    pub(super) offset: Known,
    /// Standard deviation of the rate.
    pub(super) size: f64,
    /// The factor of another band, where it is another.
    pub(super) elsewhere: Option<[f64; 2]>,
}

/// A symmetric filter: moving means, twice; a band leaves out the slow part.
#[derive(Debug, Clone, Copy)]
struct Filter {
    half: usize,
    band: bool,
}

impl Filter {
    fn all() -> impl Iterator<Item = Self> {
        HALVES.into_iter().flat_map(|half| [false, true].map(|band| Self { half, band }))
    }

    /// Samples that a value depends on.
    fn width(self) -> usize {
        4 * self.half * if self.band { SLOW } else { 1 } + 1
    }

    fn apply(self, x: &[f64]) -> Vec<f64> {
        let smooth = |half: usize| moving_mean(&moving_mean(x, half), half);
        let mut fast = smooth(self.half);
        if self.band {
            fast.iter_mut().zip(smooth(SLOW * self.half)).for_each(|(f, s)| *f -= s);
        }
        fast
    }
}

/// Means over `half` samples to either side; NaN where one is missing.
pub(super) fn moving_mean(x: &[f64], half: usize) -> Vec<f64> {
    let (mut sums, mut missing) = (vec![0.0; x.len() + 1], vec![0_usize; x.len() + 1]);
    for (k, v) in x.iter().enumerate() {
        sums[k + 1] = sums[k] + if v.is_finite() { *v } else { 0.0 };
        missing[k + 1] = missing[k] + usize::from(!v.is_finite());
    }
    let mean = |k: usize| {
        let (from, to) = (k.checked_sub(half)?, k + half + 1);
        (to <= x.len() && missing[to] == missing[from])
            .then(|| (sums[to] - sums[from]) / (2 * half + 1) as f64)
    };
    (0..x.len()).map(|k| mean(k).unwrap_or(f64::NAN)).collect()
}

/// The mean over every step by the cubic through four samples: a straight line would make fast motion too small.
pub(super) fn middles(values: &[f64]) -> Vec<f64> {
    let steps = values.len().saturating_sub(1);
    let mean = |k: usize| match (k.checked_sub(1).and_then(|k| values.get(k)), values.get(k + 2)) {
        (Some(before), Some(after)) => (13.0 * (values[k] + values[k + 1]) - before - after) / 24.0,
        _ => f64::NAN,
    };
    (0..steps).map(mean).collect()
}

/// Products of slope and rate over a stretch, per lag: slope·rate, slope², rate².
type Products = Vec<[f64; 3]>;

/// The best lag, samples, the correlation there and the ratio of the two sizes.
#[derive(Clone, Copy)]
struct Peak {
    at: usize,
    lag: f64,
    correlation: f64,
    ratio: f64,
}

fn correlation(p: &[f64; 3]) -> f64 {
    p[0] / (p[1] * p[2]).sqrt()
}

/// The largest correlation between lags, by the polynomial through five neighbours; `None` at the edge of the lags.
fn peak(products: &Products, sign: f64, near: Option<usize>) -> Option<Peak> {
    let along: Vec<f64> = products.iter().map(|p| sign * correlation(p)).collect();
    let at = near.or_else(|| (0..along.len()).max_by(|a, b| along[*a].total_cmp(&along[*b])))?;
    let y: &[f64; 5] = along.get(at.checked_sub(2)?..at + 3)?.try_into().ok()?;
    // Coefficients from central differences of a quartic.
    let c = [
        y[2],
        (y[0] - 8.0 * y[1] + 8.0 * y[3] - y[4]) / 12.0,
        (-y[0] + 16.0 * y[1] - 30.0 * y[2] + 16.0 * y[3] - y[4]) / 24.0,
        (-y[0] + 2.0 * y[1] - 2.0 * y[3] + y[4]) / 12.0,
        (y[0] - 4.0 * y[1] + 6.0 * y[2] - 4.0 * y[3] + y[4]) / 24.0,
    ];
    let mut x = 0.0_f64;
    for _ in 0..20 {
        let slope = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + 4.0 * x * c[4]));
        let bend = 2.0 * c[2] + x * (6.0 * c[3] + 12.0 * x * c[4]);
        if bend >= 0.0 {
            return None;
        }
        x = (x - slope / bend).clamp(-1.5, 1.5);
    }
    let best = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])));
    let [_, slope, rate] = products[at];
    let found = Peak {
        at,
        lag: at as f64 - (products.len() / 2) as f64 + x,
        correlation: best.min(1.0),
        ratio: (rate / slope).sqrt(),
    };
    (found.correlation.is_finite() && found.ratio.is_finite() && found.ratio > 0.0).then_some(found)
}

/// The two through a filter, and the samples at which they can be compared at every lag.
struct Filtered {
    slope: Vec<f64>,
    rate: Vec<f64>,
    samples: Vec<usize>,
}

impl Filtered {
    fn new(part: &Part, filter: Filter, lags: usize) -> Self {
        let (mut slope, mut rate) = (filter.apply(&part.slope), filter.apply(&part.rate));
        let around = moving_mean(&slope, lags);
        let samples: Vec<usize> =
            (0..rate.len()).filter(|&k| rate[k].is_finite() && around[k].is_finite()).collect();
        let samples: Vec<usize> =
            samples.iter().copied().step_by(samples.len() / MOST + 1).collect();
        for x in [&mut slope, &mut rate] {
            let mean = stats::mean(samples.iter().map(|&k| x[k])).unwrap_or(0.0);
            x.iter_mut().for_each(|v| *v -= mean);
        }
        Self { slope, rate, samples }
    }
}

/// The regression of rate on slope through the filter of best agreement. `None` where both are constant, the log is short, or the lag is at the edge.
pub(super) fn compare(parts: &[Part], lags: usize) -> Option<Alike> {
    let longest = parts.iter().map(|p| p.rate.len()).max().unwrap_or(0);
    let fits: Vec<Alike> = Filter::all()
        .filter(|f| WIDTHS * f.width() <= longest)
        .filter_map(|f| through(parts, f, lags))
        .collect();
    let mut best =
        *fits.iter().max_by(|a, b| a.correlation.abs().total_cmp(&b.correlation.abs()))?;
    let [low, high] = best.factor;
    let apart =
        |f: &&Alike| f.factor[0] > high * (1.0 + CHANGE) || f.factor[1] * (1.0 + CHANGE) < low;
    best.elsewhere =
        fits.iter().filter(|f| f.correlation.abs() >= CLEAR).find(apart).map(|f| f.factor);
    Some(best)
}

fn through(parts: &[Part], filter: Filter, lags: usize) -> Option<Alike> {
    let filtered: Vec<Filtered> = parts.iter().map(|p| Filtered::new(p, filter, lags)).collect();
    let total: usize = filtered.iter().map(|f| f.samples.len()).sum();
    if total < FEWEST {
        return None;
    }
    let mut stretches: Vec<Products> = vec![vec![[0.0; 3]; 2 * lags + 1]; STRETCHES];
    let samples = filtered.iter().flat_map(|f| f.samples.iter().map(move |&k| (f, k)));
    for (count, (f, k)) in samples.enumerate() {
        let stretch = &mut stretches[count * STRETCHES / total];
        let y = f.rate[k];
        // A later rate is the slope of an earlier sample.
        for (p, x) in stretch.iter_mut().zip(f.slope[k - lags..=k + lags].iter().rev()) {
            p[0] += x * y;
            p[1] += x * x;
            p[2] += y * y;
        }
    }
    let sum = |left_out: Option<usize>| {
        let mut all: Products = vec![[0.0; 3]; 2 * lags + 1];
        for stretch in
            stretches.iter().enumerate().filter(|(at, _)| Some(*at) != left_out).map(|(_, s)| s)
        {
            all.iter_mut().zip(stretch).for_each(|(a, s)| (0..3).for_each(|i| a[i] += s[i]));
        }
        all
    };
    let all = sum(None);
    let turned =
        |sign: f64| all.iter().map(|p| sign * correlation(p)).fold(f64::NEG_INFINITY, f64::max);
    // Half a period later both signs look alike: the other sign is accepted only where its correlation is larger by 0.05.
    let sign = if turned(-1.0) > turned(1.0) + 0.05 { -1.0 } else { 1.0 };
    let best = peak(&all, sign, None)?;
    let values = |p: Peak| [p.lag, (p.ratio * p.correlation).ln(), (p.ratio / p.correlation).ln()];
    let others: Vec<[f64; 3]> = (0..STRETCHES)
        .filter_map(|out| peak(&sum(Some(out)), sign, Some(best.at)))
        .map(values)
        .collect();
    if others.len() < STRETCHES || best.correlation <= 0.0 {
        return None;
    }
    let n = STRETCHES as f64;
    let quantile = students_t(0.975, n - 1.0).unwrap_or(f64::INFINITY);
    let half = |i: usize| {
        let mean = others.iter().map(|o| o[i]).sum::<f64>() / n;
        quantile
            * ((n - 1.0) / n * others.iter().map(|o| (o[i] - mean).powi(2)).sum::<f64>()).sqrt()
    };
    let [lag, least, most] = values(best);
    let factor = [(least - half(1)).exp(), (most + half(2)).exp()];
    let offset = offset(parts, sign * best.ratio, lag.round() as isize, quantile, factor)?;
    let size = (all[lags][2] / total as f64).sqrt();
    let found = Alike {
        correlation: sign * best.correlation,
        factor,
        lag: Known { value: lag, half: half(0) },
        offset,
        size,
        elsewhere: None,
    };
    (factor.iter().all(|f| f.is_finite()) && found.lag.half.is_finite()).then_some(found)
}

/// The part of the rate beyond factor times slope: the mean over stretches, and half its interval with that of the factor.
fn offset(
    parts: &[Part],
    ratio: f64,
    lag: isize,
    quantile: f64,
    factor: [f64; 2],
) -> Option<Known> {
    let pairs = parts.iter().flat_map(|p| {
        (0..p.rate.len())
            .filter_map(move |k| Some((p.rate[k], *p.slope.get(k.checked_add_signed(-lag)?)?)))
    });
    let pairs: Vec<(f64, f64)> = pairs.filter(|(r, s)| r.is_finite() && s.is_finite()).collect();
    let means: Vec<f64> = (0..STRETCHES)
        .filter_map(|at| {
            stats::mean(
                pairs[at * pairs.len() / STRETCHES..(at + 1) * pairs.len() / STRETCHES]
                    .iter()
                    .map(|(r, s)| r - ratio * s),
            )
        })
        .collect();
    let n = means.len() as f64;
    let value = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - value).powi(2)).sum::<f64>() / (n - 1.0) / n;
    let moved = stats::mean(pairs.iter().map(|(_, s)| *s))?.abs();
    Some(Known { value, half: quantile * variance.sqrt() + 0.5 * (factor[1] - factor[0]) * moved })
        .filter(|k| k.half.is_finite())
}

#[cfg(test)]
mod tests {
    use super::{Part, compare, middles};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// A sum of sines, whose derivative is known at any time.
    struct Motion(Vec<[f64; 3]>);

    impl Motion {
        fn new(random: &mut ChaCha8Rng) -> Self {
            let line = |_| {
                let hz = 0.1 * 30.0_f64.powf(random.random_range(0.0..1.0));
                let omega = std::f64::consts::TAU * hz;
                [
                    random.random_range(0.2..1.0) / (1.0 + hz),
                    omega,
                    random.random_range(0.0..std::f64::consts::TAU),
                ]
            };
            Self((0..25).map(line).collect())
        }

        fn place(&self, t: f64) -> f64 {
            self.0.iter().map(|[a, w, p]| a * (w * t + p).sin()).sum()
        }

        fn speed(&self, t: f64) -> f64 {
            self.0.iter().map(|[a, w, p]| a * w * (w * t + p).cos()).sum()
        }
    }

    /// Noise of an autoregression of order one.
    fn noise(samples: usize, size: f64, colour: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
        let mut last = 0.0;
        let next = |_| {
            last = colour * last
                + (1.0 - colour * colour).sqrt() * random.sample::<f64, _>(StandardNormal);
            size * last
        };
        (0..samples).map(next).collect()
    }

    /// In 400 records, with white or coloured noise in both, the intervals of factor, lag and offset hold the truth in at least 91 %. This limit is 95 % less
    /// three and a half standard deviations of that count. The factor's interval is wider by the range that the unknown ratio of the two noises leaves open.
    #[test]
    fn intervals_hold_the_truth_in_white_and_coloured_noise() {
        let (mut held, mut estimated, records) = ([0_usize; 3], 0_usize, 400);
        for seed in 0..records {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let ts = random.random_range(0.005..0.02);
            let samples = random.random_range(1500..5000);
            let (factor, lag, offset) = (
                random.random_range(0.8..1.25),
                random.random_range(-4.0..4.0),
                random.random_range(-0.5..0.5),
            );
            let motion = Motion::new(&mut random);
            let colour = |random: &mut ChaCha8Rng| {
                if random.random_range(0.0..1.0) < 0.5 {
                    0.0
                } else {
                    random.random_range(0.5..0.95)
                }
            };
            let (c, d) = (colour(&mut random), colour(&mut random));
            let of_place = noise(samples, random.random_range(0.0005..0.01), c, &mut random);
            let of_speed = noise(samples, random.random_range(0.02..0.5), d, &mut random);
            let at = |k: usize| ts * k as f64;
            let place: Vec<f64> = (0..samples).map(|k| motion.place(at(k)) + of_place[k]).collect();
            let speed: Vec<f64> = (0..samples)
                .map(|k| factor * motion.speed(at(k) - lag * ts) + offset + of_speed[k])
                .collect();
            let part = Part {
                slope: place.windows(2).map(|p| (p[1] - p[0]) / ts).collect(),
                rate: middles(&speed),
            };
            let Some(found) = compare(&[part], 35) else { continue };
            estimated += 1;
            let inside = [
                (found.factor[0]..=found.factor[1]).contains(&factor),
                (found.lag.value - lag).abs() <= found.lag.half,
                (found.offset.value - offset).abs() <= found.offset.half,
            ];
            held.iter_mut().zip(inside).for_each(|(h, i)| *h += usize::from(i));
        }
        println!("estimated {estimated} of {records}; factor, lag, offset held in {held:?}");
        assert!(estimated * 100 >= 98 * records as usize, "{estimated}");
        assert!(held.iter().all(|h| h * 100 >= 91 * estimated), "{held:?} of {estimated}");
    }

    #[test]
    fn without_noise_factor_and_lag_are_exact() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let motion = Motion::new(&mut random);
        let ts = 0.01;
        let place: Vec<f64> = (0..3000).map(|k| motion.place(ts * f64::from(k))).collect();
        let speed: Vec<f64> =
            (0..3000).map(|k| -1.09 * motion.speed(ts * f64::from(k) - 0.023)).collect();
        let part = Part {
            slope: place.windows(2).map(|p| (p[1] - p[0]) / ts).collect(),
            rate: middles(&speed),
        };
        let found = compare(&[part], 35).unwrap();
        assert!(found.correlation < -0.9999, "{found:?}");
        assert!(
            (found.factor[0] * found.factor[1]).sqrt() - 1.09 < 1e-3
                && (found.lag.value - 2.3).abs() < 0.02,
            "{found:?}"
        );
    }
}

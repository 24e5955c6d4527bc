//! The noise of the residuals: autoregressive per output, correlated across outputs, common to all hypotheses.

use nalgebra::DMatrix;

use crate::input::criteria::Criteria;
use crate::input::record::{LogRecord, Span};
use deadtime_signal::stats;

/// e = L⁻¹ A(q) r: each output's residual through its autoregression, then all through the inverse factor of the innovations' covariance.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    /// Coefficients of past residuals, per output.
    ar: Vec<Vec<f64>>,
    /// L⁻¹, outputs × outputs.
    unmix: DMatrix<f64>,
}

impl Noise {
    /// White noise of these standard deviations.
    pub(crate) fn white(std: &[f64]) -> Self {
        let unmix = DMatrix::from_fn(std.len(), std.len(), |i, j| {
            if i == j { 1.0 / std[i].max(f64::MIN_POSITIVE) } else { 0.0 }
        });
        Self { ar: vec![Vec::new(); std.len()], unmix }
    }

    /// From residuals (samples × outputs, one per record): autoregressions by Yule and Walker's equations, their orders by Akaike's criterion.
    pub(crate) fn fit(
        records: &[&LogRecord],
        residuals: &[&DMatrix<f64>],
        smallest: &[f64],
        criteria: &Criteria,
    ) -> Self {
        let outputs = smallest.len();
        let ar: Vec<Vec<f64>> =
            (0..outputs).map(|i| autoregression(records, residuals, i, criteria)).collect();
        let mut covariance = DMatrix::zeros(outputs, outputs);
        let mut count: f64 = 0.0;
        let plain = Self { ar: ar.clone(), unmix: DMatrix::identity(outputs, outputs) };
        for (record, residual) in records.iter().zip(residuals) {
            let e = plain.innovations(record, record.train, residual);
            for k in 0..record.time_s.len() {
                if (0..outputs).all(|i| record.measured_in(record.train, i, k).is_some()) {
                    let row = e.row(k);
                    covariance += row.transpose() * row;
                    count += 1.0;
                }
            }
        }
        covariance /= count.max(1.0);
        for i in 0..outputs {
            covariance[(i, i)] =
                f64::max(covariance[(i, i)] * (1.0 + 1e-6), smallest[i] * smallest[i]);
        }
        let diagonal: Vec<f64> = covariance.diagonal().iter().map(|v| v.sqrt()).collect();
        let unmix = covariance.cholesky().and_then(|c| c.l().try_inverse());
        Self { ar, unmix: unmix.unwrap_or_else(|| Self::white(&diagonal).unmix) }
    }

    /// The noise with its standard deviation multiplied by the factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { unmix: self.unmix / factor, ..self }
    }

    /// Standard deviation of every output's innovations, if they were uncorrelated.
    pub(crate) fn std(&self) -> Vec<f64> {
        let mix = self.unmix.clone().try_inverse().unwrap_or_else(|| self.unmix.clone());
        mix.row_iter().map(|row| row.norm()).collect()
    }

    /// Whitened rows of a residual, or of anything that moves as a residual does; samples that are missing or outside the span are 0.
    pub(crate) fn whiten(
        &self,
        record: &LogRecord,
        span: Option<Span>,
        residual: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        self.unmixed(&self.innovations(record, span, residual))
    }

    /// Each row through L⁻¹.
    fn unmixed(&self, innovations: &DMatrix<f64>) -> DMatrix<f64> {
        let (samples, outputs) = innovations.shape();
        let mut unmixed = DMatrix::zeros(samples, outputs);
        for (i, to) in unmixed.as_mut_slice().chunks_exact_mut(samples.max(1)).enumerate() {
            for (e, &weight) in
                innovations.as_slice().chunks_exact(samples.max(1)).zip(self.unmix.row(i).iter())
            {
                if weight != 0.0 {
                    to.iter_mut().zip(e).for_each(|(to, e)| *to += weight * e);
                }
            }
        }
        unmixed
    }

    /// The whitening filter on a response that starts from rest.
    pub(crate) fn filter(&self, response: &DMatrix<f64>) -> DMatrix<f64> {
        let filtered = DMatrix::from_fn(response.nrows(), response.ncols(), |k, i| {
            response[(k, i)]
                - self.ar[i]
                    .iter()
                    .zip((0..k).rev())
                    .map(|(a, past)| a * response[(past, i)])
                    .sum::<f64>()
        });
        filtered * self.unmix.transpose()
    }

    /// A missing residual is replaced by its prediction, so the map stays linear.
    fn innovations(
        &self,
        record: &LogRecord,
        span: Option<Span>,
        residual: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let (samples, outputs) = residual.shape();
        let mut e = DMatrix::zeros(samples, outputs);
        let Some(span) = span else { return e };
        let (from, to) = (
            record.time_s.partition_point(|t| *t < span.from_s),
            record.time_s.partition_point(|t| *t <= span.to_s),
        );
        let to = to.max(from);
        let mut past = vec![0.0; samples];
        for i in 0..outputs {
            let ar = &self.ar[i];
            if record.measured[i].present.is_none() {
                // No sample is missing: the filter runs over the whole span.
                let left = &residual.as_slice()[i * samples..(i + 1) * samples];
                let e = &mut e.as_mut_slice()[i * samples..(i + 1) * samples];
                // Lag by lag: the same sums in the same order, many samples at a time.
                for (lag, a) in (1..).zip(ar) {
                    let first = from.max(lag);
                    if first < to {
                        e[first..to]
                            .iter_mut()
                            .zip(&left[first - lag..])
                            .for_each(|(predicted, past)| *predicted += a * past);
                    }
                }
                e[from..to].iter_mut().zip(&left[from..to]).for_each(|(e, left)| *e = left - *e);
                continue;
            }
            for k in 0..samples {
                let predicted: f64 =
                    ar.iter().zip(past[..k].iter().rev()).map(|(a, r)| a * r).sum();
                past[k] = residual[(k, i)];
                if record.measured[i].get(k).is_none() {
                    past[k] = predicted;
                } else if span.holds(record.time_s[k]) {
                    e[(k, i)] = residual[(k, i)] - predicted;
                }
            }
        }
        e
    }

    /// The number of samples of one output's noise per independent sample.
    pub(crate) fn memory(&self, output: usize) -> f64 {
        memory_of(&self.ar[output])
    }
}

/// The number of samples of autoregressive noise per independent sample: its spectrum at 0 over its variance.
pub(crate) fn memory_of(ar: &[f64]) -> f64 {
    let mut impulse = vec![1.0];
    for k in 1..512 {
        let next = ar.iter().zip(impulse[..k].iter().rev()).map(|(a, h)| a * h).sum();
        impulse.push(next);
    }
    let variance: f64 = impulse.iter().map(|h| h * h).sum();
    let at_zero: f64 = impulse.iter().sum::<f64>().powi(2);
    (at_zero / variance).max(1.0)
}

/// The autoregression of one output's residuals.
fn autoregression(
    records: &[&LogRecord],
    residuals: &[&DMatrix<f64>],
    output: usize,
    criteria: &Criteria,
) -> Vec<f64> {
    let inside = |(record, residual): (&&LogRecord, &&DMatrix<f64>)| -> Vec<Option<f64>> {
        (0..record.time_s.len())
            .map(|k| record.measured_in(record.train, output, k).map(|_| residual[(k, output)]))
            .collect()
    };
    autoregression_of(&records.iter().zip(residuals).map(inside).collect::<Vec<_>>(), criteria)
}

/// The autoregression that separate stretches of one noise share, its order by Akaike's criterion.
///
/// Burg's reflection coefficients (Burg 1975; Kay 1988, Modern Spectral Estimation, ch. 7) are used where most samples have neighbours. The covariances of
/// Yule and Walker's equations overestimate the innovations of noise with a long correlation length. Only these equations use pairs of samples across gaps.
pub(crate) fn autoregression_of(stretches: &[Vec<Option<f64>>], criteria: &Criteria) -> Vec<f64> {
    let longest = criteria.longest_autoregression;
    let whole = contiguous(stretches, longest + 1);
    let all: usize = stretches.iter().map(|s| s.iter().flatten().count()).sum();
    if (all as f64) < criteria.samples_per_coefficient * longest as f64 {
        return Vec::new();
    }
    let reflections = if 2 * whole.iter().map(Vec::len).sum::<usize>() >= all {
        burg(&whole, longest)
    } else {
        yule_walker(stretches, longest)
    };
    let (mut ar, mut best) = (Vec::new(), Vec::new());
    let (mut logarithm, mut lowest) = (0.0, 0.0);
    for (order, reflection) in (1..).zip(reflections) {
        ar = longer(&ar, reflection);
        logarithm += (1.0 - reflection * reflection).ln();
        let criterion = all as f64 * logarithm + 2.0 * f64::from(order);
        if criterion < lowest {
            (best, lowest) = (ar.clone(), criterion);
        }
    }
    best
}

/// Stretches without gaps that are at least so long.
fn contiguous(stretches: &[Vec<Option<f64>>], least: usize) -> Vec<Vec<f64>> {
    let parts = stretches.iter().flat_map(|s| s.split(Option::is_none));
    parts
        .filter(|part| part.len() >= least.max(1))
        .map(|part| part.iter().flatten().copied().collect())
        .collect()
}

/// The coefficients of one order more (Levinson 1947, Durbin 1960).
fn longer(ar: &[f64], reflection: f64) -> Vec<f64> {
    let shorter = ar.iter().zip(ar.iter().rev()).map(|(a, mirrored)| a - reflection * mirrored);
    shorter.chain([reflection]).collect()
}

/// The least part of the variance that an autoregression may leave.
const EXACT: f64 = 1e-12;

/// Reflection coefficients from forward and backward prediction errors of all stretches. A part 1/n² of the energy of n samples counts as white: a constant is
/// no noise that predicts itself.
fn burg(stretches: &[Vec<f64>], longest: usize) -> Vec<f64> {
    let mut forward: Vec<Vec<f64>> = stretches.to_vec();
    let mut backward = forward.clone();
    let count: usize = stretches.iter().map(Vec::len).sum();
    let energy: f64 = stretches.iter().flatten().map(|v| v * v).sum();
    let white = 2.0 * energy / (count.max(1) as f64).powi(2);
    let (mut reflections, mut left) = (Vec::new(), 1.0);
    for _ in 0..longest {
        // The errors f(k) and b(k − 1) from the next sample on.
        for (f, b) in forward.iter_mut().zip(&mut backward) {
            f.remove(0);
            b.pop();
        }
        let pairs = || forward.iter().flatten().zip(backward.iter().flatten());
        let both: f64 = pairs().map(|(f, b)| f * b).sum();
        let squares: f64 = pairs().map(|(f, b)| f * f + b * b).sum();
        let reflection = 2.0 * both / (squares + white);
        left *= 1.0 - reflection * reflection;
        if reflection.is_nan() || left <= EXACT {
            break;
        }
        for (f, b) in forward.iter_mut().flatten().zip(backward.iter_mut().flatten()) {
            (*f, *b) = (*f - reflection * *b, *b - reflection * *f);
        }
        reflections.push(reflection);
    }
    reflections
}

/// Reflection coefficients from covariances (Levinson and Durbin's recursion): the mean products of the pairs that are there, times the part of the rows that
/// have a later row at this lag. Without gaps these are the biased covariances, which always give a stable filter.
fn yule_walker(stretches: &[Vec<Option<f64>>], longest: usize) -> Vec<f64> {
    let rows: usize = stretches.iter().map(Vec::len).sum();
    let covariance = |lag: usize| -> f64 {
        let later: usize = stretches.iter().map(|s| s.len().saturating_sub(lag)).sum();
        let pairs = stretches.iter().flat_map(|s| s.iter().zip(s.iter().skip(lag)));
        let products = pairs.filter_map(|(a, b)| Some(a.as_ref()? * b.as_ref()?));
        // 0 where no sample has another at this lag.
        stats::mean(products).unwrap_or(0.0) * later as f64 / rows.max(1) as f64
    };
    let covariances: Vec<f64> = (0..=longest).map(covariance).collect();
    let (mut ar, mut reflections): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut variance = covariances[0];
    for order in 1..=longest {
        let known: f64 =
            ar.iter().zip(covariances[1..order].iter().rev()).map(|(a, c)| a * c).sum();
        let reflection = (covariances[order] - known) / variance;
        if reflection.is_nan() || reflection.abs() >= 1.0 || variance <= EXACT * covariances[0] {
            break;
        }
        ar = longer(&ar, reflection);
        variance *= 1.0 - reflection * reflection;
        reflections.push(reflection);
    }
    reflections
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use deadtime_model::simulate::Measured;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::StandardNormal;

    /// Noise with a correlation length above 100 samples in two stretches of a thousand: its innovations, within the error of their estimate. With the
    /// covariances alone their variance is more than twice as large.
    #[test]
    fn innovations_of_noise_with_a_long_memory_have_their_size() {
        let (criteria, mut rng) = (Criteria::default(), ChaCha8Rng::seed_from_u64(7));
        let (mut ratios, mut of_covariances) = (Vec::new(), Vec::new());
        for _ in 0..10 {
            let stretches: Vec<Vec<f64>> = (0..2)
                .map(|_| {
                    let (mut slow, mut wind) = (0.0, 0.0);
                    let next = |_| {
                        wind = 0.96 * wind + rng.sample::<f64, _>(StandardNormal);
                        slow = 0.985 * slow + wind;
                        slow
                    };
                    (0..1200).map(next).skip(200).collect()
                })
                .collect();
            let gaps: Vec<Vec<Option<f64>>> =
                stretches.iter().map(|s| s.iter().copied().map(Some).collect()).collect();
            let variance = |ar: &[f64]| {
                let innovation = |s: &[f64], k: usize| {
                    s[k] - ar.iter().enumerate().map(|(j, a)| a * s[k - 1 - j]).sum::<f64>()
                };
                let all = stretches.iter().flat_map(|s| (20..s.len()).map(move |k| (s, k)));
                stats::mean(all.map(|(s, k)| innovation(s, k).powi(2))).unwrap()
            };
            ratios.push(variance(&autoregression_of(&gaps, &criteria)));
            let reflections = yule_walker(&gaps, criteria.longest_autoregression);
            of_covariances
                .push(variance(&reflections.iter().fold(Vec::new(), |ar, r| longer(&ar, *r))));
        }
        // 2000 innovations: 3.2 % each, 1 % of ten draws.
        let mean = ratios.iter().sum::<f64>() / 10.0;
        assert!((mean - 1.0).abs() < 0.03, "{ratios:?}");
        assert!(of_covariances.iter().all(|variance| *variance > 2.0), "{of_covariances:?}");
    }

    /// Every third sample is missing: the covariances of the pairs that are there.
    #[test]
    fn noise_with_gaps_has_the_autoregression_of_its_pairs() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let mut last = 0.0;
        let series: Vec<Option<f64>> = (0..20_000)
            .map(|k| {
                last = 0.8 * last + rng.sample::<f64, _>(StandardNormal);
                (k % 3 != 0).then_some(last)
            })
            .collect();
        let memory = memory_of(&autoregression_of(&[series], &Criteria::default()));
        // (1 + 0.8)/(1 − 0.8) = 9.
        assert!((memory - 9.0).abs() < 1.5, "{memory}");
    }

    /// Whitening lag by lag equals the filter to the bit. The test includes a span that begins before the filter has all its past, and an output without weight.
    #[test]
    fn whitening_lag_by_lag_is_the_filter_sample_by_sample() {
        let samples = 40;
        let value =
            |k: usize, i: usize| f64::from(u32::try_from((k * 37 + i * 11) % 23).unwrap()) - 9.3;
        let residual = DMatrix::from_fn(samples, 2, value);
        let noise = Noise {
            ar: vec![vec![0.7, -0.2, 0.05, 0.01], vec![]],
            unmix: DMatrix::from_row_slice(2, 2, &[1.7, 0.0, -0.3, 2.1]),
        };
        for from_s in [0.0, 2.0, 17.0] {
            let measured = Measured { values: vec![0.0; samples], present: None };
            let record = LogRecord {
                name: String::new(),
                time_s: (0..samples).map(|k| f64::from(u32::try_from(k).unwrap())).collect(),
                sample_time_s: 1.0,
                inputs: Vec::new(),
                measured: vec![measured; 2],
                start: Vec::new(),
                states: Vec::new(),
                context: Vec::new(),
                train: Some(Span { from_s, to_s: 30.0 }),
                anew: None,
            };
            let mut all_there = record.clone();
            for measured in &mut all_there.measured {
                measured.present = Some(vec![true; samples]);
            }
            let (fast, plain) = (
                noise.whiten(&record, record.train, &residual),
                noise.whiten(&all_there, record.train, &residual),
            );
            assert_eq!(fast, plain);
            let at = 25;
            let first = value(at, 0)
                - (0.7 * value(at - 1, 0) - 0.2 * value(at - 2, 0)
                    + 0.05 * value(at - 3, 0)
                    + 0.01 * value(at - 4, 0));
            assert_abs_diff_eq!(fast[(at, 1)], -0.3 * first + 2.1 * value(at, 1), epsilon = 1e-12);
            assert_eq!((fast[(31, 0)], fast[(39, 1)]), (0.0, 0.0));
        }
    }
}

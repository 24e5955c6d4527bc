//! Sums of products of two signals at many lags, by fast Fourier transforms.

use std::ops::RangeInclusive;

use nalgebra::Complex;

use super::fourier::{RealFourier, fast_length};

/// Lags of a block's transform that are kept out of this many: long enough that little of a transform is spent on the overlap.
const LAGS_PER_BLOCK: usize = 16;
/// A shorter transform is no faster per sample.
const SHORTEST_BLOCK: usize = 4096;

/// r(l) = Σₜ a(t)·b(t + l) for every lag l of `lags`, over all t at which both samples exist. A positive lag of the largest sum: b is later than a.
///
/// Few lags go in blocks that stay in the cache, all lags in one transform padded with zeros against wrapping; O(N·log(lags)).
///
/// # Example
/// ```
/// use deadtime_signal::correlation;
/// let (a, b) = ([1.0, 2.0, 3.0], [0.0, 1.0, 2.0]);
/// let r = correlation(&a, &b, -1..=1);
/// // a(1)·b(0) + a(2)·b(1), a(0)·b(0) + a(1)·b(1) + a(2)·b(2), a(0)·b(1) + a(1)·b(2)
/// assert!(r.iter().zip([3.0, 8.0, 5.0]).all(|(r, s)| (r - s).abs() < 1e-12));
/// ```
#[must_use]
pub fn correlation(a: &[f64], b: &[f64], lags: RangeInclusive<isize>) -> Vec<f64> {
    Correlator::new([a.len(), b.len()], lags).correlate(a, b)
}

/// [`correlation`] of many pairs of signals of the same lengths: the transform is planned once, which takes about as long as using it.
pub struct Correlator {
    /// First requested lag, and the number of lags.
    first: isize,
    count: usize,
    /// The same of the lags at which samples meet.
    from: isize,
    wanted: usize,
    fourier: RealFourier,
    blocks: bool,
}

impl Correlator {
    /// For signals of at most these lengths.
    #[must_use]
    pub fn new(lengths: [usize; 2], lags: RangeInclusive<isize>) -> Self {
        let [a, b] = lengths;
        let (first, last) = (*lags.start(), *lags.end());
        let count = if last < first { 0 } else { last.abs_diff(first).saturating_add(1) };
        // Beyond these no two samples meet.
        let (from, to) = (first.max(-signed(a)), last.min(signed(b)));
        if count == 0 || a == 0 || b == 0 || to < from {
            return Self {
                first,
                count,
                from,
                wanted: 0,
                fourier: RealFourier::new(1),
                blocks: false,
            };
        }
        let wanted = to.abs_diff(from) + 1;
        let block = fast_length((LAGS_PER_BLOCK * wanted).max(SHORTEST_BLOCK));
        let blocks = block < a.max(b);
        // In one transform, products of lag l wrap to l − length: lags from −(a − 1) to b − 1 are not zero.
        let whole =
            || fast_length((to.max(0).unsigned_abs() + a).max(from.min(0).unsigned_abs() + b));
        Self {
            first,
            count,
            from,
            wanted,
            fourier: RealFourier::new(if blocks { block } else { whole() }),
            blocks,
        }
    }

    /// The sums at every lag; samples beyond the planned lengths are ignored.
    #[must_use]
    pub fn correlate(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        if self.wanted == 0 {
            return vec![0.0; self.count];
        }
        let inner = if self.blocks { self.by_blocks(a, b) } else { self.at_once(a, b) };
        if self.wanted == self.count {
            return inner;
        }
        let mut sums = vec![0.0; self.from.abs_diff(self.first)];
        sums.extend(inner);
        sums.resize(self.count, 0.0);
        sums
    }

    /// One transform, long enough that circular wrap-around falls outside the wanted lags.
    fn at_once(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        let length = self.fourier.length();
        let mut samples = vec![0.0; length];
        let mut scratch = self.fourier.scratch();
        let mut transformed = |x: &[f64], samples: &mut [f64]| {
            let mut spectrum = vec![Complex::new(0.0, 0.0); length / 2 + 1];
            let (head, tail) = samples.split_at_mut(x.len().min(length));
            head.copy_from_slice(&x[..head.len()]);
            tail.fill(0.0);
            self.fourier.forward(samples, &mut spectrum, &mut scratch);
            spectrum
        };
        let mut product = transformed(a, &mut samples);
        let share = 1.0 / length as f64;
        for (x, y) in product.iter_mut().zip(transformed(b, &mut samples)) {
            *x = x.conj() * y * share;
        }
        self.fourier.inverse(&mut product, &mut samples, &mut scratch);
        // Negative lags are at the end of the circle.
        let negative = self.from.min(0).unsigned_abs().min(length);
        let ends = negative.saturating_sub(self.wanted);
        let mut sums = Vec::with_capacity(self.wanted);
        sums.extend_from_slice(&samples[length - negative..length - ends]);
        let start = self.from.max(0).unsigned_abs().min(length);
        let more = (self.wanted - sums.len()).min(length - start);
        sums.extend_from_slice(&samples[start..start + more]);
        sums
    }

    /// Blocks of a, each with the samples of b at the wanted lags; the products of their spectra are summed and transformed back once.
    fn by_blocks(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        let block = self.fourier.length();
        let step = block - self.wanted + 1;
        let zero = Complex::new(0.0, 0.0);
        let (mut sum, mut x, mut y) =
            (vec![zero; block / 2 + 1], vec![zero; block / 2 + 1], vec![zero; block / 2 + 1]);
        let (mut samples, mut scratch) = (vec![0.0; block], self.fourier.scratch());
        for (start, part) in (0..).step_by(step).zip(a.chunks(step)) {
            // b from start + from on; what lies before its first sample is zero.
            let begin = signed(start) + self.from;
            let zeros = begin.min(0).unsigned_abs();
            let beside = b.get(begin.max(0).unsigned_abs()..).unwrap_or_default();
            if beside.is_empty() || zeros >= block {
                continue;
            }
            let mut transform = |zeros: usize, values: &[f64], spectrum: &mut [Complex<f64>]| {
                let end = block.min(zeros + values.len());
                samples[..zeros].fill(0.0);
                samples[zeros..end].copy_from_slice(&values[..end - zeros]);
                samples[end..].fill(0.0);
                self.fourier.forward(&mut samples, spectrum, &mut scratch);
            };
            transform(0, part, &mut x);
            transform(zeros, beside, &mut y);
            for ((s, x), y) in sum.iter_mut().zip(&x).zip(&y) {
                *s += x.conj() * y;
            }
        }
        let mut sums = self.fourier.series(sum);
        sums.truncate(self.wanted);
        sums
    }
}

fn signed(n: usize) -> isize {
    isize::try_from(n).unwrap_or(isize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(n: usize, seed: f64) -> Vec<f64> {
        (0..n)
            .map(|t| (t as f64 * seed).sin() + (t as f64 * t as f64 * 0.013 * seed).cos())
            .collect()
    }

    fn direct(a: &[f64], b: &[f64], lag: isize) -> f64 {
        (0..a.len()).filter_map(|t| Some(a[t] * b.get(t.checked_add_signed(lag)?)?)).sum()
    }

    #[test]
    fn correlation_is_the_direct_sum_at_every_lag() {
        for (n, m, lags) in [
            (1, 1, -3..=3),
            (7, 12, -9..=20),
            (50, 50, -49..=49),
            (300, 20, -5..=0),
            (3, 400, 100..=390),
            (60, 60, 200..=210),
            (9000, 9000, -3..=36),
            (20_000, 15_000, 5..=70),
            (5_000, 30_000, 24_000..=24_040),
            (30_000, 5_000, -29_990..=-29_900),
        ] {
            let (a, b) = (signal(n, 1.1), signal(m, 0.7));
            let fast = correlation(&a, &b, lags.clone());
            assert_eq!(fast.len(), lags.clone().count());
            for (lag, r) in lags.zip(fast) {
                let slow = direct(&a, &b, lag);
                assert!(
                    (r - slow).abs() < 1e-9 * n.min(m) as f64,
                    "{n} and {m} samples, lag {lag}: {r} and {slow}"
                );
            }
        }
    }

    #[test]
    #[allow(clippy::reversed_empty_ranges)]
    fn no_lags_and_no_samples_are_no_panic() {
        assert!(correlation(&[1.0], &[1.0], 2..=1).is_empty());
        assert_eq!(correlation(&[], &[1.0], 0..=2), [0.0; 3]);
        assert_eq!(correlation(&[1.0], &[1.0], isize::MAX - 1..=isize::MAX), [0.0; 2]);
    }
}

//! Sums of products of two signals at many lags, by fast Fourier transforms.

use std::ops::RangeInclusive;

use nalgebra::Complex;

use super::fourier::{RealFourier, fast_length};

/// Lags of a block's transform that are kept out of this many: long enough that little of a transform is spent on the overlap.
const LAGS_PER_BLOCK: usize = 16;
/// A shorter transform is no faster per sample.
const SHORTEST_BLOCK: usize = 4096;

/// r(l) = Σₜ a(t)·b(t + l) for every lag l of `lags`, over all t at which both samples exist; a positive lag of the largest sum: b is later than a.
///
/// Few lags go in blocks that stay in the cache, all lags in one transform padded with zeros against wrapping; O(N·log(lags)).
///
/// # Example
/// ```
/// use deadtime::signal::correlation;
/// let (a, b) = ([1.0, 2.0, 3.0], [0.0, 1.0, 2.0]);
/// let r = correlation(&a, &b, -1..=1);
/// // a(1)·b(0) + a(2)·b(1), a(0)·b(0) + a(1)·b(1) + a(2)·b(2), a(0)·b(1) + a(1)·b(2)
/// assert!(r.iter().zip([3.0, 8.0, 5.0]).all(|(r, s)| (r - s).abs() < 1e-12));
/// ```
#[must_use]
pub fn correlation(a: &[f64], b: &[f64], lags: RangeInclusive<isize>) -> Vec<f64> {
    let (first, last) = (*lags.start(), *lags.end());
    if last < first {
        return Vec::new();
    }
    let count = last.abs_diff(first).saturating_add(1);
    // Beyond these no two samples meet.
    let (from, to) = (first.max(-signed(a.len())), last.min(signed(b.len())));
    if a.is_empty() || b.is_empty() || to < from {
        return vec![0.0; count];
    }
    let wanted = to.abs_diff(from) + 1;
    let block = fast_length((LAGS_PER_BLOCK * wanted).max(SHORTEST_BLOCK));
    let inner = if block < a.len().max(b.len()) { by_blocks(a, b, from, wanted, block) } else { at_once(a, b, from, wanted) };
    let mut sums = vec![0.0; from.abs_diff(first)];
    sums.extend(inner);
    sums.resize(count, 0.0);
    sums
}

fn signed(n: usize) -> isize {
    isize::try_from(n).unwrap_or(isize::MAX)
}

/// One transform, long enough that what wraps lands beside the lags wanted.
fn at_once(a: &[f64], b: &[f64], from: isize, wanted: usize) -> Vec<f64> {
    let to = from + signed(wanted) - 1;
    // Products of lag l wrap to l − length: lags from −(a.len() − 1) to b.len() − 1 are not zero.
    let above = to.max(0).unsigned_abs() + a.len();
    let below = from.min(0).unsigned_abs() + b.len();
    let fourier = RealFourier::new(fast_length(above.max(below)));
    let mut product = fourier.spectrum(a.iter().copied());
    for (x, y) in product.iter_mut().zip(fourier.spectrum(b.iter().copied())) {
        *x = x.conj() * y;
    }
    let sums = fourier.series(product);
    let length = signed(fourier.length());
    (from..=to).map(|lag| usize::try_from(lag.rem_euclid(length)).ok().and_then(|i| sums.get(i)).copied().unwrap_or(0.0)).collect()
}

/// Blocks of a beside the samples of b that the lags reach; their spectra are added up and transformed back once.
fn by_blocks(a: &[f64], b: &[f64], from: isize, wanted: usize, block: usize) -> Vec<f64> {
    let fourier = RealFourier::new(block);
    let step = block - wanted + 1;
    let mut sum = vec![Complex::new(0.0, 0.0); block / 2 + 1];
    for (start, part) in (0..).step_by(step).zip(a.chunks(step)) {
        // b from start + from on; what lies before its first sample is zero.
        let begin = signed(start) + from;
        let zeros = begin.min(0).unsigned_abs();
        let beside = b.get(begin.max(0).unsigned_abs()..).unwrap_or_default();
        if beside.is_empty() || zeros >= block {
            continue;
        }
        let x = fourier.spectrum(part.iter().copied());
        let y = fourier.spectrum(std::iter::repeat_n(0.0, zeros).chain(beside.iter().copied()));
        for ((s, x), y) in sum.iter_mut().zip(x).zip(y) {
            *s += x.conj() * y;
        }
    }
    let mut sums = fourier.series(sum);
    sums.truncate(wanted);
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(n: usize, seed: f64) -> Vec<f64> {
        (0..n).map(|t| (t as f64 * seed).sin() + (t as f64 * t as f64 * 0.013 * seed).cos()).collect()
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
                assert!((r - slow).abs() < 1e-9 * n.min(m) as f64, "{n} and {m} samples, lag {lag}: {r} and {slow}");
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

//! Weighted sums and inner products of signals, with the widest vectors of the processor at hand.

use pulp::{Arch, Simd, WithSimd};

/// Samples of a block: a dozen signals of it stay in the cache nearest to the processor.
const BLOCK: usize = 512;
/// Samples below which vectors are not worth their choice.
const FEW: usize = 16;
/// Signals that one pass takes in.
const AT_ONCE: usize = 4;

/// A factor and what it multiplies.
pub(crate) type Term<'a> = (f64, &'a [f64]);

/// to += Σ c·x; signals shorter than `to` end it.
pub(crate) fn blend(to: &mut [f64], terms: &[Term<'_>]) {
    Arch::new().dispatch(Blend { to, terms });
}

struct Blend<'a> {
    to: &'a mut [f64],
    terms: &'a [Term<'a>],
}

impl WithSimd for Blend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for terms in self.terms.chunks(AT_ONCE) {
            match *terms {
                [a, b, c, d] => several(simd, self.to, [a, b, c, d]),
                [a, b, c] => several(simd, self.to, [a, b, c]),
                [a, b] => several(simd, self.to, [a, b]),
                [a] => several(simd, self.to, [a]),
                _ => {}
            }
        }
    }
}

#[inline(always)]
fn several<S: Simd, const K: usize>(simd: S, to: &mut [f64], terms: [Term<'_>; K]) {
    let n = terms.iter().map(|t| t.1.len()).fold(to.len(), usize::min);
    let (to, rest) = S::as_mut_simd_f64s(&mut to[..n]);
    let from = n - rest.len();
    let whole = to.len();
    let wide: [&[S::f64s]; K] = std::array::from_fn(|k| &S::as_simd_f64s(&terms[k].1[..n]).0[..whole]);
    let factors: [S::f64s; K] = std::array::from_fn(|k| simd.splat_f64s(terms[k].0));
    for (v, to) in to.iter_mut().enumerate() {
        for k in 0..K {
            *to = simd.mul_add_f64s(factors[k], wide[k][v], *to);
        }
    }
    for (t, to) in rest.iter_mut().enumerate() {
        for (c, x) in terms {
            *to += c * x[from + t];
        }
    }
}

/// Σ x.
pub(crate) fn total(x: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let chunks = x.chunks_exact(8);
    let rest: f64 = chunks.remainder().iter().sum();
    for chunk in chunks {
        for (sum, v) in sums.iter_mut().zip(chunk) {
            *sum += v;
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Σ a·b, up to the end of the shorter.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    if a.len().min(b.len()) < FEW {
        return a.iter().zip(b).map(|(a, b)| a * b).sum();
    }
    Arch::new().dispatch(Dot { a, b })
}

struct Dot<'a> {
    a: &'a [f64],
    b: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let n = self.a.len().min(self.b.len());
        product(simd, &self.a[..n], &self.b[..n])
    }
}

/// Σ a·b of every pair, block by block, so that a signal of several pairs is read once. All signals are of one length.
pub(crate) fn products(pairs: &[(&[f64], &[f64])]) -> Vec<f64> {
    let mut sums = vec![0.0; pairs.len()];
    Arch::new().dispatch(Products { pairs, sums: &mut sums });
    sums
}

struct Products<'a> {
    pairs: &'a [(&'a [f64], &'a [f64])],
    sums: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let n = self.pairs.iter().map(|(a, b)| a.len().min(b.len())).min().unwrap_or(0);
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            for ((a, b), sum) in self.pairs.iter().zip(self.sums.iter_mut()) {
                *sum += product(simd, &a[from..to], &b[from..to]);
            }
        }
    }
}

#[inline(always)]
fn product<S: Simd>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let ((a, rest_a), (b, rest_b)) = (S::as_simd_f64s(a), S::as_simd_f64s(b));
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (fours_a, fours_b) = (a.chunks_exact(4), b.chunks_exact(4));
    let ends = fours_a.remainder().iter().zip(fours_b.remainder());
    for (a, b) in fours_a.zip(fours_b) {
        for k in 0..4 {
            sums[k] = simd.mul_add_f64s(a[k], b[k], sums[k]);
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(ends) {
        *sum = simd.mul_add_f64s(*a, *b, *sum);
    }
    let sum = simd.add_f64s(simd.add_f64s(sums[0], sums[1]), simd.add_f64s(sums[2], sums[3]));
    simd.reduce_sum_f64s(sum) + rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_and_products_are_those_of_one_sample_after_the_other() {
        let signal = |seed: usize, n: usize| -> Vec<f64> { (0..n).map(|t| ((t * 7919 + seed * 31) % 17) as f64 - 8.0).collect() };
        for n in [0, 1, 3, 7, 8, 31, 511, 512, 513, 1301] {
            let signals: Vec<Vec<f64>> = (0..7).map(|k| signal(k, n)).collect();
            // Whole numbers: nothing is rounded.
            assert_eq!(dot(&signals[0], &signals[1]), signals[0].iter().zip(&signals[1]).map(|(a, b)| a * b).sum::<f64>());
            assert_eq!(total(&signals[0]), signals[0].iter().sum::<f64>());
            for count in 0..=7 {
                let terms: Vec<Term<'_>> = signals.iter().take(count).enumerate().map(|(k, x)| (k as f64 - 2.0, x.as_slice())).collect();
                let mut to = signal(9, n);
                blend(&mut to, &terms);
                for (t, (got, first)) in to.iter().zip(signal(9, n)).enumerate() {
                    assert_eq!(*got, first + terms.iter().map(|(c, x)| c * x[t]).sum::<f64>(), "{n} {count} {t}");
                }
                let pairs: Vec<(&[f64], &[f64])> = signals.iter().take(count).map(|x| (x.as_slice(), signals[0].as_slice())).collect();
                for ((a, b), got) in pairs.iter().zip(products(&pairs)) {
                    assert_eq!(got, a.iter().zip(*b).map(|(a, b)| a * b).sum::<f64>(), "{n} {count}");
                }
            }
        }
    }
}

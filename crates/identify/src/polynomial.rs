//! Polynomials F(q) = 1 + f₁q⁻¹ + …: roots, stability, and filtering by 1/F.

use deadtime_signal::decompositions::eigenvalues;
use nalgebra::{Complex, DMatrix};

use super::regression::Record;

/// Largest nf.
pub const MAX_ORDER: usize = 16;

/// F(q) has all roots well inside the unit circle (Schur-Cohn recursion).
pub(super) fn is_stable(f: &[f64]) -> bool {
    let mut a = [0.0; MAX_ORDER];
    let mut n = f.len();
    a[..n].copy_from_slice(f);
    while n > 0 {
        let k = a[n - 1];
        if k.is_nan() || k.abs() >= 1.0 - 1e-9 {
            return false;
        }
        let scale = 1.0 / (1.0 - k * k);
        let previous = a;
        for i in 0..n - 1 {
            a[i] = (previous[i] - k * previous[n - 2 - i]) * scale;
        }
        n -= 1;
    }
    true
}

/// The polynomial, its roots scaled by a common factor into the unit circle.
pub(super) fn stabilised(mut f: Vec<f64>) -> Option<Vec<f64>> {
    for _ in 0..60 {
        if is_stable(&f) {
            return Some(f);
        }
        let mut factor = 0.9;
        for c in &mut f {
            *c *= factor;
            factor *= 0.9;
        }
    }
    None
}

/// The largest magnitude among the roots of F.
pub fn largest_pole(f: &[f64]) -> f64 {
    roots(f).map_or(f64::NAN, |roots| roots.iter().map(|p| p.norm()).fold(0.0, f64::max))
}

/// x/F with zero initial state.
pub fn filtered(x: &[f64], f: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    filter(x, f, &mut out);
    out
}

/// Two signals divided by F from rest, in one pass. Each recursion waits for its own last value, so two take the time of one.
pub(super) fn filter_both(x: [&[f64]; 2], f: &[f64], out: [&mut [f64]; 2]) {
    match *f {
        [f1] => together([f1], x, out),
        [f1, f2] => together([f1, f2], x, out),
        [f1, f2, f3] => together([f1, f2, f3], x, out),
        [f1, f2, f3, f4] => together([f1, f2, f3, f4], x, out),
        _ => out.into_iter().zip(x).for_each(|(out, x)| filter(x, f, out)),
    }
}

fn together<const N: usize>(f: [f64; N], x: [&[f64]; 2], [first, second]: [&mut [f64]; 2]) {
    let common = x[0].len().min(x[1].len());
    let (mut p, mut q) = ([0.0; N], [0.0; N]);
    let both = first.iter_mut().zip(x[0]).zip(second.iter_mut().zip(x[1])).take(common);
    for ((a, &v), (b, &w)) in both {
        (*a, *b) = (next(&f, &mut p, v), next(&f, &mut q, w));
    }
    for (out, x, mut past) in [(first, x[0], p), (second, x[1], q)] {
        for (o, &v) in out.iter_mut().zip(x).skip(common) {
            *o = next(&f, &mut past, v);
        }
    }
}

/// The next value of x/F. The newest past value comes last, so that the other products need not wait for it.
#[inline]
fn next<const N: usize>(f: &[f64; N], past: &mut [f64; N], x: f64) -> f64 {
    let y = (0..N).rev().fold(x, |y, i| y - f[i] * past[i]);
    past.copy_within(..N - 1, 1);
    past[0] = y;
    y
}

/// The impulse response of 1/F until all later values are below `least`; at most `rows` values.
pub(super) fn impulse_response(f: &[f64], rows: usize, least: f64, h: &mut Vec<f64>) {
    h.clear();
    let mut small = 0;
    while h.len() < rows && small < f.len().max(1) {
        let past: f64 = f.iter().zip(h.iter().rev()).map(|(c, v)| c * v).sum();
        let value = if h.is_empty() { 1.0 } else { -past };
        small = if value.abs() < least { small + 1 } else { 0 };
        h.push(value);
    }
}

/// out = x/F with zero initial state.
pub(super) fn filter(x: &[f64], f: &[f64], out: &mut [f64]) {
    match *f {
        [f1] => alone([f1], x, out),
        [f1, f2] => alone([f1, f2], x, out),
        [f1, f2, f3] => alone([f1, f2, f3], x, out),
        [f1, f2, f3, f4] => alone([f1, f2, f3, f4], x, out),
        _ => {
            for t in 0..x.len() {
                let (past, rest) = out.split_at_mut(t);
                let count = f.len().min(t);
                let past = f[..count].iter().rev().zip(&past[t - count..]);
                rest[0] = past.fold(x[t], |y, (c, v)| y - c * v);
            }
        }
    }
}

fn alone<const N: usize>(f: [f64; N], x: &[f64], out: &mut [f64]) {
    let mut past = [0.0; N];
    for (o, &v) in out.iter_mut().zip(x) {
        *o = next(&f, &mut past, v);
    }
}

/// A record without missing samples, both channels through 1/C from rest.
pub fn prefiltered<'b>(record: &Record<'_>, c: &[f64]) -> Record<'b> {
    Record::new(filtered(&record.u, c), filtered(&record.y, c))
}

/// The roots of 1 + f₁q⁻¹ + … in z; `None` where they cannot be found.
pub(super) fn roots(f: &[f64]) -> Option<Vec<Complex<f64>>> {
    let n = f.len();
    if n == 0 {
        return Some(Vec::new());
    }
    if f.iter().any(|c| !c.is_finite()) {
        return None;
    }
    let companion =
        DMatrix::from_fn(n, n, |i, j| if i == 0 { -f[j] } else { f64::from(u8::from(i == j + 1)) });
    let roots = eigenvalues(&companion);
    roots.iter().all(|r| r.re.is_finite() && r.im.is_finite()).then_some(roots)
}

/// The polynomial with these roots, which come in conjugate pairs.
pub(super) fn from_roots(roots: &[Complex<f64>]) -> Vec<f64> {
    let mut f = vec![Complex::new(1.0, 0.0)];
    for root in roots {
        let mut next = f.clone();
        next.push(Complex::new(0.0, 0.0));
        for (i, v) in f.iter().enumerate() {
            next[i + 1] -= root * v;
        }
        f = next;
    }
    f.iter().skip(1).map(|v| v.re).collect()
}

/// Roots within this distance of the unit circle, or on it, are moved to this radius: a filter's transients must decay.
const CIRCLE: f64 = 0.995;

/// The polynomial with its roots outside the unit circle mirrored inside; its spectrum differs only in gain.
pub(super) fn reflected(f: &[f64]) -> Option<Vec<f64>> {
    let all = roots(f)?;
    if all.iter().all(|r| r.norm() < 1.0 - 1e-9) {
        return Some(f.to_vec());
    }
    let inside: Vec<Complex<f64>> = all
        .into_iter()
        .map(|r| {
            let r = if r.norm() > 1.0 { r.conj().inv() } else { r };
            if r.norm() > CIRCLE { r * (CIRCLE / r.norm()) } else { r }
        })
        .collect();
    Some(from_roots(&inside))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_outside_come_back_inside_mirrored() {
        // (1 − 2q⁻¹)(1 − 0.5q⁻¹) → (1 − 0.5q⁻¹)².
        let f = reflected(&[-2.5, 1.0]).unwrap();
        assert!((f[0] + 1.0).abs() < 1e-9 && (f[1] - 0.25).abs() < 1e-9, "{f:?}");
        // 1 + 4q⁻²: ±2i → ±0.5i.
        let f = reflected(&[0.0, 4.0]).unwrap();
        assert!(f[0].abs() < 1e-9 && (f[1] - 0.25).abs() < 1e-9, "{f:?}");
        assert_eq!(reflected(&[-0.9]).unwrap(), [-0.9]);
        assert!(reflected(&[f64::NAN]).is_none());
    }

    #[test]
    fn stability_is_that_of_the_roots() {
        assert!(is_stable(&[-1.8, 0.81]));
        assert!(!is_stable(&[-2.0, 1.0]));
        assert!(!is_stable(&[-2.1, 1.05]));
        assert!(is_stable(&[]));
        assert!(!is_stable(&[f64::NAN, 0.0]));
        // (z − 0.9)(z² + 0.5z + 0.8): inside; (z − 1.1)(…): outside.
        let cubic = |p: f64| vec![0.5 - p, 0.8 - 0.5 * p, -0.8 * p];
        assert!(is_stable(&cubic(0.9)));
        assert!(!is_stable(&cubic(1.1)));
    }

    /// x[t] = Σ fᵢ·y[t − i] with f₀ = 1, for orders with a specialised loop and without. Tested on two signals, also of unequal lengths.
    #[test]
    fn what_was_filtered_gives_back_the_signal() {
        let x: Vec<f64> = (0..50).map(|t| (0.7 * f64::from(t)).sin() + f64::from(t % 3)).collect();
        for order in 0..=6 {
            let f: Vec<f64> = (0..order)
                .map(|i| 0.4_f64.powi(i + 1) * if i % 2 == 0 { -1.0 } else { 1.0 })
                .collect();
            let y = filtered(&x, &f);
            for t in 0..x.len() {
                let past: f64 = f
                    .iter()
                    .enumerate()
                    .filter(|(i, _)| *i < t)
                    .map(|(i, c)| c * y[t - 1 - i])
                    .sum();
                assert!((y[t] + past - x[t]).abs() < 1e-12, "order {order}, sample {t}");
            }
            let (mut first, mut second) = (vec![0.0; 50], vec![0.0; 30]);
            filter_both([&x, &x[20..]], &f, [&mut first, &mut second]);
            assert_eq!((first, second), (y, filtered(&x[20..], &f)));
        }
    }
}

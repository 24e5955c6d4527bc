//! Realisation of zeros, poles and gain as a cascade of real sections, which keeps the accuracy of clustered poles.

use nalgebra::{Complex, DMatrix};

use super::error::ModelError;

/// Orders roots as conjugate pairs (upper first) followed by real ones; nearly conjugate roots become exact pairs.
pub(super) fn pair_conjugates(
    what: &'static str,
    roots: Vec<Complex<f64>>,
) -> Result<Vec<Complex<f64>>, ModelError> {
    let mut ordered = Vec::with_capacity(roots.len());
    let (mut real, mut complex): (Vec<_>, Vec<_>) = roots.into_iter().partition(|r| r.im == 0.0);
    complex.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    while let Some(first) = complex.pop() {
        if !(first.re.is_finite() && first.im.is_finite()) {
            return Err(ModelError::Unpaired { what, re: first.re, im: first.im });
        }
        let distance = |r: &Complex<f64>| (r - first.conj()).norm();
        let partner = (0..complex.len())
            .min_by(|&i, &j| distance(&complex[i]).total_cmp(&distance(&complex[j])));
        match partner {
            Some(at) if distance(&complex[at]) <= 1e-6 * first.norm() => {
                let other = complex.remove(at);
                let upper = Complex::new(
                    0.5 * (first.re + other.re),
                    0.5 * (first.im.abs() + other.im.abs()),
                );
                ordered.extend([upper, upper.conj()]);
            }
            // An imaginary part of rounding size belongs to a real root.
            _ if first.im.abs() <= 1e-9 * first.norm() => real.push(Complex::new(first.re, 0.0)),
            _ => return Err(ModelError::Unpaired { what, re: first.re, im: first.im }),
        }
    }
    if let Some(bad) = real.iter().find(|r| !r.re.is_finite()) {
        return Err(ModelError::Unpaired { what, re: bad.re, im: bad.im });
    }
    real.sort_by(|a, b| a.re.total_cmp(&b.re));
    ordered.extend(real);
    Ok(ordered)
}

/// A section: up to two poles with up to as many zeros.
struct Section {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: f64,
}

type Matrices = (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, DMatrix<f64>);

/// A, B, C, D of gain·Π(x − zero)/Π(x − pole). Roots must be ordered by [`pair_conjugates`].
pub(super) fn realise(
    zeros: &[Complex<f64>],
    poles: &[Complex<f64>],
    gain: f64,
) -> Result<Matrices, ModelError> {
    if zeros.len() > poles.len() {
        return Err(ModelError::Improper { zeros: zeros.len(), poles: poles.len() });
    }
    let (mut a, mut b) = (DMatrix::zeros(0, 0), DMatrix::zeros(0, 1));
    let (mut c, mut d) = (DMatrix::zeros(1, 0), DMatrix::from_element(1, 1, gain));
    for section in sections(zeros, poles) {
        // Series connection: the cascade so far drives this section.
        let (n, m) = (a.nrows(), section.a.nrows());
        let mut next = DMatrix::zeros(n + m, n + m);
        next.view_mut((0, 0), (n, n)).copy_from(&a);
        next.view_mut((n, 0), (m, n)).copy_from(&(&section.b * &c));
        next.view_mut((n, n), (m, m)).copy_from(&section.a);
        let mut next_b = DMatrix::zeros(n + m, 1);
        next_b.view_mut((0, 0), (n, 1)).copy_from(&b);
        next_b.view_mut((n, 0), (m, 1)).copy_from(&(&section.b * d[(0, 0)]));
        let mut next_c = DMatrix::zeros(1, n + m);
        next_c.view_mut((0, 0), (1, n)).copy_from(&(&c * section.d));
        next_c.view_mut((0, n), (1, m)).copy_from(&section.c);
        d *= section.d;
        (a, b, c) = (next, next_b, next_c);
    }
    Ok((a, b, c, d))
}

/// Splits roots into sections; every section takes the zeros nearest to its poles, and complex zeros take real poles in twos.
fn sections(zeros: &[Complex<f64>], poles: &[Complex<f64>]) -> Vec<Section> {
    let split = |roots: &[Complex<f64>]| {
        let pairs: Vec<Complex<f64>> = roots.iter().copied().filter(|r| r.im > 0.0).collect();
        let real: Vec<f64> = roots.iter().filter(|r| r.im == 0.0).map(|r| r.re).collect();
        (pairs, real)
    };
    let (mut zero_pairs, mut real_zeros) = split(zeros);
    let (pole_pairs, mut real_poles) = split(poles);
    let mut sections = Vec::new();
    for p in pole_pairs {
        let (sigma, omega) = (p.re, p.im);
        // (xI − A)⁻¹B = [ω; x − σ] / ((x − σ)² + ω²)
        let (constant, linear, d) = nearest_zeros(p, &mut zero_pairs, &mut real_zeros);
        sections.push(Section {
            a: DMatrix::from_row_slice(2, 2, &[sigma, omega, -omega, sigma]),
            b: DMatrix::from_column_slice(2, 1, &[0.0, 1.0]),
            c: DMatrix::from_row_slice(1, 2, &[constant / omega, linear]),
            d,
        });
    }
    for z in zero_pairs {
        // Two real poles for a pair of complex zeros; they exist, because zeros never outnumber poles.
        let p1 = take_nearest(&mut real_poles, |p| (p - z.re).abs()).unwrap_or(0.0);
        let p2 = take_nearest(&mut real_poles, |p| (p - z.re).abs()).unwrap_or(0.0);
        let a = DMatrix::from_row_slice(2, 2, &[p1, 1.0, 0.0, p2]);
        let c = DMatrix::from_row_slice(
            1,
            2,
            &[(p1 - z.re).powi(2) + z.im * z.im, p1 + p2 - 2.0 * z.re],
        );
        sections.push(Section { a, b: DMatrix::from_column_slice(2, 1, &[0.0, 1.0]), c, d: 1.0 });
    }
    while !real_poles.is_empty() {
        let anchor = real_zeros.first().copied();
        let p =
            take_nearest(&mut real_poles, |p| anchor.map_or(0.0, |q| (p - q).abs())).unwrap_or(0.0);
        let zero = if anchor.is_some() { Some(real_zeros.remove(0)) } else { None };
        let (c, d) = zero.map_or((1.0, 0.0), |q| (p - q, 1.0));
        sections.push(Section {
            a: DMatrix::from_element(1, 1, p),
            b: DMatrix::from_element(1, 1, 1.0),
            c: DMatrix::from_element(1, 1, c),
            d,
        });
    }
    sections
}

/// The numerator of a pair of complex poles, from the nearest zeros. Constant and linear coefficient without the direct path, and the direct path.
fn nearest_zeros(
    p: Complex<f64>,
    zero_pairs: &mut Vec<Complex<f64>>,
    real_zeros: &mut Vec<f64>,
) -> (f64, f64, f64) {
    let (sigma, omega) = (p.re, p.im);
    if let Some(z) = take_nearest(zero_pairs, |z| (z - p).norm()) {
        let shift = sigma - z.re;
        (shift * shift + (z.im - omega) * (z.im + omega), 2.0 * shift, 1.0)
    } else if real_zeros.len() >= 2 {
        let q1 = take_nearest(real_zeros, |q| (q - sigma).abs()).unwrap_or(sigma);
        let q2 = take_nearest(real_zeros, |q| (q - sigma).abs()).unwrap_or(sigma);
        ((sigma - q1) * (sigma - q2) - omega * omega, 2.0 * sigma - q1 - q2, 1.0)
    } else if let Some(q) = real_zeros.pop() {
        (sigma - q, 1.0, 0.0)
    } else {
        (1.0, 0.0, 0.0)
    }
}

fn take_nearest<R: Copy>(roots: &mut Vec<R>, distance: impl Fn(R) -> f64) -> Option<R> {
    let at = (0..roots.len()).min_by(|&i, &j| distance(roots[i]).total_cmp(&distance(roots[j])))?;
    Some(roots.remove(at))
}

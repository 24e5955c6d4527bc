//! Laguerre models: a series of orthonormal filters with one repeated pole.

use nalgebra::{DMatrix, DVector};

use super::regression::{Record, dot};

/// y(t) = Σ cₖ Lₖ(q) u(t) + e(t), Lₖ(z) = √(1 − a²)/(z − a)·((1 − az)/(z − a))^(k−1), fitted by least squares. Records are assumed to begin at rest.
///
/// Source: Wahlberg (1991), "System identification using Laguerre models", IEEE Trans. Automat. Contr. 36(5), 551-562.
#[derive(Debug, Clone, PartialEq)]
pub struct Laguerre {
    /// a.
    pub pole: f64,
    /// c₁ … c_order.
    pub c: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Σ e²/rows.
    pub loss: f64,
}

/// The outputs of L₁ … L_order, at rest before the first sample.
fn filters(u: &[f64], pole: f64, order: usize) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = Vec::with_capacity(order);
    let scale = (1.0 - pole * pole).sqrt();
    for _ in 0..order {
        let mut out = vec![0.0; u.len()];
        let mut state = 0.0;
        match all.last() {
            None => {
                for (o, u) in out.iter_mut().zip(u) {
                    *o = state;
                    state = pole * state + scale * u;
                }
            }
            // (z⁻¹ − a)/(1 − a·z⁻¹)
            Some(before) => {
                for (o, x) in out.iter_mut().zip(before) {
                    *o = state - pole * x;
                    state = pole * *o + x;
                }
            }
        }
        all.push(out);
    }
    all
}

/// The model of one pole; `None` where the input does not excite all filters or rows are too few.
pub fn laguerre(records: &[Record], pole: f64, order: usize) -> Option<Laguerre> {
    let mut gram = DMatrix::<f64>::zeros(order, order);
    let mut right = DVector::<f64>::zeros(order);
    let (mut power, mut rows) = (0.0, 0_usize);
    for record in records {
        let n = record.len();
        let mut columns = filters(&record.u[..n], pole, order);
        // A row without its output is left out.
        let mut y = record.y[..n].to_vec();
        let missing =
            record.present.as_ref().map_or(Vec::new(), |p| (0..n).filter(|&t| !p[t]).collect());
        for &t in &missing {
            columns.iter_mut().for_each(|c| c[t] = 0.0);
            y[t] = 0.0;
        }
        rows += n - missing.len();
        power += dot(&y, &y);
        for (i, a) in columns.iter().enumerate() {
            right[i] += dot(a, &y);
            for (j, b) in columns.iter().enumerate().take(i + 1) {
                gram[(i, j)] += dot(a, b);
            }
        }
    }
    if rows <= order {
        return None;
    }
    // At least half of the digits must remain; only the lower triangle is read.
    let least: Vec<f64> = gram.diagonal().iter().map(|v| 1e-11 * v).collect();
    let factor = gram.cholesky()?;
    if least.iter().enumerate().any(|(i, least)| factor.l_dirty()[(i, i)].powi(2) <= *least) {
        return None;
    }
    let c = factor.solve(&right);
    // Rounding may make the difference negative.
    let squares = (power - c.dot(&right)).max(1e-15 * power);
    let (loss, variance) = (squares / rows as f64, squares / (rows - order) as f64);
    let covariance = factor.inverse() * variance;
    let sound = c.iter().chain(&covariance).all(|v| v.is_finite());
    sound.then_some(Laguerre { pole, c, covariance, loss })
}

/// Σ x(t)·lₖ(t), k = 0 … order − 1, for signals of one length: their spectra in orthonormal sequences. The sequences are l₀ = √(1 − a²)·z/(z − a), lₖ₊₁ = w·lₖ,
/// w = (1 − az)/(z − a).
pub fn laguerre_spectra(signals: [&[f64]; 2], pole: f64, order: usize) -> [Vec<f64>; 2] {
    let samples = signals[0].len().min(signals[1].len());
    let mut sequence: Vec<f64> =
        std::iter::successors(Some((1.0 - pole * pole).sqrt()), |v| Some(pole * v))
            .take(samples)
            .collect();
    let mut spectra = [Vec::with_capacity(order), Vec::with_capacity(order)];
    for _ in 0..order {
        for (spectrum, signal) in spectra.iter_mut().zip(signals) {
            spectrum.push(dot(&sequence, &signal[..samples]));
        }
        let mut state = 0.0;
        for x in &mut sequence {
            let out = state - pole * *x;
            state = pole * out + *x;
            *x = out;
        }
    }
    spectra
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn impulse(samples: usize) -> Vec<f64> {
        let mut u = vec![0.0; samples];
        u[0] = 1.0;
        u
    }

    #[test]
    fn the_filters_are_orthonormal() {
        let all = filters(&impulse(2000), 0.8, 12);
        for (i, a) in all.iter().enumerate() {
            for (j, b) in all.iter().enumerate() {
                assert!((dot(a, b) - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j}");
            }
        }
        // √(1 − a²)/(z − a) = 0.6·(z⁻¹ + 0.8z⁻² + …).
        assert!(
            (all[0][0], all[0][1]) == (0.0, (1.0_f64 - 0.8 * 0.8).sqrt())
                && (all[0][2] - 0.48).abs() < 1e-15
        );
    }

    #[test]
    fn a_model_of_the_class_is_found_whatever_is_missing() {
        let mut state = 5_u64;
        let u: Vec<f64> = (0..300)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
            })
            .collect();
        let (columns, c) = (filters(&u, 0.6, 3), [1.0, -0.5, 0.25]);
        let y: Vec<f64> =
            (0..300).map(|t| columns.iter().zip(c).map(|(x, c)| c * x[t]).sum()).collect();
        let mut record = Record::new(u, y);
        for present in [None, Some((0..300).map(|t| t % 7 != 2).collect())] {
            record.present = present;
            let found = laguerre(std::slice::from_ref(&record), 0.6, 3).unwrap();
            assert!(found.c.iter().zip(c).all(|(a, b)| (a - b).abs() < 1e-10), "{found:?}");
        }
    }

    #[test]
    fn spectra_are_the_sums_over_the_sequences() {
        let x: Vec<f64> = (0..900).map(|t| (0.3 * t as f64).sin() * 0.99_f64.powi(t)).collect();
        let [spectrum, zero] = laguerre_spectra([&x, &vec![0.0; 900]], 0.7, 300);
        // Parseval: nearly all power is in the first 300.
        assert_abs_diff_eq!(dot(&spectrum, &spectrum) / dot(&x, &x), 1.0, epsilon = 1e-9);
        // The filters have one more sample of delay.
        for (k, filtered) in filters(&impulse(901), 0.7, 5).iter().enumerate() {
            assert!((spectrum[k] - dot(&filtered[1..], &x)).abs() < 1e-12 && zero[k] == 0.0);
        }
    }
}

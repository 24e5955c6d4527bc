//! Fractional delays for conversions that do not represent them.

use nalgebra::{Complex, DMatrix};

use crate::error::ModelError;
use crate::state_space::{Sampled, StateSpace};
use crate::{cascade, zeros};
use deadtime_signal::time::{SampleTime, Samples};

/// Moves the delays to the inputs: whole samples, and the fractions as Thiran all-pass filters of at most `order` states each.
///
/// Order 0 rounds to the nearest sample, half a sample up.
pub(super) fn with_delays(
    sys: StateSpace<Sampled>,
    delays_s: &[f64],
    sample_time: SampleTime,
    order: usize,
) -> Result<StateSpace<Sampled>, ModelError> {
    let mut whole = Vec::with_capacity(delays_s.len());
    let mut filters = Vec::with_capacity(delays_s.len());
    for &delay_s in delays_s {
        let delay = sample_time.samples(delay_s)?;
        let (samples, filter) = split(delay, order)?;
        whole.push(samples);
        filters.push(filter);
    }
    cascade_inputs(&sys, &filters)?.with_input_delay(whole)
}

/// A delay as an all-pass filter in sampled time, maximally flat at low frequencies. Without `order` it has ⌈delay/sample_time⌉ states, as MATLAB's
/// `thiran(tau, Ts)`; with `order` at most that many, behind whole samples of input delay. A whole number of samples is an input delay alone.
///
/// Source: Thiran (1971), doi:10.1109/TCT.1971.1083363.
///
/// # Errors
/// [`ModelError::Time`] for a delay that is negative or not finite.
pub fn thiran(
    delay_s: f64,
    sample_time: SampleTime,
    order: Option<usize>,
) -> Result<StateSpace<Sampled>, ModelError> {
    let delay = sample_time.samples(delay_s)?;
    let (samples, filter) = match order {
        Some(order) => split(delay, order)?,
        None if delay.fraction == 0.0 => (delay.whole, None),
        None => (0, Some(all_pass(delay.whole + 1, delay.total())?)),
    };
    let (none, one) = (DMatrix::zeros(0, 0), DMatrix::from_element(1, 1, 1.0));
    let gain =
        StateSpace::sampled(none, DMatrix::zeros(0, 1), DMatrix::zeros(1, 0), one, sample_time)?;
    cascade_inputs(&gain, &[filter])?.with_input_delay(vec![samples])
}

/// The whole samples to which a delay is rounded. `None` where a filter of at most `order` states represents its fraction, or it has none.
pub(super) fn rounded(delay: Samples, order: usize) -> Option<usize> {
    let nearest = nearest(delay);
    (delay.fraction != 0.0 && order.min(nearest) == 0).then_some(nearest)
}

/// Half a sample up.
fn nearest(delay: Samples) -> usize {
    (delay.total() + 0.5).floor() as usize
}

/// A, B, C and the direct path of an all-pass filter.
type AllPass = (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, f64);
type Filter = Option<AllPass>;

/// Whole samples, and the all-pass filter for the fraction.
fn split(delay: Samples, order: usize) -> Result<(usize, Filter), ModelError> {
    let total = delay.total();
    let nearest = nearest(delay);
    let m = order.min(nearest);
    if delay.fraction == 0.0 || m == 0 {
        return Ok((nearest, None));
    }
    let pure = nearest - m;
    let (a, b, c, d) = all_pass(m, total - pure as f64)?;
    Ok((pure, Some((a, b, c, d))))
}

/// The maximally flat all-pass filter of order m with a low-frequency delay of `delay` samples, m − ½ ≤ delay < m + ½. The coefficients are a_k = (−1)ᵏ C(m,k)
/// Π_{i=0..m} (δ−m+i)/(δ−m+k+i).
///
/// Source: Thiran (1971), IEEE Trans. Circuit Theory 18(6), 659-664, doi:10.1109/TCT.1971.1083363.
fn all_pass(m: usize, delay: f64) -> Result<AllPass, ModelError> {
    let real = |k: usize| k as f64;
    let mut coefficients = vec![1.0];
    let mut binomial = 1.0;
    for k in 1..=m {
        binomial *= real(m + 1 - k) / real(k);
        let ratio: f64 = (0..=m)
            .map(|i| (delay - real(m) + real(i)) / (delay - real(m) + real(k + i)))
            .product();
        coefficients.push(if k % 2 == 0 { binomial } else { -binomial } * ratio);
    }
    let companion = DMatrix::from_fn(m, m, |i, j| {
        if i == 0 { -coefficients[j + 1] } else { f64::from(u8::from(i == j + 1)) }
    });
    let poles = cascade::pair_conjugates("pole", zeros::eigenvalues(&companion))?;
    // An all-pass filter's zeros are the reciprocals of its poles; its leading coefficient is a_m.
    let zeros = cascade::pair_conjugates(
        "zero",
        poles.iter().map(|p| Complex::new(1.0, 0.0) / p).collect(),
    )?;
    let (a, b, c, d) = cascade::realise(&zeros, &poles, coefficients[m])?;
    Ok((a, b, c, d[(0, 0)]))
}

/// The model with a filter before each input that has one.
fn cascade_inputs(
    sys: &StateSpace<Sampled>,
    filters: &[Filter],
) -> Result<StateSpace<Sampled>, ModelError> {
    let n = sys.order();
    let order = n + filters.iter().flatten().map(|f| f.0.nrows()).sum::<usize>();
    let mut a = DMatrix::zeros(order, order);
    a.view_mut((0, 0), (n, n)).copy_from(sys.a());
    let mut b = DMatrix::zeros(order, sys.inputs());
    b.view_mut((0, 0), (n, sys.inputs())).copy_from(sys.b());
    let mut c = DMatrix::zeros(sys.outputs(), order);
    c.view_mut((0, 0), (sys.outputs(), n)).copy_from(sys.c());
    let mut d = sys.d().clone();
    let mut at = n;
    for (j, filter) in filters.iter().enumerate() {
        let Some((fa, fb, fc, fd)) = filter else { continue };
        let m = fa.nrows();
        a.view_mut((at, at), (m, m)).copy_from(fa);
        a.view_mut((0, at), (n, m)).copy_from(&(sys.b().column(j) * fc));
        c.view_mut((0, at), (sys.outputs(), m)).copy_from(&(sys.d().column(j) * fc));
        b.view_mut((at, j), (m, 1)).copy_from(fb);
        b.view_mut((0, j), (n, 1)).scale_mut(*fd);
        d.column_mut(j).scale_mut(*fd);
        at += m;
    }
    StateSpace::sampled(a, b, c, d, sys.sample_time())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filters are all-pass with the right low-frequency delay, for any order.
    #[test]
    fn filters_are_late_by_their_delay() {
        let ts = SampleTime::new(0.1).unwrap();
        for (samples, order, states, whole) in
            [(2.4, None, 3, 0), (2.4, Some(1), 1, 1), (3.0, None, 0, 3), (17.6, Some(20), 18, 0)]
        {
            let filter = thiran(samples * 0.1, ts, order).unwrap();
            assert_eq!((filter.order(), filter.input_delay()[0]), (states, whole), "{samples}");
            for omega in [0.1, 1.0, 20.0] {
                let response = filter.frequency_response(omega)[(0, 0)];
                assert!((response.norm() - 1.0).abs() < 1e-11, "{samples} {omega}");
            }
            let late = Complex::from_polar(1.0, -0.3 * samples * 0.1);
            let response = filter.frequency_response(0.3)[(0, 0)];
            assert!((response - late).norm() < 1e-4, "{samples}: {response} {late}");
        }
        assert!(thiran(-0.1, ts, None).is_err());
    }
}

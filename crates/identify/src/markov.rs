//! Markov parameters from records, and the state-space model that has them.
//!
//! How it can be wrong: fewer parameters than the response lasts (`markov` has no term for the remainder). A past shorter than the observer's memory (`okid`).
//! An order above that of the parameters (singular values of rounding size are refused).

use deadtime_signal::decompositions::svd;
use nalgebra::DMatrix;

use super::error::{IdentifyError, Result};
use super::subspace::Recordings;
use deadtime_model::{Sampled, StateSpace};
use deadtime_signal::time::SampleTime;

/// A direction of the past below this share of the largest is zero.
const SEEN: f64 = 1e-10;
/// A singular value below this share of the largest is rounding.
const ROUNDING: f64 = 1e-12;

fn unfit(method: &'static str, reason: &str) -> IdentifyError {
    IdentifyError::Unfit { method, reason: reason.to_owned() }
}

/// The first `count` Markov parameters D, CB, CAB, … (each p×m), from least squares of y(t) on u(t) … u(t − count + 1). Records begin at rest.
///
/// # Errors
/// [`IdentifyError::TooShort`] for fewer rows than unknowns, [`IdentifyError::Unfit`] for inputs that excite too little.
pub fn markov(
    recordings: &Recordings,
    count: usize,
) -> std::result::Result<Vec<DMatrix<f64>>, IdentifyError> {
    let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    for s in &recordings.stretches {
        for t in 0..s.len() {
            let lag = |i: usize| t.checked_sub(i);
            rows.extend(
                (0..count).flat_map(|i| (0..m).map(move |j| lag(i).map_or(0.0, |at| s.u[(j, at)]))),
            );
            targets.extend((0..l).map(|i| s.y[(i, t)]));
        }
    }
    let solved = least_squares("markov", (&rows, count * m), (&targets, l))?;
    Ok((0..count).map(|k| solved.rows(k * m, m).transpose()).collect())
}

/// The first `count` Markov parameters by an observer with a memory of `past` samples. Records may begin in any state, and the response may last longer.
///
/// Source: Juang, Phan, Horta and Longman (1993), "Identification of observer/Kalman filter Markov parameters: theory and experiments", J. Guidance, Control, and
/// Dynamics 16(2), 320-329, doi:10.2514/3.21006.
///
/// # Errors
/// As [`markov`].
pub fn okid(
    recordings: &Recordings,
    past: usize,
    count: usize,
) -> std::result::Result<Vec<DMatrix<f64>>, IdentifyError> {
    let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
    let width = m + past * (m + l);
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    for s in &recordings.stretches {
        for t in past..s.len() {
            rows.extend((0..m).map(|j| s.u[(j, t)]));
            for lag in 1..=past {
                rows.extend((0..m).map(|j| s.u[(j, t - lag)]));
                rows.extend((0..l).map(|i| s.y[(i, t - lag)]));
            }
            targets.extend((0..l).map(|i| s.y[(i, t)]));
        }
    }
    // Among equally good observers the one with the least coefficients: without noise there are many.
    let got = targets.len() / l.max(1);
    if got < width {
        return Err(IdentifyError::TooShort { method: "okid", needed: width, got });
    }
    let (x, y) =
        (DMatrix::from_row_slice(got, width, &rows), DMatrix::from_row_slice(got, l, &targets));
    let found = svd(&x).ok_or_else(|| unfit("okid", "the records are zero or overflow"))?;
    let small = SEEN * found.singular_values.max();
    let solved = found.solve(&y, small).map_err(|reason| unfit("okid", reason))?;
    let of_input = |lag: usize| solved.rows(m + (lag - 1) * (m + l), m).transpose();
    let of_output = |lag: usize| solved.rows(m + (lag - 1) * (m + l) + m, l).transpose();
    let mut all = vec![solved.rows(0, m).transpose()];
    for k in 1..count {
        let mut next = if k <= past { of_input(k) } else { DMatrix::zeros(l, m) };
        for lag in 1..=k.min(past) {
            next += of_output(lag) * &all[k - lag];
        }
        all.push(next);
    }
    all.truncate(count);
    Ok(all)
}

/// The model of `order` states with these Markov parameters D, CB, CAB, …, by the singular value decomposition of their Hankel matrix (ERA).
///
/// Source: Juang and Pappa (1985), "An eigensystem realization algorithm for modal parameter identification and model reduction", J. Guidance, Control, and Dynamics
/// 8(5), 620-627, doi:10.2514/3.20031.
///
/// # Errors
/// [`IdentifyError::Unfit`] for an order that the parameters cannot determine.
pub fn era(
    markov: &[DMatrix<f64>],
    order: usize,
    sample_time: SampleTime,
) -> Result<StateSpace<Sampled>> {
    let Some(d) = markov.first() else {
        return Err(unfit("era", "no Markov parameter is given").into());
    };
    let (l, m) = d.shape();
    if markov.iter().any(|h| h.shape() != (l, m)) {
        return Err(unfit("era", "the Markov parameters differ in shape").into());
    }
    let half = markov.len().saturating_sub(1) / 2;
    let block = |shift: usize| {
        DMatrix::from_fn(half * l, half * m, |i, j| {
            markov[1 + i / l + j / m + shift][(i % l, j % m)]
        })
    };
    let none = "so many states do not show in these Markov parameters; take a smaller order, or more parameters";
    if order > half * l.min(m) {
        return Err(unfit("era", none).into());
    }
    if order == 0 {
        let (a, b, c) = (DMatrix::zeros(0, 0), DMatrix::zeros(0, m), DMatrix::zeros(l, 0));
        return Ok(StateSpace::sampled(a, b, c, d.clone(), sample_time)?);
    }
    let Some(found) = svd(&block(0)) else { return Err(unfit("era", none).into()) };
    let (Some(u), Some(vt)) = (found.u, found.v_t) else { return Err(unfit("era", none).into()) };
    let size = |k: usize| found.singular_values[k];
    if size(order - 1) <= ROUNDING * size(0) {
        return Err(unfit("era", none).into());
    }
    let left = DMatrix::from_fn(half * l, order, |i, k| u[(i, k)] * size(k).sqrt());
    let right = DMatrix::from_fn(order, half * m, |k, j| vt[(k, j)] * size(k).sqrt());
    let over = |matrix: DMatrix<f64>| {
        DMatrix::from_fn(order, matrix.ncols(), |k, j| matrix[(k, j)] / size(k))
    };
    let a = over(over(left.tr_mul(&(block(1) * right.transpose()))).transpose()).transpose();
    let (b, c) = (right.columns(0, m.min(right.ncols())), left.rows(0, l.min(left.nrows())));
    Ok(StateSpace::sampled(a, b.into_owned(), c.into_owned(), d.clone(), sample_time)?)
}

/// The coefficients of every column of the targets, row by row.
fn least_squares(
    method: &'static str,
    (rows, width): (&[f64], usize),
    (targets, outputs): (&[f64], usize),
) -> std::result::Result<DMatrix<f64>, IdentifyError> {
    let got = rows.len() / width.max(1);
    if got < width || width == 0 {
        return Err(IdentifyError::TooShort { method, needed: width, got });
    }
    let x = DMatrix::from_row_slice(got, width, rows);
    let y = DMatrix::from_row_slice(got, outputs, targets);
    let qr = x.qr();
    let r = qr.r();
    let largest = r.diagonal().amax();
    let poor = "the inputs are not rich enough for so many parameters; take fewer, or record with a richer input";
    if r.diagonal().iter().any(|v| v.abs() <= ROUNDING * largest) {
        return Err(unfit(method, poor));
    }
    r.solve_upper_triangular(&qr.q().tr_mul(&y)).ok_or_else(|| unfit(method, poor))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subspace::{Named, Stretch};
    use nalgebra::DVector;

    fn system() -> StateSpace<Sampled> {
        let m = |r: usize, e: &[f64]| DMatrix::from_row_slice(r, e.len() / r, e);
        StateSpace::sampled(
            m(3, &[0.7, 0.2, 0.0, -0.3, 0.5, 0.1, 0.0, 0.2, -0.4]),
            m(3, &[1.0, 0.0, 0.5, 1.0, 0.0, -0.7]),
            m(2, &[1.0, 0.0, 0.3, 0.0, 1.0, -1.0]),
            m(2, &[0.1, 0.0, 0.0, -0.2]),
            SampleTime::new(0.1).unwrap(),
        )
        .unwrap()
    }

    fn truth(count: usize) -> Vec<DMatrix<f64>> {
        let sys = system();
        let mut all = vec![sys.d().clone()];
        let mut x = sys.b().clone();
        for _ in 1..count {
            all.push(sys.c() * &x);
            x = sys.a() * x;
        }
        all
    }

    /// A record from rest, or from another state.
    fn record(start: f64) -> Recordings {
        let sys = system();
        let samples = 300;
        let u = DMatrix::from_fn(2, samples, |i, t| {
            (1.0 + (3.1 + i as f64) * (t * t) as f64 * 0.37).sin()
        });
        let mut x = DVector::from_element(3, start);
        let mut y = DMatrix::zeros(2, samples);
        for t in 0..samples {
            y.set_column(t, &(sys.c() * &x + sys.d() * u.column(t)));
            x = sys.a() * &x + sys.b() * u.column(t);
        }
        let named =
            |names: [&str; 2]| names.map(|n| Named { name: n.to_owned(), unit: None }).to_vec();
        Recordings {
            sample_time: sys.sample_time(),
            inputs: named(["u1", "u2"]),
            outputs: named(["y1", "y2"]),
            stretches: vec![Stretch { u, y }],
        }
    }

    fn near(found: &[DMatrix<f64>], tolerance: f64) {
        for (k, (h, t)) in found.iter().zip(truth(found.len())).enumerate() {
            assert!((h - &t).norm() < tolerance, "{k}: {h} {t}");
        }
    }

    #[test]
    fn parameters_of_exact_records_are_the_systems() {
        near(&markov(&record(0.0), 60).unwrap(), 1e-8);
        near(&okid(&record(2.0), 6, 40).unwrap(), 1e-9);
        assert!(markov(&record(0.0), 400).is_err());
    }

    #[test]
    fn the_model_of_parameters_has_their_response_and_no_more_states_than_they_show() {
        let found = era(&truth(21), 3, SampleTime::new(0.1).unwrap()).unwrap();
        for omega in [0.0, 2.0, 30.0] {
            let apart = found.frequency_response(omega) - system().frequency_response(omega);
            assert!(apart.norm() < 1e-11, "{omega}: {apart}");
        }
        assert!(era(&truth(21), 4, SampleTime::new(0.1).unwrap()).is_err());
        assert!(era(&truth(3), 3, SampleTime::new(0.1).unwrap()).is_err());
        assert_eq!(era(&truth(21), 0, SampleTime::new(0.1).unwrap()).unwrap().order(), 0);
    }
}

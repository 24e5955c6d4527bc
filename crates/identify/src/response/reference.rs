//! Closed loops: the response from u to y by a reference r that is independent of the noise.
//!
//! Equation: G = G_yr·G_ur⁻¹, and δG = [I, −G]·δG_zr·G_ur⁻¹ with z = [y; u].

use nalgebra::{Complex, DMatrix};

use super::lines::{Line, Seen};
use crate::error::IdentifyError;

/// The responses from the m inputs to the first l outputs; the inputs are the last m of the l + m outputs of `seen`. Lines without a reference effect on the
/// inputs are dropped.
///
/// Assumes: the references are independent of noise, and at least one reference moves each input.
/// Fails when: the references have collinear effects on the inputs at every line. [`IdentifyError::References`] has the numbers.
/// Source: Pintelon and Schoukens (2012), 2nd ed., section 2.6.4, doi:10.1002/9781118287422 (joint input-output approach).
pub(super) fn divided(seen: Seen, outputs: usize) -> Result<Seen, IdentifyError> {
    let all = seen.lines.len();
    let lines: Vec<Line> = seen.lines.into_iter().filter_map(|line| at(line, outputs)).collect();
    if lines.is_empty() {
        return Err(IdentifyError::Unmoved);
    }
    let mut notes = seen.notes;
    if lines.len() < all {
        notes.push(format!(
            "{} frequencies are left out: the references do not move the inputs there beyond noise",
            all - lines.len()
        ));
    }
    Ok(Seen { lines, notes })
}

fn at(line: Line, outputs: usize) -> Option<Line> {
    let m = line.g.nrows().checked_sub(outputs)?;
    let (y, u) = (line.g.rows(0, outputs).into_owned(), line.g.rows(outputs, m).into_owned());
    let back = u
        .clone()
        .try_inverse()
        .filter(|b| b.iter().all(|v| v.re.is_finite() && v.im.is_finite()))?;
    // Where noise hides the inputs' own responses, the division would be by noise, without a valid first-order variance.
    let moved = (0..m).all(|i| {
        let power: f64 = u.row(i).iter().map(|v| v.norm_sqr()).sum();
        let noise: f64 = (0..m)
            .map(|r| line.noise[(outputs + i, outputs + i)].re * line.weight[(r, r)].re)
            .sum();
        power > LEAST_RATIO * noise
    });
    if !moved {
        return None;
    }
    let g = &y * &back;
    // [I, −G]
    let from = DMatrix::from_fn(outputs, outputs + m, |a, b| match b.checked_sub(outputs) {
        Some(i) => -g[(a, i)],
        None => Complex::from(if a == b { 1.0 } else { 0.0 }),
    });
    Some(Line {
        omega_rad_s: line.omega_rad_s,
        noise: &from * &line.noise * from.adjoint(),
        weight: back.adjoint() * &line.weight * &back,
        inverse_power: back.adjoint() * &line.inverse_power * &back,
        freedom: line.freedom,
        g,
    })
}

/// Least squared response of the inputs to the references over the variance of its error. Below it the first-order variance of a ratio is too small (10 in
/// power, about a third in size).
const LEAST_RATIO: f64 = 10.0;

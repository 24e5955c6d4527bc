//! The local polynomial method: response and transient are smooth over frequency, noise is not.
//!
//! Equation: Y(k+r) = G(k+r)·U(k+r) + T(k+r) + V(k+r), r = −n … n, by least squares. G(k+r) = G(k) + Σₛ gₛ(k)·rˢ and T alike, s = 1 … R. The residual gives the
//! noise's covariance, with q = 2n + 1 − (R+1)(m+1) degrees of freedom.

use nalgebra::{Complex, DMatrix};
use serde::{Deserialize, Serialize};

use super::lines::{Line, Seen};
use super::responses::{ResponseMethod, unexcited};
use crate::error::IdentifyError;
use crate::subspace::recordings::{Recordings, Stretch};
use deadtime_signal::parallel;
use deadtime_signal::{RealFourier, stats};

/// The local polynomial method (LPM).
///
/// Inputs: records of m inputs and l outputs, N samples each; Output: G at up to `lines` frequencies.
/// Assumes: a linear plant, inputs independent of the outputs' noise, G smooth over a window of 2n + 1 lines.
/// Resolution and cost: the grid of the longest record; O(N log N) and a regression per line. Several records share G, each has its own transient.
/// Fails when: inputs excite single lines only (a multisine with widely spaced lines). The slope of G is then undetermined, and the lines are absent. A
/// resonance narrower than the window is smoothed, and the residual widens the interval.
/// Source: Pintelon, Schoukens, Vandersteen and Barbé (2010), Mech. Syst. Signal Process. 24(3), 573-595, doi:10.1016/j.ymssp.2009.08.009; Pintelon and
/// Schoukens (2012), 2nd ed., section 7.2.2, doi:10.1002/9781118287422.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalPolynomial {
    /// R, the order of the polynomials; default 2, at most 6.
    pub order: usize,
    /// Minimum of q, the complex degrees of freedom of the noise; default 8: wider windows determine the noise better and follow resonances worse.
    pub freedom: usize,
    /// Largest number of evenly spaced frequencies; default 1024. Windows are then as wide as the spacing.
    pub lines: usize,
}

impl Default for LocalPolynomial {
    fn default() -> Self {
        Self { order: 2, freedom: 8, lines: 1024 }
    }
}

/// The spectra of one record: lines 1 to below the Nyquist frequency, scaled by 1/√N so that noise has one variance in all records.
struct Spectra {
    samples: usize,
    /// By channel, inputs first.
    channels: Vec<Vec<Complex<f64>>>,
}

impl Spectra {
    fn of(s: &Stretch) -> Self {
        let n = s.len();
        let (fourier, last) = (RealFourier::new(n), n.saturating_sub(1) / 2);
        let scale = 1.0 / (n.max(1) as f64).sqrt();
        let one = |row: Vec<f64>| {
            // Only the line at 0 contains the mean; removing it keeps digits.
            let mean = stats::mean(row.iter().copied()).unwrap_or(0.0);
            fourier
                .spectrum(row.into_iter().map(|v| (v - mean) * scale))
                .into_iter()
                .skip(1)
                .take(last)
                .collect()
        };
        let rows = |m: &DMatrix<f64>| {
            m.row_iter().map(|r| r.iter().copied().collect::<Vec<f64>>()).collect::<Vec<_>>()
        };
        Self { samples: n, channels: rows(&s.u).into_iter().chain(rows(&s.y)).map(one).collect() }
    }

    fn lines(&self) -> usize {
        self.samples.saturating_sub(1) / 2
    }
}

/// A column whose own part is below this share depends on the previous ones.
const REPEATED: f64 = 1e-8;
/// An input below this share of its largest line excites nothing in a window.
const SILENT: f64 = 1e-9;

impl ResponseMethod for LocalPolynomial {
    fn lines(&self, recordings: &Recordings) -> Result<Seen, IdentifyError> {
        self.check()?;
        let records: Vec<Spectra> = recordings.stretches.iter().map(Spectra::of).collect();
        let longest = records.iter().map(Spectra::lines).max().unwrap_or(0);
        let samples = records.iter().map(|r| r.samples).max().unwrap_or(0);
        let m = recordings.inputs.len();
        // Neighbouring lines of the grid are `step` lines of the longest record apart.
        let step = longest.div_ceil(self.lines).max(1);
        let Some(half) = (step.div_ceil(2)..=longest.saturating_sub(1) / 2)
            .find(|n| self.left(&records, samples, *n, m) >= self.freedom)
        else {
            let needed = 2 * ((self.order + 1) * (m + 1) + self.freedom) + 3;
            return Err(IdentifyError::TooShort { method: "lpm", needed, got: samples });
        };
        let peaks: Vec<f64> = (0..m)
            .map(|i| {
                records
                    .iter()
                    .flat_map(|r| r.channels[i].iter())
                    .map(|v| v.norm())
                    .fold(0.0, f64::max)
            })
            .collect();
        let grid: Vec<usize> = (1..=longest).step_by(step).collect();
        let window =
            Window { lpm: self, records: &records, samples, half, inputs: m, peaks: &peaks };
        let ts = recordings.sample_time.seconds();
        let lines: Vec<Line> = parallel::filter_map(grid.iter(), |&k| window.at(k, ts));
        if lines.is_empty() {
            return Err(unexcited(recordings));
        }
        let mut notes = vec![format!(
            "each value comes from {:.4} Hz around it ({} lines of the longest record)",
            (2 * half + 1) as f64 / (samples as f64 * ts),
            2 * half + 1
        )];
        if lines.len() < grid.len() {
            let out = grid.len() - lines.len();
            notes.push(format!("{out} of {} frequencies are left out: the inputs do not excite them, or not each on its own", grid.len()));
        }
        Ok(Seen { lines, notes })
    }
}

impl LocalPolynomial {
    fn check(&self) -> Result<(), IdentifyError> {
        let option = |option, value: usize, rule| {
            Err(IdentifyError::Option { option, value: value as f64, rule })
        };
        match self {
            Self { order: 7.., .. } => {
                option("order", self.order, "polynomials of an order from 0 to 6 are fitted")
            }
            Self { freedom: 0, .. } => {
                option("freedom", 0, "at least 1 degree of freedom is needed for the noise")
            }
            Self { lines: 0, .. } => option("lines", 0, "at least 1 frequency is needed"),
            _ => Ok(()),
        }
    }

    /// Degrees of freedom for windows of n lines on each side, of the longest record; 0 where too few.
    fn left(&self, records: &[Spectra], samples: usize, n: usize, m: usize) -> usize {
        let terms = self.order + 1;
        let of = |r: &Spectra| width(r, samples, n).saturating_sub(terms);
        records.iter().map(of).sum::<usize>().saturating_sub(terms * m)
    }
}

/// Number of lines of a record in a window with n lines of the longest record on each side.
fn width(r: &Spectra, samples: usize, n: usize) -> usize {
    let own = (n as f64 * r.samples as f64 / samples.max(1) as f64).round() as usize;
    (2 * own + 1).min(r.lines())
}

/// Index of the record, the record, and a line of it.
type Rows<'a> = Vec<(usize, &'a Spectra, usize)>;

struct Window<'a> {
    lpm: &'a LocalPolynomial,
    records: &'a [Spectra],
    samples: usize,
    half: usize,
    inputs: usize,
    peaks: &'a [f64],
}

impl<'a> Window<'a> {
    /// The lines of the window around the middle, lines per sample, record by record.
    fn rows(&self, used: &[&'a Spectra], middle: f64) -> Rows<'a> {
        let of = |(which, &r): (usize, &&'a Spectra)| {
            let wide = width(r, self.samples, self.half);
            let centre = (middle * r.samples as f64).round() as usize;
            // At the ends of the band windows are one-sided.
            let from = centre.saturating_sub(wide / 2).max(1).min(r.lines() + 1 - wide);
            (from..from + wide).map(move |line| (which, r, line))
        };
        used.iter().enumerate().flat_map(of).collect()
    }

    /// The regressors: the transients' columns first, then the slopes of G, last G itself in the corner of the triangle.
    fn regressors(
        &self,
        rows: &Rows<'_>,
        transients: usize,
        [middle, reach]: [f64; 2],
    ) -> DMatrix<Complex<f64>> {
        let (m, terms) = (self.inputs, self.lpm.order + 1);
        let power = |x: f64, s: usize| x.powi(i32::try_from(s).unwrap_or(0));
        DMatrix::from_fn(rows.len(), transients + terms * m, |row, column| {
            let (which, r, line) = rows[row];
            let x = (line as f64 / r.samples as f64 - middle) / reach;
            match column.checked_sub(transients) {
                None if column / terms == which => Complex::from(power(x, column % terms)),
                None => Complex::default(),
                Some(of) => r.channels[of % m][line - 1] * power(x, terms - 1 - of / m),
            }
        })
    }

    /// G and its noise at line k of the longest record.
    fn at(&self, k: usize, ts: f64) -> Option<Line> {
        let (m, terms) = (self.inputs, self.lpm.order + 1);
        let channels = self.records.first()?.channels.len();
        // Lines per sample of the window's middle, and half its width.
        let (middle, reach) =
            (k as f64 / self.samples as f64, self.half as f64 / self.samples as f64);
        let used: Vec<&Spectra> =
            self.records.iter().filter(|r| width(r, self.samples, self.half) > terms).collect();
        let rows = self.rows(&used, middle);
        let transients = terms * used.len();
        let columns = transients + terms * m;
        if rows.len() <= columns || self.is_silent(&rows) {
            return None;
        }
        let regressors = self.regressors(&rows, transients, [middle, reach]);
        let sizes: Vec<f64> = regressors.column_iter().map(|c| c.norm()).collect();
        if sizes.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
            return None;
        }
        let scaled = DMatrix::from_fn(rows.len(), columns, |i, j| regressors[(i, j)] / sizes[j]);
        let outputs = DMatrix::from_fn(rows.len(), channels - m, |i, a| {
            let (_, r, line) = rows[i];
            r.channels[m + a][line - 1]
        });
        let (q, r) = scaled.qr().unpack();
        if (0..columns).any(|j| r[(j, j)].norm() <= REPEATED) {
            return None;
        }
        let seen = q.adjoint() * &outputs;
        let found = r.solve_upper_triangular(&seen)?;
        let rest = &outputs - &q * &seen;
        let freedom = rows.len() - columns;
        // Conjugation, because row a has the errors conj(vₐ): the covariance is vₐ·v_b*.
        let noise = (rest.transpose() * rest.conjugate()) / Complex::from(freedom as f64);
        let first = columns - m;
        let size = |i: usize| sizes[first + i];
        let g = DMatrix::from_fn(channels - m, m, |a, i| found[(first + i, a)] / size(i));
        // (KᴴK)⁻¹ of the last m columns equals that of the triangle's corner.
        let corner = r.view((first, first), (m, m)).into_owned();
        let inverse = corner.solve_upper_triangular(&DMatrix::identity(m, m))?;
        let product = &inverse * inverse.adjoint();
        // The errors of g in column form have the covariance (KᴴK)⁻¹·σ²; `weight[j, i]` is its entry (i, j).
        let weight = DMatrix::from_fn(m, m, |j, i| product[(i, j)] / (size(i) * size(j)));
        Some(Line {
            omega_rad_s: std::f64::consts::TAU * middle / ts,
            g,
            noise,
            weight,
            inverse_power: self.inverse_power(&rows)?,
            freedom: 2.0 * freedom as f64,
        })
    }

    /// An input has no power at these lines.
    fn is_silent(&self, rows: &Rows<'_>) -> bool {
        (0..self.inputs).any(|i| {
            let most =
                rows.iter().map(|(_, r, line)| r.channels[i][line - 1].norm()).fold(0.0, f64::max);
            most <= SILENT * self.peaks[i]
        })
    }

    /// The inverse of the inputs' spectrum.
    fn inverse_power(&self, rows: &Rows<'_>) -> Option<DMatrix<Complex<f64>>> {
        let u = DMatrix::from_fn(rows.len(), self.inputs, |row, i| {
            let (_, r, line) = rows[row];
            r.channels[i][line - 1]
        });
        let mean = (u.transpose() * u.conjugate()) / Complex::from(rows.len() as f64);
        mean.try_inverse()
    }
}

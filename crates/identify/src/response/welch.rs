//! Averaged spectra of windowed segments.
//!
//! Equation: G = S_yu·S_uu⁻¹, S_vv = (S_yy − S_yu·S_uu⁻¹·S_uy)·K/(K − m), cov = S_vv ⊗ S_uu⁻¹/K with K independent averages.

use nalgebra::{Complex, DMatrix};
use serde::{Deserialize, Serialize};

use super::lines::{Line, Seen};
use super::responses::{ResponseMethod, unexcited};
use crate::error::IdentifyError;
use crate::subspace::recordings::Recordings;
use deadtime_signal::SpectralMatrix;

/// Welch's method: averaged spectra of overlapping segments under Hann's window.
///
/// Inputs: records of m inputs and l outputs; Output: G at the lines of a segment.
/// Assumes: a linear plant whose memory (dead time and decay) is short compared with a segment, inputs independent of the outputs' noise.
/// Resolution and cost: 1/(segment's duration); O(N log N).
/// Fails when: a resonance is narrower than two lines, or the dead time is a considerable part of a segment. Leakage is then a bias that the coherence reports
/// as noise, and its interval only in part.
/// Source: Welch (1967), doi:10.1109/TAU.1967.1161901 (overlapping averages). Bendat and Piersol (2010), "Random Data", 4th ed., sections 6.1 and 9.2,
/// doi:10.1002/9781118032428: var Ĥ = |H|²(1 − γ²)/(γ²·K).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Welch {
    /// Samples of a segment; default 1/8 of the longest record.
    pub segment: Option<usize>,
    /// Share of a segment in common with the next one; default 0.5, below 1.
    pub overlap: f64,
}

impl Default for Welch {
    fn default() -> Self {
        Self { segment: None, overlap: 0.5 }
    }
}

/// Default number of segments of the longest record, not counting overlap.
const SEGMENTS: usize = 8;
/// Shortest segment.
const SHORTEST: usize = 8;
/// A spectrum below this share of its largest line excites nothing.
const SILENT: f64 = 1e-18;
/// Determinant of the inputs' coherences below which one input depends on the others.
const REPEATED: f64 = 1e-12;

impl ResponseMethod for Welch {
    fn lines(&self, recordings: &Recordings) -> Result<Seen, IdentifyError> {
        let longest = recordings.stretches.iter().map(|s| s.len()).max().unwrap_or(0);
        let segment = self.segment.unwrap_or(longest / SEGMENTS);
        let refused = |option, value, rule| Err(IdentifyError::Option { option, value, rule });
        if self.segment.is_some_and(|s| s < SHORTEST) {
            return refused("segment", segment as f64, "a segment has at least 8 samples");
        }
        if !(0.0..1.0).contains(&self.overlap) {
            return refused("overlap", self.overlap, "it is at least 0 and below 1");
        }
        let m = recordings.inputs.len();
        let rows = |m: &DMatrix<f64>| {
            m.row_iter().map(|r| r.iter().copied().collect::<Vec<f64>>()).collect::<Vec<_>>()
        };
        let records: Vec<Vec<Vec<f64>>> =
            recordings.stretches.iter().map(|s| [rows(&s.u), rows(&s.y)].concat()).collect();
        let spectra = SpectralMatrix::welch(&records, segment.max(SHORTEST), self.overlap);
        let averages = spectra.averages;
        if averages < m as f64 + 1.0 || segment < SHORTEST {
            let (needed, got) = (segment.max(SHORTEST) * (m + 2), recordings.samples());
            return Err(IdentifyError::TooShort { method: "welch", needed, got });
        }
        let peaks: Vec<f64> = (0..m)
            .map(|i| spectra.lines.iter().skip(1).map(|s| s[(i, i)].re).fold(0.0, f64::max))
            .collect();
        let ts = recordings.sample_time.seconds();
        let at = |k: usize| {
            let omega_rad_s = std::f64::consts::TAU * k as f64 / (spectra.segment as f64 * ts);
            Some(Line { omega_rad_s, ..line(spectra.lines.get(k)?, &peaks, averages)? })
        };
        // Excluded are 0, which contains the means, and the Nyquist frequency, where spectra are real.
        let all = 1..=spectra.segment.saturating_sub(1) / 2;
        let (lines, count) = (all.clone().filter_map(at).collect::<Vec<Line>>(), all.count());
        if lines.is_empty() {
            return Err(unexcited(recordings));
        }
        let mut notes = vec![format!(
            "segments of {} samples ({:.4} s), as certain as {averages:.1} independent ones",
            spectra.segment,
            spectra.segment as f64 * ts
        )];
        if lines.len() < count {
            let out = count - lines.len();
            notes.push(format!("{out} of {count} frequencies are left out: the inputs do not excite them, or not each on its own"));
        }
        Ok(Seen { lines, notes })
    }
}

/// G and its noise from one spectral matrix, the inputs first. `None` where the inputs do not excite the line, or not independently.
fn line(s: &DMatrix<Complex<f64>>, peaks: &[f64], averages: f64) -> Option<Line> {
    let m = peaks.len();
    let l = s.nrows() - m;
    let (uu, yu) = (s.view((0, 0), (m, m)).into_owned(), s.view((m, 0), (l, m)).into_owned());
    let power: Vec<f64> = uu.diagonal().iter().map(|v| v.re).collect();
    if power.iter().zip(peaks).any(|(p, peak)| *p <= SILENT * peak) {
        return None;
    }
    let coherences = DMatrix::from_fn(m, m, |i, j| uu[(i, j)] / (power[i] * power[j]).sqrt());
    if coherences.determinant().re <= REPEATED {
        return None;
    }
    let inverse = uu.try_inverse()?;
    let g = &yu * &inverse;
    let left = s.view((m, m), (l, l)) - &g * yu.adjoint();
    Some(Line {
        omega_rad_s: 0.0,
        noise: left * Complex::from(averages / (averages - m as f64)),
        g,
        weight: &inverse / Complex::from(averages),
        inverse_power: inverse,
        freedom: 2.0 * (averages - m as f64),
    })
}

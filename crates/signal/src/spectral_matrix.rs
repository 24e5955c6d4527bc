//! Averaged spectra of several signals at once.

use nalgebra::{Complex, DMatrix};

use super::fourier::RealFourier;

/// S(k) = mean of X(k)·X(k)ᴴ over overlapping segments of M samples, means removed, with Hann's window. Line k is at ω = 2πk/M rad per sample.
///
/// Scaled by Σw²: of white noise of variance σ² it is σ². Source: Welch (1967), doi:10.1109/TAU.1967.1161901.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectralMatrix {
    /// M, samples of a segment.
    pub segment: usize,
    /// Independent segments that would be as certain, of white noise.
    pub averages: f64,
    /// Channels × channels of every line from 0 to M/2: entry (a, b) is the mean of X_a·conj(X_b).
    pub lines: Vec<DMatrix<Complex<f64>>>,
}

impl SpectralMatrix {
    /// Averages over all records, each a list of channels of one length; a record shorter than a segment is left out.
    ///
    /// The variance with K segments D apart in a record is (1 + 2·Σⱼ(1 − j/K)·ρⱼ)/K of one segment's (Welch, 1967). Here ρⱼ = (Σw(t)·w(t + jD))²/(Σw²)².
    #[must_use]
    pub fn welch(records: &[Vec<Vec<f64>>], segment: usize, overlap: f64) -> Self {
        let segment = segment.max(1);
        let channels = records.first().map_or(0, Vec::len);
        let repeated = ((segment as f64 * overlap) as usize).min(segment - 1);
        let apart = segment - repeated;
        let window: Vec<f64> = (0..segment)
            .map(|t| (std::f64::consts::PI * t as f64 / segment as f64).sin().powi(2))
            .collect();
        let power: f64 = window.iter().map(|w| w * w).sum();
        let fourier = RealFourier::new(segment);
        let mut lines = vec![DMatrix::zeros(channels, channels); segment / 2 + 1];
        let (mut count, mut variance) = (0.0, 0.0);
        for record in records {
            let samples = record.iter().map(Vec::len).min().unwrap_or(0);
            let starts: Vec<usize> =
                (0..(samples + 1).saturating_sub(segment)).step_by(apart).collect();
            for &start in &starts {
                let part = |x: &Vec<f64>| {
                    let x = &x[start..start + segment];
                    let mean = x.iter().sum::<f64>() / segment as f64;
                    fourier.spectrum(window.iter().zip(x).map(|(w, x)| w * (x - mean)))
                };
                let spectra: Vec<Vec<Complex<f64>>> = record.iter().map(part).collect();
                for (k, line) in lines.iter_mut().enumerate() {
                    for a in 0..channels {
                        for b in 0..channels {
                            line[(a, b)] += spectra[a][k] * spectra[b][k].conj();
                        }
                    }
                }
            }
            let segments = starts.len() as f64;
            let shared = |j: usize| -> f64 {
                let sum: f64 =
                    window.iter().zip(window.iter().skip(j * apart)).map(|(a, b)| a * b).sum();
                (sum / power).powi(2)
            };
            let beyond = (1..starts.len()).take_while(|j| j * apart < segment);
            variance +=
                segments + 2.0 * beyond.map(|j| (segments - j as f64) * shared(j)).sum::<f64>();
            count += segments;
        }
        if count > 0.0 {
            lines.iter_mut().for_each(|line| *line /= Complex::from(count * power));
        }
        Self {
            segment,
            averages: if variance > 0.0 { count * count / variance } else { 0.0 },
            lines,
        }
    }
}

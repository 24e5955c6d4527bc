//! The spectrum of residuals in cells of frequency, and the frequencies at which they are strong.

use deadtime_signal::dft;
use nalgebra::{Complex, DMatrix};

use crate::input::record::LogRecord;

/// Cells of time per record, of frequency per output, of range per command.
pub(crate) const CELLS: usize = 24;

/// Squares of residuals gathered in cells.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cell {
    pub(crate) sum: f64,
    pub(crate) count: f64,
    /// The strongest frequency of a cell of a spectrum, Hz, and its power.
    pub(crate) peak: (f64, f64),
}

impl Cell {
    pub(crate) fn add(&mut self, square: f64) {
        self.sum += square;
        self.count += 1.0;
    }
}

/// Power of the residual by frequency, in cells of equal width on a logarithmic axis: their edges, and the powers of the frequencies in each.
pub(crate) fn spectrum(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    i: usize,
) -> Option<(Vec<f64>, Vec<Cell>)> {
    let longest =
        records.iter().filter(|r| r.train.is_some()).map(LogRecord::duration_s).fold(0.0, f64::max);
    let shortest = records
        .iter()
        .filter(|r| r.train.is_some())
        .map(|r| r.sample_time_s)
        .fold(f64::INFINITY, f64::min);
    let (low, high) = (1.0 / longest, 0.5 / shortest);
    if !(low > 0.0 && high > low && high.is_finite()) {
        return None;
    }
    let edges: Vec<f64> =
        (0..=CELLS).map(|c| low * (high / low).powf(c as f64 / CELLS as f64)).collect();
    let mut cells = vec![Cell::default(); CELLS];
    for (record, residual) in records.iter().zip(residuals).filter(|(r, _)| r.train.is_some()) {
        let mut values: Vec<Complex<f64>> = (0..record.time_s.len())
            .filter(|&k| record.train.is_some_and(|s| s.holds(record.time_s[k])))
            .map(|k| {
                Complex::new(
                    if record.measured[i].get(k).is_some() { residual[(k, i)] } else { 0.0 },
                    0.0,
                )
            })
            .collect();
        let n = values.len();
        dft(&mut values);
        for (bin, value) in values.iter().enumerate().take(n / 2).skip(1) {
            let hz = bin as f64 / (n as f64 * record.sample_time_s);
            let cell = edges.partition_point(|e| *e <= hz).clamp(1, CELLS) - 1;
            let power = value.norm_sqr() / n as f64;
            cells[cell].add(power);
            if power > cells[cell].peak.1 {
                cells[cell].peak = (hz, power);
            }
        }
    }
    Some((edges, cells))
}

/// Frequencies at which the residual of any output is strong, in rising order: the strongest lines of its spectrum's strongest cells, to the line. A sine with
/// a frequency error of 10 % is uncorrelated with the right one over a long log.
pub(crate) fn peaks_hz(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    outputs: usize,
) -> Vec<f64> {
    let mut peaks = Vec::new();
    for i in 0..outputs {
        let Some((_, cells)) = spectrum(records, residuals, i) else { continue };
        let powers: Vec<f64> = cells.iter().map(|c| c.peak.1).collect();
        let mut order: Vec<usize> = (0..cells.len())
            .filter(|&c| {
                powers[c] > 0.0
                    && (c == 0 || powers[c - 1] <= powers[c])
                    && powers.get(c + 1).is_none_or(|next| *next <= powers[c])
            })
            .collect();
        order.sort_by(|&a, &b| powers[b].total_cmp(&powers[a]));
        peaks.extend(order.into_iter().take(4).map(|c| cells[c].peak.0));
    }
    peaks.sort_by(f64::total_cmp);
    peaks.dedup_by(|a, b| (*a / *b - 1.0).abs() < 0.005);
    peaks
}

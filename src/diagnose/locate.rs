//! Where the gap is: the shortest span of time, of frequency and of a command's range that holds most of an output's excess over the floor.

use nalgebra::DMatrix;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use super::data::Record;
use super::diagnosis::{Band, Regime, TimeSpan, Where, WhereOutput};
use super::floor::Floor;
use crate::simulate::System;

/// The share of the excess that a span must hold.
const MOST: f64 = 0.8;
/// Cells of time per record, of frequency per output, of range per command.
const CELLS: usize = 24;
/// A range of a command is only worth naming if it is narrower than this part of all.
const NARROW: f64 = 0.6;

/// Shares of Σ(before² − floor²), scaled by each output's spread; none where nothing is above the floor.
pub(super) fn output_shares(before: &[Option<f64>], floor: &[Option<f64>]) -> Vec<Option<f64>> {
    let excess = |b: &Option<f64>, f: &Option<f64>| Some((b.as_ref()?.powi(2) - f.as_ref()?.powi(2)).max(0.0));
    let all: Vec<Option<f64>> = before.iter().zip(floor).map(|(b, f)| excess(b, f)).collect();
    let sum: f64 = all.iter().flatten().sum();
    all.into_iter().map(|e| e.map(|e| if sum > 0.0 { e / sum } else { 0.0 })).collect()
}

/// The sections of `where`; `residuals` are those of the model as it came.
pub(super) fn locate(system: &System, records: &[Record], residuals: &[DMatrix<f64>], floor: &Floor, shares: &[Option<f64>]) -> Where {
    let mut found = Where::default();
    let mut order: Vec<usize> = (0..shares.len()).filter(|&i| shares[i].is_some_and(|s| s > 0.0)).collect();
    order.sort_by(|&a, &b| shares[b].unwrap_or(0.0).total_cmp(&shares[a].unwrap_or(0.0)));
    for i in order {
        let name = system.outputs[i].name.clone();
        found.outputs.push(WhereOutput { name: name.clone(), share: shares[i].unwrap_or(0.0) });
        // A share of 5 % is no place of its own.
        if shares[i].is_none_or(|s| s < 0.05) {
            continue;
        }
        let square = floor.floor[i].powi(2);
        times(records, residuals, i, square, &name, &mut found.times);
        found.bands.extend(band(records, residuals, i, square, &name));
        for (j, input) in system.inputs.iter().enumerate() {
            found.regimes.extend(regime(records, residuals, i, square, j, &name, &input.name));
        }
    }
    found.times.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

/// The shortest run of cells with [`MOST`] of the sum of `excess`, and its share.
fn shortest(excess: &[f64]) -> Option<(usize, usize, f64)> {
    let sum: f64 = excess.iter().sum();
    if sum <= 0.0 {
        return None;
    }
    let mut best: Option<(usize, usize, f64)> = None;
    let (mut from, mut held) = (0, 0.0);
    for to in 0..excess.len() {
        held += excess[to];
        while held - excess[from] >= MOST * sum && from < to {
            held -= excess[from];
            from += 1;
        }
        if held >= MOST * sum && best.is_none_or(|(a, b, _)| to - from < b - a) {
            best = Some((from, to, held / sum));
        }
    }
    best
}

fn times(records: &[Record], residuals: &[DMatrix<f64>], i: usize, floor: f64, name: &str, found: &mut Vec<TimeSpan>) {
    let excess_of = |record: &Record, residual: &DMatrix<f64>| {
        let mut cells = vec![0.0; CELLS];
        let Some(span) = record.train else { return (span_of(record), cells) };
        let width = (span.to_s - span.from_s) / CELLS as f64;
        for k in (0..record.time_s.len()).filter(|&k| record.measured_in(record.train, i, k).is_some()) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let cell = (((record.time_s[k] - span.from_s) / width) as usize).min(CELLS - 1);
            cells[cell] += residual[(k, i)].powi(2) - floor;
        }
        for cell in &mut cells {
            *cell = cell.max(0.0);
        }
        ((span.from_s, width), cells)
    };
    let all: Vec<((f64, f64), Vec<f64>)> = records.iter().zip(residuals).map(|(r, e)| excess_of(r, e)).collect();
    let total: f64 = all.iter().flat_map(|(_, cells)| cells).sum();
    for (record, ((start, width), cells)) in records.iter().zip(&all) {
        let Some((from, to, share)) = shortest(cells) else { continue };
        let here = share * cells.iter().sum::<f64>() / total;
        #[allow(clippy::cast_precision_loss)]
        found.push(TimeSpan {
            log: record.name.clone(),
            output: name.to_owned(),
            from_s: start + width * from as f64,
            to_s: start + width * (to + 1) as f64,
            share: here,
        });
    }
}

fn span_of(record: &Record) -> (f64, f64) {
    #[allow(clippy::cast_precision_loss)]
    let width = record.duration_s() / CELLS as f64;
    (0.0, width)
}

/// Power of the residual by frequency, in cells of equal width on a logarithmic axis; frequency of a cell's lower edge, and the sums.
fn spectrum(records: &[Record], residuals: &[DMatrix<f64>], i: usize, floor: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let longest = records.iter().filter(|r| r.train.is_some()).map(Record::duration_s).fold(0.0, f64::max);
    let shortest = records.iter().filter(|r| r.train.is_some()).map(|r| r.sample_time_s).fold(f64::INFINITY, f64::min);
    let (low, high) = (1.0 / longest, 0.5 / shortest);
    if !(low > 0.0 && high > low && high.is_finite()) {
        return None;
    }
    #[allow(clippy::cast_precision_loss)]
    let edges: Vec<f64> = (0..=CELLS).map(|c| low * (high / low).powf(c as f64 / CELLS as f64)).collect();
    let mut cells = vec![0.0; CELLS];
    let mut planner = FftPlanner::new();
    for (record, residual) in records.iter().zip(residuals).filter(|(r, _)| r.train.is_some()) {
        let mut values: Vec<Complex<f64>> = (0..record.time_s.len())
            .filter(|&k| record.train.is_some_and(|s| s.holds(record.time_s[k])))
            .map(|k| Complex::new(if record.measured[i].get(k).is_some() { residual[(k, i)] } else { 0.0 }, 0.0))
            .collect();
        let n = values.len();
        planner.plan_fft_forward(n).process(&mut values);
        #[allow(clippy::cast_precision_loss)]
        for (bin, value) in values.iter().enumerate().take(n / 2).skip(1) {
            let hz = bin as f64 / (n as f64 * record.sample_time_s);
            let cell = edges.partition_point(|e| *e <= hz).clamp(1, CELLS) - 1;
            // The floor as white noise: the same power in every bin.
            cells[cell] += value.norm_sqr() / n as f64 - floor;
        }
    }
    for cell in &mut cells {
        *cell = cell.max(0.0);
    }
    Some((edges, cells))
}

fn band(records: &[Record], residuals: &[DMatrix<f64>], i: usize, floor: f64, name: &str) -> Option<Band> {
    let (edges, cells) = spectrum(records, residuals, i, floor)?;
    let (from, to, share) = shortest(&cells)?;
    Some(Band { output: name.to_owned(), from_hz: edges[from], to_hz: edges[to + 1], share })
}

/// Frequencies at which the residual of any output is strong, strongest first: the peaks of its spectrum, then a coarse grid.
pub(super) fn peaks_hz(records: &[Record], residuals: &[DMatrix<f64>], outputs: usize) -> Vec<f64> {
    let mut peaks = Vec::new();
    for i in 0..outputs {
        let Some((edges, cells)) = spectrum(records, residuals, i, 0.0) else { continue };
        let mut order: Vec<usize> = (0..cells.len())
            .filter(|&c| (c == 0 || cells[c - 1] <= cells[c]) && cells.get(c + 1).is_none_or(|next| *next <= cells[c]))
            .collect();
        order.sort_by(|&a, &b| cells[b].total_cmp(&cells[a]));
        peaks.extend(order.into_iter().take(4).map(|c| (edges[c] * edges[c + 1]).sqrt()));
    }
    peaks.sort_by(f64::total_cmp);
    peaks.dedup_by(|a, b| (*a / *b - 1.0).abs() < 0.1);
    peaks
}

/// The range of a command outside which the gap is small.
fn regime(
    records: &[Record],
    residuals: &[DMatrix<f64>],
    i: usize,
    floor: f64,
    input: usize,
    name: &str,
    variable: &str,
) -> Option<Regime> {
    let values = || {
        records.iter().zip(residuals).flat_map(move |(r, e)| {
            (0..r.time_s.len()).filter(move |&k| r.measured_in(r.train, i, k).is_some()).map(move |k| (r.inputs[input][k], e[(k, i)]))
        })
    };
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (u, _)| (l.min(u), h.max(u)));
    if high.partial_cmp(&low) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let mut cells = vec![0.0; CELLS];
    #[allow(clippy::cast_precision_loss)]
    let width = (high - low) / CELLS as f64;
    for (u, e) in values() {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let cell = (((u - low) / width) as usize).min(CELLS - 1);
        cells[cell] += e * e - floor;
    }
    for cell in &mut cells {
        *cell = f64::max(*cell, 0.0);
    }
    let (from, to, share) = shortest(&cells)?;
    #[allow(clippy::cast_precision_loss)]
    let narrow = (to + 1 - from) as f64 <= NARROW * CELLS as f64;
    #[allow(clippy::cast_precision_loss)]
    narrow.then(|| Regime {
        output: name.to_owned(),
        variable: variable.to_owned(),
        from: low + width * from as f64,
        to: low + width * (to + 1) as f64,
        share,
    })
}

//! The place of the gap: the shortest ranges of time, frequency and a command that hold most of an output's excess over the floor.

use nalgebra::DMatrix;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::baseline::spectrum::{CELLS, Cell, spectrum};
use crate::format::place::{Band, Regime, TimeSpan, Where, WhereOutput};
use crate::input::record::LogRecord;
use crate::judge::floor::Floor;
use deadtime_model::simulate::System;

/// The share of the excess that a band or a range must hold.
const MOST: f64 = 0.8;
/// The same for a span of time: the span of an event should include its beginning and its end.
const NEARLY_ALL: f64 = 0.95;
/// A range of a variable is only worth naming if it holds less than this part of all samples.
const NARROW: f64 = 0.6;
/// Ranges that are named per output.
const REGIMES: usize = 3;
/// The share of false cells among those that are named.
const FALSE: f64 = 0.05;

/// Shares of Σ(before² − floor²), scaled by each output's spread; none where nothing is above the floor.
pub(crate) fn output_shares(before: &[Option<f64>], floor: &[Option<f64>]) -> Vec<Option<f64>> {
    let excess = |b: &Option<f64>, f: &Option<f64>| {
        Some((b.as_ref()?.powi(2) - f.as_ref()?.powi(2)).max(0.0))
    };
    let all: Vec<Option<f64>> = before.iter().zip(floor).map(|(b, f)| excess(b, f)).collect();
    let sum: f64 = all.iter().flatten().sum();
    all.into_iter().map(|e| e.map(|e| if sum > 0.0 { e / sum } else { 0.0 })).collect()
}

/// The sections of `where`; `residuals` are those of the nominal model, `memory` is the number of samples of each output's noise per independent sample.
pub(crate) fn locate(
    system: &System,
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    floor: &Floor,
    shares: &[Option<f64>],
    memory: &[f64],
) -> Where {
    let mut found = Where::default();
    let mut order: Vec<usize> =
        (0..shares.len()).filter(|&i| shares[i].is_some_and(|s| s > 0.0)).collect();
    order.sort_by(|&a, &b| shares[b].unwrap_or(0.0).total_cmp(&shares[a].unwrap_or(0.0)));
    let variables = variables(system, records);
    for i in order {
        let name = system.outputs[i].name.clone();
        found.outputs.push(WhereOutput { name: name.clone(), share: shares[i].unwrap_or(0.0) });
        // An output with a share below 5 % gets no place.
        if shares[i].is_none_or(|s| s < 0.05) {
            continue;
        }
        let noise = Noise { square: floor.floor[i].powi(2), memory: memory[i] };
        times(records, residuals, i, noise, &name, &mut found.times);
        found.bands.extend(band(records, residuals, i, noise, &name));
        let mut regimes: Vec<(f64, Regime)> = variables
            .iter()
            .filter_map(|variable| regime(records, residuals, i, noise, variable, &name))
            .collect();
        // The narrowest range is the most informative.
        regimes.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.regimes.extend(regimes.into_iter().take(REGIMES).map(|r| r.1));
    }
    found.times.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

/// The noise of one output's residual.
#[derive(Debug, Clone, Copy)]
struct Noise {
    /// Mean square.
    square: f64,
    /// Samples per independent sample.
    memory: f64,
}

/// The excess of every cell above the noise, and 0 where the excess may be chance. The share of false cells among the named ones is controlled (Benjamini and
/// Hochberg 1995, doi:10.1111/j.2517-6161.1995.tb02031.x; positively dependent cells: Benjamini and Yekutieli 2001).
fn significant(cells: &[Cell], noise: Noise) -> Vec<f64> {
    let chance = |cell: &Cell| {
        let freedom = (cell.count / noise.memory).max(1.0);
        if cell.count == 0.0 || noise.square <= 0.0 {
            return if cell.sum > 0.0 { 0.0 } else { 1.0 };
        }
        let statistic = freedom * cell.sum / cell.count / noise.square;
        ChiSquared::new(freedom).map_or(1.0, |chi| chi.sf(statistic))
    };
    let p: Vec<f64> = cells.iter().map(chance).collect();
    let mut sorted: Vec<f64> = p.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = sorted
        .iter()
        .enumerate()
        .filter(|(n, p)| **p <= FALSE * (n + 1) as f64 / cells.len() as f64)
        .map(|(_, p)| *p)
        .fold(-1.0, f64::max);
    cells
        .iter()
        .zip(&p)
        .map(|(c, p)| if *p <= limit { (c.sum - c.count * noise.square).max(0.0) } else { 0.0 })
        .collect()
}

/// A quantity whose range may localise a gap: a command, its absolute value, a further column of the logs.
struct Variable {
    name: String,
    /// One series per record.
    values: Vec<Vec<f64>>,
}

fn variables(system: &System, records: &[LogRecord]) -> Vec<Variable> {
    let mut all = Vec::new();
    for (j, input) in system.inputs.iter().enumerate() {
        let values: Vec<Vec<f64>> = records.iter().map(|r| r.inputs[j].clone()).collect();
        let signs = |sign: f64| values.iter().flatten().any(|v| v * sign > 0.0);
        if signs(1.0) && signs(-1.0) {
            let sizes = values.iter().map(|r| r.iter().map(|v| v.abs()).collect()).collect();
            all.push(Variable { name: format!("abs({})", input.name), values: sizes });
        }
        all.push(Variable { name: input.name.clone(), values });
    }
    if let Some(first) = records.first() {
        for (name, _) in &first.context {
            let of = |r: &LogRecord| r.context.iter().find(|c| c.0 == *name).map(|c| c.1.clone());
            if let Some(values) = records.iter().map(of).collect::<Option<Vec<_>>>() {
                all.push(Variable { name: name.clone(), values });
            }
        }
    }
    all
}

/// The shortest run of cells with the share `most` of the sum of `excess`, and its own share.
fn shortest(excess: &[f64], most: f64) -> Option<(usize, usize, f64)> {
    let sum: f64 = excess.iter().sum();
    if sum <= 0.0 {
        return None;
    }
    let mut best: Option<(usize, usize, f64)> = None;
    let (mut from, mut held) = (0, 0.0);
    for to in 0..excess.len() {
        held += excess[to];
        while held - excess[from] >= most * sum && from < to {
            held -= excess[from];
            from += 1;
        }
        if held >= most * sum && best.is_none_or(|(a, b, _)| to - from < b - a) {
            best = Some((from, to, held / sum));
        }
    }
    best
}

fn times(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    i: usize,
    noise: Noise,
    name: &str,
    found: &mut Vec<TimeSpan>,
) {
    let cells_of = |record: &LogRecord, residual: &DMatrix<f64>| {
        let mut cells = vec![Cell::default(); CELLS];
        let Some(span) = record.train else { return (span_of(record), Vec::new()) };
        let width = (span.to_s - span.from_s) / CELLS as f64;
        for k in
            (0..record.time_s.len()).filter(|&k| record.measured_in(record.train, i, k).is_some())
        {
            let cell = (((record.time_s[k] - span.from_s) / width) as usize).min(CELLS - 1);
            cells[cell].add(residual[(k, i)].powi(2));
        }
        ((span.from_s, width), cells)
    };
    let all: Vec<((f64, f64), Vec<Cell>)> =
        records.iter().zip(residuals).map(|(r, e)| cells_of(r, e)).collect();
    let excess: Vec<f64> =
        significant(&all.iter().flat_map(|(_, cells)| cells.clone()).collect::<Vec<_>>(), noise);
    let total: f64 = excess.iter().sum();
    let mut rest = excess.as_slice();
    for (record, ((start, width), cells)) in records.iter().zip(&all) {
        let (here, further) = rest.split_at(cells.len());
        rest = further;
        let Some((from, to, share)) = shortest(here, NEARLY_ALL) else { continue };
        found.push(TimeSpan {
            log: record.name.clone(),
            output: name.to_owned(),
            from_s: start + width * from as f64,
            to_s: start + width * (to + 1) as f64,
            share: share * here.iter().sum::<f64>() / total,
        });
    }
}

fn span_of(record: &LogRecord) -> (f64, f64) {
    let width = record.duration_s() / CELLS as f64;
    (0.0, width)
}

fn band(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    i: usize,
    noise: Noise,
    name: &str,
) -> Option<Band> {
    let (edges, cells) = spectrum(records, residuals, i)?;
    // The floor as white noise: the same power at every frequency, each of two degrees of freedom.
    let (from, to, share) = shortest(&significant(&cells, Noise { memory: 0.5, ..noise }), MOST)?;
    Some(Band { output: name.to_owned(), from_hz: edges[from], to_hz: edges[to + 1], share })
}

/// The range of a variable outside which the gap is small, and its width as a part of all samples.
fn regime(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    i: usize,
    noise: Noise,
    variable: &Variable,
    name: &str,
) -> Option<(f64, Regime)> {
    let values = || {
        records.iter().zip(residuals).zip(&variable.values).flat_map(move |((r, e), v)| {
            (0..r.time_s.len())
                .filter(move |&k| r.measured_in(r.train, i, k).is_some() && v[k].is_finite())
                .map(move |k| (v[k], e[(k, i)]))
        })
    };
    let (low, high) =
        values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (u, _)| (l.min(u), h.max(u)));
    if high.partial_cmp(&low) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let mut cells = vec![Cell::default(); CELLS];
    let width = (high - low) / CELLS as f64;
    for (u, e) in values() {
        let cell = (((u - low) / width) as usize).min(CELLS - 1);
        cells[cell].add(e * e);
    }
    let (from, to, share) = shortest(&significant(&cells, noise), MOST)?;
    let (inside, all): (f64, f64) =
        (cells[from..=to].iter().map(|c| c.count).sum(), cells.iter().map(|c| c.count).sum());
    let part = inside / all;
    // Where the gap's share is that of the samples, the variable is uninformative.
    let regime = || Regime {
        output: name.to_owned(),
        variable: variable.name.clone(),
        from: low + width * from as f64,
        to: low + width * (to + 1) as f64,
        share,
    };
    (part <= NARROW).then(|| (part, regime()))
}

//! Amplitudes and rates of the signals, from which priors and first guesses are made.

use nalgebra::DMatrix;

use super::noise::Noise;
use super::predictor::Predictor;
use super::spectrum::peaks_hz;
use crate::error::Result;
use crate::format::error::GapError;
use crate::input::black_box::Probed;
use crate::input::criteria::Criteria;
use crate::input::record::LogRecord;
use deadtime_model::effect::{Applied, Chance, Scales, Spread};
use deadtime_model::simulate::{Dynamics, System};
use deadtime_signal::stats;

/// The nominal motion.
pub(crate) struct Motion {
    /// Predicted outputs from the nominal start, per record.
    pub(crate) predicted: Vec<DMatrix<f64>>,
    states: Vec<DMatrix<f64>>,
    /// Rms motion of every state about its start; of a black box what moves an output as far as that moves.
    pub(crate) rms: Vec<f64>,
    /// Residuals smaller than this are no noise but rounding, per output.
    pub(crate) smallest: Vec<f64>,
}

impl Motion {
    /// Simulates the nominal model.
    pub(crate) fn of(
        system: &System,
        own: &[Applied],
        records: &[LogRecord],
        predictor: &Predictor,
        probed: Option<&Probed>,
    ) -> Result<Self> {
        let plan = Applied::plan(system, own, Chance::Mean)?;
        let (mut predicted, mut states) = (Vec::new(), Vec::new());
        for (at, record) in records.iter().enumerate() {
            let correction = predictor.correction(at, &record.measured);
            let run = system
                .simulate(&plan, record.commands(), &record.start, correction)
                .map_err(|e| GapError::Nominal { log: record.name.clone(), why: e.to_string() })?;
            predicted.push(run.y);
            states.push(run.x);
        }
        let rms = (0..system.states.len())
            .map(|j| {
                // For a black box the motion is unknown, and only the response to the initial state is known.
                if let Some(probed) = probed {
                    return probed.states[j];
                }
                let moved = states.iter().flat_map(|x| {
                    x.column(j).iter().map(|v| v - system.initial[j]).collect::<Vec<_>>()
                });
                let rms = root_mean_square(moved);
                // A state that the commands never move: its initial value may still be wrong by its own size.
                if rms > 0.0 { rms } else { system.initial[j].abs() }
            })
            .collect();
        let smallest = (0..system.outputs.len())
            .map(|i| {
                1e-6 * root_mean_square(
                    records
                        .iter()
                        .flat_map(|r| (0..r.time_s.len()).filter_map(|k| r.measured[i].get(k))),
                )
            })
            .map(|v| f64::max(v, 1e-12))
            .collect();
        Ok(Self { predicted, states, rms, smallest })
    }

    /// Standard deviations of the initial state: those of the model, else the state's motion; 0 for a state that moves no output.
    pub(crate) fn prior(&self, system: &System) -> Vec<f64> {
        let known = system.initial_std.iter().zip(&self.rms);
        known
            .map(
                |(std, rms)| {
                    if *rms == 0.0 && system.is_black_box() { 0.0 } else { std.unwrap_or(*rms) }
                },
            )
            .collect()
    }

    /// The part of every output's residual that its own past does not predict: the first noise estimate.
    pub(crate) fn innovations(&self, records: &[LogRecord], criteria: &Criteria) -> Vec<f64> {
        let trained: Vec<usize> =
            (0..records.len()).filter(|&i| records[i].train.is_some()).collect();
        let residuals: Vec<DMatrix<f64>> = trained
            .iter()
            .map(|&at| {
                let y = &self.predicted[at];
                DMatrix::from_fn(y.nrows(), y.ncols(), |k, i| {
                    records[at].measured[i].get(k).map_or(0.0, |m| m - y[(k, i)])
                })
            })
            .collect();
        let of: Vec<&LogRecord> = trained.iter().map(|&i| &records[i]).collect();
        let noise =
            Noise::fit(&of, &residuals.iter().collect::<Vec<_>>(), &self.smallest, criteria);
        noise.std()
    }

    /// The time in which the fastest output moves by its standard deviation.
    fn timescale(&self, records: &[LogRecord]) -> f64 {
        let of = |y: &DMatrix<f64>, record: &LogRecord, i: usize| {
            let y: Vec<f64> = y.column(i).iter().copied().collect();
            let rate = root_mean_square(
                y.windows(2)
                    .zip(record.time_s.windows(2))
                    .map(|(y, t)| (y[1] - y[0]) / (t[1] - t[0])),
            );
            (rate > 0.0).then(|| spread(vec![y], record.sample_time_s).std / rate)
        };
        let all = self
            .predicted
            .iter()
            .zip(records)
            .flat_map(|(y, record)| (0..y.ncols()).filter_map(move |i| of(y, record, i)));
        let fastest = all.fold(f64::INFINITY, f64::min);
        if fastest.is_finite() { fastest } else { 0.0 }
    }

    /// Sizes for first guesses, from the training data: a limit that only held-out data would reach is no guess. `residuals` are those of the nominal model.
    pub(crate) fn scales(
        &self,
        system: &System,
        records: &[LogRecord],
        residuals: &[DMatrix<f64>],
        longest_delay_s: f64,
    ) -> Scales {
        let trained = || records.iter().filter(|r| r.train.is_some());
        let sample_time_s = trained().map(|r| r.sample_time_s).fold(f64::INFINITY, f64::min);
        let column = |x: &DMatrix<f64>, j: usize| x.column(j).iter().copied().collect::<Vec<f64>>();
        // The number of samples of a record up to the end of the training data.
        let until =
            |r: &LogRecord| r.train.map_or(0, |span| r.time_s.partition_point(|t| *t <= span.to_s));
        let moved = || self.states.iter().zip(records).filter(|(_, r)| r.train.is_some());
        let derivative = |j: usize| {
            let steps = moved().flat_map(|(x, r)| {
                let x = column(x, j);
                x.windows(2)
                    .zip(r.time_s.windows(2))
                    .map(|(x, t)| (x[1] - x[0]) / (t[1] - t[0]))
                    .collect::<Vec<_>>()
            });
            root_mean_square(steps)
        };
        let measured = |i: usize| {
            trained()
                .map(|r| (0..until(r)).filter_map(|k| r.measured[i].get(k)).collect())
                .collect()
        };
        let state = |j: usize| {
            moved().map(|(x, r)| x.column(j).iter().copied().take(until(r)).collect()).collect()
        };
        Scales {
            sample_time_s,
            duration_s: trained().map(LogRecord::duration_s).fold(0.0, f64::max),
            timescale_s: self.timescale(records),
            longest_delay_s,
            inputs: (0..system.inputs.len())
                .map(|j| {
                    spread(
                        trained().map(|r| r.inputs[j][..until(r)].to_vec()).collect(),
                        sample_time_s,
                    )
                })
                .collect(),
            states: if system.is_black_box() {
                self.rms.iter().map(|&rms| Spread { rms, std: rms, ..Spread::default() }).collect()
            } else {
                (0..system.states.len()).map(|j| spread(state(j), sample_time_s)).collect()
            },
            inner: self.inner(system, records, sample_time_s),
            derivatives: if system.is_black_box() {
                Vec::new()
            } else {
                (0..system.states.len()).map(derivative).collect()
            },
            outputs: (0..system.outputs.len())
                .map(|i| spread(measured(i), sample_time_s))
                .collect(),
            peaks_hz: peaks_hz(records, residuals, system.outputs.len()),
            scanned: Vec::new(),
        }
    }
}

impl Motion {
    /// The motion of the quantities inside equations on which effects act: those of controllers, and twists of links.
    fn inner(
        &self,
        system: &System,
        records: &[LogRecord],
        sample_time_s: f64,
    ) -> Vec<(String, Spread)> {
        let Dynamics::Equations(equations, parameters) = &system.dynamics else {
            return Vec::new();
        };
        let one = |name: String| {
            let shown = equations.with_shown_quantity(&name).ok()??;
            let mut workspace = shown.workspace();
            let mut y = vec![0.0; shown.output_variables().len()];
            let mut of = |(states, record): (&DMatrix<f64>, &LogRecord)| -> Vec<f64> {
                let value = |k: usize| {
                    let x: Vec<f64> = states.row(k).iter().copied().collect();
                    let u: Vec<f64> = record.inputs.iter().map(|u| u[k]).collect();
                    shown.outputs(record.time_s[k], &x, &u, parameters, &mut workspace, &mut y);
                    y.last().copied().unwrap_or(f64::NAN)
                };
                let samples = record.trained_samples().min(states.nrows());
                (0..samples).map(value).filter(|v| v.is_finite()).collect()
            };
            let trained = self.states.iter().zip(records).filter(|(_, r)| r.train.is_some());
            let values: Vec<Vec<f64>> = trained.map(&mut of).collect();
            Some((name, spread(values, sample_time_s)))
        };
        let names = equations.controls().into_iter().chain(equations.links());
        names.filter_map(one).collect()
    }
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    stats::rms(values).unwrap_or(0.0)
}

/// The spread of a signal over several records.
fn spread(records: Vec<Vec<f64>>, sample_time_s: f64) -> Spread {
    let fastest =
        records.iter().flat_map(|r| r.windows(2)).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max)
            / sample_time_s;
    let all: Vec<f64> = records.into_iter().flatten().collect();
    let Some(mean) = stats::mean(all.iter().copied()) else { return Spread::default() };
    let mut sizes: Vec<f64> = all.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let at = |q: f64| sizes[(q * (sizes.len() - 1) as f64) as usize];
    Spread {
        quantiles: [0.1, 0.25, 0.5, 0.75, 0.9, 1.0].map(at),
        rms: root_mean_square(all.iter().copied()),
        std: root_mean_square(all.iter().map(|v| v - mean)),
        smallest: all.iter().copied().fold(f64::INFINITY, f64::min),
        largest: all.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        fastest,
        lattice: lattice(&all),
    }
}

/// The step of the lattice on which all values lie; `None` unless each step is taken several times.
fn lattice(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let size = sorted.last()?.abs().max(sorted.first()?.abs());
    sorted.dedup_by(|a, b| (*a - *b).abs() <= 1e-9 * size);
    if sorted.len() < 2 || 4 * sorted.len() > values.len() {
        return None;
    }
    let step = sorted.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    // Over many steps rounding in the file adds up; the mean of all multiples is the better step.
    let multiples: Vec<f64> = sorted.iter().map(|v| (v / step).round()).collect();
    let better = sorted.iter().zip(&multiples).map(|(v, m)| v * m).sum::<f64>()
        / multiples.iter().map(|m| m * m).sum::<f64>();
    sorted
        .iter()
        .zip(&multiples)
        .all(|(v, m)| (v - m * better).abs() <= 1e-3 * better)
        .then_some(better)
}

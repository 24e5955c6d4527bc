//! One plant, several injected delays.

use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use crate::delay::{DelayEstimator, Experiment, PlantModel, Recording, Search};
use crate::model::c2d::{Conversion, ZeroOrderHold};
use crate::model::{Continuous, StateSpace};
use crate::signal::excitation::Rbs;
use crate::signal::{Excitation, Noise, NoiseColour, NoiseScaling};
use crate::simulate::{Options, lsim};
use crate::time::SampleTime;

/// One plant, one output, random binary input, white noise; several injected delays.
#[derive(Debug, Clone, PartialEq)]
pub struct Injected {
    /// The plant, without delay, one input.
    pub plant: StateSpace<Continuous>,
    /// The output that is measured, counted from 0.
    pub output: usize,
    /// The sample time.
    pub sample_time: SampleTime,
    /// Samples of a record.
    pub samples: usize,
    /// The input.
    pub excitation: Rbs,
    /// var(signal)/var(noise), on the output and on every state.
    pub snr: f64,
    /// Delays to inject, s.
    pub delays_s: Vec<f64>,
    /// Records per delay.
    pub trials: usize,
    /// Seed; every record has a stream of its own.
    pub seed: u64,
}

/// How one method did at one delay.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Cell {
    /// The method's name.
    pub method: String,
    /// The injected delay, s.
    pub delay_s: f64,
    /// Records.
    pub trials: usize,
    /// Records for which it gave no delay.
    pub flagged: usize,
    /// Mean error of the others, samples.
    pub bias_samples: Option<f64>,
    /// Root mean square error of the others, samples.
    pub rms_samples: Option<f64>,
    /// Share of the others whose 95 % interval holds the injected delay.
    pub coverage95: Option<f64>,
}

impl Injected {
    /// One cell per method and delay; the same for any number of threads.
    ///
    /// # Errors
    /// Whatever keeps the plant from being simulated or a method from being set up.
    pub fn run(&self, methods: &[(&str, &dyn DelayEstimator)]) -> crate::Result<Vec<Cell>> {
        let bias = ZeroOrderHold {}.c2d(&self.plant, self.sample_time)?.relative_degree(self.output, 0).unwrap_or(1);
        let search = Search { default_bias: bias, ..Search::default() };
        let mut cells = Vec::new();
        for (d, &delay_s) in self.delays_s.iter().enumerate() {
            let records: Vec<Experiment> =
                (0..self.trials).into_par_iter().map(|t| self.record(delay_s, d * self.trials + t)).collect::<crate::Result<_>>()?;
            for &(name, method) in methods {
                let answers: Vec<Option<(f64, bool)>> = records
                    .par_iter()
                    .map(|record| {
                        let estimate = method.estimate(record, &search)?.into_iter().next().map(|e| e.estimate);
                        let found = estimate.filter(|e| e.outcome.has_delay());
                        Ok(found.and_then(|e| {
                            let inside = e.ci95_s.is_some_and(|[from, to]| from <= delay_s + ROUNDING && delay_s <= to + ROUNDING);
                            Some((e.delay_s? - delay_s, inside))
                        }))
                    })
                    .collect::<crate::Result<_>>()?;
                cells.push(self.cell(name, delay_s, &answers));
            }
        }
        Ok(cells)
    }

    fn record(&self, delay_s: f64, stream: usize) -> crate::Result<Experiment> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(stream as u64);
        let u = self.excitation.generate(self.samples, &mut rng)?;
        let plant = self.plant.clone().with_input_delay(vec![delay_s])?;
        let response = lsim(&plant, &DMatrix::from_column_slice(u.len(), 1, &u), self.sample_time, &Options::default())?;
        let noise = Noise { snr: self.snr, colour: NoiseColour::White, scaling: NoiseScaling::Expected };
        let column = |m: &DMatrix<f64>, i: usize| m.column(i).iter().copied().collect::<Vec<f64>>();
        let y = noise.add(&column(&response.y, self.output), &mut rng)?;
        let states = (0..plant.order()).map(|i| noise.add(&column(&response.x, i), &mut rng)).collect::<Result<_, _>>()?;
        let mut experiment = Experiment::siso(self.sample_time, Vec::new(), Vec::new());
        experiment.recordings = vec![Recording { inputs: vec![u], outputs: vec![y.into()], states }];
        experiment.model = Some(PlantModel::Continuous(self.plant.clone()));
        Ok(experiment)
    }

    #[allow(clippy::cast_precision_loss)]
    fn cell(&self, method: &str, delay_s: f64, answers: &[Option<(f64, bool)>]) -> Cell {
        let found: Vec<(f64, bool)> = answers.iter().copied().flatten().collect();
        let mean = |f: &dyn Fn(&(f64, bool)) -> f64| (!found.is_empty()).then(|| found.iter().map(f).sum::<f64>() / found.len() as f64);
        let ts = self.sample_time.seconds();
        Cell {
            method: method.to_owned(),
            delay_s,
            trials: answers.len(),
            flagged: answers.len() - found.len(),
            bias_samples: mean(&|a| a.0 / ts),
            rms_samples: mean(&|a| (a.0 / ts).powi(2)).map(f64::sqrt),
            coverage95: mean(&|a| f64::from(u8::from(a.1))),
        }
    }
}

/// Seconds by which an interval's end may miss the truth through rounding alone.
const ROUNDING: f64 = 1e-12;

//! Integrating process models: K/s·e^(−τs) and K/(s(1 + T·s))·e^(−τs), their own search over dead time and time constant.
//!
//! Equation: y = K·(I(t − τ) − T·w(t)) + c·t + levels + decays, I the integral of the held input, w its response through 1/(1 + T·s)·e^(−τs); a lag takes a time constant's worth
//! off the integral. c stands for an operating input that is not the records' mean. Everything but τ and T is linear and eliminated, as in `fit`.
//! How it can be wrong: a plant with a slow pole rather than an integrator; a load that changes, which is a slope of its own.

use nalgebra::DVector;

use super::fit::{Signals, project};
use super::model::ProcessModel;
use super::solved::Solved;
use crate::posterior;
use deadtime_identify::Record;
use deadtime_signal::fit::{LevenbergMarquardt, Normal};
use deadtime_signal::time::SampleTime;

/// What is fitted to what, time in samples.
pub(super) struct Integrator<'a> {
    /// With a time constant besides.
    pub(super) lag: bool,
    pub(super) records: &'a [Record<'static>],
    pub(super) max_delay: usize,
    /// The mean of the input over all records.
    pub(super) mean: f64,
}

/// Time constants that are tried, samples.
const LAGS: [f64; 7] = [0.5, 2.0, 5.0, 12.0, 30.0, 100.0, 300.0];
/// Best places of the grid that are descended from.
const STARTS: usize = 4;
/// Smallest time constant, samples.
const LEAST_LAG: f64 = 0.05;

impl Integrator<'_> {
    pub(super) fn solve(&self) -> Result<Solved, String> {
        let shortest = self.records.iter().map(Record::len).min().unwrap_or(0) as f64;
        let lags: Vec<Option<f64>> = if self.lag {
            LAGS.into_iter().filter(|l| *l <= shortest / 3.0).map(|l| Some(l.ln())).collect()
        } else {
            vec![None]
        };
        let mut grid: Vec<(f64, usize, Option<f64>)> = Vec::new();
        for lag in lags {
            for delay in 1..=self.max_delay {
                if let Some(s) = self.signals(delay, 0.5, lag) {
                    grid.push((s.normal(0).cost, delay, lag));
                }
            }
        }
        grid.sort_by(|a, b| a.0.total_cmp(&b.0));
        grid.truncate(STARTS);
        let most = (shortest / 2.0).max(1.0).ln();
        let descend = |(_, delay, lag): &(f64, usize, Option<f64>)| {
            // One minimum for each sampling interval: theirs, and those beside it.
            let beside = delay.saturating_sub(1).max(1)..=(delay + 1).min(self.max_delay);
            let one = |delay: usize| {
                let (mut start, mut lower, mut upper) = (vec![0.5], vec![0.0], vec![1.0]);
                if let Some(lag) = lag {
                    start.insert(0, *lag);
                    lower.insert(0, LEAST_LAG.ln());
                    upper.insert(0, most);
                }
                let search = LevenbergMarquardt {
                    lower,
                    upper,
                    max_iterations: 60,
                    ..LevenbergMarquardt::default()
                };
                let fit = search.minimise(&start, |p| self.evaluate(delay, p));
                fit.normal.cost.is_finite().then_some((fit.normal.cost, delay, fit.parameters))
            };
            beside.filter_map(one).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let best = grid.iter().filter_map(descend).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((cost, delay, p)) = best else {
            return Err("the input moves nothing that an integrator could follow".to_owned());
        };
        let (g, lag) = (p.last().copied().unwrap_or(0.0), (p.len() > 1).then(|| p[0]));
        let signals = self.signals(delay, g, lag).ok_or("it cannot be evaluated at its minimum")?;
        let n = signals.residual.len() as f64;
        let without: f64 = {
            let rest = signals.linear.get(1..).unwrap_or_default();
            let y: Vec<f64> =
                signals.model.iter().zip(&signals.residual).map(|(m, e)| m + e).collect();
            let (_, c) = project(rest, &y).ok_or("its level cannot be fitted")?;
            (0..y.len())
                .map(|t| {
                    (y[t] - rest.iter().zip(c.iter()).map(|(r, c)| c * r[t]).sum::<f64>()).powi(2)
                })
                .sum()
        };
        let counting =
            posterior::samples_under(&signals.slopes[signals.slopes.len() - 1], &signals.residual)
                .min(n);
        let gain = counting * (without / cost.max(f64::MIN_POSITIVE)).ln();
        if gain < posterior::visible_gain(2 + usize::from(self.lag), self.max_delay + 1) {
            return Err(format!(
                "no integrating model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input"
            ));
        }
        let (k, slope) = (signals.coefficients[0], signals.coefficients[1]);
        let values: Vec<f64> = lag.into_iter().chain([delay as f64 - g, k, slope]).collect();
        let (last, poles) = signals.slopes.split_last().ok_or("it has no derivatives")?;
        let jacobian = poles
            .iter()
            .cloned()
            .chain([last.iter().map(|v| -v).collect()])
            .chain(signals.linear.iter().cloned())
            .collect::<Vec<_>>();
        let mut notes = Vec::new();
        if lag.is_some_and(|l| l >= most - 1e-6) {
            notes.push("the time constant is as long as the record shows: it cannot be told from a second integrator".to_owned());
        }
        let level = self.records.iter().flat_map(|r| r.y.iter()).sum::<f64>()
            / self.records.iter().map(Record::len).sum::<usize>().max(1) as f64;
        let mut solved = Solved {
            values,
            jacobian,
            residual: signals.residual,
            lengths: self.records.iter().map(|r| r.len() - self.first(r)).collect(),
            delay: None,
            noise: None,
            operating: [self.mean, level],
            notes,
        };
        let poles = usize::from(self.lag);
        solved.weigh(poles, false);
        solved.operating[0] -= solved.values[poles + 2] / solved.values[poles + 1];
        Ok(solved)
    }

    /// The first sample that counts: where the input moves within the longest delay, what it was before the record matters until then.
    fn first(&self, r: &Record) -> usize {
        let head = r.u.get(..self.max_delay.min(r.len())).unwrap_or_default();
        if head.windows(2).all(|w| w[0] == w[1]) { 0 } else { head.len() }
    }

    fn evaluate(&self, delay: usize, p: &[f64]) -> Option<Normal> {
        let (g, lag) = p.split_last()?;
        Some(self.signals(delay, *g, lag.first().copied())?.normal(p.len()))
    }

    /// Model and derivatives for a delay of `delay` − g samples; slopes by ln T where there is a T, then by g.
    fn signals(&self, delay: usize, g: f64, lag: Option<f64>) -> Option<Signals> {
        let counted: Vec<usize> = self.records.iter().map(|r| r.len() - self.first(r)).collect();
        let total: usize = counted.iter().sum();
        let each = if lag.is_some() { 2 } else { 1 };
        let mut linear = vec![vec![0.0; total]; 2 + each * self.records.len()];
        let mut by_lag = vec![vec![0.0; total]; 1 + self.records.len()];
        let (mut by_g, mut y) = (vec![0.0; total], Vec::with_capacity(total));
        let mut from = 0;
        for (number, r) in self.records.iter().enumerate() {
            let (first, before) = (self.first(r), r.u.first()? - self.mean);
            let at = |t: usize| t.checked_sub(delay).map_or(before, |t| r.u[t] - self.mean);
            // The integral up to a delay ago; before the record the input was what it is at first.
            let mut integral = -before * delay as f64;
            let slow = match lag {
                None => None,
                Some(l) => {
                    let moved: Vec<f64> = r.u.iter().map(|u| u - r.u[0]).collect();
                    let model = ProcessModel {
                        gain: 1.0,
                        lags_s: vec![l.exp()],
                        zero_s: None,
                        delay_s: delay as f64 - g,
                    };
                    Some((l.exp(), model.slopes(&moved, SampleTime::new(1.0).ok()?)?))
                }
            };
            for t in 0..r.len() {
                let held = at(t);
                if t >= first {
                    let row = from + t - first;
                    let mut response = integral + g * held;
                    by_g[row] = held;
                    if let Some((lag, w)) = &slow {
                        let through = w.response[t] + before;
                        let decay = (-(t as f64) / lag).exp();
                        response -= lag * through;
                        // d(I − T·w)/dt is w itself.
                        by_g[row] = through;
                        by_lag[0][row] = -lag * (through + w.by_others[0][t]);
                        by_lag[1 + number][row] = decay * t as f64 / lag;
                        linear[3 + each * number][row] = decay;
                    }
                    linear[0][row] = response;
                    linear[1][row] = t as f64;
                    linear[2 + each * number][row] = 1.0;
                    y.push(r.y[t]);
                }
                integral += held;
            }
            from += counted[number];
        }
        let (inverse, coefficients) = project(&linear, &y)?;
        let sum = |c: &DVector<f64>| -> Vec<f64> {
            (0..total)
                .map(|t| c.iter().zip(&linear).map(|(c, column)| c * column[t]).sum())
                .collect()
        };
        let model = sum(&coefficients);
        let residual = y.iter().zip(&model).map(|(y, m)| y - m).collect();
        let k = coefficients[0];
        let mut slopes = Vec::new();
        if lag.is_some() {
            let decays = |t: usize| {
                (0..self.records.len())
                    .map(|r| coefficients[3 + each * r] * by_lag[1 + r][t])
                    .sum::<f64>()
            };
            slopes.push((0..total).map(|t| k * by_lag[0][t] + decays(t)).collect());
        }
        slopes.push(by_g.iter().map(|v| k * v).collect());
        Some(Signals { residual, model, linear, slopes, inverse, coefficients })
    }
}

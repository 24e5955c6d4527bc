//! Integrating process models: K/s·e^(−τs) and K/(s(1 + T·s))·e^(−τs), with a search over dead time and time constant.
//!
//! Equation: y = K·(I(t − τ) − T·w(t)) + c·t + offsets + decays, I the integral of the held input. w is the input's response through 1/(1 + T·s)·e^(−τs): a lag
//! subtracts T·w from the integral. c represents an operating input that differs from the records' mean. Everything but τ and T is linear and eliminated, as in
//! `fit`. How it can be wrong: a plant with a slow pole instead of an integrator. A changing load is a slope of its own.
//!
//! The interval of the delay is that of the likelihood ratio, the time constant refitted at every delay. A time constant has no value below zero. Of one step,
//! only the rise separates it from dead time.

use super::family::RESOLVED;
use super::fit::{Signals, project};
use super::model::{ProcessModel, Slopes};
use super::reach::reach;
use super::solved::Solved;
use crate::posterior;
use deadtime_identify::Record;
use deadtime_signal::fit::{LevenbergMarquardt, Normal};
use deadtime_signal::stats;
use deadtime_signal::stats::{NORMAL_95, students_t};
use deadtime_signal::time::SampleTime;

/// The data and the model of a fit, time in samples.
#[derive(Clone, Copy)]
pub(super) struct Integrator<'a> {
    /// With a time constant.
    lag: bool,
    /// The lag's state at the start of every record is fitted, too.
    moving: bool,
    /// A record whose input rests within the longest delay is used from its first sample: its input had that value before.
    whole: bool,
    records: &'a [Record<'static>],
    max_delay: usize,
    /// The mean of the input over all records.
    mean: f64,
}

/// The minimum of a model.
pub(super) struct Lowest<'a> {
    model: Integrator<'a>,
    /// Without the interval of the delay.
    pub(super) solved: Solved,
    /// The delay of least squares, samples.
    at: f64,
    /// ln T.
    lag: Option<f64>,
    /// Its largest value.
    most: f64,
}

impl Lowest<'_> {
    /// The 95 % interval of the delay, samples. It moves with the further step of the estimate.
    pub(super) fn interval(&self) -> [f64; 2] {
        let moved = self.solved.values[usize::from(self.lag.is_some())] - self.at;
        self.model.interval(self.at, self.lag, self.most).map(|end| (end + moved).max(0.0))
    }
}

/// Tested time constants, samples.
const LAGS: [f64; 7] = [0.5, 2.0, 5.0, 12.0, 30.0, 100.0, 300.0];
/// Delays of the grid.
const PLACES: usize = 80;
/// Best grid points from which a descent starts.
const STARTS: usize = 4;
/// Smallest time constant, samples: the tolerance of a delay without one.
const LEAST_LAG: f64 = 0.001;

/// Σ e², the delay of the states, and ln T with a time constant, then g.
type Bottom = (f64, usize, Vec<f64>);

impl<'a> Integrator<'a> {
    pub(super) fn new(
        lag: bool,
        records: &'a [Record<'static>],
        max_delay: usize,
        mean: f64,
    ) -> Self {
        Self { lag, moving: lag, whole: true, records, max_delay, mean }
    }

    /// Without the samples that depend on the input before the record.
    pub(super) fn without_heads(self) -> Self {
        Self { whole: false, ..self }
    }

    /// The fit with the interval of its delay.
    pub(super) fn solve(&self) -> Result<Solved, String> {
        let lowest = self.lowest()?;
        let delay = Some(lowest.interval());
        Ok(Solved { delay, ..lowest.solved })
    }

    /// The model whose lag starts in motion where that is significant, else the one from rest. The decay of a very short lag would follow the noise of one sample.
    pub(super) fn lowest(&self) -> Result<Lowest<'a>, String> {
        let moving = self.fitted();
        if !self.lag {
            return moving;
        }
        match (Self { moving: false, ..*self }.fitted(), moving) {
            (Ok(resting), Ok(moving)) if self.starts_in_motion(&resting.solved, &moving.solved) => {
                Ok(moving)
            }
            (Ok(resting), _) => Ok(resting),
            (Err(_), moving) => moving,
        }
    }

    /// Some samples are used although they depend on the input before the record.
    pub(super) fn has_heads(&self) -> bool {
        self.records.iter().any(|r| self.first(r) == 0)
    }

    fn starts_in_motion(&self, resting: &Solved, moving: &Solved) -> bool {
        let cost = |solved: &Solved| solved.residual.iter().map(|e| e * e).sum::<f64>();
        let n = moving.residual.len() as f64;
        // After ln T, delay, K and slope, each record has its level and its decay.
        let counting = (moving.jacobian.iter().skip(5).step_by(2))
            .map(|decay| posterior::samples_under(decay, &moving.residual))
            .fold(n, f64::min);
        let gain = counting * (cost(resting) / cost(moving).max(f64::MIN_POSITIVE)).ln();
        gain > posterior::visible_gain(self.records.len(), 1)
    }

    fn fitted(&self) -> Result<Lowest<'a>, String> {
        let shortest = self.records.iter().map(Record::len).min().unwrap_or(0) as f64;
        let most = (shortest / 2.0).max(1.0).ln();
        let Some((cost, delay, p)) = self.best(shortest, most) else {
            return Err("the input moves nothing that an integrator could follow".to_owned());
        };
        let (g, lag) = (p.last().copied().unwrap_or(0.0), (p.len() > 1).then(|| p[0]));
        let signals = self.signals(delay, g, lag).ok_or("it cannot be evaluated at its minimum")?;
        let (last, by_lag) = signals.slopes.split_last().ok_or("it has no derivatives")?;
        self.visible(&signals, last, cost)?;
        let at = delay as f64 - g;
        let jacobian = by_lag
            .iter()
            .cloned()
            .chain([last.iter().map(|v| -v).collect()])
            .chain(signals.linear.iter().cloned())
            .collect();
        let mut notes = Vec::new();
        if lag.is_some_and(|l| l >= most - 1e-6) {
            notes.push("the time constant is as long as the record shows: it is indistinguishable from a second integrator".to_owned());
        }
        let level = stats::mean(self.records.iter().flat_map(|r| r.y.iter().copied()));
        let (k, slope) = (signals.coefficients[0], signals.coefficients[1]);
        let mut solved = Solved {
            values: lag.into_iter().chain([at, k, slope]).collect(),
            jacobian,
            residual: signals.residual,
            lengths: self.records.iter().map(|r| r.len() - self.first(r)).collect(),
            delay: None,
            noise: None,
            operating: [self.mean, level.unwrap_or(0.0)],
            notes,
        };
        let poles = usize::from(self.lag);
        solved.weigh(poles, false);
        solved.operating[0] -= solved.values[poles + 2] / solved.values[poles + 1];
        Ok(Lowest { model: *self, solved, at, lag, most })
    }

    /// The lowest of the local minima around the best grid points.
    fn best(&self, shortest: f64, most: f64) -> Option<Bottom> {
        let lags: Vec<Option<f64>> = if self.lag {
            LAGS.into_iter().filter(|l| *l <= shortest / 3.0).map(|l| Some(l.ln())).collect()
        } else {
            vec![None]
        };
        let cost = |delay: usize, lag| Some(self.signals(delay, 0.5, lag)?.normal(0).cost);
        let mut stride = self.max_delay.div_ceil(PLACES);
        let mut grid: Vec<(f64, usize, Option<f64>)> = Vec::new();
        for lag in lags {
            let places = (1..=self.max_delay).step_by(stride);
            grid.extend(places.filter_map(|delay| Some((cost(delay, lag)?, delay, lag))));
        }
        grid.sort_by(|a, b| a.0.total_cmp(&b.0));
        grid.truncate(STARTS);
        // The cost of an integral varies slowly: halving the stride finds its minimum.
        while stride > 1 {
            stride = stride.div_ceil(2);
            for at in &mut grid {
                let near =
                    [at.1.saturating_sub(stride).max(1), (at.1 + stride).min(self.max_delay)];
                let found =
                    near.into_iter().filter_map(|delay| Some((cost(delay, at.2)?, delay, at.2)));
                *at = found.fold(*at, |best, next| if next.0 < best.0 { next } else { best });
            }
        }
        // One minimum for each sampling interval: the point's own, and its neighbours.
        let descend = |(_, delay, lag): &(f64, usize, Option<f64>)| {
            let neighbours = delay.saturating_sub(1).max(1)..=(delay + 1).min(self.max_delay);
            let bottoms = neighbours.filter_map(|delay| self.descend(delay, *lag, most));
            bottoms.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut best = grid.iter().filter_map(descend).min_by(|a, b| a.0.total_cmp(&b.0))?;
        // The valley of delay and time constant crosses sampling intervals.
        for _ in 0..self.max_delay {
            let lag = (best.2.len() > 1).then(|| best.2[0]);
            let near = [best.1.saturating_sub(1).max(1), (best.1 + 1).min(self.max_delay)];
            let neighbours = near.into_iter().filter(|delay| *delay != best.1);
            let bottoms = neighbours.filter_map(|delay| self.descend(delay, lag, most));
            match bottoms.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|next| next.0 < best.0) {
                Some(next) => best = next,
                None => break,
            }
        }
        Some(best)
    }

    /// The minimum within one sampling interval.
    fn descend(&self, delay: usize, lag: Option<f64>, most: f64) -> Option<Bottom> {
        let (mut start, mut lower, mut upper) = (vec![0.5], vec![0.0], vec![1.0]);
        if let Some(lag) = lag {
            start.insert(0, lag);
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
    }

    /// The likelihood-ratio interval of the delay at 95 %, samples, from the minimum at delay `at`. Coloured residuals count as fewer samples.
    fn interval(&self, at: f64, lag: Option<f64>, most: f64) -> [f64; 2] {
        let delay = at.ceil().max(1.0);
        let signals = self.signals(delay as usize, delay - at, lag);
        let Some((signals, alone)) = signals.and_then(|s| s.alone().map(|alone| (s, alone))) else {
            return [0.0, self.max_delay as f64];
        };
        let squares = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
        let power = squares(&signals.model) + squares(&signals.residual);
        let floored = |cost: f64| cost.max(posterior::ROUNDING * power).max(f64::MIN_POSITIVE);
        let cost = floored(squares(&signals.residual));
        let independent = posterior::samples_under(&alone, &signals.residual);
        let parameters = signals.slopes.len() + signals.linear.len();
        let freedom = (independent - parameters as f64).max(1.0);
        let quantile = students_t(0.975, freedom).unwrap_or(NORMAL_95);
        let std = (cost / freedom / squares(&alone).max(f64::MIN_POSITIVE)).sqrt();
        [-1.0, 1.0].map(|direction| {
            let limit = if direction > 0.0 { self.max_delay as f64 - at } else { at };
            let mut near = (at, lag);
            let distance = reach(0.0, (quantile * std).clamp(RESOLVED, 0.5), limit, |step| {
                let here = at + direction * step;
                let (found, lag) = self.refitted(here, near, most)?;
                let lacks = freedom * (floored(found) / cost).ln();
                if lacks < quantile * quantile {
                    near = (here, lag);
                }
                Some(lacks.max(0.0).sqrt() / quantile)
            });
            at + direction * distance
        })
    }

    /// Σ e² at a delay, samples, and the ln T of lowest cost. The descents start at the one of a delay nearby, and where the sum of delay and time constant,
    /// which is the ramp's own delay, is the same.
    fn refitted(
        &self,
        at: f64,
        (nearby, lag): (f64, Option<f64>),
        most: f64,
    ) -> Option<(f64, Option<f64>)> {
        let delay = at.ceil().max(1.0);
        let signals = |lag| self.signals(delay as usize, delay - at, lag);
        let Some(lag) = lag else { return Some((signals(None)?.normal(0).cost, None)) };
        let search = LevenbergMarquardt {
            lower: vec![LEAST_LAG.ln()],
            upper: vec![most],
            max_iterations: 60,
            ..LevenbergMarquardt::default()
        };
        let same_sum = (lag.exp() + nearby - at).max(LEAST_LAG).ln().min(most);
        let fits = [lag, same_sum]
            .map(|start| search.minimise(&[start], |p| Some(signals(Some(p[0]))?.normal(1))));
        let best = fits.into_iter().min_by(|a, b| a.normal.cost.total_cmp(&b.normal.cost))?;
        best.normal.cost.is_finite().then(|| (best.normal.cost, best.parameters.first().copied()))
    }

    /// Tests that the output visibly follows the input: offset and initial states alone leave a significantly larger residual.
    fn visible(&self, signals: &Signals, by_delay: &[f64], cost: f64) -> Result<(), String> {
        let rest = signals.linear.get(1..).unwrap_or_default();
        let y: Vec<f64> = signals.model.iter().zip(&signals.residual).map(|(m, e)| m + e).collect();
        let (_, c) = project(rest, &y).ok_or("its level cannot be fitted")?;
        let without: f64 = (0..y.len())
            .map(|t| (y[t] - rest.iter().zip(c.iter()).map(|(r, c)| c * r[t]).sum::<f64>()).powi(2))
            .sum();
        let counting = posterior::samples_under(by_delay, &signals.residual)
            .min(signals.residual.len() as f64);
        let gain = counting * (without / cost.max(f64::MIN_POSITIVE)).ln();
        if gain < posterior::visible_gain(2 + usize::from(self.lag), self.max_delay + 1) {
            return Err(format!(
                "no integrating model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input"
            ));
        }
        Ok(())
    }

    /// The first used sample: where the input moves within the longest delay, earlier samples depend on the input before the record.
    fn first(&self, r: &Record) -> usize {
        let head = r.u.get(..self.max_delay.min(r.len())).unwrap_or_default();
        if self.whole && head.windows(2).all(|w| w[0] == w[1]) { 0 } else { head.len() }
    }

    fn evaluate(&self, delay: usize, p: &[f64]) -> Option<Normal> {
        let (g, lag) = p.split_last()?;
        Some(self.signals(delay, *g, lag.first().copied())?.normal(p.len()))
    }

    /// Model and derivatives for a delay of `delay` − g samples; slopes by ln T where T exists, then by g.
    fn signals(&self, delay: usize, g: f64, lag: Option<f64>) -> Option<Signals> {
        let IntegratorColumns { linear, by_lag, by_g, y } = self.columns(delay, g, lag)?;
        let total = y.len();
        let (inverse, coefficients) = project(&linear, &y)?;
        let model: Vec<f64> = (0..total)
            .map(|t| coefficients.iter().zip(&linear).map(|(c, column)| c * column[t]).sum())
            .collect();
        let residual = y.iter().zip(&model).map(|(y, m)| y - m).collect();
        let k = coefficients[0];
        let mut slopes = Vec::new();
        if lag.is_some() {
            let decays = |t: usize| {
                let moving = if self.moving { self.records.len() } else { 0 };
                (0..moving).map(|r| coefficients[3 + 2 * r] * by_lag[1 + r][t]).sum::<f64>()
            };
            slopes.push((0..total).map(|t| k * by_lag[0][t] + decays(t)).collect());
        }
        slopes.push(by_g.iter().map(|v| k * v).collect());
        Some(Signals { residual, model, linear, slopes, inverse, coefficients })
    }

    /// The columns of the outputs.
    fn columns(&self, delay: usize, g: f64, lag: Option<f64>) -> Option<IntegratorColumns> {
        let counted: Vec<usize> = self.records.iter().map(|r| r.len() - self.first(r)).collect();
        let total: usize = counted.iter().sum();
        let each = if self.moving { 2 } else { 1 };
        let mut linear = vec![vec![0.0; total]; 2 + each * self.records.len()];
        let mut by_lag = vec![vec![0.0; total]; 1 + self.records.len()];
        let (mut by_g, mut y) = (vec![0.0; total], Vec::with_capacity(total));
        let mut from = 0;
        for (number, r) in self.records.iter().enumerate() {
            let (first, before) = (self.first(r), r.u.first()? - self.mean);
            let at = |t: usize| t.checked_sub(delay).map_or(before, |t| r.u[t] - self.mean);
            // The integral up to one delay ago; before the record the input equals its first value.
            let mut integral = -before * delay as f64;
            let slow = match lag {
                None => None,
                Some(l) => Some((l.exp(), through_the_lag(r, l, delay as f64 - g)?)),
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
                        if self.moving {
                            by_lag[1 + number][row] = decay * t as f64 / lag;
                            linear[3 + each * number][row] = decay;
                        }
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
        Some(IntegratorColumns { linear, by_lag, by_g, y })
    }
}

/// The columns of the outputs, all records in a row, and the outputs.
struct IntegratorColumns {
    /// The response, time, and of each record its level and decay.
    linear: Vec<Vec<f64>>,
    /// Derivatives by ln T of the response and of each record's decay.
    by_lag: Vec<Vec<f64>>,
    by_g: Vec<f64>,
    y: Vec<f64>,
}

/// The response to the input's motion behind a lag of e^`l` samples and a delay.
fn through_the_lag(r: &Record, l: f64, delay_s: f64) -> Option<Slopes> {
    let moved: Vec<f64> = r.u.iter().map(|u| u - r.u[0]).collect();
    let model = ProcessModel { gain: 1.0, lags_s: vec![l.exp()], zero_s: None, delay_s };
    model.slopes(&moved, SampleTime::new(1.0).ok()?)
}

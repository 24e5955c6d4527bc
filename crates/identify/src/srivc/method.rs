//! The method: dead times on a grid, several starts, least squares of output errors, and steps weighted by the noise's own colour.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::filters::Poles;
use super::point::{Data, Linear, Point, power};
use crate::error::IdentifyError;
use crate::parametric::{Cloud, Coloured, Parameter, Parametric, coloured, given, usable};
use crate::rival::{FAR, Rival};
use crate::subspace::identifier::{Identified, Identifier};
use crate::subspace::innovations::InnovationsModel;
use crate::subspace::recordings::{Recordings, Scales, Stretch};
use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{Continuous, StateSpace};
use deadtime_signal::fit::LevenbergMarquardt;
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::interval95;
use deadtime_signal::time::SampleTime;
use statrs::function::erf::erfc;

/// y(t) = Σ B_j(p)/A(p)·u_j(t − τ_j) + e/D(q), p = d/dt. A is common to all inputs; each has a B and a real-valued dead time of its own.
///
/// Inputs: records of one output on one even grid, inputs held between samples. Output: a₁ …, b₀ … of every input in powers of s and s⁻¹, and dead times in s,
/// with standard deviations and intervals. Also the model in continuous time. Estimate: simplified refined instrumental variables start from filtered least
/// squares at every dead time of the search. Least squares of the output error over poles and dead times continue from the best of these, and from a subspace
/// model. Gauss-Newton steps under the autoregression of the residual follow. Every record has its own initial state and offset. Intervals come from the last
/// step's covariance.
/// Assumes: open loop, a stable plant, `nb` ≤ `nf` (no direct path), noise independent of the inputs.
/// Fails when: the input is not held between samples, or depends on the output (biased); poles are much faster than the sample time.
/// Source: Young and Jakeman (1980), doi:10.1080/00207178008961080; Garnier and Young (2014), "The advantages of directly identifying continuous-time transfer
/// function models in practical applications", Int. J. Control 87(7), 1319-1338, doi:10.1080/00207179.2013.840053; Ljung (1999), section 10.2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Srivc {
    /// Poles; default 2. `order` is a synonym.
    #[serde(alias = "order")]
    pub nf: usize,
    /// Coefficients of B, for each input, at most `nf`; default 1, no zero.
    pub nb: usize,
    /// Each input's dead time, s; `None`: fitted.
    pub delay_s: Option<Vec<f64>>,
    /// Longest dead time searched, samples; default 35.
    pub max_delay: usize,
    /// Drawn models for bands, and as many small ones for standard deviations of poles; default 200; 0: none.
    pub draws: usize,
    /// Seed of the draws; default 1.
    pub seed: u64,
}

impl Default for Srivc {
    fn default() -> Self {
        Self { nf: 2, nb: 1, delay_s: None, max_delay: 35, draws: 200, seed: 1 }
    }
}

const NAME: &str = "srivc";
/// Passes over several inputs, each with the other dead times fixed.
const TURNS: usize = 3;
/// Number of dead times whose starts are refined, and of starts of the last search.
const REFINED: usize = 8;
const STARTS: usize = 3;
/// Number of minima in the mixture.
const MINIMA: usize = 6;
/// Twice the logarithm of a likelihood ratio, beyond which noise alone cannot have swapped two minima.
const BEYOND_NOISE: f64 = 50.0;
/// A weight below this value moves no end of an interval.
const NOTHING: f64 = 1e-3;
/// Steps under the noise's own colour.
const STEPS: usize = 3;
/// Largest number of records, or stretches between gaps.
const STRETCHES: usize = 100;
/// Longest part of a record used for starts, samples.
const HEAD: usize = 20_000;

fn failed(reason: &str) -> IdentifyError {
    IdentifyError::Unfit { method: NAME, reason: reason.to_owned() }
}

impl Identifier for Srivc {
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        let m = recordings.inputs.len();
        let delays = self.checked(recordings)?;
        let longest = delays
            .as_ref()
            .map_or(self.max_delay as f64, |d| d.iter().copied().fold(0.0, f64::max));
        let history = longest.ceil() as usize + 1;
        let (used, said) =
            usable(NAME, recordings, history + 4 * (self.nf + m * self.nb + self.nf + 2))?;
        if used.stretches.len() > STRETCHES {
            let rule = "at most 100: fill the gaps, or name fewer logs";
            let value = used.stretches.len() as f64;
            return Err(IdentifyError::Option {
                option: "number of stretches without a gap",
                value,
                rule,
            });
        }
        let scales = used.scales()?;
        let scaled: Vec<Stretch> = used.stretches.iter().map(|s| scales.scaled(s)).collect();
        let data = Data::new(&scaled, history, self.nb);
        far.at(0.05, &"trying dead times");
        let starts = self.starts(&data, delays.as_deref())?;
        far.at(0.5, &"fitting");
        let subspace = self.subspace(&used, &starts);
        let free = vec![delays.is_none(); m];
        let ends = self.searched(&data, starts, subspace.as_ref(), &free)?;
        if let (Some(theirs), Some(End { loss, .. })) = (&subspace, ends.first())
            && *loss > FAR * theirs.mean_square * data.rows() as f64
        {
            return Err(failed(
                "a subspace model of the same order explains the output far better, so this is not the best model of its orders; take more coefficients of B (nb), \
                 other orders, or --method pbsidopt",
            ));
        }
        far.at(0.8, &"weighing by the noise");
        let weighed = ends.into_iter().filter_map(|e| Weighed::of(&data, e.point, e.linear, &free));
        let mut fits: Vec<Weighed> = weighed.collect();
        fits.sort_by(|a, b| a.noise.variance.total_cmp(&b.noise.variance));
        if fits.is_empty() {
            return Err(failed(
                "the numbers are indistinguishable; take smaller orders, or record with a stronger excitation",
            ));
        }
        self.answer(&used, scales, fits, &free, said)
    }
}

impl Data {
    fn new(scaled: &[Stretch], history: usize, nb: usize) -> Self {
        let row = |m: &DMatrix<f64>, j: usize| m.row(j).iter().copied().collect::<Vec<f64>>();
        Self {
            inputs: scaled
                .iter()
                .map(|s| (0..s.u.nrows()).map(|j| row(&s.u, j)).collect())
                .collect(),
            outputs: scaled.iter().map(|s| row(&s.y, 0).split_off(history)).collect(),
            history,
            nb,
        }
    }

    /// The first samples of every stretch.
    fn head(&self) -> Self {
        let inputs = |stretch: &Vec<Vec<f64>>| {
            stretch.iter().map(|u| u[..u.len().min(HEAD + self.history)].to_vec()).collect()
        };
        Self {
            inputs: self.inputs.iter().map(inputs).collect(),
            outputs: self.outputs.iter().map(|y| y[..y.len().min(HEAD)].to_vec()).collect(),
            ..*self
        }
    }
}

impl Srivc {
    /// The given dead times, samples.
    fn checked(&self, recordings: &Recordings) -> Result<Option<Vec<f64>>, IdentifyError> {
        let refused = |option, value: f64, rule| Err(IdentifyError::Option { option, value, rule });
        if !(1..=20).contains(&self.nf) {
            return refused("nf", self.nf as f64, "it must be 1 to 20");
        }
        if !(1..=self.nf).contains(&self.nb) {
            return refused("nb", self.nb as f64, "it must be 1 to nf: there is no direct path");
        }
        let Some(given) = &self.delay_s else { return Ok(None) };
        if given.len() != recordings.inputs.len() {
            return refused(
                "number of dead times in delay_s",
                given.len() as f64,
                "one for each input",
            );
        }
        if let Some(value) = given.iter().find(|d| !(d.is_finite() && **d >= 0.0)) {
            return refused("delay_s", *value, "it must be 0 or more");
        }
        let step_s = recordings.sample_time.seconds();
        Ok(Some(given.iter().map(|d| d / step_s).collect()))
    }

    /// The best starts, least loss first: at the given dead times, or at whole samples of one input after the other.
    fn starts(&self, data: &Data, given: Option<&[f64]>) -> Result<Vec<Point>, IdentifyError> {
        let head = data.head();
        let none = || {
            failed(
                "no model of these orders is stable and explains the data; take smaller nf and nb, or record with a stronger excitation",
            )
        };
        if let Some(delays) = given {
            let start = head.start(self.nf, delays).ok_or_else(none)?.1;
            return Ok(vec![head.refined(start.clone()).map_or(start, |(_, p)| p)]);
        }
        let m = data.count();
        let mut delays = vec![0.0; m];
        let mut ranked: Vec<(f64, Point)> = Vec::new();
        for _ in 0..if m == 1 { 1 } else { TURNS } {
            let before = delays.clone();
            for j in 0..m {
                let at = |d: usize| {
                    let mut own = delays.clone();
                    own[j] = d as f64;
                    head.start(self.nf, &own)
                };
                let mut found: Vec<(f64, Point)> = parallel::filter_map(0..=self.max_delay, at);
                found.sort_by(|a, b| a.0.total_cmp(&b.0));
                found.truncate(REFINED);
                found = parallel::filter_map(found, |(_, p)| head.refined(p));
                found.sort_by(|a, b| a.0.total_cmp(&b.0));
                let best = found.first().ok_or_else(none)?;
                delays[j] = best.1.delays[j];
                ranked = found;
            }
            if delays == before {
                break;
            }
        }
        let likely =
            Likely { rows: head.rows() as f64, least: ranked.first().map_or(0.0, |r| r.0) };
        let begun = |(i, (loss, _)): &(usize, (f64, Point))| *i < STARTS || likely.holds(*loss);
        Ok(ranked.into_iter().enumerate().filter(begun).map(|(_, (_, p))| p).collect())
    }

    /// A subspace model of the same order behind the best start's dead times.
    fn subspace(&self, used: &Recordings, starts: &[Point]) -> Option<Rival> {
        let delays: Vec<usize> = starts.first()?.delays.iter().map(|d| *d as usize).collect();
        Rival::of(used, &delays, self.nf)
    }

    /// The minima of the output error over poles and dead times that noise may have swapped, the least first.
    fn searched(
        &self,
        data: &Data,
        mut starts: Vec<Point>,
        subspace: Option<&Rival>,
        free: &[bool],
    ) -> Result<Vec<End>, IdentifyError> {
        let poles = subspace.and_then(|s| Poles::of_sampled(&s.poles));
        if let (Some(poles), Some(first)) = (poles, starts.first()) {
            starts.push(Point { poles, delays: first.delays.clone() });
        }
        // The derivative by a dead time jumps at whole samples: the search starts on either side of each.
        let most = data.history as f64 - 1.0;
        let between = |point: &Point| {
            let late = |(d, free): (&f64, &bool)| if *free { (d + 0.5).min(most) } else { *d };
            let delays = point.delays.iter().zip(free).map(late).collect();
            Point { poles: point.poles.clone(), delays }
        };
        if free.contains(&true) {
            starts.extend(starts.iter().map(between).collect::<Vec<_>>());
        }
        let mut ends: Vec<End> = parallel::filter_map(starts, |start| {
            let point = self.descended(data, &start, free);
            data.solved(&point).map(|s| End { loss: s.loss, point, linear: s.linear })
        });
        ends.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        let least = ends.first().map(|e| e.loss);
        let least =
            least.ok_or_else(|| failed("the search has no finite end; take smaller orders"))?;
        let likely = Likely { rows: data.rows() as f64, least };
        let mut distinct: Vec<End> = Vec::new();
        for end in ends {
            let new = !distinct.iter().any(|d| d.is(&end)) && distinct.len() < MINIMA;
            if distinct.is_empty() || (new && likely.holds(end.loss)) {
                distinct.push(end);
            }
        }
        Ok(distinct)
    }

    fn descended(&self, data: &Data, start: &Point, free: &[bool]) -> Point {
        let n = start.poles.order();
        let count = free.iter().filter(|f| **f).count();
        let place = |z: &[f64]| {
            let mut point = start.clone();
            point.poles.a.copy_from_slice(&z[..n]);
            let moved = (0..free.len()).filter(|j| free[*j]);
            moved.zip(&z[n..]).for_each(|(j, d)| point.delays[j] = *d);
            point
        };
        let mut from = start.poles.a.clone();
        from.extend(start.delays.iter().zip(free).filter(|(_, f)| **f).map(|(d, _)| *d));
        let limits =
            |of_delay: f64, of_pole: f64| [vec![of_pole; n], vec![of_delay; count]].concat();
        let search = LevenbergMarquardt {
            lower: limits(0.0, f64::NEG_INFINITY),
            upper: limits(data.history as f64 - 1.0, f64::INFINITY),
            gradient_tolerance: 1e-8,
            step_tolerance: 1e-8,
            ..LevenbergMarquardt::default()
        };
        place(&search.minimise(&from, |z| data.normal(&place(z), free)).parameters)
    }
}

/// A minimum of the output error.
struct End {
    loss: f64,
    point: Point,
    linear: Linear,
}

impl End {
    /// The same minimum, reached from another start.
    fn is(&self, other: &Self) -> bool {
        let delays = self.point.delays.iter().zip(&other.point.delays);
        delays.into_iter().all(|(a, b)| (a - b).abs() < 0.05)
            && (self.loss - other.loss).abs() <= 1e-6 * self.loss
    }
}

/// Losses that are compatible with the truth.
struct Likely {
    rows: f64,
    least: f64,
}

impl Likely {
    fn holds(&self, loss: f64) -> bool {
        self.rows * (loss.max(f64::MIN_POSITIVE) / self.least.max(f64::MIN_POSITIVE)).ln()
            < BEYOND_NOISE
    }
}

/// A fit under the noise's own colour.
struct Weighed {
    point: Point,
    linear: Linear,
    noise: Coloured,
    rows: usize,
}

impl Weighed {
    /// a, the free delays in samples and b, with their covariance.
    fn numbers(&self, free: &[bool]) -> (Vec<f64>, DMatrix<f64>) {
        let mut values = self.point.poles.a.clone();
        values.extend(self.point.delays.iter().zip(free).filter(|(_, f)| **f).map(|(d, _)| *d));
        values.extend(&self.linear.b);
        let count = values.len();
        (values, self.noise.covariance.view((0, 0), (count, count)).into_owned())
    }

    /// Gauss-Newton steps while they lower the variance of the noise.
    fn of(data: &Data, point: Point, linear: Linear, free: &[bool]) -> Option<Self> {
        let lengths: Vec<usize> = data.outputs.iter().map(Vec::len).collect();
        let y = data.outputs.concat();
        let look = |point: &Point, linear: &Linear| {
            let model = data.output(point, linear);
            let left: Vec<f64> = y.iter().zip(&model).map(|(y, x)| y - x).collect();
            let slopes = data.all_slopes(point, linear, free);
            coloured(&slopes, &left, &lengths, true).map(|c| (c, power(&left)))
        };
        let (mut point, mut linear) = (point, linear);
        let (mut noise, _) = look(&point, &linear)?;
        for _ in 0..STEPS {
            let Some((next, own)) = moved(data, &point, &linear, free, &noise.change) else {
                break;
            };
            let Some((found, _)) = look(&next, &own) else { break };
            let (there, here) = (found.variance, noise.variance * (1.0 + 1e-3));
            if there.is_nan() || there > here {
                break;
            }
            (point, linear, noise) = (next, own, found);
        }
        Some(Self { point, linear, noise, rows: y.len() })
    }
}

/// Poles, delays, B and initial states after a step; `None` for invalid ones.
fn moved(
    data: &Data,
    point: &Point,
    linear: &Linear,
    free: &[bool],
    change: &[f64],
) -> Option<(Point, Linear)> {
    let (mut point, mut linear) = (point.clone(), linear.clone());
    let (n, mut change) = (point.poles.order(), change.iter());
    point.poles.a.iter_mut().zip(change.by_ref().take(n)).for_each(|(a, c)| *a += c);
    let most = data.history as f64 - 1.0;
    for (delay, _) in point.delays.iter_mut().zip(free).filter(|(_, f)| **f) {
        *delay = (*delay + change.next()?).clamp(0.0, most);
    }
    linear.b.iter_mut().for_each(|b| *b += change.next().copied().unwrap_or(0.0));
    for own in &mut linear.own {
        own.iter_mut().take(n).for_each(|s| *s += change.next().copied().unwrap_or(0.0));
    }
    if !point.poles.is_stable() {
        return None;
    }
    // Offsets are fitted jointly with them.
    let model = data.output(&point, &linear);
    let mut from = 0;
    for (y, own) in data.outputs.iter().zip(&mut linear.own) {
        let left = y.iter().zip(&model[from..]).map(|(y, x)| y - x).sum::<f64>() / y.len() as f64;
        if let Some(level) = own.last_mut() {
            *level += left;
        }
        from += y.len();
    }
    Some((point, linear))
}

/// The model of parameters in the order of the covariance: a, delays in samples, b.
#[derive(Clone)]
struct Build<'a> {
    omega: f64,
    n: usize,
    nb: usize,
    delays: &'a [f64],
    free: &'a [bool],
    step: SampleTime,
    /// The output's unit over each input's.
    units: Vec<f64>,
}

impl Build<'_> {
    fn delays(&self, values: &[f64]) -> Vec<f64> {
        let mut moved = values[self.n..].iter();
        let one = |(given, free): (&f64, &bool)| match free {
            true => moved.next().copied().unwrap_or(0.0).max(0.0),
            false => *given,
        };
        self.delays.iter().zip(self.free).map(one).collect()
    }

    /// The factor of aᵢ, or of B's i-th coefficient, from the search's time unit to seconds.
    fn factors(&self) -> (Vec<f64>, Vec<f64>) {
        let omega = self.omega / self.step.seconds();
        let of_a = (1..=self.n).map(|i| omega.powi(i as i32)).collect();
        let power = |i: usize| omega.powi((self.n + 1 + i - self.nb) as i32);
        (of_a, (0..self.nb).map(power).collect())
    }

    /// Observer form, in the search's time unit so that entries are of similar size.
    fn system(&self, values: &[f64]) -> Option<StateSpace<Continuous>> {
        let (n, nb, m) = (self.n, self.nb, self.units.len());
        let omega = self.omega / self.step.seconds();
        let b = &values[values.len() - m * nb..];
        let a = DMatrix::from_fn(n, n, |i, j| {
            omega * if j == 0 { -values[i] } else { f64::from(u8::from(j == i + 1)) }
        });
        let entry = |i: usize, j: usize| {
            let at = (i + nb).checked_sub(n);
            at.map_or(0.0, |at| omega * b[j * nb + at] * self.units[j])
        };
        let c = DMatrix::from_fn(1, n, |_, j| f64::from(u8::from(j == 0)));
        let delays = self.delays(values).iter().map(|d| self.step.to_seconds(*d)).collect();
        StateSpace::continuous(a, DMatrix::from_fn(n, m, entry), c, DMatrix::zeros(1, m))
            .ok()?
            .with_input_delay(delays)
            .ok()
    }

    fn sampled(&self, values: &[f64]) -> Option<(InnovationsModel, Vec<usize>)> {
        let s = ZeroOrderHold::default().c2d(&self.system(values)?, self.step).ok()?;
        let [a, b, c, d] = [s.a(), s.b(), s.c(), s.d()].map(Clone::clone);
        let k = DMatrix::zeros(s.order(), 1);
        Some((InnovationsModel { a, b, c, d, k }, s.input_delay().to_vec()))
    }
}

impl Srivc {
    fn answer(
        &self,
        used: &Recordings,
        mut scales: Scales,
        fits: Vec<Weighed>,
        free: &[bool],
        said: Option<String>,
    ) -> Result<Identified, IdentifyError> {
        let (n, nb, m) = (self.nf, self.nb, used.inputs.len());
        let spread = scales.outputs[0].1;
        let units: Vec<f64> = scales.inputs.iter().map(|s| spread / s.1).collect();
        let numbers = |fit: &Weighed| {
            let build = self.build(fit, free, used.sample_time, &units);
            let (values, covariance) = fit.numbers(free);
            parameters(used, &build, &values, &covariance)
        };
        let parameters = mixed(&fits, fits.iter().map(numbers).collect());
        let notes = self.notes(said, &fits, free, used);
        let Some(fit) = fits.into_iter().next() else { return Err(failed("no fit is left")) };
        let build = self.build(&fit, free, used.sample_time, &units);
        let (values, covariance) = fit.numbers(free);
        let Weighed { linear, noise, rows, .. } = &fit;
        let nominal = build.system(&values).ok_or_else(|| failed("its numbers make no model"))?;
        let (model, delays) =
            build.sampled(&values).ok_or_else(|| failed("it cannot be sampled"))?;
        let cloud = Cloud::of(values.clone(), &covariance, self.seed);
        let draws =
            cloud.map(|c| c.models(self.draws, &|v: &[f64]| build.sampled(v))).unwrap_or_default();
        let total = linear.own.len().max(1) as f64;
        let level = linear.own.iter().filter_map(|o| o.last()).sum::<f64>() / total;
        scales.outputs[0].0 += spread * level;
        Ok(Identified {
            method: NAME,
            sample_time: used.sample_time,
            inputs: used.inputs.clone(),
            outputs: used.outputs.clone(),
            past: noise.d.len(),
            rows: *rows,
            order: given(model.order()),
            innovations: DMatrix::from_element(1, 1, noise.variance * spread * spread),
            model,
            draws,
            notes,
            scales,
            parametric: Some(Parametric {
                structure: format!(
                    "y = {}B(s)/A(s)·e^(−dead_time·s)·u + e/D, B = b0·s^{} + …, A = s^{n} + a1·s^{} + …",
                    if m > 1 { "Σ " } else { "" },
                    nb - 1,
                    n - 1
                ),
                parameters,
                delays,
                noise: noise.d.clone(),
                continuous: Some(nominal),
                guesses: Vec::new(),
            }),
        })
    }

    fn build<'a>(
        &self,
        fit: &'a Weighed,
        free: &'a [bool],
        step: SampleTime,
        units: &[f64],
    ) -> Build<'a> {
        let (omega, delays) = (fit.point.poles.omega, fit.point.delays.as_slice());
        Build { omega, n: self.nf, nb: self.nb, delays, free, step, units: units.to_vec() }
    }

    fn notes(
        &self,
        said: Option<String>,
        fits: &[Weighed],
        free: &[bool],
        used: &Recordings,
    ) -> Vec<String> {
        let mut notes: Vec<String> = said.into_iter().collect();
        let Some(best) = fits.first() else { return notes };
        let weights = weights(fits);
        let step_s = used.sample_time.seconds();
        for (j, input) in used.inputs.iter().enumerate().filter(|(j, _)| free[*j]) {
            let delay = best.point.delays[j];
            let others = fits.iter().zip(&weights).filter(|(_, w)| **w > NOTHING);
            let others = others.map(|(fit, _)| fit.point.delays[j] * step_s);
            let [from, to] = others.fold([f64::INFINITY, 0.0], |[a, b], d| [d.min(a), d.max(b)]);
            if to - from > step_s {
                notes.push(format!(
                    "{}: dead times from {from:.3} to {to:.3} s, with other coefficients, fit about as well; the intervals hold these too",
                    input.name
                ));
            }
            if delay >= self.max_delay as f64 - 0.5 {
                notes.push(format!(
                    "{}: the dead time is the longest that was searched; set a longer max_delay",
                    input.name
                ));
            }
        }
        notes
    }
}

/// The likelihood of each fit, normalised to 1.
fn weights(fits: &[Weighed]) -> Vec<f64> {
    let least = fits.first().map_or(0.0, |f| f.noise.variance).max(f64::MIN_POSITIVE);
    let likelihood = |f: &Weighed| {
        (-0.5 * f.rows as f64 * (f.noise.variance.max(f64::MIN_POSITIVE) / least).ln()).exp()
    };
    let all: Vec<f64> = fits.iter().map(likelihood).collect();
    let total: f64 = all.iter().sum();
    all.iter().map(|w| w / total).collect()
}

/// The first fit's parameters, with standard deviations and intervals of the mixture of all fits, weighted by likelihood.
fn mixed(fits: &[Weighed], all: Vec<Vec<Parameter>>) -> Vec<Parameter> {
    let weights = weights(fits);
    let count = weights.iter().filter(|w| **w > NOTHING).count();
    let mut own = all.first().cloned().unwrap_or_default();
    for (j, p) in own.iter_mut().enumerate().filter(|_| count > 1) {
        let law = |(of, w): (&Vec<Parameter>, &f64)| Some((of[j].value, of[j].std?, *w));
        let laws: Vec<(f64, f64, f64)> = all.iter().zip(&weights).filter_map(law).collect();
        let square = |(v, s, w): &(f64, f64, f64)| w * ((v - p.value).powi(2) + s * s);
        p.std = p.std.map(|_| laws.iter().map(square).sum::<f64>().sqrt());
        let least = if p.name == "dead_time" { 0.0 } else { f64::NEG_INFINITY };
        p.ci95 = p.ci95.map(|_| [0.025, 0.975].map(|share| quantile(&laws, share).max(least)));
    }
    own
}

/// The quantile of a mixture of normal distributions (mean, standard deviation, weight) at this share.
fn quantile(laws: &[(f64, f64, f64)], share: f64) -> f64 {
    let below = |x: f64| {
        let of = |(v, s, w): &(f64, f64, f64)| {
            0.5 * w * erfc((v - x) / (s.max(f64::MIN_POSITIVE) * std::f64::consts::SQRT_2))
        };
        laws.iter().map(of).sum::<f64>()
    };
    let ends = laws.iter().map(|(v, s, _)| [v - 9.0 * s, v + 9.0 * s]);
    let [mut from, mut to] =
        ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [c, d]| [a.min(c), b.max(d)]);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (from + to);
        if below(middle) < share { from = middle } else { to = middle }
    }
    0.5 * (from + to)
}

/// Bisections after which a quantile is exact to rounding.
const HALVINGS: usize = 80;

/// Every parameter in seconds and the channels' units.
fn parameters(
    used: &Recordings,
    build: &Build<'_>,
    values: &[f64],
    covariance: &DMatrix<f64>,
) -> Vec<Parameter> {
    let (n, nb) = (build.n, build.nb);
    let (of_a, of_b) = build.factors();
    let std = |at: usize| covariance[(at, at)].max(0.0).sqrt();
    let step_s = build.step.seconds();
    let one = |name: String, input: Option<String>, unit: Option<&str>, at: usize, factor: f64| {
        let (value, std) = (values[at] * factor, std(at) * factor.abs());
        let (unit, ci95) = (unit.map(str::to_owned), Some(interval95(value, std)));
        Parameter { name, input, value, unit, std: Some(std), ci95 }
    };
    let mut all = Vec::new();
    let mut at = n;
    for ((input, free), delay) in used.inputs.iter().zip(build.free).zip(build.delays) {
        let name = Some(input.name.clone());
        if *free {
            let mut p = one("dead_time".to_owned(), name, Some("s"), at, step_s);
            p.ci95 = p.ci95.map(|ends| ends.map(|e| e.max(0.0)));
            all.push(p);
            at += 1;
        } else {
            let (value, unit) = (delay * step_s, Some("s".to_owned()));
            all.push(Parameter {
                name: "dead_time".to_owned(),
                input: name,
                value,
                unit,
                std: None,
                ci95: None,
            });
        }
    }
    all.extend((0..n).map(|i| one(format!("a{}", i + 1), None, None, i, of_a[i])));
    for (j, input) in used.inputs.iter().enumerate() {
        for (i, of_b) in of_b.iter().enumerate().take(nb) {
            let factor = of_b * build.units[j];
            all.push(one(format!("b{i}"), Some(input.name.clone()), None, at + j * nb + i, factor));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subspace::recordings::Named;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// A plant with its parameters a₁ …, b₀ …, its dead time and sample time.
    struct Plant {
        a: &'static [f64],
        b: &'static [f64],
        delay_s: f64,
        ts: f64,
    }

    /// Rao and Garnier's system of two resonances and a zero in the right half plane; a slow lag; a resonance. All dead times are no whole samples.
    const PLANTS: [Plant; 4] = [
        Plant { a: &[5.0, 408.0, 416.0, 1600.0], b: &[-6400.0, 1600.0], delay_s: 0.0, ts: 0.01 },
        Plant { a: &[5.0, 408.0, 416.0, 1600.0], b: &[-6400.0, 1600.0], delay_s: 0.034, ts: 0.01 },
        Plant { a: &[3.0, 2.0], b: &[4.0], delay_s: 0.337, ts: 0.1 },
        Plant { a: &[0.8, 25.0], b: &[2.0, 30.0], delay_s: 0.113, ts: 0.05 },
    ];

    impl Plant {
        fn record(&self, samples: usize, share: f64, seed: u64) -> Recordings {
            let n = self.a.len();
            let step = SampleTime::new(self.ts).unwrap();
            let poles = Poles { omega: self.ts, a: self.a.to_vec() };
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut level = 1.0;
            let before = 400;
            let u: Vec<f64> = (0..samples + before)
                .map(|k| {
                    if k % 5 == 0 && random.random::<bool>() {
                        level = -level;
                    }
                    level
                })
                .collect();
            let states = poles.states(&u, self.delay_s / self.ts, 40);
            let y: Vec<f64> = (0..u.len() - 40)
                .map(|t| {
                    let of = |(i, b): (usize, &f64)| b * states[n - self.b.len() + i][t];
                    self.b.iter().enumerate().map(of).sum()
                })
                .collect();
            let from = before - 40;
            let power = y[from..].iter().map(|v| v * v).sum::<f64>() / samples as f64;
            let noise = (share * power).sqrt();
            let y: Vec<f64> = y[from..]
                .iter()
                .map(|v| 3.0 + v + noise * random.sample::<f64, _>(StandardNormal))
                .collect();
            let u = &u[before..];
            let named = |name: &str| vec![Named { name: name.to_owned(), unit: None }];
            Recordings {
                sample_time: step,
                inputs: named("u"),
                outputs: named("y"),
                stretches: vec![Stretch {
                    u: DMatrix::from_row_slice(1, samples, u),
                    y: DMatrix::from_row_slice(1, samples, &y),
                }],
            }
        }

        fn truth(&self, name: &str) -> f64 {
            let at = |list: &[f64], first: usize| list[name[1..].parse::<usize>().unwrap() - first];
            match &name[..1] {
                "d" => self.delay_s,
                "a" => at(self.a, 1),
                _ => at(self.b, 0),
            }
        }

        fn method(&self) -> Srivc {
            let (nf, nb) = (self.a.len(), self.b.len());
            Srivc { nf, nb, draws: 0, max_delay: 12, ..Srivc::default() }
        }
    }

    #[test]
    fn numbers_and_dead_times_of_exact_records_are_found_to_many_digits() {
        for (i, plant) in PLANTS.iter().enumerate() {
            let record = plant.record(1000, 0.0, 7);
            let found = plant.method().identify(&record, &HowFar::default()).unwrap();
            for p in &found.parametric.unwrap().parameters {
                let truth = plant.truth(&p.name);
                let apart = (p.value - truth).abs() / truth.abs().max(plant.ts);
                assert!(apart < 1e-5, "{i} {}: {} for {truth}", p.name, p.value);
            }
        }
    }

    /// Sixteen records of each of four plants at 10 dB. Of sixteen 95 % intervals, fewer than twelve hold the truth in one of 1000 cases.
    #[test]
    #[ignore = "nightly: coverage over draws"]
    fn intervals_hold_the_truth() {
        const RECORDS: u64 = 16;
        for (i, plant) in PLANTS.iter().enumerate() {
            let one = |seed: u64| {
                let record = plant.record(500, 0.1, seed);
                let found = plant.method().identify(&record, &HowFar::default()).unwrap();
                found.parametric.unwrap().parameters
            };
            let all: Vec<Vec<Parameter>> = parallel::map(0..RECORDS, one);
            for (k, first) in all[0].iter().enumerate() {
                let truth = plant.truth(&first.name);
                let inside = |p: &Parameter| p.ci95.is_some_and(|[a, b]| a <= truth && truth <= b);
                let held = all.iter().filter(|of| inside(&of[k])).count();
                assert!(held >= 12, "{i} {}: {held} of {RECORDS}", first.name);
            }
        }
    }

    /// Half of the weight each: the ends leave 5 % of one distribution outside, Φ⁻¹(0.95) = 1.6449 of its standard deviations.
    #[test]
    fn intervals_of_two_minima_hold_both() {
        let laws = [(0.0, 1.0, 0.5), (100.0, 2.0, 0.5)];
        assert!((quantile(&laws, 0.025) + 1.644_85).abs() < 1e-4);
        assert!((quantile(&laws, 0.975) - 100.0 - 2.0 * 1.644_85).abs() < 1e-4);
        assert!((quantile(&[(3.0, 0.5, 1.0)], 0.975) - 3.979_98).abs() < 1e-4);
    }
}

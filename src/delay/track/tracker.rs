//! The delay of a machine that runs: sample by sample, in bounded memory.

use nalgebra::DMatrix;

use super::rows::solve;
use crate::delay::DelayError;
use crate::time::SampleTime;

/// How a running machine is watched; all in samples.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOptions {
    /// Longest raw delay; default 35.
    pub max_delay: usize,
    /// Samples that the plant needs to respond without any dead time; default 1.
    pub bias: usize,
    /// Past outputs of the model; default 6.
    pub na: usize,
    /// Input coefficients of the model; default 4.
    pub nb: usize,
    /// Samples from which the response is learnt before anything is told; default 600. It takes longer where the input does not move.
    pub learn: usize,
    /// Samples after which what was learnt counts a third: a plant that changes slowly is followed; default 4000.
    pub forget: usize,
    /// What a change of the delay must gain before it is told, in units of the logarithm of the likelihood; default 20. The lower, the sooner and the oftener wrong.
    pub alarm: f64,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self { max_delay: 35, bias: 1, na: 6, nb: 4, learn: 600, forget: 4000, alarm: 20.0 }
    }
}

/// Why a tracker raises its voice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alarm {
    /// The delay is another one, and has been for some time.
    DelayChanged {
        /// The dead time before, s.
        from_s: f64,
        /// The dead time now, s.
        to_s: f64,
        /// Since when, s from the first sample.
        since_s: f64,
    },
    /// No delay explains what the output does any more: the plant or its noise is another one. The response is learnt anew.
    ResponseChanged {
        /// Since when, s from the first sample.
        since_s: f64,
    },
}

/// What is known after a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracking {
    /// The sample's time, s from the first.
    pub time_s: f64,
    /// The dead time, s; `None` while the response is learnt.
    pub delay_s: Option<f64>,
    /// Its 95 % band, s: wide where the input does not move.
    pub band_s: Option<[f64; 2]>,
    /// What happened at this sample.
    pub alarm: Option<Alarm>,
}

/// Follows the dead time between a command and a response, sample by sample.
///
/// First the response is learnt: the regression y(t) = Σ aᵢ·y(t−i) + Σ bⱼ·u(t−d−j) + c for every delay d out of one running Gram matrix. Then each sample costs one error
/// for each delay, a step of a filter over delays (the band), and one sum for each delay that compares it with the delay believed (Page's CUSUM of the log-likelihood
/// ratio); the shape a, b, c is solved anew from a Gram matrix that forgets. Memory is bounded by the options, whatever the number of samples.
///
/// Wrong when: the delay changes while the response is learnt (the delay told then lies between, and the change is not told); the input repeats within the window; the
/// plant changes in a way that another delay explains better than nothing does. Nothing is told while nothing moves: the band widens.
///
/// Source: E. S. Page (1954), "Continuous inspection schemes", Biometrika 41, 100-115, doi:10.1093/biomet/41.1-2.100; Basseville and Nikiforov (1993), "Detection of
/// Abrupt Changes", section 2.2; L. Ljung (1999), "System Identification", 2nd ed., section 11.2 (forgetting).
///
/// # Example
/// ```
/// use deadtime::delay::track::{Alarm, Tracker, TrackerOptions};
/// use deadtime::rand::{RngExt, SeedableRng};
/// use deadtime::time::SampleTime;
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let mut tracker = Tracker::new(SampleTime::new(0.01)?, TrackerOptions::default())?;
/// let (mut sent, mut y, mut told) = (vec![], 0.0, vec![]);
/// for k in 0..1500 {
///     // A lag whose command comes 4 samples late, and 9 after ten seconds.
///     let late = if k < 1000 { 5 } else { 10 };
///     sent.push(if rng.random() { 1.0 } else { -1.0 });
///     y = 0.8 * y + if k >= late { sent[k - late] } else { 0.0 } + 0.1 * rng.random_range(-1.0..1.0);
///     told.extend(tracker.push(sent[k], Some(y))?.alarm);
/// }
/// let Alarm::DelayChanged { from_s, to_s, since_s } = told[0] else { panic!("{told:?}") };
/// assert!((from_s - 0.04).abs() < 1e-9 && (to_s - 0.09).abs() < 1e-9 && (since_s - 10.0).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Tracker {
    options: TrackerOptions,
    sample_time: SampleTime,
    /// Samples seen.
    count: u64,
    /// u(t), u(t−1), … and y(t−1), y(t−2), …; `None` where it was not measured.
    u: Past<f64>,
    y: Past<Option<f64>>,
    stage: Stage,
}

#[derive(Debug, Clone)]
enum Stage {
    Learning(Learning),
    Following(Box<Following>),
}

/// The last samples, the newest first.
#[derive(Debug, Clone)]
struct Past<T> {
    ring: Vec<T>,
    newest: usize,
    seen: usize,
}

impl<T: Copy> Past<T> {
    fn new(length: usize, of: T) -> Self {
        Self { ring: vec![of; length.max(1)], newest: 0, seen: 0 }
    }

    fn push(&mut self, value: T) {
        self.newest = (self.newest + self.ring.len() - 1) % self.ring.len();
        self.ring[self.newest] = value;
        self.seen = (self.seen + 1).min(self.ring.len());
    }

    fn at(&self, back: usize) -> T {
        self.ring[(self.newest + back) % self.ring.len()]
    }

    fn is_full(&self) -> bool {
        self.seen == self.ring.len()
    }
}

/// The running Gram matrix of [past outputs, inputs at every lag, 1, output].
#[derive(Debug, Clone)]
struct Learning {
    gram: DMatrix<f64>,
    row: Vec<f64>,
    rows: usize,
}

/// What is learnt, and the sums that watch it.
#[derive(Debug, Clone)]
struct Following {
    a: Vec<f64>,
    b: Vec<f64>,
    level: f64,
    /// Variance of the errors at the delay believed.
    variance: f64,
    /// Mean square of the least errors of late.
    near: f64,
    /// Delay believed: the lag of the first coefficient.
    delay: usize,
    /// Coefficients before the first that acts.
    ahead: f64,
    /// Σ bⱼ·u(t−j), the newest first.
    drive: Past<f64>,
    /// Gain of each delay over the one believed, and the samples since it began to grow.
    gains: Vec<(f64, u64)>,
    /// The same of noise that has grown.
    louder: (f64, u64),
    chances: Vec<f64>,
    next: Vec<f64>,
    errors: Vec<f64>,
    /// Of the shape at the delay believed.
    gram: DMatrix<f64>,
    /// What says how far a row lies from all that the shape was learnt from.
    inverse: DMatrix<f64>,
    row: Vec<f64>,
    other: Vec<f64>,
    until_solved: usize,
    /// Samples for which another delay has been so much better that it would be told.
    waited: usize,
    /// Squared errors of each delay since the change has passed, over twice their variance.
    fresh: Vec<f64>,
}

/// A coefficient that stands out by so many standard deviations acts.
const ACTS: f64 = 4.0;
/// Samples between two solutions of the shape.
const SOLVE_EVERY: usize = 50;
/// Samples over which the least errors are averaged.
const NEAR: f64 = 20.0;
/// The most by which the gain of a growing noise may grow at once: an outlier is no change.
const OUTLIER: f64 = 9.0;
/// How many times the noise's variance is suspected to have grown, and what that must gain.
const LOUDER: f64 = 4.0;
const LOUDER_GAIN: f64 = 40.0;
/// Probabilities of a step to a neighbour and of a jump, by sample, of the filter that gives the band.
const STEP: f64 = 1e-4;
const JUMP: f64 = 1e-5;
/// By how much the new delay must be better than any other, in units of the logarithm of the likelihood, and the samples after which it is told in any case.
/// What a row may leave at the new delay, in units of half the noise's variance: one on average, where the delay is the whole truth.
const EXPLAINED: f64 = 1.25;
const CLEAR: f64 = 3.0;
const LONGEST_WAIT: usize = 20;
/// Samples between two trials to end learning.
const TRY_EVERY: usize = 50;

impl Tracker {
    /// A tracker that has seen nothing.
    ///
    /// # Errors
    /// [`DelayError::Option`] for an option out of its range.
    pub fn new(sample_time: SampleTime, options: TrackerOptions) -> Result<Self, DelayError> {
        let wrong = |option, value: usize, allowed| DelayError::Option { method: "tracker", option, value: value as f64, allowed };
        for (option, value) in [("na", options.na), ("nb", options.nb)] {
            if !(1..=50).contains(&value) {
                return Err(wrong(option, value, "from 1 to 50"));
            }
        }
        if !(1..=1000).contains(&options.max_delay) {
            return Err(wrong("max_delay", options.max_delay, "from 1 to 1000"));
        }
        let least = 2 * (options.na + options.nb + options.max_delay + 2);
        if options.learn < least {
            return Err(wrong("learn", options.learn, "at least twice the sum of max_delay, na, nb and 2"));
        }
        if options.forget < options.learn {
            return Err(wrong("forget", options.forget, "at least `learn`"));
        }
        if !(options.alarm.is_finite() && options.alarm > 0.0) {
            return Err(DelayError::Option { method: "tracker", option: "alarm", value: options.alarm, allowed: "finite and above 0" });
        }
        let (u, y) = (Past::new(options.max_delay + options.nb, 0.0), Past::new(options.na, None));
        let stage = Stage::Learning(Learning::new(&options));
        Ok(Self { options, sample_time, count: 0, u, y, stage })
    }

    /// Takes the command given at this sample and the response measured at it; `None` where it was not measured.
    ///
    /// # Errors
    /// [`DelayError::NotFinite`] for a value that is no finite number; the sample is then left out.
    pub fn push(&mut self, u: f64, y: Option<f64>) -> Result<Tracking, DelayError> {
        let bad = |role, value| DelayError::NotFinite {
            role,
            channel: if role == "input" { "u" } else { "y" }.to_owned(),
            sample: usize::try_from(self.count).unwrap_or(usize::MAX),
            value,
        };
        if !u.is_finite() {
            return Err(bad("input", u));
        }
        if let Some(value) = y.filter(|v| !v.is_finite()) {
            return Err(bad("output", value));
        }
        self.u.push(u);
        let mut alarm = None;
        let mut next = None;
        let whole = self.u.is_full() && self.y.is_full();
        match &mut self.stage {
            Stage::Learning(learning) => {
                if whole && let Some(y) = y {
                    learning.add(&self.options, &self.u, &self.y, y);
                }
                if learning.rows >= self.options.learn && learning.rows.is_multiple_of(TRY_EVERY) {
                    next = learning.learnt(&self.options, &self.u).map(|f| Stage::Following(Box::new(f)));
                    // Counted once: without another row there is nothing new to try.
                    learning.rows += usize::from(next.is_none());
                }
            }
            Stage::Following(following) => {
                alarm = following.step(&self.options, &self.u, &self.y, y, self.count);
                if matches!(alarm, Some(Event::Response(_))) {
                    next = Some(Stage::Learning(Learning::new(&self.options)));
                }
            }
        }
        self.y.push(y);
        let alarm = alarm.map(|event| self.told(event));
        if let Some(next) = next {
            self.stage = next;
        }
        let time_s = self.sample_time.to_seconds(self.count as f64);
        self.count += 1;
        let (delay_s, band_s) = match &self.stage {
            Stage::Learning(_) => (None, None),
            Stage::Following(f) => {
                let [mean, low, high] = f.believed();
                (Some(self.seconds(mean + f.ahead)), Some([self.seconds(low + f.ahead), self.seconds(high + f.ahead)]))
            }
        };
        Ok(Tracking { time_s, delay_s, band_s, alarm })
    }

    /// The dead time of a raw delay, s.
    fn seconds(&self, raw: f64) -> f64 {
        self.sample_time.to_seconds((raw - self.options.bias as f64).max(0.0))
    }

    fn told(&self, event: Event) -> Alarm {
        let since = |sample: u64| self.sample_time.to_seconds((sample as f64 - self.options.bias as f64).max(0.0));
        match event {
            Event::Delay { from, to, since: sample } => {
                Alarm::DelayChanged { from_s: self.seconds(from), to_s: self.seconds(to), since_s: since(sample) }
            }
            Event::Response(sample) => Alarm::ResponseChanged { since_s: since(sample) },
        }
    }
}

/// An alarm in samples.
#[derive(Debug, Clone, Copy)]
enum Event {
    Delay { from: f64, to: f64, since: u64 },
    Response(u64),
}

/// Fills `row` with past outputs, the inputs at the lags, 1 and the output; false where an output is missing.
fn fill(row: &mut [f64], u: &Past<f64>, y: &Past<Option<f64>>, now: f64, na: usize, lags: std::ops::Range<usize>) -> bool {
    for (i, value) in row[..na].iter_mut().enumerate() {
        let Some(past) = y.at(i) else { return false };
        *value = past;
    }
    let count = lags.len();
    for (value, lag) in row[na..na + count].iter_mut().zip(lags) {
        *value = u.at(lag);
    }
    row[na + count] = 1.0;
    row[na + count + 1] = now;
    true
}

/// gram ← forget·gram + row·rowᵀ, the upper triangle.
fn accumulate(gram: &mut DMatrix<f64>, row: &[f64], forget: f64) {
    for (c, right) in row.iter().enumerate() {
        let mut column = gram.column_mut(c);
        for (r, left) in row[..=c].iter().enumerate() {
            column[r] = forget * column[r] + left * right;
        }
    }
}

impl Learning {
    fn new(options: &TrackerOptions) -> Self {
        let size = options.na + options.max_delay + options.nb + 2;
        Self { gram: DMatrix::zeros(size, size), row: vec![0.0; size], rows: 0 }
    }

    fn add(&mut self, options: &TrackerOptions, u: &Past<f64>, y: &Past<Option<f64>>, now: f64) {
        if fill(&mut self.row, u, y, now, options.na, 0..options.max_delay + options.nb) {
            accumulate(&mut self.gram, &self.row, 1.0);
            self.rows += 1;
        }
    }

    /// The best delay and its shape, where the input explains enough of the output to tell.
    fn learnt(&self, options: &TrackerOptions, u: &Past<f64>) -> Option<Following> {
        let TrackerOptions { na, nb, max_delay, .. } = *options;
        let last = self.gram.nrows() - 1;
        let mut full = self.gram.clone();
        full.fill_lower_triangle_with_upper_triangle();
        let part = |columns: &[usize]| full.select_columns(columns).select_rows(columns);
        let columns = |d: usize| -> Vec<usize> { (0..na).chain(na + d..na + d + nb).chain([last - 1, last]).collect() };
        let without: Vec<usize> = (0..na).chain([last - 1, last]).collect();
        let (_, alone) = solve(&part(&without))?;
        let fits = (0..=max_delay).filter_map(|d| Some((d, solve(&part(&columns(d)))?)));
        let (delay, (theta, left)) = fits.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let power = full[(last, last)] - full[(last - 1, last)].powi(2) / full[(last - 1, last - 1)].max(1.0);
        let left = left.max(1e-12 * power);
        if left <= 0.0 || 0.5 * self.rows as f64 * (alone / left).ln() < options.alarm {
            return None;
        }
        let gram = part(&columns(delay));
        let variance = left / self.rows as f64;
        let inverse = inverse(&gram)?;
        let ahead = first_acting(&inverse, &theta, na, nb, variance)?;
        let mut following = Following {
            a: theta[..na].to_vec(),
            b: theta[na..na + nb].to_vec(),
            level: theta[na + nb],
            variance,
            near: variance,
            delay,
            ahead,
            drive: Past::new(max_delay + 1, 0.0),
            gains: vec![(0.0, 0); max_delay + 1],
            louder: (0.0, 0),
            chances: vec![0.0; max_delay + 1],
            next: vec![0.0; max_delay + 1],
            errors: vec![0.0; max_delay + 1],
            gram,
            inverse,
            row: vec![0.0; na + nb + 2],
            other: vec![0.0; na + nb + 2],
            until_solved: SOLVE_EVERY,
            waited: 0,
            fresh: vec![0.0; max_delay + 1],
        };
        following.chances[delay] = 1.0;
        following.refill(u);
        Some(following)
    }
}

/// The inverse of the normal equations' matrix, a trace of each diagonal added.
fn inverse(gram: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = gram.nrows() - 1;
    let mut normal = gram.view((0, 0), (size, size)).into_owned();
    for i in 0..size {
        normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + f64::MIN_POSITIVE;
    }
    Some(normal.cholesky()?.inverse())
}

/// xᵀ·P·x.
fn leverage(p: &DMatrix<f64>, x: &[f64]) -> f64 {
    let size = p.nrows();
    (0..size).map(|i| x[i] * p.column(i).iter().zip(x).map(|(p, x)| p * x).sum::<f64>()).sum::<f64>().max(0.0)
}

/// How many coefficients come before the first that stands out of its noise.
fn first_acting(inverse: &DMatrix<f64>, theta: &[f64], na: usize, nb: usize, variance: f64) -> Option<f64> {
    let most = theta[na..na + nb].iter().fold(0.0, |m: f64, b| m.max(b.abs()));
    let acts = |j: &usize| {
        let b = theta[na + j].abs();
        b > 0.1 * most && b > ACTS * (variance * inverse[(na + j, na + j)]).max(0.0).sqrt()
    };
    (0..nb).find(acts).map(|j| j as f64)
}

impl Following {
    /// The drive of the whole window, with the shape as it is now.
    fn refill(&mut self, u: &Past<f64>) {
        for back in (0..self.drive.ring.len()).rev() {
            self.drive.push(self.b.iter().enumerate().map(|(j, b)| b * u.at(back + j)).sum());
        }
    }

    /// Mean and 95 % of the filter; half a sample on either side, as delays between whole ones are none of its states.
    fn believed(&self) -> [f64; 3] {
        let mean = self.chances.iter().enumerate().map(|(d, p)| p * d as f64).sum();
        let end = |share: f64| {
            let mut sum = 0.0;
            let at = self.chances.iter().position(|p| {
                sum += p;
                sum >= share
            });
            at.unwrap_or(self.chances.len() - 1) as f64
        };
        [mean, end(0.025) - 0.5, end(0.975) + 0.5]
    }

    fn step(&mut self, options: &TrackerOptions, u: &Past<f64>, y: &Past<Option<f64>>, now: Option<f64>, count: u64) -> Option<Event> {
        self.drive.push(self.b.iter().enumerate().map(|(j, b)| b * u.at(j)).sum());
        super::smooth::step(&self.chances, STEP, JUMP, &mut self.next);
        std::mem::swap(&mut self.chances, &mut self.next);
        let lags = self.delay..self.delay + options.nb;
        let now = now?;
        if !fill(&mut self.row, u, y, now, options.na, lags) {
            return None;
        }
        let left = now - self.level - self.a.iter().zip(&self.row).map(|(a, y)| a * y).sum::<f64>();
        let mut least = f64::INFINITY;
        for (d, e) in self.errors.iter_mut().enumerate() {
            *e = (left - self.drive.at(d)).powi(2);
            least = least.min(*e);
        }
        self.near += (least - self.near) / NEAR;
        // A row unlike those that were learnt from, such as a frequency that is new, is predicted badly at any delay.
        let nearest = self.errors.iter().position(|e| *e <= least).unwrap_or(self.delay);
        fill(&mut self.other, u, y, now, options.na, nearest..nearest + options.nb);
        let new = 1.0 + leverage(&self.inverse, &self.row).max(leverage(&self.inverse, &self.other));
        let half = 0.5 / (new * self.variance.max(self.near)).max(f64::MIN_POSITIVE);
        // The filter.
        let mut total = 0.0;
        for (p, e) in self.chances.iter_mut().zip(&self.errors) {
            *p *= (half * (least - e)).exp();
            total += *p;
        }
        let scale = total.max(f64::MIN_POSITIVE).recip();
        self.chances.iter_mut().for_each(|p| *p *= scale);
        // The sums.
        let believed = self.errors[self.delay];
        let mut best = (0.0, 0);
        for (d, (gain, since)) in self.gains.iter_mut().enumerate() {
            if *gain <= 0.0 {
                *since = count;
            }
            *gain = (*gain + half * (believed - self.errors[d])).max(0.0);
            if *gain > best.0 {
                best = (*gain, d);
            }
        }
        let ratio = (least / (new * self.variance).max(f64::MIN_POSITIVE)).min(OUTLIER * LOUDER);
        if self.louder.0 <= 0.0 {
            self.louder.1 = count;
        }
        self.louder.0 = (self.louder.0 + 0.5 * (ratio * (1.0 - LOUDER.recip()) - LOUDER.ln())).max(0.0);
        // Around the change some coefficients act at one delay and some at the other: which delay it is shows in the rows behind them, and may take some.
        if best.0 > options.alarm {
            self.waited += 1;
        } else {
            self.waited = 0;
            self.fresh.fill(0.0);
        }
        if self.waited > options.nb {
            let half = 0.5 / (new * self.variance).max(f64::MIN_POSITIVE);
            self.fresh.iter_mut().zip(&self.errors).for_each(|(f, e)| *f += half * e);
            let (to, least) = self.fresh.iter().copied().enumerate().fold((0, f64::INFINITY), |m, f| if f.1 < m.1 { f } else { m });
            let second = self.fresh.iter().enumerate().filter(|(d, _)| *d != to).map(|(_, f)| *f).fold(f64::INFINITY, f64::min);
            if second - least > CLEAR || self.waited > options.nb + LONGEST_WAIT {
                let (from, since) = (self.delay, self.gains[best.1].1);
                let rows = (self.waited - options.nb) as f64;
                self.waited = 0;
                self.fresh.fill(0.0);
                self.gains.iter_mut().for_each(|g| *g = (0.0, count));
                // A delay that leaves much more than noise is none: the plant is moved as it never was while it was learnt.
                if to != from && least < rows * EXPLAINED {
                    self.delay = to;
                    return Some(Event::Delay { from: from as f64 + self.ahead, to: to as f64 + self.ahead, since });
                }
            }
        }
        if self.louder.0 > LOUDER_GAIN {
            return Some(Event::Response(self.louder.1));
        }
        // What is suspected to be another delay teaches nothing about this one.
        if best.0 < 0.5 * options.alarm {
            self.learn(options, u, believed);
        }
        None
    }

    fn learn(&mut self, options: &TrackerOptions, u: &Past<f64>, believed: f64) {
        let forget = 1.0 - (options.forget as f64).recip();
        accumulate(&mut self.gram, &self.row, forget);
        self.variance += (1.0 - forget) * (believed.min(OUTLIER * self.variance) - self.variance);
        self.until_solved -= 1;
        if self.until_solved > 0 {
            return;
        }
        self.until_solved = SOLVE_EVERY;
        let mut gram = self.gram.clone();
        gram.fill_lower_triangle_with_upper_triangle();
        if let (Some((theta, _)), Some(inverse)) = (solve(&gram), inverse(&gram)) {
            self.inverse = inverse;
            let (na, nb) = (options.na, options.nb);
            self.a.copy_from_slice(&theta[..na]);
            self.b.copy_from_slice(&theta[na..na + nb]);
            self.level = theta[na + nb];
            self.refill(u);
        }
    }
}

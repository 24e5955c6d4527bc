//! Following: sums that compare every delay with the current one, and the filter behind the band.

use nalgebra::DMatrix;

use super::options::TrackerOptions;
use super::past::Past;
use super::rows::{Left, Unsure, accumulate, fill, fill_earlier, inverse, leverage};
use crate::track::rows::{ResponseShape, solve};
use crate::track::smooth::step;

/// Samples between two solutions of the shape.
const SOLVE_EVERY: usize = 50;
/// Samples over which the least errors are averaged.
const NEAR: f64 = 20.0;
/// Largest increment of the gain of a growing noise: an outlier is no change.
const OUTLIER: f64 = 9.0;
/// Tested growth factor of the noise's variance, and its required gain.
const GROWN: f64 = 4.0;
const GROWN_GAIN: f64 = 40.0;
/// Probabilities of a step to a neighbour and of a jump, by sample, in the filter behind the band.
const STEP: f64 = 1e-4;
const JUMP: f64 = 1e-5;
/// Limit of half a row's squared error at the new delay, over the noise's variance. The mean is 0.5 for the true delay.
const EXPLAINED: f64 = 1.25;
/// Required log-likelihood margin of the new delay over any other, and the samples after which it is reported without that margin.
const CLEAR: f64 = 3.0;
const LONGEST_WAIT: usize = 20;
/// Rows that are compared again before a change is reported.
const AGAIN: usize = 200;
/// Factor on the covariance of the fitted shape in that second comparison: a low-order model's error exceeds its noise for a new input. Tuned on draws 101 to
/// 110 of the study, which are not in its tables. 10 gives twice as many false alarms under chirps. 100 loses 10 % of the jumps of 2 samples under a prbs.
const UNSURE: f64 = 30.0;
/// The share of an alarm's level that the second comparison must gain; tuned on the same draws.
const CERTAIN: f64 = 0.5;

/// An alarm in samples.
#[derive(Debug, Clone, Copy)]
pub(super) enum Event {
    Delay { from: f64, to: f64, since: u64 },
    Response(u64),
}

/// The fitted shape, and the sums that compare it with alternatives.
#[derive(Debug, Clone)]
pub(super) struct Following {
    shape: ResponseShape,
    /// Variance of the errors at the current delay.
    variance: f64,
    /// Mean square of the recent least errors.
    near: f64,
    /// Current delay: the lag of the first coefficient.
    delay: usize,
    /// Coefficients before the first significant one.
    pub(super) ahead: f64,
    /// Σ bⱼ·u(t−j), the newest first.
    drive: Past<f64>,
    /// Gain of each delay over the current one, and the samples since its growth began.
    gains: Vec<(f64, u64)>,
    /// The same for grown noise.
    grown: (f64, u64),
    chances: Vec<f64>,
    next: Vec<f64>,
    errors: Vec<f64>,
    /// The Gram matrix of the shape at the current delay.
    gram: DMatrix<f64>,
    /// The inverse of the normal equations' matrix: it measures the distance of a row from the fitted data.
    inverse: DMatrix<f64>,
    row: Vec<f64>,
    other: Vec<f64>,
    until_solved: usize,
    /// Samples for which another delay has exceeded the level of an alarm.
    waited: usize,
    /// Recent commands and responses, for the second comparison.
    recent: (Past<f64>, Past<Option<f64>>),
}

/// Further results of the first fit.
pub(super) struct FollowingStart {
    pub(super) variance: f64,
    pub(super) delay: usize,
    pub(super) ahead: f64,
    pub(super) gram: DMatrix<f64>,
    pub(super) inverse: DMatrix<f64>,
}

impl Following {
    /// The result of the first fit, with all sums at zero.
    pub(super) fn new(
        options: &TrackerOptions,
        shape: ResponseShape,
        start: FollowingStart,
        u: &Past<f64>,
    ) -> Self {
        let TrackerOptions { na, nb, max_delay, .. } = *options;
        let FollowingStart { variance, delay, ahead, gram, inverse } = start;
        let mut following = Self {
            shape,
            variance,
            near: variance,
            delay,
            ahead,
            drive: Past::new(max_delay + 1, 0.0),
            gains: vec![(0.0, 0); max_delay + 1],
            grown: (0.0, 0),
            chances: vec![0.0; max_delay + 1],
            next: vec![0.0; max_delay + 1],
            errors: vec![0.0; max_delay + 1],
            gram,
            inverse,
            row: vec![0.0; na + nb + 2],
            other: vec![0.0; na + nb + 2],
            until_solved: SOLVE_EVERY,
            waited: 0,
            recent: (Past::new(AGAIN + max_delay + nb, 0.0), Past::new(AGAIN + na, None)),
        };
        following.chances[delay] = 1.0;
        following.refill(u);
        following
    }

    /// The drive of the whole window with the current shape.
    fn refill(&mut self, u: &Past<f64>) {
        for back in (0..self.drive.length()).rev() {
            self.drive.push(self.shape.b.iter().enumerate().map(|(j, b)| b * u.at(back + j)).sum());
        }
    }

    /// Mean and 95 % of the filter, plus half a sample on either side for fractional delays.
    pub(super) fn band(&self) -> [f64; 3] {
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

    /// Processes one sample.
    pub(super) fn step(
        &mut self,
        options: &TrackerOptions,
        u: &Past<f64>,
        y: &Past<Option<f64>>,
        now: Option<f64>,
        count: u64,
    ) -> Option<Event> {
        self.drive.push(self.shape.b.iter().enumerate().map(|(j, b)| b * u.at(j)).sum());
        step(&self.chances, STEP, JUMP, &mut self.next);
        std::mem::swap(&mut self.chances, &mut self.next);
        self.recent.0.push(u.at(0));
        self.recent.1.push(now);
        let lags = self.delay..self.delay + options.nb;
        let now = now?;
        if !fill(&mut self.row, u, y, now, options.na, lags) {
            return None;
        }
        let left = now
            - self.shape.level
            - self.shape.a.iter().zip(&self.row).map(|(a, y)| a * y).sum::<f64>();
        let mut least = f64::INFINITY;
        for (d, e) in self.errors.iter_mut().enumerate() {
            *e = (left - self.drive.at(d)).powi(2);
            least = least.min(*e);
        }
        self.near += (least - self.near) / NEAR;
        // A row unlike those of the fit, such as a new frequency, has large errors at any delay.
        let nearest = self.errors.iter().position(|e| *e <= least).unwrap_or(self.delay);
        fill(&mut self.other, u, y, now, options.na, nearest..nearest + options.nb);
        let new =
            1.0 + leverage(&self.inverse, &self.row).max(leverage(&self.inverse, &self.other));
        let half = 0.5 / (new * self.variance.max(self.near)).max(f64::MIN_POSITIVE);
        self.reweigh(half, least);
        let best = self.accumulate_gains(half, new, least, count);
        if let Some(event) = self.moved(options, best, count) {
            return Some(event);
        }
        if self.grown.0 > GROWN_GAIN {
            return Some(Event::Response(self.grown.1));
        }
        // Rows suspected of another delay do not update the shape.
        if best.0 < 0.5 * options.alarm {
            self.learn(options, u, self.errors[self.delay]);
        }
        None
    }

    /// The filter's update: the probability of every delay from its error at this sample.
    fn reweigh(&mut self, half: f64, least: f64) {
        let mut total = 0.0;
        for (p, e) in self.chances.iter_mut().zip(&self.errors) {
            *p *= (half * (least - e)).exp();
            total += *p;
        }
        let scale = total.max(f64::MIN_POSITIVE).recip();
        self.chances.iter_mut().for_each(|p| *p *= scale);
    }

    /// The sums against the current delay, one for each other delay and one for grown noise; returns the largest sum and its delay.
    fn accumulate_gains(&mut self, half: f64, new: f64, least: f64, count: u64) -> (f64, usize) {
        let current = self.errors[self.delay];
        let mut best = (0.0, 0);
        for (d, (gain, since)) in self.gains.iter_mut().enumerate() {
            if *gain <= 0.0 {
                *since = count;
            }
            *gain = (*gain + half * (current - self.errors[d])).max(0.0);
            if *gain > best.0 {
                best = (*gain, d);
            }
        }
        let ratio = (least / (new * self.variance).max(f64::MIN_POSITIVE)).min(OUTLIER * GROWN);
        if self.grown.0 <= 0.0 {
            self.grown.1 = count;
        }
        self.grown.0 = (self.grown.0 + 0.5 * (ratio * (1.0 - GROWN.recip()) - GROWN.ln())).max(0.0);
        best
    }

    /// A change of the delay, once the rows behind an alarm determine the new one.
    ///
    /// The sums treat the shape as known. Under a new kind of input motion, the fitted shape has similar errors in successive rows, which the sums attribute to
    /// another delay. A second comparison of all delays therefore integrates out the shape. The likeliest delay is then reported, if its gain over the current
    /// one suffices.
    fn moved(&mut self, options: &TrackerOptions, best: (f64, usize), count: u64) -> Option<Event> {
        if best.0 <= options.alarm {
            self.waited = 0;
            return None;
        }
        self.waited += 1;
        if self.waited <= options.nb {
            return None;
        }
        let since = self.gains[best.1].1;
        // Around the change, coefficients act at either delay: its first rows are uninformative.
        let rows = usize::try_from(count - since).unwrap_or(AGAIN) + 1;
        let rows = rows.saturating_sub(options.nb).clamp(self.waited - options.nb, AGAIN);
        let waits = self.waited <= options.nb + LONGEST_WAIT;
        let seen: Vec<Option<Left>> =
            (0..=options.max_delay).map(|d| self.evidence(options, d, rows)).collect();
        let smallest =
            seen.iter().flatten().map(|e| e.left / e.rows.max(1.0)).fold(f64::INFINITY, f64::min);
        let variance = self.variance.max(smallest).max(f64::MIN_POSITIVE);
        let log = |d: usize| {
            seen[d]
                .as_ref()
                .map_or(f64::NEG_INFINITY, |e| -0.5 * (e.left / variance + e.log_volume))
        };
        let (to, most) = (0..seen.len())
            .map(|d| (d, log(d)))
            .fold((0, f64::NEG_INFINITY), |m, l| if l.1 > m.1 { l } else { m });
        let second =
            (0..seen.len()).filter(|d| *d != to).map(log).fold(f64::NEG_INFINITY, f64::max);
        let certain = most - log(self.delay) > CERTAIN * options.alarm;
        if waits && (most - second <= CLEAR || !certain) {
            return None;
        }
        let from = self.delay;
        self.waited = 0;
        self.gains.iter_mut().for_each(|g| *g = (0.0, count));
        // A delay with a residual far above the noise is rejected: the plant then moves unlike during the fit.
        let left = seen[to]
            .as_ref()
            .map_or(f64::INFINITY, |e| 0.5 * e.left / (self.variance * e.rows.max(1.0)));
        if to == from || !certain || left >= EXPLAINED {
            return None;
        }
        self.delay = to;
        Some(Event::Delay { from: from as f64 + self.ahead, to: to as f64 + self.ahead, since })
    }

    /// The residual of a delay over the last rows with the shape integrated out. The prior of the shape is normal about the fitted one, with a multiple of the
    /// fit's covariance.
    fn evidence(&self, options: &TrackerOptions, delay: usize, rows: usize) -> Option<Left> {
        let theta: Vec<f64> =
            self.shape.a.iter().chain(&self.shape.b).copied().chain([self.shape.level]).collect();
        let mut unsure = Unsure::new(&self.gram, UNSURE);
        let mut row = vec![0.0; theta.len() + 1];
        for back in (0..rows).rev() {
            let Some(now) = self.recent.1.at(back) else { continue };
            let lags = delay..delay + options.nb;
            if fill_earlier(
                &mut row,
                &self.recent.0,
                &self.recent.1,
                [back, back + 1],
                now,
                options.na,
                lags,
            ) {
                let said: f64 = theta.iter().zip(&row).map(|(t, x)| t * x).sum();
                unsure.add(&row[..theta.len()], now - said);
            }
        }
        unsure.evidence()
    }

    fn learn(&mut self, options: &TrackerOptions, u: &Past<f64>, current: f64) {
        let forget = 1.0 - (options.forget as f64).recip();
        accumulate(&mut self.gram, &self.row, forget);
        self.variance += (1.0 - forget) * (current.min(OUTLIER * self.variance) - self.variance);
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
            self.shape.a.copy_from_slice(&theta[..na]);
            self.shape.b.copy_from_slice(&theta[na..na + nb]);
            self.shape.level = theta[na + nb];
            self.refill(u);
        }
    }
}

//! Alternating fits: the dynamics for a fixed delay, and the delay for fixed dynamics.
//!
//! Equation: y(t) = b/(1 + f₁q⁻¹ + f₂q⁻²)·u_τ(t) + e(t), τ̂ = Ts·(n + λ). The delayed input is u_τ(t) = (1 − λ)·u(t − n) + λ·u(t − n − 1), 0 ≤ λ ≤ 1. V = Σ e²
//! is minimised over (n, λ, b) for fixed f₁ and f₂, then over (b, f₁, f₂) for fixed n + λ. The two steps alternate until convergence.

use super::profile::shortened;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, noted, options};
use crate::method::{Condition, Information, Law, Method, Start, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{Initial, OeFit, OutputError, Record, filtered, largest_pole, power};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u, a fraction of a sample included.
///
/// Assumes: a stable plant of two lags (or one, or an oscillation) in open loop. Noise uncorrelated with the input; a record that starts at rest.
/// Resolution and cost: a fraction of a sample where Schwarz's criterion selects one, else whole samples (the raw value is the fraction at the minimum). The
/// input between two delays is interpolated (its held value averaged over the sample), which is exact for whole delays and slow plants. Each iteration takes a
/// filter pass and one product per delay; about ten iterations from each of a few starts.
/// Fails when: the iterations creep because delay and lags are nearly aliases. Each iteration is therefore followed by growing steps in its direction; a search
/// without convergence is `not_converged`. Unstable plants and feedback fail, too. The delay is that of the sampled model. Two lags behind a hold are up to 0.5
/// samples later than their dead time, one lag a few hundredths of a sample earlier. The model does not reveal the number of lags, and the interval covers
/// both.
/// Source: the scheme of class 2b in Björklund (2003), LiU-TEK-LIC-2003:60, p. 14, which lists such methods without preferring one. The source leaves the
/// model, the starts and the stopping rule open; all three are this program's choices.
#[doc = plant_example!(TwoStep, 300, 0.8, 1e-3)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TwoStep {
    /// Largest number of iterations from each start; default 100.
    pub max_turns: usize,
    /// Longest part of a record that is used, samples; default 20 000: each iteration costs a product per sample and delay.
    pub max_samples: usize,
}

impl Default for TwoStep {
    fn default() -> Self {
        Self { max_turns: 100, max_samples: 20_000 }
    }
}

const NAME: &str = "two_step";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Poles(2),
    tolerance: 0.2,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics, Condition::MissingOutputs],
    needs: "open loop, a stable plant of low order that rests at the start",
    blind_to: "what an unstable plant or feedback does; delays that lags of the model can stand for",
    exempt: &[(
        Law::Exact,
        "a direct path together with slow motion is two input coefficients, which it takes for a fraction of a sample",
    )],
    ..method_line!(
        "two_step",
        "two lags for a fixed delay and the delay for fixed lags in turns, to fractions of a sample",
        TwoStep,
        Parametric
    )
};

/// Initial denominators: slow, fast and oscillating.
const STARTS: [[f64; 2]; 4] = [[-0.5, 0.0], [-1.3, 0.4], [-1.85, 0.855], [-1.6, 0.8]];

/// A change of the delay, samples, that ends the iterations.
const STILL: f64 = 1e-6;

/// Minimum number of rows per parameter.
const ROWS: usize = 12;

const MODEL: OutputError = OutputError { nb: 1, nf: 2, initial: Initial::Zero };

impl PairMethod for TwoStep {
    fn check(&self) -> Result<(), DelayError> {
        let at_least_one = |name, value: usize| (name, value as f64, value >= 1, "1 or more");
        let Self { max_turns, max_samples } = *self;
        options(
            NAME,
            [at_least_one("max_turns", max_turns), at_least_one("max_samples", max_samples)],
        )
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        pair.at_least(NAME, pair.max_delay + 1 + ROWS, LengthRemedy::Window)?;
        pair.visible()?;
        let (records, note) = shortened(pair.records, self.max_samples);
        noted(self.rest(&pair.with(&records)), note)
    }
}

/// The end of the iterations.
struct Rest {
    delay: f64,
    fit: OeFit,
    came_to_rest: bool,
}

impl TwoStep {
    /// The delay of the best converged iteration.
    fn rest(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, .. } = pair;
        let mut rests: Vec<Rest> =
            STARTS.iter().filter_map(|start| self.turns(records, max_delay, start)).collect();
        rests.sort_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss));
        let Some(best) = rests.first() else {
            let note = "the input is zero wherever a model could use it";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        if !best.came_to_rest || !best.fit.stopped.converged() {
            let note = format!(
                "delay and lags had not come to rest after {} turns (at {:.2} samples)",
                self.max_turns, best.delay
            );
            return Err(NoDelay::new(Outcome::NotConverged, note));
        }
        let residuals =
            MODEL.residuals(&interpolated(records, best.delay), 0, &best.fit.f).unwrap_or_default();
        let samples = residuals.len() as f64;
        let floor = posterior::ROUNDING * power(records);
        let independent =
            if best.fit.loss <= floor { samples } else { posterior::effective_samples(&residuals) };
        let gain = |loss: f64| {
            independent * (loss.max(floor) / best.fit.loss.max(floor).max(f64::MIN_POSITIVE)).ln()
        };
        let [from, to] = reach(records, best, max_delay, |loss| gain(loss) <= LIKELY);
        let longest = max_delay as f64;
        if to - from > 0.5 * longest.max(2.0) {
            let note = format!(
                "every delay from {from:.1} to {to:.1} samples fits: other lags make up for it"
            );
            return Err(NoDelay::new(Outcome::Flat, note));
        }
        // Other minima are included by their probability.
        let alternatives: Vec<&Rest> =
            rests.iter().filter(|r| gain(r.fit.loss) <= LIKELY).collect();
        // The lags of a plant as fast as its sampling adapt to any fraction. A fraction is accepted only where the data support it.
        let whole = nearest_whole(records, best, max_delay)
            .filter(|w| gain(w.fit.loss) <= independent.ln());
        let delay = whole.map_or(best.delay, |w| w.delay);
        let ends = alternatives.iter().fold([from.min(delay), to.max(delay)], |[from, to], r| {
            [from.min(r.delay), to.max(r.delay)]
        });
        let [from, to] = behind_the_hold(ends, delay, &best.fit.f);
        let std = ((to - from) / 3.92).max(LEAST_STD);
        let apart = alternatives.iter().map(|r| (r.delay - best.delay).abs()).fold(0.0, f64::max);
        let note = (apart > 0.5)
            .then(|| format!("another minimum, {apart:.1} samples away, is nearly as good"));
        let estimate = pair.counted_at(delay, std, [from, to], delay + 0.5 >= longest);
        Ok(estimate.noting(note).with_raw_s(pair.seconds(best.delay)))
    }

    /// Iterations from one start until the delay converges.
    fn turns(&self, records: &[Record], max_delay: usize, start: &[f64]) -> Option<Rest> {
        let dynamics = |delay: f64, f: &[f64]| MODEL.refine(&interpolated(records, delay), 0, f);
        let longest = max_delay as f64;
        let mut delay = best_delay(records, start, max_delay)?;
        let mut fit = dynamics(delay, start)?;
        for _ in 0..self.max_turns {
            let next = best_delay(records, &fit.f, max_delay)?;
            let mut step = next - delay;
            let before = fit.loss;
            (delay, fit) = (next, dynamics(next, &fit.f)?);
            if step.abs() <= STILL {
                return Some(Rest { delay, fit, came_to_rest: true });
            }
            // Iterations creep along a valley: follow it in growing steps while the loss falls. The end is the minimum of the parabola through the last three
            // losses.
            let mut behind = before;
            loop {
                let ahead = (delay + 2.0 * step).clamp(0.0, longest);
                let Some(further) = dynamics(ahead, &fit.f) else { break };
                if ahead != delay && further.loss < fit.loss {
                    behind = fit.loss;
                    step = ahead - delay;
                    (delay, fit) = (ahead, further);
                    continue;
                }
                let (up, down) = (further.loss - fit.loss, behind - fit.loss);
                // Losses at −step, 0 and 2·step.
                let bottom = delay + step * (4.0 * down - up) / (2.0 * (2.0 * down + up));
                if let Some(lower) = Some(bottom)
                    .filter(|b| *b > 0.0 && *b < longest)
                    .and_then(|b| dynamics(b, &fit.f))
                    && lower.loss < fit.loss
                {
                    (delay, fit) = (bottom, lower);
                }
                break;
            }
        }
        Some(Rest { delay, fit, came_to_rest: false })
    }
}

/// The ends of an interval, moved by the effect of the hold on one lag and on two.
fn behind_the_hold([from, to]: [f64; 2], delay: f64, f: &[f64]) -> [f64; 2] {
    let (_, share) = split(delay);
    let (earlier, later) = (two_lags(f), one_lag(f, share) - share);
    [from - earlier, to + later.max(0.0)]
}

/// The share of the second coefficient in the hold's numerator for two lags with these sampled poles and no delay. 0 where no continuous plant has these poles.
fn two_lags(f: &[f64]) -> f64 {
    let &[f1, f2] = f else { return 0.0 };
    let (middle, discriminant) = (-0.5 * f1, 0.25 * f1 * f1 - f2);
    // The step response of 1/((1 + s/a₁)(1 + s/a₂)) after one sample.
    let first = if discriminant > 1e-9 {
        let (p, q) = (middle + discriminant.sqrt(), middle - discriminant.sqrt());
        if q <= 0.0 || p >= 1.0 {
            return 0.0;
        }
        let (a, b) = (-p.ln(), -q.ln());
        1.0 - (b * p - a * q) / (b - a)
    } else {
        let radius = f2.max(0.0).sqrt();
        let angle = (-discriminant).max(0.0).sqrt().atan2(middle);
        if radius <= 0.0 || radius >= 1.0 {
            return 0.0;
        }
        let sine = if angle > 1e-6 { angle.sin() / angle } else { 1.0 };
        1.0 - radius * (angle.cos() - radius.ln() * sine)
    };
    let share = 1.0 - first / (1.0 + f1 + f2);
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

/// The fractional delay at which one lag with the slowest of these poles has this share in its second coefficient.
fn one_lag(f: &[f64], share: f64) -> f64 {
    let p = largest_pole(f);
    if p > 0.0 && p < 1.0 { 1.0 - (p + share * (1.0 - p)).ln() / p.ln() } else { share }
}

/// The better of the two whole delays next to `rest`, with refitted lags.
fn nearest_whole(records: &[Record], rest: &Rest, max_delay: usize) -> Option<Rest> {
    let (n, _) = split(rest.delay);
    let at = |n: usize| {
        let delay = n as f64;
        Some(Rest {
            delay,
            fit: MODEL.refine(&interpolated(records, delay), 0, &rest.fit.f)?,
            came_to_rest: true,
        })
    };
    [n, n + 1]
        .into_iter()
        .filter(|n| *n <= max_delay)
        .filter_map(at)
        .min_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss))
}

/// N·ln(V/V₀) up to which a delay belongs to the 95 % interval: the quantile of χ² with one degree of freedom.
const LIKELY: f64 = 3.841;

/// The ends of the interval around `rest` in which a model with refitted lags is `likely` at its loss.
///
/// A likelihood profile instead of the curvature at the minimum: where a pole and the fraction are aliases, the curvature is that of rounding.
fn reach(
    records: &[Record],
    rest: &Rest,
    max_delay: usize,
    likely: impl Fn(f64) -> bool,
) -> [f64; 2] {
    let longest = max_delay as f64;
    [-1.0, 1.0].map(|side| {
        let clamped = |delay: f64| delay.clamp(0.0, longest);
        let mut f = rest.fit.f.clone();
        let mut holds = |delay: f64| {
            let fit =
                MODEL.refine(&interpolated(records, delay), 0, &f).filter(|fit| likely(fit.loss));
            fit.map(|fit| f = fit.f).is_some()
        };
        let (mut inside, mut step) = (rest.delay, FIRST_STEP);
        let mut outside = loop {
            let next = clamped(inside + side * step);
            if !holds(next) {
                break next;
            }
            if next <= 0.0 || next >= longest {
                return next;
            }
            (inside, step) = (next, (2.0 * step).min(1.0));
        };
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            if holds(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        0.5 * (inside + outside)
    })
}

/// The first step out from a minimum, samples.
const FIRST_STEP: f64 = 0.02;
/// Bisections of the last step: down to some millionths of a sample.
const HALVINGS: usize = 16;

/// Lower bound of the standard deviation, samples: rounding.
const LEAST_STD: f64 = 1e-9;

/// The records with the input `delay` samples later, interpolated within a sample.
fn interpolated<'a>(records: &'a [Record<'_>], delay: f64) -> Vec<Record<'a>> {
    let (n, share) = split(delay);
    let later = |u: &[f64]| -> Vec<f64> {
        let at = |t: usize, lag: usize| if t >= lag { u[t - lag] } else { 0.0 };
        (0..u.len()).map(|t| (1.0 - share) * at(t, n) + share * at(t, n + 1)).collect()
    };
    records
        .iter()
        .map(|r| Record { u: later(&r.u[..r.len()]).into(), ..r.head(usize::MAX) })
        .collect()
}

/// Whole samples, and the fraction.
fn split(delay: f64) -> (usize, f64) {
    let n = delay.max(0.0) as usize;
    let share = (delay - n as f64).clamp(0.0, 1.0);
    (n, share)
}

/// The delay from 0 to `max_delay`, whole or not, of the best model with this denominator and a free gain.
fn best_delay(records: &[Record], f: &[f64], max_delay: usize) -> Option<f64> {
    // Σ x(t − n)·y(t), Σ x(t − n)² and Σ x(t − n)·x(t − n − 1) over the measured samples, x = u/F.
    let delays = max_delay + 1;
    let (mut with_y, mut square, mut next) =
        (vec![0.0; delays], vec![0.0; delays], vec![0.0; delays]);
    for record in records {
        let x = filtered(&record.u[..record.len()], f);
        let there = |t: usize| record.present.as_ref().is_none_or(|p| p[t]);
        for n in 0..delays.min(x.len()) {
            for (t, y) in
                record.y.iter().enumerate().take(x.len()).skip(n).filter(|(t, _)| there(*t))
            {
                let now = x[t - n];
                with_y[n] += now * y;
                square[n] += now * now;
                if t > n {
                    next[n] += now * x[t - n - 1];
                }
            }
        }
    }
    let alone = |n: usize| if square[n] > 0.0 { with_y[n] * with_y[n] / square[n] } else { 0.0 };
    let mut best: Option<(f64, f64)> = None;
    let mut offer = |explained: f64, delay: f64| {
        if explained > best.map_or(0.0, |b| b.0) {
            best = Some((explained, delay));
        }
    };
    for n in 0..delays {
        let whole = n as f64;
        offer(alone(n), whole);
        let Some(&y1) = with_y.get(n + 1) else { break };
        let determinant = square[n] * square[n + 1] - next[n] * next[n];
        let a = (square[n + 1] * with_y[n] - next[n] * y1) / determinant;
        let b = (square[n] * y1 - next[n] * with_y[n]) / determinant;
        if a * b > 0.0 {
            offer(a * with_y[n] + b * y1, whole + b / (a + b));
        }
    }
    best.map(|b| b.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hold_of_two_lags_has_the_known_second_coefficient() {
        use deadtime_model::StateSpace;
        use deadtime_model::c2d::{Conversion, ZeroOrderHold};
        use nalgebra::DMatrix;
        let m = DMatrix::from_row_slice;
        // s² + c₁s + c₀: real, complex, and nearly equal poles.
        for (c1, c0) in [(1.1, 0.3), (0.4, 0.5), (1.0, 0.25)] {
            let plant = StateSpace::continuous(
                m(2, 2, &[-c1, -c0, 1.0, 0.0]),
                m(2, 1, &[1.0, 0.0]),
                m(1, 2, &[0.0, c0]),
                m(1, 1, &[0.0]),
            );
            let sampled = ZeroOrderHold {}
                .c2d(&plant.unwrap(), deadtime_signal::time::SampleTime::new(1.0).unwrap())
                .unwrap();
            let (a, first) = (sampled.a(), (sampled.c() * sampled.b())[(0, 0)]);
            let f = [-a.trace(), a.determinant()];
            assert!((two_lags(&f) - (1.0 - first / (1.0 + f[0] + f[1]))).abs() < 1e-6, "{c1} {c0}");
        }
        assert!(
            (one_lag(&[-0.7, 0.0], 0.0)).abs() < 1e-12
                && (one_lag(&[-0.7, 0.0], 1.0) - 1.0).abs() < 1e-12
        );
    }

    #[test]
    fn the_delay_for_known_dynamics_is_exact_whole_or_not() {
        let u: Vec<f64> = (0..200).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let f = [-1.2, 0.5];
        for delay in [0.0, 3.0, 3.25, 7.9, 12.0] {
            let y = filtered(&interpolated(&[Record::new(u.clone(), u.clone())], delay)[0].u, &f);
            let found = best_delay(&[Record::new(u.clone(), y)], &f, 12).unwrap();
            assert!((found - delay).abs() < 1e-6, "{delay} {found}");
        }
    }
}

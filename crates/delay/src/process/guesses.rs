//! Initial guesses of a lag and a dead time from a step response.

use deadtime_identify::{Guess, Record, fir};
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// Coefficients beyond the longest delay from which a step response is read.
const BEYOND: usize = 100;
/// The last 1/`END` of a step response gives its final value.
const END: usize = 10;

/// Initial guesses of K/(1 + T·s)·e^(−τ·s): from the step itself in a step record, else from the running sum of a least-squares impulse response.
pub(super) fn guesses(records: &[Record], step: SampleTime, max_delay: usize) -> Vec<Guess> {
    let response = match records {
        [one] if one.is_one_step() => of_step(one),
        _ => running_sum(records, max_delay),
    };
    let guesses = response.map(|s| [by_area(&s), by_tangent(&s)]);
    let in_seconds = |g: Guess| Guess {
        lag_s: step.to_seconds(g.lag_s),
        dead_time_s: step.to_seconds(g.dead_time_s),
        ..g
    };
    guesses.into_iter().flatten().flatten().map(in_seconds).collect()
}

/// The running sum of the impulse response.
fn running_sum(records: &[Record], max_delay: usize) -> Option<Vec<f64>> {
    let shortest = records.iter().map(Record::len).min().unwrap_or(0);
    let centred = |x: &[f64]| {
        let mean = stats::mean(x.iter().copied()).unwrap_or(0.0);
        x.iter().map(|v| v - mean).collect::<Vec<f64>>()
    };
    let centred: Vec<Record<'static>> =
        records.iter().map(|r| Record::new(centred(&r.u), centred(&r.y))).collect();
    let heads: Vec<Record<'_>> = centred.iter().map(|r| r.head(20 * BEYOND)).collect();
    let fir = fir(&heads, (max_delay + BEYOND).min(shortest / 4))?;
    let mut sum = 0.0;
    let sums = fir.coefficients.iter().map(|h| {
        sum += h;
        sum
    });
    Some(sums.collect())
}

/// The output after the only input step, relative to its initial level and for a unit step.
fn of_step(record: &Record) -> Option<Vec<f64>> {
    let at = record.u.windows(2).position(|w| w[0] != w[1])? + 1;
    let size = record.u.last()? - record.u.first()?;
    let before = record.y.get(..=at)?;
    let rest = stats::mean(before.iter().copied())?;
    Some(record.y.get(at..)?.iter().map(|y| (y - rest) / size).collect())
}

/// Åström and Hägglund's areas: T_ar = ∫(1 − s/K) dt, A₁ = ∫₀^T_ar s/K dt, T = e·A₁, τ = T_ar − T.
fn by_area(step: &[f64]) -> Option<Guess> {
    let (gain, s) = scaled(step)?;
    let t_ar: f64 = s.windows(2).map(|w| 1.0 - 0.5 * (w[0] + w[1])).sum();
    if !(0.0..s.len() as f64 - 1.0).contains(&t_ar) {
        return None;
    }
    let (whole, part) = (t_ar as usize, t_ar.fract());
    let next = s[whole + 1];
    let a1 = s[..=whole].windows(2).map(|w| 0.5 * (w[0] + w[1])).sum::<f64>()
        + part * (s[whole] + 0.5 * part * (next - s[whole]));
    let lag = std::f64::consts::E * a1;
    (lag > 0.0).then_some(Guess {
        by: "area",
        gain,
        lag_s: lag,
        dead_time_s: (t_ar - lag).max(0.0),
    })
}

/// The steepest tangent meets the start level at τ; the response reaches 63 % at τ + T.
fn by_tangent(step: &[f64]) -> Option<Guess> {
    let (gain, s) = scaled(step)?;
    // Over a few samples, so that noise does not determine the slope.
    let span = (s.len() / 40).max(1);
    let slope = |k: usize| (s[k + span] - s[k]) / span as f64;
    let at = (0..s.len().checked_sub(span + 1)?).max_by(|a, b| slope(*a).total_cmp(&slope(*b)))?;
    let dead = (at as f64 + 0.5 * span as f64 - 0.5 * (s[at] + s[at + span]) / slope(at)).max(0.0);
    let reached = s.iter().position(|v| *v >= 1.0 - (-1.0_f64).exp())?;
    let lag = reached as f64 - dead;
    (slope(at) > 0.0 && lag > 0.0).then_some(Guess {
        by: "tangent",
        gain,
        lag_s: lag,
        dead_time_s: dead,
    })
}

/// A step response over its final value, and that value.
fn scaled(step: &[f64]) -> Option<(f64, Vec<f64>)> {
    let end = step.get(step.len() - (step.len() / END).max(1)..)?;
    let gain = stats::mean(end.iter().copied())?;
    (gain != 0.0 && gain.is_finite() && step.len() > 3)
        .then(|| (gain, step.iter().map(|s| s / gain).collect()))
}

//! An output that leads its command: a filter smoothed it in both directions, or its clock is ahead.
//!
//! Equation: y(t) = Σⱼ≥₋F hⱼ·u(t−j) + v(t), v autoregressive. Four conditions establish a lead. Later inputs (F of them) explain the output beyond the earlier
//! inputs. Earlier outputs predict the input (tested in [`super::feedback`]). The response is smooth up to its first lag. The coefficients before the command
//! are no controller's. A controller's reaction is a single coefficient, or larger than the response and of the opposite sign: −(1−a)/K of a stabilising K.
//! The side lobes of a smoothing filter are smaller than its response.
//!
//! A smoothing filter that runs both ways has a response with no beginning: the dead time behind it is not identifiable without the filter.
//!
//! How it can be wrong: positive feedback, or a controller with a small reaction, aliases with a lead when the reference is smoother than the noise. A filter
//! over fewer than four samples is not detected. Interpolation also makes an output lead by one sample, so resampled logs are not judged.

use deadtime_identify::{Record, Regression};

use super::feedback::{explained, residual};

/// Later inputs that are tested. A filter with a longer lookahead is visible in these, too.
const LATER: usize = 20;
/// Share of the output's innovations that later inputs explain, as for feedback. A mildly nonlinear plant reaches a few hundredths with smooth inputs.
const SHARE: f64 = 0.03;
/// The probability of such a share by chance, as for feedback.
const BY_CHANCE: f64 = 1e-4;
/// A coefficient up to the first lag that deviates from its neighbours' mean by this share of the largest coefficient is a controller's. In a loop the response
/// is a·G − (1−a)/K at each frequency. Here a is the reference's share in the power of the input. The term −1/K does not last. The response of a smoothing
/// filter over four samples or more changes less between samples.
const SINGLE: f64 = 0.25;

/// Share of the power before the command that the neighbours' means retain in a smooth response. Coefficients of noise alone retain 50 %. A copy delayed by a
/// fraction of a sample retains none, because it rings at half the sampling rate.
const LASTING: f64 = 0.5;

/// Whether the output leads the input. The regression contains `lags` past inputs; a filter of order `order` whitens the noise.
pub(super) fn ahead(records: &[Record<'_>], order: usize, lags: usize) -> bool {
    smooth(records, order, lags).unwrap_or(false)
}

/// The same test; `None` where the regressions have no solution.
fn smooth(records: &[Record<'_>], order: usize, lags: usize) -> Option<bool> {
    let least = 2 * LATER + lags + order;
    let whole: Vec<Record<'_>> = records.iter().flat_map(|r| r.stretches(least)).collect();
    let white = whitened(&whole, order, lags)?;
    let (with, without) = advanced(&white);
    let all = Regression { na: 0, lags: lags + LATER };
    let (more, rows) = residual(all, &with)?;
    let (less, _) = residual(Regression { na: 0, lags }, &without)?;
    let (share, chance) = explained(less, more, LATER, rows - lags - LATER);
    if chance >= BY_CHANCE || share <= SHARE {
        return Some(false);
    }
    let solution = all.factor(&with).solve()?;
    let h = |i: usize| solution.coefficients[i];
    let largest = (0..LATER + lags).map(|i| h(i).abs()).fold(0.0, f64::max);
    let sum = |range: std::ops::Range<usize>| range.map(h).sum::<f64>();
    let peak = |range: std::ops::Range<usize>| range.map(|i| h(i).abs()).fold(0.0, f64::max);
    let (before, after) = (0..LATER + 1, LATER + 1..LATER + lags);
    let against = sum(before.clone()) * sum(after.clone()) < 0.0 && peak(before) >= peak(after);
    let bend = |i: usize| (h(i) - 0.5 * (h(i - 1) + h(i + 1))).abs();
    let power = |x: &dyn Fn(usize) -> f64| (1..LATER).map(|i| x(i).powi(2)).sum::<f64>();
    let rings = power(&|i| 0.5 * (h(i - 1) + h(i))) < LASTING * power(&h);
    Some(!rings && !against && (1..=LATER + 1).all(|i| bend(i) <= SINGLE * largest))
}

/// The records with the input [`LATER`] samples ahead, and the same rows without the later inputs.
fn advanced<'a>(records: &'a [Record<'_>]) -> (Vec<Record<'a>>, Vec<Record<'a>>) {
    let part = |u: usize, less: usize| {
        records.iter().map(|r| r.part(u, u.min(LATER), r.len() - less)).collect::<Vec<_>>()
    };
    let with = records.iter().map(|r| r.part(LATER, 0, r.len() - LATER)).collect();
    (with, part(LATER, 2 * LATER))
}

/// The records through the filter that whitens the residual of the two-sided response. The same filter on both channels preserves the response.
///
/// Past outputs are no regressors here: outputs of a two-sided filter already contain the later inputs.
///
/// Source: Cochrane and Orcutt (1949), J. Am. Stat. Assoc. 44(245), 32-61, doi:10.1080/01621459.1949.10483290.
fn whitened(records: &[Record<'_>], order: usize, lags: usize) -> Option<Vec<Record<'static>>> {
    let (with, _) = advanced(records);
    let response = Regression { na: 0, lags: lags + LATER }.factor(&with).solve()?.coefficients;
    let left: Vec<Record<'_>> = with
        .iter()
        .map(|r| {
            let of = |t: usize| -> f64 {
                r.y[t] - response.iter().enumerate().map(|(j, h)| h * r.u[t - j]).sum::<f64>()
            };
            let noise: Vec<f64> = (lags + LATER - 1..r.len()).map(of).collect();
            Record::new(noise.clone(), noise)
        })
        .collect();
    let colour = Regression { na: order, lags: 0 }.factor(&left).solve()?.coefficients;
    let filtered = |x: &[f64]| -> Vec<f64> {
        let past =
            |t: usize| -> f64 { colour.iter().enumerate().map(|(i, a)| a * x[t - 1 - i]).sum() };
        (order..x.len()).map(|t| x[t] - past(t)).collect()
    };
    Some(records.iter().map(|r| Record::new(filtered(&r.u), filtered(&r.y))).collect())
}

#[cfg(test)]
mod tests {
    use crate::feedback::{in_loop, lead};
    use deadtime_identify::Record;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn gauss(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    fn centred(x: Vec<f64>) -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        x.into_iter().map(|v| v - mean).collect()
    }

    /// Steps or a random walk about zero.
    fn command(rng: &mut ChaCha8Rng, samples: usize) -> Vec<f64> {
        let (hold, binary) = (rng.random_range(8..60_usize), rng.random::<bool>());
        let mut u = Vec::with_capacity(samples);
        while u.len() < samples {
            let level = if binary { f64::from(rng.random_range(0..2)) - 0.5 } else { gauss(rng) };
            u.extend(std::iter::repeat_n(level, rng.random_range(1..hold)));
        }
        u.truncate(samples);
        u
    }

    /// A lag behind a dead time of its own, and noise.
    fn open(rng: &mut ChaCha8Rng, u: &[f64]) -> Vec<f64> {
        let (tau, delay) = (rng.random_range(3.0..25.0_f64), rng.random_range(0..14_usize));
        let (pole, noise) = ((-1.0 / tau).exp(), rng.random_range(0.003..0.05));
        let gain = if rng.random() { 1.0 } else { -2.0 };
        let mut x = 0.0;
        (0..u.len())
            .map(|t| {
                x = pole * x + (1.0 - pole) * t.checked_sub(delay + 1).map_or(0.0, |at| u[at]);
                gain * x + noise * gauss(rng)
            })
            .collect()
    }

    fn one_way(y: &[f64], pole: f64) -> Vec<f64> {
        let mut x = y[0];
        let pass = y.iter().map(|v| {
            x = pole * x + (1.0 - pole) * v;
            x
        });
        pass.collect()
    }

    fn turned(y: Vec<f64>) -> Vec<f64> {
        y.into_iter().rev().collect()
    }

    /// A smoothing filter without a beginning, of this many samples.
    fn both_ways(kind: usize, y: &[f64], width: f64) -> Vec<f64> {
        let weights = |weight: &dyn Fn(f64) -> f64, reach: isize| -> Vec<f64> {
            let h: Vec<f64> = (-reach..=reach).map(|k| weight(k as f64)).collect();
            let total: f64 = h.iter().sum();
            let at = |t: isize| y[t.clamp(0, y.len() as isize - 1) as usize];
            (0..y.len() as isize)
                .map(|t| (-reach..=reach).zip(&h).map(|(k, w)| w * at(t + k)).sum::<f64>() / total)
                .collect()
        };
        let pole = (-1.0 / width).exp();
        match kind {
            0 => turned(one_way(&turned(one_way(y, pole)), pole)),
            1 => both_ways(0, &both_ways(0, y, width), width),
            2 => weights(&|k| (-0.5 * (k / width).powi(2)).exp(), (4.0 * width) as isize),
            _ => weights(&|_| 1.0, width as isize),
        }
    }

    #[test]
    fn an_output_that_was_smoothed_both_ways_moves_before_its_command() {
        let mut rng = ChaCha8Rng::seed_from_u64(71);
        let mut found = [0; 4];
        for round in 0..80 {
            let u = command(&mut rng, 2500);
            let y = open(&mut rng, &u);
            let width = rng.random_range(15.0..40.0);
            let y = both_ways(round % 4, &y, width);
            let seen = in_loop(&[Record::new(centred(u), centred(y))], 35, 1);
            found[round % 4] += usize::from(seen.ahead && !seen.closed());
        }
        assert!(found.iter().all(|count| *count >= 18), "{found:?} of 20 each");
    }

    #[test]
    fn an_output_that_was_filtered_forwards_or_bent_does_not() {
        let mut rng = ChaCha8Rng::seed_from_u64(72);
        let mut found = [0; 4];
        for round in 0..160 {
            let u = command(&mut rng, 2500);
            // Smooth inputs raise the share that later inputs explain for a nonlinear plant.
            let u = if round % 8 < 4 { u } else { one_way(&one_way(&u, 0.8), 0.8) };
            let y = open(&mut rng, &u);
            let pole = rng.random_range(0.5..0.95);
            let y = match round % 4 {
                0 => y,
                1 => one_way(&one_way(&y, pole), pole),
                2 => y.iter().map(|v| v + 0.5 * v * v.abs() + 0.3 * v * v).collect(),
                _ => y.iter().map(|v| v.clamp(-0.4, 0.3)).collect(),
            };
            let seen = in_loop(&[Record::new(centred(u), centred(y))], 35, 1);
            found[round % 4] += usize::from(seen.ahead);
        }
        assert!(found.iter().sum::<usize>() <= 1, "{found:?} of 40 each");
    }

    #[test]
    fn a_copy_delayed_by_a_fraction_of_a_sample_does_not() {
        let mut rng = ChaCha8Rng::seed_from_u64(74);
        let found = (0..40).filter(|_| {
            let u: Vec<f64> = (0..2000).map(|_| gauss(&mut rng)).collect();
            let mut y = deadtime_signal::fractional_delay(&u, rng.random_range(1.0..9.0));
            let noise = rng.random_range(0.01..0.3);
            y.iter_mut().for_each(|v| *v += noise * gauss(&mut rng));
            in_loop(&[Record::new(u, y)], 35, 1).ahead
        });
        let found = found.count();
        assert!(found <= 1, "{found} of 40");
    }

    #[test]
    fn of_exchanged_channels_the_output_leads_also_where_it_was_smoothed() {
        let mut rng = ChaCha8Rng::seed_from_u64(75);
        let mut found = [0; 2];
        for round in 0..60 {
            let u = command(&mut rng, 2500);
            let y = open(&mut rng, &u);
            let y = if round % 2 == 0 { y } else { both_ways(0, &y, rng.random_range(3.0..12.0)) };
            let exchanged = [Record::new(centred(y), centred(u))];
            found[round % 2] += usize::from(lead(&exchanged, 35, 1).is_some());
        }
        assert!(found.iter().all(|count| *count >= 25), "{found:?} of 30 each");
        let looped = (0..60).filter(|_| lead(&[looped(&mut rng)], 35, 1).is_some()).count();
        assert!(looped <= 3, "{looped} of 60");
    }

    /// A lag behind a dead time under a proportional or integrating controller, with noise at the output.
    fn looped(rng: &mut ChaCha8Rng) -> Record<'static> {
        let samples = 2500;
        let reference = command(rng, samples);
        let scale = rng.random_range(0.0..1.0);
        let (tau, delay) = (rng.random_range(5.0..25.0_f64), rng.random_range(1..6_usize));
        let pole = (-1.0 / tau).exp();
        let (gain, integral) = (rng.random_range(0.3..1.0), rng.random_range(0.0..0.03));
        let (filter, mut slow) = ([0.0, 0.6][rng.random_range(0..2_usize)], 0.0);
        let (noise, late) = (rng.random_range(0.02..0.2), rng.random_range(0..2_usize));
        let colour = rng.random_range(0.0..0.95);
        let (mut u, mut y) = (Vec::<f64>::new(), Vec::<f64>::new());
        let (mut x, mut sum, mut v) = (0.0, 0.0, 0.0);
        for (t, level) in reference.iter().enumerate() {
            x = pole * x + (1.0 - pole) * t.checked_sub(delay).map_or(0.0, |at| u[at]);
            v = colour * v + noise * gauss(rng);
            y.push(x + v);
            let seen = t.checked_sub(late).map_or(0.0, |at| y[at]);
            slow = filter * slow + (1.0 - filter) * seen;
            let error = scale * level - slow;
            sum += integral * error;
            u.push(gain * error + sum);
        }
        Record::new(centred(u), centred(y))
    }

    #[test]
    fn a_controller_that_moves_the_input_against_the_output_does_not() {
        let mut rng = ChaCha8Rng::seed_from_u64(73);
        let found = (0..80).filter(|_| in_loop(&[looped(&mut rng)], 35, 1).ahead);
        let found = found.count();
        assert!(found <= 1, "{found} of 80");
    }
}

//! The alternative to a time-varying delay: one delay behind a static nonlinearity of the input.

use super::rows::Rows;

/// Bends of the nonlinearity: a dead zone has two.
const BENDS: usize = 2;
/// Grid points for a bend over the range of the input, and then around the best of them.
const PLACES: usize = 15;
const FINER: [f64; 3] = [0.5, 0.15, 0.05];

/// e² of each row under y(t) = Σ aᵢ·y(t−i) + Σₖ Σⱼ bₖⱼ·fₖ(u(t−d−j)) + c + e(t), at the best of the delays given. f₀ is the input, the others are max(u − pₖ,
/// 0). The positions pₖ are chosen one after the other, each with the largest cost reduction: thresholds, dead zones and limits. `None` without a finite value.
pub(super) fn one_delay_with_bends(rows: &Rows, delays: &[usize]) -> Option<Vec<f64>> {
    let u = rows.input();
    let mut values = u.to_vec();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let best_of = |delay: usize| {
        let mut hinges: Vec<Vec<f64>> = Vec::new();
        let mut best = rows.squares_of(delay, &[u])?;
        for _ in 0..BENDS {
            let Some((hinge, squares)) = next_bend(rows, delay, &values, &hinges, sum(&best))
            else {
                break;
            };
            best = squares;
            hinges.push(hinge);
        }
        Some(best)
    };
    delays.iter().filter_map(|d| best_of(*d)).min_by(|a, b| sum(a).total_cmp(&sum(b)))
}

/// The additional bend with the largest reduction of `least`, and its e².
fn next_bend(
    rows: &Rows,
    delay: usize,
    values: &[f64],
    hinges: &[Vec<f64>],
    least: f64,
) -> Option<(Vec<f64>, Vec<f64>)> {
    let u = rows.input();
    let at = |place: f64| {
        let hinge: Vec<f64> = u.iter().map(|u| (u - place).max(0.0)).collect();
        let mut inputs = vec![u];
        inputs.extend(hinges.iter().map(Vec::as_slice));
        inputs.push(&hinge);
        let squares = rows.squares_of(delay, &inputs)?;
        Some((place, hinge, squares))
    };
    let better = |a: &(f64, Vec<f64>, Vec<f64>), b: &(f64, Vec<f64>, Vec<f64>)| {
        sum(&a.2).total_cmp(&sum(&b.2))
    };
    let place = |i: usize| values[i * (values.len() - 1) / (PLACES + 1)];
    let mut best = (1..=PLACES).map(place).filter_map(at).min_by(better)?;
    let step = (values[values.len() - 1] - values[0]) / (PLACES + 1) as f64;
    for share in FINER {
        let near = [-1.0, 1.0].iter().filter_map(|sign| at(best.0 + sign * share * step));
        if let Some(found) = near.min_by(better).filter(|f| sum(&f.2) < sum(&best.2)) {
            best = found;
        }
    }
    (sum(&best.2) < least).then_some((best.1, best.2))
}

fn sum(squares: &[f64]) -> f64 {
    squares.iter().sum()
}

#[cfg(test)]
mod tests {
    use crate::estimator::Search;
    use crate::track::watch::Watch;
    use deadtime_identify::Record;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Ramps and a step, triangles, or a sine.
    fn slow(rng: &mut ChaCha8Rng, kind: u64, samples: usize) -> Vec<f64> {
        let period = rng.random_range(samples / 5..samples / 2) as f64;
        let at = |k: usize| {
            let (share, turn) = (k as f64 / samples as f64, k as f64 / period);
            match kind {
                0 if share < 0.5 => 2.0 * share,
                0 if share < 0.6 => 0.0,
                0 => 1.5,
                1 => 4.0 * ((turn + 0.25).rem_euclid(1.0) - 0.5).abs() - 1.0,
                _ => (std::f64::consts::TAU * turn).sin(),
            }
        };
        (0..samples).map(at).collect()
    }

    /// A mass under viscous friction of this time constant and Coulomb friction, sample by sample, with one delay per sample.
    fn motor(u: &[f64], lag: f64, holds: f64, delay: impl Fn(usize) -> usize) -> Vec<f64> {
        let keeps = (-1.0 / lag).exp();
        let mut speed: f64 = 0.0;
        let step = |k: usize| {
            let before = speed;
            let force = k.checked_sub(delay(k)).map_or(0.0, |at| u[at]);
            let sign = if speed == 0.0 { force.signum() } else { speed.signum() };
            if speed != 0.0 || force.abs() > holds {
                let next = keeps * speed + (1.0 - keeps) * (force - sign * holds);
                speed = if next * sign < 0.0 { 0.0 } else { next };
            }
            before
        };
        (0..u.len()).map(step).collect()
    }

    fn moves(rng: &mut ChaCha8Rng, u: Vec<f64>, mut y: Vec<f64>) -> bool {
        for v in &mut y {
            let e: f64 = StandardNormal.sample(rng);
            *v += 0.02 * e;
        }
        let centred = |x: Vec<f64>| {
            let mean = x.iter().sum::<f64>() / x.len() as f64;
            x.into_iter().map(|v| v - mean).collect::<Vec<f64>>()
        };
        let record = Record::new(centred(u), centred(y));
        !Watch::default().look(&[record], &Search::default()).unwrap().is_steady()
    }

    #[test]
    fn a_threshold_is_no_delay_that_moves() {
        let false_claims: Vec<u64> = (0..30)
            .filter(|seed| {
                let mut rng = ChaCha8Rng::seed_from_u64(*seed);
                let u = slow(&mut rng, seed % 3, 1000);
                let (holds, delay) = (rng.random_range(0.1..0.4), rng.random_range(1..9));
                let y = motor(&u, rng.random_range(3.0..15.0), holds, |_| delay);
                moves(&mut rng, u, y)
            })
            .collect();
        assert!(false_claims.is_empty(), "{false_claims:?}");
    }

    #[test]
    fn a_delay_that_jumps_behind_a_threshold_is_seen() {
        let seen = (0..20).filter(|seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(100 + seed);
            let mut level: f64 = 0.0;
            let mut u = Vec::with_capacity(1000);
            while u.len() < 1000 {
                level = if rng.random::<bool>() { rng.random_range(-2.0..2.0) } else { -level };
                let lasts = rng.random_range(1..8_usize).min(1000 - u.len());
                u.extend(std::iter::repeat_n(level, lasts));
            }
            let (before, by) = (rng.random_range(1..9), rng.random_range(2..8));
            let holds = rng.random_range(0.1..0.4);
            let delay = |k: usize| if k < 500 { before } else { before + by };
            let y = motor(&u, rng.random_range(3.0..15.0), holds, delay);
            moves(&mut rng, u, y)
        });
        let seen = seen.count();
        assert!(seen >= 19, "{seen} of 20");
    }
}

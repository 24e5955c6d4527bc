//! The most probable sequence of lost commands, given what each does to the outputs.
//!
//! A search through the sequences keeps the most probable ones (the M-algorithm; Anderson and Mohan 1984, doi:10.1109/TCOM.1984.1096023).

use nalgebra::DMatrix;

/// One command that differs from the one in force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Decision {
    /// The sample at which it was decided.
    pub(crate) sample: usize,
    pub(crate) lost: bool,
    /// Between the command and the one in force, behind the maps.
    pub(crate) difference: f64,
}

pub(crate) struct Path {
    pub(crate) lost: Vec<bool>,
    /// In the order of time.
    pub(crate) decisions: Vec<Decision>,
}

/// A sequence up to now.
#[derive(Clone)]
struct Survivor {
    cost: f64,
    /// The command in force.
    held: f64,
    /// Deviations of the whitened residual that are still to come, a ring of samples × outputs.
    ahead: Vec<f64>,
    /// The last decision, in the list of all.
    last: Option<usize>,
}

/// The most probable sequence: `e` whitened residuals without losses, `g` the whitened response to one held sample (both samples × outputs).
pub(crate) fn search(
    u: &[f64],
    through: &dyn Fn(f64) -> f64,
    e: &DMatrix<f64>,
    g: &DMatrix<f64>,
    probability: f64,
    kept: usize,
) -> Path {
    let (length, outputs) = g.shape();
    let mut all: Vec<(Option<usize>, usize, Decision)> = Vec::new();
    let mut beam = vec![Survivor {
        cost: 0.0,
        held: u.first().copied().unwrap_or(0.0),
        ahead: vec![0.0; length * outputs],
        last: None,
    }];
    let (pass, lose) = (-2.0 * (1.0 - probability).ln(), -2.0 * probability.ln());
    for (k, &command) in u.iter().enumerate() {
        let slot = k % length;
        let arrived = through(command);
        let mut next: Vec<Survivor> = Vec::with_capacity(2 * beam.len());
        for mut h in beam {
            if h.held == command {
                next.push(h);
                continue;
            }
            let difference = through(h.held) - arrived;
            let mut decide = |lost: bool| {
                all.push((h.last, k, Decision { sample: k, lost, difference }));
                Some(all.len() - 1)
            };
            let (passed, missed) = (decide(false), decide(true));
            let mut other = h.clone();
            (other.cost, other.last) = (h.cost + lose, missed);
            for n in 0..length {
                for i in 0..outputs {
                    other.ahead[((slot + n) % length) * outputs + i] += difference * g[(n, i)];
                }
            }
            next.push(other);
            (h.cost, h.last, h.held) = (h.cost + pass, passed, command);
            next.push(h);
        }
        for h in &mut next {
            for i in 0..outputs {
                let deviation = std::mem::take(&mut h.ahead[slot * outputs + i]);
                // Samples that are missing or outside the span are exactly 0.
                if e[(k, i)] != 0.0 {
                    h.cost += (e[(k, i)] - deviation).powi(2);
                }
            }
        }
        next.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        next.truncate(kept);
        beam = next;
    }
    let mut path = Path { lost: vec![false; u.len()], decisions: Vec::new() };
    let mut at = beam.first().and_then(|h| h.last);
    while let Some((before, k, decision)) = at.and_then(|at| all.get(at)) {
        path.lost[*k] = decision.lost;
        path.decisions.push(*decision);
        at = *before;
    }
    path.decisions.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    const SAMPLES: usize = 12;

    /// The cost of a pattern of losses, every sample of the deviation summed from its definition; and the lost commands of the pattern.
    fn cost(
        pattern: u32,
        u: &[f64],
        e: &DMatrix<f64>,
        g: &DMatrix<f64>,
        probability: f64,
    ) -> (f64, Vec<bool>) {
        let (mut held, mut cost, mut lost) = (u[0], 0.0, vec![false; SAMPLES]);
        let mut deviation = DMatrix::zeros(SAMPLES, e.ncols());
        for k in 0..SAMPLES {
            if u[k] == held {
                continue;
            }
            lost[k] = pattern >> k & 1 == 1;
            cost -= 2.0 * if lost[k] { probability.ln() } else { (1.0 - probability).ln() };
            if lost[k] {
                for n in k..SAMPLES.min(k + g.nrows()) {
                    let mut row = deviation.row_mut(n);
                    row += g.row(n - k) * (held - u[k]);
                }
            } else {
                held = u[k];
            }
        }
        (cost + (e - deviation).norm_squared(), lost)
    }

    /// All 4096 patterns are tried; the search that keeps 32 finds the best of them, on every draw.
    #[test]
    fn the_search_finds_what_trying_every_sequence_finds() {
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        let mut some_lost = 0;
        for _ in 0..20 {
            let u: Vec<f64> = (0..SAMPLES).map(|_| rng.random_range(-1.0..1.0)).collect();
            let g = DMatrix::from_fn(5, 2, |n, i| {
                6.0 * (-0.5 * n as f64).exp() * if i == 0 { 1.0 } else { 0.4 }
            });
            let pattern: u32 =
                (0..SAMPLES).map(|k| u32::from(rng.random::<f64>() < 0.3) << k).sum();
            let noise = DMatrix::from_fn(SAMPLES, 2, |_, _| rng.random_range(-1.0..1.0));
            // The residual of a true pattern is its deviation; the remaining cost is that pattern's.
            let (none, silent) =
                (DMatrix::zeros(SAMPLES, 2), |p: u32, e: &DMatrix<f64>| cost(p, &u, e, &g, 0.3));
            let mut deviation = none.clone();
            for k in 0..SAMPLES {
                for i in 0..2 {
                    let mut unit = none.clone();
                    unit[(k, i)] = 1.0;
                    // |e − d|² at e = 0 and at a unit vector: 1 − 2d + d² − d².
                    deviation[(k, i)] =
                        0.5 * (1.0 + silent(pattern, &none).0 - silent(pattern, &unit).0);
                }
            }
            let e = deviation + noise;
            let best = (0..1_u32 << SAMPLES)
                .map(|p| silent(p, &e))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap();
            let found = search(&u, &|v| v, &e, &g, 0.3, 32);
            assert_eq!(found.lost, best.1);
            some_lost += usize::from(best.1.contains(&true));
        }
        assert!(some_lost > 10, "only {some_lost} draws lose anything");
    }

    /// With one sequence kept the search is greedy, and some draw shows it: the test above can fail.
    #[test]
    fn a_greedy_search_misses_the_best_sequence() {
        let u = [0.0, 1.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 0.5];
        // The first sample of the response carries no information, the later ones decide.
        let g = DMatrix::from_row_slice(3, 1, &[1e-3, 5.0, 5.0]);
        let e = DMatrix::from_fn(SAMPLES, 1, |k, _| if k == 2 || k == 3 { -5.0 } else { 1e-12 });
        let best = (0..1_u32 << SAMPLES)
            .map(|p| cost(p, &u, &e, &g, 0.3))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap();
        assert!(best.1[1]);
        assert_eq!(search(&u, &|v| v, &e, &g, 0.3, 32).lost, best.1);
        assert_ne!(search(&u, &|v| v, &e, &g, 0.3, 1).lost, best.1);
    }
}

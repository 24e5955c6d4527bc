//! The most probable sequence of lost commands, given what each does to the outputs.
//!
//! A search through the sequences keeps the most probable ones (the M-algorithm; Anderson and Mohan 1984, doi:10.1109/TCOM.1984.1096023).

use nalgebra::DMatrix;

/// One command that differs from the one in force.
#[derive(Debug, Clone, Copy)]
pub(in crate::diagnose) struct Decision {
    pub(in crate::diagnose) lost: bool,
    /// Between the command and the one in force, behind the maps.
    pub(in crate::diagnose) difference: f64,
}

pub(in crate::diagnose) struct Path {
    pub(in crate::diagnose) lost: Vec<bool>,
    pub(in crate::diagnose) decisions: Vec<Decision>,
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
pub(in crate::diagnose) fn search(
    u: &[f64],
    through: &dyn Fn(f64) -> f64,
    e: &DMatrix<f64>,
    g: &DMatrix<f64>,
    probability: f64,
    kept: usize,
) -> Path {
    let (length, outputs) = g.shape();
    let mut all: Vec<(Option<usize>, usize, Decision)> = Vec::new();
    let mut beam = vec![Survivor { cost: 0.0, held: u.first().copied().unwrap_or(0.0), ahead: vec![0.0; length * outputs], last: None }];
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
                all.push((h.last, k, Decision { lost, difference }));
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
    path
}

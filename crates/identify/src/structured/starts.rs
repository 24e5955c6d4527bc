//! Starts of the search for dead times: the cost has many minima over a dead time, each with its own neighbourhood.
//!
//! Equation: profile(d) = c(d) − gᵀ (N + Λ)⁻¹ g. c, g, N are the cost, gradient and information at the dead time d, g and N for the other parameters.
//!
//! Assumes: one Gauss-Newton step of the other parameters ranks dead times; full fits from the best few decide. Cost: about 36 evaluations of all windows per
//! dead time and pass, and two fits; two passes where the first finds the lowest minimum.
//! Fails when: the other parameters are so far off that a step from the file's values ranks wrongly. The file's dead time then remains a start.
//! Source: Golub and Pereyra (1973), doi:10.1137/0710036, for the profile over the other parameters.

use nalgebra::{DMatrix, DVector};

use super::problem::{StructuredProblem, Weights};
use crate::error::Result;
use deadtime_signal::fit::Fit;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stop::Stop;

/// Candidates of a grid after its first: as many as the estimators' search window has samples. Where the last is best, the grid doubles once, as that window
/// does.
const CANDIDATES: usize = 35;
/// Grid minima that are fitted in full: the lowest, and one in case a single step of the other parameters misranks.
const MINIMA: usize = 2;
/// Largest number of passes over all dead times; the last one only confirms.
const TURNS: usize = 4;
/// Candidates are spaced by at most the lag at which an input's autocorrelation falls to this value. Any dead time then has a candidate within half that lag.
/// There the correlation of the two delayed inputs is about (1 + ALIKE)/2, on the central peak.
const ALIKE: f64 = 0.5;
/// Progress after the fits from the file's values and from the given ones.
const BEGUN: f64 = 0.1;
/// Costs within this relative distance differ by rounding.
const ROUNDING: f64 = 1e-9;

/// The search for the starts.
pub(super) struct Search<'p, 'a> {
    pub(super) problem: &'p StructuredProblem<'a>,
    pub(super) weights: &'p Weights,
    pub(super) prior: &'p [f64],
    pub(super) stop: &'p Stop,
    pub(super) far: &'p HowFar,
}

impl Search<'_, '_> {
    /// Minima by `fit` from several starts: the file's values first, then each dead time's lowest valleys, with the best other dead times so far.
    ///
    /// Dead times alternate until a pass finds nothing lower: the dead time of a weak input becomes visible only once the others are near.
    pub(super) fn minima(
        &self,
        hint: Option<&[f64]>,
        fit: impl Fn(&[f64], &HowFar) -> Fit,
    ) -> Result<Vec<Fit>> {
        let free = &self.problem.free;
        let delays: Vec<usize> =
            (0..free.len()).filter(|&at| self.problem.delayed(free[at].0).is_some()).collect();
        let mut fits =
            vec![fit(&vec![0.0; self.problem.unknowns()], &self.far.part(0.0, BEGUN / 2.0))];
        if let Some(values) = hint {
            let mut start = fits[0].parameters.clone();
            for &at in &delays {
                start[at] = (values[at] - self.problem.nominal(free[at].0)) / free[at].1;
            }
            fits.push(fit(&start, &self.far.part(BEGUN / 2.0, BEGUN)));
        }
        let mut best = lowest(&fits);
        let share =
            |done: usize| BEGUN + (1.0 - BEGUN) * done as f64 / (TURNS * delays.len()) as f64;
        for turn in 0..TURNS {
            let before = best;
            for (k, &at) in delays.iter().enumerate() {
                let done = turn * delays.len() + k;
                let far = self.far.part(share(done), share(done + 1));
                let found = self.grid(at, &fits[best].parameters, &far.part(0.0, 0.5))?;
                let begin = fits[best].parameters.clone();
                for (k, z) in valleys(found, begin[at]).into_iter().enumerate() {
                    self.stop.check()?;
                    let mut start = begin.clone();
                    start[at] = z;
                    let share = |k: usize| 0.5 + 0.5 * k as f64 / MINIMA as f64;
                    fits.push(fit(&start, &far.part(share(k), share(k + 1))));
                }
                best = lowest(&fits);
            }
            if best == before {
                break;
            }
        }
        Ok(fits)
    }

    /// Candidates of one dead time, ascending, with the profile at each; diverging ones are left out.
    fn grid(&self, at: usize, z: &[f64], far: &HowFar) -> Result<Vec<(f64, f64)>> {
        let (i, size) = self.problem.free[at];
        let (nominal, spacing) = (self.problem.nominal(i), spacing(self.problem, i) as f64);
        let step_s = self.problem.simulator.step_s;
        let longest_s = step_s * self.problem.reach as f64;
        let mut found: Vec<(f64, f64)> = Vec::new();
        let add = |value: f64, found: &mut Vec<(f64, f64)>| -> Result<()> {
            self.stop.check()?;
            let share = found.len() as f64 / (2 * CANDIDATES + 3) as f64;
            far.at(share, &format_args!("candidates of {}", self.problem.quantities[i].name));
            let mut moved = z.to_vec();
            moved[at] = value;
            found.extend(self.profile(&moved).map(|cost| (value, cost)));
            Ok(())
        };
        add(z[at], &mut found)?;
        for part in 0..2 {
            for k in part * (CANDIDATES + 1)..(part + 1) * (CANDIDATES + 1) {
                let delay_s = k as f64 * spacing * step_s;
                let value = (delay_s - nominal) / size;
                if delay_s <= longest_s && value != z[at] {
                    add(value, &mut found)?;
                }
            }
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            let lowest = found.iter().map(|f| f.1).fold(f64::INFINITY, f64::min);
            let rise = found.iter().any(|f| f.1 > lowest * (1.0 + ROUNDING));
            if !rise || found.last().is_none_or(|last| last.1 > lowest) {
                break;
            }
        }
        Ok(found)
    }

    fn profile(&self, z: &[f64]) -> Option<f64> {
        let problem = self.problem;
        let normal = problem.normal(&problem.clusters(z, self.weights)?, z, self.prior);
        let late =
            |at: &usize| *at < problem.free.len() && problem.delayed(problem.free[*at].0).is_some();
        let others: Vec<usize> = (0..z.len()).filter(|at| !late(at)).collect();
        let gradient = DVector::from_fn(others.len(), |a, _| normal.gradient[others[a]]);
        let information = DMatrix::from_fn(others.len(), others.len(), |a, b| {
            normal.information[(others[a], others[b])]
        });
        let fall = information.cholesky().map_or(0.0, |c| gradient.dot(&c.solve(&gradient)));
        Some(normal.cost - fall).filter(|cost| cost.is_finite())
    }
}

/// The longest dead time in the search, in samples: that of the doubled grids, and the file's.
pub(super) fn reach(problem: &StructuredProblem<'_>) -> usize {
    let of = |&(i, _): &(usize, f64)| {
        problem.delayed(i)?;
        let file = (problem.nominal(i) / problem.simulator.step_s).ceil() as usize;
        Some(file.max((2 * CANDIDATES + 1) * spacing(problem, i)))
    };
    problem.free.iter().chain(&problem.own).filter_map(of).max().unwrap_or(0)
}

/// Samples between candidates of a dead time. The spacing is at most half a window, because an edge outside a window has no effect in it.
fn spacing(problem: &StructuredProblem<'_>, i: usize) -> usize {
    let Some(input) = problem.delayed(i) else { return 1 };
    let most = (problem.simulator.horizon / 2).max(1);
    let width = problem.simulator.leaders.len();
    let columns: Vec<Vec<f64>> = problem
        .records
        .iter()
        .map(|r| r.u.iter().skip(input).step_by(width).copied().collect())
        .collect();
    let alike = |lag: usize| {
        let sum = |column: &Vec<f64>| {
            let mean = column.iter().sum::<f64>() / column.len() as f64;
            let own = column.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            let pairs = column.iter().zip(column.iter().skip(lag));
            (pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>(), own)
        };
        let (with, own) = columns.iter().map(sum).fold((0.0, 0.0), |t, s| (t.0 + s.0, t.1 + s.1));
        with > ALIKE * own
    };
    (1..=most).take_while(|&lag| alike(lag)).count().max(1)
}

/// The fit of the lowest cost; the first of those equal to rounding.
pub(super) fn lowest(fits: &[Fit]) -> usize {
    let mut best = 0;
    for (k, fit) in fits.iter().enumerate() {
        if fit.normal.cost < fits[best].normal.cost * (1.0 - ROUNDING) {
            best = k;
        }
    }
    best
}

/// The lowest local minima of a profile, except that at `here`.
fn valleys(profile: Vec<(f64, f64)>, here: f64) -> Vec<f64> {
    let cost = |k: Option<usize>| k.and_then(|k| profile.get(k)).map_or(f64::INFINITY, |f| f.1);
    let valley = |&k: &usize| {
        profile[k].0 != here
            && profile[k].1 < cost(k.checked_sub(1)) * (1.0 - ROUNDING)
            && profile[k].1 <= cost(Some(k + 1))
    };
    let mut found: Vec<(f64, f64)> =
        (0..profile.len()).filter(valley).map(|k| profile[k]).collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found.into_iter().take(MINIMA).map(|(z, _)| z).collect()
}

//! The best model of every delay: starts, searches and neighbours.

use super::model::{OeFit, OutputError};
use super::output_error::count;
use super::problem::OeProblem;
use crate::polynomial::is_stable;
use crate::regression::Record;
use deadtime_signal::fit::{Fit, LevenbergMarquardt, Normal, Stopped, polish, polish_exact};
use deadtime_signal::stop::Stop;
use nalgebra::DVector;

/// The search has returned to a known minimum. The loss exceeds that minimum by less than the tolerance, and the quadratic model predicts no minimum in
/// between.
fn is_same_minimum(f: &[f64], normal: &Normal, known: &Fit) -> bool {
    let excess = NEAR * known.normal.cost;
    let away = DVector::from_iterator(f.len(), f.iter().zip(&known.parameters).map(|(a, b)| a - b));
    normal.cost >= known.normal.cost
        && normal.cost - known.normal.cost <= excess
        && (&known.normal.information * &away).dot(&away) <= 2.0 * excess
}

/// A loss within this relative distance of a minimum, with parameters that explain it, belongs to that minimum.
const NEAR: f64 = 1e-5;

/// Denominators close to most sampled dynamics: real and complex pole pairs from fast to slow.
fn table(nf: usize) -> Vec<Vec<f64>> {
    let real = [0.0, 0.5, 0.8, 0.95, 0.99];
    let mut seeds: Vec<Vec<f64>> = Vec::new();
    if nf == 1 {
        return [-0.5, 0.0, 0.4, 0.7, 0.9, 0.97, 0.995].iter().map(|p| vec![-p]).collect();
    }
    for (i, p) in real.iter().enumerate() {
        for q in &real[i..] {
            seeds.push(vec![-(p + q), p * q]);
        }
    }
    for radius in [0.7, 0.9, 0.98] {
        for angle in [0.1, 0.3, 0.8, 1.6, 2.4_f64] {
            seeds.push(vec![-2.0 * radius * angle.cos(), radius * radius]);
        }
    }
    for f in &mut seeds {
        f.resize(nf, 0.0);
    }
    seeds
}

/// Slope and relative step at a converged minimum.
const TIGHT: f64 = 1e-9;

/// Searches from one more start; keeps the lower minimum.
fn improve(
    problem: &mut OeProblem<'_>,
    search: &LevenbergMarquardt,
    best: &mut Option<Fit>,
    start: &[f64],
) {
    let known = best.as_ref().filter(|fit| fit.stopped.converged());
    // A second start is searched only if it does not lead to the same minimum at once.
    if known.is_some_and(|fit| fit.parameters.iter().zip(start).all(|(a, b)| (a - b).abs() <= 1e-6))
    {
        return;
    }
    let (mut returned, mut lowest) = (false, f64::INFINITY);
    let fit = search.minimise(start, |f| {
        let mut normal = problem.evaluate(f, lowest)?;
        lowest = lowest.min(normal.cost);
        if known.is_some_and(|known| is_same_minimum(f, &normal, known)) {
            returned = true;
            normal.gradient.fill(0.0);
        }
        Some(normal)
    });
    let lower = || best.as_ref().is_none_or(|b| fit.normal.cost < b.normal.cost * (1.0 - 1e-12));
    if !returned && fit.stopped != Stopped::Undefined && lower() {
        *best = Some(fit);
    }
}

/// Exact second derivatives stop at the edge of stability; the product of first ones continues along it.
fn creep(
    problem: &mut OeProblem<'_>,
    search: &LevenbergMarquardt,
    best: &mut [Option<Fit>],
    seeds: &[Vec<Vec<f64>>],
) {
    problem.exact = false;
    for (nk, best) in best.iter_mut().enumerate() {
        problem.nk = nk;
        let Some(stuck) = best.as_ref().filter(|fit| !fit.stopped.converged()) else { continue };
        let starts = std::iter::once(stuck.parameters.clone()).chain(seeds[nk].iter().cloned());
        let crept: Vec<Fit> = starts
            .map(|start| search.minimise(&start, |f| problem.evaluate(f, f64::INFINITY)))
            .collect();
        let defined =
            best.take().into_iter().chain(crept).filter(|f| f.stopped != Stopped::Undefined);
        *best = defined.min_by(|a, b| a.normal.cost.total_cmp(&b.normal.cost));
    }
    problem.exact = true;
}

/// The search only finds the valley. Newton steps find the minimum in it, or a search with tight tolerances where the curvature is unsuitable.
fn settle(
    problem: &mut OeProblem<'_>,
    search: &LevenbergMarquardt,
    mut fit: Fit,
    exact: bool,
) -> Fit {
    if fit.stopped == Stopped::Cost {
        return fit;
    }
    let mut evaluate = |f: &[f64]| problem.evaluate(f, f64::INFINITY);
    if exact {
        fit = polish_exact(fit, &mut evaluate);
    }
    fit = polish(fit, &mut evaluate);
    if fit.normal.slope(&vec![true; fit.parameters.len()]) <= TIGHT {
        return fit;
    }
    let tight =
        LevenbergMarquardt { gradient_tolerance: TIGHT, step_tolerance: TIGHT, ..search.clone() };
    let found = tight.minimise(&fit.parameters, &mut evaluate);
    polish(found, &mut evaluate)
}

impl OutputError {
    /// The best model for nk = 0 … `max_delay`; `None` for a delay whose model cannot be evaluated (for example a zero input).
    ///
    /// All samples are used, also for nk = 0: before a record the input is taken as zero.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> Vec<Option<OeFit>> {
        self.scan_until(records, max_delay, &Stop::default())
    }

    /// [`Self::scan`] with cancellation; a cancelled scan has no valid result.
    #[must_use]
    pub fn scan_until(
        &self,
        records: &[Record],
        max_delay: usize,
        stop: &Stop,
    ) -> Vec<Option<OeFit>> {
        let mut problem = OeProblem::new(*self, records);
        let exact = problem.is_second_order();
        let search = LevenbergMarquardt {
            max_iterations: 60,
            gradient_tolerance: 1e-4,
            step_tolerance: 1e-4,
            cost_floor: 1e-28 * problem.power,
            ..LevenbergMarquardt::default()
        };
        let seeds = self.seeds(&mut problem, max_delay, stop);
        let mut best: Vec<Option<Fit>> = vec![None; max_delay + 1];
        // Twice: a neighbour's result from the downward pass may help the next upward pass.
        for (sweep, upwards) in [true, false, true, false].into_iter().enumerate() {
            for step in 0..=max_delay {
                if stop.is_set() {
                    return vec![None; max_delay + 1];
                }
                let nk = if upwards { step } else { max_delay - step };
                problem.nk = nk;
                if sweep == 0 {
                    seeds[nk]
                        .iter()
                        .for_each(|start| improve(&mut problem, &search, &mut best[nk], start));
                }
                let neighbour = if upwards { nk.checked_sub(1) } else { Some(nk + 1) };
                let start = neighbour.and_then(|n| Some(best.get(n)?.as_ref()?.parameters.clone()));
                if let Some(start) = start {
                    improve(&mut problem, &search, &mut best[nk], &start);
                }
            }
        }
        if exact {
            creep(&mut problem, &search, &mut best, &seeds);
        }
        let samples = count(records);
        let settled = |(nk, fit): (usize, Option<Fit>)| {
            problem.nk = nk;
            let fit = fit.filter(|_| !stop.is_set())?;
            let fit = settle(&mut problem, &search, fit, exact);
            problem.cost(&fit.parameters)?;
            let b = problem.linear.iter().take(self.nb).copied().collect();
            let loss = fit.normal.cost / samples;
            Some(OeFit { loss, b, f: fit.parameters, stopped: fit.stopped })
        };
        best.into_iter().enumerate().map(settled).collect()
    }

    /// Σ e²/samples for each of the given denominators and nk = 0 … `max_delay`, with the best numerator. Accurate to rounding of the output's power; NaN where
    /// undefined.
    #[must_use]
    pub fn losses(
        &self,
        records: &[Record],
        max_delay: usize,
        denominators: &[Vec<f64>],
    ) -> Vec<Vec<f64>> {
        let mut problem = OeProblem::new(*self, records);
        let samples = count(records);
        denominators
            .iter()
            .map(|f| problem.costs(f, max_delay).iter().map(|cost| cost / samples).collect())
            .collect()
    }

    /// Starting denominators for every delay: the best of the table, and Steiglitz-McBride.
    fn seeds(
        &self,
        problem: &mut OeProblem<'_>,
        max_delay: usize,
        stop: &Stop,
    ) -> Vec<Vec<Vec<f64>>> {
        let mut ranked: Vec<Vec<(f64, Vec<f64>)>> = vec![Vec::new(); max_delay + 1];
        for f in table(self.nf) {
            if self.nf == 0 || !is_stable(&f) || stop.is_set() {
                continue;
            }
            for (entries, cost) in ranked.iter_mut().zip(problem.costs(&f, max_delay)) {
                if cost.is_finite() {
                    entries.push((cost, f.clone()));
                }
            }
        }
        (ranked.into_iter().enumerate())
            .map(|(nk, mut entries)| {
                entries.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut seeds: Vec<Vec<f64>> = entries.into_iter().take(3).map(|e| e.1).collect();
                problem.nk = nk;
                seeds.extend(problem.steiglitz_mcbride(3));
                if self.nf == 0 {
                    seeds.push(Vec::new());
                }
                seeds
            })
            .collect()
    }
}

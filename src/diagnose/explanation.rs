//! One or more effects that together explain a gap, and their fit to the training logs.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::lost::Lost;
use super::problem::{Acting, Problem, Whitened};
use crate::effect::{Applied, Scales, Site};
use crate::fit::{LevenbergMarquardt, Normal};

/// Effects with their best parameters so far.
#[derive(Debug, Clone)]
pub(super) struct Explanation {
    /// In the order of the table of effects; in a verdict by what each contributes.
    pub(super) effects: Vec<Applied>,
    /// Parameters that were fitted, as effect and place; limits that do not act are not among them.
    pub(super) free: Vec<(usize, usize)>,
    /// How far the whitened cost falls against no effect.
    pub(super) gain: f64,
    /// Fitted in full, not only screened.
    pub(super) fitted: bool,
    /// The commands that were lost, where an effect loses some.
    pub(super) lost: Option<Lost>,
}

/// Whitened residuals and their derivatives by the free parameters, at one set of parameters.
pub(super) struct Slopes {
    pub(super) residual: Whitened,
    pub(super) columns: Vec<Whitened>,
}

/// The same effect with other values.
pub(super) fn with(applied: &Applied, values: &[f64]) -> Applied {
    Applied { values: values.to_vec(), ..applied.clone() }
}

/// `a − b`, times `scale`.
pub(super) fn difference(a: &Whitened, b: &Whitened, scale: f64) -> Whitened {
    a.iter().zip(b).map(|(a, b)| (a - b) * scale).collect()
}

/// Steps to either side that are tried for one parameter.
const POLISHES: usize = 6;

impl Explanation {
    /// One effect, not fitted yet.
    pub(super) fn screened(applied: Applied, gain: f64) -> Self {
        Self { effects: vec![applied], free: Vec::new(), gain, fitted: false, lost: None }
    }

    /// `effect:channel`, of several joined by " + ", whatever their order.
    pub(super) fn key(&self) -> String {
        let mut keys: Vec<String> = self.effects.iter().map(Applied::key).collect();
        keys.sort();
        keys.join(" + ")
    }

    /// Parameters beyond the first of every effect.
    pub(super) fn further_parameters(&self) -> usize {
        self.free.len().saturating_sub(self.effects.len())
    }

    /// Some effect loses commands.
    pub(super) fn loses_commands(&self) -> bool {
        self.effects.iter().any(|a| a.effect.loses_commands())
    }

    /// Lowers the cost from the present values by bounded Gauss-Newton steps; `None` where the start cannot be simulated.
    pub(super) fn fit(problem: &Problem<'_>, effects: &[Applied], scales: &Scales, nominal_cost: f64, iterations: usize) -> Option<Self> {
        Self::refit(
            problem,
            Self { effects: effects.to_vec(), free: Vec::new(), gain: 0.0, fitted: false, lost: None },
            scales,
            nominal_cost,
            iterations,
        )
    }

    /// The same with commands lost as they are; their probability is no matter of the fit, nor is the step of a lattice, which raw values show.
    pub(super) fn refit(problem: &Problem<'_>, from: Self, scales: &Scales, nominal_cost: f64, iterations: usize) -> Option<Self> {
        let (effects, lost) = (&from.effects, from.lost.as_ref());
        let free: Vec<(usize, usize)> = (effects.iter().enumerate())
            .filter(|(_, a)| (lost.is_none() || !a.effect.loses_commands()) && !a.effect.leaves_residual())
            .flat_map(|(e, a)| (0..a.values.len()).filter(|&i| a.values[i].is_finite()).map(move |i| (e, i)))
            .collect();
        let priced = |cost: f64| nominal_cost - cost - lost.map_or(0.0, |l| l.price);
        if free.is_empty() {
            let there = problem.whitened(&from)?;
            let gain = priced(problem.inner(&there, &there));
            return Some(Self { gain, free, fitted: true, ..from });
        }
        // The search takes numbers below a thousandth for small ones: tiny ones, such as a coefficient in SI units, are passed to it in a unit of their own.
        let unit: Vec<f64> = free.iter().map(|&(e, i)| own_unit(effects[e].values[i])).collect();
        let scaled = |bounds: Vec<f64>| bounds.iter().zip(&unit).map(|(b, u)| b / u).collect::<Vec<f64>>();
        let in_units = |values: &[f64]| values.iter().zip(&unit).map(|(v, u)| v * u).collect::<Vec<f64>>();
        let begin: Vec<f64> = free.iter().zip(&unit).map(|(&(e, i), u)| effects[e].values[i] / u).collect();
        let (lower, upper): (Vec<f64>, Vec<f64>) = free.iter().map(|&(e, i)| range(&effects[e], i, scales)).unzip();
        let search = LevenbergMarquardt {
            max_iterations: iterations,
            gradient_tolerance: 1e-4,
            step_tolerance: 1e-4,
            cost_floor: 0.0,
            lower: scaled(lower),
            upper: scaled(upper),
        };
        let acting = Acting::from(&from);
        let (mut lowest, mut steps) = (f64::INFINITY, vec![None; free.len()]);
        let found = search.minimise(&begin, |values| {
            let there = placed(effects, &free, &in_units(values));
            let acting = acting.with(&there);
            let residual = problem.whitened(acting)?;
            let cost = problem.inner(&residual, &residual);
            // Where the cost does not fall, nobody asks which way it falls.
            if cost >= lowest {
                let k = free.len();
                return Some(Normal { cost, gradient: DVector::zeros(k), information: DMatrix::zeros(k, k) });
            }
            let normal = normal(problem, &slopes(problem, acting, residual, &free, scales, &mut steps)?);
            lowest = cost;
            Some(in_own_units(normal, &unit))
        });
        if found.normal.information.is_empty() {
            return None;
        }
        let mut best = placed(effects, &free, &in_units(&found.parameters));
        let mut kept = free.clone();
        let cost = found.normal.cost;
        // A limit that the training data never reach is infinite.
        for &(e, i) in free.iter().filter(|&&(e, i)| effects[e].parameters[i].nominal.is_infinite()) {
            let mut without = best.clone();
            without[e].values[i] = effects[e].parameters[i].nominal;
            if problem.whitened(acting.with(&without)).is_some_and(|w| (problem.inner(&w, &w) - cost).abs() <= 1e-9 * cost) {
                best = without;
                kept.retain(|&at| at != (e, i));
            }
        }
        for applied in &mut best {
            applied.values = applied.effect.canonical(std::mem::take(&mut applied.values));
        }
        Some(Self { effects: best, free: kept, gain: priced(cost), fitted: true, lost: from.lost })
    }

    /// Tries steps of each parameter beside the fit: a cost with kinks has minima that no gradient leaves.
    pub(super) fn polished(self, problem: &Problem<'_>, scales: &Scales, nominal_cost: f64, iterations: usize) -> Self {
        let mut best = self;
        let cost_of = |e: &Self| problem.whitened(e).map_or(f64::INFINITY, |w| problem.inner(&w, &w));
        let (mut cost, mut moved) = (cost_of(&best), false);
        let before = cost;
        for at in best.free.clone() {
            let (p, value) = (&best.effects[at.0].parameters[at.1], best.effects[at.0].values[at.1]);
            let mut step = match (p.unit.as_str(), p.nominal.is_finite()) {
                ("s", _) => 0.5 * scales.sample_time_s,
                (_, true) => 0.1 * (value - p.nominal).abs(),
                (_, false) => 0.1 * value.abs(),
            };
            let (lower, upper) = range(&best.effects[at.0], at.1, scales);
            for _ in 0..POLISHES {
                let try_at = |value: f64| {
                    let mut there = best.clone();
                    there.effects[at.0].values[at.1] = value.clamp(lower, upper);
                    (cost_of(&there), there)
                };
                let here = best.effects[at.0].values[at.1];
                let (lowest, there) = [here + step, here - step]
                    .map(try_at)
                    .into_iter()
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .unwrap_or((f64::INFINITY, best.clone()));
                if lowest < cost {
                    (cost, best, moved) = (lowest, there, true);
                } else {
                    step *= 0.4;
                }
            }
        }
        // What gains next to nothing is no other minimum.
        if moved && cost < before * (1.0 - 1e-6) {
            Self::refit(problem, best.clone(), scales, nominal_cost, iterations).unwrap_or(best)
        } else {
            best
        }
    }

    /// One of its effects, with the values that it has beside the others.
    pub(super) fn only(&self, place: usize) -> Self {
        let effects = self.effects.get(place).cloned().into_iter().collect();
        let free = self.free.iter().filter(|f| f.0 == place).map(|f| (0, f.1)).collect();
        Self { effects, free, lost: None, ..self.clone() }
    }

    /// Its effects by what each explains, most first.
    pub(super) fn ordered(mut self, explains: impl Fn(&Applied) -> f64) -> Self {
        let mut order: Vec<usize> = (0..self.effects.len()).collect();
        order.sort_by(|&a, &b| explains(&self.effects[b]).total_cmp(&explains(&self.effects[a])));
        let effects = order.iter().map(|&e| self.effects[e].clone()).collect();
        for free in &mut self.free {
            free.0 = order.iter().position(|&e| e == free.0).unwrap_or(free.0);
        }
        self.effects = effects;
        self
    }

    /// A limit that was left out is tried at several places; the explanation with it where that explains more than chance.
    pub(super) fn with_missing_limits(self, problem: &Problem<'_>, scales: &Scales, nominal_cost: f64, iterations: usize) -> Self {
        let mut best = self;
        let open: Vec<(usize, usize)> = (best.effects.iter().enumerate())
            .flat_map(|(e, a)| (0..a.values.len()).filter(|&i| a.values[i].is_infinite()).map(move |i| (e, i)))
            .collect();
        for (e, i) in open {
            // Between the other limit and where the signal ends: all starts of the effect know sensible places.
            let applied = &best.effects[e];
            let starts = problem.first_guesses(applied, scales);
            let mut tried: Vec<(f64, Vec<Applied>)> = Vec::new();
            for place in starts.iter().filter_map(|s| s.get(i)).filter(|v| v.is_finite()) {
                let mut moved = best.effects.clone();
                moved[e].values[i] = *place;
                tried.extend(problem.whitened(Acting::from(&best).with(&moved)).map(|w| (problem.inner(&w, &w), moved)));
            }
            let Some((_, effects)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let from = Self { effects, ..best.clone() };
            if let Some(better) = Self::refit(problem, from, scales, nominal_cost, iterations)
                && better.gain > best.gain + 2.0 * problem.weight().max(2.0).ln()
            {
                best = better;
            }
        }
        best
    }

    /// The gain under the problem's present noise, parameters as they are.
    pub(super) fn rescore(&mut self, problem: &Problem<'_>, nominal_cost: f64) {
        if self.gain == f64::NEG_INFINITY {
            return;
        }
        let price = self.lost.as_ref().map_or(0.0, |l| l.price);
        self.gain = problem.whitened(&*self).map_or(f64::NEG_INFINITY, |e| nominal_cost - problem.inner(&e, &e) - price);
    }

    /// Residual and derivatives at the present values.
    pub(super) fn slopes(&self, problem: &Problem<'_>, scales: &Scales) -> Option<Slopes> {
        let acting = Acting::from(self);
        slopes(problem, acting, problem.whitened(acting)?, &self.free, scales, &mut vec![None; self.free.len()])
    }

    /// A parameter stands at the edge of what was searched.
    pub(super) fn at_bound(&self, (e, i): (usize, usize), scales: &Scales) -> bool {
        let (lower, upper) = range(&self.effects[e], i, scales);
        let value = self.effects[e].values[i];
        value <= lower || value >= upper
    }
}

fn placed(effects: &[Applied], free: &[(usize, usize)], values: &[f64]) -> Vec<Applied> {
    let mut all = effects.to_vec();
    for (&(e, i), v) in free.iter().zip(values) {
        all[e].values[i] = *v;
    }
    all
}

/// `steps`: those that fitted a black box's resolution the last time.
fn slopes(
    problem: &Problem<'_>,
    acting: Acting<'_>,
    residual: Whitened,
    free: &[(usize, usize)],
    scales: &Scales,
    steps: &mut [Option<f64>],
) -> Option<Slopes> {
    let effects = acting.effects;
    let column_of = |(e, i): (usize, usize), h: f64| {
        let mut moved = effects.to_vec();
        moved[e].values[i] += h;
        Some(difference(&problem.whitened(acting.with(&moved))?, &residual, 1.0 / h))
    };
    let plain = |(e, i): (usize, usize)| column_of((e, i), step(&effects[e], i, scales));
    if !effects.iter().any(|a| problem.calls(a)) {
        let columns = free.par_iter().map(|&at| plain(at)).collect::<Option<Vec<_>>>()?;
        return Some(Slopes { residual, columns });
    }
    let mut columns = Vec::with_capacity(free.len());
    for (&(e, i), known) in free.iter().zip(steps) {
        if !problem.calls(&effects[e]) {
            columns.push(plain((e, i))?);
            continue;
        }
        let column = |h: f64| column_of((e, i), h);
        let p = &effects[e].parameters[i];
        let inside = |h: f64| if effects[e].values[i] + h > p.upper { -h } else { h };
        let mut h = known.unwrap_or_else(|| called_step(&effects[e], i, scales));
        let mut found = column(inside(h))?;
        // As large as the noise lets it show, and far above rounding.
        let wanted = SHOWS.max(ABOVE_ROUNDING * problem.rounding());
        let moved = h * problem.inner(&found, &found).max(0.0).sqrt();
        let factor = if moved > 0.0 { (wanted / moved).clamp(1e-3, 10.0) } else { 10.0 };
        if !(0.1..=4.0).contains(&factor) {
            h *= factor;
            found = column(inside(h))?;
        }
        *known = Some(h);
        columns.push(found);
    }
    Some(Slopes { residual, columns })
}

/// The length by which a step moves a black box's whitened residual: less than a standard deviation of the parameter.
const SHOWS: f64 = 0.3;
/// The same in units of what rounding does.
const ABOVE_ROUNDING: f64 = 30.0;

/// A first step for a black box's numerical derivative.
fn called_step(applied: &Applied, at: usize, scales: &Scales) -> f64 {
    let (p, value) = (&applied.parameters[at], applied.values[at]);
    let size = if p.nominal.is_finite() { (value - p.nominal).abs() } else { value.abs() };
    let least = if p.unit == "s" { 0.02 * scales.sample_time_s } else { 1e-3 * value.abs() };
    let step = (1e-2 * size).max(least);
    if step > 0.0 { step } else { 1e-9 }
}

/// A power of two near a tiny number; 1 for any other.
fn own_unit(value: f64) -> f64 {
    if value != 0.0 && value.abs() < 1e-6 { value.abs().log2().round().exp2() } else { 1.0 }
}

/// The same problem with parameters counted in other units.
fn in_own_units(mut normal: Normal, unit: &[f64]) -> Normal {
    for (i, u) in unit.iter().enumerate() {
        normal.gradient[i] *= u;
        for (j, v) in unit.iter().enumerate() {
            normal.information[(i, j)] *= u * v;
        }
    }
    normal
}

fn normal(problem: &Problem<'_>, slopes: &Slopes) -> Normal {
    let (e, columns) = (&slopes.residual, &slopes.columns);
    let all: Vec<&Whitened> = columns.iter().chain([e]).collect();
    let k = columns.len();
    let products = problem.inner_of_all(&all);
    Normal {
        cost: products[(k, k)],
        gradient: products.view((0, k), (k, 1)).column(0).into_owned(),
        information: products.view((0, 0), (k, k)).into_owned(),
    }
}

/// The step for a numerical derivative.
fn step(applied: &Applied, at: usize, scales: &Scales) -> f64 {
    let (p, value) = (&applied.parameters[at], applied.values[at]);
    let size = if p.nominal.is_finite() { (value - p.nominal).abs() } else { value.abs() };
    let least = match p.unit.as_str() {
        "s" => 0.01 * scales.sample_time_s,
        _ => 1e-6 * value.abs(),
    };
    let step = (1e-4 * size).max(1e-4 * least).max(1e-12);
    if value + step > p.upper { -step } else { step }
}

/// The bounds of a parameter in a search: its own, and what these logs can show at all.
fn range(applied: &Applied, at: usize, scales: &Scales) -> (f64, f64) {
    let p = &applied.parameters[at];
    let (lower, upper) = match (p.name, p.unit.as_str()) {
        // From a fifth of a period in the whole log to near the Nyquist frequency.
        ("frequency", _) => (0.2 / scales.duration_s, 0.45 / scales.sample_time_s),
        ("damping", _) => (1e-3, 2.0),
        ("delay", _) => (0.0, scales.longest_delay_s),
        ("time_constant", _) => (0.0, 0.25 * scales.duration_s),
        ("offset", "s") if applied.effect.site() == Site::Clock => (-scales.longest_delay_s, scales.longest_delay_s),
        _ => (p.lower, p.upper),
    };
    (lower.max(p.lower), upper.min(p.upper))
}

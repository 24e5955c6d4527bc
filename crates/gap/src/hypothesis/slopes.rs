//! Derivatives of whitened residuals by parameters.

use nalgebra::DMatrix;

use super::direction::difference;
use super::effects::Hypothesis;
use super::shared_time::put;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::Scales;
use deadtime_signal::parallel;

/// Whitened residuals and their derivatives by the free parameters, at one set of parameters.
pub(crate) struct Slopes {
    pub(crate) residual: Whitened,
    pub(crate) columns: Vec<Whitened>,
}

impl Hypothesis {
    /// Residual and derivatives at the present values.
    pub(crate) fn slopes(&self, likelihood: &Likelihood<'_>, scales: &Scales) -> Option<Slopes> {
        let active = ActiveEffects::from(self);
        slopes(
            likelihood,
            active,
            likelihood.whitened(active)?,
            &self.free,
            scales,
            &mut vec![None; self.free.len()],
        )
    }
}

/// `steps`: those that fitted a black box's resolution the last time.
pub(crate) fn slopes(
    likelihood: &Likelihood<'_>,
    active: ActiveEffects<'_>,
    residual: Whitened,
    free: &[(usize, usize)],
    scales: &Scales,
    steps: &mut [Option<f64>],
) -> Option<Slopes> {
    let effects = active.effects;
    let column_of = |(e, i): (usize, usize), h: f64| {
        let mut moved = effects.to_vec();
        put(&mut moved, (e, i), effects[e].values[i] + h);
        Some(difference(&likelihood.whitened(active.with(&moved))?, &residual, 1.0 / h))
    };
    let central = |(e, i): (usize, usize)| {
        let (p, value) = (&effects[e].parameters[i], effects[e].values[i]);
        let h = p.central_step(value, scales).filter(|_| likelihood.has_central_differences())?;
        let side = |h: f64| {
            let mut moved = effects.to_vec();
            put(&mut moved, (e, i), value + h);
            likelihood.whitened(active.with(&moved))
        };
        Some(difference(&side(h)?, &side(-h)?, 0.5 / h))
    };
    let plain = |(e, i): (usize, usize)| {
        let h = effects[e].parameters[i].derivative_step(effects[e].values[i], scales);
        central((e, i)).or_else(|| column_of((e, i), h))
    };
    if !effects.iter().any(|a| likelihood.calls(a)) {
        let columns = parallel::try_map(free, |&at| plain(at))?;
        return Some(Slopes { residual, columns });
    }
    let mut columns = Vec::with_capacity(free.len());
    for (&(e, i), known) in free.iter().zip(steps) {
        if !likelihood.calls(&effects[e]) {
            columns.push(plain((e, i))?);
            continue;
        }
        let column = |h: f64| column_of((e, i), h);
        let p = &effects[e].parameters[i];
        let inside = |h: f64| if effects[e].values[i] + h > p.upper { -h } else { h };
        let mut h = known.unwrap_or_else(|| p.rough_derivative_step(effects[e].values[i], scales));
        let mut found = column(inside(h))?;
        // As large as the noise lets it show, and far above rounding.
        let wanted = SHOWS.max(ABOVE_ROUNDING * likelihood.rounding());
        let moved = h * likelihood.inner(&found, &found).max(0.0).sqrt();
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

/// The information matrix of parameters whose derivatives these are; `prior`: as [`Hypothesis::prior`].
pub(crate) fn information(
    likelihood: &Likelihood<'_>,
    columns: &[Whitened],
    prior: &[(f64, f64)],
) -> DMatrix<f64> {
    let all: Vec<&Whitened> = columns.iter().collect();
    let mut information = likelihood.inner_of_all(&all);
    for (at, (precision, _)) in prior.iter().enumerate() {
        information[(at, at)] += precision;
    }
    information
}

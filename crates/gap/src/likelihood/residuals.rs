//! Residuals of any active effects, from the posterior initial state of each record.

use nalgebra::DMatrix;

use super::active_effects::ActiveEffects;
use super::gaussian::Likelihood;
use crate::input::record::LogRecord;
use deadtime_signal::parallel;

/// Residuals from the posterior initial state of each record, by the same rule for every hypothesis. A held-out log uses its own samples, any other log the
/// training span.
pub(crate) fn residuals<'e>(
    likelihood: &Likelihood<'_>,
    active: impl Into<ActiveEffects<'e>>,
) -> Option<Vec<DMatrix<f64>>> {
    let active = active.into();
    parallel::try_map(0..likelihood.records.len(), |at| {
        let record = &likelihood.records[at];
        let span = record.estimated_from()?;
        Some(likelihood.residual(at, &likelihood.predict_from_posterior(at, active, span)?))
    })
}

/// The same, those of another model for a record that cannot be simulated.
pub(crate) fn residuals_or<'e>(
    likelihood: &Likelihood<'_>,
    active: impl Into<ActiveEffects<'e>>,
    otherwise: &[DMatrix<f64>],
) -> Vec<DMatrix<f64>> {
    let active = active.into();
    let one = |(at, (record, otherwise)): (usize, (&LogRecord, &DMatrix<f64>))| {
        let predicted = record
            .estimated_from()
            .and_then(|span| likelihood.predict_from_posterior(at, active, span));
        predicted.map_or_else(|| otherwise.clone(), |y| likelihood.residual(at, &y))
    };
    likelihood.records.iter().zip(otherwise).enumerate().map(one).collect()
}

/// Residuals of runs from the best-fitting initial state of each record: the error that a user of the model gets. A held-out log uses its own samples, any
/// other log the training span.
pub(crate) fn simulated<'e>(
    likelihood: &Likelihood<'_>,
    active: impl Into<ActiveEffects<'e>>,
) -> Option<Vec<DMatrix<f64>>> {
    let active = active.into();
    parallel::try_map(0..likelihood.records.len(), |at| {
        let record = &likelihood.records[at];
        let span = record.estimated_from()?;
        Some(likelihood.residual(at, &likelihood.predict_from_best_start(at, active, span)?))
    })
}

/// Residuals of the training spans alone from their posterior starts; of anything else nothing that means something.
pub(crate) fn trained<'e>(
    likelihood: &Likelihood<'_>,
    active: impl Into<ActiveEffects<'e>>,
) -> Option<Vec<DMatrix<f64>>> {
    let active = active.into();
    (0..likelihood.records.len())
        .map(|at| {
            let record = &likelihood.records[at];
            if record.train.is_none() {
                return Some(DMatrix::zeros(record.time_s.len(), record.measured.len()));
            }
            Some(likelihood.residual(at, &likelihood.predict_trained_from_posterior(at, active)?))
        })
        .collect()
}

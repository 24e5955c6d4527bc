//! The held-out error as a function of the prediction horizon. A correction may reduce the error far ahead and raise it at the next sample, or the reverse.

use std::num::NonZeroUsize;

use nalgebra::DMatrix;

use super::held_out::HeldOut;
use crate::format::diagnosis::HorizonError;
use crate::likelihood::errors::overall;
use crate::likelihood::gaussian::Likelihood;

/// The nrmse of the nominal and of the written model, for samples a given number of steps after the start of their prediction. The first prediction of a record
/// is left out: it begins with the model's own initial state. Empty where predictions have no horizon.
pub(super) fn horizon_errors(
    likelihood: &Likelihood<'_>,
    held: &HeldOut,
    [before, after]: [&[DMatrix<f64>]; 2],
) -> Vec<HorizonError> {
    let Some(horizon) = likelihood.predictor.horizon else { return Vec::new() };
    let deviations = held.errors(likelihood.records, before);
    // The variance of every measured output; 0 where it is constant.
    let variances: Vec<f64> = deviations
        .relative(&vec![1.0; deviations.deviations.len()])
        .iter()
        .map(|v| v.map_or(0.0, |v| v.powi(-2)))
        .collect();
    let nrmse = |residuals: &[DMatrix<f64>], steps: usize| {
        let of_output = |i: usize| {
            let samples = likelihood.records.iter().zip(residuals).enumerate().flat_map(
                |(at, (record, residual))| {
                    let span = held.span(at);
                    let so_far =
                        move |k: &usize| *k > horizon.get() && (k - 1) % horizon.get() + 1 == steps;
                    let measured = move |k: usize| {
                        record.measured_in(span, i, k).map(|_| residual[(k, i)].powi(2))
                    };
                    (0..record.time_s.len()).filter(so_far).filter_map(measured)
                },
            );
            let (sum, count) =
                samples.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
            (count > 0.0 && variances[i] > 0.0).then(|| (sum / count / variances[i]).sqrt())
        };
        overall(&(0..variances.len()).map(of_output).collect::<Vec<_>>())
    };
    let one = |samples: usize| HorizonError {
        samples,
        before: nrmse(before, samples),
        after: nrmse(after, samples),
    };
    reported(horizon).into_iter().map(one).collect()
}

/// 1, 2, 5, 10, 20, 50 … steps, and the last.
fn reported(horizon: NonZeroUsize) -> Vec<usize> {
    let decades = (0..).map_while(|e| 10_usize.checked_pow(e)).take_while(|d| *d <= horizon.get());
    let mut steps: Vec<usize> =
        decades.flat_map(|d| [1, 2, 5].map(|m| m * d)).filter(|s| *s < horizon.get()).collect();
    steps.push(horizon.get());
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reported_steps_end_with_the_horizon() {
        let of = |n: usize| reported(NonZeroUsize::new(n).unwrap());
        assert_eq!((of(1), of(2), of(30)), (vec![1], vec![1, 2], vec![1, 2, 5, 10, 20, 30]));
    }
}

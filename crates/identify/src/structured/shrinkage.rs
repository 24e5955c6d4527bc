//! The strength of the shrinkage towards the file's values, by cross-validation.

use nalgebra::DVector;

use super::problem::StructuredProblem;
use deadtime_signal::fit::Normal;

/// The weakest shrinkage: it keeps undetermined directions at the file's values, at no cost elsewhere.
pub(super) const WEAKEST: f64 = 1e-8;
/// Candidates per decade.
const A_DECADE: i32 = 2;

/// The shrinkage with the least error in cross-validation. Folds are records if there are at least three, else clusters of windows.
///
/// Each fold's fit is one Gauss-Newton step from the joint fit, its error the quadratic there; no window is simulated again.
pub(super) fn by_data(
    problem: &StructuredProblem<'_>,
    clusters: &[Normal],
    z: &[f64],
    prior: impl Fn(f64) -> Vec<f64>,
) -> Option<f64> {
    let by_record = problem.records.len() >= 3;
    let folds = if by_record { problem.records.len() } else { clusters.len() };
    if folds < 3 {
        return None;
    }
    let nothing = vec![0.0; z.len()];
    let whole = problem.normal(clusters, z, &nothing);
    let parts: Vec<Normal> = (0..folds)
        .map(|fold| {
            let mut part = Normal {
                cost: 0.0,
                gradient: DVector::zeros(z.len()),
                information: whole.information.clone() * 0.0,
            };
            for (i, (cluster, normal)) in problem.clusters.iter().zip(clusters).enumerate() {
                if fold == if by_record { cluster.record } else { i } {
                    problem.scatter(cluster.record, normal, &mut part, 1.0);
                }
            }
            part
        })
        .collect();
    let mean = whole.information.diagonal().mean();
    let candidates = (-16 * A_DECADE / 2..=2 * A_DECADE)
        .map(|i| mean * 10f64.powf(f64::from(i) / f64::from(A_DECADE)));
    let left_out = |shrinkage: f64| -> Option<f64> {
        let prior = prior(shrinkage);
        let mut error = 0.0;
        for (fold, part) in parts.iter().enumerate() {
            let mut information = &whole.information - &part.information;
            let mut gradient = &whole.gradient - &part.gradient;
            for i in 0..z.len() {
                information[(i, i)] += prior[i].max(WEAKEST);
                gradient[i] += prior[i] * z[i];
            }
            let mut step = -information.cholesky()?.solve(&gradient);
            if by_record {
                // The deviation of an unseen record is unknown.
                let own = problem.own.len();
                for i in problem.free.len() + fold * own..problem.free.len() + (fold + 1) * own {
                    step[i] = -z[i];
                }
            }
            error +=
                part.cost + 2.0 * part.gradient.dot(&step) + (&part.information * &step).dot(&step);
        }
        Some(error)
    };
    let scored = candidates.filter_map(|s| Some((s, left_out(s)?)));
    scored.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(s, _)| s.max(WEAKEST))
}

/// Standard deviation of the records' deviations: the mean square of the estimates plus their variance (an expectation-maximisation step).
pub(super) fn own_sizes(
    problem: &StructuredProblem<'_>,
    clusters: &[Normal],
    z: &[f64],
    prior: &[f64],
    sizes: &mut [f64],
) {
    let Some(inverse) =
        problem.normal(clusters, z, prior).information.cholesky().map(|c| c.inverse())
    else {
        return;
    };
    let (shared, own, records) = (problem.free.len(), problem.own.len(), problem.records.len());
    for (j, size) in sizes.iter_mut().enumerate() {
        let square = |i: usize| z[i] * z[i] + inverse[(i, i)];
        let sum: f64 = (0..records).map(|r| square(shared + r * own + j)).sum();
        *size = (sum / records as f64).sqrt().max(1e-9);
    }
}

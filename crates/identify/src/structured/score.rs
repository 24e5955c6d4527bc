//! The error of predictions by horizon and group.

use serde::Serialize;

use super::problem::StructuredProblem;
use super::window::{Buffers, WindowPoint};
use deadtime_signal::parallel;
use deadtime_signal::stats;

/// Mean length of a group's error over all windows, by horizon. The error of a vector is the length of the difference, that of an attitude the angle between
/// the two.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupScore {
    /// The group.
    pub group: String,
    /// Unit of the error.
    pub unit: Option<String>,
    /// Mean absolute error, horizons 1, 2, …
    pub mean_absolute: Vec<f64>,
    /// Root mean square, horizons 1, 2, …
    pub rms: Vec<f64>,
    /// Sum of the mean absolute errors over all horizons.
    pub sum: f64,
}

/// Lengths of all errors, `[group][horizon - 1]` a list over windows in order. Where a window diverges: its record and start.
pub(super) fn lengths(
    problem: &StructuredProblem<'_>,
    z: &[f64],
) -> Result<Vec<Vec<Vec<f64>>>, (usize, usize)> {
    let (groups, horizon) = (problem.simulator.groups.len(), problem.simulator.horizon);
    let one = |cluster: &super::problem::Cluster| {
        let p = problem.parameters(cluster.record, z);
        let (mut found, mut buffers) =
            (vec![vec![Vec::new(); horizon]; groups], Buffers::default());
        let weights = problem.plain_weights(cluster.record);
        for &start in &cluster.starts {
            let shift = problem
                .start_of(cluster.record, start, &p, &weights, &mut buffers)
                .ok_or((cluster.record, start))?;
            let at =
                WindowPoint { p: &p, columns: &[], starts: &problem.starts.states, shift: &shift };
            let finite = problem.simulator.walk(
                &problem.records[cluster.record],
                start,
                at,
                &mut buffers,
                |seen| {
                    found[seen.group][seen.horizon - 1]
                        .push(seen.error.iter().map(|e| e * e).sum::<f64>().sqrt());
                },
            );
            if !finite {
                return Err((cluster.record, start));
            }
        }
        Ok(found)
    };
    let parts: Vec<_> = parallel::try_map(&problem.clusters, one)?;
    let mut all = vec![vec![Vec::new(); horizon]; groups];
    for part in parts {
        for (to, from) in all.iter_mut().flatten().zip(part.into_iter().flatten()) {
            to.extend(from);
        }
    }
    Ok(all)
}

/// The means of those lengths.
pub(super) fn score(problem: &StructuredProblem<'_>, lengths: &[Vec<Vec<f64>>]) -> Vec<GroupScore> {
    let groups = problem.simulator.groups.iter().zip(lengths);
    groups
        .map(|(group, by_horizon)| {
            let mean_absolute: Vec<f64> =
                by_horizon.iter().map(|l| stats::mean(l.iter().copied()).unwrap_or(0.0)).collect();
            let rms =
                by_horizon.iter().map(|l| stats::rms(l.iter().copied()).unwrap_or(0.0)).collect();
            GroupScore {
                group: group.name.clone(),
                unit: group.unit.clone(),
                sum: mean_absolute.iter().sum(),
                mean_absolute,
                rms,
            }
        })
        .collect()
}

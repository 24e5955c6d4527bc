//! What a structured fit found: values with intervals, what the data do not show, and what predicts without being physics.

use deadtime_signal::decompositions::symmetric_eigen;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::fitted::Fitted;
use super::known::{Known, RESOLVED, Standing, Unseen, standing};
use super::problem::StructuredProblem;
use super::score::GroupScore;
use deadtime_model::EquationsFile;
use deadtime_signal::fit::{Normal, Stopped};
use deadtime_signal::stats::interval95;

/// A fitted parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FreeParameter {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The file's value.
    pub nominal: f64,
    /// The value found.
    pub value: f64,
    /// Its standard deviation, over clusters of windows.
    pub std: f64,
    /// 95 % interval.
    pub interval: [f64; 2],
    /// The value from windows of one step, with its standard deviation.
    pub one_step: Option<[f64; 2]>,
    /// Whether it can be taken for the quantity.
    pub standing: Standing,
}

/// What was found.
#[derive(Debug, Clone, Serialize)]
pub struct StructuredFit {
    /// `deadtime/structure@1`.
    pub format: &'static str,
    /// The model's name.
    pub name: String,
    /// The parameters.
    pub parameters: Vec<FreeParameter>,
    /// What stands off by record: parameter, record, value.
    pub per_record: Vec<(String, String, f64)>,
    /// Combinations that are not identifiable.
    pub unseen: Vec<Unseen>,
    /// Pairs that are correlated, in words.
    pub trades: Vec<String>,
    /// Steps of a window.
    pub horizon: usize,
    /// The logs' sample time, s.
    pub sample_time_s: f64,
    /// Runge-Kutta steps in a sample.
    pub substeps: usize,
    /// Windows of the fit.
    pub windows: usize,
    /// Clusters that the covariance rests on.
    pub clusters: usize,
    /// λ, in the cost of the weighted errors.
    pub shrinkage: f64,
    /// The search ended at a minimum.
    pub converged: bool,
    /// Its last iteration count.
    pub iterations: usize,
    /// Errors on the training logs: the file's model, the fitted one.
    pub training: [Vec<GroupScore>; 2],
    /// The same on logs held out.
    pub held_out: Option<[Vec<GroupScore>; 2]>,
    /// The fitted model.
    #[serde(skip)]
    pub model: Option<EquationsFile>,
}

/// Sandwich covariance over clusters, with what the shrinkage leaves open, and the information deflated by how much errors repeat each other.
///
/// V = A⁻¹ (M + κΛ) A⁻¹, A = N + Λ; N the information, Λ the shrinkage, M = C/(C−1) Σ sₖsₖᵀ the clusters' scores, κ = tr(A⁻¹M)/tr(A⁻¹N), so that
/// a parameter that only the shrinkage holds gets the shrinkage's own spread, never a tight interval. What the logs do not resolve at all ([`RESOLVED`]) is as uncertain as
/// the parameters are large.
pub(super) fn covariance(
    problem: &StructuredProblem<'_>,
    clusters: &[Normal],
    z: &[f64],
    prior: &[f64],
) -> (DMatrix<f64>, DMatrix<f64>) {
    let size = z.len();
    let nothing = vec![0.0; size];
    let bare = problem.normal(clusters, z, &nothing);
    let mut meat = DMatrix::zeros(size, size);
    for (cluster, normal) in problem.clusters.iter().zip(clusters) {
        let mut score = DVector::<f64>::zeros(size);
        for i in 0..normal.gradient.len() {
            score[problem.place(cluster.record, i)] += normal.gradient[i];
        }
        meat += &score * score.transpose();
    }
    let count = clusters.len() as f64;
    meat *= count / (count - 1.0).max(1.0);
    let with = problem.normal(clusters, z, prior).information;
    let unknown = DMatrix::from_diagonal_element(size, size, f64::INFINITY);
    let Some(inverse) = with.cholesky().map(|c| c.inverse()) else {
        return (unknown, bare.information);
    };
    let kappa = ((&inverse * &meat).trace()
        / (&inverse * &bare.information).trace().max(f64::MIN_POSITIVE))
    .max(f64::MIN_POSITIVE);
    let mut middle = meat;
    for i in 0..size {
        middle[(i, i)] += kappa * prior[i];
    }
    let mut covariance = &inverse * middle * &inverse;
    let Some(eigen) = symmetric_eigen(&bare.information) else {
        return (unknown, bare.information);
    };
    let most = eigen.eigenvalues.max();
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        if *value <= RESOLVED * most {
            // The parameters' own size.
            let direction = eigen.eigenvectors.column(k);
            covariance += direction * direction.transpose();
        }
    }
    (covariance, bare.information / kappa)
}

/// Value and standard deviation of each shared parameter.
pub(super) fn values(problem: &StructuredProblem<'_>, fitted: &Fitted) -> Vec<[f64; 2]> {
    let value = |(j, &(i, size)): (usize, &(usize, f64))| {
        [problem.nominal[i] + size * fitted.z[j], size * fitted.covariance[(j, j)].max(0.0).sqrt()]
    };
    problem.free.iter().enumerate().map(value).collect()
}

pub(super) fn answer(
    problem: &StructuredProblem<'_>,
    fitted: &Fitted,
    one_step: Option<&[[f64; 2]]>,
) -> StructuredFit {
    let symbols = problem.simulator.equations.parameters();
    let shared = problem.free.len();
    let values = values(problem, fitted);
    let known = Known {
        names: problem.free.iter().map(|&(i, _)| symbols[i].name.as_str()).collect(),
        sizes: problem.free.iter().map(|&(_, size)| size).collect(),
        values: values.iter().map(|[value, _]| *value).collect(),
        information: fitted.information.view((0, 0), (shared, shared)).into_owned(),
        covariance: fitted.covariance.view((0, 0), (shared, shared)).into_owned(),
        source: "the logs do",
    };
    let unseen = known.unseen();
    let (trades, traded) = known.trades();
    let parameter = |(j, [value, std]): (usize, [f64; 2])| {
        let (i, _) = problem.free[j];
        let one_step = one_step.map(|list| list[j]);
        let (nominal, symbol) = (problem.nominal[i], &symbols[i]);
        let lost = traded[j]
            || unseen.iter().any(|u| u.parts.iter().any(|(name, _)| *name == symbol.name));
        FreeParameter {
            name: symbol.name.clone(),
            unit: symbol.unit.clone(),
            nominal,
            value,
            std,
            interval: interval95(value, std),
            one_step,
            standing: standing(nominal, [value, std], one_step, lost),
        }
    };
    let parameters = values.into_iter().enumerate().map(parameter).collect();
    let own = problem.own.len();
    let per_record = (0..problem.records.len())
        .flat_map(|r| (0..own).map(move |j| (r, j)))
        .map(|(r, j)| {
            let ((i, size), source) = (problem.own[j], problem.records[r].source.clone());
            (symbols[i].name.clone(), source, size * fitted.z[shared + r * own + j])
        })
        .collect();
    StructuredFit {
        format: "deadtime/structure@1",
        name: String::new(),
        parameters,
        per_record,
        unseen,
        trades,
        horizon: problem.simulator.horizon,
        sample_time_s: problem.simulator.step_s,
        substeps: fitted.substeps,
        windows: 0,
        clusters: fitted.clusters.len(),
        shrinkage: fitted.prior.first().copied().unwrap_or(fitted.shrinkage),
        converged: fitted.fit.stopped.converged()
            || fitted.fit.stopped == Stopped::Stalled
                && fitted.fit.normal.slope(&vec![true; fitted.z.len()]) < 1e-3,
        iterations: fitted.fit.iterations,
        training: [Vec::new(), Vec::new()],
        held_out: None,
        model: None,
    }
}

//! The delay of the ARX model with the best prediction.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, A(q) y(t) = B(q) u(t − nk) + e(t). The estimate leaves out leading coefficients of B that the data do
//! not support; the published minimum is the raw value.

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{
    DelayEstimator, NoDelay, PairRecords, Search, first_of, joint_inputs, one_pair, options, seen,
};
use crate::experiment::Experiment;
use crate::method::{Basis, Condition, Information, Method, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{ArxScan, JointArx, Record, arx_scan, beside};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: noise that an AR(na) filter describes; holds for unstable plants and under feedback, as prediction-error methods do.
/// Resolution and cost: one sample; O(N·(na + nb + delays)) for all delays together.
/// Fails when: the input's first coefficient is small compared with the noise (biased late). Many delays that fit equally well give a wide interval or `flat`.
/// With nb above 1 the published minimum is often early, because leading coefficients may be zero. The estimate weights numerators of 1 to nb coefficients by
/// their evidence instead. Several inputs are fitted together, without a published source: the shared part of correlated inputs would leak from one pair into
/// another. `others: apart` fits each pair alone.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.3 (na 10, nb 5); Ljung (1999), "System Identification", 2nd ed., section 4.2; MATLAB `arxstruc`.
#[doc = plant_example!(Arxstruc, 400, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arxstruc {
    /// Past outputs; default 10, the best in Björklund's study.
    pub na: usize,
    /// Input coefficients; default 5, as above.
    pub nb: usize,
    /// The treatment of an experiment's other inputs; default apart: every pair alone.
    pub others: Others,
    /// Longest part of a record that is used where other inputs are regressors, samples; default 100 000.
    pub max_samples: usize,
}

/// The role of the other inputs in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Others {
    /// None: their effect is noise, and their part correlated with the input biases its estimate.
    Apart,
    /// Regressors, each behind a delay of its own, found by coordinate descent. The estimate for one input fixes the others' delays at their best values.
    #[default]
    Regressors,
}

impl Default for Arxstruc {
    fn default() -> Self {
        let [na, nb] = posterior::ARX_ORDERS;
        Self { na, nb, others: Others::Regressors, max_samples: 100_000 }
    }
}

const NAME: &str = "arxstruc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Poles(2),
    basis: Basis::Arx,
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
        Condition::MissingOutputs,
        Condition::OtherInputs,
        Condition::InverseResponse,
    ],
    needs: "noise that an AR filter of its order whitens",
    blind_to: "fractions of a sample; a first coefficient that is small against the noise",
    ..method_line!(
        "arxstruc",
        "best ARX model over all delays (na 10, nb 5): fast, also for unstable plants and under feedback",
        Arxstruc,
        Parametric
    )
};

impl DelayEstimator for Arxstruc {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        self.run(NAME, experiment, search)
    }

    fn is_joint(&self) -> bool {
        self.others == Others::Regressors
    }
}

impl Arxstruc {
    /// The scan under the name of a method that is one.
    pub(super) fn run(
        &self,
        name: &'static str,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        options(name, [("nb", self.nb as f64, self.nb >= 1, "1 or more")])?;
        if self.others == Others::Regressors && experiment.inputs().len() > 1 {
            return first_of(joint_inputs(experiment, search, |pairs| self.joint(name, pairs))?);
        }
        one_pair(experiment, search, |pair| self.alone(name, pair))
    }

    /// The estimates of all inputs for one output, each with the others as regressors.
    fn joint(
        &self,
        name: &'static str,
        pairs: &[PairRecords],
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        let Some(PairRecords { max_delay, experiment, .. }) = pairs.first() else {
            return Ok(Vec::new());
        };
        let cut: Vec<Vec<Record>> = pairs.iter().map(|p| p.heads(self.max_samples).0).collect();
        let lags = JointArx::new(&cut, self.na, self.nb, *max_delay);
        let rows_needed = 2 * (self.na + self.nb * pairs.len());
        if lags.scan(0, &[]).rows < rows_needed {
            return Err(self.too_short(name, *max_delay, rows_needed, experiment));
        }
        // Each input alone first: the descent starts at the pairs' estimates.
        let alone: Vec<usize> = (0..pairs.len())
            .map(|input| {
                let loss = lags.scan(input, &[]).loss;
                (0..loss.len()).min_by(|&a, &b| loss[a].total_cmp(&loss[b])).unwrap_or(0)
            })
            .collect();
        let delays = lags.descend(alone);
        let each = |(input, pair): (usize, &PairRecords)| {
            let scan = lags.scan(input, &beside(&delays, input));
            if scan.input_rank.iter().all(|&r| r == 0) {
                let note = "the other inputs explain every lag of this one: they move together";
                return Ok(DelayEstimate::without(Outcome::Singular, note));
            }
            answer(&scan, self.nb, pair).or_else(NoDelay::answered)
        };
        pairs.iter().enumerate().map(each).collect()
    }

    /// The estimate for one input, without the others.
    fn alone(&self, name: &'static str, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, experiment, .. } = pair;
        let scan = arx_scan(records, self.na, self.nb, max_delay);
        let rows_needed = 2 * (self.na + self.nb);
        if scan.rows < rows_needed {
            let gaps = records.iter().any(|r| r.present.is_some());
            if gaps && experiment.longest() >= self.longest_needed(max_delay, rows_needed) {
                let note = format!(
                    "missing outputs leave {} rows with all of {} past ones, {rows_needed} are needed: set a smaller na",
                    scan.rows, self.na
                );
                return Err(NoDelay::new(Outcome::NotApplicable, note));
            }
            return Err(self.too_short(name, max_delay, rows_needed, experiment).into());
        }
        answer(&scan, self.nb, pair)
    }

    fn longest_needed(&self, max_delay: usize, rows: usize) -> usize {
        self.na.max(max_delay + self.nb - 1) + rows
    }

    fn too_short(
        &self,
        method: &'static str,
        max_delay: usize,
        rows: usize,
        experiment: &Experiment,
    ) -> DelayError {
        let needed = self.longest_needed(max_delay, rows);
        let remedy = LengthRemedy::WindowOr("set smaller na and nb");
        DelayError::TooShort { method, needed, got: experiment.longest(), remedy }
    }
}

/// The estimate of the delay from the losses of an ARX scan.
pub(super) fn answer(
    scan: &ArxScan,
    nb: usize,
    pair: &PairRecords,
) -> Result<DelayEstimate, NoDelay> {
    if scan.input_rank.iter().all(|&r| r == 0) {
        let note =
            "past outputs explain every lag of the input: it is almost constant in the rows used";
        return Err(NoDelay::new(Outcome::NotRichEnough, note));
    }
    let (Some(minimum), Some(posterior)) = (
        posterior::smallest(&scan.loss),
        posterior::posterior_of_start(&scan.by_count, scan.power, scan.rows as f64),
    ) else {
        return Err(NoDelay::overflow());
    };
    seen(posterior::unseen_by(scan, nb))?;
    if posterior.is_flat() {
        return Err(NoDelay::flat(posterior.set, pair.max_delay + 1));
    }
    Ok(pair
        .most_probable(&posterior)
        .with_raw_s(pair.seconds(minimum as f64))
        .noting(leading_zeros(posterior.best, minimum)))
}

/// The note where the smallest loss comes before the most probable delay.
pub(super) fn leading_zeros(best: usize, minimum: usize) -> Option<String> {
    let leading = best.checked_sub(minimum).filter(|&n| n > 0)?;
    Some(format!(
        "the smallest loss is at nk = {minimum}, but its first {leading} input coefficients are zero within the noise"
    ))
}

//! The delay whose ARX model predicts best.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, A(q) y(t) = B(q) u(t − nk) + e(t); leading coefficients of B that the data do not ask for are taken
//! off the answer, the published minimum stays beside it as the raw value.

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search, joint_inputs, one_pair};
use crate::experiment::Experiment;
use crate::method::WHOLE;
use crate::method::{
    Basis, Class, Condition, Information, Method, ReferenceExperiment, Scope, Start,
};
use crate::posterior;
use deadtime_identify::{ArxScan, JointArx, Record, arx_scan, beside};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: noise that an AR(na) filter describes; holds for unstable plants and under feedback, as prediction-error methods do.
/// Resolution and cost: one sample; O(N·(na + nb + delays)) for all delays together.
/// Fails when: the input's first coefficient is small against the noise (the delay is then found late); many delays that fit alike show as a wide interval or `flat`.
/// With nb above 1 the published minimum is often early, because leading coefficients may be zero; the answer weighs numerators of 1 to nb coefficients by their
/// evidence instead.
/// Several inputs are fitted beside each other, because what inputs share that move together would leak from one pair into another (no source is followed in
/// that); `others: apart` looks at each pair alone.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.3 (na 10, nb 5); Ljung (1999), "System Identification", 2nd ed., section 4.2; MATLAB `arxstruc`.
///
/// # Example
/// ```
/// use deadtime_delay::{Arxstruc, DelayEstimator, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 400];
/// for t in 5..400 {
///     y[t] = 0.8 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Arxstruc::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arxstruc {
    /// Past outputs; default 10, the best in Björklund's study.
    pub na: usize,
    /// Input coefficients; default 5, as above.
    pub nb: usize,
    /// What is made of an experiment's other inputs; default nothing: every pair is treated apart.
    pub others: Others,
    /// Longest part of a record that is used where other inputs are regressors, samples; default 100 000.
    pub max_samples: usize,
}

/// What is made of the inputs beside the one whose delay is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Others {
    /// Nothing: what they do is noise, and what they share with the input leaks into its answer.
    Apart,
    /// They are regressors too, each behind a delay of its own, found by coordinate descent. The answer for one input holds the others' delays at their best values.
    #[default]
    Regressors,
}

impl Default for Arxstruc {
    fn default() -> Self {
        Self { na: 10, nb: 5, others: Others::Regressors, max_samples: 100_000 }
    }
}

const NAME: &str = "arxstruc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "arxstruc",
        "best ARX model over all delays (na 10, nb 5): fast, also for unstable plants and under feedback",
        Arxstruc,
        dyn DelayEstimator
    ),
    class: Class::Parametric,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Plant,
    information: Information::Poles(2),
    basis: Basis::Arx,
    tolerance: WHOLE,
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
        Condition::MissingOutputs,
        Condition::OtherInputs,
    ],
    needs: "noise that an AR filter of its order whitens",
    blind_to: "fractions of a sample; a first coefficient that is small against the noise",
    exempt: &[],
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
        if self.nb == 0 {
            return Err(DelayError::Option {
                method: name,
                option: "nb",
                value: 0.0,
                allowed: "1 or more",
            });
        }
        if self.others == Others::Regressors && experiment.inputs().len() > 1 {
            let all = joint_inputs(experiment, search, |inputs, max_delay, bias| {
                self.joint(name, inputs, max_delay, bias, experiment)
            })?;
            return all.into_iter().next().ok_or(DelayError::Count {
                what: "inputs",
                needed: 1,
                got: 0,
            });
        }
        one_pair(experiment, search, |records, max_delay, bias| {
            self.pair(name, records, max_delay, bias, experiment)
        })
    }

    /// The answers of all inputs for one output, each with the others as regressors.
    fn joint(
        &self,
        name: &'static str,
        inputs: &[Vec<Record>],
        max_delay: usize,
        bias: &[usize],
        experiment: &Experiment,
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        let cut: Vec<Vec<Record>> = inputs
            .iter()
            .map(|records| {
                super::misfit::heads(records, self.max_samples).unwrap_or_else(|| records.clone())
            })
            .collect();
        let lags = JointArx::new(&cut, self.na, self.nb, max_delay);
        let rows_needed = 2 * (self.na + self.nb * inputs.len());
        let first = lags.scan(0, &[]);
        if first.rows < rows_needed {
            return Err(DelayError::TooShort {
                method: name,
                needed: self.na.max(max_delay + self.nb - 1) + rows_needed,
                got: experiment.longest(),
                remedy: crate::error::LengthRemedy::WindowOr("set smaller na and nb"),
            });
        }
        // Each input alone first: the descent starts where the pairs' answers are.
        let alone: Vec<usize> = (0..inputs.len())
            .map(|input| {
                let loss = lags.scan(input, &[]).loss;
                (0..loss.len()).min_by(|&a, &b| loss[a].total_cmp(&loss[b])).unwrap_or(0)
            })
            .collect();
        let delays = lags.descend(alone);
        let each = |input: usize| {
            let scan = lags.scan(input, &beside(&delays, input));
            let rank = scan.input_rank.iter().all(|&r| r == 0);
            if rank {
                DelayEstimate::without(
                    Outcome::Singular,
                    "the other inputs explain every lag of this one: they move together",
                )
            } else {
                answer(&scan, self.nb, max_delay, bias[input], experiment)
            }
        };
        Ok((0..inputs.len()).map(each).collect())
    }

    fn pair(
        &self,
        name: &'static str,
        records: &[Record],
        max_delay: usize,
        bias: usize,
        experiment: &Experiment,
    ) -> Result<DelayEstimate, DelayError> {
        let scan = arx_scan(records, self.na, self.nb, max_delay);
        let rows_needed = 2 * (self.na + self.nb);
        if scan.rows < rows_needed {
            let gaps = records.iter().any(|r| r.present.is_some());
            if gaps && experiment.longest() >= self.na.max(max_delay + self.nb - 1) + rows_needed {
                let note = format!(
                    "missing outputs leave {} rows with all of {} past ones, {rows_needed} are needed: set a smaller na",
                    scan.rows, self.na
                );
                return Ok(DelayEstimate::without(Outcome::NotApplicable, note));
            }
            return Err(DelayError::TooShort {
                method: name,
                needed: self.na.max(max_delay + self.nb - 1) + rows_needed,
                got: experiment.longest(),
                remedy: crate::error::LengthRemedy::WindowOr("set smaller na and nb"),
            });
        }
        Ok(answer(&scan, self.nb, max_delay, bias, experiment))
    }
}

/// What the losses of an ARX scan say of the delay.
pub(super) fn answer(
    scan: &ArxScan,
    nb: usize,
    max_delay: usize,
    bias: usize,
    experiment: &Experiment,
) -> DelayEstimate {
    if scan.input_rank.iter().all(|&r| r == 0) {
        return DelayEstimate::without(
            Outcome::NotRichEnough,
            "past outputs explain every lag of the input: it hardly moves in the rows used",
        );
    }
    let rows = scan.rows as f64;
    let minimum = (0..scan.loss.len())
        .filter(|&nk| scan.loss[nk].is_finite())
        .min_by(|&a, &b| scan.loss[a].total_cmp(&scan.loss[b]));
    let (Some(minimum), Some(posterior)) =
        (minimum, posterior::posterior_of_start(&scan.by_count, scan.power, rows))
    else {
        return DelayEstimate::without(
            Outcome::Singular,
            "no delay has a finite loss: the numbers overflow; scale the channels",
        );
    };
    let best = posterior.best;
    let delays = max_delay + 1;
    if let Some(note) = posterior::unseen_by(scan, nb) {
        return DelayEstimate::without(Outcome::NotVisible, note);
    }
    if posterior.is_flat() {
        return DelayEstimate::without(
            Outcome::Flat,
            format!("{} of {delays} delays fit equally well", posterior.set),
        );
    }
    let (start, raw) = (best as f64, minimum as f64);
    let estimate = DelayEstimate::counted(
        start,
        posterior.std,
        posterior::first_coefficient(posterior.ends[0], posterior.ends[1], bias),
        best == max_delay,
        bias,
        experiment.sample_time(),
    );
    let leading = best.saturating_sub(minimum);
    let note = (leading > 0)
        .then(|| format!("the smallest loss is at nk = {minimum}, but its first {leading} input coefficients are zero within the noise"));
    DelayEstimate { raw_delay_s: Some(experiment.sample_time().to_seconds(raw)), ..estimate }
        .noting(note)
}

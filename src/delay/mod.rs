//! Dead-time estimation: what an estimator is, and the list of all there are.

mod area;
mod error;
mod estimate;
mod experiment;
mod frequency;
mod laguerre;
mod method;
mod parametric;
mod posterior;
mod states;
mod threshold;
mod verdict;

pub use area::{Area1, Area2, Area3, Moment};
pub use error::DelayError;
pub use estimate::{DelayEstimate, Outcome, PairEstimate};
pub use experiment::{Detrend, Experiment, PlantModel, Recording, Series};
pub use frequency::{Arxdap, Firdap, Oedap};
pub use laguerre::{Fischer, Lagudap};
pub use method::{Class, Condition, Information, Law, Method, Scope, Start, Suits, method};
pub use parametric::{Arxstruc, Oestruc};
pub use states::{Coefficients, Selection, StateLeastSquares};
pub use threshold::{Records, Step, Threshold};
pub use verdict::{Verdict, verdict};

pub use crate::identify::{Initial, Record};

/// How far to search, and what to take off the answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Longest delay searched, samples; default 35. When the answer is the longest, the window doubles once.
    pub max_delay: usize,
    /// Samples that a delay-free plant already needs to respond (its relative degree), by output and input; pairs beyond the table take `default_bias`.
    pub bias: Vec<Vec<usize>>,
    /// The bias of every other pair; default 1, a strictly proper plant behind a zero-order hold.
    pub default_bias: usize,
}

impl Default for Search {
    fn default() -> Self {
        Self { max_delay: 35, bias: Vec::new(), default_bias: 1 }
    }
}

impl Search {
    fn bias(&self, input: usize, output: usize) -> usize {
        self.bias.get(output).and_then(|row| row.get(input)).copied().unwrap_or(self.default_bias)
    }
}

/// An estimator; the implementor is its option struct.
pub trait DelayEstimator: Send + Sync {
    /// The delay of every pair (or of every input).
    ///
    /// # Errors
    /// [`DelayError`] where the data cannot be used at all; what the data do not show is an [`Outcome`].
    fn estimate(&self, experiment: &Experiment, search: &Search) -> Result<Vec<PairEstimate>, DelayError>;
}

/// Runs `method` on every pair, with the window doubled once where its answer is the longest delay searched.
fn every_pair(
    experiment: &Experiment,
    search: &Search,
    method: impl Fn(&[Record], usize, usize) -> Result<DelayEstimate, DelayError>,
) -> Result<Vec<PairEstimate>, DelayError> {
    experiment.check()?;
    let mut estimates = Vec::new();
    for output in 0..experiment.outputs.len() {
        for input in 0..experiment.inputs.len() {
            let records = experiment.pair(input, output)?;
            let bias = search.bias(input, output);
            let mut estimate = method(&records, search.max_delay, bias)?;
            if estimate.outcome == Outcome::AtEdge
                // A record too short for the wider window leaves the answer at the edge of the narrow one.
                && let Ok(wider) = method(&records, 2 * search.max_delay, bias)
            {
                estimate = wider;
            }
            estimates.push(PairEstimate { input, output: Some(output), estimate });
        }
    }
    Ok(estimates)
}

/// Every estimator, within a class the most trusted first.
pub const METHODS: &[Method] = &[
    parametric::oestruc::METHOD,
    parametric::arxstruc::METHOD,
    threshold::impulse::METHOD,
    threshold::step::METHOD,
    frequency::oedap::METHOD,
    frequency::arxdap::METHOD,
    frequency::firdap::METHOD,
    laguerre::lagudap::METHOD,
    laguerre::fischer::METHOD,
    area::area1::METHOD,
    area::area3::METHOD,
    area::area2::METHOD,
    area::moment::METHOD,
    states::state_least_squares::METHOD,
];

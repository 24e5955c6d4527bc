//! Dead-time estimation: what an estimator is, and the list of all there are.

mod error;
mod estimate;
mod experiment;
mod method;
mod parametric;
mod posterior;
mod states;
mod threshold;
mod verdict;

pub use error::DelayError;
pub use estimate::{DelayEstimate, Outcome, PairEstimate};
pub use experiment::{Detrend, Experiment, PlantModel, Recording, Series};
pub use method::{Class, Condition, Information, Law, Method, Scope, Start, Suits, method};
pub use parametric::{Armaxstruc, Arxstruc, Ivstruc, Met1struc, Oestruc, Others};
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

/// Runs `method` on all inputs of every output together, records and bias by input, with the window doubled once where an answer is the longest delay searched.
fn every_output(
    experiment: &Experiment,
    search: &Search,
    method: impl Fn(&[Vec<Record>], usize, &[usize]) -> Result<Vec<DelayEstimate>, DelayError>,
) -> Result<Vec<PairEstimate>, DelayError> {
    experiment.check()?;
    let mut answers = Vec::new();
    for output in 0..experiment.outputs.len() {
        let inputs = (0..experiment.inputs.len()).map(|input| experiment.pair(input, output)).collect::<Result<Vec<_>, _>>()?;
        let bias: Vec<usize> = (0..inputs.len()).map(|input| search.bias(input, output)).collect();
        let mut estimates = method(&inputs, search.max_delay, &bias)?;
        if estimates.iter().any(|e| e.outcome == Outcome::AtEdge)
            && let Ok(wider) = method(&inputs, 2 * search.max_delay, &bias)
        {
            estimates = wider;
        }
        answers.extend(estimates.into_iter().enumerate().map(|(input, estimate)| PairEstimate { input, output: Some(output), estimate }));
    }
    Ok(answers)
}

/// Every estimator, within a class the most trusted first.
pub const METHODS: &[Method] = &[
    parametric::oestruc::METHOD,
    parametric::armaxstruc::METHOD,
    parametric::met1struc::METHOD,
    parametric::ivstruc::METHOD,
    parametric::arxstruc::METHOD,
    threshold::impulse::METHOD,
    threshold::step::METHOD,
    states::state_least_squares::METHOD,
];

//! An estimator and the delays that it searches.

use super::error::{DelayError, Result};
use super::estimate::{DelayEstimate, Outcome};
use super::experiment::Experiment;
use deadtime_identify::Record;
use deadtime_signal::stop::Stop;

/// How far to search, and what to take off the answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Shortest raw delay searched, samples; default 0. Under feedback of the same sample it must be 1 or more (and the plant strictly proper): what the
    /// controller made of the output's noise would pass for an answer within the sample.
    pub min_delay: usize,
    /// Longest delay searched, samples; default 35. When the answer is the longest, the window doubles once.
    pub max_delay: usize,
    /// Samples that a delay-free plant already needs to respond (its relative degree), by output and input; pairs beyond the table take `default_bias`.
    pub bias: Vec<Vec<usize>>,
    /// The bias of every other pair; default 1, a strictly proper plant behind a zero-order hold.
    pub default_bias: usize,
    /// Looked at between pairs and inside long scans; default: never stops.
    pub stop: Stop,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            min_delay: 0,
            max_delay: 35,
            bias: Vec::new(),
            default_bias: 1,
            stop: Stop::default(),
        }
    }
}

impl Search {
    /// Goes on, unless the work is no longer wanted.
    pub(super) fn go_on(&self) -> Result<(), DelayError> {
        if self.stop.is_set() { Err(DelayError::Stopped) } else { Ok(()) }
    }

    /// Samples by which the input is given later, so that shorter delays are out of reach.
    fn skip(&self) -> usize {
        self.min_delay.min(self.max_delay.saturating_sub(1))
    }

    pub(super) fn bias(&self, input: usize, output: usize) -> usize {
        self.bias.get(output).and_then(|row| row.get(input)).copied().unwrap_or(self.default_bias)
    }

    /// The same search with the biases of one pair, of `inputs` inputs, in the order of [`Experiment::towards`].
    #[must_use]
    pub fn towards(&self, input: usize, output: usize, inputs: usize) -> Self {
        let order = std::iter::once(input).chain((0..inputs).filter(|other| *other != input));
        Self { bias: vec![order.map(|i| self.bias(i, output)).collect()], ..self.clone() }
    }
}

/// An estimator; the implementor is its option struct.
pub trait DelayEstimator: Send + Sync {
    /// The delay from the experiment's first input to its first output, or between its two sequences of events; see [`Experiment::select`] and
    /// [`Experiment::towards`] for the other pairs.
    ///
    /// # Errors
    /// [`DelayError`] where the data cannot be used at all; what the data do not show is an [`Outcome`].
    fn estimate(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError>;

    /// The delays of all inputs of a method that finds them together; of any other method that of the first.
    ///
    /// # Errors
    /// As [`DelayEstimator::estimate`].
    fn estimate_inputs(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        Ok(vec![self.estimate(experiment, search)?])
    }

    /// It treats the other inputs of the experiment as further causes of the output, rather than as noise.
    fn is_joint(&self) -> bool {
        false
    }
}

/// Runs `method` on the records of the first pair, with the window doubled once where its answer is the longest delay searched.
pub(super) fn one_pair(
    experiment: &Experiment<'_>,
    search: &Search,
    method: impl Fn(&[Record<'_>], usize, usize) -> Result<DelayEstimate, DelayError>,
) -> Result<DelayEstimate, DelayError> {
    search.go_on()?;
    let (skip, logged) = (search.skip(), experiment.pair(0, 0)?);
    let records: Vec<Record<'_>> = logged.iter().map(|r| r.ahead(skip)).collect();
    let bias = search.bias(0, 0);
    let mut estimate = method(&records, search.max_delay - skip, bias)?;
    search.go_on()?;
    if estimate.outcome == Outcome::AtEdge
        // A record too short for the wider window leaves the answer at the edge of the narrow one.
        && let Ok(wider) = method(&records, 2 * search.max_delay - skip, bias)
    {
        estimate = wider;
    }
    search.go_on()?;
    Ok(estimate.finished(experiment.sample_time().to_seconds(skip as f64)))
}

/// Runs `method` on all inputs of the first output together, records and bias by input, with the window doubled once where an answer is the longest delay searched.
pub(super) fn joint_inputs(
    experiment: &Experiment<'_>,
    search: &Search,
    method: impl Fn(&[Vec<Record<'_>>], usize, &[usize]) -> Result<Vec<DelayEstimate>, DelayError>,
) -> Result<Vec<DelayEstimate>, DelayError> {
    search.go_on()?;
    let skip = search.skip();
    let logged = (0..experiment.inputs().len())
        .map(|input| experiment.pair(input, 0))
        .collect::<Result<Vec<_>, _>>()?;
    let inputs: Vec<Vec<Record<'_>>> =
        logged.iter().map(|records| records.iter().map(|r| r.ahead(skip)).collect()).collect();
    let bias: Vec<usize> = (0..inputs.len()).map(|input| search.bias(input, 0)).collect();
    let mut estimates = method(&inputs, search.max_delay - skip, &bias)?;
    search.go_on()?;
    if estimates.iter().any(|e| e.outcome == Outcome::AtEdge)
        && let Ok(wider) = method(&inputs, 2 * search.max_delay - skip, &bias)
    {
        estimates = wider;
    }
    search.go_on()?;
    let moved_s = experiment.sample_time().to_seconds(skip as f64);
    Ok(estimates.into_iter().map(|e| e.finished(moved_s)).collect())
}

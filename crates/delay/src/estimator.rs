//! An estimator and the delays that it searches.

use super::error::{DelayError, LengthRemedy, Result};
use super::estimate::{DelayEstimate, Outcome};
use super::experiment::Experiment;
use super::posterior::{self, Posterior};
use crate::parametric::scans::Scans;
use deadtime_identify::{Fir, Record, fir_or_rank};
use deadtime_signal::remedy::{Message, Remedied};
use deadtime_signal::stop::Stop;

/// The search window, and the bias to subtract from the estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Shortest raw delay searched, samples; default 0. Under feedback without delay it must be 1 or more, and the plant strictly proper. Otherwise the
    /// controller's response to output noise passes for a direct path.
    pub min_delay: usize,
    /// Longest delay searched, samples; default 35. When the estimate is the longest delay, the window doubles once.
    pub max_delay: usize,
    /// Samples after which a delay-free plant first responds (its relative degree), by output and input; pairs beyond the table use `default_bias`.
    pub bias: Vec<Vec<usize>>,
    /// The bias of every other pair; default 1, a strictly proper plant behind a zero-order hold.
    pub default_bias: usize,
    /// Cancellation, checked between pairs and inside long scans; default: never stops.
    pub stop: Stop,
    /// Output-error models that several methods share; default: none yet.
    pub scans: Scans,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            min_delay: 0,
            max_delay: 35,
            bias: Vec::new(),
            default_bias: 1,
            stop: Stop::default(),
            scans: Scans::default(),
        }
    }
}

impl Search {
    /// Continues, unless the work is cancelled.
    pub(super) fn go_on(&self) -> Result<(), DelayError> {
        if self.stop.is_set() { Err(DelayError::Stopped) } else { Ok(()) }
    }

    /// Samples by which the input is shifted, so that shorter delays are outside the window.
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
    /// The delay from the experiment's first input to its first output, or between its two event sequences. [`Experiment::select`] and [`Experiment::towards`]
    /// give the other pairs.
    ///
    /// # Errors
    /// [`DelayError`] for unusable data. Data without a visible delay are an [`Outcome`].
    fn estimate(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError>;

    /// The delays of all inputs, for a method that estimates them jointly; for any other method, the first input's.
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

    /// The method models the other inputs of the experiment as causes of the output instead of noise.
    fn is_joint(&self) -> bool {
        false
    }
}

/// The data of one input and one output.
#[derive(Clone, Copy)]
pub(super) struct PairRecords<'a> {
    /// The records; the shortest delay searched is lag 0.
    pub(super) records: &'a [Record<'a>],
    /// Longest delay, samples.
    pub(super) max_delay: usize,
    /// Samples after which a delay-free plant first responds.
    pub(super) bias: usize,
    /// The source of the records.
    pub(super) experiment: &'a Experiment<'a>,
    /// Cancellation, checked inside long scans.
    pub(super) stop: &'a Stop,
    /// Output-error models that another method may have made.
    pub(super) scans: &'a Scans,
}

/// Why a method gives no delay.
pub(super) enum NoDelay {
    /// The data reveal no delay.
    Answer(DelayEstimate),
    /// The data cannot be used.
    Refused(DelayError),
}

impl NoDelay {
    /// An estimate without a delay.
    pub(super) fn new(outcome: Outcome, note: impl Into<Message>) -> Self {
        Self::Answer(DelayEstimate::without(outcome, note))
    }

    /// The result of a scan where no delay has a finite loss.
    pub(super) fn overflow() -> Self {
        Self::new(
            Outcome::Singular,
            "no delay has a finite loss: the numbers overflow; scale the channels",
        )
    }

    /// The result of a scan of `delays` of which `same` fit equally.
    pub(super) fn flat(same: usize, delays: usize) -> Self {
        Self::new(Outcome::Flat, format!("{same} of {delays} delays fit equally well"))
    }

    /// The estimate, or the error.
    pub(super) fn answered(self) -> Result<DelayEstimate, DelayError> {
        match self {
            Self::Answer(estimate) => Ok(estimate),
            Self::Refused(error) => Err(error),
        }
    }
}

impl From<DelayError> for NoDelay {
    fn from(error: DelayError) -> Self {
        Self::Refused(error)
    }
}

impl From<DelayEstimate> for NoDelay {
    fn from(estimate: DelayEstimate) -> Self {
        Self::Answer(estimate)
    }
}

impl<'a> PairRecords<'a> {
    /// Refuses records of fewer than `needed` samples.
    pub(super) fn at_least(
        &self,
        method: &'static str,
        needed: usize,
        remedy: LengthRemedy,
    ) -> Result<(), DelayError> {
        long_enough(method, needed, self.experiment.longest(), remedy)
    }

    /// Fails where the output does not visibly follow the input.
    pub(super) fn visible(&self) -> Result<(), NoDelay> {
        seen(posterior::unseen(self.records, self.max_delay))
    }

    /// Fails where an output sample is missing.
    pub(super) fn complete(&self, why: &'static str) -> Result<(), NoDelay> {
        let whole = self.records.iter().all(|r| r.present.is_none());
        if whole { Ok(()) } else { Err(NoDelay::new(Outcome::NotApplicable, why)) }
    }

    /// The same, where a mask that marks every sample as measured is allowed.
    pub(super) fn measured_throughout(&self, why: &'static str) -> Result<(), NoDelay> {
        let gap = |r: &Record| r.present.as_ref().is_some_and(|p| p.contains(&false));
        let gaps = self.records.iter().any(gap);
        if gaps { Err(NoDelay::new(Outcome::NotApplicable, why)) } else { Ok(()) }
    }

    /// The first `most` samples of every record; a note says so where one is longer.
    pub(super) fn heads(&self, most: usize) -> (Vec<Record<'a>>, Option<String>) {
        let got = self.experiment.longest();
        let cut = self.records.iter().any(|r| r.len() > most);
        let note = cut.then(|| format!("used the first {most} of {got} samples"));
        (self.records.iter().map(|r| r.head(most)).collect(), note)
    }

    /// The same with other records.
    pub(super) fn with<'b>(&self, records: &'b [Record<'b>]) -> PairRecords<'b>
    where
        'a: 'b,
    {
        PairRecords { records, ..*self }
    }

    /// The estimate of a method in samples: raw value, standard deviation and interval.
    pub(super) fn counted(&self, raw: f64, std: f64, interval: [f64; 2]) -> DelayEstimate {
        self.counted_at(raw, std, interval, raw == self.max_delay as f64)
    }

    /// The most probable delay, at the response's first coefficient.
    pub(super) fn most_probable(&self, posterior: &Posterior) -> DelayEstimate {
        let interval = posterior.first_coefficient(self.bias);
        self.counted(posterior.best as f64, posterior.std, interval)
    }

    /// The same, for a method that itself decides whether its estimate is at the edge of the window.
    pub(super) fn counted_at(
        &self,
        raw: f64,
        std: f64,
        interval: [f64; 2],
        at_edge: bool,
    ) -> DelayEstimate {
        self.measured(raw, std, interval, at_edge, self.bias as f64)
    }

    /// The same, for a bias `off` that may be a fraction of a sample.
    pub(super) fn measured(
        &self,
        raw: f64,
        std: f64,
        interval: [f64; 2],
        at_edge: bool,
        off: f64,
    ) -> DelayEstimate {
        let sample_time = self.experiment.sample_time();
        DelayEstimate::measured(raw, std, interval, at_edge, off, sample_time)
    }

    /// Refuses a standard deviation, samples, at or above that of a uniform delay over the window.
    pub(super) fn narrows(&self, std: f64) -> Result<(), NoDelay> {
        if std <= (self.max_delay as f64).max(1.0) / 12.0_f64.sqrt() {
            return Ok(());
        }
        let note = format!(
            "a standard deviation of {std:.1} samples says no more than the search window does"
        );
        Err(NoDelay::new(Outcome::Flat, note))
    }

    /// `samples` in seconds.
    pub(super) fn seconds(&self, samples: f64) -> f64 {
        self.experiment.sample_time().to_seconds(samples)
    }
}

/// Refuses records of fewer than `needed` samples.
pub(super) fn long_enough(
    method: &'static str,
    needed: usize,
    got: usize,
    remedy: LengthRemedy,
) -> Result<(), DelayError> {
    if got < needed { Err(DelayError::TooShort { method, needed, got, remedy }) } else { Ok(()) }
}

/// The estimate, with or without a delay, with an added note.
pub(super) fn noted(
    answer: Result<DelayEstimate, NoDelay>,
    note: Option<String>,
) -> Result<DelayEstimate, NoDelay> {
    Ok(answer.or_else(NoDelay::answered)?.noting(note))
}

/// Fails with the given reason where the output does not visibly follow the input.
pub(super) fn seen(unseen: Option<String>) -> Result<(), NoDelay> {
    unseen.map_or(Ok(()), |note| Err(NoDelay::new(Outcome::NotVisible, note)))
}

/// Refuses options out of their ranges; each has a name, a value, whether it is valid, and the valid range.
pub(super) fn options<const N: usize>(
    method: &'static str,
    options: [(&'static str, f64, bool, &'static str); N],
) -> Result<(), DelayError> {
    match options.into_iter().find(|(_, _, ok, _)| !ok) {
        Some((option, value, _, allowed)) => {
            Err(DelayError::Option { method, option, value, allowed })
        }
        None => Ok(()),
    }
}

/// The finite impulse response with this number of coefficients.
pub(super) fn impulse_response(records: &[Record<'_>], taps: usize) -> Result<Fir, NoDelay> {
    fir_or_rank(records, taps).map_err(|found| {
        let (rank, columns) = (found.rank, found.columns);
        let note = format!("the input excites only {rank} of {columns} coefficients");
        NoDelay::new(Outcome::NotRichEnough, note)
    })
}

/// The estimate of a method. Data that a method cannot use give an outcome; invalid options and cancellation are errors.
pub(super) fn usable(
    answer: Result<DelayEstimate, DelayError>,
) -> Result<DelayEstimate, DelayError> {
    answer.or_else(|e| match e {
        DelayError::Option { .. } | DelayError::Stopped => Err(e),
        e => Ok(DelayEstimate::without(Outcome::NotApplicable, e.message())),
    })
}

/// A method for one input and one output at a time.
pub(super) trait PairMethod: Send + Sync {
    /// Refuses options out of their ranges.
    fn check(&self) -> Result<(), DelayError> {
        Ok(())
    }

    /// The delay of one pair.
    fn pair(&self, pair: &PairRecords<'_>) -> Result<DelayEstimate, NoDelay>;
}

impl<M: PairMethod> DelayEstimator for M {
    fn estimate(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        self.check()?;
        one_pair(experiment, search, |pair| self.pair(pair))
    }
}

/// Runs `method` on the records of the first pair; doubles the window once where the estimate is the longest delay.
pub(super) fn one_pair(
    experiment: &Experiment<'_>,
    search: &Search,
    method: impl Fn(&PairRecords<'_>) -> Result<DelayEstimate, NoDelay>,
) -> Result<DelayEstimate, DelayError> {
    search.go_on()?;
    let (skip, logged) = (search.skip(), experiment.pair(0, 0)?);
    let records: Vec<Record<'_>> = logged.iter().map(|r| r.ahead(skip)).collect();
    let (bias, stop, scans) = (search.bias(0, 0), &search.stop, &search.scans);
    let within = |longest: usize| {
        let max_delay = longest - skip;
        let pair = PairRecords { records: &records, max_delay, bias, experiment, stop, scans };
        method(&pair).or_else(NoDelay::answered)
    };
    let mut estimate = within(search.max_delay)?;
    search.go_on()?;
    if estimate.outcome == Outcome::AtEdge
        // A record too short for the wider window keeps the estimate at the edge of the narrow one.
        && let Ok(wider) = within(2 * search.max_delay)
    {
        estimate = wider;
    }
    search.go_on()?;
    Ok(estimate.finished(experiment.sample_time().to_seconds(skip as f64)))
}

/// Runs `method` on all inputs of the first output together, pair by pair. The window doubles once where an estimate is the longest delay.
pub(super) fn joint_inputs(
    experiment: &Experiment<'_>,
    search: &Search,
    method: impl Fn(&[PairRecords<'_>]) -> Result<Vec<DelayEstimate>, DelayError>,
) -> Result<Vec<DelayEstimate>, DelayError> {
    search.go_on()?;
    let (skip, stop, scans) = (search.skip(), &search.stop, &search.scans);
    let logged = (0..experiment.inputs().len())
        .map(|input| experiment.pair(input, 0))
        .collect::<Result<Vec<_>, _>>()?;
    let inputs: Vec<Vec<Record<'_>>> =
        logged.iter().map(|records| records.iter().map(|r| r.ahead(skip)).collect()).collect();
    let within = |longest: usize| {
        let max_delay = longest - skip;
        let pairs: Vec<PairRecords<'_>> = (inputs.iter().enumerate())
            .map(|(input, records)| {
                let bias = search.bias(input, 0);
                PairRecords { records, max_delay, bias, experiment, stop, scans }
            })
            .collect();
        method(&pairs)
    };
    let mut estimates = within(search.max_delay)?;
    search.go_on()?;
    if estimates.iter().any(|e| e.outcome == Outcome::AtEdge)
        && let Ok(wider) = within(2 * search.max_delay)
    {
        estimates = wider;
    }
    search.go_on()?;
    let moved_s = experiment.sample_time().to_seconds(skip as f64);
    Ok(estimates.into_iter().map(|e| e.finished(moved_s)).collect())
}

/// The first of the estimates of all inputs.
pub(super) fn first_of(all: Vec<DelayEstimate>) -> Result<DelayEstimate, DelayError> {
    all.into_iter().next().ok_or(DelayError::Count { what: "inputs", needed: 1, got: 0 })
}

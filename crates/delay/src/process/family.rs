//! Continuous models of low order with a real-valued dead time: P1D to P3DZ.
//!
//! Equation: (τ̂, θ̂) = argmin Σ (y(t) − ŷ(t))², ŷ = K·(1 + T_z·s)/D(s)·e^(−τs)·u sampled. u is held between its samples; D has one to three poles (see
//! `chain`).

use super::chain::Shape;
use super::fit::{Found, Place, Problem};
use super::reach::reach;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Misfit, Outcome};
use crate::estimator::{
    DelayEstimator, NoDelay, PairRecords, Search, first_of, joint_inputs, one_pair, options,
};
use crate::experiment::Experiment;
use crate::method::{
    Condition, Information, Law, Method, ReferenceExperiment, Start, WHOLE, method_line,
};
use crate::parametric::arxstruc::Others;
use crate::posterior;
use deadtime_identify::{Initial, Record};
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::stats::students_t;
use deadtime_signal::stop::Stop;

/// The allowed poles of a process model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Poles {
    /// Real poles: overshoot only through the zero.
    #[default]
    Real,
    /// Two of two or three poles may be a complex pair.
    Any,
}

/// The options of a process model: one to three poles, with or without a zero, and a real-valued dead time.
///
/// Inputs: u, held between its samples, and y on one even grid; several records share one model. Further inputs are fitted jointly (`others`). Output: seconds,
/// positive = y lags u. The model contains the hold's own sample: no bias is subtracted from the estimate, for any assumed degree bias.
///
/// Assumes: a stable plant of this order in open loop; noise uncorrelated with the input; a record that starts at rest (or `initial: estimated`).
/// Resolution and cost: a fraction of a sample, down to the Cramér-Rao bound. About 100 filter passes over the records, for any search window. One pass per row
/// of a table of poles ranks the whole samples; a dozen descents start at the best.
/// Interval: the likelihood-ratio interval at 95 %, with gain, zero, poles and initial state refitted at every delay. Coloured residuals count as fewer
/// samples; other minima of nearly equal likelihood widen it. Where a gain alone is equally likely, no time constant is visible. The plant settles within a
/// sample, and the interval covers all delays within that sample.
/// Fails when: the plant has more poles than the model: the estimate is late by about the omitted time constants, outside its interval. A note reports a
/// residual that still follows the input. With fewer poles in the plant, gain, poles and delay are confounded, and intervals are wide. With a zero, a slow pole
/// nearly cancelled by it may follow slow noise. An integrating or unstable plant gives `not_converged`. Feedback biases the estimate. An interpolated instead
/// of a held input biases the delay early by half a sample.
/// Source: MATLAB `procest`, idproc models P1D to P3DZ, for the models. Björklund (2003), LiU-TEK-LIC-2003:60, section 6.2 (idproc6 and 7) and p. 47 (one
/// minimum per sampling interval). For fractional delays fitted with the poles Chen, Garnier and Gilson (2015), J. Process Control 25, 19-27,
/// doi:10.1016/j.jprocont.2014.10.001. The sources do not state how `procest` starts and bounds its search. Here no start is needed, and a time constant may
/// reach the length of the records.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, P1d, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(300, &mut ChaCha8Rng::seed_from_u64(1))?;
/// // dy/dt = u(t − 0.43 s) − y, every 0.1 s: of the two inputs that act within a sample the old one does for 0.03 s.
/// let (old, new) = ((-0.07_f64).exp() - (-0.1_f64).exp(), 1.0 - (-0.07_f64).exp());
/// let mut y = vec![0.0; 300];
/// for t in 5..300 {
///     y[t] = (-0.1_f64).exp() * y[t - 1] + new * u[t - 5] + if t > 5 { old * u[t - 6] } else { 0.0 };
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = P1d::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.43).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Process {
    /// The allowed poles; default real ones. A single pole is always real.
    pub poles: Poles,
    /// The initial state of a record; default at rest. `estimated` leaves out the samples that the longest delay needs before the first.
    pub initial: Initial,
    /// An additional initial delay, s; default none. The search covers the whole window, so only the run time changes.
    pub initial_delay_s: Option<f64>,
    /// Longest part of a record that is used, samples; default 50 000.
    pub max_samples: usize,
    /// The role of further inputs: regressors (default) or noise. A regressor has its own gain, zero and delay. The poles are common, or its own where the data
    /// support them. A model of one pole and a zero fits one input at a time.
    pub others: Others,
}

impl Default for Process {
    fn default() -> Self {
        Self {
            poles: Poles::Real,
            initial: Initial::Zero,
            initial_delay_s: None,
            max_samples: 50_000,
            others: Others::Regressors,
        }
    }
}

/// The methods, one a line: type, line in the list, name, summary, poles, zero. Then tolerance, conditions that it withstands, exempt laws, and the fitted
/// model.
macro_rules! process {
    ($($type:ident, $line:ident, $name:literal, $summary:literal, $poles:literal, $zero:literal, $tolerance:expr, $withstands:expr, $exempt:expr, $model:literal;)+) => {$(
        #[doc = $model]
        #[doc = "\n\nOptions, assumptions and failures as [`Process`] has them."]
        #[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
        #[serde(transparent)]
        pub struct $type(pub Process);

        #[doc = $model]
        pub(crate) const $line: Method = Method {
            start: Start::Rest,
            reference: ReferenceExperiment::Process { poles: $poles, zero: $zero },
            information: Information::Poles($poles),
            tolerance: $tolerance,
            withstands: $withstands,
            needs: "open loop, a held input, a stable plant of its order that rests at the start",
            blind_to: "poles beyond its own: it takes their lag for dead time; what an unstable plant or feedback does",
            exempt: $exempt,
            ..method_line!($name, $summary, $type, Process)
        };

        impl DelayEstimator for $type {
            fn estimate(&self, experiment: &Experiment, search: &Search) -> Result<DelayEstimate, DelayError> {
                self.0.run($name, Shape { poles: $poles, zero: $zero }, experiment, search)
            }

            fn is_joint(&self) -> bool {
                self.0.others == Others::Regressors && !Shape { poles: $poles, zero: $zero }.whole()
            }
        }
    )+};
}

pub(super) const LAG: &[Condition] =
    &[Condition::ColouredNoise, Condition::MissingOutputs, Condition::OtherInputs];

/// One pole and a zero: one input at a time.
pub(super) const LAG_WITH_ZERO: &[Condition] =
    &[Condition::ColouredNoise, Condition::MissingOutputs];

pub(super) const LAGS: &[Condition] = &[
    Condition::ColouredNoise,
    Condition::Dynamics,
    Condition::MissingOutputs,
    Condition::OtherInputs,
];

pub(super) const CONTINUOUS: &[(Law, &str)] = &[INEXACT];

pub(super) const INEXACT: (Law, &str) = (
    Law::Exact,
    "exact for continuous plants of its order behind a hold, not for any sampled plant",
);

pub(super) const NEARLY_FLAT: &[(Law, &str)] = &[
    INEXACT,
    (
        Law::Gain,
        "on plants without its zero or second pole delays within one sample fit alike, and rounding chooses among them",
    ),
];

pub(super) const SECOND_POLE: &[(Law, &str)] = &[
    INEXACT,
    (
        Law::Gain,
        "where the plant has one pole the likelihood ends in a cliff on 1 record of 1500, and rounding moves that end of the interval",
    ),
];

pub(super) const THIRD_POLE: &[(Law, &str)] = &[
    INEXACT,
    (
        Law::Gain,
        "on plants of fewer poles the likelihood is flat along its third, and rounding moves the interval's ends by some per cent",
    ),
];

pub(super) const OVERSIZED: &[(Law, &str)] = &[
    INEXACT,
    (
        Law::Gain,
        "on a plant of fewer poles one of its poles and the zero all but cancel anywhere, and rounding moves the interval's ends",
    ),
    (
        Law::Shift,
        "on plants of one pole 17 of 100 answers moved by another number of samples, as pole and zero cancelled elsewhere",
    ),
];

/// A slow pole nearly cancelled by a zero can follow slow noise.
pub(super) const WITH_ZERO: &[Condition] = &[
    Condition::Dynamics,
    Condition::MissingOutputs,
    Condition::OtherInputs,
    Condition::InverseResponse,
];

process! {
    P1d, P1D, "p1d", "continuous model of one pole, fractional dead time",
        1, false, 0.1, LAG, CONTINUOUS, "K/(1 + T₁s)·e^(−τs).";
    P2d, P2D, "p2d", "continuous model of two poles, fractional dead time: the finest answer on open-loop data",
        2, false, 0.1, LAGS, SECOND_POLE, "K/((1 + T₁s)(1 + T₂s))·e^(−τs).";
    P3d, P3D, "p3d", "continuous model of three poles, fractional dead time",
        3, false, 0.1, LAGS, THIRD_POLE, "K/((1 + T₁s)(1 + T₂s)(1 + T₃s))·e^(−τs).";
    P1dz, P1DZ, "p1dz", "continuous model of one pole and a zero (a direct path), fractional dead time",
        1, true, WHOLE, LAG_WITH_ZERO, CONTINUOUS, "K(1 + T_z·s)/(1 + T₁s)·e^(−τs).";
    P2dz, P2DZ, "p2dz", "continuous model of two poles and a zero, fractional dead time",
        2, true, 1.0, WITH_ZERO, NEARLY_FLAT, "K(1 + T_z·s)/((1 + T₁s)(1 + T₂s))·e^(−τs).";
    P3dz, P3DZ, "p3dz", "continuous model of three poles and a zero, fractional dead time",
        3, true, 1.0, WITH_ZERO, OVERSIZED, "K(1 + T_z·s)/((1 + T₁s)(1 + T₂s)(1 + T₃s))·e^(−τs).";
}

impl Process {
    fn run(
        &self,
        method: &'static str,
        shape: Shape,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        let first = self.initial_delay_s;
        let first_ok = first.is_none_or(|v| v.is_finite() && v >= 0.0);
        let rows = [
            ("max_samples", self.max_samples as f64, self.max_samples >= 1, "1 or more"),
            ("initial_delay_s", first.unwrap_or_default(), first_ok, "0 or more"),
        ];
        options(method, rows)?;
        // Raw delays include the sample of the hold; this model contains it.
        let search = Search { min_delay: search.min_delay.saturating_sub(1), ..search.clone() };
        if self.others == Others::Regressors && !shape.whole() && experiment.inputs().len() > 1 {
            return first_of(joint_inputs(experiment, &search, |pairs| {
                let Some((first, others)) = pairs.split_first() else { return Ok(Vec::new()) };
                let answer = self.pair(method, shape, first, others);
                Ok(vec![answer.or_else(NoDelay::answered)?])
            })?);
        }
        one_pair(experiment, &search, |pair| self.pair(method, shape, pair, &[]))
    }

    /// The delay of one input, given the others.
    fn pair(
        &self,
        method: &'static str,
        shape: Shape,
        pair: &PairRecords,
        others: &[PairRecords],
    ) -> Result<DelayEstimate, NoDelay> {
        let max_delay = pair.max_delay;
        let start = if self.initial == Initial::Estimated { shape.poles } else { 0 };
        let parameters = shape.denominator() + (shape.numerator() + 1) * (1 + others.len()) + start;
        pair.at_least(method, max_delay + 3 * parameters, LengthRemedy::Window)?;
        let records = pair.heads(self.max_samples).0;
        let others: Vec<Vec<Record>> = others.iter().map(|o| o.heads(self.max_samples).0).collect();
        let real = self.poles == Poles::Real;
        let problem =
            Problem::together(shape, real, self.initial, &records, &others, max_delay, pair.stop);
        let initial = self.initial_delay_s.map(|s| s / pair.experiment.sample_time().seconds());
        let fitted = self.visible(Fitted::of(problem, initial)?, shape, max_delay)?;
        let (fitted, own) = fitted.poles_of_others(&records, max_delay, initial, others.len())?;
        let fitted = fitted.seen_poles(initial)?;
        let (estimate, left) = fitted.answer(pair, &records)?;
        let got = pair.experiment.longest();
        let used = (got > self.max_samples)
            .then(|| format!("used the first {} of {got} samples", self.max_samples));
        Ok(estimate.noting(own).noting(used).contradicted(left))
    }

    /// The fitted model; an error where it is not significant.
    pub(super) fn visible<'a>(
        &self,
        fitted: Fitted<'a>,
        shape: Shape,
        max_delay: usize,
    ) -> Result<Fitted<'a>, DelayEstimate> {
        let Fitted { problem, best, knowledge, .. } = &fitted;
        let gain = knowledge.counting * (problem.without / knowledge.floored(best.cost)).ln();
        // A pair of poles may converge to any of N/2 frequencies, where the delay is only a phase; this adds to the number of tests.
        let resonances = if self.poles == Poles::Any && shape.poles > 1 {
            (knowledge.counting / 2.0) as usize
        } else {
            0
        };
        if gain.is_nan()
            || gain < posterior::visible_gain(problem.added(), max_delay + 1 + resonances)
        {
            let note = format!(
                "no model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input"
            );
            return Err(DelayEstimate::without(Outcome::NotVisible, note));
        }
        Ok(fitted)
    }
}

/// A problem with its local minima, the lowest of them, and the information there.
pub(super) struct Fitted<'a> {
    pub(super) problem: Problem<'a>,
    pub(super) minima: Vec<Found>,
    pub(super) best: Found,
    pub(super) knowledge: Knowledge,
}

impl<'a> Fitted<'a> {
    /// The delay with its interval, and any contradiction of the model.
    fn answer(
        self,
        pair: &PairRecords,
        records: &[Record],
    ) -> Result<(DelayEstimate, Option<String>), NoDelay> {
        let Self { problem, minima, best, knowledge } = self.centred();
        let [from, to] = knowledge.interval(&problem, &best, &minima);
        let delay = best.place.delay();
        let longest = pair.max_delay as f64;
        if to - from > 0.5 * longest {
            let note = format!("delays from {from:.1} to {to:.1} samples fit equally well");
            return Err(NoDelay::new(Outcome::Flat, note));
        }
        let std = ((delay - from).max(to - delay) / knowledge.quantile).max(RESOLVED);
        let estimate = pair.measured(delay, std, [from, to], delay >= longest - EDGE, 0.0);
        let misfit = Misfit {
            log_cost: knowledge.floored(best.cost).ln(),
            counting: knowledge.counting,
            parameters: problem.added(),
        };
        let left = knowledge.leaves(records, pair.max_delay).then(|| {
            "what the model leaves over still follows the input: a plant of another shape, whose lag may be in the dead time".to_owned()
        });
        Ok((DelayEstimate { misfit: Some(Box::new(misfit)), ..estimate }, left))
    }

    /// The same at the centre of the delays of equal cost.
    pub(super) fn centred(self) -> Self {
        let Self { problem, minima, best, knowledge } = self;
        let best = if problem.whole() { best } else { knowledge.middle(&problem, best) };
        Self { problem, minima, best, knowledge }
    }

    /// The first fit, or the reason why it fails.
    pub(super) fn of(problem: Problem<'a>, initial: Option<f64>) -> Result<Self, DelayEstimate> {
        let minima = problem.minima(initial);
        let Some(best) = minima.first().map(|m| problem.refine(m)).filter(|m| m.cost.is_finite())
        else {
            let note = "the input is zero wherever a model could use it, or the numbers overflow";
            return Err(DelayEstimate::without(Outcome::NotRichEnough, note));
        };
        Self::at(problem, minima, best)
    }

    /// The information at a local minimum.
    fn at(problem: Problem<'a>, minima: Vec<Found>, best: Found) -> Result<Self, DelayEstimate> {
        match Knowledge::of(&problem, &best) {
            Some(knowledge) => Ok(Self { problem, minima, best, knowledge }),
            None => Err(singular()),
        }
    }

    /// The fit with other inputs, with poles of their own where the data support them, and the choice in words.
    fn poles_of_others(
        self,
        records: &[Record],
        max_delay: usize,
        initial: Option<f64>,
        others: usize,
    ) -> Result<(Self, Option<String>), DelayEstimate> {
        let Some(apart) = self.problem.apart() else { return Ok((self, None)) };
        let said =
            |poles: &str| Some(format!("fitted together with {} of {poles}", inputs(others)));
        let Self { problem, best, knowledge, .. } = &self;
        let more = knowledge.counting * (best.cost / knowledge.floored(apart)).ln();
        // The residual of common poles may be so slow that few of its samples are independent.
        if more > posterior::visible_gain(problem.apart_adds(), 1)
            || (more > 0.0 && knowledge.leaves(records, max_delay))
        {
            let problem = problem.behind_others();
            let minima = problem.minima(initial);
            let refined = minima.first().map(|m| problem.refine(m)).ok_or_else(singular)?;
            return Ok((Self::at(problem, minima, refined)?, said("poles of their own")));
        }
        Ok((self, said("the same poles")))
    }

    /// Where a pole is as slow as the record: the model without it, if that is not significantly worse. A pole nearly cancelled by a zero may grow as slow as
    /// the record and follow its drift. A plant that integrates needs such a pole.
    pub(super) fn seen_poles(self, initial: Option<f64>) -> Result<Self, DelayEstimate> {
        if !self.problem.integrates(&self.best.theta) {
            return Ok(self);
        }
        let needed = posterior::visible_gain(2, 1);
        let problem = self.problem.of_seen_poles();
        let minima = problem.minima(initial);
        match minima
            .first()
            .map(|m| problem.refine(m))
            .filter(|m| self.knowledge.lacks(m.cost) < needed)
        {
            Some(seen) => Self::at(problem, minima, seen),
            None => {
                let note = "the best model's time constant is as long as the record: an integrating or unstable plant, or feedback";
                Err(DelayEstimate::without(Outcome::NotConverged, note))
            }
        }
    }
}

pub(super) fn singular() -> DelayEstimate {
    DelayEstimate::without(
        Outcome::Singular,
        "the model cannot be evaluated at its own minimum; scale the channels",
    )
}

/// `one other input`, `3 other inputs`.
pub(super) fn inputs(others: usize) -> String {
    if others == 1 { "one other input".to_owned() } else { format!("{others} other inputs") }
}

/// A model of given order, fitted quickly: the source of the predicted information on a delay before any method runs.
pub(crate) struct Rough {
    /// The delay of the model, samples.
    pub(crate) delay: f64,
    /// ŷ.
    pub(crate) model: Vec<f64>,
    /// y − ŷ.
    pub(crate) residual: Vec<f64>,
    /// ∂ŷ/∂L per sample except for its sign, with all other parameters known.
    pub(crate) slope: Vec<f64>,
    /// Its component orthogonal to the derivatives by gain and poles.
    pub(crate) alone: Vec<f64>,
    /// The model's response to a pulse of one sample.
    pub(crate) impulse: Vec<f64>,
    /// Σ y².
    pub(crate) power: f64,
    /// Samples used.
    pub(crate) samples: f64,
    /// Parameters fitted.
    pub(crate) parameters: usize,
}

/// The initial part of the records in a quick fit, samples; the information is then summed over the whole records.
pub(crate) const ROUGH_SAMPLES: usize = 4000;

/// The quick fit; `None` without usable data.
pub(crate) fn rough(
    records: &[Record],
    poles: usize,
    max_delay: usize,
    taps: usize,
) -> Option<Rough> {
    let shape = Shape { poles: poles.clamp(1, 3), zero: false };
    let heads: Vec<Record> = records.iter().map(|r| r.head(ROUGH_SAMPLES)).collect();
    let stop = Stop::default();
    let start = Problem::new(shape, false, Initial::Zero, &heads, max_delay, &stop)
        .minima(None)
        .into_iter()
        .next()?;
    let problem = Problem::new(shape, false, Initial::Zero, records, max_delay, &stop);
    let signals = problem.signals(&start.theta, start.place)?;
    let alone = signals.alone()?;
    Some(Rough {
        delay: start.place.delay(),
        slope: signals.by_delay().to_vec(),
        impulse: problem.impulse(&start.theta, start.place, &signals, taps),
        power: problem.power,
        samples: problem.samples,
        parameters: problem.parameters(),
        alone,
        model: signals.model,
        residual: signals.residual,
    })
}

/// Lower bound of the standard deviation, samples: rounding and the optimiser's tolerance.
pub(super) const RESOLVED: f64 = 1e-6;

/// An estimate within this distance of the longest delay, samples, is at the edge.
pub(super) const EDGE: f64 = 1e-3;

/// The information at the minimum.
pub(super) struct Knowledge {
    /// Independent samples behind the model as a whole.
    pub(super) counting: f64,
    /// Independent samples behind the delay.
    independent: f64,
    /// Standard deviation of the delay by the curvature at the minimum, samples.
    std: f64,
    /// Student's 97.5 % point.
    quantile: f64,
    /// Smallest Σ e² that is not rounding.
    floor: f64,
    /// Σ e² of the best.
    cost: f64,
    /// y − ŷ, all records in a row.
    pub(super) residual: Vec<f64>,
}

impl Knowledge {
    fn of(problem: &Problem<'_>, best: &Found) -> Option<Self> {
        let signals = problem.signals(&best.theta, best.place)?;
        let alone = signals.alone()?;
        let floor = posterior::ROUNDING * problem.power;
        let exact = best.cost <= floor;
        let under = |signal: &[f64]| {
            let n = problem.samples;
            if exact {
                n
            } else {
                n * posterior::samples_under(signal, &signals.residual) / signal.len().max(1) as f64
            }
        };
        let counting = under(&signals.model);
        // With whole-sample delays the derivative by the delay does not exist.
        let independent = if problem.whole() { counting } else { under(&alone) };
        let freedom = (independent - problem.parameters() as f64).max(1.0);
        let energy: f64 = alone.iter().map(|v| v * v).sum();
        let quantile = students_t(0.975, freedom).unwrap_or(NORMAL_95);
        let std = (best.cost.max(floor) / freedom / energy.max(f64::MIN_POSITIVE)).sqrt();
        Some(Self {
            counting,
            independent: freedom,
            std,
            quantile,
            floor,
            cost: best.cost,
            residual: signals.residual,
        })
    }

    /// The residuals follow the input significantly, beyond rounding.
    pub(super) fn leaves(&self, records: &[Record], max_delay: usize) -> bool {
        let mut from = 0;
        let left: Vec<Record> = records
            .iter()
            .map(|r| {
                let y = self.residual.iter().skip(from).take(r.len()).copied().collect();
                from += r.len();
                Record { u: r.u.clone(), y, present: r.present.clone() }
            })
            .collect();
        self.cost > self.floor && posterior::unseen(&left, max_delay).is_none()
    }

    pub(super) fn floored(&self, cost: f64) -> f64 {
        cost.max(self.floor).max(f64::MIN_POSITIVE)
    }

    /// Deficit of twice the log-likelihood at a cost.
    fn lacks(&self, cost: f64) -> f64 {
        self.independent * (self.floored(cost) / self.floored(self.cost)).ln()
    }

    /// The same relative to its 95 % quantile by chance.
    fn unlikely(&self, cost: f64) -> f64 {
        self.lacks(cost) / (self.quantile * self.quantile)
    }

    /// The centre of the delays of equal cost. A pole that decays before the next sample only adds to the dead time. A plant that settles within a sample is
    /// visible in that sample only. Whole ranges of delays then have one cost, and rounding would select among them.
    pub(super) fn middle(&self, problem: &Problem<'_>, best: Found) -> Found {
        if let Some((lag, cost)) = problem
            .settled(best.place.delay())
            .filter(|s| s.0 > 0 && self.unlikely(s.1) <= ALIKE * ALIKE)
        {
            return Found { place: Place { lag, g: 0.5 }, cost, ..best };
        }
        let [before, after] =
            [-1.0, 1.0].map(|direction| self.reach(problem, &best, direction, ALIKE));
        let place = Place::of(best.place.delay() + 0.5 * (after - before));
        problem
            .at(&best.theta, place)
            .filter(|f| self.unlikely(f.cost) <= ALIKE * ALIKE)
            .unwrap_or(best)
    }

    /// The delays within the likelihood-ratio limit, first and last, samples.
    pub(super) fn interval(
        &self,
        problem: &Problem<'_>,
        best: &Found,
        minima: &[Found],
    ) -> [f64; 2] {
        let mut ends = [best.place.delay(); 2];
        let as_good = minima.iter().filter(|m| {
            (m.place.delay() - best.place.delay()).abs() > 0.25 && self.unlikely(m.cost) < 1.0
        });
        for minimum in [best].into_iter().chain(as_good) {
            let at = minimum.place.delay();
            ends[0] = ends[0].min(at - self.reach(problem, minimum, -1.0, 1.0));
            ends[1] = ends[1].max(at + self.reach(problem, minimum, 1.0, 1.0));
        }
        if problem.whole() {
            // The jump occurred at any time since the previous sample.
            ends[0] = (ends[0] - 1.0).max(0.0);
        } else if let Some((lag, _)) =
            problem.settled(best.place.delay()).filter(|s| s.0 > 0 && self.unlikely(s.1) < 1.0)
        {
            // No time constant is visible: the same for a plant that settles within the sample.
            let lag = lag as f64;
            ends = [ends[0].min(lag - 1.0), ends[1].max(lag)];
        }
        ends
    }

    /// The distance from a minimum in one direction at which the delay lacks the share `level` of the interval's likelihood.
    fn reach(&self, problem: &Problem<'_>, from: &Found, direction: f64, level: f64) -> f64 {
        let at = from.place.delay();
        let limit = if direction > 0.0 { problem.longest() - at } else { at };
        let root = |cost: f64| self.unlikely(cost).max(0.0).sqrt() / level;
        if problem.whole() {
            let mut step = 0.0;
            let likely = |step: f64| {
                problem
                    .afresh(&from.theta, Place::of(at + direction * step))
                    .is_some_and(|f| root(f.cost) < 1.0)
            };
            while step < limit && likely(step + 1.0) {
                step += 1.0;
            }
            return step;
        }
        let first = (level * self.quantile * self.std).clamp(RESOLVED, 0.5);
        let mut theta = from.theta.clone();
        reach(root(from.cost), first, limit, |step| {
            let found = problem.at(&theta, Place::of(at + direction * step))?;
            let here = root(found.cost);
            if here < 1.0 {
                theta = found.theta;
            }
            Some(here)
        })
    }
}

/// Share of the interval's likelihood deficit, as its root, that counts as zero: 1e-3 of a standard deviation.
const ALIKE: f64 = 1e-3;

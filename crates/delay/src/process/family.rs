//! Continuous models of low order whose dead time is a real number: P1D to P3DZ.
//!
//! Equation: (τ̂, θ̂) = argmin Σ (y(t) − ŷ(t))², ŷ = K·(1 + T_z·s)/D(s)·e^(−τs)·u sampled, u held between its samples, D of one to three poles (see `chain`).

use super::chain::Shape;
use super::fit::{Found, Place, Problem};
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

/// Which poles a process model may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Poles {
    /// Real ones: no overshoot but by the zero.
    #[default]
    Real,
    /// Of two or three, two may be a complex pair.
    Any,
}

/// The options of a process model: one to three poles, with a zero or not, and a dead time that need not be whole samples.
///
/// Inputs: u, held between its samples, and y on one even grid; several records share one model. Further inputs are fitted with it (`others`). Output: seconds, positive = y lags u. The hold's own sample is in
/// the model: nothing is taken off the answer, whatever degree bias was assumed.
///
/// Assumes: a stable plant of this order in open loop, noise that is not correlated with the input, a record that starts at rest (or `initial: estimated`).
/// Resolution and cost: a fraction of a sample, down to the Cramér-Rao bound; some hundred filter passes over the records whatever the search window: whole samples
/// are ranked out of one pass for each row of a table of poles, and a dozen descents go on from the best.
/// Interval: the delays whose best model (gain, zero, poles and start fitted anew) is as likely as the best of all but for chance, a likelihood ratio at 95 %; residuals
/// that are not white count as fewer samples; other minima that are nearly as good widen it. Where a gain alone is as likely, no time constant shows: the plant settles
/// within a sample, any delay within that sample fits, and the interval has all of it.
/// Fails when: the plant has more poles than the model (the answer includes their lag: it is late by about the time constants left out, and no
/// interval says so; a note does where the residual still follows the input); it has fewer (gain, poles and delay become confounded: wide intervals; with a
/// zero they are nearly free: under slow noise a slow pole all but cancelled by the zero may follow the noise); it integrates or is unstable (`not_converged`);
/// under feedback (biased); the input does not change from sample to sample as a hold does (an interpolated input looks half a sample early).
/// Source: MATLAB `procest`, idproc models P1D to P3DZ, for the models; Björklund (2003), LiU-TEK-LIC-2003:60, section 6.2 (idproc6 and 7) and p. 47 (one minimum per
/// sampling interval); Chen, Garnier and Gilson (2015), J. Process Control 25, 19-27, doi:10.1016/j.jprocont.2014.10.001, for fractional delays fitted with the poles.
/// What the sources leave unclear: how `procest` starts and bounds its search; here no start is needed, and a time constant may reach the length of the records.
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
    /// Which poles it may have; default real ones. One pole is real in any case.
    pub poles: Poles,
    /// The start of a record; default at rest. `estimated` leaves out the samples that the longest delay needs before the first.
    pub initial: Initial,
    /// A delay to look at besides, s; default none. The search covers the whole window, so it changes nothing but the time taken.
    pub initial_delay_s: Option<f64>,
    /// Longest part of a record that is used, samples; default 50 000.
    pub max_samples: usize,
    /// What further inputs are: regressors (default) or noise. A regressor has a gain, a zero and a delay of its own; the poles are common, or of its own where the data ask for it.
    /// A model of one pole and a zero takes one input at a time.
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

/// The methods, one a line: type, line in the list, name, summary, poles, zero, tolerance, what it
/// withstands, what it is exempt from, and the model that it fits.
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

/// A slow pole next to a zero that all but cancels it can follow slow noise.
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
        // Raw delays count the sample that a hold takes to show; here it is in the model.
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

    /// What was fitted, or that it is no more than chance.
    pub(super) fn visible<'a>(
        &self,
        fitted: Fitted<'a>,
        shape: Shape,
        max_delay: usize,
    ) -> Result<Fitted<'a>, DelayEstimate> {
        let Fitted { problem, best, knowledge, .. } = &fitted;
        let gain = knowledge.counting * (problem.without / knowledge.floored(best.cost)).ln();
        // A pair of poles may settle on any of N/2 frequencies, where the delay is but a phase: these are tries too.
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

/// A problem with its valleys, the bottom of the lowest, and how much the data know there.
pub(super) struct Fitted<'a> {
    pub(super) problem: Problem<'a>,
    pub(super) minima: Vec<Found>,
    pub(super) best: Found,
    pub(super) knowledge: Knowledge,
}

impl<'a> Fitted<'a> {
    /// The delay with its interval, and what contradicts the model, if anything does.
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

    /// The same in the middle of the delays that fit alike.
    pub(super) fn centred(self) -> Self {
        let Self { problem, minima, best, knowledge } = self;
        let best = if problem.whole() { best } else { knowledge.middle(&problem, best) };
        Self { problem, minima, best, knowledge }
    }

    /// The first fit; else what keeps it from being made.
    pub(super) fn of(problem: Problem<'a>, initial: Option<f64>) -> Result<Self, DelayEstimate> {
        let minima = problem.minima(initial);
        let Some(best) = minima.first().map(|m| problem.refine(m)).filter(|m| m.cost.is_finite())
        else {
            let note = "the input is zero wherever a model could use it, or the numbers overflow";
            return Err(DelayEstimate::without(Outcome::NotRichEnough, note));
        };
        Self::at(problem, minima, best)
    }

    /// What the data know at the bottom of a valley.
    fn at(problem: Problem<'a>, minima: Vec<Found>, best: Found) -> Result<Self, DelayEstimate> {
        match Knowledge::of(&problem, &best) {
            Some(knowledge) => Ok(Self { problem, minima, best, knowledge }),
            None => Err(singular()),
        }
    }

    /// Together with other inputs: with poles of their own where the data ask for them, and what was chosen, in words.
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

    /// Where a pole is as slow as the record: without it, if that costs no more than chance. A pole next to a zero that all but cancels it may grow as slow as the record
    /// and follow its drift: two parameters of chance. A plant that integrates needs such a pole.
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

/// A model of some poles, fitted quickly: what a record can know of a delay is read from it before any method runs.
pub(crate) struct Rough {
    /// The delay of the model, samples.
    pub(crate) delay: f64,
    /// ŷ.
    pub(crate) model: Vec<f64>,
    /// y − ŷ.
    pub(crate) residual: Vec<f64>,
    /// ∂ŷ/∂L per sample but for its sign, all else known.
    pub(crate) slope: Vec<f64>,
    /// What of it is no combination of the derivatives by gain and poles.
    pub(crate) alone: Vec<f64>,
    /// The model's answer to a pulse of one sample.
    pub(crate) impulse: Vec<f64>,
    /// Σ y².
    pub(crate) power: f64,
    /// Samples that count.
    pub(crate) samples: f64,
    /// Parameters fitted.
    pub(crate) parameters: usize,
}

/// The start of the records that a quick fit looks at, samples; what the whole records know is then summed over all of them.
pub(crate) const ROUGH_SAMPLES: usize = 4000;

/// The quick fit; `None` where there is nothing to fit.
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

/// Standard deviations below this, samples, are rounding's and the optimiser's.
pub(super) const RESOLVED: f64 = 1e-6;

/// An answer this near to the longest delay, samples, is at the edge.
pub(super) const EDGE: f64 = 1e-3;

/// How much the data know at the minimum.
pub(super) struct Knowledge {
    /// Independent samples behind the model as a whole.
    pub(super) counting: f64,
    /// Independent samples behind the delay.
    independent: f64,
    /// Standard deviation of the delay by the curvature there, samples.
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
        // Where whole samples are all that shows there is no derivative by the delay.
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

    /// The residuals visibly follow the input, beyond rounding.
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

    /// Twice the log-likelihood that a cost lacks.
    fn lacks(&self, cost: f64) -> f64 {
        self.independent * (self.floored(cost) / self.floored(self.cost)).ln()
    }

    /// The same in units of what chance makes of it in one case of twenty.
    fn unlikely(&self, cost: f64) -> f64 {
        self.lacks(cost) / (self.quantile * self.quantile)
    }

    /// The middle of the delays that fit alike. A pole that dies away before the next sample only adds to the dead time. A plant that settles within a sample
    /// shows no more than that sample. Whole ranges of delays then have one cost, among which rounding would choose.
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

    /// The delays that are as likely as the best, from first to last, samples.
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
            // The jump came at any time since the sample before.
            ends[0] = (ends[0] - 1.0).max(0.0);
        } else if let Some((lag, _)) =
            problem.settled(best.place.delay()).filter(|s| s.0 > 0 && self.unlikely(s.1) < 1.0)
        {
            // No time constant shows: the same of a plant that settles within the sample.
            let lag = lag as f64;
            ends = [ends[0].min(lag - 1.0), ends[1].max(lag)];
        }
        ends
    }

    /// How far from a minimum the delay may move in one direction until it lacks likelihood, in a share `level` of the interval's: false position on the root of the
    /// likelihood ratio, which is a straight line where the cost is a parabola, and halving where it is not.
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
        let (mut inner, mut outer) = ((0.0, root(from.cost)), None::<(f64, f64)>);
        let mut theta = from.theta.clone();
        let mut step = (level * self.quantile * self.std).clamp(RESOLVED, 0.5).min(limit);
        let mut widths = [f64::INFINITY; 2];
        for _ in 0..REACHES {
            let Some(found) = problem.at(&theta, Place::of(at + direction * step)) else { break };
            let here = (step, root(found.cost));
            if here.1 < 1.0 {
                if step >= limit {
                    return limit;
                }
                inner = here;
                theta = found.theta;
            } else {
                outer = Some(here);
            }
            step = match outer {
                None => (step * (1.1 / here.1.max(0.1)).clamp(1.2, 2.5)).min(limit),
                Some(outer) => {
                    let (width, share) = (
                        outer.0 - inner.0,
                        (1.0 - inner.1) / (outer.1 - inner.1).max(f64::MIN_POSITIVE),
                    );
                    if width <= ENDS * outer.0 {
                        return inner.0 + share * width;
                    }
                    let slow = width > 0.5 * widths[0];
                    widths = [widths[1], width];
                    // To either side of the crossing in turn, so that the bracket closes from both.
                    let shift = if here.1 < 1.0 { 1e-3 } else { -1e-3 };
                    inner.0 + if slow { 0.5 } else { (share + shift).clamp(0.02, 0.98) } * width
                }
            };
        }
        outer.map_or(inner.0, |o| o.0)
    }
}

/// Share of the interval's lack of likelihood, as its root, that is none: a thousandth of a standard deviation.
pub(super) const ALIKE: f64 = 1e-3;

/// Steps towards an end of the interval.
pub(super) const REACHES: usize = 40;

/// To what share of itself the distance to an end is found.
pub(super) const ENDS: f64 = 1e-4;

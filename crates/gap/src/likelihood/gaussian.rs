//! The likelihood that all hypotheses share: predictions, nuisances, whitened residuals.

use std::sync::Arc;

use nalgebra::{Const, DMatrix, DVector, Dyn};

use super::active_effects::{ActiveEffects, NO_EFFECT};
use super::log_start::{log_start, rests};
use super::nuisances::{Common, Nuisances, Responses};
use super::simulated::{Key, Simulated};
use crate::baseline::feedback;
use crate::baseline::noise::Noise;
use crate::baseline::predictor::Predictor;
use crate::format::error::GapError;
use crate::input::budget::{Allowance, Budget};
use crate::input::criteria::Criteria;
use crate::input::nuisance::Nuisance;
use crate::input::record::{LogRecord, Span};
use deadtime_model::effect::{Applied, Chance, Scales, Site};
use deadtime_model::simulate::{
    Commands, Correction, Plan, SimulateError, System, Term, Tolerance, Wanted,
};
use deadtime_signal::parallel;
use deadtime_signal::stop::Stop;

/// The terms of a likelihood.
pub(crate) struct Terms<'a> {
    pub(crate) system: &'a System,
    pub(crate) records: &'a [LogRecord],
    pub(crate) predictor: &'a Predictor,
    /// Effects that belong to the simulator.
    pub(crate) model_effects: Vec<Applied>,
    /// The constants with a separate value in every log.
    pub(crate) nuisances: &'a [Nuisance],
    /// Prior standard deviations of the start; 0: exactly known.
    pub(crate) prior: Vec<f64>,
    /// Standard deviation of every output's noise.
    pub(crate) noise_std: Vec<f64>,
    /// Per output of a black box, the rounding error.
    pub(crate) resolution: Vec<f64>,
    pub(crate) criteria: Criteria,
    pub(crate) stop: Stop,
}

/// The likelihood of the logs under any active effects. It never changes: another noise or another prior makes a new one.
#[derive(Clone)]
pub(crate) struct Likelihood<'a> {
    pub(crate) system: &'a System,
    pub(crate) records: &'a [LogRecord],
    pub(crate) predictor: &'a Predictor,
    /// The thresholds of the verdict.
    pub(crate) criteria: Criteria,
    /// The budget of a search.
    pub(crate) budget: &'static Budget,
    /// Effects that belong to the simulator.
    model_effects: Vec<Applied>,
    /// The constants that the model file declares with a separate value in every log.
    pub(crate) declared: &'a [Nuisance],
    /// Prior standard deviations of the start; 0: exactly known.
    pub(super) prior: Vec<f64>,
    pub(super) noise: Vec<Noise>,
    pub(super) nuisances: Vec<Nuisances>,
    /// Per record, the state from which runs begin: that of the model, conditioned on the log's first samples.
    starts: Vec<Vec<f64>>,
    /// Per record and input, the plant's input at rest.
    rests: Vec<Vec<Option<f64>>>,
    /// Per record, the responses to the difference between that point and the model's own initial state, about which deviations are defined. Empty where both
    /// are equal.
    ways_back: Vec<Option<DMatrix<f64>>>,
    /// Per record, the nonlinear part of the responses to its own constants; `None` where they have none.
    bends: Vec<Option<DMatrix<f64>>>,
    /// Integration steps allowed, per record.
    step_limits: Vec<usize>,
    /// Per output of a black box, the rounding error.
    resolution: Vec<f64>,
    /// The relative standard deviation of every number of the model about the value that came; `None`: numbers that are fitted are free.
    shrinkage: Option<f64>,
    /// Derivatives are central differences of fine simulations: the tolerance of coarse ones seems to fix directions that the data leave open.
    central: bool,
    stop: Stop,
    /// Recent simulations: neither noise nor priors change them.
    simulated: Arc<Simulated>,
}

/// Far below the noise of any sensor; a hypothesis that diverges stops early.
const TOLERANCE: Tolerance = Tolerance {
    relative: 1e-6,
    absolute: 1e-9,
    steps: 2000,
    budget: usize::MAX,
    past_samples: true,
};
/// For central differences, whose steps move the outputs by 1e-4 of their size and less.
const FINE: f64 = 1e-9;
/// The factor of integration steps of a fine simulation: a method of order five has (1e-6/1e-9)^(1/5), and rejects steps at kinks.
const FINE_STEPS: usize = 8;
/// Integration steps per sample, and the multiple of the nominal model's steps, above which a hypothesis is dropped.
const STEPS_PER_SAMPLE: usize = 10;
const STEPS_OF_NOMINAL: usize = 4;

/// Per record, the projection of a whitened residual on the nuisances; `None` without nuisances.
type Projected = Vec<Option<Common>>;

/// A whitened residual, one column of all samples and outputs per record.
pub(crate) type Whitened = Vec<DVector<f64>>;

/// The plans of the nominal model.
struct NominalPlans {
    plan: Plan,
    /// The same with an effect of size 0: a linear model takes no steps, but a hypothesis with friction does.
    integrated: Plan,
}

impl NominalPlans {
    fn of(system: &System, model_effects: &[Applied]) -> crate::error::Result<Self> {
        let plan = Applied::plan(system, model_effects, Chance::Mean)?;
        let mut integrated = Applied::plan(system, model_effects, Chance::Mean)?;
        if !(system.is_sampled() || system.is_black_box() || system.states.is_empty()) {
            integrated.terms.push(Term::Function { to: 0, from: 0, f: Arc::new(|_| 0.0) });
        }
        Ok(Self { plan, integrated })
    }
}

/// The responses to the free components of the initial state, each with its place.
type StartResponses = Vec<(usize, DMatrix<f64>)>;

impl<'a> Likelihood<'a> {
    /// With white noise.
    ///
    /// # Errors
    /// [`GapError::Nominal`] where the nominal model cannot be simulated, [`crate::error::Error::Stopped`].
    pub(crate) fn new(terms: Terms<'a>) -> crate::error::Result<Self> {
        let nominal = NominalPlans::of(terms.system, &terms.model_effects)?;
        let noise_std = terms.noise_std.clone();
        let mut likelihood = Self::without_logs(terms);
        for at in 0..likelihood.records.len() {
            likelihood.stop.check()?;
            likelihood.add_log(at, &nominal, &noise_std)?;
        }
        Ok(likelihood)
    }

    /// The likelihood before the nominal model has run on any log.
    fn without_logs(terms: Terms<'a>) -> Self {
        Self {
            system: terms.system,
            records: terms.records,
            predictor: terms.predictor,
            criteria: terms.criteria,
            budget: Budget::of(terms.system),
            model_effects: terms.model_effects,
            declared: terms.nuisances,
            prior: terms.prior,
            noise: vec![Noise::white(&terms.noise_std); terms.records.len()],
            nuisances: Vec::new(),
            starts: Vec::new(),
            rests: Vec::new(),
            ways_back: Vec::new(),
            bends: Vec::new(),
            step_limits: Vec::new(),
            resolution: terms.resolution,
            shrinkage: None,
            central: false,
            stop: terms.stop,
            simulated: Arc::default(),
        }
    }

    /// Runs the nominal model on the next log: its initial state, its integration steps and its nuisances.
    fn add_log(
        &mut self,
        at: usize,
        nominal: &NominalPlans,
        noise_std: &[f64],
    ) -> crate::error::Result<()> {
        let (system, record) = (self.system, &self.records[at]);
        let plan = Applied::plan(system, &self.model_effects, Chance::Mean)?;
        let begin = log_start(system, plan, record, self.correction(at), &self.prior, noise_std);
        self.rests.push(rests(system, record, &begin, noise_std));
        self.starts.push(begin);
        let failed =
            |e: SimulateError| GapError::Nominal { log: record.name.clone(), why: e.to_string() };
        let responses = self.start_responses(at, &nominal.plan).map_err(failed)?;
        let steps = self.nominal_steps(at, nominal).map_err(failed)?;
        self.step_limits.push(STEPS_PER_SAMPLE * record.time_s.len() + STEPS_OF_NOMINAL * steps);
        // Deviations count from the model's own initial state.
        let begin = self.start_of(at);
        let back = (responses.iter().map(|(c, response)| (response, record.start[*c] - begin[*c])))
            .filter(|(_, by)| *by != 0.0)
            .map(|(response, by)| response * by)
            .reduce(|a, b| a + b);
        self.ways_back.push(back);
        self.add_nuisances(at, responses)
    }

    /// The responses of the nominal model to the free components of a log's initial state.
    fn start_responses(&self, at: usize, plan: &Plan) -> Result<StartResponses, SimulateError> {
        let record = &self.records[at];
        let scale: Vec<f64> = self.prior.iter().map(|s| self.budget.start_push * s).collect();
        let all = self.system.sensitivity(
            plan,
            record.commands(),
            self.start_of(at),
            &scale,
            self.correction(at),
        )?;
        let (samples, outputs) = (record.time_s.len(), self.system.outputs.len());
        // In a restarted simulator every initial state is a separate nuisance, window by window.
        let states = self.prior.len().max(1);
        Ok((0..all.ncols())
            .filter(|c| self.prior.get(c % states).is_some_and(|s| *s > 0.0))
            .map(|c| (c, DMatrix::from_column_slice(samples, outputs, all.column(c).as_slice())))
            .collect())
    }

    /// The number of integration steps of the nominal model over a log.
    fn nominal_steps(&self, at: usize, nominal: &NominalPlans) -> Result<usize, SimulateError> {
        let run = |plan: &Plan| {
            let commands = self.records[at].commands();
            self.system.simulate(plan, commands, self.start_of(at), self.correction(at))
        };
        Ok(match run(&nominal.plan)?.steps {
            // A linear model that is too stiff to be integrated is simulated all the same.
            0 => run(&nominal.integrated).map_or(0, |run| run.steps),
            steps => steps,
        })
    }

    /// Adds the nuisances of a log; the declared constants respond about their own estimates where the log has some.
    fn add_nuisances(&mut self, at: usize, starts: StartResponses) -> crate::error::Result<()> {
        let record = &self.records[at];
        let starts = starts.into_iter().map(|(_, response)| response).collect();
        let mut raw = Responses { starts, ..Responses::default() };
        if let Some(predicted) = self.predict(at, NO_EFFECT) {
            let residual = self.residual(at, &predicted);
            raw.feedback = feedback::regressors(record, &residual, &self.criteria);
        }
        let alone = self.declared_responses(at, NO_EFFECT, &vec![0.0; self.declared.len()]);
        let why = "what it does with a nuisance at half a standard deviation to either side is not finite; lower its `std`";
        raw.declared = alone
            .ok_or_else(|| GapError::Nominal { log: record.name.clone(), why: why.to_owned() })?;
        raw.declared_std = self.declared.iter().map(|n| n.std).collect();
        self.nuisances.push(Nuisances::new(raw, record, &self.noise[at], &self.prior));
        if let Some((declared, bend)) = self.about_own_constants(at) {
            let raw = Responses { declared, ..self.nuisances[at].raw().clone() };
            self.nuisances[at] = Nuisances::new(raw, record, &self.noise[at], &self.prior);
            self.bends.resize(at, None);
            self.bends.push(Some(bend));
        }
        Ok(())
    }

    /// The same logs under another predictor and white noise.
    ///
    /// # Errors
    /// As [`Likelihood::new`].
    pub(crate) fn predicting<'b>(
        &self,
        predictor: &'b Predictor,
        noise_std: &[f64],
    ) -> crate::error::Result<Likelihood<'b>>
    where
        'a: 'b,
    {
        Likelihood::new(Terms {
            system: self.system,
            records: self.records,
            predictor,
            model_effects: self.model_effects.clone(),
            nuisances: self.declared,
            prior: self.prior.clone(),
            noise_std: noise_std.to_vec(),
            resolution: self.resolution.clone(),
            criteria: self.criteria,
            stop: self.stop.clone(),
        })
    }

    /// The same on further records behind those that it was made of, under the noise of the record of the closest sample time.
    ///
    /// # Errors
    /// As [`Likelihood::new`].
    pub(crate) fn on<'b>(
        &self,
        records: &'b [LogRecord],
        predictor: &'b Predictor,
    ) -> crate::error::Result<Likelihood<'b>>
    where
        'a: 'b,
    {
        let distance =
            |own: &LogRecord, r: &LogRecord| (own.sample_time_s / r.sample_time_s).ln().abs();
        let closest = |r: &LogRecord| {
            let own = self.records.iter().zip(&self.noise);
            let closest = own.min_by(|a, b| distance(a.0, r).total_cmp(&distance(b.0, r)));
            closest.map(|(_, noise)| noise.clone())
        };
        let further = records.iter().skip(self.noise.len()).filter_map(closest);
        let noise: Vec<Noise> = self.noise.iter().cloned().chain(further).collect();
        let white = Likelihood::new(Terms {
            system: self.system,
            records,
            predictor,
            model_effects: self.model_effects.clone(),
            nuisances: self.declared,
            prior: self.prior.clone(),
            noise_std: self.noise_std(),
            resolution: self.resolution.clone(),
            criteria: self.criteria,
            stop: self.stop.clone(),
        })?;
        Ok(Likelihood {
            shrinkage: self.shrinkage,
            central: self.central,
            ..white.with_noise(noise)
        })
    }

    /// Under another noise model; one per record.
    pub(crate) fn with_noise(&self, noise: Vec<Noise>) -> Self {
        let whitened = self.nuisances.iter().zip(self.records).zip(&noise);
        let nuisances = whitened
            .map(|((nuisances, record), noise)| nuisances.with_noise(record, noise, &self.prior))
            .collect();
        Self { noise, nuisances, ..self.clone() }
    }

    /// With other prior standard deviations of the start; those that are 0 stay so.
    pub(crate) fn with_prior(&self, prior: Vec<f64>) -> Self {
        let nuisances =
            self.nuisances.iter().map(|nuisances| nuisances.with_prior(&prior)).collect();
        Self { prior, nuisances, ..self.clone() }
    }

    /// With a normal prior on every number of the model that is fitted: about the value that came, of this relative standard deviation.
    pub(crate) fn with_shrinkage(&self, size: f64) -> Self {
        Self { shrinkage: Some(size), ..self.clone() }
    }

    /// With derivatives by central differences, for reported values.
    pub(crate) fn with_central_differences(&self) -> Self {
        let step_limits = self.step_limits.iter().map(|steps| FINE_STEPS * steps).collect();
        Self { central: true, step_limits, simulated: Arc::default(), ..self.clone() }
    }

    pub(crate) fn has_central_differences(&self) -> bool {
        self.central
    }

    /// Mean and standard deviation of the prior on an effect's parameter; `None`: it is free.
    pub(crate) fn prior_of(&self, applied: &Applied, parameter: usize) -> Option<(f64, f64)> {
        let nominal = applied.parameters[parameter].nominal;
        let std = self.shrinkage? * nominal.abs();
        (applied.effect.corrects_model() && std > 0.0 && std.is_finite()).then_some((nominal, std))
    }

    /// To try the effect a black box must be called: what comes after it costs nothing.
    pub(crate) fn calls(&self, applied: &Applied) -> bool {
        self.system.is_black_box() && matches!(applied.effect.site(), Site::Input | Site::Dynamics)
    }

    /// The allowed cost of a trial of the effect.
    pub(crate) fn allowance(&self, applied: &Applied) -> &'static Allowance {
        if self.calls(applied) { &self.budget.called } else { &self.budget.plain }
    }

    /// First guesses of an effect's parameters, fewer where each is a call.
    pub(crate) fn first_guesses(&self, applied: &Applied, scales: &Scales) -> Vec<Vec<f64>> {
        let all = applied.starts(self.system, scales);
        let every = all.len().div_ceil(self.allowance(applied).first_guesses).max(1);
        all.into_iter().step_by(every).collect()
    }

    /// The length of a whitened residual that rounding in a black box makes.
    pub(crate) fn rounding(&self) -> f64 {
        let noise = self.noise_std();
        let parts =
            self.resolution.iter().zip(&noise).map(|(r, s)| (r / s.max(f64::MIN_POSITIVE)).powi(2));
        let samples = self
            .records
            .iter()
            .filter(|r| r.train.is_some())
            .map(|r| r.time_s.len())
            .sum::<usize>() as f64;
        (parts.sum::<f64>() * samples).sqrt()
    }

    /// How the outputs of one record respond to the nuisances, samples × outputs each.
    pub(crate) fn responses_of(&self, record: usize) -> impl Iterator<Item = &DMatrix<f64>> {
        self.nuisances[record].raw().all()
    }

    /// The caller no longer waits for the diagnosis.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.is_set()
    }

    /// The precision of their prior.
    pub(crate) fn precision_of(&self, record: usize) -> DMatrix<f64> {
        self.nuisances[record].precision(&self.prior)
    }

    pub(crate) fn prior(&self) -> &[f64] {
        &self.prior
    }

    pub(crate) fn correction(&self, record: usize) -> Option<Correction<'_>> {
        self.predictor.correction(record, &self.records[record].measured)
    }

    /// The plan of the simulator with its own and these effects.
    pub(crate) fn plan(&self, effects: &[Applied], chance: Chance<'_>) -> Option<Plan> {
        Applied::plan(self.system, self.model_effects.iter().chain(effects), chance).ok()
    }

    /// Predicted outputs of one record from the nominal start, samples × outputs.
    pub(crate) fn predict<'e>(
        &self,
        record: usize,
        active: impl Into<ActiveEffects<'e>>,
    ) -> Option<DMatrix<f64>> {
        self.predict_samples(record, active.into(), &self.records[record].inputs, usize::MAX)
    }

    /// The same with other commands than those of the log, over the rows of the fit: samples after the training span are 0.
    pub(crate) fn predict_trained(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        inputs: &[Vec<f64>],
    ) -> Option<DMatrix<f64>> {
        self.predict_samples(record, active, inputs, self.records[record].trained_samples())
    }

    /// The plan of a run over one record.
    pub(super) fn plan_on(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        samples: usize,
    ) -> Option<Plan> {
        if self.stop.is_set() {
            return None;
        }
        let ActiveEffects { effects, lost } = active;
        let known = lost.and_then(|l| l.get(record));
        let mut plan =
            self.plan(effects, known.map_or(Chance::Mean, |sequences| Chance::Known(sequences)))?;
        plan.tolerance = Tolerance {
            budget: self.step_limits.get(record).copied().unwrap_or(usize::MAX),
            relative: if self.central { FINE } else { TOLERANCE.relative },
            ..TOLERANCE
        };
        plan.wanted = Wanted { samples, states: false };
        let rests = self.rests.get(record).map_or(&[][..], Vec::as_slice);
        for (path, rest) in plan.inputs.iter().zip(rests) {
            if let Some(rest) = rest {
                path.rest.get_or_init(|| *rest);
            }
        }
        Some(plan)
    }

    /// The outputs of a real run, as long as the record: nothing in it is a straight line.
    pub(super) fn run(&self, record: usize, active: ActiveEffects<'_>) -> Option<DMatrix<f64>> {
        self.run_samples(record, active, &self.records[record].inputs, usize::MAX)
    }

    fn predict_samples(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        inputs: &[Vec<f64>],
        samples: usize,
    ) -> Option<DMatrix<f64>> {
        let mut y = self.run_samples(record, active, inputs, samples)?;
        for missing in [&self.ways_back, &self.bends] {
            if let Some(Some(missing)) = missing.get(record) {
                y += missing;
            }
        }
        Some(y)
    }

    fn run_samples(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        inputs: &[Vec<f64>],
        samples: usize,
    ) -> Option<DMatrix<f64>> {
        let log = &self.records[record];
        let simulate = || {
            let plan = self.plan_on(record, active, samples)?;
            let commands = Commands { time_s: &log.time_s, inputs };
            let start = self.start_of(record);
            Some(self.system.simulate(&plan, commands, start, self.correction(record)).ok()?.y)
        };
        if active.lost.is_some() || !std::ptr::eq(inputs, log.inputs.as_slice()) {
            return simulate();
        }
        // A run ended by a stop carries no information.
        self.simulated.of(
            Key::new(record, samples.min(log.time_s.len()), active.effects),
            simulate,
            || !self.stop.is_set(),
        )
    }

    /// The responses to the way from where runs of a record begin to the model's own initial state.
    pub(super) fn way_back(&self, record: usize) -> Option<&DMatrix<f64>> {
        self.ways_back.get(record)?.as_ref()
    }

    /// The state from which runs of a record begin.
    pub(crate) fn start_of(&self, record: usize) -> &[f64] {
        self.starts.get(record).unwrap_or(&self.records[record].start)
    }

    /// measured − predicted, 0 where there is no measurement.
    pub(crate) fn residual(&self, record: usize, predicted: &DMatrix<f64>) -> DMatrix<f64> {
        let (samples, outputs) = predicted.shape();
        let mut residual = Vec::with_capacity(samples * outputs);
        for (predicted, measured) in
            predicted.as_slice().chunks_exact(samples.max(1)).zip(&self.records[record].measured)
        {
            let both = measured.values.iter().zip(predicted);
            match &measured.present {
                None => residual.extend(both.map(|(y, predicted)| y - predicted)),
                Some(present) => residual.extend(
                    both.zip(present)
                        .map(|((y, predicted), there)| if *there { y - predicted } else { 0.0 }),
                ),
            }
        }
        DMatrix::from_vec(samples, outputs, residual)
    }

    /// Whitened residuals of all training records; `None` where a simulation fails.
    pub(crate) fn whitened<'e>(&self, active: impl Into<ActiveEffects<'e>>) -> Option<Whitened> {
        let active = active.into();
        let one = |at: usize| {
            let record = &self.records[at];
            if record.train.is_none() {
                return Some(DVector::zeros(0));
            }
            let residual = self.residual(at, &self.predict_trained(at, active, &record.inputs)?);
            let e = self.noise[at].whiten(record, record.train, &residual);
            let rows = e.len();
            e.iter().all(|v| v.is_finite()).then(|| e.reshape_generic(Dyn(rows), Const::<1>))
        };
        if self.budget.one_by_one {
            return (0..self.records.len()).map(one).collect();
        }
        parallel::try_map(0..self.records.len(), one)
    }

    /// Every record can be simulated to its end.
    pub(crate) fn holds_throughout<'e>(&self, active: impl Into<ActiveEffects<'e>>) -> bool {
        let active = active.into();
        !parallel::any(0..self.records.len(), |at| self.predict(at, active).is_none())
    }

    /// A residual whitened over the whole record, independent of the training span.
    pub(crate) fn whiten_whole(&self, at: usize, residual: &DMatrix<f64>) -> DMatrix<f64> {
        self.whiten_in(at, residual, Span { from_s: 0.0, to_s: self.records[at].duration_s() })
    }

    /// A residual whitened over a span, independent of the training span; 0 outside it.
    pub(crate) fn whiten_in(&self, at: usize, residual: &DMatrix<f64>, span: Span) -> DMatrix<f64> {
        self.noise[at].whiten(&self.records[at], Some(span), residual)
    }

    /// Anything that moves as a residual does, from any sample on, through the noise's whitening filter.
    pub(crate) fn filter(&self, at: usize, response: &DMatrix<f64>) -> DMatrix<f64> {
        self.noise[at].filter(response)
    }

    /// The inner product of whitened residuals with the start integrated out: aᵀ(I + W P Wᵀ)⁻¹b over the training records.
    pub(crate) fn inner(&self, a: &Whitened, b: &Whitened) -> f64 {
        let projected = self.projected(b);
        if std::ptr::eq(a, b) {
            self.product((a, &projected), (b, &projected))
        } else {
            self.product((a, &self.projected(a)), (b, &projected))
        }
    }

    /// All inner products among a list.
    pub(crate) fn inner_of_all(&self, all: &[&Whitened]) -> DMatrix<f64> {
        let projected: Vec<Projected> = all.iter().map(|a| self.projected(a)).collect();
        let mut products = DMatrix::zeros(all.len(), all.len());
        for i in 0..all.len() {
            for j in 0..=i {
                products[(i, j)] = self.product((all[i], &projected[i]), (all[j], &projected[j]));
                products[(j, i)] = products[(i, j)];
            }
        }
        products
    }

    fn product(
        &self,
        (a, left): (&Whitened, &Projected),
        (b, right): (&Whitened, &Projected),
    ) -> f64 {
        let mut sum = 0.0;
        for ((a, b), (left, right)) in a.iter().zip(b).zip(left.iter().zip(right)) {
            sum += a.dot(b);
            if let (Some((by_start, _)), Some((_, solved))) = (left, right) {
                sum -= by_start.dot(solved);
            }
        }
        sum
    }

    /// The projection of a whitened residual on the nuisances: Wᵀa and (P⁻¹ + WᵀW)⁻¹Wᵀa per record.
    fn projected(&self, a: &Whitened) -> Projected {
        a.iter().zip(&self.nuisances).map(|(a, nuisances)| nuisances.projected(a)).collect()
    }

    /// (I + W P Wᵀ)⁻¹a, record by record: [`Self::inner`] is its scalar product with the other vector.
    pub(crate) fn reduced(&self, a: &Whitened) -> Whitened {
        a.iter().zip(&self.nuisances).map(|(a, nuisances)| nuisances.reduced(a)).collect()
    }

    /// Predicted outputs from the posterior mean of the start, given the samples in `span` of each record.
    pub(crate) fn predict_from_posterior<'e>(
        &self,
        record: usize,
        active: impl Into<ActiveEffects<'e>>,
        span: Span,
    ) -> Option<DMatrix<f64>> {
        let y = self.predict(record, active)?;
        self.moved_to_posterior(record, y, span)
    }

    /// The same of the training span given its own samples; samples after it are of no use.
    pub(crate) fn predict_trained_from_posterior<'e>(
        &self,
        record: usize,
        active: impl Into<ActiveEffects<'e>>,
    ) -> Option<DMatrix<f64>> {
        let y = self.predict_trained(record, active.into(), &self.records[record].inputs)?;
        self.moved_to_posterior(record, y, self.records[record].train?)
    }

    fn moved_to_posterior(
        &self,
        record: usize,
        mut y: DMatrix<f64>,
        span: Span,
    ) -> Option<DMatrix<f64>> {
        let nuisances = &self.nuisances[record];
        if nuisances.is_empty() {
            return Some(y);
        }
        let (noise, log) = (&self.noise[record], &self.records[record]);
        let whitened = noise.whiten(log, Some(span), &self.residual(record, &y));
        let e = DVector::from_column_slice(whitened.as_slice());
        let deviation = if log.train == Some(span) {
            nuisances.posterior(&e)?
        } else {
            nuisances.posterior_in(span, &e, log, noise, &self.prior)?
        };
        nuisances.add_to(&mut y, &deviation);
        Some(y)
    }

    /// Standard deviation of each output's innovations.
    pub(crate) fn noise_std(&self) -> Vec<f64> {
        let trained = self.records.iter().zip(&self.noise).find(|(r, _)| r.train.is_some());
        trained.map_or_else(|| vec![1.0; self.system.outputs.len()], |(_, noise)| noise.std())
    }

    /// The number of samples of each output's noise per independent sample.
    pub(crate) fn memory(&self) -> Vec<f64> {
        let trained = self.records.iter().zip(&self.noise).find(|(r, _)| r.train.is_some());
        (0..self.system.outputs.len())
            .map(|i| trained.map_or(1.0, |(_, noise)| noise.memory(i)))
            .collect()
    }

    /// Samples with weight.
    pub(crate) fn weight(&self) -> f64 {
        let here = |record: &LogRecord| {
            let inside = (0..record.time_s.len())
                .flat_map(|k| (0..record.measured.len()).map(move |i| (i, k)));
            inside.filter(|&(i, k)| record.measured_in(record.train, i, k).is_some()).count()
        };

        self.records.iter().map(here).sum::<usize>() as f64
    }
}

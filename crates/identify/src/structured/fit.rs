//! Parameters of a model file, fitted to logs.

use super::answer::{FreeParameter, StructuredFit};
use super::error::StructuredError;
use super::fitted::Fitted;
use super::group::Group;
use super::problem::{Cluster, Starts, StructuredProblem, Weights};
use super::record::{LogRecord, WindowLayout};
use super::score::GroupScore;
use super::window::Simulator;
use super::{answer, record, shrinkage};
use crate::error::Result;
use deadtime_log::Log;
use deadtime_model::{Equations, EquationsFile};
use deadtime_signal::fit::{Fit, LevenbergMarquardt, Normal};
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats;
use deadtime_signal::stop::Stop;

/// About so many clusters of windows carry the covariance.
pub(super) const CLUSTERS: usize = 60;

/// Most Runge-Kutta steps within one sample.
pub(super) const MOST_SUBSTEPS: usize = 16;

/// A finer step must change no mean error by more than this share of it.
pub(super) const STEP_SHARE: f64 = 1e-3;

/// How far a record's own parameter may first stand off, in the parameter's size.
pub(super) const OWN_SIZE: f64 = 0.1;

/// How much of the work is done when the windows are fitted, and when those of one step are.
pub(super) const FITTED: f64 = 0.7;

pub(super) const ONE_STEP: f64 = 0.9;

/// What one set of parameters more leaves of a round.
pub(super) const LEFT: f64 = 0.8;

/// How the errors of different horizons are weighed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Balance {
    /// Each horizon by its own size of error: none is sacrificed.
    #[default]
    Horizon,
    /// All horizons of a group alike: long ones, with larger errors, count most.
    Group,
}

/// What is fitted, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Structured {
    /// Parameters that all records share, by name.
    pub free: Vec<String>,
    /// Parameters that may also stand off by record, with zero mean; a prediction of another log does not use what stands off.
    pub per_record: Vec<String>,
    /// Steps of a window; default 50.
    pub horizon: usize,
    /// Steps from a window's start to the next; default: the horizon.
    pub stride: Option<usize>,
    /// Huber's threshold in median lengths; infinite: plain squares. Default 1.345.
    pub threshold: f64,
    /// How horizons are weighed.
    pub balance: Balance,
    /// Size of the shrinkage towards the file's values; default: by the data.
    pub shrinkage: Option<f64>,
    /// Fit windows of one step too, to tell physical values from surrogates; default yes.
    pub one_step: bool,
    /// Rounds of weighing and fitting; default 3.
    pub rounds: usize,
    /// Where it is said how far the fit is.
    pub far: HowFar,
    /// Ends the fit before its next round.
    pub stop: Stop,
}

impl Default for Structured {
    fn default() -> Self {
        Self {
            free: Vec::new(),
            per_record: Vec::new(),
            horizon: 50,
            stride: None,
            threshold: 1.345,
            balance: Balance::Horizon,
            shrinkage: None,
            one_step: true,
            rounds: 3,
            far: HowFar::default(),
            stop: Stop::default(),
        }
    }
}

/// A model ready to be simulated over windows.
pub(super) struct Prepared<'a> {
    file: &'a EquationsFile,
    equations: Equations,
    starts: Option<(Equations, Vec<usize>)>,
    groups: Vec<Group>,
    logged: Vec<bool>,
    step_s: f64,
}

impl<'a> Prepared<'a> {
    fn new(file: &'a EquationsFile, logs: &[Log]) -> Result<Self> {
        let unsupported =
            |what, remedy| StructuredError::Unsupported { model: file.name.clone(), what, remedy };
        if !file.effects.is_empty() {
            return Err(
                unsupported("effects", "write them into its equations, or take them out").into()
            );
        }
        let mut step_s = None;
        for log in logs {
            let found_s = log.even_grid()?.seconds();
            let first_s = *step_s.get_or_insert(found_s);
            if (found_s - first_s).abs() > 1e-6 * first_s {
                return Err(StructuredError::SampleTime {
                    file: log.source().to_owned(),
                    found_s,
                    first_s,
                }
                .into());
            }
        }
        let step_s = step_s.unwrap_or(1.0);
        if file.input_delay_s.iter().any(|d| (d / step_s - (d / step_s).round()).abs() > 1e-6) {
            return Err(unsupported(
                "an input delay that is no whole number of samples",
                "round it, or resample the logs",
            )
            .into());
        }
        // A state starts from the log where every log has it.
        let logged = file
            .states
            .iter()
            .map(|(name, _)| {
                !file.starts.iter().any(|(s, _)| s == name)
                    && logs.iter().all(|log| log.output(name).is_ok())
            })
            .collect();
        let at =
            |(name, _): &(String, String)| file.states.iter().position(|(state, _)| state == name);
        let starts = file
            .start_equations()?
            .map(|equations| (equations, file.starts.iter().filter_map(at).collect()));
        Ok(Self {
            file,
            equations: file.equations()?,
            starts,
            groups: Group::all(file),
            logged,
            step_s,
        })
    }

    fn records(&self, logs: &[Log], layout: WindowLayout) -> Result<Vec<LogRecord>> {
        logs.iter()
            .map(|log| {
                record::record(self.file, &self.groups, &self.logged, log, self.step_s, layout)
            })
            .collect()
    }

    fn problem<'b>(
        &'b self,
        records: &'b [LogRecord],
        horizon: usize,
        free: Vec<(usize, f64)>,
        own: Vec<(usize, f64)>,
    ) -> StructuredProblem<'b> {
        let states = self.equations.state_variables();
        let said = |i: &usize| self.starts.as_ref().is_some_and(|(_, list)| list.contains(i));
        let unknown =
            |i: &usize| !self.logged[*i] && !said(i) && states[*i].initial_std != Some(0.0);
        let starts: Vec<usize> = (0..states.len()).filter(unknown).collect();
        let std = starts.iter().map(|&i| states[i].initial_std.unwrap_or(f64::INFINITY)).collect();
        StructuredProblem {
            simulator: Simulator {
                equations: &self.equations,
                starts: self.starts.as_ref(),
                groups: &self.groups,
                logged: &self.logged,
                step_s: self.step_s,
                substeps: 1,
                horizon,
            },
            records,
            clusters: clusters(records),
            starts: Starts { states: starts, std },
            nominal: self.equations.nominal(),
            free,
            own,
        }
    }
}

/// Windows that lie together, about [`CLUSTERS`] of them, none over two records.
pub(super) fn clusters(records: &[LogRecord]) -> Vec<Cluster> {
    let all: usize = records.iter().map(|r| r.windows.len()).sum();
    let size = all.div_ceil(CLUSTERS).max(1);
    let of = |(record, r): (usize, &LogRecord)| {
        let parts = r.windows.len().div_ceil(size);
        let each = r.windows.len().div_ceil(parts.max(1)).max(1);
        r.windows
            .chunks(each)
            .map(|starts| Cluster { record, starts: starts.to_vec() })
            .collect::<Vec<_>>()
    };
    records.iter().enumerate().flat_map(of).collect()
}

/// The errors of a model as it stands.
///
/// # Errors
/// As [`Structured::fit`].
pub fn score(
    file: &EquationsFile,
    logs: &[Log],
    horizon: usize,
    stride: usize,
) -> Result<Vec<GroupScore>> {
    if horizon == 0 || stride == 0 {
        return Err(StructuredError::Horizon { horizon, stride }.into());
    }
    let prepared = Prepared::new(file, logs)?;
    let records = prepared.records(logs, WindowLayout { horizon, stride })?;
    let mut problem = prepared.problem(&records, horizon, Vec::new(), Vec::new());
    let lengths = refined(&mut problem)?;
    Ok(super::score::score(&problem, &lengths))
}

/// Errors of the nominal model at a step so short that a shorter one changes nothing worth mentioning.
pub(super) fn refined(problem: &mut StructuredProblem<'_>) -> Result<Vec<Vec<Vec<f64>>>> {
    let z = vec![0.0; problem.unknowns()];
    let diverges = |records: &[LogRecord], (record, start): (usize, usize), step_s: f64| {
        StructuredError::Diverges {
            file: records[record].source.clone(),
            time_s: records[record].start_s + start as f64 * step_s,
        }
    };
    let mut before = super::score::lengths(problem, &z);
    while problem.simulator.substeps < MOST_SUBSTEPS {
        problem.simulator.substeps *= 2;
        let after = super::score::lengths(problem, &z);
        if let (Ok(a), Ok(b)) = (&before, &after) {
            let means = |of: &[Vec<Vec<f64>>]| {
                super::score::score(problem, of)
                    .into_iter()
                    .flat_map(|g| g.mean_absolute)
                    .collect::<Vec<_>>()
            };
            if means(a)
                .iter()
                .zip(means(b))
                .all(|(a, b)| (a - b).abs() <= STEP_SHARE * b.abs().max(f64::MIN_POSITIVE))
            {
                problem.simulator.substeps /= 2;
                break;
            }
        }
        before = after;
    }
    before.map_err(|at| diverges(problem.records, at, problem.simulator.step_s).into())
}

impl Structured {
    /// Fits the free parameters on `logs`; prediction errors of both models are reported on them and on `held_out` logs.
    ///
    /// # Errors
    /// [`StructuredError`]; [`deadtime_log::LogError`] for a channel that is not there; [`deadtime_model::ModelError`] for equations that do not compile.
    pub fn fit(
        &self,
        file: &EquationsFile,
        logs: &[Log],
        held_out: &[Log],
    ) -> Result<StructuredFit> {
        let prepared = Prepared::new(file, logs)?;
        let free = indices(file, &prepared.equations, &self.free)?;
        let own = indices(file, &prepared.equations, &self.per_record)?;
        if free.is_empty() && own.is_empty() {
            return Err(StructuredError::NothingFree.into());
        }
        let stride = self.stride.unwrap_or(self.horizon);
        if self.horizon == 0 || stride == 0 {
            return Err(StructuredError::Horizon { horizon: self.horizon, stride }.into());
        }
        let records = prepared.records(logs, WindowLayout { horizon: self.horizon, stride })?;
        let (problem, fitted) = self.run(
            &prepared,
            &records,
            (self.horizon, &self.far.part(0.0, FITTED)),
            &free,
            &own,
        )?;
        // Starts that are estimated window by window leave a single step nothing to say.
        let one_step = if self.one_step && self.horizon > 1 && problem.starts.states.is_empty() {
            let records =
                prepared.records(logs, WindowLayout { horizon: 1, stride: (stride / 8).max(1) })?;
            let (problem, fitted) =
                self.run(&prepared, &records, (1, &self.far.part(FITTED, ONE_STEP)), &free, &own)?;
            Some(answer::values(&problem, &fitted))
        } else {
            None
        };
        self.far.at(ONE_STEP, &"errors of both models");
        let mut answer = answer::answer(&problem, &fitted, one_step.as_deref());
        let model = with_values(file, &answer.parameters);
        let every = |logs: &[Log], file: &EquationsFile| score(file, logs, self.horizon, stride);
        answer.training = [every(logs, file)?, every(logs, &model)?];
        if !held_out.is_empty() {
            answer.held_out = Some([every(held_out, file)?, every(held_out, &model)?]);
        }
        answer.windows = records.iter().map(|r| r.windows.len()).sum();
        answer.model = Some(model);
        Ok(answer)
    }

    /// Sizes of the parameters, weights, shrinkage and the fit.
    fn run<'b>(
        &self,
        prepared: &'b Prepared<'_>,
        records: &'b [LogRecord],
        (horizon, far): (usize, &HowFar),
        free: &[usize],
        own: &[usize],
    ) -> Result<(StructuredProblem<'b>, Fitted)> {
        far.at(0.0, &"choosing the step of the simulation");
        let unit = |list: &[usize]| list.iter().map(|&i| (i, 1.0)).collect::<Vec<_>>();
        let mut problem = prepared.problem(records, horizon, unit(free), unit(own));
        let mut weights = self.weights(&refined(&mut problem)?);
        let mut z = vec![0.0; problem.unknowns()];
        let diverged = || StructuredError::Diverges {
            file: records[0].source.clone(),
            time_s: records[0].start_s,
        };
        let first = problem.clusters(&z, &weights).ok_or_else(diverged)?;
        sizes(&mut problem, &first);
        let mut own_size = vec![OWN_SIZE; own.len()];
        let mut shrinkage = self.shrinkage.unwrap_or(shrinkage::WEAKEST);
        let (mut fit, mut prior);
        let mut round = 0;
        loop {
            self.stop.check()?;
            prior = self.prior(&problem, shrinkage, &own_size);
            fit = self.round(&problem, &z, (&weights, &prior), round, far);
            z.clone_from(&fit.parameters);
            round += 1;
            if round >= self.rounds {
                break;
            }
            weights = self.weights(&super::score::lengths(&problem, &z).map_err(|_| diverged())?);
            let clusters = problem.clusters(&z, &weights).ok_or_else(diverged)?;
            if self.shrinkage.is_none() {
                shrinkage = shrinkage::by_data(&problem, &clusters, &z, |s| {
                    self.prior(&problem, s, &own_size)
                })
                .unwrap_or(shrinkage);
            }
            shrinkage::own_sizes(&problem, &clusters, &z, &prior, &mut own_size);
        }
        weights.curvature = true;
        let clusters = problem.clusters(&z, &weights).ok_or_else(diverged)?;
        let (covariance, information) = answer::covariance(&problem, &clusters, &z, &prior);
        let substeps = problem.simulator.substeps;
        Ok((
            problem,
            Fitted { z, fit, clusters, prior, shrinkage, covariance, information, substeps },
        ))
    }

    /// The fit under these weights and this prior.
    fn round(
        &self,
        problem: &StructuredProblem<'_>,
        z: &[f64],
        (weights, prior): (&Weights, &[f64]),
        round: usize,
        far: &HowFar,
    ) -> Fit {
        let rounds = self.rounds;
        // Weights change with every round: only the last one needs its minimum to many digits.
        let tolerance = if round + 1 >= rounds { 1e-5 } else { 1e-3 };
        let search = LevenbergMarquardt {
            max_iterations: 30,
            gradient_tolerance: tolerance,
            step_tolerance: tolerance,
            ..Default::default()
        };
        let share = |round: usize| round as f64 / rounds.max(1) as f64;
        let far = far.part(share(round), share(round + 1));
        let mut tried = 0;
        search.minimise(z, |z| {
            // The number of evaluations of a round is unknown: each one counts as a share of the remainder.
            let now =
                format_args!("round {} of {rounds}, set {} of parameters", round + 1, tried + 1);
            far.at(1.0 - LEFT.powi(tried), &now);
            tried += 1;
            problem.clusters(z, weights).map(|c| problem.normal(&c, z, prior))
        })
    }

    /// λ of every unknown: the shared ones alike, a record's own by how far they stand off.
    fn prior(&self, problem: &StructuredProblem<'_>, shrinkage: f64, own_size: &[f64]) -> Vec<f64> {
        let own = own_size.iter().map(|size| 1.0 / (size * size)).collect::<Vec<_>>();
        let shared = std::iter::repeat_n(shrinkage, problem.free.len());
        shared.chain((0..problem.records.len()).flat_map(|_| own.iter().copied())).collect()
    }

    fn weights(&self, lengths: &[Vec<Vec<f64>>]) -> Weights {
        let median = |list: &Vec<f64>| stats::upper_median(list.clone()).unwrap_or(1.0);
        let of = |group: &Vec<Vec<f64>>| {
            let each: Vec<f64> = group.iter().map(median).collect();
            let whole = stats::rms(each.iter().copied()).unwrap_or(0.0).max(f64::MIN_POSITIVE);
            let floor = |v: f64| if whole > f64::MIN_POSITIVE { v.max(1e-6 * whole) } else { 1.0 };
            match self.balance {
                Balance::Horizon => each.into_iter().map(floor).collect(),
                Balance::Group => vec![floor(whole); each.len()],
            }
        };
        Weights {
            scale: lengths.iter().map(of).collect(),
            threshold: self.threshold,
            curvature: false,
        }
    }
}

/// Each parameter's size: its own value, or, for one that is 0, what would move the predictions as far as their errors.
pub(super) fn sizes(problem: &mut StructuredProblem<'_>, clusters: &[Normal]) {
    let nothing = vec![0.0; problem.unknowns()];
    let normal = problem.normal(clusters, &nothing, &nothing);
    let shared = problem.free.len();
    let size = |nominal: f64, information: f64| match nominal {
        0.0 if information > 0.0 && normal.cost > 0.0 => (normal.cost / information).sqrt(),
        0.0 => 1.0,
        nominal => nominal.abs(),
    };
    let nominal = problem.nominal.clone();
    for (at, entry) in problem.free.iter_mut().enumerate() {
        entry.1 = size(nominal[entry.0], normal.information[(at, at)]);
    }
    let (own, records) = (problem.own.len(), problem.records.len());
    for (at, entry) in problem.own.iter_mut().enumerate() {
        let information =
            (0..records).map(|r| shared + r * own + at).map(|i| normal.information[(i, i)]).sum();
        entry.1 = size(nominal[entry.0], information);
    }
}

/// The model with what was found.
pub(super) fn with_values(file: &EquationsFile, found: &[FreeParameter]) -> EquationsFile {
    let mut model = file.clone();
    for (name, entry) in &mut model.parameters {
        if let Some(parameter) = found.iter().find(|p| p.name == *name) {
            entry.value = parameter.value;
        }
    }
    model
}

/// The named parameters; of `all` those that are not known.
fn indices(file: &EquationsFile, equations: &Equations, names: &[String]) -> Result<Vec<usize>> {
    let parameters = equations.parameters();
    if let Some(name) = names.iter().find(|name| name.starts_with("delay:")) {
        return Err(StructuredError::Delay { name: name.clone() }.into());
    }
    let find = |name: &String| {
        let known = || parameters.iter().map(|p| p.name.clone()).collect();
        let at = parameters.iter().position(|p| p.name == *name);
        at.ok_or_else(|| StructuredError::NoParameter { name: name.clone(), known: known() }.into())
    };
    let single = names.iter().filter(|name| *name != "all");
    let mut found: Vec<usize> = single.map(find).collect::<Result<_>>()?;
    if names.iter().any(|name| name == "all") {
        let unknown =
            |i: &usize| !file.parameters.iter().any(|(n, p)| p.known && *n == parameters[*i].name);
        found.extend((0..parameters.len()).filter(unknown));
    }
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

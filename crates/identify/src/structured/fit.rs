//! Parameters of a model file, fitted to logs.

use super::answer::StructuredFit;
use super::error::StructuredError;
use super::fitted::Fitted;
use super::free::{self, Quantity};
use super::group::Group;
use super::problem::{Starts, StructuredProblem, Weights, clusters};
use super::record::{LogRecord, WindowLayout};
use super::runs::WindowRun;
use super::score::GroupScore;
use super::starts::{self, Search};
use super::window::Simulator;
use super::{answer, record, runs, shrinkage};
use crate::error::Result;
use deadtime_log::Log;
use deadtime_model::{Equations, EquationsFile};
use deadtime_signal::fit::{Fit, LevenbergMarquardt, Normal, Stopped};
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::{self, NORMAL_95};
use deadtime_signal::stop::Stop;

/// Largest number of Runge-Kutta steps per sample.
pub(super) const MOST_SUBSTEPS: usize = 16;

/// Largest relative change of a mean error by a finer step.
pub(super) const STEP_SHARE: f64 = 1e-3;

/// Times the last round is continued where its iterations ran out.
const CONTINUED: usize = 10;

/// Initial standard deviation of a record's own parameter, in the parameter's size.
pub(super) const OWN_SIZE: f64 = 0.1;

/// Progress after the fit of the windows; the windows of one step take the remainder.
pub(super) const FITTED: f64 = 0.7;

pub(super) const ONE_STEP: f64 = 0.9;

/// Factor on the remaining progress of a round per evaluated parameter set.
pub(super) const LEFT: f64 = 0.8;

/// The weighting of errors over horizons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Balance {
    /// Each horizon by its own error size, so that all horizons have equal weight.
    #[default]
    Horizon,
    /// All horizons of a group with equal weight: long ones, with larger errors, dominate.
    Group,
}

/// The options of a structured fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Structured {
    /// Names of parameters shared by all records. `all`: every parameter not marked as known, and all dead times; `delay:INPUT`: the dead time of an input, s.
    pub free: Vec<String>,
    /// Parameters with an additional zero-mean deviation by record; a prediction of another log does not use the deviation.
    pub per_record: Vec<String>,
    /// Steps of a window; default 50.
    pub horizon: usize,
    /// Steps between the starts of successive windows; default: the horizon.
    pub stride: Option<usize>,
    /// Huber's threshold in median lengths; infinite: squared errors. Default 1.345.
    pub threshold: f64,
    /// The weighting of horizons.
    pub balance: Balance,
    /// Strength of the shrinkage towards the file's values; default: from the data. Dead times have none, because a file's usual value of 0 is no measurement.
    pub shrinkage: Option<f64>,
    /// Also fits windows of one step, to distinguish physical values from surrogates; default yes.
    pub one_step: bool,
    /// Rounds of weighting and fitting; default 3.
    pub rounds: usize,
    /// Progress of the fit.
    pub far: HowFar,
    /// Cancellation, checked before each round.
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

/// A model prepared for simulation over windows.
pub(super) struct Prepared<'a> {
    file: &'a EquationsFile,
    equations: Equations,
    starts: Option<(Equations, Vec<usize>)>,
    groups: Vec<Group>,
    logged: Vec<bool>,
    quantities: Vec<Quantity>,
    /// For each input, the input whose dead time applies to it.
    leaders: Vec<usize>,
    step_s: f64,
}

impl<'a> Prepared<'a> {
    pub(super) fn new(file: &'a EquationsFile, logs: &[Log]) -> Result<Self> {
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
        // A state starts from the log if every log contains it.
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
            quantities: free::quantities(file),
            leaders: free::leaders(file),
            step_s,
        })
    }

    pub(super) fn records(&self, logs: &[Log], layout: WindowLayout) -> Result<Vec<LogRecord>> {
        logs.iter()
            .map(|log| record::record(self.file, &self.groups, &self.logged, log, layout))
            .collect()
    }

    pub(super) fn problem<'b>(
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
                leaders: &self.leaders,
                step_s: self.step_s,
                substeps: 1,
                horizon,
            },
            records,
            clusters: clusters(records, 0),
            reach: 0,
            starts: Starts { states: starts, std },
            quantities: &self.quantities,
            free,
            own,
        }
    }
}

/// The errors of a model with its own values.
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

/// Measured outputs, with the predictions of the file's model and of the fitted one.
fn window_runs(
    [file, fitted]: [&EquationsFile; 2],
    logs: &[Log],
    horizon: usize,
    stride: usize,
) -> Result<Vec<WindowRun>> {
    let logs = &logs[..logs.len().min(runs::RECORDS)];
    let units: Vec<_> = file.outputs.iter().map(|o| (o.name.clone(), o.unit.clone())).collect();
    let layout = WindowLayout { horizon, stride };
    let of = |model: &EquationsFile| {
        let prepared = Prepared::new(model, logs)?;
        let records = prepared.records(logs, layout)?;
        let mut problem = prepared.problem(&records, horizon, Vec::new(), Vec::new());
        refined(&mut problem)?;
        let predicted = runs::predictions(&problem);
        Ok::<_, crate::Error>((records, predicted))
    };
    let step_s = Prepared::new(file, logs)?.step_s;
    let ((records, before), (_, after)) = (of(file)?, of(fitted)?);
    Ok(runs::paired(&records, &units, step_s, [&before, &after]))
}

/// Errors of the nominal model at a step that is short enough: a shorter one changes no mean error noticeably.
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
    /// Fits the free parameters on `logs`; reports prediction errors of both models on them and on `held_out` logs.
    ///
    /// # Errors
    /// [`StructuredError`]; [`deadtime_log::LogError`] for a missing channel; [`deadtime_model::ModelError`] for equations that do not compile.
    pub fn fit(
        &self,
        file: &EquationsFile,
        logs: &[Log],
        held_out: &[Log],
    ) -> Result<StructuredFit> {
        let prepared = Prepared::new(file, logs)?;
        let free = free::indices(file, &prepared.quantities, &self.free)?;
        let own = free::indices(file, &prepared.quantities, &self.per_record)?;
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
            (&free, &own),
            None,
        )?;
        let values = answer::values(&problem, &fitted);
        // Initial states estimated per window leave a single step without information.
        let one_step = if self.one_step && self.horizon > 1 && problem.starts.states.is_empty() {
            let records =
                prepared.records(logs, WindowLayout { horizon: 1, stride: (stride / 8).max(1) })?;
            let (problem, fitted) = self.run(
                &prepared,
                &records,
                (1, &self.far.part(FITTED, ONE_STEP)),
                (&free, &own),
                Some(&values.iter().map(|v| v[0]).collect::<Vec<_>>()),
            )?;
            Some(answer::values(&problem, &fitted))
        } else {
            None
        };
        self.far.at(ONE_STEP, &"errors of both models");
        let mut answer = answer::answer(&problem, &fitted, one_step.as_deref());
        let values: Vec<_> = answer.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
        let model = free::with_values(file, &values);
        let every = |logs: &[Log], file: &EquationsFile| score(file, logs, self.horizon, stride);
        answer.training = [every(logs, file)?, every(logs, &model)?];
        if !held_out.is_empty() {
            answer.held_out = Some([every(held_out, file)?, every(held_out, &model)?]);
        }
        let shown = if held_out.is_empty() { logs } else { held_out };
        answer.runs = window_runs([file, &model], shown, self.horizon, stride)?;
        answer.windows = problem.clusters.iter().map(|c| c.starts.len()).sum();
        answer.model = Some(model);
        Ok(answer)
    }

    /// Sizes of the parameters, weights, shrinkage and the fit.
    fn run<'b>(
        &self,
        prepared: &'b Prepared<'_>,
        records: &'b [LogRecord],
        (horizon, far): (usize, &HowFar),
        (free, own): (&[usize], &[usize]),
        hint: Option<&[f64]>,
    ) -> Result<(StructuredProblem<'b>, Fitted)> {
        far.at(0.0, &"choosing the step of the simulation");
        let unit = |list: &[usize]| list.iter().map(|&i| (i, 1.0)).collect::<Vec<_>>();
        let mut problem = prepared.problem(records, horizon, unit(free), unit(own));
        let late = free.iter().chain(own).any(|&i| problem.delayed(i).is_some());
        if late {
            let reach = starts::reach(&problem);
            problem.reach(reach);
        }
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
        let (mut fit, mut prior, mut alike);
        alike = Vec::new();
        let mut round = 0;
        loop {
            self.stop.check()?;
            prior = self.prior(&problem, shrinkage, &own_size);
            let share = |round: usize| round as f64 / self.rounds.max(1) as f64;
            let far = &far.part(share(round), share(round + 1));
            if round == 0 && free.iter().any(|&i| problem.delayed(i).is_some()) {
                (fit, alike) = self.first(&mut problem, (&weights, &prior), hint, far)?;
            } else {
                fit = self.round(&problem, &z, (&weights, &prior), round, far);
            }
            z.clone_from(&fit.parameters);
            round += 1;
            if round >= self.rounds {
                fit = self.continued(&problem, fit, (&weights, &prior), round - 1, far)?;
                z.clone_from(&fit.parameters);
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
            Fitted { z, fit, clusters, prior, shrinkage, covariance, information, substeps, alike },
        ))
    }

    /// The end of a round whose iterations may have run out, after its continuations.
    fn continued(
        &self,
        problem: &StructuredProblem<'_>,
        mut fit: Fit,
        (weights, prior): (&Weights, &[f64]),
        round: usize,
        far: &HowFar,
    ) -> Result<Fit> {
        for _ in 0..CONTINUED {
            if fit.stopped != Stopped::Iterations {
                break;
            }
            self.stop.check()?;
            let before = fit.iterations;
            fit = self.round(problem, &fit.parameters, (weights, prior), round, far);
            fit.iterations += before;
        }
        Ok(fit)
    }

    /// The first round from each start of the dead times. Returns the lowest minimum, and the dead times of indistinguishable minima.
    ///
    /// Along one direction the cost rises by κ χ² with one degree of freedom, κ the dispersion. A minimum within κ 1.96² of the lowest is not rejected at 95 %.
    /// Among such minima, the one reached from the file's values is selected. Each dead time is then rescaled by its estimate.
    fn first(
        &self,
        problem: &mut StructuredProblem<'_>,
        (weights, prior): (&Weights, &[f64]),
        hint: Option<&[f64]>,
        far: &HowFar,
    ) -> Result<(Fit, Vec<Vec<f64>>)> {
        let search = Search { problem, weights, prior, stop: &self.stop, far };
        let mut fits = search
            .minima(hint, |start, far| self.round(problem, start, (weights, prior), 0, far))?;
        let cost = |k: &usize| fits[*k].normal.cost;
        let lowest = starts::lowest(&fits);
        let curved = Weights { curvature: true, ..weights.clone() };
        let at = &fits[lowest].parameters;
        let dispersion = problem
            .clusters(at, &curved)
            .and_then(|clusters| answer::dispersion(problem, &clusters, at, prior));
        let close = cost(&lowest) + NORMAL_95.powi(2) * dispersion.unwrap_or(0.0);
        let taken = if cost(&0) <= close { 0 } else { lowest };
        let seconds = |k: usize| {
            let late = problem.free.iter().zip(&fits[k].parameters);
            let late = late.filter(|((i, _), _)| problem.delayed(*i).is_some());
            late.map(|(&(i, size), z)| problem.nominal(i) + size * z).collect::<Vec<f64>>()
        };
        let others = (0..fits.len()).filter(|k| *k != taken && cost(k) <= close);
        let alike = others.map(seconds).collect();
        let mut fit = fits.swap_remove(taken);
        let step_s = problem.simulator.step_s;
        let longest_s = problem.reach as f64 * step_s;
        let mut most_s: f64 = 0.0;
        for (at, least) in prior.iter().enumerate().take(problem.free.len()) {
            let (i, size) = problem.free[at];
            if problem.delayed(i).is_none() {
                continue;
            }
            let nominal = problem.nominal(i);
            let found = nominal + size * fit.parameters[at];
            // The information exceeds the prior's.
            let seen = fit.normal.information.get((at, at)).is_some_and(|n| *n > 2.0 * least);
            let new = if seen { nominal.max(found).max(step_s) } else { longest_s.max(step_s) };
            problem.free[at].1 = new;
            fit.parameters[at] = (found - nominal) / new;
            most_s = most_s.max(if seen { found } else { longest_s });
        }
        // Half as long again plus two samples: the possible change in another round.
        let reach = (1.5 * most_s / step_s).ceil() as usize + 2;
        problem.reach(reach.min(problem.reach));
        Ok((fit, alike))
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
        // Weights change with every round: only the last round needs an accurate minimum.
        let tolerance = if round + 1 >= rounds { 1e-5 } else { 1e-3 };
        let [lower, upper] = problem.bounds();
        let search = LevenbergMarquardt {
            max_iterations: 30,
            gradient_tolerance: tolerance,
            step_tolerance: tolerance,
            lower,
            upper,
            ..Default::default()
        };
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

    /// λ of every unknown: equal for the shared ones; for a record's own by their deviations.
    fn prior(&self, problem: &StructuredProblem<'_>, shrinkage: f64, own_size: &[f64]) -> Vec<f64> {
        let own = own_size.iter().map(|size| 1.0 / (size * size)).collect::<Vec<_>>();
        let late = |i: usize| problem.delayed(i).is_some();
        let of = |&(i, _): &(usize, f64)| if late(i) { shrinkage::WEAKEST } else { shrinkage };
        let shared = problem.free.iter().map(of);
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

/// Each parameter's size: its own value, or, for the value 0, the change that moves the predictions by their errors. The size of a dead time is at least one
/// sample, because its hold lasts one.
pub(super) fn sizes(problem: &mut StructuredProblem<'_>, clusters: &[Normal]) {
    let nothing = vec![0.0; problem.unknowns()];
    let normal = problem.normal(clusters, &nothing, &nothing);
    let shared = problem.free.len();
    let size = |nominal: f64, information: f64| match nominal {
        0.0 if information > 0.0 && normal.cost > 0.0 => (normal.cost / information).sqrt(),
        0.0 => 1.0,
        nominal => nominal.abs(),
    };
    let (quantities, step_s) = (problem.quantities, problem.simulator.step_s);
    let first_delay = problem.simulator.equations.parameters().len();
    let size = |i: usize, information: f64| {
        let nominal = quantities[i].nominal;
        if i < first_delay { size(nominal, information) } else { nominal.max(step_s) }
    };
    for (at, entry) in problem.free.iter_mut().enumerate() {
        entry.1 = size(entry.0, normal.information[(at, at)]);
    }
    let (own, records) = (problem.own.len(), problem.records.len());
    for (at, entry) in problem.own.iter_mut().enumerate() {
        let information =
            (0..records).map(|r| shared + r * own + at).map(|i| normal.information[(i, i)]).sum();
        entry.1 = size(entry.0, information);
    }
}

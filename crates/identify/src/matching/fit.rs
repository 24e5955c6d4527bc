//! Parameters of a model file, matched to an identified model.

use super::error::MatchingError;
use super::norms::{self, At, NORMS, Norm};
use super::options::Matching;
use super::prior::{HELD, Prior};
use super::problem::{Descent, MatchProblem, Parts};
use super::structure::{Free, Structure};
use super::system::{GainMatrix, System};
use super::target::Target;
use super::{grid, problem, structure};
use crate::error::Result;
use crate::structured::known::{Known, RESOLVED, Standing, Unseen, standing};
use deadtime_model::{EquationsFile, NuGap, Peak};
use deadtime_signal::decompositions::{singular_values, symmetric_eigen};
use deadtime_signal::parallel;
use deadtime_signal::stats::interval95;
use nalgebra::{Complex, DMatrix, DVector, SymmetricEigen};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use serde::Serialize;

/// Magnitudes are raised to this share of a pair's largest: relative errors of smaller ones are uninformative.
pub(super) const FLOOR: f64 = 1e-3;

/// Drawn models behind the standard deviations of a norm that is no sum of squares.
pub(super) const DRAWS: u64 = 64;

/// Number of the search's last powers for drawn models, which suffice because these models are close.
pub(super) const AGAIN: usize = 3;

/// Number of refinements: frequencies between those of the grid with a larger difference are added.
pub(super) const ADDED: usize = 4;

/// Standard deviations at one frequency and pair beyond which the structure does not follow the identified model.
pub(super) const MISFIT: f64 = 5.0;

/// A matched parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MatchedParameter {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The file's value.
    pub nominal: f64,
    /// The matched value.
    pub value: f64,
    /// Its standard deviation; `None` where the identified model's file has none.
    pub std: Option<f64>,
    /// 95 % interval.
    pub interval: Option<[f64; 2]>,
    /// The interpretation of the value as the physical quantity.
    pub standing: Standing,
}

/// The largest difference of two responses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Misfit {
    /// rad/s.
    pub omega_rad_s: f64,
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// The difference over the identified model's standard deviation (over its magnitude where that is unknown).
    pub size: f64,
}

/// The compared responses of one pair of channels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// Frequency by frequency.
    pub points: Vec<ComparedPoint>,
}

/// The responses at one frequency, real and imaginary part.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ComparedPoint {
    /// rad/s.
    pub omega_rad_s: f64,
    /// Of the identified model.
    pub identified: [f64; 2],
    /// Standard deviations of its gain and of its phase (rad), to first order; `None` where they are unknown.
    pub std: Option<[f64; 2]>,
    /// Of the structured model with the file's values.
    pub nominal: [f64; 2],
    /// Of the structured model with the matched values.
    pub found: [f64; 2],
}

/// The result of a match.
#[derive(Debug, Clone, Serialize)]
pub struct Matched {
    /// `deadtime/match@1`.
    pub format: &'static str,
    /// The structured model's name.
    pub structure: String,
    /// The identified model's name.
    pub identified: String,
    /// The norm.
    pub norm: &'static str,
    /// The band, rad/s.
    pub band_rad_s: [f64; 2],
    /// Number of compared frequencies.
    pub frequencies: usize,
    /// The identified model's sample time, s; `None` in continuous time.
    pub sample_time_s: Option<f64>,
    /// The parameters.
    pub parameters: Vec<MatchedParameter>,
    /// Combinations that are not identifiable.
    pub unseen: Vec<Unseen>,
    /// Sentences on correlated pairs.
    pub trades: Vec<String>,
    /// The norm of the difference with the file's values, and with the matched ones.
    pub difference: [f64; 2],
    /// The largest gain of the difference over the band, with the file's values and with the matched ones.
    pub largest_gain: [Gain; 2],
    /// The nu-gap of the two models over all frequencies; `None` where it has no value.
    pub nu_gap: Option<NuGap>,
    /// Numbers of unstable poles: of the identified model and of the structured one.
    pub unstable_poles: [usize; 2],
    /// The largest difference relative to its uncertainty.
    pub misfit: Misfit,
    /// The compared responses.
    pub responses: Vec<Compared>,
    /// The identified model has an uncertainty.
    pub uncertainty: bool,
    /// Starts of the search, and how many ended at the lowest minimum.
    pub starts: [usize; 2],
    /// The search ended at a minimum.
    pub converged: bool,
    /// Prior standard deviation of the file's values, as a share of each; `None` without a prior.
    pub prior: Option<f64>,
    /// Notes for the reader.
    pub notes: Vec<String>,
    /// The structured model with the matched values.
    #[serde(skip)]
    pub model: Option<EquationsFile>,
}

/// A largest gain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gain {
    /// In outputs' units per inputs'.
    pub gain: f64,
    /// Its frequency, rad/s.
    pub omega_rad_s: f64,
    /// `true`: by level sets; `false`: the largest of the grid, because continuous models behind different delays are not rational.
    pub exact: bool,
}

impl Matching {
    /// Finds the free parameters of `file` whose response is closest to that of `target`.
    ///
    /// # Errors
    /// [`MatchingError`]; [`deadtime_model::ModelError`] for equations that do not compile; [`deadtime_signal::registry::RegistryError`] for an unknown
    /// norm.
    pub fn fit(&self, file: &EquationsFile, target: &Target) -> Result<Matched> {
        let norm = norms::norm(&self.norm)?;
        self.check()?;
        let structure = Structure::new(self, file, target)?;
        let band = grid::band(&structure.target, target.lowest_rad_s, self.band)?;
        let omegas = grid::frequencies(&structure.target, band);
        let no_response = || MatchingError::NoResponse { model: file.name.clone() };
        let mut problem = MatchProblem {
            structure: &structure,
            at: points(&structure, &omegas).ok_or_else(no_response)?,
            omegas,
            sizes: Vec::new(),
        };
        problem.sizes = sizes(&problem).ok_or_else(no_response)?;
        let zero = vec![0.0; problem.sizes.len()];
        let prior = problem.prior(norm, self.prior);
        let (found, alike) =
            self.search(&mut problem, norm, prior, band).ok_or_else(no_response)?;
        if !found.converged {
            let (model, steps) = (file.name.clone(), problem::MOST_STEPS);
            return Err(MatchingError::NoMinimum { model, steps, difference: found.value }.into());
        }
        let own = |z: &[f64]| {
            Some(problem::normal(&problem.parts(norm, z)?, *norm.powers.last()?).cost.sqrt())
        };
        let difference =
            [own(&zero).ok_or_else(no_response)?, own(&found.z).ok_or_else(no_response)?];
        let matched = structure.system(&problem.values(&found.z))?;
        let mut answer = Matched {
            format: "deadtime/match@1",
            structure: file.name.clone(),
            identified: target.name.clone(),
            norm: norm.name,
            band_rad_s: band,
            frequencies: problem.omegas.len(),
            sample_time_s: structure.target.sample_time_s(),
            parameters: Vec::new(),
            unseen: Vec::new(),
            trades: Vec::new(),
            difference,
            largest_gain: [
                largest_gain(&problem, &zero, band)?,
                largest_gain(&problem, &found.z, band)?,
            ],
            nu_gap: structure.target.nu_gap(&matched),
            unstable_poles: [structure.target.unstable(), matched.unstable()],
            misfit: misfit(&problem, &found.z, target).ok_or_else(no_response)?,
            responses: compared(&problem, &found.z, target).ok_or_else(no_response)?,
            uncertainty: target.has_uncertainty(),
            starts: [self.starts.max(1), alike],
            converged: found.converged,
            prior: prior.map(|p| p.spread),
            notes: structure.notes.clone(),
            model: Some(structure.file_with(&problem.values(&found.z))),
        };
        know(&problem, norm, (&found, prior), &mut answer).ok_or_else(no_response)?;
        answer.remark();
        Ok(answer)
    }

    /// The check of the options' ranges.
    fn check(&self) -> Result<()> {
        if let Some(value) = self.prior.filter(|share| share.is_nan() || *share <= 0.0) {
            let rule = "it must be above 0; inf holds nothing".to_owned();
            return Err(MatchingError::Option { option: "prior", value, rule }.into());
        }
        Ok(())
    }

    /// The lowest minimum, and the number of starts that ended at it.
    fn search(
        &self,
        problem: &mut MatchProblem<'_>,
        norm: &Norm,
        prior: Option<Prior>,
        band: [f64; 2],
    ) -> Option<(Descent, usize)> {
        let first =
            if norm.name == NORMS[0].name { prior } else { problem.prior(&NORMS[0], self.prior) };
        let (found, alike) = problem.best(norm, [first, prior], self.starts)?;
        if norm.name == "hinf" {
            return Some((problem.refined(norm, found, band)?, alike.max(1)));
        }
        Some((found, alike))
    }
}

impl Matched {
    fn remark(&mut self) {
        let [identified, structured] = self.unstable_poles;
        if identified != structured {
            self.notes.push(format!(
                "the identified model has {identified} unstable poles, the structured one {structured}: their responses may be near and the models are not (see the nu-gap)"
            ));
        }
        if !self.uncertainty {
            self.notes.push(
                "the identified model's file says nothing of its uncertainty, so there are no intervals; match the report of an identification by pbsidopt to have them"
                    .to_owned(),
            );
        } else if self.misfit.size > MISFIT {
            let Misfit { omega_rad_s, input, output, size } = &self.misfit;
            self.notes.push(format!(
                "the structure does not follow what was identified: {size:.1} standard deviations from {input} to {output} at {omega_rad_s:.3} rad/s; \
                 the intervals are those of the nearest such model, not of the physics"
            ));
        }
        let [all, alike] = self.starts;
        if all > 1 && alike * 4 <= all {
            self.notes.push(format!("{alike} of {all} starts ended at the lowest minimum: there may be a lower one; take more starts"));
        }
    }
}

impl MatchProblem<'_> {
    /// A further search with added frequencies, between those of the grid, at which the difference is larger.
    fn refined(&mut self, norm: &Norm, mut found: Descent, band: [f64; 2]) -> Option<Descent> {
        for _ in 0..ADDED {
            let peak = largest_gain(self, &found.z, band).ok();
            let (Some(peak), Some(seen)) = (peak, grid_gain(self, &found.z)) else { break };
            if !peak.exact || peak.gain <= seen.gain * 1.0005 {
                break;
            }
            self.omegas.push(peak.omega_rad_s);
            self.omegas.sort_by(f64::total_cmp);
            self.at = points(self.structure, &self.omegas)?;
            found = self.descend(norm, norm.powers, None, &found.z)?;
        }
        Some(found)
    }
}

/// Target, weights and shares at each frequency; `None` where the identified model's response is not finite.
pub(super) fn points(structure: &Structure<'_>, omegas: &[f64]) -> Option<Vec<At>> {
    let target = structure::finite_responses(&structure.target, omegas)?;
    let deviations = deviations(structure, omegas, &target)?;
    let (p, m) = target.first()?.shape();
    let peak =
        DMatrix::from_fn(p, m, |i, j| target.iter().map(|g| g[(i, j)].norm()).fold(0.0, f64::max));
    let whole = peak.max();
    let widths = grid::widths(omegas, |w| w);
    let logs = grid::widths(omegas, f64::ln);
    let band: f64 = logs.iter().sum();
    let weight = |k: usize, i: usize, j: usize| {
        let floor =
            FLOOR * if peak[(i, j)] > 0.0 { peak[(i, j)] } else { whole }.max(f64::MIN_POSITIVE);
        match deviations.as_slice() {
            [] => 1.0 / target[k][(i, j)].norm().max(floor),
            list => {
                1.0 / list
                    .iter()
                    .map(|d| d[k][(i, j)].norm_sqr())
                    .sum::<f64>()
                    .sqrt()
                    .max(1e-6 * floor)
            }
        }
    };
    let step_s = structure.target.sample_time_s().unwrap_or(1.0);
    Some(
        (0..omegas.len())
            .map(|k| At {
                weight: DMatrix::from_fn(p, m, |i, j| weight(k, i, j)),
                target: target[k].clone(),
                share: logs[k] / band,
                width_rad_s: widths[k],
                step_s,
            })
            .collect(),
    )
}

/// The effect of each deviation of one standard deviation on the response, `[deviation][frequency]`.
pub(super) fn deviations(
    structure: &Structure<'_>,
    omegas: &[f64],
    target: &[GainMatrix],
) -> Option<Vec<Vec<GainMatrix>>> {
    let of = |moved: &System| {
        let moved = structure::finite_responses(moved, omegas)?;
        Some(target.iter().zip(&moved).map(|(g, h)| Target::slope(g, h)).collect())
    };
    parallel::try_map(&structure.deviations, of)
}

/// Each parameter's size: its own value, or, for the value 0, the change that moves the response by its own magnitude.
pub(super) fn sizes(problem: &MatchProblem<'_>) -> Option<Vec<f64>> {
    let nominal = &problem.structure.nominal;
    // A delay of half a radian at the end of the band is well visible there, and linear.
    let late = 0.5 / problem.omegas.last()?;
    let first: Vec<f64> = nominal
        .iter()
        .zip(&problem.structure.free)
        .map(|(v, free)| match (*v, free) {
            (_, Free::Delay(_)) => v.max(late),
            (0.0, _) => 1.0,
            (v, _) => v.abs(),
        })
        .collect();
    let trial = MatchProblem {
        structure: problem.structure,
        omegas: problem.omegas.clone(),
        at: points(problem.structure, &problem.omegas)?,
        sizes: first.clone(),
    };
    let parts = trial.parts(&NORMS[0], &vec![0.0; first.len()])?;
    let whole: f64 = trial
        .at
        .iter()
        .map(|at| (NORMS[0].difference)(at, &(&at.target * Complex::new(0.0, 0.0))).norm_squared())
        .sum();
    let moved = problem::normal(&parts, 2.0).information.diagonal();
    let of = |(j, size): (usize, &f64)| {
        let unknown = nominal[j] == 0.0 && matches!(problem.structure.free[j], Free::Parameter(_));
        if unknown && moved[j] > 0.0 && whole > 0.0 { (whole / moved[j]).sqrt() } else { *size }
    };
    Some(first.iter().enumerate().map(of).collect())
}

pub(super) fn grid_gain(problem: &MatchProblem<'_>, z: &[f64]) -> Option<Peak> {
    let sys = problem.structure.system(&problem.values(z)).ok()?;
    let gains = problem.omegas.iter().zip(&problem.at).filter_map(|(&omega_rad_s, at)| {
        let gain = singular_values(&(sys.response(omega_rad_s) - &at.target))?.max();
        Some(Peak { gain, omega_rad_s })
    });
    gains.max_by(|a, b| a.gain.total_cmp(&b.gain))
}

pub(super) fn largest_gain(problem: &MatchProblem<'_>, z: &[f64], band: [f64; 2]) -> Result<Gain> {
    let sys = problem.structure.system(&problem.values(z))?;
    let (found, exact) = match problem.structure.target.farthest(&sys, band) {
        Some(peak) => (peak, true),
        None => (
            grid_gain(problem, z).unwrap_or(Peak { gain: f64::INFINITY, omega_rad_s: f64::NAN }),
            false,
        ),
    };
    Ok(Gain { gain: found.gain, omega_rad_s: found.omega_rad_s, exact })
}

pub(super) fn misfit(problem: &MatchProblem<'_>, z: &[f64], target: &Target) -> Option<Misfit> {
    let sys = problem.structure.system(&problem.values(z)).ok()?;
    let mut worst = (0.0, 0, 0, 0);
    for (k, (at, &omega)) in problem.at.iter().zip(&problem.omegas).enumerate() {
        let apart = (sys.response(omega) - &at.target).zip_map(&at.weight, |d, w| d * w);
        for i in 0..apart.nrows() {
            for j in 0..apart.ncols() {
                if apart[(i, j)].norm() > worst.0 {
                    worst = (apart[(i, j)].norm(), k, i, j);
                }
            }
        }
    }
    let (size, k, i, j) = worst;
    let shared = problem.structure.output_names(target);
    let (input, output) = (target.inputs.get(j)?.name.clone(), shared.get(i)?.clone());
    Some(Misfit { omega_rad_s: *problem.omegas.get(k)?, input, output, size })
}

/// The responses of both models, pair by pair.
pub(super) fn compared(
    problem: &MatchProblem<'_>,
    z: &[f64],
    target: &Target,
) -> Option<Vec<Compared>> {
    let structure = problem.structure;
    let of = |values: &[f64]| {
        structure::finite_responses(&structure.system(values).ok()?, &problem.omegas)
    };
    let (nominal, found) = (of(&structure.nominal)?, of(&problem.values(z))?);
    let identified: Vec<GainMatrix> = problem.at.iter().map(|at| at.target.clone()).collect();
    let deviations = deviations(structure, &problem.omegas, &identified)?;
    let parts = |v: Complex<f64>| [v.re, v.im];
    let mut all = Vec::new();
    for (j, input) in target.inputs.iter().enumerate() {
        for (i, output) in structure.output_names(target).into_iter().enumerate() {
            // The component along G changes its gain, the component across it its phase.
            let std = |k: usize| {
                let g: Complex<f64> = identified[k][(i, j)];
                let along = deviations.iter().map(|d| g.conj() * d[k][(i, j)] / g.norm());
                let [gain, across] = along
                    .fold([0.0, 0.0], |[a, b], v| [a + v.re * v.re, b + v.im * v.im])
                    .map(f64::sqrt);
                [gain, across / g.norm()]
            };
            let point = |(k, &omega_rad_s): (usize, &f64)| ComparedPoint {
                omega_rad_s,
                identified: parts(identified[k][(i, j)]),
                std: target.has_uncertainty().then(|| std(k)),
                nominal: parts(nominal[k][(i, j)]),
                found: parts(found[k][(i, j)]),
            };
            all.push(Compared {
                input: input.name.clone(),
                output,
                points: problem.omegas.iter().enumerate().map(point).collect(),
            });
        }
    }
    Some(all)
}

/// The uncertainty of a match, in the parameters' sizes.
struct Uncertainty {
    /// The covariance; under the prior where there is one.
    covariance: DMatrix<f64>,
    /// The information without the prior; its weak directions are the unidentifiable combinations.
    information: DMatrix<f64>,
    /// The identified model's file has no uncertainty.
    is_unknown: bool,
}

impl Uncertainty {
    /// The uncertainty at the end of the search.
    fn of(
        problem: &MatchProblem<'_>,
        norm: &Norm,
        (found, prior): (&Descent, Option<Prior>),
    ) -> Option<Self> {
        let parts = problem.parts(norm, &found.z)?;
        let information = problem::normal(&parts, 2.0).information;
        let eigen = symmetric_eigen(&information)?;
        let most = eigen.eigenvalues.max();
        let target: Vec<GainMatrix> = problem.at.iter().map(|at| at.target.clone()).collect();
        let deviations = deviations(problem.structure, &problem.omegas, &target)?;
        let mut covariance = if norm.powers == [2.0] {
            to_first_order(problem, norm, &parts, &deviations, &inverted(&eigen))
        } else {
            of_draws(problem, norm, found, &deviations)
        };
        let mut posterior = prior.filter(|_| !deviations.is_empty()).and_then(|prior| {
            with_prior(problem, norm, (&parts, &deviations), (&information, &prior))
        });
        for at in 0..found.z.len() {
            let late = delay_variance(problem, at);
            covariance[(at, at)] += late;
            if let Some(posterior) = &mut posterior {
                posterior[(at, at)] += late;
            }
        }
        // Without uncertainty only unresolvable combinations are reported: the other parameters count as known.
        let scaled = if deviations.is_empty() {
            &information / (RESOLVED * most).max(f64::MIN_POSITIVE)
        } else {
            inverse(&covariance, &eigen, most)?
        };
        add_unresolved(&mut covariance, &eigen);
        Some(Self {
            covariance: posterior.unwrap_or(covariance),
            information: scaled,
            is_unknown: deviations.is_empty(),
        })
    }
}

/// Adds the parameters' own size to the covariance along each unresolved direction.
fn add_unresolved(covariance: &mut DMatrix<f64>, eigen: &SymmetricEigen<f64, nalgebra::Dyn>) {
    let most = eigen.eigenvalues.max();
    let resolved = |k: &usize| eigen.eigenvalues[*k] > RESOLVED * most;
    for k in (0..eigen.eigenvalues.len()).filter(|k| !resolved(k)) {
        let direction = eigen.eigenvectors.column(k);
        *covariance += direction * direction.transpose();
    }
}

/// The estimate with its uncertainty, each delay in its own matched size.
fn known<'a>(
    problem: &MatchProblem<'_>,
    names: &'a [String],
    values: &[f64],
    Uncertainty { covariance, information, .. }: &Uncertainty,
) -> Known<'a> {
    let count = names.len();
    // A matched delay is its own size; the search used the resolution of the highest frequency.
    let size = |at: usize| match problem.structure.free[at] {
        Free::Delay(_) => problem.sizes[at].max(values[at]),
        Free::Parameter(_) => problem.sizes[at],
    };
    let sizes: Vec<f64> = (0..count).map(size).collect();
    let ratio = |at: usize| problem.sizes[at] / sizes[at];
    Known {
        names: names.iter().map(String::as_str).collect(),
        values: values.to_vec(),
        information: DMatrix::from_fn(count, count, |i, j| {
            information[(i, j)] / (ratio(i) * ratio(j))
        }),
        covariance: DMatrix::from_fn(count, count, |i, j| covariance[(i, j)] * ratio(i) * ratio(j)),
        sizes,
        source: "the responses do",
    }
}

/// Standard deviations from the identified model's, unidentifiable combinations, and the interpretation of each value.
fn know(
    problem: &MatchProblem<'_>,
    norm: &Norm,
    (found, prior): (&Descent, Option<Prior>),
    answer: &mut Matched,
) -> Option<()> {
    let (structure, count) = (problem.structure, found.z.len());
    let uncertainty = Uncertainty::of(problem, norm, (found, prior))?;
    let values = problem.values(&found.z);
    let names: Vec<String> = (0..count).map(|at| structure.name(at)).collect();
    let known = known(problem, &names, &values, &uncertainty);
    answer.unseen = known.unseen();
    let mut traded = vec![false; count];
    if !uncertainty.is_unknown {
        (answer.trades, traded) = known.trades();
    }
    for (at, name) in names.iter().enumerate() {
        let variance = uncertainty.covariance[(at, at)];
        let std = (!uncertainty.is_unknown).then(|| problem.sizes[at] * variance.max(0.0).sqrt());
        let lost = traded[at]
            || answer.unseen.iter().any(|u| u.parts.iter().any(|(part, _)| part == name));
        let (value, nominal) = (values[at], structure.nominal[at]);
        let held =
            prior.is_some_and(|p| problem.held()[at] && variance >= (HELD * p.spread).powi(2));
        answer.parameters.push(MatchedParameter {
            name: name.clone(),
            unit: structure.unit(at),
            nominal,
            value,
            std,
            interval: std.map(|s| interval95(value, s)),
            standing: if held {
                Standing::Held
            } else {
                standing(nominal, [value, std.unwrap_or(0.0)], None, lost, 0.0)
            },
        });
    }
    Some(())
}

/// The variance of a delay, in its size, from half a sample either way. The identified model's dead times are whole samples, and exact in its covariance.
fn delay_variance(problem: &MatchProblem<'_>, at: usize) -> f64 {
    let late = problem
        .structure
        .identified_delay_s(at)
        .filter(|(delay_s, _)| *delay_s > 0.0)
        .map_or(0.0, |(_, step_s)| step_s);
    (late * late / 12.0) / (problem.sizes[at] * problem.sizes[at])
}

/// The inverse of an information matrix over its resolved directions.
fn inverted(eigen: &SymmetricEigen<f64, nalgebra::Dyn>) -> DMatrix<f64> {
    let most = eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|v| if v > RESOLVED * most { 1.0 / v } else { 0.0 });
    &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose()
}

/// The covariance for a sum of squares: to first order the minimum moves by H⁻¹Jᵀ times the change of the difference.
fn to_first_order(
    problem: &MatchProblem<'_>,
    norm: &Norm,
    parts: &Parts,
    deviations: &[Vec<GainMatrix>],
    inverse: &DMatrix<f64>,
) -> DMatrix<f64> {
    let count = inverse.nrows();
    let mut covariance = DMatrix::zeros(count, count);
    for deviation in deviations {
        let mut pull = DVector::zeros(count);
        for ((at, (psi, slopes)), d) in problem.at.iter().zip(parts).zip(deviation) {
            let moved =
                (norm.difference)(at, &(&at.target + d)) - (norm.difference)(at, &at.target);
            debug_assert_eq!(psi.shape(), moved.shape());
            slopes.iter().enumerate().for_each(|(a, slope)| pull[a] += slope.dotc(&moved).re);
        }
        let step = inverse * pull;
        covariance += &step * step.transpose();
    }
    covariance
}

/// The same for a minimum with a prior, over the noise and over the prior's truths. The covariance is A (Σ + w²τ²) A with A = (H + w)⁻¹, w on the held
/// parameters.
fn with_prior(
    problem: &MatchProblem<'_>,
    norm: &Norm,
    (parts, deviations): (&Parts, &[Vec<GainMatrix>]),
    (information, prior): (&DMatrix<f64>, &Prior),
) -> Option<DMatrix<f64>> {
    let weights: Vec<f64> =
        problem.held().iter().map(|held| if *held { prior.weight } else { 0.0 }).collect();
    let weights = DMatrix::from_diagonal(&DVector::from_vec(weights));
    let inverse = (information + &weights).cholesky()?.inverse();
    let by_truth = &inverse * (&weights * prior.spread);
    Some(
        to_first_order(problem, norm, parts, deviations, &inverse)
            + &by_truth * by_truth.transpose(),
    )
}

/// The covariance where the largest value is no smooth function of the response: the match is repeated for models drawn from the noise.
fn of_draws(
    problem: &MatchProblem<'_>,
    norm: &Norm,
    found: &Descent,
    deviations: &[Vec<GainMatrix>],
) -> DMatrix<f64> {
    let count = found.z.len();
    let mut covariance = DMatrix::zeros(count, count);
    if deviations.is_empty() {
        return covariance;
    }
    let again = |draw: u64| {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        random.set_stream(draw);
        let sizes: Vec<f64> = deviations.iter().map(|_| random.sample(StandardNormal)).collect();
        let mut drawn = MatchProblem {
            structure: problem.structure,
            omegas: problem.omegas.clone(),
            at: points(problem.structure, &problem.omegas)?,
            sizes: problem.sizes.clone(),
        };
        for (k, at) in drawn.at.iter_mut().enumerate() {
            for (d, size) in deviations.iter().zip(&sizes) {
                at.target += &d[k] * Complex::new(*size, 0.0);
            }
        }
        let last = &norm.powers[norm.powers.len().saturating_sub(AGAIN)..];
        drawn.descend(norm, last, None, &found.z).map(|d| d.z)
    };
    let drawn: Vec<Option<Vec<f64>>> = parallel::map(0..DRAWS, again);
    let ends: Vec<Vec<f64>> = drawn.into_iter().flatten().collect();
    for end in &ends {
        let step = DVector::from_iterator(count, end.iter().zip(&found.z).map(|(a, b)| a - b));
        covariance += &step * step.transpose() / ends.len() as f64;
    }
    covariance
}

/// The inverse of a covariance. Unresolved directions of the information have none; exactly known ones are limited so that all others remain resolved.
pub(super) fn inverse(
    covariance: &DMatrix<f64>,
    information: &SymmetricEigen<f64, nalgebra::Dyn>,
    most: f64,
) -> Option<DMatrix<f64>> {
    let count = covariance.nrows();
    let mut whole = covariance.clone();
    let least =
        (10.0 * RESOLVED * symmetric_eigen(&whole)?.eigenvalues.max()).max(f64::MIN_POSITIVE);
    for k in (0..count).filter(|k| information.eigenvalues[*k] <= RESOLVED * most) {
        let direction = information.eigenvectors.column(k);
        whole += direction * direction.transpose() / RESOLVED;
    }
    let eigen = symmetric_eigen(&whole)?;
    Some(
        &eigen.eigenvectors
            * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| 1.0 / v.max(least)))
            * eigen.eigenvectors.transpose(),
    )
}

//! Transfer functions of given orders by refined instrumental variables, of one output and one or more inputs.

use std::borrow::Cow;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::error::IdentifyError;
use super::iv::{IvFit, IvInput, IvProblem, RefinedIv, noise_model};
use super::parametric::{Cloud, Parameter, Parametric, given, usable};
use crate::rival::{FAR, Rival, polynomial};
use crate::subspace::identifier::{Identified, Identifier};
use crate::subspace::innovations::{Direct, InnovationsModel};
use crate::subspace::recordings::{Recordings, Scales, Stretch};
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stats::{self, interval95};

/// y = Σ B_j(q)/F(q)·u_j(t − nk_j) + e/D(q), by refined instrumental variables. F is common to all inputs; each has a B and a dead time of its own.
///
/// The structure includes inputs with poles of their own: F is then the product of their polynomials, and each B has correspondingly more coefficients. Every
/// delay up to `max_delay` is tested, for several inputs one input after the other until convergence; the smallest loss decides. Every record has its own
/// offset and initial state. Intervals come from the asymptotic covariance (`RefinedIv`), given the delays; they are valid where D is the noise's own.
/// Assumes: open loop, persistently exciting inputs, a stable plant.
/// Fails when: the input depends on the output (biased). With too few coefficients, noise or dead time absorb the remainder. Noise other than an autoregression
/// invalidates the intervals.
/// Source: Young (2011), "Recursive Estimation and Time-Series Analysis", 2nd ed., chapter 7, doi:10.1007/978-3-642-21981-8; Jakeman and Young (1979),
/// Int. J. Control 29(4), 621-644, doi:10.1080/00207177908922724 (several inputs, covariance).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Riv {
    /// Coefficients of F, the poles; default 2. `order` is a synonym.
    #[serde(alias = "order")]
    pub nf: usize,
    /// Coefficients of B, for each input; default 2.
    pub nb: usize,
    /// Coefficients of D, the noise's poles; `None`: by Schwarz's criterion, at most 10.
    pub noise: Option<usize>,
    /// The lag of each input's first coefficient, samples; `None`: searched.
    pub nk: Option<Vec<usize>>,
    /// Longest lag searched, samples; default 35.
    pub max_delay: usize,
    /// Whether inputs act within the sample: lags from 0 on; default no, lags from 1 on.
    pub direct: Direct,
    /// Drawn models for bands, and as many small ones for standard deviations of poles; default 200; 0: none.
    pub draws: usize,
    /// Seed of the draws; default 1.
    pub seed: u64,
}

impl Default for Riv {
    fn default() -> Self {
        Self {
            nf: 2,
            nb: 2,
            noise: None,
            nk: None,
            max_delay: 35,
            direct: Direct::None,
            draws: 200,
            seed: 1,
        }
    }
}

const NAME: &str = "riv";
/// Largest number of noise poles tested.
const NOISE: usize = 10;
/// Number of noise poles during the search of delays.
const ROUGH_NOISE: usize = 2;
/// Largest number of passes over the delays of all inputs.
const TURNS: usize = 6;
/// False-alarm probability of a response.
const BY_CHANCE: f64 = 0.003;
/// Largest number of records, or stretches between gaps, with estimated initial states.
const STRETCHES: usize = 100;

/// Stretches in scaled units, and their cuts: the output starts after the longest lag.
struct Data {
    scaled: Vec<Stretch>,
    longest: usize,
    /// Coefficients of an initial state.
    starts: usize,
}

impl Data {
    /// The inputs at these lags, then the initial state and the offset of every stretch, as inputs of their own.
    ///
    /// An initial state is C/F of an impulse. The initial state represents the plant's response to earlier inputs, including those that B reaches.
    fn problem<'a>(&'a self, lags: &[usize], nb: usize, outputs: &'a [Vec<f64>]) -> IvProblem<'a> {
        let rows = |s: &Stretch| s.len() - self.longest;
        let input = |(j, lag): (usize, &usize)| {
            let late = |s: &Stretch| {
                Some(Cow::Owned(
                    (0..rows(s)).map(|t| s.u[(j, t + self.longest - lag)]).collect::<Vec<f64>>(),
                ))
            };
            IvInput { samples: self.scaled.iter().map(late).collect(), lag: 0, count: nb }
        };
        let mut inputs: Vec<IvInput<'a>> = lags.iter().enumerate().map(input).collect();
        for r in 0..self.scaled.len() {
            let alone = |from: fn(usize) -> f64| {
                let of = |(i, s): (usize, &Stretch)| {
                    (i == r).then(|| Cow::Owned((0..rows(s)).map(from).collect::<Vec<f64>>()))
                };
                self.scaled.iter().enumerate().map(of).collect()
            };
            inputs.push(IvInput {
                samples: alone(|t| f64::from(u8::from(t == 0))),
                lag: 0,
                count: self.starts,
            });
            inputs.push(IvInput { samples: alone(|_| 1.0), lag: 0, count: 1 });
        }
        IvProblem { inputs, outputs: outputs.iter().map(Vec::as_slice).collect() }
    }
}

impl Identifier for Riv {
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        let m = recordings.inputs.len();
        let (nf, nb) = (self.nf, self.nb);
        let (from, to) = self.lags(m)?;
        let longest = to.iter().copied().max().unwrap_or(0);
        let starts = nf.max(nb - 1);
        let (used, said) = usable(NAME, recordings, longest + 3 * (nf + m * nb + starts + 1))?;
        if used.stretches.len() > STRETCHES {
            return Err(IdentifyError::Option {
                option: "number of stretches without a gap",
                value: used.stretches.len() as f64,
                rule: "at most 100: fill the gaps, or name fewer logs",
            });
        }
        let scales = used.scales()?;
        let data = Data {
            scaled: used.stretches.iter().map(|s| scales.scaled(s)).collect(),
            longest,
            starts,
        };
        let outputs: Vec<Vec<f64>> = data
            .scaled
            .iter()
            .map(|s| s.y.row(0).iter().skip(longest).copied().collect())
            .collect();
        let rough = RefinedIv { nb, nf, noise: self.noise.unwrap_or(ROUGH_NOISE) };
        let search = Search { data: &data, outputs: &outputs, rough, nb };
        let failed =
            |reason: &str| IdentifyError::Unfit { method: NAME, reason: reason.to_owned() };
        let found = search.best(&from, &to, far).ok_or_else(|| {
            failed("no model of these orders is stable and explains the data; take smaller nf and nb, or record with a stronger excitation")
        })?;
        let problem = data.problem(&found.lags, nb, &outputs);
        let orders = self.with_own_noise(rough, &problem, &found.fit);
        let delays: Vec<usize> = found.lags.iter().map(|lag| lag.saturating_sub(1)).collect();
        let rival = Rival::of(&used, &delays, nf);
        let subspace = rival.as_ref().map(|r| polynomial(r.poles.iter().copied()));
        let begun = std::iter::once(found.fit.f.clone())
            .chain(orders.filtered_starts(&problem))
            .chain(subspace);
        let fit = smallest(&orders, &problem, begun.collect())
            .map(|fit| orders.polished(&problem, fit))
            .ok_or_else(|| failed("the rounds have no finite end; take smaller orders"))?;
        let rows: usize = outputs.iter().map(Vec::len).sum();
        let free = nf + m * nb + used.stretches.len() * starts;
        if gain(&outputs, orders.noise, fit.loss) < gain_by_chance(free, longest, rows) {
            return Err(failed(
                "the output does not visibly follow the inputs; check the channels, or record with a stronger excitation",
            ));
        }
        let left = orders.left(&problem, &fit).concat();
        let mean_square = left.iter().map(|e| e * e).sum::<f64>() / rows as f64;
        if rival.is_some_and(|r| mean_square > FAR * r.mean_square) {
            return Err(failed(
                "a subspace model of the same order explains the output far better, so this is not the best model of its orders; take more coefficients of B (nb), \
                 other orders, or --method pbsidopt",
            ));
        }
        let covariance = orders.covariance(&problem, &fit);
        let (lags, ends) = (&found.lags, &found.ends);
        Ok(self.answer(Answer { used: &used, scales, lags, ends, fit, covariance, rows, said }))
    }
}

impl Riv {
    /// The orders of a refit: the noise's own order where none is given.
    fn with_own_noise(
        &self,
        rough: RefinedIv,
        problem: &IvProblem<'_>,
        found: &IvFit,
    ) -> RefinedIv {
        match (self.noise, noise_model(&rough.left(problem, found), NOISE)) {
            (None, Some(noise)) => RefinedIv { noise: noise.d.len(), ..rough },
            _ => rough,
        }
    }

    /// The shortest and the longest lag of each of `m` inputs.
    fn lags(&self, m: usize) -> Result<(Vec<usize>, Vec<usize>), IdentifyError> {
        let refused = |option, value: usize, rule| {
            Err(IdentifyError::Option { option, value: value as f64, rule })
        };
        for (option, value) in
            [("nf", self.nf), ("nb", self.nb), ("noise", self.noise.unwrap_or(1))]
        {
            if !(1..=20).contains(&value) {
                return refused(option, value, "it must be 1 to 20");
            }
        }
        let least = usize::from(self.direct == Direct::None);
        match &self.nk {
            Some(lags) if lags.len() != m => {
                refused("number of lags in nk", lags.len(), "one for each input")
            }
            Some(lags) => Ok((lags.clone(), lags.clone())),
            None => Ok((vec![least; m], vec![self.max_delay.max(least); m])),
        }
    }
}

/// The largest gain by chance of `free` coefficients over all lags up to the longest, of this number of samples.
///
/// Poles may converge to any of N/2 frequencies, where a lag is only a phase. The initial states are free in the model without inputs, too.
fn gain_by_chance(free: usize, longest: usize, rows: usize) -> f64 {
    let tries = (1 + longest) as f64 * (rows as f64 / 2.0).max(1.0);
    ChiSquared::new(free as f64).map_or(0.0, |d| d.inverse_cdf(1.0 - BY_CHANCE / tries))
}

/// Twice the log-likelihood that the inputs add to a noise model alone.
fn gain(outputs: &[Vec<f64>], noise: usize, loss: f64) -> f64 {
    let rows: usize = outputs.iter().map(Vec::len).sum();
    let centred = |y: &Vec<f64>| {
        let mean = stats::mean(y.iter().copied()).unwrap_or(0.0);
        y.iter().map(|v| v - mean).collect()
    };
    let without = noise_model(
        &outputs.iter().map(centred).collect::<Vec<Vec<f64>>>(),
        noise.max(ROUGH_NOISE),
    );
    let without = without.map_or(f64::INFINITY, |w| w.variance);
    rows as f64 * (without / loss.max(f64::MIN_POSITIVE)).ln()
}

/// The model of smallest loss from any of these starts.
fn smallest(orders: &RefinedIv, problem: &IvProblem<'_>, starts: Vec<Vec<f64>>) -> Option<IvFit> {
    let fits: Vec<IvFit> = parallel::filter_map(starts, |start| orders.refine(problem, start));
    fits.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss))
}

/// The data of the search for lags.
struct Search<'a> {
    data: &'a Data,
    outputs: &'a [Vec<f64>],
    rough: RefinedIv,
    nb: usize,
}

/// The lags with the smallest loss, and the first and last equivalent lag of each input.
struct Found {
    lags: Vec<usize>,
    ends: Vec<[usize; 2]>,
    fit: IvFit,
}

impl Search<'_> {
    fn best(&self, from: &[usize], to: &[usize], far: &HowFar) -> Option<Found> {
        let m = from.len();
        let (mut lags, mut ends) =
            (from.to_vec(), from.iter().map(|l| [*l; 2]).collect::<Vec<_>>());
        let mut best: Option<IvFit> = None;
        let turns = if m == 1 { 1 } else { TURNS };
        let steps = far.steps(turns * m, "delays tried");
        for _ in 0..turns {
            let before = lags.clone();
            for j in 0..m {
                let mut all = self.along(&lags, j, (from[j], to[j]), best.as_ref());
                // Once more from the best poles, which one delay may find and its neighbour miss.
                let lowest =
                    all.iter().flatten().min_by(|a, b| a.1.loss.total_cmp(&b.1.loss)).cloned()?;
                let lowest = self.restarted(&lags, j, lowest);
                for (old, new) in
                    all.iter_mut().zip(self.along(&lags, j, (from[j], to[j]), Some(&lowest)))
                {
                    if let Some(new) =
                        new.filter(|n| old.as_ref().is_none_or(|o| n.1.loss < o.1.loss))
                    {
                        *old = Some(new);
                    }
                }
                let (lag, fit) =
                    all.iter().flatten().min_by(|a, b| a.1.loss.total_cmp(&b.1.loss))?.clone();
                ends[j] = self.as_good(&all, fit.loss);
                lags[j] = lag;
                best = Some(fit);
                steps.one_more();
            }
            if lags == before {
                break;
            }
        }
        Some(Found { lags, ends, fit: best? })
    }

    /// The model of smallest loss at this lag of one input, including filtered starts.
    fn restarted(&self, lags: &[usize], input: usize, (lag, fit): (usize, IvFit)) -> IvFit {
        let mut own = lags.to_vec();
        own[input] = lag;
        let problem = self.data.problem(&own, self.nb, self.outputs);
        let others = self.rough.filtered_starts(&problem);
        smallest(&self.rough, &problem, others).filter(|o| o.loss < fit.loss).unwrap_or(fit)
    }

    /// The best model at every lag of one input, with the other lags fixed.
    fn along(
        &self,
        lags: &[usize],
        input: usize,
        (from, to): (usize, usize),
        known: Option<&IvFit>,
    ) -> Vec<Option<(usize, IvFit)>> {
        let at = |lag: usize| {
            let mut own = lags.to_vec();
            own[input] = lag;
            let problem = self.data.problem(&own, self.nb, self.outputs);
            let starts = self.rough.start(&problem).into_iter().chain(known.map(|k| k.f.clone()));
            let fits = starts.filter_map(|start| self.rough.refine(&problem, start));
            fits.min_by(|a, b| a.loss.total_cmp(&b.loss)).map(|fit| (lag, fit))
        };
        parallel::map(from..=to, at)
    }

    /// First and last of the most likely lags with 95 % of the total likelihood.
    fn as_good(&self, all: &[Option<(usize, IvFit)>], best: f64) -> [usize; 2] {
        let rows: usize = self.outputs.iter().map(Vec::len).sum();
        let floor = f64::MIN_POSITIVE;
        let mut weights: Vec<(usize, f64)> = all
            .iter()
            .flatten()
            .map(|(lag, fit)| {
                (*lag, (-0.5 * rows as f64 * (fit.loss.max(floor) / best.max(floor)).ln()).exp())
            })
            .collect();
        weights.sort_by(|a, b| b.1.total_cmp(&a.1));
        let total: f64 = weights.iter().map(|w| w.1).sum();
        let mut held = 0.0;
        let mut ends = [weights.first().map_or(0, |w| w.0); 2];
        for (lag, weight) in weights {
            ends = [ends[0].min(lag), ends[1].max(lag)];
            held += weight;
            if held >= 0.95 * total {
                break;
            }
        }
        ends
    }
}

/// The data of a result.
struct Answer<'a> {
    used: &'a Recordings,
    scales: Scales,
    lags: &'a [usize],
    ends: &'a [[usize; 2]],
    fit: IvFit,
    covariance: Option<DMatrix<f64>>,
    rows: usize,
    said: Option<String>,
}

impl Riv {
    fn answer(&self, mut of: Answer<'_>) -> Identified {
        let (nf, nb, m) = (self.nf, self.nb, of.lags.len());
        let (sy, count) = (of.scales.outputs[0].1, nf + m * nb);
        // f, then every b in the channels' units.
        let unit = |i: usize| if i < nf { 1.0 } else { sy / of.scales.inputs[(i - nf) / nb].1 };
        let values: Vec<f64> = (of.fit.f.iter())
            .chain(of.fit.b.iter().take(m * nb))
            .enumerate()
            .map(|(i, v)| v * unit(i))
            .collect();
        let covariance = of
            .covariance
            .as_ref()
            .map(|c| DMatrix::from_fn(count, count, |i, j| c[(i, j)] * unit(i) * unit(j)));
        let delays: Vec<usize> = of.lags.iter().map(|l| l.saturating_sub(1)).collect();
        // Lags of the first coefficient that remain in the matrices.
        let inside: Vec<usize> = of.lags.iter().zip(&delays).map(|(l, d)| l - d).collect();
        let build = |values: &[f64]| {
            Some((observer(&values[..nf], &values[nf..], &inside), delays.clone()))
        };
        let cloud = covariance.as_ref().and_then(|c| Cloud::of(values.clone(), c, self.seed));
        let draws = cloud.map(|c| c.models(self.draws, &build)).unwrap_or_default();
        let parameters = self.parameters(&of, &values, covariance.as_ref());
        let notes = self.notes(&of);
        of.scales.outputs[0].0 += sy * self.level(&of);
        let Answer { used, scales, fit, rows, .. } = of;
        let model = observer(&values[..nf], &values[nf..], &inside);
        let freedom = (rows as f64 - (fit.b.len() + nf + fit.d.len()) as f64).max(1.0);
        Identified {
            method: NAME,
            sample_time: used.sample_time,
            inputs: used.inputs.clone(),
            outputs: used.outputs.clone(),
            past: fit.d.len(),
            rows,
            order: given(model.order()),
            innovations: DMatrix::from_element(1, 1, fit.loss * rows as f64 / freedom * sy * sy),
            model,
            draws,
            notes,
            scales,
            parametric: Some(Parametric {
                structure: format!(
                    "y(t) = {}B(q)/F(q)·u(t − nk) + e(t)/D(q), B = b0 + b1·q⁻¹ + …, F = 1 + f1·q⁻¹ + …",
                    if m > 1 { "Σ " } else { "" }
                ),
                parameters,
                delays,
                noise: fit.d,
                continuous: None,
                guesses: Vec::new(),
            }),
        }
    }

    /// The lags, then the coefficients in the channels' units.
    fn parameters(
        &self,
        of: &Answer<'_>,
        values: &[f64],
        covariance: Option<&DMatrix<f64>>,
    ) -> Vec<Parameter> {
        let (nf, nb) = (self.nf, self.nb);
        let name = |i: usize| {
            if i < nf {
                return (format!("f{}", i + 1), None);
            }
            let (input, at) = ((i - nf) / nb, (i - nf) % nb);
            (format!("b{at}"), Some(of.used.inputs[input].name.clone()))
        };
        let lags = of.lags.iter().zip(of.ends).zip(&of.used.inputs);
        let lags = lags.map(|((lag, ends), input)| Parameter {
            name: "nk".to_owned(),
            input: Some(input.name.clone()),
            value: *lag as f64,
            unit: Some("samples".to_owned()),
            std: None,
            ci95: Some(ends.map(|e| e as f64)),
        });
        let coefficients = values.iter().enumerate().map(|(i, &value)| {
            let std = covariance.map(|c| c[(i, i)].max(0.0).sqrt());
            let (name, input) = name(i);
            let ci95 = std.map(|s| interval95(value, s));
            Parameter { name, input, value, unit: None, std, ci95 }
        });
        lags.chain(coefficients).collect()
    }

    /// Notes for the reader.
    fn notes(&self, of: &Answer<'_>) -> Vec<String> {
        let mut notes: Vec<String> = of.said.iter().cloned().collect();
        if !of.fit.converged {
            notes.push(
                "the rounds did not settle: orders that are too large or too small for the data; look at the fits of other orders"
                    .to_owned(),
            );
        }
        let searched = of.lags.iter().zip(of.ends).zip(&of.used.inputs);
        for ((lag, [from, to]), input) in searched.filter(|_| self.nk.is_none()) {
            let name = &input.name;
            if from < to {
                notes.push(format!(
                    "{name}: lags from {from} to {to} samples fit about as well; the other intervals are those of {lag}"
                ));
            }
            if *lag == self.max_delay {
                notes.push(format!(
                    "{name}: the best lag is the longest that was searched; set a longer max_delay"
                ));
            }
        }
        if of.lags.len() > 1 {
            notes.push(
                "all inputs have the poles F in common; where they have poles of their own, nf is the number of all and nb as many more"
                    .to_owned(),
            );
        }
        notes
    }

    /// The scaled output's mean offset, weighted by stretch length: the steady state of c/F for an input of 1.
    fn level(&self, of: &Answer<'_>) -> f64 {
        let at_rest = 1.0 + of.fit.f.iter().sum::<f64>();
        let (inputs, each) = (of.lags.len() * self.nb, self.nf.max(self.nb - 1) + 1);
        let weight = |s: &Stretch| s.len() as f64 / of.used.samples().max(1) as f64;
        let settled =
            |r: usize| of.fit.b.get(inputs + r * each + each - 1).map_or(0.0, |c| c / at_rest);
        of.used.stretches.iter().enumerate().map(|(r, s)| settled(r) * weight(s)).sum::<f64>()
    }
}

/// Σ B_j/F u_j in observer form. The first coefficient of input j is at the lag `lags[j]`, 0 or 1; B of all inputs one after the other.
fn observer(f: &[f64], b: &[f64], lags: &[usize]) -> InnovationsModel {
    let (m, nb) = (lags.len(), b.len() / lags.len().max(1));
    let last = lags.iter().map(|l| l + nb - 1).max().unwrap_or(0);
    let n = f.len().max(last);
    let pole = |i: usize| f.get(i).copied().unwrap_or(0.0);
    let at = |lag: usize, j: usize| {
        lag.checked_sub(lags[j]).filter(|i| *i < nb).map_or(0.0, |i| b[j * nb + i])
    };
    InnovationsModel {
        a: DMatrix::from_fn(
            n,
            n,
            |i, j| if j == 0 { -pole(i) } else { f64::from(u8::from(j == i + 1)) },
        ),
        // F also feeds back the direct path.
        b: DMatrix::from_fn(n, m, |i, j| at(i + 1, j) - pole(i) * at(0, j)),
        c: DMatrix::from_fn(1, n, |_, j| f64::from(u8::from(j == 0))),
        d: DMatrix::from_fn(1, m, |_, j| at(0, j)),
        k: DMatrix::zeros(n, 1),
    }
}
